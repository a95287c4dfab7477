//! Inverse kinematics: joint rotations from joint positions alone.
//!
//! Bone directions determine every joint rotation except the roll about the bone. The roll is
//! derived from the body. Hips and shoulders determine the turn of the pelvis and the chest. A bent
//! knee or elbow shows its hinge axis. A straight limb keeps the roll that results from the
//! shortest rotation from the T-pose.

use glam::{Mat3, Quat, Vec3};
use radarllm_base::Joint;
use radarllm_base::skeleton::{N_JOINTS, Skeleton};

/// Bend angles, rad: below the first, the hinge of a limb is ignored; above the second, the hinge
/// alone determines the roll. Measurement noise of 1 cm on a 25 cm bone is 2 degrees, so 10 degrees
/// is well above it.
const HINGE_FADE_RAD: (f32, f32) = (0.17, 0.6);

/// World-from-joint rotations whose bones point along the observed positions.
///
/// `positions` are world positions in any unit. `None` means that the source has no such joint;
/// that joint rotates with its parent. `upright` is the rotation used when the positions do not
/// determine one.
pub(crate) fn rotations_from_positions(
    positions: &[Option<Vec3>; N_JOINTS],
    rest: &[Vec3; N_JOINTS],
    upright: Quat,
) -> [Quat; N_JOINTS] {
    let solver = Solver { positions, rest };
    let mut world = [upright; N_JOINTS];
    let pelvis = solver.pelvis().unwrap_or(upright);
    let chest = solver.chest().unwrap_or(pelvis);
    for joint in Joint::ALL {
        let j = joint as usize;
        let parent = joint.parent().map_or(pelvis, |p| world[p as usize]);
        world[j] = match joint {
            Joint::Pelvis => pelvis,
            // The twist between pelvis and chest is distributed over the spine.
            Joint::Spine1 => solver.swing(joint, pelvis.slerp(chest, 1.0 / 3.0)),
            Joint::Spine2 => solver.swing(joint, pelvis.slerp(chest, 2.0 / 3.0)),
            Joint::Spine3 => chest,
            Joint::LeftHip => solver.hinged(joint, Joint::LeftKnee, Vec3::X, parent),
            Joint::RightHip => solver.hinged(joint, Joint::RightKnee, Vec3::X, parent),
            Joint::LeftShoulder => solver.hinged(joint, Joint::LeftElbow, Vec3::NEG_Y, parent),
            Joint::RightShoulder => solver.hinged(joint, Joint::RightElbow, Vec3::Y, parent),
            _ => solver.swing(joint, parent),
        };
    }
    world
}

/// The child joint at the end of a joint's bone, for joints with exactly one bone.
pub(crate) fn bone_child(joint: Joint) -> Option<Joint> {
    Some(match joint {
        Joint::LeftHip => Joint::LeftKnee,
        Joint::RightHip => Joint::RightKnee,
        Joint::Spine1 => Joint::Spine2,
        Joint::LeftKnee => Joint::LeftAnkle,
        Joint::RightKnee => Joint::RightAnkle,
        Joint::Spine2 => Joint::Spine3,
        Joint::LeftAnkle => Joint::LeftFoot,
        Joint::RightAnkle => Joint::RightFoot,
        Joint::Neck => Joint::Head,
        Joint::LeftCollar => Joint::LeftShoulder,
        Joint::RightCollar => Joint::RightShoulder,
        Joint::LeftShoulder => Joint::LeftElbow,
        Joint::RightShoulder => Joint::RightElbow,
        Joint::LeftElbow => Joint::LeftWrist,
        Joint::RightElbow => Joint::RightWrist,
        _ => return None,
    })
}

/// Rotation that maps `primary_rest` exactly and `secondary_rest` as closely as possible onto the
/// observed directions. Returns `None` if the vectors are too short or too parallel.
pub(crate) fn align_pair(
    primary_rest: Vec3,
    secondary_rest: Vec3,
    primary_seen: Vec3,
    secondary_seen: Vec3,
) -> Option<Quat> {
    let rest = triad(primary_rest, secondary_rest)?;
    let seen = triad(primary_seen, secondary_seen)?;
    Some(Quat::from_mat3(&(seen * rest.transpose())).normalize())
}

