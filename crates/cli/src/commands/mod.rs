//! One file a verb.

pub mod dataset;
pub mod demo;
pub mod describe;
pub mod doctor;
pub mod edits;
pub mod eval;
pub mod motion;
pub mod pictures;
pub mod process;
pub mod radar;
pub mod realism;
pub mod score;
pub mod simulate;
pub mod train;
pub mod view;
