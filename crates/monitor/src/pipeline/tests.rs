use std::sync::Mutex;

use radarllm_base::RadarPoint;

use super::*;
use crate::zones::ZoneKind;
use crate::zones::tests::rectangle;

const START_MS: i64 = 1_795_455_492_000;

/// States the height of the person, and remembers the clips.
#[derive(Default)]
struct ByHeight(Arc<Mutex<Vec<Clip>>>);

impl Describe for ByHeight {
    fn describe(&mut self, clip: &Clip, _: WindowContext) -> Described {
        self.0.lock().unwrap().push(clip.clone());
        let heights = clip.frames.iter().flat_map(|f| &f.points).map(|p| p.z_m);
        let highest_m = heights.fold(f32::NEG_INFINITY, f32::max);
        if !highest_m.is_finite() {
            return Described::Abstained {
                reason: "no points".into(),
            };
        }
        let seen = clip.frames.iter().filter(|f| !f.points.is_empty());
        let is_up = seen.rev().take(20).any(|f| {
            let mut points = f.points.iter();
            points.any(|p| p.z_m > 0.0)
        });
        let (caption, action) = match is_up {
            true => ("a person walks", "walk"),
            false => ("a person lies on the floor", "lie_still"),
        };
        Described::Sentence {
            caption: caption.into(),
            actions: vec![action.into()],
            confidence: Some(0.7),
            measured: Vec::new(),
        }
    }
}

fn stream() -> StreamInfo {
    StreamInfo {
        frame_period_s: 0.1,
        radar_height_m: 1.0,
        is_height_assumed: false,
        radar: "test".into(),
        provenance: Provenance::simulated("builtin:walk", 1),
        clutter: Clutter::Settled,
    }
}

/// A column of points that move, from the floor to a height.
fn body(x_m: f32, height_m: f32) -> Vec<RadarPoint> {
    let point = |i: u32| RadarPoint {
        x_m,
        y_m: 2.5,
        z_m: height_m * (i + 1) as f32 / 12.0 - 1.0,
        range_m: 2.5,
        velocity_mps: 0.5,
        intensity_db: 20.0,
    };
    (0..12).map(point).collect()
}

/// Somebody walks from 1 s on, falls at 20 s, lies until 50 s, gets up, and is gone from 60 s on.
fn points(n: u32) -> Vec<RadarPoint> {
    let t_s = n as f32 / 10.0;
    match t_s {
        1.0..20.0 => body(0.4 * (t_s * 0.5).sin(), 1.7),
        20.0..20.7 => body(0.0, 1.7 - 2.0 * (t_s - 20.0)),
        20.7..50.0 => body(0.0, 0.3),
        50.0..51.0 => body(0.0, 0.3 + 1.4 * (t_s - 50.0)),
        51.0..60.0 => body(0.0, 1.7),
        _ => Vec::new(),
    }
}

fn frame(n: u32) -> PointFrame {
    PointFrame {
        frame: n,
        time_s: 0.0,
        points: points(n),
        board: None,
    }
}

struct Run {
    outputs: Vec<Output>,
    clips: Vec<Clip>,
}

fn run(numbers: impl Iterator<Item = u32>, arrival: impl Fn(u32) -> Arrival) -> Run {
    let describer = ByHeight::default();
    let clips = Arc::clone(&describer.0);
    let options = PipelineOptions::default();
    let mut pipeline =
        Pipeline::new(stream(), &options, Box::new(describer), Arc::default()).unwrap();
    let mut outputs: Vec<Output> = numbers
        .flat_map(|n| pipeline.push_frame(frame(n), arrival(n), true))
        .collect();
    outputs.extend(pipeline.finish());
    let clips = clips.lock().unwrap().clone();
    Run { outputs, clips }
}

fn events(outputs: &[Output]) -> Vec<(i64, EventKind)> {
    let event = |output: &Output| match output {
        Output::Event(event) => Some(((event.at_ms - START_MS) / 1_000, event.kind)),
        _ => None,
    };
    outputs.iter().filter_map(event).collect()
}

