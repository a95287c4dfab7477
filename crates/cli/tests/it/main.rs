//! Tests of the whole command and of the repository's shape.

mod architecture;
mod bad_input;
mod capture;
mod chain;
mod command;
mod geometry;
mod lm;
mod recordings;
mod robustness;
mod score;

/// Captures are made as the capture crate's own tests make them.
#[allow(dead_code)]
#[path = "../../../capture/tests/it/made.rs"]
mod made;
