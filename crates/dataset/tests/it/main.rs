//! Whole-file tests of the data set crate: real files in temporary directories.

#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
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
