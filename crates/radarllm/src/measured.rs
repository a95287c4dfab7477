//! Descriptions by what is measured: places, heights and speeds of the board's own tracks.

use radarllm_base::{Clip, PointFrame, RadarPoint, stats::quantile_nearest};
use radarllm_inference::{
    Description, PreparedClip, Segment,
    lm::{Abstained, NO_PERSON},
};
use radarllm_measure::{
    Activity, Before, Site, State, TrackedPerson,
    falls::{Fall, falls_of_points, falls_out_of_view},
    measure,
    people::{MIN_TRACKED_S, Sample},
    sentence,
    states::states_of,
};

use crate::{
    gaps::follows,
    point_people::{learn_site, people_in_points},
};

/// Time that a fall in the points takes, s, before and after the moment at which it is found.
const FALL_S: f64 = 1.0;

/// What is measured of a recording.
pub(crate) enum Measured {
    /// The board tracks people: what they do, in order of time.
    States(Vec<State>),
    /// The board states points alone: where people walk and fall in them, in order of time, falls last.
    InPoints(Vec<Segment>),
}

impl Measured {
    /// Measures a clip. The site is learned from the clip where none is known and somebody walks in it.
    pub(crate) fn of(clip: &PreparedClip, site: Option<&Site>, before: Before) -> Self {
        let learned =
            || learn_site(&clip.radar, &clip.frames).unwrap_or_else(|_| unlearned_site(clip));
        let mut site = site.cloned().unwrap_or_else(learned);
        site.stated_height_m = (!clip.is_height_assumed).then_some(clip.radar_height_m);
        match measure(&clip.frames, &site, before) {
            Some(states) => Self::States(states),
            None => {
                let in_clip = |clip: &Clip| {
                    let falls = falls_of_points(&clip.frames);
                    [walks_in_points(clip), fall_segments(&clip.frames, falls)]
                };
                let [mut walks, mut falls] = in_clip(clip);
                let all = clip.moving();
                let is_other = !std::ptr::eq(all, &**clip);
                if is_other && (!walks.is_empty() || !falls.is_empty()) {
                    let [other_walks, other_falls] = in_clip(all);
                    keep_shown(&mut walks, &other_walks);
                    keep_shown(&mut falls, &other_falls);
                }
                if let Some(reported) = clip.reported() {
                    // A time without frames shows nobody, and says nothing.
                    let runs = reported.frames.chunk_by(follows);
                    let found = runs.flat_map(falls_out_of_view).collect();
                    let mut out_of_view = fall_segments(&reported.frames, found);
                    out_of_view.retain(|fall| !falls.iter().any(|other| overlap(fall, other)));
                    falls.append(&mut out_of_view);
                    falls.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
                }
                let mut segments = postures_in_points(clip, &site, before);
                segments.append(&mut walks);
                segments.append(&mut falls);
                Self::InPoints(segments)
            }
        }
    }
}

/// Keeps the segments of which others cover half or more. Where static points were removed, slow points of the body went with
/// them, and those that are left are not in the middle of it: they jump as a person does who walks or falls, and all points
/// that have a speed do not.
fn keep_shown(segments: &mut Vec<Segment>, others: &[Segment]) {
    segments.retain(|segment| {
        let covered_s = |other: &Segment| {
            (segment.end_s.min(other.end_s) - segment.start_s.max(other.start_s)).max(0.0)
        };
        2.0 * others.iter().map(covered_s).sum::<f64>() >= segment.end_s - segment.start_s
    });
}

fn overlap(a: &Segment, b: &Segment) -> bool {
    a.start_s < b.end_s && b.start_s < a.end_s
}

/// The site of a clip from which nothing can be learned.
pub(crate) fn unlearned_site(clip: &Clip) -> Site {
    match clip.is_height_assumed {
        true => Site::assumed(&clip.radar, clip.radar_height_m),
        false => Site::unlearned(&clip.radar, clip.radar_height_m),
    }
}

/// A description of nothing but what is measured: a sentence for each state of the person who is tracked longest at its
/// time. Where nobody is tracked, nothing is stated.
pub(crate) fn description(seconds: f64, states: &[State]) -> Description {
    let mut description = Description {
        caption: NO_PERSON.into(),
        confidence: 0.0,
        tokens: Vec::new(),
        seconds: seconds as f32,
        windows: 0,
        segments: Vec::new(),
        choices: Vec::new(),
        abstained: Some(Abstained::NobodyTracked),
    };
    description.set_segments(segments(states));
    description
}

