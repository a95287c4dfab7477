//! The HTTP server of a running radar: the page, the live messages, the timeline and the state of health.
//!
//! Every request is untrusted. `guard` says who may ask, `connection` how long and how much, `routes` what is answered.
//! The live messages are server-sent events: a browser comes back by itself, and curl can read them. Every stream begins
//! with `hello`, which has all that a late comer needs; there is no resumption by number.
//!
//! | route | answer |
//! |---|---|
//! | `GET /` | the page; `/?token=TOKEN` also sets the cookie |
//! | `GET /live.js`, `GET /live.css` | its script and its style |
//! | `GET /api/live` | [messages](radarllm_monitor::messages) as server-sent events |
//! | `GET /api/state` | the `hello` message |
//! | `GET /api/history?from&to&person&action&q&limit&before` | activities and events, newest first; times in milliseconds since 1970 |
//! | `DELETE /api/history?from&to` | forgets a range of time |
//! | `GET /api/ask?q` | the [answer](radarllm_memory::Answer) to a question |
//! | `GET /api/activity/ID/points` | the points of an activity |
//! | `POST /api/falls/ID/acknowledge` | ends a fall on a user's word; all listeners hear of it |
//! | `GET /api/bug-bundle` | what a report of a fault should have, without sentences |
//! | `GET /metrics` | counters in the text format of Prometheus |
//! | `GET /healthz` | 200, or 503 with reasons |

mod answer;
mod connection;
mod error;
mod events;
mod guard;
mod history;
mod places;
mod routes;
mod token;

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use radarllm_memory::store::Deleted;
use radarllm_memory::{Clock, StoreError};
use radarllm_monitor::liveness::Liveness;
use tokio::sync::watch;

pub use error::HttpError;
pub use token::Token;

use crate::bus::Bus;
use crate::metrics::Metrics;
use crate::mqtt::Status;
use guard::Guard;
use routes::App;

/// Port of the page.
pub const PORT: u16 = 8_741;
/// Most listeners to the live messages.
pub const MAX_LISTENERS: usize = 32;
/// Most connections at once of which a request was admitted.
pub const MAX_CONNECTIONS: usize = 128;
/// Most other connections at once; of more, the oldest ones are closed.
pub const MAX_STRANGERS: usize = 64;
/// Longest body of a request, bytes.
pub const MAX_BODY_BYTES: usize = 16 << 10;
/// Threads that read the memory.
const MAX_READING_THREADS: usize = 2;
/// Most requests that wait for these threads. Work of a client that went away is done all the same, so that its amount
/// must not follow the number of requests.
const MAX_READING: usize = 8;
/// How long the server waits for its connections when it stops.
const STOP_TIME: Duration = Duration::from_secs(2);

/// Where the server listens, and whom it answers.
#[derive(Clone, Debug)]
pub struct Options {
    /// Address. One that is not loopback needs a token.
    pub address: SocketAddr,
    /// Secret of those who may ask. Without it everybody on this computer may.
    pub token: Option<Token>,
    /// Names under which the server is reached, beside loopback and its address.
    pub allow_hosts: Vec<String>,
    /// Origins whose pages may show this one in a frame, for example `http://homeassistant.local:8123`.
    pub allow_frames: Vec<String>,
    /// How long a client may take for the head of a request, for its body and for taking what was sent to it.
    pub patience: Duration,
}

impl Default for Options {
    /// The options of a server on port [`PORT`] of this computer.
    fn default() -> Self {
        Self::new(SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), PORT))
    }
}

impl Options {
    /// The options of a server on an address, without token and further names.
    pub fn new(address: SocketAddr) -> Self {
        Self {
            address,
            token: None,
            allow_hosts: Vec::new(),
            allow_frames: Vec::new(),
            patience: Duration::from_secs(10),
        }
    }
}

