//! Radar descriptions and recordings from outside.

mod bag;
mod hostile;
mod lint;
mod make;
mod shared_data;
mod ti_files;
mod ti_lines;
mod uart;
