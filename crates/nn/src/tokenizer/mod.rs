//! The radar tokenizer's network (Aggregate VQ-VAE).
//!
//! ```text
//! points --> centre --> tubes --> [step, anchor, C] --> context --> pooled --> [code, D] --> ids
//!             (radarllm-inference)  (point_conv)       (attention)  (network)   (codebook)
//! ```
//!
//! Reading order: [`batch`] (batches of clips), [`point_conv`], [`attention`], [`network`], [`codebook`],
//! [`reference`](mod@reference) (points to codes by this network), [`points`] (codes to points). Reconstruction and guidance losses are in
//! `radarllm-train`.

pub mod attention;
pub mod batch;
pub mod codebook;
pub mod network;
pub mod point_conv;
pub mod points;
pub mod reference;

pub use reference::{ReferenceTokenizer, pack};
