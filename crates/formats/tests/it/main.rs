//! Radar descriptions, captures and recordings from outside.

#![allow(
    clippy::disallowed_methods,
    clippy::panic,
    clippy::print_stdout,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "a test"
)]

mod adc;
mod adc_files;
mod bag;
mod dca1000;
mod hostile_captures;
mod hostile_recordings;
mod lint;
mod made;
mod make;
#[allow(dead_code)]
mod make_ros2;
mod matlab;
#[cfg(feature = "hdf5")]
mod matlab73;
mod ros2;
mod shared_data;
mod studio;
mod tables;
mod ti_dialects;
mod ti_files;
mod ti_lines;
mod uart;
mod uart_kinds;
mod visualizer;
