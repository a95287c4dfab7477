//! Points of a room through the tracker to presence and falls.

#![allow(clippy::unwrap_used, reason = "a test")]

use radarllm_base::{PointFrame, RadarPoint};
use radarllm_monitor::clock::StreamClock;
use radarllm_monitor::falls::FallState;
use radarllm_monitor::presence::Presence;
use radarllm_monitor::watch::{Watch, WatchOptions};
use radarllm_monitor::zones::{Zone, ZoneKind, Zones};

/// Height of the radar, m.
const RADAR_M: f32 = 1.0;
const START_MS: i64 = 1_795_455_492_000;

/// A body at a place, `height_m` high, as a column of points that move.
fn body([x_m, y_m]: [f32; 2], height_m: f32, n_points: u32) -> Vec<RadarPoint> {
    let share = |i: u32| (i + 1) as f32 / n_points as f32;
    (0..n_points)
        .map(|i| RadarPoint {
            x_m: x_m + 0.1 * (share(i) - 0.5),
            y_m,
            z_m: height_m * share(i) - RADAR_M,
            range_m: x_m.hypot(y_m),
            velocity_mps: 0.5,
            intensity_db: 20.0,
        })
        .collect()
}

/// What somebody does at a time: comes in by the door, falls, lies, gets up, goes out by the door.
fn points(t_s: f32) -> Vec<RadarPoint> {
    let [door, middle] = [[2.2, 2.5], [0.0, 2.5]];
    let between = |share: f32| [door[0] + share * (middle[0] - door[0]), 2.5];
    match t_s {
        2.0..5.0 => body(between((t_s - 2.0) / 3.0), 1.7, 12),
        5.0..10.0 => body(middle, 1.7, 12),
        // Down within 0.7 s.
        10.0..10.7 => body(middle, 1.7 - 2.0 * (t_s - 10.0), 12),
        10.7..12.0 => body(middle, 0.3, 10),
        // Hardly anything moves.
        12.0..50.0 => body(
            middle,
            0.2,
            u32::from(((t_s * 10.0) as u32).is_multiple_of(9)),
        ),
        50.0..52.0 => body(middle, 0.3 + 0.7 * (t_s - 50.0), 12),
        52.0..56.0 => body(middle, 1.7, 12),
        56.0..59.0 => body(between(1.0 - (t_s - 56.0) / 3.0), 1.7, 12),
        _ => Vec::new(),
    }
}

/// Changes, with their times, s, rounded.
type Changes<T> = Vec<(i64, T)>;

/// A cat that walks to and fro all the time, in front of a place.
fn cat(t_s: f32, [x_m, y_m]: [f32; 2]) -> Vec<RadarPoint> {
    body([x_m + (t_s * 0.2).sin(), y_m], 0.3, 6)
}

fn door() -> Zone {
    Zone {
        name: "door".into(),
        kind: ZoneKind::Door,
        polygon_m: vec![[1.8, 2.0], [2.8, 2.0], [2.8, 3.0], [1.8, 3.0]],
        below_m: None,
    }
}

/// Changes of presence and of falls.
fn watch(
    zones: &[Zone],
    points: impl Fn(f32) -> Vec<RadarPoint>,
) -> (Changes<Presence>, Changes<FallState>) {
    let zones = Zones::new(zones.to_vec()).unwrap();
    let mut clock = StreamClock::new(0.1).unwrap();
    let options = WatchOptions {
        zones,
        ..WatchOptions::default()
    };
    let mut watch = Watch::new(&options, RADAR_M.into()).unwrap();
    let (mut changes, mut fallen) = (Vec::new(), Vec::new());
    for n in 0..1_200u32 {
        let tick = clock.replayed(u64::from(n), START_MS);
        let frame = PointFrame {
            frame: n,
            time_s: tick.t_s,
            points: points(n as f32 / 10.0),
            board: None,
        };
        let seen = watch.push(&frame);
        let at_s = tick.t_s.round() as i64;
        if seen.presence.has_changed {
            changes.push((at_s, seen.presence.presence));
        }
        fallen.extend(seen.falls.iter().map(|event| (at_s, event.state)));
    }
    (changes, fallen)
}

#[test]
fn somebody_comes_falls_gets_up_and_leaves() {
    let (changes, fallen) = watch(&[door()], points);
    // Tracked 0.7 s after the first points, present 1 s later. While the person lies, nobody is tracked.
    let states: Vec<Presence> = changes.iter().map(|(_, presence)| *presence).collect();
    let expected = [
        Presence::Present,
        Presence::Held,
        Presence::Present,
        Presence::Absent,
    ];
    assert_eq!(states, expected, "{changes:?}");
    assert_eq!((changes[0].0, changes[1].0), (4, 14));
    // Seen last in the door at 59 s; the tracker waits 2 s.
    assert!((60..=62).contains(&changes[3].0), "{changes:?}");
    let states: Vec<FallState> = fallen.iter().map(|(_, state)| *state).collect();
    let expected = [
        FallState::Suspected,
        FallState::Confirmed,
        FallState::Recovered,
    ];
    assert_eq!(states, expected, "{fallen:?}");
    assert_eq!((fallen[0].0, fallen[1].0), (11, 31));
    assert!((52..=54).contains(&fallen[2].0), "{fallen:?}");
}

#[test]
fn without_a_door_presence_is_held() {
    let (changes, fallen) = watch(&[], points);
    let (last_s, last) = changes[changes.len() - 1];
    assert_eq!(last, Presence::Absent);
    assert!((90..=92).contains(&last_s), "{changes:?}");
    assert_eq!(fallen.len(), 3);
}

/// The same states, at most 2 s later: heights are known later than places.
fn assert_later<T: PartialEq + std::fmt::Debug>(found: &Changes<T>, expected: &Changes<T>) {
    let is_later = |((at_s, state), (expected_s, expected)): (&(i64, T), &(i64, T))| {
        state == expected && (0..=2).contains(&(at_s - expected_s))
    };
    let all = found.len() == expected.len() && found.iter().zip(expected).all(is_later);
    assert!(all, "{found:?}, expected {expected:?}");
}

#[test]
fn a_cat_is_nobody_where_what_is_low_is_ignored() {
    let floor = Zone {
        name: "floor".into(),
        kind: ZoneKind::Ignore,
        polygon_m: vec![[-4.0, 0.0], [4.0, 0.0], [4.0, 6.0], [-4.0, 6.0]],
        below_m: Some(0.5),
    };
    let far = |t_s: f32| cat(t_s, [-2.5, 5.0]);
    let (changes, _) = watch(&[door()], far);
    assert_eq!(changes.len(), 1, "without such a zone it is somebody");
    let (changes, fallen) = watch(&[door(), floor.clone()], far);
    assert_eq!((changes, fallen), (Vec::new(), Vec::new()));

    // Whoever falls was higher, and is found as without the cat.
    let (alone, alone_fallen) = watch(&[door()], points);
    let both = |t_s: f32| [points(t_s), far(t_s)].concat();
    let (changes, fallen) = watch(&[door(), floor.clone()], both);
    assert_later(&fallen, &alone_fallen);
    assert_later(&changes, &alone);

    // A cat that passes whoever lies there may get that number from the tracker: the fall is confirmed all the same, and
    // stays open until somebody says that it has ended.
    let beside = |t_s: f32| [points(t_s), cat(t_s, [-1.5, 3.5])].concat();
    let (_, fallen) = watch(&[door(), floor], beside);
    assert_eq!(fallen, alone_fallen[..2]);
}
