//! `eval falls`: how many falls are noticed, how late, and how often is there a false alarm?

use std::path::{Path, PathBuf};

use clap::Args;
use radarllm::{Captioner, CaptureOptions};
use radarllm_base::{Clip, Provenance};
use radarllm_eval::{
    EvalError,
    falls::{
        DescribeTrial, FallPlan, FallReport, RecordingAlarms, StatedAction, evaluate_falls,
        recording_alarms,
    },
    recordings::{LOOKS_HEAD, RecordingsConfig, Role, labelled_files, look_for_falls},
};
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};

use super::recordings::{read_config, read_recordings};
use crate::{
    error::{CliError, CliResult},
    output,
    threads::on_threads,
};

/// `eval falls`.
#[derive(Args)]
pub(crate) struct EvalFallsArgs {
    /// TOML with radars, places, people, falls and other motions.
    pub config: PathBuf,
    /// Also count false alarms in recordings without falls: a configuration of `eval recordings` and its folder. May be
    /// repeated.
    #[arg(long, num_args = 2, value_names = ["CONFIG", "DIR"])]
    pub recordings: Vec<PathBuf>,
    /// Which recordings are read: those for `tuning`, which may be used to choose settings, or `judged` ones, which choose
    /// nothing and whose evaluations are logged. May be repeated.
    #[arg(long, default_value = "tuning", requires = "recordings")]
    pub role: Vec<Role>,
    /// Log of evaluations of judged recordings.
    #[arg(long, value_name = "FILE", default_value = "docs/results/looks.csv")]
    pub looks: PathBuf,
    /// Reason for evaluating judged recordings, for the log.
    #[arg(long, value_name = "TEXT", required_if_eq("role", "judged"))]
    pub purpose: Option<String>,
    /// Simulate nothing: only count false alarms in recordings.
    #[arg(long, requires = "recordings")]
    pub recordings_only: bool,
    /// Also describe the points of every trial, as a recording of a board that no model learned from.
    #[arg(long, conflicts_with = "recordings_only")]
    pub described: bool,
    /// Do not state the height of the radar to what describes.
    #[arg(long, requires = "described")]
    pub height_not_stated: bool,
    /// Threads of the simulation; all cores if omitted.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub(super) fn run(args: &EvalFallsArgs) -> CliResult {
    let text = files::read_text(&args.config, MAX_CONFIG_BYTES)?;
    let plan = FallPlan::from_toml(&text)
        .map_err(|e| CliError::new(format!("{}: {e}", args.config.display())))?;
    let mut recorded = Vec::new();
    for pair in args.recordings.chunks_exact(2) {
        let config = RecordingsConfig {
            part_s: None,
            ..read_config(&pair[0])?
        };
        let options = CaptureOptions {
            radar_height_m: config.radar_height_m,
            ..CaptureOptions::default()
        };
        for &role in &args.role {
            // A set may have recordings of one role only.
            let files = labelled_files(&config, role, &pair[1]);
            let is_none = files.is_ok_and(|files| files.is_empty());
            if is_none && args.role.len() > 1 {
                continue;
            }
            let recordings = read_recordings(&config, role, &pair[1], &options)?;
            let name = pair[0].display().to_string();
            recorded.push(recording_alarms(&name, &config, role, &recordings)?);
        }
    }
    log_looks(args, &recorded)?;
    let base = args.config.parent().unwrap_or(Path::new(""));
    let captioner = args.described.then(Captioner::bundled).transpose()?;
    let describe = captioner.map(|captioner| {
        move |mut clip: Clip| {
            clip.is_height_assumed = args.height_not_stated;
            stated_actions(&captioner, clip)
        }
    });
    let describe = describe.as_ref().map(|describe| describe as &DescribeTrial);
    let mut report = match args.recordings_only {
        true => FallReport::without_trials(&plan),
        false => on_threads(args.threads, || evaluate_falls(&plan, base, describe))??,
    };
    report.recordings = recorded;
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&report.to_markdown());
    Ok(())
}

/// What is stated in a clip that is taken for a recording of a board that no model learned from.
fn stated_actions(captioner: &Captioner, mut clip: Clip) -> Result<Vec<StatedAction>, EvalError> {
    clip.radar = "unknown".into();
    clip.provenance = Provenance::recorded("points", "trial");
    let description = captioner.describe(&clip)?;
    let stated = description.segments.iter().flat_map(|segment| {
        segment.actions.iter().map(|action| StatedAction {
            action: (*action).into(),
            start_s: segment.start_s,
            end_s: segment.end_s,
        })
    });
    Ok(stated.collect())
}

/// Adds a line to the log of evaluations for every set of judged recordings.
fn log_looks(args: &EvalFallsArgs, recorded: &[RecordingAlarms]) -> CliResult {
    let is_judged = |alarms: &&RecordingAlarms| alarms.role == Role::Judged;
    let purpose = args.purpose.as_deref().unwrap_or_default();
    let lines = recorded.iter().filter(is_judged);
    let lines: Vec<String> = lines.map(|a| look_for_falls(a, purpose)).collect();
    if lines.is_empty() {
        return Ok(());
    }
    let log = args.looks.as_path();
    let mut text = match log.exists() {
        true => files::read_text(log, MAX_CONFIG_BYTES)?,
        false => LOOKS_HEAD.into(),
    };
    text.extend(lines);
    output::write_atomic(log, text.as_bytes())?;
    note!("logged in {}", log.display());
    Ok(())
}
