//! Frame rates that cannot be right, noticed by the gait.
//!
//! Who walks faster takes longer and more frequent steps, in a ratio that hardly depends on the speed: step length divided
//! by step frequency, the *walk ratio*, is about 0.4 m/Hz for adults (Sekiya and Nagasaki, 1998), and not very different
//! for a run. A motion that is played twice as fast has half of it, one at half the speed twice.
//!
//! People who are old, shy or tired, who walk backwards or jog slowly take shorter steps than that. They do not take them in
//! haste, so that only a gait of short and quick steps is too fast. Which steps are quick differs between walks and runs;
//! which of both it is does not depend on the frame rate: who walks is highest over the standing foot, who runs between
//! the steps.

use glam::{Vec2, Vec3};
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::stats::median_upper;
use radarllm_base::{Joint, Motion};

use crate::sample::resample;

/// Rate at which the gait is looked at, Hz.
const RATE_HZ: f64 = 30.0;
/// Slowest walk that is looked at, m/s.
const MIN_SPEED_MPS: f32 = 0.5;
/// Time over which the speed of the pelvis is averaged, frames: 0.5 s.
const SPEED_FRAMES: usize = 15;
/// Least distance of the feet along the way that makes a step, m.
const MIN_FEET_M: f32 = 0.1;
/// Shortest way of the pelvis between two steps that counts, m. A way that begins within a step is shorter.
const MIN_STEP_M: f32 = 0.2;
/// Least number of steps that a gait is judged by.
const MIN_STEPS: usize = 4;
/// Walk ratios of people, m/Hz; smaller ones with steps of a shorter time than [`MIN_WALK_S`] or [`MIN_RUN_S`] are too fast.
///
/// Measured with the BVH files of walks, runs and dashes of the Bandai-Namco data set 1 in 15 styles, 30 frames/s. Of 91
/// files, none is refused as it is (73 have enough steps to be judged). Played 1.5, 2 and 4 times as fast, 36 of 71, 55 of
/// 63 and 33 of 33 are; of the style `normal`, all that are judged. What passes at twice the rate are slow walks of the
/// styles proud, sad and not-confident.
const PEOPLE: std::ops::RangeInclusive<f32> = 0.26..=0.65;
/// Time of the quickest short steps of people who walk, s. In the same files, the quickest are 0.40 s, and 0.37 s or less in
/// normal walks that are played 1.5 times as fast.
const MIN_WALK_S: f32 = 0.38;
/// The same of people who run, s: the quickest are 0.27 s, and 0.23 s or less in runs that are played twice as fast.
const MIN_RUN_S: f32 = 0.25;
/// Correlation of height and distance of the feet above which a gait is a run. In the same files, runs and dashes with short
/// steps have 0.38 to 0.75; of all runs, one has less than 0.2. Normal walks have -0.65 and less.
const RUN_CORRELATION: f32 = 0.25;
/// Root mean square of heights below which a body does not rise and fall, m.
const MIN_RISE_M: f32 = 1e-3;

/// Steps of somebody who walks or runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gait {
    /// Number of steps.
    pub n_steps: usize,
    /// Median length of a step, m.
    pub step_m: f32,
    /// Median time of a step, s.
    pub step_s: f32,
    /// Correlation of the height of the pelvis with the distance of the feet along the way: negative in a walk, positive in a
    /// run, whatever the frame rate.
    pub height_correlation: f32,
}

