//! JSON recordings of TI's Industrial and Applications Visualizers: a folder of `replay_N.json` with 100 frames each.
//!
//! A file is an object with `cfg` (the lines of the chirp file), `demo`, `device` and `data`, an array of frames
//! `{"frameData": {..}, "timestamp": ms}`. Absent keys have a meaning: a frame without `pointCloud` has no points, and
//! one without `frameNum` is a packet that the visualizer could not parse.
//!
//! | key of `frameData` | rows |
//! |---|---|
//! | `pointCloud` | x, y, z, velocity, SNR, noise, track |
//! | `trackData` | id, position, velocity and acceleration (x, y, z each), then more |
//! | `heightData` | id, top, bottom |
//!
//! x points right, y away from the radar, z up, m; the velocity is positive when receding. The SNR is a linear ratio in
//! the demos that send compressed points (people tracking on xWR6843 and xWR1843), as in [`crate::uart`], and in dB in
//! the others. Python writes numbers that are not finite as `NaN` and `Infinity`, which are not valid JSON. Such points
//! are dropped and counted, as in a UART stream.

mod join;
mod parse;

use radarllm_base::{BoardReport, RadarPoint};

pub use join::join_parts;

use super::{MAX_INTENSITY_DB, RecordedFrame, RecordingError, point};
use crate::sensor_position::SensorPosition;
use crate::uart::{Target, TargetHeight};

/// Prefix of the file names, which is followed by the number and `.json`.
pub const PREFIX: &str = "replay_";

/// Demos that send compressed points with a linear SNR, on devices other than the low-power ones.
const LINEAR_SNR_DEMOS: [&str; 5] = [
    "3D People Tracking",
    "Vital Signs with People Tracking",
    "Long Range People Detection",
    "Mobile Tracker",
    "Small Obstacle Detection",
];

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
}

impl VisualizerRecording {
    /// The frames with the tracks of the firmware, if it tracked anybody in the recording. Frames without a track then say
    /// that nobody is tracked.
    pub fn into_recorded_frames(self) -> Vec<RecordedFrame> {
        let tracks = self.frames.iter().any(|f| !f.tracks.is_empty());
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
    part.finish_points();
    Ok(part)
}

impl VisualizerPart {
    /// Converts the SNR of all points to dB. This is done after parsing because it depends on the demo and the device,
    /// which may follow the frames in the file.
    fn finish_points(&mut self) {
        let is_low_power = |device: &str| device.to_ascii_uppercase().contains("WRL");
        let is_linear = self
            .demo
            .as_deref()
            .is_some_and(|d| LINEAR_SNR_DEMOS.contains(&d))
            && !self.device.as_deref().is_some_and(is_low_power);
        let counts = &mut self.counts;
        for frame in &mut self.frames {
            frame.frame.points.retain_mut(|point| {
                let stored = point.intensity_db;
                point.intensity_db = match is_linear {
                    true if stored > 0.0 => 10.0 * stored.log10(),
                    true => 0.0,
                    false => stored,
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
