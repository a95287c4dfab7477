//! Points of one recording or simulation in memory, as a points file holds them.

use radarllm_base::{Clip, PointFrame, Provenance};

/// Properties of a whole points file, stored as key-value metadata under the field names.
#[derive(Clone, Debug, PartialEq)]
pub struct PointsMeta {
    /// Radar name; `unknown` if the file does not specify it.
    pub radar: String,
    /// Where the points came from, for example `simulated:builtin:walk` or `recorded:dca1000`.
    pub source: String,
    /// Seed of the simulation; `None` for recordings.
    pub seed: Option<u64>,
    /// Version of the program that generated the points.
    pub version: String,
    /// Height of the radar above the floor, m, if known.
    pub radar_height_m: Option<f32>,
    /// Frames per second (metadata key `frame_rate`); finite and positive.
    pub frame_rate_hz: f64,
    /// Whether the speeds of the points are known ([`Clip::has_speeds`]); files that do not say that they are not have them.
    pub has_speeds: bool,
}

impl PointsMeta {
    /// The metadata of a clip, with the version of this library.
    pub fn of(clip: &Clip) -> Self {
        Self {
            radar: clip.radar.clone(),
            source: clip.provenance.to_string(),
            seed: clip.provenance.seed(),
            version: env!("CARGO_PKG_VERSION").into(),
            radar_height_m: (!clip.is_height_assumed).then_some(clip.radar_height_m),
            frame_rate_hz: clip.frame_rate_hz,
            has_speeds: clip.has_speeds(),
        }
    }

    /// Whether frames of this source can have a report of their board
    /// ([`BoardReport`](radarllm_base::BoardReport)): it was recorded in a format that has them.
    pub fn board_can_report(&self) -> bool {
        let Ok(provenance) = self.source.parse::<Provenance>();
        match provenance {
            Provenance::Recorded { format, .. } => {
                format.is_some_and(|format| FORMATS_WITH_REPORTS.contains(&format.as_str()))
            }
            _ => false,
        }
    }
}

/// Names of the formats in which the firmware of a board states more than points.
const FORMATS_WITH_REPORTS: [&str; 3] = ["uart", "visualizer-json", "track-csv"];

/// A points file in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct PointsFile {
    /// Provenance and timing.
    pub meta: PointsMeta,
    /// Frames in order. Frames in which nothing was detected are present and empty; frames that
    /// the recording lost are absent.
    pub frames: Vec<PointFrame>,
}
