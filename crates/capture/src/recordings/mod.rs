//! Points that somebody else's radar reported: text in, [`RecordedFrame`]s out.
//!
//! Every reader ends in the project's axes (x right, y away from the radar, z up, m) and says what it
//! assumed. Intensities keep the recording's own reference: only differences in dB mean something.

pub mod mars;
pub mod radhar;

use radarllm_base::RadarPoint;

pub use mars::read_mars_points;
pub use radhar::read_radhar_points;

/// Farthest coordinate believed, m: no room radar reports more.
const MAX_COORDINATE_M: f64 = 1e3;
/// Fastest velocity believed, m/s.
const MAX_VELOCITY_MPS: f64 = 1e3;

/// One frame of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedFrame {
    /// The recorder's own count.
    pub number: u64,
    /// The recorder's own clock, s; `None` if the format has none that can be used.
    pub stamp_s: Option<f64>,
    /// Points in the recorder's order.
    pub points: Vec<RadarPoint>,
}

/// Why a recording is refused.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
#[error("line {line}: expected {expected}, found {found}")]
pub struct RecordingError {
    /// Line, from 1.
    pub line: usize,
    /// What the format asks for.
    pub expected: String,
    /// What is there, shortened.
    pub found: String,
}

impl RecordingError {
    fn new(line: usize, expected: impl Into<String>, found: &str) -> Self {
        // Hostile text stays out of terminals: short, and without control characters.
        let found: String = found
            .chars()
            .take(40)
            .map(|c| if c.is_control() { '?' } else { c })
            .collect();
        Self {
            line,
            expected: expected.into(),
            found: format!("`{found}`"),
        }
    }
}

/// A finite number within +-`limit`.
fn number(line: usize, name: &str, text: &str, limit: f64) -> Result<f64, RecordingError> {
    text.trim()
        .parse::<f64>()
        .ok()
        .filter(|v| v.abs() <= limit)
        .ok_or_else(|| {
            RecordingError::new(line, format!("{name}, a number within +-{limit}"), text)
        })
}

fn point(position_m: [f64; 3], velocity_mps: f64, intensity_db: f64) -> RadarPoint {
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
