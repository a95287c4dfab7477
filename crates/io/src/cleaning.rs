//! Background subtraction and corrections of recordings: empty scene, offsets, leakage, channel mismatch.

use std::path::{Path, PathBuf};

use radarllm_base::{PointFrame, RadarConfig, RadarCube};
use radarllm_dataset::read_points_from;
use radarllm_files::bounded::{self, MAX_CONFIG_BYTES};
use radarllm_formats::{
    Calibration,
    adc::{CubeShape, FrameSource},
};
use radarllm_radar_dsp::{
    Background, ClutterFilter, Corrections, Corrector, DspOptions, EmptyRoom,
};
use radarllm_tracking::PointBackground;

use crate::{
    error::{Error, Result},
    layout::open_samples,
    opened::{Opened, RecordingKind},
    options::{CaptureFormat, CaptureOptions, CleaningOptions, LayoutOptions},
    points,
    radar::OpenedRadar,
    samples::SampleFrames,
};

/// Frames of an empty scene that are read at most: 17 minutes at 10 frames/s.
const MAX_EMPTY_FRAMES: usize = 10_000;
/// Residual above which the user is warned, in dB: that of the empty scene's own frames after subtraction.
const UNSTEADY_DB: f64 = -20.0;

/// Creates the corrections of raw samples that the options request. Use them together with [`chain`]. `format` is the
/// recording's format as named by the caller.
///
/// # Errors
/// Options that apply only to points, and files that cannot be read or do not match the radar.
pub fn corrector(
    options: &CleaningOptions,
    radar: &OpenedRadar,
    format: Option<CaptureFormat>,
    layout: &LayoutOptions,
    notes: &mut Vec<String>,
) -> Result<Corrector> {
    options.check_for_samples()?;
    let background = match &options.background {
        Some(path) => Some(mean_background(path, radar, format, layout, notes)?),
        None => None,
    };
    let channel_gains = match &options.calibration {
        Some(path) => {
            let hint = "`radarllm radar calibrate` makes such files, one for each radar";
            let wrong = |e| Error::wrap_in_file(path, e).with_hint(hint);
            let text = bounded::read_text(path, MAX_CONFIG_BYTES)?;
            let calibration = Calibration::from_toml(&text).map_err(wrong)?;
            calibration.gains(radar.config()?).map_err(wrong)?
        }
        None => Vec::new(),
    };
    let corrections = Corrections {
        background,
        remove_offset: options.remove_offset,
        leakage_m: options.remove_leakage_m,
        channel_gains,
    };
    Ok(Corrector::new(radar.config()?, corrections)?)
}

/// Returns the signal chain after these corrections. A subtracted background replaces the removal of the mean of each
/// frame.
pub fn chain(options: &CleaningOptions, dsp: DspOptions) -> DspOptions {
    match options.background {
        Some(_) => DspOptions {
            clutter: ClutterFilter::Off,
            ..dsp
        },
        None => dsp,
    }
}

/// Removes the points of the empty scene from recorded points.
pub(crate) fn remove_background(
    frames: &mut [PointFrame],
    options: &CaptureOptions,
    notes: &mut Vec<String>,
) -> Result {
    let (Some(background), Some(path)) = (point_background(options)?, &options.cleaning.background)
    else {
        return Ok(());
    };
    let n_points: usize = frames.iter().map(|f| f.points.len()).sum();
    let n_removed = background.remove(frames);
    notes.push(about_background(&background, path, n_removed, n_points));
    Ok(())
}

/// What the removal of an empty scene did.
pub(crate) fn about_background(
    background: &PointBackground,
    path: &Path,
    n_removed: usize,
    n_points: usize,
) -> String {
    let places = match background.n_places() {
        0 => String::new(),
        1 => " and 1 place where something moves".into(),
        n => format!(" and {n} places where something moves"),
    };
    format!(
        "background: {} cells{places} of {} frames of {}; {n_removed} of {n_points} points removed",
        background.n_cells(),
        background.n_frames,
        path.display()
    )
}

/// Learns the cells of the empty scene that the options name.
///
/// # Errors
/// Options that apply only to raw samples, and a recording that cannot be read.
pub(crate) fn point_background(options: &CaptureOptions) -> Result<Option<PointBackground>> {
    options.cleaning.check_for_points()?;
    let Some(path) = &options.cleaning.background else {
        return Ok(None);
    };
    let named = match options.format {
        Some(CaptureFormat::Format(format)) => Some(format),
        _ => None,
    };
    let as_named = CaptureOptions {
        format: named.map(CaptureFormat::Format),
        ..CaptureOptions::default()
    };
    let mut opened = Opened::open(std::slice::from_ref(path), &as_named)?;
    let empty = match opened.kind() {
        RecordingKind::PointsFile => read_points_from(opened.take_first()?, path)?.frames,
        RecordingKind::Samples(_) => {
            return Err(Error::in_file(
                path,
                "raw samples, but the capture holds points",
            ));
        }
        RecordingKind::Points(_) => {
            let radar = options.radar.as_ref();
            points::open_points(opened, radar, &options.points)?
                .timeline
                .frames
        }
    };
    let cells = options.cleaning.background_cells.resolve();
    Ok(Some(PointBackground::learn(&empty, cells)?))
}

/// Computes the mean of the frames of an empty scene.
fn mean_background(
    path: &PathBuf,
    radar: &OpenedRadar,
    format: Option<CaptureFormat>,
    layout: &LayoutOptions,
    notes: &mut Vec<String>,
) -> Result<Background> {
    let captures = std::slice::from_ref(path);
    let opened = Opened::samples(captures, format)?;
    let mut remarks = Vec::new();
    let mut frames = open_samples(opened, radar, layout, &mut remarks, &mut Vec::new())?;
    notes.extend(remarks.into_iter().map(|n| format!("background: {n}")));
    let config = radar.config()?;
    let mut room = EmptyRoom::new(config);
    let n_damaged = each_whole_frame(&mut frames, path, config, |cube| Ok(room.push(cube)?))?;
    let background = room.finish().ok_or_else(|| {
        Error::in_file(
            path,
            format!("not one whole frame of radar `{}`", config.name),
        )
    })?;
    let n_frames = background.n_frames;
    let mut note = format!(
        "background: mean of {n_frames} frames of {}",
        path.display()
    );
    if n_damaged > 0 {
        note += &format!(", {n_damaged} with missing bytes left out");
    }
    if let Some(drift_db) = background.drift_db {
        note += &format!("; they differ from it by {drift_db:.1} dB");
        if drift_db > UNSTEADY_DB {
            note += ": the scene or the radar changed from frame to frame, and this much remains";
        }
    }
    notes.push(note);
    Ok(background)
}

/// Calls `each` with every complete frame, and returns the number of frames with missing bytes.
///
/// # Errors
/// A frame that cannot be read, or the first error of `each`, with the name of the file.
pub fn each_whole_frame(
    frames: &mut SampleFrames,
    path: &Path,
    radar: &RadarConfig,
    mut each: impl FnMut(&RadarCube) -> Result,
) -> Result<usize> {
    let mut cube = CubeShape::of(radar).zeros()?;
    let mut n_damaged = 0;
    for _ in 0..MAX_EMPTY_FRAMES {
        match frames.next_frame(&mut cube) {
            Ok(Some(integrity)) if integrity.is_complete() => {
                each(&cube).map_err(|e| e.naming(path))?;
            }
            Ok(Some(_)) => n_damaged += 1,
            Ok(None) => break,
            Err(e) => return Err(Error::wrap_in_file(path, e)),
        }
    }
    Ok(n_damaged)
}
