//! Training of the radar-language model: pretraining and instruction tuning.
//!
//! The input is captioned codes ([`LmClip`]); the output is a checkpoint that [`radarllm_nn::lm::RadarLm::load`] opens.
//! The loss covers targets only, never prompts or padding. Captions are used unchanged. Batches contain sequences of
//! similar length.
//!
//! Reading order: [`clip`] (data), [`corrupt`] (span masking), [`sentences`] (text without motions),
//! [`examples`] (tasks to token sequences), [`loss`], [`contrast`] (contrastive loss of codes and captions), [`retrieval`] (embeddings learned by it), [`stage`] (the two stages).

pub mod clip;
pub mod config;
pub mod contrast;
pub mod corrupt;
pub mod examples;
pub mod loss;
pub mod retrieval;
pub mod sentences;
pub mod stage;
#[cfg(test)]
mod tests;

pub use clip::LmClip;
pub(crate) use clip::Motions;
pub use config::{CodeSource, LmTrainConfig, TaskWeights};
pub(crate) use stage::target_states;
pub use stage::{LmOutcome, instruct, pretrain, pretrain_further};
