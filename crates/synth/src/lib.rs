//! Motion in, radar-text records out: the place where body, virtual radar and signal chain meet.
//!
//! Reading order: [`placement`] (where a person stands), [`synthesizer`] (one motion to points),
//! [`corpus`] (captioned motions), [`config`] (the data set's TOML), [`impairments`],
//! [`weather`], [`processing`] and [`room`] (its tables of receiver faults, of the air, of the signal chain
//! and of walls), [`record`] (one pure function `(motion, seed) -> ClipRecord`), [`build`] (a whole data
//! set); [`mod@scene`] (scene files) with `obj` (meshes); [`realism`] (the same chain beside recordings).
//!
//! Deliberately absent: anything of the models, and any silent substitute for missing input.

pub mod build;
pub mod config;
pub mod corpus;
pub mod impairments;
mod obj;
pub mod placement;
pub mod processing;
pub mod realism;
pub mod record;
pub mod room;
pub mod scene;
pub mod synthesizer;
pub mod weather;

pub use synthesizer::{Method, SynthError, Synthesizer};
