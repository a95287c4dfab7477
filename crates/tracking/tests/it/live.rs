//! One frame at a time.

use std::collections::{BTreeMap, BTreeSet};

use proptest::prelude::*;
use radarllm_base::{PointFrame, RadarPoint};
use radarllm_tracking::{LiveTrack, TrackOptions, Tracker, track};

/// Somebody who walks straight on, seen from one frame to another but for gaps.
#[derive(Clone, Debug)]
struct Walker {
    from: u32,
    until: u32,
    /// Frames without points begin at multiples of this number, and last `unseen` frames.
    every: u32,
    unseen: u32,
    start_m: [f32; 2],
    step_m: [f32; 2],
    n_points: u32,
}

fn walker() -> impl Strategy<Value = Walker> {
    let place = (-2.0f32..2.0, 1.0f32..5.0);
    let step = (-0.1f32..0.1, -0.1f32..0.1);
    let when = (0u32..100, 5u32..120, 10u32..60, 0u32..40);
    (when, place, step, 2u32..8).prop_map(|(when, place, step, n_points)| Walker {
        from: when.0,
        until: when.0 + when.1,
        every: when.2,
        unseen: when.3,
        start_m: [place.0, place.1],
        step_m: [step.0, step.1],
        n_points,
    })
}

/// People, noise, points that are no numbers, and times that stand still or jump.
fn scene() -> impl Strategy<Value = Vec<PointFrame>> {
    let noise = prop::collection::vec((-3.0f32..3.0, 0.5f32..8.0, -3.0f32..3.0), 0..200);
    let steps = prop::collection::vec(
        prop_oneof![20 => Just(0.1), 1 => Just(0.0), 1 => 0.0..4.0],
        160,
    );
    (
        prop::collection::vec(walker(), 0..5),
        noise,
        steps,
        any::<u64>(),
    )
        .prop_map(|(walkers, noise, steps, seed)| {
            let mut time_s = 0.0;
            (0..160u32)
                .map(|i| {
                    time_s += steps[i as usize];
                    let mut points = Vec::new();
                    for w in &walkers {
                        let is_hidden = i % w.every < w.unseen.min(w.every - 1);
                        if !(w.from..w.until).contains(&i) || is_hidden {
                            continue;
                        }
                        let n = (i - w.from) as f32;
                        points.extend((0..w.n_points).map(|j| RadarPoint {
                            x_m: w.start_m[0] + n * w.step_m[0] + 0.07 * j as f32,
                            y_m: w.start_m[1] + n * w.step_m[1] - 0.05 * j as f32,
                            velocity_mps: 10.0 * w.step_m[1],
                            ..RadarPoint::default()
                        }));
                    }
                    for (j, &(x_m, y_m, velocity_mps)) in noise.iter().enumerate() {
                        if (j as u64 ^ seed).wrapping_mul(0x9E37_79B9) % 160 == u64::from(i) {
                            points.push(RadarPoint {
                                x_m: if j % 17 == 0 { f32::NAN } else { x_m },
                                y_m,
                                velocity_mps,
                                ..RadarPoint::default()
                            });
                        }
                    }
                    PointFrame {
                        frame: i,
                        time_s,
                        points,
                        board: None,
                    }
                })
                .collect()
        })
}

fn push_all(frames: &[PointFrame], options: TrackOptions) -> Vec<Vec<LiveTrack>> {
    let mut tracker = Tracker::new(options).unwrap();
    frames.iter().map(|frame| tracker.push(frame)).collect()
}

proptest! {
    #[test]
    fn pushed_frames_give_what_the_whole_recording_gives(frames in scene()) {
        // Without rejoining, numbers can be compared one by one.
        let options = TrackOptions { rejoin_s: 0.0, ..TrackOptions::default() };
        let live = push_all(&frames, options);
        let tracks = track(&frames, &options).unwrap();
        let mut batch_of: BTreeMap<u32, u32> = BTreeMap::new();
        for track in &tracks {
            // From the frame of confirmation on, every frame of a track was there live, to the last bit.
            let mut is_confirmed = false;
            for at in &track.frames {
                let same = |one: &&LiveTrack| {
                    one.place_m == at.place_m && one.velocity_mps == at.velocity_mps && one.points == at.points
                };
                let found = live[at.frame].iter().find(same);
                prop_assert!(found.is_some() || !is_confirmed, "frame {} of track {}", at.frame, track.id);
                if let Some(one) = found {
                    is_confirmed = true;
                    let known = *batch_of.entry(one.id).or_insert(track.id);
                    prop_assert_eq!(known, track.id);
                }
            }
            prop_assert!(is_confirmed, "track {} was never there live", track.id);
        }
        // Nobody else was there.
        let ids: BTreeSet<u32> = live.iter().flatten().map(|one| one.id).collect();
        prop_assert_eq!(ids.len(), tracks.len());
        let numbers: Vec<u32> = ids.into_iter().collect();
        prop_assert_eq!(numbers, (1..=tracks.len() as u32).collect::<Vec<_>>());
    }

    #[test]
    fn nobody_is_there_twice_and_all_numbers_are_finite(frames in scene()) {
        for (people, frame) in push_all(&frames, TrackOptions::default()).iter().zip(&frames) {
            let mut ids = BTreeSet::new();
            for one in people {
                prop_assert!(ids.insert(one.id));
                prop_assert!(one.place_m.iter().chain(&one.velocity_mps).all(|v| v.is_finite()));
                prop_assert_eq!(one.points_of(frame).len(), one.points.len());
            }
        }
    }
}

