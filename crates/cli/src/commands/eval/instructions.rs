//! `eval instructions`: questions about the clips of a split, in words that no training had.

use std::path::{Path, PathBuf};

use clap::Args;
use radarllm_dataset::Dataset;
use radarllm_eval::instructions::{
    InstructionOptions, InstructionReport, Wordings, evaluate_instructions, markdown,
};
use radarllm_files::bounded::{self, MAX_CONFIG_BYTES};
use radarllm_inference::lm::templates::Task;

use super::captions::split;
use crate::{
    commands::generate,
    error::{CliError, CliResult},
    model,
    model_args::DecoderName,
    output,
};

/// `eval instructions`.
#[derive(Args)]
pub(crate) struct InstructionsArgs {
    /// Wordings of the questions, TOML.
    pub wordings: PathBuf,
    /// Model folder, or a bundled model, of which only `tokens` learned to follow instructions.
    #[arg(long, default_value = "tokens")]
    pub model: PathBuf,
    /// Data set folder.
    #[arg(long)]
    pub data: PathBuf,
    /// Split whose clips are asked.
    #[arg(long, default_value = "test")]
    pub split: String,
    /// Number of motions that are asked; all if 0.
    #[arg(long, default_value_t = 0)]
    pub count: usize,
    /// Folder for instructions.json, instructions.md and instructions.jsonl.
    #[arg(long)]
    pub out: PathBuf,
    /// Seed of claims and of the bootstrap.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Replace an earlier report.
    #[arg(long)]
    pub force: bool,
    /// Print the report as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub(super) fn run(args: &InstructionsArgs) -> CliResult {
    output::check_free(&args.out.join("instructions.json"), args.force)?;
    let options = InstructionOptions {
        split: split(&args.split)?,
        count: args.count,
        seed: args.seed,
    };
    let report = evaluate_into(&args.out, &args.model, &args.wordings, &args.data, &options)?;
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(markdown(&report).trim_end());
    Ok(())
}

/// Asks a model, and writes instructions.jsonl, instructions.md and instructions.json.
pub(crate) fn evaluate_into(
    out: &Path,
    model: &Path,
    wordings: &Path,
    data: &Path,
    options: &InstructionOptions,
) -> CliResult<InstructionReport> {
    let text = bounded::read_text(wordings, MAX_CONFIG_BYTES)?;
    let wordings = Wordings::from_toml(&text)
        .map_err(|e| CliError::new(format!("{}: {e}", wordings.display())))?;
    let model = model::open(Some(model), DecoderName::F32)?;
    let learned = model.networks()?.require(Task::Question, true);
    learned.map_err(|e| generate::not_learned(model.name(), e))?;
    let data = Dataset::open(data)?;
    let (report, lines) =
        evaluate_instructions(model.networks()?, model.name(), &data, &wordings, options)?;
    let write = |name: &str, text: &str| output::write_atomic(&out.join(name), text.as_bytes());
    write("instructions.jsonl", &output::json_lines(&lines)?)?;
    write("instructions.md", &markdown(&report))?;
    write("instructions.json", &serde_json::to_string_pretty(&report)?)?;
    Ok(report)
}
