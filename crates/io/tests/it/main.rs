//! Running radars: boards on pseudo-terminals, cards on the loopback network.
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
#![cfg(target_os = "linux")]

mod card;
mod events;
mod fake_board;
#[allow(dead_code)]
#[path = "../../../formats/tests/it/made.rs"]
mod made;
#[path = "../../../formats/tests/it/make_uart.rs"]
mod make_uart;
mod ti_board;