/// The sentences of states. Where several people are tracked at once, the state that began first is stated, but a fall of
/// anybody before all else.
fn segments(states: &[State]) -> Vec<Segment> {
    let mut segments: Vec<Segment> = Vec::new();
    let is_fall = |state: &&State| state.activity == Activity::Falls;
    let (falls, others): (Vec<&State>, Vec<&State>) = states.iter().partition(is_fall);
    let mut taken: Vec<[f64; 2]> = Vec::new();
    for state in falls.into_iter().chain(others) {
        for [start_s, end_s] in rest_of([state.start_s, state.end_s], &taken) {
            let caption = sentence(state);
            segments.push(Segment {
                start_s,
                end_s,
                actions: radarllm_inference::actions(&caption),
                caption,
                confidence: state.probability,
                side_confidence: None,
                taught: None,
                guess: None,
            });
            taken.push([start_s, end_s]);
        }
        // Times before this state are complete, but for falls: they stay.
        taken.sort_by(|a, b| a[0].total_cmp(&b[0]));
        join(&mut taken);
    }
    segments.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    segments
}

/// What is left of a time beside others, which are in order and apart.
fn rest_of([start_s, end_s]: [f64; 2], taken: &[[f64; 2]]) -> Vec<[f64; 2]> {
    /// Shorter rests, s, are not stated.
    const MIN_REST_S: f64 = 0.5;
    let mut rest = Vec::new();
    let mut from_s = start_s;
    let first = taken.partition_point(|t| t[1] <= start_s);
    for [a, b] in taken[first..].iter().take_while(|t| t[0] < end_s) {
        rest.push([from_s, *a]);
        from_s = *b;
    }
    rest.push([from_s, end_s]);
    let is_whole = rest.len() == 1;
    rest.retain(|[a, b]| b - a >= MIN_REST_S || is_whole);
    rest
}

/// Joins times in order that touch.
fn join(times: &mut Vec<[f64; 2]>) {
    times.dedup_by(|next, before| {
        let touches = next[0] <= before[1];
        if touches {
            before[1] = before[1].max(next[1]);
        }
        touches
    });
}

/// Where people walk who are tracked by their points.
fn walks_in_points(clip: &Clip) -> Vec<Segment> {
    let people = people_in_points(&clip.frames, None).into_iter();
    let site = unlearned_site(clip);
    let may_fold = speeds_may_fold(&clip.frames);
    let walks = |p: TrackedPerson| -> Vec<State> {
        let mut states = states_of(&p, &site, &[], Before::Nothing);
        states.retain(|s| {
            s.activity == Activity::Walks
                && (may_fold || is_as_fast(&clip.frames, &p, s))
                && !sinks(&clip.frames, &p, s)
        });
        states
    };
    let mut states: Vec<State> = people
        .filter(|p| p.length_s() >= MIN_TRACKED_S)
        .flat_map(walks)
        .collect();
    states.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    segments(&states)
}

/// In which postures people stay who are tracked by their points, before a board whose site is known.
fn postures_in_points(clip: &Clip, site: &Site, before: Before) -> Vec<Segment> {
    /// Shorter ones, s, are not stated.
    const MIN_POSTURE_S: f64 = 3.0;
    let people = people_in_points(&clip.frames, Some(site)).into_iter();
    let mut states: Vec<State> = people
        .filter(|p| p.length_s() >= MIN_TRACKED_S)
        .flat_map(|p| states_of(&p, site, &[], before))
        .filter(|s| matches!(s.activity, Activity::Stays(_)))
        // Which part of a body the points show depends on the board.
        .filter(|s| site.is_known_at(s.distances_m()[1]))
        .filter(|s| s.end_s - s.start_s >= MIN_POSTURE_S)
        .collect();
    states.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    segments(&states)
}

/// Whether frames may be of a board whose speeds fold below that of somebody who walks: no point is faster.
fn speeds_may_fold(frames: &[PointFrame]) -> bool {
    const MIN_FASTEST_MPS: f32 = 0.7;
    let mut points = frames.iter().flat_map(|f| &f.points);
    !points.any(|p| p.velocity_mps.abs() >= MIN_FASTEST_MPS)
}

