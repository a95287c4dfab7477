//! What is said of somebody of whom nothing is measured, and of whom the model only guesses: whether somebody moves on the spot
//! or about, or is there. It is told by the points alone, and holds only while they show somebody.

use std::borrow::Cow;

use radarllm_base::{Clip, PointFrame, RadarPoint, stats::quantile_nearest};
use radarllm_inference::{
    DescribeOptions, Description, PreparedClip, Segment,
    lm::{NO_PERSON, times_with_person},
};

use crate::gaps::follows;

/// What is said of somebody who is seen for too short a time to say more.
const SOMEBODY: &str = "a person is there";
const MOVES_ABOUT: &str = "a person moves about";
const MOVES_ON_THE_SPOT: &str = "a person moves on the spot";
/// Length of the pieces of a recording of which it is said whether somebody moves about, s: that of a window of the model.
const PIECE_S: f64 = 10.0;
/// Distance between places of one person, m, above which the person moves about.
const ABOUT_M: f32 = 1.0;
/// Seconds with points that show whether a person moves about.
const MIN_PLACES: usize = 4;
/// Share of the seconds on either side of the distance.
const OUTSIDE: f32 = 0.1;

/// Whether a segment states no action, but only what the points show of any motion. Its confidence is that of the guess of the
/// model, and 0 without one.
pub fn is_general(segment: &Segment) -> bool {
    segment.actions.is_empty()
        && segment.taught.is_none()
        && [SOMEBODY, MOVES_ABOUT, MOVES_ON_THE_SPOT].contains(&segment.caption.as_str())
}

/// The description of a clip by its points alone.
pub(crate) fn describe(clip: &PreparedClip, options: &DescribeOptions) -> Description {
    let mut segments = Vec::new();
    let mut abstained = None;
    for frames in clip.frames.chunk_by(follows) {
        let run = match frames.len() == clip.frames.len() {
            true => Cow::Borrowed(&**clip),
            false => Cow::Owned(clip.with_frames(frames.to_vec())),
        };
        match times_with_person(&run, options) {
            Ok(times) => {
                for [start_s, end_s] in times {
                    add(&run, start_s, end_s, &mut segments);
                }
            }
            Err(why) => abstained = abstained.or(Some(why)),
        }
    }
    let mut description = Description {
        caption: NO_PERSON.into(),
        seconds: clip.duration_s() as f32,
        abstained,
        ..Description::default()
    };
    description.set_segments(segments);
    description
}

/// Adds what is said of a time in which there may be somebody.
fn add(clip: &Clip, start_s: f64, end_s: f64, segments: &mut Vec<Segment>) {
    let whole = Segment {
        start_s,
        end_s,
        ..general(SOMEBODY)
    };
    for part in where_seen(&clip.frames, whole) {
        let mut from_s = part.start_s;
        while from_s < part.end_s {
            let to_s = (from_s + PIECE_S).min(part.end_s);
            let piece = Segment {
                start_s: from_s,
                end_s: to_s,
                ..general(visible(&clip.frames, from_s, to_s))
            };
            join(&clip.frames, segments, piece);
            from_s = to_s;
        }
    }
}

fn general(caption: &str) -> Segment {
    Segment {
        start_s: 0.0,
        end_s: 0.0,
        caption: caption.into(),
        actions: Vec::new(),
        confidence: 0.0,
        side_confidence: None,
        taught: None,
        guess: None,
    }
}

/// Adds the guesses of the model to what is said by the points: of each segment the one that covers the longest part of it.
pub(crate) fn add_guesses(description: &mut Description, guessed: Description) {
    description.tokens = guessed.tokens;
    description.windows = guessed.windows;
    let mut segments = std::mem::take(&mut description.segments);
    for segment in &mut segments {
        let shared_s =
            |guess: &Segment| guess.end_s.min(segment.end_s) - guess.start_s.max(segment.start_s);
        let longest = (guessed.segments.iter()).max_by(|a, b| shared_s(a).total_cmp(&shared_s(b)));
        if let Some(guess) = longest.filter(|guess| shared_s(guess) > 0.0) {
            segment.guess = Some(guess.caption.clone());
            segment.confidence = guess.confidence;
        }
    }
    let abstained = description.abstained;
    description.set_segments(segments);
    description.abstained = description.abstained.or(abstained);
}

/// Adds a segment to those before it; two general ones of one thing become one.
pub(crate) fn join(frames: &[PointFrame], segments: &mut Vec<Segment>, next: Segment) {
    match segments.last_mut() {
        Some(last) if let Some(caption) = of_both(frames, last, &next) => {
            last.caption = caption;
            // The guess of the longer part stands for both.
            let (first_s, second_s) = (last.end_s - last.start_s, next.end_s - next.start_s);
            let weight = (second_s / (first_s + second_s)) as f32;
            last.confidence += weight * (next.confidence - last.confidence);
            last.end_s = next.end_s;
            if second_s > first_s {
                last.guess = next.guess;
            }
        }
        _ => segments.push(next),
    }
}

