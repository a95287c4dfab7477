//! Simulated rooms with people in them, through the tracker.

#![allow(clippy::unwrap_used, unreachable_pub, reason = "a test")]

mod ghosts;
mod live;
mod scenes;
mod tracks;
