//! A caption report as tables and as Markdown.

use super::{
    CaptionReport, Slice, System,
    facts::{FactCounts, FactsOfKind, NoveltySlice},
};
use crate::{Estimate, captioner::decision, table::Table};

/// Model, data and speed, a line each.
pub fn summary(report: &CaptionReport) -> Vec<String> {
    let mut lines = vec![
        format!(
            "Model {}: {:.2} M parameters, {:.2} MB on disk, decoder {}, {}. {} clips, one of each motion; {} of them \
             without a caption because they have too few points or frames. Baselines and action classifier are made from {} \
             training clips.",
            report.model,
            report.parameters as f64 / 1e6,
            report.model_bytes as f64 / 1e6,
            report.decoder,
            decision(report.beam),
            report.clips,
            report.abstained,
            report.train_clips
        ),
        format!(
            "Speed on this machine, with whatever else it was doing: {:.1} captions/s, {:.0} radar frames/s, {:.0} tokens/s, \
             from points to captions.",
            report.captions_per_s, report.radar_frames_per_s, report.tokens_per_s
        ),
    ];
    lines.push(format!(
        "Radar tokens of these clips: {:.0} % of the codebook in use, perplexity {:.0}.",
        report.codes.used * 100.0,
        report.codes.perplexity
    ));
    if let Some(mb) = report.peak_memory_mb {
        lines.push(format!("Peak memory {mb:.0} MB."));
    }
    lines
}

/// All tables of the report.
pub fn tables(report: &CaptionReport) -> Vec<Table> {
    let encoders: Vec<&'static str> = encoder_columns(report);
    let mut head = vec![
        "system",
        "BLEU-1",
        "BLEU-4",
        "ROUGE-1",
        "ROUGE-L",
        "METEOR",
        "CIDEr-D",
        "action accuracy",
        "same actions",
        "facts precision",
        "facts recall",
        "contradictions",
    ];
    head.extend(&encoders);
    let mut scores = Table::new(
        "Scores",
        format!(
            "Protocol {}, at max {} references for each of {} clips. Values are multiplied by 100, except CIDEr-D; 95 % \
             bootstrap intervals over motions. Action accuracy: the share of captions in which a naive Bayes classifier, \
             fitted on training captions, recognises the clip's action; on the references of this split it is {:.1} %. \
             Same actions: the share of captions that state exactly the actions of one of the references, in order. \
             METEOR 1.5 with exact, stem and WordNet matches. Facts: actions with their attributes, as a parser reads \
             them. {}",
            report.protocol,
            report.max_references,
            report.clips,
            report.action_accuracy_on_references * 100.0,
            encoder_rules(report)
        ),
        &head,
    );
    let row = |system| system_row(system, &encoders);
    scores.rows = report.systems.iter().map(row).collect();
    let mut tables = vec![
        scores,
        slices(
            "By length",
            "The model by length of the clip. Values are multiplied by 100, with 95 % intervals.",
            "clip length",
            &report.by_length,
        ),
    ];
    if !report.by_n_actions.is_empty() {
        tables.push(slices(
            "By number of actions",
            "The model by number of actions that a clip is composed of. Values are multiplied by 100, with 95 % intervals.",
            "actions",
            &report.by_n_actions,
        ));
    }
    tables.push(slices(
        "By action",
        "The model by action. Values are multiplied by 100, with 95 % intervals.",
        "action",
        &report.by_action,
    ));
    tables.push(facts_by_kind(&report.facts));
    tables.push(by_novelty(&report.by_novelty));
    if !report.confusions.is_empty() {
        let mut confusions = Table::new(
            "Confusions",
            format!(
                "Captions that are classified as another action, the {} most frequent pairs.",
                report.confusions.len()
            ),
            &["action", "classified as", "clips"],
        );
        for c in &report.confusions {
            let named = c.named.as_deref().unwrap_or("unknown");
            let row = vec![c.action.clone(), named.into(), c.clips.to_string()];
            confusions.rows.push(row);
        }
        tables.push(confusions);
    }
    tables
}

/// The report as Markdown.
pub fn markdown(report: &CaptionReport) -> String {
    let mut text = format!(
        "# Captions of `{}`, split `{}`\n\n{}\n",
        report.data,
        report.split,
        summary(report).join("\n")
    );
    for table in tables(report) {
        text += &format!(
            "\n## {}\n\n{}\n\n{}",
            table.title,
            table.about,
            table.to_markdown()
        );
    }
    text
}

const BERT_SCORE: &str = "BERTScore";
const SIM_CSE: &str = "SimCSE";

