//! Loading of recorded human motion and body models that perform it: loaders, retargeting, skinned
//! meshes.
//!
//! [`load_motion_file`] reads a motion file and returns a [`radarllm_base::Motion`] on the 22
//! joints of SMPL-X. The mesh converts the motion into moving triangles for the simulator.
//!
//! ```
//! use glam::{Quat, Vec3};
//! use radarllm_base::Pose;
//! use radarllm_body::mesh::{BodyModel, BodyShape, BuiltinBody};
//!
//! let body = BuiltinBody::new(&BodyShape { facet_edge_m: 0.05, ..BodyShape::default() })?;
//! // The T-pose, pelvis at the origin: y is up.
//! let pose = Pose { root_in_world: Vec3::ZERO, rotations: [Quat::IDENTITY; 22] };
//! let mut vertices = vec![Vec3::ZERO; body.n_vertices()];
//! body.pose_into(&pose, &mut vertices);
//! let low = vertices.iter().map(|v| v.y).fold(f32::MAX, f32::min);
//! let high = vertices.iter().map(|v| v.y).fold(f32::MIN, f32::max);
//! assert!((high - low - 1.75).abs() < 0.05, "{}", high - low);
//! # Ok::<(), radarllm_body::mesh::BodyError>(())
//! ```
//!
//! Motions are resampled with cubic splines. A frame rate outside the supported range is rejected:
//!
//! ```
//! use radarllm_base::{Motion, Pose};
//! use radarllm_body::{canonical_skeleton, sample::resample};
//!
//! let pose = Pose { root_in_world: glam::Vec3::Z, rotations: [glam::Quat::IDENTITY; 22] };
//! let motion = Motion { fps: 120.0, skeleton: canonical_skeleton(1.75), poses: vec![pose; 121] };
//! assert_eq!(resample(&motion, 20.0)?.len(), 21);
//! assert!(resample(&motion, 0.0).is_err());
//! # Ok::<(), radarllm_body::sample::FrameRateError>(())
//! ```
//!
//! Reading order: [`proportions`] (the T-pose), [`loaders`] (files), [`retarget`] (other
//! skeletons to SMPL-X), [`sample`] (interpolation between frames), [`features`] (HumanML3D
//! vectors), [`gait`] (frame rates that cannot be right), [`despike`] (glitches of motion capture), [`mesh`].

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

pub mod despike;
pub mod error;
pub mod features;
pub mod gait;
mod ik;
pub mod loaders;
pub mod mesh;
pub mod proportions;
pub mod retarget;
pub mod sample;

pub use error::MotionError;
pub use loaders::{LoadedMotion, load_asf_amc, load_motion, load_motion_file};
pub use proportions::canonical_skeleton;
pub use retarget::motion_from_positions;
pub use sample::MotionSampler;
