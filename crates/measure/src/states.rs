//! What people do, second by second, and joined to states with a beginning and an end.

use std::borrow::Cow;

use radarllm_base::{PointFrame, stats::quantile_nearest};

use crate::{
    Site,
    falls::{EVENT_S, Fall, confirmed, falls_of, falls_of_points, is_within, walks_on},
    people::{MIN_TRACKED_S, Sample, TrackedPerson, Tracker, tracked_people},
    posture::{Posture, PostureProbabilities},
};

/// Distance between places that are two seconds apart, m, from which on somebody walks. The board's tracks of people who
/// stay tremble by less than half of it; those of points jump between parts of the body.
const WALKING_M: f32 = 0.3;
const WALKING_BY_POINTS_M: f32 = 0.8;
/// Extent of the places of somebody who is tracked by points and walks, m, unless every second shows walking: a body that
/// tilts or reaches out moves its points fast at times, but not far.
const MIN_EXTENT_BY_POINTS_M: f32 = 1.0;
/// A walk that is not longer, s, and in which the places of the board's track extend over less, m, is a shift of somebody
/// who stays: who sits down or turns on a chair moves the track by up to half a metre.
const MAX_SHIFT_S: f64 = 4.0;
const MIN_EXTENT_M: f32 = 0.6;
/// Way back after which somebody has turned, m.
const TURN_M: f32 = 1.0;
/// Somebody who stays is at another place, and has a state of their own there, if the middles of the places of this time
/// before and after, s, are farther apart than this, m.
const PLACE_S: f64 = 5.0;
const OTHER_PLACE_M: f32 = 0.6;
/// Share of the time in which points show walking in which the board's tracks show it as well: docs/results/boards.md.
const SURE_BY_POINTS: f32 = 0.86;
/// Probability of a posture from which on it is stated where the site is not known well: a wrong posture says less than
/// none. The second one is for a radar whose height nobody states: it stands or hangs anywhere.
const SURE_OF_POSTURE: f32 = 0.65;
const SURE_OF_POSTURE_ASSUMED: f32 = 0.9;
/// The same in a window of a running radar, which keeps a posture once it is stated, and which will learn its site.
const SURE_OF_POSTURE_IN_WINDOW: f32 = 0.85;
/// Probability from which on a posture is clear where the site is known well, and seconds after the beginning in which it counts
/// for all of them; probability up to which a posture is wrong.
const CLEAR_POSTURE: f32 = 0.8;
const CLEAR_SOON: usize = 10;
const WRONG_POSTURE: f32 = 0.05;
/// Change of height, m, from which on somebody who stays may have changed the posture: whoever gets up or sits down is half a
/// metre higher or lower afterwards, and the height of somebody who keeps still drifts by up to a quarter of a metre.
const CHANGE_M: f32 = 0.3;
/// Share of the seconds around one in which somebody walks, from which on the person walks in it: who turns back stands for
/// a moment.
const WALKING: f32 = 0.5;
/// Seconds before and after in which walking counts as well, and postures: heights of still people drift within seconds.
const WALKING_NEIGHBOURS: usize = 2;
const POSTURE_NEIGHBOURS: usize = 4;
const HEIGHT_NEIGHBOURS: usize = 1;
/// States that are shorter, s, belong to the state before; falls are never joined to others.
const MIN_STATE_S: f64 = 2.0;
/// Seconds before a window whose height is that of the posture that is known at its beginning.
const SECONDS_BEFORE: usize = 6;
/// What is left of a state at the beginning of a window belongs to the next one if it is shorter, s.
const MIN_REST_S: f64 = 1.0;

/// Time after a fall that tells whether it was one, s; less where nobody states the height of the radar, because the time
/// before the fall has to be in the same window then. For how long somebody who is tracked may be lost meanwhile, s.
const AFTER_FALL_S: f64 = 3.0;
const AFTER_FALL_ASSUMED_S: f64 = 2.0;
const STILL_TRACKED_S: f64 = 0.5;

/// What a person does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// Walks.
    Walks,
    /// Stays in one place in a posture.
    Stays(Posture),
    /// Stays in one place; the board does not state heights.
    StaysSomehow,
    /// Falls.
    Falls,
}

/// What is known of a person before the first frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Before<'a> {
    /// Nothing: a recording is looked at as a whole.
    #[default]
    Nothing,
    /// The frames are a part of a recording, at whose beginning people of these tracks were in these postures.
    Part(&'a [(u32, Posture)]),
    /// The frames are a window of a running radar. A posture that is not sure is not stated: a later window would contradict
    /// it.
    Window {
        /// The frames before the window, in whose light its own are seen.
        earlier: &'a [PointFrame],
        /// The posture of the person at the beginning of the window, if it is known.
        posture: Option<Posture>,
    },
}

/// What a person does from one time to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// Number of the board's track.
    pub track: u32,
    /// Beginning, s.
    pub start_s: f64,
    /// End, s.
    pub end_s: f64,
    /// What the person does.
    pub activity: Activity,
    /// Probability of it, 0..=1.
    pub probability: f32,
    /// Places at the beginning and at the end, m: right of the radar, away from the radar.
    pub places_m: [[f32; 2]; 2],
    /// Least and greatest distance from the radar of the places of a second each, m.
    pub between_m: [f32; 2],
    /// How often the person turned back: distances from the radar that rise and then fall by a metre or more, or the other
    /// way round.
    pub turns: usize,
}

impl State {
    /// Distances from the radar at the beginning and at the end, m.
    pub fn distances_m(&self) -> [f32; 2] {
        self.places_m.map(|[x_m, y_m]| x_m.hypot(y_m))
    }
}

