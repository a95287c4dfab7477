//! `eval boards`: is what is said of recordings right on boards that nothing was learned from?

use std::path::{Path, PathBuf};

use clap::Args;
use radarllm::{
    Captioner, CaptureFormat, CaptureOptions, Clip, DescribeOptions, PointFrame, PreparedClip,
    Recording, Site,
};
use radarllm_eval::{
    boards::{BoardConfig, BoardReport, BoardsConfig, BoardsReport, Reading, markdown},
    recordings::{Role, evaluate_recordings},
};
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};
use radarllm_io::PointOptions;

use super::recordings::{read_config, read_recordings};
use crate::{
    commands::site,
    error::{CliError, CliResult},
    model,
    model_args::DecoderName,
    output,
};

/// `eval boards`.
#[derive(Args)]
pub(crate) struct EvalBoardsArgs {
    /// TOML with the boards and their recordings.
    pub config: PathBuf,
    /// Folder with the recordings of all boards.
    #[arg(long)]
    pub data: PathBuf,
    /// Only boards whose name contains this text.
    #[arg(long, value_name = "TEXT")]
    pub board: Option<String>,
    /// State the sentences of the model alone on every board, without what is measured: what it would say of boards that it
    /// does not know.
    #[arg(long)]
    pub without_measuring: bool,
    /// Leave out whom the boards track: what is said by points alone.
    #[arg(long)]
    pub without_tracks: bool,
    /// Model folder, or a bundled model: `features` (the default) or `tokens`.
    #[arg(long)]
    pub model: Option<PathBuf>,
    /// Also write the report to this Markdown file.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Replace an existing report.
    #[arg(long)]
    pub force: bool,
    /// Print one JSON document, with every sentence.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub(crate) fn run(args: &EvalBoardsArgs) -> CliResult {
    if let Some(out) = &args.out {
        output::check_free(out, args.force)?;
    }
    let text = files::read_text(&args.config, MAX_CONFIG_BYTES)?;
    let config = BoardsConfig::from_toml(&text)
        .map_err(|e| CliError::new(format!("{}: {e}", args.config.display())))?;
    let mut captioner = model::captioner(args.model.as_deref(), DecoderName::F32)?;
    if args.without_measuring {
        captioner = captioner.without_measuring();
    }
    let mut model = captioner.name().to_string();
    for (is_without, what) in [
        (args.without_measuring, ", without measuring"),
        (args.without_tracks, ", by points alone"),
    ] {
        if is_without {
            model += what;
        }
    }
    let wanted = args.board.as_deref().unwrap_or("");
    let mut boards = Vec::new();
    for board in config.board.iter().filter(|b| b.name.contains(wanted)) {
        note!("{}", board.name);
        let (report, used) = evaluate(captioner, board, args)?;
        captioner = used;
        boards.push(report);
    }
    if boards.is_empty() {
        return Err(CliError::new(format!(
            "{}: no board whose name contains `{wanted}`",
            args.config.display()
        )));
    }
    let report = BoardsReport {
        model,
        role: Role::Tuning,
        boards,
    };
    let page = markdown(&report);
    if let Some(out) = &args.out {
        output::write_atomic(out, page.as_bytes())?;
    }
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&page);
    Ok(())
}

