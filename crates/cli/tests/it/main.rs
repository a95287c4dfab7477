//! Tests of the whole command and of the repository's shape.

mod architecture;
mod bad_input;
mod capture;
mod chain;
mod clean;
mod command;
mod dataset;
mod eval_recordings;
mod geometry;
mod golden;
mod live;
mod live_outside;
#[cfg(feature = "train")]
mod lm;
mod recordings;
mod robustness;
mod score;
mod teach;
mod visualizer;
#[cfg(not(feature = "train"))]
mod without_training;

/// Captures are made as the capture crate's own tests make them.
#[allow(dead_code)]
#[path = "../../../formats/tests/it/made.rs"]
mod made;
