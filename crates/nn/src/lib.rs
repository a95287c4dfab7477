//! The networks in burn, as they are trained.
//!
//! Everything that needs the learning framework is here: the radar tokenizer's network, the motion VQ-VAE that guides
//! it, the T5, the decoder-only networks that can take its place, and the devices that they run on. Inference does not
//! need this crate: `radarllm-inference` runs trained weights on its own engine. Training does, and so do the tests
//! that compare the engine with the networks that it replaces.
//!
//! | to find | look at |
//! |---|---|
//! | points to codes, as trained | [`tokenizer::network`], [`tokenizer::ReferenceTokenizer`] |
//! | codes to words, as trained | [`lm::RadarLm`] |
//! | a captioner on these networks | [`ReferenceBackend`], [`load_reference_captioner`] |
//! | the teacher of the radar tokenizer | [`motion_vqvae`] |
//! | GPT-2, Qwen2, BERT, LoRA adapters | [`pretrained`] |
//! | CPU, GPU, several GPUs | [`device`] |
//! | parameters by name | [`params`] |
//!
//! Deliberately absent: losses, optimisers, batches and loops live in `radarllm-train`; configuration types,
//! vocabulary, prompts and checkpoint files in `radarllm-inference`.

pub mod backend;
pub mod device;
pub mod lm;
pub mod motion_vqvae;
pub mod params;
pub mod precision;
pub mod pretrained;
pub mod tokenizer;

pub use backend::{
    ReferenceBackend, captioner_from_checkpoints, load_reference_captioner, reference_captioner,
};
pub use burn::tensor::Device;
