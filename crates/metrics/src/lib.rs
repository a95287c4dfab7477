//! Caption metrics with confidence intervals, over plain slices.
//!
//! Enter: candidate and reference sentences with ids. Leave: corpus values in the 0..1 scale
//! (CIDEr in its own, x10 included), each with a 95 % bootstrap interval over motions. Nothing
//! here opens a file.
//!
//! A value is only comparable under the same tokenisation and reference rule, so both travel with
//! it as a [`Protocol`]. What was not computed is null with a reason, never approximated.
//!
//! Reading order: [`mod@score`] (all metrics of a corpus), [`tokens`] and [`mod@ptb`], [`bleu`], [`rouge`], [`cider`],
//! [`meteor`], [`self_bleu`], [`bootstrap`], [`embedding`], then [`floors`] (what a caption system must beat) and [`action`]
//! (do the captions name the right action?). Apart from captions: [`points`] and [`classifier`], how
//! like a recording a simulation is; [`pose`], how far an estimated body is from the true one.
#![forbid(unsafe_code)]

pub mod score;

pub mod ptb;
pub mod tokens;

pub mod bleu;
pub mod cider;
pub mod embedding;
pub mod meteor;
pub mod rouge;
pub mod self_bleu;

pub mod bootstrap;

pub mod action;
pub mod floors;

pub mod classifier;
pub mod points;
pub mod pose;

mod grams;
mod rng;
pub mod stem;
mod wordnet;

pub use action::ActionNamer;
pub use classifier::LogisticRegression;
pub use floors::{NearestNeighbour, majority_caption, shuffled_assignment};
pub use score::{Candidate, Reference, ScoreError, ScoreOptions, Scores, score, score_with};
pub use tokens::Protocol;
