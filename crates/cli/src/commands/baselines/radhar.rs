//! `baselines radhar`: supervised classifiers on RadHAR's recordings.

use std::path::{Path, PathBuf};

use clap::Args;
use radarllm::{CaptureFormat, CaptureOptions};
use radarllm_eval::{
    radhar::{RadharConfig, RadharRecording, evaluate, markdown},
    recordings::{RecordingsConfig, Role, labelled_files},
};
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};
use radarllm_formats::read_radhar_points;

use crate::{
    commands::eval::recordings::read_config,
    error::{CliError, CliResult},
    output, threads,
};

/// Largest recording that is read. RadHAR's longest ones, of three minutes, have 25 MB.
const MAX_RECORDING_BYTES: u64 = 256 << 20;

/// `baselines radhar`.
#[derive(Args)]
pub(crate) struct RadharArgs {
    /// Classifiers and protocols (TOML); it names the configuration of the recordings.
    pub config: PathBuf,
    /// Folder with RadHAR's recordings: {boxing,jack,jump,squats,walk}/*.txt. Only those for tuning are read.
    #[arg(long)]
    pub recordings: PathBuf,
    /// Also write the report to this folder, as table.md and table.json.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Replace an existing report.
    #[arg(long)]
    pub force: bool,
    /// Threads; all cores if omitted.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Print one JSON document.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub(crate) fn run(args: &RadharArgs) -> CliResult {
    let out = |name: &str| args.out.as_ref().map(|folder| folder.join(name));
    let (page_path, json_path) = (out("table.md"), out("table.json"));
    for path in page_path.iter().chain(&json_path) {
        output::check_free(path, args.force)?;
    }
    let text = files::read_text(&args.config, MAX_CONFIG_BYTES)?;
    let config = RadharConfig::from_toml(&text)
        .map_err(|e| CliError::new(format!("{}: {e}", args.config.display())))?;
    let base = args.config.parent().unwrap_or(Path::new(""));
    let labelled = read_config(&base.join(&config.recordings))?;
    let activities: Vec<String> = labelled.activity.iter().map(|a| a.name.clone()).collect();
    let recordings = read(&labelled, &args.recordings)?;
    let report = threads::on_threads(args.threads, || {
        evaluate(&config, &activities, &recordings, &|line| note!("{line}"))
    })??;
    let page = markdown(&report, &args.config.display().to_string());
    if let Some(path) = page_path {
        output::write_atomic(&path, page.as_bytes())?;
    }
    if let Some(path) = json_path {
        let text = serde_json::to_string_pretty(&report)?;
        output::write_atomic(&path, text.as_bytes())?;
    }
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(page.trim_end());
    Ok(())
}

/// The recordings for tuning: their frames as recorded, and as they are prepared for the model.
fn read(config: &RecordingsConfig, folder: &Path) -> CliResult<Vec<RadharRecording>> {
    let labelled =
        labelled_files(config, Role::Tuning, folder).map_err(|e| CliError::io(folder, e))?;
    if labelled.is_empty() {
        let problem = "no recordings of an activity with the role `tuning`";
        return Err(CliError::new(format!("{}: {problem}", folder.display()))
            .hint("the folder has a folder for each activity, with RadHAR's text files"));
    }
    let options = CaptureOptions {
        format: Some(CaptureFormat::from_name("radhar")?),
        radar_height_m: config.radar_height_m,
        ..CaptureOptions::default()
    };
    let mut recordings = Vec::new();
    for (activity, name) in labelled {
        let path = folder.join(&name);
        let text = files::read_text(&path, MAX_RECORDING_BYTES)?;
        let frames = read_radhar_points(&text)
            .map_err(|e| CliError::new(format!("{}: {e}", path.display())))?;
        let prepared = radarllm::open(&path)
            .with_options(options.clone())
            .points()?
            .prepared()?;
        let clip = prepared.clip.into_clip();
        let mut activities = config.activity.iter();
        recordings.push(RadharRecording {
            activity: activities
                .position(|a| a.name == activity)
                .unwrap_or_default(),
            frames: frames.into_iter().map(|frame| frame.points).collect(),
            clip,
            name,
        });
    }
    Ok(recordings)
}
