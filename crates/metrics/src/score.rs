//! All metrics of a corpus at once.

use std::collections::{BTreeMap, HashMap};

use serde::{Deserialize, Serialize};

use crate::bleu::BleuStats;
use crate::bootstrap::{self, Interval};
use crate::grams::{Grams, Vocabulary};
use crate::rng::Rng;
use crate::{Protocol, cider, rouge, self_bleu, tokens};

/// Captions that Self-BLEU looks at, at most.
const SELF_BLEU_SAMPLE: usize = 1000;
/// Ids that an error or a list of empty candidates names, at most.
const NAMED_IDS: usize = 20;

/// A generated caption.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Candidate {
    /// Clip id.
    pub id: String,
    /// Caption.
    pub text: String,
}

/// Reference captions of a clip.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reference {
    /// Clip id.
    pub id: String,
    /// At least one caption.
    pub texts: Vec<String>,
}

/// How to score.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScoreOptions {
    /// Tokenisation and rules.
    pub protocol: Protocol,
    /// Only the first so many references of an item count; 0 means all.
    pub max_references: usize,
    /// Bootstrap resamples; 0 leaves `ci95` empty.
    pub n_resamples: usize,
    /// Seed of the bootstrap and of Self-BLEU's sample.
    pub seed: u64,
}

impl Default for ScoreOptions {
    fn default() -> Self {
        Self {
            protocol: Protocol::Plain,
            max_references: 3,
            n_resamples: 1000,
            seed: 0,
        }
    }
}

/// Why a corpus cannot be scored.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ScoreError {
    /// Nothing to score.
    #[error("no candidates and no references")]
    Empty,
    /// An id occurs twice in one list.
    #[error("{list}: id `{id}` occurs more than once")]
    Duplicate {
        /// `candidates` or `references`.
        list: &'static str,
        /// First such id.
        id: String,
    },
    /// Ids that only one list has. Scoring the rest would silently drop items.
    #[error("{n} ids are missing from the {list}, first {ids:?}")]
    Missing {
        /// List that lacks them.
        list: &'static str,
        /// How many.
        n: usize,
        /// The first of them.
        ids: Vec<String>,
    },
    /// An item without reference captions.
    #[error("references: `{id}` has no text")]
    NoReference {
        /// Item.
        id: String,
    },
    /// The protocol's tokenisation is not implemented; another's values would be wrong.
    #[error("protocol `{protocol}` is not supported yet; use plain or nlg-eval")]
    Unsupported {
        /// Name.
        protocol: &'static str,
    },
}

/// Corpus values. Field names are those of `radarllm score`'s JSON; 0..1 except CIDEr.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// Rules in force.
    pub protocol: Protocol,
    /// Its tokenisation in words. ROUGE-1 and ROUGE-L always use rouge-score's, without stemming.
    pub tokenisation: String,
    /// References per item at most; 0 means all.
    pub max_references: usize,
    /// Items scored.
    pub items: usize,
    /// Candidates without a word. They are scored, as nearly 0.
    pub empty_candidates: usize,
    /// The first of their ids.
    pub empty_candidate_ids: Vec<String>,
    /// BLEU-1, COCO rules.
    pub bleu_1: f64,
    /// BLEU-2.
    pub bleu_2: f64,
    /// BLEU-3.
    pub bleu_3: f64,
    /// BLEU-4.
    pub bleu_4: f64,
    /// ROUGE-1 F1, rouge-score.
    pub rouge_1: f64,
    /// ROUGE-L F1, rouge-score.
    pub rouge_l: f64,
    /// ROUGE-L, COCO.
    pub rouge_l_coco: f64,
    /// METEOR.
    pub meteor: Option<f64>,
    /// Matchers that METEOR used.
    pub meteor_matchers: Option<Vec<String>>,
    /// CIDEr-D, COCO, x10 included.
    pub cider_d: f64,
    /// Plain CIDEr, x10 included.
    pub cider: f64,
    /// Self-BLEU of the candidates.
    pub self_bleu: Option<f64>,
    /// BERTScore F1.
    pub bert_score: Option<f64>,
    /// SimCSE cosine.
    pub sim_cse: Option<f64>,
    /// Why a value is null, by field name.
    pub reason: BTreeMap<String, String>,
    /// 95 % intervals, by field name.
    pub ci95: BTreeMap<String, Interval>,
    /// How they were made.
    pub bootstrap: BootstrapInfo,
}

/// How intervals were made.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BootstrapInfo {
    /// What is drawn: `motion`, the part of the id before `#`.
    pub unit: String,
    /// Motions.
    pub units: usize,
    /// Resamples.
    pub resamples: usize,
    /// Seed.
    pub seed: u64,
}

