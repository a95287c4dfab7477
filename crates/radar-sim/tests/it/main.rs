//! Whole-simulator tests.

mod closed_forms;
mod fast_against_reference;
mod input;
mod reproducibility;
