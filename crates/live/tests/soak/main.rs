//! A day of a running radar in a few minutes: everything but the radar is what runs, with the default model.
//!
//! The radar is a script. Motions are simulated once with physics and noise and replayed at other places, mirrored, turned
//! and moved; empty rooms have single points that are nothing. The clock is that of the script. One viewer reads the page,
//! and the broker is the one of the tests of MQTT.
//!
//! An hour is part of the ordinary tests. The day:
//!
//! ```text
//! cargo test --release -p radarllm-live --test soak -- --ignored --nocapture
//! ```
//!
//! With `RADARLLM_SOAK_SEED=N` it is another day: other bodies in motion, places and times.

#![allow(
    clippy::disallowed_methods,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "a test"
)]

// The tests of MQTT use more of it.
#[allow(dead_code)]
#[path = "../../src/mqtt/tests/broker.rs"]
mod broker;
mod figures;
mod motions;
mod script;
mod watcher;

use std::path::Path;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use radarllm::Captioner;
use radarllm_live::local_time::now_ms;
use radarllm_live::{Input, Live, LiveOptions, http, mqtt};
use radarllm_memory::store::{ActivityQuery, Store};
use radarllm_memory::{Answer, Clock, ask};
use radarllm_monitor::rows::ActivityRow;

use figures::{Figures, Viewer};
use script::{Plan, Progress, Radar, Script, frames};
use watcher::Watcher;

/// The allocator of the command.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const DAY_MS: i64 = 86_400_000;
/// Longest time between two messages. The end, when everything is written, takes seconds; the disk is full for a minute.
const LONGEST_SILENCE: Duration = Duration::from_secs(180);
/// Two runs at once would measure each other.
static ONE: Mutex<()> = Mutex::new(());

const HOUR: Plan = Plan {
    seed: 23,
    n_hours: 1,
    is_busy: |_| true,
    n_visits_an_hour: 9,
    n_falls: 2,
    n_outages: 1,
    upright: &["pace?repetitions=2", "walk+then+pick_up"],
    falls: &["pace+then+fall?pace.repetitions=1&fall.direction=forward&after_s=10"],
    suspended: None,
};

const DAY: Plan = Plan {
    seed: 23,
    n_hours: 24,
    is_busy: |hour| hour == 0 || (6..13).contains(&hour) || (14..23).contains(&hour),
    n_visits_an_hour: 16,
    n_falls: 20,
    n_outages: 12,
    upright: &[
        "pace?repetitions=2",
        "walk+then+pick_up",
        "squat?repetitions=4",
        "walk+then+kneel",
        "walk+then+toe_touch",
        "walk+then+lunge",
        "walk+then+bow",
        "walk+then+crouch",
        "circle?repetitions=2",
        "wave?side=left&repetitions=8",
        "jumping_jack?repetitions=6",
    ],
    falls: &[
        "pace+then+fall?pace.repetitions=1&fall.direction=forward&after_s=10",
        "pace+then+fall?pace.repetitions=1&fall.direction=backward&after_s=10",
        "pace+then+fall?pace.repetitions=1&fall.direction=left&after_s=10",
        "walk+then+stand_still+then+fall?stand_still.duration_s=2&fall.direction=right&after_s=10",
    ],
    suspended: Some(3),
};

/// When the broker is away, frames from the beginning.
struct Away {
    from: u32,
    until: u32,
}

struct Run<'a> {
    plan: &'a Plan,
    away: Vec<Away>,
    /// Whether the disk is full once. Writing is tried again after a minute, in which the radar waits.
    disk_is_full_once: bool,
}

/// What is known after a run.
struct Outcome {
    script: Arc<Script>,
    watcher: Watcher,
    figures: Figures,
    memory: Memory,
    start_ms: i64,
}