/// What the people whom the board tracks do, ordered by their beginnings; `None` if the frames have no report of a board.
pub fn measure(frames: &[PointFrame], site: &Site, before: Before) -> Option<Vec<State>> {
    let (frames, from_s) = match (before, frames.first()) {
        (Before::Window { earlier, .. }, Some(first)) if !earlier.is_empty() => {
            (Cow::Owned([earlier, frames].concat()), first.time_s)
        }
        _ => (Cow::Borrowed(frames), f64::NEG_INFINITY),
    };
    let frames: &[PointFrame] = &frames;
    let people = tracked_people(frames, Some(site))?;
    // Only who is tracked in a plane has the falls of the points.
    let falls = match people.iter().any(is_flat) {
        true => falls_of_points(frames),
        false => Vec::new(),
    };
    let span_s = |times: [Option<f64>; 2]| match times {
        [Some(first_s), Some(last_s)] => last_s - first_s,
        _ => 0.0,
    };
    let whole_s = span_s([frames.first(), frames.last()].map(|f| f.map(|f| f.time_s)));
    // A track that flickers is nobody, unless the recording is as short.
    let is_somebody = |p: &&TrackedPerson| p.length_s() >= MIN_TRACKED_S.min(0.5 * whole_s);
    let end_s = frames.last().map_or(0.0, |frame| frame.time_s);
    // What comes after a fall tells whether it was one. A window of a running radar may end before that, and the next one
    // does not.
    let is_known = |person: &TrackedPerson, fall: &Fall| {
        let goes_on = person.length_s() >= EVENT_S && end_s - person.end_s() < STILL_TRACKED_S;
        let after_s = match site.is_height_assumed {
            true => AFTER_FALL_ASSUMED_S,
            false => AFTER_FALL_S,
        };
        !goes_on || end_s - fall.t_s >= after_s
    };
    let falls_of_person = |person: &TrackedPerson| -> Vec<Fall> {
        let falls = match is_flat(person) {
            // One person at a time: the points are those of the room.
            true => falls.clone(),
            false => falls_of(person, site),
        };
        let falls = falls.into_iter().filter(|fall| is_known(person, fall));
        falls
            .filter(|fall| !walks_on(person, fall))
            .filter_map(|fall| confirmed(frames, person, fall, site))
            .collect()
    };
    let start_s = (frames.first()).map_or(0.0, |frame| frame.time_s.max(from_s));
    // Who comes later is somebody else.
    let before_of = |person: &TrackedPerson| match before {
        Before::Window { earlier, .. } if person.start_s() - start_s > STILL_TRACKED_S => {
            Before::Window {
                earlier,
                posture: None,
            }
        }
        Before::Part(_) if person.start_s() - start_s > STILL_TRACKED_S => Before::Nothing,
        before => before,
    };
    let mut states: Vec<State> = (people.iter())
        .filter(is_somebody)
        .flat_map(|p| {
            let states = joined_states(p, site, &falls_of_person(p), before_of(p), from_s);
            placed(p, since(p, states, from_s))
        })
        .collect();
    states.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    Some(states)
}

/// A second of a person.
struct Second {
    is_walking: bool,
    posture: Option<PostureProbabilities>,
    /// Height above the radar, m.
    height_m: Option<f32>,
    is_falling: bool,
    places_m: [[f32; 2]; 2],
    start_s: f64,
    end_s: f64,
}

/// Whether a person is tracked in a plane.
fn is_flat(person: &TrackedPerson) -> bool {
    person.samples.iter().all(|s| s.height_m.is_none())
}

/// What a person does who has these falls.
pub fn states_of(
    person: &TrackedPerson,
    site: &Site,
    falls: &[Fall],
    before: Before,
) -> Vec<State> {
    let states = joined_states(person, site, falls, before, f64::NEG_INFINITY);
    placed(person, states)
}

/// The same of a window that begins at `from_s`, with the time before it; only the places between beginning and end are not
/// known yet.
fn joined_states(
    person: &TrackedPerson,
    site: &Site,
    falls: &[Fall],
    before: Before,
    from_s: f64,
) -> Vec<State> {
    let seconds = seconds_of(person, site, falls);
    let mut states: Vec<State> = Vec::new();
    let are_down = are_down(&seconds);
    let activities = activities_of(person, site, &seconds, falls, before, from_s);
    for (i, (second, (mut activity, mut probability))) in seconds.iter().zip(activities).enumerate()
    {
        if are_down[i] && activity == Activity::Stays(Posture::Sitting) {
            // Some boards track who lies as high as others track who sits.
            activity = Activity::Stays(Posture::Lying);
        }
        if person.tracker == Tracker::Points && activity == Activity::Walks {
            probability *= SURE_BY_POINTS;
        }
        match states.last_mut() {
            Some(last) if last.activity == activity => {
                let share = (second.end_s - second.start_s) / (second.end_s - last.start_s);
                last.probability += share as f32 * (probability - last.probability);
                last.end_s = second.end_s;
                last.places_m[1] = second.places_m[1];
            }
            _ => states.push(State {
                track: person.track,
                start_s: second.start_s,
                end_s: second.end_s,
                activity,
                probability,
                places_m: second.places_m,
                between_m: [0.0; 2],
                turns: 0,
            }),
        }
    }
    let mut states = joined(states);
    for at in 0..states.len() {
        let state = states[at];
        if state.activity != Activity::Walks {
            continue;
        }
        let extent_m = extent_m(&places_of_seconds(person, &state));
        match person.tracker {
            Tracker::Points => {
                let is_doubtful = state.probability < 0.99 * SURE_BY_POINTS;
                if is_doubtful && extent_m < MIN_EXTENT_BY_POINTS_M {
                    states[at].activity = Activity::StaysSomehow;
                }
            }
            Tracker::Board => {
                let is_short = state.end_s - state.start_s <= MAX_SHIFT_S;
                if let (true, Some(rest)) = (
                    is_short && extent_m < MIN_EXTENT_M,
                    stays_beside(&states, at),
                ) {
                    states[at].activity = rest.activity;
                    states[at].probability = rest.probability;
                }
            }
        }
    }
    let mut has_fallen = false;
    for state in &mut states {
        let is_known = site.is_known_at(state.distances_m()[1]);
        // Who has just fallen lies where the height says so, even if it is not certain.
        if let Activity::Stays(_) = state.activity
            && state.probability < sure_of_posture(site, before)
            && !is_known
            && !has_fallen
        {
            state.activity = Activity::StaysSomehow;
            state.probability = 1.0;
        }
        has_fallen = state.activity == Activity::Falls;
    }
    joined(states)
}

/// States with their places.
fn placed(person: &TrackedPerson, states: Vec<State>) -> Vec<State> {
    let mut states: Vec<State> = (states.into_iter())
        .flat_map(|state| by_place(person, state))
        .collect();
    for state in &mut states {
        let [from_m, to_m] = state.distances_m();
        let distances_m: Vec<f32> = places_of_seconds(person, state)
            .into_iter()
            .map(|[x_m, y_m]| x_m.hypot(y_m))
            .collect();
        let ends_m = [from_m.min(to_m), from_m.max(to_m)];
        state.between_m = distances_m.iter().fold(ends_m, |between, m| {
            [between[0].min(*m), between[1].max(*m)]
        });
        state.turns = turns(&distances_m);
    }
    states
}