/// Scores candidates against references; ids must agree. Values and intervals depend on the
/// arguments only, items count in the order of `references`.
///
/// Intervals hold CIDEr's document frequencies and Self-BLEU's pool fixed.
///
/// # Errors
/// See [`ScoreError`].
pub fn score(
    candidates: &[Candidate],
    references: &[Reference],
    options: &ScoreOptions,
) -> Result<Scores, ScoreError> {
    let ScoreOptions {
        protocol,
        max_references,
        n_resamples,
        seed,
    } = *options;
    let items = align(candidates, references, max_references)?;
    let normalise = |text: &str| {
        protocol.normalise(text).ok_or(ScoreError::Unsupported {
            protocol: protocol.name(),
        })
    };

    let mut vocabulary = Vocabulary::default();
    let mut grams = Vec::with_capacity(items.len());
    let mut rows: Vec<Vec<f64>> = Vec::with_capacity(items.len());
    let mut empty = Vec::new();
    for item in &items {
        let candidate = normalise(item.candidate)?;
        let texts = item
            .references
            .iter()
            .map(|t| normalise(t))
            .collect::<Result<Vec<_>, _>>()?;
        let mut count = |text: &str| Grams::of(&vocabulary.numbers(tokens::words(text)));
        let candidate_grams = count(&candidate);
        let reference_grams: Vec<Grams> = texts.iter().map(|t| count(t)).collect();
        if candidate_grams.len == 0 {
            empty.push(item.id.to_string());
        }
        let rouge_candidate = tokens::rouge_score(item.candidate);
        let rouge_references: Vec<_> = item
            .references
            .iter()
            .map(|t| tokens::rouge_score(t))
            .collect();
        let mut row = bleu_row(&BleuStats::of(&candidate_grams, &reference_grams));
        row.extend([
            1.0,
            rouge::rouge_1(&rouge_candidate, &rouge_references),
            rouge::rouge_l(&rouge_candidate, &rouge_references),
            rouge::rouge_l_coco(&candidate, &texts),
        ]);
        rows.push(row);
        grams.push((candidate_grams, reference_grams));
    }
    let cider = cider::cider(&grams);
    for ((row, d), plain) in rows.iter_mut().zip(cider.cider_d).zip(cider.cider) {
        row.extend([d, plain]);
    }
    // Self-BLEU's items are a sample of the others: own counter and sum.
    let sample = sample(grams.len(), SELF_BLEU_SAMPLE, seed);
    let chosen: Vec<Grams> = sample.iter().map(|&i| grams[i].0.clone()).collect();
    rows.iter_mut().for_each(|row| row.extend([0.0, 0.0]));
    for (&i, value) in sample.iter().zip(self_bleu::self_bleu(&chosen)) {
        rows[i][SELF_COUNT] = 1.0;
        rows[i][SELF_COUNT + 1] = value;
    }

    let units = bootstrap::units_of_ids(items.iter().map(|i| i.id));
    let mut total = vec![0.0; WIDTH];
    for row in &rows {
        total.iter_mut().zip(row).for_each(|(sum, v)| *sum += v);
    }
    let values = corpus_values(&total);
    let self_bleu = (chosen.len() > 1).then_some(values[9]);
    let mut ci95: BTreeMap<String, Interval> = FIELDS
        .into_iter()
        .map(str::to_string)
        .zip(bootstrap::intervals(
            &rows,
            &units,
            n_resamples,
            seed,
            corpus_values,
        ))
        .collect();
    // A resample may miss Self-BLEU's sample altogether: then there is no interval.
    ci95.retain(|_, interval| interval.iter().all(|v| v.is_finite()));

    let mut reason: BTreeMap<String, String> = [
        ("meteor", "METEOR is not implemented yet"),
        ("bert_score", "not run: no weights given (--bert-score DIR)"),
        ("sim_cse", "not run: no weights given (--sim-cse DIR)"),
    ]
    .into_iter()
    .map(|(field, why)| (field.to_string(), why.to_string()))
    .collect();
    if self_bleu.is_none() {
        ci95.remove("self_bleu");
        reason.insert("self_bleu".into(), "needs at least two candidates".into());
    }
    Ok(Scores {
        protocol,
        tokenisation: protocol.tokenisation().into(),
        max_references,
        items: items.len(),
        empty_candidates: empty.len(),
        empty_candidate_ids: empty.into_iter().take(NAMED_IDS).collect(),
        bleu_1: values[0],
        bleu_2: values[1],
        bleu_3: values[2],
        bleu_4: values[3],
        rouge_1: values[4],
        rouge_l: values[5],
        rouge_l_coco: values[6],
        meteor: None,
        meteor_matchers: None,
        cider_d: values[7],
        cider: values[8],
        self_bleu,
        bert_score: None,
        sim_cse: None,
        reason,
        ci95,
        bootstrap: BootstrapInfo {
            unit: "motion".into(),
            units: units.iter().max().map_or(0, |m| m + 1),
            resamples: n_resamples,
            seed,
        },
    })
}

