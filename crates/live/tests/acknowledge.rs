//! A fall that a user acknowledges ends for everybody: listeners, memory, and presence.

#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a test")]

use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::time::Duration;

use radarllm_base::{Clip, Clutter, PointFrame, Provenance, RadarPoint};
use radarllm_live::bus::{Bus, Reader};
use radarllm_live::http::{Options, Server, Sources};
use radarllm_live::metrics::Metrics;
use radarllm_memory::Clock;
use radarllm_monitor::liveness::Liveness;
use radarllm_monitor::messages::{About, Body, FallState, Message};
use radarllm_monitor::pipeline::{
    Arrival, Describe, Described, Output, Pipeline, PipelineOptions, StreamInfo, WindowContext,
};
use radarllm_monitor::rows::{Event, EventKind, Origin};

const START_MS: i64 = 1_795_455_492_000;
const HEIGHT_M: f64 = 1.0;

struct Silent;

impl Describe for Silent {
    fn describe(&mut self, _: &Clip, _: WindowContext) -> Described {
        Described::Abstained {
            reason: "a test".into(),
        }
    }
}

/// Somebody stands, falls at 5 s and lies.
fn frame(number: u32) -> PointFrame {
    let t_s = number as f32 / 10.0;
    let height_m = (1.7 - 2.0 * (t_s - 5.0).max(0.0)).max(0.3);
    let point = |i: u32| RadarPoint {
        x_m: 0.1 * (t_s * 2.0).sin(),
        y_m: 2.5,
        z_m: height_m * (i + 1) as f32 / 12.0 - HEIGHT_M as f32,
        range_m: 2.5,
        velocity_mps: 0.5,
        intensity_db: 20.0,
    };
    PointFrame {
        frame: number,
        time_s: 0.0,
        points: (0..12).map(point).collect(),
        board: None,
    }
}

fn pipeline() -> Pipeline {
    let stream = StreamInfo {
        frame_period_s: 0.1,
        radar_height_m: HEIGHT_M,
        is_height_assumed: false,
        radar: "test".into(),
        provenance: Provenance::simulated("builtin:fall", 1),
        clutter: Clutter::Settled,
    };
    let options = PipelineOptions::default();
    Pipeline::new(stream, &options, Box::new(Silent), Arc::default()).unwrap()
}

/// Publishes messages and returns the events.
fn publish(bus: &Bus, outputs: Vec<Output>) -> Vec<Event> {
    let event = |output| match output {
        Output::Message(stamp, body) => {
            bus.publish(stamp, body);
            None
        }
        Output::Event(event) => Some(event),
        Output::Row { .. } => None,
    };
    outputs.into_iter().filter_map(event).collect()
}

fn falls(reader: &Reader) -> Vec<(u64, FallState)> {
    let mut falls = Vec::new();
    while let Ok(published) = reader.recv_timeout(Duration::ZERO) {
        let message: Message = serde_json::from_str(&published.json).unwrap();
        if let Body::Fall(fall) = message.at.what {
            falls.push((fall.id, fall.state));
        }
    }
    falls
}

/// Lets somebody fall and lie for some frames, acknowledges it, and returns what listeners and the memory were told.
fn acknowledged_after(n_frames: u32) -> (Vec<(u64, FallState)>, Vec<Event>) {
    let about = About {
        name: "lounge".into(),
        origin: Origin {
            source: "sim:".into(),
            radar: "test".into(),
            model: "none".into(),
            decoder: "greedy".into(),
            version: "0".into(),
            synthetic: true,
        },
        radar_height_m: HEIGHT_M,
        frame_period_s: 0.1,
        zones: Vec::new(),
    };
    let bus = Arc::new(Bus::new(about));
    let (acknowledge, acknowledged) = channel();
    let sources = Sources {
        bus: Arc::clone(&bus),
        metrics: Arc::<Metrics>::default(),
        liveness: Arc::new(Liveness::new(Duration::from_millis(100))),
        database: None,
        forget: None,
        broker: None,
        acknowledge: Some(Arc::new(move |fall| acknowledge.send(fall).is_ok())),
        clock: Arc::new(|| Clock {
            now_ms: START_MS,
            offset_s: 0,
        }),
    };
    let server = Server::start(Options::new(([127, 0, 0, 1], 0).into()), sources).unwrap();
    let reader = bus.subscribe();
    let mut pipeline = pipeline();
    for number in 0..n_frames {
        let outputs = pipeline.push_frame(frame(number), Arrival::Replayed(START_MS), true);
        publish(&bus, outputs);
    }
    let mut stream = TcpStream::connect(server.address()).unwrap();
    let request = format!(
        "POST /api/falls/1/acknowledge HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n",
        server.address()
    );
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 202"), "{answer}");
    let fall = acknowledged.try_recv().unwrap();
    let events = publish(&bus, pipeline.acknowledge(fall));
    // Once is enough, and there is no other fall.
    assert!(pipeline.acknowledge(fall).is_empty());
    assert!(pipeline.acknowledge(2).is_empty());
    assert!(!bus.has_fall(1));
    // Whoever still lies there does not fall again.
    for number in n_frames..n_frames + 300 {
        let outputs = pipeline.push_frame(frame(number), Arrival::Replayed(START_MS), true);
        publish(&bus, outputs);
    }
    (falls(&reader), events)
}

#[test]
fn a_suspected_fall_is_dismissed_and_a_confirmed_one_has_recovered() {
    use FallState::{Confirmed, Dismissed, Recovered, Suspected};
    let (reported, events) = acknowledged_after(100);
    assert_eq!(reported, [(1, Suspected), (1, Dismissed)]);
    assert_eq!(events[0].kind, EventKind::Dismissed);
    assert_eq!(events[0].data.as_ref().unwrap()["acknowledged"], true);
    let (reported, events) = acknowledged_after(300);
    assert_eq!(reported, [(1, Suspected), (1, Confirmed), (1, Recovered)]);
    assert_eq!(events[0].kind, EventKind::Recovered);
    assert_eq!(events[0].data.as_ref().unwrap()["acknowledged"], true);
}
