//! Bytes of a client of the page of `live`, on a connection of this computer: one server with a token, one without, both with
//! a memory. The first byte says which.
#![no_main]

use std::io::{Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpStream};
use std::sync::{Arc, LazyLock, Mutex};
use std::time::Duration;

use libfuzzer_sys::fuzz_target;
use radarllm_fuzz::{NOW_MS, about, write_memory};
use radarllm_live::bus::Bus;
use radarllm_live::http::{Options, Server, Sources, Token};
use radarllm_live::metrics::Metrics;
use radarllm_memory::Clock;
use radarllm_memory::store::Deleted;
use radarllm_monitor::liveness::Liveness;
use tempfile::TempDir;

/// The longest wait for an answer. Streams of messages end when the client ends.
const PATIENCE: Duration = Duration::from_secs(5);

/// Servers that run as long as the process, and the folder of their memory.
type Running = ([Server; 2], TempDir);

/// Their addresses, and what keeps them.
static SERVERS: LazyLock<([SocketAddr; 2], Mutex<Running>)> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let database = folder.path().join("live.db");
    write_memory(&database);
    let server = |token: Option<&str>| {
        let mut options = Options::new(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)));
        options.token = token.map(|token| Token::new(token).expect("a token"));
        let sources = Sources {
            bus: Arc::new(Bus::new(about())),
            metrics: Arc::new(Metrics::default()),
            liveness: Arc::new(Liveness::new(Duration::from_millis(100))),
            database: Some(database.clone()),
            forget: Some(Arc::new(|_, _| Ok(Deleted::default()))),
            broker: None,
            acknowledge: Some(Arc::new(|_| true)),
            clock: Arc::new(|| Clock {
                now_ms: NOW_MS,
                offset_s: 3_600,
            }),
        };
        Server::start(options, sources).expect("a server")
    };
    let servers = [
        server(None),
        server(Some("0123456789abcdef0123456789abcdef")),
    ];
    let addresses = servers.each_ref().map(Server::address);
    (addresses, Mutex::new((servers, folder)))
});

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else {
        return;
    };
    let server = SERVERS.0[usize::from(kind % 2)];
    let mut stream = TcpStream::connect(server).expect("the server accepts");
    stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    // The server may close a connection before it has read everything.
    let _ = stream.write_all(bytes);
    let _ = stream.shutdown(Shutdown::Write);
    let mut answer = Vec::new();
    if let Err(e) = stream.read_to_end(&mut answer) {
        let late = matches!(
            e.kind(),
            std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut
        );
        assert!(!late, "no end of the answer");
    }
});
