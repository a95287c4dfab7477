//! Points files and data sets in Parquet: what the feature `parquet` adds.

pub mod points_file;
pub mod shard;
pub mod table;

mod board_columns;
pub mod builder;
pub mod dataset;
pub mod export;
pub mod info;
pub mod manifest;
pub mod validate;

mod atomic;
mod card;
mod check;
mod file_system;
mod folder;
mod guard;
mod index;
mod levels;
mod plan;
mod work;

pub use builder::{
    BuildOptions, BuildPlan, BuildReport, Builder, BuiltShards, ItemId, Progress, build,
};
pub use check::check_record;
pub use dataset::{BatchIter, ClipIter, Dataset};
pub use export::export;
pub use index::PreparedPlan;
pub use info::Info;
pub use manifest::{Manifest, ShardEntry, SourceLicence};
pub use points_file::{
    PointsReader, PointsWriter, is_points_column, point_columns, points_from_tables,
    points_to_table, read_points, read_points_from, write_clip, write_points, write_points_with,
};
pub use shard::Columns;
pub use table::{Column, Table};
pub use validate::{Problem, validate, validate_with};

/// What to do if the output exists.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overwrite {
    /// Fail with [`crate::DatasetError::Exists`].
    Refuse,
    /// Replace it, atomically.
    Replace,
}
