//! Where in a person the motion is: offsets of the fast, the high and the outermost points from the middle of the body,
//! the path of the body, the duration, and what the points of four bands of height do.
//!
//! The codes describe groups of points over 0.4 s. Which arm moves shows in offsets of 0.1 to 0.4 m that single groups
//! hardly show. Trees that learn such values of simulated clips alone tell left, right and both arms apart in 117 of 161
//! clips of real people's motions with the offsets, and in 159 with the bands (studies/sides.py).

use radarllm_base::stats::{quantile_nearest, rank_nearest};
use radarllm_base::{PointFrame, RadarPoint};

use super::context::bin;

/// Radar frame period, s.
const FRAME_PERIOD_S: f32 = 0.1;
/// The middle of the body is the median of the points of this many frames before and after.
const MIDDLE_FRAMES: usize = 4;
/// Share of the points that are the fast ones.
const FAST: f32 = 0.15;
/// Share of the points that are the high ones.
const HIGH: f32 = 0.1;
/// Share of the high points that are fast high ones.
const FAST_OF_HIGH: f32 = 0.3;
/// Share of the points beyond each of the outermost ones.
const OUTERMOST: f32 = 0.03;
/// Shares of the points, sorted by height, between which the bands of height are: about the legs, the trunk, the shoulders,
/// and the head with raised hands.
const BANDS: [[f32; 2]; 4] = [[0.0, 0.3], [0.5, 0.7], [0.7, 0.85], [0.85, 1.0]];
/// Shares of the points below the heights that are stated.
const HEIGHTS: [f32; 5] = [0.03, 0.25, 0.75, 0.9, 0.97];

/// What a value is, which decides its bins.
#[derive(Clone, Copy)]
enum Kind {
    /// Horizontal offset from the middle of the body, m.
    Offset,
    /// Length of a path, m.
    Path,
    /// s.
    Duration,
    /// m/s.
    Speed,
    /// Distance from the median height, m.
    Height,
}

impl Kind {
    /// Edges between the bins.
    const fn edges(self) -> &'static [f32] {
        match self {
            Self::Offset => &[0.03, 0.06, 0.1, 0.15, 0.2, 0.26, 0.33, 0.42, 0.55, 0.75],
            Self::Path => &[0.1, 0.25, 0.5, 1.0, 2.0],
            Self::Duration => &[1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0],
            Self::Speed => &[
                0.08, 0.12, 0.17, 0.23, 0.3, 0.38, 0.48, 0.6, 0.75, 0.95, 1.2, 1.6,
            ],
            Self::Height => &[
                0.06, 0.1, 0.15, 0.2, 0.26, 0.33, 0.42, 0.52, 0.63, 0.76, 0.9, 1.1,
            ],
        }
    }

    /// Whether negative values have bins of their own.
    const fn is_signed(self) -> bool {
        matches!(self, Self::Offset | Self::Path)
    }

    const fn n_bins(self) -> usize {
        let n = self.edges().len();
        if self.is_signed() { 2 * n + 1 } else { n + 1 }
    }

    /// Index of the bin of a value: of both signs, the bin about 0 is in the middle, and mirrored values have mirrored bins.
    fn bin(self, value: f32) -> usize {
        let (edges, n) = (self.edges(), bin(value.abs(), self.edges()));
        match (self.is_signed(), value < 0.0) {
            (false, _) => n,
            (true, false) => edges.len() + n,
            (true, true) => edges.len() - n,
        }
    }
}

/// Lateral offsets of the points: of the fast ones, of the high ones, of the fast high ones, of the upper half weighted
/// by the square of the speed, and of the outermost ones to the right and to the left.
const N_OFFSETS: usize = 6;
/// Paths: across, along, and how far the middle of the path is beside its ends.
const N_PATHS: usize = 3;
/// Of each band: the quartiles of the lateral offsets, the mean offset along the line of sight, and the mean speed.
const BAND: [Kind; 4] = [Kind::Offset, Kind::Offset, Kind::Offset, Kind::Speed];

/// Number of layout values.
pub(crate) const N_LAYOUT: usize =
    N_OFFSETS + N_PATHS + 1 + BANDS.len() * BAND.len() + HEIGHTS.len();
/// What each layout value is. Models of earlier versions are told the first ones.
const KINDS: [Kind; N_LAYOUT] = kinds();
/// Number of different layout tokens.
pub(super) const N_LAYOUT_TOKENS: usize = first_token(N_LAYOUT);

