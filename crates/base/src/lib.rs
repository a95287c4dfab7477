//! Constants, frames of reference and the plain types that meet between stages.
//!
//! Nothing here opens a file, draws a random number or knows serde: Parquet columns, JSON and
//! configuration files have structs of their own, so that each can change alone.
//!
//! Reading order: [`frames`] (axes), [`skeleton`] (the 22 joints, [`Motion`]), [`surface`] (what
//! the simulator sees), [`materials`] (what that reflects), [`radar_config`] (what a radar is), [`cube`] (raw samples), [`points`]
//! (what the tokenizer reads), [`clip`] (points with their frame rate, radar and provenance), [`timeline`] (recorded
//! frames with times), [`seed`] (reproducible randomness).

pub mod clip;
pub mod cube;
pub mod frames;
pub mod materials;
pub mod points;
pub mod radar_config;
pub mod seed;
pub mod skeleton;
pub mod surface;
pub mod timeline;

pub use clip::{Clip, Provenance, STATIC_SPEED_MPS, StaticClutter};
pub use cube::RadarCube;
pub use points::{PointFrame, RadarPoint};
pub use radar_config::RadarConfig;
pub use skeleton::{Joint, Motion, Pose, Skeleton};
pub use surface::{Material, MovingSurface};
pub use timeline::{RecordedFrame, Timeline, TimelineError};

/// Speed of light in vacuum, m/s (exact, SI).
pub const SPEED_OF_LIGHT_MPS: f64 = 299_792_458.0;
/// Boltzmann constant, J/K (exact, SI).
pub const BOLTZMANN_J_PER_K: f64 = 1.380_649e-23;
/// Reference temperature T0 of noise figures, K (IEEE).
pub const STANDARD_TEMPERATURE_K: f64 = 290.0;
