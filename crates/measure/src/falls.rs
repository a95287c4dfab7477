//! Falls: fast downward, and low afterwards.
//!
//! Where the board tracks heights, a fall is a downward speed that sitting down does not reach, after which the track is
//! lower than that of anybody who sits. Where it does not, the heights of the points stand for it: the middle of all points
//! of a second falls by more than a seat is deep. Where heights show nothing and the board reports static points, too, a fall
//! below the beam shows: somebody moves at one place, and at once nothing reflects there any more, neither moving nor static.

use radarllm_base::{PointFrame, RadarPoint, stats::quantile_nearest};

use crate::{
    Site,
    people::{Sample, TrackedPerson},
};

/// Downward speed of a fall, m/s, as the mean over a time, s. Who sits down or lies down stays below 0.9 m/s.
const FALLING_MPS: f32 = 0.9;
const SPEED_S: f64 = 0.3;
/// Height below a standing person after a fall, m, and the time in which it is reached, s.
const FALLEN_M: f32 = 1.0;
const LANDING_S: f64 = 1.0;
/// Height below a standing person, m, of somebody who was up before a fall, and the time before it, s. Who lies already does
/// not fall.
const UP_M: f32 = 0.8;
const BEFORE_S: f64 = 1.5;
/// Where nobody knows the height of the radar: the time before a fall in which the person stood, s, the share of the heights
/// that are lower, and how far the middle of the points of a person who is up lies below the track or a standing person, m.
const OWN_HEIGHT_S: f64 = 10.0;
const OWN_HEIGHT: f32 = 0.9;
const MIDDLE_BELOW_M: f32 = 0.25;
/// Nearer than this, m, the board sees a part of a body only, and no fall is stated: the track of somebody who reaches for
/// the board, or walks past below it, sinks.
pub const MIN_DISTANCE_M: f32 = 0.7;
/// Distance from a fall within which the points of who fell are, m.
pub const NEAR_FALL_M: f32 = 1.2;
/// Two falls of one person are at least this far apart, s.
const APART_S: f64 = 3.0;

/// Points of a second before and after, with time between them, s; the fall of their middle, m; points needed in each.
const POOL_S: f64 = 1.0;
const POOL_GAP_S: f64 = 0.3;
const POOL_FALL_M: f32 = 0.7;
/// They are at least as many as the frames: what fewer points show is chance.
const POOL_POINTS: usize = 4;
/// Share of the points that must be left afterwards: what lies on the floor reflects (three tenths or more of the points in
/// the falls of the IWRL6432AOP), and who stops leaves noise where static points are removed (one or two hundredths).
const POOL_LEFT: f32 = 0.1;
/// Part of the fall below which the middle of the points is up again a second later.
const POOL_RISEN: f32 = 0.4;
/// How far the middle of the points may go meanwhile, m: farther away is another person, or an echo.
const POOL_SHIFT_M: f32 = 1.0;
/// How far the middle half of the points may be spread afterwards on the floor and in height, m: at most 1.95 m and 2.0 m after
/// the falls of the IWRL6432AOP. The few points that are left of somebody who stops are noise from everywhere.
const POOL_SPREAD_M: [f32; 2] = [2.0, 2.2];

/// Time of the movement before somebody drops out of view, and of the absence afterwards, s; how long nobody may be back, s.
const MOVING_S: f64 = 1.0;
const ABSENT_S: f64 = 0.8;
const NOT_BACK_S: f64 = 2.0;
/// Moments that are looked at are so far apart, s.
const VIEW_STEP_S: f64 = 0.1;
/// How far the points of one place are apart, m, and how many must move there.
const VIEW_NEAR_M: f32 = 0.6;
const VIEW_POINTS: usize = 10;
/// Points weaker than those of the person by this, dB, are echoes of the room. The strength of a person is that of the upper
/// tenth of the points.
const VIEW_WEAKER_DB: f32 = 6.0;
const VIEW_STRENGTH: f32 = 0.9;
/// Share of the moving points that may be left at the place, or as strong elsewhere.
const VIEW_LEFT: f32 = 0.15;
/// How far the place may be from that of a second before, m: who is farther walks out of view.
const VIEW_SHIFT_M: f32 = 0.5;
/// Share of the frames in which static points are reported while the person is not seen: somebody who keeps still would be
/// among them.
const VIEW_STATIC: f32 = 0.5;
/// How sure such a fall is at most: one board showed falls this way, of one person.
const VIEW_PROBABILITY: f32 = 0.9;
/// Shorter recordings are whole events, s; in longer ones the time before a fall must be known.
pub(crate) const EVENT_S: f64 = 5.0;

/// A fall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fall {
    /// When the person was falling, s.
    pub t_s: f64,
    /// Where, m: right of the radar, away from the radar.
    pub place_m: [f32; 2],
    /// How sure it is, 0..=1.
    pub probability: f32,
}

