//! Boards in turn: is what is said of recordings right on boards that nothing was learned from?
//!
//! A configuration names boards, each with parts: recordings of known activities, a long recording with labelled times,
//! and times at which nobody is there or somebody is. Every board has a row of its own, and the headline is the mean over the
//! boards that the model did not learn: a board with many recordings does not decide it.

mod report;

use std::path::PathBuf;

use radarllm_inference::Segment;
use radarllm_metrics::{
    dense::{Dense, Timed, soda},
    meteor::{Meteor, Resources},
};
use serde::{Deserialize, Serialize};

use super::recordings::{
    Activity, Calibration, Judged, RecordingRow, RecordingsConfig, Role, SegmentRow,
    strict::StatedTime,
};
use crate::EvalError;

pub use report::markdown;

/// The configuration file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardsConfig {
    /// The boards.
    pub board: Vec<BoardConfig>,
}

/// A board.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardConfig {
    /// Name in the report.
    pub name: String,
    /// Whether the model learned from recordings of this board.
    #[serde(default)]
    pub learned: bool,
    /// Recordings of which the site of all parts is learned, below the folder of the data. Where somebody walks in a
    /// recording, it is learned from that if this is omitted.
    pub site: Option<PathBuf>,
    /// Folders of recordings with one activity each.
    #[serde(default)]
    pub activities: Vec<ActivitiesPart>,
    /// Recordings with labelled times.
    #[serde(default)]
    pub labelled: Vec<LabelledPart>,
    /// Recordings of which it is known whether somebody is there.
    #[serde(default)]
    pub presence: Vec<PresencePart>,
}

/// How the recordings of a part are read.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reading {
    /// Format, where it is not detected.
    pub format: Option<String>,
    /// Frames per second, where the recording does not state them.
    pub frame_rate_hz: Option<f64>,
}

/// Recordings of one activity each: what `eval recordings` evaluates.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActivitiesPart {
    /// Configuration of `eval recordings`, beside this one.
    pub config: PathBuf,
    /// Folder below that of the data.
    pub recordings: PathBuf,
    /// How they are read.
    #[serde(default)]
    pub reading: Reading,
}

/// A recording with labelled times.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LabelledPart {
    /// The recording, below the folder of the data.
    pub recording: PathBuf,
    /// CSV beside it with the columns `start_s`, `end_s` and the one named by `column`. Other columns are ignored.
    pub labels: PathBuf,
    /// Column of the activity.
    pub column: String,
    /// Share of each labelled time at its ends that is not judged, because the bounds are uncertain.
    #[serde(default)]
    pub uncertain_ends: f64,
    /// The activities.
    pub activity: Vec<Activity>,
    /// How it is read.
    #[serde(default)]
    pub reading: Reading,
}

/// A recording, or a part of one, of which it is known whether somebody is there.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PresencePart {
    /// Name in the report.
    pub name: String,
    /// The recording, below the folder of the data.
    pub recording: PathBuf,
    /// Whether somebody is there.
    pub truth: PresenceTruth,
    /// From and to, s since the first frame; all if omitted.
    pub between_s: Option<[f64; 2]>,
    /// How it is read.
    #[serde(default)]
    pub reading: Reading,
}

/// What is known of the presence of people.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PresenceTruth {
    /// Nobody is there.
    Nobody,
    /// Somebody is there all the time.
    Somebody,
    /// It is not known when somebody is there, only that nobody is known to fall.
    Unknown,
}

/// A labelled time.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// Activity.
    pub activity: String,
    /// Beginning, s.
    pub start_s: f64,
    /// End, s.
    pub end_s: f64,
}

/// What was said while it was known whether somebody is there.
#[derive(Clone, Debug, Serialize)]
pub struct PresenceRow {
    /// Name of the part.
    pub name: String,
    /// What is known.
    pub truth: PresenceTruth,
    /// Length, s.
    pub seconds: f64,
    /// Time for which a sentence states a person, s.
    pub stated_s: f64,
    /// Sentences that state a fall.
    pub falls: usize,
}

/// How well the timeline of a recording agrees with its labelled times.
#[derive(Clone, Debug, Serialize)]
pub struct TimelineRow {
    /// The recording.
    pub recording: String,
    /// Number of labelled times.
    pub labels: usize,
    /// Number of sentences within them.
    pub sentences: usize,
    /// Agreement of the times, whatever is said.
    pub times: Dense,
    /// The same of sentences that state the labelled activity; those that state another one count nothing.
    pub actions: Dense,
    /// SODA_c: the same with the METEOR of each sentence against the one that the configuration gives its activity; `None`
    /// unless it gives one to all.
    pub soda: Option<Dense>,
}