impl Gait {
    /// The gait of a motion; `None` if fewer than four steps forward are found in it.
    pub fn of(motion: &Motion) -> Option<Self> {
        let motion = resample(motion, RATE_HZ).ok()?;
        let joints = motion.joints_in_world();
        let at = |joints: &[Vec3; N_JOINTS], joint: Joint| joints[joint as usize].truncate();
        let feet = |joints: &[Vec3; N_JOINTS]| {
            [Joint::Pelvis, Joint::LeftAnkle, Joint::RightAnkle].map(|joint| at(joints, joint))
        };
        let frames: Vec<[Vec2; 3]> = joints.iter().map(feet).collect();
        let heights_m: Vec<f32> = joints.iter().map(|j| j[Joint::Pelvis as usize].z).collect();
        // Frame and side of the last step.
        let mut last: Option<(usize, bool)> = None;
        let mut steps: Vec<(f32, f32)> = Vec::new();
        // Distance of the feet, and height of the pelvis above its mean over a second.
        let mut spread: Vec<(f32, f32)> = Vec::new();
        for i in SPEED_FRAMES..frames.len().saturating_sub(SPEED_FRAMES) {
            let way = frames[i + SPEED_FRAMES][0] - frames[i - SPEED_FRAMES][0];
            let speed_mps = way.length() * RATE_HZ as f32 / (2 * SPEED_FRAMES) as f32;
            let forward = way.normalize_or_zero();
            if speed_mps < MIN_SPEED_MPS {
                last = None;
                continue;
            }
            let ahead_m = (frames[i][1] - frames[i][2]).dot(forward);
            let around = &heights_m[i - SPEED_FRAMES..=i + SPEED_FRAMES];
            let mean_m = around.iter().sum::<f32>() / around.len() as f32;
            spread.push((ahead_m.abs(), heights_m[i] - mean_m));
            if ahead_m.abs() < MIN_FEET_M {
                continue;
            }
            let is_left = ahead_m > 0.0;
            match last {
                Some((_, side)) if side == is_left => {}
                Some((before, _)) => {
                    let step_m = frames[i][0].distance(frames[before][0]);
                    if step_m >= MIN_STEP_M {
                        steps.push((step_m, (i - before) as f32 / RATE_HZ as f32));
                    }
                    last = Some((i, is_left));
                }
                None => last = Some((i, is_left)),
            }
        }
        if steps.len() < MIN_STEPS {
            return None;
        }
        Some(Self {
            n_steps: steps.len(),
            step_m: median_upper(steps.iter().map(|s| s.0))?,
            step_s: median_upper(steps.iter().map(|s| s.1))?,
            height_correlation: correlation(&spread),
        })
    }

    /// Step length divided by step frequency, m/Hz.
    pub fn walk_ratio(&self) -> f32 {
        self.step_m * self.step_s
    }

    /// What is wrong with the gait, if people cannot walk like this.
    pub fn problem(&self) -> Option<String> {
        let min_s = match self.height_correlation > RUN_CORRELATION {
            true => MIN_RUN_S,
            false => MIN_WALK_S,
        };
        let what = match self.walk_ratio() {
            ratio if ratio > *PEOPLE.end() => "too slow",
            ratio if ratio < *PEOPLE.start() && self.step_s < min_s => "too fast",
            _ => return None,
        };
        Some(format!(
            "steps of {:.2} m every {:.2} s: the motion is {what}, is its frame rate wrong?",
            self.step_m, self.step_s
        ))
    }
}

