//! Body pose from radar points: the network of mmMesh (Xue et al., MobiSys 2021) on the 22 joints of this project's body.
//!
//! Points of each frame enter; the rotations of the joints, the place of the pelvis and the height of the body leave. A
//! base layer describes each point; a global branch attends to all points of a frame and finds the place of the person on the
//! floor; an anchor branch groups the points about a grid of anchors at that place. Two LSTMs follow the branches over time.
//!
//! Departures from the published network, each because of this project's body: 22 joints instead of nine, a height instead
//! of shape and gender, the built-in skeleton instead of SMPL. Frames of fewer than 128 points are masked instead of filled
//! with repeated points. Without these the network has the 491,608 parameters of the published one.
//!
//! Reading order: [`config`] (shape and limits), `layers` (normalisation over points, LSTM), [`network`], [`kinematics`]
//! (rotations to joints), [`estimator`] (a trained network applied to clips).

pub mod config;
pub mod estimator;
pub mod kinematics;
mod layers;
pub mod network;
#[cfg(test)]
mod reference;

pub use config::{POSE_KIND, PoseConfig, PoseFile};
pub use estimator::{PoseError, PoseEstimator};
pub use layers::PosePass;
pub use network::{PoseBatch, PoseNet, PoseOutput};
