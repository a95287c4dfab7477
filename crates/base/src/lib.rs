//! Physical constants, coordinate frames and the plain types that the processing stages exchange.
//!
//! This crate opens no files and does not use serde. The Parquet columns, the JSON files and the configuration files
//! have structs of their own, so that each format can change independently.
//!
//! The performance figures of a radar follow from its chirp (CONVENTIONS.md, "Signal"):
//!
//! ```
//! use radarllm_base::RadarConfig;
//!
//! let radar = RadarConfig::awr1843boost();
//! // The carrier is the middle of the ADC window: 77 GHz + S (6 us + 29.09 us).
//! assert!((radar.carrier_hz() / 79.106e9 - 1.0).abs() < 1e-4);
//! assert!((radar.range_resolution_m() - 0.04293).abs() < 1e-5);
//! assert!((radar.max_velocity_mps() - 4.386).abs() < 1e-3);
//! assert_eq!(radar.frame_rate_hz(), 10.0);
//! ```
//!
//! A person who faces the radar has their left hand at positive x (CONVENTIONS.md, "Frames of reference"):
//!
//! ```
//! use glam::Vec3;
//! use radarllm_base::frames::world_from_rest_facing_radar;
//!
//! let forward_in_world = world_from_rest_facing_radar() * Vec3::Z;
//! let left_in_world = world_from_rest_facing_radar() * Vec3::X;
//! assert!((forward_in_world - Vec3::NEG_Y).length() < 1e-6);
//! assert!((left_in_world - Vec3::X).length() < 1e-6);
//! ```
//!
//! Reading order: [`frames`] (axes), [`skeleton`] (the 22 joints, [`Motion`]), [`surface`] (the simulator's view of the
//! world), [`materials`] (reflectivity of materials), [`radar_config`] (description of a radar), [`cube`] (raw
//! samples), [`points`] (input of the tokenizer), [`board`] (what firmware states beside its points), [`clip`] (points with their frame rate, radar and provenance),
//! [`static_cells`] (what stands still), [`timeline`] (recorded frames with times), [`series`] (values with
//! gaps), [`civil`] (dates and times of day), [`stats`] (medians and quantiles), [`options`] (numbers within limits), [`seed`], [`random`] and [`hash`]
//! (reproducible random numbers, fingerprints), [`mod@message`] (messages that name options).

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

pub mod board;
pub mod civil;
pub mod clip;
pub mod cube;
pub mod disturb;
pub mod frames;
pub mod hash;
pub mod materials;
pub mod message;
pub mod options;
pub mod points;
pub mod radar_config;
pub mod random;
pub mod seed;
pub mod series;
pub mod skeleton;
pub mod static_cells;
pub mod stats;
pub mod surface;
pub mod timeline;

pub use board::{BoardReport, BoardTrack};
pub use clip::{Clip, Clutter, Provenance, STATIC_SPEED_MPS, SourceInfo, StaticClutter};
pub use cube::RadarCube;
pub use message::{Message, Piece};
pub use points::{PointFrame, RadarPoint};
pub use radar_config::RadarConfig;
pub use skeleton::{Joint, Motion, Pose, Skeleton};
pub use static_cells::StaticCells;
pub use surface::{Material, MovingSurface};
pub use timeline::{NumberClock, RecordedFrame, Timeline, TimelineError};

/// Speed of light in vacuum, m/s (exact, SI).
pub const SPEED_OF_LIGHT_MPS: f64 = 299_792_458.0;
/// Boltzmann constant, J/K (exact, SI).
pub const BOLTZMANN_J_PER_K: f64 = 1.380_649e-23;
/// Reference temperature T0 of noise figures, K (IEEE).
pub const STANDARD_TEMPERATURE_K: f64 = 290.0;
