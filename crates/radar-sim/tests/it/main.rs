//! Whole-simulator tests.

#![allow(clippy::unwrap_used, unreachable_pub, reason = "a test")]

mod bounces;
mod closed_forms;
mod common;
mod cross_sections;
mod fast_against_reference;
mod input;
mod reproducibility;
mod screens;
mod still;
mod visibility;
mod weather;
