//! Tests of the evaluation crate.

mod action;
mod baselines;
mod descriptor;
mod held_out;
mod near_duplicates;
mod realism;
