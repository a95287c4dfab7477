//! One file or folder per command, with its arguments.

// Builds without training list its commands all the same, and parse their arguments.
#[cfg_attr(not(feature = "train"), allow(dead_code))]
pub mod ablate;
pub mod calibrate;
pub mod dataset;
pub mod demo;
pub mod describe;
pub mod doctor;
#[cfg(feature = "eval")]
pub mod eval;
pub mod generate;
#[cfg(feature = "live")]
pub mod live;
#[cfg_attr(not(feature = "train"), allow(dead_code))]
pub mod lm;
#[cfg(feature = "train")]
pub mod model_scores;
pub mod motion;
pub mod pictures;
#[cfg(feature = "eval")]
pub mod pose_scores;
pub mod process;
pub mod radar;
pub mod score;
pub mod shell;
pub mod simulate;
pub mod teach;
#[cfg_attr(not(feature = "train"), allow(dead_code))]
pub mod train;
pub mod view;
