//! BERTScore and SimCSE for `score`: sentences through a checkpoint that the user names, compared.

use std::{collections::BTreeMap, path::Path};

use radarllm_inference::{
    device::Processor,
    lm::{Device, EncodedText, Pooling, TextEncoder},
};
use radarllm_metrics::{
    Candidate, Protocol, Reference, Scores,
    bootstrap::{mean_interval, units_of_ids},
    embedding::{BertScore, Idf, Sentence, bert_score, cosine},
};

use crate::{
    args::ScoreArgs,
    error::{CliError, CliResult},
};

/// Items whose token states are held at once.
const CHUNK: usize = 256;
/// Resamples of an interval, as for the other metrics.
const RESAMPLES: usize = 1000;

/// One item: what was said, and what may be said.
struct Item<'a> {
    id: &'a str,
    candidate: &'a str,
    references: Vec<&'a str>,
}

/// Adds what `--bert-score` and `--sim-cse` ask for.
pub fn add(
    scores: &mut Scores,
    args: &ScoreArgs,
    candidates: &[Candidate],
    references: &[Reference],
) -> CliResult {
    if args.bert_score.is_none() && args.sim_cse.is_none() {
        return Ok(());
    }
    let device = args.device.as_deref().unwrap_or("cpu").parse::<Processor>();
    let device = device.and_then(Processor::device);
    let device = device.map_err(|e| CliError::new(format!("--device: {e}")))?;
    let items = items(scores, candidates, references);
    let units = units_of_ids(items.iter().map(|item| item.id));
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    if let Some(dir) = &args.bert_score {
        let layer = args.layer.ok_or_else(|| {
            CliError::new("--bert-score needs --layer")
                .hint("17 for roberta-large, 9 for bert-base-uncased")
        })?;
        let with_idf = scores.protocol == Protocol::MotionGpt;
        let values = bert_scores(dir, &device, layer, with_idf, args.bert_baseline, &items)?;
        scores.bert_score = Some(mean(&values));
        scores.bert_score_rules = Some(format!(
            "{}, layer {layer}, F1, best reference, {} idf, {}",
            dir.display(),
            if with_idf { "with" } else { "without" },
            match args.bert_baseline {
                Some(b) => format!("rescaled by {b}"),
                None => "not rescaled".into(),
            }
        ));
        interval(scores, "bert_score", &values, &units, args.seed);
    }
    if let Some(dir) = &args.sim_cse {
        let name = args.pooling.as_deref().ok_or_else(|| {
            CliError::new("--sim-cse needs --pooling").hint("pooler (supervised), cls or mean")
        })?;
        let pooling = Pooling::from_name(name).ok_or_else(|| {
            CliError::new(format!("--pooling {name}: unknown")).hint("pooler, cls or mean")
        })?;
        let values = similarities(dir, &device, pooling, &items)?;
        scores.sim_cse = Some(mean(&values));
        scores.sim_cse_rules = Some(format!(
            "{}, pooling {name}, cosine, best reference",
            dir.display()
        ));
        interval(scores, "sim_cse", &values, &units, args.seed);
    }
    Ok(())
}

fn interval(scores: &mut Scores, field: &str, values: &[f64], units: &[usize], seed: u64) {
    scores.reason.remove(field);
    if let Some(found) = mean_interval(values, units, RESAMPLES, seed) {
        scores.ci95.insert(field.into(), found);
    }
}

/// Items in the order of the references, with the references that the protocol counts: at most so many,
/// and, for `motiongpt`, repeated in turn up to that number. Ids agree, `score` has checked them.
fn items<'a>(
    scores: &Scores,
    candidates: &'a [Candidate],
    references: &'a [Reference],
) -> Vec<Item<'a>> {
    let said: BTreeMap<&str, &str> = candidates
        .iter()
        .map(|c| (c.id.as_str(), c.text.as_str()))
        .collect();
    let most = match scores.max_references {
        0 => usize::MAX,
        most => most,
    };
    references
        .iter()
        .filter_map(|reference| {
            let texts = reference.texts.iter().map(String::as_str);
            let references = match scores.protocol {
                Protocol::MotionGpt => texts.cycle().take(most).collect(),
                _ => texts.take(most).collect(),
            };
            Some(Item {
                id: &reference.id,
                candidate: said.get(reference.id.as_str())?,
                references,
            })
        })
        .collect()
}

fn open(dir: &Path, device: &Device) -> CliResult<TextEncoder> {
    TextEncoder::open(dir, device).map_err(|e| {
        CliError::new(e).hint("a folder with config.json, model.safetensors and tokenizer.json")
    })
}

fn texts<'a>(items: &'a [Item], of: impl Fn(&'a Item) -> Vec<&'a str>) -> Vec<String> {
    items.iter().flat_map(of).map(String::from).collect()
}

fn bert_scores(
    dir: &Path,
    device: &Device,
    layer: usize,
    with_idf: bool,
    baseline: Option<f64>,
    items: &[Item],
) -> CliResult<Vec<f64>> {
    let encoder = open(dir, device)?;
    let idf = match with_idf {
        false => None,
        true => {
            let ids = encoder.ids(&texts(items, |item| item.references.clone()))?;
            Some(Idf::of(ids.iter().map(Vec::as_slice)))
        }
    };
    // The special tokens at both ends count nothing, and are still there to be matched.
    let weights = |text: &EncodedText| -> Vec<f64> {
        let last = text.ids.len() - 1;
        let weight = |(i, &id): (usize, &u32)| match &idf {
            _ if i == 0 || i == last => 0.0,
            None => 1.0,
            Some(idf) => idf.weight(id),
        };
        text.ids.iter().enumerate().map(weight).collect()
    };
    let mut out = Vec::with_capacity(items.len());
    for chunk in items.chunks(CHUNK) {
        let said = encoder.encode(&texts(chunk, |item| vec![item.candidate]), layer)?;
        let meant = encoder.encode(&texts(chunk, |item| item.references.clone()), layer)?;
        let mut meant = meant.iter();
        for (item, candidate) in chunk.iter().zip(&said) {
            let candidate_weights = weights(candidate);
            let mut scores = Vec::with_capacity(item.references.len());
            for reference in meant.by_ref().take(item.references.len()) {
                let reference_weights = weights(reference);
                scores.push(bert_score(
                    Sentence {
                        embeddings: &candidate.states,
                        weights: &candidate_weights,
                    },
                    Sentence {
                        embeddings: &reference.states,
                        weights: &reference_weights,
                    },
                    encoder.width(),
                )?);
            }
            let best = BertScore::best(scores).unwrap_or_default();
            let rescaled = |b: f64| (best.f1 - b) / (1.0 - b);
            out.push(baseline.map_or(best.f1, rescaled));
        }
    }
    Ok(out)
}

fn similarities(
    dir: &Path,
    device: &Device,
    pooling: Pooling,
    items: &[Item],
) -> CliResult<Vec<f64>> {
    let encoder = open(dir, device)?;
    let mut out = Vec::with_capacity(items.len());
    for chunk in items.chunks(CHUNK) {
        let said = encoder.sentences(&texts(chunk, |item| vec![item.candidate]), pooling)?;
        let meant = encoder.sentences(&texts(chunk, |item| item.references.clone()), pooling)?;
        let mut meant = meant.iter();
        for (item, candidate) in chunk.iter().zip(&said) {
            let mut best = f64::NEG_INFINITY;
            for reference in meant.by_ref().take(item.references.len()) {
                best = best.max(cosine(candidate, reference)?);
            }
            out.push(best);
        }
    }
    Ok(out)
}
