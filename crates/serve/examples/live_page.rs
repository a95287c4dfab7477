//! The live page with a scripted room, to look at without a radar:
//! `cargo run --release -p radarllm-serve --example live_page [ADDRESS [TOKEN]]`.
//!
//! Nothing here is measured or simulated by the virtual radar: a few points circle around a walking figure, and sentences
//! come from a list. Everything is marked as simulated. After half a minute the figure falls; it gets up later.

use std::error::Error;
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use radarllm_base::RadarPoint;
use radarllm_serve::bus::Bus;
use radarllm_serve::http::{Forget, Options, Server, Sources, Token};
use radarllm_serve::messages::{
    About, Body, Fall, FallState, Frame, Health, Now, Person, Presence, PresenceState, SourceState,
    Stamp, Zone,
};
use radarllm_serve::metrics::Metrics;
use radarllm_serve::store::{Activity, ActivityRow, Origin, Store};
use radarllm_serve::vitals::Vitals;
use radarllm_serve::{Clock, StoreError};

const FRAME_PERIOD: Duration = Duration::from_millis(100);
const RADAR_HEIGHT_M: f32 = 1.25;
/// What the figure does in turn, for 6 s each.
const SCRIPT: [(&str, &str); 6] = [
    ("walk", "a person walks in a circle"),
    ("sit_down", "a person sits down on a chair"),
    ("stand_up", "a person gets up from a chair"),
    ("wave", "a person waves with the left arm"),
    ("walk", "a person walks to the right"),
    ("fall", "a person walks and falls to the floor"),
];
const SCENE_FRAMES: usize = 60;

fn main() -> Result<(), Box<dyn Error>> {
    let address = std::env::args().nth(1);
    let address = address.as_deref().unwrap_or("127.0.0.1:8741").parse()?;
    let mut options = Options::new(address);
    options.token = std::env::args()
        .nth(2)
        .map(|t| Token::new(&t))
        .transpose()?;
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("live.db");
    let store = Arc::new(Mutex::new(Store::open(&path, now_ms())?.store));
    let bus = Arc::new(Bus::new(about()));
    let (metrics, vitals) = (
        Arc::new(Metrics::default()),
        Arc::new(Vitals::new(FRAME_PERIOD)),
    );
    let forgetting = Arc::clone(&store);
    let forget: Forget =
        Arc::new(move |from_ms, to_ms| lock(&forgetting).forget(Some(from_ms), to_ms));
    let sources = Sources {
        bus: Arc::clone(&bus),
        metrics: Arc::clone(&metrics),
        vitals: Arc::clone(&vitals),
        database: Some(path),
        forget: Some(forget),
        clock: Arc::new(|| Clock {
            now_ms: now_ms(),
            offset_s: 0,
        }),
    };
    let server = Server::start(options, sources)?;
    println!("http://{}/", server.address());
    for n in 0.. {
        let stamp = Stamp {
            utc_ms: now_ms(),
            t_s: n as f64 * FRAME_PERIOD.as_secs_f64(),
        };
        vitals.frame();
        vitals.step();
        metrics.frames_used.add(1);
        bus.publish(stamp, Body::Frame(frame(n)));
        tell(&bus, stamp, n);
        if n % SCENE_FRAMES == SCENE_FRAMES - 1 {
            remember(&bus, &mut lock(&store), stamp, n)?;
        }
        std::thread::sleep(FRAME_PERIOD);
    }
    Ok(())
}

fn about() -> About {
    About {
        name: "lounge".into(),
        origin: Origin {
            source: "script:".into(),
            radar: "awr1843boost".into(),
            model: "none".into(),
            decoder: "list".into(),
            version: env!("CARGO_PKG_VERSION").into(),
            synthetic: true,
        },
        radar_height_m: RADAR_HEIGHT_M.into(),
        frame_period_s: FRAME_PERIOD.as_secs_f64(),
        zones: vec![Zone {
            name: "hall".into(),
            kind: "door".into(),
            polygon_m: vec![[1.5, 4.5], [2.5, 4.5], [2.5, 5.5], [1.5, 5.5]],
        }],
    }
}

