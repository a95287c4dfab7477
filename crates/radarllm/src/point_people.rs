//! People before a board that sends points alone: tracked by this program, with the heights of their points.
//!
//! Boards that track people put the track into the middle of the points, so that the middle of the points of somebody is as
//! high as the track of such a board, and says posture as it does.

use radarllm_base::{PointFrame, RadarPoint, stats::quantile_nearest};
use radarllm_measure::{
    Activity, Before, Site, SiteError, SiteLearner, State, TrackedPerson,
    people::{MIN_TRACKED_S, Sample, Tracker},
    states::states_of,
};
use radarllm_tracking::{Track, TrackFrame, TrackOptions, track};

use crate::gaps::follows;

/// Time before and after a moment whose points show a height, s, and the points that it needs.
const AROUND_S: f64 = 1.0;
const MIN_POINTS: usize = 4;
/// Who keeps still is seen no more, and is still there when somebody is seen again within this time, s, and within this
/// distance, m: who leaves or comes is seen walking.
pub(crate) const STILL_THERE_S: f64 = 60.0;
const STILL_THERE_M: f32 = 1.0;
/// Who hardly moves has too few points for a track, and is seen where the track was lost while points are there again and again,
/// s and m.
const STILL_SEEN_S: f64 = 10.0;
const BODY_M: f32 = 0.75;

/// Tracks of the points of frames. Nobody is followed through a time without frames.
pub(crate) struct PointTracks<'a> {
    frames: &'a [PointFrame],
    /// Frames without a gap, and their tracks.
    runs: Vec<(&'a [PointFrame], Vec<Track>)>,
}

impl<'a> PointTracks<'a> {
    /// Tracks the points of frames.
    pub(crate) fn of(frames: &'a [PointFrame]) -> Self {
        let runs = frames.chunk_by(follows);
        Self {
            frames,
            runs: runs.map(|run| (run, tracks_of(run))).collect(),
        }
    }

    /// The people of the tracks, who are still there where a track was lost. Heights are corrected by the site.
    pub(crate) fn people(&self, site: Option<&Site>) -> Vec<TrackedPerson> {
        let runs = self.runs.iter();
        runs.flat_map(|(frames, tracks)| still_there(frames, persons(frames, tracks, site), site))
            .collect()
    }

    /// The people of the tracks while these last.
    fn moving_people(&self) -> Vec<TrackedPerson> {
        let runs = self.runs.iter();
        runs.flat_map(|(frames, tracks)| persons(frames, tracks, None))
            .collect()
    }

    /// Where people walk, in order of time.
    pub(crate) fn walks(&self) -> Vec<State> {
        let people = self.moving_people();
        let people = people.iter().filter(|p| p.length_s() >= MIN_TRACKED_S);
        let mut states: Vec<State> = people.flat_map(|p| walks_of(self.frames, p)).collect();
        states.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
        states
    }

    /// Learns a site from the people while they walk: tracks of points jump between parts of a body, too.
    ///
    /// # Errors
    /// [`SiteError`]: no heights, or nobody walked for long enough.
    pub(crate) fn learn_site(&self, radar: &str) -> Result<Site, SiteError> {
        let mut learner = SiteLearner::default();
        learner.add_people(&self.walking());
        learner.site(radar)
    }

    fn walking(&self) -> Vec<TrackedPerson> {
        let mut people = self.moving_people();
        for person in &mut people {
            let goes = goes_of(person);
            let is_on_the_way = |s: &Sample| goes.iter().any(|go| (go[0]..=go[1]).contains(&s.t_s));
            person.samples.retain(is_on_the_way);
        }
        people.retain(|person| !person.samples.is_empty());
        people
    }
}

/// Times in which somebody goes farther than a lunge reaches.
fn goes_of(person: &TrackedPerson) -> Vec<[f64; 2]> {
    const WAY_S: f64 = 3.0;
    const WAY_M: f32 = 1.2;
    let way_m = |from_s: f64| {
        let samples = person.between(from_s, from_s + WAY_S);
        let (first, last) = (samples.first()?, samples.last()?);
        let [dx_m, dy_m] = [0, 1].map(|axis| first.place_m[axis] - last.place_m[axis]);
        Some(dx_m.hypot(dy_m))
    };
    let mut goes: Vec<[f64; 2]> = Vec::new();
    let mut from_s = person.start_s();
    while from_s < person.end_s() {
        if way_m(from_s).is_some_and(|way_m| way_m >= WAY_M) {
            match goes.last_mut() {
                Some(last) if last[1] >= from_s => last[1] = from_s + WAY_S,
                _ => goes.push([from_s, from_s + WAY_S]),
            }
        }
        from_s += 0.5;
    }
    goes
}

