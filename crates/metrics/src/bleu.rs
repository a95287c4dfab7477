//! BLEU-1..4 by the COCO caption evaluation's rules (pycocoevalcap's `bleu_scorer`, option
//! `closest`), from statistics that add up over items.

use crate::grams::{Grams, intersect};

/// Values of BLEU-1, BLEU-2, BLEU-3, BLEU-4.
pub type Bleu = [f64; 4];

/// What one item, or a sum of items, contributes.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct BleuStats {
    /// Clipped n-gram matches, n = 1..4.
    pub correct: [f64; 4],
    /// N-grams of the candidate.
    pub guess: [f64; 4],
    /// Words of the candidate.
    pub candidate_len: f64,
    /// Words of the reference closest in length, the shorter one on a tie.
    pub reference_len: f64,
}

impl BleuStats {
    /// Statistics of one candidate against its references (at least one).
    pub(crate) fn of(candidate: &Grams, references: &[Grams]) -> Self {
        let mut stats = Self {
            candidate_len: candidate.len as f64,
            ..Self::default()
        };
        let closest = references
            .iter()
            .map(|r| (r.len.abs_diff(candidate.len), r.len))
            .min();
        stats.reference_len = closest.map_or(0.0, |(_, len)| len as f64);
        for i in 0..4 {
            stats.guess[i] = f64::from(candidate.total(i));
            let mut most: Vec<u32> = vec![0; candidate.counts[i].len()];
            for reference in references {
                // Position in the candidate's list rides along as its value.
                let indexed: Vec<_> = candidate.counts[i]
                    .iter()
                    .enumerate()
                    .map(|(k, &(gram, _))| (gram, k))
                    .collect();
                intersect(&indexed, &reference.counts[i], |_, k, count| {
                    most[k] = most[k].max(count)
                });
            }
            let matches = candidate.counts[i]
                .iter()
                .zip(most)
                .map(|(&(_, count), most)| count.min(most));
            stats.correct[i] = f64::from(matches.sum::<u32>());
        }
        stats
    }

    /// Adds another item.
    pub fn add(&mut self, other: &Self) {
        for i in 0..4 {
            self.correct[i] += other.correct[i];
            self.guess[i] += other.guess[i];
        }
        self.candidate_len += other.candidate_len;
        self.reference_len += other.reference_len;
    }

    /// BLEU-1..4. No smoothing beyond COCO's 1e-15 and 1e-9, which keep 0/0 at about 0.
    pub fn bleu(&self) -> Bleu {
        const SMALL: f64 = 1e-9;
        const TINY: f64 = 1e-15;
        let ratio = (self.candidate_len + TINY) / (self.reference_len + SMALL);
        let penalty = if ratio < 1.0 {
            (1.0 - 1.0 / ratio).exp()
        } else {
            1.0
        };
        let mut product = 1.0;
        std::array::from_fn(|i| {
            product *= (self.correct[i] + TINY) / (self.guess[i] + SMALL);
            product.powf(1.0 / (i + 1) as f64) * penalty
        })
    }
}
