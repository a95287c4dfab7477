//! Systems beside each other: captions of the same clips by our model, by other systems and by floors, in one table.
//!
//! A configuration lists the rows. The caller trains and describes; this module scores the captions, compares every row with
//! the first one on the same clips, and writes the table. A row without captions says why.

use std::{collections::BTreeMap, fmt::Write as _, path::PathBuf};

use radarllm_base::{random::SplitMix64, stats::quantile_linear};
use radarllm_dataset::{ClipRecord, Split};
use radarllm_metrics::{Scores, bootstrap::units_of_ids};
use serde::{Deserialize, Serialize};
use toml::Table;

use super::{AddScores, Item, MAX_REFERENCES, Scorer, best_rouge_l, facts, split_of, test_split};
use crate::{ActionClassifier, Estimate, EvalError, ablation::METRICS, interval::N_RESAMPLES};

/// The file of a comparison (TOML).
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ComparisonConfig {
    /// Recipe that every trained row changes, relative to this file. Its table `pose` configures the pose network.
    pub base: PathBuf,
    /// Configuration of the data set, relative to this file; built if the folder `data` of the recipe does not exist.
    pub data: Option<PathBuf>,
    /// Folder for everything, relative to this file.
    pub out: PathBuf,
    /// Split to describe.
    #[serde(default = "test_split", deserialize_with = "split_of")]
    pub split: Split,
    /// Seed of trainings, bootstrap and shuffling.
    #[serde(default = "one")]
    pub seed: u64,
    /// Changes to the base recipe for all rows: dotted key to value.
    #[serde(default)]
    pub common: Table,
    /// Rows; the first one, with which the others are compared, is a model on radar: `radar` or `model`.
    #[serde(rename = "row")]
    pub rows: Vec<ComparisonRow>,
}

/// One system.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ComparisonRow {
    /// What the row is called.
    pub name: String,
    /// Where its captions come from.
    pub kind: RowKind,
    /// Changes to the common recipe: dotted key to value.
    #[serde(default)]
    pub set: Table,
    /// Dotted keys of the common recipe that this row leaves at their defaults.
    #[serde(default)]
    pub unset: Vec<String>,
    /// For `model`: its folder, relative to the file of the comparison, or the name of a bundled model.
    pub model: Option<PathBuf>,
    /// For `answers`: the captions, written by `radarllm baselines answers`, relative to the file of the comparison.
    pub captions: Option<PathBuf>,
    /// For `answers` and `not_run`: why there are no captions.
    pub reason: Option<String>,
    /// Published values on virtual radar, as printed there.
    #[serde(default)]
    pub reported: BTreeMap<String, f64>,
    /// Published values on real radar.
    #[serde(default)]
    pub reported_real: BTreeMap<String, f64>,
}

/// Where the captions of a row come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RowKind {
    /// A language model on codes of the radar tokenizer.
    Radar,
    /// A finished model, which describes by a vote of drawn sentences, as `radarllm describe` does. What it learned is its own
    /// affair.
    Model,
    /// A language model on codes of motions (`pretrain.codes`), on the motion that the pose network estimates from the points.
    EstimatedMotion,
    /// The same language model on the true motion: what a perfect pose would give.
    TrueMotion,
    /// A language model on pictures of range, velocity and azimuth over time (`pretrain.codes = "pictures"`).
    Pictures,
    /// The captions of the first row, each for another clip.
    Shuffled,
    /// The most frequent training caption.
    Majority,
    /// A caption of the training clip with the nearest descriptor.
    Nearest,
    /// A caption of the training clip that is nearest by dynamic time warping.
    Dtw,
    /// The medoid of the captions of the five nearest training clips by dynamic time warping.
    DtwMedoid,
    /// A classifier of actions, and the medoid caption of the action.
    Classifier,
    /// Facts measured by rules, and a writer of sentences; nothing is learned.
    Facts,
    /// Facts recognised by forests, and a writer of sentences; no network.
    ForestFacts,
    /// Actions recognised window by window, what rules measure of them, and a writer of sentences.
    WindowFacts,
    /// Captions made elsewhere, by `radarllm baselines answers`.
    Answers,
    /// A system that cannot be run.
    NotRun,
}

