//! `ablate`: trains and evaluates a grid of modified recipes. Builds without training have its arguments alone.

#[cfg(feature = "train")]
mod run;

use std::path::PathBuf;

use clap::Args;

#[cfg(feature = "train")]
pub(crate) use run::{PlannedGrid, run};

#[cfg(not(feature = "train"))]
use crate::error::{CliResult, needs_training};

/// `ablate`.
#[derive(Args)]
pub(crate) struct AblateArgs {
    /// The grid: base recipe, seeds, tables and rows; see docs/guides/ablations.md.
    pub config: PathBuf,
    /// Number of trainings that run at the same time and share the cores.
    #[arg(long, default_value_t = 1)]
    pub jobs: usize,
    /// Print finished and missing runs, and exit.
    #[arg(long)]
    pub plan: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Says that this build has no training.
#[cfg(not(feature = "train"))]
pub(crate) fn run(_: &AblateArgs) -> CliResult {
    Err(needs_training("`ablate`"))
}
