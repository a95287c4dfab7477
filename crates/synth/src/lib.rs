//! Motion in, radar-text records out: the place where body, virtual radar and signal chain meet.
//!
//! Scenes and data sets are described in TOML; every table has a type here, and unknown keys are refused:
//!
//! ```
//! use std::path::Path;
//! use radarllm_synth::{processing::ProcessingFile, synthesizer::open_radar};
//!
//! let radar = open_radar("awr1843boost", Path::new("."))?;
//! let file = ProcessingFile::from_toml("[processing]\npreset = \"mmmesh\"\nmax_points = 64")?;
//! assert_eq!(file.resolve(&radar).max_points, 64);
//! assert!(ProcessingFile::from_toml("[processing]\nmax_point = 64").is_err());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The same seed draws the same data set, whatever the number of threads:
//!
//! ```
//! use radarllm_synth::corpus::{Corpus, procedural::ProceduralCorpus};
//!
//! let [a, b] = [0, 1].map(|_| ProceduralCorpus::new([2, 0, 0], 5));
//! assert_eq!(a.items()[1].captions, b.items()[1].captions);
//! ```
//!
//! Reading order: [`placement`] (where a person stands), [`synthesizer`] (one motion to points), [`simulate`] (a motion that somebody names to a clip),
//! [`corpus`] (captioned motions), [`config`] (the data set's TOML), [`impairments`],
//! [`weather`], [`processing`] and [`room`] (its tables of receiver faults, of the air, of the signal chain
//! and of walls), [`record`] (one pure function `(motion, seed) -> ClipRecord`), [`build`] (a whole data
//! set); [`mod@scene`] (scene files) with `obj` (meshes).
//!
//! Deliberately absent: anything of the models, and any silent substitute for missing input.

pub mod build;
pub mod config;
pub mod corpus;
pub mod impairments;
mod obj;
pub mod placement;
pub mod processing;
pub mod record;
pub mod room;
pub mod scene;
pub mod simulate;
pub mod synthesizer;
pub mod weather;

pub use simulate::{
    MotionInfo, MotionInput, SimulateOptions, SimulatedClip, open_motion, simulate_motion,
};
pub use synthesizer::{Method, SynthError, Synthesizer};