const fn kinds() -> [Kind; N_LAYOUT] {
    let mut kinds = [Kind::Height; N_LAYOUT];
    let mut i = 0;
    while i < N_LAYOUT - HEIGHTS.len() {
        kinds[i] = if i < N_OFFSETS {
            Kind::Offset
        } else if i < N_OFFSETS + N_PATHS {
            Kind::Path
        } else if i == N_OFFSETS + N_PATHS {
            Kind::Duration
        } else {
            BAND[(i - N_OFFSETS - N_PATHS - 1) % BAND.len()]
        };
        i += 1;
    }
    kinds
}

/// The first token of a value: the number of bins of the values before it.
const fn first_token(value: usize) -> usize {
    let (mut first, mut i) = (0, 0);
    while i < value {
        first += KINDS[i].n_bins();
        i += 1;
    }
    first
}

/// Tokens below [`N_LAYOUT_TOKENS`] of frames at ten per second, each value at its own place.
pub(super) fn layout(frames: &[PointFrame]) -> [usize; N_LAYOUT] {
    let values = values(frames.len(), Body::of(frames).as_ref());
    std::array::from_fn(|i| first_token(i) + KINDS[i].bin(values[i]))
}

/// A point and its offset from the middle of the body at that time: across the line of sight, to the right, and along it.
pub(crate) struct Placed<'a> {
    pub(crate) across_m: f32,
    pub(crate) along_m: f32,
    pub(crate) point: &'a RadarPoint,
}

/// Where the points of frames are in the person.
pub(crate) struct Body<'a> {
    /// Middle of the body in each frame, x and y, m.
    middles: Vec<[f32; 2]>,
    /// All points, sorted by height.
    pub(crate) points: Vec<Placed<'a>>,
}

impl<'a> Body<'a> {
    /// `None` without points.
    pub(crate) fn of(frames: &'a [PointFrame]) -> Option<Self> {
        let middles = middles(frames)?;
        let mut points = placed(frames, &middles);
        points.sort_by(|a, b| a.point.z_m.total_cmp(&b.point.z_m));
        Some(Self { middles, points })
    }
}

/// The layout values of a number of frames; without points, zeros but for the duration.
pub(crate) fn values(n_frames: usize, body: Option<&Body>) -> [f32; N_LAYOUT] {
    let mut values = [0.0; N_LAYOUT];
    let (offsets, rest) = values.split_at_mut(N_OFFSETS);
    let (paths, rest) = rest.split_at_mut(N_PATHS);
    let (duration, rest) = rest.split_at_mut(1);
    let (bands, heights) = rest.split_at_mut(BANDS.len() * BAND.len());
    duration[0] = n_frames as f32 * FRAME_PERIOD_S;
    if let Some(Body { middles, points }) = body {
        offsets.copy_from_slice(&offsets_m(points));
        paths.copy_from_slice(&paths_m(middles));
        for (values, [from, to]) in bands.chunks_exact_mut(BAND.len()).zip(BANDS) {
            let index = |share: f32| (share * points.len() as f32) as usize;
            values.copy_from_slice(&band(&points[index(from)..index(to).min(points.len())]));
        }
        let height_m = |share: f32| {
            points[(share * (points.len() - 1) as f32) as usize]
                .point
                .z_m
        };
        for (value, share) in heights.iter_mut().zip(HEIGHTS) {
            *value = height_m(share) - height_m(0.5);
        }
    }
    values
}

fn placed<'a>(frames: &'a [PointFrame], middles: &[[f32; 2]]) -> Vec<Placed<'a>> {
    let mut all = Vec::with_capacity(frames.iter().map(|f| f.points.len()).sum());
    for (frame, [x_m, y_m]) in frames.iter().zip(middles) {
        // Unit vector along the line of sight; ahead for a person above or below the radar.
        let range_m = x_m.hypot(*y_m);
        let (sin, cos) = match range_m > 1e-3 {
            true => (x_m / range_m, y_m / range_m),
            false => (0.0, 1.0),
        };
        all.extend(frame.points.iter().map(|point| {
            let (dx, dy) = (point.x_m - x_m, point.y_m - y_m);
            Placed {
                across_m: dx * cos - dy * sin,
                along_m: dx * sin + dy * cos,
                point,
            }
        }));
    }
    all
}

