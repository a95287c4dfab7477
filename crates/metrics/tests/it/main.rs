//! Tests of the metrics crate.

#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
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
