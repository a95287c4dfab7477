//! A source skeleton and its motion, as stored in BVH and ASF/AMC files.

use glam::{Quat, Vec3};

/// Degree of freedom that one column of motion data drives. Angles are in degrees, as in the files.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Channel {
    /// Coordinate 0, 1 or 2 of the joint's translation; replaces that coordinate of the offset.
    Position(u8),
    /// Rotation about axis 0, 1 or 2; successive rotations multiply on the right.
    Rotation(u8),
}

/// One joint of a source skeleton.
#[derive(Clone, Debug)]
pub(crate) struct SourceJoint {
    pub name: String,
    pub parent: Option<usize>,
    /// Offset from the parent joint, file units, used unless a position channel replaces it.
    pub offset: Vec3,
    /// Channels with their column indices.
    pub channels: Vec<(Channel, usize)>,
    /// ASF's `axis`: the channels rotate about these axes instead of the parent's. Identity in BVH.
    pub axis: Quat,
}

/// A source skeleton with its frames, in file units and axes.
#[derive(Clone, Debug)]
pub(crate) struct SourceMotion {
    /// Joints, with parents before children.
    pub joints: Vec<SourceJoint>,
    pub fps: f64,
    pub n_columns: usize,
    pub n_frames: usize,
    /// `[frame][column]`, finite.
    pub values: Vec<f32>,
}

/// Joint positions (file units) and file-from-joint rotations of one frame.
#[derive(Clone, Debug)]
pub(crate) struct SourcePose {
    pub positions: Vec<Vec3>,
    pub rotations: Vec<Quat>,
}

impl SourceMotion {
    /// Rest pose: every rotation is zero and every offset is as written in the file.
    pub(crate) fn rest(&self) -> SourcePose {
        let mut pose = self.blank();
        for (j, joint) in self.joints.iter().enumerate() {
            pose.positions[j] =
                joint.parent.map_or(Vec3::ZERO, |p| pose.positions[p]) + joint.offset;
        }
        pose
    }

    /// An empty pose to be filled by [`Self::forward`].
    pub(crate) fn blank(&self) -> SourcePose {
        SourcePose {
            positions: vec![Vec3::ZERO; self.joints.len()],
            rotations: vec![Quat::IDENTITY; self.joints.len()],
        }
    }

    /// Forward kinematics of `frame` for the joints marked in `needed`, which must contain the
    /// ancestors of each marked joint.
    pub(crate) fn forward(&self, frame: usize, needed: &[bool], pose: &mut SourcePose) {
        let row = &self.values[frame * self.n_columns..(frame + 1) * self.n_columns];
        for (j, joint) in self.joints.iter().enumerate() {
            if !needed[j] {
                continue;
            }
            let mut translation = joint.offset;
            let mut rotation = Quat::IDENTITY;
            for &(channel, column) in &joint.channels {
                match channel {
                    Channel::Position(axis) => translation[usize::from(axis)] = row[column],
                    Channel::Rotation(axis) => {
                        rotation *= rotation_about(axis, row[column].to_radians());
                    }
                }
            }
            let local = (joint.axis * rotation * joint.axis.conjugate()).normalize();
            let (position, parent_rotation) = match joint.parent {
                None => (Vec3::ZERO, Quat::IDENTITY),
                Some(p) => (pose.positions[p], pose.rotations[p]),
            };
            pose.positions[j] = position + parent_rotation * translation;
            pose.rotations[j] = (parent_rotation * local).normalize();
        }
    }

    /// True if `ancestor` is on the path from `joint` to its root, or is `joint` itself.
    pub(crate) fn descends(&self, joint: usize, ancestor: usize) -> bool {
        self.path_to_root(joint).contains(&ancestor)
    }

    /// The path from `joint` through its parents to the root, including both.
    pub(crate) fn path_to_root(&self, joint: usize) -> Vec<usize> {
        let mut path = vec![joint];
        while let Some(parent) = self.joints[path[path.len() - 1]].parent {
            path.push(parent);
        }
        path
    }
}

/// Rotation about coordinate axis 0, 1 or 2.
pub(crate) fn rotation_about(axis: u8, angle_rad: f32) -> Quat {
    match axis {
        0 => Quat::from_rotation_x(angle_rad),
        1 => Quat::from_rotation_y(angle_rad),
        _ => Quat::from_rotation_z(angle_rad),
    }
}