/// The last state of every row: action, start and end, s.
fn rows(outputs: &[Output]) -> Vec<(String, f64, f64)> {
    let mut rows = std::collections::BTreeMap::new();
    for output in outputs {
        if let Output::Row { row, activity, .. } = output {
            let s = |ms: i64| (ms - START_MS) as f64 / 1e3;
            let state = (
                activity.action.clone(),
                s(activity.start_ms),
                s(activity.end_ms),
            );
            rows.insert(*row, state);
        }
    }
    rows.into_values().collect()
}

#[test]
fn a_stream_becomes_presence_falls_and_rows() {
    let run = run(0..1_000, |_| Arrival::Replayed(START_MS));
    let expected = [
        EventKind::Present,
        EventKind::Suspected,
        EventKind::Confirmed,
        EventKind::Recovered,
        EventKind::Absent,
    ];
    let found = events(&run.outputs);
    let kinds: Vec<EventKind> = found.iter().map(|(_, kind)| *kind).collect();
    assert_eq!(kinds, expected, "{found:?}");
    assert!((20..=21).contains(&found[1].0), "{found:?}");
    assert!((40..=41).contains(&found[2].0), "{found:?}");
    let rows = rows(&run.outputs);
    let actions: Vec<&str> = rows.iter().map(|r| r.0.as_str()).collect();
    assert_eq!(actions, ["walk", "lie_still", "walk"], "{rows:?}");
    assert!(
        rows[0].1 < 3.0 && (18.0..25.0).contains(&rows[0].2),
        "{rows:?}"
    );
    assert!(rows[2].1 > 44.0 && rows[2].2 > 58.0, "{rows:?}");
    // The first sentence comes within 10 s of the person.
    let first = run.outputs.iter().find_map(|output| match output {
        Output::Message(stamp, Body::Now(now)) if now.caption.is_some() => Some(stamp.t_s),
        _ => None,
    });
    assert!(first.is_some_and(|t_s| t_s < 8.0), "{first:?}");
    // Windows hold one person's points at the rate of the radar.
    let full = &run.clips[2];
    assert_eq!((full.frames.len(), full.frame_rate_hz), (60, 10.0));
    assert_eq!(full.clutter, Clutter::Settled);
    assert!(full.frames.iter().all(|f| f.points.len() == 12));
}

#[test]
fn arrival_times_change_no_row() {
    let replayed = run(0..1_000, |_| Arrival::Replayed(START_MS));
    // Frames that arrive in bursts of five, up to half a second late.
    let bursts = run(0..1_000, |n| {
        Arrival::At(START_MS + i64::from(n / 5 * 5 + 5) * 100)
    });
    let spans = |run: &Run| -> Vec<(String, i64)> {
        let rows = rows(&run.outputs);
        let span = |(action, start_s, end_s): (String, f64, f64)| {
            (action, ((end_s - start_s) * 1e3).round() as i64)
        };
        rows.into_iter().map(span).collect()
    };
    assert_eq!(spans(&bursts), spans(&replayed));
    assert_eq!(bursts.clips, replayed.clips);
}

/// A state that is measured over the whole of a window.
fn whole(clip: &Clip, action: Option<&str>, caption: &str) -> MeasuredSpan {
    let time_s = |frame: Option<&PointFrame>| frame.map_or(0.0, |f| f.time_s);
    MeasuredSpan {
        start_s: time_s(clip.frames.first()),
        end_s: time_s(clip.frames.last()),
        action: action.map(String::from),
        caption: WindowCaption {
            text: caption.into(),
            confidence: Some(0.9),
            place_m: None,
        },
    }
}

/// States in every window that the person falls.
struct Falls {
    is_measured: bool,
}

impl Describe for Falls {
    fn describe(&mut self, clip: &Clip, _: WindowContext) -> Described {
        let caption = "a person falls 2.0 m away";
        Described::Sentence {
            caption: caption.into(),
            actions: vec!["fall".into()],
            confidence: Some(0.7),
            measured: match self.is_measured {
                true => vec![whole(clip, Some("fall"), caption)],
                false => Vec::new(),
            },
        }
    }
}

