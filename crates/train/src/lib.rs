//! Training: losses, learning rate schedules, batches, training loops, and checkpoints from which runs resume.
//!
//! The input is clips ([`radarllm_dataset::record::ClipRecord`]), the output is checkpoints. Each stage has a
//! configuration struct that can be read from TOML and a `train` function. All stages share [`harness`].
//! [`recipe::Recipe`] runs all stages in order and writes the folder that [`radarllm_inference::Captioner::load`]
//! opens.
//!
//! ```
//! use std::path::Path;
//!
//! use radarllm_train::recipe::{Recipe, RecipeStage};
//!
//! let text = r#"
//!     data = "my-data"
//!     out = "my-model"
//!     [tokenizer.loop]
//!     epochs = 20
//! "#;
//! let mut recipe = Recipe::from_toml(text, Path::new("configs"))?;
//! assert_eq!(recipe.out, Path::new("configs/my-model"));
//! assert!(!recipe.is_finished(RecipeStage::Tokenizer));
//!
//! // After Ctrl-C, for example: the stage writes a checkpoint and ends.
//! let stop = recipe.stop.clone();
//! stop.stop();
//! # Ok::<(), radarllm_train::harness::TrainError>(())
//! ```
//!
//! The crate prints nothing. Progress is reported as events of the crate `tracing`, whose messages are complete lines.
//!
//! Reading order: [`harness`] (training loop), [`inputs`] (what a stage learns from, by hashes), [`adamw`] (optimiser), [`data`] (batches and augmentation), [`motion`],
//! [`tokenizer`], [`points`], [`evidence`] and [`pose`] (stages), [`lm`] (language-model stages), [`motion_codes`] and [`pictures`] (what comparison
//! systems read instead of radar codes).

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

pub mod adamw;
mod average;
pub mod caption_words;
pub mod chamfer;
pub mod code_captions;
pub mod data;
mod error;
mod event_file;
pub mod evidence;
pub mod harness;
pub mod inputs;
pub mod lm;
mod log;
mod loop_config;
mod loss_scale;
pub mod motion;
pub mod motion_codes;
pub mod pictures;
pub mod points;
pub mod pose;
pub mod recipe;
mod stop;
pub mod tokenizer;
mod tokenizer_config;
pub mod tokens_only;
mod values;
