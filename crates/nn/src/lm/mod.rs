//! The radar-language model in burn: the T5, its files and decoding.
//!
//! Reading order: [`t5`] (the network), [`hf`] (its Hugging Face names and files), [`radar_lm`] (the network with its
//! vocabulary), `decode` (the networks as a backend of the engine's search), `rows`, `pass` and `dropout` (shared by
//! all language models). The decoder-only networks that can replace the T5 are in [`crate::pretrained`].

mod decode;
mod dropout;
#[cfg(test)]
mod engine_equality;
pub mod hf;
pub(crate) mod pass;
pub mod radar_lm;
pub(crate) mod rows;
pub mod t5;
pub mod text;

pub use dropout::DropoutRng;
pub use pass::TrainingPass;
pub use radar_lm::{RadarLm, RadarNet};
pub use rows::{Rows, Steps};
pub use t5::{RadarT5, SourceBatch};