/// The parts of a segment in which the radar saw somebody. A sentence is one of a whole window: a person who is there for a
/// part of it would be said to be there before and afterwards.
pub(crate) fn where_seen(frames: &[PointFrame], segment: Segment) -> Vec<Segment> {
    let parts = seen(frames, segment.start_s, segment.end_s);
    if parts.is_empty() {
        return vec![segment];
    }
    let part = |[start_s, end_s]: [f64; 2]| Segment {
        start_s,
        end_s,
        ..segment.clone()
    };
    parts.into_iter().map(part).collect()
}

/// The times between two others, s, in which points show somebody. Somebody who keeps still is seen no more, so that times
/// that are near each other are one.
fn seen(frames: &[PointFrame], start_s: f64, end_s: f64) -> Vec<[f64; 2]> {
    /// Time without points, s, after which nothing is said until they come again.
    const MAX_UNSEEN_S: f64 = 4.0;
    /// Less than this at the beginning or the end, s, belongs to the sentence: the radar needs a moment.
    const MIN_CUT_S: f64 = 1.0;
    /// Distance of the points of a body from their middle, m.
    const BODY_M: f32 = 0.75;
    let begins = |t_s: f64| frames.partition_point(|frame| frame.time_s < t_s);
    let frames = frames
        .get(begins(start_s)..begins(end_s))
        .unwrap_or_default();
    let mut times: Vec<[f64; 2]> = Vec::new();
    for second in frames.chunk_by(|a, b| {
        let second = |frame: &PointFrame| (frame.time_s - start_s) as u64;
        second(a) == second(b)
    }) {
        let all = || second.iter().flat_map(|f| &f.points);
        let points = || all().filter(|p| !p.is_leakage());
        let [x_m, y_m] = [
            quantile(points().map(|p| p.x_m), 0.5),
            quantile(points().map(|p| p.y_m), 0.5),
        ];
        let is_near = |p: &RadarPoint| (p.x_m - x_m).hypot(p.y_m - y_m) <= BODY_M;
        let n_near = points().filter(|p| is_near(p)).count();
        // False alarms are spread over the room.
        if n_near < 2 || 4 * n_near < points().count() {
            continue;
        }
        let mut of_body = second.iter().filter(|f| f.points.iter().any(is_near));
        let Some(first) = of_body.next() else {
            continue;
        };
        let last = of_body.next_back().unwrap_or(first);
        match times.last_mut() {
            Some(before) if first.time_s - before[1] <= MAX_UNSEEN_S => before[1] = last.time_s,
            _ => times.push([first.time_s, last.time_s]),
        }
    }
    if let (Some(first), Some(last)) = (times.first().copied(), times.last().copied()) {
        let n = times.len();
        if first[0] - start_s < MIN_CUT_S {
            times[0][0] = start_s;
        }
        if end_s - last[1] < MIN_CUT_S {
            times[n - 1][1] = end_s;
        }
    }
    // A single echo among others is nobody.
    let is_alone = times.len() == 1;
    times.retain(|[from_s, to_s]| is_alone || to_s > from_s);
    times
}

/// The sentence about the points of two general segments, one after the other, if they are of one thing: what is seen of each is
/// the same, or one is too short to show more than somebody, and both together show what the other does.
fn of_both(frames: &[PointFrame], first: &Segment, second: &Segment) -> Option<String> {
    if ![first, second].into_iter().all(is_general) || first.end_s != second.start_s {
        return None;
    }
    let stronger = match (first.caption.as_str(), second.caption.as_str()) {
        (a, b) if a == b || b == SOMEBODY => a,
        (SOMEBODY, b) => b,
        _ => return None,
    };
    // What was done more than a minute before says little of now.
    let start_s = first.start_s.max(first.end_s - 60.0);
    let is_shown =
        first.caption == second.caption || visible(frames, start_s, second.end_s) == stronger;
    is_shown.then(|| stronger.into())
}

/// What the points of a time show of any motion.
pub(crate) fn visible(frames: &[PointFrame], start_s: f64, end_s: f64) -> &'static str {
    let begins = |t_s: f64| frames.partition_point(|frame| frame.time_s < t_s);
    let (first, end) = (begins(start_s), begins(end_s));
    let mut seconds: Vec<Vec<[f32; 2]>> = Vec::new();
    for frame in frames.get(first..end).unwrap_or_default() {
        let second = (frame.time_s - start_s) as usize;
        while seconds.len() <= second {
            seconds.push(Vec::new());
        }
        seconds[second].extend(frame.points.iter().map(|p| [p.x_m, p.y_m]));
    }
    // The middle of the points of each second that has more than single ones.
    let places: Vec<[f32; 2]> = seconds
        .iter()
        .filter(|points| points.len() >= 3)
        .map(|points| [0, 1].map(|axis| quantile(points.iter().map(|p| p[axis]), 0.5)))
        .collect();
    let extent = |axis: usize| {
        let values = || places.iter().map(|p| p[axis]);
        quantile(values(), 1.0 - OUTSIDE) - quantile(values(), OUTSIDE)
    };
    match extent(0).hypot(extent(1)) > ABOUT_M {
        // Of a shorter time it cannot be said where somebody goes.
        _ if places.len() < MIN_PLACES => SOMEBODY,
        true => MOVES_ABOUT,
        false => MOVES_ON_THE_SPOT,
    }
}