/// How sure a value beyond a limit is: of the falls that two boards show at the limits, about seven of ten are falls, and
/// nearly all of those that are half beyond them.
fn beyond(value: f32, limit: f32) -> f32 {
    (0.7 + 0.56 * (value / limit - 1.0)).clamp(0.0, 0.98)
}

/// Height above the radar, m, at which a person stood before a time: that of the site, or the upper end of the heights of the
/// last seconds where the height of the radar is assumed.
fn standing_m(person: &TrackedPerson, t_s: f64, site: &Site) -> Option<f32> {
    /// The upper end may be that of a track that jumped up for a moment: from a time on, s, it is limited to this far above
    /// the median, m, which is the way from a seat.
    const LONG_S: f64 = 2.5;
    const FROM_SEAT_M: f32 = 0.3;
    if !site.is_height_assumed {
        return Some(site.standing_m);
    }
    let before = person.between(t_s - OWN_HEIGHT_S, t_s);
    // A window of a longer recording may begin with the jump.
    let is_cut = before.first().is_none_or(|first| t_s - first.t_s < LONG_S);
    if is_cut && person.length_s() >= EVENT_S {
        return None;
    }
    let height_m = |share| quantile_nearest(before.iter().filter_map(|s| s.height_m), share);
    let upper_m = height_m(OWN_HEIGHT)?;
    match is_cut {
        true => Some(upper_m),
        false => Some(upper_m.min(height_m(0.5)? + FROM_SEAT_M)),
    }
}

/// The falls of a person whom the board tracks in height.
pub fn falls_of(person: &TrackedPerson, site: &Site) -> Vec<Fall> {
    let mut falls: Vec<Fall> = Vec::new();
    for at in &person.samples {
        let recent = person.between(at.t_s - SPEED_S + 1e-6, at.t_s);
        let speeds: Vec<f32> = recent.iter().filter_map(|s| s.upward_mps).collect();
        if speeds.is_empty() {
            continue;
        }
        let down_mps = -speeds.iter().sum::<f32>() / speeds.len() as f32;
        if down_mps < FALLING_MPS {
            continue;
        }
        let before = person.between(at.t_s - BEFORE_S, at.t_s).iter();
        let highest_m = before.filter_map(|s| s.height_m).fold(f32::MIN, f32::max);
        let Some(standing_m) = standing_m(person, at.t_s, site) else {
            continue;
        };
        if standing_m - highest_m > UP_M {
            continue;
        }
        let landing = person.between(at.t_s, at.t_s + LANDING_S);
        let last = &landing[landing.len().saturating_sub(3)..];
        let Some(height_m) = quantile_nearest(last.iter().filter_map(|s| s.height_m), 0.5) else {
            continue;
        };
        let below_m = standing_m - height_m;
        let distance_m = at.place_m[0].hypot(at.place_m[1]);
        if below_m < FALLEN_M
            || distance_m < MIN_DISTANCE_M
            || has_risen(person, at.t_s, standing_m)
        {
            continue;
        }
        push(
            &mut falls,
            Fall {
                t_s: at.t_s,
                place_m: at.place_m,
                probability: beyond(down_mps, FALLING_MPS).min(beyond(below_m, FALLEN_M)),
            },
        );
    }
    falls
}

/// Whether a person is up again in one of the two seconds after the landing: then the track went down alone, or the person
/// crouched.
fn has_risen(person: &TrackedPerson, t_s: f64, standing_m: f32) -> bool {
    /// Part of the height of a fall below which somebody has risen.
    const RISEN: f32 = 0.8;
    let is_up = |from_s: f64| {
        let after = person.between(from_s, from_s + LANDING_S);
        let height = quantile_nearest(after.iter().filter_map(|s| s.height_m), 0.5);
        after.len() >= 5 && height.is_some_and(|z_m| standing_m - z_m < RISEN * FALLEN_M)
    };
    is_up(t_s + LANDING_S) || is_up(t_s + 2.0 * LANDING_S)
}

/// Whether a person walks after a time: who has fallen does not go on.
pub(crate) fn walks_on(person: &TrackedPerson, fall: &Fall) -> bool {
    /// From one to three seconds after the fall, m.
    const WALKS_M: f32 = 0.6;
    let after = person.between(fall.t_s + 1.0, fall.t_s + 3.0);
    after.first().zip(after.last()).is_some_and(|(a, b)| {
        (a.place_m[0] - b.place_m[0]).hypot(a.place_m[1] - b.place_m[1]) >= WALKS_M
    })
}

