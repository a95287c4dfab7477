//! Confidence in sentences about recorded radar, and what is stated where it is low.
//!
//! A model that learned from simulated radar is too sure of itself on recordings. A logistic function that was fitted on
//! recordings with known activities turns its confidence into the probability that a sentence is right (Platt, 1999).
//! Where that is low, the description states only what the points show: whether somebody moves on the spot or about.

use std::collections::BTreeMap;

use radarllm_base::{Clip, PointFrame, RadarPoint, stats::quantile_nearest};
use radarllm_inference::{Description, Segment};
use radarllm_io::{Error, Result};
use serde::Deserialize;

/// Distance between places of one person, m, above which the person moves about.
const ABOUT_M: f32 = 1.0;
/// Seconds with points that show whether a person moves about.
const MIN_PLACES: usize = 4;
/// Confidences nearer to 0 or 1 count as this far from it: windows of a recording agree also where they err.
const NEAREST: f32 = 0.01;
/// Share of the seconds on either side of the distance.
const OUTSIDE: f32 = 0.1;

/// The probability that a sentence about a recording is right, given the confidence of the model.
///
/// How often a confident sentence is right differs between boards and their firmwares. What was fitted on recordings of
/// one format, in which one firmware's points are recorded, holds for that format; all others have what was fitted on
/// recordings of another board.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedConfidence {
    /// Sentences with a smaller probability are not stated.
    unsure_below: f32,
    /// For formats without an entry of their own.
    others: Fitted,
    /// By the name of the recording's format ([`radarllm_base::Provenance::format`]).
    #[serde(default)]
    formats: BTreeMap<String, Fitted>,
    /// For simulated clips, whose sentences are stated however probable they are; the model's own confidence if absent.
    /// The confidence that was fitted contains that of the side ([`Segment::side_confidence`]).
    simulated: Option<Fitted>,
}

/// What was fitted on the recordings of one board. The confidence of a sentence about one window is another quantity than
/// that of a sentence about many ([`Segment::confidence`]).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fitted {
    /// For clips of one window.
    window: Logistic,
    /// For longer ones.
    recording: Logistic,
}

/// A logistic function of the log-odds of a confidence.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Logistic {
    /// Change of the log-odds of the probability with those of the confidence.
    slope: f32,
    /// Log-odds of the probability at a confidence of one half.
    offset: f32,
}

impl Fitted {
    fn is_valid(&self) -> bool {
        self.window.is_valid() && self.recording.is_valid()
    }
}

impl Logistic {
    fn is_valid(&self) -> bool {
        self.slope.is_finite() && self.slope >= 0.0 && self.offset.is_finite()
    }

    /// Probability that a sentence with this confidence is right.
    fn probability(&self, confidence: f32) -> f32 {
        let p = confidence.clamp(NEAREST, 1.0 - NEAREST);
        let log_odds = self.offset + self.slope * (p / (1.0 - p)).ln();
        1.0 / (1.0 + (-log_odds).exp())
    }
}

impl RecordedConfidence {
    /// File in the folder of a model.
    pub const FILE: &str = "confidence.toml";

    /// Reads the file of a model.
    ///
    /// # Errors
    /// TOML errors, missing keys, and values that are no probability or not finite.
    pub fn from_toml(text: &str) -> Result<Self> {
        let file: Self = toml::from_str(text).map_err(Error::wrap)?;
        let is_valid = (0.0..=1.0).contains(&file.unsure_below)
            && file
                .formats
                .values()
                .chain([&file.others])
                .chain(&file.simulated)
                .all(Fitted::is_valid);
        match is_valid {
            true => Ok(file),
            false => Err(Error::input(
                "`slope` must be at least 0, `offset` finite and `unsure_below` in 0..=1",
            )),
        }
    }

    /// Whether the model learned from recordings like this one. On all others its actions are guesses: of 176 recordings of
    /// three other boards it described 3 right.
    pub(crate) fn knows(&self, clip: &Clip) -> bool {
        let format = clip.provenance.format();
        clip.provenance.is_simulated() || format.is_some_and(|f| self.formats.contains_key(f))
    }