/// In frame `i` a few points about every place of `at(i)`, walking away at 0.5 m/s.
fn appearances(n: u32, at: impl Fn(u32) -> Vec<[f32; 2]>) -> Vec<PointFrame> {
    let points = |[x, y]: [f32; 2]| {
        (0..5).map(move |j| RadarPoint {
            x_m: x + 0.05 * j as f32,
            y_m: y,
            velocity_mps: 0.5,
            ..RadarPoint::default()
        })
    };
    (0..n)
        .map(|i| PointFrame {
            frame: i,
            time_s: f64::from(i) / 10.0,
            points: at(i).into_iter().flat_map(points).collect(),
            board: None,
        })
        .collect()
}

#[test]
fn a_number_is_given_at_confirmation_and_found_again_after_a_gap() {
    let ids = |frames: &[PointFrame], options: TrackOptions| {
        let live = push_all(frames, options);
        let numbers = |people: &Vec<LiveTrack>| people.iter().map(|one| one.id).collect();
        live.iter().map(numbers).collect::<Vec<Vec<u32>>>()
    };
    let vanish = |i: u32| match i {
        0..20 => vec![[0.0, 2.0 + 0.05 * i as f32]],
        80.. => vec![[0.6, 3.3 + 0.05 * (i - 80) as f32]],
        _ => vec![],
    };
    let frames = appearances(100, vanish);
    let found = ids(&frames, TrackOptions::default());
    for (i, found) in found.iter().enumerate() {
        // Eight frames confirm; after the 20th, a person is kept for 2 s without points.
        let is_there = (7..=39).contains(&i) || i >= 87;
        let expected: &[u32] = if is_there { &[1] } else { &[] };
        assert_eq!(found, expected, "frame {i}");
    }
    // Too far away for the limit.
    let options = TrackOptions {
        rejoin_m: 0.5,
        ..TrackOptions::default()
    };
    assert_eq!(ids(&frames, options)[99], [2]);
    // Two disappeared there: nobody knows who is back.
    let doubt = |i: u32| {
        let mut at = vanish(i);
        if i < 20 {
            at.push([1.4, 3.0]);
        }
        at
    };
    let found = ids(&appearances(100, doubt), TrackOptions::default());
    assert_eq!((&found[10][..], &found[99][..]), (&[1, 2][..], &[3][..]));
    // One disappeared and two appear at once.
    let two = |i: u32| {
        let mut at = vanish(i);
        if i >= 80 {
            at.push([-0.6, 3.0]);
        }
        at
    };
    let found = ids(&appearances(100, two), TrackOptions::default());
    assert_eq!((&found[10][..], &found[99][..]), (&[1][..], &[2, 3][..]));
}

#[test]
fn without_rejoining_not_even_frames_of_equal_time_are_one_track() {
    let appear = |i: u32| match i {
        0..20 => vec![[0.0, 2.0 + 0.05 * i as f32]],
        _ => vec![[2.0, 3.0 + 0.05 * (i - 20) as f32]],
    };
    let mut frames = appearances(50, appear);
    for frame in &mut frames[20..] {
        frame.time_s -= 0.1;
    }
    assert_eq!(frames[19].time_s, frames[20].time_s);
    for (rejoin_s, n) in [(0.0, 2), (10.0, 1)] {
        let options = TrackOptions {
            rejoin_s,
            rejoin_m: 3.0,
            ..TrackOptions::default()
        };
        assert_eq!(track(&frames, &options).unwrap().len(), n, "{rejoin_s} s");
    }
}

#[test]
fn a_day_of_frames_does_not_grow_the_tracker() {
    // 24 h at 10 Hz: a person who paces for 20 s, hides for 20 s and comes back elsewhere.
    let mut tracker = Tracker::new(TrackOptions::default()).unwrap();
    let mut longest = [0; 2];
    for i in 0..864_000u32 {
        let (turn, t) = (i / 400, i % 400);
        let place = [(turn % 5) as f32 - 2.0, 2.0 + 0.005 * t as f32];
        let frame = appearances(1, |_| if t < 200 { vec![place] } else { vec![] });
        let people = tracker.push(&PointFrame {
            frame: i,
            time_s: f64::from(i) / 10.0,
            points: frame[0].points.clone(),
            board: None,
        });
        assert!(people.len() <= 1);
        let half = usize::from(i >= 432_000);
        // The text of the whole state stands for its size.
        if i % 997 == 0 {
            longest[half] = longest[half].max(format!("{tracker:?}").len());
        }
    }
    assert!(
        longest[0] < 4_000 && longest[1] < 4_000,
        "{longest:?} characters"
    );
}
