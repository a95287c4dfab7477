//! Calibration of the constant rotation between a rig's joint axes and those of SMPL-X.

use super::{Seen, next_seen};
use crate::ik::{align_pair, bone_child, rest_of, rotations_from_positions, shortest};
use glam::{Mat3, Quat, Vec3, Vec4};
use radarllm_base::frames::world_from_rest_facing_radar;
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::{Joint, Skeleton};

/// Maximum angle within which the rig's own axes are preferred to the average posture, rad (30
/// degrees). The average of a clip depends on the person's actions in it; the axes of the rig do
/// not.
const SNAP_RAD: f32 = 0.52;

/// Calibrates from a rest pose that shows a standing person.
///
/// The trunk and head are assumed to be upright in it, and the feet flat. Limbs are rotated by the
/// shortest rotation from the T-pose to their observed directions.
pub(super) fn from_rest_pose(seen: &Seen, canonical: &Skeleton) -> [Option<Quat>; N_JOINTS] {
    let rest = rest_of(canonical);
    let at = |j: Joint| seen.positions[j as usize];
    let left = match (at(Joint::LeftHip), at(Joint::RightHip)) {
        (Some(l), Some(r)) => (l - r).reject_from(Vec3::Z),
        _ => Vec3::X,
    };
    let trunk =
        align_pair(Vec3::Y, Vec3::X, Vec3::Z, left).unwrap_or(world_from_rest_facing_radar());
    let mut world = [trunk; N_JOINTS];
    for joint in Joint::ALL {
        let j = joint as usize;
        let Some(parent) = joint.parent() else {
            continue;
        };
        let base = world[parent as usize];
        world[j] = match joint {
            Joint::Spine1 | Joint::Spine2 | Joint::Spine3 | Joint::Neck | Joint::Head => trunk,
            // The start of the collar bone varies more between rigs than its direction.
            Joint::LeftCollar | Joint::RightCollar => trunk,
            Joint::LeftAnkle | Joint::RightAnkle => match bone(seen, &rest, joint) {
                Some((rest_toes, toes)) => {
                    let ahead = toes.reject_from(Vec3::Z);
                    align_pair(Vec3::Y, rest_toes.reject_from(Vec3::Y), Vec3::Z, ahead)
                        .unwrap_or(base)
                }
                None => trunk,
            },
            Joint::LeftFoot | Joint::RightFoot => base,
            _ => match bone(seen, &rest, joint) {
                Some((from, to)) => (shortest(base * from, to) * base).normalize(),
                None => base,
            },
        };
    }
    let mut constant = [None; N_JOINTS];
    for (j, slot) in constant.iter_mut().enumerate() {
        *slot = seen.rotations[j].map(|source| (source.conjugate() * world[j]).normalize());
    }
    constant
}

/// Calibrates from the frames of the motion, for rigs whose rest pose is not a valid posture.
pub(super) fn from_frames(frames: &[Seen], canonical: &Skeleton) -> [Option<Quat>; N_JOINTS] {
    let rest = rest_of(canonical);
    let mut sums = [Vec4::ZERO; N_JOINTS];
    for seen in frames {
        let world =
            rotations_from_positions(&seen.positions, &rest, world_from_rest_facing_radar());
        for joint in Joint::ALL {
            let j = joint as usize;
            let Some(source) = seen.rotations[j] else {
                continue;
            };
            let constant = Vec4::from(source.conjugate() * world[j]);
            // q and -q are the same rotation: add with the sign that agrees with the sum so far.
            let sign = if constant.dot(sums[j]) < 0.0 {
                -1.0
            } else {
                1.0
            };
            sums[j] += constant * (sign * confidence(joint, seen));
        }
    }
    let mut constant = [None; N_JOINTS];
    for joint in Joint::ALL {
        let j = joint as usize;
        if let Some(mean) = sums[j].try_normalize() {
            constant[j] = Some(snap(joint, Quat::from_vec4(mean), frames, &rest));
        }
    }
    constant
}

