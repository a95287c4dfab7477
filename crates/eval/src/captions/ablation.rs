//! Tables of an ablation: which part of the model contributes how much?
//!
//! A grid lists changes of a training recipe. Every changed recipe is trained once with each seed and evaluated; a row
//! shows mean and standard deviation over the seeds, beside published values. Training is the caller's part, so that
//! this crate needs no learning framework.

use std::{collections::BTreeMap, fmt::Write as _, path::PathBuf};

use radarllm_dataset::Split;
use serde::{Deserialize, Serialize};
use toml::Table;

use super::{split_of, test_split};
use crate::EvalError;

/// Metrics a table may show: key in the reports of `eval`, heading, factor in print.
pub(crate) const METRICS: [(&str, &str, f64); 9] = [
    ("rouge_1", "ROUGE-1", 100.0),
    ("rouge_l", "ROUGE-L", 100.0),
    ("bleu_1", "BLEU-1", 100.0),
    ("bleu_4", "BLEU-4", 100.0),
    ("meteor", "METEOR", 100.0),
    ("cider_d", "CIDEr-D", 1.0),
    ("self_bleu", "Self-BLEU", 100.0),
    ("bert_score", "BERTScore", 100.0),
    ("action_accuracy", "action accuracy", 100.0),
];

/// The file of a grid (TOML).
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    /// Recipe that every row changes, relative to this file.
    pub base: PathBuf,
    /// Folder for everything, relative to this file.
    pub out: PathBuf,
    /// Split to evaluate on.
    #[serde(default = "test_split", deserialize_with = "split_of")]
    pub split: Split,
    /// Every row is trained once with each.
    pub seeds: Vec<u64>,
    /// Changes to the base recipe for all rows: dotted key to value.
    #[serde(default)]
    pub common: Table,
    /// Tables.
    #[serde(rename = "table")]
    pub tables: Vec<GridTable>,
}

/// One table of the grid.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GridTable {
    /// Heading.
    pub title: String,
    /// Keys of metrics, as in `reported`.
    pub columns: Vec<String>,
    /// Rows.
    #[serde(rename = "row")]
    pub rows: Vec<GridRow>,
}

/// One row: a changed recipe.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GridRow {
    /// What the row is called.
    pub name: String,
    /// Changes to the common recipe: dotted key to value.
    #[serde(default)]
    pub set: Table,
    /// Dotted keys of the common recipe that this row leaves at their defaults.
    #[serde(default)]
    pub unset: Vec<String>,
    /// False leaves instruction tuning out.
    #[serde(default = "yes")]
    pub instruct: bool,
    /// Published values, as printed there.
    #[serde(default)]
    pub reported: BTreeMap<String, f64>,
    /// Why some of them are doubtful: printed below the table, and a mark beside the value.
    #[serde(default)]
    pub doubted: BTreeMap<String, String>,
}

fn yes() -> bool {
    true
}

impl Grid {
    /// Reads a grid.
    ///
    /// # Errors
    /// TOML errors with their place; a grid without seeds or rows, or with two of the same; unknown metrics.
    pub fn from_toml(text: &str) -> Result<Self, EvalError> {
        let grid: Self = toml::from_str(text).map_err(|e| EvalError::Config(e.to_string()))?;
        check(&grid).map_err(EvalError::Config)?;
        Ok(grid)
    }
}

