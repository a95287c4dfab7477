//! `baselines`: comparison systems and floors beside our model, on the same clips. Builds without training have its arguments
//! alone.

#[cfg(feature = "train")]
mod captions;
#[cfg(feature = "train")]
mod run;

use std::path::PathBuf;

use clap::{Args, Subcommand};

#[cfg(not(feature = "train"))]
use crate::error::needs_training;
use crate::{error::CliResult, model_args::EncoderArgs};

/// `baselines ...`.
#[derive(Subcommand)]
pub(crate) enum BaselinesVerb {
    /// Train, describe and score the rows of a comparison, and write its table.
    ///
    /// What was interrupted continues with the same command.
    ///
    /// Example: radarllm baselines run configs/eval/baselines.toml
    Run(RunArgs),
}

/// `baselines run`.
#[derive(Args)]
pub(crate) struct RunArgs {
    /// The comparison: base recipe, rows and published values; see docs/guides/baselines.md.
    pub config: PathBuf,
    /// Name of a row to run besides the first one; may be repeated. The other rows are shown as left out.
    #[arg(long, value_name = "ROW")]
    pub only: Vec<String>,
    /// Number of trainings that run at the same time and share the cores.
    #[arg(long, default_value_t = 1)]
    pub jobs: usize,
    /// Print what is finished and what is missing, and exit.
    #[arg(long)]
    pub plan: bool,
    /// Sentence encoders.
    #[command(flatten)]
    pub encoders: EncoderArgs,
    /// Print the table as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub(crate) fn run(verb: &BaselinesVerb) -> CliResult {
    match verb {
        #[cfg(feature = "train")]
        BaselinesVerb::Run(args) => run::run(args),
        #[cfg(not(feature = "train"))]
        BaselinesVerb::Run(_) => Err(needs_training("`baselines run`")),
    }
}
