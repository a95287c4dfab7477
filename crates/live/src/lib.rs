//! A running radar: frames come in, and sentences, presence and falls go out, while it happens.
//!
//! | thread | does |
//! |---|---|
//! | source | waits for frames of a recording, a board or the simulated room, and puts them into a queue |
//! | pipeline | tracks, watches and describes ([`radarllm_serve::pipeline`]) |
//! | store | writes rows and events ([`radarllm_serve::keeper`]) |
//! | server | the page and the messages ([`radarllm_serve::http`]) |
//! | broker | MQTT ([`radarllm_serve::mqtt`]) |
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
//! [`captions`] (the model), [`zones`], [`local_time`], [`notify`] (systemd).

pub mod captions;
pub mod input;
pub mod local_time;
pub mod notify;
mod resample;
pub mod room;
pub mod service;
pub mod zones;

pub use input::{Input, ReadTime, Speed};
pub use service::{Broker, Live, LiveOptions, Page};