fn check(grid: &Grid) -> Result<(), String> {
    if grid.seeds.is_empty() {
        return Err("seeds: at least one is needed".into());
    }
    if let Some(seed) = repeated(&grid.seeds) {
        return Err(format!("seeds: {seed} occurs twice"));
    }
    if grid.tables.iter().all(|table| table.rows.is_empty()) {
        return Err("no table has a row".into());
    }
    for table in &grid.tables {
        let names: Vec<&str> = table.rows.iter().map(|row| row.name.as_str()).collect();
        if let Some(name) = repeated(&names) {
            return Err(format!(
                "table `{}`: two rows have the name `{name}`",
                table.title
            ));
        }
        let known = |key: &String| METRICS.iter().any(|m| m.0 == key);
        let reported = table.rows.iter().flat_map(|row| row.reported.keys());
        for row in &table.rows {
            if let Some(key) = row.doubted.keys().find(|k| !row.reported.contains_key(*k)) {
                return Err(format!(
                    "row `{}`: {key} is doubted, but not reported",
                    row.name
                ));
            }
        }
        if let Some(key) = table.columns.iter().chain(reported).find(|k| !known(k)) {
            let names: Vec<&str> = METRICS.iter().map(|m| m.0).collect();
            return Err(format!("{key}: unknown; columns are {}", names.join(", ")));
        }
    }
    Ok(())
}

/// The first value that occurs before.
fn repeated<T: PartialEq>(values: &[T]) -> Option<&T> {
    let mut all = values.iter().enumerate();
    let found = all.find(|(index, value)| values[..*index].contains(value));
    found.map(|(_, value)| value)
}

/// A value over the seeds.
#[derive(Clone, Debug, Serialize)]
pub struct Spread {
    /// Mean over the seeds.
    pub mean: f64,
    /// Standard deviation of the sample; none of a single seed.
    pub deviation: Option<f64>,
}

/// One row: our values beside the published ones.
#[derive(Clone, Debug, Serialize)]
pub struct RowReport {
    /// Name of the row.
    pub name: String,
    /// Seeds of the trainings.
    pub seeds: Vec<u64>,
    /// Our values by metric; `None` where a metric was not computed.
    pub ours: BTreeMap<String, Option<Spread>>,
    /// Published values.
    pub reported: BTreeMap<String, f64>,
    /// Why published values are doubtful.
    pub doubted: BTreeMap<String, String>,
}

/// One table.
#[derive(Clone, Debug, Serialize)]
pub struct TableReport {
    /// Heading.
    pub title: String,
    /// Metrics.
    pub columns: Vec<String>,
    /// Rows.
    pub rows: Vec<RowReport>,
}

impl GridTable {
    /// The table with our values: `metric(row, seed, key)` is a metric of a training, by the index of row and seed;
    /// `None` where it was not computed.
    pub fn report(
        &self,
        seeds: &[u64],
        metric: impl Fn(usize, usize, &str) -> Option<f64>,
    ) -> TableReport {
        let rows = self.rows.iter().enumerate().map(|(row, about)| {
            let ours = self.columns.iter().map(|key| {
                let values: Option<Vec<f64>> = (0..seeds.len())
                    .map(|seed| metric(row, seed, key))
                    .collect();
                (key.clone(), values.and_then(|v| spread(&v)))
            });
            RowReport {
                name: about.name.clone(),
                seeds: seeds.to_vec(),
                ours: ours.collect(),
                reported: about.reported.clone(),
                doubted: about.doubted.clone(),
            }
        });
        TableReport {
            title: self.title.clone(),
            columns: self.columns.clone(),
            rows: rows.collect(),
        }
    }
}

/// Mean and deviation; `None` without values.
pub fn spread(values: &[f64]) -> Option<Spread> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (!values.is_empty()).then(|| Spread {
        mean,
        deviation: (values.len() > 1).then(|| (squares / (n - 1.0)).sqrt()),
    })
}

