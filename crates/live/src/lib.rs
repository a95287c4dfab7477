//! A running radar: frames come in, and sentences, presence and falls go out, while it happens.
//!
//! | thread | does |
//! |---|---|
//! | source | waits for frames of a recording, a board or the simulated room, and puts them into a queue |
//! | pipeline | tracks, watches and describes ([`radarllm_monitor::pipeline`]) |
//! | store | writes rows and events ([`store_writer`]) |
//! | server | the page and the messages ([`http`]) |
//! | broker | MQTT ([`mqtt`]) |
//!
//! ```no_run
//! use radarllm_live::{Input, Live, LiveOptions, Speed};
//!
//! let recording = radarllm::open("uart.dat").radar("profile.cfg")?.points()?;
//! let input = Input::replay("uart.dat", recording, Speed::Times(1.0), false)?;
//! let live = Live::start(input, radarllm::Captioner::bundled()?, LiveOptions::default())?;
//! if let Some(address) = live.address() {
//!     println!("http://{address}/");
//! }
//! while !live.is_over() {
//!     std::thread::sleep(std::time::Duration::from_millis(100));
//! }
//! # Ok::<(), radarllm::Error>(())
//! ```
//!
//! Reading order: [`service`] (everything put together), [`input`] (sources of frames), [`room`] (the simulated room),
//! [`captions`] (the model), [`bus`] (how messages reach listeners), [`http`] (the server and its page), [`mqtt`] (the
//! messages on a broker, for Home Assistant), [`store_writer`] (the thread that writes into the memory), [`metrics`]
//! (counters as text), [`zones`], [`local_time`], [`notify`] (systemd).
//!
//! Presence, falls and rows are in `radarllm-monitor`, the database and questions in `radarllm-memory`. Threads, the clock
//! and network servers are here only.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

pub mod bus;
pub mod captions;
pub mod http;
pub mod input;
pub mod local_time;
pub mod metrics;
pub mod mqtt;
pub mod notify;
mod resample;
pub mod room;
mod runs;
pub mod service;
pub mod store_writer;
pub mod zones;

pub use input::{Input, ReadTime, Speed};
pub use service::{Live, LiveOptions};
