//! Detection of ghost tracks: multipath reflections of a person over a wall.
//!
//! A flat wall produces a second image of a person behind it. There are two kinds of path.
//! - Both ways over the wall: the waves come from the mirror image of the person.
//! - One way over the wall: the range is the mean of both path lengths, and the bearing is between those of the person
//!   and of the mirror image. The array receives from another direction than it transmits to, so it is not determined
//!   which bearing dominates, and the elevation is meaningless.
//!
//! Both kinds are farther away than the person, both are attenuated by the reflection, and the wall determines the
//! motion of both. One plane therefore explains every frame. A plane rarely explains a second person for long.

use std::f64::consts::PI;

use radarllm_base::{PointFrame, RadarPoint, stats::median_upper};

use crate::tracker::{Track, TrackFrame};

/// Minimum number of frames in which both tracks are seen.
const MIN_FRAMES: usize = 10;
/// Minimum path length of the person within these frames, m. For a person who stands still, some mirror plane explains
/// any other track.
const MIN_PATH_M: f64 = 0.5;
/// Minimum loss of a ghost relative to the person, dB, after removal of the fourth power of range from both. Concrete
/// and plaster attenuate by 7 to 12 dB per reflection; two paths of equal length recover part of that. The levels of
/// two people differ by a few dB.
const MIN_LOSS_DB: f64 = 4.0;
/// Minimum share of the frames in which the ghost is farther away than the person.
const FARTHER_SHARE: f64 = 0.9;
/// Standard deviations of a ghost about the position that the plane predicts: in range, across the line of sight, and
/// in radial velocity. They are those of medians over a cluster.
const SIGMA: [f64; 3] = [0.2, 0.6, 0.4];
/// Maximum root mean square residual, in these standard deviations, at which a plane explains a track. A walker beside
/// a concrete wall measures 0.4.
const MAX_MISFIT: f64 = 0.7;
/// Maximum contribution of one frame to the sum of squares. A cluster that was split once is no evidence against a
/// ghost.
const MAX_SQUARE: f64 = 9.0;
/// Step sizes of the search over planes.
const STEP_RAD: f64 = PI / 90.0;
const STEP_M: f64 = 0.1;
/// Minimum and maximum distance of the wall from the radar, m.
const WALL_M: [f64; 2] = [0.3, 12.0];

/// Propagation path of a ghost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GhostPath {
    /// Over the wall on the way out and on the way back.
    BothWays,
    /// Over the wall on one of the two ways only.
    OneWay,
}

/// A track that is a multipath ghost of another track.
#[derive(Clone, Debug, PartialEq)]
pub struct Ghost {
    /// Number of the ghost's track.
    pub id: u32,
    /// Number of the person's track.
    pub of: u32,
    /// Propagation path.
    pub path: GhostPath,
    /// Bearing of the foot of the perpendicular from the radar to the wall, rad, to the right of boresight. For a wall
    /// beside a person near boresight, the side may be wrong.
    pub wall_azimuth_rad: f64,
    /// Distance of the wall from the radar, m.
    pub wall_m: f64,
    /// Root mean square residual of the fit of the wall, in standard deviations.
    pub misfit: f64,
    /// Median loss relative to the person, dB, with the dependence on range removed.
    pub loss_db: f64,
}

/// Finds tracks that are reflections of others over a flat upright wall, at most one ghost per track.
///
/// Two tracks are compared over the frames in which both are seen. There must be at least ten such frames, and the
/// person must move 0.5 m in them. A track is a ghost of the person if all of these hold:
/// - it is farther away in nine of ten frames;
/// - it is weaker by 4 dB (median of the points' summed power, after removal of the fourth power of range);
/// - one plane explains its ranges, bearings and radial velocities with an rms residual of at most 0.7 standard
///   deviations (0.2 m in range, 0.6 m across the line of sight, 0.4 m/s).
///
/// Two people who stand still are never classified as ghosts. A ghost whose person is not tracked is not found. A
/// person who follows another in single file, and is weaker because of shadowing, may be misclassified as a ghost. For
/// this reason ghosts are removed only on request.
pub fn find_ghosts(tracks: &[Track], frames: &[PointFrame]) -> Vec<Ghost> {
    let mut found = Vec::new();
    for ghost in tracks {
        let best = tracks
            .iter()
            .filter(|person| person.id != ghost.id)
            .filter_map(|person| compare(person, ghost, frames))
            .min_by(|a, b| a.misfit.total_cmp(&b.misfit));
        found.extend(best);
    }
    found
}

/// A person and a candidate ghost in one frame.
struct Pair {
    person_m: [f64; 2],
    person_mps: [f64; 2],
    ghost: Seen,
    loss_db: f64,
}

/// Medians over the points of a track in one frame.
struct Seen {
    range_m: f64,
    /// x / range.
    right: f64,
    velocity_mps: f64,
    /// Summed power with the dependence on the fourth power of range removed, dB.
    level_db: f64,
}