/// How people are tracked in frames.
pub(crate) fn track_options(frames: &[PointFrame]) -> TrackOptions {
    let mut options = TrackOptions::default();
    if !frames
        .iter()
        .flat_map(|f| &f.points)
        .any(|p| p.velocity_mps != 0.0)
    {
        // Speeds are not known.
        options.confirm_moving_frames = 0;
    }
    options
}

fn tracks_of(frames: &[PointFrame]) -> Vec<Track> {
    track(frames, &track_options(frames)).unwrap_or_default()
}

fn persons(frames: &[PointFrame], tracks: &[Track], site: Option<&Site>) -> Vec<TrackedPerson> {
    let tracks = tracks.iter();
    tracks.map(|track| person(frames, track, site)).collect()
}

/// Follows people where their tracks were lost, and joins those who were not seen for a time and were seen again at the same
/// place.
fn still_there(
    frames: &[PointFrame],
    mut people: Vec<TrackedPerson>,
    site: Option<&Site>,
) -> Vec<TrackedPerson> {
    for at in 0..people.len() {
        let others = people.iter().enumerate().filter(|(other, _)| *other != at);
        let until_s = others
            .map(|(_, person)| person.start_s())
            .filter(|start_s| *start_s > people[at].end_s())
            .fold(f64::INFINITY, f64::min);
        let seen = still_seen(frames, &people[at], until_s, site);
        people[at].samples.extend(seen);
    }
    let mut joined: Vec<TrackedPerson> = Vec::new();
    for mut next in people {
        let Some(first) = next.samples.first().copied() else {
            continue;
        };
        let is_same = |before: &&mut TrackedPerson| {
            before.samples.last().is_some_and(|last| {
                let [dx_m, dy_m] = [0, 1].map(|axis| last.place_m[axis] - first.place_m[axis]);
                (0.0..=STILL_THERE_S).contains(&(first.t_s - last.t_s))
                    && dx_m.hypot(dy_m) <= STILL_THERE_M
            })
        };
        let latest =
            (joined.iter_mut().filter(is_same)).max_by(|a, b| a.end_s().total_cmp(&b.end_s()));
        match latest {
            Some(before) => before.samples.append(&mut next.samples),
            None => joined.push(next),
        }
    }
    joined
}

/// Gives moments without a height that of the moment before: who is not seen keeps still.
pub(crate) fn hold_heights(person: &mut TrackedPerson) {
    let mut last_m = person.samples.iter().find_map(|sample| sample.height_m);
    for sample in &mut person.samples {
        last_m = sample.height_m.or(last_m);
        sample.height_m = last_m;
    }
}

/// The samples of somebody whose track was lost, until another one begins.
fn still_seen(
    frames: &[PointFrame],
    person: &TrackedPerson,
    until_s: f64,
    site: Option<&Site>,
) -> Vec<Sample> {
    let mut samples: Vec<Sample> = Vec::new();
    let Some(lost) = person.samples.last().copied() else {
        return samples;
    };
    let mut last_s = lost.t_s;
    let has_heights = person.samples.iter().any(|s| s.height_m.is_some());
    let mut heights: Vec<(f64, f32)> = Vec::new();
    let begins = frames.partition_point(|frame| frame.time_s <= lost.t_s);
    for frame in &frames[begins..] {
        if frame.time_s >= until_s || frame.time_s - last_s > STILL_SEEN_S {
            break;
        }
        let is_near = |p: &&RadarPoint| {
            !p.is_leakage() && (p.x_m - lost.place_m[0]).hypot(p.y_m - lost.place_m[1]) <= BODY_M
        };
        let near: Vec<&RadarPoint> = frame.points.iter().filter(is_near).collect();
        if near.is_empty() {
            continue;
        }
        last_s = frame.time_s;
        if has_heights {
            heights.extend(near.iter().map(|p| (frame.time_s, level(site, p))));
        }
        samples.push(Sample {
            t_s: frame.time_s,
            height_m: height_around(&heights, frame.time_s),
            ..lost
        });
    }
    samples
}

/// Height of a point above the radar, m.
fn level(site: Option<&Site>, point: &RadarPoint) -> f32 {
    site.map_or(point.z_m, |site| site.level([point.y_m, point.z_m])[1])
}

