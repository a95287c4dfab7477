//! Caption metrics with confidence intervals, over plain slices.
//!
//! Inputs are candidate and reference sentences with ids. Outputs are corpus values on the 0..1 scale
//! (CIDEr on its own scale, x10 included), each with a 95 % bootstrap interval over motions. This
//! crate opens no files.
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
//! BLEU statistics are counted per sentence and summed before the value is computed, as for corpus values in papers:
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
//! Values are only comparable under the same tokenisation and reference rule, so both are reported with
//! the value as a [`Protocol`]. A metric that was not computed is null with a reason, never approximated.
//!
//! Reading order: [`mod@score`] (all metrics of a corpus), [`tokens`] and [`mod@ptb`], [`bleu`], [`rouge`], [`cider`],
//! [`meteor`], [`self_bleu`], [`variety`], [`bootstrap`], [`embedding`], [`dtw`] (series, for retrieval), [`dense`] (sentences with times). Baselines, action accuracy and metrics that do not concern
//! captions are in `radarllm-eval`.
#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]
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
pub mod variety;

pub mod bootstrap;
pub mod dense;
pub mod dtw;

mod grams;
pub mod stem;
mod wordnet;

pub use score::{Candidate, Reference, ScoreError, ScoreOptions, Scores, score, score_with};
pub use tokens::Protocol;
