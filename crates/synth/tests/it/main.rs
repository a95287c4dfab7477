//! Tests that need the virtual radar and the signal chain together.

#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test")]

mod boards;
mod field_of_view;
mod noise;
mod objects;
mod rates;
mod rooms;
mod simulation;
mod threads;

use std::path::Path;

use radarllm_dataset::{BuildOptions, ClipRecord, Dataset, Overwrite, Split};
use radarllm_synth::{DatasetPlan, config::DatasetConfig};

/// Training clips of the data set that a configuration describes.
fn train_clips(config: &str, threads: usize) -> Vec<ClipRecord> {
    let folder = tempfile::tempdir().unwrap();
    let config = DatasetConfig::from_toml(config).unwrap();
    let options = BuildOptions {
        threads,
        overwrite: Overwrite::Refuse,
        retry_failed: false,
    };
    let plan = DatasetPlan::new(config, Path::new("")).unwrap();
    plan.build(folder.path(), options, |_| (), &|| false)
        .unwrap();
    let dataset = Dataset::open(folder.path()).unwrap();
    dataset.read_split(Split::Train).unwrap()
}