/// A fall as the points of the person show it: none if they stay at the height of a person who is up, because then the
/// track sank alone; surer if they are down. Who lies has half of the points within 0.8 m of the floor, who walks above
/// 1.4 m (docs/results/boards.md).
pub(crate) fn confirmed(
    frames: &[PointFrame],
    person: &TrackedPerson,
    fall: Fall,
    site: &Site,
) -> Option<Fall> {
    /// Height of the middle of the points below a standing person, m, from which on the person lies.
    const LIES_M: f32 = 0.55;
    /// When the points are looked at, s after the fall, and how near they are, m.
    const AFTER_S: [f64; 2] = [0.5, 2.0];
    const NEAR_M: f32 = 1.0;
    /// Fewer points say nothing: some boards report none of who keeps still.
    const MIN_POINTS: usize = 10;
    /// Part of the doubt that points which are down leave: of the falls of the IWRL6432 that are stated, all are falls.
    const DOUBT: f32 = 0.3;
    let is_flat = person.samples.iter().all(|s| s.height_m.is_none());
    let heights = |from_s, to_s| heights_of_points(frames, from_s, to_s);
    if is_flat && is_as_high_afterwards(&fall, &SECONDS_AROUND, heights) {
        return None;
    }
    let [from_s, to_s] = AFTER_S.map(|s| fall.t_s + s);
    let heights_m: Vec<f32> = points_between(frames, from_s, to_s)
        .filter_map(|point| {
            let [y_m, z_m] = site.level([point.y_m, point.z_m]);
            let apart_m = (point.x_m - fall.place_m[0]).hypot(y_m - fall.place_m[1]);
            (apart_m < NEAR_M).then_some(z_m)
        })
        .collect();
    if heights_m.len() < MIN_POINTS {
        // Where nothing else has a height, the few points were the only witness.
        return (!is_flat || !site.is_height_assumed).then_some(fall);
    }
    let middle_m = quantile_nearest(heights_m, 0.5)?;
    // Points that are there, but were too few before, confirm nothing.
    let standing_m =
        standing_m(person, fall.t_s, site).or_else(|| standing_by_points_m(frames, fall.t_s))?;
    (standing_m - middle_m >= LIES_M).then_some(Fall {
        probability: 1.0 - DOUBT * (1.0 - fall.probability),
        ..fall
    })
}

/// Times before and after a fall, s, and the share of them in which the person has to be seen.
pub struct Around {
    before_s: [f64; 2],
    after_s: [f64; 2],
    seen: f64,
}

/// Seconds: the points of somebody who stands are those of the legs for a moment.
pub const SECONDS_AROUND: Around = Around {
    before_s: [-4.0, -1.0],
    after_s: [1.5, 4.5],
    seen: 0.7,
};
/// For as long as a running radar waits before it confirms a fall: who keeps still is seen now and then.
pub const DWELL_AROUND: Around = Around {
    before_s: [-20.0, -1.0],
    after_s: [1.5, 20.0],
    seen: 0.1,
};

/// A height, m, that is seen at a time, s, and at a place on the floor, m.
pub type SeenHeight = (f64, [f32; 2], f32);

/// Whether the heights near a fall are the same after it as before it. `heights` gives those between two times, s, in order of
/// time.
pub fn is_as_high_afterwards<I: Iterator<Item = SeenHeight>>(
    fall: &Fall,
    around: &Around,
    heights: impl Fn(f64, f64) -> I,
) -> bool {
    /// Change of the height below which it is that of before, m.
    const SAME_M: f32 = 0.25;
    let middle_m = |[from_s, to_s]: [f64; 2]| {
        let all = heights(fall.t_s + from_s, fall.t_s + to_s);
        let near = all.filter(|(_, [x_m, y_m], _)| {
            (x_m - fall.place_m[0]).hypot(y_m - fall.place_m[1]) <= NEAR_FALL_M
        });
        let near: Vec<(f64, f32)> = near.map(|(t_s, _, z_m)| (t_s, z_m)).collect();
        let seen_s = near.last()?.0 - near.first()?.0;
        (seen_s >= around.seen * (to_s - from_s))
            .then(|| quantile_nearest(near.iter().map(|(_, z_m)| *z_m), 0.5))?
    };
    let heights_m = middle_m(around.before_s).zip(middle_m(around.after_s));
    heights_m.is_some_and(|(before_m, after_m)| before_m - after_m < SAME_M)
}

/// The heights of the points between two times, s.
fn heights_of_points(
    frames: &[PointFrame],
    from_s: f64,
    to_s: f64,
) -> impl Iterator<Item = SeenHeight> {
    let frames = frames_between(frames, from_s, to_s).iter();
    frames.flat_map(|frame| {
        let points = frame.points.iter().filter(|p| !p.is_leakage());
        points.map(|p| (frame.time_s, [p.x_m, p.y_m], p.z_m))
    })
}

/// Height above the radar, m, of a standing person as the points of the last seconds before a fall show it; `None` if they
/// are few.
fn standing_by_points_m(frames: &[PointFrame], t_s: f64) -> Option<f32> {
    /// Points of fewer say nothing.
    const MIN_POINTS: usize = 10;
    let points = points_between(frames, t_s - OWN_HEIGHT_S, t_s - POOL_GAP_S);
    let heights_m: Vec<f32> = points.map(|point| point.z_m).collect();
    let middle_m = (heights_m.len() >= MIN_POINTS).then(|| quantile_nearest(heights_m, 0.5))??;
    Some(middle_m + MIDDLE_BELOW_M)
}

