//! Pretrained networks of other architectures: GPT-2, Qwen2, BERT and RoBERTa, with LoRA adapters.
//!
//! Uses:
//!
//! - A GPT-2 or Qwen2 that replaces the T5 ([`RadarDecoder`], [`DecoderOnlyNet`]): the paper compares backbones.
//! - LoRA adapters in PEFT's layout on such a network ([`LoraConfig`], [`decoder_files`]).
//! - Loading of any of these checkpoints by its `model_type`, single or sharded, for comparison ([`Pretrained`]).
//! - Sentence embedding by a BERT, for BERTScore and SimCSE ([`TextEncoder`]).
//!
//! Tests cover logits and hidden states against the reference implementations on small networks with random
//! weights (`tests/goldens/make_hf.py`, `make_lora.py`), merged and unmerged adapters, damaged and hostile files,
//! decoding with and without a cache, and training steps. docs/reference/backbones.md has the details.
//!
//! No published pretrained weights were ever loaded. Networks with the shapes of `gpt2`, `Qwen2-0.5B` and
//! `roberta-large` were built, but their published files were not read. Their tokenizers and their file layouts
//! are therefore supported by specification only.
//!
//! Reading order: [`layers`] (shared by the architectures), [`gpt2`], [`qwen2`], [`bert`], [`folder`] (a checkpoint
//! folder by its `model_type`), [`decoder`] (a network that replaces the T5), [`decoder_files`] (its files),
//! [`text_encoder`].

pub mod bert;
pub mod decoder;
pub mod decoder_files;
pub mod folder;
pub mod gpt2;
pub mod layers;
pub mod qwen2;
pub mod text_encoder;

pub use decoder::{DecoderOnlyNet, RadarDecoder};
pub use folder::{ModelInput, Pretrained};
pub use layers::LoraConfig;
pub use text_encoder::{EncodedText, Pooling, TextEncoder};