/// The offsets of all points, which are sorted by height and at least one.
fn offsets_m(points: &[Placed]) -> [f32; N_OFFSETS] {
    let speed = |p: &Placed| p.point.velocity_mps.abs();
    let fast_mps = quantile(points.iter().map(speed), 1.0 - FAST);
    let fast_of_high_mps = quantile(points.iter().map(speed), 1.0 - FAST_OF_HIGH);
    let height_m = |share| points[rank_nearest(share, points.len() - 1)].point.z_m;
    let (high_m, upper_m) = (height_m(1.0 - HIGH), height_m(0.5));
    let across = |is_one: &dyn Fn(&Placed) -> bool| {
        mean(points.iter().filter(|p| is_one(p)).map(|p| p.across_m))
    };
    let (moment, weight) = points.iter().filter(|p| p.point.z_m > upper_m).fold(
        (0.0, 0.0f32),
        |(moment, weight), p| {
            let square = p.point.velocity_mps * p.point.velocity_mps;
            (moment + square * p.across_m, weight + square)
        },
    );
    let outermost = |share| quantile(points.iter().map(|p| p.across_m), share);
    [
        across(&|p| speed(p) >= fast_mps),
        across(&|p| p.point.z_m >= high_m),
        across(&|p| p.point.z_m >= high_m && speed(p) >= fast_of_high_mps),
        moment / weight.max(1e-6),
        outermost(1.0 - OUTERMOST),
        outermost(OUTERMOST),
    ]
}

/// The paths of the middle of the body.
fn paths_m(middles: &[[f32; 2]]) -> [f32; N_PATHS] {
    let n = middles.len();
    let third = (n / 3).max(1);
    let part = |range: std::ops::Range<usize>, axis: usize| {
        quantile(middles[range].iter().map(|m| m[axis]), 0.5)
    };
    let ends = |axis| (part(0..third, axis), part(n - third..n, axis));
    let ((start_x_m, end_x_m), (start_y_m, end_y_m)) = (ends(0), ends(1));
    let bow_m = match n > 2 * third {
        true => part(third..n - third, 0) - 0.5 * (start_x_m + end_x_m),
        false => 0.0,
    };
    [end_x_m - start_x_m, end_y_m - start_y_m, bow_m]
}

/// The values of a band's points.
fn band(points: &[Placed]) -> [f32; BAND.len()] {
    let across = |share| quantile(points.iter().map(|p| p.across_m), share);
    [
        across(0.25),
        across(0.75),
        mean(points.iter().map(|p| p.along_m)),
        mean(points.iter().map(|p| p.point.velocity_mps.abs())),
    ]
}

/// 0 without values.
fn mean(values: impl Iterator<Item = f32>) -> f32 {
    let (sum, n) = values.fold((0.0, 0.0f32), |(sum, n), value| (sum + value, n + 1.0));
    sum / n.max(1.0)
}

/// Middle of the body in each frame, x and y, m: the median of the points of neighbouring frames, or the nearest earlier
/// middle, else the first one. `None` without points.
fn middles(frames: &[PointFrame]) -> Option<Vec<[f32; 2]>> {
    let own: Vec<Option<[f32; 2]>> = (0..frames.len())
        .map(|i| {
            let near = i.saturating_sub(MIDDLE_FRAMES)..(i + MIDDLE_FRAMES + 1).min(frames.len());
            let points = || frames[near.clone()].iter().flat_map(|f| &f.points);
            points().next()?;
            Some([
                quantile(points().map(|p| p.x_m), 0.5),
                quantile(points().map(|p| p.y_m), 0.5),
            ])
        })
        .collect();
    let mut last = own.iter().flatten().next().copied()?;
    Some(
        own.into_iter()
            .map(|middle| {
                last = middle.unwrap_or(last);
                last
            })
            .collect(),
    )
}

