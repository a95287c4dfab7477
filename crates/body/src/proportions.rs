//! Body proportions of an adult: the canonical T-pose skeleton.

use glam::Vec3;
use radarllm_base::Skeleton;
use radarllm_base::skeleton::N_JOINTS;

/// Default standing height, of the person with average proportions, m.
pub const DEFAULT_HEIGHT_M: f32 = 1.72;

/// Distance of the sole below the foot joints (ball of the foot), as a fraction of the height.
pub const SOLE_BELOW_FOOT: f32 = 0.020;

/// Distance of the crown above the head joint (base of the skull), as a fraction of the height.
pub const CROWN_ABOVE_HEAD: f32 = 0.095;

/// Rest-pose joint positions relative to the midpoint between the soles, as fractions of the
/// height: x left, y up, z forward. The table is left-right symmetric.
///
/// Segment heights follow the usual anthropometric fractions (Drillis and Contini; Winter,
/// *Biomechanics and Motor Control of Human Movement*, table 4.1: hip 0.530, knee 0.285, ankle
/// 0.039, shoulder 0.818). They are moved from skin landmarks to the rotation centres that SMPL-X
/// calls joints. The small slopes (thighs 6 degrees outward, upper arms 10 degrees down) match the
/// SMPL-X rest pose to about two degrees. The rotations of AMASS and of this project therefore
/// describe the same posture on either skeleton.
const REST: [[f32; 3]; N_JOINTS] = [
    [0.000, 0.560, 0.005],   // pelvis
    [0.036, 0.516, -0.003],  // left hip
    [-0.036, 0.516, -0.003], // right hip
    [0.000, 0.622, -0.010],  // spine1
    [0.062, 0.286, -0.010],  // left knee
    [-0.062, 0.286, -0.010], // right knee
    [0.000, 0.696, -0.014],  // spine2
    [0.050, 0.054, -0.028],  // left ankle
    [-0.050, 0.054, -0.028], // right ankle
    [0.000, 0.730, 0.000],   // spine3
    [0.068, 0.020, 0.044],   // left foot
    [-0.068, 0.020, 0.044],  // right foot
    [0.000, 0.830, -0.016],  // neck
    [0.028, 0.784, -0.004],  // left collar
    [-0.028, 0.784, -0.004], // right collar
    [0.000, 0.905, -0.002],  // head
    [0.098, 0.812, -0.012],  // left shoulder
    [-0.098, 0.812, -0.012], // right shoulder
    [0.250, 0.785, -0.028],  // left elbow
    [-0.250, 0.785, -0.028], // right elbow
    [0.396, 0.788, -0.030],  // left wrist
    [-0.396, 0.788, -0.030], // right wrist
];

/// The T-pose skeleton of an adult with average proportions and standing height `height_m`.
///
/// Offsets are in body rest axes (x left, y up, z forward), m, and left-right symmetric. With
/// identity joint rotations and an upright root, the soles are on the floor when the pelvis is at
/// [`standing_pelvis_height_m`].
pub fn canonical_skeleton(height_m: f32) -> Skeleton {
    let rest = REST.map(|p| Vec3::from_array(p) * height_m);
    let mut offsets = [Vec3::ZERO; N_JOINTS];
    for joint in radarllm_base::Joint::ALL {
        if let Some(parent) = joint.parent() {
            offsets[joint as usize] = rest[joint as usize] - rest[parent as usize];
        }
    }
    Skeleton { offsets }
}

/// Height of the pelvis above the floor when `skeleton` stands in its rest pose, m.
pub fn standing_pelvis_height_m(skeleton: &Skeleton) -> f32 {
    let lowest_m = rest_positions(skeleton)
        .iter()
        .map(|p| p.y)
        .fold(0.0, f32::min);
    standing_height_m(skeleton) * SOLE_BELOW_FOOT - lowest_m
}

/// Standing height of a person with this skeleton, including soles and crown, m.
pub fn standing_height_m(skeleton: &Skeleton) -> f32 {
    let rest = rest_positions(skeleton);
    let low = rest.iter().map(|p| p.y).fold(0.0, f32::min);
    let high = rest[radarllm_base::Joint::Head as usize].y;
    (high - low) / (1.0 - SOLE_BELOW_FOOT - CROWN_ABOVE_HEAD)
}

/// Joint positions of the rest pose relative to the pelvis, in rest axes, m.
pub fn rest_positions(skeleton: &Skeleton) -> [Vec3; N_JOINTS] {
    let mut rest = [Vec3::ZERO; N_JOINTS];
    for joint in radarllm_base::Joint::ALL {
        if let Some(parent) = joint.parent() {
            rest[joint as usize] = rest[parent as usize] + skeleton.offsets[joint as usize];
        }
    }
    rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_base::Joint;

    #[test]
    fn canonical_skeleton_stands_as_high_as_asked() {
        for height_m in [1.2, 1.72, 2.0] {
            let skeleton = canonical_skeleton(height_m);
            // The tolerance covers rounding of f32 sums only.
            assert!((standing_height_m(&skeleton) - height_m).abs() < 1e-5);
            assert!((standing_pelvis_height_m(&skeleton) - 0.560 * height_m).abs() < 1e-5);
        }
    }

    #[test]
    fn canonical_skeleton_is_symmetric_with_left_at_positive_x() {
        let rest = rest_positions(&canonical_skeleton(1.72));
        for (left, right) in [
            (Joint::LeftHip, Joint::RightHip),
            (Joint::LeftFoot, Joint::RightFoot),
            (Joint::LeftWrist, Joint::RightWrist),
        ] {
            let (l, r) = (rest[left as usize], rest[right as usize]);
            assert!(l.x > 0.0 && (l * Vec3::new(-1.0, 1.0, 1.0) - r).length() < 1e-6);
        }
        assert!(rest[Joint::LeftFoot as usize].z > rest[Joint::LeftAnkle as usize].z + 0.1);
    }
}
