//! Groups points into tubes by anchor and time.
//!
//! A tube is one anchor at one step. It contains the points of the step's three frames (2s - 1, 2s, 2s + 1: temporal
//! stride 2, padding [1, 0]) that are within the radius of the anchor. Only tubes with points are listed.

use radarllm_base::{PointFrame, stats::median_upper};
use serde::{Deserialize, Serialize};

use super::centre::track_centre;
use super::config::{AnchorMode, FRAMES_PER_CODE, FRAMES_PER_STEP, GroupingConfig, MAX_FRAMES};
use super::doppler_profile::{PROFILE_DIM, doppler_profile};

pub use radarllm_engine::tokenizer::{NEIGHBOUR_DIM, STEP_DIM, TUBE_DIM, Tube};

/// Scale of the range, m: ranges are divided by it.
pub(super) const RANGE_SCALE_M: f32 = 3.0;
/// Scale of the velocities, m/s: velocities are divided by it.
const VELOCITY_SCALE_MPS: f32 = 2.0;
/// Scale of the relative intensity, dB: intensities are divided by it.
const INTENSITY_SCALE_DB: f32 = 10.0;
/// Radar frame period from which speeds are derived, s.
const FRAME_PERIOD_S: f32 = 0.1;

/// A clip as tubes.
#[derive(Clone, Debug, PartialEq)]
pub struct Grouped {
    /// Number of steps that begin inside the clip.
    pub n_steps: usize,
    /// Number of codes: one per four frames. The last code may cover fewer.
    pub n_codes: usize,
    /// Tubes that contain points, ordered by step, then anchor.
    pub tubes: Vec<Tube>,
    /// Neighbours of all tubes: those of a tube are in order of frames and then of distance. See [`NEIGHBOUR_DIM`].
    pub neighbours: Vec<[f32; NEIGHBOUR_DIM]>,
    /// Values of each step; see [`STEP_DIM`].
    pub steps: Vec<[f32; STEP_DIM]>,
    /// Values of each step; see [`super::doppler_profile`].
    pub profiles: Vec<[f32; PROFILE_DIM]>,
    /// Anchors relative to the centre and the floor, m: `[anchor]` for a template,
    /// `[step][anchor]` for farthest-point sampling.
    pub anchors: Vec<[f32; 3]>,
    /// Number of points that belong to at least one tube.
    pub n_points_used: usize,
}

/// Reasons why points cannot be grouped.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum GroupingError {
    /// The clip has no frame.
    #[error("no radar frame")]
    Empty,
    /// The clip has more frames than the network can process at once.
    #[error("{found} radar frames, at most {MAX_FRAMES} at once")]
    TooLong {
        /// Number of frames.
        found: usize,
    },
    /// A coordinate, velocity, intensity or the radar's height is NaN or infinite.
    #[error("frame {frame}, point {point}: value is not finite")]
    NotFinite {
        /// Index of the frame.
        frame: usize,
        /// Index of the point.
        point: usize,
    },
    /// The radar's height is not finite.
    #[error("radar height {0} m is not finite")]
    Height(f32),
}

/// Grid anchors relative to the centre (x, y) and the floor (z), m; x slowest, z fastest.
pub fn template_anchors(config: &GroupingConfig) -> Vec<[f32; 3]> {
    let [nx, ny, nz] = config.counts;
    let centred = |i: usize, n: usize, step: f32| (i as f32 - 0.5 * (n as f32 - 1.0)) * step;
    let mut anchors = Vec::with_capacity(nx * ny * nz);
    for ix in 0..nx {
        for iy in 0..ny {
            for iz in 0..nz {
                anchors.push([
                    centred(ix, nx, config.step_m[0]),
                    centred(iy, ny, config.step_m[1]),
                    config.z_min_m + iz as f32 * config.step_m[2],
                ]);
            }
        }
    }
    anchors
}

/// Groups a clip's points around its anchors.
///
/// # Errors
/// If there is no frame, too many, or a value is not finite.
pub fn group(
    frames: &[PointFrame],
    radar_height_m: f32,
    config: &GroupingConfig,
) -> Result<Grouped, GroupingError> {
    let clip = PlacedClip::new(frames, radar_height_m, config)?;
    Ok(clip.group(config, |_, _| true))
}