#[test]
fn a_measured_fall_is_suspected_whatever_the_heights_are() {
    // The person walks at a height of more than 1 m throughout: a model that reads a fall errs.
    let suspected = |is_measured: bool| {
        let describer = Box::new(Falls { is_measured });
        let options = PipelineOptions::default();
        let mut pipeline = Pipeline::new(stream(), &options, describer, Arc::default()).unwrap();
        let at = |n: u32| Arrival::Replayed(START_MS + i64::from(n) * 100);
        let outputs: Vec<Output> = (0..150)
            .flat_map(|n| pipeline.push_frame(frame(n), at(n), true))
            .collect();
        let is_suspected = |(_, kind): &&(i64, EventKind)| *kind == EventKind::Suspected;
        events(&outputs).iter().filter(is_suspected).count()
    };
    assert_eq!(suspected(false), 0);
    assert!(suspected(true) >= 1);
}

/// Measures that the person sits until 15 s, and walks afterwards; never both in a window.
struct SitsThenWalks;

impl Describe for SitsThenWalks {
    fn describe(&mut self, clip: &Clip, _: WindowContext) -> Described {
        let end_s = clip.frames.last().map_or(0.0, |frame| frame.time_s);
        let (caption, action) = match end_s < 15.0 {
            true => ("a person sits", "sit_still"),
            false => ("a person walks", "walk"),
        };
        Described::Sentence {
            caption: caption.into(),
            actions: vec![action.into()],
            confidence: Some(0.7),
            measured: vec![whole(clip, Some(action), caption)],
        }
    }
}

#[test]
fn who_sat_in_one_window_and_walks_in_the_next_one_has_got_up() {
    let options = PipelineOptions::default();
    let describer = Box::new(SitsThenWalks);
    let mut pipeline = Pipeline::new(stream(), &options, describer, Arc::default()).unwrap();
    let mut outputs = Vec::new();
    for n in 0..300u32 {
        let moving = PointFrame {
            points: body(0.4 * (n as f32 * 0.05).sin(), 1.7),
            ..frame(n)
        };
        outputs.extend(pipeline.push_frame(moving, Arrival::Replayed(START_MS), true));
    }
    outputs.extend(pipeline.finish());
    let mut actions: Vec<String> = rows(&outputs).into_iter().map(|row| row.0).collect();
    actions.sort_unstable();
    assert_eq!(actions, ["sit_still", "stand_up", "walk"]);
}

/// Measures a fall from 8 to 10 s, and walking for the rest of a window after it.
struct FallsThenWalks;

impl Describe for FallsThenWalks {
    fn measures_falls(&self, _: &StreamInfo) -> bool {
        true
    }

    fn describe(&mut self, clip: &Clip, _: WindowContext) -> Described {
        let window = whole(clip, Some("walk"), "a person walks about 2.5 m away");
        let part = |start_s: f64, end_s: f64| MeasuredSpan {
            start_s: start_s.max(window.start_s),
            end_s: end_s.min(window.end_s),
            ..window.clone()
        };
        let fall = MeasuredSpan {
            action: Some("fall".into()),
            ..part(8.0, 10.0)
        };
        let all = [part(0.0, 8.0), fall, part(10.0, 1e3)];
        let measured: Vec<MeasuredSpan> = (all.into_iter())
            .filter(|span| span.end_s - span.start_s > 0.5)
            .collect();
        Described::Sentence {
            caption: window.caption.text.clone(),
            actions: measured.iter().filter_map(|s| s.action.clone()).collect(),
            confidence: Some(0.9),
            measured,
        }
    }
}

