//! `eval-recordings`: do sentences about recorded radar name what was done?

use std::{fs, path::Path};

use radarllm_base::seed::derive_seed;
use serde::{Deserialize, Serialize};

use crate::{
    args::EvalRecordingsArgs,
    commands::describe,
    error::{CliError, CliResult},
    files::{self, MAX_CONFIG_BYTES},
    input::ClipOptions,
    output,
};

/// Sentences shown on the page.
const SHOWN: usize = 20;

/// The configuration.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Config {
    radar_height_m: f32,
    activity: Vec<Activity>,
}

/// A folder of recordings and the words that name what was done.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Activity {
    name: String,
    words: Vec<String>,
}

#[derive(Serialize)]
struct Row {
    recording: String,
    activity: String,
    caption: String,
    confidence: f32,
    abstained: bool,
    /// Activities that the sentence names.
    named: Vec<String>,
}

#[derive(Serialize)]
struct ActivityReport {
    activity: String,
    recordings: usize,
    abstained: usize,
    /// Sentences that name it, whatever else they name.
    named: usize,
    /// Sentences that name it and nothing else of the list.
    named_alone: usize,
    /// Sentences about the *other* activities that name this one: what naming it says nothing about.
    named_elsewhere: usize,
    /// Sentences that name each activity, in the order of the list; one can name several.
    confusion: Vec<usize>,
    /// Sentences that name none of them.
    none: usize,
}

#[derive(Serialize)]
struct Report {
    model: String,
    radar_height_m: f32,
    recordings: usize,
    named: usize,
    activities: Vec<ActivityReport>,
    sentences: Vec<Row>,
}

/// Runs the verb.
pub fn run(args: &EvalRecordingsArgs) -> CliResult {
    if let Some(out) = &args.out {
        output::check_free(out, args.force)?;
    }
    let text = files::read_text(&args.config, MAX_CONFIG_BYTES)?;
    let wrong = |e: String| CliError::new(format!("{}: {e}", args.config.display()));
    let config: Config = toml::from_str(&text).map_err(|e| wrong(e.to_string()))?;
    if config.activity.is_empty() {
        return Err(wrong("no [[activity]]".into()));
    }
    let captioner = describe::load_captioner(args.model.as_deref())?;
    let model = describe::model_name(args.model.as_deref());
    let options = ClipOptions {
        radar: args.radar.as_deref(),
        format: args.format.as_deref(),
        recording: &args.recording,
        radar_height_m: config.radar_height_m,
        distance_m: 3.0,
        seed: 1,
    };
    let mut rows = Vec::new();
    for activity in &config.activity {
        for file in files(&args.recordings.join(&activity.name))? {
            let name = file.display().to_string();
            let clip = describe::heard(&name, &options)?;
            if clip.provenance.synthetic {
                return Err(CliError::new(format!("{name}: simulated, not recorded")));
            }
            let row = describe::describe(&captioner, &clip, model.clone(), args.beam)?;
            rows.push(Row {
                named: named(&row.caption, &config.activity),
                recording: format!(
                    "{}/{}",
                    activity.name,
                    file.file_name().unwrap_or_default().to_string_lossy()
                ),
                activity: activity.name.clone(),
                caption: row.caption,
                confidence: row.confidence,
                abstained: row.reason.is_some(),
            });
        }
    }
    let report = report(model, &config, rows);
    let page = page(&report, args);
    if let Some(out) = &args.out {
        output::write_atomic(out, page.as_bytes())?;
    }
    if args.json {
        return output::print_json(&report);
    }
    output::print_line(&page);
    Ok(())
}

fn files(folder: &Path) -> CliResult<Vec<std::path::PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(|e| CliError::io(folder, e))? {
        let path = entry.map_err(|e| CliError::io(folder, e))?.path();
        if path.is_file() {
            files.push(path);
        }
    }
    files.sort();
    if files.is_empty() {
        return Err(CliError::new(format!(
            "{}: no recordings",
            folder.display()
        )));
    }
    Ok(files)
}

