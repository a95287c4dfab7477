//! Computes all metrics of a corpus.
//!
//! The captions are read twice, first for CIDEr's document frequencies, then for everything else, so that no
//! item's n-grams are kept in memory.

use std::collections::{BTreeMap, HashMap, HashSet};

use serde::{Deserialize, Serialize};

use crate::bleu::{BleuStats, Rules};
use crate::bootstrap::{self, Interval};
use crate::cider::Frequencies;
use crate::grams::{Grams, Vocabulary};
use crate::meteor::{Meteor, MeteorStats, Resources, nltk::meteor_nltk};
use crate::{Protocol, rouge, self_bleu, tokens};
use radarllm_base::random::SplitMix64;

/// Maximum number of captions in the Self-BLEU sample.
const SELF_BLEU_SAMPLE: usize = 1000;
/// Maximum number of groups that the bootstrap resamples. It bounds memory and computing time. If there are more
/// motions, motion n belongs to group n modulo this number.
const MAX_GROUPS: usize = 20_000;
/// Maximum number of words in a caption. Tokenisation and matching take time at least quadratic in the length.
const MAX_WORDS: usize = 1000;
const MAX_BYTES: usize = 20_000;
/// Number of references per item in the protocol `motiongpt`.
const MOTIONGPT_REFERENCES: usize = 3;
/// Maximum number of ids in an error or in a list of empty candidates.
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

/// Scoring options.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScoreOptions {
    /// Tokenisation and rules.
    pub protocol: Protocol,
    /// Maximum number of references per item, of which the first are used; 0 means all.
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
    #[error("{list}: {n} ids occur more than once, first `{id}`")]
    Duplicate {
        /// `candidates` or `references`.
        list: &'static str,
        /// Number of such ids.
        n: usize,
        /// First such id.
        id: String,
    },
    /// Ids that occur in only one list. Scoring the others would silently drop items.
    #[error("{n} ids are missing from the {list}, first {ids:?}")]
    Missing {
        /// List that lacks them.
        list: &'static str,
        /// Number of such ids.
        n: usize,
        /// The first of them.
        ids: Vec<String>,
    },
    /// An item without reference captions.
    #[error("references: {n} items have no text, first `{id}`")]
    NoReference {
        /// Number of such items.
        n: usize,
        /// Item.
        id: String,
    },
    /// A caption that is too long.
    #[error(
        "{list}: `{id}` has a caption of {words} words and {bytes} bytes; at most 1000 words and 20000 bytes are scored"
    )]
    TooLong {
        /// `candidates` or `references`.
        list: &'static str,
        /// Item.
        id: String,
        /// Number of words.
        words: usize,
        /// Length, bytes.
        bytes: usize,
    },
    /// Protocol `motiongpt` fixes the number of references.
    #[error("protocol `motiongpt` takes 3 references of every item, not {max_references}")]
    FixedReferences {
        /// The requested number.
        max_references: usize,
    },
}

/// Corpus values. Field names are those of `radarllm score`'s JSON; 0..1 except CIDEr.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    /// Protocol of the values.
    pub protocol: Protocol,
    /// The protocol's tokenisation in words. ROUGE-1 and ROUGE-L always use rouge-score's, without stemming.
    pub tokenisation: String,
    /// Maximum number of references per item; 0 means all.
    pub max_references: usize,
    /// Items scored.
    pub items: usize,
    /// Candidates without a word. They are scored, with values of nearly 0.
    pub empty_candidates: usize,
    /// The first of their ids.
    pub empty_candidate_ids: Vec<String>,
    /// References without a word, among those that are used. They are scored like others.
    #[serde(default)]
    pub empty_references: usize,
    /// BLEU-1. COCO's rules; nmt's (shortest reference) under protocol `motiongpt`.
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
    /// METEOR 1.5; nltk's under protocol `motiongpt`.
    pub meteor: Option<f64>,
    /// Matchers that METEOR used.
    pub meteor_matchers: Option<Vec<String>>,
    /// The variant of METEOR, and the origin of its function words.
    #[serde(default)]
    pub meteor_rules: Option<String>,
    /// CIDEr-D, COCO, x10 included.
    pub cider_d: f64,
    /// Plain CIDEr, x10 included.
    pub cider: f64,
    /// Self-BLEU of the candidates.
    pub self_bleu: Option<f64>,
    /// BERTScore F1.
    pub bert_score: Option<f64>,
    /// Origin of the encoder's weights, and the method.
    #[serde(default)]
    pub bert_score_rules: Option<String>,
    /// SimCSE cosine.
    pub sim_cse: Option<f64>,
    /// Origin of the encoder's weights, and the method.
    #[serde(default)]
    pub sim_cse_rules: Option<String>,
    /// Why a value is null, by field name; and of one item, why CIDEr is 0.
    pub reason: BTreeMap<String, String>,
    /// 95 % intervals, by field name.
    pub ci95: BTreeMap<String, Interval>,
    /// How the intervals were computed.
    pub bootstrap: BootstrapInfo,
}

