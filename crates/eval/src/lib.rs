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
//! Reading order: [`interval`] (estimates), [`baselines`] with [`mod@descriptor`], [`action`] (action accuracy). The
//! questions lie in four folders:
//!
//! | question | module |
//! |---|---|
//! | [`captions`]: simulated clips | |
//! | How good are the captions of a data set's split? | [`mod@captions`] itself |
//! | Do they stay right under noise, distance, rain? | [`robustness`] |
//! | Does a caption follow its cause? | [`interventions`] |
//! | Does it answer questions in words that no training had? | [`instructions`] |
//! | Which part of the model contributes how much? | [`ablation`] |
//! | Which system describes the same clips best? | [`comparison`] |
//! | Does a model describe what it generated from a sentence? | [`mod@round_trip`] |
//! | How similar are captions and references to a sentence encoder? | [`embedding_scores`] |
//! | [`field`]: recordings, and a radar that runs | |
//! | Do captions of recorded radar name the activity? | [`recordings`] |
//! | Are they right on boards that nothing was learned from? | [`boards`] |
//! | What do supervised classifiers reach on RadHAR, without the leak between windows? | [`radhar`] |
//! | Would a network learn it from these clips? | [`proxy`], with [`features`] and [`forest`] |
//! | Does a running radar notice falls, and how often is it wrong? | [`falls`] |
//! | [`data`]: data sets | |
//! | Are test motions in the training split? | [`held_out`], [`near_duplicates`] |
//! | [`simulator`]: the virtual radar and the body | |
//! | How similar are simulated and recorded points? | [`realism`], [`points`], [`classifier`] |
//! | How far is an estimated body from the true one? | [`pose_report`], [`pose_table`], [`mod@pose`] |
//!
//! Deliberately absent: flags, printing, plots, the opening of recordings, and any learning framework. Nothing here writes
//! a file. Caption metrics are in `radarllm-metrics`.
#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]
#![forbid(unsafe_code)]

pub mod captions;
pub mod data;
pub mod field;
pub mod interval;
pub mod simulator;

mod captioner;
mod error;
mod table;

pub use captions::{
    ablation, action, baselines, comparison, descriptor, embedding_scores, floors, instructions,
    interventions, robustness, round_trip,
};
pub use data::{held_out, near_duplicates};
pub use field::{boards, falls, features, forest, proxy, radhar, recordings};
pub use simulator::{classifier, points, pose, pose_report, pose_table, realism};

pub use action::ActionClassifier;
pub use captioner::ModelInfo;
pub use error::EvalError;
pub use interval::Estimate;
pub use table::Table;