/// Which points of a clip a mask of anchors hides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hides {
    /// None: the masked anchors' tubes are left out, but nearly all of their points are also in tubes of visible anchors,
    /// because tubes overlap about tenfold.
    Tubes,
    /// The points whose nearest anchor is masked, at a step that contains them.
    Nearest,
    /// All points within the radius of a masked anchor, at a step that contains them. With half of the anchors masked
    /// almost no point remains.
    Reach,
}

/// A clip with masked anchors, divided into what a mask leaves and what it hides.
#[derive(Clone, Debug, PartialEq)]
pub struct MaskedClip {
    /// Tubes and step values of the visible points alone.
    pub visible: Grouped,
    /// Tubes of the hidden points alone.
    pub hidden: Grouped,
}

/// Groups a clip whose anchors are masked where `masked[anchor]` is true. A point is either in tubes of
/// [`MaskedClip::visible`] or in tubes of [`MaskedClip::hidden`]. The anchors, the centres and the Doppler profiles of
/// both are those of all points: anchors and centres are the frame of reference in which points are reconstructed.
///
/// # Errors
/// As [`group`].
pub fn group_masked(
    frames: &[PointFrame],
    radar_height_m: f32,
    config: &GroupingConfig,
    masked: &[bool],
    hides: Hides,
) -> Result<MaskedClip, GroupingError> {
    let clip = PlacedClip::new(frames, radar_height_m, config)?;
    let hidden = clip.hidden(config, masked, hides);
    Ok(MaskedClip {
        visible: clip.group(config, |frame, point| !hidden[frame][point]),
        hidden: clip.group(config, |frame, point| hidden[frame][point]),
    })
}

/// The points of a clip with the anchors of every step.
struct PlacedClip {
    points: Vec<Vec<Point>>,
    centres: Vec<[f32; 2]>,
    /// Anchors relative to the centre and the floor, for every step of farthest-point sampling; otherwise the template
    /// alone.
    anchors: Vec<Vec<[f32; 3]>>,
}

impl PlacedClip {
    fn new(
        frames: &[PointFrame],
        radar_height_m: f32,
        config: &GroupingConfig,
    ) -> Result<Self, GroupingError> {
        check(frames, radar_height_m)?;
        let points: Vec<Vec<Point>> = clip_points(frames, radar_height_m, config.max_points);
        let centres = track_centre(frames, config);
        let anchors = match config.anchors {
            AnchorMode::Template => vec![template_anchors(config)],
            AnchorMode::FarthestPoint => {
                let n_anchors = config.counts.iter().product();
                let middles = (0..frames.len()).step_by(FRAMES_PER_STEP);
                let sampled = |i: usize| farthest_points(&points[i], centres[i], n_anchors);
                middles.map(sampled).collect()
            }
        };
        Ok(Self {
            points,
            centres,
            anchors,
        })
    }

    fn n_steps(&self) -> usize {
        self.points.len().div_ceil(FRAMES_PER_STEP)
    }

    /// Frames of a step.
    fn window(&self, step: usize) -> std::ops::Range<usize> {
        let middle = step * FRAMES_PER_STEP;
        middle.saturating_sub(1)..(middle + 2).min(self.points.len())
    }

    /// Positions of the anchors of a step, m.
    fn places(&self, step: usize) -> impl Iterator<Item = [f32; 3]> {
        let centre = self.centres[step * FRAMES_PER_STEP];
        let anchors = self.anchors.get(step).unwrap_or(&self.anchors[0]);
        let place = move |a: &[f32; 3]| [centre[0] + a[0], centre[1] + a[1], a[2]];
        anchors.iter().map(place)
    }