impl RowKind {
    /// Whether the row needs a training.
    pub fn is_trained(self) -> bool {
        matches!(
            self,
            Self::Radar | Self::EstimatedMotion | Self::TrueMotion | Self::Pictures
        )
    }

    /// What reads what, in words.
    pub fn about(self) -> &'static str {
        match self {
            Self::Radar => "radar codes to text",
            Self::Model => "radar to text, by a vote",
            Self::EstimatedMotion => "estimated motion to text",
            Self::TrueMotion => "true motion to text (ceiling)",
            Self::Pictures => "radar pictures to text",
            Self::Shuffled | Self::Majority | Self::Nearest | Self::Dtw | Self::DtwMedoid => {
                "floor"
            }
            Self::Classifier => "label to sentence",
            Self::Facts => "facts by rules to sentence",
            Self::ForestFacts => "facts by forests to sentence",
            Self::WindowFacts => "facts of windows to sentence",
            Self::Answers => "video to text",
            Self::NotRun => "-",
        }
    }
}

fn one() -> u64 {
    1
}

impl ComparisonConfig {
    /// Reads a configuration.
    ///
    /// # Errors
    /// TOML errors with their place; rows that lack what their kind needs; unknown metrics.
    pub fn from_toml(text: &str) -> Result<Self, EvalError> {
        let config: Self = toml::from_str(text).map_err(|e| EvalError::Config(e.to_string()))?;
        config.check().map_err(EvalError::Config)?;
        Ok(config)
    }

    fn check(&self) -> Result<(), String> {
        let first = self.rows.first().map(|row| row.kind);
        if !matches!(first, Some(RowKind::Radar | RowKind::Model)) {
            return Err(
                "the first row must have kind = \"radar\" or \"model\": the others are compared with it"
                    .into(),
            );
        }
        for (index, row) in self.rows.iter().enumerate() {
            let fail = |problem: String| Err(format!("row `{}`: {problem}", row.name));
            if self.rows[..index]
                .iter()
                .any(|other| other.name == row.name)
            {
                return fail("the name occurs twice".into());
            }
            if row.kind == RowKind::NotRun && row.reason.is_none() {
                return fail("kind = \"not_run\" needs a `reason`".into());
            }
            if (row.kind == RowKind::Model) != row.model.is_some() {
                return fail("kind = \"model\" and `model` need each other".into());
            }
            if row.kind == RowKind::Answers && row.captions.is_none() {
                return fail("kind = \"answers\" needs `captions`".into());
            }
            let changes = !row.set.is_empty() || !row.unset.is_empty();
            if changes && !row.kind.is_trained() {
                return fail("`set` and `unset` change a training, and this kind has none".into());
            }
            let reported = row.reported.keys().chain(row.reported_real.keys());
            let known = |key: &&String| !METRICS.iter().any(|m| m.0 == key.as_str());
            if let Some(key) = reported.clone().find(known) {
                let names: Vec<&str> = METRICS.iter().map(|m| m.0).collect();
                return fail(format!("{key}: unknown; metrics are {}", names.join(", ")));
            }
        }
        Ok(())
    }
}

/// Captions of a row, or why there are none.
#[derive(Clone, Debug)]
pub struct RowCaptions {
    /// One for each clip.
    pub texts: Result<Vec<String>, String>,
    /// What the system costs.
    pub cost: Cost,
}

/// What a system costs; `None` where it does not apply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Parameters of all networks from points to text.
    pub parameters: Option<usize>,
    /// Minutes of training of all of them.
    pub training_minutes: Option<f64>,
    /// Clips described per second, from points to text.
    pub clips_per_s: Option<f64>,
}

/// The mean of a row less that of the first row, over the same clips.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// The difference with its interval.
    #[serde(flatten)]
    pub estimate: Estimate,
    /// Two-sided p of no difference: twice the smaller share of the paired resamples on either side of zero.
    pub p: f64,
}

