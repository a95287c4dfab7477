//! Questions asked of a model or of the simulator, answered with numbers, counts and intervals.
//!
//! Is a model better than a baseline? How often do its captions name the right action? Does it still work behind a
//! curtain? Is the simulated radar similar to a recorded one? Are the test motions really unseen? Every answer is a
//! plain struct (a report) that can be serialised, most of them also have a text form in Markdown.
//!
//! ```
//! use radarllm_eval::{ActionClassifier, Estimate, baselines::majority_caption};
//!
//! let training = [
//!     ("a person walks forward", "walk"),
//!     ("a person walks slowly", "walk"),
//!     ("a person sits down", "sit_down"),
//! ];
//! let classifier = ActionClassifier::fit(&training).unwrap();
//! // Captions of a model for four test clips, and what was done in them.
//! let captions = ["a person walks", "someone sits down", "a person walks", "a person sits"];
//! let actions = ["walk", "sit_down", "sit_down", "sit_down"];
//! let accuracy = |captions: &[&str]| {
//!     let correct = |(c, a): (&&str, &&str)| f64::from(u8::from(classifier.classify(c) == Some(*a)));
//!     let correct: Vec<f64> = captions.iter().zip(&actions).map(correct).collect();
//!     Estimate::of_mean(&correct, &[0, 1, 2, 3], 1).unwrap()
//! };
//! // The baseline answers every clip with the most frequent training caption.
//! let majority = majority_caption(&training.map(|(caption, _)| caption)).unwrap();
//! assert_eq!(accuracy(&captions).value, 0.75);
//! assert_eq!(accuracy(&[majority; 4]).value, 0.25);
//! ```
//!
//! Reading order: [`interval`] (estimates), [`baselines`] with [`mod@descriptor`], [`action`] (action accuracy).
//!
//! | question | module |
//! |---|---|
//! | How good are the captions of a data set's split? | [`captions`] |
//! | Do they stay right under noise, distance, rain? | [`robustness`] |
//! | Does a caption follow its cause? | [`interventions`] |
//! | Do captions of recorded radar name the activity? | [`recordings`] |
//! | Does a running radar notice falls, and how often is it wrong? | [`falls`] |
//! | Which part of the model contributes how much? | [`ablation`] |
//! | Does a model describe what it generated from a sentence? | [`mod@round_trip`] |
//! | How similar are captions and references to a sentence encoder? | [`embedding_scores`] |
//! | Are test motions in the training split? | [`held_out`], [`near_duplicates`] |
//! | How similar are simulated and recorded points? | [`realism`], [`points`], [`classifier`] |
//! | How far is an estimated body from the true one? | [`pose_report`], [`mod@pose`] |
//!
//! Deliberately absent: flags, printing, plots, the opening of recordings, and any learning framework. Nothing here writes
//! a file. Caption metrics are in `radarllm-metrics`.
#![forbid(unsafe_code)]

pub mod interval;

pub mod action;
pub mod baselines;
pub mod descriptor;

pub mod ablation;
mod captioner;
pub mod captions;
pub mod embedding_scores;
pub mod falls;
pub mod interventions;
pub mod proxy;
pub mod recordings;
pub mod robustness;
pub mod round_trip;

pub mod held_out;
pub mod near_duplicates;

pub mod classifier;
pub mod forest;
pub mod points;
pub mod realism;

pub mod pose;
pub mod pose_report;

mod error;
mod table;

pub use action::ActionClassifier;
pub use captioner::ModelInfo;
pub use error::EvalError;
pub use interval::Estimate;
pub use table::Table;
