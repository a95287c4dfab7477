//! Facts about people that are measured, without a network: where somebody is, whether the person walks, stands, sits,
//! lies or falls.
//!
//! Frames of points enter ([`PointFrame`](radarllm_base::PointFrame)), with the tracks of the board where its firmware
//! states them; [`State`]s with times, places and probabilities leave. They hold for every board, also one that no model
//! has learned from, because they are distances, heights and speeds.
//!
//! A board that tracks people says where somebody is who sits still and reflects no moving point. Height says posture once
//! the height of a standing person is known; the tilt of the radar distorts it with distance. Both follow from where people
//! walk ([`site`]).
//!
//! Reading order: [`people`] (tracks of the board, joined to people), [`site`] (tilt and standing height), [`posture`],
//! [`falls`], [`states`] (all of it in order of time), [`sentences`].
//!
//! Deliberately absent: models, files, and the tracker of points (`radarllm-tracking`).

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

pub mod falls;
pub mod people;
pub mod posture;
pub mod sentences;
pub mod site;
pub mod states;

pub use people::{Sample, TrackedPerson, tracked_people};
pub use posture::{Posture, PostureProbabilities};
pub use sentences::sentence;
pub use site::{Site, SiteDeviation, SiteError, SiteLearner};
pub use states::{Activity, Before, State, measure};