impl Difference {
    /// Of paired values, resampling whole units; `None` without values.
    ///
    /// # Shapes
    /// - `values`, `others`: one for each clip, in one order
    /// - `units`: unit number of each clip, from 0
    pub fn of(values: &[f64], others: &[f64], units: &[usize], seed: u64) -> Option<Self> {
        let n = values.len() as f64;
        let n_units = units.iter().max()? + 1;
        let mut sums = vec![[0.0, 0.0]; n_units];
        for ((a, b), &unit) in values.iter().zip(others).zip(units) {
            sums[unit][0] += a - b;
            sums[unit][1] += 1.0;
        }
        let value = sums.iter().map(|s| s[0]).sum::<f64>() / n;
        let mut rng = SplitMix64::new(seed);
        let mut means: Vec<f64> = (0..N_RESAMPLES)
            .map(|_| {
                let mut total = [0.0, 0.0];
                for _ in 0..n_units {
                    let drawn = sums[rng.below(n_units)];
                    total = [total[0] + drawn[0], total[1] + drawn[1]];
                }
                total[0] / total[1]
            })
            .collect();
        means.sort_unstable_by(f64::total_cmp);
        let share = |on_side: &dyn Fn(f64) -> bool| {
            means.iter().filter(|m| on_side(**m)).count() as f64 / means.len() as f64
        };
        let smaller = share(&|m| m <= 0.0).min(share(&|m| m >= 0.0));
        let [low, high] = [0.025, 0.975].map(|q| quantile_linear(&means, q).unwrap_or(f64::NAN));
        Some(Self {
            estimate: Estimate { value, low, high },
            // A finite number of resamples cannot show less.
            p: (2.0 * smaller).clamp(1.0 / N_RESAMPLES as f64, 1.0),
        })
    }
}

/// Scores of the captions of a row.
#[derive(Clone, Debug, Serialize)]
pub struct RowScores {
    /// Caption metrics.
    pub scores: Scores,
    /// Share of captions in which the action classifier recognises the clip's action.
    pub action_accuracy: Estimate,
    /// Share of captions with exactly the actions of one of the references, in order.
    pub same_actions: Estimate,
    /// [`r_precision`] of the captions at 1, 2 and 3.
    pub r_precision: Option<[f64; 3]>,
    /// Difference of ROUGE-L to the first row.
    pub rouge_l_difference: Option<Difference>,
    /// Difference of action accuracy to the first row.
    pub action_accuracy_difference: Option<Difference>,
    /// Difference of same actions to the first row.
    pub same_actions_difference: Option<Difference>,
}

/// One row of the report.
#[derive(Clone, Debug, Serialize)]
pub struct RowReport {
    /// Name.
    pub name: String,
    /// Kind.
    pub kind: RowKind,
    /// Scores, if the row was run.
    pub result: Option<RowScores>,
    /// Why it was not run.
    pub not_run: Option<String>,
    /// What it costs.
    pub cost: Cost,
    /// Published values on virtual radar.
    pub reported: BTreeMap<String, f64>,
    /// Published values on real radar.
    pub reported_real: BTreeMap<String, f64>,
}

/// The comparison.
#[derive(Clone, Debug, Serialize)]
pub struct ComparisonReport {
    /// Name of the data set.
    pub data: String,
    /// Split.
    pub split: String,
    /// Clips described: one of each motion.
    pub clips: usize,
    /// Clips of the training split.
    pub train_clips: usize,
    /// References counted of each clip.
    pub max_references: usize,
    /// Seed.
    pub seed: u64,
    /// Action accuracy of the references themselves.
    pub action_accuracy_on_references: f64,
    /// [`r_precision`] of the first references, and which model embedded.
    pub r_precision_on_references: Option<([f64; 3], String)>,
    /// Rows, in the order of the configuration.
    pub rows: Vec<RowReport>,
}