/// The frames between two times, s. Frames are in order of time.
fn frames_between(frames: &[PointFrame], from_s: f64, to_s: f64) -> &[PointFrame] {
    let first = frames.partition_point(|frame| frame.time_s < from_s);
    let last = frames.partition_point(|frame| frame.time_s <= to_s);
    &frames[first..last.max(first)]
}

/// The points between two times, s, without leakage. Frames are in order of time.
fn points_between(
    frames: &[PointFrame],
    from_s: f64,
    to_s: f64,
) -> impl Iterator<Item = &RadarPoint> {
    let points = frames_between(frames, from_s, to_s)
        .iter()
        .flat_map(|f| &f.points);
    points.filter(|point| !point.is_leakage())
}

/// Adds a fall; of several that are one, the surest stays.
fn push(falls: &mut Vec<Fall>, fall: Fall) {
    match falls.last_mut() {
        Some(last) if fall.t_s - last.t_s < APART_S => {
            if fall.probability > last.probability {
                last.probability = fall.probability;
            }
        }
        _ => falls.push(fall),
    }
}

/// The falls that the points of one person show, for boards that do not track heights.
pub fn falls_of_points(frames: &[PointFrame]) -> Vec<Fall> {
    let pool = |from_s: f64, to_s: f64| -> Vec<RadarPoint> {
        points_between(frames, from_s, to_s).copied().collect()
    };
    let middle = |points: &[RadarPoint], n_frames: usize| {
        (points.len() >= POOL_POINTS.max(n_frames))
            .then(|| quantile_nearest(points.iter().map(|p| p.z_m), 0.5))
            .flatten()
    };
    let mut falls = Vec::new();
    for t_s in frames.iter().map(|f| f.time_s) {
        let before = pool(t_s - POOL_GAP_S - POOL_S, t_s - POOL_GAP_S);
        let after = pool(t_s, t_s + POOL_S);
        let n_frames = frames_between(frames, t_s - POOL_GAP_S - POOL_S, t_s - POOL_GAP_S).len();
        let middles = [&before, &after].map(|points| middle(points, n_frames));
        let [Some(before_m), Some(after_m)] = middles else {
            continue;
        };
        let fallen_m = before_m - after_m;
        // The points may become few within the second before.
        let earlier_s = t_s - POOL_GAP_S - POOL_S;
        let n_earlier = points_between(frames, earlier_s - POOL_S, earlier_s).count();
        let n_before = before.len().max(n_earlier);
        let is_left = after.len() as f32 >= POOL_LEFT * n_before as f32;
        if fallen_m < POOL_FALL_M || !is_left {
            continue;
        }
        // Who moves an arm or a leg on the spot is up again at once.
        let later = pool(t_s + POOL_S, t_s + 2.0 * POOL_S);
        let is_up_again = |later_m: f32| before_m - later_m < POOL_RISEN * POOL_FALL_M;
        if middle(&later, n_frames).is_some_and(is_up_again) {
            continue;
        }
        let place_of = |points: &[RadarPoint]| middle_of(points.iter()).unwrap_or_default();
        let [from_m, place_m] = [place_of(&before), place_of(&after)];
        let shift_m = (from_m[0] - place_m[0]).hypot(from_m[1] - place_m[1]);
        let is_near = place_m[0].hypot(place_m[1]) < MIN_DISTANCE_M;
        let [across_m, upward_m] = spread_m(&after);
        let is_compact = across_m <= POOL_SPREAD_M[0] && upward_m <= POOL_SPREAD_M[1];
        if shift_m > POOL_SHIFT_M || !is_compact || is_near {
            continue;
        }
        push(
            &mut falls,
            Fall {
                t_s,
                place_m,
                probability: beyond(fallen_m, POOL_FALL_M),
            },
        );
    }
    falls
}

/// Whether the points at the place of a fall are down after it, before a radar at a known height, m. Where there are none, they
/// deny nothing.
pub fn ends_low(frames: &[PointFrame], fall: &Fall, site: &Site, radar_height_m: f32) -> bool {
    /// Distance of the points from the place, m.
    const NEAR_M: f32 = 1.2;
    /// Height of their middle above the floor, m.
    const LOW_M: f32 = 0.6;
    let [x_m, y_m] = fall.place_m;
    let near = points_between(frames, fall.t_s, fall.t_s + POOL_S)
        .filter(|p| (p.x_m - x_m).hypot(p.y_m - y_m) < NEAR_M);
    let heights_m = near.map(|p| site.level([p.y_m, p.z_m])[1] + radar_height_m);
    quantile_nearest(heights_m, 0.5).is_none_or(|m| m < LOW_M)
}