/// The middle of the heights around a time, m, which are in order of time.
fn height_around(heights: &[(f64, f32)], t_s: f64) -> Option<f32> {
    let first = heights.partition_point(|(at_s, _)| *at_s < t_s - AROUND_S);
    let last = heights.partition_point(|(at_s, _)| *at_s <= t_s + AROUND_S);
    let around = &heights[first..last.max(first)];
    match around.len() >= MIN_POINTS {
        true => quantile_nearest(around.iter().map(|(_, z_m)| *z_m), 0.5),
        false => None,
    }
}

fn person(frames: &[PointFrame], track: &Track, site: Option<&Site>) -> TrackedPerson {
    let mut points: Vec<(f64, &RadarPoint)> = Vec::new();
    for at in &track.frames {
        let frame = &frames[at.frame];
        let of_frame = (at.points.iter()).filter_map(|i| frame.points.get(*i as usize));
        points.extend(of_frame.map(|p| (frame.time_s, p)));
    }
    // If all are zero, heights are not measured; the tilt of the site must not make some of them. Single zeros are measured: the
    // elevations of some boards are a few steps, one of which is zero.
    if points.iter().all(|(_, p)| p.z_m == 0.0) {
        points.clear();
    }
    let heights = points.into_iter().map(|(t_s, p)| (t_s, level(site, p)));
    let heights: Vec<(f64, f32)> = heights.collect();
    let height_m = |t_s: f64| height_around(&heights, t_s);
    let sample = |at: &TrackFrame| {
        let t_s = frames[at.frame].time_s;
        Sample {
            t_s,
            place_m: at.place_m.map(|v| v as f32),
            height_m: height_m(t_s),
            upward_mps: None,
        }
    };
    TrackedPerson {
        tracker: Tracker::Points,
        track: track.id,
        samples: track.frames.iter().map(sample).collect(),
    }
}

