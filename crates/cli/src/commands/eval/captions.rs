//! `eval captions`: captions of a split with all metrics, intervals and baselines.

use std::path::{Path, PathBuf};

use clap::Args;
use radarllm_dataset::{Dataset, Split};
use radarllm_eval::{
    EvalError,
    captions::{
        AddScores, CaptionReport, CaptionedClip, EvaluationOptions, evaluate_captions_with,
        report::markdown,
    },
    round_trip::{self, RoundTripLine, RoundTripOptions, RoundTripReport, evaluate_round_trip},
};
use radarllm_inference::lm::templates::Task;
use radarllm_metrics::{Candidate, Reference, Scores};

use super::page;
use crate::{
    commands::{describe, generate},
    error::{CliError, CliResult},
    memory::peak_memory_mb,
    model,
    model_args::{DecoderName, EncoderArgs},
    output,
};

/// `eval captions`.
#[derive(Args)]
pub(crate) struct CaptionsArgs {
    /// Model folder, or a bundled model: `features` (the default) or `tokens`.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Data set folder.
    #[arg(long)]
    pub data: PathBuf,
    /// Split to describe.
    #[arg(long, default_value = "test")]
    pub split: String,
    /// Folder for report.json, report.md, report.html and captions.jsonl.
    #[arg(long)]
    pub out: PathBuf,
    /// Decoder of the language model.
    #[arg(long, value_enum, default_value = "f32")]
    pub decoder: DecoderName,
    /// Search for the most probable sentence with N beams (1 is greedy) instead of a vote among drawn sentences.
    #[arg(long, value_name = "N")]
    pub beam: Option<usize>,
    /// Instead of captions: generate radar from the captions of N motions, and describe what was generated. The folder
    /// gets round-trip.json, round-trip.md and round-trip.jsonl.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(2..=1_000_000))]
    pub round_trip: Option<u64>,
    /// Sentence encoders.
    #[command(flatten)]
    pub encoders: EncoderArgs,
    /// Seed of bootstrap and shuffling.
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
pub(crate) fn run(args: &CaptionsArgs) -> CliResult {
    if let Some(count) = args.round_trip {
        return round_trip(args, count as usize);
    }
    output::check_free(&args.out.join("report.json"), args.force)?;
    let options = EvaluationOptions {
        split: split(&args.split)?,
        beam: args.beam,
        seed: args.seed,
    };
    let adding = adder(&args.encoders, args.seed)?;
    let report = evaluate_into(
        &args.out,
        args.model.as_deref(),
        args.decoder,
        &args.data,
        &options,
        adding.as_ref(),
    )?;
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(markdown(&report).trim_end());
    Ok(())
}

/// Further scores of captions.
pub(crate) type Adder =
    Box<dyn Fn(&mut Scores, &[Candidate], &[Reference]) -> Result<(), EvalError>>;

/// What the named sentence encoders add to the scores of captions; nothing without any.
pub(crate) fn adder(args: &EncoderArgs, seed: u64) -> CliResult<Adder> {
    #[cfg(feature = "train")]
    if let Some(encoders) = crate::commands::model_scores::Encoders::open(args)? {
        return Ok(Box::new(move |scores, candidates, references| {
            encoders.add(scores, candidates, references, seed)
        }));
    }
    #[cfg(not(feature = "train"))]
    if args.are_given() {
        return Err(crate::error::needs_training("--bert-score or --sim-cse"));
    }
    let _ = (args, seed);
    Ok(Box::new(|_, _, _| Ok(())))
}

/// Generates radar from captions and describes it.
fn round_trip(args: &CaptionsArgs, count: usize) -> CliResult {
    output::check_free(&args.out.join("round-trip.json"), args.force)?;
    describe::check_beam(args.beam)?;
    let options = RoundTripOptions {
        split: split(&args.split)?,
        count,
        beam: args.beam,
        seed: args.seed,
    };
    let (report, lines) = round_trip_into(
        &args.out,
        args.model.as_deref(),
        args.decoder,
        &args.data,
        &options,
    )?;
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(round_trip::markdown(&report, &lines).trim_end());
    Ok(())
}

/// Evaluates round trips of a model and writes round-trip.jsonl, round-trip.md and round-trip.json.
pub(crate) fn round_trip_into(
    out: &Path,
    model: Option<&Path>,
    decoder: DecoderName,
    data: &Path,
    options: &RoundTripOptions,
) -> CliResult<(RoundTripReport, Vec<RoundTripLine>)> {
    let model = model::open(model, decoder)?;
    let name = model.name();
    // Said before anything is read: most models did not learn to generate.
    let learned = model.networks()?.require(Task::TextToRadar, false);
    learned.map_err(|e| generate::not_learned(name, e))?;
    let decoder = model.points()?;
    let data = Dataset::open(data)?;
    let points = |codes: &[u32], text: &str| Ok(generate::clip_of(&decoder, codes, text, name)?);
    let (report, lines) = evaluate_round_trip(model.networks()?, name, points, &data, options)?;
    let write = |name: &str, text: &str| output::write_atomic(&out.join(name), text.as_bytes());
    write("round-trip.jsonl", &output::json_lines(&lines)?)?;
    write("round-trip.md", &round_trip::markdown(&report, &lines))?;
    write("round-trip.json", &serde_json::to_string_pretty(&report)?)?;
    Ok((report, lines))
}

/// A split by its name.
pub(crate) fn split(name: &str) -> CliResult<Split> {
    Split::from_name(name)
        .ok_or_else(|| CliError::new(format!("--split {name}: unknown")).hint("train, val or test"))
}

/// Evaluates a model and writes captions.jsonl, report.md, report.html and report.json.
pub(crate) fn evaluate_into(
    out: &Path,
    model: Option<&Path>,
    decoder: DecoderName,
    data: &Path,
    options: &EvaluationOptions,
    add: AddScores,
) -> CliResult<CaptionReport> {
    let model = model::open(model, decoder)?;
    let info = model::info(&model, decoder)?;
    let data = Dataset::open(data)?;
    let cut = model::open_cut(&model, decoder)?;
    let cut: Vec<_> = cut
        .iter()
        .map(|c| Ok((c.cut, c.model.networks()?)))
        .collect::<CliResult<_>>()?;
    let (mut report, clips) =
        evaluate_captions_with(model.networks()?, &cut, &info, &data, options, add)?;
    report.peak_memory_mb = peak_memory_mb();
    let write = |name: &str, text: &str| output::write_atomic(&out.join(name), text.as_bytes());
    let lines = output::json_lines(clips.iter().map(CaptionedClip::line))?;
    write("captions.jsonl", &lines)?;
    write("report.md", &markdown(&report))?;
    write("report.html", &page::html(&report, &clips))?;
    write("report.json", &serde_json::to_string_pretty(&report)?)?;
    Ok(report)
}