/// Correlation of distances and heights; 0 if the heights are constant.
fn correlation(pairs: &[(f32, f32)]) -> f32 {
    let n = pairs.len().max(1) as f32;
    let sum = |of: &dyn Fn(&(f32, f32)) -> f32| pairs.iter().map(of).sum::<f32>();
    let (a_mean, b_mean) = (sum(&|p| p.0) / n, sum(&|p| p.1) / n);
    let product = sum(&|p| (p.0 - a_mean) * (p.1 - b_mean));
    let a_square = sum(&|p| (p.0 - a_mean).powi(2));
    let b_square = sum(&|p| (p.1 - b_mean).powi(2));
    match a_square > 0.0 && b_square > n * MIN_RISE_M * MIN_RISE_M {
        true => product / (a_square * b_square).sqrt(),
        false => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::{FRAC_PI_2, TAU};

    use glam::Quat;
    use radarllm_base::Pose;

    use super::*;
    use crate::canonical_skeleton;

    /// Six seconds of a walk with 1.9 steps a second, at 100 frames/s.
    fn walk(speed_mps: f32) -> Motion {
        gait(speed_mps, 1.9, 0.0)
    }

    /// Six seconds of a gait at 100 frames/s. The pelvis rises by `flight_m` while the feet are apart.
    fn gait(speed_mps: f32, steps_per_s: f32, flight_m: f32) -> Motion {
        let pose = |i: u16| {
            let t_s = f32::from(i) / 100.0;
            let phase = (0.5 * TAU * steps_per_s * t_s).sin();
            let swing_rad = 0.4 * phase;
            let mut rotations = [Quat::IDENTITY; N_JOINTS];
            // y, up in the skeleton, becomes z; z, forward, becomes -y.
            rotations[Joint::Pelvis as usize] = Quat::from_rotation_x(FRAC_PI_2);
            rotations[Joint::LeftHip as usize] = Quat::from_rotation_x(swing_rad);
            rotations[Joint::RightHip as usize] = Quat::from_rotation_x(-swing_rad);
            Pose {
                root_in_world: Vec3::new(0.0, -speed_mps * t_s, 0.95 + flight_m * phase.abs()),
                rotations,
            }
        };
        Motion {
            fps: 100.0,
            skeleton: canonical_skeleton(1.75),
            poses: (0..600).map(pose).collect(),
        }
    }

    #[test]
    fn steps_are_found_and_a_wrong_frame_rate_is_noticed() {
        let mut motion = walk(1.3);
        let gait = Gait::of(&motion).unwrap();
        assert!((gait.step_s - 1.0 / 1.9).abs() < 0.02, "{gait:?}");
        assert!((gait.step_m - 1.3 / 1.9).abs() < 0.03, "{gait:?}");
        assert!((8..=11).contains(&gait.n_steps), "{gait:?}");
        assert_eq!(gait.problem(), None);
        motion.fps = 200.0;
        let problem = Gait::of(&motion).unwrap().problem().unwrap();
        assert!(problem.contains("too fast"), "{problem}");
        motion.fps = 50.0;
        let problem = Gait::of(&motion).unwrap().problem().unwrap();
        assert!(problem.contains("too slow"), "{problem}");
    }

    #[test]
    fn short_steps_are_those_of_people_unless_they_are_quick_for_their_gait() {
        let problem = |speed_mps, steps_per_s, flight_m| {
            let gait = Gait::of(&gait(speed_mps, steps_per_s, flight_m)).unwrap();
            (gait.height_correlation, gait.problem())
        };
        // An old person: steps of 0.40 m every 0.60 s.
        let (height_correlation, found) = problem(0.67, 1.67, -0.02);
        assert!(height_correlation < -0.5 && found.is_none(), "{found:?}");
        // A slow run: 0.67 m every 0.33 s. A walk of the same steps is one that is played too fast.
        let (height_correlation, found) = problem(2.0, 3.0, 0.05);
        assert!(height_correlation > 0.5 && found.is_none(), "{found:?}");
        let (_, found) = problem(2.0, 3.0, -0.02);
        assert!(found.is_some_and(|p| p.contains("too fast")));
        // The run played twice as fast.
        let mut motion = gait(2.0, 3.0, 0.05);
        motion.fps *= 2.0;
        let found = Gait::of(&motion).unwrap().problem();
        assert!(found.is_some_and(|p| p.contains("too fast")));
    }

    #[test]
    fn who_goes_too_fast_for_the_steps_is_noticed() {
        let problem = Gait::of(&walk(2.4)).unwrap().problem().unwrap();
        assert!(problem.contains("steps of 1.2"), "{problem}");
    }

    #[test]
    fn who_does_not_go_has_no_gait() {
        assert_eq!(Gait::of(&walk(0.2)), None);
        let mut short = walk(1.3);
        short.poses.truncate(100);
        assert_eq!(Gait::of(&short), None);
    }
}
