//! Simulated rooms with people in them, through the tracker.

mod ghosts;
mod scenes;
mod tracks;