/// Whether the points near a walk are about as fast as the track changes its range: a track that jumps between the parts of a
/// body, or between two people, is much faster than they are.
fn is_as_fast(frames: &[PointFrame], person: &TrackedPerson, walk: &State) -> bool {
    /// Share of the way in range that speeds must show, and the way from which on it is asked for, m: who walks past the radar
    /// has none.
    const MIN_SHARE: f32 = 0.4;
    const MIN_WAY_M: f32 = 0.5;
    let (mut way_m, mut shown_m) = (0.0, 0.0);
    let mut before_m: Option<f32> = None;
    let mut t_s = walk.start_s;
    while t_s < walk.end_s {
        let samples = person.between(t_s, (t_s + 1.0).min(walk.end_s));
        t_s += 1.0;
        if samples.is_empty() {
            before_m = None;
            continue;
        }
        let n = samples.len() as f32;
        let mean = |axis: usize| samples.iter().map(|s| s.place_m[axis]).sum::<f32>() / n;
        let range_m = mean(0).hypot(mean(1));
        let mut speeds_mps = Vec::new();
        for sample in samples {
            speeds_mps.extend(points_near(frames, sample).map(|p| p.velocity_mps));
        }
        if let (Some(before_m), false) = (before_m, speeds_mps.is_empty()) {
            way_m += (range_m - before_m).abs();
            shown_m += speeds_mps.iter().sum::<f32>().abs() / speeds_mps.len() as f32;
        }
        before_m = Some(range_m);
    }
    way_m < MIN_WAY_M || shown_m >= MIN_SHARE * way_m
}

/// Whether the points near a short walk sink, as those of somebody who falls and goes a step meanwhile.
fn sinks(frames: &[PointFrame], person: &TrackedPerson, walk: &State) -> bool {
    /// A longer way, m, changes heights by the error of the tilt.
    const MAX_WAY_M: f32 = 1.5;
    /// How far the middle of the points sinks from the second around the beginning to the one around the end, m.
    const SINKS_M: f32 = 0.5;
    /// Fewer points say nothing.
    const MIN_POINTS: usize = 5;
    let way = walk.places_m;
    if (way[0][0] - way[1][0]).hypot(way[0][1] - way[1][1]) > MAX_WAY_M {
        return false;
    }
    let middle_m = |t_s: f64| {
        let samples = person.between(t_s - 0.5, t_s + 0.5);
        let heights: Vec<f32> = samples
            .iter()
            .flat_map(|sample| points_near(frames, sample))
            .map(|p| p.z_m)
            .collect();
        (heights.len() >= MIN_POINTS).then(|| quantile_nearest(heights, 0.5))?
    };
    let heights_m = [walk.start_s, walk.end_s].map(middle_m);
    matches!(heights_m, [Some(from_m), Some(to_m)] if from_m - to_m >= SINKS_M)
}

/// The points of the frame of a sample that are near it.
fn points_near<'a>(
    frames: &'a [PointFrame],
    sample: &Sample,
) -> impl Iterator<Item = &'a RadarPoint> + use<'a> {
    /// Distance of points from the track, m.
    const NEAR_M: f32 = 0.7;
    let [x_m, y_m] = sample.place_m;
    let at = frames.partition_point(|f| f.time_s < sample.t_s);
    let points = frames.get(at).into_iter().flat_map(|f| &f.points);
    points.filter(move |p| (p.x_m - x_m).hypot(p.y_m - y_m) < NEAR_M)
}

/// The sentences of falls in frames.
fn fall_segments(frames: &[PointFrame], falls: Vec<Fall>) -> Vec<Segment> {
    let end_s = frames.last().map_or(0.0, |f| f.time_s);
    let start_s = frames.first().map_or(0.0, |f| f.time_s);
    let segment = |fall: Fall| {
        let [x_m, y_m] = fall.place_m;
        let caption = format!("a person falls {:.1} m away", x_m.hypot(y_m));
        Segment {
            start_s: (fall.t_s - FALL_S).max(start_s),
            end_s: (fall.t_s + FALL_S).min(end_s),
            actions: radarllm_inference::actions(&caption),
            caption,
            confidence: fall.probability,
            side_confidence: None,
            taught: None,
            guess: None,
        }
    };
    falls.into_iter().map(segment).collect()
}

#[cfg(test)]
mod tests {
    use radarllm_base::Clutter;
    use radarllm_measure::{Posture, people::Tracker};

    use super::*;

