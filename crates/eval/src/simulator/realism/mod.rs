//! How similar the virtual radar is to a recording: recorded joints move the simulated body, the simulator uses the
//! settings of the recording radar, and the simulated points are compared with the recorded ones.
//!
//! [`mars`] reads recordings with joints, [`pairs`] a user's own with scenes, [`mod@replay`] simulates
//! them, [`mod@compare`] compares both, [`activities`] does so where only the activity is known, [`mod@calibrate`]
//! estimates values of the configuration ([`RealismConfig`]) from recordings, [`report`] writes the tables: see
//! docs/results/realism.md.
//!
//! Simulations run on the threads of the rayon pool from which they are called, with the same bytes for any number of
//! threads.

pub mod activities;
pub mod calibrate;
pub mod compare;
pub mod mars;
pub mod pairs;
pub mod replay;
pub mod report;

use std::path::Path;

use glam::Vec3;
use radarllm_base::{PointFrame, skeleton::N_JOINTS};
use radarllm_body::{MotionError, loaders::MAX_FILE_BYTES};
use radarllm_files::bounded;
use radarllm_radar_sim::SimOptions;
use radarllm_synth::{
    SynthError, impairments::ImpairmentsFile, processing::ProcessingFile, scene::OwnedScene,
};
use serde::{Deserialize, Serialize};

use activities::Activities;

pub use activities::{ActivityReport, compare_activities};
pub use calibrate::calibrate;
pub use compare::{RealismReport, compare};
pub use replay::replay;

/// Why recordings and simulation cannot be compared.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RealismError {
    /// A file of the recording is unreadable or malformed.
    #[error("{file}: {problem}")]
    File {
        /// File.
        file: String,
        /// What is wrong.
        problem: String,
    },
    /// Nothing to calibrate on.
    #[error("no points within crop_m: nothing to compare")]
    NoPoints,
    /// Joints that cannot be performed.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// The chain refused.
    #[error("{0}")]
    Synth(#[from] SynthError),
}

impl RealismError {
    fn io(path: &Path, error: &std::io::Error) -> Self {
        Self::File {
            file: path.display().to_string(),
            problem: error.to_string(),
        }
    }
}

/// A text file of a recording, capped like motion files.
fn read_text(path: &Path) -> Result<String, RealismError> {
    bounded::read_text(path, MAX_FILE_BYTES).map_err(|e| RealismError::io(path, &e.into_io()))
}

/// A piece of recording without interruption.
pub struct Take {
    /// Who moves.
    pub subject: String,
    /// Part of the data set.
    pub part: String,
    /// What is done, by the data set's numbering from 0.
    pub class: usize,
    /// Recorded points; `frame` counts frame periods from the start of the driver.
    pub frames: Vec<PointFrame>,
    /// What moved.
    pub driver: Driver,
}

/// What drives the simulation of a take.
pub enum Driver {
    /// Joints at every frame period, in the recording's axes (the radar's, but for the origin), m.
    Joints(Vec<[Vec3; N_JOINTS]>),
    /// A scene that says what happened, and the simulator's options for it.
    Scene(Box<OwnedScene>, SimOptions),
}

/// The TOML file of `realism`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RealismConfig {
    /// The radar that recorded: built-in name, or a `.toml` or `.cfg` file.
    pub radar: String,
    /// Seed of noise and impairments.
    pub seed: u64,
    /// Points outside are left out on both sides, as the data set's own cleaning did: smallest and
    /// largest x, y, z, m.
    pub crop_m: [[f32; 2]; 3],
    /// Longest facet edge of the body, m.
    pub facet_edge_m: f32,
    /// Most surfaces on a path, 1..=4.
    pub max_bounces: usize,
    /// Static clutter in front of the body and what it does to the receiver; none without it.
    pub impairments: ImpairmentsFile,
    /// The recording radar's signal chain.
    pub processing: ProcessingFile,
    /// For recordings without joints: what was done.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub activities: Option<Activities>,
    /// Where the joints' origin lies in the radar's axes, m: the two sensors never sit in one place.
    pub joints_origin_m: [f32; 3],
    /// Rms speed of the standing body's sway, m/s, which joints of a camera do not show: without it a
    /// person at rest vanishes with the static clutter. Quiet standing has about 0.01 (centre of
    /// pressure; see docs/results/realism.md).
    pub sway_mps: f32,
    /// Added to z / range of the simulated points: what a phase difference between the rows of an
    /// uncalibrated board does.
    pub elevation_bias: f64,
    /// Frames a window of the classifier.
    pub window_frames: usize,
    /// Frames from one window to the next.
    pub window_stride: usize,
}