/// Columns of the metrics that were computed with a sentence encoder.
fn encoder_columns(report: &CaptionReport) -> Vec<&'static str> {
    let Some(system) = report.systems.first() else {
        return Vec::new();
    };
    let bert = system.scores.bert_score.map(|_| BERT_SCORE);
    let sim = system.scores.sim_cse.map(|_| SIM_CSE);
    bert.into_iter().chain(sim).collect()
}

/// With which weights these metrics were computed, or that they were not.
fn encoder_rules(report: &CaptionReport) -> String {
    let rules = |name: &str, rules: Option<&String>| match rules {
        Some(rules) => format!("{name}: {rules}."),
        None => format!("{name} was not computed."),
    };
    let scores = report.systems.first().map(|system| &system.scores);
    let bert = scores.and_then(|s| s.bert_score_rules.as_ref());
    let sim = scores.and_then(|s| s.sim_cse_rules.as_ref());
    if bert.is_none() && sim.is_none() {
        return "BERTScore and SimCSE were not computed.".into();
    }
    format!("{} {}", rules(BERT_SCORE, bert), rules(SIM_CSE, sim))
}

/// Metrics of a system with intervals.
fn system_row(system: &System, encoders: &[&str]) -> Vec<String> {
    let s = &system.scores;
    let mut row = vec![system.what.to_string()];
    row.extend(Estimate::cells(
        s,
        &[
            "bleu_1", "bleu_4", "rouge_1", "rouge_l", "meteor", "cider_d",
        ],
    ));
    row.push(system.action_accuracy.to_text(100.0, 1));
    row.push(system.same_actions.to_text(100.0, 1));
    row.extend(fact_cells(&system.facts));
    let metrics = encoders.iter().map(|name| match *name {
        BERT_SCORE => "bert_score",
        _ => "sim_cse",
    });
    row.extend(Estimate::cells(s, &metrics.collect::<Vec<_>>()));
    row
}

/// Precision, recall and contradictions.
fn fact_cells(facts: &FactCounts) -> [String; 3] {
    [
        percent(facts.all.precision()),
        percent(facts.all.recall()),
        facts.contradictions.to_string(),
    ]
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".into(), |share| format!("{:.1}", share * 100.0))
}

/// Facts of the model's captions by kind.
fn facts_by_kind(rows: &[FactsOfKind]) -> Table {
    let mut table = Table::new(
        "Facts by kind",
        "Facts of the model's captions beside the references that agree with them max. A contradiction excludes what the \
         reference states: left for right, once for several times.",
        &[
            "kind",
            "stated",
            "right",
            "in references",
            "precision %",
            "recall %",
            "contradictions",
        ],
    );
    let row = |row: &FactsOfKind| {
        let tally = row.tally;
        vec![
            row.kind.to_string(),
            tally.candidate.to_string(),
            tally.common.to_string(),
            tally.reference.to_string(),
            percent(tally.precision()),
            percent(tally.recall()),
            row.contradictions.to_string(),
        ]
    };
    table.rows = rows.iter().map(row).collect();
    table
}

/// The model's captions of clips of which no training caption tells.
fn by_novelty(slices: &[NoveltySlice]) -> Table {
    let mut table = Table::new(
        "What no training caption states",
        "The model's captions by what is new about a clip: something that its references state and no training caption of \
         this data set states. Clips whose references are no training captions, word for word, are also counted in the \
         last row. Values are multiplied by 100, except the confidence; 95 % intervals.",
        &[
            "new about the clip",
            "clips",
            "same actions",
            "facts precision",
            "facts recall",
            "contradictions",
            "ROUGE-L",
            "mean confidence",
        ],
    );
    let row = |slice: &NoveltySlice| {
        let mut row = vec![
            slice.name.to_string(),
            slice.clips.to_string(),
            slice.same_actions.to_text(100.0, 1),
        ];
        row.extend(fact_cells(&slice.facts));
        row.push(slice.rouge_l.to_text(100.0, 1));
        row.push(format!("{:.2}", slice.confidence));
        row
    };
    table.rows = slices.iter().map(row).collect();
    table
}

fn slices(title: &str, about: &str, first: &str, slices: &[Slice]) -> Table {
    let mut table = Table::new(
        title,
        about,
        &[first, "clips", "action accuracy", "same actions", "ROUGE-L"],
    );
    let row = |slice: &Slice| {
        vec![
            slice.name.clone(),
            slice.clips.to_string(),
            slice.action_accuracy.to_text(100.0, 1),
            slice.same_actions.to_text(100.0, 1),
            slice.rouge_l.to_text(100.0, 1),
        ]
    };
    table.rows = slices.iter().map(row).collect();
    table
}