/// All tables as Markdown.
///
/// # Errors
/// None in practice: text is written into memory.
pub fn markdown(grid: &Grid, tables: &[TableReport]) -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    writeln!(
        text,
        "Split `{}`, protocol `plain`, greedy; values x100 (CIDEr-D in its own scale); seeds {:?}, mean and standard \
         deviation over them. *reported*: the paper's figure, on other data at another size.",
        grid.split, grid.seeds
    )?;
    for table in tables {
        let shown: Vec<(&str, &str, f64)> = METRICS
            .into_iter()
            .filter(|m| table.columns.iter().any(|c| c == m.0))
            .collect();
        writeln!(text, "\n## {}\n", table.title)?;
        write!(text, "| |")?;
        for (_, heading, _) in &shown {
            write!(text, " {heading} | *reported* |")?;
        }
        writeln!(text, "\n|---|{}", "---|---|".repeat(shown.len()))?;
        for row in &table.rows {
            write!(text, "| {} |", row.name)?;
            for (key, _, factor) in &shown {
                match row.ours.get(*key).and_then(Option::as_ref) {
                    None => write!(text, " not run |")?,
                    Some(Spread { mean, deviation }) => {
                        let digits = if *factor == 1.0 { 3 } else { 1 };
                        write!(text, " {:.digits$}", mean * factor)?;
                        if let Some(deviation) = deviation {
                            write!(text, " +- {:.digits$}", deviation * factor)?;
                        }
                        write!(text, " |")?;
                    }
                }
                match (row.reported.get(*key), row.doubted.get(*key)) {
                    (Some(value), None) => write!(text, " *{value}* |")?,
                    (Some(value), Some(_)) => write!(text, " *{value}* (?) |")?,
                    (None, _) => write!(text, " |")?,
                }
            }
            writeln!(text)?;
        }
        let mut reasons: BTreeMap<&str, Vec<String>> = BTreeMap::new();
        for row in &table.rows {
            for (key, heading, _) in &shown {
                if let Some(reason) = row.doubted.get(*key) {
                    let place = format!("{}, {heading}", row.name);
                    reasons.entry(reason).or_default().push(place);
                }
            }
        }
        for (reason, places) in reasons {
            writeln!(text, "\n(?) {}: {reason}", places.join("; "))?;
        }
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: &str = r#"
base = "model.toml"
out = "grid"
seeds = [1, 2]
common = { "tokenizer.loop.max_steps" = 3 }

[[table]]
title = "Parts"
columns = ["bleu_1", "meteor"]

[[table.row]]
name = "whole"
reported = { bleu_1 = 48.0, meteor = 33.7 }
doubted = { meteor = "differs elsewhere." }
"#;

    #[test]
    fn tables_show_what_was_run_and_what_was_reported() {
        let grid = Grid::from_toml(GRID).unwrap();
        let metric = |row: usize, seed: usize, key: &str| {
            assert_eq!(row, 0);
            (key == "bleu_1").then_some([0.4, 0.6][seed])
        };
        let table = grid.tables[0].report(&grid.seeds, metric);
        let s = table.rows[0].ours["bleu_1"].clone().unwrap();
        assert!((s.mean - 0.5).abs() < 1e-12);
        assert!((s.deviation.unwrap() - 0.02_f64.sqrt()).abs() < 1e-12);
        let text = markdown(&grid, &[table]).unwrap();
        assert!(
            text.contains("| whole | 50.0 +- 14.1 | *48* | not run | *33.7* (?) |"),
            "{text}"
        );
        assert!(
            text.ends_with("\n(?) whole, METEOR: differs elsewhere.\n"),
            "{text}"
        );
    }

    #[test]
    fn mistakes_in_a_grid_are_named() {
        let error = |text: &str| Grid::from_toml(text).unwrap_err().to_string();
        let stray = GRID.replace("bleu_1 = 48.0, meteor = 33.7", "bleu_1 = 48.0");
        assert!(error(&stray).contains("meteor is doubted"));
        assert!(error(&GRID.replace("meteor", "metoer")).contains("metoer"));
        assert!(error(&GRID.replace("[1, 2]", "[]")).contains("seeds"));
        assert!(error(&GRID.replace("[1, 2]", "[3, 1, 3]")).contains("seeds: 3 occurs twice"));
        let twice = format!("{GRID}\n[[table.row]]\nname = \"whole\"\n");
        let twice = error(&twice);
        assert!(
            twice.contains("`Parts`") && twice.contains("`whole`"),
            "{twice}"
        );
        let split = error(&format!("split = \"tset\"\n{GRID}"));
        for part in ["split", "`tset`", "train, val or test"] {
            assert!(split.contains(part), "{split}");
        }
    }
}
