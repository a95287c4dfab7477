//! Self-BLEU: the similarity of captions to each other. Lower values mean more variety.
//!
//! Texygen's definition (Zhu et al. 2018): each sentence is scored against all others by nltk's
//! `sentence_bleu`, uniform weights, here n = 4 and smoothing `method1` (Chen and Cherry 2014).

use std::collections::HashMap;

use crate::grams::{Gram, Grams};

/// nltk's epsilon of `method1`.
const EPSILON: f64 = 0.1;

/// Score of each sentence against all others, 0..1. Empty for fewer than two sentences.
pub(crate) fn self_bleu(sentences: &[Grams]) -> Vec<f64> {
    if sentences.len() < 2 {
        return Vec::new();
    }
    // The clip count of an n-gram is its largest count in any *other* sentence. The largest and
    // second largest counts over all sentences determine it without comparing every pair.
    let mut tops: HashMap<Gram, Top> = HashMap::new();
    for (who, sentence) in sentences.iter().enumerate() {
        for &(gram, count) in sentence.counts.iter().flatten() {
            tops.entry(gram).or_default().add(who, count);
        }
    }
    let mut n_of_len: std::collections::BTreeMap<usize, usize> = std::collections::BTreeMap::new();
    for sentence in sentences {
        *n_of_len.entry(sentence.len).or_default() += 1;
    }
    let lengths: Vec<(usize, usize)> = n_of_len.into_iter().collect();

    let score = |(who, sentence): (usize, &Grams)| {
        let others = lengths
            .iter()
            .filter(|&&(len, n)| n > usize::from(len == sentence.len));
        let closest = others
            .map(|&(len, _)| (len.abs_diff(sentence.len), len))
            .min();
        let reference_len = closest.map_or(0, |(_, len)| len);
        let mut ln_precision = 0.0;
        for (i, counts) in sentence.counts.iter().enumerate() {
            let clip = |gram| tops.get(gram).map_or(0, |top: &Top| top.without(who));
            let matches: u32 = counts
                .iter()
                .map(|(gram, count)| (*count).min(clip(gram)))
                .sum();
            if i == 0 && matches == 0 {
                return 0.0;
            }
            // Sentences shorter than n still count one n-gram.
            let total = f64::from(sentence.total(i).max(1));
            let matches = if matches == 0 {
                EPSILON
            } else {
                f64::from(matches)
            };
            ln_precision += 0.25 * (matches / total).ln();
        }
        let penalty = if sentence.len > reference_len {
            1.0
        } else {
            (1.0 - reference_len as f64 / sentence.len as f64).exp()
        };
        penalty * ln_precision.exp()
    };
    sentences.iter().enumerate().map(score).collect()
}

/// The two largest counts of an n-gram, and the index of the sentence with the largest one.
#[derive(Default)]
struct Top {
    holder: usize,
    first: u32,
    second: u32,
}

impl Top {
    fn add(&mut self, who: usize, count: u32) {
        if count > self.first {
            (self.holder, self.second, self.first) = (who, self.first, count);
        } else {
            self.second = self.second.max(count);
        }
    }

    fn without(&self, who: usize) -> u32 {
        if who == self.holder {
            self.second
        } else {
            self.first
        }
    }
}
