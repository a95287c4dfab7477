//! `baselines`: comparison systems and floors beside our model, on the same clips. Builds without training have its arguments
//! alone.

mod answers;
#[cfg(feature = "train")]
mod captions;
mod endpoint;
mod estimated;
mod prompts;
mod radhar;
mod render;
#[cfg(feature = "train")]
mod run;

use std::path::PathBuf;

use clap::{Args, Subcommand};

use answers::AnswersArgs;
use radhar::RadharArgs;
use render::RenderArgs;

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
    /// Render the estimated or the true bodies of a split as videos, with prompts for video language models elsewhere.
    ///
    /// Example: radarllm baselines render work/data --true --out renders
    Render(RenderArgs),
    /// Train supervised classifiers on RadHAR's recordings for tuning, and test them by recording, by session and by window.
    ///
    /// Example: radarllm baselines radhar configs/eval/baselines-radhar.toml --recordings radhar
    Radhar(RadharArgs),
    /// Turn the answers of a video language model into the captions of a row.
    ///
    /// Example: radarllm baselines answers renders answers.jsonl --as Video-LLaVA-7B@984e65b --data work/data --out work/baselines
    Answers(AnswersArgs),
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
        BaselinesVerb::Render(args) => render::run(args),
        BaselinesVerb::Radhar(args) => radhar::run(args),
        BaselinesVerb::Answers(args) => answers::run(args),
    }
}
