//! Training of the radar-language model: pretraining and instruction tuning.
//!
//! Captioned codes enter as [`LmClip`]; a checkpoint that
//! [`radarllm_nn::lm::RadarLm::load`] opens leaves. Loss covers targets only, never prompts or
//! padding; captions are used as they are; batches hold sequences of similar length.
//!
//! Reading order: [`clip`] (data and the lateral flip), [`corrupt`] (span masking), [`examples`]
//! (tasks to token sequences), [`loss`], [`contrast`] (codes beside captions), [`stage`] (the two stages).

pub mod clip;
pub mod config;
pub mod contrast;
pub mod corrupt;
pub mod examples;
pub mod loss;
pub mod stage;
#[cfg(test)]
mod tests;

pub(crate) use clip::word_spans;
pub use clip::{LmClip, swap_sides};
pub use config::{LmTrainConfig, TaskWeights};
pub use stage::{LmOutcome, instruct, pretrain};
