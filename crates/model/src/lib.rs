//! The radar tokenizer (Aggregate VQ-VAE) and the radar-language model (T5).
//!
//! Radar points enter, codes leave ([`tokenizer`]); codes and words enter, sentences leave
//! ([`lm`]). Losses, optimisers and loops live in `radarllm-train`; this crate holds what inference
//! needs. Nothing here opens a socket, and files are opened only by [`checkpoint`].
//!
//! Reading order: [`checkpoint`] (files), [`tokenizer`] (points to codes), [`motion_vqvae`] (the
//! teacher that guides the tokenizer's training), [`lm`] (codes to words).

pub mod checkpoint;
pub mod lm;
pub mod motion_vqvae;
pub mod tokenizer;
