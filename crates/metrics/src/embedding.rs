//! Arithmetic of BERTScore and SimCSE over the embeddings of an encoder (bert_score 0.3.13's rules).
//!
//! The encoder, the choice of its layer and its tokenizer are not in this module. bert_score compares [`BATCH`] pairs at
//! once and pads their sentences to equal lengths with positions whose similarity to every token is 0. A token that is
//! similar to nothing, with a negative best similarity, then counts 0 if the sentence opposite is not the longest of
//! its batch. [`padding`] says which sentences of which pairs are padded.

use std::collections::{HashMap, HashSet};

/// Number of tokens of an empty sentence: the two special tokens at its ends.
const SPECIAL_TOKENS: usize = 2;

/// Pairs that bert_score compares at once if it is not told otherwise.
pub const BATCH: usize = 64;

/// Which sentences of a pair are shorter than the longest one of their side in the batch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Padding {
    /// The candidate is padded: it offers a similarity of 0 to every token of the reference.
    pub candidate: bool,
    /// The same for the reference.
    pub reference: bool,
}

/// The padding of pairs in the order in which they are compared, from the numbers of tokens of their candidates and
/// references.
pub fn padding(lengths: &[(usize, usize)]) -> Vec<Padding> {
    let of_batch = |batch: &[(usize, usize)]| {
        let longest = |side: fn(&(usize, usize)) -> usize| batch.iter().map(side).max();
        let (candidate, reference) = (longest(|l| l.0), longest(|l| l.1));
        let padded = |l: &(usize, usize)| Padding {
            candidate: Some(l.0) < candidate,
            reference: Some(l.1) < reference,
        };
        batch.iter().map(padded).collect::<Vec<_>>()
    };
    lengths.chunks(BATCH).flat_map(of_batch).collect()
}

/// Why embeddings cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("embeddings: {problem}")]
pub struct EmbeddingError {
    /// What is wrong.
    pub problem: String,
}

fn wrong(problem: String) -> EmbeddingError {
    EmbeddingError { problem }
}

/// An encoded sentence, including the special tokens at its ends.
#[derive(Clone, Copy, Debug)]
pub struct Sentence<'a> {
    /// `[token][dimension]`, one layer's hidden states, not normalised.
    pub embeddings: &'a [f32],
    /// `[token]`, 0 for the special tokens, which still serve as match targets.
    pub weights: &'a [f64],
}

/// Precision, recall, F1.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct BertScore {
    /// Precision, over the candidate's tokens.
    pub precision: f64,
    /// Recall, over the reference's tokens.
    pub recall: f64,
    /// Harmonic mean; 0 if it is undefined.
    pub f1: f64,
}

impl BertScore {
    fn map2(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            precision: f(self.precision, other.precision),
            recall: f(self.recall, other.recall),
            f1: f(self.f1, other.f1),
        }
    }

    /// Maximum over several references, separately for precision, recall and F1. `None` without references.
    pub fn best(of: impl IntoIterator<Item = Self>) -> Option<Self> {
        of.into_iter().reduce(|a, b| a.map2(b, f64::max))
    }

    /// Rescaled with a baseline, `(x - b) / (1 - b)`.
    pub fn rescaled(self, baseline: Self) -> Self {
        self.map2(baseline, |x, b| (x - b) / (1.0 - b))
    }
}

