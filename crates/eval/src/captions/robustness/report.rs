//! Scores of the cells beside the unchanged one, as a report, Markdown and curves.

use radarllm_dataset::Split;
use radarllm_metrics::{Candidate, Reference, ScoreOptions, bootstrap::units_of_ids, score};
use radarllm_synth::corpus::{Corpus, CorpusItem};
use serde::Serialize;

use super::{
    Cell, Experiment,
    conditions::{Change, Plan},
};
use crate::{ActionClassifier, Estimate, EvalError, captions::MAX_REFERENCES, table::Table};

/// The captions of one cell, scored.
#[derive(Clone, Debug, Serialize)]
pub struct ScoredCell {
    /// The change in words.
    pub condition: String,
    /// Place on the axis; `None` for the unchanged cell of some axes and for names.
    pub x: Option<f64>,
    /// BLEU-1, 0..=1.
    pub bleu_1: Estimate,
    /// ROUGE-L, 0..=1.
    pub rouge_l: Estimate,
    /// METEOR, 0..=1.
    pub meteor: Estimate,
    /// CIDEr-D.
    pub cider_d: Estimate,
    /// Share of captions in which the action classifier recognises the clip's action, 0..=1.
    pub action_accuracy: Estimate,
    /// Action accuracy less that of the unchanged cell, clip by clip.
    pub action_accuracy_change: Estimate,
    /// Clips without a caption.
    pub abstained: usize,
    /// Mean number of points per frame.
    pub points_per_frame: f64,
}

/// All values of one condition.
#[derive(Clone, Debug, Serialize)]
pub struct AxisReport {
    /// Name of the condition.
    pub name: &'static str,
    /// What is varied, with its unit.
    pub about: &'static str,
    /// The unchanged cell first.
    pub cells: Vec<ScoredCell>,
}

/// A model under changed conditions.
#[derive(Clone, Debug, Serialize)]
pub struct RobustnessReport {
    /// Name of the model.
    pub model: String,
    /// Name of the data set configuration.
    pub data: String,
    /// Split whose motions are shown.
    pub split: String,
    /// Motions in every cell.
    pub clips: usize,
    /// Protocol of the caption metrics.
    pub protocol: &'static str,
    /// References counted of each clip.
    pub max_references: usize,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// Share of these clips' references that are classified as their action.
    pub action_accuracy_on_references: f64,
    /// Conditions.
    pub axes: Vec<AxisReport>,
    /// Limits of what the numbers show.
    pub notes: Vec<&'static str>,
}

/// Part of every report.
const NOTES: [&str; 2] = [
    "Darkness: no cell. The simulator has no light in it, so darkness cannot change a number here.",
    "All clips are simulated; the numbers do not show how a real radar behaves under these conditions.",
];

/// Scores cells, which must hold every change of the plan.
///
/// # Errors
/// A missing cell; a training split without captions.
pub fn report(
    plan: &Plan,
    experiment: &Experiment,
    cells: &[(Change, Cell)],
    seed: u64,
) -> Result<RobustnessReport, EvalError> {
    let items: Vec<&CorpusItem> = experiment.items().collect();
    let classifier = fit_classifier(experiment.corpora)?;
    let references: Vec<(&str, &str)> = items
        .iter()
        .flat_map(|i| i.captions.iter().map(|c| (c.as_str(), i.action.as_str())))
        .collect();
    let cell = |change: &Change| {
        let found = cells.iter().find(|(known, _)| known == change);
        found
            .map(|(_, cell)| cell)
            .ok_or_else(|| EvalError::Empty(format!("{}: not measured", change.label())))
    };
    let unchanged = cell(&Change::Nothing)?;
    let scorer = Scorer {
        items: &items,
        classifier: &classifier,
        unchanged: correct(&classifier, &items, unchanged),
        seed,
    };
    let axes = plan
        .axes
        .iter()
        .map(|axis| {
            let mut scored = vec![ScoredCell {
                x: axis.x_of_nothing(),
                ..scorer.score(&Change::Nothing, unchanged)?
            }];
            for change in axis.changes() {
                scored.push(scorer.score(&change, cell(&change)?)?);
            }
            Ok(AxisReport {
                name: axis.name(),
                about: axis.about(),
                cells: scored,
            })
        })
        .collect::<Result<Vec<_>, EvalError>>()?;
    Ok(RobustnessReport {
        model: experiment.model.name.clone(),
        data: experiment.config.name.clone(),
        split: plan.split.clone(),
        clips: items.len(),
        protocol: "plain",
        max_references: MAX_REFERENCES,
        seed,
        action_accuracy_on_references: classifier.accuracy(&references).unwrap_or(0.0),
        axes,
        notes: NOTES.to_vec(),
    })
}

/// A classifier fitted on the captions of the training split.
fn fit_classifier(corpora: &[Box<dyn Corpus>]) -> Result<ActionClassifier, EvalError> {
    let pairs: Vec<(&str, &str)> = corpora
        .iter()
        .flat_map(|corpus| corpus.items())
        .filter(|item| item.split == Split::Train)
        .flat_map(|item| {
            item.captions
                .iter()
                .map(|c| (c.as_str(), item.action.as_str()))
        })
        .collect();
    ActionClassifier::fit(&pairs).ok_or_else(|| {
        EvalError::Empty(
            "the training split has no captions to fit the action classifier on".into(),
        )
    })
}

/// 1 for every caption that is classified as its clip's action, else 0.
fn correct(classifier: &ActionClassifier, items: &[&CorpusItem], cell: &Cell) -> Vec<f64> {
    let pairs = cell.captions.iter().zip(items);
    pairs
        .map(|(caption, item)| classifier.classify(caption) == Some(&item.action))
        .map(|correct| f64::from(u8::from(correct)))
        .collect()
}

