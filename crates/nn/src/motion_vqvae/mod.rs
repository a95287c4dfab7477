//! Motion VQ-VAE: the teacher whose features guide the radar tokenizer (T2M-GPT style: Zhang et al.,
//! Generating Human Motion from Textual Descriptions with Discrete Representations, CVPR 2023).
//!
//! A 1-D convolutional encoder converts HumanML3D features (263 values, 20 per second) to one
//! feature per 8 frames (0.4 s), the length of one radar code. The teacher is frozen. The tokenizer learns to predict
//! the teacher's output before quantization, standardised per channel.

pub mod layout;
pub mod network;
pub mod teacher;

pub use layout::mirror_motion_features;
pub use network::{MotionNet, MotionVqVaeConfig};
pub use teacher::{MotionFile, MotionTeacher};

/// Width of a HumanML3D feature vector.
pub const MOTION_DIM: usize = 263;
/// Motion frames per teacher feature.
pub const FRAMES_PER_FEATURE: usize = 8;
