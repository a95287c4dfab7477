//! What a radar sees while it runs: frames become presence, falls, sentences, rows of a timeline and messages.
//!
//! The points of one frame after the other enter a [`Pipeline`](pipeline::Pipeline), together with the time at which they
//! arrived. Messages for listeners, rows and events leave. Whoever describes windows in words implements
//! [`Describe`](pipeline::Describe).
//!
//! Reading order: [`pipeline`] (one frame in, messages and records out), [`queue`] (frames before it); [`clock`] (frames to
//! times), [`people`] and [`zones`] (what enters), [`presence`], [`falls`] and [`watch`] (both behind the tracker),
//! [`activities`] (windows to labels and rows), [`measured`] (rows of what is
//! measured), [`options`]; [`rows`] (activities and events), [`messages`] (what listeners
//! receive), [`points`] (points as bytes), [`counters`], [`liveness`] (whether frames arrive and the pipeline moves).
//!
//! Deliberately absent: files, sockets, threads, the database and the time of day, so that a recording gives the same rows
//! at any speed. Only [`liveness`] and the time that a sentence took are measured by the computer's clock.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

pub mod activities;
mod board;
pub mod clock;
pub mod counters;
pub mod falls;
pub mod liveness;
pub mod measured;
pub mod messages;
pub mod options;
pub mod people;
pub mod pipeline;
pub mod points;
pub mod presence;
pub mod queue;
pub mod rows;
mod statures;
pub mod watch;
pub mod zones;
