//! Descriptions by what is measured: places, heights and speeds of the board's own tracks.

use radarllm_base::{Clip, PointFrame};
use radarllm_inference::{
    Description, PreparedClip, Segment,
    lm::{Abstained, NO_PERSON},
};
use radarllm_measure::{
    Activity, Before, Site, State, TrackedPerson,
    falls::{
        Around, DWELL_AROUND, Fall, NEAR_FALL_M, SECONDS_AROUND, ends_low, falls_of_points,
        falls_out_of_view, is_as_high_afterwards,
    },
    measure,
    people::MIN_TRACKED_S,
    sentence,
    states::states_of,
};

use crate::{
    falls_by_height::{FallByHeight, falls_by_height},
    gaps::follows,
    point_people::{PointTracks, STILL_THERE_S, hold_heights, track_options},
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
        let with_height = |mut site: Site| {
            site.stated_height_m = (!clip.is_height_assumed).then_some(clip.radar_height_m);
            site
        };
        let by_tracks = || Site::learn(&clip.radar, &clip.frames).ok();
        let of_tracks = site.cloned().or_else(by_tracks);
        let of_tracks = with_height(of_tracks.unwrap_or_else(|| unlearned_site(clip)));
        match measure(&clip.frames, &of_tracks, before) {
            Some(states) => Self::States(states),
            None => {
                let tracks = PointTracks::of(&clip.frames);
                let by_points = || tracks.learn_site(&clip.radar).ok();
                let site = site.cloned().or_else(by_points);
                let site = with_height(site.unwrap_or_else(|| unlearned_site(clip)));
                let mut people = tracks.people(Some(&site));
                // A running radar watches heights itself, frame by frame.
                let is_window = matches!(before, Before::Window { .. });
                let in_clip = |clip: &Clip, tracks: &PointTracks| {
                    let falls = falls_in_points(&clip.frames, &people, &site, is_window);
                    (segments(&tracks.walks()), falls)
                };
                let (mut walks, (mut falls, mut lying)) = in_clip(clip, &tracks);
                let all = clip.moving();
                let is_other = !std::ptr::eq(all, &**clip);
                if is_other && (!walks.is_empty() || !falls.is_empty()) {
                    let (other_walks, (other_falls, _)) =
                        in_clip(all, &PointTracks::of(&all.frames));
                    keep_shown(&mut walks, &other_walks);
                    keep_shown(&mut falls, &other_falls);
                }
                lying.retain_mut(|lies| begins_after_one_of(&falls, lies));
                if let Some(reported) = clip.reported() {
                    // A time without frames shows nobody, and says nothing.
                    let runs = reported.frames.chunk_by(follows);
                    let found = runs.flat_map(falls_out_of_view).collect();
                    add_falls(&mut falls, fall_segments(&reported.frames, found));
                }
                people.iter_mut().for_each(hold_heights);
                let mut segments = lying;
                segments.append(&mut postures_in_points(&people, &site, before));
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

/// The falls that the points of people show. Those of the middle of all points end near the floor where the height of the radar
/// is stated, and heights of each person are watched then, except in a window: that person lies afterwards.
fn falls_in_points(
    frames: &[PointFrame],
    people: &[TrackedPerson],
    site: &Site,
    is_window: bool,
) -> (Vec<Segment>, Vec<Segment>) {
    let mut falls = falls_of_points(frames);
    falls.retain(|fall| {
        let is_low = |height_m| ends_low(frames, fall, site, height_m);
        !people.iter().any(|p| stays_up(p, fall, &SECONDS_AROUND))
            && site.stated_height_m.is_none_or(is_low)
    });
    let (Some(height_m), false) = (site.stated_height_m, is_window) else {
        return (fall_segments(frames, falls), Vec::new());
    };
    let mut watched = falls_by_height(frames, site, height_m, track_options(frames));
    watched.retain(|one| !people.iter().any(|p| stays_up(p, &one.fall, &DWELL_AROUND)));
    // Who is down does not fall.
    let is_down = |t_s: f64| (watched.iter()).any(|one| (one.fall.t_s..one.until_s).contains(&t_s));
    falls.retain(|fall| !is_down(fall.t_s));
    let mut segments = fall_segments(frames, falls);
    let lying = watched.iter().filter_map(|one| lying_after(frames, one));
    let lying = lying.collect();
    let watched = watched.into_iter().map(|one| one.fall).collect();
    add_falls(&mut segments, fall_segments(frames, watched));
    (segments, lying)
}

/// The sentence of somebody who fell, from the moment of the fall until the person is up again or is seen no more at its place.
fn lying_after(
    frames: &[PointFrame],
    FallByHeight { fall, until_s }: &FallByHeight,
) -> Option<Segment> {
    let mut seen_s = fall.t_s;
    let begins = frames.partition_point(|frame| frame.time_s <= fall.t_s);
    for frame in &frames[begins..] {
        if frame.time_s >= *until_s || frame.time_s - seen_s > STILL_THERE_S {
            break;
        }
        let mut points = frame.points.iter().filter(|p| !p.is_leakage());
        let [x_m, y_m] = fall.place_m;
        if points.any(|p| (p.x_m - x_m).hypot(p.y_m - y_m) <= NEAR_FALL_M) {
            seen_s = frame.time_s;
        }
    }
    let caption = || format!("a person lies {:.1} m away", distance_m(fall));
    (seen_s > fall.t_s).then(|| segment([fall.t_s, seen_s], caption(), fall.probability))
}

/// Lets the sentence of somebody who lies begin where that of the fall ends, if a fall is stated there and the person lies for
/// longer.
fn begins_after_one_of(falls: &[Segment], lies: &mut Segment) -> bool {
    let is_its_fall =
        |fall: &&Segment| (fall.start_s - FALL_S..=fall.end_s + FALL_S).contains(&lies.start_s);
    let Some(fall) = falls.iter().find(is_its_fall) else {
        return false;
    };
    lies.start_s = fall.end_s;
    lies.end_s > lies.start_s
}

/// Adds falls that are not those which are there already.
fn add_falls(falls: &mut Vec<Segment>, mut others: Vec<Segment>) {
    let overlap = |a: &Segment, b: &Segment| a.start_s < b.end_s && b.start_s < a.end_s;
    others.retain(|fall| !falls.iter().any(|other| overlap(fall, other)));
    falls.append(&mut others);
    falls.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
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
            segments.push(segment(
                [start_s, end_s],
                sentence(state),
                state.probability,
            ));
            taken.push([start_s, end_s]);
        }
        // Times before this state are complete, but for falls: they stay.
        taken.sort_by(|a, b| a[0].total_cmp(&b[0]));
        join(&mut taken);
    }
    segments.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    segments
}

/// A sentence that is measured.
fn segment([start_s, end_s]: [f64; 2], caption: String, probability: f32) -> Segment {
    Segment {
        start_s,
        end_s,
        actions: radarllm_inference::actions(&caption),
        caption,
        confidence: probability,
        side_confidence: None,
        taught: None,
        guess: None,
    }
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

/// Whether a person is as high after a fall at the same place as before.
fn stays_up(person: &TrackedPerson, fall: &Fall, around: &Around) -> bool {
    is_as_high_afterwards(fall, around, |from_s, to_s| {
        let samples = person.between(from_s, to_s).iter();
        samples.filter_map(|s| Some((s.t_s, s.place_m, s.height_m?)))
    })
}

/// In which postures people stay who are tracked by their points, before a board whose site is known.
fn postures_in_points(people: &[TrackedPerson], site: &Site, before: Before) -> Vec<Segment> {
    /// Shorter ones, s, are not stated.
    const MIN_POSTURE_S: f64 = 3.0;
    let people = people.iter().filter(|p| p.length_s() >= MIN_TRACKED_S);
    let mut states: Vec<State> = people
        .flat_map(|p| states_of(p, site, &[], before))
        .filter(|s| matches!(s.activity, Activity::Stays(_)))
        // Which part of a body the points show depends on the board.
        .filter(|s| site.is_known_at(s.distances_m()[1]))
        .filter(|s| s.end_s - s.start_s >= MIN_POSTURE_S)
        .collect();
    states.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    let mut segments = segments(&states);
    for segment in &mut segments {
        // Whether somebody keeps still is another question: arms move, too.
        segment.caption = segment.caption.replacen("stands still", "stands", 1);
    }
    segments
}

/// Distance from the radar on the floor, m.
fn distance_m(fall: &Fall) -> f32 {
    fall.place_m[0].hypot(fall.place_m[1])
}

/// The sentences of falls in frames.
fn fall_segments(frames: &[PointFrame], falls: Vec<Fall>) -> Vec<Segment> {
    let end_s = frames.last().map_or(0.0, |f| f.time_s);
    let start_s = frames.first().map_or(0.0, |f| f.time_s);
    let of_fall = |fall: Fall| {
        let span_s = [
            (fall.t_s - FALL_S).max(start_s),
            (fall.t_s + FALL_S).min(end_s),
        ];
        let caption = format!("a person falls {:.1} m away", distance_m(&fall));
        segment(span_s, caption, fall.probability)
    };
    falls.into_iter().map(of_fall).collect()
}

#[cfg(test)]
mod tests {
    use radarllm_base::{Clutter, RadarPoint};
    use radarllm_measure::Posture;

    use super::*;
    use crate::falls_by_height::tests::{RADAR_M, body};

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
                Measured::InPoints(segments) => {
                    let falls = segments.iter().filter(|s| s.actions == ["fall"]);
                    falls.count()
                }
                Measured::States(_) => 0,
            }
        };
        assert_eq!([found(true), found(false)], [1, 0]);
    }

    /// The sentences of 40 s of a body: [`body`].
    fn sentences_of(top_m: impl Fn(f64) -> Option<f32>) -> Vec<(String, [f64; 2])> {
        let clip = Clip {
            frames: body(400, top_m),
            frame_rate_hz: 10.0,
            radar_height_m: RADAR_M,
            is_height_assumed: false,
            radar: "board".into(),
            provenance: "recorded:csv:x".parse().unwrap(),
            clutter: Clutter::Settled,
        };
        let clip = PreparedClip::of(&clip).unwrap();
        let Measured::InPoints(segments) = Measured::of(&clip, None, Before::Nothing) else {
            panic!("no tracks of a board")
        };
        let of = |s: Segment| (s.caption, [s.start_s, s.end_s]);
        segments.into_iter().map(of).collect()
    }

    #[test]
    fn who_fell_lies_until_the_person_is_up_or_seen_no_more() {
        let drops = |t_s: f64| (1.7 - 2.0 * (t_s - 5.0).max(0.0) as f32).max(0.3);
        let stays = |t_s: f64| Some(drops(t_s));
        let rises = |t_s: f64| Some(if t_s > 30.0 { 1.7 } else { drops(t_s) });
        let vanishes = |t_s: f64| (t_s < 15.0).then(|| drops(t_s));
        for (found, until_s) in [
            (sentences_of(stays), 39.8..40.0),
            (sentences_of(rises), 30.0..32.0),
            (sentences_of(vanishes), 14.8..15.0),
        ] {
            let [(lies, [from_s, to_s]), (falls, [_, end_s])] = &found[..] else {
                panic!("{found:?}")
            };
            assert!(falls.starts_with("a person falls 3."), "{falls}");
            assert!(lies.starts_with("a person lies 3."), "{lies}");
            assert!(from_s == end_s && until_s.contains(to_s), "{found:?}");
        }
    }

    /// Of somebody who sits and is hardly seen, the points are those of a raised arm and then those of the feet for a time.
    #[test]
    fn who_is_seen_as_high_afterwards_now_and_then_has_not_fallen() {
        let feet = |then_m: f32| {
            move |t_s: f64| match t_s {
                t if t < 14.0 => Some(0.9),
                t if t < 15.0 => Some(1.2),
                t if t < 17.0 => Some(0.3),
                t => (t % 3.0 < 1.0).then_some(then_m),
            }
        };
        assert_eq!(sentences_of(feet(0.9)), []);
        let fallen = sentences_of(feet(0.3));
        assert!(
            fallen.iter().any(|(s, _)| s.contains("falls")),
            "{fallen:?}"
        );
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
            turns: 0,
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
