//! A server on loopback, asked by a client that writes bytes.

mod client;
mod listeners;
mod page;
mod timeline;
mod visitors;

use std::path::Path;
use std::sync::Mutex;

use radarllm_memory::store::Store;

use super::*;
use crate::bus::tests::about;
use client::Reply;

pub(super) const NOW_MS: i64 = 1_795_455_492_000;
pub(super) const TOKEN: &str = "0123456789abcdef";

/// A server and what it shows.
pub(super) struct Fixture {
    pub server: Server,
    pub bus: Arc<Bus>,
    pub liveness: Arc<Liveness>,
    pub metrics: Arc<Metrics>,
    /// Numbers of falls that were acknowledged.
    pub acknowledged: Receiver<u64>,
}

pub(super) fn loopback() -> Options {
    Options::new(([127, 0, 0, 1], 0).into())
}

pub(super) fn fixture(options: Options) -> Fixture {
    with_memory(options, None)
}

/// A server that reads the database at a path, and that forgets through the store.
pub(super) fn with_memory(options: Options, memory: Option<(&Path, Store)>) -> Fixture {
    let bus = Arc::new(Bus::new(about()));
    let liveness = Arc::new(Liveness::new(Duration::from_millis(100)));
    let metrics = Arc::new(Metrics::default());
    let database = memory.as_ref().map(|(path, _)| path.to_path_buf());
    let forget = memory.map(|(_, store)| -> Forget {
        let store = Mutex::new(store);
        Arc::new(move |from_ms, to_ms| store.lock().unwrap().forget(Some(from_ms), to_ms))
    });
    let (acknowledge, acknowledged) = channel();
    let sources = Sources {
        bus: Arc::clone(&bus),
        metrics: Arc::clone(&metrics),
        liveness: Arc::clone(&liveness),
        database,
        forget,
        broker: None,
        acknowledge: Some(Arc::new(move |fall| acknowledge.send(fall).is_ok())),
        clock: Arc::new(|| Clock {
            now_ms: NOW_MS,
            offset_s: 0,
        }),
    };
    Fixture {
        server: Server::start(options, sources).unwrap(),
        bus,
        liveness,
        metrics,
        acknowledged,
    }
}

impl Fixture {
    /// Sends a request with our `Host` header and the further lines.
    pub fn ask(&self, method: &str, target: &str, lines: &str) -> Reply {
        let host = self.server.address();
        self.send(&format!(
            "{method} {target} HTTP/1.1\r\nHost: {host}\r\n{lines}Connection: close\r\n\r\n"
        ))
    }

    pub fn get(&self, target: &str) -> Reply {
        self.ask("GET", target, "")
    }

    /// Sends bytes as they are.
    pub fn send(&self, request: &str) -> Reply {
        client::send(self.server.address(), request.as_bytes())
    }
}