    /// Whether each point of each frame is hidden.
    fn hidden(&self, config: &GroupingConfig, masked: &[bool], hides: Hides) -> Vec<Vec<bool>> {
        let is_masked = |anchor: usize| masked.get(anchor).copied() == Some(true);
        let mut hidden: Vec<Vec<bool>> = self.points.iter().map(|p| vec![false; p.len()]).collect();
        let reach = config.radius_m * config.radius_m;
        for step in 0..self.n_steps() {
            let places: Vec<[f32; 3]> = self.places(step).collect();
            for frame in self.window(step) {
                for (point, hidden) in self.points[frame].iter().zip(&mut hidden[frame]) {
                    let squares = places.iter().map(|at| squared_distance(point.at, *at));
                    *hidden |= match hides {
                        Hides::Tubes => false,
                        Hides::Nearest => {
                            let nearest = squares.enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
                            nearest.is_some_and(|(anchor, _)| is_masked(anchor))
                        }
                        Hides::Reach => squares
                            .enumerate()
                            .any(|(anchor, square)| square <= reach && is_masked(anchor)),
                    };
                }
            }
        }
        hidden
    }

    /// Groups the points that `keeps` of their frame and number.
    fn group(&self, config: &GroupingConfig, keeps: impl Fn(usize, usize) -> bool) -> Grouped {
        let Self {
            points, centres, ..
        } = self;
        let n_anchors: usize = config.counts.iter().product();
        let n_steps = self.n_steps();
        let mut grouped = Grouped {
            n_steps,
            n_codes: points.len().div_ceil(FRAMES_PER_CODE),
            tubes: Vec::new(),
            neighbours: Vec::new(),
            steps: Vec::with_capacity(n_steps),
            profiles: Vec::with_capacity(n_steps),
            anchors: Vec::new(),
            n_points_used: 0,
        };
        let mut used: Vec<Vec<bool>> = points.iter().map(|p| vec![false; p.len()]).collect();
        let mut near: Vec<(f32, usize)> = Vec::new();
        for step in 0..n_steps {
            let middle = step * FRAMES_PER_STEP;
            let window = self.window(step);
            for (anchor, at) in self.places(step).enumerate() {
                let start = grouped.neighbours.len();
                let (mut n_in_radius, mut velocity_sum) = (0usize, 0.0f32);
                for frame_idx in window.clone() {
                    near.clear();
                    for (i, p) in points[frame_idx].iter().enumerate() {
                        let square = squared_distance(p.at, at);
                        if square <= config.radius_m * config.radius_m && keeps(frame_idx, i) {
                            near.push((square, i));
                        }
                    }
                    n_in_radius += near.len();
                    // In a tie the stronger point, which comes first, is used.
                    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                    near.truncate(config.k_per_frame);
                    for &(_, i) in &near {
                        let p = &points[frame_idx][i];
                        used[frame_idx][i] = true;
                        velocity_sum += p.velocity;
                        let relative = |axis: usize| (p.at[axis] - at[axis]) / config.radius_m;
                        grouped.neighbours.push([
                            relative(0),
                            relative(1),
                            relative(2),
                            frame_idx as f32 - middle as f32,
                            p.range,
                            p.velocity,
                            p.intensity,
                        ]);
                    }
                }
                let end = grouped.neighbours.len();
                if end > start {
                    grouped.tubes.push(Tube {
                        step: step as u32,
                        anchor: anchor as u32,
                        start: start as u32,
                        end: end as u32,
                        statistics: [
                            (n_in_radius as f32).ln_1p() / 3.0,
                            velocity_sum / (end - start) as f32,
                        ],
                    });
                }
            }
            if config.anchors == AnchorMode::FarthestPoint {
                let mut sampled = self.anchors[step].clone();
                sampled.resize(n_anchors, [0.0; 3]);
                grouped.anchors.extend(sampled);
            }
            let seen = points[window.clone()].iter().flatten();
            let profile = doppler_profile(seen, centres[middle]);
            grouped.profiles.push(profile);
            let values = step_features(points, centres, window, middle, &keeps);
            grouped.steps.push(values);
        }
        if config.anchors == AnchorMode::Template {
            grouped.anchors.clone_from(&self.anchors[0]);
        }
        grouped.n_points_used = used.iter().flatten().filter(|u| **u).count();
        grouped
    }
}

fn squared_distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

/// A point above the floor with scaled features.
pub(super) struct Point {
    /// Position; z above the floor, m.
    pub(super) at: [f32; 3],
    range: f32,
    velocity: f32,
    intensity: f32,
}

