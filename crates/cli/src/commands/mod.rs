//! One file or folder per command, with its arguments.

// Builds without training list its commands all the same, and parse their arguments.
#[cfg_attr(not(feature = "train"), allow(dead_code))]
pub(crate) mod ablate;
#[cfg(feature = "eval")]
#[cfg_attr(not(feature = "train"), allow(dead_code))]
pub(crate) mod baselines;
pub(crate) mod calibrate;
pub(crate) mod dataset;
pub(crate) mod demo;
pub(crate) mod describe;
pub(crate) mod doctor;
#[cfg(feature = "eval")]
pub(crate) mod eval;
pub(crate) mod generate;
#[cfg(feature = "live")]
pub(crate) mod live;
#[cfg_attr(not(feature = "train"), allow(dead_code))]
pub(crate) mod lm;
#[cfg(feature = "train")]
pub(crate) mod model_scores;
pub(crate) mod motion;
pub(crate) mod pictures;
#[cfg(feature = "eval")]
pub(crate) mod pose_scores;
pub(crate) mod process;
pub(crate) mod radar;
#[cfg(feature = "eval")]
#[cfg_attr(not(feature = "train"), allow(dead_code))]
pub(crate) mod reproduce;
pub(crate) mod score;
pub(crate) mod shell;
pub(crate) mod simulate;
pub(crate) mod site;
pub(crate) mod teach;
#[cfg_attr(not(feature = "train"), allow(dead_code))]
pub(crate) mod train;
#[cfg(feature = "train")]
pub(crate) mod trainings;
pub(crate) mod view;
