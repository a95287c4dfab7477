//! Shape of the network, and its `config.json`.

use serde::{Deserialize, Serialize};

/// `kind` in the `config.json` of a pose network.
pub const POSE_KIND: &str = "pose";
/// Maximum number of points of a frame; the strongest are kept.
pub const MAX_POINTS: usize = 128;
/// Values of a point: x, y and height above the floor in m, velocity in m/s, intensity relative to the median of the clip in
/// 10 dB, range in m.
pub const POINT_INPUTS: usize = 6;
/// Height of a body whose predicted logarithm of the height is zero, m.
pub const REFERENCE_HEIGHT_M: f32 = 1.72;

/// Shape of the network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PoseConfig {
    /// Factor on all widths; 1 is the published network.
    pub width: usize,
    /// Number of nearest points that are grouped about an anchor; 8 in the published network.
    pub neighbours: usize,
    /// The horizontal translation is relative to the place that the global branch finds, instead of absolute (published).
    pub relative_translation: bool,
    /// Horizontal coordinates are relative to the median of the points about a frame, instead of the radar (published), so
    /// that the network need not learn every place of a room.
    pub centred: bool,
}

impl Default for PoseConfig {
    fn default() -> Self {
        Self::paper()
    }
}

impl PoseConfig {
    /// The published network.
    pub fn paper() -> Self {
        Self {
            width: 1,
            neighbours: 8,
            relative_translation: false,
            centred: false,
        }
    }

    /// The published network with twice the width.
    pub fn wide() -> Self {
        Self {
            width: 2,
            ..Self::paper()
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that cannot be used.
    pub fn validate(&self) -> Result<(), String> {
        for (field, value, max) in [
            ("width", self.width, 16),
            ("neighbours", self.neighbours, MAX_POINTS),
        ] {
            if value == 0 || value > max {
                return Err(format!("{field}: must be in 1..={max}, found {value}"));
            }
        }
        Ok(())
    }
}

/// `config.json` of a pose network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseFile {
    /// [`POSE_KIND`].
    pub kind: String,
    /// Shape.
    pub model: PoseConfig,
    /// Names of the data sets on which the network was trained.
    #[serde(default)]
    pub data: Vec<String>,
    /// How the network was trained, as a record; this field is not read.
    #[serde(default)]
    pub training: serde_json::Value,
}
