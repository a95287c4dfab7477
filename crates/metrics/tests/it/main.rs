//! Tests of the metrics crate.

mod action;
mod bleu;
mod bootstrap;
mod captions;
mod embedding;
mod floors;
mod goldens;
mod meteor;
mod score;
mod tokens;
