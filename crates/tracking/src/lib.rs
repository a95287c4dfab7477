//! Tracking: the points of a room in, the points of each person out.
//!
//! [`PointFrame`](radarllm_base::PointFrame)s of any radar enter, simulated or recorded. They leave without the points
//! of the empty scene ([`background`]), and as [`Track`]s: which points belong to one person, from when to when.
//! [`track_people`] does all of it for a clip.
//!
//! Reading order: [`people`] (a clip to one clip per person), [`background`], [`mod@cluster`] (points of a frame that
//! belong to one body), [`assignment`] (clusters to tracks), [`kalman`] (where a track is expected), [`tracker`] (all of
//! it over time), [`ghosts`] (tracks that are multipath reflections of others).
//!
//! Deliberately absent: raw samples (`radarllm-radar-dsp`), file formats (`radarllm-formats`) and any model.

pub mod assignment;
pub mod background;
pub mod cluster;
pub mod ghosts;
pub mod kalman;
pub mod people;
pub mod tracker;

pub use background::{BackgroundOptions, PointBackground};
pub use cluster::{Cluster, ClusterOptions, clusters};
pub use ghosts::{Ghost, GhostPath, find_ghosts};
pub use people::{People, PeopleOptions, Person, find_people, track_people};
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
