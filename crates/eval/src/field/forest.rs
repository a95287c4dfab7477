//! Extremely randomised trees (Geurts, Ernst and Wehenkel, Machine Learning 2006).
//!
//! ```
//! use radarllm_eval::forest::Forest;
//!
//! // Two classes that differ in the first feature.
//! let rows: Vec<Vec<f32>> = (0..40).map(|i| vec![(i % 2) as f32 + 0.01 * i as f32, 1.0]).collect();
//! let labels: Vec<usize> = (0..40).map(|i| i % 2).collect();
//! let forest = Forest::fit(&rows, &labels, 2, 50, 1).unwrap();
//! assert!(forest.probabilities(&[0.1, 1.0])[0] > 0.8);
//! ```

use radarllm_base::{random::SplitMix64, seed::derive_seed};
use rayon::prelude::*;

/// Nodes with fewer rows are leaves.
const MIN_SPLIT: usize = 4;

/// A forest of extremely randomised trees with balanced class weights.
pub struct Forest {
    trees: Vec<Vec<Node>>,
    n_classes: usize,
    n_features: usize,
}

enum Node {
    Split {
        feature: usize,
        threshold: f32,
        /// Node for values below the threshold, and for the others.
        children: [usize; 2],
    },
    /// Probability of each class.
    Leaf(Vec<f32>),
}

struct Training<'a> {
    rows: &'a [Vec<f32>],
    labels: &'a [usize],
    /// Weight of each class: the same sum for all classes.
    weights: Vec<f64>,
    n_candidates: usize,
}

impl Forest {
    /// Fits `n_trees` trees; `None` for rows of unequal widths, without rows, or with a label that is not below
    /// `n_classes`.
    pub fn fit(
        rows: &[Vec<f32>],
        labels: &[usize],
        n_classes: usize,
        n_trees: usize,
        seed: u64,
    ) -> Option<Self> {
        let n_features = rows.first()?.len();
        let fits = rows
            .iter()
            .all(|r| r.len() == n_features && r.iter().all(|v| v.is_finite()))
            && labels.iter().all(|l| *l < n_classes);
        if !fits || rows.len() != labels.len() || n_features == 0 {
            return None;
        }
        let mut counts = vec![0.0_f64; n_classes];
        labels.iter().for_each(|l| counts[*l] += 1.0);
        let training = Training {
            rows,
            labels,
            weights: counts.iter().map(|n| 1.0 / n.max(1.0)).collect(),
            n_candidates: (n_features as f64).sqrt().round().max(1.0) as usize,
        };
        let tree = |i: usize| {
            let mut rng = SplitMix64::new(derive_seed(seed, &format!("tree-{i}")));
            let mut nodes = Vec::new();
            training.grow((0..rows.len()).collect(), &mut nodes, &mut rng);
            nodes
        };
        Some(Self {
            trees: (0..n_trees).into_par_iter().map(tree).collect(),
            n_classes,
            n_features,
        })
    }

    /// Mean probability of each class over the trees, for a row of the training width.
    pub fn probabilities(&self, row: &[f32]) -> Vec<f32> {
        let mut sum = vec![0.0; self.n_classes];
        if row.len() != self.n_features {
            return sum;
        }
        for tree in &self.trees {
            let mut at = 0;
            let leaf = loop {
                match &tree[at] {
                    Node::Leaf(p) => break p,
                    Node::Split {
                        feature,
                        threshold,
                        children,
                    } => at = children[usize::from(row[*feature] >= *threshold)],
                }
            };
            sum.iter_mut().zip(leaf).for_each(|(s, p)| *s += p);
        }
        let n_trees = self.trees.len().max(1) as f32;
        sum.iter_mut().for_each(|s| *s /= n_trees);
        sum
    }
}

