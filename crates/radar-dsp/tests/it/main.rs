//! Checks of the whole chain on cubes evaluated from the signal model.

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

mod calibrate;
mod capon;
mod clutter;
mod correct;
mod detection;
mod geometry;
mod hostile;
mod recorded;
mod reference;
mod synthetic;
