//! Whole-file tests of the data set crate: real files in temporary directories.

mod build;
mod export;
mod hostile;
mod kill;
mod points;
mod steps;
mod support;