/// What is described, and from what was learned.
pub struct Compared<'a> {
    /// Name of the data set.
    pub data: &'a str,
    /// Clips of the split, one of each motion.
    pub clips: &'a [ClipRecord],
    /// Training clips.
    pub train: &'a [ClipRecord],
    /// Embeddings by a model of motions and sentences.
    pub embedded: Option<Embedded>,
}

/// True motions and captions, embedded by a model that was trained to bring the motion and the captions of a clip together.
#[derive(Clone, Debug)]
pub struct Embedded {
    /// Which model.
    pub by: String,
    /// True motions, `[clip][width]`.
    pub motions: Vec<Vec<f32>>,
    /// The first references, `[clip][width]`.
    pub references: Vec<Vec<f32>>,
    /// The captions of each row, `[clip][width]`; none of a row without captions.
    pub rows: Vec<Option<Vec<Vec<f32>>>>,
}

/// Captions among which the one of a motion has to be found, as in Guo et al. (CVPR 2022).
const POOL: usize = 32;

/// R-precision: the share of motions whose own text is among the nearest 1, 2 and 3 of a pool of 32 texts, that is its
/// own and those of other motions, drawn by `seed`. Nearest is by cosine; equal texts of others count as wrong. `None` for
/// fewer than two motions.
///
/// # Shapes
/// - `motions`, `texts`: `[clip][width]`, in one order
pub fn r_precision(motions: &[Vec<f32>], texts: &[Vec<f32>], seed: u64) -> Option<[f64; 3]> {
    let n = motions.len().min(texts.len());
    if n < 2 {
        return None;
    }
    let cosine = |a: &[f32], b: &[f32]| {
        let dot =
            |a: &[f32], b: &[f32]| -> f64 { a.iter().zip(b).map(|(x, y)| f64::from(x * y)).sum() };
        dot(a, b) / (dot(a, a) * dot(b, b)).sqrt().max(1e-12)
    };
    let mut rng = SplitMix64::new(seed);
    let mut hits = [0.0; 3];
    for (own, motion) in motions.iter().enumerate().take(n) {
        let mut others: Vec<usize> = (0..n).filter(|i| *i != own).collect();
        let size = (POOL - 1).min(others.len());
        for i in 0..size {
            let j = i + rng.below(others.len() - i);
            others.swap(i, j);
        }
        let score = cosine(motion, &texts[own]);
        let is_before = |i: &&usize| cosine(motion, &texts[**i]) >= score;
        let before = others[..size].iter().filter(is_before).count();
        for (k, hit) in hits.iter_mut().enumerate() {
            *hit += f64::from(u8::from(before <= k));
        }
    }
    Some(hits.map(|h| h / n as f64))
}

