//! Training: losses, schedules, batches, loops, checkpoints that resume.
//!
//! Clips enter ([`radarllm_dataset::record::ClipRecord`]), checkpoints leave. Each stage has a
//! configuration struct readable from TOML and a `train` function; all share [`harness`].
//!
//! Reading order: [`harness`] (the loop), [`adamw`] (the update), [`data`] (batches and
//! augmentation), [`motion`] and [`tokenizer`] (stages), [`lm`] (language-model stages).

pub mod adamw;
mod average;
pub mod caption_words;
pub mod chamfer;
pub mod data;
mod error;
mod event_file;
pub mod harness;
pub mod lm;
mod log;
mod loop_config;
mod loss_scale;
pub mod motion;
pub mod recipe;
pub mod tokenizer;
mod tokenizer_config;
mod values;
