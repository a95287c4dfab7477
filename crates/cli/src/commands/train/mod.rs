//! `train`: one stage, or all of them. Builds without training have its arguments alone.

#[cfg(feature = "train")]
mod run;

use std::path::PathBuf;

use clap::{Args, ValueEnum};

#[cfg(feature = "train")]
pub(crate) use run::run;

#[cfg(not(feature = "train"))]
use crate::error::{CliResult, needs_training};

/// Values of the keys that a training configuration does not set.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum, Debug)]
pub(crate) enum Preset {
    /// Networks for CPU cores, with this project's additions to the paper.
    Small,
    /// Sizes, losses, batches, learning rates and epochs of the paper.
    Paper,
}

/// Stages of `train`.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum, Debug)]
pub(crate) enum Stage {
    /// The motion VQ-VAE that guides the tokenizer.
    Motion,
    /// The radar tokenizer.
    Tokenizer,
    /// The language model on the three pretraining tasks.
    Pretrain,
    /// Instruction tuning.
    Instruct,
    /// The decoder of radar codes, which `radarllm generate` needs.
    Points,
    /// The networks that weigh what is said by what the points say by themselves.
    Evidence,
    /// The estimator of body pose from points (mmMesh's network), for comparison systems.
    Pose,
    /// Every stage in order; `points`, `evidence` and `pose` only if the configuration has a table of that name.
    All,
}

/// `train`.
#[derive(Args)]
pub(crate) struct TrainArgs {
    /// Stage.
    #[arg(value_enum)]
    pub stage: Stage,
    /// Training configuration (TOML).
    #[arg(required_unless_present = "print_config")]
    pub config: Option<PathBuf>,
    /// Values of the keys that the configuration does not set, instead of those of its own preset.
    #[arg(long, value_enum)]
    pub preset: Option<Preset>,
    /// Continue from the last checkpoint; finished stages are kept.
    #[arg(long)]
    pub resume: bool,
    /// Print the configuration with all defaults and exit.
    #[arg(long)]
    pub print_config: bool,
    /// Replace an earlier training in the output folder.
    #[arg(long)]
    pub force: bool,
    /// Device instead of the configuration's: cpu, gpu, gpu:N, cuda, cuda:N, or several, as gpu:0,gpu:1
    /// (docs/guides/training-on-gpus.md).
    #[arg(long, value_name = "DEVICE")]
    pub device: Option<String>,
    /// Threads of a training on the CPU; the result does not depend on their number; all cores if omitted.
    #[arg(long)]
    pub threads: Option<usize>,
}

/// Says that this build has no training.
#[cfg(not(feature = "train"))]
pub(crate) fn run(_: &TrainArgs) -> CliResult {
    Err(needs_training("`train`"))
}