/// Activities whose words stand at the beginning of words in the sentence. Longer phrases come first, and what they match
/// is used up.
fn named(caption: &str, activities: &[Activity]) -> Vec<String> {
    let mut phrases: Vec<(&str, &str)> = activities
        .iter()
        .flat_map(|a| a.words.iter().map(|w| (w.as_str(), a.name.as_str())))
        .collect();
    phrases.sort_by_key(|(phrase, _)| std::cmp::Reverse(phrase.len()));
    let mut left = format!(" {}", caption.to_lowercase());
    let mut found = Vec::new();
    for (phrase, activity) in phrases {
        let start = format!(" {}", phrase.to_lowercase());
        if left.contains(&start) {
            left = left.replace(&start, " #");
            found.push(activity);
        }
    }
    // In the order of the list, once each.
    let order = activities
        .iter()
        .filter(|a| found.contains(&a.name.as_str()));
    order.map(|a| a.name.clone()).collect()
}

fn report(model: String, config: &Config, rows: Vec<Row>) -> Report {
    let activities: Vec<ActivityReport> = config
        .activity
        .iter()
        .map(|activity| {
            let own: Vec<&Row> = rows
                .iter()
                .filter(|r| r.activity == activity.name)
                .collect();
            let names = |row: &&&Row| row.named.contains(&activity.name);
            ActivityReport {
                activity: activity.name.clone(),
                recordings: own.len(),
                abstained: own.iter().filter(|r| r.abstained).count(),
                named: own.iter().filter(names).count(),
                named_alone: own
                    .iter()
                    .filter(names)
                    .filter(|r| r.named.len() == 1)
                    .count(),
                named_elsewhere: rows
                    .iter()
                    .filter(|r| r.activity != activity.name && r.named.contains(&activity.name))
                    .count(),
                confusion: config
                    .activity
                    .iter()
                    .map(|other| own.iter().filter(|r| r.named.contains(&other.name)).count())
                    .collect(),
                none: own.iter().filter(|r| r.named.is_empty()).count(),
            }
        })
        .collect();
    Report {
        model,
        radar_height_m: config.radar_height_m,
        recordings: rows.len(),
        named: activities.iter().map(|a| a.named).sum(),
        activities,
        sentences: rows,
    }
}

fn page(report: &Report, args: &EvalRecordingsArgs) -> String {
    let percent = |part: usize, whole: usize| 100.0 * part as f64 / whole.max(1) as f64;
    let mut page = format!(
        "Model {}, beam {}, configuration {}, radar {} m above the floor. **{} of {} sentences ({:.1} %) name the \
         recorded activity.**\n\n\
         | activity | recordings | said nothing | name it | name only it | sentences about the others that name it |\n\
         |---|---|---|---|---|---|\n",
        report.model,
        args.beam,
        args.config.display(),
        report.radar_height_m,
        report.named,
        report.recordings,
        percent(report.named, report.recordings)
    );
    for a in &report.activities {
        let others = report.recordings - a.recordings;
        page += &format!(
            "| {} | {} | {} | {} ({:.1} %) | {} | {} of {others} ({:.1} %) |\n",
            a.activity,
            a.recordings,
            a.abstained,
            a.named,
            percent(a.named, a.recordings),
            a.named_alone,
            a.named_elsewhere,
            percent(a.named_elsewhere, others)
        );
    }
    let names: Vec<&str> = report
        .activities
        .iter()
        .map(|a| a.activity.as_str())
        .collect();
    page += &format!(
        "\nRecorded (row) and named (column); a sentence can name several:\n\n| | {} | none of them |\n|{}\n",
        names.join(" | "),
        "---|".repeat(names.len() + 2)
    );
    for a in &report.activities {
        let cells: Vec<String> = a.confusion.iter().map(usize::to_string).collect();
        page += &format!("| {} | {} | {} |\n", a.activity, cells.join(" | "), a.none);
    }
    page += "\nTwenty sentences, drawn by the recordings' names:\n\n| recording | sentence | confidence |\n|---|---|---|\n";
    // The same draw for every model: by a hash of the name, not by what was said.
    let mut drawn: Vec<&Row> = report.sentences.iter().collect();
    drawn.sort_by_key(|r| derive_seed(1, &r.recording));
    for row in drawn.into_iter().take(SHOWN) {
        page += &format!(
            "| {} | {} | {:.2} |\n",
            row.recording, row.caption, row.confidence
        );
    }
    page
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
    fn phrases_name_activities_and_use_words_up() {
        let names = |caption: &str| named(caption, &activities());
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
        let config = Config {
            radar_height_m: 1.0,
            activity: activities(),
        };
        let row = |activity: &str, caption: &str| Row {
            recording: "x".into(),
            activity: activity.into(),
            caption: caption.into(),
            confidence: 0.5,
            abstained: false,
            named: named(caption, &config.activity),
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
    }
}