    /// What was fitted for clips like this one, which is described in a number of windows.
    fn of(&self, clip: &Clip, n_windows: usize) -> Option<Logistic> {
        let recorded = || {
            let own = clip.provenance.format().and_then(|f| self.formats.get(f));
            own.unwrap_or(&self.others)
        };
        let fitted = match clip.provenance.is_simulated() {
            true => self.simulated.as_ref()?,
            false => recorded(),
        };
        Some(match n_windows > 1 {
            true => fitted.recording,
            false => fitted.window,
        })
    }

    /// Replaces the confidences of a description, and the sentences about a recording that are too uncertain: all of them
    /// where the board is not known.
    pub(crate) fn apply(&self, clip: &Clip, is_known: bool, description: &mut Description) {
        let Some(fitted) = self.of(clip, description.windows) else {
            return;
        };
        if description.abstained.is_some() {
            return;
        }
        let is_recorded = !clip.provenance.is_simulated();
        let guessed = |mut segment: Segment| -> Vec<Segment> {
            // A sentence of a simulated clip is right only if its side is: `[simulated]` was fitted so.
            let side = match is_recorded {
                true => 1.0,
                false => segment.side_confidence.unwrap_or(1.0),
            };
            segment.confidence = fitted.probability(side * segment.confidence);
            if !is_recorded || (segment.confidence >= self.unsure_below && is_known) {
                return vec![segment];
            }
            segment.actions.clear();
            segment.guess = Some(std::mem::take(&mut segment.caption));
            let mut parts = where_seen(&clip.frames, segment);
            for part in &mut parts {
                part.caption = visible(&clip.frames, part.start_s, part.end_s).into();
            }
            parts
        };
        let mut stated: Vec<Segment> = Vec::new();
        let segments = std::mem::take(&mut description.segments).into_iter();
        for segment in segments.flat_map(guessed) {
            match stated.last_mut() {
                Some(last) if let Some(caption) = of_both(&clip.frames, last, &segment) => {
                    last.caption = caption;
                    // The guess of the longer part stands for both.
                    let (first_s, second_s) =
                        (last.end_s - last.start_s, segment.end_s - segment.start_s);
                    let weight = (second_s / (first_s + second_s)) as f32;
                    last.confidence += weight * (segment.confidence - last.confidence);
                    last.end_s = segment.end_s;
                    if second_s > first_s {
                        last.guess = segment.guess;
                    }
                }
                _ => stated.push(segment),
            }
        }
        description.set_segments(stated);
    }
}

