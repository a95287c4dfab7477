//! `eval interventions`: changes one parameter of a built-in motion and checks whether the caption follows.

use std::path::PathBuf;

use clap::Args;
use radarllm_eval::interventions::{InterventionOptions, evaluate_interventions};

use crate::{error::CliResult, model, model_args::DecoderName, output, threads::on_threads};

/// `eval interventions`.
#[derive(Args)]
pub(crate) struct InterventionsArgs {
    /// Model folder, or a bundled model: `features` (the default) or `tokens`.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Number of interventions: side, direction and action take turns.
    #[arg(long, default_value_t = 60)]
    pub count: usize,
    /// Seed of motions, placement and noise.
    #[arg(long, default_value_t = 1000)]
    pub seed: u64,
    /// Threads of the simulation; all cores if omitted.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub(super) fn run(args: &InterventionsArgs) -> CliResult {
    let model = model::open(args.model.as_deref(), DecoderName::F32)?;
    let options = InterventionOptions {
        count: args.count,
        seed: args.seed,
    };
    let networks = model.networks()?;
    let report = on_threads(args.threads, || evaluate_interventions(networks, &options))??;
    if args.json {
        return output::print_json(&report);
    }
    for row in &report.rows {
        let mark = if row.followed { "yes" } else { "NO " };
        output::print_line(&format!(
            "{mark} {}\n      {}\n    {}\n      {}",
            row.from, row.from_caption, row.to, row.to_caption
        ));
    }
    for (name, [hits, count]) in &report.followed {
        output::print_line(&format!(
            "{name}: the caption followed {hits} of {count} interventions"
        ));
    }
    Ok(())
}