fn compare(person: &Track, ghost: &Track, frames: &[PointFrame]) -> Option<Ghost> {
    let pairs: Vec<Pair> = ghost
        .frames
        .iter()
        .filter_map(|g| {
            let first = person.frames.first()?.frame;
            let p = person.frames.get(g.frame.checked_sub(first)?)?;
            pair(p, g, frames.get(g.frame)?)
        })
        .collect();
    if pairs.len() < MIN_FRAMES {
        return None;
    }
    let range = |[x, y]: [f64; 2]| x.hypot(y);
    let n_farther = pairs
        .iter()
        .filter(|p| p.ghost.range_m > range(p.person_m))
        .count();
    let start = pairs[0].person_m;
    let way_m = pairs
        .iter()
        .map(|p| range([p.person_m[0] - start[0], p.person_m[1] - start[1]]))
        .fold(0.0, f64::max);
    let loss_db = median_upper(pairs.iter().map(|p| p.loss_db))?;
    if (n_farther as f64) < FARTHER_SHARE * pairs.len() as f64
        || way_m < MIN_PATH_M
        || loss_db < MIN_LOSS_DB
    {
        return None;
    }
    let n_azimuths = (2.0 * PI / STEP_RAD) as usize;
    let n_distances = ((WALL_M[1] - WALL_M[0]) / STEP_M) as usize;
    let mut best: Option<Ghost> = None;
    for path in [GhostPath::BothWays, GhostPath::OneWay] {
        for i in 0..n_azimuths {
            let wall_azimuth_rad = i as f64 * STEP_RAD - PI;
            for j in 0..=n_distances {
                let wall_m = WALL_M[0] + j as f64 * STEP_M;
                let Some(misfit) = misfit(&pairs, path, wall_azimuth_rad, wall_m) else {
                    continue;
                };
                if misfit <= best.as_ref().map_or(MAX_MISFIT, |b| b.misfit) {
                    best = Some(Ghost {
                        id: ghost.id,
                        of: person.id,
                        path,
                        wall_azimuth_rad,
                        wall_m,
                        misfit,
                        loss_db,
                    });
                }
            }
        }
    }
    best
}

fn pair(person: &TrackFrame, ghost: &TrackFrame, frame: &PointFrame) -> Option<Pair> {
    let (person_seen, ghost) = (seen(person, frame)?, seen(ghost, frame)?);
    // Ghost and person are compared by measured range, which includes height. The person is therefore placed at the
    // tracked bearing and the measured range.
    let [x, y] = person.place_m;
    let scale = person_seen.range_m / x.hypot(y).max(1e-6);
    Some(Pair {
        person_m: [x * scale, y * scale],
        person_mps: person.velocity_mps,
        loss_db: person_seen.level_db - ghost.level_db,
        ghost,
    })
}

fn seen(at: &TrackFrame, frame: &PointFrame) -> Option<Seen> {
    let points: Vec<_> = at
        .points
        .iter()
        .filter_map(|i| frame.points.get(*i as usize))
        .collect();
    let median = |value: fn(&RadarPoint) -> f32| {
        median_upper(points.iter().map(|p| value(p))).map(f64::from)
    };
    let range_m = median(|p| p.range_m)?.max(0.1);
    let power: f64 = points
        .iter()
        .map(|p| 10_f64.powf(f64::from(p.intensity_db) / 10.0))
        .sum();
    Some(Seen {
        range_m,
        right: median(|p| p.x_m / p.range_m.max(0.1))?,
        velocity_mps: median(|p| p.velocity_mps)?,
        level_db: 10.0 * power.max(f64::MIN_POSITIVE).log10() + 40.0 * range_m.log10(),
    })
}

/// Root mean square residual of the ghost for a wall; `None` if the person is ever behind the wall.
fn misfit(pairs: &[Pair], path: GhostPath, azimuth_rad: f64, wall_m: f64) -> Option<f64> {
    let normal = [azimuth_rad.sin(), azimuth_rad.cos()];
    let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
    let mut sum = 0.0;
    for pair in pairs {
        let depth_m = wall_m - dot(normal, pair.person_m);
        if depth_m <= 0.0 {
            return None;
        }
        let image_m: [f64; 2] =
            std::array::from_fn(|i| pair.person_m[i] + 2.0 * depth_m * normal[i]);
        let along = dot(normal, pair.person_mps);
        let image_mps: [f64; 2] =
            std::array::from_fn(|i| pair.person_mps[i] - 2.0 * along * normal[i]);
        let sight = |p: [f64; 2]| {
            let range_m = p[0].hypot(p[1]).max(1e-6);
            (range_m, [p[0] / range_m, p[1] / range_m])
        };
        let (person_range_m, person_sight) = sight(pair.person_m);
        let (image_range_m, image_sight) = sight(image_m);
        let person_radial = dot(person_sight, pair.person_mps);
        let image_radial = dot(image_sight, image_mps);
        let ghost = &pair.ghost;
        let (one, other) = (person_sight[0], image_sight[0]);
        let (range_m, off, radial_mps) = match path {
            GhostPath::BothWays => (image_range_m, ghost.right - other, image_radial),
            GhostPath::OneWay => (
                0.5 * (person_range_m + image_range_m),
                ghost.right - ghost.right.clamp(one.min(other), one.max(other)),
                0.5 * (person_radial + image_radial),
            ),
        };
        let square = ((ghost.range_m - range_m) / SIGMA[0]).powi(2)
            + (off * ghost.range_m / SIGMA[1]).powi(2)
            + ((ghost.velocity_mps - radial_mps) / SIGMA[2]).powi(2);
        sum += square.min(MAX_SQUARE) / 3.0;
    }
    Some((sum / pairs.len() as f64).sqrt())
}
