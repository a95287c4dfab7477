//! Running radars: boards on pseudo-terminals, cards on the loopback network. Recordings: folders and tables.
#![allow(
    clippy::disallowed_methods,
    clippy::panic,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "a test"
)]
#![cfg(target_os = "linux")]

mod card;
mod chirp_files;
mod events;
mod fake_board;
#[allow(dead_code)]
#[path = "../../../formats/tests/it/made.rs"]
mod made;
#[path = "../../../formats/tests/it/make_uart.rs"]
mod make_uart;
mod tables;
mod ti_board;
mod uart_streams;
mod visualizer;