    /// Points of a body that walks away for three seconds and then moves in its place.
    #[test]
    fn walking_is_measured_in_points() {
        let frame = |i: u32| {
            let t_s = i as f32 / 10.0;
            let walks = t_s < 3.0;
            let y_m = 2.0 + t_s.min(3.0);
            let part = |k: u32| {
                let [x_m, dy_m] = [0.1 * (k % 3) as f32 - 0.1, 0.1 * (k / 3) as f32 - 0.1];
                RadarPoint {
                    x_m,
                    y_m: y_m + dy_m,
                    z_m: 0.1 * k as f32 - 0.4,
                    range_m: y_m + dy_m,
                    velocity_mps: if walks { 1.0 } else { 0.3 * (3.0 * t_s).sin() },
                    intensity_db: 15.0,
                }
            };
            PointFrame {
                frame: i,
                time_s: f64::from(i) / 10.0,
                points: (0..9).map(part).collect(),
                board: None,
            }
        };
        let clip = Clip {
            frames: (0..100).map(frame).collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "board".into(),
            provenance: "recorded:csv:x".parse().unwrap(),
            clutter: Clutter::Settled,
        };
        let found = walks_in_points(&clip);
        let [walk] = &found[..] else {
            panic!("{found:?}")
        };
        assert_eq!(walk.actions, ["walk"]);
        assert!(
            walk.caption
                .starts_with("a person walks away from the radar")
        );
        assert!(
            walk.start_s < 1.0 && (2.0..5.0).contains(&walk.end_s),
            "{walk:?}"
        );
    }

    /// A track that jumps between parts of a body, or between two bodies, changes its range and its points are slow.
    #[test]
    fn who_walks_is_as_fast_as_the_points() {
        let person = |at_m: &dyn Fn(f32) -> f32| TrackedPerson {
            tracker: Tracker::Points,
            track: 1,
            samples: (0..100)
                .map(|i| Sample {
                    t_s: f64::from(i) / 10.0,
                    place_m: [0.0, at_m(i as f32 / 10.0)],
                    height_m: None,
                    upward_mps: None,
                })
                .collect(),
        };
        // Points at the place of the track with this speed, and one far away that is as fast as somebody who walks, or not.
        let frames = |at_m: &dyn Fn(f32) -> f32, velocity_mps: f32, fastest_mps: f32| {
            let point = |y_m: f32, velocity_mps: f32| RadarPoint {
                y_m,
                range_m: y_m,
                velocity_mps,
                ..RadarPoint::default()
            };
            let frame = |i: u32| PointFrame {
                frame: i,
                time_s: f64::from(i) / 10.0,
                points: vec![
                    point(at_m(i as f32 / 10.0), velocity_mps),
                    point(9.0, fastest_mps),
                ],
                board: None,
            };
            (0..100).map(frame).collect::<Vec<_>>()
        };
        let walk = State {
            track: 1,
            start_s: 0.0,
            end_s: 9.9,
            activity: Activity::Walks,
            probability: 0.8,
            places_m: [[0.0, 2.0]; 2],
            between_m: [2.0; 2],
        };
        let is_walk = |at_m: &dyn Fn(f32) -> f32, velocity_mps: f32, fastest_mps: f32| {
            let frames = frames(at_m, velocity_mps, fastest_mps);
            speeds_may_fold(&frames) || is_as_fast(&frames, &person(at_m), &walk)
        };
        let away = |t_s: f32| 2.0 + 0.5 * t_s;
        let jumps = |t_s: f32| {
            if (t_s as u32).is_multiple_of(2) {
                1.5
            } else {
                2.5
            }
        };
        assert!(is_walk(&away, 0.5, 1.0));
        assert!(!is_walk(&away, 0.05, 1.0));
        assert!(!is_walk(&jumps, 0.1, 1.0));
        // Speeds that fold say nothing; who walks past has no radial speed.
        assert!(is_walk(&away, 0.05, 0.3));
        assert!(is_walk(&|_| 2.0, 0.05, 1.0));
    }

