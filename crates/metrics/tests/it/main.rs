//! Tests of the metrics crate.

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

mod bleu;
mod bootstrap;
mod captions;
mod embedding;
mod goldens;
mod meteor;
mod score;
mod tokens;
