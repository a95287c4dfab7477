//! Tests of the whole command and of the repository's shape.

mod architecture;
mod bad_input;
mod chain;
mod command;
mod geometry;
mod lm;
mod recordings;