struct Scorer<'a> {
    items: &'a [&'a CorpusItem],
    classifier: &'a ActionClassifier,
    /// Which captions of the unchanged cell are correct.
    unchanged: Vec<f64>,
    seed: u64,
}

impl Scorer<'_> {
    fn score(&self, change: &Change, cell: &Cell) -> Result<ScoredCell, EvalError> {
        let references: Vec<Reference> = self
            .items
            .iter()
            .map(|item| Reference {
                id: item.motion_id.clone(),
                texts: item.captions.clone(),
            })
            .collect();
        let candidates: Vec<Candidate> = self
            .items
            .iter()
            .zip(&cell.captions)
            .map(|(item, text)| Candidate {
                id: item.motion_id.clone(),
                text: text.clone(),
            })
            .collect();
        let options = ScoreOptions {
            seed: self.seed,
            max_references: MAX_REFERENCES,
            ..ScoreOptions::default()
        };
        let scores = score(&candidates, &references, &options)?;
        let units = units_of_ids(self.items.iter().map(|item| item.motion_id.as_str()));
        let mean = |values: &[f64]| {
            Estimate::of_mean(values, &units, self.seed)
                .ok_or_else(|| EvalError::Empty("no clips to score".into()))
        };
        let correct = correct(self.classifier, self.items, cell);
        let differences: Vec<f64> = correct
            .iter()
            .zip(&self.unchanged)
            .map(|(here, unchanged)| here - unchanged)
            .collect();
        Ok(ScoredCell {
            condition: cell.condition.clone(),
            x: change.x(),
            bleu_1: Estimate::of_metric(&scores, "bleu_1", scores.bleu_1),
            rouge_l: Estimate::of_metric(&scores, "rouge_l", scores.rouge_l),
            meteor: Estimate::of_metric(&scores, "meteor", scores.meteor.unwrap_or(f64::NAN)),
            cider_d: Estimate::of_metric(&scores, "cider_d", scores.cider_d),
            action_accuracy: mean(&correct)?,
            action_accuracy_change: mean(&differences)?,
            abstained: cell.abstained,
            points_per_frame: cell.points_per_frame,
        })
    }
}

/// The report as Markdown.
pub fn markdown(report: &RobustnessReport) -> String {
    let mut text = format!(
        "Model {}, {} motions of split `{}` of `{}`, the same in every cell, captioned by a vote. Protocol `{}`, at max {} \
         references; values are multiplied by 100, except CIDEr-D; 95 % bootstrap intervals over motions. Action accuracy: \
         the share of captions in which a naive Bayes classifier, fitted on training captions, recognises the clip's \
         action; on these clips' own references it is {:.0} %. \"Change\" is the difference in action accuracy to the \
         unchanged cell, clip by clip.\n",
        report.model,
        report.clips,
        report.split,
        report.data,
        report.protocol,
        report.max_references,
        report.action_accuracy_on_references * 100.0
    );
    for axis in &report.axes {
        let mut table = Table::new(
            axis.name,
            axis.about,
            &[
                "condition",
                "BLEU-1",
                "ROUGE-L",
                "METEOR",
                "CIDEr-D",
                "action accuracy",
                "change",
                "points per frame",
                "without caption",
            ],
        );
        table.rows = axis.cells.iter().map(row).collect();
        text += &format!(
            "\n## {}: {}\n\n{}",
            table.title,
            table.about,
            table.to_markdown()
        );
    }
    text.push('\n');
    for note in &report.notes {
        text += &format!("- {note}\n");
    }
    text
}

fn row(cell: &ScoredCell) -> Vec<String> {
    let change = if cell.condition == Change::Nothing.label() {
        String::new()
    } else {
        cell.action_accuracy_change.to_signed_text(100.0, 1)
    };
    vec![
        cell.condition.clone(),
        cell.bleu_1.to_text(100.0, 1),
        cell.rouge_l.to_text(100.0, 1),
        cell.meteor.to_text(100.0, 1),
        cell.cider_d.to_text(1.0, 2),
        cell.action_accuracy.to_text(100.0, 1),
        change,
        format!("{:.1}", cell.points_per_frame),
        cell.abstained.to_string(),
    ]
}

/// A curve over the values of a condition.
#[derive(Clone, Debug)]
pub struct Curve {
    /// Metric with its unit.
    pub name: &'static str,
    /// Values of the condition, ascending.
    pub x: Vec<f64>,
    /// Metric.
    pub y: Vec<f64>,
    /// 95 % intervals of the metric, low and high.
    pub intervals: Vec<[f64; 2]>,
}

/// Curves of a condition with at least two places on its axis; else none.
pub fn curves(axis: &AxisReport) -> Vec<Curve> {
    let mut cells: Vec<(f64, &ScoredCell)> = axis
        .cells
        .iter()
        .filter_map(|cell| Some((cell.x?, cell)))
        .collect();
    if cells.len() < 2 {
        return Vec::new();
    }
    cells.sort_by(|a, b| a.0.total_cmp(&b.0));
    let curve = |name, scale: f64, metric: fn(&ScoredCell) -> Estimate| {
        let estimates = || cells.iter().map(|(_, cell)| metric(cell));
        Curve {
            name,
            x: cells.iter().map(|(x, _)| *x).collect(),
            y: estimates().map(|e| e.value * scale).collect(),
            intervals: estimates()
                .map(|e| [e.low * scale, e.high * scale])
                .collect(),
        }
    };
    vec![
        curve("action accuracy, %", 100.0, |c| c.action_accuracy),
        curve("BLEU-1 x100", 100.0, |c| c.bleu_1),
        curve("ROUGE-L x100", 100.0, |c| c.rouge_l),
        curve("CIDEr-D x10", 10.0, |c| c.cider_d),
    ]
}