/// Quantile of values without interpolation; 0 without values.
fn quantile(values: impl Iterator<Item = f32>, share: f32) -> f32 {
    quantile_nearest(values, share).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use radarllm_base::Clutter;

    use super::*;

    /// Points of somebody at the distances that a function of the time gives; nobody where it gives none.
    fn clip(seconds: u32, at: impl Fn(f64) -> Option<f32>) -> Clip {
        let frame = |i: u32| {
            let time_s = f64::from(i) / 10.0;
            let point = |y_m: f32| RadarPoint {
                y_m,
                range_m: y_m,
                velocity_mps: 0.5,
                ..RadarPoint::default()
            };
            PointFrame {
                frame: i,
                time_s,
                points: at(time_s).map_or(Vec::new(), |y_m| vec![point(y_m); 9]),
                board: None,
            }
        };
        Clip {
            frames: (0..10 * seconds).map(frame).collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "board".into(),
            provenance: "recorded:csv:x".parse().unwrap(),
            clutter: Clutter::Settled,
        }
    }

    fn said(clip: &Clip) -> Vec<(String, [f64; 2])> {
        let clip = PreparedClip::of(clip).unwrap();
        let description = describe(&clip, &DescribeOptions::default());
        assert!(description.segments.iter().all(is_general));
        let times = |s: Segment| {
            let tenths = |t_s: f64| (10.0 * t_s).round() / 10.0;
            (s.caption, [tenths(s.start_s), tenths(s.end_s)])
        };
        description.segments.into_iter().map(times).collect()
    }

    #[test]
    fn what_points_show_holds_while_they_show_it() {
        // Somebody comes in after 30 s, walks about for 10 s, then stays for 20 s.
        let stays = |t_s: f64| match t_s {
            t if t < 30.0 => None,
            t if t < 40.0 => Some(1.0 + 0.4 * (t as f32 - 30.0)),
            t if t < 60.0 => Some(5.0),
            _ => None,
        };
        let row = |caption: &str, times: [f64; 2]| (caption.to_string(), times);
        assert_eq!(
            said(&clip(90, stays)),
            [
                row(MOVES_ABOUT, [30.0, 40.0]),
                row(MOVES_ON_THE_SPOT, [40.0, 59.9]),
            ]
        );
        assert_eq!(said(&clip(90, |_| None)), []);
        let empty = clip(90, |_| None);
        let empty = PreparedClip::of(&empty).unwrap();
        let description = describe(&empty, &DescribeOptions::default());
        assert_eq!(description.caption, NO_PERSON);
        assert!(description.abstained.is_some());
    }

    #[test]
    fn nothing_is_said_of_a_time_without_frames() {
        let mut clip = clip(40, |_| Some(2.0));
        clip.frames.retain(|f| !(10.0..25.0).contains(&f.time_s));
        assert_eq!(
            said(&clip),
            [
                (MOVES_ON_THE_SPOT.to_string(), [0.0, 10.0]),
                (MOVES_ON_THE_SPOT.to_string(), [25.0, 40.0]),
            ]
        );
    }

    #[test]
    fn a_guess_belongs_to_the_segment_of_which_it_covers_most() {
        let clip = clip(20, |_| Some(2.0));
        let clip = PreparedClip::of(&clip).unwrap();
        let mut description = describe(&clip, &DescribeOptions::default());
        let guess = |caption: &str, start_s: f64, end_s: f64| Segment {
            start_s,
            end_s,
            confidence: 0.4,
            ..general(caption)
        };
        let guessed = Description {
            segments: vec![
                guess("a person claps", 0.0, 4.0),
                guess("a person waves", 4.0, 20.0),
            ],
            windows: 5,
            tokens: vec![7],
            ..Description::default()
        };
        add_guesses(&mut description, guessed);
        let [all] = &description.segments[..] else {
            panic!("{description:?}")
        };
        assert_eq!(all.guess.as_deref(), Some("a person waves"));
        assert_eq!(
            (all.caption.as_str(), all.confidence),
            (MOVES_ON_THE_SPOT, 0.4)
        );
        assert_eq!(
            (description.windows, &description.tokens[..]),
            (5, &[7][..])
        );
    }
}
