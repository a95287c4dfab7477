//! Folders and files of TI's visualizers, and the chirp file beside a recording.

use std::{
    fs,
    path::{Path, PathBuf},
};

use radarllm_base::{
    RecordedFrame,
    message::{option, text},
};
use radarllm_files::bounded;
use radarllm_formats::{
    CfgChoice, RecordingFormat, SensorPosition, choose_cfg,
    detect::numbered,
    recordings::{
        PiecesError, VisualizerBinaryError, join_run, read_visualizer_binary_run,
        read_visualizer_json, visualizer_binary, visualizer_json,
    },
    uart::{Dialect, recorded_frames},
    visualizer_folder,
};

use crate::{
    error::{Error, Result},
    opened::{MAX_FILE_BYTES, Opened, detect_error},
    points::check_stream,
    radar::{OpenedRadar, open_radar_text},
};

/// Maximum number of names listed in a folder and its subfolders.
const MAX_NAMES: usize = 100_000;
/// Maximum depth of subfolders that are searched: `binData/<time>/`.
const MAX_DEPTH: usize = 2;

/// Names of the files in a folder, and of those in its subfolders with the subfolder and `/` before them.
pub(crate) fn file_names(folder: &Path) -> Result<Vec<String>> {
    let mut names = Vec::new();
    list(folder, "", 0, &mut names)?;
    Ok(names)
}

fn list(folder: &Path, prefix: &str, depth: usize, names: &mut Vec<String>) -> Result {
    for entry in fs::read_dir(folder).map_err(|e| Error::io(folder, e))? {
        let entry = entry.map_err(|e| Error::io(folder, e))?;
        // A name that is not valid text is not the name of a recording's file.
        let Ok(name) = entry.file_name().into_string() else {
            continue;
        };
        let is_folder = entry.file_type().is_ok_and(|t| t.is_dir());
        if is_folder && depth < MAX_DEPTH {
            list(&entry.path(), &format!("{prefix}{name}/"), depth + 1, names)?;
        } else if !is_folder {
            names.push(format!("{prefix}{name}"));
        }
        if names.len() > MAX_NAMES {
            return Err(Error::in_file(
                folder,
                format!("more than {MAX_NAMES} files, too many for a recording"),
            ));
        }
    }
    Ok(())
}

/// A recording of a visualizer.
pub(crate) struct Visualized {
    /// Frames. The points are in the sensor's axes, or level and relative to the radar if `is_level`.
    pub frames: Vec<RecordedFrame>,
    /// Whether the visualizer has rotated the points into level axes.
    pub is_level: bool,
    /// The radar of the chirp file inside the recording.
    pub radar: Option<OpenedRadar>,
    /// Height and angles stated in this chirp file.
    pub position: Option<SensorPosition>,
}

/// Number and path of each file of a recording, which is one file or the files of a folder.
fn pieces(path: &Path, format: RecordingFormat) -> Result<Vec<(u64, PathBuf)>> {
    if !path.is_dir() {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let prefix = match format {
            RecordingFormat::VisualizerJson => visualizer_json::PREFIX,
            _ => visualizer_binary::PREFIX,
        };
        let number = numbered(&name.to_lowercase(), &prefix.to_lowercase());
        return Ok(vec![(number.unwrap_or(1), path.into())]);
    }
    let names = file_names(path)?;
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let folder = visualizer_folder(&names, Some(format))
        .map_err(|e| detect_error(path, e))?
        .ok_or_else(|| Error::in_file(path, format!("no files of format {}", format.name())))?;
    let piece = |(number, name): (u64, String)| (number, path.join(name));
    Ok(folder.files.into_iter().map(piece).collect())
}

/// The error of pieces that cannot be joined, with a hint if one of several runs can be chosen.
fn pieces_error(path: &Path, error: PiecesError) -> Error {
    let has_runs = matches!(error, PiecesError::SeveralRuns { .. });
    let error = Error::wrap_in_file(path, error);
    match has_runs {
        true => error.with_hint(
            option("run")
                .text(" N reads one of them; or move the pieces of each into a folder of its own"),
        ),
        false => error,
    }
}

