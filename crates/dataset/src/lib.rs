//! Radar-text data sets on disk: Parquet schema, shards, manifest, validation.
//!
//! Inputs are [`ClipRecord`]s (from simulation or recordings) and point clouds. Outputs are the same types, read
//! from files whose hashes, shapes and values were checked. This crate is the only one that defines
//! the columns. It does not depend on how a clip is made or what is trained on it.
//!
//! ```
//! use radarllm_base::{PointFrame, RadarPoint};
//! use radarllm_dataset::{Overwrite, PointsMeta, read_points, write_points};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("walk.parquet");
//! let meta = PointsMeta {
//!     radar: "awr1843boost".into(),
//!     source: "recorded:dca1000".into(),
//!     seed: None,
//!     version: "0.1.0".into(),
//!     radar_height_m: Some(1.0),
//!     frame_rate_hz: 10.0,
//! };
//! let point = RadarPoint { y_m: 2.0, range_m: 2.0, intensity_db: 60.0, ..RadarPoint::default() };
//! let frames = [PointFrame { frame: 0, time_s: 0.0, points: vec![point] }];
//! write_points(&path, &meta, &frames, Overwrite::Refuse)?;
//! assert_eq!(read_points(&path)?.frames, frames);
//! // An existing file is only replaced on request.
//! assert!(write_points(&path, &meta, &frames, Overwrite::Refuse).is_err());
//! # Ok(())
//! # }
//! ```
//!
//! Reading order: [`record`] (one clip), [`points_file`] (one recording's points), [`shard`] (the
//! columns of the archive), [`builder`] (resumable building by one or more processes), [`dataset`] (reading),
//! [`info`], [`mod@validate`], [`mod@export`] (a copy for the Hugging Face Hub).
//!
//! Layout of a data set directory:
//!
//! ```text
//! manifest.json                      what is in it: written last, so its presence means complete
//! README.md                          data set card, generated from the manifest
//! data/train-00000-of-00002.parquet  shards, one row a clip
//! .shards/                           what a build needs to resume: plan, one sidecar a shard, lock
//! ```
#![forbid(unsafe_code)]

pub mod record;

pub mod points_file;
pub mod shard;

pub mod builder;
pub mod dataset;
pub mod export;
pub mod info;
pub mod manifest;
pub mod validate;

mod atomic;
mod card;
mod check;
mod error;
mod file_system;
mod folder;
mod guard;
mod plan;
mod split;
mod work;

pub use builder::{
    BuildOptions, BuildPlan, BuildReport, Builder, BuiltShards, ItemId, Progress, build,
};
pub use check::check_record;
pub use dataset::{BatchIter, ClipIter, Dataset};
pub use error::DatasetError;
pub use export::export;
pub use info::Info;
pub use manifest::{FailedItem, Manifest, ShardEntry, SourceLicence};
pub use points_file::{
    PointsFile, PointsMeta, points_from_batches, points_to_batch, read_points, write_clip,
    write_points,
};
pub use record::{ClipRecord, MOTION_FEATURE_DIM, RECORDINGS, Split};
pub use shard::Columns;
pub use validate::{Problem, validate, validate_with};

/// What to do if the output exists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overwrite {
    /// Fail with [`DatasetError::Exists`].
    Refuse,
    /// Replace it, atomically.
    Replace,
}
