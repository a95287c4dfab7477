//! `eval`: captions of a split with all metrics, intervals and baselines.

use std::path::Path;

use radarllm_dataset::{Dataset, Split};
use radarllm_eval::captions::{
    CaptionReport, CaptionedClip, EvaluationOptions, evaluate_captions, report::markdown,
};

use crate::{
    args::{DecoderName, EvalArgs},
    commands::{eval_page, model_files},
    error::{CliError, CliResult},
    memory::peak_memory_mb,
    output,
};

/// Runs the command.
pub fn run(args: &EvalArgs) -> CliResult {
    output::check_free(&args.out.join("report.json"), args.force)?;
    let options = EvaluationOptions {
        split: split(&args.split)?,
        beam: args.beam,
        seed: args.seed,
    };
    let report = evaluate_into(
        &args.out,
        args.model.as_deref(),
        args.decoder,
        &args.data,
        &options,
    )?;
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(markdown(&report).trim_end());
    Ok(())
}

/// A split by its name.
pub fn split(name: &str) -> CliResult<Split> {
    Split::from_name(name)
        .ok_or_else(|| CliError::new(format!("--split {name}: unknown")).hint("train, val or test"))
}

/// Evaluates a model and writes captions.jsonl, report.md, report.html and report.json.
pub fn evaluate_into(
    out: &Path,
    model: Option<&Path>,
    decoder: DecoderName,
    data: &Path,
    options: &EvaluationOptions,
) -> CliResult<CaptionReport> {
    let (captioner, model) = model_files::load(model, decoder)?;
    let data = Dataset::open(data)?;
    let (mut report, clips) = evaluate_captions(captioner.model(), &model, &data, options)?;
    report.peak_memory_mb = peak_memory_mb();
    let write = |name: &str, text: &str| output::write_atomic(&out.join(name), text.as_bytes());
    write("captions.jsonl", &json_lines(&clips)?)?;
    write("report.md", &markdown(&report))?;
    write("report.html", &eval_page::html(&report, &clips))?;
    write("report.json", &serde_json::to_string_pretty(&report)?)?;
    Ok(report)
}

fn json_lines(clips: &[CaptionedClip]) -> CliResult<String> {
    let mut lines = String::new();
    for clip in clips {
        lines += &serde_json::to_string(&clip.line())?;
        lines.push('\n');
    }
    Ok(lines)
}
