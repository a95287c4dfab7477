//! `eval recordings`: do captions of recorded radar state the recorded activity?

use std::path::{Path, PathBuf};

use clap::Args;
use radarllm::{CaptureFormat, CaptureOptions, DescribeOptions, PreparedClip, open_radar};
use radarllm_dataset::Dataset;
use radarllm_eval::{
    proxy::Proxy,
    recordings::{
        LOOKS_HEAD, LabelledRecording, RecordingsConfig, RecordingsReport, Role, TeachOptions,
        evaluate_recordings, evaluate_taught, labelled_clips, labelled_files, look, markdown,
        parts, runs,
    },
};
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};

use crate::{
    commands::describe::{self, Detail},
    error::{CliError, CliResult},
    model,
    model_args::DecoderName,
    output,
    recording_args::LabelledArgs,
};

/// `eval recordings`.
#[derive(Args)]
pub(crate) struct EvalRecordingsArgs {
    /// Recordings.
    #[command(flatten)]
    pub labelled: LabelledArgs,
    /// Which recordings are evaluated: those for `tuning`, which may be used to choose settings, or `judged` ones, which
    /// choose nothing and whose evaluations are logged.
    #[arg(long, default_value = "tuning")]
    pub role: Role,
    /// Log of evaluations of judged recordings.
    #[arg(long, value_name = "FILE", default_value = "docs/results/looks.csv")]
    pub looks: PathBuf,
    /// Reason for evaluating judged recordings, for the log.
    #[arg(long, value_name = "TEXT", required_if_eq("role", "judged"))]
    pub purpose: Option<String>,
    /// Instead of a model, a forest on simple features that is trained on the clips of these data sets: what their
    /// generator teaches, without training a network.
    #[arg(long, value_name = "DATA", num_args = 1.., conflicts_with_all = ["teach", "model"])]
    pub proxy: Vec<PathBuf>,
    /// Disturbed copies of every clip for the forest.
    #[arg(long, value_name = "N", default_value_t = 5, requires = "proxy")]
    pub proxy_copies: usize,
    /// Teach every activity by this many recordings for tuning, drawn at random, and evaluate the others. Counts also
    /// what is recognised in the recordings of each activity when all activities but this one are taught.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100))]
    pub teach: Option<u64>,
    /// Draws of taught recordings.
    #[arg(long, value_name = "N", default_value_t = 3, requires = "teach")]
    pub draws: u64,
    /// Choose among these activities instead of describing freely: "boxing,squats,walking".
    #[arg(long, value_name = "LIST", value_delimiter = ',', conflicts_with_all = ["teach", "proxy"])]
    pub choose: Vec<String>,
    /// Model folder, or a bundled model: `features` (the default) or `tokens`.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// File of the site of these recordings, by `radarllm site`. Learned from each recording in which somebody walks if omitted.
    #[arg(long, value_name = "FILE", conflicts_with = "proxy")]
    pub site: Option<PathBuf>,
    /// Search for the most probable sentence with N beams (1 is greedy) instead of a vote among drawn sentences.
    #[arg(long, value_name = "N")]
    pub beam: Option<usize>,
    /// Also write the report to this Markdown file.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Replace an existing report.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub(crate) fn run(args: &EvalRecordingsArgs) -> CliResult {
    describe::check_beam(args.beam)?;
    if let Some(out) = &args.out {
        output::check_free(out, args.force)?;
    }
    let role = args.role;
    let config = read_config(&args.labelled.config)?;
    let options = capture_options(&config, &args.labelled)?;
    let folder = args.labelled.recordings.as_path();
    let read = |role| read_recordings(&config, role, folder, &options);
    let recordings = read(role)?;
    let report = if args.proxy.is_empty() {
        let captioner = model::captioner(args.model.as_deref(), DecoderName::F32)?;
        let info = model::info(captioner.model(), DecoderName::F32)?;
        let site = args.site.as_deref().map(radarllm::read_site).transpose()?;
        let captioner = model::restricted(captioner.with_site(site), &args.choose)?;
        let name = captioner.name();
        let options = DescribeOptions {
            beam: args.beam,
            ..DescribeOptions::default()
        };
        let describe = |clip: &PreparedClip| -> CliResult<_> {
            Ok(captioner.describe_prepared(clip, &options)?)
        };
        if let Some(n_examples) = args.teach {
            let pool = match role {
                Role::Tuning => recordings.clone(),
                Role::Judged => read(Role::Tuning)?,
            };
            let teaching = TeachOptions {
                n_examples: n_examples as usize,
                draws: args.draws,
                role,
            };
            let (counts, mut last) = evaluate_taught(
                describe,
                radarllm::insert_taught,
                name,
                &config,
                &teaching,
                &pool,
                &recordings,
            )?;
            (last.right, last.recordings) = (counts.right, counts.recordings);
            let how = format!("taught by {n_examples} examples, {} draws: ", args.draws);
            log_look(args, &last, info.fingerprint, &how)?;
            if args.json {
                return output::print_json(&counts);
            }
            output::print_line(&counts.to_text());
            return Ok(());
        }
        let recordings = recordings.into_iter().map(Ok);
        let report = evaluate_recordings(describe, name, &config, role, recordings)?;
        let how = match args.choose.join(", ") {
            choices if choices.is_empty() => choices,
            choices => format!("choice of {choices}: "),
        };
        log_look(args, &report, info.fingerprint, &how)?;
        report
    } else {
        let data: Result<Vec<Dataset>, _> = args.proxy.iter().map(|d| Dataset::open(d)).collect();
        let proxy = Proxy::of_data_sets(&data?, args.proxy_copies, 1)?;
        let describe = |clip: &PreparedClip| -> CliResult<_> { Ok(proxy.describe(clip)) };
        let recordings = recordings.into_iter().map(Ok);
        let report = evaluate_recordings(describe, &proxy.name(), &config, role, recordings)?;
        log_look(args, &report, 0, "")?;
        report
    };
    let page = markdown(
        &report,
        args.beam,
        &args.labelled.config.display().to_string(),
    );
    if let Some(out) = &args.out {
        output::write_atomic(out, page.as_bytes())?;
    }
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&page);
    Ok(())
}

