//! Tests of the metrics crate.

mod action;
mod bootstrap;
mod floors;
mod goldens;
mod score;
