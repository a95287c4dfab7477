//! Points of a room in, points of each person out.
//!
//! What enters are [`radarllm_base::PointFrame`]s, of any radar, simulated or recorded; what leaves are the same
//! points without the empty room ([`background`]), and [`Track`]s: which of them are one person, from when to when.
//!
//! Reading order: [`background`], [`mod@cluster`] (points of a frame that are one body), [`assignment`] (which cluster is
//! whose), [`kalman`] (where somebody should be), [`tracker`] (all of it over time), [`ghosts`] (tracks that are
//! reflections of others).
//!
//! A crate of its own: it knows neither samples (radar-dsp) nor file formats (capture), and its only neighbours are
//! points.

pub mod assignment;
pub mod background;
pub mod cluster;
pub mod ghosts;
pub mod kalman;
pub mod tracker;

pub use background::{BackgroundOptions, PointBackground};
pub use cluster::{Cluster, ClusterOptions, clusters};
pub use ghosts::{Ghost, GhostPath, find_ghosts};
pub use tracker::{Track, TrackFrame, TrackOptions, track};

/// An option that makes no sense.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("option `{field}`: expected {expected}, found {found}")]
pub struct OptionError {
    /// Offending option.
    pub field: &'static str,
    /// What it may be.
    pub expected: &'static str,
    /// What it is.
    pub found: f64,
}

/// Refuses a value outside `low..=high`.
pub(crate) fn within(
    field: &'static str,
    found: f64,
    low: f64,
    high: f64,
    expected: &'static str,
) -> Result<(), OptionError> {
    if (low..=high).contains(&found) {
        Ok(())
    } else {
        Err(OptionError {
            field,
            expected,
            found,
        })
    }
}