/// Shortest rotation between two directions; the identity if either vanishes.
pub(crate) fn shortest(from: Vec3, to: Vec3) -> Quat {
    match (from.try_normalize(), to.try_normalize()) {
        // glam's own arc rounds angles below 0.0007 rad to zero, which becomes visible in a chain
        // of bones.
        (Some(a), Some(b)) if a.dot(b) > -0.99 => {
            let axis = a.cross(b);
            Quat::from_xyzw(axis.x, axis.y, axis.z, 1.0 + a.dot(b)).normalize()
        }
        (Some(a), Some(b)) => Quat::from_rotation_arc(a, b).normalize(),
        _ => Quat::IDENTITY,
    }
}

/// Orthonormal axes with the first along `primary`.
fn triad(primary: Vec3, secondary: Vec3) -> Option<Mat3> {
    let a = primary.try_normalize()?;
    let c = a.cross(secondary.try_normalize()?);
    // sin of 5 degrees: if the vectors are closer to parallel, their common plane is dominated by
    // noise.
    if c.length() < 0.087 {
        return None;
    }
    let c = c.normalize();
    Some(Mat3::from_cols(a, c, c.cross(a)))
}

struct Solver<'a> {
    positions: &'a [Option<Vec3>; N_JOINTS],
    rest: &'a [Vec3; N_JOINTS],
}

impl Solver<'_> {
    fn seen(&self, joint: Joint) -> Option<Vec3> {
        self.positions[joint as usize]
    }

    fn between(&self, from: Joint, to: Joint) -> Option<(Vec3, Vec3)> {
        let seen = self.seen(to)? - self.seen(from)?;
        Some((self.rest[to as usize] - self.rest[from as usize], seen))
    }

    fn pelvis(&self) -> Option<Quat> {
        let (across_rest, across) = self
            .between(Joint::RightHip, Joint::LeftHip)
            .or_else(|| self.between(Joint::RightShoulder, Joint::LeftShoulder))?;
        let low = match (self.seen(Joint::LeftHip), self.seen(Joint::RightHip)) {
            (Some(l), Some(r)) => (
                0.5 * (self.rest[Joint::LeftHip as usize] + self.rest[Joint::RightHip as usize]),
                0.5 * (l + r),
            ),
            _ => (self.rest[0], self.seen(Joint::Pelvis)?),
        };
        let high = [
            Joint::Spine1,
            Joint::Spine2,
            Joint::Spine3,
            Joint::Neck,
            Joint::Head,
        ]
        .into_iter()
        .find_map(|j| Some((self.rest[j as usize], self.seen(j)?)))?;
        align_pair(across_rest, high.0 - low.0, across, high.1 - low.1)
    }

    fn chest(&self) -> Option<Quat> {
        let collars = self.between(Joint::RightCollar, Joint::LeftCollar);
        let shoulders = self.between(Joint::RightShoulder, Joint::LeftShoulder);
        // Collars are part of the chest; shoulders move relative to it. In rigs where both collars
        // start at the same point, only the shoulders can be used.
        let (across_rest, across) = match (collars, shoulders) {
            (Some(c), Some(s)) if c.1.length() > 0.1 * s.1.length() => c,
            (_, Some(s)) => s,
            (c, None) => c?,
        };
        let (up_rest, up) = self
            .between(Joint::Spine3, Joint::Neck)
            .or_else(|| self.between(Joint::Pelvis, Joint::Neck))
            .or_else(|| self.between(Joint::Pelvis, Joint::Head))?;
        // The spine is the primary direction: it is long, and shoulders may be raised on one side.
        align_pair(up_rest, across_rest, up, across)
    }

    /// The next joint along the bone that the source has, with its rest direction and observed
    /// direction.
    fn bone(&self, joint: Joint) -> Option<(Vec3, Vec3)> {
        let mut child = bone_child(joint)?;
        loop {
            if let Some(found) = self.between(joint, child) {
                return Some(found);
            }
            child = bone_child(child).or((child == Joint::Spine3).then_some(Joint::Neck))?;
        }
    }

    /// Applies the shortest rotation to `base` that aligns the joint's bone with its observed
    /// direction.
    fn swing(&self, joint: Joint, base: Quat) -> Quat {
        match self.bone(joint) {
            Some((rest, seen)) => (shortest(base * rest, seen) * base).normalize(),
            None => base,
        }
    }

    /// Like [`Self::swing`], with the roll derived from the bend of the `middle` joint.
    /// `hinge_rest` is the flexion axis of that joint in the T-pose.
    fn hinged(&self, joint: Joint, middle: Joint, hinge_rest: Vec3, parent: Quat) -> Quat {
        let swung = self.swing(joint, parent);
        let (Some((upper_rest, upper)), Some((_, lower))) = (self.bone(joint), self.bone(middle))
        else {
            return swung;
        };
        let bend_rad = upper.angle_between(lower);
        let (low, high) = HINGE_FADE_RAD;
        // In a fully folded limb the two bones are almost parallel again.
        let distance_rad = bend_rad.min(std::f32::consts::PI - bend_rad);
        let weight = ((distance_rad - low) / (high - low)).clamp(0.0, 1.0);
        match align_pair(upper_rest, hinge_rest, upper, upper.cross(lower)) {
            Some(hinged) if weight > 0.0 => {
                let mixed = swung.slerp(hinged, weight);
                // Both ends of the interpolation align the bone; intermediate rotations may not, so
                // align again.
                (shortest(mixed * upper_rest, upper) * mixed).normalize()
            }
            _ => swung,
        }
    }
}