#[test]
fn who_fell_and_is_measured_to_walk_is_up_if_the_track_goes_as_far() {
    let run = |speed_mps: f32, is_height_assumed: bool| {
        let options = PipelineOptions::default();
        let describer = Box::new(FallsThenWalks);
        let info = StreamInfo {
            is_height_assumed,
            ..stream()
        };
        let mut pipeline = Pipeline::new(info, &options, describer, Arc::default()).unwrap();
        let mut outputs = Vec::new();
        for n in 0..350u32 {
            let x_m = speed_mps * (n as f32 / 10.0 - 10.0).max(0.0) + 0.02 * (n as f32 * 0.5).sin();
            let low = PointFrame {
                points: body(x_m.min(4.0), 0.4),
                ..frame(n)
            };
            outputs.extend(pipeline.push_frame(low, Arrival::Replayed(START_MS), true));
        }
        let said = outputs.iter().filter_map(|output| match output {
            Output::Message(stamp, Body::Now(now)) if stamp.t_s > 13.0 => {
                Some((now.caption.clone()?, now.label.clone()))
            }
            _ => None,
        });
        let kinds = events(&outputs).into_iter().map(|(_, kind)| kind);
        let kinds: Vec<EventKind> = kinds.filter(|kind| *kind != EventKind::Present).collect();
        (kinds, said.collect::<Vec<_>>())
    };
    // Nobody states the height of the radar: how low it is means nothing.
    let (kinds, said) = run(0.8, true);
    assert_eq!(kinds, [EventKind::Suspected, EventKind::Dismissed]);
    assert_eq!(said.last().unwrap().1, "walk");
    // As low as on the floor, and far: crawls.
    let (kinds, _) = run(0.8, false);
    assert_eq!(kinds, [EventKind::Suspected, EventKind::Confirmed]);
    // The place trembles: the person has fallen, and no more is said than that the person is there.
    let (kinds, said) = run(0.0, true);
    assert_eq!(kinds, [EventKind::Suspected, EventKind::Confirmed]);
    for (caption, label) in said {
        let last = caption.rsplit(", then ").next().unwrap();
        assert!(last.contains("is there"), "{caption}");
        assert!(
            ["unsure", "fall"].contains(&&label[..]),
            "{caption}: {label}"
        );
    }
}

#[test]
fn a_gap_ends_rows() {
    let numbers = (0..100).chain(105..150).chain(190..290);
    let run = run(numbers, |_| Arrival::Replayed(START_MS));
    let ends: Vec<f64> = rows(&run.outputs).iter().map(|r| r.2).collect();
    assert!(ends.len() >= 2, "{ends:?}");
    assert!(ends[0] <= 15.0, "{ends:?}");
}

#[test]
fn clocks_that_jump_and_computers_that_sleep_are_told_and_lose_nothing() {
    let changes = |events: &[(i64, EventKind)], kind: EventKind| {
        let of_kind = events.iter().filter(|(_, k)| *k == kind);
        of_kind.count()
    };
    // From 15 s on the clock of the computer is an hour ahead, or behind, or the computer slept for ten minutes, of which
    // no frame is known. The person falls at 20 s.
    for jump_ms in [3_600_000, -3_600_000, 600_000] {
        let at = |n: u32| START_MS + i64::from(n) * 100 + if n < 150 { 0 } else { jump_ms };
        let run = run(0..1_000, |n| Arrival::At(at(n)));
        let found = events(&run.outputs);
        assert_eq!(changes(&found, EventKind::ClockStep), 1, "{found:?}");
        for kind in [
            EventKind::Suspected,
            EventKind::Confirmed,
            EventKind::Recovered,
        ] {
            assert_eq!(changes(&found, kind), 1, "{kind:?}: {found:?}");
        }
        let confirmed = found.iter().find(|(_, kind)| *kind == EventKind::Confirmed);
        let at_s = confirmed.unwrap().0 - jump_ms / 1_000;
        assert!((40..=41).contains(&at_s), "{found:?}");
        let is_frame = |output: &&Output| matches!(output, Output::Message(_, Body::Frame(_)));
        assert_eq!(run.outputs.iter().filter(is_frame).count(), 1_000);
        // Nothing reaches over the gap, and no row ends before it begins.
        let rows = rows(&run.outputs);
        assert!(rows.len() >= 3, "{rows:?}");
        assert!(
            rows.iter().all(|r| r.2 >= r.1 && r.2 - r.1 < 40.0),
            "{rows:?}"
        );
        // What was done before the clock jumped has the times of then.
        let is_before = |r: &&(String, f64, f64)| (0.0..=15.0).contains(&r.1) && r.2 <= 17.0;
        assert!(rows.iter().any(|r| is_before(&r)), "{rows:?}");
        let from_s = jump_ms as f64 / 1e3 + 12.0;
        let is_after = |r: &&(String, f64, f64)| r.1 >= from_s && r.2 <= from_s + 100.0;
        assert!(
            rows.iter().all(|r| is_before(&r) || is_after(&r)),
            "{rows:?}"
        );
    }
    // Also where the row goes on; each keeps the beginning with which it was announced first.
    for jump_ms in [1_500, -1_500, 3_600_000, -3_600_000] {
        let at = |n: u32| START_MS + i64::from(n) * 100 + if n < 150 { 0 } else { jump_ms };
        let run = run(0..1_000, |n| Arrival::At(at(n)));
        let mut starts = std::collections::BTreeMap::new();
        for output in &run.outputs {
            if let Output::Row { row, activity, .. } = output {
                let start_ms = *starts.entry(*row).or_insert(activity.start_ms);
                assert_eq!(activity.start_ms, start_ms, "row {row}");
            }
        }
        assert!(starts.len() >= 3, "{starts:?}");
    }
}