impl Training<'_> {
    /// Adds the tree of these rows to `nodes` and returns the index of its root.
    fn grow(&self, rows: Vec<usize>, nodes: &mut Vec<Node>, rng: &mut SplitMix64) -> usize {
        let index = nodes.len();
        nodes.push(Node::Leaf(self.shares(&rows)));
        let pure = rows.iter().all(|r| self.labels[*r] == self.labels[rows[0]]);
        if rows.len() < MIN_SPLIT || pure {
            return index;
        }
        let Some((feature, threshold)) = self.split(&rows, rng) else {
            return index;
        };
        let (above, below): (Vec<usize>, Vec<usize>) = rows
            .into_iter()
            .partition(|r| self.rows[*r][feature] >= threshold);
        let below = self.grow(below, nodes, rng);
        let above = self.grow(above, nodes, rng);
        nodes[index] = Node::Split {
            feature,
            threshold,
            children: [below, above],
        };
        index
    }

    /// The best of a few random splits of random features, by the Gini impurity.
    fn split(&self, rows: &[usize], rng: &mut SplitMix64) -> Option<(usize, f32)> {
        let mut features: Vec<usize> = (0..self.rows[0].len()).collect();
        let mut best: Option<(f64, usize, f32)> = None;
        let mut n_tried = 0;
        // Features that are constant here cannot split and do not count.
        while n_tried < self.n_candidates && !features.is_empty() {
            let feature = features.swap_remove(rng.below(features.len()));
            let values = rows.iter().map(|r| self.rows[*r][feature]);
            let low = values.clone().fold(f32::INFINITY, f32::min);
            let high = values.fold(f32::NEG_INFINITY, f32::max);
            let threshold = low + (high - low) * rng.uniform_f32();
            if threshold <= low {
                continue;
            }
            n_tried += 1;
            let mut sums = [vec![0.0; self.weights.len()], vec![0.0; self.weights.len()]];
            for r in rows {
                let label = self.labels[*r];
                sums[usize::from(self.rows[*r][feature] >= threshold)][label] +=
                    self.weights[label];
            }
            let impurity: f64 = sums.iter().map(|s| weighted_gini(s)).sum();
            if best.is_none_or(|(min, ..)| impurity < min) {
                best = Some((impurity, feature, threshold));
            }
        }
        best.map(|(_, feature, threshold)| (feature, threshold))
    }

    fn shares(&self, rows: &[usize]) -> Vec<f32> {
        let mut sums = vec![0.0; self.weights.len()];
        for r in rows {
            sums[self.labels[*r]] += self.weights[self.labels[*r]];
        }
        let total: f64 = sums.iter().sum();
        sums.iter()
            .map(|s| (s / total.max(f64::MIN_POSITIVE)) as f32)
            .collect()
    }
}

/// Sum of the weights times the Gini impurity.
fn weighted_gini(sums: &[f64]) -> f64 {
    let total: f64 = sums.iter().sum();
    if total <= 0.0 {
        return 0.0;
    }
    total - sums.iter().map(|s| s * s).sum::<f64>() / total
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rings: no single feature separates the classes.
    fn rings(seed: u64) -> (Vec<Vec<f32>>, Vec<usize>) {
        let mut rng = SplitMix64::new(seed);
        (0..600)
            .map(|i| {
                let radius = (i % 3) as f32 + 0.6 * rng.uniform_f32();
                let (sin, cos) = (std::f32::consts::TAU * rng.uniform_f32()).sin_cos();
                (vec![radius * sin, radius * cos, rng.uniform_f32()], i % 3)
            })
            .unzip()
    }

    #[test]
    fn classes_that_no_feature_separates_are_recognised() {
        let ((rows, labels), (test, truth)) = (rings(1), rings(2));
        let forest = Forest::fit(&rows, &labels, 3, 100, 5).unwrap();
        let best = |row: &Vec<f32>| {
            let p = forest.probabilities(row);
            assert!((p.iter().sum::<f32>() - 1.0).abs() < 1e-4);
            (0..3).max_by(|a, b| p[*a].total_cmp(&p[*b])).unwrap()
        };
        let right = test
            .iter()
            .zip(&truth)
            .filter(|(r, t)| best(r) == **t)
            .count();
        assert!(right > 570, "{right} of 600");
        // The same seed gives the same forest.
        let again = Forest::fit(&rows, &labels, 3, 100, 5).unwrap();
        assert_eq!(
            again.probabilities(&test[0]),
            forest.probabilities(&test[0])
        );
    }

    #[test]
    fn unusable_rows_are_refused() {
        let (mut rows, labels) = rings(1);
        assert!(Forest::fit(&[], &[], 3, 10, 1).is_none());
        assert!(Forest::fit(&rows, &labels[1..], 3, 10, 1).is_none());
        assert!(Forest::fit(&rows, &labels, 2, 10, 1).is_none());
        rows[4][1] = f32::NAN;
        assert!(Forest::fit(&rows, &labels, 3, 10, 1).is_none());
        // Rows without any difference are one leaf.
        let same = vec![vec![1.0]; 6];
        let forest = Forest::fit(&same, &[0, 0, 0, 1, 1, 1], 2, 5, 1).unwrap();
        assert_eq!(forest.probabilities(&[1.0]), [0.5, 0.5]);
    }
}