    /// Who falls goes a step meanwhile; who walks stays as high, and a longer way changes heights by the error of the tilt.
    #[test]
    fn points_that_sink_on_a_short_way_are_no_walk() {
        let sinks_by = |way_m: f32, sinks_m: f32| {
            let share = |i: u32| (i as f32 / 30.0).min(1.0);
            let frame = |i: u32| PointFrame {
                frame: i,
                time_s: f64::from(i) / 10.0,
                points: (0..6)
                    .map(|k| RadarPoint {
                        y_m: 2.0 + way_m * share(i),
                        z_m: 0.1 * k as f32 - sinks_m * share(i),
                        ..RadarPoint::default()
                    })
                    .collect(),
                board: None,
            };
            let frames: Vec<PointFrame> = (0..40).map(frame).collect();
            let person = TrackedPerson {
                tracker: Tracker::Points,
                track: 1,
                samples: (0..40)
                    .map(|i| Sample {
                        t_s: f64::from(i) / 10.0,
                        place_m: [0.0, 2.0 + way_m * share(i)],
                        height_m: None,
                        upward_mps: None,
                    })
                    .collect(),
            };
            let walk = State {
                track: 1,
                start_s: 0.0,
                end_s: 3.0,
                activity: Activity::Walks,
                probability: 0.8,
                places_m: [[0.0, 2.0], [0.0, 2.0 + way_m]],
                between_m: [2.0, 2.0 + way_m],
            };
            sinks(&frames, &person, &walk)
        };
        assert!(sinks_by(1.0, 1.0));
        assert!(!sinks_by(1.0, 0.2));
        assert!(!sinks_by(2.0, 1.0));
    }

    /// Most of a body on the spot is slow and goes with the static points; what is left of it moves its middle.
    #[test]
    fn what_is_left_of_a_body_shows_a_fall_only_with_all_points_that_move() {
        let point = |x_m: f32, z_m: f32, velocity_mps: f32| RadarPoint {
            x_m,
            y_m: 2.0,
            z_m,
            range_m: 2.0,
            velocity_mps,
            intensity_db: 15.0,
        };
        let frame = |i: u32, falls: bool| {
            let is_down = i >= 40;
            // Furniture, the slow body in the cell of a static echo, and what moves: an arm above, then the legs.
            let mut points: Vec<RadarPoint> = (0..30)
                .map(|k| point(0.02 * k as f32 - 0.3, 0.1, 0.0))
                .collect();
            let slow_m = if falls && is_down { -1.2 } else { 0.1 };
            points.extend((0..12).map(|k| point(0.02 * k as f32, slow_m, 0.09)));
            let fast_m = if is_down { -1.1 } else { 0.6 };
            points.extend((0..5).map(|k| point(0.05 * k as f32, fast_m, 0.8)));
            PointFrame {
                frame: i,
                time_s: f64::from(i) / 10.0,
                points,
                board: None,
            }
        };
        let found = |falls: bool| {
            let clip = Clip {
                frames: (0..80).map(|i| frame(i, falls)).collect(),
                frame_rate_hz: 10.0,
                radar_height_m: 1.0,
                is_height_assumed: false,
                radar: "board".into(),
                provenance: "recorded:csv:x".parse().unwrap(),
                clutter: Clutter::Unchecked,
            };
            let clip = PreparedClip::of(&clip).unwrap();
            assert_ne!(clip.n_points(), clip.moving().n_points());
            match Measured::of(&clip, None, Before::Nothing) {
                Measured::InPoints(segments) => segments.len(),
                Measured::States(_) => 0,
            }
        };
        assert_eq!([found(true), found(false)], [1, 0]);
    }

    fn state(activity: Activity, start_s: f64, end_s: f64) -> State {
        State {
            track: 0,
            start_s,
            end_s,
            activity,
            probability: 0.9,
            places_m: [[0.0, 2.0]; 2],
            between_m: [2.0; 2],
        }
    }

    #[test]
    fn every_time_has_one_sentence_and_a_fall_comes_first() {
        let stands = Activity::Stays(Posture::Standing);
        let sits = Activity::Stays(Posture::Sitting);
        let states = [
            state(stands, 0.0, 10.0),
            state(sits, 4.0, 20.0),
            state(Activity::Falls, 12.0, 14.0),
        ];
        let found: Vec<(String, f64, f64)> = segments(&states)
            .into_iter()
            .map(|s| (s.actions.join(" "), s.start_s, s.end_s))
            .collect();
        let row = |action: &str, start_s, end_s| (action.to_string(), start_s, end_s);
        assert_eq!(
            found,
            [
                row("stand_still", 0.0, 10.0),
                row("sit_still", 10.0, 12.0),
                row("fall", 12.0, 14.0),
                row("sit_still", 14.0, 20.0)
            ]
        );
    }
}
