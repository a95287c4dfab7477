//! The memory of a running radar, questions about it, and the server that shows both while frames arrive.
//!
//! Activities (what a person did, from when to when, as an action and a sentence) and events (presence, falls, the state
//! of the radar) enter. Rows by time, person, action and words leave, and answers to questions such as "how often did
//! she get up today?".
//!
//! ```
//! use radarllm_serve::store::{Activity, Origin, Store};
//! use radarllm_serve::{Clock, ask};
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
//! Reading order: [`pipeline`] (one frame in, messages and records out), [`queue`] (frames before it), [`keeper`] (the
//! thread that writes into the memory); [`clock`] (frames to times), [`people`] and [`zones`] (what enters), [`presence`], [`falls`] and [`watch`] (both behind the tracker),
//! [`activities`] (windows to labels and rows), [`options`]; [`store`] (the database), [`ask`](mod@ask) (questions),
//! [`points`] (points as bytes); [`messages`] (what listeners are told), [`bus`] (how it reaches them), [`http`] (the
//! server and its page), [`mqtt`] (the messages on a broker, for Home Assistant), [`metrics`] and [`vitals`] (counters
//! and signs of life); [`error`].
//!
//! Deliberately absent: the clock. The caller gives the present time and the offset of the local time. Only [`http`] and
//! [`mqtt`] have a thread and the network. Nobody is identified: a person is the number of a track.

pub mod activities;
pub mod ask;
pub mod bus;
mod civil;
pub mod clock;
pub mod error;
pub mod falls;
pub mod http;
pub mod keeper;
pub mod messages;
pub mod metrics;
pub mod mqtt;
pub mod options;
pub mod people;
pub mod pipeline;
pub mod points;
pub mod presence;
pub mod queue;
pub mod store;
pub mod vitals;
pub mod watch;
pub mod zones;

pub use ask::{Answer, Clock, ask};
pub use civil::{midnight_ms, utc_ms};
pub use error::StoreError;
pub use store::{Store, Timeline};