/// What is left of states from a time on. A short rest of the first one belongs to the next.
fn since(person: &TrackedPerson, mut states: Vec<State>, from_s: f64) -> Vec<State> {
    states.retain(|state| state.end_s > from_s);
    let is_cut = states.first().is_some_and(|first| first.start_s < from_s);
    if !is_cut {
        return states;
    }
    let is_rest = |first: &State| first.end_s - from_s < MIN_REST_S;
    if states.len() > 1 && states.first().is_some_and(is_rest) {
        states.remove(0);
    }
    if let Some(first) = states.first_mut() {
        first.start_s = from_s;
        if let Some(sample) = person.between(from_s, first.end_s).first() {
            first.places_m[0] = sample.place_m;
        }
    }
    states
}

/// How often distances turn back by [`TURN_M`] or more.
fn turns(distances_m: &[f32]) -> usize {
    let Some(first_m) = distances_m.first() else {
        return 0;
    };
    let mut n = 0;
    let [mut nearest_m, mut farthest_m] = [*first_m; 2];
    // Whether the last way of such a length led away; none did at the beginning.
    let mut is_away: Option<bool> = None;
    for m in distances_m {
        [nearest_m, farthest_m] = [nearest_m.min(*m), farthest_m.max(*m)];
        let goes_away = match (m - nearest_m >= TURN_M, farthest_m - m >= TURN_M) {
            (true, _) if is_away != Some(true) => true,
            (_, true) if is_away != Some(false) => false,
            _ => continue,
        };
        n += usize::from(is_away.is_some());
        is_away = Some(goes_away);
        // The next way back is measured from here on.
        [nearest_m, farthest_m] = [*m; 2];
    }
    n
}

fn sure_of_posture(site: &Site, before: Before) -> f32 {
    match (site.is_height_assumed, before) {
        (true, _) => SURE_OF_POSTURE_ASSUMED,
        (false, Before::Window { .. }) => SURE_OF_POSTURE_IN_WINDOW,
        (false, _) => SURE_OF_POSTURE,
    }
}

/// Whether a person fell before each second and has not risen since.
fn are_down(seconds: &[Second]) -> Vec<bool> {
    /// Somebody who gets onto a chair is that much higher than on the floor, m, for two seconds.
    const RISEN_M: f32 = 0.35;
    let mut floor_m: Option<f32> = None;
    let height_m = |at: usize| seconds.get(at).and_then(|second: &Second| second.height_m);
    let is_down = |(at, second): (usize, &Second)| {
        if second.is_falling {
            floor_m = height_m(at);
        }
        if let (Some(lowest_m), Some(own_m)) = (floor_m, height_m(at)) {
            let lowest_m = lowest_m.min(own_m);
            let kept_m = height_m(at + 1).map_or(own_m, |next_m| next_m.min(own_m));
            floor_m = (kept_m - lowest_m < RISEN_M).then_some(lowest_m);
        }
        floor_m.is_some() && !second.is_falling
    };
    seconds.iter().enumerate().map(is_down).collect()
}

/// The state before or after a state, if the person stays there in a known posture; the longer of two.
fn stays_beside(states: &[State], at: usize) -> Option<State> {
    let before = at.checked_sub(1).and_then(|before| states.get(before));
    let beside = before.into_iter().chain(states.get(at + 1)).copied();
    beside
        .filter(|s| matches!(s.activity, Activity::Stays(_)))
        .max_by(|a, b| (a.end_s - a.start_s).total_cmp(&(b.end_s - b.start_s)))
}

/// A state of somebody who stays, or one for each place if the person goes a step aside, takes the chair along, or is
/// followed by somebody else: the distance of one would be wrong for the other. A place is the middle of those of its time.
fn by_place(person: &TrackedPerson, state: State) -> Vec<State> {
    if !matches!(state.activity, Activity::Stays(_) | Activity::StaysSomehow) {
        return vec![state];
    }
    let places = timed_places(person, &state);
    // Places of a second come every half.
    let n = (2.0 * PLACE_S) as usize;
    let moved_m = |at: usize| {
        let [before, after] = [&places[at - n..at], &places[at..at + n]].map(middle);
        (before[0] - after[0]).hypot(before[1] - after[1])
    };
    let candidates = n..(places.len() + 1).saturating_sub(n);
    let moved: Vec<(usize, f32)> = candidates.map(|at| (at, moved_m(at))).collect();
    let mut cuts: Vec<usize> = vec![0];
    for run in moved.chunk_by(|a, b| (a.1 > OTHER_PLACE_M) == (b.1 > OTHER_PLACE_M)) {
        let farthest = run.iter().max_by(|a, b| a.1.total_cmp(&b.1));
        cuts.extend(
            farthest
                .filter(|cut| cut.1 > OTHER_PLACE_M)
                .map(|cut| cut.0),
        );
    }
    cuts.push(places.len());
    let part = |pair: &[usize]| {
        let of_part = &places[pair[0]..pair[1]];
        let time_s = |at: usize| places.get(at).map_or(state.end_s, |place| place.0);
        let place_m = match of_part.is_empty() {
            true => state.places_m[1],
            false => middle(of_part),
        };
        State {
            start_s: if pair[0] == 0 {
                state.start_s
            } else {
                time_s(pair[0])
            },
            end_s: time_s(pair[1]),
            places_m: [place_m; 2],
            ..state
        }
    };
    cuts.windows(2).map(part).collect()
}

/// The middle of places, of each axis by itself.
fn middle(places: &[(f64, [f32; 2])]) -> [f32; 2] {
    [0, 1].map(|axis| {
        quantile_nearest(places.iter().map(|place| place.1[axis]), 0.5).unwrap_or_default()
    })
}

/// The places of a person in a state, m, each the mean of a second.
fn places_of_seconds(person: &TrackedPerson, state: &State) -> Vec<[f32; 2]> {
    let places = timed_places(person, state).into_iter();
    places.map(|(_, place_m)| place_m).collect()
}

/// The same with the times at which the seconds begin, s; they come every half second.
fn timed_places(person: &TrackedPerson, state: &State) -> Vec<(f64, [f32; 2])> {
    let mut places = Vec::new();
    let mut t_s = state.start_s;
    while t_s < state.end_s {
        let samples = person.between(t_s, (t_s + 1.0).min(state.end_s));
        let n = samples.len() as f32;
        if n > 0.0 {
            let mean = |axis: usize| samples.iter().map(|s| s.place_m[axis]).sum::<f32>() / n;
            places.push((t_s, [mean(0), mean(1)]));
        }
        t_s += 0.5;
    }
    places
}

