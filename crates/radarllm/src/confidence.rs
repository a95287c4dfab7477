//! Confidence in sentences about recorded radar, and what is stated where it is low.
//!
//! A model that learned from simulated radar is too sure of itself on recordings. A logistic function that was fitted on
//! recordings with known activities turns its confidence into the probability that a sentence is right (Platt, 1999).
//! Where that is low, the description states only what the points show ([`crate::general`]).

use std::collections::BTreeMap;

use radarllm_base::Clip;
use radarllm_inference::{Description, Segment};
use radarllm_io::{Error, Result};
use serde::Deserialize;

use crate::general::{join, visible, where_seen};

/// Confidences nearer to 0 or 1 count as this far from it: windows of a recording agree also where they err.
const NEAREST: f32 = 0.01;
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

    /// The probability that a guess with this confidence is right, about a clip that is described in a number of windows.
    pub(crate) fn of_guess(&self, clip: &Clip, n_windows: usize, confidence: f32) -> f32 {
        let fitted = self.of(clip, n_windows);
        fitted.map_or(confidence, |fitted| fitted.probability(confidence))
    }

    /// Replaces the confidences of a description, and the sentences about a recording that are too uncertain.
    pub(crate) fn apply(&self, clip: &Clip, description: &mut Description) {
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
            if !is_recorded || segment.confidence >= self.unsure_below {
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
            join(&clip.frames, &mut stated, segment);
        }
        description.set_segments(stated);
    }
}

#[cfg(test)]
mod tests {
    use radarllm_base::{Clutter, PointFrame, RadarPoint};

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
        confidence.apply(&clip(0.0, "recorded:uart:x"), &mut description);
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
        confidence.apply(&clip(0.4, "recorded:uart:x"), &mut description);
        assert_eq!(description.caption, "a person moves about");
        assert_eq!(description.segments.len(), 1);
    }

    /// A sentence is one of a window of ten seconds; where it is too uncertain, only the time in which somebody is seen is stated.
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
        let stated = |is_sure: bool| {
            let mut description = described(&[if is_sure { 0.99 } else { 0.3 }]);
            description.segments[0].end_s = 10.0;
            confidence.apply(&clip, &mut description);
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
        let mut description = described(&[0.3]);
        description.segments[0].end_s = 10.0;
        confidence.apply(&clip, &mut description);
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
        confidence.apply(&clip(0.0, "recorded:uart:x"), &mut description);
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
            confidence.apply(&clip(0.0, provenance), &mut description);
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
        confidence.apply(&simulated, &mut description);
        assert_eq!(description, before);

        let fitted = "[simulated]\nwindow = { slope = 1.0, offset = -3.0 }\n\
            recording = { slope = 1.0, offset = 0.0 }\n";
        let confidence = RecordedConfidence::from_toml(&format!("{FILE}{fitted}")).unwrap();
        confidence.apply(&simulated, &mut description);
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
            confidence.apply(&clip(0.0, provenance), &mut description);
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
