//! Points stored by other recorders: converts text or bytes into [`radarllm_base::RecordedFrame`]s.
//!
//! Every reader returns points in the project's axes (x right, y away from the radar, z up, m) and documents what it
//! assumes. Intensities keep the recording's own reference: only their differences in dB can be compared.

pub mod bag;
pub mod mars;
pub mod matlab;
pub mod mmbody;
pub mod mmfi;
mod pieces;
pub mod radhar;
pub mod ros;
pub mod track_table;
pub mod visualizer_binary;
pub mod visualizer_json;
pub mod windows_json;

use radarllm_base::RadarPoint;
pub(crate) use radarllm_base::RecordedFrame;
use radarllm_files::npy::NpyError;

pub use bag::read_bag;
pub use mars::{read_mars_features, read_mars_points};
pub use matlab::{MatArray, MatlabRecording, read_mat_array, read_matlab_points};
pub use mmbody::{read_mmbody_calibration, read_mmbody_frame};
pub use mmfi::read_mmfi_frame;
pub use pieces::{PiecesError, Run};
pub use radhar::read_radhar_points;
pub use ros::{Bag, BagError, RosEncoding, RosMessages};
pub use track_table::{TrackTable, read_track_table};
pub use visualizer_binary::{
    VisualizerBinary, VisualizerBinaryError, read_visualizer_binary, read_visualizer_binary_run,
};
pub use visualizer_json::{
    SnrUnit, VisualizerCounts, VisualizerFrame, VisualizerPart, VisualizerRecording, join_parts,
    join_run, read_visualizer_json,
};
pub use windows_json::read_windows_json;

/// Maximum coordinate accepted, m: indoor radars report less.
pub(crate) const MAX_COORDINATE_M: f64 = 1e3;
/// Maximum speed accepted, m/s.
pub(crate) const MAX_VELOCITY_MPS: f64 = 1e3;
/// Maximum intensity accepted, dB.
pub(crate) const MAX_INTENSITY_DB: f64 = 1e3;

/// Orientation of the axes of a recording. z is up in both.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axes {
    /// x right, y away from the radar: the project's own.
    RightForwardUp,
    /// x away from the radar, y left: what ROS drivers send (REP 103).
    ForwardLeftUp,
}

impl Axes {
    /// All orientations, for messages.
    pub const ALL: [Self; 2] = [Self::RightForwardUp, Self::ForwardLeftUp];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::RightForwardUp => "right-forward-up",
            Self::ForwardLeftUp => "forward-left-up",
        }
    }

    /// The axes with the given [`Self::name`].
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|a| a.name() == name)
    }

    /// Converts a position from these axes into the project's axes.
    pub fn to_project(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self {
            Self::RightForwardUp => [x, y, z],
            Self::ForwardLeftUp => [-y, x, z],
        }
    }
}

/// Position in a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Line of a text, from 1.
    Line(usize),
    /// Byte of a file, from 0.
    Byte(u64),
    /// Row of an array, from 0.
    Row(usize),
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Line(n) => write!(f, "line {n}"),
            Self::Byte(n) => write!(f, "byte {n}"),
            Self::Row(n) => write!(f, "row {n}"),
        }
    }
}

/// Reason why a recording is refused.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
#[error("{at}: expected {expected}, found {found}")]
pub struct RecordingError {
    /// Position in the recording.
    pub at: Place,
    /// What the format requires.
    pub expected: String,
    /// What was found, shortened.
    pub found: String,
}

/// Names of a foreign file that a message lists.
const MAX_LISTED: usize = 30;

impl RecordingError {
    pub(crate) fn new(at: Place, expected: impl Into<String>, found: &str) -> Self {
        Self {
            at,
            expected: expected.into(),
            found: format!("`{}`", printable(found)),
        }
    }

    /// An error about names of which some are missing: those that are there are listed.
    pub(crate) fn listing(at: Place, expected: impl Into<String>, names: &[&str]) -> Self {
        Self {
            at,
            expected: expected.into(),
            found: listed(names),
        }
    }
}

/// Untrusted text must not reach a terminal unchanged: it is shortened and its control characters are removed.
pub(crate) fn printable(text: &str) -> String {
    text.trim()
        .chars()
        .take(40)
        .map(|c| if c.is_control() { '?' } else { c })
        .collect()
}

/// The names of columns, fields or topics of a foreign file, for messages.
pub(crate) fn listed(names: &[&str]) -> String {
    if names.is_empty() {
        return "none".into();
    }
    let shown = names.iter().take(MAX_LISTED);
    // A topic with its type is longer than a name.
    let halves = |name: &&str| match name.split_once(' ') {
        Some((name, kind)) => format!("`{} {}`", printable(name), printable(kind)),
        None => format!("`{}`", printable(name)),
    };
    let mut list: Vec<String> = shown.map(halves).collect();
    if names.len() > MAX_LISTED {
        list.push(format!("{} more", names.len() - MAX_LISTED));
    }
    list.join(", ")
}

impl From<NpyError> for RecordingError {
    fn from(error: NpyError) -> Self {
        Self {
            at: Place::Byte(error.byte),
            expected: error.expected,
            found: error.found,
        }
    }
}

/// Parses a finite number within +-`limit`.
fn number(line: usize, name: &str, text: &str, limit: f64) -> Result<f64, RecordingError> {
    text.trim()
        .parse::<f64>()
        .ok()
        .filter(|v| v.abs() <= limit)
        .ok_or_else(|| {
            RecordingError::new(
                Place::Line(line),
                format!("{name}, a number within +-{limit}"),
                text,
            )
        })
}

/// A point from five numbers, converted into the project's axes. Each number is checked against its limit.
fn checked_point(
    at: Place,
    axes: Axes,
    [x, y, z, velocity_mps, intensity_db]: [f64; 5],
) -> Result<RadarPoint, RecordingError> {
    let limits = [
        ("x, m", x, MAX_COORDINATE_M),
        ("y, m", y, MAX_COORDINATE_M),
        ("z, m", z, MAX_COORDINATE_M),
        ("velocity, m/s", velocity_mps, MAX_VELOCITY_MPS),
        ("intensity, dB", intensity_db, MAX_INTENSITY_DB),
    ];
    for (name, value, limit) in limits {
        // NaN is out of range.
        if value.is_nan() || value.abs() > limit {
            let expected = format!("{name}, within +-{limit}");
            return Err(RecordingError::new(at, expected, &value.to_string()));
        }
    }
    if !is_in_range([x, y, z]) {
        let expected = format!("a point within {MAX_COORDINATE_M} m of the radar");
        return Err(RecordingError::new(at, expected, &format!("{x}, {y}, {z}")));
    }
    Ok(point(
        axes.to_project([x, y, z]),
        velocity_mps,
        intensity_db,
    ))
}

/// Whether a point is as near as any point of a recording: its range counts, not each coordinate by itself.
pub(crate) fn is_in_range([x, y, z]: [f64; 3]) -> bool {
    x.hypot(y).hypot(z) <= MAX_COORDINATE_M
}

pub(crate) fn point(position_m: [f64; 3], velocity_mps: f64, intensity_db: f64) -> RadarPoint {
    let [x_m, y_m, z_m] = position_m;
    RadarPoint {
        x_m: x_m as f32,
        y_m: y_m as f32,
        z_m: z_m as f32,
        range_m: (x_m * x_m + y_m * y_m + z_m * z_m).sqrt() as f32,
        velocity_mps: velocity_mps as f32,
        intensity_db: intensity_db as f32,
    }
}
