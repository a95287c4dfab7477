//! The radar-language model: radar codes and words in one vocabulary, read and written by a T5, a GPT-2 or
//! a Qwen2.
//!
//! Reading order: [`config`] (shapes and presets), [`position`] (relative position buckets),
//! [`t5`] (the network), [`decoder`] (a decoder alone in its place) and [`decoder_files`] (its files), [`hf`] (Hugging Face names and files), [`vocab`] (ids), [`templates`]
//! (prompts), [`radar_lm`] (network + vocabulary on disk), [`generate`] (greedy and beam
//! decoding), `on_engine` (the same on packed weights), [`captioner`] (points in, sentence out). Beside it:
//! [`pretrained`] (checkpoints of other architectures, for comparison and metrics), [`gpt2`], [`qwen2`],
//! [`bert`], [`layers`], [`text_encoder`] (sentences into vectors).
//!
//! Deliberately absent: losses, batching and schedules live in `radarllm-train`.

pub mod bert;
pub mod captioner;
pub mod config;
pub mod decoder;
pub mod decoder_files;
mod error;
pub mod generate;
pub mod gpt2;
pub mod hf;
pub mod layers;
mod on_engine;
mod presence;
pub mod pretrained;
pub mod qwen2;
pub mod radar_lm;
pub mod t5;
pub mod templates;
pub mod text_encoder;
pub mod vocab;

pub use burn::tensor::Device;
pub use captioner::{Abstained, Captioner, Decoder, Description, FRAME_RATE_HZ};
pub use config::{Backbone, FeedForward, LmConfig, LmPreset, NetworkConfig, T5Config};
pub use decoder::{Decoder as DecoderNet, RadarDecoder};
pub use error::LmError;
pub use generate::{Allowed, GenerateOptions, Generated};
pub use layers::LoraConfig;
pub use pretrained::{ModelInput, Pretrained};
pub use radar_lm::{RadarLm, RadarNet};
pub use radarllm_engine::{Precision, position};
pub use t5::{DropoutRng, RadarT5, Source, SourceBatch};
pub use text_encoder::{EncodedText, Pooling, TextEncoder};
pub use vocab::Vocab;