#[test]
fn a_silent_radar_ends_rows_and_presence() {
    let counters = Arc::new(Counters::default());
    let options = PipelineOptions::default();
    let describer = Box::new(ByHeight::default());
    let mut pipeline = Pipeline::new(stream(), &options, describer, counters).unwrap();
    let at_ms = |n: u32| START_MS + i64::from(n) * 100;
    let mut outputs = Vec::new();
    for n in 0..100 {
        outputs.extend(pipeline.push_frame(frame(n), Arrival::At(at_ms(n)), true));
    }
    let lost = pipeline.source_lost(at_ms(150), "unplugged");
    assert!(lost.iter().any(|o| matches!(o, Output::Row { .. })));
    let state = |outputs: &[Output]| {
        outputs.iter().rev().find_map(|output| match output {
            Output::Message(_, Body::Health(health)) => Some(health.source),
            _ => None,
        })
    };
    assert_eq!(state(&lost), Some(SourceState::Lost));
    // The newest sentence is not left standing.
    let said = |outputs: &[Output]| {
        let mut said = outputs.iter().rev().filter_map(|output| match output {
            Output::Message(_, Body::Now(now)) => Some((now.label.clone(), now.reason.clone())),
            _ => None,
        });
        said.next()
    };
    assert_eq!(
        said(&lost),
        Some(("unseen".into(), Some("unplugged".into())))
    );
    outputs.extend(lost);
    outputs.extend(pipeline.source_back(at_ms(200)));
    let after = pipeline.push_frame(frame(0), Arrival::At(at_ms(201)), true);
    assert_eq!(state(&after), Some(SourceState::Ok));
    assert_eq!(said(&after), Some(("nobody".into(), None)));
    outputs.extend(after);
    let kinds: Vec<EventKind> = events(&outputs).iter().map(|(_, kind)| *kind).collect();
    let expected = [
        EventKind::Present,
        EventKind::Absent,
        EventKind::SourceLost,
        EventKind::SourceBack,
    ];
    assert_eq!(kinds, expected);
}

/// The state and the number of people of every message about presence.
fn presences(outputs: &[Output]) -> Vec<(PresenceState, u32)> {
    let presence = |output: &Output| match output {
        Output::Message(_, Body::Presence(presence)) => Some((presence.state, presence.people)),
        _ => None,
    };
    outputs.iter().filter_map(presence).collect()
}