/// Scores the captions of all rows.
///
/// # Errors
/// A row with another number of captions than there are clips; no clips; captions that cannot be scored.
pub fn compare(
    config: &ComparisonConfig,
    compared: &Compared,
    captions: &[RowCaptions],
    add: AddScores,
) -> Result<ComparisonReport, EvalError> {
    let pairs = super::captions_with_actions(compared.train);
    let classifier = ActionClassifier::fit(&pairs)
        .ok_or_else(|| EvalError::Empty("the training captions hold no words".into()))?;
    let items: Vec<Item> = compared.clips.iter().map(Item::of_record).collect();
    let units = units_of_ids(items.iter().map(|i| i.id));
    let scorer = Scorer::new(&items, &classifier, config.seed, add);
    let mut first: Option<[Vec<f64>; 3]> = None;
    let mut rows = Vec::with_capacity(captions.len());
    for (row, captions) in config.rows.iter().zip(captions) {
        let result = match &captions.texts {
            Err(_) => None,
            Ok(texts) if texts.len() != items.len() => {
                return Err(EvalError::Config(format!(
                    "row `{}`: {} captions of {} clips",
                    row.name,
                    texts.len(),
                    items.len()
                )));
            }
            Ok(texts) => {
                let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
                let measures = scorer.measures(&texts)?;
                let of_clips = || items.iter().zip(&texts);
                let own = [
                    of_clips()
                        .map(|(i, text)| best_rouge_l(text, i.references))
                        .collect::<Vec<f64>>(),
                    of_clips()
                        .map(|(i, text)| classifier.classify(text) == Some(i.action))
                        .map(|right| f64::from(u8::from(right)))
                        .collect(),
                    of_clips()
                        .map(|(i, text)| facts::same_actions(text, i.references))
                        .collect(),
                ];
                let difference = |k: usize| {
                    let first = first.as_ref()?;
                    Difference::of(&own[k], &first[k], &units, config.seed)
                };
                let result = RowScores {
                    rouge_l_difference: difference(0),
                    action_accuracy_difference: difference(1),
                    same_actions_difference: difference(2),
                    scores: measures.scores,
                    action_accuracy: measures.action_accuracy,
                    same_actions: measures.same_actions,
                    r_precision: compared.embedded.as_ref().and_then(|embedded| {
                        let own = embedded.rows.get(rows.len())?.as_ref()?;
                        r_precision(&embedded.motions, own, config.seed)
                    }),
                };
                first.get_or_insert(own);
                Some(result)
            }
        };
        rows.push(RowReport {
            name: row.name.clone(),
            kind: row.kind,
            not_run: captions.texts.as_ref().err().cloned(),
            result,
            cost: captions.cost,
            reported: row.reported.clone(),
            reported_real: row.reported_real.clone(),
        });
    }
    let references: Vec<(&str, &str)> = items
        .iter()
        .flat_map(|i| i.references.iter().map(|r| (r.as_str(), i.action)))
        .collect();
    Ok(ComparisonReport {
        data: compared.data.into(),
        split: config.split.to_string(),
        clips: items.len(),
        train_clips: compared.train.len(),
        max_references: MAX_REFERENCES,
        seed: config.seed,
        action_accuracy_on_references: classifier.accuracy(&references).unwrap_or(f64::NAN),
        r_precision_on_references: compared.embedded.as_ref().and_then(|embedded| {
            let found = r_precision(&embedded.motions, &embedded.references, config.seed)?;
            Some((found, embedded.by.clone()))
        }),
        rows,
    })
}

/// Columns of the reported values.
const REPORTED: [&str; 7] = [
    "rouge_1",
    "rouge_l",
    "bleu_1",
    "bleu_4",
    "meteor",
    "cider_d",
    "bert_score",
];