/// The falls below the beam of a board that reports static points: for about a second somebody moves at one place, and then
/// nothing is there any more, although static points of the room are still reported. Somebody who stops is still there as a
/// static echo, and somebody who walks away is seen elsewhere, or fades.
///
/// `frames` are all points that the board reports, without a time in which no frame came. Where points have no intensity,
/// nothing at all may be left at the place.
pub fn falls_out_of_view(frames: &[PointFrame]) -> Vec<Fall> {
    let mut falls = Vec::new();
    let (Some(first), Some(last)) = (frames.first(), frames.last()) else {
        return falls;
    };
    let is_event = last.time_s - first.time_s < EVENT_S;
    let mut next_s = first.time_s;
    for frame in frames {
        let t_s = frame.time_s;
        // The moments differ by rounding from multiples of the step.
        if t_s < next_s - 1e-6 {
            continue;
        }
        next_s = t_s + VIEW_STEP_S;
        if t_s + ABSENT_S > last.time_s + 1e-6 {
            break;
        }
        if !is_event && t_s - 2.0 * MOVING_S < first.time_s {
            continue;
        }
        if let Some(fall) = drops_out_of_view(frames, t_s) {
            push(&mut falls, fall);
        }
    }
    falls
}

/// The fall of somebody who drops out of view at a time.
fn drops_out_of_view(frames: &[PointFrame], t_s: f64) -> Option<Fall> {
    /// A frame at the time itself belongs to the absence.
    const BEFORE_S: f64 = 1e-3;
    /// The absence begins at the time: somebody moved at the place until shortly before, s.
    const RECENT_S: f64 = 0.3;
    let moves = |point: &&RadarPoint| point.velocity_mps != 0.0;
    let moving = |from_s: f64, to_s: f64| points_between(frames, from_s, to_s).filter(moves);
    let before: Vec<&RadarPoint> = moving(t_s - MOVING_S, t_s - BEFORE_S).collect();
    if before.len() < VIEW_POINTS {
        return None;
    }
    let mut place_m = middle_of(before.iter().copied())?;
    // What moves elsewhere draws the middle away from the place.
    let mut own = before;
    for _ in 0..3 {
        own.retain(|point| is_at(point, place_m));
        place_m = middle_of(own.iter().copied())?;
    }
    let distance_m = place_m[0].hypot(place_m[1]);
    let mut recent = moving(t_s - RECENT_S, t_s - BEFORE_S);
    let is_recent = recent.any(|point| is_at(point, place_m));
    if own.len() < VIEW_POINTS || distance_m < MIN_DISTANCE_M || !is_recent {
        return None;
    }
    let strength_db = quantile_nearest(own.iter().map(|p| p.intensity_db), VIEW_STRENGTH)?;
    let is_strong = |point: &RadarPoint| point.intensity_db > strength_db - VIEW_WEAKER_DB;
    // As many as may be left in the time of the absence.
    let left = VIEW_LEFT * own.len() as f32 * (ABSENT_S / MOVING_S) as f32;
    let is_few = |n: usize| n as f32 <= left;
    let absent = || points_between(frames, t_s, t_s + ABSENT_S);
    let back = points_between(frames, t_s, t_s + NOT_BACK_S);
    let back_db = back.filter(|p| is_at(p, place_m)).map(|p| p.intensity_db);
    let weaker_db = strength_db - back_db.fold(f32::NEG_INFINITY, f32::max);
    let is_seen = weaker_db < VIEW_WEAKER_DB;
    let n_left = absent().filter(moves).filter(|p| is_at(p, place_m)).count();
    let n_elsewhere = absent().filter(moves).filter(|p| is_strong(p)).count();
    if is_seen || !is_few(n_left) || !is_few(n_elsewhere) || !room_is_seen(frames, t_s) {
        return None;
    }
    let earlier: Vec<&RadarPoint> =
        moving(t_s - 2.0 * MOVING_S, t_s - MOVING_S - BEFORE_S).collect();
    let has_come = earlier.len() >= POOL_POINTS
        && middle_of(earlier.iter().copied()).is_some_and(|earlier_m| {
            (earlier_m[0] - place_m[0]).hypot(earlier_m[1] - place_m[1]) > VIEW_SHIFT_M
        });
    // Who walks out of view becomes fewer points.
    (!has_come && own.len() >= earlier.len()).then(|| Fall {
        t_s,
        place_m,
        probability: beyond(weaker_db, VIEW_WEAKER_DB).min(VIEW_PROBABILITY),
    })
}

/// Whether static points are reported in the frames of an absence.
fn room_is_seen(frames: &[PointFrame], t_s: f64) -> bool {
    let frames = frames_between(frames, t_s, t_s + ABSENT_S);
    let is_static = |point: &RadarPoint| point.velocity_mps == 0.0 && !point.is_leakage();
    let shows = |frame: &&PointFrame| frame.points.iter().any(is_static);
    let n = frames.iter().filter(shows).count();
    n as f32 >= VIEW_STATIC * frames.len() as f32 && n > 0
}

/// The middle of points on the floor, m.
fn middle_of<'a>(points: impl Iterator<Item = &'a RadarPoint> + Clone) -> Option<[f32; 2]> {
    let middle = |axis: fn(&RadarPoint) -> f32| quantile_nearest(points.clone().map(axis), 0.5);
    Some([middle(|p| p.x_m)?, middle(|p| p.y_m)?])
}

