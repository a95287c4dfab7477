//! Checks of the whole chain on cubes evaluated from the signal model.

#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "a test"
)]

mod calibrate;
mod capon;
mod clutter;
mod correct;
mod detection;
mod geometry;
mod hostile;
mod recorded;
mod reference;
mod synthetic;
