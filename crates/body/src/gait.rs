//! Frame rates that cannot be right, noticed by the gait.
//!
//! Who walks faster takes longer and more frequent steps, in a ratio that hardly depends on the speed: step length divided
//! by step frequency, the *walk ratio*, is about 0.4 m/Hz for adults (Sekiya and Nagasaki, 1998), and not very different
//! for a run. A motion that is played twice as fast has half of it, one at half the speed twice.

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
const MIN_STEP_M: f32 = 0.1;
/// Least number of steps that a gait is judged by.
const MIN_STEPS: usize = 4;
/// Walk ratios of people, m/Hz.
const PEOPLE: std::ops::RangeInclusive<f32> = 0.26..=0.65;

/// Steps of somebody who walks or runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gait {
    /// Number of steps.
    pub n_steps: usize,
    /// Median length of a step, m.
    pub step_m: f32,
    /// Median time of a step, s.
    pub step_s: f32,
}

impl Gait {
    /// The gait of a motion; `None` if fewer than four steps forward are found in it.
    pub fn of(motion: &Motion) -> Option<Self> {
        let motion = resample(motion, RATE_HZ).ok()?;
        let at = |joints: &[Vec3; N_JOINTS], joint: Joint| joints[joint as usize].truncate();
        let feet = |joints: &[Vec3; N_JOINTS]| {
            [Joint::Pelvis, Joint::LeftAnkle, Joint::RightAnkle].map(|joint| at(joints, joint))
        };
        let frames: Vec<[Vec2; 3]> = motion.joints_in_world().iter().map(feet).collect();
        // Frame and side of the last step.
        let mut last: Option<(usize, bool)> = None;
        let mut steps: Vec<(f32, f32)> = Vec::new();
        for i in SPEED_FRAMES..frames.len().saturating_sub(SPEED_FRAMES) {
            let way = frames[i + SPEED_FRAMES][0] - frames[i - SPEED_FRAMES][0];
            let speed_mps = way.length() * RATE_HZ as f32 / (2 * SPEED_FRAMES) as f32;
            let forward = way.normalize_or_zero();
            if speed_mps < MIN_SPEED_MPS {
                last = None;
                continue;
            }
            let ahead_m = (frames[i][1] - frames[i][2]).dot(forward);
            if ahead_m.abs() < MIN_STEP_M {
                continue;
            }
            let is_left = ahead_m > 0.0;
            match last {
                Some((_, side)) if side == is_left => {}
                Some((before, _)) => {
                    let step_m = frames[i][0].distance(frames[before][0]);
                    steps.push((step_m, (i - before) as f32 / RATE_HZ as f32));
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
        })
    }

    /// Step length divided by step frequency, m/Hz.
    pub fn walk_ratio(&self) -> f32 {
        self.step_m * self.step_s
    }

    /// What is wrong with the gait, if people cannot walk like this.
    pub fn problem(&self) -> Option<String> {
        let what = match self.walk_ratio() {
            ratio if PEOPLE.contains(&ratio) => return None,
            ratio if ratio < *PEOPLE.start() => "too fast",
            _ => "too slow",
        };
        Some(format!(
            "steps of {:.2} m every {:.2} s: the motion is {what}, is its frame rate wrong?",
            self.step_m, self.step_s
        ))
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
        let pose = |i: u16| {
            let t_s = f32::from(i) / 100.0;
            let swing_rad = 0.4 * (TAU * 0.95 * t_s).sin();
            let mut rotations = [Quat::IDENTITY; N_JOINTS];
            // y, up in the skeleton, becomes z; z, forward, becomes -y.
            rotations[Joint::Pelvis as usize] = Quat::from_rotation_x(FRAC_PI_2);
            rotations[Joint::LeftHip as usize] = Quat::from_rotation_x(swing_rad);
            rotations[Joint::RightHip as usize] = Quat::from_rotation_x(-swing_rad);
            Pose {
                root_in_world: Vec3::new(0.0, -speed_mps * t_s, 0.95),
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
