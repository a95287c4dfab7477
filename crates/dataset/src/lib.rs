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
//!     has_speeds: true,
//! };
//! let point = RadarPoint { y_m: 2.0, range_m: 2.0, intensity_db: 60.0, ..RadarPoint::default() };
//! let frames = [PointFrame { frame: 0, time_s: 0.0, points: vec![point], board: None }];
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
//! The feature `parquet`, on by default, reads and writes files. Without it there are the types alone, and
//! [`read_points`] is an error, so that a program that only simulates and describes is built in half the time.
//!
//! Layout of a data set directory:
//!
//! ```text
//! manifest.json                      what is in it: written last, so its presence means complete
//! README.md                          data set card, generated from the manifest
//! data/train-00000-of-00002.parquet  shards, one row a clip
//! .shards/                           what a build needs to resume: plan, one sidecar a shard, lock
//! ```

#![cfg_attr(test, allow(unreachable_pub, reason = "tests"))]
#![allow(
    clippy::disallowed_methods,
    reason = "a data set is files of its own, whose reading and replacing is described in folder.rs"
)]
#![forbid(unsafe_code)]

mod error;
#[cfg(feature = "parquet")]
mod on_disk;
mod points;
pub mod record;
mod split;
#[cfg(not(feature = "parquet"))]
mod without_parquet;

pub use error::DatasetError;
#[cfg(feature = "parquet")]
pub use on_disk::*;
pub use points::{PointsFile, PointsMeta};
pub use record::{ClipRecord, FailedItem, MOTION_FEATURE_DIM, RECORDINGS, Split};
#[cfg(not(feature = "parquet"))]
pub use without_parquet::{PointsReader, read_points, read_points_from};