/// Reads the configuration of recordings.
pub(crate) fn read_config(path: &Path) -> CliResult<RecordingsConfig> {
    let text = files::read_text(path, MAX_CONFIG_BYTES)?;
    RecordingsConfig::from_toml(&text)
        .map_err(|e| CliError::new(format!("{}: {e}", path.display())))
}

/// How the recordings of a configuration are read.
pub(crate) fn capture_options(
    config: &RecordingsConfig,
    args: &LabelledArgs,
) -> CliResult<CaptureOptions> {
    Ok(CaptureOptions {
        radar: args.radar.as_deref().map(open_radar).transpose()?,
        format: (args.format.as_deref())
            .map(CaptureFormat::from_name)
            .transpose()?,
        points: args.recording.options()?,
        radar_height_m: config.radar_height_m,
        ..CaptureOptions::default()
    })
}

/// All recordings of a role, prepared for the model.
pub(crate) fn read_recordings(
    config: &RecordingsConfig,
    role: Role,
    folder: &Path,
    options: &CaptureOptions,
) -> CliResult<Vec<LabelledRecording>> {
    let none = || {
        CliError::new(format!(
            "{}: no recordings of an activity with the role `{}`",
            folder.display(),
            role.name()
        ))
        .hint("the configuration names activities, their files and the files for tuning")
    };
    if config.simulated {
        let clips = labelled_clips(config, role, &Dataset::open(folder)?)?;
        return if clips.is_empty() {
            Err(none())
        } else {
            Ok(clips)
        };
    }
    let files = labelled_files(config, role, folder).map_err(|e| CliError::io(folder, e))?;
    if files.is_empty() {
        return Err(none());
    }
    let mut all = Vec::new();
    for (activity, name) in files {
        let path = folder.join(&name);
        let recording = radarllm::open(&path)
            .with_options(options.clone())
            .points()?;
        let mut runs = runs(recording.clip.clone(), config.cut_at_gap_s);
        runs.retain(|clip| clip.duration_s() >= config.min_s);
        let several = runs.len() > 1;
        for (i, clip) in runs.into_iter().enumerate() {
            let name = match several {
                true => format!("{name} run {}", i + 1),
                false => name.clone(),
            };
            let mut run = recording.clone();
            run.clip = clip;
            let (clip, _) = describe::prepared(&path.display().to_string(), &run, Detail::All)?;
            all.extend(parts(config, &activity, &name, clip));
        }
    }
    Ok(all)
}

/// Adds a line to the log of evaluations if the recordings were judged ones.
fn log_look(
    args: &EvalRecordingsArgs,
    report: &RecordingsReport,
    fingerprint: u64,
    how: &str,
) -> CliResult {
    if report.role == Role::Tuning {
        return Ok(());
    }
    let log = args.looks.as_path();
    let mut text = match log.exists() {
        true => files::read_text(log, MAX_CONFIG_BYTES)?,
        false => LOOKS_HEAD.into(),
    };
    let purpose = format!("{how}{}", args.purpose.as_deref().unwrap_or(""));
    text += &look(
        report,
        &args.labelled.config.display().to_string(),
        fingerprint,
        &purpose,
    );
    output::write_atomic(log, text.as_bytes())?;
    note!("logged in {}", log.display());
    Ok(())
}