/// A board and what was said of its recordings.
#[derive(Clone, Debug, Serialize)]
pub struct BoardReport {
    /// Name.
    pub board: String,
    /// Whether the model learned from recordings of this board.
    pub learned: bool,
    /// Recordings and labelled times of known activities.
    pub rows: Vec<RecordingRow>,
    /// Recordings of known presence.
    pub presence: Vec<PresenceRow>,
    /// Timelines of recordings with labelled times.
    pub timelines: Vec<TimelineRow>,
    /// Confidence of the sentences against whether they are right.
    pub calibration: Option<Calibration>,
}

/// All boards.
#[derive(Clone, Debug, Serialize)]
pub struct BoardsReport {
    /// Name of the model.
    pub model: String,
    /// Role of the recordings.
    pub role: Role,
    /// The boards.
    pub boards: Vec<BoardReport>,
}

impl BoardsConfig {
    /// Reads a configuration (TOML).
    ///
    /// # Errors
    /// TOML errors with their place; no boards; shares and times that are impossible.
    pub fn from_toml(text: &str) -> Result<Self, EvalError> {
        let config: Self = toml::from_str(text).map_err(|e| EvalError::Config(e.to_string()))?;
        if config.board.is_empty() {
            return Err(EvalError::Config("no [[board]]".into()));
        }
        let parts = || config.board.iter().flat_map(|b| &b.labelled);
        if parts().any(|part| !(0.0..0.5).contains(&part.uncertain_ends)) {
            return Err(EvalError::Config("uncertain_ends: must be 0 to 0.5".into()));
        }
        let times = config
            .board
            .iter()
            .flat_map(|b| &b.presence)
            .filter_map(|p| p.between_s);
        if times
            .into_iter()
            .any(|[from_s, to_s]| !(from_s >= 0.0 && from_s < to_s))
        {
            return Err(EvalError::Config(
                "between_s: must be two times, the later one second".into(),
            ));
        }
        Ok(config)
    }
}

impl LabelledPart {
    /// Reads the labels.
    ///
    /// # Errors
    /// The line of a missing column, a time that is no number, or an activity that the configuration does not have.
    pub fn labels(&self, text: &str) -> Result<Vec<Label>, EvalError> {
        let mut lines = text.lines().enumerate();
        let (_, head) = lines.next().unwrap_or_default();
        let head: Vec<&str> = head.split(',').map(str::trim).collect();
        let at = |name: &str| {
            let found = head.iter().position(|n| *n == name);
            found.ok_or_else(|| EvalError::Config(format!("labels: no column `{name}`")))
        };
        let (start, end, activity) = (at("start_s")?, at("end_s")?, at(&self.column)?);
        let mut labels = Vec::new();
        for (i, row) in lines.filter(|(_, row)| !row.trim().is_empty()) {
            let cells: Vec<&str> = row.split(',').map(str::trim).collect();
            let wrong = |what: &str| EvalError::Config(format!("labels: line {}: {what}", i + 1));
            let time = |at: usize| {
                let time_s = cells.get(at).and_then(|c| c.parse::<f64>().ok());
                time_s
                    .filter(|t| t.is_finite())
                    .ok_or_else(|| wrong("a time, s"))
            };
            let (start_s, end_s) = (time(start)?, time(end)?);
            if end_s <= start_s {
                return Err(wrong("an end after the start"));
            }
            let name = cells.get(activity).copied().unwrap_or_default();
            if !self.activity.iter().any(|a| a.name == name) {
                return Err(wrong("an activity of the configuration"));
            }
            let cut_s = self.uncertain_ends * (end_s - start_s);
            labels.push(Label {
                activity: name.into(),
                start_s: start_s + cut_s,
                end_s: end_s - cut_s,
            });
        }
        Ok(labels)
    }