/// BERTScore of one candidate and one reference, with the padding of their batch. A sentence that consists only of special tokens gives 0. So do
/// weights that are all 0, for which bert_score gives NaN precision and recall.
///
/// # Errors
/// No dimension, weights and embeddings of different lengths, values that are not finite.
pub fn bert_score(
    candidate: Sentence,
    reference: Sentence,
    dimension: usize,
    padding: Padding,
) -> Result<BertScore, EmbeddingError> {
    let c = normalised(candidate, dimension)?;
    let r = normalised(reference, dimension)?;
    if candidate.weights.len() <= SPECIAL_TOKENS || reference.weights.len() <= SPECIAL_TOKENS {
        return Ok(BertScore::default());
    }
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let best = |a: &[f64], others: &[f64], are_padded: bool| {
        let similarities = others.chunks_exact(dimension).map(|b| dot(a, b));
        let min = if are_padded { 0.0 } else { f64::NEG_INFINITY };
        similarities.fold(min, f64::max)
    };
    let weighted = |side: &[f64], weights: &[f64], others: &[f64], are_padded: bool| {
        let total: f64 = weights.iter().sum();
        let tokens = side.chunks_exact(dimension).zip(weights);
        let sum: f64 = tokens
            .map(|(token, w)| w * best(token, others, are_padded))
            .sum();
        if total == 0.0 { 0.0 } else { sum / total }
    };
    let precision = weighted(&c, candidate.weights, &r, padding.reference);
    let recall = weighted(&r, reference.weights, &c, padding.candidate);
    let f1 = 2.0 * precision * recall / (precision + recall);
    Ok(BertScore {
        precision,
        recall,
        f1: if f1.is_nan() { 0.0 } else { f1 },
    })
}

/// The embeddings of all tokens, normalised to length 1.
fn normalised(sentence: Sentence, dimension: usize) -> Result<Vec<f64>, EmbeddingError> {
    let Sentence {
        embeddings,
        weights,
    } = sentence;
    let expected = weights.len().checked_mul(dimension);
    if dimension == 0 || expected != Some(embeddings.len()) {
        return Err(wrong(format!(
            "{} values for {} tokens of dimension {dimension}",
            embeddings.len(),
            weights.len()
        )));
    }
    if embeddings.iter().any(|x| !x.is_finite())
        || weights.iter().any(|w| !w.is_finite() || *w < 0.0)
    {
        return Err(wrong(
            "a value or weight is not finite, or a weight is negative".into(),
        ));
    }
    let mut out: Vec<f64> = embeddings.iter().map(|&x| f64::from(x)).collect();
    for token in out.chunks_exact_mut(dimension) {
        let norm = token.iter().map(|x| x * x).sum::<f64>().sqrt();
        if norm == 0.0 {
            return Err(wrong("a token's embedding is all zero".into()));
        }
        token.iter_mut().for_each(|x| *x /= norm);
    }
    Ok(out)
}

/// Inverse document frequencies of token ids over all references, duplicates included.
#[derive(Clone, Debug, Default)]
pub struct Idf {
    n_documents: usize,
    frequency: HashMap<u32, usize>,
}

impl Idf {
    /// Counts references, each the ids of its tokens.
    pub fn of<'a>(documents: impl IntoIterator<Item = &'a [u32]>) -> Self {
        let mut this = Self::default();
        for document in documents {
            this.n_documents += 1;
            for id in document.iter().collect::<HashSet<_>>() {
                *this.frequency.entry(*id).or_default() += 1;
            }
        }
        this
    }

    /// ln((N + 1) / (df + 1)). The caller gives special tokens weight 0.
    pub fn weight(&self, id: u32) -> f64 {
        let df = self.frequency.get(&id).copied().unwrap_or(0);
        ((self.n_documents + 1) as f64 / (df + 1) as f64).ln()
    }
}

/// Cosine similarity of two sentence embeddings (SimCSE).
///
/// # Errors
/// Different lengths, all zero, values that are not finite.
pub fn cosine(a: &[f32], b: &[f32]) -> Result<f64, EmbeddingError> {
    if a.len() != b.len() {
        return Err(wrong(format!("{} values against {}", a.len(), b.len())));
    }
    let one = |x: &[f32]| {
        normalised(
            Sentence {
                embeddings: x,
                weights: &[1.0],
            },
            x.len(),
        )
    };
    Ok(one(a)?.iter().zip(one(b)?).map(|(x, y)| x * y).sum())
}