/// How intervals were computed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BootstrapInfo {
    /// The resampled unit: `motion`, the part of the id before `#`.
    pub unit: String,
    /// Number of motions.
    pub units: usize,
    /// Number of groups that are resampled: one per motion, at most 20,000.
    #[serde(default)]
    pub groups: usize,
    /// Resamples.
    pub resamples: usize,
    /// Seed.
    pub seed: u64,
}

/// Scores candidates against references; the ids must agree. Values and intervals depend only on the
/// arguments; items are in the order of `references`. METEOR uses the built-in tables.
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
    score_with(candidates, references, options, &Resources::default())
}

/// As `score`, but with other tables for METEOR. Protocol `motiongpt` does not use them.
///
/// # Errors
/// See [`ScoreError`].
pub fn score_with(
    candidates: &[Candidate],
    references: &[Reference],
    options: &ScoreOptions,
    resources: &Resources,
) -> Result<Scores, ScoreError> {
    let ScoreOptions {
        protocol,
        max_references,
        n_resamples,
        seed,
    } = *options;
    let is_motiongpt = protocol == Protocol::MotionGpt;
    if is_motiongpt && max_references != MOTIONGPT_REFERENCES {
        return Err(ScoreError::FixedReferences { max_references });
    }
    let items = align(candidates, references, max_references)?;

    let mut vocabulary = Vocabulary::default();
    let mut frequencies = Frequencies::default();
    for item in &items {
        check_length("candidates", item.id, item.candidate)?;
        for text in item.references {
            check_length("references", item.id, text)?;
        }
        let texts: Vec<String> = item
            .references(protocol)
            .map(|t| protocol.normalise_for_cider(t))
            .collect();
        frequencies.add(&vocabulary.grams(&texts));
    }
    let ln_items = if is_motiongpt && items.len() == 1 {
        // nlg-metricverse uses 1 for a single item.
        1.0
    } else {
        frequencies.ln_items()
    };

    let units = bootstrap::units_of_ids(items.iter().map(|i| i.id));
    let n_units = units.iter().max().map_or(0, |m| m + 1);
    let n_groups = n_units.min(MAX_GROUPS);
    let mut sums = vec![0.0; n_groups * WIDTH];
    let mut total = vec![0.0; WIDTH];
    let mut meteor = Meteor::new(resources);
    let mut empty = Vec::new();
    let mut n_empty = 0;
    let mut n_empty_references = 0;
    // Self-BLEU is computed for a sample of the items and therefore has its own count and sum.
    let sample = sample(items.len(), SELF_BLEU_SAMPLE, seed);
    let mut chosen: Vec<Grams> = Vec::with_capacity(sample.len());
    for (index, (item, unit)) in items.iter().zip(&units).enumerate() {
        let candidate = protocol.normalise(item.candidate);
        let texts: Vec<String> = item
            .references(protocol)
            .map(|t| protocol.normalise(t))
            .collect();
        let candidate_grams = vocabulary.one(&candidate);
        let reference_grams = vocabulary.grams(&texts);
        if candidate_grams.len == 0 {
            n_empty += 1;
            if empty.len() < NAMED_IDS {
                empty.push(item.id.to_string());
            }
        }
        n_empty_references += reference_grams.iter().filter(|g| g.len == 0).count();
        let (cider_d, cider) = if is_motiongpt {
            let raw = |t: &str| protocol.normalise_for_cider(t);
            let texts: Vec<String> = item.references(protocol).map(raw).collect();
            let candidate = vocabulary.one(&raw(item.candidate));
            frequencies.cider(&candidate, &vocabulary.grams(&texts), ln_items)
        } else {
            frequencies.cider(&candidate_grams, &reference_grams, ln_items)
        };
        let rouge_candidate = tokens::rouge_score(item.candidate);
        let rouge_references: Vec<_> = item.references(protocol).map(tokens::rouge_score).collect();
        let (mean_meteor, meteor_stats) = if is_motiongpt {
            let references: Vec<Vec<&str>> =
                texts.iter().map(|t| tokens::words(t).collect()).collect();
            let candidate: Vec<&str> = tokens::words(&candidate).collect();
            (meteor_nltk(&candidate, &references), MeteorStats::default())
        } else {
            (0.0, meteor.stats(&candidate, &texts))
        };
        let bleu = BleuStats::of(&candidate_grams, &reference_grams);
        let reference_len = if is_motiongpt {
            bleu.shortest_len
        } else {
            bleu.reference_len
        };
        let means = [
            1.0,
            rouge::rouge_1(&rouge_candidate, &rouge_references),
            rouge::rouge_l(&rouge_candidate, &rouge_references),
            rouge::rouge_l_coco(&candidate, &texts),
            cider_d,
            cider,
            mean_meteor,
            0.0,
            0.0,
        ];
        let row = (bleu.correct.into_iter())
            .chain(bleu.guess)
            .chain([bleu.candidate_len, reference_len])
            .chain(means)
            .chain(meteor_stats.corpus_columns());
        let group = &mut sums[unit % n_groups * WIDTH..][..WIDTH];
        for ((sum, total), v) in group.iter_mut().zip(&mut total).zip(row) {
            *sum += v;
            *total += v;
        }
        if sample.binary_search(&index).is_ok() {
            chosen.push(candidate_grams);
        }
    }
    let mut self_bleu_total = [0.0; 2];
    for (&i, value) in sample.iter().zip(self_bleu::self_bleu(&chosen)) {
        let group = &mut sums[units[i] % n_groups * WIDTH..][..WIDTH];
        for ((sum, total), v) in group[SELF_COUNT..]
            .iter_mut()
            .zip(&mut self_bleu_total)
            .zip([1.0, value])
        {
            *sum += v;
            *total += v;
        }
    }
    total[SELF_COUNT..][..2].copy_from_slice(&self_bleu_total);

    let rules = if is_motiongpt {
        Rules::Nmt
    } else {
        Rules::Coco
    };
    let statistic = |sums: &[f64]| corpus_values(sums, rules);
    let values = statistic(&total);
    let self_bleu = (chosen.len() > 1).then_some(values[9]);
    let found = bootstrap::intervals_of_sums(&sums, WIDTH, n_resamples, seed, statistic);
    let mut ci95: BTreeMap<String, Interval> =
        FIELDS.into_iter().map(str::to_string).zip(found).collect();
    // A resample can miss Self-BLEU's sample entirely. There is then no interval.
    ci95.retain(|_, interval| interval.iter().all(|v| v.is_finite()));

    let mut reason: BTreeMap<String, String> = [
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
    if items.len() == 1 {
        // As in coco-caption: the weight of an n-gram is the logarithm of items per item that has it, here ln 1.
        for field in ["cider", "cider_d"] {
            reason.insert(
                field.into(),
                "0 by definition: with one item, every n-gram is in all items and has no weight; score two or more"
                    .into(),
            );
        }
    }
    let (matchers, meteor_rules) = if is_motiongpt {
        (
            vec!["exact", "stem", "synonym"],
            "nltk 3.10, mean over items".to_string(),
        )
    } else {
        let words = resources.function_word_list();
        (
            resources.matchers(),
            format!("METEOR 1.5, corpus statistics, function words: {words}"),
        )
    };
    Ok(Scores {
        protocol,
        tokenisation: protocol.tokenisation().into(),
        max_references,
        items: items.len(),
        empty_candidates: n_empty,
        empty_candidate_ids: empty,
        empty_references: n_empty_references,
        bleu_1: values[0],
        bleu_2: values[1],
        bleu_3: values[2],
        bleu_4: values[3],
        rouge_1: values[4],
        rouge_l: values[5],
        rouge_l_coco: values[6],
        meteor: Some(values[10]),
        meteor_matchers: Some(matchers.into_iter().map(str::to_string).collect()),
        meteor_rules: Some(meteor_rules),
        cider_d: values[7],
        cider: values[8],
        self_bleu,
        bert_score: None,
        bert_score_rules: None,
        sim_cse: None,
        sim_cse_rules: None,
        reason,
        ci95,
        bootstrap: BootstrapInfo {
            unit: "motion".into(),
            units: n_units,
            groups: n_groups,
            resamples: n_resamples,
            seed,
        },
    })
}

/// Fields in the order of [`corpus_values`].
const FIELDS: [&str; 11] = [
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
    "meteor",
];
/// Number of columns of the additive statistics: 10 of BLEU, the item count, 3 of ROUGE, 2 of CIDEr, nltk's METEOR,
/// count and sum of Self-BLEU, and those of METEOR 1.5.
const WIDTH: usize = METEOR + MeteorStats::WIDTH;
const COUNT: usize = 10;
const MEAN_METEOR: usize = 16;
const SELF_COUNT: usize = 17;
const METEOR: usize = 19;

fn corpus_values(sums: &[f64], rules: Rules) -> Vec<f64> {
    let stats = BleuStats {
        correct: std::array::from_fn(|i| sums[i]),
        guess: std::array::from_fn(|i| sums[4 + i]),
        candidate_len: sums[8],
        reference_len: sums[9],
        shortest_len: sums[9],
        ..BleuStats::default()
    };
    let mean = |column: usize| sums[column] / sums[COUNT];
    let meteor = if rules == Rules::Nmt {
        mean(MEAN_METEOR)
    } else {
        MeteorStats::from_columns(&std::array::from_fn(|i| sums[METEOR + i])).score()
    };
    let self_bleu = sums[SELF_COUNT + 1] / sums[SELF_COUNT];
    stats
        .by(rules)
        .into_iter()
        .chain((COUNT + 1..MEAN_METEOR).map(mean))
        .chain([self_bleu, meteor])
        .collect()
}

fn check_length(list: &'static str, id: &str, text: &str) -> Result<(), ScoreError> {
    let words = tokens::words(text).count();
    if words > MAX_WORDS || text.len() > MAX_BYTES {
        return Err(ScoreError::TooLong {
            list,
            id: id.to_string(),
            words,
            bytes: text.len(),
        });
    }
    Ok(())
}

/// One item to score.
struct Item<'a> {
    id: &'a str,
    candidate: &'a str,
    references: &'a [String],
}

