//! A recording through everything: rows of the memory, the page, questions.

#![allow(
    clippy::disallowed_methods,
    clippy::panic,
    clippy::unwrap_used,
    reason = "a test"
)]

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};

use radarllm::{Captioner, Clutter, DEFAULT_RADAR, Provenance};
use radarllm_base::SourceInfo;
use radarllm_io::live::{LiveCounts, LiveEvent, LiveSource};
use radarllm_live::local_time::now_ms;
use radarllm_live::room::RoomOptions;
use radarllm_live::{Input, Live, LiveOptions, Speed, http};
use radarllm_memory::store::{ActivityQuery, EventQuery};
use radarllm_memory::{Clock, Store, Timeline, ask};
use radarllm_monitor::rows::{ActivityRow, Event, EventKind, Origin};

const DEADLINE: Duration = Duration::from_secs(120);

fn options(database: Option<&Path>) -> LiveOptions {
    let page = http::Options::new(([127, 0, 0, 1], 0).into());
    LiveOptions {
        name: "lounge".into(),
        page: Some(page),
        database: database.map(Path::to_path_buf),
        ..LiveOptions::default()
    }
}

fn squats(speed: Speed, repeats: bool) -> Input {
    let source = radarllm::open("builtin:squat?repetitions=6");
    Input::replay("squats", source.points().unwrap(), speed, repeats).unwrap()
}

fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < DEADLINE, "{what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn rows_of(speed: Speed) -> Vec<ActivityRow> {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("live.db");
    let captioner = Captioner::bundled().unwrap();
    let live = Live::start(squats(speed, false), captioner, options(Some(&database))).unwrap();
    wait_until("the recording ends", || live.is_over());
    drop(live);
    let timeline = Timeline::open(&database).unwrap();
    let page = timeline
        .activities(&ActivityQuery::default(), None, 100)
        .unwrap();
    let clock = Clock {
        now_ms: now_ms(),
        offset_s: 0,
    };
    let answer = ask(&timeline, "did anybody squat today?", clock).unwrap();
    assert!(answer.answer.contains("squatted"), "{}", answer.answer);
    assert!(answer.answer.contains("simulat"), "{}", answer.answer);
    page.rows
}

#[test]
fn a_replay_has_the_time_of_its_recording() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("live.db");
    let start_ms = 1_700_000_000_000;
    let input = squats(Speed::Max, false).starting_at(start_ms).unwrap();
    let captioner = Captioner::bundled().unwrap();
    let live = Live::start(input, captioner, options(Some(&database))).unwrap();
    wait_until("the recording ends", || live.is_over());
    drop(live);
    let timeline = Timeline::open(&database).unwrap();
    let rows = timeline
        .activities(&ActivityQuery::default(), None, 100)
        .unwrap()
        .rows;
    assert!(!rows.is_empty());
    for row in rows {
        let since_start_ms = row.activity.start_ms - start_ms;
        assert!((0..30_000).contains(&since_start_ms), "{since_start_ms}");
    }
    let room = Input::room(&RoomOptions::default()).unwrap();
    assert!(room.starting_at(start_ms).is_err());
}

#[test]
fn rows_do_not_depend_on_the_speed() {
    let fast = rows_of(Speed::Max);
    let slow = rows_of(Speed::Times(20.0));
    let parts = |rows: &[ActivityRow]| -> Vec<(i64, String, String, Option<f64>, u32)> {
        let part = |row: &ActivityRow| {
            let a = &row.activity;
            let length_ms = a.end_ms - a.start_ms;
            (
                length_ms,
                a.action.clone(),
                a.caption.clone(),
                a.confidence,
                a.windows,
            )
        };
        rows.iter().map(part).collect()
    };
    assert!(!fast.is_empty());
    assert_eq!(parts(&fast), parts(&slow));
    assert!(fast.iter().any(|row| row.activity.action == "squat"));
    assert!(fast.iter().all(|row| row.origin.synthetic));
}

/// The answer of the server to a request, head and body.
fn get(live: &Live, path: &str, host: &str) -> String {
    request(live, "GET", path, host)
}

