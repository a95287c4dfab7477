//! The radar-language model at inference: radar codes and words in one vocabulary, read and written by a T5.
//!
//! Reading order: [`config`] (shapes and presets), [`position`] (relative position buckets), [`vocab`] (ids),
//! [`templates`] (prompts), [`card`] (a model on disk), [`generate`] (decoding options), [`engine_lm`] (codes to words
//! on packed weights), [`cut`] (models with a way from the radar cut), [`ensemble`] (several models together), `person_gate` (whether a person is present), `consensus` (sentences of overlapping windows to segments), [`captioner`]
//! (points to sentences).
//!
//! Out of scope: the trainable networks are in `radarllm-nn`, losses and schedules in `radarllm-train`.

pub mod captioner;
pub mod card;
pub mod config;
mod consensus;
pub mod cut;
pub mod engine_lm;
pub mod ensemble;
mod error;
pub mod generate;
pub mod gpt2_config;
pub mod instruction;
mod person_gate;
pub mod questions;
pub mod qwen2_config;
pub mod templates;
pub mod vocab;
mod windows;
pub mod word_piece;

pub use captioner::{
    Abstained, Answer, AnswerPart, Captioner, Chosen, DescribeOptions, Description, NO_PERSON,
    Segment, actions,
};
pub use card::{Learned, LmCard, LmFiles};
pub use config::{Backbone, FeedForward, LmConfig, LmPreset, NetworkConfig, T5Config};
pub use consensus::WINDOWS;
pub use cut::{RadarCut, WeightsCut};
pub use engine_lm::EngineLm;
pub use error::{InputError, LmError, Unlearned};
pub use generate::{Allowed, GenerateOptions, Generated};
pub use instruction::Instruction;
pub use radarllm_engine::{Precision, Source, Watch, position};
pub use vocab::Vocab;
pub use windows::times_with_person;