/// Describes the recordings of a board. Returns the captioner, which knows the board's site meanwhile.
fn evaluate(
    captioner: Captioner,
    board: &BoardConfig,
    args: &EvalBoardsArgs,
) -> CliResult<(BoardReport, Captioner)> {
    let site = match &board.site {
        None => None,
        Some(folder) => Some(learn_site(board, args, folder)?),
    };
    if let Some(site) = &site {
        note!(
            "site: {:.1} degrees more tilt, standing {:.2} m above the radar, by {:.0} s of walking",
            site.tilt_rad.to_degrees(),
            site.standing_m,
            site.walking_s
        );
    }
    let captioner = captioner.with_site(site);
    let name = captioner.name();
    let options = DescribeOptions::default();
    let describe = |clip: &PreparedClip| -> CliResult<_> {
        Ok(match args.without_tracks {
            true => captioner.describe_prepared(&clip.without_tracks(), &options)?,
            false => captioner.describe_prepared(clip, &options)?,
        })
    };
    let describe_clip = |clip: &Clip| describe(&PreparedClip::of(clip)?);
    let (mut rows, mut presence, mut timelines) = (Vec::new(), Vec::new(), Vec::new());
    for part in &board.activities {
        let beside = args.config.parent().unwrap_or(Path::new("."));
        let config = read_config(&beside.join(&part.config))?;
        let options = CaptureOptions {
            radar_height_m: config.radar_height_m,
            ..reading(&part.reading)?
        };
        let folder = args.data.join(&part.recordings);
        let recordings = read_recordings(&config, Role::Tuning, &folder, &options)?;
        let recordings = recordings.into_iter().map(Ok);
        let report = evaluate_recordings(describe, name, &config, Role::Tuning, recordings)?;
        rows.extend(report.rows);
    }
    for part in &board.labelled {
        let labels = args.data.join(&part.labels);
        let labels = part
            .labels(&files::read_text(&labels, MAX_CONFIG_BYTES)?)
            .map_err(|e| CliError::new(format!("{}: {e}", labels.display())))?;
        let recording = open(&args.data.join(&part.recording), &part.reading)?;
        let described = describe_clip(&recording.clip)?;
        rows.extend(part.rows(&labels, &described.segments));
        timelines.extend(part.timeline(&labels, &described.segments));
    }
    for part in &board.presence {
        let mut recording = open(&args.data.join(&part.recording), &part.reading)?;
        if let Some([from_s, to_s]) = part.between_s {
            let is_between = |f: &PointFrame| (from_s..to_s).contains(&f.time_s);
            recording.clip.frames.retain(is_between);
        }
        let times = [recording.clip.frames.first(), recording.clip.frames.last()];
        let [Some(start_s), Some(end_s)] = times.map(|f| f.map(|f| f.time_s)) else {
            return Err(CliError::new(format!(
                "{}: no frame between these times",
                part.name
            )));
        };
        let described = describe_clip(&recording.clip)?;
        presence.push(part.row(&described.segments, start_s, end_s));
    }
    Ok((
        BoardReport::new(board, rows, presence, timelines),
        captioner,
    ))
}

fn reading(reading: &Reading) -> CliResult<CaptureOptions> {
    Ok(CaptureOptions {
        format: (reading.format.as_deref())
            .map(CaptureFormat::from_name)
            .transpose()?,
        points: PointOptions {
            frame_rate_hz: reading.frame_rate_hz,
            ..PointOptions::default()
        },
        ..CaptureOptions::default()
    })
}

fn open(path: &Path, how: &Reading) -> CliResult<Recording> {
    Ok(radarllm::open(path).with_options(reading(how)?).points()?)
}

/// Learns a site from the recordings of a folder, or from one recording.
fn learn_site(board: &BoardConfig, args: &EvalBoardsArgs, folder: &Path) -> CliResult<Site> {
    let path = &args.data.join(folder);
    let how = board.activities.first().map(|part| part.reading.clone());
    let how = how.unwrap_or_default();
    let mut paths = vec![path.clone()];
    let is_folder_of_recordings = path.is_dir() && open(path, &how).is_err();
    if is_folder_of_recordings {
        let entries = std::fs::read_dir(path).map_err(|e| CliError::io(path, e))?;
        let inside: Result<Vec<_>, _> = entries.map(|entry| Ok(entry?.path())).collect();
        paths = inside.map_err(|e: std::io::Error| CliError::io(path, e))?;
        paths.sort();
    }
    let clips = paths.iter().map(|path| -> CliResult<_> {
        let clip = open(path, &how)?.clip;
        Ok(match args.without_tracks {
            true => clip.without_tracks(),
            false => clip,
        })
    });
    site::learn(clips).map_err(|e| CliError::new(format!("{}: {}", path.display(), e.cause)))
}
