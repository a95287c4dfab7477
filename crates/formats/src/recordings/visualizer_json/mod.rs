//! JSON recordings of TI's Industrial and Applications Visualizers: a folder of `replay_N.json` with 100 frames each.
//!
//! A file is an object with `cfg` (the lines of the chirp file), `demo`, `device` and `data`, an array of frames
//! `{"frameData": {..}, "timestamp": ms}`. Absent keys have a meaning: a frame without `pointCloud` has no points, and
//! one without `frameNum` is a packet that the visualizer could not parse.
//!
//! | key of `frameData` | rows |
//! |---|---|
//! | `pointCloud` | x, y, z, velocity, SNR, noise, track |
//! | `pointCloudMinor` | the same, of slow motion (people tracking on the xWRL6844) |
//! | `trackData` | id, position, velocity and acceleration (x, y, z each), then more |
//! | `heightData` | id, top, bottom |
//!
//! x points right, y away from the radar, z up, m; the velocity is positive when receding. The SNR is a linear ratio in
//! the demos that send compressed points, as in [`crate::uart`], and in dB in the others; `demos.rs` has the table. Python writes numbers that are not finite as `NaN` and `Infinity`, which are not valid JSON. Such points
//! are dropped and counted, as in a UART stream.

mod demos;
mod join;
mod parse;

use std::collections::BTreeSet;

use radarllm_base::{BoardReport, RadarPoint};

pub use demos::SnrUnit;
pub use join::{join_parts, join_run};

use super::{MAX_INTENSITY_DB, RecordedFrame, RecordingError, point};
use crate::sensor_position::SensorPosition;
use crate::uart::{Target, TargetHeight};
use demos::Demo;

/// Prefix of the file names, which is followed by the number and `.json`.
pub const PREFIX: &str = "replay_";

/// One frame.
#[derive(Clone, Debug, PartialEq)]
pub struct VisualizerFrame {
    /// Frame number of the firmware, time stamp of the PC, and points.
    pub frame: RecordedFrame,
    /// Tracks of the firmware, as the visualizer stored them.
    pub tracks: Vec<Target>,
    /// Vertical extents of the tracks.
    pub heights: Vec<TargetHeight>,
}

/// Counts of dropped or doubtful data.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct VisualizerCounts {
    /// Frames with a non-zero `error`. They are kept if they have a number.
    pub frames_with_error: u64,
    /// Frames without `frameNum`, which are dropped.
    pub frames_without_number: u64,
    /// Points that consist of zeros. The visualizer allocates more points than it parses.
    pub points_empty: u64,
    /// Points of slow motion that were kept (`pointCloudMinor`).
    pub points_minor: u64,
    /// Points dropped because of NaN or infinity.
    pub points_not_finite: u64,
    /// Points dropped because they are farther than 1 km, faster than 1 km/s or stronger than 1000 dB.
    pub points_out_of_range: u64,
    /// Points kept without SNR: intensity 0 dB.
    pub points_without_snr: u64,
    /// Tracks and heights dropped for the same reasons as points.
    pub tracks_dropped: u64,
    /// Position of the first point that is not finite or out of range.
    pub first_dropped: Option<String>,
    /// Keys of `frameData` whose names begin with `pointCloud` and that are not read, the first few of them.
    pub unread_clouds: BTreeSet<String>,
}

/// Content of one file.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct VisualizerPart {
    /// Text of the chirp file.
    pub cfg: Option<String>,
    /// Name of the demo.
    pub demo: Option<String>,
    /// Name of the device.
    pub device: Option<String>,
    /// Frames in the order of the file.
    pub frames: Vec<VisualizerFrame>,
    /// Unit of the SNR in the file, from which the intensities in dB were computed. `None` if the demo and the device do
    /// not tell it: the intensities are then the numbers of the file, until [`join_parts`] has looked at all files.
    pub snr_unit: Option<SnrUnit>,
    /// Whether a point of `pointCloud` has a noise other than 0 beside its SNR.
    pub has_noise: bool,
    /// Counts of dropped or doubtful data.
    pub counts: VisualizerCounts,
}