/// The report as Markdown.
pub fn markdown(report: &ComparisonReport) -> String {
    let mut text = format!(
        "# Systems beside each other on `{}`, split `{}`\n\n{} clips, {} training clips; protocol `plain`, at most {} references \
         a clip, greedy decoding, but votes of finished models; values x100 except CIDEr-D, 95 % bootstrap intervals over motions. Action accuracy: a naive \
         Bayes classifier fitted on training captions recognises the clip's action ({:.1} % on the references). Same actions: \
         the caption states exactly the actions of one of the references, in order. Training minutes and clips a second are of \
         the machine that ran it.\n\n## Scores\n\n",
        report.data,
        report.split,
        report.clips,
        report.train_clips,
        report.max_references,
        report.action_accuracy_on_references * 100.0,
    );
    let encoders: Vec<&str> = ["bert_score", "sim_cse"]
        .into_iter()
        .filter(|name| has_encoder(report, name))
        .collect();
    text += "| system | reads | same actions | action accuracy | ROUGE-1 | ROUGE-L | BLEU-1 | BLEU-4 | METEOR | CIDEr-D |";
    for name in &encoders {
        text += if *name == "bert_score" {
            " BERTScore |"
        } else {
            " SimCSE |"
        };
    }
    let retrieves = report.r_precision_on_references.is_some();
    if retrieves {
        text += " R@1 | R@3 |";
    }
    text += " parameters | training, min | clips/s |\n|---|";
    let n_columns = 12 + encoders.len() + 2 * usize::from(retrieves);
    text += &"---|".repeat(n_columns);
    text.push('\n');
    for row in &report.rows {
        let _ = write!(text, "| {} | {} |", row.name, row.kind.about());
        let Some(result) = &row.result else {
            let reason = row.not_run.as_deref().unwrap_or_default();
            let _ = writeln!(text, " not run: {reason} |{}", " |".repeat(n_columns - 2));
            continue;
        };
        let mut cells = vec![
            result.same_actions.to_text(100.0, 1),
            result.action_accuracy.to_text(100.0, 1),
        ];
        let metrics = [
            "rouge_1", "rouge_l", "bleu_1", "bleu_4", "meteor", "cider_d",
        ];
        cells.extend(Estimate::cells(&result.scores, &metrics));
        cells.extend(Estimate::cells(&result.scores, &encoders));
        if retrieves {
            let at = |k: usize| match result.r_precision {
                Some(found) => format!("{:.1}", found[k] * 100.0),
                None => "-".into(),
            };
            cells.extend([at(0), at(2)]);
        }
        let cost = row.cost;
        cells.push(cost.parameters.map_or("-".into(), |n| n.to_string()));
        cells.push(
            cost.training_minutes
                .map_or("-".into(), |m| format!("{m:.1}")),
        );
        cells.push(cost.clips_per_s.map_or("-".into(), |v| format!("{v:.1}")));
        let _ = writeln!(text, " {} |", cells.join(" | "));
    }
    if encoders.is_empty() {
        text += "\nBERTScore and SimCSE were not computed: they need the weights of a sentence encoder \
                 (`--bert-score`, `--sim-cse`).\n";
    }
    if let Some(([first, _, third], by)) = &report.r_precision_on_references {
        let _ = writeln!(
            text,
            "\nR@1, R@3: R-precision, the share of true motions whose caption is the nearest, or among the nearest three, of \
             {POOL} captions of different motions, by the encoder of the row `{by}`; the references reach {:.1} and {:.1} %.",
            first * 100.0,
            third * 100.0
        );
    }
    text += "\n## Differences to the first row, paired over the same motions\n\n\
             | system | same actions | p | action accuracy | p | ROUGE-L | p |\n|---|---|---|---|---|---|---|\n";
    for row in report.rows.iter().skip(1) {
        let Some(result) = &row.result else { continue };
        let _ = write!(text, "| {} |", row.name);
        for difference in [
            result.same_actions_difference,
            result.action_accuracy_difference,
            result.rouge_l_difference,
        ] {
            match difference {
                Some(d) => {
                    let _ = write!(
                        text,
                        " {} | {:.3} |",
                        d.estimate.to_signed_text(100.0, 1),
                        d.p
                    );
                }
                None => text += " - | - |",
            }
        }
        text.push('\n');
    }
    text += &reported(report);
    text
}

fn has_encoder(report: &ComparisonReport, name: &str) -> bool {
    report
        .rows
        .iter()
        .filter_map(|row| row.result.as_ref())
        .any(|result| match name {
            "bert_score" => result.scores.bert_score.is_some(),
            _ => result.scores.sim_cse.is_some(),
        })
}

