//! Do captions of recorded radar state the recorded activity?
//!
//! The activity of a recording is known, its reference captions are not. A recording is described right if, over time,
//! its sentences state the activity at least half of the time and no other action as long ([`strict`]).
//!
//! Recordings have roles. Those for tuning may be used to choose anything except the weights of a model that is called
//! zero-shot. Judged recordings choose nothing, and every evaluation on them is logged ([`Role`]).

pub mod calibration;
mod files;
mod looks;
mod report;
pub mod strict;
mod taught;
pub mod training;

use std::collections::BTreeMap;

use radarllm_base::Clip;
use radarllm_inference::{Description, PreparedClip, Segment};
use serde::{Deserialize, Serialize};

use crate::EvalError;
pub use calibration::Calibration;
pub use files::{labelled_clips, labelled_files, parts, runs};
pub use looks::{LOOKS_HEAD, look, look_for_falls};
pub use report::markdown;
use strict::StatedTime;
pub use taught::{TaughtReport, TeachOptions, evaluate_taught};

/// The configuration file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingsConfig {
    /// Height of the radar above the floor, m, if it is known. Clips of a data set have their own.
    pub radar_height_m: Option<f32>,
    /// The recordings are the clips of a data set: motion capture of people through the virtual radar. Their paths are
    /// `SPLIT/MOTION`.
    #[serde(default)]
    pub simulated: bool,
    /// Cut recordings into parts of this length, s; a shorter rest is left out. Not cut if omitted.
    pub part_s: Option<f64>,
    /// Recordings in which no frame came for longer than this, s, are several ones, which follow each other in a file.
    pub cut_at_gap_s: Option<f64>,
    /// Parts that are shorter than this, s, after cutting are fragments and left out.
    #[serde(default)]
    pub min_s: f64,
    /// Roles of the recordings.
    pub roles: Roles,
    /// The activities.
    pub activity: Vec<Activity>,
}

/// Which recordings are for tuning. All others are judged.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Roles {
    /// Patterns of paths below the folder of recordings; `*` matches any text.
    pub tuning: Vec<String>,
}

/// The role of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// May be used to choose settings.
    Tuning,
    /// Judges a candidate and chooses nothing.
    Judged,
}

impl std::str::FromStr for Role {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        [Self::Tuning, Self::Judged]
            .into_iter()
            .find(|role| role.name() == name)
            .ok_or_else(|| "a role is `tuning` or `judged`".into())
    }
}

impl Role {
    /// Name in configurations and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tuning => "tuning",
            Self::Judged => "judged",
        }
    }
}

/// An activity and the actions that state it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Activity {
    /// Name.
    pub name: String,
    /// Names of actions ([`radarllm_facts`]) that state it, each with attributes that the sentence must state, separated
    /// by spaces: `one` or `both` sides; `forward`, `backward` or `sideways`.
    pub actions: Vec<String>,
    /// Patterns of paths below the folder of recordings; `NAME/*` if omitted.
    pub files: Option<Vec<String>>,
    /// Patterns of the paths of recordings with a side of the body or of the direction, by side. Sides do not decide
    /// whether a recording is described right, but are counted beside that.
    #[serde(default)]
    pub sides: BTreeMap<ActivitySide, Vec<String>>,
    /// When a recording is described right.
    #[serde(default)]
    pub judged: Judged,
    /// The sentence by which the activity is taught, where it is.
    pub says: Option<String>,
    /// The sentence about recordings of a side, instead of `says`, in data sets of recordings.
    #[serde(default)]
    pub says_of_side: BTreeMap<ActivitySide, String>,
}

/// When a recording of an activity is described right.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Judged {
    /// The activity is stated for most of the time ([`strict`]).
    #[default]
    Mostly,
    /// The activity is an event, such as a fall: it is stated at all.
    Event,
    /// The activity is not stated at all: what happens is not known, but that is not it.
    Never,
}

/// A side of the body or of a direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ActivitySide {
    /// Left.
    Left,
    /// Right.
    Right,
    /// Both sides of the body.
    Both,
}

/// The path of a recording by its name, which may be that of a part: [`files::parts`].
fn file_of(name: &str) -> &str {
    name.split_once(" from ").map_or(name, |(path, _)| path)
}

impl RecordingRow {
    /// Whether a taught activity was recognised in at least half of the recording.
    pub fn is_recognised(&self) -> bool {
        let taught = self.segments.iter().filter(|s| s.taught.is_some());
        taught.map(|s| s.end_s - s.start_s).sum::<f64>() >= 0.5 * self.seconds
    }
}

