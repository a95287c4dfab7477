//! Radar tokenizer: points in, one code per 0.4 s out (Aggregate VQ-VAE).
//!
//! ```text
//! points --> centre --> tubes --> [step, anchor, C] --> context --> pooled --> [code, D] --> ids
//!           (centre)  (grouping)  (point_conv)       (attention)  (network)   (codebook)
//! ```
//!
//! Reading order: [`config`] (sizes), [`centre`], [`grouping`] and [`doppler_profile`] (plain
//! arithmetic on points), [`encode`] (a trained network on the engine). With the feature `train`, the
//! network as it is trained: `batch` (clips side by side), `point_conv`, `attention`, `network`,
//! `codebook`, `reference` (points to codes by this network).
//! Reconstruction and guidance losses live in `radarllm-train`.

#[cfg(feature = "train")]
pub mod attention;
#[cfg(feature = "train")]
pub mod batch;
pub mod centre;
#[cfg(feature = "train")]
pub mod codebook;
pub mod config;
pub mod doppler_profile;
pub mod encode;
pub mod grouping;
#[cfg(feature = "train")]
pub mod network;
#[cfg(feature = "train")]
pub mod point_conv;
#[cfg(feature = "train")]
pub mod reference;

pub use config::{FRAMES_PER_CODE, MAX_FRAMES, TokenizerConfig};
pub use encode::{EncodeError, Encoded, RadarTokenizer};
#[cfg(feature = "train")]
pub use reference::ReferenceTokenizer;
