//! `lm`: pretrained language models. Builds without training have its arguments alone.

#[cfg(feature = "train")]
mod run;

use std::path::PathBuf;

use clap::Subcommand;

#[cfg(feature = "train")]
pub(crate) use run::run;

#[cfg(not(feature = "train"))]
use crate::error::{CliResult, needs_training};

/// `lm ...`.
#[derive(Subcommand)]
pub(crate) enum LmVerb {
    /// Run a forward pass: logits, or the last hidden states of BERT and RoBERTa.
    ///
    /// Example: radarllm lm logits --weights gpt2 --ids ids.json --out logits.npy
    Logits {
        /// Folder with config.json and model.safetensors (single or sharded).
        #[arg(long)]
        weights: PathBuf,
        /// JSON `{"input_ids": [[..]], "decoder_input_ids": [[..]]}`, rows of equal length;
        /// optional `attention_mask` of the same shape (1 token, 0 padding).
        #[arg(long)]
        ids: PathBuf,
        /// npy f32 `[batch, step, vocab]`, or `[batch, step, width]` of hidden states.
        #[arg(long)]
        out: PathBuf,
        /// Replace an existing file.
        #[arg(long)]
        force: bool,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Make a model read its radar tokens alone: what the features beside them say becomes part of the tokens' embeddings.
    ///
    /// Nothing is trained; a training goes on from the result if a recipe names it as `start`.
    ///
    /// Example: radarllm lm tokens --model models/own --out work/tokens
    Tokens {
        /// Folder of the model, with `tokenizer` and `lm`; of an ensemble, each member has a folder of its own.
        #[arg(long)]
        model: PathBuf,
        /// Give each step a second code of this many, which is fitted to what the first code leaves of the features of --data.
        #[arg(long, requires = "data")]
        residual_codes: Option<usize>,
        /// Data set whose training clips the second codes are fitted to; several may be given.
        #[arg(long, requires = "residual_codes")]
        data: Vec<PathBuf>,
        /// New folder.
        #[arg(long)]
        out: PathBuf,
    },
    /// Write a model with its language models, which are T5, as bytes, at a quarter of their size: sentences occasionally
    /// differ by a word.
    ///
    /// Example: radarllm lm pack --model work/model/model --out work/packed
    Pack {
        /// Folder of the model, with `tokenizer` and `lm`; of an ensemble, each member has a folder of its own.
        #[arg(long)]
        model: PathBuf,
        /// New folder.
        #[arg(long)]
        out: PathBuf,
    },
    /// Merge the adapters of a trained GPT-2 or Qwen2 into its weights, for programs without adapter support.
    ///
    /// Example: radarllm lm merge --model work/model/model/lm --out merged
    Merge {
        /// Folder of the language model: adapter_config.json and adapter_model.safetensors.
        #[arg(long)]
        model: PathBuf,
        /// New folder: config.json, tokenizer.json, model.safetensors.
        #[arg(long)]
        out: PathBuf,
    },
}

/// Says that this build has no training.
#[cfg(not(feature = "train"))]
pub(crate) fn run(_: &LmVerb) -> CliResult {
    Err(needs_training("`lm`"))
}