/// Fields in the order of [`corpus_values`].
const FIELDS: [&str; 10] = [
    "bleu_1",
    "bleu_2",
    "bleu_3",
    "bleu_4",
    "rouge_1",
    "rouge_l",
    "rouge_l_coco",
    "cider_d",
    "cider",
    "self_bleu",
];
/// Columns of the additive statistics: 10 of BLEU, item count, 3 ROUGE, 2 CIDEr, Self-BLEU count
/// and sum.
const WIDTH: usize = 18;
const COUNT: usize = 10;
const SELF_COUNT: usize = 16;

fn bleu_row(stats: &BleuStats) -> Vec<f64> {
    let lengths = [stats.candidate_len, stats.reference_len];
    stats
        .correct
        .into_iter()
        .chain(stats.guess)
        .chain(lengths)
        .collect()
}

fn corpus_values(sums: &[f64]) -> Vec<f64> {
    let stats = BleuStats {
        correct: std::array::from_fn(|i| sums[i]),
        guess: std::array::from_fn(|i| sums[4 + i]),
        candidate_len: sums[8],
        reference_len: sums[9],
    };
    let means = sums[COUNT + 1..SELF_COUNT]
        .iter()
        .map(|sum| sum / sums[COUNT]);
    let self_bleu = sums[SELF_COUNT + 1] / sums[SELF_COUNT];
    stats
        .bleu()
        .into_iter()
        .chain(means)
        .chain([self_bleu])
        .collect()
}

/// One item to score.
struct Item<'a> {
    id: &'a str,
    candidate: &'a str,
    references: &'a [String],
}

fn align<'a>(
    candidates: &'a [Candidate],
    references: &'a [Reference],
    max_references: usize,
) -> Result<Vec<Item<'a>>, ScoreError> {
    if candidates.is_empty() && references.is_empty() {
        return Err(ScoreError::Empty);
    }
    let mut text_of: HashMap<&str, &str> = HashMap::new();
    for c in candidates {
        if text_of.insert(&c.id, &c.text).is_some() {
            return Err(ScoreError::Duplicate {
                list: "candidates",
                id: c.id.clone(),
            });
        }
    }
    let mut known: HashMap<&str, ()> = HashMap::new();
    for r in references {
        if known.insert(&r.id, ()).is_some() {
            return Err(ScoreError::Duplicate {
                list: "references",
                id: r.id.clone(),
            });
        }
        if r.texts.is_empty() {
            return Err(ScoreError::NoReference { id: r.id.clone() });
        }
    }
    let lacking = |list, ids: Vec<&String>| match ids.len() {
        0 => Ok(()),
        n => Err(ScoreError::Missing {
            list,
            n,
            ids: ids.into_iter().take(NAMED_IDS).cloned().collect(),
        }),
    };
    lacking(
        "references",
        candidates
            .iter()
            .map(|c| &c.id)
            .filter(|id| !known.contains_key(id.as_str()))
            .collect(),
    )?;
    lacking(
        "candidates",
        references
            .iter()
            .map(|r| &r.id)
            .filter(|id| !text_of.contains_key(id.as_str()))
            .collect(),
    )?;
    let most = if max_references == 0 {
        usize::MAX
    } else {
        max_references
    };
    let item = |r: &'a Reference| Item {
        id: &r.id,
        candidate: text_of.get(r.id.as_str()).copied().unwrap_or_default(),
        references: &r.texts[..r.texts.len().min(most)],
    };
    Ok(references.iter().map(item).collect())
}

/// `k` of `0..n` in increasing order, all if there are no more (Fisher-Yates, cut short).
fn sample(n: usize, k: usize, seed: u64) -> Vec<usize> {
    let mut all: Vec<usize> = (0..n).collect();
    if n > k {
        // Another stream than the bootstrap's, which starts from the seed itself.
        let mut rng = Rng::new(seed ^ 0x5e1f_b1e0);
        for i in 0..k {
            let j = i + rng.below(n - i);
            all.swap(i, j);
        }
        all.truncate(k);
        all.sort_unstable();
    }
    all
}