fn run(run: &Run, database: &Path) -> Outcome {
    let began = Instant::now();
    let script = Arc::new(Script::new(run.plan));
    let simulated_s = began.elapsed().as_secs_f64();
    // Yesterday, so that nothing of it is in the future or too old to be kept.
    let start_ms = now_ms() / DAY_MS * DAY_MS - DAY_MS;
    let progress = Arc::new(Progress::default());
    let clock_ms = Arc::new(AtomicI64::new(start_ms));
    let radar = Radar::new(
        Arc::clone(&script),
        Arc::clone(&progress),
        Arc::clone(&clock_ms),
        start_ms,
    );
    let input = Input::radar("soak", Box::new(radar))
        .with_clock(Arc::new(move || clock_ms.load(Ordering::Relaxed)));
    let mut broker = Some(broker::Broker::start());
    let address = broker.as_ref().unwrap().address;
    let options = LiveOptions {
        name: "soak".into(),
        page: Some(http::Options::new(([127, 0, 0, 1], 0).into())),
        database: Some(database.into()),
        broker: Some(mqtt::Options {
            allow_synthetic: true,
            ..mqtt::Options::new(address.to_string().parse().unwrap())
        }),
        ..LiveOptions::default()
    };
    // From the first message on: the radar waits until it is told that its frames were seen.
    let captioner = Captioner::bundled().unwrap();
    let (live, messages) = Live::start_and_listen(input, captioner, options).unwrap();
    let viewer = Viewer::start(live.address().unwrap());
    let began = Instant::now();
    let mut heard_at = began;
    let mut watcher = Watcher::default();
    let mut figures = Figures::new(database);
    let mut full_at = script
        .quiet
        .get(script.quiet.len() / 2)
        .filter(|_| run.disk_is_full_once);
    let mut failures = None;
    let mut n_broker_losses = 0;
    while !live.is_over() {
        let Ok(message) = messages.recv_timeout(Duration::from_millis(200)) else {
            assert!(heard_at.elapsed() < LONGEST_SILENCE, "nothing is told");
            continue;
        };
        heard_at = Instant::now();
        let Some(frame) = watcher.take(&message.json) else {
            continue;
        };
        // While the broker is away.
        let is_away = run.away.iter().any(|a| (a.from..a.until).contains(&frame));
        match &broker {
            Some(_) if is_away => broker = None,
            None if !is_away => {
                let again = broker::Broker::start_at(address);
                again.wait("the radar is online again", |state| {
                    let topic = "radarllm/soak/availability";
                    (state.retained.get(topic).map(String::as_str) == Some("online")).then_some(())
                });
                n_broker_losses += 1;
                broker = Some(again);
            }
            _ => {}
        }
        // The messages that the broker of the tests remembers are not the memory of the radar.
        if let Some(broker) = broker.as_ref().filter(|_| frame.is_multiple_of(64)) {
            watcher.heard(std::mem::take(&mut broker.state().messages));
        }
        if full_at.is_some_and(|at| frame >= *at) {
            full_at = None;
            failures = Some(live.metrics().store_failures.get());
            figures::limit_file_size(Some(0));
        }
        if failures.is_some_and(|before| live.metrics().store_failures.get() > before) {
            failures = None;
            figures::limit_file_size(None);
            // Then writing is tried again.
            std::thread::sleep(Duration::from_secs(61));
        }
        figures.look(frame);
        progress.tell(frame);
    }
    figures.wall_s = began.elapsed().as_secs_f64();
    figures.simulated_s = simulated_s;
    figures.count(live.metrics());
    if let Some(broker) = &broker {
        watcher.heard(std::mem::take(&mut broker.state().messages));
    }
    let stopping = Instant::now();
    drop(live);
    figures.stop_s = stopping.elapsed().as_secs_f64();
    figures.viewer = viewer.end();
    assert_eq!(n_broker_losses, run.away.len());
    assert!(failures.is_none() && full_at.is_none());
    if let Some(broker) = broker {
        let state = broker.state();
        let topic = "radarllm/soak/availability";
        assert_eq!(
            state.retained.get(topic).map(String::as_str),
            Some("offline")
        );
    }
    let memory = Memory::read(database, start_ms, &mut figures);
    memory.forget(database, start_ms, &watcher);
    Outcome {
        script,
        watcher,
        figures,
        memory,
        start_ms,
    }
}

/// What the memory says at the end of the day.
struct Memory {
    last_fall: Answer,
    get_ups: Answer,
    rows: Vec<ActivityRow>,
}

impl Memory {
    fn read(database: &Path, start_ms: i64, figures: &mut Figures) -> Self {
        let store = Store::open(database, now_ms()).unwrap().store;
        store.check_integrity().unwrap();
        let timeline = store.timeline();
        let clock = Clock {
            now_ms: start_ms + DAY_MS - 1,
            offset_s: 0,
        };
        let last_fall = ask(timeline, "when did she last fall?", clock).unwrap();
        let get_ups = ask(timeline, "how often did she get up today?", clock).unwrap();
        figures.answers = vec![last_fall.answer.clone(), get_ups.answer.clone()];
        let (mut rows, mut before) = (Vec::new(), None);
        loop {
            let page = timeline.activities(&ActivityQuery::default(), before, 200);
            let page = page.unwrap();
            rows.extend(page.rows);
            before = page.next;
            if before.is_none() {
                break;
            }
        }
        rows.reverse();
        Self {
            last_fall,
            get_ups,
            rows,
        }
    }

    /// Forgets everything, and looks for sentences in the bytes that are left.
    fn forget(&self, database: &Path, start_ms: i64, watcher: &Watcher) {
        let mut store = Store::open(database, now_ms()).unwrap().store;
        store.forget(None, start_ms + 2 * DAY_MS).unwrap();
        drop(store);
        for suffix in ["", "-wal", "-shm"] {
            let mut path = database.as_os_str().to_owned();
            path.push(suffix);
            let bytes = std::fs::read(path).unwrap_or_default();
            let captions = watcher.captions.iter().map(String::as_str);
            for caption in captions.chain(["a person"]) {
                let mut windows = bytes.windows(caption.len());
                let is_there = windows.any(|w| w == caption.as_bytes());
                assert!(!is_there, "live.db{suffix} still has `{caption}`");
            }
        }
    }

