//! Bodies: a pose enters, the vertices of a closed triangle mesh leave.
//!
//! [`BuiltinBody`] is made by this project and needs no file; [`SmplxBody`] reads a licensed
//! SMPL-X (or SMPL) `.npz` a user has. Both are [`BodyModel`]s, and [`PosedBody`] turns a body, a
//! motion and a place in front of the radar into the moving triangles the simulator sees.
//!
//! Reading order: [`posed`], [`builtin`] with `anatomy` (shape), `field`, `polygonize`, `remesh`
//! (shape to triangles), `weights`, `skin` (triangles to motion), [`smplx`],
//! [`topology`] (facts about meshes).

mod anatomy;
pub mod builtin;
pub mod error;
mod field;
mod polygonize;
pub mod posed;
mod remesh;
mod skin;
pub mod smplx;
pub mod topology;
mod weights;

pub use builtin::{BodyShape, Build, BuiltinBody};
pub use error::BodyError;
pub use posed::{PosedBody, clothed_skin, pose_on_body};
pub use smplx::SmplxBody;

use glam::Vec3;
use radarllm_base::{Pose, Skeleton};

/// A triangle mesh that follows the 22 body joints.
pub trait BodyModel: Send + Sync {
    /// Short name for reports and provenance, e.g. `builtin` or the model file's stem.
    fn name(&self) -> &str;
    /// Rest-pose bone vectors, m.
    fn skeleton(&self) -> &Skeleton;
    /// Vertex indices, counter-clockwise seen from outside.
    fn triangles(&self) -> &[[u32; 3]];
    /// Number of vertices.
    fn n_vertices(&self) -> usize;
    /// Height of the pelvis joint above the soles in the rest pose, m.
    fn standing_pelvis_height_m(&self) -> f32;
    /// Writes vertex positions in the pose's world frame, m. Allocates nothing.
    ///
    /// # Panics
    /// If `out.len() != n_vertices()`.
    fn pose_into(&self, pose: &Pose, out: &mut [Vec3]);
    /// Poses several frames, `out[i]` from `poses[i]`; bodies whose vertices depend on large tables
    /// override this to read them once for all. Allocates nothing.
    ///
    /// # Panics
    /// If `out` is not one slice of `n_vertices()` per pose.
    fn pose_many_into(&self, poses: &[Pose], out: &mut [&mut [Vec3]]) {
        assert_eq!(out.len(), poses.len(), "one slice of vertices per pose");
        for (pose, out) in poses.iter().zip(out) {
            self.pose_into(pose, out);
        }
    }
}
