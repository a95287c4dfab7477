//! Checks of the whole chain on cubes evaluated from the signal model.

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
