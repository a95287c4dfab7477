//! A running radar in Home Assistant: the live messages on an MQTT broker.
//!
//! A [`Publisher`] listens to a [`Bus`] on a thread of its own and keeps a broker up to date. Nobody waits for the broker:
//! while it is away only the latest values are kept, and all of them are published again when it is back or when Home
//! Assistant comes online. All messages have QoS 1.
//!
//! | topic | payload | retained |
//! |---|---|---|
//! | `PREFIX/device/radarllm_NAME/config` | the description of the device and its six entities | yes |
//! | `radarllm/NAME/availability` | `online` or `offline`, which is also the will | yes |
//! | `radarllm/NAME/source/availability` | `online` while the radar is heard, or `offline` | yes |
//! | `radarllm/NAME/state` | occupancy, people, activity, fallen | yes |
//! | `radarllm/NAME/caption` | the newest sentence with its provenance, at most one a second | yes |
//! | `radarllm/NAME/fall` | each transition of a fall, if it is younger than a minute | no |
//!
//! With several people, activity and sentence are those of one of them: of those who do something that is known, the one
//! with the smallest number. The broker is untrusted: packets of more than 64 KiB end the connection, and everything that
//! waits is bounded. The connection is not encrypted. A simulated radar publishes only if the options allow it.
//!
//! ```
//! # use radarllm_monitor::{messages::About, rows::Origin};
//! # let about = About {
//! #     name: "lounge".into(),
//! #     origin: Origin {
//! #         source: "/dev/ttyUSB1".into(),
//! #         radar: "awr1843boost".into(),
//! #         model: "default".into(),
//! #         decoder: "greedy".into(),
//! #         version: "0.1.0".into(),
//! #         synthetic: false,
//! #     },
//! #     radar_height_m: 1.2,
//! #     frame_period_s: 0.1,
//! #     zones: Vec::new(),
//! # };
//! use std::sync::Arc;
//!
//! use radarllm_live::bus::Bus;
//! use radarllm_live::mqtt::{Options, Publisher};
//!
//! let bus = Arc::new(Bus::new(about));
//! let mut options = Options::new("mqtt://127.0.0.1".parse()?);
//! options.actions = vec!["walk".into(), "sit_down".into()];
//! let publisher = Publisher::start(options, Arc::clone(&bus))?;
//! // Whatever is published on the bus now reaches the broker as soon as there is one.
//! assert_eq!(publisher.counts().dropped, 0);
//! publisher.stop();
//! # Ok::<(), radarllm_live::mqtt::MqttError>(())
//! ```

mod discovery;
mod error;
mod link;
mod options;
mod room;
mod session;

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use serde::Serialize;
use tokio::sync::watch;

pub use error::MqttError;
pub use options::{Address, Options, Password, validate_name};

use crate::bus::Bus;
use discovery::Topics;
use room::Room;
use session::{Session, Shared};

/// Longest description of a device, bytes: a packet without its topic.
const MAX_DESCRIPTION: usize = link::MAX_PACKET - 1_024;
/// How long one waits for the thread when it stops. It publishes its farewell in less.
const STOP_TIME: Duration = Duration::from_secs(2);

/// What happened between this program and the broker.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Whether the broker is connected.
    pub connected: bool,
    /// Connections after the first one.
    pub reconnects: u64,
    /// Messages that the broker acknowledged.
    pub published: u64,
    /// Transitions of falls that were too old or too many, and messages of a simulated radar that are not allowed.
    pub dropped: u64,
    /// Whether Home Assistant's status is not listened to any more, because a message there was too long.
    pub status_ignored: bool,
}

/// What happens between this program and the broker, for those who show it.
#[derive(Clone, Debug)]
pub struct Status(Arc<Shared>);

impl Status {
    /// What happened so far.
    pub fn counts(&self) -> Counts {
        let shared = &self.0;
        let connections = shared.connections.load(Ordering::Relaxed);
        Counts {
            connected: shared.is_connected.load(Ordering::Relaxed),
            reconnects: connections.saturating_sub(1),
            published: shared.published.load(Ordering::Relaxed),
            dropped: shared.dropped.load(Ordering::Relaxed),
            status_ignored: shared.is_status_ignored.load(Ordering::Relaxed),
        }
    }

    /// Why the last connection or the last attempt failed, in words, while there is no connection.
    pub fn problem(&self) -> Option<String> {
        self.0.problem()
    }
}

/// Publishes the live messages. It stops when this is dropped.
#[derive(Debug)]
pub struct Publisher {
    shared: Arc<Shared>,
    stop: watch::Sender<bool>,
    stopped: Receiver<bool>,
    thread: Option<JoinHandle<()>>,
}

impl Publisher {
    /// Starts to publish on a thread of its own. The broker need not be there.
    ///
    /// # Errors
    /// A simulated radar that is not allowed, a name of the radar other than 1 to 32 characters `a-z0-9_`, or an option
    /// that cannot be used.
    pub fn start(options: Options, bus: Arc<Bus>) -> Result<Self, MqttError> {
        let about = bus.about();
        if about.origin.synthetic && !options.allow_synthetic {
            return Err(MqttError::Synthetic {
                found: about.origin.source,
            });
        }
        options::validate_name(&about.name)?;
        options.validate()?;
        let topics = Topics::new(&about.name, &options.discovery_prefix);
        let room = Room::new(about, &options.actions, options.allow_synthetic);
        let description = discovery::description(room.about(), &topics, room.labels()).to_string();
        if description.len() > MAX_DESCRIPTION {
            return Err(MqttError::TooLong {
                actions: options.actions.len(),
                found: description.len(),
                expected: MAX_DESCRIPTION,
            });
        }
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .max_blocking_threads(1)
            .thread_name("mqtt")
            .build()
            .map_err(|source| MqttError::Thread { source })?;
        let shared = Arc::new(Shared::default());
        let (stop, stopping) = watch::channel(false);
        let session = Session::new(options, topics, description, room, bus, Arc::clone(&shared));
        let (tell_stopped, stopped) = channel();
        let thread = std::thread::Builder::new()
            .name("mqtt".into())
            .spawn(move || {
                let is_offline = runtime.block_on(session.run(stopping));
                // Looking up a host can take long and cannot be given up.
                runtime.shutdown_background();
                // The owner may be gone.
                let _ = tell_stopped.send(is_offline);
            })
            .map_err(|source| MqttError::Thread { source })?;
        Ok(Self {
            shared,
            stop,
            stopped,
            thread: Some(thread),
        })
    }

    /// What happens between this program and the broker.
    pub fn status(&self) -> Status {
        Status(Arc::clone(&self.shared))
    }

    /// What happened so far.
    pub fn counts(&self) -> Counts {
        self.status().counts()
    }

    /// Why the last connection or the last attempt failed, in words, while there is no connection.
    pub fn problem(&self) -> Option<String> {
        self.status().problem()
    }

    /// Publishes `offline` and stops, within two seconds. Returns whether the broker took it; if not, it publishes the
    /// will.
    pub fn stop(mut self) -> bool {
        self.end()
    }

    fn end(&mut self) -> bool {
        let Some(thread) = self.thread.take() else {
            return false;
        };
        // The thread may be gone.
        let _ = self.stop.send(true);
        match self.stopped.recv_timeout(STOP_TIME) {
            Ok(is_offline) => {
                // A panic was printed where it happened.
                let _ = thread.join();
                is_offline
            }
            Err(_) => false,
        }
    }
}

impl Drop for Publisher {
    fn drop(&mut self) {
        self.end();
    }
}

#[cfg(test)]
mod tests;
