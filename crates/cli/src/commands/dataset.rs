//! `dataset build|prepare|finish|export|info|validate`.

use std::{
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

#[cfg(feature = "eval")]
use clap::Args;
use clap::Subcommand;
use radarllm::{
    DatasetPlan, Error,
    dataset::{self, BuildOptions, Dataset, Overwrite, Progress, ShardEntry},
};
#[cfg(feature = "eval")]
use radarllm_eval::{
    held_out::validate_with_held_out,
    recordings::{Role, training},
};

#[cfg(feature = "eval")]
use crate::error::CliError;
#[cfg(feature = "eval")]
use crate::{
    commands::eval::recordings, model, model_args::DecoderName, recording_args::LabelledArgs,
};
use crate::{error::CliResult, output, threads};

/// `dataset ...`.
#[derive(Subcommand)]
pub(crate) enum DatasetVerb {
    /// Build a data set from motions with captions: Parquet shards. Run it again to resume.
    ///
    /// With --shard, several processes or machines that share the folder build a part each, and `dataset finish` completes
    /// the data set.
    ///
    /// Example: radarllm dataset build configs/data/default-data.toml --out work/data
    ///
    /// Example: radarllm dataset build configs/data/default-data.toml --out work/data --shard 3/8
    Build {
        /// Configuration (TOML); see docs/guides/dataset.md.
        config: PathBuf,
        /// Folder of the data set.
        #[arg(long)]
        out: PathBuf,
        /// Build only this part of the shards, for example 3/8: the third of eight parts.
        #[arg(long, value_name = "PART/PARTS", conflicts_with = "force")]
        shard: Option<Part>,
        /// Threads; all cores if omitted.
        #[arg(long)]
        threads: Option<usize>,
        /// Replace another data set in the folder.
        #[arg(long)]
        force: bool,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Prepare the folder of a data set for processes that build parts of it with --shard. They then read what their shards
    /// are made of instead of opening the sources, which takes as long as the whole data set is large.
    ///
    /// Example: radarllm dataset prepare configs/data/default-data.toml --out work/data
    Prepare {
        /// Configuration (TOML); see docs/guides/dataset.md.
        config: PathBuf,
        /// Folder of the data set.
        #[arg(long)]
        out: PathBuf,
        /// Replace another data set in the folder.
        #[arg(long)]
        force: bool,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Complete a data set whose parts were built with --shard. Exit code 1 if shards are missing, which are named.
    ///
    /// Example: radarllm dataset finish configs/data/default-data.toml --out work/data
    Finish {
        /// Configuration (TOML) of the parts.
        config: PathBuf,
        /// Folder of the data set.
        #[arg(long)]
        out: PathBuf,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    /// Copy a finished data set to a folder for the Hugging Face Hub: card, manifest and shards, with their hashes checked.
    ///
    /// Nothing is uploaded: `huggingface_hub.upload_folder` or git does that.
    ///
    /// Example: radarllm dataset export work/data --to hub
    Export {
        /// Folder of the data set.
        dir: PathBuf,
        /// Folder of the copy.
        #[arg(long)]
        to: PathBuf,
        /// Replace the data set in an existing copy; its other files stay.
        #[arg(long)]
        force: bool,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    #[cfg(feature = "eval")]
    /// Build a data set of recorded radar: recordings for tuning, with the sentences of their activities or with those of a
    /// model.
    ///
    /// A model that learns from recordings is no longer zero-shot. Judged recordings are never read.
    ///
    /// Example: radarllm dataset recordings configs/eval/recorded-radhar.toml --recordings radhar --out work/recorded-radhar
    Recordings(Box<DatasetRecordingsArgs>),
    /// Print clips, hours, actions and points per frame of a data set.
    Info {
        /// Folder of the data set.
        dir: PathBuf,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
    #[cfg(feature = "eval")]
    /// Check hashes, rows, values and leakage between splits. Exit code 1 if there is a problem.
    Validate {
        /// Folder of the data set.
        dir: PathBuf,
        /// Print one JSON document.
        #[arg(long)]
        json: bool,
    },
}

#[cfg(feature = "eval")]
/// `dataset recordings`.
#[derive(Args)]
pub(crate) struct DatasetRecordingsArgs {
    /// Recordings; their activities need the sentence `says` unless --by-model is given.
    #[command(flatten)]
    pub labelled: LabelledArgs,
    /// Folder of the data set.
    #[arg(long)]
    pub out: PathBuf,
    /// Captions are what a model says about the recordings, instead of the sentences of their activities: adaptation without
    /// labels.
    #[arg(long)]
    pub by_model: bool,
    /// Model folder, or a bundled model: `features` (the default) or `tokens`.
    #[arg(long, requires = "by_model")]
    pub model: Option<PathBuf>,
    /// Sentences of the model with less confidence are left out, 0 to 1.
    #[arg(long, default_value_t = 0.6, requires = "by_model")]
    pub min_confidence: f32,
    /// Replace another data set in the folder.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// One of several parts of equal size, numbered from 1: `3/8`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Part {
    /// In `1..=of`.
    pub number: usize,
    /// Number of parts.
    pub of: usize,
}

impl std::str::FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text
            .split_once('/')
            .map(|(number, of)| (number.parse::<usize>(), of.parse::<usize>()));
        match numbers {
            Some((Ok(number), Ok(of))) if (1..=of).contains(&number) => Ok(Self { number, of }),
            Some((Ok(_), Ok(of))) if of > 0 => {
                Err(format!("parts are numbered from 1/{of} to {of}/{of}"))
            }
            _ => Err("expected a part and the number of parts, for example 3/8".into()),
        }
    }
}

/// Time between progress lines.
const PROGRESS_EVERY: Duration = Duration::from_secs(5);

/// Runs the command.
pub(crate) fn run(verb: &DatasetVerb) -> CliResult {
    match verb {
        DatasetVerb::Build {
            config,
            out,
            shard,
            threads,
            force,
            json,
        } => {
            let options = BuildOptions {
                threads: threads::threads(*threads),
                overwrite: overwrite(*force),
                retry_failed: false,
            };
            match shard {
                Some(part) => build_part(config, out, *part, options, *json),
                None => build(&DatasetPlan::open(config)?, out, options, *json),
            }
        }
        DatasetVerb::Prepare {
            config,
            out,
            force,
            json,
        } => prepare(config, out, overwrite(*force), *json),
        DatasetVerb::Finish { config, out, json } => {
            finish(&DatasetPlan::open_all(config, out)?, out, *json)
        }
        DatasetVerb::Export {
            dir,
            to,
            force,
            json,
        } => export(dir, to, overwrite(*force), *json),
        #[cfg(feature = "eval")]
        DatasetVerb::Recordings(args) => recordings(args),
        DatasetVerb::Info { dir, json } => info(dir, *json),
        #[cfg(feature = "eval")]
        DatasetVerb::Validate { dir, json } => validate(dir, *json),
    }
}

#[cfg(feature = "eval")]
/// `dataset recordings`: recordings for tuning with sentences.
fn recordings(args: &DatasetRecordingsArgs) -> CliResult {
    if !(0.0..=1.0).contains(&args.min_confidence) {
        return Err(CliError::new(format!(
            "--min-confidence: must be in 0..=1, found {}",
            args.min_confidence
        )));
    }
    let config_name = args.labelled.config.display();
    let config = recordings::read_config(&args.labelled.config)?;
    if config.simulated {
        return Err(CliError::new(format!(
            "{config_name}: its recordings are simulated and already a data set"
        )));
    }
    let options = recordings::capture_options(&config, &args.labelled)?;
    let folder = args.labelled.recordings.as_path();
    let all = recordings::read_recordings(&config, Role::Tuning, folder, &options)?;
    let mut clips = Vec::new();
    let sentences = if args.by_model {
        // The sentences of the model are asked for, also on boards that it does not know.
        let captioner = model::captioner(args.model.as_deref(), DecoderName::F32)?;
        let captioner = captioner.without_measuring();
        for recording in &all {
            let description = captioner.describe(&recording.clip)?;
            let stretches =
                training::by_model(&recording.clip, &description.segments, args.min_confidence);
            clips.extend(training::clips(recording, &stretches));
        }
        format!(
            "sentences of the model {} with confidence {} or more, which may be wrong",
            captioner.name(),
            args.min_confidence
        )
    } else {
        for recording in &all {
            let stretches = training::by_activity(&config, recording)?;
            clips.extend(training::clips(recording, &stretches));
        }
        format!("sentences of the activities of {config_name}")
    };
    let seconds: f64 = all.iter().map(|r| r.clip.duration_s()).sum();
    let rate_hz = all.first().map_or(10.0, |r| r.clip.frame_rate_hz);
    let report = training::write(&args.out, clips, rate_hz, &sentences, overwrite(args.force))?;
    let n_clips = report.manifest.n_clips;
    if args.json {
        return output::print_json(&serde_json::json!({
            "recordings": all.len(),
            "seconds": seconds,
            "clips": n_clips,
            "sentences": sentences,
        }));
    }
    output::print_line(&format!(
        "{}: {n_clips} clips of {} recordings for tuning ({seconds:.0} s); {sentences}",
        args.out.display(),
        all.len()
    ));
    Ok(())
}

fn overwrite(force: bool) -> Overwrite {
    match force {
        true => Overwrite::Replace,
        false => Overwrite::Refuse,
    }
}

/// Builds what is missing of a data set, and prints what there is.
pub(crate) fn build(
    plan: &DatasetPlan,
    out: &Path,
    options: BuildOptions,
    json: bool,
) -> CliResult {
    let started = Instant::now();
    let report = plan.build(out, options, progress_lines(started), &|| false)?;
    let manifest = &report.manifest;
    if json {
        return output::print_json(&serde_json::json!({
            "clips": manifest.n_clips,
            "failed": manifest.n_failed,
            "skipped": manifest.skipped.len(),
            "shards": manifest.shards.len(),
            "shards_made": report.n_made_shards,
            "seconds": started.elapsed().as_secs_f64(),
        }));
    }
    output::print_line(&format!(
        "{}: {} clips in {} shards ({} made now), {} failed",
        out.display(),
        manifest.n_clips,
        manifest.shards.len(),
        report.n_made_shards,
        manifest.n_failed
    ));
    for skipped in &manifest.skipped {
        note!("left out: {}: {}", skipped.id, skipped.reason);
    }
    print_failed(&manifest.shards);
    Ok(())
}

/// Builds what is missing of a data set, with notes alone.
#[cfg(feature = "train")]
pub(crate) fn build_quietly(plan: &DatasetPlan, out: &Path, options: BuildOptions) -> CliResult {
    let report = plan.build(out, options, progress_lines(Instant::now()), &|| false)?;
    note!("{}: {} clips", out.display(), report.manifest.n_clips);
    Ok(())
}

/// Makes a folder that of a data set, without building anything.
fn prepare(config: &Path, out: &Path, overwrite: Overwrite, json: bool) -> CliResult {
    let plan = DatasetPlan::open(config)?;
    plan.prepare(out, overwrite)?;
    let (n_clips, n_shards) = (plan.n_clips(), plan.n_shards());
    if json {
        return output::print_json(&serde_json::json!({
            "clips": n_clips,
            "shards": n_shards,
        }));
    }
    output::print_line(&format!(
        "{}: {n_clips} clips in {n_shards} shards to build",
        out.display()
    ));
    Ok(())
}

/// Builds the shards of one part, in a folder that whichever process comes first prepares.
fn build_part(
    config: &Path,
    out: &Path,
    part: Part,
    options: BuildOptions,
    json: bool,
) -> CliResult {
    let started = Instant::now();
    let plan = DatasetPlan::open_part(config, out, part.number, part.of)?;
    let shards = plan.part(part.number, part.of)?;
    plan.prepare_once(out)?;
    let built = plan.build_shards(out, shards, options, progress_lines(started), &|| false)?;
    let entries = &built.entries;
    let n_clips: u64 = entries.iter().map(|e| e.rows).sum();
    let n_failed: usize = entries.iter().map(|e| e.failed.len()).sum();
    let n_made = entries.len() - built.n_kept;
    if json {
        return output::print_json(&serde_json::json!({
            "part": part.number,
            "parts": part.of,
            "clips": n_clips,
            "failed": n_failed,
            "shards": entries.len(),
            "shards_made": n_made,
            "seconds": started.elapsed().as_secs_f64(),
        }));
    }
    output::print_line(&format!(
        "{}: part {} of {}: {n_clips} clips in {} shards ({n_made} made now), {n_failed} failed",
        out.display(),
        part.number,
        part.of,
        entries.len(),
    ));
    print_failed(entries);
    Ok(())
}

fn finish(plan: &DatasetPlan, out: &Path, json: bool) -> CliResult {
    let manifest = plan.finish(out)?;
    if json {
        return output::print_json(&serde_json::json!({
            "clips": manifest.n_clips,
            "failed": manifest.n_failed,
            "skipped": manifest.skipped.len(),
            "shards": manifest.shards.len(),
        }));
    }
    output::print_line(&format!(
        "{}: {} clips in {} shards, {} failed",
        out.display(),
        manifest.n_clips,
        manifest.shards.len(),
        manifest.n_failed
    ));
    Ok(())
}

fn export(dir: &Path, to: &Path, overwrite: Overwrite, json: bool) -> CliResult {
    let manifest = dataset::export(dir, to, overwrite).map_err(Error::from)?;
    let bytes: u64 = manifest.shards.iter().map(|s| s.bytes).sum();
    if json {
        return output::print_json(&serde_json::json!({
            "clips": manifest.n_clips,
            "shards": manifest.shards.len(),
            "bytes": bytes,
        }));
    }
    output::print_line(&format!(
        "{}: {} clips in {} shards, {bytes} bytes",
        to.display(),
        manifest.n_clips,
        manifest.shards.len(),
    ));
    Ok(())
}

/// Prints a line from time to time.
fn progress_lines(started: Instant) -> impl Fn(Progress) + Sync {
    let last_line = Mutex::new(Instant::now());
    move |progress| {
        let mut last = last_line.lock().unwrap_or_else(PoisonError::into_inner);
        if last.elapsed() < PROGRESS_EVERY {
            return;
        }
        *last = Instant::now();
        let seconds = started.elapsed().as_secs_f64();
        let left_s =
            seconds / progress.n_done.max(1) as f64 * (progress.n_items - progress.n_done) as f64;
        note!(
            "{} of {} clips, {} failed, {} of {} shards, {:.1} clips/s, about {:.0} min left",
            progress.n_done,
            progress.n_items,
            progress.n_failed,
            progress.n_shards_done,
            progress.n_shards,
            progress.n_done as f64 / seconds,
            left_s / 60.0
        );
    }
}

fn print_failed(shards: &[ShardEntry]) {
    for failed in shards.iter().flat_map(|s| &s.failed) {
        note!("failed: {}: {}", failed.id, failed.reason);
    }
}

fn info(dir: &Path, json: bool) -> CliResult {
    let info = Dataset::open(dir)?.info()?;
    if json {
        return output::print_json(&info);
    }
    output::print_line(&serde_json::to_string_pretty(&info)?);
    Ok(())
}

#[cfg(feature = "eval")]
fn validate(dir: &Path, json: bool) -> CliResult {
    let found = validate_with_held_out(dir)?;
    let lines: Vec<String> = found
        .problems
        .iter()
        .map(|p| {
            let id =
                p.id.as_ref()
                    .map(|id| format!(": {id}"))
                    .unwrap_or_default();
            format!("{}{id}: {}", p.file, p.problem)
        })
        .collect();
    if json {
        output::print_json(&serde_json::json!({ "problems": lines, "held_out": found.held_out }))?;
    } else {
        if lines.is_empty() {
            output::print_line("no problems");
        }
        for line in &lines {
            output::print_line(line);
        }
        let held_out = &found.held_out;
        if let Some([min, five, median]) = held_out.distances {
            output::print_line(&format!(
                "nearest training motion of {} held-out clips: distance {min:.4} rad at min, {five:.4} at 5 %, {median:.4} \
                 median; a leak is below {}",
                held_out.judged, held_out.leak_distance
            ));
        }
        if held_out.not_judged > 0 {
            output::print_line(&format!(
                "{} held-out clips could not be compared: no joints, too short, or hardly moving",
                held_out.not_judged
            ));
        }
    }
    match lines.len() {
        0 => Ok(()),
        n => Err(CliError::new(format!("{}: {n} problems", dir.display()))),
    }
}
