//! Procedural everyday motions that need no recording: about forty-five motions with matching
//! captions.
//!
//! The default model is trained on these motions. They also serve demonstrations for which no
//! recording exists.
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
//! Motions can be chained and combined. An unknown key gives an error that lists the valid keys:
//!
//! ```
//! let both = radarllm_motions::parse("builtin:walk+then+sit_down?walk.speed=slow").unwrap();
//! assert_eq!(both.render(1).action, "walk then sit_down");
//! let error = radarllm_motions::parse("builtin:walk?pace=slow").unwrap_err();
//! assert!(error.to_string().contains("pace"), "{error}");
//! ```
//!
//! `parse("builtin:walk+then+sit_down?walk.speed=slow")` returns a [`BuiltinRequest`].
//! [`BuiltinRequest::render`] renders it with a seed and returns a [`Procedural`]: the motion, the
//! name of the action, captions generated from the same parameters, and the parameters as
//! attributes. [`random_request`] draws varied requests for synthetic data sets. [`specs`] lists
//! the motions with their keys.
//!
//! Reading order: [`spec`] (available motions), [`request`] (request syntax), [`render`] (the
//! complete pipeline), `control` (animation controls), `rig` (joint rotations from the controls),
//! `track` and `gait` (curves over time), `motions` (the individual motions), `captions` (the
//! sentences), [`random`].
//!
//! The motions are kinematic: feet and hands are planned, limbs are solved by inverse kinematics,
//! flights are ballistic and standing is balanced. They are not recordings and do not claim to be.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]
// Sides and joints index several arrays at once; iterating over one of them would hide that.
#![allow(clippy::needless_range_loop)]

mod actor;
mod captions;
mod control;
mod dice;
pub mod error;
mod facts;
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
pub use random::{
    PeopleRequest, once_request, pair_request, people_request, random_request, side_request,
};
pub use render::Procedural;
pub use request::{BuiltinRequest, parse};
pub use spec::{MotionSpec, specs};