impl Item<'_> {
    /// The references that are used. Protocol `motiongpt` repeats them until there are three: one becomes a, a, a, and
    /// two become a, b, a.
    fn references(&self, protocol: Protocol) -> impl Iterator<Item = &str> {
        let n = match protocol {
            Protocol::MotionGpt => MOTIONGPT_REFERENCES,
            _ => self.references.len(),
        };
        self.references.iter().cycle().take(n).map(String::as_str)
    }
}

fn align<'a>(
    candidates: &'a [Candidate],
    references: &'a [Reference],
    max_references: usize,
) -> Result<Vec<Item<'a>>, ScoreError> {
    if candidates.is_empty() && references.is_empty() {
        return Err(ScoreError::Empty);
    }
    unique("candidates", candidates.iter().map(|c| &c.id))?;
    unique("references", references.iter().map(|r| &r.id))?;
    let text_of: HashMap<&str, &str> = candidates
        .iter()
        .map(|c| (c.id.as_str(), c.text.as_str()))
        .collect();
    let known: HashSet<&str> = references.iter().map(|r| r.id.as_str()).collect();
    let mut without = references.iter().filter(|r| r.texts.is_empty());
    if let Some(first) = without.next() {
        return Err(ScoreError::NoReference {
            n: 1 + without.count(),
            id: first.id.clone(),
        });
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
            .filter(|id| !known.contains(id.as_str()))
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
    let max = if max_references == 0 {
        usize::MAX
    } else {
        max_references
    };
    let item = |r: &'a Reference| Item {
        id: &r.id,
        candidate: text_of.get(r.id.as_str()).copied().unwrap_or_default(),
        references: &r.texts[..r.texts.len().min(max)],
    };
    Ok(references.iter().map(item).collect())
}

fn unique<'a>(list: &'static str, ids: impl Iterator<Item = &'a String>) -> Result<(), ScoreError> {
    let mut seen = HashSet::new();
    let again: Vec<&String> = ids.filter(|id| !seen.insert(id.as_str())).collect();
    let Some(first) = again.first() else {
        return Ok(());
    };
    Err(ScoreError::Duplicate {
        list,
        n: again.iter().collect::<HashSet<_>>().len(),
        id: (*first).clone(),
    })
}

/// Draws `k` of `0..n` in increasing order, or all if there are no more than `k` (a partial Fisher-Yates shuffle).
fn sample(n: usize, k: usize, seed: u64) -> Vec<usize> {
    let mut all: Vec<usize> = (0..n).collect();
    if n > k {
        // The bootstrap's stream starts from the seed itself. This stream must differ from it.
        let mut rng = SplitMix64::new(seed ^ 0x5e1f_b1e0);
        for i in 0..k {
            let j = i + rng.below(n - i);
            all.swap(i, j);
        }
        all.truncate(k);
        all.sort_unstable();
    }
    all
}