fn is_at(point: &RadarPoint, [x_m, y_m]: [f32; 2]) -> bool {
    (point.x_m - x_m).hypot(point.y_m - y_m) < VIEW_NEAR_M
}

/// How far the middle half of points is spread on the floor, and in height, m.
fn spread_m(points: &[RadarPoint]) -> [f32; 2] {
    let along = |axis: fn(&RadarPoint) -> f32| {
        let share = |share| quantile_nearest(points.iter().map(axis), share).unwrap_or_default();
        share(0.75) - share(0.25)
    };
    [along(|p| p.x_m).hypot(along(|p| p.y_m)), along(|p| p.z_m)]
}

/// Whether a sample is in the time of a fall: from a second before to a second after.
pub(crate) fn is_within(fall: &Fall, sample: &Sample) -> bool {
    (sample.t_s - fall.t_s).abs() <= 1.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::people::{tests::frames, tracked_people};

    fn found(at: impl Fn(f64) -> Option<[f32; 3]>) -> Vec<Fall> {
        let people = tracked_people(&frames(20.0, at), None).unwrap();
        falls_of(&people[0], &Site::unlearned("board", 1.5))
    }

    /// Height and speed of somebody who goes from one height to another within a time, from second 8 on.
    fn down(from_m: f32, to_m: f32, seconds: f32) -> impl Fn(f64) -> Option<[f32; 3]> {
        move |t| {
            let share = ((t as f32 - 8.0) / seconds).clamp(0.0, 1.0);
            let is_moving = share > 0.0 && share < 1.0;
            let speed_mps = if is_moving {
                (to_m - from_m) / seconds
            } else {
                0.0
            };
            Some([2.5, from_m + share * (to_m - from_m), speed_mps])
        }
    }

    /// A frame of points 2 m away at a height above the radar, m.
    fn points_at(i: u32, z_m: f32, n: usize) -> PointFrame {
        let point = RadarPoint {
            y_m: 2.0,
            z_m,
            range_m: 2.0,
            ..RadarPoint::default()
        };
        PointFrame {
            frame: i,
            time_s: f64::from(i) / 10.0,
            points: vec![point; n],
            ..PointFrame::default()
        }
    }

    #[test]
    fn a_fall_is_fast_and_ends_low() {
        let falls = found(down(0.1, -1.2, 0.8));
        assert_eq!(falls.len(), 1);
        assert!((8.0..9.0).contains(&falls[0].t_s) && falls[0].probability > 0.5);
        // Sitting down fast, lying down slowly, and a jump of the track that comes back.
        assert_eq!(found(down(0.1, -0.5, 0.5)), []);
        assert_eq!(found(down(0.1, -1.2, 2.5)), []);
        let glitch = |t: f64| match t {
            t if (8.0..9.2).contains(&t) => Some([2.5, -1.2, -2.0]),
            _ => Some([2.5, 0.1, 0.0]),
        };
        assert_eq!(found(glitch), []);
        // Somebody who reaches for the board.
        let near = down(0.1, -1.2, 0.8);
        assert_eq!(found(|t| near(t).map(|[_, z_m, up]| [0.4, z_m, up])), []);
    }

    /// The points of somebody who stands are those of the legs for a second and a half.
    #[test]
    fn points_that_are_as_high_afterwards_show_no_fall() {
        let frames = |down_s: f64| -> Vec<PointFrame> {
            let frame = |i: u32| {
                let time_s = f64::from(i) / 10.0;
                let is_down = (8.0..8.0 + down_s).contains(&time_s);
                points_at(i, if is_down { -1.0 } else { 0.1 }, 5)
            };
            (0..200).map(frame).collect()
        };
        let fall = Fall {
            t_s: 8.0,
            place_m: [0.0, 2.0],
            probability: 0.8,
        };
        let is_as_high = |frames: &[PointFrame]| {
            is_as_high_afterwards(&fall, &SECONDS_AROUND, |from_s, to_s| {
                heights_of_points(frames, from_s, to_s)
            })
        };
        assert!(is_as_high(&frames(1.5)));
        assert!(!is_as_high(&frames(20.0)));
        // Without points afterwards, nothing is known.
        assert!(!is_as_high(&frames(1.5)[..90]));
    }

    #[test]
    fn where_the_height_of_the_radar_is_assumed_a_fall_is_told_by_the_persons_own_height() {
        // The radar is 0.9 m higher or lower than assumed; somebody stands, sits for a while, or is seen too high for a second.
        let site = Site::assumed("board", 1.5);
        let falls = |at: &dyn Fn(f64) -> Option<[f32; 3]>| {
            let people = tracked_people(&frames(20.0, at), None).unwrap();
            falls_of(&people[0], &site).len()
        };
        for off_m in [-0.9, 0.0, 0.9] {
            let stated = |from_m: f32, to_m: f32, seconds: f32| {
                let down = down(from_m + off_m, to_m + off_m, seconds);
                move |t: f64| down(t)
            };
            assert_eq!(falls(&stated(0.1, -1.3, 0.8)), 1);
            assert_eq!(falls(&stated(0.1, -0.5, 0.5)), 0);
            assert_eq!(falls(&stated(0.1, -1.3, 2.5)), 0);
            let jumped = |t: f64| match t {
                t if (8.0..9.0).contains(&t) => Some([2.5, 1.2 + off_m, 0.0]),
                t if (9.0..9.4).contains(&t) => Some([2.5, 0.1 + off_m, -2.0]),
                _ => Some([2.5, 0.1 + off_m, 0.0]),
            };
            assert_eq!(falls(&jumped), 0);
        }
        // The site of a stated height would take the same fall for that of somebody who lies already.
        let low = down(-0.8, -2.2, 0.8);
        let people = tracked_people(&frames(20.0, low), None).unwrap();
        assert_eq!(falls_of(&people[0], &Site::unlearned("board", 1.5)), []);
    }

    #[test]
    fn points_that_stay_up_deny_a_fall_also_where_the_height_of_the_radar_is_assumed() {
        // Tracked in a plane: the points of somebody who walks, of whom a second is seen lower, and of somebody who falls.
        let recording = |after_m: f32| -> Vec<PointFrame> {
            let frame = |i: u32| points_at(i, if i < 80 { 0.9 } else { after_m }, 3);
            (0..120).map(frame).collect()
        };
        let flat = TrackedPerson {
            tracker: crate::people::Tracker::Board,
            track: 1,
            samples: Vec::new(),
        };
        let fall = Fall {
            t_s: 8.0,
            place_m: [0.0, 2.0],
            probability: 0.8,
        };
        let site = Site::assumed("board", 1.0);
        assert_eq!(confirmed(&recording(0.8), &flat, fall, &site), None);
        assert!(confirmed(&recording(0.0), &flat, fall, &site).is_some());
    }

    #[test]
    fn points_that_sink_by_more_than_a_seat_are_a_fall() {
        let recording = |to_m: f32, near_m: f32| -> Vec<PointFrame> {
            let frame = |i: u32| {
                let z_m = if i < 40 { 0.0 } else { to_m };
                let point = RadarPoint {
                    y_m: near_m,
                    z_m: z_m * near_m / 2.0,
                    range_m: near_m,
                    ..RadarPoint::default()
                };
                PointFrame {
                    frame: i,
                    time_s: f64::from(i) / 10.0,
                    points: vec![point; 2],
                    ..PointFrame::default()
                }
            };
            (0..80).map(frame).collect()
        };
        let falls = falls_of_points(&recording(-1.1, 2.0));
        assert_eq!(falls.len(), 1);
        // Somebody stops, and a few points from everywhere are left: too few, too far apart, or of somebody else.
        let stops = |n_before: usize, spread_m: [f32; 2], y_m: f32| {
            let mut frames = recording(-1.1, 2.0);
            for frame in &mut frames {
                let is_before = frame.frame < 40;
                let point = frame.points[0];
                frame.points = match is_before {
                    true => vec![point; n_before],
                    false => (0..2)
                        .map(|k| RadarPoint {
                            x_m: spread_m[0] * (k as f32 - 0.5),
                            y_m,
                            z_m: point.z_m + spread_m[1] * (k as f32 - 0.5),
                            ..point
                        })
                        .collect(),
                };
            }
            falls_of_points(&frames).len()
        };
        assert_eq!(stops(2, [0.5, 0.5], 2.0), 1);
        assert_eq!(stops(30, [0.5, 0.5], 2.0), 0);
        assert_eq!(stops(2, [3.0, 0.5], 2.0), 0);
        assert_eq!(stops(2, [0.5, 4.0], 2.0), 0);
        assert_eq!(stops(3, [0.5, 0.5], 4.0), 0);
        assert!((falls[0].t_s - 4.0).abs() < 1.1, "{falls:?}");
        assert_eq!(falls_of_points(&recording(-0.5, 2.0)), []);
        // Who lifts a leg is up again a second later.
        let mut exercise = recording(-1.1, 2.0);
        let up_m = exercise[0].points[0].z_m;
        for frame in exercise.iter_mut().filter(|f| f.time_s >= 5.0) {
            frame.points.iter_mut().for_each(|point| point.z_m = up_m);
        }
        assert_eq!(falls_of_points(&exercise), []);
        // Leakage before the antennas is nobody.
        assert_eq!(falls_of_points(&recording(-1.1, 0.1)), []);
    }

    #[test]
    fn points_that_are_above_the_floor_after_a_fall_deny_it() {
        const FALL: Fall = Fall {
            t_s: 4.0,
            place_m: [0.0, 2.0],
            probability: 0.8,
        };
        let low = |after_m: f32| {
            let frame = |i: u32| PointFrame {
                frame: i,
                time_s: f64::from(i) / 10.0,
                points: vec![RadarPoint {
                    y_m: 2.0,
                    z_m: if i < 40 { 0.3 } else { after_m },
                    ..RadarPoint::default()
                }],
                ..PointFrame::default()
            };
            let frames: Vec<PointFrame> = (0..80).map(frame).collect();
            ends_low(&frames, &FALL, &Site::unlearned("board", 1.2), 1.2)
        };
        assert!(low(-0.9) && !low(-0.4));
        assert!(ends_low(&[], &FALL, &Site::unlearned("board", 1.2), 1.2));
    }

    /// Ten frames a second of a room with two static echoes, before which somebody stands 1 m away, moves from 3 s on, and is
    /// what `after` says from 4 s on.
    fn room(after: impl Fn(f64) -> Vec<RadarPoint>) -> Vec<PointFrame> {
        let frame = |i: u32| {
            let time_s = f64::from(i) / 10.0;
            let mut points = vec![view_point(2.5, 0.0, 15.0), view_point(3.0, 0.0, 18.0)];
            match i {
                0..30 => points.push(view_point(1.0, 0.0, 35.0)),
                30..40 => points.extend([view_point(1.0, 0.2, 40.0); 3]),
                _ => points.extend(after(time_s)),
            }
            PointFrame {
                frame: i,
                time_s,
                points,
                ..PointFrame::default()
            }
        };
        (0..80).map(frame).collect()
    }

    fn view_point(y_m: f32, velocity_mps: f32, intensity_db: f32) -> RadarPoint {
        RadarPoint {
            y_m,
            range_m: y_m,
            velocity_mps,
            intensity_db,
            ..RadarPoint::default()
        }
    }

    #[test]
    fn who_drops_out_of_view_while_the_room_is_still_seen_has_fallen() {
        let falls = falls_out_of_view(&room(|_| Vec::new()));
        assert_eq!(falls.len(), 1);
        assert!((3.5..4.5).contains(&falls[0].t_s), "{falls:?}");
        assert_eq!(falls[0].place_m, [0.0, 1.0]);
        // Weak echoes of the floor at the same place.
        let weak = falls_out_of_view(&room(|_| vec![view_point(1.1, 0.0, 20.0)]));
        assert_eq!(weak.len(), 1);
        // Who stops is a static echo, who bends is back after a second, who walks away is seen elsewhere.
        let stopped = room(|_| vec![view_point(1.0, 0.0, 37.0)]);
        let back = room(|t_s| match t_s {
            t_s if t_s < 5.0 => Vec::new(),
            _ => vec![view_point(1.0, 0.2, 40.0)],
        });
        let gone = room(|t_s| vec![view_point(1.0 + (t_s - 3.8) as f32 * 2.0, 0.2, 38.0); 2]);
        for frames in [stopped, back, gone] {
            assert_eq!(falls_out_of_view(&frames), []);
        }
    }

    #[test]
    fn an_absence_says_nothing_where_static_points_are_not_reported_or_the_start_is_not_known() {
        let fall = room(|_| Vec::new());
        let mut moving = fall.clone();
        for frame in &mut moving {
            frame.points.retain(|p| p.velocity_mps != 0.0);
        }
        assert_eq!(falls_out_of_view(&moving), []);
        // Somebody who comes from elsewhere, or of whom ever fewer points are seen, leaves.
        let arrives = |y_m: f32, n: usize| {
            let mut frames = fall.clone();
            for frame in &mut frames[20..30] {
                frame.points.extend(vec![view_point(y_m, 0.2, 40.0); n]);
            }
            falls_out_of_view(&frames).len()
        };
        assert_eq!(
            (arrives(1.0, 1), arrives(2.0, 1), arrives(1.0, 8)),
            (1, 0, 0)
        );
        // A longer recording that begins with the movement does not tell where it comes from; a short one is an event.
        assert_eq!(falls_out_of_view(&fall[30..]).len(), 1);
        let mut longer = fall[30..].to_vec();
        let empty = longer[40].clone();
        longer.extend((0..20).map(|i| PointFrame {
            time_s: 8.0 + f64::from(i) / 10.0,
            ..empty.clone()
        }));
        assert_eq!(falls_out_of_view(&longer), []);
        assert_eq!(falls_out_of_view(&[]), []);
    }

    #[test]
    fn fewer_points_than_frames_show_no_fall() {
        let recording = |every: usize| -> Vec<PointFrame> {
            let frame = |i: usize| {
                let z_m = if i < 80 { 0.3 } else { -0.7 };
                let point = RadarPoint {
                    y_m: 2.0,
                    z_m,
                    ..RadarPoint::default()
                };
                PointFrame {
                    frame: i as u32,
                    time_s: i as f64 / 20.0,
                    points: vec![point; usize::from(i.is_multiple_of(every))],
                    ..PointFrame::default()
                }
            };
            (0..160).map(frame).collect()
        };
        assert_eq!(falls_of_points(&recording(1)).len(), 1);
        assert_eq!(falls_of_points(&recording(4)), []);
    }
}