impl Default for RealismConfig {
    fn default() -> Self {
        Self {
            radar: "iwr1443boost".into(),
            seed: 1,
            crop_m: [[-1.0, 1.0], [0.0, 3.0], [-1.0, 1.0]],
            facet_edge_m: 0.02,
            max_bounces: 1,
            impairments: ImpairmentsFile::default(),
            processing: ProcessingFile::default(),
            activities: None,
            joints_origin_m: [0.0; 3],
            sway_mps: 0.0,
            elevation_bias: 0.0,
            window_frames: 20,
            window_stride: 5,
        }
    }
}

impl RealismConfig {
    /// Reads a configuration.
    ///
    /// # Errors
    /// TOML errors with their place; values out of range with their name.
    pub fn from_toml(text: &str) -> Result<Self, SynthError> {
        let config: Self = toml::from_str(text).map_err(|e| SynthError::Config(e.to_string()))?;
        let fail = |problem: String| Err(SynthError::Config(problem));
        for (name, value) in [
            ("window_frames", config.window_frames),
            ("window_stride", config.window_stride),
        ] {
            if !(1..=1000).contains(&value) {
                return fail(format!("{name}: must be in 1..=1000, found {value}"));
            }
        }
        if !(0.008..=0.05).contains(&config.facet_edge_m) {
            return fail(format!(
                "facet_edge_m: must be in 0.008..=0.05, found {}",
                config.facet_edge_m
            ));
        }
        for [low, high] in config.crop_m {
            if !(low.is_finite() && high.is_finite() && low < high) {
                return fail(format!("crop_m: [{low}, {high}] is not [low, high]"));
            }
        }
        let lengths = config.joints_origin_m.map(f64::from);
        let others = [config.elevation_bias, f64::from(config.sway_mps)];
        for value in lengths.into_iter().chain(others) {
            if !(-10.0..=10.0).contains(&value) {
                return fail(format!(
                    "joints_origin_m, elevation_bias and sway_mps: must be within +-10, found {value}"
                ));
            }
        }
        if let Some(table) = &config.activities {
            let n = table.activity.len();
            if n < 2 || table.activity.iter().any(|a| a.motions.is_empty()) {
                return fail(format!(
                    "[activities]: needs two and more [[activities.activity]] with motions, found {n}"
                ));
            }
            if !(2..=10_000).contains(&table.clips) {
                return fail(format!(
                    "[activities] clips: must be in 2..=10000, found {}",
                    table.clips
                ));
            }
            let values = [
                table.distance_m[0],
                table.distance_m[1],
                table.lateral_m,
                table.heading_deg,
                table.radar_height_m,
                table.slowest_mps,
            ];
            if values.iter().any(|v| !(0.0..=360.0).contains(v)) {
                return fail(format!(
                    "[activities]: distances, heading and speed must be in 0..=360, found {values:?}"
                ));
            }
        }
        config.impairments.resolve().map_err(SynthError::Config)?;
        Ok(config)
    }

    /// The configuration as a file.
    ///
    /// # Errors
    /// None in practice: every field has a TOML form.
    pub fn to_toml(&self) -> Result<String, SynthError> {
        toml::to_string(self).map_err(|e| SynthError::Config(e.to_string()))
    }

    /// Leaves out points beyond the crop.
    fn crop(&self, frame: &mut PointFrame) {
        frame.points.retain(|p| {
            [p.x_m, p.y_m, p.z_m]
                .iter()
                .zip(self.crop_m)
                .all(|(v, [low, high])| (low..=high).contains(v))
        });
    }
}