/// Reads `replay_N.json`: one file, or all of a folder, or those of one of several runs in it.
pub(crate) fn read_json(
    capture: &mut Opened,
    run: Option<usize>,
    notes: &mut Vec<String>,
    warnings: &mut Vec<String>,
) -> Result<Visualized> {
    let path = &capture.path().to_path_buf();
    let mut parts = Vec::new();
    for (number, file) in pieces(path, RecordingFormat::VisualizerJson)? {
        let text = match file == *path {
            true => capture.text()?,
            false => bounded::read_text(&file, MAX_FILE_BYTES)?,
        };
        let part = read_visualizer_json(&text).map_err(|e| Error::wrap_in_file(&file, e))?;
        parts.push((number, part));
    }
    let mut recording = join_run(parts, run).map_err(|e| pieces_error(path, e))?;
    notes.append(&mut recording.notes);
    notes.extend_from_slice(&recording.warnings);
    warnings.append(&mut recording.warnings);
    let is_level = recording.z_above_floor;
    let position = recording.sensor_position;
    match position {
        Some(position) => recording.lower(position.height_m),
        // If the added height is unknown, z is still the height above the floor.
        None if is_level => {
            return Err(Error::in_file(
                path,
                "the visualizer has added the sensor's height to z, but the chirp file in it has no sensorPosition",
            ));
        }
        None => {}
    }
    let radar = match &recording.cfg {
        Some(cfg) => match open_radar_text(path, cfg) {
            Ok(radar) => Some(radar),
            Err(error) => {
                notes.push(format!(
                    "the chirp file in the recording is not used: {error}"
                ));
                None
            }
        },
        None => None,
    };
    Ok(Visualized {
        frames: recording.into_recorded_frames(),
        is_level,
        radar,
        position,
    })
}

/// Reads `pHistBytes_N.bin`: one file, or all of a folder.
pub(crate) fn read_binary(
    capture: &mut Opened,
    dialect: Option<Dialect>,
    run: Option<usize>,
    notes: &mut Vec<String>,
    warnings: &mut Vec<String>,
) -> Result<Vec<RecordedFrame>> {
    let path = &capture.path().to_path_buf();
    let mut pieces_read = Vec::new();
    for (number, file) in pieces(path, RecordingFormat::VisualizerBinary)? {
        let bytes = match file == *path {
            true => capture.bytes()?,
            false => bounded::read_bytes(&file, MAX_FILE_BYTES)?,
        };
        pieces_read.push((number, bytes));
    }
    let recording = read_visualizer_binary_run(pieces_read, dialect, run).map_err(|e| match e {
        VisualizerBinaryError::Pieces(e) => pieces_error(path, e),
        e => Error::wrap_in_file(path, e).with_hint(option("dialect").text(" names it")),
    })?;
    let (report, guess) = (recording.report, recording.guess);
    let frames = recorded_frames(recording.frames);
    let mut reports = frames.iter().flat_map(|f| &f.board);
    let has_tracks = reports.any(|report| !report.tracks.is_empty());
    check_stream(path, &report, guess.as_ref(), has_tracks, notes, warnings)?;
    notes.extend(recording.notes);
    Ok(frames)
}

/// Finds the chirp file of a recording: the only one in its folder, or else the only one in the parent folder. If there
/// are several, none is chosen and a note is added. One that cannot be read is an error if it is needed, or else a note.
pub(crate) fn radar_beside(
    path: &Path,
    is_needed: bool,
    notes: &mut Vec<String>,
) -> Result<Option<OpenedRadar>> {
    let folder = match path.is_dir() {
        true => path.to_path_buf(),
        false => match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
            _ => PathBuf::from("."),
        },
    };
    let names = |folder: &Path| -> Vec<String> {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        entries
            .filter_map(|entry| entry.file_name().into_string().ok())
            .collect()
    };
    let parent = folder.join("..");
    let (inside, above) = (names(&folder), names(&parent));
    let choice = choose_cfg(
        inside.iter().map(String::as_str),
        above.iter().map(String::as_str),
    );
    let place = |is_in_parent: bool| match is_in_parent {
        true => &parent,
        false => &folder,
    };
    match choice {
        CfgChoice::None => Ok(None),
        CfgChoice::Several {
            names,
            is_in_parent,
        } => {
            notes.push(format!(
                "{} chirp files in {}: {}; `radar` names the one of the recording",
                names.len(),
                place(is_in_parent).display(),
                names.join(", ")
            ));
            Ok(None)
        }
        CfgChoice::One { name, is_in_parent } => {
            let file = place(is_in_parent).join(name);
            let cfg = bounded::read_text(&file, bounded::MAX_CONFIG_BYTES).map_err(Error::from);
            let radar = match cfg.and_then(|cfg| open_radar_text(&file, &cfg)) {
                Ok(radar) => radar,
                Err(error) if is_needed => {
                    return Err(error.with_hint(
                        text("this chirp file lies beside the recording; ")
                            .option("radar")
                            .text(" names another one, ")
                            .option("frame_rate")
                            .text(" HZ does without it"),
                    ));
                }
                Err(error) => {
                    notes.push(format!(
                        "the chirp file beside the recording is not used: {error}"
                    ));
                    return Ok(None);
                }
            };
            notes.push(format!("radar by {}, beside the recording", file.display()));
            Ok(Some(radar))
        }
    }
}