/// Largest distance between places, m.
fn extent_m(places_m: &[[f32; 2]]) -> f32 {
    let range = |axis: usize| {
        let values = || places_m.iter().map(|p| p[axis]);
        values().fold(f32::MIN, f32::max) - values().fold(f32::MAX, f32::min)
    };
    match places_m.is_empty() {
        true => 0.0,
        false => range(0).hypot(range(1)),
    }
}

fn seconds_of(person: &TrackedPerson, site: &Site, falls: &[Fall]) -> Vec<Second> {
    let walking_m = match person.tracker {
        Tracker::Board => WALKING_M,
        Tracker::Points => WALKING_BY_POINTS_M,
    };
    let mut seconds = Vec::new();
    let mut t_s = person.start_s();
    while t_s < person.end_s() || seconds.is_empty() {
        let samples = person.between(t_s, t_s + 1.0);
        let start_s = t_s;
        t_s += 1.0;
        let (Some(first), Some(last)) = (samples.first(), samples.last()) else {
            continue;
        };
        // The places of a second before and after, so that a still person whose track trembles does not walk.
        let wide = person.between(start_s - 0.5, start_s + 1.5);
        let path_m = wide.first().zip(wide.last()).map_or(0.0, |(a, b)| {
            let speed = (a.place_m[0] - b.place_m[0]).hypot(a.place_m[1] - b.place_m[1]);
            let seconds = (b.t_s - a.t_s).max(0.5) as f32;
            speed * 2.0 / seconds
        });
        let height = quantile_nearest(samples.iter().filter_map(|s| s.height_m), 0.5);
        seconds.push(Second {
            is_walking: path_m >= walking_m,
            height_m: height,
            posture: height.map(|height_m| {
                let [x_m, y_m] = first.place_m;
                let error_m = site.height_error_m(x_m.hypot(y_m));
                let below_m = site.standing_m - height_m;
                PostureProbabilities::of(below_m, site.standing_above_floor_m(), error_m)
            }),
            is_falling: falls
                .iter()
                .any(|fall| samples.iter().any(|s: &Sample| is_within(fall, s))),
            places_m: [first.place_m, last.place_m],
            start_s,
            end_s: (start_s + 1.0).min(person.end_s().max(start_s)),
        });
    }
    seconds
}

/// What a person does in each second, with its probability.
fn activities_of(
    person: &TrackedPerson,
    site: &Site,
    seconds: &[Second],
    falls: &[Fall],
    before: Before,
    from_s: f64,
) -> Vec<(Activity, f32)> {
    let mut activities: Vec<(Activity, f32)> = Vec::with_capacity(seconds.len());
    let seen: Vec<Seen> = (0..seconds.len())
        .map(|at| seen(seconds, at, falls, before))
        .collect();
    let at_window = match before {
        Before::Window { posture, .. } => posture,
        Before::Nothing | Before::Part(_) => None,
    };
    let mut kept = match before {
        Before::Nothing => None,
        Before::Part(known) => (known.iter().find(|known| known.0 == person.track)).map(|k| k.1),
        Before::Window { .. } => at_window.filter(|_| from_s == f64::NEG_INFINITY),
    };
    // Runs of seconds in which the person stays, walks or falls.
    let mut at = 0;
    for run in seen.chunk_by(|a, b| a.kind() == b.kind()) {
        let span = at..at + run.len();
        at = span.end;
        let is_after_fall = activities
            .last()
            .is_some_and(|last| last.0 == Activity::Falls);
        match run[0] {
            Seen::Stays(_) => {
                let run: Vec<Stay> = (run.iter())
                    .filter_map(|seen| match seen {
                        Seen::Stays(stays) => Some(*stays),
                        Seen::Other(..) => None,
                    })
                    .collect();
                let states_unsure = !matches!(before, Before::Window { .. }) || is_after_fall;
                let [x_m, y_m] = seconds[span.start].places_m[0];
                let is_known = site.is_known_at(x_m.hypot(y_m));
                let sure = (!is_known).then(|| sure_of_posture(site, before));
                // What was said of the beginning of the window is known there.
                let n_earlier = seconds[span].partition_point(|second| second.start_s < from_s);
                let (earlier, own) = run.split_at(n_earlier);
                let mut postures = postures_of(earlier, &[], &mut kept, states_unsure, sure);
                let is_parted = !earlier.is_empty() && !own.is_empty();
                kept = at_window.filter(|_| is_parted).or(kept);
                postures.extend(postures_of(own, earlier, &mut kept, states_unsure, sure));
                activities.extend(postures.into_iter().map(|posture| match posture {
                    Some((posture, probability)) => (Activity::Stays(posture), probability),
                    None => (Activity::StaysSomehow, 1.0),
                }));
            }
            Seen::Other(activity, _) => {
                if activity != Activity::StaysSomehow && !is_shift(person, &seconds[span]) {
                    kept = None;
                }
                let others = run.iter().map(|seen| match seen {
                    Seen::Other(activity, probability) => (*activity, *probability),
                    Seen::Stays(_) => (activity, 0.0),
                });
                activities.extend(others);
            }
        }
    }
    activities
}

