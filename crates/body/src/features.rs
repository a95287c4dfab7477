//! HumanML3D feature vectors: 263 numbers per frame at 20 frames per second.
//!
//! | columns | content |
//! |---|---|
//! | 0 | yaw velocity of the root: half the turn about the vertical from this frame to the next, rad |
//! | 1..3 | horizontal root velocity (left, forward) in the heading of the next frame, m per frame |
//! | 3 | root height, m |
//! | 4..67 | joints 1..21, heading frame, horizontal origin below the root, m |
//! | 67..193 | local rotations of joints 1..21, first two columns of the matrix |
//! | 193..259 | velocities of joints 0..21 in this frame's heading, m per frame |
//! | 259..263 | left ankle, left foot, right ankle, right foot on the ground (0 or 1) |
//!
//! The axes are those of the original: x is left, y is up, and z is forward in the first frame,
//! which starts at the origin. As in the original, the yaw velocity is the arcsine of a quaternion
//! component, the heading is smoothed over time (Gaussian of 20 frames), and contact means a
//! squared step below 0.002 m^2. There are two differences. The skeleton is not rescaled to the
//! reference body of the original. The rotations are those of the motion itself, not the result of
//! inverse kinematics on the joint positions.
//!
//! Source: Guo et al., *Generating Diverse and Natural 3D Human Motions from Text*, CVPR 2022.

use crate::sample::{canonicalize, resample_unchecked};
use glam::{Mat3, Quat, Vec3};
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::{Joint, Motion};

/// Numbers per frame.
pub const HUMANML3D_DIM: usize = 263;
/// Frames per second.
pub const HUMANML3D_FPS: f64 = 20.0;

/// Squared displacement between frames below which an ankle or a foot counts as in contact with the
/// ground, m^2.
const CONTACT_STEP_M2: f32 = 0.002;
/// Standard deviation of the temporal smoothing of the heading, frames.
const HEADING_SIGMA: f32 = 20.0;

/// HumanML3D features of a motion as a row-major array `[n_frames - 1][263]`, where `n_frames` is
/// the number of frames of the motion at 20 fps. The array is empty for motions with fewer than two
/// such frames.
pub fn humanml3d_features(motion: &Motion) -> Vec<f32> {
    let mut motion = resample_unchecked(motion, HUMANML3D_FPS);
    canonicalize(&mut motion);
    let joints: Vec<[Vec3; N_JOINTS]> = motion
        .joints_in_world()
        .iter()
        .map(|row| row.map(|p| Vec3::new(p.x, p.z, -p.y)))
        .collect();
    if joints.len() < 2 {
        return Vec::new();
    }
    let headings = smooth(&joints.iter().map(forward_of).collect::<Vec<_>>());
    // Rotation from the canonical frame into the heading's frame.
    let local_from_world: Vec<Quat> = headings
        .iter()
        .map(|f| Quat::from_rotation_y(-f.x.atan2(f.z)))
        .collect();

    let mut out = Vec::with_capacity((joints.len() - 1) * HUMANML3D_DIM);
    for t in 0..joints.len() - 1 {
        let (now, next) = (&joints[t], &joints[t + 1]);
        let (local, local_next) = (local_from_world[t], local_from_world[t + 1]);
        let mut turn = local_next * local.conjugate();
        if turn.w < 0.0 {
            turn = -turn;
        }
        let travel = local_next * (next[0] - now[0]);
        out.extend([turn.y.clamp(-1.0, 1.0).asin(), travel.x, travel.z, now[0].y]);
        let below_root = Vec3::new(now[0].x, 0.0, now[0].z);
        for position in &now[1..] {
            out.extend((local * (*position - below_root)).to_array());
        }
        for rotation in &motion.poses[t].rotations[1..] {
            let matrix = Mat3::from_quat(*rotation);
            out.extend(matrix.x_axis.to_array());
            out.extend(matrix.y_axis.to_array());
        }
        for (a, b) in now.iter().zip(next) {
            out.extend((local * (*b - *a)).to_array());
        }
        for joint in [
            Joint::LeftAnkle,
            Joint::LeftFoot,
            Joint::RightAnkle,
            Joint::RightFoot,
        ] {
            let step = next[joint as usize].distance_squared(now[joint as usize]);
            out.push(f32::from(u8::from(step < CONTACT_STEP_M2)));
        }
    }
    out
}

/// Joint positions from features, `[frame][joint]`, in world axes (z up), m. This is the inverse of
/// columns 0..67. The motion starts at x = y = 0 and faces -y.
pub fn joints_from_features(features: &[f32]) -> Vec<[Vec3; N_JOINTS]> {
    let mut yaw_half_rad = 0.0_f32;
    let mut root = Vec3::ZERO;
    let mut frames = Vec::with_capacity(features.len() / HUMANML3D_DIM);
    let mut previous: Option<&[f32]> = None;
    for row in features.chunks_exact(HUMANML3D_DIM) {
        if let Some(before) = previous {
            yaw_half_rad += before[0];
            let local_from_world = Quat::from_rotation_y(2.0 * yaw_half_rad);
            root += local_from_world.conjugate() * Vec3::new(before[1], 0.0, before[2]);
        }
        let world_from_local = Quat::from_rotation_y(-2.0 * yaw_half_rad);
        let mut joints = [Vec3::ZERO; N_JOINTS];
        joints[0] = Vec3::new(root.x, row[3], root.z);
        for (j, local) in row[4..67].chunks_exact(3).enumerate() {
            joints[j + 1] = world_from_local * Vec3::from_slice(local) + root;
        }
        frames.push(joints.map(|p| Vec3::new(p.x, -p.z, p.y)));
        previous = Some(row);
    }
    frames
}

