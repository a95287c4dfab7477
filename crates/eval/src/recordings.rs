//! Do captions of recorded radar name the recorded activity?
//!
//! The activity of a recording is known, its reference captions are not. Words of the caption decide: every activity has
//! a list of phrases that name it.

use radarllm_base::{Clip, seed::derive_seed};
use radarllm_inference::Captioner;
use serde::{Deserialize, Serialize};

use crate::{EvalError, captioner::caption_clips, table::Table};

/// Captions shown in the text form of a report.
const N_SHOWN: usize = 20;

/// The configuration file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingsConfig {
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
    /// What is done in the recordings.
    pub activity: Vec<Activity>,
}

/// An activity and the words that name it.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Activity {
    /// Name, also of the folder with its recordings.
    pub name: String,
    /// Phrases that name it.
    pub words: Vec<String>,
}

impl RecordingsConfig {
    /// Reads a configuration (TOML).
    ///
    /// # Errors
    /// TOML errors with their place; a configuration without activities.
    pub fn from_toml(text: &str) -> Result<Self, EvalError> {
        let config: Self = toml::from_str(text).map_err(|e| EvalError::Config(e.to_string()))?;
        if config.activity.is_empty() {
            return Err(EvalError::Config("no [[activity]]".into()));
        }
        Ok(config)
    }
}

/// A recording whose activity is known.
#[derive(Clone, Debug)]
pub struct LabelledRecording {
    /// Name in the report.
    pub name: String,
    /// Name of the activity.
    pub activity: String,
    /// The points, prepared for the model.
    pub clip: Clip,
}

/// A recording and its caption.
#[derive(Clone, Debug, Serialize)]
pub struct RecordingRow {
    /// Name of the recording.
    pub recording: String,
    /// What was recorded.
    pub activity: String,
    /// Caption of the model.
    pub caption: String,
    /// Confidence of the model, 0..=1.
    pub confidence: f32,
    /// Whether the model gave no caption.
    pub abstained: bool,
    /// Activities that the caption names.
    pub named: Vec<String>,
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
    /// Captions that name it, whatever else they name.
    pub named: usize,
    /// Captions that name it and no other activity.
    pub named_alone: usize,
    /// Captions of recordings of *other* activities that name this one: false positives.
    pub named_elsewhere: usize,
    /// Captions that name each activity, in the order of the configuration; a caption can name several.
    pub confusion: Vec<usize>,
    /// Captions that name no activity.
    pub none: usize,
}

/// A model on recordings of known activities.
#[derive(Clone, Debug, Serialize)]
pub struct RecordingsReport {
    /// Name of the model.
    pub model: String,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f32,
    /// Number of recordings.
    pub recordings: usize,
    /// Captions that name the recorded activity.
    pub named: usize,
    /// By activity.
    pub activities: Vec<ActivityReport>,
    /// Every recording.
    pub sentences: Vec<RecordingRow>,
}

/// Captions recordings one after the other, as `recordings` yields them, and counts which activities the captions
/// name. `beam` 1 is greedy.
///
/// # Errors
/// Whatever `recordings` yields; simulated points; a clip that the model refuses.
pub fn evaluate_recordings<E: From<EvalError>>(
    captioner: &Captioner,
    model: &str,
    config: &RecordingsConfig,
    beam: usize,
    recordings: impl IntoIterator<Item = Result<LabelledRecording, E>>,
) -> Result<RecordingsReport, E> {
    let mut rows = Vec::new();
    for recording in recordings {
        let LabelledRecording {
            name,
            activity,
            clip,
        } = recording?;
        if clip.provenance.is_simulated() {
            return Err(EvalError::Simulated(clip.provenance.input().into()).into());
        }
        for description in caption_clips(captioner, &[&clip], beam)? {
            rows.push(RecordingRow {
                recording: name.clone(),
                activity: activity.clone(),
                named: named_activities(&description.caption, &config.activity),
                caption: description.caption,
                confidence: description.confidence,
                abstained: description.abstained.is_some(),
            });
        }
    }
    Ok(report(model.into(), config, rows))
}

/// Activities whose phrases occur at the beginning of words in the caption. Longer phrases are matched first, and
/// matched words are not matched again.
fn named_activities(caption: &str, activities: &[Activity]) -> Vec<String> {
    let mut phrases: Vec<(&str, &str)> = activities
        .iter()
        .flat_map(|a| a.words.iter().map(|w| (w.as_str(), a.name.as_str())))
        .collect();
    phrases.sort_by_key(|(phrase, _)| std::cmp::Reverse(phrase.len()));
    let mut rest = format!(" {}", caption.to_lowercase());
    let mut found = Vec::new();
    for (phrase, activity) in phrases {
        let start = format!(" {}", phrase.to_lowercase());
        if rest.contains(&start) {
            rest = rest.replace(&start, " #");
            found.push(activity);
        }
    }
    // In the order of the configuration, once each.
    let order = activities
        .iter()
        .filter(|a| found.contains(&a.name.as_str()));
    order.map(|a| a.name.clone()).collect()
}