/// The postures of successive seconds of somebody who stays, with their probabilities. `kept` is the posture before the first
/// and after the last one, if it is known.
///
/// The person has one posture until the height changes as much as that of somebody who gets up or sits down: in between,
/// heights drift. It is the one that is clear soon, or the most probable one over the time, or none. `sure` is the probability
/// from which on a posture is stated where the site is not known well; `earlier` are the seconds before the first one.
fn postures_of(
    run: &[Stay],
    earlier: &[Stay],
    kept: &mut Option<Posture>,
    states_unsure: bool,
    sure: Option<f32>,
) -> Vec<Option<(Posture, f32)>> {
    let is_known = sure.is_none();
    let mut postures = Vec::with_capacity(run.len());
    // Without the last two, in which the person may be on the way already.
    let before = earlier.len().saturating_sub(2);
    let before = &earlier[before.saturating_sub(SECONDS_BEFORE)..before];
    let (mut from, mut is_first) = (0, true);
    while from < run.len() {
        let known = kept.filter(|_| is_first);
        let before = if is_first { before } else { &[] };
        let to = end_of_posture(run, from, before, known, is_known);
        if to == from {
            // It ended with the seconds before.
            is_first = false;
            continue;
        }
        let part = &run[from..to];
        let mean = mean_of(part).best();
        let clear = || {
            let mut soon = (0..part.len().min(CLEAR_SOON)).map(|at| around(part, at).best());
            let clear = soon.find(|best| is_known && best.1 >= CLEAR_POSTURE);
            clear.map(|best| best.0)
        };
        let states_mean = states_unsure || !is_first || sure.is_some_and(|sure| mean.1 >= sure);
        let stated = (known.or_else(clear)).or_else(|| states_mean.then_some(mean.0));
        *kept = stated;
        (from, is_first) = (to, false);
        let Some(stated) = stated else {
            postures.extend(part.iter().map(|_| None));
            continue;
        };
        let probabilities: Vec<f32> = (0..part.len())
            .map(|at| around(part, at).of_posture(stated))
            .collect();
        // What was clear once is as sure as then; what was known before is at least clear. Errors of a site that is not known
        // well are the same all the time.
        let min = known.map_or(0.0, |_| CLEAR_POSTURE);
        let surest = probabilities.iter().copied().fold(min, f32::max);
        let is_clear = is_known && surest >= CLEAR_POSTURE;
        postures.extend(
            (probabilities.iter()).map(|own| Some((stated, if is_clear { surest } else { *own }))),
        );
    }
    postures
}

/// Where the posture ends that begins with a second, or that was known in the seconds before it: the height changes by a step
/// to that of another posture, or the posture is wrong.
fn end_of_posture(
    run: &[Stay],
    from: usize,
    before: &[Stay],
    known: Option<Posture>,
    is_known: bool,
) -> usize {
    let before = before.iter().filter(|_| known.is_some());
    let mut heights_m: Vec<f32> = before.map(|stay| stay.height_m).collect();
    for to in from..run.len() {
        let own = &run[from..to];
        let now = || known.unwrap_or_else(|| mean_of(own).best().0);
        let has_moved = || {
            let mean_m = heights_m.iter().sum::<f32>() / heights_m.len() as f32;
            let is_other = |stay: &Stay| {
                (stay.height_m - mean_m).abs() >= CHANGE_M && stay.postures.best().0 != now()
            };
            run[to..].iter().take(2).all(is_other)
        };
        let is_wrong = || {
            let probability = around(&run[from..], to - from).of_posture(now());
            is_known && probability <= WRONG_POSTURE
        };
        if !heights_m.is_empty() && has_moved() || to > from && is_wrong() {
            return to;
        }
        heights_m.push(run[to].height_m);
    }
    run.len()
}

fn mean_of(part: &[Stay]) -> PostureProbabilities {
    let postures: Vec<PostureProbabilities> = part.iter().map(|stay| stay.postures).collect();
    PostureProbabilities::mean(&postures)
}

/// The postures of a second and of those around it.
fn around(part: &[Stay], at: usize) -> PostureProbabilities {
    let from = at.saturating_sub(POSTURE_NEIGHBOURS);
    mean_of(&part[from..(at + POSTURE_NEIGHBOURS + 1).min(part.len())])
}

/// Whether the walk of these seconds is a shift of somebody who stays.
fn is_shift(person: &TrackedPerson, walk: &[Second]) -> bool {
    let [Some(first), Some(last)] = [walk.first(), walk.last()] else {
        return true;
    };
    let places: Vec<[f32; 2]> = walk.iter().flat_map(|second| second.places_m).collect();
    person.tracker == Tracker::Board
        && walk.iter().all(|second| !second.is_falling)
        && last.end_s - first.start_s <= MAX_SHIFT_S
        && extent_m(&places) < MIN_EXTENT_M
}

/// A second in which a person stays, by the heights of one second before and after it.
#[derive(Clone, Copy, Debug)]
struct Stay {
    postures: PostureProbabilities,
    /// Height above the radar, m.
    height_m: f32,
}

/// What a second and those around it show.
#[derive(Clone, Copy, Debug)]
enum Seen {
    /// The person stays.
    Stays(Stay),
    /// Something else, with its probability.
    Other(Activity, f32),
}

impl Seen {
    /// The activity, if it is known already.
    fn kind(&self) -> Option<Activity> {
        match self {
            Self::Stays(_) => None,
            Self::Other(activity, _) => Some(*activity),
        }
    }
}

fn seen(seconds: &[Second], at: usize, falls: &[Fall], before: Before) -> Seen {
    let second = &seconds[at];
    if second.is_falling {
        let middle_s = 0.5 * (second.start_s + second.end_s);
        let distance = |fall: &Fall| (fall.t_s - middle_s).abs();
        let nearest = falls
            .iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)));
        return Seen::Other(Activity::Falls, nearest.map_or(0.5, |f| f.probability));
    }
    let around = |n: usize| &seconds[at.saturating_sub(n)..(at + n + 1).min(seconds.len())];
    let near = around(WALKING_NEIGHBOURS);
    let n_walking = near.iter().filter(|s| s.is_walking).count() as f32;
    // At the ends of a window, a single second is no walk of somebody who stayed before: if it is the beginning of one, the next
    // window shows it. Who walked before goes on.
    let n_near = match before {
        Before::Window { earlier, posture } if posture.is_some() || !earlier.is_empty() => {
            2 * WALKING_NEIGHBOURS + 1
        }
        Before::Window { .. } | Before::Nothing | Before::Part(_) => near.len(),
    };
    let walking = n_walking / n_near as f32;
    if walking >= WALKING {
        return Seen::Other(Activity::Walks, walking);
    }
    // Heights of somebody who walks or falls say nothing of the posture before and after.
    let known = |n: usize| -> Vec<(PostureProbabilities, f32)> {
        let still = around(n).iter().filter(|s| !s.is_walking && !s.is_falling);
        let of_second = |second: &Second| second.posture.zip(second.height_m);
        still.filter_map(of_second).collect()
    };
    // Where the second itself has no height, those farther away have.
    let mut near = known(HEIGHT_NEIGHBOURS);
    if near.is_empty() {
        near = known(POSTURE_NEIGHBOURS);
    }
    if near.is_empty() {
        near.extend(second.posture.zip(second.height_m));
    }
    if near.is_empty() {
        return Seen::Other(Activity::StaysSomehow, 1.0 - walking);
    }
    let (postures, heights_m): (Vec<PostureProbabilities>, Vec<f32>) = near.into_iter().unzip();
    Seen::Stays(Stay {
        postures: PostureProbabilities::mean(&postures),
        height_m: heights_m.iter().sum::<f32>() / heights_m.len() as f32,
    })
}

