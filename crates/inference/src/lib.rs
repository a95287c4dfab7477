//! Generates sentences from radar points.
//!
//! This crate runs a trained model. A [`Captioner`] takes a [`Clip`](radarllm_base::Clip) of radar points and returns
//! the sentence that the model generates for it, with a confidence and the radar tokens that it read:
//!
//! ```
//! use std::path::Path;
//!
//! use radarllm_base::{Clip, Clutter, PointFrame, RadarPoint};
//! use radarllm_inference::{Captioner, DescribeOptions, Precision, PreparedClip};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let model = Path::new("../model-default/weights");
//! let captioner = Captioner::load(model, Precision::F32)?;
//!
//! // Four seconds of a recording at 20 frames per second: thirty points around a body that walks away.
//! let frame = |i: u32| {
//!     let time_s = f64::from(i) / 20.0;
//!     let point = |k: u32| RadarPoint {
//!         x_m: 0.3 * (k as f32 * 1.9).sin(),
//!         y_m: 2.0 + time_s as f32,
//!         z_m: 0.7 * (k as f32 * 0.7).sin(),
//!         range_m: 2.0 + time_s as f32,
//!         velocity_mps: 1.0,
//!         intensity_db: 30.0,
//!     };
//!     PointFrame { frame: i, time_s, points: (0..30).map(point).collect(), board: None }
//! };
//! let clip = Clip {
//!     frames: (0..80).map(frame).collect(),
//!     frame_rate_hz: 20.0,
//!     radar_height_m: 1.0,
//!     is_height_assumed: false,
//!     radar: "awr1843boost".into(),
//!     provenance: "recorded:csv:walk.csv".parse()?,
//!     clutter: Clutter::Unchecked,
//! };
//! let clip = PreparedClip::of(&clip)?;
//! let described = captioner.describe(&clip, &DescribeOptions::default())?;
//! println!("{} ({:.2})", described.caption, described.confidence);
//! assert_eq!(described.abstained, None);
//! assert_eq!(described.tokens.len(), 11); // One token per 0.4 s.
//! # Ok(())
//! # }
//! ```
//!
//! # What the model expects
//!
//! The model was trained on simulated radars at [`FRAME_RATE_HZ`] that remove static clutter. A [`PreparedClip`] is
//! such a clip: other frame rates are resampled, static clutter is removed from recordings, and values that are not
//! finite are refused. [`prepare_for_model`] also reports what it changed.
//!
//! # Map
//!
//! Reading order: [`checkpoint`] (files), [`prepare`] (the input contract), [`tokenizer`] (points to codes), [`lm`]
//! (codes to words), [`backend`] (execution of both networks).
//!
//! Out of scope: the trainable networks, which use burn, are in `radarllm-nn`. That crate depends on this one and never
//! the reverse. This crate opens no sockets and prints nothing, and only [`checkpoint`] opens files.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

pub mod backend;
pub mod checkpoint;
pub mod evidence;
pub mod lm;
pub mod prepare;
pub mod tokenizer;

pub use backend::{Backend, EngineBackend, LoadBackend};
pub use lm::{
    Captioner, Chosen, DescribeOptions, Description, LmError, Precision, Segment, actions,
};
pub use prepare::{
    FRAME_RATE_HZ, PrepareError, PrepareOptions, Prepared, PreparedClip, RATE_TOLERANCE,
    prepare_for_model,
};
