//! Generates radar-text records from motions, by combining the body model, the virtual radar and the signal chain.
//!
//! Scenes and data sets are described in TOML. Every table has a type in this crate, and unknown keys are errors:
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
//! The same seed generates the same data set, independently of the number of threads:
//!
//! ```
//! use radarllm_synth::corpus::{Corpus, procedural::{ProceduralConfig, ProceduralCorpus}};
//!
//! let config = ProceduralConfig { train: 2, ..Default::default() };
//! let [a, b] = [ProceduralCorpus::new(&config, 5)?, ProceduralCorpus::new(&config, 5)?];
//! assert_eq!(a.items()[1].captions, b.items()[1].captions);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Reading order: [`placement`] (position of the person), [`synthesizer`] (a motion to points), [`simulate`] and
//! [`simulation`] (a motion file, a built-in motion or a scene file to a clip or to samples), [`corpus`] (captioned motions), [`config`] (the data set's TOML),
//! [`impairments`], [`weather`], [`processing`] and [`room`] (its tables for receiver impairments, weather, the signal
//! chain and walls), [`record`] (one pure function `(motion, seed) -> ClipRecord`), [`build`] (a complete data set);
//! [`mod@scene`] (scene files) with `obj` (meshes).
//!
//! This crate contains no models, and it never silently substitutes missing input.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

#[cfg(feature = "parquet")]
mod arithmetic;
#[cfg(feature = "parquet")]
pub mod build;
pub mod config;
pub mod corpus;
pub mod impairments;
mod obj;
pub mod objects;
pub mod placement;
pub mod processing;
pub mod record;
pub mod room;
pub mod scene;
pub mod simulate;
pub mod simulation;
pub mod synthesizer;
pub mod weather;

#[cfg(feature = "parquet")]
pub use build::DatasetPlan;
pub use simulate::{
    MotionInfo, MotionInput, SimulateOptions, SimulatedClip, SimulatedCubes, open_motion,
    simulate_cubes, simulate_motion, simulate_motion_until,
};
pub use simulation::{Performed, Simulation};
pub use synthesizer::{Method, SynthError, Synthesizer};
