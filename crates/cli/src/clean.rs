//! What is taken off recordings before anybody looks at them: the empty room, offsets, leakage, channel mismatch.

use std::path::PathBuf;

use clap::Args;
use radarllm_base::{PointFrame, RadarConfig, RadarCube};
use radarllm_dataset::read_points;
use radarllm_formats::{
    Calibration, Format as PointsFormat,
    adc::{CubeShape, FrameSource},
};
use radarllm_radar_dsp::{
    Background, ClutterFilter, Corrections, Corrector, DspOptions, EmptyRoom,
};
use radarllm_tracking::{BackgroundOptions, PointBackground};

use crate::{
    capture::{self, Frames, LayoutArgs},
    error::{CliError, CliResult, refuse_options},
    files::{self, MAX_CONFIG_BYTES},
    input::MAX_FRAMES,
    recording::{self, RecordingArgs},
};

/// Of options that mean nothing for points.
pub const NEEDS_SAMPLES: &str = "needs raw samples; this capture holds points";
/// What remains of an empty room's frames after subtraction, dB, from which the user should know.
const UNSTEADY_DB: f64 = -20.0;

/// What to take off.
#[derive(Args, Clone, Debug, Default)]
pub struct CleanArgs {
    /// Capture of the same room without people, by the same radar. Raw samples: its mean is subtracted in
    /// place of each frame's own, so that who sits still stays visible. Points: its cells are removed.
    #[arg(long, value_name = "EMPTY")]
    pub background: Option<PathBuf>,
    /// Recorded points: edge of the empty room's cells in x, y and z, m; 0.25 without it.
    #[arg(long, value_name = "M", requires = "background")]
    pub background_cell: Option<f64>,
    /// Recorded points: edge of the cells in velocity, m/s; 0.25 without it.
    #[arg(long, value_name = "MPS", requires = "background")]
    pub background_velocity: Option<f64>,
    /// Recorded points: a cell is the room's with points in more than this share of its frames; 0.1 without it.
    #[arg(long, value_name = "SHARE", requires = "background")]
    pub background_share: Option<f64>,
    /// Raw samples: channel gains, by `radar calibrate`.
    #[arg(long, value_name = "CAL.toml")]
    pub calibration: Option<PathBuf>,
    /// Raw samples: take off each receiver's mean. Seen only together with --background: without it all
    /// that stands still goes anyway.
    #[arg(long)]
    pub remove_offset: bool,
    /// Raw samples: take off what stands still up to this range, m: leakage. Seen as --remove-offset is.
    #[arg(long, value_name = "M")]
    pub remove_leakage: Option<f64>,
}

impl CleanArgs {
    /// Corrections of raw samples; [`Self::chain`] goes with them.
    ///
    /// `format` is the capture's, as the user named it.
    pub fn of_samples(
        &self,
        radar: &RadarConfig,
        radar_name: &str,
        format: Option<&str>,
        layout: &LayoutArgs,
        notes: &mut Vec<String>,
    ) -> CliResult<Corrector> {
        refuse_options(
            &[
                ("--background-cell", self.background_cell.is_some()),
                ("--background-velocity", self.background_velocity.is_some()),
                ("--background-share", self.background_share.is_some()),
            ],
            "has no meaning for raw samples: their mean is subtracted",
        )?;
        let background = match &self.background {
            Some(path) => Some(empty_room(path, radar, radar_name, format, layout, notes)?),
            None => None,
        };
        let channel_gains = match &self.calibration {
            Some(path) => {
                let wrong = |e: &dyn std::fmt::Display| {
                    CliError::new(format!("{}: {e}", path.display()))
                        .hint("`radarllm radar calibrate` makes such files, one for each radar")
                };
                let text = files::read_text(path, MAX_CONFIG_BYTES)?;
                let calibration = Calibration::from_toml(&text).map_err(|e| wrong(&e))?;
                calibration.gains(radar).map_err(|e| wrong(&e))?
            }
            None => Vec::new(),
        };
        let corrections = Corrections {
            background,
            remove_offset: self.remove_offset,
            leakage_m: self.remove_leakage,
            channel_gains,
        };
        Ok(Corrector::new(radar, corrections)?)
    }