/// The walks of somebody who is tracked by points.
fn walks_of(frames: &[PointFrame], person: &TrackedPerson) -> Vec<State> {
    // Who walks does so whatever the height of the radar is.
    let site = Site::assumed("", 1.0);
    let may_fold = speeds_may_fold(frames);
    let mut states = states_of(person, &site, &[], Before::Nothing);
    states.retain(|s| {
        s.activity == Activity::Walks
            && (may_fold || is_as_fast(frames, person, s))
            && !sinks(frames, person, s)
    });
    states
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

/// Learns a site from people who walk before it, whom the board tracks or the points show.
///
/// # Errors
/// [`SiteError`]: no heights, or nobody walked for long enough.
pub fn learn_site(radar: &str, frames: &[PointFrame]) -> Result<Site, SiteError> {
    let mut learner = SiteLearner::default();
    learn_from(&mut learner, frames);
    learner.site(radar)
}

/// Adds frames to what is learned of a site.
pub fn learn_from(learner: &mut SiteLearner, frames: &[PointFrame]) {
    match frames.iter().all(|frame| frame.board.is_none()) {
        true => learner.add_people(&PointTracks::of(frames).walking()),
        false => learner.add(frames),
    }
}

#[cfg(test)]
mod tests {
    use radarllm_measure::{Posture, sentence};

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
        let frames: Vec<PointFrame> = (0..100).map(frame).collect();
        let found = PointTracks::of(&frames).walks();
        let [walk] = &found[..] else {
            panic!("{found:?}")
        };
        let caption = sentence(walk);
        assert!(caption.starts_with("a person walks away from the radar"));
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
            turns: 0,
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
                turns: 0,
            };
            sinks(&frames, &person, &walk)
        };
        assert!(sinks_by(1.0, 1.0));
        assert!(!sinks_by(1.0, 0.2));
        assert!(!sinks_by(2.0, 1.0));
    }

    /// Somebody is tracked for two seconds and then seen without a track, before a radar that is tilted. Where all heights are
    /// zero, none is measured; where some are, the zeros are measured, too.
    #[test]
    fn heights_that_are_all_zero_are_not_measured() {
        let site = Site {
            tilt_rad: 0.2,
            ..Site::unlearned("board", 1.5)
        };
        let place_m = [0.0, 3.0];
        let seen = |z_m: [f32; 9]| -> TrackedPerson {
            let point = |z_m: f32| RadarPoint {
                x_m: place_m[0],
                y_m: place_m[1],
                z_m,
                range_m: place_m[1],
                velocity_mps: 0.3,
                intensity_db: 15.0,
            };
            let frame = |i: u32| PointFrame {
                frame: i,
                time_s: f64::from(i) / 10.0,
                points: z_m.map(point).to_vec(),
                board: None,
            };
            let frames: Vec<PointFrame> = (0..40).map(frame).collect();
            let at = |frame: usize| TrackFrame {
                frame,
                place_m: place_m.map(f64::from),
                velocity_mps: [0.0; 2],
                points: (0..9).collect(),
                is_shared: false,
            };
            let track = Track {
                id: 1,
                frames: (0..20).map(at).collect(),
            };
            let mut person = person(&frames, &track, Some(&site));
            let lost = still_seen(&frames, &person, f64::INFINITY, Some(&site));
            person.samples.extend(lost);
            assert_eq!(person.samples.len(), 40);
            person
        };
        let unknown = seen([0.0; 9]);
        assert!(unknown.samples.iter().all(|s| s.height_m.is_none()));

        let in_steps = seen([-0.5, -0.5, -0.5, 0.0, 0.0, 0.0, 0.5, 0.5, 0.5]);
        // Zero, turned by 0.2 rad 3 m away. The first frame without a track has too few points around it.
        let expected_m = 3.0 * 0.2_f32.sin();
        for sample in in_steps.samples.iter().filter(|s| s.t_s != 2.0) {
            let height_m = sample.height_m.unwrap();
            assert!((height_m - expected_m).abs() < 1e-3, "{sample:?}");
        }
    }

    /// Somebody walks to and fro, keeps still for half a minute as an upright person or 0.5 m lower, with a point now and then, and
    /// moves again at the same place.
    #[test]
    fn who_keeps_still_has_the_height_of_the_points() {
        let body = |t_s: f32, at_m: f32, low_m: f32, speed_mps: f32| -> Vec<RadarPoint> {
            let part = |k: u16| {
                let [x_m, dy_m] = [f32::from(k % 3), f32::from(k / 3)].map(|v| 0.1 * v - 0.1);
                RadarPoint {
                    x_m,
                    y_m: at_m + dy_m,
                    z_m: 0.1 * f32::from(k) - 0.1 - low_m,
                    range_m: at_m + dy_m,
                    velocity_mps: speed_mps + 0.2 * (9.0 * t_s + f32::from(k)).sin(),
                    intensity_db: 15.0,
                }
            };
            (0..9).map(part).collect()
        };
        let frames = |low_m: f32| -> Vec<PointFrame> {
            let frame = |i: u32| {
                let t_s = i as f32 / 10.0;
                let phase = (t_s * 0.8).rem_euclid(6.0);
                let (way_m, speed_mps) = match phase < 3.0 {
                    true => (phase, 0.8),
                    false => (6.0 - phase, -0.8),
                };
                let still_m = 2.0;
                let points = match t_s {
                    t if t < 60.0 => body(t_s, 2.0 + way_m, 0.0, speed_mps),
                    t if t < 65.0 => body(t_s, still_m, low_m, 0.0),
                    t if t < 95.0 && i.is_multiple_of(40) => {
                        body(t_s, still_m, low_m, 0.0)[..5].to_vec()
                    }
                    t if t < 95.0 => Vec::new(),
                    _ => body(t_s, still_m, low_m, 0.0),
                };
                PointFrame {
                    frame: i,
                    time_s: f64::from(i) / 10.0,
                    points,
                    board: None,
                }
            };
            (0..1000).map(frame).collect()
        };
        for (low_m, posture) in [(0.0, Posture::Standing), (0.5, Posture::Sitting)] {
            let frames = frames(low_m);
            let tracks = PointTracks::of(&frames);
            let site = tracks.learn_site("board").unwrap();
            assert!((site.standing_m - 0.3).abs() < 0.1, "{site:?}");
            let mut people = tracks.people(Some(&site));
            people.iter_mut().for_each(hold_heights);
            let states: Vec<State> = (people.iter())
                .flat_map(|person| states_of(person, &site, &[], Before::Nothing))
                .collect();
            let stays = |s: &&State| s.activity == Activity::Stays(posture) && s.end_s > 70.0;
            let stay_s: f64 = states
                .iter()
                .filter(stays)
                .map(|s| s.end_s - s.start_s)
                .sum();
            assert!(stay_s > 34.0, "{posture:?}: {states:?}");
        }
        // Where nobody walks, no site is learned.
        let still: Vec<PointFrame> = frames(0.0).split_off(600);
        assert!(PointTracks::of(&still).learn_site("board").is_err());
    }
}