/// Joins states that are too short to the state before, or the first to the one after.
fn joined(states: Vec<State>) -> Vec<State> {
    let mut out: Vec<State> = Vec::new();
    for mut state in states {
        let is_short =
            |s: &State| s.end_s - s.start_s < MIN_STATE_S && s.activity != Activity::Falls;
        match out.last_mut() {
            Some(last) if last.activity == state.activity => {
                let share = (state.end_s - state.start_s) / (state.end_s - last.start_s).max(1e-6);
                last.probability += share as f32 * (state.probability - last.probability);
                last.end_s = state.end_s;
                last.places_m[1] = state.places_m[1];
            }
            Some(last) if is_short(&state) && last.activity != Activity::Falls => {
                last.end_s = state.end_s;
                last.places_m[1] = state.places_m[1];
            }
            Some(last) if is_short(last) => {
                state.start_s = last.start_s;
                state.places_m[0] = last.places_m[0];
                *last = state;
            }
            _ => out.push(state),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::people::tests::frames;

    fn window(posture: Option<Posture>) -> Before<'static> {
        Before::Window {
            earlier: &[],
            posture,
        }
    }

    fn activities(at: impl Fn(f64) -> Option<[f32; 3]>, seconds: f64) -> Vec<(Activity, i32, i32)> {
        let site = Site::unlearned("board", 1.5);
        let states = measure(&frames(seconds, at), &site, Before::Nothing).unwrap();
        let row = |s: &State| (s.activity, s.start_s.round() as i32, s.end_s.round() as i32);
        states.iter().map(row).collect()
    }

    #[test]
    fn somebody_walks_sits_down_and_leaves() {
        let at = |t: f64| match t {
            t if t < 6.0 => Some([5.0 - 0.5 * t as f32, 0.1, 0.0]),
            t if t < 20.0 => Some([2.0, -0.4, 0.0]),
            _ => None,
        };
        let found = activities(at, 30.0);
        let [
            (Activity::Walks, 0, a),
            (Activity::Stays(Posture::Sitting), b, 20),
        ] = found[..]
        else {
            panic!("{found:?}")
        };
        assert!(a == b && (5..=7).contains(&a), "{found:?}");
    }

    #[test]
    fn whoever_goes_back_by_a_metre_has_turned() {
        let to_and_fro = [1.5, 3.0, 4.9, 3.2, 1.5, 2.7, 4.9];
        assert_eq!(turns(&to_and_fro), 2);
        assert_eq!(turns(&to_and_fro[..3]), 0);
        // Half a metre back is none.
        assert_eq!(turns(&[1.5, 3.0, 2.5, 4.0, 3.5, 5.0]), 0);
        assert_eq!(turns(&[5.0, 4.5, 3.9, 4.2, 4.95]), 1);
        assert_eq!(turns(&[]), 0);
    }

    #[test]
    fn somebody_falls_and_lies() {
        let at = |t: f64| match t {
            t if t < 8.0 => Some([2.0, 0.15, 0.0]),
            t if t < 9.0 => Some([2.0, 0.1 - 1.4 * (t - 8.0) as f32, -1.4]),
            _ => Some([2.0, -1.3, 0.0]),
        };
        let found = activities(at, 20.0);
        let kinds: Vec<Activity> = found.iter().map(|s| s.0).collect();
        assert_eq!(
            kinds,
            [
                Activity::Stays(Posture::Standing),
                Activity::Falls,
                Activity::Stays(Posture::Lying)
            ],
            "{found:?}"
        );
    }

    /// A board that tracks the chest of who lies, 1.15 m below who stands: whoever fell lies until rising.
    #[test]
    fn who_fell_lies_and_who_sat_down_sits() {
        let kinds = |speed_mps: f32, below_m: f32, chair: bool| {
            let down_s = f64::from(below_m / speed_mps);
            let at = move |t: f64| match t {
                t if t < 8.0 => Some([2.0, 0.15, 0.0]),
                t if t < 8.0 + down_s => {
                    Some([2.0, 0.15 - speed_mps * (t - 8.0) as f32, -speed_mps])
                }
                t if t < 20.0 || !chair => Some([2.0, 0.15 - below_m, 0.0]),
                _ => Some([2.0, -0.5, 0.0]),
            };
            let found = activities(at, 40.0);
            found.into_iter().map(|s| s.0).collect::<Vec<_>>()
        };
        let [stands, sits, lies] =
            [Posture::Standing, Posture::Sitting, Posture::Lying].map(Activity::Stays);
        assert_eq!(kinds(1.6, 1.15, false), [stands, Activity::Falls, lies]);
        assert_eq!(
            kinds(1.6, 1.15, true),
            [stands, Activity::Falls, lies, sits]
        );
        assert_eq!(kinds(0.5, 0.8, false), [stands, sits]);
    }

    /// A window of a running radar may end before it is known what follows a fall; the next one does not.
    #[test]
    fn a_fall_is_stated_when_it_is_known_what_follows() {
        let falls = |seconds: f64, y_m: &dyn Fn(f64) -> f32| {
            let at = |t: f64| match t {
                t if t < 8.0 => Some([y_m(t), 0.15, 0.0]),
                t if t < 9.0 => Some([y_m(t), 0.1 - 1.4 * (t - 8.0) as f32, -1.4]),
                _ => Some([y_m(t), -1.3, 0.0]),
            };
            let found = activities(at, seconds);
            found.iter().any(|s| s.0 == Activity::Falls)
        };
        assert!(!falls(9.5, &|_| 2.0));
        assert!(falls(13.0, &|_| 2.0));
        // Who goes on has not fallen: the track sank alone.
        assert!(!falls(14.0, &|t| 2.0 + 0.5 * t as f32));
    }

    /// A body that tilts to and fro moves the track of its points fast, and never far.
    #[test]
    fn who_tilts_on_the_spot_does_not_walk() {
        let states = |extent_m: f32, tracker: Tracker| {
            let sample = |i: u16| {
                let turn = (f32::from(i) / 10.0 / 6.0).fract();
                let way = 1.0 - (2.0 * turn - 1.0).abs();
                Sample {
                    t_s: f64::from(i) / 10.0,
                    place_m: [0.0, 1.5 + extent_m * way],
                    height_m: None,
                    upward_mps: None,
                }
            };
            let person = TrackedPerson {
                tracker,
                track: 1,
                samples: (0..240).map(sample).collect(),
            };
            states_of(
                &person,
                &Site::unlearned("board", 1.0),
                &[],
                Before::Nothing,
            )
        };
        let walks = |states: Vec<State>| states.iter().any(|s| s.activity == Activity::Walks);
        assert!(!walks(states(0.9, Tracker::Points)));
        assert!(walks(states(3.0, Tracker::Points)));
        assert!(walks(states(0.9, Tracker::Board)));
    }

    /// Tracks of points jump between parts of the body, so that they walk only from a longer way on.
    #[test]
    fn the_same_way_is_walking_for_the_board_and_trembling_for_points() {
        let walks = |tracker: Tracker, speed_mps: f32| {
            let sample = |i: u16| Sample {
                t_s: f64::from(i) / 10.0,
                place_m: [0.0, 2.0 + speed_mps * f32::from(i) / 10.0],
                height_m: None,
                upward_mps: None,
            };
            let person = TrackedPerson {
                tracker,
                track: 1,
                samples: (0..60).map(sample).collect(),
            };
            let states = states_of(
                &person,
                &Site::unlearned("board", 1.0),
                &[],
                Before::Nothing,
            );
            states.iter().all(|s| s.activity == Activity::Walks)
        };
        for (speed_mps, board, points) in
            [(0.1, false, false), (0.25, true, false), (0.5, true, true)]
        {
            assert_eq!(walks(Tracker::Board, speed_mps), board, "{speed_mps}");
            assert_eq!(walks(Tracker::Points, speed_mps), points, "{speed_mps}");
        }
    }

    /// Who sits and shifts on the chair sits all the time; who gets up and walks does not.
    #[test]
    fn a_shift_on_a_chair_is_no_walk() {
        let found = |shift_m: f32| {
            let at = |t: f64| {
                let share = ((t as f32 - 20.0) / 2.0).clamp(0.0, 1.0);
                Some([3.0 + shift_m * share, -0.4, 0.0])
            };
            activities(at, 40.0)
        };
        let sits = Activity::Stays(Posture::Sitting);
        assert_eq!(found(0.4), [(sits, 0, 40)]);
        let walked = found(1.5);
        assert_eq!(walked.len(), 3, "{walked:?}");
        assert_eq!(walked[1].0, Activity::Walks);
    }

    /// What may be the beginning of a walk, at the end of a window, is one only if the person did not stay before.
    #[test]
    fn the_end_of_a_window_alone_shows_no_walk() {
        let at = |t: f64| Some([3.0 + 0.5 * (t as f32 - 4.0).max(0.0), -0.4, 0.0]);
        let site = Site::unlearned("board", 1.5);
        let walks = |before: Before| {
            let states = measure(&frames(6.1, at), &site, before).unwrap();
            states.iter().any(|s| s.activity == Activity::Walks)
        };
        assert!(!walks(window(Some(Posture::Sitting))));
        assert!(walks(window(None)));
    }

    /// Who takes the chair along sits at two places; who leans forward for a moment at one.
    #[test]
    fn a_window_is_seen_in_the_light_of_the_time_before() {
        let mut site = Site::unlearned("board", 1.5);
        (site.error.tilt_rad, site.error.standing_m) = (0.01, 0.02);
        // Sits down at 20 s; at 38 s the height drifts up for some seconds, as far as that of somebody who stands.
        let at = |t: f64| match t {
            t if t < 15.0 => Some([5.0 - 0.2 * t as f32, 0.15, 0.0]),
            t if t < 38.0 => Some([2.0, -0.35, 0.0]),
            t => Some([2.0, -0.35 + (0.04 * (t - 38.0) as f32).min(0.2), 0.0]),
        };
        let all = frames(44.0, at);
        let of = |earlier: &[PointFrame], part: &[PointFrame]| {
            let before = Before::Window {
                earlier,
                posture: None,
            };
            let states = measure(part, &site, before).unwrap();
            let row = |s: &State| (s.activity, s.start_s, s.distances_m()[0]);
            states.iter().map(row).collect::<Vec<_>>()
        };
        let sits = Activity::Stays(Posture::Sitting);
        assert_eq!(of(&all[..380], &all[380..]), [(sits, 38.0, 2.0)]);
        // The walk is before the window, but for its end.
        let [(Activity::Walks, 13.0, from_m), (activity, ..)] = of(&all[..130], &all[130..190])[..]
        else {
            panic!("{:?}", of(&all[..130], &all[130..190]))
        };
        assert_eq!(activity, sits);
        assert!((from_m - 2.4).abs() < 0.05, "{from_m}");
        // Less than a second of it is nothing of its own.
        let late = of(&all[..148], &all[148..208]);
        assert_eq!(late, [(sits, 14.8, 2.0)]);
        assert_eq!(of(&all[..200], &all[200..260]), [(sits, 20.0, 2.0)]);
    }

    #[test]
    fn somebody_who_stays_at_another_place_has_a_state_there() {
        let places = |from_m: f32, to_m: f32, back_s: f64| {
            let at = |t: f64| {
                let share = ((t as f32 - 20.0) / 1.0).clamp(0.0, 1.0);
                let y_m = match t > back_s {
                    true => from_m,
                    false => from_m + (to_m - from_m) * share,
                };
                Some([y_m, -0.4, 0.0])
            };
            let site = Site::unlearned("board", 1.5);
            let states = measure(&frames(60.0, at), &site, Before::Nothing).unwrap();
            let sits = states.iter();
            let sits = sits.filter(|s| matches!(s.activity, Activity::Stays(Posture::Sitting)));
            sits.map(|s| (s.start_s.round() as i32, s.distances_m()[1]))
                .collect::<Vec<(i32, f32)>>()
        };
        let moved = places(2.0, 2.9, 99.0);
        let [(0, first_m), (then_s, second_m)] = moved[..] else {
            panic!("{moved:?}")
        };
        assert!(
            (first_m - 2.0).abs() < 0.01 && (second_m - 2.9).abs() < 0.01,
            "{moved:?}"
        );
        assert!((18..24).contains(&then_s), "{moved:?}");
        assert_eq!(places(2.0, 2.3, 99.0).len(), 1);
        let leans = places(2.0, 2.5, 22.0);
        assert!(
            leans.len() == 1 && (leans[0].1 - 2.0).abs() < 0.05,
            "{leans:?}"
        );
    }

    /// Where height and tilt of the radar are only stated, a posture is stated where it is clear.
    #[test]
    fn a_site_that_is_not_known_gives_clear_postures_only() {
        let found = |below_m: f32, site: Site| {
            let at = |_: f64| Some([4.0, site.standing_m - below_m, 0.0]);
            let states = measure(&frames(20.0, at), &site, Before::Nothing).unwrap();
            states[0].activity
        };
        let unlearned = || Site::unlearned("board", 1.5);
        let learned = || Site {
            walking_s: 300.0,
            error: crate::SiteDeviation {
                tilt_rad: 0.005,
                standing_m: 0.02,
                distance_m: 2.5,
            },
            ..unlearned()
        };
        // A radar whose height nobody states may be half a metre higher or lower.
        let assumed = || Site::assumed("board", 1.5);
        assert_eq!(found(0.5, assumed()), Activity::StaysSomehow);
        assert_eq!(found(2.0, assumed()), Activity::Stays(Posture::Lying));
        assert_eq!(found(0.7, unlearned()), Activity::Stays(Posture::Sitting));
        assert_eq!(found(0.25, unlearned()), Activity::StaysSomehow);
        assert_eq!(found(0.25, learned()), Activity::Stays(Posture::Sitting));
        assert_eq!(found(1.15, unlearned()), Activity::StaysSomehow);
        assert_eq!(found(1.15, learned()), Activity::Stays(Posture::Lying));
    }

    /// The height of somebody who keeps still drifts across the limit of a posture; who sits down or gets up is half a metre
    /// lower or higher at once.
    #[test]
    fn a_posture_changes_with_a_step_of_the_height() {
        let site = Site {
            walking_s: 300.0,
            error: crate::SiteDeviation {
                tilt_rad: 0.005,
                standing_m: 0.02,
                distance_m: 2.5,
            },
            ..Site::unlearned("board", 1.5)
        };
        let found = |below_m: &dyn Fn(f32) -> f32, seconds: f64, before: Before| {
            let at = |t: f64| Some([2.0, site.standing_m - below_m(t as f32), 0.0]);
            let states = measure(&frames(seconds, at), &site, before).unwrap();
            let row = |s: &State| (s.activity, s.start_s.round() as i32, s.end_s.round() as i32);
            states.iter().map(row).collect::<Vec<_>>()
        };
        let [stands, sits] = [Posture::Standing, Posture::Sitting].map(Activity::Stays);
        let drifts = |t: f32| 0.05 + 0.2 * (t / 10.0).sin().max(0.0);
        assert_eq!(found(&drifts, 60.0, Before::Nothing), [(stands, 0, 60)]);
        let sits_down = |t: f32| if t < 30.0 { 0.0 } else { 0.45 };
        let changed = found(&sits_down, 60.0, Before::Nothing);
        let [(a, 0, then_s), (b, _, 60)] = changed[..] else {
            panic!("{changed:?}")
        };
        assert_eq!((a, b), (stands, sits));
        assert!((28..=32).contains(&then_s), "{changed:?}");
        // A window of a running radar goes on with what was known, states nothing that is not clear, and shows a change.
        let doubtful = |_: f32| 0.2;
        let before = window;
        let [standing, sitting] = [Posture::Standing, Posture::Sitting].map(Some);
        assert_eq!(found(&doubtful, 6.0, before(standing)), [(stands, 0, 6)]);
        assert_eq!(found(&doubtful, 6.0, before(sitting)), [(sits, 0, 6)]);
        let unsure = found(&doubtful, 6.0, before(None));
        assert_eq!(unsure, [(Activity::StaysSomehow, 0, 6)]);
        assert_eq!(found(&|_| 0.5, 6.0, before(None)), [(sits, 0, 6)]);
        let gets_up = |t: f32| if t < 2.0 { 0.5 } else { 0.0 };
        let changed = found(&gets_up, 6.0, before(sitting));
        let [(a, 0, _), (b, _, 6)] = changed[..] else {
            panic!("{changed:?}")
        };
        assert_eq!((a, b), (sits, stands));
        // What was known wrongly is given up where the height is certain.
        assert_eq!(
            found(&|_| 0.9, 6.0, before(standing)).last().unwrap().0,
            sits
        );
        // A part of a recording goes on with the posture of the same track.
        let known = [(3, Posture::Standing)];
        let part = |known| found(&doubtful, 6.0, Before::Part(known));
        assert_eq!(part(&known), [(stands, 0, 6)]);
        assert_eq!(part(&[(2, Posture::Standing)]), [(sits, 0, 6)]);
    }

    /// A track that sinks by itself is no fall: the points of the person stay up.
    #[test]
    fn a_fall_brings_the_points_down() {
        let falls = |points_m: f32, per_frame: usize| {
            let mut frames = frames(14.0, |t| {
                let share = ((t as f32 - 8.0) / 0.8).clamp(0.0, 1.0);
                let speed_mps = if share > 0.0 && share < 1.0 {
                    -1.7
                } else {
                    0.0
                };
                Some([2.5, 0.1 - 1.3 * share, speed_mps])
            });
            for frame in &mut frames {
                let point = radarllm_base::RadarPoint {
                    y_m: 2.4,
                    z_m: points_m,
                    range_m: 2.4,
                    ..Default::default()
                };
                frame.points = vec![point; per_frame];
            }
            let states = measure(&frames, &Site::unlearned("board", 1.5), Before::Nothing).unwrap();
            states.iter().any(|s| s.activity == Activity::Falls)
        };
        assert!(!falls(-0.2, 4));
        assert!(falls(-1.0, 4));
        // Without points, the track decides.
        assert!(falls(-0.2, 0));
    }

    #[test]
    fn nobody_is_no_state_and_a_plane_has_no_posture() {
        assert_eq!(activities(|_| None, 60.0), []);
        let mut flat = frames(10.0, |_| Some([2.0, 0.0, 0.0]));
        for track in flat
            .iter_mut()
            .flat_map(|f| &mut f.board)
            .flat_map(|b| &mut b.tracks)
        {
            track.height_m = None;
        }
        let states = measure(&flat, &Site::unlearned("board", 1.0), Before::Nothing).unwrap();
        assert_eq!(states.len(), 1);
        assert_eq!(states[0].activity, Activity::StaysSomehow);
        assert_eq!(
            measure(
                &[PointFrame::default()],
                &Site::unlearned("board", 1.0),
                Before::Nothing
            ),
            None
        );
    }
}