    /// The signal chain after these corrections: an empty room that was subtracted takes the place of each frame's mean.
    pub fn chain(&self, options: DspOptions) -> DspOptions {
        match self.background {
            Some(_) => DspOptions {
                clutter: ClutterFilter::Off,
                ..options
            },
            None => options,
        }
    }

    /// Removes the empty room's points from recorded ones.
    pub fn of_points(
        &self,
        frames: &mut [PointFrame],
        radar: Option<&str>,
        format: Option<&str>,
        args: &RecordingArgs,
        notes: &mut Vec<String>,
    ) -> CliResult {
        refuse_options(
            &[
                ("--calibration", self.calibration.is_some()),
                ("--remove-offset", self.remove_offset),
                ("--remove-leakage", self.remove_leakage.is_some()),
            ],
            NEEDS_SAMPLES,
        )?;
        let Some(path) = &self.background else {
            return Ok(());
        };
        let detected =
            recording::format_of(path, format)?.map_err(|e| recording::detect_error(path, &e))?;
        let empty = match detected.format {
            PointsFormat::Points => read_points(path)?.frames,
            PointsFormat::Adc | PointsFormat::Dca1000 => {
                return Err(CliError::new(format!(
                    "{}: raw samples, but the capture holds points",
                    path.display()
                )));
            }
            _ => {
                recording::open(path, &detected, radar, args)?
                    .timeline
                    .frames
            }
        };
        let defaults = BackgroundOptions::default();
        let options = BackgroundOptions {
            cell_m: self.background_cell.unwrap_or(defaults.cell_m),
            cell_mps: self.background_velocity.unwrap_or(defaults.cell_mps),
            share: self.background_share.unwrap_or(defaults.share),
        };
        let background = PointBackground::learn(&empty, options)?;
        let n_points: usize = frames.iter().map(|f| f.points.len()).sum();
        let n_removed = background.remove(frames);
        notes.push(format!(
            "background: {} cells of {} frames of {}; {n_removed} of {n_points} points removed",
            background.n_cells(),
            background.n_frames,
            path.display()
        ));
        Ok(())
    }
}

/// The mean of an empty room's frames.
fn empty_room(
    path: &PathBuf,
    radar: &RadarConfig,
    radar_name: &str,
    format: Option<&str>,
    layout: &LayoutArgs,
    notes: &mut Vec<String>,
) -> CliResult<Background> {
    let captures = std::slice::from_ref(path);
    let format = capture::format_of(captures, format)?;
    let mut said = Vec::new();
    let mut frames = Frames::open(format, captures, radar, radar_name, layout, &mut said)?;
    notes.extend(said.into_iter().map(|n| format!("background: {n}")));
    let mut room = EmptyRoom::new(radar);
    let n_damaged = whole_frames(&mut frames, path, radar, |cube| Ok(room.push(cube)?))?;
    let background = room.finish().ok_or_else(|| {
        CliError::new(format!(
            "{}: not one whole frame of radar `{}`",
            path.display(),
            radar.name
        ))
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
            note += ": the room or the radar changed from frame to frame, and so much stays";
        }
    }
    notes.push(note);
    Ok(background)
}

/// Calls `each` with the frames that miss no bytes; returns how many do.
pub fn whole_frames(
    frames: &mut Frames,
    path: &std::path::Path,
    radar: &RadarConfig,
    mut each: impl FnMut(&RadarCube) -> CliResult,
) -> CliResult<usize> {
    let mut cube = CubeShape::of(radar).zeros()?;
    let mut n_damaged = 0;
    for _ in 0..MAX_FRAMES {
        match frames.next_frame(&mut cube) {
            Ok(Some(integrity)) if integrity.is_complete() => {
                each(&cube).map_err(|e| CliError {
                    cause: format!("{}: {}", path.display(), e.cause),
                    ..e
                })?;
            }
            Ok(Some(_)) => n_damaged += 1,
            Ok(None) => break,
            Err(e) => return Err(capture::naming(path, e)),
        }
    }
    Ok(n_damaged)
}