#[test]
fn who_fell_is_there_while_the_radar_is_silent() {
    let options = PipelineOptions::default();
    let describer = Box::new(ByHeight::default());
    let mut pipeline = Pipeline::new(stream(), &options, describer, Arc::default()).unwrap();
    let at_ms = |n: u32| START_MS + i64::from(n) * 100;
    let mut outputs = Vec::new();
    // The fall at 20 s is suspected at 21 s.
    for n in 0..230 {
        outputs.extend(pipeline.push_frame(frame(n), Arrival::At(at_ms(n)), true));
    }
    outputs.extend(pipeline.source_lost(at_ms(250), "unplugged"));
    let kinds: Vec<EventKind> = events(&outputs).iter().map(|(_, kind)| *kind).collect();
    let expected = [
        EventKind::Present,
        EventKind::Suspected,
        EventKind::SourceLost,
    ];
    assert_eq!(kinds, expected);
    assert_eq!(
        presences(&outputs).last(),
        Some(&(PresenceState::Held, 1)),
        "{:?}",
        presences(&outputs)
    );
}

#[test]
fn falls_of_an_earlier_run_are_told_and_end_by_a_users_word() {
    let options = PipelineOptions::default();
    let describer = Box::new(ByHeight::default());
    let mut pipeline = Pipeline::new(stream(), &options, describer, Arc::default()).unwrap();
    let earlier = EarlierFall {
        fall: 4,
        person: 9,
        is_confirmed: true,
        age_s: 120.0,
        place_m: [0.0, 2.5],
    };
    let restored = pipeline.restore(&[earlier], START_MS);
    assert_eq!(presences(&restored), [(PresenceState::Held, 1)]);
    assert_eq!(events(&restored), [(0, EventKind::Present)]);
    let is_published = restored.iter().any(|output| {
        matches!(output, Output::Message(_, Body::Fall(fall))
            if fall.id == 4 && fall.state == messages::FallState::Confirmed && fall.dwell_s == 120.0)
    });
    assert!(is_published, "{restored:?}");
    // Nobody is seen for a minute, and the fall stays open.
    let empty = |n: u32| PointFrame {
        points: Vec::new(),
        ..frame(n)
    };
    let mut outputs = Vec::new();
    for n in 0..600 {
        let at = Arrival::At(START_MS + i64::from(n) * 100);
        outputs.extend(pipeline.push_frame(empty(n), at, true));
    }
    assert!(events(&outputs).is_empty() && presences(&outputs).is_empty());
    let is_absence = |output: &Output| matches!(output, Output::Message(_, Body::Now(now)) if now.label == "nobody");
    assert!(!outputs.iter().any(is_absence));
    let ended = pipeline.acknowledge(4);
    assert_eq!(events(&ended), [(59, EventKind::Recovered)]);
    let is_published = ended
        .iter()
        .any(|output| matches!(output, Output::Message(_, Body::Fall(fall)) if fall.acknowledged));
    assert!(is_published, "{ended:?}");
}

#[test]
fn a_computer_that_is_too_slow_has_fewer_windows_until_it_is_fast_again() {
    let options = PipelineOptions::default();
    let describer = ByHeight::default();
    let clips = Arc::clone(&describer.0);
    let counters = Arc::new(Counters::default());
    let counts = Arc::clone(&counters);
    let mut pipeline = Pipeline::new(stream(), &options, Box::new(describer), counters).unwrap();
    let (mut degraded, mut events) = (Vec::new(), 0);
    for n in 0..3_000u32 {
        let standing = PointFrame {
            points: body(0.4 * (n as f32 * 0.05).sin(), 1.7),
            ..frame(n)
        };
        // Too slow for the first minute.
        let outputs = pipeline.push_frame(standing, Arrival::Replayed(START_MS), n >= 600);
        for output in outputs {
            match output {
                Output::Message(stamp, Body::Health(health)) => {
                    degraded.extend(health.degraded.map(|what| (stamp.t_s, what)));
                }
                Output::Message(_, Body::Frame(f)) => events += usize::from(!f.people.is_empty()),
                _ => {}
            }
        }
    }
    assert_eq!(counts.windows_overwritten.get(), 28);
    let times: Vec<f64> = degraded.iter().map(|(t_s, _)| *t_s).collect();
    // Every 4 s in the second minute, every 2 s from the third on.
    assert!(degraded.iter().all(|(_, what)| what == "captions"));
    assert!(times.first().is_some_and(|t_s| (60.0..66.0).contains(t_s)));
    assert!(times.last().is_some_and(|t_s| (114.0..120.0).contains(t_s)));
    let n_clips = clips.lock().unwrap().len();
    // From 64 s to 116 s, and from 122 s to 298 s.
    assert_eq!(n_clips, 14 + 89);
    // People are tracked all the time.
    assert!(events > 2_950, "{events}");
}

