//! CIDEr-D as the COCO caption evaluation computes it (called "CIDEr" there), and plain CIDEr.
//!
//! Vedantam, Zitnick, Parikh: "CIDEr: Consensus-based image description evaluation", CVPR 2015;
//! constants and the missing stemming as in pycocoevalcap's `cider_scorer`.

use std::collections::HashMap;

use crate::grams::{Gram, Grams, intersect};

/// Width of CIDEr-D's length penalty, in bigrams.
const SIGMA: f64 = 6.0;

/// Document frequencies: the number of items whose references contain each n-gram.
#[derive(Default)]
pub(crate) struct Frequencies {
    items: HashMap<Gram, u32>,
    n_items: usize,
}

impl Frequencies {
    /// Counts the references of an item.
    pub(crate) fn add(&mut self, references: &[Grams]) {
        self.n_items += 1;
        let mut seen: Vec<Gram> = references
            .iter()
            .flat_map(|r| r.counts.iter().flatten().map(|&(gram, _)| gram))
            .collect();
        seen.sort_unstable();
        seen.dedup();
        for gram in seen {
            *self.items.entry(gram).or_default() += 1;
        }
    }

    /// Logarithm of the number of items. With one item, every weight is ln 1 = 0, and the score is 0.
    pub(crate) fn ln_items(&self) -> f64 {
        (self.n_items.max(1) as f64).ln()
    }

    /// (CIDEr-D, plain CIDEr) of an item, both x10.
    pub(crate) fn cider(
        &self,
        candidate: &Grams,
        references: &[Grams],
        ln_items: f64,
    ) -> (f64, f64) {
        let weigh = |grams: &Grams| Weighted::of(grams, &self.items, ln_items);
        let c = weigh(candidate);
        let (mut clipped, mut full) = (0.0, 0.0);
        for reference in references {
            let (similarity_d, similarity) = c.similarity(&weigh(reference));
            clipped += similarity_d;
            full += similarity;
        }
        // Mean over n = 1..4, mean over references, times 10.
        let scale = 10.0 / 4.0 / references.len().max(1) as f64;
        (clipped * scale, full * scale)
    }
}

/// TF-IDF vector of a sentence per n.
struct Weighted {
    weights: [Vec<(Gram, f64)>; 4],
    norms: [f64; 4],
    n_bigrams: f64,
}

impl Weighted {
    fn of(grams: &Grams, frequency: &HashMap<Gram, u32>, ln_items: f64) -> Self {
        let weights: [Vec<(Gram, f64)>; 4] = std::array::from_fn(|i| {
            let weigh = |&(gram, count): &(Gram, u32)| {
                let df = frequency.get(&gram).copied().unwrap_or(0).max(1);
                (gram, f64::from(count) * (ln_items - f64::from(df).ln()))
            };
            grams.counts[i].iter().map(weigh).collect()
        });
        let norms =
            std::array::from_fn(|i| weights[i].iter().map(|(_, w)| w * w).sum::<f64>().sqrt());
        Self {
            weights,
            norms,
            n_bigrams: f64::from(grams.total(1)),
        }
    }

    /// Sums over n of (CIDEr-D, CIDEr) similarity to a reference.
    fn similarity(&self, reference: &Self) -> (f64, f64) {
        let delta = self.n_bigrams - reference.n_bigrams;
        let penalty = (-(delta * delta) / (2.0 * SIGMA * SIGMA)).exp();
        let (mut clipped_sum, mut full_sum) = (0.0, 0.0);
        for i in 0..4 {
            let (mut clipped, mut full) = (0.0, 0.0);
            intersect(&self.weights[i], &reference.weights[i], |_, h, r| {
                clipped += h.min(r) * r;
                full += h * r;
            });
            let norm = self.norms[i] * reference.norms[i];
            if norm != 0.0 {
                clipped /= norm;
                full /= norm;
            }
            clipped_sum += clipped * penalty;
            full_sum += full;
        }
        (clipped_sum, full_sum)
    }
}
