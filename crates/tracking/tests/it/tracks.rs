//! Who is who over time.

use radarllm_base::{PointFrame, RadarPoint};
use radarllm_tracking::{Track, TrackOptions, track};

use crate::scenes::{off_line, points, summary, walker};

fn tracks(frames: &[PointFrame]) -> Vec<Track> {
    track(frames, &TrackOptions::default()).unwrap()
}

/// Two who walk across each other's way; each track must be one of them from its first frame to its last.
fn keep_identities(starts: [[f64; 2]; 2], headings_deg: [f64; 2], distance_m: f64) {
    let scene = [
        "duration_s = 3.6\n",
        &walker(starts[0], headings_deg[0], distance_m),
        &walker(starts[1], headings_deg[1], distance_m),
    ]
    .concat();
    let frames = points(&scene);
    let found = tracks(&frames);
    let text = summary(&found);
    assert_eq!(found.len(), 2, "{text:#?}");
    let mut who = Vec::new();
    for track in &found {
        let n = track.frames.len();
        assert!(n > 24, "{text:#?}");
        let off = |i: usize, person: usize| {
            off_line(
                track.frames[i].place_m,
                starts[person],
                headings_deg[person],
            )
        };
        // The person whose line the track begins on.
        let me = usize::from(off(0, 1) < off(0, 0));
        who.push(me);
        for i in (0..n / 4).chain(n - n / 4..n) {
            // Half a metre: a body's half width, and what a cluster's mean lies off its middle.
            assert!(
                off(i, me) < 0.5 && off(i, me) < off(i, 1 - me),
                "frame {i}: {} m off, {text:#?}",
                off(i, me)
            );
        }
        // Every point belongs to one person at most.
        for at in &track.frames {
            for other in found.iter().filter(|t| t.id != track.id) {
                let theirs = other.frames.iter().filter(|f| f.frame == at.frame);
                assert!(
                    theirs
                        .flat_map(|f| &f.points)
                        .all(|p| !at.points.contains(p))
                );
            }
        }
    }
    who.sort_unstable();
    assert_eq!(who, [0, 1], "{text:#?}");
}

#[test]
fn two_who_pass_each_other_sideways_keep_their_tracks() {
    keep_identities([[-1.4, 2.8], [1.4, 3.5]], [90.0, -90.0], 2.8);
}

#[test]
fn two_whose_diagonals_cross_keep_their_tracks() {
    // The second reaches the crossing at (0, 3.4) half a metre of way after the first.
    keep_identities([[-1.2, 2.4], [1.6, 2.07]], [129.8, -129.8], 3.2);
}

#[test]
fn one_leaves_and_another_comes_in() {
    let mut frames = points(&format!(
        "duration_s = 2.5\n{}",
        walker([0.5, 4.5], 0.0, 2.5)
    ));
    let n_first = frames.len();
    // Somebody else, later and elsewhere; nobody in between.
    let second = points(&format!(
        "duration_s = 2.5\n{}",
        walker([-0.8, 2.0], 180.0, 2.5)
    ));
    let gap = 30;
    for i in 0..gap + second.len() {
        let number = n_first + i;
        frames.push(PointFrame {
            frame: number as u32,
            time_s: 0.1 * number as f64,
            points: match i.checked_sub(gap) {
                Some(i) => second[i].points.clone(),
                None => Vec::new(),
            },
            board: None,
        });
    }
    let found = tracks(&frames);
    let text = summary(&found);
    assert_eq!(found.len(), 2, "{text:#?}");
    let span = |t: &Track| (t.frames[0].frame, t.frames[t.frames.len() - 1].frame);
    assert_eq!([found[0].id, found[1].id], [1, 2]);
    assert!(
        span(&found[0]).1 < n_first && span(&found[1]).0 >= n_first + gap,
        "{text:#?}"
    );
    let one = found[0].points(&frames);
    assert_eq!(one[0].frame as usize, span(&found[0]).0);
    let all: usize = frames[..n_first].iter().map(|f| f.points.len()).sum();
    // Nearly all points of a single walker are that person's.
    assert!(
        found[0].n_points() as f64 > 0.8 * all as f64,
        "{text:#?}, {all}"
    );
    assert_eq!(
        one.iter().map(|f| f.points.len()).sum::<usize>(),
        found[0].n_points()
    );
}