#[test]
fn windows_are_left_out_and_counted_where_frames_wait() {
    let counters = Arc::new(Counters::default());
    let options = PipelineOptions::default();
    let describer = ByHeight::default();
    let clips = Arc::clone(&describer.0);
    let mut pipeline = Pipeline::new(
        stream(),
        &options,
        Box::new(describer),
        Arc::clone(&counters),
    )
    .unwrap();
    for n in 0..100 {
        pipeline.push_frame(frame(n), Arrival::Replayed(START_MS), false);
    }
    assert!(clips.lock().unwrap().is_empty());
    assert_eq!(counters.windows_overwritten.get(), 2);
}

/// A model that cannot be used for its first windows.
struct Recovering {
    n_failures: u32,
}

impl Describe for Recovering {
    fn describe(&mut self, _: &Clip, _: WindowContext) -> Described {
        match self.n_failures.checked_sub(1) {
            Some(left) => {
                self.n_failures = left;
                Described::Failed {
                    error: "no weights".into(),
                }
            }
            None => Described::Sentence {
                caption: "a person walks".into(),
                actions: vec!["walk".into()],
                confidence: Some(0.7),
                measured: Vec::new(),
            },
        }
    }
}

#[test]
fn a_model_that_fails_is_counted_and_reported_until_it_describes_again() {
    let counters = Arc::new(Counters::default());
    let model = Box::new(Recovering { n_failures: 5 });
    let options = PipelineOptions::default();
    let mut pipeline = Pipeline::new(stream(), &options, model, Arc::clone(&counters)).unwrap();
    let (mut problems, mut reasons) = (Vec::new(), Vec::new());
    for n in 0..300 {
        let walking = PointFrame {
            points: body(0.4 * (n as f32 * 0.05).sin(), 1.7),
            ..frame(n)
        };
        for output in pipeline.push_frame(walking, Arrival::Replayed(START_MS), true) {
            match output {
                Output::Message(_, Body::Health(health)) => problems.push(health.problems),
                Output::Message(_, Body::Now(now)) if now.window_s > 0.0 => {
                    reasons.push(now.reason);
                }
                _ => {}
            }
        }
    }
    let failed = "the model failed: no weights";
    assert_eq!(
        (counters.model_errors.get(), counters.abstained.get()),
        (5, 0)
    );
    assert!(reasons[..5].iter().all(|r| r.as_deref() == Some(failed)));
    assert!(reasons.len() > 10 && reasons[5..].iter().all(Option::is_none));
    // Every 5 s; the last failure is before 15 s.
    assert!(problems.iter().any(|p| *p == [failed]), "{problems:?}");
    assert!(problems.last().is_some_and(Vec::is_empty), "{problems:?}");
    assert_eq!(counters.model_problem.get(), None);
}

/// How many points a window has, and how many the radar reported in its time.
type Counts = (usize, Option<usize>);

/// Remembers the counts of each window.
struct Reported(Arc<Mutex<Vec<Counts>>>);

impl Describe for Reported {
    fn describe(&mut self, clip: &Clip, context: WindowContext) -> Described {
        let reported = context.reported;
        let times = |clip: &Clip| -> Vec<f64> { clip.frames.iter().map(|f| f.time_s).collect() };
        assert!(
            reported
                .as_ref()
                .is_none_or(|reported| times(reported) == times(clip))
        );
        let counts = (clip.n_points(), reported.as_ref().map(Clip::n_points));
        self.0.lock().unwrap().push(counts);
        Described::Abstained {
            reason: "nothing is said".into(),
        }
    }
}

