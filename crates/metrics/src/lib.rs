//! Caption metrics with confidence intervals, over plain slices.
//!
//! Enter: candidate and reference sentences with ids. Leave: corpus values in the 0..1 scale
//! (CIDEr in its own, x10 included), each with a 95 % bootstrap interval over motions. Nothing
//! here opens a file.
//!
//! ```
//! use radarllm_metrics::{rouge::rouge_l, tokens};
//!
//! let reference = tokens::rouge_score("a person walks to the left");
//! let found = tokens::rouge_score("A person walks slowly to the left.");
//! // Six common words in order, of seven and of six: F1 = 2 * 6 / (7 + 6).
//! let value = rouge_l(&found, &[reference]);
//! assert!((value - 12.0 / 13.0).abs() < 1e-12, "{value}");
//! ```
//!
//! BLEU is counted per sentence and summed before it is a number, as the corpus values in papers are:
//!
//! ```
//! use radarllm_metrics::{bleu, tokens};
//!
//! let reference = tokens::plain("a person walks to the left");
//! let found = tokens::plain("a person walks to the right");
//! let [bleu_1, .., bleu_4] = bleu::stats(&found, &[reference]).bleu();
//! // Five of six words; of the n-grams 4/5, 3/4 and 2/3.
//! assert!((bleu_1 - 5.0 / 6.0).abs() < 1e-6);
//! assert!((bleu_4 - (5.0 / 6.0 * 0.8 * 0.75 * 2.0 / 3.0_f64).powf(0.25)).abs() < 1e-6);
//! ```
//!
//! A value is only comparable under the same tokenisation and reference rule, so both travel with
//! it as a [`Protocol`]. What was not computed is null with a reason, never approximated.
//!
//! Reading order: [`mod@score`] (all metrics of a corpus), [`tokens`] and [`mod@ptb`], [`bleu`], [`rouge`], [`cider`],
//! [`meteor`], [`self_bleu`], [`bootstrap`], [`embedding`]. Baselines, action accuracy and what is not about captions are
//! in `radarllm-eval`.
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

mod grams;
pub mod stem;
mod wordnet;

pub use score::{Candidate, Reference, ScoreError, ScoreOptions, Scores, score, score_with};
pub use tokens::Protocol;