impl Point {
    /// Radial velocity, m/s, within what the network's scale can hold.
    pub(super) fn velocity_mps(&self) -> f32 {
        self.velocity * VELOCITY_SCALE_MPS
    }

    /// Linear amplitude relative to the clip's median, within 40 dB of it.
    pub(super) fn amplitude(&self) -> f32 {
        10f32.powf(self.intensity * INTENSITY_SCALE_DB / 20.0)
    }
}

fn check(frames: &[PointFrame], radar_height_m: f32) -> Result<(), GroupingError> {
    if frames.is_empty() {
        return Err(GroupingError::Empty);
    }
    if frames.len() > MAX_FRAMES {
        return Err(GroupingError::TooLong {
            found: frames.len(),
        });
    }
    if !radar_height_m.is_finite() {
        return Err(GroupingError::Height(radar_height_m));
    }
    for (frame, f) in frames.iter().enumerate() {
        for (point, p) in f.points.iter().enumerate() {
            // A value of 1e6 in any unit cannot come from a radar point. The limit keeps squares finite.
            let values = [
                p.x_m,
                p.y_m,
                p.z_m,
                p.range_m,
                p.velocity_mps,
                p.intensity_db,
            ];
            if !values.iter().all(|v| v.abs() < 1e6) {
                return Err(GroupingError::NotFinite { frame, point });
            }
        }
    }
    Ok(())
}

fn clip_points(frames: &[PointFrame], radar_height_m: f32, max_points: usize) -> Vec<Vec<Point>> {
    let kept = |f: &PointFrame| f.points.len().min(max_points);
    // Intensities of different radars and gains differ by a constant, so only differences are used.
    let db = frames
        .iter()
        .flat_map(|f| f.points[..kept(f)].iter().map(|p| p.intensity_db));
    let median_db = median_upper(db).unwrap_or(0.0);
    let point = |p: &radarllm_base::RadarPoint| Point {
        at: [p.x_m, p.y_m, p.z_m + radar_height_m],
        range: (p.range_m / RANGE_SCALE_M - 1.0).clamp(-4.0, 4.0),
        velocity: (p.velocity_mps / VELOCITY_SCALE_MPS).clamp(-4.0, 4.0),
        intensity: ((p.intensity_db - median_db) / INTENSITY_SCALE_DB).clamp(-4.0, 4.0),
    };
    frames
        .iter()
        .map(|f| f.points[..kept(f)].iter().map(point).collect())
        .collect()
}

fn step_features(
    points: &[Vec<Point>],
    centres: &[[f32; 2]],
    window: std::ops::Range<usize>,
    middle: usize,
    keeps: impl Fn(usize, usize) -> bool,
) -> [f32; STEP_DIM] {
    let before = middle.saturating_sub(FRAMES_PER_STEP);
    let after = (middle + FRAMES_PER_STEP).min(centres.len() - 1);
    let elapsed_s = ((after - before) as f32 * FRAME_PERIOD_S).max(FRAME_PERIOD_S);
    let speed = |axis: usize| (centres[after][axis] - centres[before][axis]) / elapsed_s;
    let (mut n, mut velocity) = (0usize, 0.0f32);
    for frame in window {
        let kept = points[frame].iter().enumerate();
        for (_, p) in kept.filter(|(i, _)| keeps(frame, *i)) {
            n += 1;
            velocity += p.velocity;
        }
    }
    [
        (centres[middle][0] / RANGE_SCALE_M).clamp(-4.0, 4.0),
        (centres[middle][1] / RANGE_SCALE_M - 1.0).clamp(-4.0, 4.0),
        speed(0).clamp(-4.0, 4.0),
        speed(1).clamp(-4.0, 4.0),
        (n as f32).ln_1p() / 3.0 - 1.0,
        velocity / n.max(1) as f32,
    ]
}