#[test]
fn windows_come_with_everything_that_the_radar_reported_if_that_may_be_clutter() {
    for clutter in [Clutter::Settled, Clutter::Unchecked] {
        let counts = Arc::default();
        let info = StreamInfo {
            clutter,
            ..stream()
        };
        let describer = Reported(Arc::clone(&counts));
        let options = PipelineOptions::default();
        let mut pipeline =
            Pipeline::new(info, &options, Box::new(describer), Arc::default()).unwrap();
        for n in 0..300 {
            let mut points = body(0.4 * (n as f32 * 0.05).sin(), 1.7);
            // A wall.
            points.extend((0..20).map(|i| RadarPoint {
                x_m: 0.1 * i as f32 - 1.0,
                y_m: 4.0,
                range_m: 4.0,
                ..RadarPoint::default()
            }));
            let frame = PointFrame { points, ..frame(n) };
            pipeline.push_frame(frame, Arrival::Replayed(START_MS), true);
        }
        let counts = counts.lock().unwrap();
        let (seen, reported) = counts.last().unwrap();
        match clutter {
            Clutter::Settled => assert_eq!((*seen, *reported), (60 * 32, None)),
            Clutter::Unchecked => assert_eq!((*seen, *reported), (60 * 12, Some(60 * 32))),
        }
    }
}

/// What a pipeline with a zone over the whole floor that ignores below 0.5 m, or without it, says about frames.
fn run_over(
    frames: impl Iterator<Item = PointFrame>,
    has_zone: bool,
) -> (Vec<PresenceState>, Vec<Clip>) {
    let describer = ByHeight::default();
    let clips = Arc::clone(&describer.0);
    let mut options = PipelineOptions::default();
    if has_zone {
        let floor = crate::zones::Zone {
            below_m: Some(0.5),
            ..rectangle(ZoneKind::Ignore, [-4.0, 0.0], [4.0, 6.0])
        };
        options.watch.zones = Zones::new(vec![floor]).unwrap();
    }
    let mut pipeline =
        Pipeline::new(stream(), &options, Box::new(describer), Arc::default()).unwrap();
    let mut outputs: Vec<Output> = frames
        .flat_map(|frame| pipeline.push_frame(frame, Arrival::Replayed(START_MS), true))
        .collect();
    outputs.extend(pipeline.finish());
    let states = presences(&outputs).into_iter().map(|(state, _)| state);
    let clips = clips.lock().unwrap().clone();
    (states.collect(), clips)
}

#[test]
fn a_robot_vacuum_is_nobody_tracked_or_not_and_its_points_are_no_persons() {
    let vacuum = |n: u32| body(-1.5 + 0.5 * (n as f32 * 0.02).sin(), 0.1);
    let with = |n: u32, points: Vec<RadarPoint>| PointFrame { points, ..frame(n) };
    for (what, is_seen) in [("tracked", 1), ("hardly seen", 7)] {
        let frames = || {
            (0..300).map(|n| {
                let points = if n % is_seen == 0 {
                    vacuum(n)
                } else {
                    Vec::new()
                };
                with(n, points)
            })
        };
        let (states, clips) = run_over(frames(), false);
        assert!(!states.is_empty() && !clips.is_empty(), "{what}");
        let (states, clips) = run_over(frames(), true);
        assert!(states.is_empty() && clips.is_empty(), "{what}: {states:?}");
    }
    let both = (0..300).map(|n| {
        let person = body(1.0 + 0.2 * (n as f32 * 0.05).sin(), 1.7);
        with(n, [person, vacuum(n)].concat())
    });
    let (states, clips) = run_over(both, true);
    assert_eq!(states, [PresenceState::Present]);
    let newest = clips.last().unwrap();
    let points = newest.frames.iter().flat_map(|frame| &frame.points);
    assert!(points.clone().count() > 300 && points.clone().all(|p| p.x_m > 0.5));
}