/// Confidence of a frame in a joint's roll; limbs show their roll when they are bent.
fn confidence(joint: Joint, seen: &Seen) -> f32 {
    let (upper, middle) = match joint {
        Joint::LeftHip | Joint::LeftKnee => (Joint::LeftHip, Joint::LeftKnee),
        Joint::RightHip | Joint::RightKnee => (Joint::RightHip, Joint::RightKnee),
        Joint::LeftShoulder | Joint::LeftElbow => (Joint::LeftShoulder, Joint::LeftElbow),
        Joint::RightShoulder | Joint::RightElbow => (Joint::RightShoulder, Joint::RightElbow),
        _ => return 1.0,
    };
    let lower = bone_child(middle);
    let at = |j: Joint| seen.positions[j as usize];
    let sine = lower.and_then(|lower| {
        let a = (at(middle)? - at(upper)?).try_normalize()?;
        let b = (at(lower)? - at(middle)?).try_normalize()?;
        Some(a.cross(b).length())
    });
    0.02 + sine.unwrap_or(0.0)
}

/// Snaps an estimate to the rig's own axes if these are near.
fn snap(joint: Joint, estimate: Quat, frames: &[Seen], rest: &[Vec3; N_JOINTS]) -> Quat {
    let limb_axis = match joint {
        Joint::LeftHip | Joint::RightHip | Joint::LeftKnee | Joint::RightKnee => Vec3::X,
        Joint::LeftAnkle | Joint::RightAnkle => Vec3::X,
        Joint::LeftCollar | Joint::RightCollar | Joint::LeftShoulder | Joint::RightShoulder => {
            Vec3::Y
        }
        Joint::LeftElbow | Joint::RightElbow => Vec3::Y,
        // Rigs without a joint at the tip of the toes leave the axes of the last joint arbitrary.
        Joint::LeftFoot | Joint::RightFoot => return estimate,
        _ => {
            let axes = nearest_axes(estimate);
            return if axes.angle_between(estimate) < SNAP_RAD {
                axes
            } else {
                estimate
            };
        }
    };
    let Some(child) = frames
        .first()
        .and_then(|seen| next_seen(joint, &seen.positions))
    else {
        return estimate;
    };
    let bone_rest = rest[child as usize] - rest[joint as usize];
    let bone = estimate * bone_rest.normalize_or_zero();
    // cos of 3 degrees: the rig aligns its bones with a coordinate axis.
    if bone.abs().max_element() < 0.9986 {
        return estimate;
    }
    let roll = (estimate * limb_axis).reject_from(bone).normalize_or_zero();
    let near = nearest_axis(roll);
    match align_pair(bone_rest, limb_axis, bone, near) {
        Some(snapped) if roll.angle_between(near) < SNAP_RAD => snapped,
        _ => estimate,
    }
}

/// The coordinate axis closest to a direction.
fn nearest_axis(v: Vec3) -> Vec3 {
    let axes = [
        Vec3::X,
        Vec3::Y,
        Vec3::Z,
        Vec3::NEG_X,
        Vec3::NEG_Y,
        Vec3::NEG_Z,
    ];
    axes.into_iter()
        .max_by(|a, b| a.dot(v).total_cmp(&b.dot(v)))
        .unwrap_or(Vec3::X)
}

/// The rotation closest to `q`, judged by its first two axes, among the 24 that permute the axes.
fn nearest_axes(q: Quat) -> Quat {
    let up = nearest_axis(q * Vec3::Y);
    let left = nearest_axis((q * Vec3::X).reject_from(up));
    Quat::from_mat3(&Mat3::from_cols(left, up, left.cross(up))).normalize()
}

fn bone(seen: &Seen, rest: &[Vec3; N_JOINTS], joint: Joint) -> Option<(Vec3, Vec3)> {
    let child = next_seen(joint, &seen.positions)?;
    let seen_bone = seen.positions[child as usize]? - seen.positions[joint as usize]?;
    Some((rest[child as usize] - rest[joint as usize], seen_bone))
}