/// Selects at most `n` points by farthest-point sampling, starting with the strongest.
fn farthest_points(points: &[Point], centre: [f32; 2], n: usize) -> Vec<[f32; 3]> {
    let mut chosen = Vec::new();
    let mut distance = vec![f32::INFINITY; points.len()];
    let mut next = (!points.is_empty()).then_some(0);
    while let Some(i) = next {
        let p = points[i].at;
        chosen.push([p[0] - centre[0], p[1] - centre[1], p[2]]);
        for (d, q) in distance.iter_mut().zip(points) {
            let square: f32 = (0..3).map(|axis| (q.at[axis] - p[axis]).powi(2)).sum();
            *d = d.min(square);
        }
        next = (0..points.len()).max_by(|a, b| distance[*a].total_cmp(&distance[*b]));
        if chosen.len() == n || next.is_none_or(|i| distance[i] == 0.0) {
            break;
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_base::RadarPoint;

    fn point(x: f32, y: f32, z: f32) -> RadarPoint {
        RadarPoint {
            x_m: x,
            y_m: y,
            z_m: z,
            range_m: y,
            ..Default::default()
        }
    }

    #[test]
    fn grids_are_the_published_ones() {
        let paper = super::super::config::TokenizerConfig::paper();
        let anchors = template_anchors(&paper.grouping);
        assert_eq!(anchors.len(), 81);
        for (found, expected) in anchors[0].iter().zip([-0.3, -0.3, -0.3]) {
            assert!((found - expected).abs() < 1e-6);
        }
        // mmMesh: the top layer lies 2.1 m above the floor.
        assert!((anchors[80][2] - 2.1).abs() < 1e-5);
        assert_eq!(template_anchors(&GroupingConfig::default()).len(), 54);
    }

    /// Compares every neighbour with an exhaustive search.
    #[test]
    fn tubes_hold_exactly_the_nearest_points_of_their_window() {
        let mut frames = Vec::new();
        for f in 0..5 {
            let points = (0..40).map(|i| {
                let t = (f * 40 + i) as f32;
                point(
                    (t * 0.37).sin() * 0.8,
                    3.0 + (t * 0.61).cos() * 0.8,
                    (t * 0.23).sin(),
                )
            });
            frames.push(PointFrame {
                points: points.collect(),
                ..Default::default()
            });
        }
        let config = GroupingConfig {
            k_per_frame: 3,
            ..Default::default()
        };
        let grouped = group(&frames, 1.0, &config).unwrap();
        let centres = track_centre(&frames, &config);
        assert_eq!((grouped.n_steps, grouped.n_codes), (3, 2));
        let mut n_tubes = 0;
        for step in 0..3usize {
            for (anchor, place) in template_anchors(&config).iter().enumerate() {
                let c = centres[2 * step];
                let at = [c[0] + place[0], c[1] + place[1], place[2]];
                let mut expected = 0;
                for offset in -1i32..=1 {
                    let Some(frame) = usize::try_from(2 * step as i32 + offset)
                        .ok()
                        .and_then(|f| frames.get(f))
                    else {
                        continue;
                    };
                    let within = frame.points.iter().filter(|p| {
                        let d = [p.x_m - at[0], p.y_m - at[1], p.z_m + 1.0 - at[2]];
                        d.iter().map(|v| v * v).sum::<f32>() <= 0.45 * 0.45
                    });
                    expected += within.count().min(3);
                }
                let tube = grouped
                    .tubes
                    .iter()
                    .find(|t| t.step == step as u32 && t.anchor == anchor as u32);
                assert_eq!(tube.map_or(0, |t| t.end - t.start) as usize, expected);
                n_tubes += usize::from(expected > 0);
            }
        }
        assert_eq!(grouped.tubes.len(), n_tubes);
        let in_ball =
            |n: &[f32; NEIGHBOUR_DIM]| n[..3].iter().map(|v| v * v).sum::<f32>() <= 1.0 + 1e-5;
        assert!(grouped.neighbours.iter().all(in_ball));
    }

    #[test]
    fn tubes_do_not_depend_on_where_the_person_stands() {
        let clip = |x: f32, y: f32| -> Vec<PointFrame> {
            let points = |f: usize| {
                (0..30).map(move |i| {
                    let t = (f * 30 + i) as f32;
                    // Multiples of 1/64 add to the shifts without rounding.
                    let q = |v: f32| (v * 64.0).round() / 64.0;
                    let mut p = point(
                        x + q((t * 0.7).sin() * 0.5),
                        y + q((t * 0.3).cos() * 0.5),
                        q((t * 0.9).sin()),
                    );
                    p.range_m = 3.0;
                    p
                })
            };
            (0..8)
                .map(|f| PointFrame {
                    points: points(f).collect(),
                    ..Default::default()
                })
                .collect()
        };
        let config = GroupingConfig::default();
        let a = group(&clip(0.0, 2.0), 1.0, &config).unwrap();
        let b = group(&clip(1.0, 4.0), 1.0, &config).unwrap();
        assert_eq!(a.tubes.len(), b.tubes.len());
        for (p, q) in a.neighbours.iter().zip(&b.neighbours) {
            // Centres differ by rounding of sums near 4 m, divided by the radius.
            assert!(p.iter().zip(q).all(|(u, v)| (u - v).abs() < 1e-5));
        }
    }

    /// A person who walks sideways: points on the surface of a body, `n` in a frame.
    fn walking(n: usize) -> Vec<PointFrame> {
        let frame = |f: usize| {
            let points = (0..n).map(|i| {
                let t = (f * n + i) as f32;
                let wave = |rate: f32| (t * rate).sin();
                let x = 0.05 * f as f32 - 1.0 + 0.35 * wave(2.399);
                let mut p = point(x, 3.0 + 0.25 * wave(1.713), 0.85 * wave(0.917) - 0.1);
                p.velocity_mps = wave(0.31);
                p
            });
            PointFrame {
                points: points.collect(),
                ..Default::default()
            }
        };
        (0..40).map(frame).collect()
    }

    /// Share of the points in tubes of masked anchors that are in no tube of a visible anchor, and share of all points in
    /// any tube that are still in a tube of a visible anchor. Every second anchor is masked, in a random order.
    fn shares(config: &GroupingConfig, n_points: usize, hides: Hides) -> (f64, f64) {
        let frames = walking(n_points);
        let n_anchors: usize = config.counts.iter().product();
        let mut order: Vec<usize> = (0..n_anchors).collect();
        order.sort_by_key(|a| (a * 7919) % 104_729 % 97);
        let mut masked = vec![false; n_anchors];
        order[..n_anchors / 2]
            .iter()
            .for_each(|a| masked[*a] = true);
        let clip = PlacedClip::new(&frames, 1.0, config).unwrap();
        let hidden = clip.hidden(config, &masked, hides);
        let reach = config.radius_m * config.radius_m;
        let (mut in_masked, mut unseen, mut all, mut seen) = (0.0, 0.0, 0.0, 0.0);
        for (frame, points) in clip.points.iter().enumerate() {
            for (i, p) in points.iter().enumerate() {
                let mut reached = [false; 2];
                for step in (0..clip.n_steps()).filter(|s| clip.window(*s).contains(&frame)) {
                    let places = clip.places(step).zip(&masked);
                    for (_, masked) in places.filter(|(at, _)| squared_distance(p.at, *at) <= reach)
                    {
                        reached[usize::from(*masked)] = true;
                    }
                }
                let visible = reached[0] && !hidden[frame][i];
                all += f64::from(u8::from(reached[0] || reached[1]));
                seen += f64::from(u8::from(visible));
                in_masked += f64::from(u8::from(reached[1]));
                unseen += f64::from(u8::from(reached[1] && !visible));
            }
        }
        (unseen / in_masked, seen / all)
    }

    /// `cargo test -p radarllm-inference masks -- --nocapture` prints the shares that docs/guides/ablations.md quotes.
    #[test]
    fn masks_hide_half_of_the_points_and_not_almost_none_or_all() {
        let paper = super::super::config::TokenizerConfig::paper().grouping;
        for (name, config, n_points) in [
            ("small, 12 points a frame", GroupingConfig::default(), 12),
            ("paper, 128 points a frame", paper, 128),
        ] {
            let [tubes, nearest, reach] =
                [Hides::Tubes, Hides::Nearest, Hides::Reach].map(|hides| {
                    let (unseen, seen) = shares(&config, n_points, hides);
                    println!(
                        "{name}, {hides:?}: {:.3} hidden, {:.3} visible",
                        unseen, seen
                    );
                    (unseen, seen)
                });
            assert!(tubes.0 < 0.05 && tubes.1 > 0.95, "{name}: {tubes:?}");
            assert!((0.35..0.75).contains(&nearest.0), "{name}: {nearest:?}");
            assert!((0.25..0.65).contains(&nearest.1), "{name}: {nearest:?}");
            assert!(reach.0 > 0.99 && reach.1 < 0.05, "{name}: {reach:?}");
        }
    }

    #[test]
    fn a_point_is_visible_or_hidden_and_never_both() {
        let config = GroupingConfig {
            // So many neighbours that none is left out.
            k_per_frame: 128,
            ..GroupingConfig::default()
        };
        let frames = walking(12);
        let n_anchors = 54;
        let masked: Vec<bool> = (0..n_anchors).map(|a| a % 2 == 0).collect();
        let whole = group(&frames, 1.0, &config).unwrap();
        for hides in [Hides::Tubes, Hides::Nearest, Hides::Reach] {
            let parts = group_masked(&frames, 1.0, &config, &masked, hides).unwrap();
            let n_used = parts.visible.n_points_used + parts.hidden.n_points_used;
            assert_eq!(n_used, whole.n_points_used, "{hides:?}");
            let n_neighbours = parts.visible.neighbours.len() + parts.hidden.neighbours.len();
            assert_eq!(n_neighbours, whole.neighbours.len(), "{hides:?}");
            for (step, (visible, all)) in parts.visible.steps.iter().zip(&whole.steps).enumerate() {
                // The centre and its speed stay; the number of points and their velocity are those of the visible ones.
                assert_eq!(visible[..4], all[..4], "{hides:?}, step {step}");
                assert!(visible[4] <= all[4], "{hides:?}, step {step}");
            }
            match hides {
                Hides::Tubes => assert_eq!(parts.visible, whole),
                _ => assert!(parts.visible.steps != whole.steps),
            }
            // No visible point is in a masked tube.
            if hides == Hides::Reach {
                let masked = |t: &&Tube| masked[t.anchor as usize];
                assert_eq!(parts.visible.tubes.iter().filter(masked).count(), 0);
            }
        }
        let none = group_masked(&frames, 1.0, &config, &[], Hides::Nearest).unwrap();
        assert_eq!(none.visible, whole);
        assert!(none.hidden.tubes.is_empty());
    }

    #[test]
    fn hostile_clips_are_errors_and_empty_ones_are_not() {
        let config = GroupingConfig::default();
        assert_eq!(group(&[], 1.0, &config), Err(GroupingError::Empty));
        let long = vec![PointFrame::default(); 97];
        assert_eq!(
            group(&long, 1.0, &config),
            Err(GroupingError::TooLong { found: 97 })
        );
        let nan = PointFrame {
            points: vec![point(0.0, f32::NAN, 0.0)],
            ..Default::default()
        };
        assert_eq!(
            group(&[nan], 1.0, &config),
            Err(GroupingError::NotFinite { frame: 0, point: 0 })
        );
        assert!(group(&[PointFrame::default()], f32::INFINITY, &config).is_err());
        let empty = group(&long[..96], 1.0, &config).unwrap();
        assert_eq!(
            (empty.tubes.len(), empty.n_codes, empty.n_steps),
            (0, 24, 48)
        );
        assert!(empty.steps.iter().flatten().all(|v| v.is_finite()));
    }

    #[test]
    fn farthest_points_spread_out_and_never_repeat() {
        let frame = PointFrame {
            points: vec![
                point(0.0, 3.0, 0.0),
                point(0.01, 3.0, 0.0),
                point(1.0, 3.0, 0.0),
                point(0.0, 3.0, 0.0),
            ],
            ..Default::default()
        };
        let points = clip_points(&[frame], 0.0, 128);
        let chosen = farthest_points(&points[0], [0.0, 3.0], 10);
        assert_eq!(
            chosen,
            vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.01, 0.0, 0.0]]
        );
    }
}
