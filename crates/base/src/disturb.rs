//! Points as another room, threshold, mounting and pace would have given them.
//!
//! A model that learns from simulated points must not depend on what the simulation fixes: how many of the slow points
//! pass the detector, where exactly zero height is, how fast a person moves, and that there is nothing else in the
//! room. [`disturb`] changes all of these at once, at random.

use crate::{PointFrame, RadarPoint, random::SplitMix64};

/// Points with a smaller radial speed are near the threshold of detectors and clutter filters, m/s.
const SLOW_MPS: f32 = 0.7;
/// Shares of the slow points that are kept.
const KEPT_SLOW: [f32; 4] = [1.0, 0.6, 0.3, 0.15];
/// Smallest share of the fast points that is kept.
const KEPT_FAST: f32 = 0.5;
/// Heights about the radar are multiplied by 1 plus or minus up to this.
const HEIGHT_SCALE: f32 = 0.15;
/// Largest error of the elevation angle, rad: heights shift with the range.
const ELEVATION_RAD: f32 = 0.12;
/// Largest error of the radar's height, m.
const HEIGHT_M: f32 = 0.3;
/// The pace changes by a factor between these.
const PACE: [f32; 2] = [0.75, 1.33];
/// Mean number of ghosts in a clip.
const GHOSTS: [f32; 3] = [0.0, 2.0, 6.0];
/// Standard deviation of ghosts about the person, m.
const GHOST_SPREAD_M: f32 = 0.5;

/// Whether [`disturb`] changes the pace of the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// Frames stay where they are, for example because they belong to poses.
    Kept,
    /// The motion becomes faster or slower. A clip that had at most this many frames keeps its end.
    UpTo {
        /// Most frames of the result.
        max_frames: usize,
    },
}

/// Disturbs a clip of frames at a constant rate. The seed determines all changes.
///
/// ```
/// use radarllm_base::{PointFrame, RadarPoint, disturb::{Pace, disturb}};
///
/// let point = RadarPoint { y_m: 2.0, range_m: 2.0, velocity_mps: 1.0, ..RadarPoint::default() };
/// let frame = |i: u32| PointFrame { frame: i, time_s: f64::from(i) / 10.0, points: vec![point; 8], board: None };
/// let frames: Vec<PointFrame> = (0..60).map(frame).collect();
/// let disturbed = disturb(&frames, 10.0, Pace::UpTo { max_frames: 96 }, 7);
/// assert_eq!(disturbed, disturb(&frames, 10.0, Pace::UpTo { max_frames: 96 }, 7));
/// assert_ne!(disturbed, frames);
/// assert!((45..=80).contains(&disturbed.len()));
/// ```
pub fn disturb(
    frames: &[PointFrame],
    frame_rate_hz: f64,
    pace: Pace,
    seed: u64,
) -> Vec<PointFrame> {
    let mut rng = SplitMix64::new(seed);
    let mut within = |low: f32, high: f32| low + (high - low) * rng.uniform_f32();
    let kept_slow = KEPT_SLOW[(within(0.0, 4.0) as usize).min(3)];
    let kept_fast = kept_slow.max(KEPT_FAST);
    let scale = within(1.0 - HEIGHT_SCALE, 1.0 + HEIGHT_SCALE);
    let elevation_rad = within(-ELEVATION_RAD, ELEVATION_RAD);
    let height_m = within(-HEIGHT_M, HEIGHT_M);
    let drawn = PACE[0] * (PACE[1] / PACE[0]).powf(within(0.0, 1.0));
    let (pace, max_frames) = match pace {
        Pace::Kept => (1.0, frames.len()),
        Pace::UpTo { max_frames } => {
            let slowest = max_frames.max(frames.len()) as f32 / frames.len().max(1) as f32;
            (drawn.min(slowest), max_frames)
        }
    };
    let n_ghosts = GHOSTS[(within(0.0, 3.0) as usize).min(2)] * within(0.0, 2.0);
    let centre = centre(frames);

    let n_frames = ((frames.len() as f32 * pace).round() as usize).min(max_frames);
    let mut out: Vec<PointFrame> = (0..n_frames)
        .map(|i| {
            let source = ((i as f32 / pace) as usize).min(frames.len() - 1);
            let change = |p: &RadarPoint| {
                let z_m = p.z_m * scale + elevation_rad * p.range_m + height_m;
                RadarPoint {
                    z_m,
                    velocity_mps: p.velocity_mps / pace,
                    ..*p
                }
            };
            let mut points: Vec<RadarPoint> = frames[source].points.iter().map(change).collect();
            points.retain(|p| {
                let slow = p.velocity_mps.abs() * pace < SLOW_MPS;
                within(0.0, 1.0) < if slow { kept_slow } else { kept_fast }
            });
            PointFrame {
                frame: i as u32,
                time_s: i as f64 / frame_rate_hz,
                points,
                board: None,
            }
        })
        .collect();
    for _ in 0..n_ghosts.round() as usize {
        let at = (within(0.0, n_frames as f32) as usize).min(n_frames.saturating_sub(1));
        // The sum of three uniform numbers has a standard deviation of half their width.
        let mut around = |c: f32| {
            let sum: f32 = (0..3).map(|_| within(-1.0, 1.0)).sum();
            c + GHOST_SPREAD_M * sum
        };
        let [x_m, y_m, z_m] = centre.map(&mut around);
        let velocity_mps = if within(0.0, 1.0) < 0.5 { -0.6 } else { 0.6 };
        if let Some(frame) = out.get_mut(at) {
            frame.points.push(RadarPoint {
                x_m,
                y_m,
                z_m,
                range_m: (x_m * x_m + y_m * y_m + z_m * z_m).sqrt(),
                velocity_mps,
                intensity_db: within(10.0, 20.0),
            });
        }
    }
    out
}