/// A complete recording, joined from its files.
#[derive(Clone, Debug, PartialEq)]
pub struct VisualizerRecording {
    /// Text of the chirp file.
    pub cfg: Option<String>,
    /// Name of the demo.
    pub demo: Option<String>,
    /// Name of the device.
    pub device: Option<String>,
    /// Height and tilt that the chirp file states.
    pub sensor_position: Option<SensorPosition>,
    /// Whether the visualizer has rotated the points into level axes and added the height of the sensor. z is then
    /// measured from the floor, and [`Self::lower`] subtracts the height again. Otherwise, points are in the axes of
    /// the sensor.
    pub z_above_floor: bool,
    /// Frames, without those left over from the previous run.
    pub frames: Vec<VisualizerFrame>,
    /// Notes for the user: missing files, dropped frames and points, doubts.
    pub notes: Vec<String>,
    /// What a user should know before trusting the points, a sentence each: assumptions about a demo that is not known, a
    /// clock that falls back, points of which none can be used.
    pub warnings: Vec<String>,
}

impl VisualizerRecording {
    /// The frames with the tracks of the firmware, if it tracked anybody in the recording. Frames without a track then say
    /// that nobody is tracked. So do those of an empty room before a demo that tracks people; where its points show that
    /// something moves, the visualizer may have left the tracks out.
    pub fn into_recorded_frames(self) -> Vec<RecordedFrame> {
        let tracks_people = |demo: &str| demo.contains("People Tracking");
        let shows_nothing =
            |f: &&VisualizerFrame| f.frame.points.iter().all(RadarPoint::is_leakage);
        let is_empty = 2 * self.frames.iter().filter(shows_nothing).count() > self.frames.len();
        let tracks = self.frames.iter().any(|f| !f.tracks.is_empty())
            || is_empty && self.demo.as_deref().is_some_and(tracks_people);
        let recorded = |frame: VisualizerFrame| RecordedFrame {
            board: tracks.then(|| BoardReport {
                tracks: frame.tracks.iter().map(Target::track).collect(),
                is_present: None,
            }),
            ..frame.frame
        };
        self.frames.into_iter().map(recorded).collect()
    }

    /// Moves the origin of level points to the radar, which is `height_m` above the floor. Does nothing if
    /// [`Self::z_above_floor`] is false.
    pub fn lower(&mut self, height_m: f64) {
        if !self.z_above_floor {
            return;
        }
        self.z_above_floor = false;
        for frame in &mut self.frames {
            for p in &mut frame.frame.points {
                *p = moved(p, |[x, y, z]| [x, y, z - height_m]);
            }
            // The visualizer moves its tracks as it moves the points.
            for track in &mut frame.tracks {
                track.position_m[2] -= height_m as f32;
            }
        }
    }
}

/// Reads the text of one `replay_N.json`. Left-over frames at its start are kept; [`join_parts`] drops them, also for a
/// single file.
///
/// # Errors
/// [`RecordingError`] with the line: invalid JSON, no `data`, a key of the wrong type, or a row of the wrong length.
/// The message names the frame (from 0) and the key.
pub fn read_visualizer_json(text: &str) -> Result<VisualizerPart, RecordingError> {
    let mut part = parse::part(text)?;
    let demo = part.demo.as_deref().and_then(Demo::named);
    if let Some(unit) = demo.and_then(|demo| demo.snr_unit(part.device.as_deref())) {
        part.finish_points(unit);
    }
    Ok(part)
}

impl VisualizerPart {
    /// Converts the SNR of all points to dB. This is done after parsing because it depends on the demo and the device,
    /// which may follow the frames in the file.
    fn finish_points(&mut self, unit: SnrUnit) {
        self.snr_unit = Some(unit);
        let counts = &mut self.counts;
        for frame in &mut self.frames {
            frame.frame.points.retain_mut(|point| {
                let stored = point.intensity_db;
                point.intensity_db = match unit {
                    SnrUnit::Ratio if stored > 0.0 => 10.0 * stored.log10(),
                    SnrUnit::Ratio => 0.0,
                    SnrUnit::Decibels => stored,
                };
                if point.intensity_db.abs() > MAX_INTENSITY_DB as f32 {
                    counts.points_out_of_range += 1;
                    counts.first_dropped.get_or_insert_with(|| {
                        format!("the SNR of frame number {}", frame.frame.number)
                    });
                    return false;
                }
                counts.points_without_snr += u64::from(stored <= 0.0);
                true
            });
        }
    }
}

/// The point at another position, with its new range.
fn moved(p: &RadarPoint, to: impl Fn([f64; 3]) -> [f64; 3]) -> RadarPoint {
    let position_m = to([p.x_m, p.y_m, p.z_m].map(f64::from));
    point(
        position_m,
        f64::from(p.velocity_mps),
        f64::from(p.intensity_db),
    )
}
