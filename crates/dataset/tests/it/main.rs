//! Whole-file tests of the data set crate: real files in temporary directories.

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

mod build;
mod export;
mod hostile;
mod kill;
mod points;
mod steps;
mod support;
