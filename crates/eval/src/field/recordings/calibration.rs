//! Does the confidence of a sentence equal the probability that it is right?

use serde::Serialize;

/// Number of equally wide bins of the reliability table.
const N_BINS: usize = 10;

/// One bin of the reliability table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ReliabilityBin {
    /// Lower and upper edge of the confidence.
    pub confidence: [f64; 2],
    /// Number of sentences.
    pub n: usize,
    /// Mean confidence.
    pub mean_confidence: f64,
    /// Share of right sentences.
    pub right: f64,
}

/// Calibration of confidences.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Calibration {
    /// Bins with at least one sentence.
    pub bins: Vec<ReliabilityBin>,
    /// Expected calibration error: mean distance between confidence and share of right sentences over the bins,
    /// weighted by their numbers of sentences (Guo et al., On Calibration of Modern Neural Networks, ICML 2017).
    pub expected_error: f64,
    /// Share of right sentences among those with the highest confidence, for a coverage of 100, 75, 50 and 25 %.
    pub right_at_coverage: [(f64, f64); 4],
}

impl Calibration {
    /// Calibration of (confidence, right) pairs; `None` without pairs.
    ///
    /// ```
    /// use radarllm_eval::recordings::calibration::Calibration;
    ///
    /// // Confidence 0.9, and nine of ten are right.
    /// let pairs: Vec<(f64, bool)> = (0..10).map(|i| (0.9, i > 0)).collect();
    /// let calibration = Calibration::of(&pairs).unwrap();
    /// assert!(calibration.expected_error < 1e-9);
    /// ```
    pub fn of(pairs: &[(f64, bool)]) -> Option<Self> {
        if pairs.is_empty() {
            return None;
        }
        let right = |pairs: &[(f64, bool)]| {
            pairs.iter().filter(|p| p.1).count() as f64 / pairs.len().max(1) as f64
        };
        let bin_of = |confidence: f64| ((confidence * N_BINS as f64) as usize).min(N_BINS - 1);
        let mut bins = Vec::new();
        for bin in 0..N_BINS {
            let own: Vec<(f64, bool)> = pairs
                .iter()
                .filter(|p| bin_of(p.0) == bin)
                .copied()
                .collect();
            if own.is_empty() {
                continue;
            }
            bins.push(ReliabilityBin {
                confidence: [bin, bin + 1].map(|edge| edge as f64 / N_BINS as f64),
                n: own.len(),
                mean_confidence: own.iter().map(|p| p.0).sum::<f64>() / own.len() as f64,
                right: right(&own),
            });
        }
        let mut sorted = pairs.to_vec();
        sorted.sort_by(|a, b| b.0.total_cmp(&a.0));
        Some(Self {
            expected_error: bins
                .iter()
                .map(|b| b.n as f64 * (b.mean_confidence - b.right).abs())
                .sum::<f64>()
                / pairs.len() as f64,
            bins,
            right_at_coverage: [1.0, 0.75, 0.5, 0.25].map(|coverage| {
                let n = ((coverage * sorted.len() as f64).round() as usize).max(1);
                (coverage, right(&sorted[..n]))
            }),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overconfidence_is_the_expected_error() {
        // Confidence 0.75, and a quarter is right: the error is one half.
        let pairs: Vec<(f64, bool)> = (0..40).map(|i| (0.75, i % 4 == 0)).collect();
        let calibration = Calibration::of(&pairs).unwrap();
        assert!((calibration.expected_error - 0.5).abs() < 1e-12);
        assert_eq!(calibration.bins.len(), 1);
        assert_eq!(calibration.bins[0].n, 40);
        assert_eq!(Calibration::of(&[]), None);
    }

    #[test]
    fn the_confident_half_is_scored_alone() {
        let pairs = [(0.9, true), (0.8, true), (0.2, false), (0.1, true)];
        let coverage = Calibration::of(&pairs).unwrap().right_at_coverage;
        assert_eq!(coverage[0], (1.0, 0.75));
        assert_eq!(coverage[2], (0.5, 1.0));
        // A confidence of one lies in the last bin.
        assert_eq!(
            Calibration::of(&[(1.0, true)]).unwrap().bins[0].confidence,
            [0.9, 1.0]
        );
    }
}
