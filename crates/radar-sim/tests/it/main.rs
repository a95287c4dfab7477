//! Whole-simulator tests.

mod bounces;
mod closed_forms;
mod fast_against_reference;
mod input;
mod reproducibility;