impl RecordingsConfig {
    /// Reads a configuration (TOML).
    ///
    /// # Errors
    /// TOML errors with their place; a configuration without activities, or an activity without a known action.
    pub fn from_toml(text: &str) -> Result<Self, EvalError> {
        let config: Self = toml::from_str(text).map_err(|e| EvalError::Config(e.to_string()))?;
        if config.activity.is_empty() {
            return Err(EvalError::Config("no [[activity]]".into()));
        }
        if config.part_s.is_some_and(|s| !(1.0..=3600.0).contains(&s)) {
            return Err(EvalError::Config("part_s: must be 1 to 3600".into()));
        }
        for activity in &config.activity {
            let known = |action: &&String| {
                let mut words = action.split(' ');
                let name = words.next().unwrap_or_default();
                radarllm_facts::tables::stated_actions().any(|action| action == name)
                    && words.all(|word| strict::ATTRIBUTES.contains(&word))
            };
            if let Some(unknown) = activity.actions.iter().find(|action| !known(action)) {
                let problem = format!("activity `{}`: no action `{unknown}`", activity.name);
                return Err(EvalError::Config(problem));
            }
            if activity.actions.is_empty() {
                let problem = format!("activity `{}`: no actions", activity.name);
                return Err(EvalError::Config(problem));
            }
        }
        Ok(config)
    }

    /// A configuration of activities alone.
    pub fn of_activities(activity: Vec<Activity>) -> Self {
        Self {
            radar_height_m: Some(1.0),
            simulated: false,
            part_s: None,
            cut_at_gap_s: None,
            min_s: 0.0,
            roles: Roles { tuning: Vec::new() },
            activity,
        }
    }

    /// The activity of a recording, by its path below the folder of recordings with `/` between names.
    pub fn activity_of(&self, path: &str) -> Option<&Activity> {
        self.activity.iter().find(|activity| match &activity.files {
            Some(patterns) => patterns.iter().any(|p| matches_pattern(path, p)),
            None => path
                .strip_prefix(&activity.name)
                .is_some_and(|rest| rest.starts_with('/')),
        })
    }

    /// The side of a recording of an activity, or of a part of one, by its name.
    fn side_of(&self, activity: &Activity, name: &str) -> Option<ActivitySide> {
        let path = file_of(name);
        let fits = |patterns: &Vec<String>| patterns.iter().any(|p| matches_pattern(path, p));
        let (side, _) = activity.sides.iter().find(|(_, patterns)| fits(patterns))?;
        Some(*side)
    }

    /// The role of a recording, by its path.
    pub fn role_of(&self, path: &str) -> Role {
        match self.roles.tuning.iter().any(|p| matches_pattern(path, p)) {
            true => Role::Tuning,
            false => Role::Judged,
        }
    }
}

/// Whether a text matches a pattern in which `*` stands for any text.
fn matches_pattern(text: &str, pattern: &str) -> bool {
    let Some((start, rest)) = pattern.split_once('*') else {
        return text == pattern;
    };
    let Some(text) = text.strip_prefix(start) else {
        return false;
    };
    (0..=text.len())
        .filter(|i| text.is_char_boundary(*i))
        .any(|i| matches_pattern(&text[i..], rest))
}

/// A recording whose activity is known.
#[derive(Clone, Debug)]
pub struct LabelledRecording {
    /// Name in the report.
    pub name: String,
    /// Name of the activity.
    pub activity: String,
    /// The points, prepared for the model as `describe` prepares them.
    pub clip: PreparedClip<'static>,
}

/// A recording and what was stated about it.
#[derive(Clone, Debug, Serialize)]
pub struct RecordingRow {
    /// Name of the recording.
    pub recording: String,
    /// What was recorded.
    pub activity: String,
    /// Length, s.
    pub seconds: f64,
    /// The sentences with their times.
    pub segments: Vec<SegmentRow>,
    /// Whether the model gave no caption.
    pub abstained: bool,
    /// Share of the time in which its own activity is stated.
    pub own_share: f64,
    /// What the sentences state by the strict rule: an activity of the configuration or another action; `None` if no
    /// action covers half of the time.
    pub stated: Option<String>,
    /// Whether that is the recorded activity.
    pub right: bool,
    /// When it is right.
    pub judged: Judged,
    /// Whether the side is right, too, if the activity has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub side_right: Option<bool>,
}