/// What the server asks for the present time and the offset of the local time.
pub type ReadClock = Arc<dyn Fn() -> Clock + Send + Sync>;
/// What the server calls to forget the range of time from the first to before the second, milliseconds since 1970 in UTC.
pub type Forget = Arc<dyn Fn(i64, i64) -> Result<Deleted, StoreError> + Send + Sync>;
/// What the server calls to end the fall of a number. It returns false if too many such calls wait.
pub type Acknowledge = Arc<dyn Fn(u64) -> bool + Send + Sync>;

/// What the server shows.
#[derive(Clone)]
pub struct Sources {
    /// The live messages.
    pub bus: Arc<Bus>,
    /// The counters.
    pub metrics: Arc<Metrics>,
    /// Whether frames arrive and the pipeline moves.
    pub liveness: Arc<Liveness>,
    /// The database, if there is one. It is opened for reading only.
    pub database: Option<PathBuf>,
    /// How to forget, if there is a database. It is called on a thread that may wait.
    pub forget: Option<Forget>,
    /// The MQTT broker, if there is one.
    pub broker: Option<Status>,
    /// How to end a fall, if falls are watched. It does not wait.
    pub acknowledge: Option<Acknowledge>,
    /// The clock.
    pub clock: ReadClock,
}

impl fmt::Debug for Sources {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Sources")
            .field("bus", &self.bus)
            .field("metrics", &self.metrics)
            .field("liveness", &self.liveness)
            .field("database", &self.database)
            .finish_non_exhaustive()
    }
}

/// A running server. It stops when this is dropped.
#[derive(Debug)]
pub struct Server {
    address: SocketAddr,
    stop: watch::Sender<bool>,
    stopped: Receiver<()>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Starts a server on a thread of its own.
    ///
    /// # Errors
    /// An address that is not loopback without a token, an origin or a name that is none, or an address on which one
    /// cannot listen.
    #[expect(
        clippy::disallowed_methods,
        reason = "the page's socket is opened here alone"
    )]
    pub fn start(options: Options, sources: Sources) -> Result<Self, HttpError> {
        if options.token.is_none() && !options.address.ip().is_loopback() {
            return Err(HttpError::NoToken {
                address: options.address,
            });
        }
        let listen = |source| HttpError::Listen {
            address: options.address,
            source,
        };
        let listener = TcpListener::bind(options.address).map_err(listen)?;
        listener.set_nonblocking(true).map_err(listen)?;
        let address = listener.local_addr().map_err(listen)?;
        let guard = Guard::new(&options, address)?;
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .max_blocking_threads(MAX_READING_THREADS)
            .thread_name("http")
            .build()
            .map_err(|source| HttpError::Thread { source })?;
        let (stop, stopping) = watch::channel(false);
        let app = Arc::new(App::new(guard, sources, options.patience, stopping.clone()));
        let (tell_stopped, stopped) = channel();
        let thread = std::thread::Builder::new()
            .name("http".into())
            .spawn(move || {
                runtime.block_on(connection::accept(listener, app, stopping));
                runtime.shutdown_timeout(STOP_TIME);
                // The owner may be gone.
                let _ = tell_stopped.send(());
            })
            .map_err(|source| HttpError::Thread { source })?;
        Ok(Self {
            address,
            stop,
            stopped,
            thread: Some(thread),
        })
    }

    /// The address, with the port that the operating system chose if none was asked for.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // The thread may be gone.
        let _ = self.stop.send(true);
        let in_time = self.stopped.recv_timeout(2 * STOP_TIME).is_ok();
        if let Some(thread) = self.thread.take().filter(|_| in_time) {
            // A panic was printed where it happened.
            let _ = thread.join();
        }
    }
}

/// Waits until the server stops.
async fn stopped(mut stopping: watch::Receiver<bool>) {
    // An error means that the server is gone, which is a stop as well.
    let _ = stopping.wait_for(|stop| *stop).await;
}

#[cfg(test)]
mod tests;
