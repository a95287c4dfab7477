//! Radar descriptions from outside.

mod lint;
mod ti_files;
mod ti_lines;
