//! A plain classifier for train-on-simulated, test-on-recorded: multinomial logistic regression.
//!
//! Deliberately weak and deterministic: what is measured is the data, not the classifier.

/// Penalty on squared weights, relative to the mean loss: keeps a hundred features from fitting a
/// few hundred windows exactly.
const PENALTY: f64 = 1e-2;
/// Steps of gradient descent; the loss is flat well before.
const STEPS: usize = 400;
/// Heavy-ball momentum.
const MOMENTUM: f64 = 0.9;

/// A trained classifier.
#[derive(Clone, Debug, PartialEq)]
pub struct LogisticRegression {
    n_classes: usize,
    /// Mean and inverse deviation of each feature over the training rows.
    scale: Vec<(f64, f64)>,
    /// `[class][feature, then bias]`.
    weights: Vec<Vec<f64>>,
}

impl LogisticRegression {
    /// Trains on rows of one width with labels under `n_classes`; `None` if there is nothing to learn
    /// from: no rows, rows of different widths, a label out of range, a value that is not finite.
    ///
    /// Work: 400 passes over `rows x classes x features`.
    pub fn train(rows: &[Vec<f64>], labels: &[usize], n_classes: usize) -> Option<Self> {
        let width = rows.first()?.len();
        let usable = rows.len() == labels.len()
            && rows
                .iter()
                .all(|r| r.len() == width && r.iter().all(|v| v.is_finite()))
            && labels.iter().all(|l| *l < n_classes);
        if !usable {
            return None;
        }
        let n = rows.len() as f64;
        let scale: Vec<(f64, f64)> = (0..width)
            .map(|k| {
                let mean = rows.iter().map(|r| r[k]).sum::<f64>() / n;
                let variance = rows.iter().map(|r| (r[k] - mean).powi(2)).sum::<f64>() / n;
                // A constant feature says nothing.
                let inverse = if variance > 1e-12 {
                    1.0 / variance.sqrt()
                } else {
                    0.0
                };
                (mean, inverse)
            })
            .collect();
        let mut model = Self {
            n_classes,
            scale,
            weights: vec![vec![0.0; width + 1]; n_classes],
        };
        let scaled: Vec<Vec<f64>> = rows.iter().map(|r| model.scaled(r)).collect();
        // The loss of standardised rows has curvature of at most half of the mean squared row.
        let curvature = 0.5
            * scaled
                .iter()
                .flat_map(|r| r.iter().map(|v| v * v))
                .sum::<f64>()
            / n
            + PENALTY;
        let rate = 1.0 / curvature;
        let mut speed = vec![vec![0.0; width + 1]; n_classes];
        for _ in 0..STEPS {
            let mut gradient: Vec<Vec<f64>> = model
                .weights
                .iter()
                .map(|w| w.iter().map(|v| v * PENALTY).collect())
                .collect();
            for (row, &label) in scaled.iter().zip(labels) {
                for (class, p) in model.probabilities(row).into_iter().enumerate() {
                    let error = (p - f64::from(u8::from(class == label))) / n;
                    for (g, v) in gradient[class].iter_mut().zip(row) {
                        *g += error * v;
                    }
                }
            }
            for ((weights, speed), gradient) in
                model.weights.iter_mut().zip(&mut speed).zip(&gradient)
            {
                for ((w, s), g) in weights.iter_mut().zip(speed).zip(gradient) {
                    *s = MOMENTUM * *s - rate * g;
                    *w += *s;
                }
            }
        }
        Some(model)
    }

    /// The likeliest class of a row of the training width.
    pub fn predict(&self, row: &[f64]) -> usize {
        let p = self.probabilities(&self.scaled(row));
        (0..self.n_classes)
            .max_by(|a, b| p[*a].total_cmp(&p[*b]))
            .unwrap_or_default()
    }

    /// Standardised, with the bias' constant one at the end.
    fn scaled(&self, row: &[f64]) -> Vec<f64> {
        row.iter()
            .zip(&self.scale)
            .map(|(v, (mean, inverse))| (v - mean) * inverse)
            .chain([1.0])
            .collect()
    }

    fn probabilities(&self, scaled: &[f64]) -> Vec<f64> {
        let scores: Vec<f64> = self
            .weights
            .iter()
            .map(|w| w.iter().zip(scaled).map(|(a, b)| a * b).sum())
            .collect();
        let top = scores.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let powers: Vec<f64> = scores.iter().map(|s| (s - top).exp()).collect();
        let sum: f64 = powers.iter().sum();
        powers.into_iter().map(|p| p / sum).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_base::random::SplitMix64;

    /// Three clusters in the plane beside a constant and a noise feature.
    fn clusters(seed: u64) -> (Vec<Vec<f64>>, Vec<usize>) {
        let mut rng = SplitMix64::new(seed);
        let mut unit = || rng.below(2001) as f64 / 1000.0 - 1.0;
        let centres = [[0.0, 3.0], [3.0, 0.0], [-3.0, -3.0]];
        (0..150)
            .map(|i| {
                let [x, y] = centres[i % 3];
                (vec![x + unit(), y + unit(), 7.0, unit()], i % 3)
            })
            .unzip()
    }

    #[test]
    fn separable_clusters_are_told_apart_and_shuffled_labels_are_not() {
        let (rows, labels) = clusters(1);
        let (test, truth) = clusters(2);
        let right = |model: &LogisticRegression| {
            test.iter()
                .zip(&truth)
                .filter(|(r, l)| model.predict(r) == **l)
                .count()
        };
        let model = LogisticRegression::train(&rows, &labels, 3).unwrap();
        // Squares of side 2 whose centres are at least 4.2 apart do not touch.
        assert_eq!(right(&model), 150);
        // A rotation by one class: the same classifier must be wrong everywhere.
        let rotated: Vec<usize> = labels.iter().map(|l| (l + 1) % 3).collect();
        let model = LogisticRegression::train(&rows, &rotated, 3).unwrap();
        assert_eq!(right(&model), 0);
    }

    #[test]
    fn unusable_input_is_refused() {
        let (rows, labels) = clusters(1);
        assert!(LogisticRegression::train(&[], &[], 3).is_none());
        assert!(LogisticRegression::train(&rows, &labels[1..], 3).is_none());
        assert!(LogisticRegression::train(&rows, &labels, 2).is_none());
        let mut ragged = rows.clone();
        ragged[3].pop();
        assert!(LogisticRegression::train(&ragged, &labels, 3).is_none());
        let mut broken = rows;
        broken[3][0] = f64::NAN;
        assert!(LogisticRegression::train(&broken, &labels, 3).is_none());
    }
}
