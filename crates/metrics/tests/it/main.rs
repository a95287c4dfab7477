//! Tests of the metrics crate.

mod action;
mod bleu;
mod bootstrap;
mod captions;
mod floors;
mod goldens;
mod meteor;
mod score;
mod tokens;
