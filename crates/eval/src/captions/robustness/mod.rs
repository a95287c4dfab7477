//! Do captions stay right when conditions change? The same motions under noise, distance, rain and other conditions,
//! one change at a time.
//!
//! Every cell shows the same clips with the same bodies, places and noise seeds, so that differences
//! between cells are differences of the condition. A finished cell has a name made from everything that it depends on;
//! callers keep cells under these names and measure only what is missing.
//!
//! Reading order: [`conditions`] (the plan), [`cells`] (one cell), [`mod@report`] (scores, Markdown, curves).

pub mod cells;
pub mod conditions;
pub mod report;

pub use cells::{Cell, Experiment};
pub use conditions::{Axis, Change, Plan};
pub use report::{RobustnessReport, report};