/// A sentence and its time.
#[derive(Clone, Debug, Serialize)]
pub struct SegmentRow {
    /// Start, s.
    pub start_s: f64,
    /// End, s.
    pub end_s: f64,
    /// The sentence.
    pub caption: String,
    /// Actions that it states.
    pub actions: Vec<&'static str>,
    /// Confidence of the model, 0..=1.
    pub confidence: f32,
    /// The sentence of the model, where it was too uncertain to be stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guess: Option<String>,
    /// Whether the sentence alone, or the guess if there is one, states the recorded activity by the strict rule, and its
    /// side if it has one.
    pub right: bool,
    /// Name of the taught activity that was recognised, if it is not the model's own sentence.
    pub taught: Option<String>,
}

/// The recordings of one activity.
#[derive(Clone, Debug, Serialize)]
pub struct ActivityReport {
    /// Name of the activity.
    pub activity: String,
    /// Number of recordings.
    pub recordings: usize,
    /// Recordings without a caption.
    pub abstained: usize,
    /// Recordings described right.
    pub right: usize,
    /// Those among them whose side is right or that have none, if the activity has sides.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub with_side: Option<usize>,
    /// Recordings described as each activity, in the order of the configuration.
    pub confusion: Vec<usize>,
    /// Recordings described as another action.
    pub other: usize,
    /// Recordings of which no action covers half of the time.
    pub none: usize,
}

/// False alarms: falls that sentences state in recordings without a fall.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct FalseFalls {
    /// Sentences that state a fall.
    pub falls: usize,
    /// Length of the recordings without a fall, h.
    pub hours: f64,
}

/// A model on recordings of known activities.
#[derive(Clone, Debug, Serialize)]
pub struct RecordingsReport {
    /// Name of the model.
    pub model: String,
    /// Role of the recordings.
    pub role: Role,
    /// Height of the radar above the floor, m, if it is known.
    pub radar_height_m: Option<f32>,
    /// Number of recordings.
    pub recordings: usize,
    /// Recordings described right.
    pub right: usize,
    /// Recordings described right, and with the right side where they have one; `None` if no activity has sides.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub right_with_side: Option<usize>,
    /// False falls.
    pub false_falls: FalseFalls,
    /// Confidence of sentences against whether they are right.
    pub calibration: Option<Calibration>,
    /// By activity.
    pub activities: Vec<ActivityReport>,
    /// Every recording.
    pub rows: Vec<RecordingRow>,
}

/// Describes recordings one after the other, as `recordings` yields them, and scores by the strict rule what the
/// sentences state.
///
/// # Errors
/// Whatever `recordings` yields; simulated points; an error of `describe`.
pub fn evaluate_recordings<E: From<EvalError>>(
    describe: impl Fn(&PreparedClip) -> Result<Description, E>,
    model: &str,
    config: &RecordingsConfig,
    role: Role,
    recordings: impl IntoIterator<Item = Result<LabelledRecording, E>>,
) -> Result<RecordingsReport, E> {
    let mut rows = Vec::new();
    for recording in recordings {
        let recording = recording?;
        check_recorded(config, &recording.clip)?;
        let description = describe(&recording.clip)?;
        rows.push(described(config, &recording, &description));
    }
    Ok(report(model.into(), config, role, rows))
}

/// Refuses simulated points, unless the configuration is about them.
fn check_recorded(config: &RecordingsConfig, clip: &Clip) -> Result<(), EvalError> {
    match clip.provenance.is_simulated() && !config.simulated {
        true => Err(EvalError::Simulated(clip.provenance.input().into())),
        false => Ok(()),
    }
}

/// A recording and its description.
fn described(
    config: &RecordingsConfig,
    recording: &LabelledRecording,
    description: &Description,
) -> RecordingRow {
    let LabelledRecording {
        name,
        activity,
        clip,
    } = recording;
    let abstained = description.abstained.is_some();
    row(
        config,
        name,
        activity,
        clip.duration_s(),
        &description.segments,
        abstained,
    )
}

