//! Radar descriptions from outside.

mod ti_files;
mod ti_lines;
