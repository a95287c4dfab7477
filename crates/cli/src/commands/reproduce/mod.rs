//! `reproduce`: builds, trains and evaluates what the paper's tables show. Builds without training have its arguments alone.

#[cfg(feature = "train")]
mod page;
#[cfg(feature = "train")]
mod run;

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

#[cfg(feature = "train")]
pub(crate) use run::run;

#[cfg(not(feature = "train"))]
use crate::error::{CliResult, needs_training};

/// `reproduce ...`.
#[derive(Subcommand)]
pub(crate) enum ReproduceVerb {
    /// The system of the RadarLLM paper: data, trainings, scores and ablations, on one page beside the figures of the paper.
    ///
    /// What was interrupted continues with the same command.
    ///
    /// Example: radarllm reproduce paper --scale small --out work/paper
    Paper(PaperArgs),
}

/// `reproduce paper`.
#[derive(Args)]
pub(crate) struct PaperArgs {
    /// How much is trained, and on what.
    #[arg(long, value_enum)]
    pub scale: Scale,
    /// Folder for data, models, reports and the page, paper.md.
    #[arg(long)]
    pub out: PathBuf,
    /// Folder of the configurations, as in a clone of the repository.
    #[arg(long, default_value = "configs/reproduce")]
    pub configs: PathBuf,
    /// Number of trainings that run at the same time and share the cores.
    #[arg(long, default_value_t = 2)]
    pub jobs: usize,
    /// Print what would be done, what is done already and what it took elsewhere, and exit.
    #[arg(long)]
    pub plan: bool,
}

/// How much is trained, and on what.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Scale {
    /// Simulated motions of the library and small networks; needs nothing but a clone.
    Small,
    /// The part of HumanML3D whose motions can be had freely, and small networks.
    Cmu,
    /// HumanML3D with AMASS, and the paper's networks: for a GPU.
    Amass,
}

impl Scale {
    /// Name of its configuration.
    #[cfg_attr(
        not(feature = "train"),
        expect(dead_code, reason = "only training reads it")
    )]
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Small => "small",
            Self::Cmu => "cmu",
            Self::Amass => "amass",
        }
    }
}

/// Says that this build has no training.
#[cfg(not(feature = "train"))]
pub(crate) fn run(_: &ReproduceVerb) -> CliResult {
    Err(needs_training("`reproduce`"))
}
