//! Whole-simulator tests.

#![allow(
    clippy::disallowed_methods,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stderr,
    clippy::print_stdout,
    clippy::unwrap_used,
    missing_docs,
    unreachable_pub,
    reason = "a test"
)]

mod bounces;
mod closed_forms;
mod common;
mod cross_sections;
mod fast_against_reference;
mod input;
mod reproducibility;
mod screens;
mod visibility;
mod weather;
