//! Simulated rooms with people in them, through the tracker.

mod ghosts;
mod live;
mod scenes;
mod tracks;
