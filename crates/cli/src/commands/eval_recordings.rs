//! `eval-recordings`: do captions of recorded radar state the recorded activity?

use std::{
    fs,
    path::{Path, PathBuf},
    time::{SystemTime, UNIX_EPOCH},
};

use radarllm::{
    Captioner, CaptureFormat, CaptureOptions, Clip, DescribeOptions, PointFrame, open_radar,
    teach::Memory,
};
use radarllm_base::seed::derive_seed;
use radarllm_dataset::{Columns, Dataset, Split};
use radarllm_eval::proxy::Proxy;
use radarllm_eval::recordings::{
    LabelledRecording, RecordingsConfig, RecordingsReport, Role, evaluate_recordings, markdown,
};
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};
use radarllm_inference::prepare::RATE_TOLERANCE;
use serde::Serialize;

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
    let recordings = read_recordings(&config, role, args, &options)?;
    let describing = DescribeOptions {
        beam: args.beam,
        ..DescribeOptions::default()
    };
    if let Some(n) = args.teach {
        let pool = match role {
            Role::Tuning => recordings.clone(),
            Role::Judged => read_recordings(&config, Role::Tuning, args, &options)?,
        };
        let taught = Taught {
            config: &config,
            pool: &pool,
            n_examples: n as usize,
            role,
            describing,
        };
        return taught.run(captioner, &recordings, args, info.fingerprint);
    }
    let (report, fingerprint) = match args.proxy.is_empty() {
        true => {
            let describe =
                |clip: &Clip| Ok::<_, CliError>(captioner.describe_with(clip, &describing)?);
            let recordings = recordings.into_iter().map(Ok);
            let name = captioner.name();
            let report = evaluate_recordings(describe, name, &config, role, recordings)?;
            (report, info.fingerprint)
        }
        false => {
            let proxy = train_proxy(args)?;
            let describe = |clip: &Clip| Ok::<_, CliError>(proxy.describe(clip));
            let names: Vec<String> = args.proxy.iter().map(|p| p.display().to_string()).collect();
            let name = format!(
                "forest on {}, {} windows",
                names.join(", "),
                proxy.n_windows
            );
            let recordings = recordings.into_iter().map(Ok);
            (
                evaluate_recordings(describe, &name, &config, role, recordings)?,
                0,
            )
        }
    };
    let page = markdown(&report, args.beam, &args.config.display().to_string());
    if let Some(out) = &args.out {
        output::write_atomic(out, page.as_bytes())?;
    }
    if role == Role::Judged {
        log_look(args, &report, fingerprint, "")?;
    }
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&page);
    Ok(())
}

/// A forest on the training clips of the data sets.
fn train_proxy(args: &EvalRecordingsArgs) -> CliResult<Proxy> {
    let mut clips = Vec::new();
    let mut rate_hz = None;
    for dir in &args.proxy {
        let data = Dataset::open(dir)?;
        let own_hz = data.manifest().frame_rate_hz;
        if (own_hz / rate_hz.unwrap_or(own_hz) - 1.0).abs() > RATE_TOLERANCE {
            return Err(CliError::new(format!(
                "{}: {own_hz} frames/s, the data sets before have another rate",
                dir.display()
            )));
        }
        rate_hz = Some(own_hz);
        for clip in data.iter_split(Split::Train, Columns::Points) {
            clips.push(clip?);
        }
    }
    Ok(Proxy::train(
        &clips,
        rate_hz.unwrap_or(10.0),
        args.proxy_copies,
        1,
    )?)
}

/// All recordings of a role.
fn read_recordings(
    config: &RecordingsConfig,
    role: Role,
    args: &EvalRecordingsArgs,
    options: &CaptureOptions,
) -> CliResult<Vec<LabelledRecording>> {
    let mut all = Vec::new();
    for (activity, name) in labelled_files(config, role, &args.recordings)? {
        let clip = open(&args.recordings.join(&name), options)?;
        all.extend(
            parts(clip, config.part_s)
                .into_iter()
                .map(|(part, clip)| LabelledRecording {
                    name: format!("{name}{part}"),
                    activity: activity.clone(),
                    clip,
                }),
        );
    }
    Ok(all)
}

/// An evaluation of taught activities.
struct Taught<'a> {
    config: &'a RecordingsConfig,
    /// Recordings of which examples are drawn.
    pool: &'a [LabelledRecording],
    /// Examples of each activity.
    n_examples: usize,
    role: Role,
    describing: DescribeOptions,
}