/// Published values, which nothing is computed with.
fn reported(report: &ComparisonReport) -> String {
    let rows: Vec<&RowReport> = report
        .rows
        .iter()
        .filter(|row| !(row.reported.is_empty() && row.reported_real.is_empty()))
        .collect();
    if rows.is_empty() {
        return String::new();
    }
    let headings: Vec<&str> = REPORTED
        .iter()
        .filter_map(|key| METRICS.iter().find(|m| m.0 == *key).map(|m| m.1))
        .collect();
    let mut text = format!(
        "\n## Reported by the paper, on other data at another size\n\nNothing is computed with these values.\n\n\
         | system | radar | {} |\n|---|---|{}\n",
        headings.join(" | "),
        "---|".repeat(headings.len())
    );
    for row in rows {
        for (radar, values) in [("virtual", &row.reported), ("real", &row.reported_real)] {
            if values.is_empty() {
                continue;
            }
            let cells: Vec<String> = REPORTED
                .iter()
                .map(|key| values.get(*key).map_or("-".into(), |v| format!("*{v}*")))
                .collect();
            let _ = writeln!(text, "| {} | {radar} | {} |", row.name, cells.join(" | "));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: &str = r#"
base = "model.toml"
out = "out"

[[row]]
name = "ours"
kind = "radar"

[[row]]
name = "two stages"
kind = "estimated_motion"
set = { "pretrain.codes" = "motion" }
reported = { rouge_1 = 31.2 }

[[row]]
name = "video"
kind = "not_run"
reason = "needs a GPU"
"#;

    #[test]
    fn slips_in_a_comparison_are_named() {
        let error = |from: &str, to: &str| {
            let text = CONFIG.replace(from, to);
            assert_ne!(text, CONFIG);
            ComparisonConfig::from_toml(&text).unwrap_err().to_string()
        };
        ComparisonConfig::from_toml(CONFIG).unwrap();
        assert!(error("kind = \"radar\"", "kind = \"majority\"").contains("first row"));
        assert!(error("reason = \"needs a GPU\"", "").contains("video"));
        assert!(error("rouge_1", "rouge_2").contains("rouge_2"));
        assert!(error("two stages", "ours").contains("twice"));
        let split = error("out = \"out\"", "out = \"out\"\nsplit = \"tset\"");
        assert!(
            split.contains("`tset`") && split.contains("train, val or test"),
            "{split}"
        );
        assert!(error("\"not_run\"\n", "\"answers\"\n").contains("captions"));
        assert!(error("kind = \"radar\"", "kind = \"model\"").contains("`model`"));
        assert!(
            error("kind = \"radar\"", "kind = \"radar\"\nmodel = \"features\"").contains("`model`")
        );
        assert!(
            error("kind = \"not_run\"", "kind = \"facts\"\nset = { a = 1 }").contains("training")
        );
    }

    #[test]
    fn r_precision_counts_texts_that_are_nearer_than_the_own_one() {
        // Each motion has an axis of its own.
        let axis =
            |i: usize| -> Vec<f32> { (0..40).map(|k| f32::from(u8::from(k == i))).collect() };
        let motions: Vec<Vec<f32>> = (0..40).map(axis).collect();
        assert_eq!(r_precision(&motions, &motions, 1), Some([1.0; 3]));
        // The text of the next motion: the own one is at 90 degrees, as are all but one.
        let others: Vec<Vec<f32>> = (0..40).map(|i| axis((i + 1) % 40)).collect();
        assert_eq!(r_precision(&motions, &others, 1), Some([0.0; 3]));
        // A constant caption cannot be told from the others.
        assert_eq!(r_precision(&motions, &vec![axis(0); 40], 1), Some([0.0; 3]));
        assert_eq!(r_precision(&motions[..1], &motions[..1], 1), None);
    }

    #[test]
    fn differences_have_the_sign_and_the_certainty_of_their_values() {
        let units: Vec<usize> = (0..40).collect();
        let ones = vec![1.0; 40];
        let zeros = vec![0.0; 40];
        let sure = Difference::of(&ones, &zeros, &units, 1).unwrap();
        assert_eq!(
            (sure.estimate.value, sure.estimate.low, sure.p),
            (1.0, 1.0, 0.001)
        );
        let none = Difference::of(&ones, &ones, &units, 1).unwrap();
        assert_eq!((none.estimate.value, none.p), (0.0, 1.0));
        // Half better, half worse: no difference, and a wide interval.
        let mixed: Vec<f64> = (0..40).map(|i| f64::from(i % 2)).collect();
        let other: Vec<f64> = (0..40).map(|i| f64::from((i + 1) % 2)).collect();
        let open = Difference::of(&mixed, &other, &units, 1).unwrap();
        assert_eq!(open.estimate.value, 0.0);
        assert!(open.p > 0.5 && open.estimate.low < -0.2 && open.estimate.high > 0.2);
        assert_eq!(Difference::of(&[], &[], &[], 1), None);
    }
}
