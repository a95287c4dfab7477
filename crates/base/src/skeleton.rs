//! The 22 body joints of SMPL-X and motions expressed on them.

use glam::{Quat, Vec3};

macro_rules! joints {
    ($($name:ident = $text:literal, $parent:expr;)*) => {
        /// The 22 body joints of SMPL-X, in its order. `joint as usize` is the index.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[repr(u8)]
        pub enum Joint { $(#[doc = concat!("`", $text, "` of SMPL-X.")] $name),* }
        impl Joint {
            /// All joints, parents before children.
            pub const ALL: [Joint; N_JOINTS] = [$(Joint::$name),*];
            /// Name of the joint in SMPL-X.
            pub fn name(self) -> &'static str { match self { $(Joint::$name => $text),* } }
            /// Parent joint; `None` for the pelvis.
            pub fn parent(self) -> Option<Joint> { match self { $(Joint::$name => $parent),* } }
        }
    };
}

/// Number of body joints.
pub const N_JOINTS: usize = 22;

joints! {
    Pelvis = "pelvis", None;
    LeftHip = "left_hip", Some(Joint::Pelvis);
    RightHip = "right_hip", Some(Joint::Pelvis);
    Spine1 = "spine1", Some(Joint::Pelvis);
    LeftKnee = "left_knee", Some(Joint::LeftHip);
    RightKnee = "right_knee", Some(Joint::RightHip);
    Spine2 = "spine2", Some(Joint::Spine1);
    LeftAnkle = "left_ankle", Some(Joint::LeftKnee);
    RightAnkle = "right_ankle", Some(Joint::RightKnee);
    Spine3 = "spine3", Some(Joint::Spine2);
    LeftFoot = "left_foot", Some(Joint::LeftAnkle);
    RightFoot = "right_foot", Some(Joint::RightAnkle);
    Neck = "neck", Some(Joint::Spine3);
    LeftCollar = "left_collar", Some(Joint::Spine3);
    RightCollar = "right_collar", Some(Joint::Spine3);
    Head = "head", Some(Joint::Neck);
    LeftShoulder = "left_shoulder", Some(Joint::LeftCollar);
    RightShoulder = "right_shoulder", Some(Joint::RightCollar);
    LeftElbow = "left_elbow", Some(Joint::LeftShoulder);
    RightElbow = "right_elbow", Some(Joint::RightShoulder);
    LeftWrist = "left_wrist", Some(Joint::LeftElbow);
    RightWrist = "right_wrist", Some(Joint::RightElbow);
}

/// Rest-pose bone vectors of a body, in body rest axes (x left, y up, z forward), m.
#[derive(Clone, Debug, PartialEq)]
pub struct Skeleton {
    /// Vector from the parent joint in the T-pose; the pelvis entry is zero.
    pub offsets: [Vec3; N_JOINTS],
}

/// One body pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// Pelvis position in the world, m.
    pub root_in_world: Vec3,
    /// Local rotation of every joint relative to its parent. The T-pose has the identity everywhere except at the root.
    /// Entry 0 rotates body rest axes into world axes.
    pub rotations: [Quat; N_JOINTS],
}

/// A motion: poses at a constant rate on a skeleton.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Poses per second; finite and positive.
    pub fps: f64,
    /// Bone vectors of the moving person.
    pub skeleton: Skeleton,
    /// At least one pose.
    pub poses: Vec<Pose>,
}

impl Skeleton {
    /// World positions, m, and world-from-rest rotations of all joints.
    pub fn forward(&self, pose: &Pose) -> ([Vec3; N_JOINTS], [Quat; N_JOINTS]) {
        let mut position_in_world = [Vec3::ZERO; N_JOINTS];
        let mut world_from_joint = [Quat::IDENTITY; N_JOINTS];
        for joint in Joint::ALL {
            let j = joint as usize;
            match joint.parent() {
                None => {
                    position_in_world[j] = pose.root_in_world;
                    world_from_joint[j] = pose.rotations[j];
                }
                Some(parent) => {
                    let p = parent as usize;
                    position_in_world[j] =
                        position_in_world[p] + world_from_joint[p] * self.offsets[j];
                    world_from_joint[j] = world_from_joint[p] * pose.rotations[j];
                }
            }
        }
        (position_in_world, world_from_joint)
    }
}

impl Motion {
    /// Number of poses.
    pub fn len(&self) -> usize {
        self.poses.len()
    }

    /// True if there is no pose. Loaders never return such a motion.
    pub fn is_empty(&self) -> bool {
        self.poses.is_empty()
    }

    /// Time from the first to the last pose plus one period, s.
    pub fn duration_s(&self) -> f64 {
        self.poses.len() as f64 / self.fps
    }

    /// World joint positions of every pose, m: `[frame][joint]`.
    pub fn joints_in_world(&self) -> Vec<[Vec3; N_JOINTS]> {
        self.poses
            .iter()
            .map(|p| self.skeleton.forward(p).0)
            .collect()
    }
}
