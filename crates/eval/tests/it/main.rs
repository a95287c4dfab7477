//! Tests of the evaluation crate.

#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test")]

mod action;
mod baselines;
mod descriptor;
mod held_out;
mod near_duplicates;
mod radhar;
mod realism;