pub(crate) fn row(
    config: &RecordingsConfig,
    name: &str,
    activity: &str,
    seconds: f64,
    segments: &[Segment],
    abstained: bool,
) -> RecordingRow {
    let own = config.activity.iter().find(|a| a.name == activity);
    let judged = own.map_or(Judged::Mostly, |a| a.judged);
    let side = own.and_then(|a| Some((a, config.side_of(a, name)?)));
    let mut whole = StatedTime::default();
    let segments = segments.iter().map(|segment| {
        whole.add(&segment.caption, segment.end_s - segment.start_s);
        let mut alone = StatedTime::default();
        alone.add(segment.guess.as_ref().unwrap_or(&segment.caption), 1.0);
        let is_own = match judged {
            Judged::Mostly => alone.stated(&config.activity, 1.0).as_deref() == Some(activity),
            Judged::Event | Judged::Never => own.is_some_and(|a| alone.of(a) > 0.0),
        };
        SegmentRow {
            start_s: segment.start_s,
            end_s: segment.end_s,
            caption: segment.caption.clone(),
            actions: segment.actions.clone(),
            confidence: segment.confidence,
            taught: segment.taught.clone(),
            guess: segment.guess.clone(),
            right: match judged {
                Judged::Never => !is_own,
                _ => is_own && side.is_none_or(|(a, side)| alone.has_side(a, side)),
            },
        }
    });
    let segments = segments.collect();
    let stated = whole.stated(&config.activity, seconds);
    let is_stated = own.is_some_and(|a| whole.of(a) > 0.0);
    let right = match judged {
        Judged::Mostly => stated.as_deref() == Some(activity),
        Judged::Event => is_stated,
        Judged::Never => !is_stated,
    };
    RecordingRow {
        recording: name.into(),
        activity: activity.into(),
        seconds,
        segments,
        abstained,
        own_share: own.map_or(0.0, |a| whole.of(a) / seconds.max(f64::MIN_POSITIVE)),
        side_right: side.map(|(a, side)| right && whole.has_side(a, side)),
        right,
        judged,
        stated,
    }
}

fn report(
    model: String,
    config: &RecordingsConfig,
    role: Role,
    rows: Vec<RecordingRow>,
) -> RecordingsReport {
    let of_activity = |activity: &Activity| {
        let own = || rows.iter().filter(|r| r.activity == activity.name);
        let stated_as = |name: &str| own().filter(|r| r.stated.as_deref() == Some(name)).count();
        let confusion: Vec<usize> = config.activity.iter().map(|a| stated_as(&a.name)).collect();
        let none = own().filter(|r| r.stated.is_none()).count();
        ActivityReport {
            activity: activity.name.clone(),
            recordings: own().count(),
            abstained: own().filter(|r| r.abstained).count(),
            right: own().filter(|r| r.right).count(),
            with_side: (!activity.sides.is_empty()).then(|| {
                own()
                    .filter(|r| r.right && r.side_right != Some(false))
                    .count()
            }),
            other: own().count() - none - confusion.iter().sum::<usize>(),
            confusion,
            none,
        }
    };
    let activities: Vec<ActivityReport> = config.activity.iter().map(of_activity).collect();
    let has_sides = activities.iter().any(|a| a.with_side.is_some());
    let with_side = activities.iter().map(|a| a.with_side.unwrap_or(a.right));
    let segments: Vec<(f64, bool)> = rows
        .iter()
        .flat_map(|r| &r.segments)
        .map(|s| (f64::from(s.confidence), s.right))
        .collect();
    RecordingsReport {
        model,
        role,
        radar_height_m: config.radar_height_m,
        recordings: rows.len(),
        right: activities.iter().map(|a| a.right).sum(),
        right_with_side: has_sides.then(|| with_side.sum()),
        false_falls: false_falls(config, &rows),
        calibration: Calibration::of(&segments),
        activities,
        rows,
    }
}