fn report(model: String, config: &RecordingsConfig, rows: Vec<RecordingRow>) -> RecordingsReport {
    let of_activity = |activity: &Activity| {
        let own: Vec<&RecordingRow> = rows
            .iter()
            .filter(|r| r.activity == activity.name)
            .collect();
        let count = |of: &dyn Fn(&RecordingRow) -> bool| own.iter().filter(|r| of(r)).count();
        let names = |row: &RecordingRow| row.named.contains(&activity.name);
        ActivityReport {
            activity: activity.name.clone(),
            recordings: own.len(),
            abstained: count(&|r| r.abstained),
            named: count(&names),
            named_alone: count(&|r| names(r) && r.named.len() == 1),
            named_elsewhere: rows
                .iter()
                .filter(|r| r.activity != activity.name && names(r))
                .count(),
            confusion: config
                .activity
                .iter()
                .map(|other| count(&|r| r.named.contains(&other.name)))
                .collect(),
            none: count(&|r| r.named.is_empty()),
        }
    };
    let activities: Vec<ActivityReport> = config.activity.iter().map(of_activity).collect();
    RecordingsReport {
        model,
        radar_height_m: config.radar_height_m,
        recordings: rows.len(),
        named: activities.iter().map(|a| a.named).sum(),
        activities,
        sentences: rows,
    }
}

/// The report as Markdown; `config` names the configuration.
pub fn markdown(report: &RecordingsReport, beam: usize, config: &str) -> String {
    let percent = |part: usize, whole: usize| 100.0 * part as f64 / whole.max(1) as f64;
    let mut counts = Table::new(
        "",
        "",
        &[
            "activity",
            "recordings",
            "without caption",
            "caption names it",
            "caption names it alone",
            "captions of other activities that name it",
        ],
    );
    for a in &report.activities {
        let others = report.recordings - a.recordings;
        counts.rows.push(vec![
            a.activity.clone(),
            a.recordings.to_string(),
            a.abstained.to_string(),
            format!("{} ({:.1} %)", a.named, percent(a.named, a.recordings)),
            a.named_alone.to_string(),
            format!(
                "{} of {others} ({:.1} %)",
                a.named_elsewhere,
                percent(a.named_elsewhere, others)
            ),
        ]);
    }
    let mut head = vec![""];
    head.extend(report.activities.iter().map(|a| a.activity.as_str()));
    head.push("none of them");
    let mut confusion = Table::new("", "", &head);
    for a in &report.activities {
        let mut row = vec![a.activity.clone()];
        row.extend(a.confusion.iter().map(usize::to_string));
        row.push(a.none.to_string());
        confusion.rows.push(row);
    }
    // The same sample for every model: by a hash of the name, not by the caption.
    let mut drawn: Vec<&RecordingRow> = report.sentences.iter().collect();
    drawn.sort_by_key(|r| derive_seed(1, &r.recording));
    drawn.truncate(N_SHOWN);
    let mut captions = Table::new("", "", &["recording", "caption", "confidence"]);
    for row in &drawn {
        captions.rows.push(vec![
            row.recording.clone(),
            row.caption.clone(),
            format!("{:.2}", row.confidence),
        ]);
    }
    format!(
        "Model {}, beam {beam}, configuration {config}, radar {} m above the floor. **{} of {} captions ({:.1} %) name the \
         recorded activity.** A caption names an activity if one of its words or phrases in the configuration occurs in \
         it.\n\n{}\n\
         Recorded activity (row) and activities that captions name (column); a caption can name several:\n\n{}\n\
         {} captions, sampled by the names of the recordings:\n\n{}",
        report.model,
        report.radar_height_m,
        report.named,
        report.recordings,
        percent(report.named, report.recordings),
        counts.to_markdown(),
        confusion.to_markdown(),
        drawn.len(),
        captions.to_markdown()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn activities() -> Vec<Activity> {
        [
            ("jack", vec!["jumping jack", "star jump"]),
            ("jump", vec!["jump"]),
            ("walk", vec!["walk"]),
        ]
        .into_iter()
        .map(|(name, words)| Activity {
            name: name.into(),
            words: words.into_iter().map(String::from).collect(),
        })
        .collect()
    }

    #[test]
    fn phrases_name_activities_and_are_matched_once() {
        let names = |caption: &str| named_activities(caption, &activities());
        assert_eq!(names("a person performs jumping jacks"), ["jack"]);
        assert_eq!(
            names("A person jumps up, then is walking"),
            ["jump", "walk"]
        );
        assert_eq!(names("star jumps, then jumps"), ["jack", "jump"]);
        assert!(names("a person stands on the sidewalk").is_empty());
        assert!(names("no person seen").is_empty());
    }

    #[test]
    fn counts_add_up() {
        let config = RecordingsConfig {
            radar_height_m: 1.0,
            activity: activities(),
        };
        let row = |activity: &str, caption: &str| RecordingRow {
            recording: "x".into(),
            activity: activity.into(),
            caption: caption.into(),
            confidence: 0.5,
            abstained: false,
            named: named_activities(caption, &config.activity),
        };
        let rows = vec![
            row("jack", "jumping jacks"),
            row("jack", "jumps, then walks"),
            row("walk", "walks"),
            row("walk", "stands"),
        ];
        let report = report(String::new(), &config, rows);
        assert_eq!((report.named, report.recordings), (2, 4));
        let jack = &report.activities[0];
        assert_eq!((jack.named, jack.named_alone, jack.none), (1, 1, 0));
        assert_eq!(jack.confusion, [1, 1, 1]);
        let walk = &report.activities[2];
        assert_eq!((walk.named, walk.named_elsewhere, walk.none), (1, 1, 1));
        let page = markdown(&report, 1, "c.toml");
        assert!(page.contains("**2 of 4 captions (50.0 %)"), "{page}");
        assert!(page.contains("| walk | 0 | 0 | 1 | 1 |"), "{page}");
    }
}
