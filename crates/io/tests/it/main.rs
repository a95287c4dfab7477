//! Running radars: boards on pseudo-terminals, cards on the loopback network. Recordings: folders, tables and ROS 2 bags.
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
mod compressed;
mod events;
mod fake_board;
#[allow(dead_code)]
#[path = "../../../formats/tests/it/made.rs"]
mod made;
#[cfg(feature = "ros2")]
#[path = "../../../formats/tests/it/make_ros2.rs"]
mod make_ros2;
#[path = "../../../formats/tests/it/make_uart.rs"]
mod make_uart;
mod ros2;
mod tables;
mod ti_board;
mod uart_streams;
mod visualizer;