/// Rest-pose positions of a skeleton, for [`rotations_from_positions`].
pub(crate) fn rest_of(skeleton: &Skeleton) -> [Vec3; N_JOINTS] {
    crate::proportions::rest_positions(skeleton)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::proportions::canonical_skeleton;
    use radarllm_base::Pose;
    use radarllm_base::frames::world_from_rest_facing_radar;

    /// Forward kinematics of the solution reproduces the positions. Bones are exact by construction
    /// except at the pelvis and the chest, whose several bones are rigid here, so only rounding
    /// errors remain.
    #[test]
    fn posture_made_by_hinges_comes_back() {
        let skeleton = canonical_skeleton(1.7);
        let mut rotations = [Quat::IDENTITY; N_JOINTS];
        rotations[0] = world_from_rest_facing_radar() * Quat::from_rotation_y(0.7);
        rotations[Joint::LeftHip as usize] = Quat::from_rotation_x(-1.2);
        rotations[Joint::LeftKnee as usize] = Quat::from_rotation_x(1.4);
        rotations[Joint::RightShoulder as usize] = Quat::from_rotation_z(1.1);
        rotations[Joint::RightElbow as usize] = Quat::from_rotation_y(1.3);
        rotations[Joint::Spine3 as usize] = Quat::from_rotation_y(0.4);
        rotations[Joint::Neck as usize] = Quat::from_rotation_x(0.3);
        let pose = Pose {
            root_in_world: Vec3::new(0.1, 0.2, 0.9),
            rotations,
        };
        let (seen, wanted) = skeleton.forward(&pose);
        let world = rotations_from_positions(&seen.map(Some), &rest_of(&skeleton), Quat::IDENTITY);
        for joint in Joint::ALL {
            let Some(child) = bone_child(joint) else {
                continue;
            };
            let bone = world[joint as usize] * skeleton.offsets[child as usize];
            assert!(
                (bone - (seen[child as usize] - seen[joint as usize])).length() < 1e-4,
                "{joint:?}"
            );
        }
        // The hinge axis of the knee was x, so the roll of the thigh is recovered as well. The rest
        // bones slope by 6 degrees against the hinge plane, which tilts the observed axis by about
        // the same angle.
        let roll = world[Joint::LeftHip as usize].angle_between(wanted[Joint::LeftHip as usize]);
        assert!(roll < 0.2, "{roll}");
    }

    #[test]
    fn missing_and_coincident_joints_give_finite_rotations() {
        let upright = world_from_rest_facing_radar();
        let rest = rest_of(&canonical_skeleton(1.7));
        for positions in [[None; N_JOINTS], [Some(Vec3::ZERO); N_JOINTS]] {
            let world = rotations_from_positions(&positions, &rest, upright);
            assert!(
                world
                    .iter()
                    .all(|q| q.is_finite() && q.angle_between(upright) < 1e-3)
            );
        }
    }
}