fn request(live: &Live, method: &str, path: &str, host: &str) -> String {
    let mut stream = TcpStream::connect(live.address().unwrap()).unwrap();
    stream.set_read_timeout(Some(DEADLINE)).unwrap();
    let request = format!("{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

#[test]
fn the_page_shows_what_is_seen_and_refuses_strangers() {
    let captioner = Captioner::bundled().unwrap();
    let live = Live::start(squats(Speed::Times(20.0), true), captioner, options(None)).unwrap();
    let host = live.address().unwrap().to_string();
    let page = get(&live, "/", &host);
    assert!(page.starts_with("HTTP/1.1 200") && page.contains("live.js"));
    assert!(get(&live, "/", "evil.example").starts_with("HTTP/1.1 421"));
    wait_until("a sentence is told", || {
        get(&live, "/api/state", &host).contains("a person squats")
    });
    let metrics = get(&live, "/metrics", &host);
    assert!(metrics.contains("radarllm_frames_total"), "{metrics}");
    assert!(get(&live, "/healthz", &host).starts_with("HTTP/1.1 200"));
    let began = Instant::now();
    drop(live);
    assert!(began.elapsed() < Duration::from_secs(5));
}

#[test]
fn an_open_address_wants_a_token_and_names_are_checked() {
    let start = |options| {
        let captioner = Captioner::bundled().unwrap();
        let live = Live::start(squats(Speed::Max, false), captioner, options);
        live.err().map(|e| e.to_string()).unwrap_or_default()
    };
    let open = LiveOptions {
        page: Some(http::Options::new(([0, 0, 0, 0], 0).into())),
        ..LiveOptions::default()
    };
    assert!(start(open).contains("token"));
    let named = LiveOptions {
        name: "Living room".into(),
        ..options(None)
    };
    assert!(start(named).contains("a to z"));
}

#[test]
fn a_fall_of_the_run_before_is_open_until_somebody_says_otherwise() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("live.db");
    let origin = Origin {
        source: "sim:".into(),
        radar: DEFAULT_RADAR.into(),
        model: "none".into(),
        decoder: "none".into(),
        version: "0".into(),
        synthetic: true,
    };
    let event = |kind, age_s: i64| Event {
        at_ms: now_ms() - age_s * 1_000,
        kind,
        person: Some(2),
        data: Some(serde_json::json!({ "fall": 3, "dwell_s": 0.0, "place_m": [0.0, 7.0] })),
    };
    let mut store = Store::open(&database, now_ms()).unwrap().store;
    let written = store.write(|batch| {
        batch.insert_event(&event(EventKind::Suspected, 60), &origin)?;
        batch.insert_event(&event(EventKind::Confirmed, 40), &origin)
    });
    written.unwrap();
    drop(store);
    let input = Input::room(&RoomOptions::default()).unwrap();
    let captioner = Captioner::bundled().unwrap();
    let live = Live::start(input, captioner, options(Some(&database))).unwrap();
    let host = live.address().unwrap().to_string();
    let is_open = || {
        let state = get(&live, "/api/state", &host);
        assert!(!state.contains("\"absent\""), "{state}");
        state.contains(r#""id":3,"state":"confirmed","person":2"#)
    };
    assert!(is_open());
    let answer = request(&live, "POST", "/api/falls/3/acknowledge", &host);
    assert!(answer.starts_with("HTTP/1.1 202"), "{answer}");
    wait_until("the fall ends", || !is_open());
    drop(live);
    let timeline = Timeline::open(&database).unwrap();
    let query = EventQuery {
        kinds: vec![EventKind::Recovered],
        ..EventQuery::default()
    };
    let ended = timeline.events(&query, None, 10).unwrap().rows;
    assert_eq!(ended.len(), 1);
    let data = ended[0].event.data.clone().unwrap();
    assert_eq!(
        (&data["fall"], &data["acknowledged"]),
        (&3.into(), &true.into())
    );
}

/// A radar whose driver has a bug.
struct Faulty;

impl LiveSource for Faulty {
    fn next(&mut self, _timeout: Duration) -> radarllm::Result<Option<LiveEvent>> {
        panic!("wanted")
    }

    fn about(&self) -> SourceInfo {
        SourceInfo {
            frame_period_s: 0.1,
            radar: DEFAULT_RADAR.into(),
            radar_height_m: 1.0,
            is_height_assumed: false,
            clutter: Clutter::Settled,
            provenance: Provenance::simulated("faulty", 0),
        }
    }

    fn counts(&self) -> LiveCounts {
        LiveCounts::default()
    }
}

#[test]
fn a_panic_of_a_thread_ends_the_radar_and_reaches_the_caller() {
    let input = Input::radar("faulty", Box::new(Faulty));
    let live = Live::start(input, Captioner::bundled().unwrap(), options(None)).unwrap();
    wait_until("the radar ends", || live.is_over());
    let stopped = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| live.stop()));
    let panic = stopped.unwrap_err();
    assert_eq!(panic.downcast_ref(), Some(&"wanted"));
}
