//! The training implementation of the neural networks, in burn.
//!
//! This crate contains everything that needs the deep-learning framework: the network of the radar tokenizer, the
//! motion VQ-VAE that guides it, the T5, the decoder-only networks that can replace the T5, and the devices that they
//! run on. Inference does not need this crate, because `radarllm-inference` runs trained weights on its own engine. It
//! is used for training and for the tests that compare the engine with these networks.
//!
//! | topic | module or type |
//! |---|---|
//! | points to codes, training implementation | [`tokenizer::network`], [`tokenizer::ReferenceTokenizer`] |
//! | codes to words, training implementation | [`lm::RadarLm`] |
//! | a captioner on these networks | [`ReferenceBackend`], [`load_reference`], [`load_any`] |
//! | the teacher of the radar tokenizer | [`motion_vqvae`] |
//! | what the points say by themselves | [`evidence`] |
//! | GPT-2, Qwen2, BERT, LoRA adapters | [`pretrained`] |
//! | CPU, GPU, several GPUs | [`device`] |
//! | parameters by name | [`params`] |
//!
//! This crate does not contain losses, optimisers, training batches or training loops, which are in `radarllm-train`.
//! Configuration types, the vocabulary, prompts and checkpoint files are in `radarllm-inference`.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

pub mod backend;
pub mod device;
pub mod evidence;
pub mod lm;
pub mod motion_vqvae;
pub mod params;
pub mod pose;
pub mod precision;
pub mod pretrained;
pub mod tokenizer;

pub use backend::{ReferenceBackend, load_any, load_reference};
pub use burn::tensor::Device;
