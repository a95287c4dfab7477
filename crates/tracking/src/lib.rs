//! Multi-target tracking: takes the points of a room and returns the points of each person.
//!
//! The input is [`PointFrame`](radarllm_base::PointFrame)s of any radar, simulated or recorded. The points of the empty
//! scene are removed ([`background`]). The output is [`Track`]s: which points belong to one person, and from which
//! frame to which. [`track_people`] performs all steps for a clip; [`Tracker`] takes one frame after the other.
//!
//! Reading order: [`people`] (a clip to one clip per person), [`background`], [`mod@cluster`] (points of a frame that
//! belong to one body), [`assignment`] (data association: clusters to tracks), [`kalman`] (prediction of a track's
//! position), [`tracker`] (the steps combined over time), [`ghosts`] (tracks that are multipath reflections of others).
//!
//! Out of scope: raw samples (`radarllm-radar-dsp`), file formats (`radarllm-formats`) and models.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

pub mod assignment;
pub mod background;
pub mod cluster;
pub mod ghosts;
pub mod kalman;
pub mod people;
pub mod tracker;

pub use background::{BackgroundOptions, MAX_PLACES_M2, PointBackground};
pub use cluster::{Cluster, ClusterOptions, clusters};
pub use ghosts::{Ghost, GhostPath, find_ghosts};
pub use people::{People, PeopleOptions, Person, find_people, track_people};
pub use radarllm_base::options::OptionError;
pub use tracker::{LiveTrack, Track, TrackFrame, TrackOptions, Tracker, track};