    /// How well the sentences of the whole recording agree with its labelled times. What is said outside of them is left
    /// out, and what reaches beyond the ends of one is cut. `None` without labels.
    pub fn timeline(&self, labels: &[Label], segments: &[Segment]) -> Option<TimelineRow> {
        let inside: Vec<Segment> = labels
            .iter()
            .flat_map(|label| within(segments, label.start_s, label.end_s))
            .collect();
        let said: Vec<Timed> = (inside.iter())
            .map(|s| Timed {
                span_s: [s.start_s, s.end_s],
                sentence: &s.caption,
            })
            .collect();
        let references: Vec<Timed> = (labels.iter())
            .map(|label| Timed {
                span_s: [label.start_s, label.end_s],
                sentence: &label.activity,
            })
            .collect();
        let activity = |name: &str| self.activity.iter().find(|a| a.name == name);
        let states = |sentence: &str, name: &str| {
            let mut stated = StatedTime::default();
            stated.add(sentence, 1.0);
            activity(name).is_some_and(|activity| stated.of(activity) > 0.5)
        };
        let is_said = self.activity.iter().all(|a| a.says.is_some());
        let resources = Resources::default();
        let mut meteor = Meteor::new(&resources);
        let meteor_of = |sentence: &str, name: &str| {
            let says = activity(name).and_then(|a| a.says.as_deref());
            meteor.stats(sentence, says.as_slice()).score()
        };
        Some(TimelineRow {
            recording: self.recording.display().to_string(),
            labels: labels.len(),
            sentences: said.len(),
            times: soda(&said, &references, |_, _| 1.0)?,
            actions: soda(&said, &references, |sentence, name| {
                f64::from(u8::from(states(sentence, name)))
            })?,
            soda: match is_said {
                true => soda(&said, &references, meteor_of),
                false => None,
            },
        })
    }

    /// The rows of the labelled times of a recording, by the sentences of the whole.
    pub fn rows(&self, labels: &[Label], segments: &[Segment]) -> Vec<RecordingRow> {
        let config = RecordingsConfig::of_activities(self.activity.clone());
        let row = |label: &Label| {
            let inside = within(segments, label.start_s, label.end_s);
            let name = format!("{} from {:.0} s", self.recording.display(), label.start_s);
            let seconds = label.end_s - label.start_s;
            super::recordings::row(
                &config,
                &name,
                &label.activity,
                seconds,
                &inside,
                inside.is_empty(),
            )
        };
        labels.iter().map(row).collect()
    }
}

/// Segments cut to a time.
pub fn within(segments: &[Segment], start_s: f64, end_s: f64) -> Vec<Segment> {
    let inside = segments
        .iter()
        .filter(|s| s.end_s > start_s && s.start_s < end_s);
    inside
        .map(|s| Segment {
            start_s: s.start_s.max(start_s),
            end_s: s.end_s.min(end_s),
            ..s.clone()
        })
        .collect()
}

impl PresencePart {
    /// What the sentences say of this part, which lasts from `start_s` to `end_s`.
    pub fn row(&self, segments: &[Segment], start_s: f64, end_s: f64) -> PresenceRow {
        let inside = within(segments, start_s, end_s);
        PresenceRow {
            name: self.name.clone(),
            truth: self.truth,
            seconds: end_s - start_s,
            // The sum of nothing is -0.
            stated_s: inside.iter().map(|s| s.end_s - s.start_s).sum::<f64>() + 0.0,
            falls: inside
                .iter()
                .filter(|s| s.actions.contains(&"fall"))
                .count(),
        }
    }
}

impl BoardReport {
    /// A report of the rows of a board.
    pub fn new(
        board: &BoardConfig,
        rows: Vec<RecordingRow>,
        presence: Vec<PresenceRow>,
        timelines: Vec<TimelineRow>,
    ) -> Self {
        // Sentences that state no action claim nothing; what goes before and after an event is not known.
        let claims = |row: &RecordingRow, segment: &SegmentRow| match row.judged {
            // A guess beside a sentence is not claimed.
            Judged::Event => segment.right && segment.guess.is_none(),
            _ => !segment.actions.is_empty(),
        };
        let mut pairs: Vec<(f64, bool)> = Vec::new();
        for row in &rows {
            let claimed = row.segments.iter().filter(|segment| claims(row, segment));
            pairs.extend(claimed.map(|s| (f64::from(s.confidence), s.right)));
        }
        Self {
            board: board.name.clone(),
            learned: board.learned,
            calibration: Calibration::of(&pairs),
            rows,
            presence,
            timelines,
        }
    }

    /// Share of the recordings that are described right, the mean over the activities; `None` without recordings. Recordings
    /// of which it is only known what does not happen do not count: silence would be right.
    pub fn right(&self) -> Option<f64> {
        let known = self.rows.iter().filter(|r| r.judged != Judged::Never);
        let mut activities: Vec<&str> = known.map(|r| r.activity.as_str()).collect();
        activities.sort_unstable();
        activities.dedup();
        let share = |activity: &&str| {
            let own = || self.rows.iter().filter(|r| r.activity == **activity);
            own().filter(|r| r.right).count() as f64 / own().count() as f64
        };
        let n = activities.len();
        (n > 0).then(|| activities.iter().map(share).sum::<f64>() / n as f64)
    }
}

