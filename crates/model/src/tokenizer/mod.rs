//! Radar tokenizer: points in, one code per 0.4 s out (Aggregate VQ-VAE).
//!
//! ```text
//! points --> centre --> tubes --> [step, anchor, C] --> context --> pooled --> [code, D] --> ids
//!           (centre)  (grouping)  (point_conv)       (attention)  (network)   (codebook)
//! ```
//!
//! Reading order: [`config`] (sizes), [`centre`], [`grouping`] and [`doppler_profile`] (plain
//! arithmetic on points), [`batch`] (clips side by side), [`point_conv`], [`attention`], [`network`],
//! [`codebook`].
//! Reconstruction and guidance losses live in `radarllm-train`.

pub mod attention;
pub mod batch;
pub mod centre;
pub mod codebook;
pub mod config;
pub mod doppler_profile;
pub mod encode;
pub mod grouping;
pub mod network;
pub mod point_conv;

pub use config::{FRAMES_PER_CODE, MAX_FRAMES, TokenizerConfig};
pub use encode::{EncodeError, Encoded, RadarTokenizer};
