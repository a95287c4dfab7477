//! Everyday motions without any file: about forty five of them, with sentences that describe them.
//!
//! They are what the default model is trained on, and what a demonstration needs when nobody has recorded anything.
//!
//! ```
//! let request = radarllm_motions::parse("builtin:walk?direction=backward")?;
//! let walk = request.render(5);
//! assert_eq!(walk.action, "walk");
//! assert_eq!(walk.captions[0], "a person walks backwards");
//! // Sixty poses a second on the 22 joints of SMPL-X, from the canonical place.
//! assert_eq!(walk.motion.fps, 60.0);
//! assert_eq!(walk.motion.poses[0].root_in_world.x, 0.0);
//! # Ok::<(), radarllm_motions::BuiltinError>(())
//! ```
//!
//! Motions follow and accompany each other, and a wrong key is named with those that exist:
//!
//! ```
//! let both = radarllm_motions::parse("builtin:walk+then+sit_down?walk.speed=slow").unwrap();
//! assert_eq!(both.render(1).action, "walk then sit_down");
//! let error = radarllm_motions::parse("builtin:walk?pace=slow").unwrap_err();
//! assert!(error.to_string().contains("pace"), "{error}");
//! ```
//!
//! `parse("builtin:walk+then+sit_down?walk.speed=slow")` gives a [`BuiltinRequest`];
//! [`BuiltinRequest::render`] performs it with a seed and returns a [`Procedural`]: the motion, the
//! action's name, captions made from the same parameters, and the parameters as attributes.
//! [`random_request`] draws requests broadly for synthetic data sets. [`specs`] lists motions with
//! their keys.
//!
//! Reading order: [`spec`] (what exists), [`request`] (the notation), [`render`] (the whole),
//! `control` (what an animator sets), `rig` (joints from that), `track` and `gait` (curves over
//! time), `motions` (the motions), `captions` (the sentences), [`random`].
//!
//! Motions are kinematic: planned feet and hands, solved limbs, ballistic flights, balanced
//! standing. They are not recordings, and nothing here claims to be.

// Sides and joints index several arrays at once; iterating over one of them would hide that.
#![allow(clippy::needless_range_loop)]

mod actor;
mod captions;
mod control;
mod dice;
pub mod error;
mod gait;
mod motions;
pub mod random;
pub mod render;
pub mod request;
mod rig;
pub mod spec;
mod track;
pub mod values;

#[cfg(test)]
mod tests;

pub use error::BuiltinError;
pub use random::random_request;
pub use render::Procedural;
pub use request::{BuiltinRequest, parse};
pub use spec::{MotionSpec, specs};

/// Names of all built-in motions.
pub fn motion_names() -> Vec<&'static str> {
    specs().iter().map(|s| s.name).collect()
}