/// The parts of a segment in which the radar saw somebody. A sentence is one of a whole window: a person who is there for a
/// part of it would be said to be there before and afterwards. What the model states is not cut, because people who exercise are
/// seen now and then.
fn where_seen(frames: &[PointFrame], segment: Segment) -> Vec<Segment> {
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

/// The sentence about the points of two guesses, one after the other, if they are of one thing: what is seen of each is the
/// same, or one is too short to show more than somebody, and both together show what the other does.
fn of_both(frames: &[PointFrame], first: &Segment, second: &Segment) -> Option<String> {
    let are_guesses = first.guess.is_some() && second.guess.is_some();
    if !are_guesses || first.end_s != second.start_s {
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

/// What is said of somebody who is seen for too short a time to say more.
const SOMEBODY: &str = "a person is there";

/// What the points of a time show of any motion.
fn visible(frames: &[PointFrame], start_s: f64, end_s: f64) -> &'static str {
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
        true => "a person moves about",
        false => "a person moves on the spot",
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

    fn clip(speed_mps: f32, provenance: &str) -> Clip {
        let frame = |i: u32| {
            let y_m = 2.0 + speed_mps * i as f32 / 10.0;
            let point = RadarPoint {
                y_m,
                range_m: y_m,
                ..RadarPoint::default()
            };
            PointFrame {
                frame: i,
                time_s: f64::from(i) / 10.0,
                points: vec![point; 5],
                board: None,
            }
        };
        Clip {
            frame_rate_hz: 10.0,
            frames: (0..100).map(frame).collect(),
            radar: "test".into(),
            radar_height_m: 1.0,
            is_height_assumed: false,
            provenance: provenance.parse().unwrap(),
            clutter: Clutter::default(),
        }
    }

    fn described(confidences: &[f32]) -> Description {
        let segment = |(i, confidence): (usize, &f32)| Segment {
            start_s: 5.0 * i as f64,
            end_s: 5.0 * (i + 1) as f64,
            caption: format!("a person squats {i}"),
            actions: vec!["squat"],
            confidence: *confidence,
            side_confidence: None,
            taught: None,
            guess: None,
        };
        let mut description = Description {
            caption: String::new(),
            confidence: 0.0,
            tokens: Vec::new(),
            seconds: 10.0,
            windows: 1,
            segments: Vec::new(),
            choices: Vec::new(),
            abstained: None,
        };
        description.set_segments(confidences.iter().enumerate().map(segment).collect());
        description
    }

    const FILE: &str = "unsure_below = 0.25\n[others]\nwindow = { slope = 2.0, offset = -1.0 }\n\
        recording = { slope = 1.0, offset = 1.0 }\n[formats.radhar]\nwindow = { slope = 1.0, offset = 0.0 }\n\
        recording = { slope = 1.0, offset = 0.0 }\n";

    #[test]
    fn uncertain_sentences_are_not_stated() {
        let confidence = RecordedConfidence::from_toml(FILE).unwrap();
        assert!(
            (confidence.others.window.probability(0.5) - 1.0 / (1.0 + 1.0_f32.exp())).abs() < 1e-6
        );
        let mut description = described(&[0.8, 0.3]);
        confidence.apply(&clip(0.0, "recorded:uart:x"), true, &mut description);
        let [sure, unsure] = &description.segments[..] else {
            panic!("{description:?}")
        };
        assert_eq!(
            (sure.caption.as_str(), &sure.guess),
            ("a person squats 0", &None)
        );
        assert_eq!(unsure.caption, "a person moves on the spot");
        assert_eq!(unsure.guess.as_deref(), Some("a person squats 1"));
        assert!(unsure.actions.is_empty() && unsure.confidence < 0.25);

        let mut description = described(&[0.3, 0.3]);
        confidence.apply(&clip(0.4, "recorded:uart:x"), true, &mut description);
        assert_eq!(description.caption, "a person moves about");
        assert_eq!(description.segments.len(), 1);

        // On a board that is not known, sure sentences are guesses, too.
        let mut description = described(&[0.99]);
        confidence.apply(&clip(0.4, "recorded:uart:x"), false, &mut description);
        assert_eq!(description.caption, "a person moves about");
        assert_eq!(
            description.segments[0].guess.as_deref(),
            Some("a person squats 0")
        );
    }

    /// A sentence is one of a window of ten seconds; of a board that is not known, only the time in which somebody is seen is
    /// stated.
    #[test]
    fn nobody_is_stated_before_and_after_somebody_is_seen() {
        let confidence = RecordedConfidence::from_toml(FILE).unwrap();
        let mut clip = clip(0.4, "recorded:uart:x");
        for frame in &mut clip.frames {
            let t_s = frame.time_s;
            if !((2.0..4.0).contains(&t_s) || (9.0..9.5).contains(&t_s)) {
                frame.points.clear();
            }
        }
        let stated = |is_known: bool| {
            let mut description = described(&[0.99]);
            description.segments[0].end_s = 10.0;
            confidence.apply(&clip, is_known, &mut description);
            let segments = description.segments.into_iter();
            segments
                .map(|s| [s.start_s, s.end_s])
                .collect::<Vec<[f64; 2]>>()
        };
        let unknown = stated(false);
        assert_eq!(unknown.len(), 2, "{unknown:?}");
        let expected = [[2.0, 3.9], [9.0, 10.0]];
        for (found, expected) in unknown.iter().flatten().zip(expected.iter().flatten()) {
            assert!((found - expected).abs() < 1e-6, "{unknown:?}");
        }
        assert_eq!(stated(true), [[0.0, 10.0]]);
        // Somebody who keeps still for a moment is there nevertheless.
        clip.frames.iter_mut().for_each(|frame| {
            if (4.5..5.0).contains(&frame.time_s) || (7.0..8.0).contains(&frame.time_s) {
                frame.points = vec![RadarPoint::default(); 3];
                frame.points.iter_mut().for_each(|p| p.y_m = 3.0);
                frame.points.iter_mut().for_each(|p| p.range_m = 3.0);
            }
        });
        let mut description = described(&[0.99]);
        description.segments[0].end_s = 10.0;
        confidence.apply(&clip, false, &mut description);
        assert_eq!(description.segments.len(), 1);
    }

    #[test]
    fn a_time_too_short_to_say_where_somebody_moves_joins_what_is_around_it() {
        let confidence = RecordedConfidence::from_toml(FILE).unwrap();
        let mut description = described(&[0.3; 3]);
        for (segment, [start_s, end_s]) in
            (description.segments.iter_mut()).zip([[0.0, 4.0], [4.0, 5.0], [5.0, 10.0]])
        {
            (segment.start_s, segment.end_s) = (start_s, end_s);
        }
        confidence.apply(&clip(0.0, "recorded:uart:x"), false, &mut description);
        let [all] = &description.segments[..] else {
            panic!("{description:?}")
        };
        assert_eq!(all.caption, "a person moves on the spot");
        assert_eq!((all.start_s, all.end_s), (0.0, 10.0));
        assert_eq!(all.guess.as_deref(), Some("a person squats 0"));
    }

    #[test]
    fn formats_and_longer_recordings_have_their_own_functions() {
        let confidence = RecordedConfidence::from_toml(FILE).unwrap();
        let logistic = |log_odds: f32| 1.0 / (1.0 + (-log_odds).exp());
        for (provenance, n_windows, expected) in [
            ("recorded:radhar:x", 1, 0.5),
            ("recorded:uart:x", 1, logistic(-1.0)),
            ("recorded:uart:x", 2, logistic(1.0)),
            ("recorded:x", 1, logistic(-1.0)),
        ] {
            let mut description = described(&[0.5]);
            description.windows = n_windows;
            confidence.apply(&clip(0.0, provenance), true, &mut description);
            let found = description.segments[0].confidence;
            assert!((found - expected).abs() < 1e-6, "{provenance}: {found}");
        }
    }

    #[test]
    fn simulated_clips_keep_their_sentences() {
        let simulated = clip(0.0, "simulated:builtin:walk");
        let before = described(&[0.5, 0.1]);
        let mut description = before.clone();
        let confidence = RecordedConfidence::from_toml(FILE).unwrap();
        confidence.apply(&simulated, true, &mut description);
        assert_eq!(description, before);

        let fitted = "[simulated]\nwindow = { slope = 1.0, offset = -3.0 }\n\
            recording = { slope = 1.0, offset = 0.0 }\n";
        let confidence = RecordedConfidence::from_toml(&format!("{FILE}{fitted}")).unwrap();
        confidence.apply(&simulated, true, &mut description);
        let captions = description.segments.iter().map(|s| s.caption.as_str());
        let unchanged = before.segments.iter().map(|s| s.caption.as_str());
        assert!(captions.eq(unchanged));
        assert!(description.segments.iter().all(|s| s.confidence < 0.05));
    }

    #[test]
    fn the_side_counts_for_simulated_clips_alone() {
        let fitted = "[simulated]\nwindow = { slope = 1.0, offset = 0.0 }\n\
            recording = { slope = 1.0, offset = 0.0 }\n";
        let confidence = RecordedConfidence::from_toml(&format!("{FILE}{fitted}")).unwrap();
        for (provenance, side_confidence, expected) in [
            ("simulated:builtin:wave", Some(0.5), 0.4),
            ("simulated:builtin:wave", None, 0.8),
            ("recorded:radhar:x", Some(0.5), 0.8),
        ] {
            let mut description = described(&[0.8]);
            description.segments[0].side_confidence = side_confidence;
            confidence.apply(&clip(0.0, provenance), true, &mut description);
            let found = description.segments[0].confidence;
            assert!((found - expected).abs() < 1e-6, "{provenance}: {found}");
        }
    }

    #[test]
    fn files_with_other_contents_are_refused() {
        let with = |change: &str, to: &str| {
            assert!(FILE.contains(change));
            FILE.replacen(change, to, 1)
        };
        for wrong in [
            String::new(),
            "unsure_below = 0.25".into(),
            with("slope = 2.0, ", ""),
            with("slope = 2.0", "slope = -1.0"),
            with("offset = -1.0", "offset = nan"),
            with("recording = { slope = 1.0, offset = 1.0 }\n", ""),
            with("unsure_below = 0.25", "unsure_below = 2.0"),
            with("unsure_below", "more = 1\nunsure_below"),
            with("offset = 0.0", "offset = inf"),
        ] {
            assert!(RecordedConfidence::from_toml(&wrong).is_err(), "{wrong}");
        }
    }
}
