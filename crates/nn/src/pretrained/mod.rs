//! Pretrained networks of other architectures: GPT-2, Qwen2, BERT and RoBERTa, with LoRA adapters.
//!
//! What it is for:
//!
//! - A GPT-2 or Qwen2 in the T5's place ([`RadarDecoder`], [`DecoderOnlyNet`]): the paper compares backbones.
//! - LoRA adapters in PEFT's layout on such a network ([`LoraConfig`], [`decoder_files`]).
//! - Any of these checkpoints by its `model_type`, single or sharded, for comparison ([`Pretrained`]).
//! - Sentences into vectors by a BERT, for BERTScore and SimCSE ([`TextEncoder`]).
//!
//! What is tested: logits and hidden states against the reference implementations on small networks with random
//! weights (`tests/goldens/make_hf.py`, `make_lora.py`), adapters merged and not, damaged and hostile files, decoding
//! with and without a cache, training steps. docs/backbones.md has the details.
//!
//! What it was never run on: weights that somebody pretrained. The shapes of `gpt2`, `Qwen2-0.5B` and
//! `roberta-large` were built, their published files were never loaded, so their tokenizers and their file layouts
//! are supported by specification only.
//!
//! Reading order: [`layers`] (what the architectures share), [`gpt2`], [`qwen2`], [`bert`], [`folder`] (a checkpoint
//! folder by its `model_type`), [`decoder`] (a network in the T5's place), [`decoder_files`] (its files),
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
