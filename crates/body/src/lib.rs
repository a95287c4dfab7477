//! Human motion and the body that performs it: loaders, procedural motions, skinned meshes.
//!
//! A file of recorded motion enters ([`load_motion_file`]), a [`radarllm_base::Motion`] on the 22
//! joints of SMPL-X leaves. Procedural motions make the same type, and the mesh turns it into
//! moving triangles for the simulator.
//!
//! Reading order: [`proportions`] (the T-pose), [`loaders`] (files), [`retarget`] (foreign
//! skeletons to SMPL-X), [`sample`] (motions between their frames), [`features`] (HumanML3D
//! vectors), [`procedural`], [`mesh`].

pub mod error;
pub mod features;
mod ik;
pub mod loaders;
pub mod mesh;
pub mod procedural;
pub mod proportions;
pub mod retarget;
pub mod sample;

pub use error::MotionError;
pub use loaders::{LoadedMotion, load_asf_amc, load_motion, load_motion_file};
pub use proportions::canonical_skeleton;
pub use retarget::motion_from_positions;
pub use sample::MotionSampler;