/// Counts over all draws.
#[derive(Default, Serialize)]
struct TaughtReport {
    draws: u64,
    examples: usize,
    /// Recordings of taught activities, and how many are described right.
    recordings: usize,
    right: usize,
    /// Recordings of activities that were not taught, and in how many a taught one is recognised for half of the time.
    others: usize,
    falsely_recognised: usize,
}

impl Taught<'_> {
    fn run(
        &self,
        mut captioner: Captioner,
        recordings: &[LabelledRecording],
        args: &EvalRecordingsArgs,
        fingerprint: u64,
    ) -> CliResult {
        let mut counts = TaughtReport {
            draws: args.draws,
            examples: self.n_examples,
            ..TaughtReport::default()
        };
        let mut last = None;
        for draw in 0..args.draws {
            let left_out = self.config.activity.iter().map(|a| Some(a.name.as_str()));
            for left_out in std::iter::once(None).chain(left_out) {
                let (memory, examples) = self.memory(draw, left_out)?;
                captioner = captioner.with_memory(&memory);
                let evaluated = recordings
                    .iter()
                    .filter(|r| !examples.contains(&r.name.as_str()))
                    .filter(|r| left_out.is_none_or(|name| r.activity == name))
                    .cloned();
                let report = evaluate_recordings(
                    |clip| Ok::<_, CliError>(captioner.describe_with(clip, &self.describing)?),
                    captioner.name(),
                    self.config,
                    self.role,
                    evaluated.map(Ok),
                )?;
                if left_out.is_some() {
                    counts.others += report.recordings;
                    counts.falsely_recognised +=
                        report.rows.iter().filter(|r| r.is_recognised()).count();
                } else {
                    counts.recordings += report.recordings;
                    counts.right += report.right;
                    last = Some(report);
                }
            }
        }
        let Some(mut report) = last else {
            return Err(CliError::new("--draws 0: must be 1 or more"));
        };
        (report.right, report.recordings) = (counts.right, counts.recordings);
        if self.role == Role::Judged {
            let how = format!(
                "taught by {} examples, {} draws: ",
                counts.examples, counts.draws
            );
            log_look(args, &report, fingerprint, &how)?;
        }
        if args.json {
            return output::print_json(&counts);
        }
        let percent = |part: usize, whole: usize| 100.0 * part as f64 / whole.max(1) as f64;
        output::print_line(&format!(
            "taught by {} recordings an activity, {} draws: {} of {} recordings described right ({:.1} %); a taught activity \
             recognised in {} of {} recordings that show none of them ({:.1} %)",
            counts.examples,
            counts.draws,
            counts.right,
            counts.recordings,
            percent(counts.right, counts.recordings),
            counts.falsely_recognised,
            counts.others,
            percent(counts.falsely_recognised, counts.others)
        ));
        Ok(())
    }

    /// A memory of all activities but one, and the names of the recordings in it.
    fn memory(&self, draw: u64, left_out: Option<&str>) -> CliResult<(Memory, Vec<&str>)> {
        let mut memory = Memory::default();
        let mut names = Vec::new();
        for activity in self
            .config
            .activity
            .iter()
            .filter(|a| Some(a.name.as_str()) != left_out)
        {
            let says = activity.says.as_deref().ok_or_else(|| {
                CliError::new(format!("activity `{}` has no `says`", activity.name))
                    .hint("the sentence by which it is taught")
            })?;
            let mut drawn: Vec<&LabelledRecording> = self
                .pool
                .iter()
                .filter(|r| r.activity == activity.name)
                .collect();
            drawn.sort_by_key(|r| derive_seed(draw, &r.name));
            let mut n = 0;
            for recording in drawn {
                // A recording with too few points is refused by `teach`, and the user takes another one.
                if n < self.n_examples
                    && memory.teach(&activity.name, says, &recording.clip).is_ok()
                {
                    names.push(recording.name.as_str());
                    n += 1;
                }
            }
        }
        Ok((memory, names))
    }
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
    args: &EvalRecordingsArgs,
    report: &RecordingsReport,
    fingerprint: u64,
    how: &str,
) -> CliResult {
    let log = args.looks.as_path();
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
        quoted(&format!("{how}{}", args.purpose.as_deref().unwrap_or(""))),
    );
    output::write_atomic(log, text.as_bytes())?;
    eprintln!("logged in {}", log.display());
    Ok(())
}