    /// Prints the rows of an action that are not in the script, and what of the script is in no row. `truth` has frames
    /// within the action.
    fn print(&self, action: &str, truth: &[u32], script: &Script, start_ms: i64) {
        let rows: Vec<&ActivityRow> = self
            .rows
            .iter()
            .filter(|r| r.activity.action == action)
            .collect();
        // A row begins and ends with windows.
        let is_of = |row: &ActivityRow, frame: u32| {
            let at_ms = script.utc_ms(start_ms, frame);
            (row.activity.start_ms - 6_000..=row.activity.end_ms + 6_000).contains(&at_ms)
        };
        for frame in truth.iter().filter(|f| !rows.iter().any(|r| is_of(r, **f))) {
            println!("no row: {action} at {} s", frame / 10);
        }
        for row in rows.iter().filter(|r| !truth.iter().any(|f| is_of(r, *f))) {
            let middle_ms = (row.activity.start_ms + row.activity.end_ms) / 2;
            let frame = script.frame_at(start_ms, middle_ms);
            println!(
                "wrong row: {action} at {} s, during {}: {}",
                frame / 10,
                script.what(frame),
                row.activity.caption
            );
        }
        println!(
            "{action}: {} in the script, {} rows",
            truth.len(),
            rows.len()
        );
    }
}

fn check(outcome: &Outcome) {
    let Outcome {
        script,
        watcher,
        figures,
        memory,
        start_ms,
    } = outcome;
    figures.print();
    println!("{} visits, {} rows", script.n_visits, memory.rows.len());
    memory.print("fall", &script.falls, script, *start_ms);
    memory.print("stand_up", &script.get_ups, script, *start_ms);
    watcher.print(&script.falls, script);
    watcher.check_falls(&script.falls);
    // Every frame of the radar has one fate.
    let [used, lost, dropped] = figures.frames;
    assert_eq!(used + lost + dropped, u64::from(script.n_frames));
    assert!(lost > 0 && dropped > 0, "{lost} {dropped}");
    assert!(!watcher.is_occupied, "nobody is there at the end");
    // Only of the frames that come at once.
    assert!(watcher.n_readings_lost <= script::BURST.into());
    assert!(figures.viewer.is_in_order && figures.viewer.n_messages > 1_000);
    assert!(figures.stop_s < 5.0, "{} s", figures.stop_s);
    assert!(figures.largest_log_bytes <= 16 << 20);
    let last_ms = memory.last_fall.last_ms.expect("a fall is remembered");
    let expected_ms = script.utc_ms(*start_ms, script.falls[script.falls.len() - 1]);
    let published = &memory.last_fall.answer;
    assert!(
        (last_ms - expected_ms).abs() < 10_000,
        "{published}: {expected_ms}"
    );
    let n_alarms = match script.falls.len() {
        2 => "The fall alarm was confirmed twice.".to_string(),
        n => format!("The fall alarm was confirmed {n} times."),
    };
    assert!(published.contains(&n_alarms), "{published}");
    let (published, n) = (memory.get_ups.count, script.get_ups.len() as u64);
    assert!(
        published.abs_diff(n) <= 1,
        "published {published} risings of {n}"
    );
}

#[test]
fn an_hour_of_visits_with_two_falls() {
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let run_of_hour = Run {
        plan: &HOUR,
        away: vec![Away {
            from: frames(1_000),
            until: frames(1_100),
        }],
        disk_is_full_once: false,
    };
    check(&run(&run_of_hour, &folder.path().join("live.db")));
}

#[test]
#[ignore = "24 hours of simulated clock take minutes"]
fn a_day_of_visits_with_twenty_falls() {
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let hour = |n: u32| frames(3_600 * n);
    let away = [2, 11, 18].map(|n| Away {
        from: hour(n) + frames(900),
        until: hour(n) + frames(1_800),
    });
    let seed = std::env::var("RADARLLM_SOAK_SEED").ok();
    let plan = Plan {
        seed: seed.map_or(DAY.seed, |seed| seed.parse().unwrap()),
        ..DAY
    };
    let run_of_day = Run {
        plan: &plan,
        away: away.into(),
        disk_is_full_once: true,
    };
    let outcome = run(&run_of_day, &folder.path().join("live.db"));
    check(&outcome);
    let hours = &outcome.figures.hours;
    let (first, last) = (&hours[0], &hours[23]);
    assert!(
        last.memory_kb <= first.memory_kb + (8 << 10),
        "memory grows"
    );
    assert!(hours.iter().all(|h| h.memory_kb < 160_000), "160 MB");
    // A viewer that is too slow loses its connection and comes back.
    assert!(
        hours.iter().all(|h| h.n_files <= first.n_files),
        "open files"
    );
    assert!(outcome.figures.store_failures > 0, "the disk was full");
}
