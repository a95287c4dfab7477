//! Descriptions by what is measured: places, heights and speeds of the board's own tracks.

use radarllm_base::{Clip, PointFrame, stats::quantile_nearest};
use radarllm_inference::{
    Description, PreparedClip, Segment,
    lm::{Abstained, NO_PERSON},
};
use radarllm_measure::{
    Activity, Before, Site, State, TrackedPerson,
    falls::{Fall, ends_low, falls_of_points, falls_out_of_view},
    measure,
    people::{MIN_TRACKED_S, Sample},
    sentence,
    states::states_of,
};

use crate::{
    falls_by_height::falls_by_height,
    gaps::follows,
    point_people::{PointTracks, hold_heights, track_options},
};

/// Time that a fall in the points takes, s, before and after the moment at which it is found.
const FALL_S: f64 = 1.0;
/// Distance of the person from it, m.
const NEAR_FALL_M: f32 = 1.2;

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
                let is_window = matches!(before, Before::Window(_));
                let in_clip = |clip: &Clip, tracks: &PointTracks| {
                    let falls = falls_in_points(&clip.frames, &people, &site, is_window);
                    [segments(&tracks.walks()), falls]
                };
                let [mut walks, mut falls] = in_clip(clip, &tracks);
                let all = clip.moving();
                let is_other = !std::ptr::eq(all, &**clip);
                if is_other && (!walks.is_empty() || !falls.is_empty()) {
                    let [other_walks, other_falls] = in_clip(all, &PointTracks::of(&all.frames));
                    keep_shown(&mut walks, &other_walks);
                    keep_shown(&mut falls, &other_falls);
                }
                if let Some(reported) = clip.reported() {
                    // A time without frames shows nobody, and says nothing.
                    let runs = reported.frames.chunk_by(follows);
                    let found = runs.flat_map(falls_out_of_view).collect();
                    add_falls(&mut falls, fall_segments(&reported.frames, found));
                }
                people.iter_mut().for_each(hold_heights);
                let mut segments = postures_in_points(&people, &site, before);
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
/// is stated, and heights of each person are watched then, except in a window.
fn falls_in_points(
    frames: &[PointFrame],
    people: &[TrackedPerson],
    site: &Site,
    is_window: bool,
) -> Vec<Segment> {
    let mut falls = falls_of_points(frames);
    falls.retain(|fall| {
        let is_low = |height_m| ends_low(frames, fall, site, height_m);
        !people.iter().any(|p| stays_up(p, fall)) && site.stated_height_m.is_none_or(is_low)
    });
    let (Some(height_m), false) = (site.stated_height_m, is_window) else {
        return fall_segments(frames, falls);
    };
    let watched = falls_by_height(frames, site, height_m, track_options(frames));
    // Who is down does not fall.
    let is_down = |t_s: f64| (watched.iter()).any(|one| (one.fall.t_s..one.until_s).contains(&t_s));
    falls.retain(|fall| !is_down(fall.t_s));
    let mut segments = fall_segments(frames, falls);
    let watched = watched.into_iter().map(|one| one.fall).collect();
    add_falls(&mut segments, fall_segments(frames, watched));
    segments
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

/// Whether a person is as high after a fall at the same place as before: the middle of the points of somebody who stands is
/// that of the legs for a moment.
fn stays_up(person: &TrackedPerson, fall: &Fall) -> bool {
    /// Times before and after the fall, s.
    const BEFORE_S: [f64; 2] = [-4.0, -1.0];
    const AFTER_S: [f64; 2] = [1.5, 4.5];
    /// Change of the height below which it is that of before, m.
    const SAME_M: f32 = 0.25;
    /// Share of the time in which the person has to be seen.
    const SEEN: f64 = 0.7;
    let height_m = |[from_s, to_s]: [f64; 2]| {
        let samples = person.between(fall.t_s + from_s, fall.t_s + to_s);
        let near = samples.iter().filter(|s| {
            (s.place_m[0] - fall.place_m[0]).hypot(s.place_m[1] - fall.place_m[1]) <= NEAR_FALL_M
        });
        let seen: Vec<&Sample> = near.filter(|s| s.height_m.is_some()).collect();
        let seen_s = seen.last()?.t_s - seen.first()?.t_s;
        (seen_s >= SEEN * (to_s - from_s))
            .then(|| quantile_nearest(seen.iter().filter_map(|s| s.height_m), 0.5))?
    };
    let heights_m = height_m(BEFORE_S).zip(height_m(AFTER_S));
    heights_m.is_some_and(|(before_m, after_m)| before_m - after_m < SAME_M)
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
    use radarllm_base::{Clutter, RadarPoint};
    use radarllm_measure::Posture;

    use super::*;

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
