//! Tests of the whole command and of the repository's shape.

#![allow(
    clippy::disallowed_methods,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stderr,
    clippy::print_stdout,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "a test"
)]

mod architecture;
mod bad_input;
#[cfg(feature = "train")]
mod baselines;
mod boards;
mod capture;
mod chain;
mod clean;
mod command;
mod dataset;
mod eval_recordings;
mod geometry;
mod golden;
mod headline;
mod keywords;
mod links;
mod live;
mod live_outside;
#[cfg(target_os = "linux")]
mod live_radars;
#[cfg(feature = "train")]
mod lm;
mod recordings;
mod robustness;
mod score;
mod teach;
mod verbs;
mod video_models;
mod visualizer;
#[cfg(not(feature = "train"))]
mod without_training;
mod words;

/// Boards on pseudo-terminals, and a broker, are those of the tests of their crates.
#[cfg(target_os = "linux")]
#[allow(dead_code)]
#[path = "../../../live/src/mqtt/tests/broker.rs"]
mod broker;
#[cfg(target_os = "linux")]
#[allow(dead_code)]
#[path = "../../../io/tests/it/events.rs"]
mod events;
#[cfg(target_os = "linux")]
#[allow(dead_code)]
#[path = "../../../io/tests/it/fake_board.rs"]
mod fake_board;
#[cfg(target_os = "linux")]
#[allow(dead_code)]
#[path = "../../../formats/tests/it/make_uart.rs"]
mod make_uart;

/// Captures are made as the capture crate's own tests make them.
#[allow(dead_code)]
#[path = "../../../formats/tests/it/made.rs"]
mod made;
