//! The memory of a running radar, and questions about it.
//!
//! Activities (what a person did, from when to when, as an action and a sentence) and events (presence, falls, the state
//! of the radar) enter. Rows by time, person, action and words leave, and answers to questions such as "how often did
//! she get up today?".
//!
//! Reading order: [`store`] (the database), [`ask`](mod@ask) (questions), [`points`] (points as bytes), [`error`].
//!
//! Deliberately absent: threads, the network and the clock. The caller gives the present time and the offset of the
//! local time. Nobody is identified: a person is the number of a track.

pub mod ask;
mod civil;
pub mod error;
pub mod points;
pub mod store;

pub use ask::{Answer, Clock, ask};
pub use error::StoreError;
pub use store::{Store, Timeline};
