//! The radar tokenizer (Aggregate VQ-VAE) and the radar-language model (T5).
//!
//! Radar points enter, codes leave ([`tokenizer`]); codes and words enter, sentences leave
//! ([`lm`]). Losses, optimisers and loops live in `radarllm-train`; this crate holds what inference
//! needs. Nothing here opens a socket, and files are opened only by [`checkpoint`].
//!
//! Inference runs on `radarllm-engine` alone. The networks as they are trained, in burn, and what only they
//! need come with the feature `train`: [`tokenizer::network`] and below, [`motion_vqvae`], most of [`lm`]. [`device`] says
//! what they run on, [`precision`] how exactly their products are computed.
//!
//! Reading order: [`checkpoint`] (files), [`tokenizer`] (points to codes), [`motion_vqvae`] (the
//! teacher that guides the tokenizer's training), [`lm`] (codes to words).

pub mod checkpoint;
#[cfg(feature = "train")]
pub mod device;
pub mod lm;
#[cfg(feature = "train")]
pub mod motion_vqvae;
#[cfg(feature = "train")]
mod params;
#[cfg(feature = "train")]
pub mod precision;
pub mod tokenizer;
