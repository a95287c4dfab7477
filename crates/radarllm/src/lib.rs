//! Millimetre-wave radar to language.
//!
//! A radar in the corner of a room sees a sparse cloud of moving points. This library reads such points, of any radar
//! and any format, and writes what the person is doing:
//!
//! ```
//! let captioner = radarllm::Captioner::bundled()?;
//! let recording = radarllm::open("builtin:walk?direction=backward").points()?;
//! for person in recording.track_people(&Default::default())? {
//!     println!("{}", captioner.describe(&person.clip)?.caption);
//! }
//! # Ok::<(), radarllm::Error>(())
//! ```
//!
//! The input above is simulated, so that the program runs anywhere. For a recording, name its file and the radar:
//!
//! ```no_run
//! # fn main() -> Result<(), radarllm::Error> {
//! let recording = radarllm::open("uart.dat").radar("profile.cfg")?.points()?;
//! # Ok(())
//! # }
//! ```
//!
//! | to do | use |
//! |---|---|
//! | open any recording or motion | [`open`], [`Source`], [`CaptureOptions`] |
//! | simulate a motion or a scene for a radar | [`open_radar`], [`simulate_motion`], [`simulate_cubes`], [`Simulation`] |
//! | raw samples to points | [`SampleRecording`], [`PointExtractor`] |
//! | draw figures and pages | [`render`] |
//! | track people | [`Recording::track_people`], [`track_people`] |
//! | describe a clip | [`Captioner`] |
//! | open a trained model, get tokens, scores of sentences or its card | [`Model`] |
//! | judge a sentence by what was performed | [`Verdict`] |
//! | teach activities by a few recordings | [`teach`], [`Captioner::with_memory`] |
//! | score captions | [`metrics`], [`CaptionScores`] |
//! | build data sets, on one machine or on several | [`DatasetPlan`] |
//! | read data sets | [`dataset`] |
//!
//! Everything is re-exported from the crates below, which can be used alone. Only [`Model`], [`Captioner`] and [`Source`]
//! are types of this crate: they join the model that comes with the library, recordings and the virtual radar. Errors are
//! [`Error`]s with kind, message, hint, path and source. Nothing here prints, keeps global state, parses a command line or chooses an allocator.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

mod board_people;
mod captioner;
mod choose;
mod confidence;
mod falls_by_height;
mod findings;
mod gaps;
mod general;
mod measured;
mod model;
mod page;
mod parts;
mod point_people;
mod score;
mod site_file;
mod source;
mod taught;
mod verdict;

pub use board_people::board_people;
pub use captioner::Captioner;
pub use choose::Choices;
pub use confidence::RecordedConfidence;
pub use findings::LongDescription;
pub use gaps::gaps;
pub use general::is_general;
pub use model::{BundledModel, Fingerprint, Model, ModelFiles, ModelOptions};
pub use page::page_segments;
pub use parts::{Input, LongRecording, Part, Parts};
pub use score::{CaptionScores, FactBlock};
pub use site_file::{read_site, site_to_toml};
pub use source::{DEFAULT_RADAR, Recording, Source, open, open_parts};
pub use taught::insert_taught;
pub use verdict::Verdict;

pub use point_people::{learn_from, learn_site};
pub use radarllm_base::{
    Clip, Clutter, Message, Motion, Piece, PointFrame, Provenance, RadarConfig, RadarCube,
    RadarPoint, Timeline,
};
#[cfg(feature = "parquet")]
pub use radarllm_dataset::{
    Overwrite, PointsWriter, is_points_column, point_columns, points_from_tables, points_to_table,
    table, write_clip, write_points, write_points_with,
};
pub use radarllm_dataset::{PointsFile, PointsMeta, read_points};
pub use radarllm_inference::{
    DescribeOptions, Description, Precision, PrepareOptions, Prepared, PreparedClip, Segment,
    prepare_for_model,
};
pub use radarllm_io::{
    CaptureFormat, CaptureOptions, CleaningOptions, Error, ErrorKind, IqChoice, LayoutOptions,
    OpenedRadar, PointOptions, Result, SampleRecording, TiFirmware, open_radar,
};
pub use radarllm_measure::{Site, SiteError, SiteLearner};
pub use radarllm_radar_dsp::{DspOptions, PointExtractor};
#[cfg(feature = "parquet")]
pub use radarllm_synth::DatasetPlan;
pub use radarllm_synth::{
    MotionInput, Performed, SimulateOptions, SimulatedClip, SimulatedCubes, Simulation,
    open_motion, simulate_cubes, simulate_motion, simulate_motion_until,
};
pub use radarllm_tracking::{PeopleOptions, Person, track_people};

pub use radarllm_dataset as dataset;
pub use radarllm_facts as facts;
pub use radarllm_inference as inference;
pub use radarllm_io as io;
pub use radarllm_measure as measure;
pub use radarllm_metrics as metrics;
pub use radarllm_radar_dsp as radar_dsp;
pub use radarllm_radar_sim as radar_sim;
pub use radarllm_render as render;
pub use radarllm_synth as synth;
pub use radarllm_teach as teach;
pub use radarllm_tracking as tracking;
