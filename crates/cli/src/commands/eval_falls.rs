//! `eval-falls`: how many falls are noticed, how late, and how often is there a false alarm?

use std::path::Path;

use radarllm::CaptureOptions;
use radarllm_eval::{
    falls::{FallPlan, evaluate_falls, recording_alarms},
    recordings::{RecordingsConfig, Role},
};
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};

use crate::{
    args::EvalFallsArgs,
    commands::eval_recordings::read_recordings,
    error::{CliError, CliResult},
    output,
    threads::on_threads,
};

/// Runs the command.
pub fn run(args: &EvalFallsArgs) -> CliResult {
    let naming = |path: &Path, e| CliError::new(format!("{}: {e}", path.display()));
    let text = files::read_text(&args.config, MAX_CONFIG_BYTES)?;
    let plan = FallPlan::from_toml(&text).map_err(|e| naming(&args.config, e))?;
    let mut recorded = Vec::new();
    for pair in args.recordings.chunks_exact(2) {
        let text = files::read_text(&pair[0], MAX_CONFIG_BYTES)?;
        let config = RecordingsConfig::from_toml(&text).map_err(|e| naming(&pair[0], e))?;
        let config = RecordingsConfig {
            part_s: None,
            ..config
        };
        let options = CaptureOptions {
            radar_height_m: Some(config.radar_height_m),
            ..CaptureOptions::default()
        };
        let recordings = read_recordings(&config, Role::Tuning, &pair[1], &options)?;
        let name = pair[0].display().to_string();
        recorded.push(recording_alarms(&name, &config, Role::Tuning, &recordings)?);
    }
    let base = args.config.parent().unwrap_or(Path::new(""));
    let mut report = on_threads(args.threads, || evaluate_falls(&plan, base))??;
    report.recordings = recorded;
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&report.to_markdown());
    Ok(())
}
