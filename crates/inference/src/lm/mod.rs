//! The radar-language model: radar codes and words in one vocabulary, read and written by a T5, a GPT-2 or
//! a Qwen2.
//!
//! Reading order: [`config`] (shapes and presets), [`position`] (relative position buckets), [`vocab`]
//! (ids), [`templates`] (prompts), `card` (a model on disk), [`generate`] (what decoding is asked),
//! `on_engine` (codes to words on packed weights), `presence` (is anybody there), [`captioner`] (points in,
//! sentence out).
//!
//! With the feature `train`, the networks as they are trained: `t5`, `decoder` (a decoder alone in its place)
//! and `decoder_files` (its files), `hf` (Hugging Face names and files), `radar_lm` (network + vocabulary),
//! `decode` (greedy and beam decoding). Beside them: `pretrained` (checkpoints of other architectures,
//! for comparison and metrics), `gpt2`, `qwen2`, `bert`, `layers`, `dropout`, `text_encoder` (sentences into vectors).
//!
//! Deliberately absent: losses, batching and schedules live in `radarllm-train`.

#[cfg(feature = "train")]
pub mod bert;
pub mod captioner;
mod card;
pub mod config;
#[cfg(feature = "train")]
mod decode;
#[cfg(feature = "train")]
pub mod decoder;
#[cfg(feature = "train")]
pub mod decoder_files;
#[cfg(feature = "train")]
mod dropout;
mod error;
pub mod generate;
#[cfg(feature = "train")]
pub mod gpt2;
pub mod gpt2_config;
#[cfg(feature = "train")]
pub mod hf;
#[cfg(feature = "train")]
pub mod layers;
mod on_engine;
mod presence;
#[cfg(feature = "train")]
pub mod pretrained;
#[cfg(feature = "train")]
pub mod qwen2;
pub mod qwen2_config;
#[cfg(feature = "train")]
pub mod radar_lm;
#[cfg(feature = "train")]
pub mod t5;
pub mod templates;
#[cfg(feature = "train")]
pub mod text_encoder;
pub mod vocab;

#[cfg(feature = "train")]
pub use burn::tensor::Device;
pub use captioner::{Abstained, Captioner, Decoder, Description, FRAME_RATE_HZ};
pub use config::{Backbone, FeedForward, LmConfig, LmPreset, NetworkConfig, T5Config};
#[cfg(feature = "train")]
pub use decoder::{Decoder as DecoderNet, RadarDecoder};
#[cfg(feature = "train")]
pub use dropout::DropoutRng;
pub use error::LmError;
pub use generate::{Allowed, GenerateOptions, Generated};
#[cfg(feature = "train")]
pub use layers::LoraConfig;
pub use on_engine::EngineLm;
#[cfg(feature = "train")]
pub use pretrained::{ModelInput, Pretrained};
#[cfg(feature = "train")]
pub use radar_lm::{RadarLm, RadarNet};
pub use radarllm_engine::{Precision, Source, position};
#[cfg(feature = "train")]
pub use t5::{RadarT5, SourceBatch};
#[cfg(feature = "train")]
pub use text_encoder::{EncodedText, Pooling, TextEncoder};
pub use vocab::Vocab;