fn false_falls(config: &RecordingsConfig, rows: &[RecordingRow]) -> FalseFalls {
    let is_fall = |row: &&RecordingRow| {
        let own = config.activity.iter().find(|a| a.name == row.activity);
        own.is_some_and(|a| a.actions.iter().any(|action| action == "fall"))
    };
    let mut counts = FalseFalls::default();
    for row in rows.iter().filter(|row| !is_fall(row)) {
        counts.hours += row.seconds / 3600.0;
        counts.falls += row
            .segments
            .iter()
            .filter(|s| s.actions.contains(&"fall"))
            .count();
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: &str = r#"
        radar_height_m = 1.0
        [roles]
        tuning = ["*/20_*", "subject1/*"]
        [[activity]]
        name = "jack"
        actions = ["jumping_jack"]
        [[activity]]
        name = "walk"
        actions = ["walk", "circle"]
        [[activity]]
        name = "squat"
        actions = ["squat"]
        files = ["*/radar_data6.mat"]
    "#;

    fn config() -> RecordingsConfig {
        RecordingsConfig::from_toml(CONFIG).unwrap()
    }

    #[test]
    fn paths_decide_activity_and_role() {
        let config = config();
        let activity = |path: &str| config.activity_of(path).map(|a| a.name.as_str());
        assert_eq!(activity("jack/20_jack_1.txt"), Some("jack"));
        assert_eq!(activity("jacks/20_jack_1.txt"), None);
        assert_eq!(activity("subject2/radar_data6.mat"), Some("squat"));
        assert_eq!(activity("subject2/radar_data16.mat"), None);
        assert_eq!(config.role_of("jack/20_jack_1.txt"), Role::Tuning);
        assert_eq!(config.role_of("jack/_jack_20_1.txt"), Role::Judged);
        assert_eq!(config.role_of("subject1/radar_data6.mat"), Role::Tuning);
    }

    #[test]
    fn unknown_actions_are_refused() {
        let wrong = CONFIG.replace("\"squat\"]", "\"sqat\"]");
        let error = RecordingsConfig::from_toml(&wrong).unwrap_err().to_string();
        assert!(error.contains("no action `sqat`"), "{error}");
    }

    fn segment(start_s: f64, end_s: f64, caption: &str) -> Segment {
        let clauses = radarllm_facts::parse(caption);
        Segment {
            start_s,
            end_s,
            caption: caption.into(),
            actions: clauses
                .iter()
                .flat_map(|c| &c.actions)
                .map(|a| a.name)
                .collect(),
            confidence: 0.5,
            side_confidence: None,
            taught: None,
            guess: None,
        }
    }

    #[test]
    fn sides_are_counted_beside_actions() {
        let text = CONFIG.replace(
            "actions = [\"walk\", \"circle\"]",
            "actions = [\"walk\", \"circle\"]\nsides = { left = [\"*left*\"] }",
        );
        let config = RecordingsConfig::from_toml(&text).unwrap();
        let row = |activity: &str, name: &str, caption: &str| {
            let segments = [segment(0.0, 1.0, caption)];
            super::row(&config, name, activity, 1.0, &segments, false)
        };
        let rows = vec![
            row(
                "walk",
                "walk-left/1",
                "a person walks in a circle to the left",
            ),
            row(
                "walk",
                "walk-left/2",
                "a person walks in a circle to the right",
            ),
            row("walk", "walk-left/3", "a person walks"),
            row("walk", "walk/4", "a person walks"),
            row("squat", "left/5", "a person walks to the left"),
        ];
        let sides: Vec<Option<bool>> = rows.iter().map(|r| r.side_right).collect();
        assert_eq!(sides, [Some(true), Some(false), Some(false), None, None]);
        let report = report(String::new(), &config, Role::Tuning, rows);
        assert_eq!((report.right, report.right_with_side), (4, Some(2)));
        let page = markdown(&report, None, "c.toml");
        assert!(
            page.contains("2 (40.0 %) are described with the right side"),
            "{page}"
        );
    }

    #[test]
    fn counts_add_up() {
        let config = config();
        let row = |activity: &str, segments: &[Segment]| {
            super::row(&config, "x", activity, 10.0, segments, segments.is_empty())
        };
        let rows = vec![
            row("jack", &[segment(0.0, 10.0, "a person does jumping jacks")]),
            row(
                "jack",
                &[segment(0.0, 10.0, "a person walks, then falls forward")],
            ),
            row(
                "walk",
                &[
                    segment(0.0, 5.0, "a person walks"),
                    segment(5.0, 10.0, "a person bows"),
                ],
            ),
            row("walk", &[segment(0.0, 9.0, "a person bows")]),
            row("walk", &[]),
        ];
        let report = report(String::new(), &config, Role::Tuning, rows);
        assert_eq!((report.right, report.recordings), (1, 5));
        let [jack, walk, _] = &report.activities[..] else {
            panic!()
        };
        assert_eq!((jack.right, jack.none, jack.other), (1, 1, 0));
        // Half and half is a tie, and no answer.
        assert_eq!(
            (walk.right, walk.none, walk.other, walk.abstained),
            (0, 2, 1, 1)
        );
        assert_eq!(report.false_falls.falls, 1);
        assert!((report.false_falls.hours - 50.0 / 3600.0).abs() < 1e-9);
        let page = markdown(&report, None, "c.toml");
        assert!(page.contains("1 of 5 recordings (20.0 %)"), "{page}");
    }
}