/// Mean position of all points, m.
fn centre(frames: &[PointFrame]) -> [f32; 3] {
    let points = || frames.iter().flat_map(|f| &f.points);
    let n = points().count().max(1) as f32;
    let mean = |value: fn(&RadarPoint) -> f32| points().map(value).sum::<f32>() / n;
    [mean(|p| p.x_m), mean(|p| p.y_m), mean(|p| p.z_m)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clip(n: u32) -> Vec<PointFrame> {
        let point = |k: u32| RadarPoint {
            y_m: 2.0,
            z_m: 0.1 * k as f32,
            range_m: 2.0,
            velocity_mps: 0.3 * k as f32,
            ..RadarPoint::default()
        };
        let frame = |i: u32| PointFrame {
            frame: i,
            time_s: f64::from(i) / 10.0,
            points: (0..8).map(point).collect(),
            board: None,
        };
        (0..n).map(frame).collect()
    }

    #[test]
    fn disturbances_vary_and_stay_finite() {
        let frames = clip(60);
        let (mut shortest, mut longest, mut fewest) = (usize::MAX, 0, usize::MAX);
        for seed in 0..200 {
            let out = disturb(&frames, 10.0, Pace::UpTo { max_frames: 96 }, seed);
            shortest = shortest.min(out.len());
            longest = longest.max(out.len());
            let n_points: usize = out.iter().map(|f| f.points.len()).sum();
            fewest = fewest.min(n_points * 60 / out.len());
            for (i, frame) in out.iter().enumerate() {
                assert!((frame.time_s - i as f64 / 10.0).abs() < 1e-9);
                for p in &frame.points {
                    assert!(p.z_m.is_finite() && p.range_m > 0.0 && p.velocity_mps.abs() < 3.0);
                }
            }
        }
        assert!(
            shortest <= 48 && longest >= 75,
            "{shortest} to {longest} frames"
        );
        assert!(fewest < 60 * 5, "at fewest {fewest} points");
    }

    #[test]
    fn a_clip_keeps_its_end() {
        for seed in 0..50 {
            let pace = Pace::UpTo { max_frames: 96 };
            assert!(disturb(&clip(96), 10.0, pace, seed).len() <= 96);
            assert!(disturb(&clip(3), 10.0, pace, seed).len() <= 4);
            assert_eq!(disturb(&clip(60), 10.0, Pace::Kept, seed).len(), 60);
        }
        assert!(disturb(&[], 10.0, Pace::Kept, 1).is_empty());
    }
}