impl BoardsReport {
    /// Mean over the boards that nothing was learned from, of the share that is described right.
    pub fn unknown_boards(&self) -> Option<f64> {
        self.mean_of_unknown(BoardReport::right)
    }

    /// Mean over the same boards of the expected calibration error.
    pub fn calibration_error(&self) -> Option<f64> {
        self.mean_of_unknown(|board| Some(board.calibration.as_ref()?.expected_error))
    }

    fn mean_of_unknown(&self, value: impl Fn(&BoardReport) -> Option<f64>) -> Option<f64> {
        let boards = self.boards.iter().filter(|b| !b.learned);
        let values: Vec<f64> = boards.filter_map(value).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: &str = r#"
        [[board]]
        name = "a board"

        [[board.labelled]]
        recording = "room"
        labels = "room.csv"
        column = "posture"
        uncertain_ends = 0.1
        activity = [{ name = "standing", actions = ["stand_still"] }, { name = "sitting", actions = ["sit_still"] }]

        [[board.presence]]
        name = "night"
        recording = "night"
        truth = "nobody"
    "#;

    fn segment(start_s: f64, end_s: f64, caption: &str) -> Segment {
        Segment {
            start_s,
            end_s,
            caption: caption.into(),
            actions: radarllm_inference::actions(caption),
            confidence: 0.9,
            side_confidence: None,
            taught: None,
            guess: None,
        }
    }

    #[test]
    fn labelled_times_are_judged_by_the_sentences_within_them() {
        let config = BoardsConfig::from_toml(CONFIG).unwrap();
        let board = &config.board[0];
        let part = &board.labelled[0];
        let labels = part
            .labels("posture,start_s,end_s\nstanding,0,10\nsitting,10,20\nsitting,30,40\n")
            .unwrap();
        assert_eq!((labels[0].start_s, labels[0].end_s), (1.0, 9.0));
        let said = [
            segment(0.0, 12.0, "a person stands still 2.0 m away"),
            segment(12.0, 25.0, "a person sits 2.0 m away"),
        ];
        let rows = part.rows(&labels, &said);
        let right: Vec<bool> = rows.iter().map(|r| r.right).collect();
        assert_eq!(right, [true, true, false]);
        // The first sentence is cut to 1 to 9 s, the second to 12 to 19 s of 11 to 19 s.
        let timeline = part.timeline(&labels, &said).unwrap();
        assert_eq!((timeline.labels, timeline.sentences), (3, 3));
        let sum = 1.0 + 7.0 / 8.0;
        assert!(
            (timeline.actions.precision - sum / 3.0).abs() < 1e-9,
            "{timeline:?}"
        );
        assert!((timeline.actions.recall - sum / 3.0).abs() < 1e-9);
        assert!(timeline.soda.is_none() && part.timeline(&[], &said).is_none());
        let mut says = part.clone();
        for activity in &mut says.activity {
            activity.says = Some("a person stands still 2.0 m away".into());
        }
        // The same sentence has a METEOR of 1.
        let soda = says.timeline(&labels[..1], &said).unwrap().soda.unwrap();
        assert!((soda.f1 - 1.0).abs() < 0.01, "{soda:?}");
        let night = board.presence[0].row(&said, 20.0, 60.0);
        assert_eq!((night.seconds, night.stated_s, night.falls), (40.0, 5.0, 0));
        let report = BoardsReport {
            model: "model".into(),
            role: Role::Tuning,
            boards: vec![BoardReport::new(board, rows, vec![night], vec![timeline])],
        };
        // One of one standing, one of two sitting.
        assert_eq!(report.unknown_boards(), Some(0.75));
        let page = markdown(&report);
        assert!(page.contains("75.0") && page.contains("450"), "{page}");
    }

    #[test]
    fn damage_is_named() {
        let config = BoardsConfig::from_toml(CONFIG).unwrap();
        let part = &config.board[0].labelled[0];
        let error = |text: &str| part.labels(text).unwrap_err().to_string();
        assert!(error("start_s,end_s\n").contains("no column `posture`"));
        assert!(error("posture,start_s,end_s\nlying,0,1\n").contains("line 2"));
        assert!(error("posture,start_s,end_s\nsitting,5,1\n").contains("line 2"));
        assert!(BoardsConfig::from_toml("").is_err());
        let half = CONFIG.replace("0.1", "0.5");
        assert!(BoardsConfig::from_toml(&half).is_err());
    }
}
