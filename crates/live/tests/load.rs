//! As many viewers as may look, on loopback: one takes nothing, and the others lose nothing.
//!
//! Ten minutes of it, at the pace of a radar:
//!
//! ```text
//! cargo test --release -p radarllm-live --test load -- --ignored --nocapture
//! ```

#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test")]

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

use radarllm_base::RadarPoint;
use radarllm_live::bus::Bus;
use radarllm_live::http::{MAX_LISTENERS, Options, Server, Sources};
use radarllm_memory::Clock;
use radarllm_monitor::liveness::Liveness;
use radarllm_monitor::messages::{About, Body, Frame, Now, Stamp};
use radarllm_monitor::rows::Origin;

/// Points of a frame: those of several people and of a room, 27 kB as a message.
const POINTS: usize = 2_000;
/// Time between two frames.
const PERIOD: Duration = Duration::from_millis(100);
/// Frames between two sentences.
const STRIDE: u32 = 20;

fn about() -> About {
    About {
        name: "load".into(),
        origin: Origin {
            source: "test:".into(),
            radar: "test".into(),
            model: "none".into(),
            decoder: "greedy".into(),
            version: "0".into(),
            synthetic: true,
        },
        radar_height_m: 1.0,
        frame_period_s: PERIOD.as_secs_f64(),
        zones: Vec::new(),
    }
}

fn serve(bus: &Arc<Bus>) -> Server {
    let sources = Sources {
        bus: Arc::clone(bus),
        metrics: Arc::default(),
        liveness: Arc::new(Liveness::new(PERIOD)),
        database: None,
        forget: None,
        broker: None,
        acknowledge: None,
        clock: Arc::new(|| Clock {
            now_ms: 1_795_455_492_000,
            offset_s: 0,
        }),
    };
    Server::start(Options::new(([127, 0, 0, 1], 0).into()), sources).unwrap()
}

/// A viewer, and the status of the answer that it got.
fn view(address: SocketAddr) -> (BufReader<TcpStream>, String) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(60)))
        .unwrap();
    let request = format!("GET /api/live HTTP/1.1\r\nHost: {address}\r\n\r\n");
    stream.write_all(request.as_bytes()).unwrap();
    let mut lines = BufReader::new(stream);
    let mut first = String::new();
    lines.read_line(&mut first).unwrap();
    let status = first.split(' ').nth(1).unwrap_or_default().to_string();
    (lines, status)
}

/// Reads up to a message of a number. Returns how many messages came, every one of them with the number after that of
/// the one before.
fn read_until(lines: &mut BufReader<TcpStream>, last: u64) -> u64 {
    let (mut line, mut seq, mut n) = (String::new(), None, 0);
    while seq != Some(last) {
        line.clear();
        assert!(
            lines.read_line(&mut line).unwrap() > 0,
            "closed after {seq:?}"
        );
        let Some(json) = line.strip_prefix("data:") else {
            continue;
        };
        let (_, after) = json.split_once("\"seq\":").unwrap();
        let digits = after.find(|c: char| !c.is_ascii_digit()).unwrap();
        let number: u64 = after[..digits].parse().unwrap();
        assert!(
            seq.is_none_or(|seq| number == seq + 1),
            "{number} after {seq:?}"
        );
        assert!(!json.contains("\"type\":\"lag\""), "{seq:?}");
        seq = Some(number);
        n += 1;
    }
    n
}

fn memory_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status
        .lines()
        .find_map(|l| l.strip_prefix("VmRSS:"))
        .unwrap();
    line.trim().trim_end_matches(" kB").parse().unwrap()
}

struct Figures {
    memory_kb: Vec<u64>,
    n_messages: u64,
    frames_lost: u64,
    readers: usize,
}

fn run(n_frames: u32) -> Figures {
    let bus = Arc::new(Bus::new(about()));
    let server = serve(&bus);
    let address = server.address();
    let mut viewers: Vec<_> = (0..MAX_LISTENERS).map(|_| view(address)).collect();
    assert!(viewers.iter().all(|(_, status)| status == "200"));
    assert_eq!(view(address).1, "503");
    let (stalled, _) = viewers.remove(0);
    let last = u64::from(n_frames + n_frames / STRIDE);
    let mut memory = Vec::new();
    let n_messages = std::thread::scope(|threads| {
        let reading: Vec<_> = viewers
            .iter_mut()
            .map(|(lines, _)| threads.spawn(move || read_until(lines, last)))
            .collect();
        let began = Instant::now();
        for n in 1..=n_frames {
            let stamp = Stamp {
                utc_ms: 1_795_455_492_000 + 100 * i64::from(n),
                t_s: f64::from(n) / 10.0,
            };
            let point = RadarPoint {
                x_m: n as f32 / n_frames as f32,
                ..RadarPoint::default()
            };
            let frame = Frame::new(&vec![point; POINTS], Vec::new());
            bus.publish(stamp, Body::Frame(frame));
            if n.is_multiple_of(STRIDE) {
                bus.publish(stamp, Body::Now(now()));
            }
            if n.is_multiple_of(600) || n == 100 || n == n_frames {
                memory.push(memory_kb());
            }
            std::thread::sleep((began + n * PERIOD).saturating_duration_since(Instant::now()));
        }
        let counts: Vec<u64> = reading.into_iter().map(|r| r.join().unwrap()).collect();
        // Each one `hello`, and every message.
        assert!(counts.iter().all(|n| *n == last + 1), "{counts:?}");
        counts.iter().sum()
    });
    // While the viewers are still there.
    let counts = bus.counts();
    drop((viewers, stalled));
    Figures {
        memory_kb: memory,
        n_messages,
        frames_lost: counts.frames_dropped,
        readers: counts.readers,
    }
}

fn now() -> Now {
    Now {
        person: Some(1),
        caption: Some("a person walks".into()),
        label: "walk".into(),
        confidence: Some(0.7),
        window_s: 6.0,
        reason: None,
        provisional: true,
        synthetic: true,
    }
}

#[test]
fn thirty_one_viewers_lose_nothing_while_one_is_stalled() {
    let figures = run(40);
    assert_eq!(figures.n_messages, 31 * (40 + 2 + 1));
}

#[test]
#[ignore = "ten minutes"]
fn ten_minutes_of_thirty_two_viewers() {
    let figures = run(6_000);
    println!(
        "{} messages to 31 viewers, none lost; the stalled one lost {} frames; viewers at the end: {}; memory {:?} kB",
        figures.n_messages, figures.frames_lost, figures.readers, figures.memory_kb
    );
    // The stalled viewer lost its place.
    assert!(figures.frames_lost > 0 && figures.readers == 31);
    let [first, .., last] = figures.memory_kb[..] else {
        panic!("memory was not measured");
    };
    assert!(
        last < first + (16 << 10) && last < 160_000,
        "{first} {last}"
    );
}
