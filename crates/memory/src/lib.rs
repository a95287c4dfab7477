//! The memory of a running radar, an SQLite database, and questions in English about it.
//!
//! Activities (what a person did, from when to when, as an action and a sentence), events (presence, falls, the state of the
//! radar) and runs (from when to when a radar was watched) enter. Rows by time, person, action and words leave, and answers
//! to questions such as "how often did she get up today?".
//!
//! ```
//! use radarllm_memory::{Clock, Store, ask};
//! use radarllm_monitor::rows::{Activity, Origin};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("live.db");
//! let now_ms = 1_795_455_492_000; // 2026-11-23 17:38:12 UTC
//! let mut store = Store::open(&path, now_ms)?.store;
//! let origin = Origin {
//!     source: "/dev/ttyUSB1".into(),
//!     radar: "awr1843boost".into(),
//!     model: "default".into(),
//!     decoder: "greedy".into(),
//!     version: "0.1.0".into(),
//!     synthetic: false,
//! };
//! let activity = Activity {
//!     start_ms: now_ms - 60_000,
//!     end_ms: now_ms - 56_000,
//!     person: 1,
//!     action: "stand_up".into(),
//!     caption: "a person gets up from the floor".into(),
//!     confidence: Some(0.7),
//!     windows: 2,
//!     points: 130,
//!     place_m: Some([0.4, 2.1]),
//! };
//! store.write(|batch| batch.insert_activity(&activity, &origin))?;
//!
//! let clock = Clock { now_ms, offset_s: 3_600 };
//! let answer = ask(store.timeline(), "How often did she get up today?", clock)?;
//! assert_eq!(answer.count, 1);
//! assert!(answer.answer.starts_with("Someone got up once today, at 18:37 today."));
//! # Ok(())
//! # }
//! ```
//!
//! Reading order: [`store`] (the database), [`ask`](mod@ask) (questions), [`error`].
//!
//! Deliberately absent: the clock, which the caller reads, threads and the network. Nobody is identified: a person is the
//! number of a track.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

pub mod ask;
pub mod error;
pub mod store;

pub use ask::{Answer, Clock, ask};
pub use error::StoreError;
pub use store::{Store, Timeline};
