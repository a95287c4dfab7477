//! Tests that need the virtual radar and the signal chain together.

mod field_of_view;
mod leakage;
mod noise;
mod realism;
mod rooms;
