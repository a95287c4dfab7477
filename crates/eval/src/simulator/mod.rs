//! The virtual radar and the body: how similar are simulated and recorded points, and estimated and true bodies?

pub mod classifier;
pub mod points;
pub mod pose;
pub mod pose_report;
pub mod pose_table;
pub mod realism;