/// Horizontal forward direction of one frame, y-up axes.
fn forward_of(joints: &[Vec3; N_JOINTS]) -> Vec3 {
    let across = joints[Joint::LeftHip as usize] - joints[Joint::RightHip as usize]
        + joints[Joint::LeftShoulder as usize]
        - joints[Joint::RightShoulder as usize];
    across.cross(Vec3::Y).try_normalize().unwrap_or(Vec3::Z)
}

/// Gaussian smoothing over time with repeated end values, truncated at four standard deviations.
fn smooth(directions: &[Vec3]) -> Vec<Vec3> {
    let radius = (4.0 * HEADING_SIGMA) as isize;
    let last = directions.len() as isize - 1;
    (0..=last)
        .map(|t| {
            let sum: Vec3 = (-radius..=radius)
                .map(|k| {
                    let weight = (-0.5 * (k as f32 / HEADING_SIGMA).powi(2)).exp();
                    directions[(t + k).clamp(0, last) as usize] * weight
                })
                .sum();
            sum.try_normalize().unwrap_or(directions[t as usize])
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proportions::canonical_skeleton;
    use radarllm_base::Pose;
    use radarllm_base::frames::world_from_rest_facing_radar;

    /// A motion at 60 fps that moves forward at 1 m/s while turning left at 0.5 rad/s.
    fn curve() -> Motion {
        let mut rotations = [Quat::IDENTITY; N_JOINTS];
        let mut root_in_world = Vec3::new(2.0, 1.0, 0.5);
        let poses = (0..181)
            .map(|t| {
                let yaw = Quat::from_rotation_z(0.5 * t as f32 / 60.0 + 0.9);
                rotations[0] = yaw * world_from_rest_facing_radar();
                rotations[Joint::RightElbow as usize] = Quat::from_rotation_y(0.3);
                root_in_world += yaw * Vec3::NEG_Y / 60.0;
                Pose {
                    root_in_world,
                    rotations,
                }
            })
            .collect();
        Motion {
            fps: 60.0,
            skeleton: canonical_skeleton(1.72),
            poses,
        }
    }

    #[test]
    fn steady_curve_has_the_closed_form_values() {
        let features = humanml3d_features(&curve());
        assert_eq!(features.len(), 60 * HUMANML3D_DIM);
        // The middle frame is unaffected by the ends of the smoothing window.
        let row = &features[30 * HUMANML3D_DIM..31 * HUMANML3D_DIM];
        // Turning left (about +y): the heading's inverse turns by -0.5 rad/s / 20 fps, halved.
        // The ends of a three-second clip pull the smoothed heading by a few per cent.
        assert!((row[0] + 0.0125).abs() < 0.0025, "{}", row[0]);
        // 5 cm forward per frame.
        assert!(
            (row[2] - 0.05).abs() < 1e-3 && row[1].abs() < 3e-3,
            "{} {}",
            row[1],
            row[2]
        );
        assert!((row[3] - 0.560 * 1.72).abs() < 1e-3);
        // The left hip is on the left by the offset of the skeleton; the hip rotations are the
        // identity.
        assert!((row[4] - 0.036 * 1.72).abs() < 2e-3);
        assert_eq!(&row[67..73], &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        // The root moves 5 cm per frame and the feet slide with it: 0.0025 m^2 exceeds the contact
        // threshold.
        assert!((row[193 + 2] - 0.05).abs() < 2e-3);
        assert!(row[259..263].iter().all(|c| *c == 0.0));
    }

    #[test]
    fn still_feet_are_contacts() {
        let mut motion = curve();
        let first = motion.poses[0].clone();
        motion.poses.fill(first);
        let features = humanml3d_features(&motion);
        assert!(
            features
                .chunks_exact(HUMANML3D_DIM)
                .all(|row| row[259..] == [1.0; 4])
        );
    }

    #[test]
    fn features_give_the_joints_back() {
        let motion = curve();
        let features = humanml3d_features(&motion);
        let back = joints_from_features(&features);
        let mut canonical = resample_unchecked(&motion, HUMANML3D_FPS);
        canonicalize(&mut canonical);
        let joints = canonical.joints_in_world();
        // The features contain no absolute heading: the first smoothed heading becomes forward.
        let f = |p: &[Vec3; N_JOINTS]| forward_of(&p.map(|v| Vec3::new(v.x, v.z, -v.y)));
        let (seen, wanted) = (f(&back[0]), f(&joints[0]));
        let turn = Quat::from_rotation_z(wanted.x.atan2(wanted.z) - seen.x.atan2(seen.z));
        for (a, b) in back.iter().zip(&joints) {
            for (p, q) in a.iter().zip(b) {
                // The tolerance covers f32 sums over 60 frames; a wrong turn or step would cause
                // errors of decimetres.
                assert!((turn * *p).distance(*q) < 1e-3, "{p} {q}");
            }
        }
    }

    #[test]
    fn single_frame_has_no_features() {
        let mut motion = curve();
        motion.poses.truncate(1);
        assert!(humanml3d_features(&motion).is_empty());
    }
}
