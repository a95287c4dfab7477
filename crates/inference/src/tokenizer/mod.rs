//! Radar tokenizer (Aggregate VQ-VAE): encodes points as one code per 0.4 s.
//!
//! ```text
//! points --> centre --> tubes --> network --> [code, D] --> ids
//!           (centre)  (grouping)  (radarllm-engine)
//! ```
//!
//! Reading order: [`config`] (sizes), [`centre`], [`grouping`], [`doppler_profile`] and [`context`] (plain arithmetic on points),
//! [`encode`] (a trained network on the engine), [`residual`] (a second code for each step), [`points`] (codes back to points). The trainable network is in `radarllm-nn`.

pub mod centre;
pub mod config;
pub mod context;
pub mod doppler_profile;
pub mod encode;
pub mod grouping;
pub(crate) mod layout;
pub mod nearest;
pub mod points;
pub mod residual;
pub mod usage;

pub use config::{FRAMES_PER_CODE, MAX_FRAMES, TokenizerConfig};
pub use encode::{EncodeError, Encoded, RadarTokenizer};
