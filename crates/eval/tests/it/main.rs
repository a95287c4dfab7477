//! Tests of the evaluation crate.

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

mod action;
mod baselines;
mod descriptor;
mod held_out;
mod near_duplicates;
mod realism;