fn scene(n: usize) -> (&'static str, &'static str) {
    SCRIPT[n / SCENE_FRAMES % SCRIPT.len()]
}

fn frame(n: usize) -> Frame {
    let angle = n as f32 * 0.03;
    let (x_m, y_m) = (1.2 * angle.cos(), 3.0 + 1.2 * angle.sin());
    let is_down = scene(n).0 == "fall" && n % SCENE_FRAMES > 20;
    let height_m = if is_down { 0.3 } else { 1.75 };
    let points: Vec<RadarPoint> = (0..60)
        .map(|i| {
            let part = i as f32 / 60.0;
            let turn = i as f32 * 2.4 + n as f32;
            RadarPoint {
                x_m: x_m + 0.22 * turn.sin(),
                y_m: y_m + 0.16 * (turn * 1.7).cos(),
                z_m: part * height_m - RADAR_HEIGHT_M,
                velocity_mps: 1.5 * angle.cos() + 0.6 * turn.sin(),
                intensity_db: 10.0 + 20.0 * part,
                ..RadarPoint::default()
            }
        })
        .collect();
    let person = Person {
        id: 1,
        x_m: x_m.into(),
        y_m: y_m.into(),
        vx_mps: f64::from(-0.36 * angle.sin()),
        vy_mps: f64::from(0.36 * angle.cos()),
        height_m: Some(height_m.into()),
    };
    Frame::new(&points, vec![person])
}

/// Sentences every 2 s, presence and health every 5 s, and the states of the fall.
fn tell(bus: &Bus, stamp: Stamp, n: usize) {
    let (action, caption) = scene(n);
    if n.is_multiple_of(20) {
        bus.publish(
            stamp,
            Body::Now(Now {
                person: Some(1),
                caption: Some(caption.into()),
                label: action.into(),
                confidence: Some(0.64),
                window_s: 6.0,
                reason: None,
                provisional: true,
                synthetic: true,
            }),
        );
    }
    if n.is_multiple_of(50) {
        bus.publish(
            stamp,
            Body::Presence(Presence {
                state: PresenceState::Present,
                people: 1,
                why: Some("person 1 moves".into()),
            }),
        );
        bus.publish(
            stamp,
            Body::Health(Health {
                source: SourceState::Ok,
                degraded: None,
                frames_used: n as u64,
                frames_lost: 0,
                frames_dropped: 0,
                problems: Vec::new(),
            }),
        );
    }
    let cycle = SCENE_FRAMES * SCRIPT.len();
    let states = [
        (5 * SCENE_FRAMES + 21, FallState::Suspected, 0.0),
        (5 * SCENE_FRAMES + 41, FallState::Confirmed, 2.0),
        (40, FallState::Recovered, 6.0),
    ];
    for (at, state, dwell_s) in states {
        if n % cycle == at && n > 40 {
            let id = (n - 41) as u64 / cycle as u64;
            bus.publish(
                stamp,
                Body::Fall(Fall {
                    id,
                    state,
                    person: Some(1),
                    dwell_s,
                    synthetic: true,
                }),
            );
        }
    }
}

fn remember(bus: &Bus, store: &mut Store, stamp: Stamp, n: usize) -> Result<(), StoreError> {
    let (action, caption) = scene(n);
    let activity = Activity {
        start_ms: stamp.utc_ms - 6_000,
        end_ms: stamp.utc_ms,
        person: 1,
        action: action.into(),
        caption: caption.into(),
        confidence: Some(0.64),
        windows: 3,
        points: 3_600,
        place_m: None,
    };
    let origin = about().origin;
    let id = store.write(|batch| batch.insert_activity(&activity, &origin))?;
    let row = ActivityRow {
        id,
        activity,
        origin,
    };
    bus.publish(stamp, Body::Activity(Box::new(row)));
    Ok(())
}

fn lock(store: &Mutex<Store>) -> std::sync::MutexGuard<'_, Store> {
    store
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn now_ms() -> i64 {
    let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
    since_1970.map_or(0, |d| d.as_millis() as i64)
}
