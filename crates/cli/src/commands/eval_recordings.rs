//! `eval-recordings`: do captions of recorded radar state the recorded activity?

use std::{
    fs,
    path::{Path, PathBuf},
    time::{SystemTime, UNIX_EPOCH},
};

use radarllm::{CaptureFormat, CaptureOptions, Clip, open_radar};
use radarllm_base::PointFrame;
use radarllm_eval::recordings::{
    LabelledRecording, RecordingsConfig, RecordingsReport, Role, evaluate_recordings, markdown,
};
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};

use crate::{
    args::{DecoderName, EvalRecordingsArgs, RoleName},
    commands::{describe, model_files},
    error::{CliError, CliResult},
    output,
};

/// Folders are read to this depth.
const MAX_DEPTH: usize = 4;
/// Head of the log of evaluations on judged recordings.
const LOOKS_HEAD: &str =
    "date,configuration,model,fingerprint,right,recordings,false falls,hours,purpose\n";

/// Runs the command.
pub fn run(args: &EvalRecordingsArgs) -> CliResult {
    if let Some(out) = &args.out {
        output::check_free(out, args.force)?;
    }
    let role = match args.role {
        RoleName::Tuning => Role::Tuning,
        RoleName::Judged => Role::Judged,
    };
    let text = files::read_text(&args.config, MAX_CONFIG_BYTES)?;
    let config = RecordingsConfig::from_toml(&text)
        .map_err(|e| CliError::new(format!("{}: {e}", args.config.display())))?;
    let (captioner, info) = model_files::load(args.model.as_deref(), DecoderName::F32)?;
    let format = args.format.as_deref().map(CaptureFormat::from_name);
    let options = CaptureOptions {
        radar: args.radar.as_deref().map(open_radar).transpose()?,
        format: format.transpose()?,
        points: args.recording.options()?,
        radar_height_m: Some(config.radar_height_m),
        ..CaptureOptions::default()
    };
    let files = labelled_files(&config, role, &args.recordings)?;
    let recordings = files.into_iter().flat_map(|(activity, name)| {
        let path = args.recordings.join(&name);
        match open(&path, &options) {
            Ok(clip) => parts(clip, config.part_s)
                .into_iter()
                .map(|(part, clip)| {
                    Ok(LabelledRecording {
                        name: format!("{name}{part}"),
                        activity: activity.clone(),
                        clip,
                    })
                })
                .collect(),
            Err(e) => vec![Err(e)],
        }
    });
    let report = evaluate_recordings(
        captioner.model(),
        captioner.name(),
        &config,
        role,
        args.beam,
        recordings,
    )?;
    let page = markdown(&report, args.beam, &args.config.display().to_string());
    if let Some(out) = &args.out {
        output::write_atomic(out, page.as_bytes())?;
    }
    if role == Role::Judged {
        log_look(&args.looks, args, &report, info.fingerprint)?;
    }
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&page);
    Ok(())
}

/// A recording, prepared for the model.
fn open(path: &Path, options: &CaptureOptions) -> CliResult<Clip> {
    let recording = radarllm::open(path)
        .with_options(options.clone())
        .points()?;
    describe::prepared(&path.display().to_string(), &recording)
}

/// A recording in parts of equal length, each with the text that its name ends with.
fn parts(clip: Clip, part_s: Option<f64>) -> Vec<(String, Clip)> {
    let Some(part_s) = part_s else {
        return vec![(String::new(), clip)];
    };
    let n_frames = ((part_s * clip.frame_rate_hz).round() as usize).max(1);
    let part = |(i, frames): (usize, &[PointFrame])| {
        let start_s = (i * n_frames) as f64 / clip.frame_rate_hz;
        let part = Clip {
            frames: frames.to_vec(),
            ..clip.clone()
        };
        (format!(" from {start_s:.0} s"), part)
    };
    clip.frames
        .chunks_exact(n_frames)
        .enumerate()
        .map(part)
        .collect()
}

/// Activity and path of every recording of a role, by path. Paths are relative to the folder, with `/` between names.
fn labelled_files(
    config: &RecordingsConfig,
    role: Role,
    folder: &Path,
) -> CliResult<Vec<(String, String)>> {
    let mut names = Vec::new();
    list(folder, "", MAX_DEPTH, &mut names)?;
    names.sort();
    let labelled: Vec<(String, String)> = names
        .into_iter()
        .filter(|name| config.role_of(name) == role)
        .filter_map(|name| {
            let activity = config.activity_of(&name)?;
            Some((activity.name.clone(), name))
        })
        .collect();
    if labelled.is_empty() {
        return Err(CliError::new(format!(
            "{}: no recordings of an activity with the role `{}`",
            folder.display(),
            role_name(role)
        ))
        .hint("the configuration names activities, their files and the files for tuning"));
    }
    Ok(labelled)
}

fn list(folder: &Path, prefix: &str, depth: usize, names: &mut Vec<String>) -> CliResult {
    let io = |e| CliError::io(folder, e);
    for entry in fs::read_dir(folder).map_err(io)? {
        let entry = entry.map_err(io)?;
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        let path: PathBuf = entry.path();
        if path.is_file() {
            names.push(name);
        } else if path.is_dir() && depth > 1 {
            list(&path, &format!("{name}/"), depth - 1, names)?;
        }
    }
    Ok(())
}

fn role_name(role: Role) -> &'static str {
    match role {
        Role::Tuning => "tuning",
        Role::Judged => "judged",
    }
}

/// The date in UTC, as `YYYY-MM-DD` (Hinnant, "chrono-Compatible Low-Level Date Algorithms", `civil_from_days`).
fn today() -> String {
    let since = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    let days = (since.as_secs() / 86_400) as i64 + 719_468;
    let (era, day_of_era) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 {
        shifted_month + 3
    } else {
        shifted_month - 9
    };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}

/// Adds a line to the log of evaluations on judged recordings.
fn log_look(
    log: &Path,
    args: &EvalRecordingsArgs,
    report: &RecordingsReport,
    fingerprint: u64,
) -> CliResult {
    let mut text = match log.exists() {
        true => files::read_text(log, MAX_CONFIG_BYTES)?,
        false => LOOKS_HEAD.into(),
    };
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\"").replace('\n', " "));
    text += &format!(
        "{},{},{},{fingerprint:016x},{},{},{},{:.3},{}\n",
        today(),
        quoted(&args.config.display().to_string()),
        quoted(&report.model),
        report.right,
        report.recordings,
        report.false_falls.falls,
        report.false_falls.hours,
        quoted(args.purpose.as_deref().unwrap_or("")),
    );
    output::write_atomic(log, text.as_bytes())?;
    eprintln!("logged in {}", log.display());
    Ok(())
}
