//! Activities taught by a few recordings.
//!
//! A model that was trained on simulated radar does not know every board, room and person. Three recordings of an
//! activity are enough to recognise it again on the same board: their points hold what is needed, and nothing has to be
//! trained. A [`Memory`] keeps the features of the examples; [`Recogniser`] compares a recording with them and abstains
//! where nothing fits.
//!
//! ```
//! use radarllm_base::{Clip, Clutter, PointFrame, RadarPoint};
//! use radarllm_teach::{Memory, Recogniser};
//!
//! // Somebody whose height goes up and down, at a rate in Hz.
//! let recording = |rate_hz: f32| {
//!     let frame = |i: u32| {
//!         let time_s = i as f32 / 10.0;
//!         let z_m = 0.3 * (6.283 * rate_hz * time_s).sin();
//!         let point = RadarPoint { y_m: 2.0, z_m, range_m: 2.0, ..RadarPoint::default() };
//!         PointFrame { frame: i, time_s: time_s.into(), points: vec![point; 5], board: None }
//!     };
//!     Clip {
//!         frames: (0..120).map(frame).collect(),
//!         frame_rate_hz: 10.0,
//!         radar_height_m: 1.0,
//!         is_height_assumed: false,
//!         radar: "iwr6843isk".into(),
//!         provenance: "recorded:csv:room.csv".parse().unwrap(),
//!         clutter: Clutter::Settled,
//!     }
//! };
//! let mut memory = Memory::default();
//! for rate_hz in [0.48, 0.5, 0.52] {
//!     memory.teach("rocking", "a person rocks in the chair", &recording(rate_hz))?;
//! }
//! for rate_hz in [1.9, 2.0, 2.1] {
//!     memory.teach("shaking", "a person shakes the head", &recording(rate_hz))?;
//! }
//! let recogniser = Recogniser::new(&memory).unwrap();
//! let found = recogniser.recognise(&recording(0.51));
//! assert_eq!(found[0].says, "a person rocks in the chair");
//! // Neither of the two.
//! assert!(recogniser.recognise(&recording(1.1)).is_empty());
//! # Ok::<(), radarllm_teach::TeachError>(())
//! ```
//!
//! Reading order: [`shape`] (a window of points to 349 numbers), [`memory`] (examples and their file), [`recogniser`] (what
//! fits, and what does not), [`windows`] (how a recording is divided).

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

pub mod memory;
pub mod recogniser;
pub mod shape;
pub mod windows;

pub use memory::{Example, Memory, Taught, TeachError, Warning};
pub use recogniser::{Recognised, Recogniser};