/// The value below which a share of the values is; 0 without values.
pub(crate) fn quantile(values: impl Iterator<Item = f32>, share: f32) -> f32 {
    quantile_nearest(values, share).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_base::random::SplitMix64;

    fn values_of(frames: &[PointFrame]) -> [f32; N_LAYOUT] {
        values(frames.len(), Body::of(frames).as_ref())
    }

    /// A body of 0.4 m at 3 m, and a hand beside and above it that moves.
    fn gesture(hand_m: f32) -> Vec<PointFrame> {
        let mut rng = SplitMix64::new(3);
        let frame = |i: u32| {
            let mut points: Vec<RadarPoint> = (0..24)
                .map(|_| RadarPoint {
                    x_m: 0.4 * (rng.uniform_f32() - 0.5),
                    y_m: 3.0,
                    z_m: rng.uniform_f32() - 0.7,
                    velocity_mps: 0.1 * rng.uniform_f32(),
                    ..RadarPoint::default()
                })
                .collect();
            points.extend((0..6).map(|k| RadarPoint {
                x_m: hand_m,
                y_m: 2.9,
                z_m: 0.5 + 0.05 * k as f32,
                velocity_mps: if i.is_multiple_of(2) { 0.8 } else { -0.8 },
                ..RadarPoint::default()
            }));
            PointFrame {
                points,
                ..PointFrame::default()
            }
        };
        (0..40).map(frame).collect()
    }

    #[test]
    fn the_side_of_a_moving_hand_is_stated() {
        let zero = Kind::Offset.edges().len();
        for (hand_m, is_beyond) in [
            (-0.4, std::cmp::Ordering::Less),
            (0.4, std::cmp::Ordering::Greater),
        ] {
            let tokens = layout(&gesture(hand_m));
            // Fast, high, fast high and weighted points are those of the hand.
            for (i, token) in tokens[..4].iter().enumerate() {
                assert_eq!(
                    (token - first_token(i)).cmp(&zero),
                    is_beyond,
                    "{i} {hand_m}"
                );
            }
        }
    }

    #[test]
    fn mirrored_points_have_mirrored_tokens() {
        let frames = gesture(0.35);
        let mut mirrored = frames.clone();
        mirrored.iter_mut().for_each(PointFrame::mirror);
        let (a, b) = (layout(&frames), layout(&mirrored));
        // The middle and quartiles are the lower of two in one of both.
        for (a_i, b_i) in [(0, 0), (1, 1), (2, 2), (3, 3), (22, 23), (23, 22)] {
            let bins = [(a[a_i], a_i), (b[b_i], b_i)].map(|(token, i)| token - first_token(i));
            let middles = Kind::Offset.n_bins() - 1;
            assert!(
                bins.iter().sum::<usize>().abs_diff(middles) <= 1,
                "{bins:?}"
            );
        }
        // What is along the line of sight, speeds and heights stay.
        for i in [24, 25]
            .into_iter()
            .chain(N_LAYOUT - HEIGHTS.len()..N_LAYOUT)
        {
            assert!(a[i].abs_diff(b[i]) <= 1, "{i}: {} {}", a[i], b[i]);
        }
    }

    #[test]
    fn a_path_to_the_side_is_stated() {
        let walk = |i: u32| PointFrame {
            points: vec![RadarPoint {
                x_m: 0.05 * i as f32,
                y_m: 4.0 - 0.03 * i as f32,
                ..RadarPoint::default()
            }],
            ..PointFrame::default()
        };
        let frames: Vec<PointFrame> = (0..60).map(walk).collect();
        let values = values_of(&frames);
        let (offsets_m, paths_m) = values.split_at(N_OFFSETS);
        assert!((paths_m[0] - 2.0).abs() < 0.1, "{values:?}");
        assert!((paths_m[1] + 1.2).abs() < 0.1, "{values:?}");
        assert!(paths_m[2].abs() < 0.05, "{values:?}");
        assert!(offsets_m.iter().all(|m| m.abs() < 0.1));
    }

    /// Offsets are those across the line of sight, wherever the person is.
    #[test]
    fn a_person_aside_has_the_same_offsets() {
        let ahead = gesture(0.35);
        let (sin, cos) = 0.6f32.sin_cos();
        let mut aside = ahead.clone();
        for p in aside.iter_mut().flat_map(|f| &mut f.points) {
            (p.x_m, p.y_m) = (p.x_m * cos + p.y_m * sin, p.y_m * cos - p.x_m * sin);
        }
        let (a, b) = (values_of(&ahead), values_of(&aside));
        for i in (0..N_OFFSETS).chain(N_OFFSETS + N_PATHS..N_LAYOUT) {
            assert!((a[i] - b[i]).abs() < 0.05, "{i}: {} {}", a[i], b[i]);
        }
    }

    #[test]
    fn bands_state_where_their_points_are() {
        let values = values_of(&gesture(0.35));
        let bands = &values[N_OFFSETS + N_PATHS + 1..];
        // The points of the hand are the highest fifth.
        let [legs, head] = [0, 3].map(|b| &bands[b * BAND.len()..][..BAND.len()]);
        assert!(head[0] > 0.25 && head[1] < 0.4, "{head:?}");
        assert!((head[2] + 0.1).abs() < 0.02 && (head[3] - 0.8).abs() < 1e-3);
        assert!(legs[0] < 0.0 && legs[1] > 0.0 && legs[3] < 0.06, "{legs:?}");
        let heights_m = &bands[BANDS.len() * BAND.len()..];
        assert!(heights_m.is_sorted() && heights_m[1] < 0.0 && heights_m[4] > 0.5);
    }

    #[test]
    fn every_token_has_its_place() {
        let empty = vec![PointFrame::default(); 12];
        for frames in [Vec::new(), empty, gesture(0.4), gesture(-9.0)] {
            let tokens = layout(&frames);
            assert!(tokens.is_sorted() && tokens[N_LAYOUT - 1] < N_LAYOUT_TOKENS);
            for (i, token) in tokens.iter().enumerate() {
                assert!((first_token(i)..first_token(i + 1)).contains(token));
            }
        }
    }
}