/// In frame `i` a few points about every place of `at(i)`, walking away at 0.5 m/s.
fn appearances(n: u32, rate_hz: f64, at: impl Fn(u32) -> Vec<[f32; 2]>) -> Vec<PointFrame> {
    let points = |[x, y]: [f32; 2]| {
        (0..5).map(move |j| RadarPoint {
            velocity_mps: 0.5,
            ..still(x + 0.05 * j as f32, y)
        })
    };
    (0..n)
        .map(|i| PointFrame {
            frame: i,
            time_s: f64::from(i) / rate_hz,
            points: at(i).into_iter().flat_map(points).collect(),
            board: None,
        })
        .collect()
}

#[test]
fn who_vanished_and_appears_again_keeps_the_number_unless_there_is_doubt() {
    let spans = |frames: &[PointFrame], options: TrackOptions| {
        let tracks = track(frames, &options).unwrap();
        let span = |t: &Track| [t.frames[0].frame, t.frames[t.frames.len() - 1].frame];
        // No frame is left out, nor there twice.
        for t in &tracks {
            assert!(t.frames.windows(2).all(|w| w[1].frame == w[0].frame + 1));
        }
        tracks.iter().map(span).collect::<Vec<_>>()
    };
    // Until 2 s, then again 6 s later, 0.7 m from there.
    let vanish = |i: u32| match i {
        0..20 => vec![[0.0, 2.0 + 0.05 * i as f32]],
        80.. => vec![[0.6, 3.3 + 0.05 * (i - 80) as f32]],
        _ => vec![],
    };
    let frames = appearances(100, 10.0, vanish);
    let options = TrackOptions::default();
    assert_eq!(spans(&frames, options), [[0, 99]]);
    for (rejoin_s, rejoin_m) in [(0.0, 1.0), (5.0, 1.0), (10.0, 0.5)] {
        let options = TrackOptions {
            rejoin_s,
            rejoin_m,
            ..options
        };
        assert_eq!(spans(&frames, options), [[0, 19], [80, 99]]);
    }
    // Somebody else vanished within a metre of it as well: nobody knows who is back.
    let doubt = |i: u32| {
        let mut at = vanish(i);
        if i < 20 {
            at.push([1.4, 3.0]);
        }
        at
    };
    let found = spans(&appearances(100, 10.0, doubt), options);
    assert_eq!(found, [[0, 19], [0, 19], [80, 99]]);
}

#[test]
fn a_flicker_in_many_frames_is_nobody() {
    let flicker = |n: u32| {
        appearances(200, 100.0, |i| match i {
            0..40 => vec![[0.5, 2.0]],
            100.. if i < 100 + n => vec![[-0.5, 4.0]],
            _ => vec![],
        })
    };
    // 0.4 and 0.3 s are too short; the same for 0.8 s is somebody.
    assert!(tracks(&flicker(30)).is_empty());
    assert_eq!(tracks(&flicker(80)).len(), 1);
}

fn still(x_m: f32, y_m: f32) -> RadarPoint {
    RadarPoint {
        x_m,
        y_m,
        range_m: x_m.hypot(y_m),
        ..RadarPoint::default()
    }
}

#[test]
fn clutter_and_noise_are_nobody() {
    // A shelf that some firmware reports with velocity zero in every frame, and noise points anywhere.
    let mut state = 9_u64;
    let mut random = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 40) as f32 / (1_u64 << 24) as f32
    };
    let frames: Vec<PointFrame> = (0..200)
        .map(|i| {
            let mut points: Vec<RadarPoint> =
                (0..8).map(|j| still(1.0 + 0.1 * j as f32, 3.0)).collect();
            points.extend((0..6).map(|_| RadarPoint {
                velocity_mps: 6.0 * random() - 3.0,
                ..still(6.0 * random() - 3.0, 8.0 * random() + 0.5)
            }));
            PointFrame {
                frame: i,
                time_s: 0.1 * f64::from(i),
                points,
                board: None,
            }
        })
        .collect();
    let found = tracks(&frames);
    assert!(found.is_empty(), "{:#?}", summary(&found));
    // The same shelf, moving a little, is somebody: it is the velocity that tells.
    let mut moving = frames;
    for point in moving.iter_mut().flat_map(|f| &mut f.points[..8]) {
        point.velocity_mps = 0.3;
    }
    assert!(!tracks(&moving).is_empty());
}

#[test]
fn nothing_in_nothing_out() {
    assert!(tracks(&[]).is_empty());
    let silent = vec![PointFrame::default(); 50];
    assert!(tracks(&silent).is_empty());
    let wrong = TrackOptions {
        coast_s: f64::NAN,
        ..TrackOptions::default()
    };
    assert_eq!(track(&[], &wrong).unwrap_err().field, "coast_s");
}
