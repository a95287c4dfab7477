//! Tests of the metrics crate.

mod bleu;
mod bootstrap;
mod captions;
mod embedding;
mod goldens;
mod meteor;
mod score;
mod tokens;
