//! `eval-recordings`: do captions of recorded radar name the recorded activity?

use std::{
    fs,
    path::{Path, PathBuf},
};

use radarllm::{CaptureFormat, CaptureOptions, open_radar};
use radarllm_eval::recordings::{
    LabelledRecording, RecordingsConfig, evaluate_recordings, markdown,
};

use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};

use crate::{
    args::EvalRecordingsArgs,
    commands::describe,
    error::{CliError, CliResult},
    output,
};

/// Runs the command.
pub fn run(args: &EvalRecordingsArgs) -> CliResult {
    if let Some(out) = &args.out {
        output::check_free(out, args.force)?;
    }
    let text = files::read_text(&args.config, MAX_CONFIG_BYTES)?;
    let config = RecordingsConfig::from_toml(&text)
        .map_err(|e| CliError::new(format!("{}: {e}", args.config.display())))?;
    let captioner = describe::load_captioner(args.model.as_deref())?;
    let format = args.format.as_deref().map(CaptureFormat::from_name);
    let options = CaptureOptions {
        radar: args.radar.as_deref().map(open_radar).transpose()?,
        format: format.transpose()?,
        points: args.recording.options()?,
        radar_height_m: Some(config.radar_height_m),
        ..CaptureOptions::default()
    };
    let files = files_of_activities(&config, &args.recordings)?;
    let recordings = files
        .into_iter()
        .map(|(activity, path)| open(activity, &path, &options));
    let report = evaluate_recordings(
        captioner.model(),
        captioner.name(),
        &config,
        args.beam,
        recordings,
    )?;
    let page = markdown(&report, args.beam, &args.config.display().to_string());
    if let Some(out) = &args.out {
        output::write_atomic(out, page.as_bytes())?;
    }
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&page);
    Ok(())
}

/// A recording, prepared for the model.
fn open(activity: String, path: &Path, options: &CaptureOptions) -> CliResult<LabelledRecording> {
    let recording = radarllm::open(path)
        .with_options(options.clone())
        .points()?;
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    Ok(LabelledRecording {
        name: format!("{activity}/{file}"),
        activity,
        clip: describe::prepared(&path.display().to_string(), &recording)?,
    })
}

/// Activity and path of every recording, by activity and name.
fn files_of_activities(
    config: &RecordingsConfig,
    recordings: &Path,
) -> CliResult<Vec<(String, PathBuf)>> {
    let mut all = Vec::new();
    for activity in &config.activity {
        let folder = recordings.join(&activity.name);
        let io = |e| CliError::io(&folder, e);
        let mut files = fs::read_dir(&folder)
            .map_err(io)?
            .map(|entry| entry.map(|e| e.path()))
            .collect::<Result<Vec<_>, _>>()
            .map_err(io)?;
        files.retain(|path| path.is_file());
        files.sort();
        if files.is_empty() {
            return Err(CliError::new(format!(
                "{}: no recordings",
                folder.display()
            )));
        }
        all.extend(files.into_iter().map(|path| (activity.name.clone(), path)));
    }
    Ok(all)
}
