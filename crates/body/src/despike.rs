//! Glitches of motion capture: poses of a few frames that are far from those before and after.
//!
//! Files of the CMU database have some, where a marker was lost or an angle passed a singularity: a knee that moves at
//! 49 m/s. A radar would see them as very fast targets, and the simulator refuses them.

use glam::Vec3;
use radarllm_base::{Joint, Motion, Pose};

/// Distance of the frames on both sides that a pose is compared with, frames.
const REACH: usize = 2;
/// Error of a joint's position without a glitch, m.
const ERROR_M: f32 = 0.03;
/// Largest acceleration of a joint, m/s^2: more than that of a foot that hits the floor.
const ACCELERATION_MPS2: f32 = 300.0;
/// Longest glitch that is repaired, s.
const LONGEST_S: f64 = 0.15;
/// Largest share of frames in glitches.
const LARGEST_SHARE: f64 = 0.1;
/// Fastest that a joint of a person moves, m/s.
const FASTEST_MPS: f32 = 20.0;

/// Replaces glitches by interpolated poses. Returns the number of poses that were replaced.
///
/// # Errors
/// Says where the motion jumps, if it cannot be repaired: for longer than 0.15 s, in more than a tenth of the frames, or from
/// one place to another.
pub fn despike(motion: &mut Motion) -> Result<usize, String> {
    let joints = motion.joints_in_world();
    let reach_s = REACH as f32 / motion.fps as f32;
    let limit_m = ERROR_M + 0.5 * ACCELERATION_MPS2 * reach_s * reach_s;
    let mut is_bad = vec![false; joints.len()];
    for i in REACH..joints.len().saturating_sub(REACH) {
        let [before, after] = [&joints[i - REACH], &joints[i + REACH]];
        is_bad[i] = (0..joints[i].len())
            .any(|j| joints[i][j].distance(0.5 * (before[j] + after[j])) > limit_m);
    }
    let n_bad = is_bad.iter().filter(|bad| **bad).count();
    if n_bad as f64 > LARGEST_SHARE * joints.len() as f64 {
        return Err(format!("{n_bad} of {} poses are glitches", joints.len()));
    }
    let mut start = 0;
    while start < is_bad.len() {
        let end = start + is_bad[start..].iter().take_while(|bad| **bad).count();
        if end > start {
            let time_s = start as f64 / motion.fps;
            if (end - start) as f64 > LONGEST_S * motion.fps {
                return Err(format!("the motion jumps at {time_s:.2} s"));
            }
            // The first and the last frames are never bad.
            let [from, to] = [start - 1, end].map(|i| motion.poses[i].clone());
            for i in start..end {
                let share = (i + 1 - start) as f32 / (end + 1 - start) as f32;
                motion.poses[i] = between(&from, &to, share);
            }
        }
        start = end.max(start + 1);
    }
    match fastest(motion) {
        Some((time_s, speed_mps)) => Err(format!(
            "a joint moves at {speed_mps:.0} m/s at {time_s:.2} s"
        )),
        None => Ok(n_bad),
    }
}

fn between(from: &Pose, to: &Pose, share: f32) -> Pose {
    let mut pose = from.clone();
    pose.root_in_world = from.root_in_world.lerp(to.root_in_world, share);
    for joint in Joint::ALL {
        let j = joint as usize;
        pose.rotations[j] = from.rotations[j].slerp(to.rotations[j], share);
    }
    pose
}

/// Time, s, and speed of the fastest joint, m/s, if no person moves like this.
fn fastest(motion: &Motion) -> Option<(f64, f32)> {
    let joints = motion.joints_in_world();
    let step = |pair: &[[Vec3; radarllm_base::skeleton::N_JOINTS]]| {
        let ways = pair[0].iter().zip(&pair[1]).map(|(a, b)| a.distance(*b));
        ways.fold(0.0, f32::max) * motion.fps as f32
    };
    let speeds = joints.windows(2).map(step).enumerate();
    let (i, speed_mps) = speeds.max_by(|a, b| a.1.total_cmp(&b.1))?;
    (speed_mps > FASTEST_MPS).then_some((i as f64 / motion.fps, speed_mps))
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use glam::Quat;

    use super::*;
    use crate::canonical_skeleton;

    /// A person who kicks at 120 frames/s: the knee bends and stretches with up to 14 rad/s.
    fn kick() -> Motion {
        let pose = |i: u16| {
            let mut rotations = [Quat::IDENTITY; radarllm_base::skeleton::N_JOINTS];
            let angle_rad = 1.2 * (PI * f32::from(i) / 30.0).sin();
            rotations[Joint::LeftHip as usize] = Quat::from_rotation_x(-angle_rad);
            Pose {
                root_in_world: Vec3::new(0.0, 0.01 * f32::from(i), 0.9),
                rotations,
            }
        };
        Motion {
            fps: 120.0,
            skeleton: canonical_skeleton(1.75),
            poses: (0..240).map(pose).collect(),
        }
    }

    #[test]
    fn a_fast_kick_is_no_glitch() {
        let mut motion = kick();
        assert_eq!(despike(&mut motion), Ok(0));
        assert_eq!(motion, kick());
    }

    #[test]
    fn a_glitch_is_replaced_by_what_is_around_it() {
        let mut motion = kick();
        for i in 100..104 {
            motion.poses[i].rotations[Joint::LeftHip as usize] = Quat::from_rotation_x(2.0);
            motion.poses[i].root_in_world.z += 0.3;
        }
        let n = despike(&mut motion).unwrap();
        assert!((4..=8).contains(&n), "{n}");
        let [own, repaired] = [kick(), motion].map(|m| m.joints_in_world());
        for (i, (own, repaired)) in own.iter().zip(&repaired).enumerate() {
            for (a, b) in own.iter().zip(repaired) {
                assert!(a.distance(*b) < 0.12, "frame {i}: {}", a.distance(*b));
            }
        }
    }

    #[test]
    fn what_cannot_be_repaired_is_refused() {
        let mut away = kick();
        for pose in &mut away.poses[120..] {
            pose.root_in_world.x += 3.0;
        }
        let error = despike(&mut away).unwrap_err();
        assert!(error.contains("m/s at 1.0"), "{error}");
        let mut noisy = kick();
        for pose in noisy.poses.iter_mut().step_by(7) {
            pose.root_in_world.x += 1.0;
        }
        let error = despike(&mut noisy).unwrap_err();
        assert!(error.contains("of 240 poses are glitches"), "{error}");
        let mut short = kick();
        short.poses.truncate(3);
        assert_eq!(despike(&mut short), Ok(0));
    }
}
