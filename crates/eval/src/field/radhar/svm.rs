//! A support vector machine with a kernel of radial basis functions, one against one, trained by sequential minimal
//! optimisation.
//!
//! The working set is chosen by second-order information (Fan, Chen and Lin, JMLR 6, 2005), as in LIBSVM, without shrinking.
//! Kernels are matrices that the caller computes from squared distances, by [`rbf`].

/// Violation of the optimality conditions at which training ends.
const TOLERANCE: f64 = 1e-3;
/// Curvature that replaces one that is not positive.
const MIN_CURVATURE: f64 = 1e-12;
/// Updates after which the training of a machine ends without having converged.
const MAX_UPDATES: usize = 200_000;

/// The kernel `exp(-gamma d^2)`.
pub fn rbf(squared_distance: f64, gamma: f64) -> f64 {
    (-gamma * squared_distance).exp()
}

/// A trained classifier.
#[derive(Clone, Debug)]
pub struct Svm {
    n_classes: usize,
    machines: Vec<Machine>,
    n_unfinished: usize,
}

/// The decision between two classes.
#[derive(Clone, Debug)]
struct Machine {
    /// Classes of positive and negative decisions.
    classes: [usize; 2],
    /// Training rows with their weights in the decision.
    support: Vec<(usize, f64)>,
    bias: f64,
}

impl Svm {
    /// Trains a machine for every pair of classes that occur. `kernel` has the kernel of each pair of training rows,
    /// `[row][row]`; `penalty` is the constant C of the soft margin.
    ///
    /// `None` for a kernel of another size, a label that is not below `n_classes`, or without rows.
    pub fn train(kernel: &[f32], labels: &[usize], n_classes: usize, penalty: f64) -> Option<Self> {
        let n = labels.len();
        if n == 0 || kernel.len() != n * n || labels.iter().any(|label| *label >= n_classes) {
            return None;
        }
        let of_class = |class: usize| (0..n).filter(move |row| labels[*row] == class);
        let mut machines = Vec::new();
        let mut n_unfinished = 0;
        for a in 0..n_classes {
            for b in a + 1..n_classes {
                let rows: Vec<usize> = of_class(a).chain(of_class(b)).collect();
                let is_pair = of_class(a).next().is_some() && of_class(b).next().is_some();
                if !is_pair {
                    continue;
                }
                let signs: Vec<f64> = rows
                    .iter()
                    .map(|row| if labels[*row] == a { 1.0 } else { -1.0 })
                    .collect();
                let of_row = |i: &usize| &kernel[i * n..][..n];
                let own = rows.iter().map(of_row);
                let own: Vec<f32> = own
                    .flat_map(|kernel| rows.iter().map(|j| kernel[*j]))
                    .collect();
                let solution = solve(&own, &signs, penalty);
                n_unfinished += usize::from(!solution.is_optimal);
                let weights = rows.iter().zip(&signs).zip(&solution.alphas);
                let weights = weights.map(|((row, sign), alpha)| (*row, sign * alpha));
                machines.push(Machine {
                    classes: [a, b],
                    support: weights.filter(|(_, weight)| *weight != 0.0).collect(),
                    bias: solution.bias,
                });
            }
        }
        // With a single class there is nothing to decide.
        if machines.is_empty() {
            machines.push(Machine {
                classes: [labels[0]; 2],
                support: Vec::new(),
                bias: 1.0,
            });
        }
        Some(Self {
            n_classes,
            machines,
            n_unfinished,
        })
    }

    /// The class with the largest number of decisions, the first one of several. `kernel` has the kernel of the row with
    /// each training row.
    pub fn predict(&self, kernel: &[f32]) -> usize {
        let mut votes = vec![0_usize; self.n_classes];
        for machine in &self.machines {
            let support = machine.support.iter();
            let sum: f64 = support
                .map(|(row, weight)| weight * f64::from(kernel[*row]))
                .sum();
            let is_second = sum + machine.bias <= 0.0;
            votes[machine.classes[usize::from(is_second)]] += 1;
        }
        let max = votes.iter().max().copied().unwrap_or_default();
        votes.iter().position(|n| *n == max).unwrap_or_default()
    }

    /// Number of pairs of classes whose training ended before it had converged.
    pub fn n_unfinished(&self) -> usize {
        self.n_unfinished
    }
}

struct Solution {
    alphas: Vec<f64>,
    bias: f64,
    is_optimal: bool,
}

/// Minimises `1/2 a'Qa - sum a` for `0 <= a <= C` and `sum a s = 0`, where `Q[i][j] = s[i] s[j] K[i][j]`.
fn solve(kernel: &[f32], signs: &[f64], penalty: f64) -> Solution {
    let n = signs.len();
    let row = |i: usize| &kernel[i * n..][..n];
    let mut alphas = vec![0.0; n];
    let mut gradient = vec![-1.0; n];
    // An alpha may move so that its decision grows, or falls.
    let may_grow = |alpha: f64, sign: f64| {
        if sign > 0.0 {
            alpha < penalty
        } else {
            alpha > 0.0
        }
    };
    let may_fall = |alpha: f64, sign: f64| {
        if sign > 0.0 {
            alpha > 0.0
        } else {
            alpha < penalty
        }
    };
    let room = |alpha: f64, is_up: bool| if is_up { penalty - alpha } else { alpha };
    let (mut up, mut down) = (0.0, 0.0);
    let mut is_optimal = false;
    for _ in 0..MAX_UPDATES {
        let mut first = None;
        (up, down) = (f64::NEG_INFINITY, f64::INFINITY);
        for t in 0..n {
            let value = -signs[t] * gradient[t];
            if may_grow(alphas[t], signs[t]) && value > up {
                (up, first) = (value, Some(t));
            }
            if may_fall(alphas[t], signs[t]) {
                down = down.min(value);
            }
        }
        let Some(i) = first else {
            is_optimal = true;
            break;
        };
        if up - down < TOLERANCE {
            is_optimal = true;
            break;
        }
        let row_i = row(i);
        let mut second = None;
        let mut best_gain = 0.0;
        for t in 0..n {
            let violation = up + signs[t] * gradient[t];
            if !may_fall(alphas[t], signs[t]) || violation <= 0.0 {
                continue;
            }
            let curvature = f64::from(row_i[i]) + f64::from(row(t)[t]) - 2.0 * f64::from(row_i[t]);
            let curvature = curvature.max(MIN_CURVATURE);
            let gain = violation * violation / curvature;
            if gain > best_gain {
                best_gain = gain;
                second = Some((t, violation / curvature));
            }
        }
        let Some((j, step)) = second else {
            is_optimal = true;
            break;
        };
        let step = step
            .min(room(alphas[i], signs[i] > 0.0))
            .min(room(alphas[j], signs[j] < 0.0));
        // Rounding must not leave an alpha a little inside its bound.
        let moved = |alpha: f64, by: f64| match alpha + by {
            near if near < 1e-12 * penalty => 0.0,
            near if near > (1.0 - 1e-12) * penalty => penalty,
            inside => inside,
        };
        alphas[i] = moved(alphas[i], signs[i] * step);
        alphas[j] = moved(alphas[j], -signs[j] * step);
        let row_j = row(j);
        for t in 0..n {
            let change = f64::from(row_i[t]) - f64::from(row_j[t]);
            gradient[t] += signs[t] * step * change;
        }
    }
    let is_free = |t: &usize| alphas[*t] > 0.0 && alphas[*t] < penalty;
    let free = (0..n).filter(is_free);
    let (n_free, sum) = free.fold((0.0, 0.0), |(n_free, sum), t| {
        (n_free + 1.0, sum - signs[t] * gradient[t])
    });
    let bias = match n_free > 0.0 {
        true => sum / n_free,
        false => 0.5 * (up + down),
    };
    Solution {
        alphas,
        bias,
        is_optimal,
    }
}

#[cfg(test)]
mod tests {
    use radarllm_base::random::SplitMix64;

    use super::*;

    fn kernel(a: &[[f64; 2]], b: &[[f64; 2]], gamma: f64) -> Vec<f32> {
        let value = |p: &[f64; 2], q: &[f64; 2]| {
            rbf((p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2), gamma) as f32
        };
        a.iter()
            .flat_map(|p| b.iter().map(move |q| value(p, q)))
            .collect()
    }

    #[test]
    fn two_points_have_the_closed_form() {
        // Two points of both signs: alpha = 1 / (1 - K), no bias, and decisions of exactly +-1.
        let k = 0.5_f32;
        let solution = solve(&[1.0, k, k, 1.0], &[1.0, -1.0], 100.0);
        assert!(solution.is_optimal);
        for alpha in solution.alphas {
            assert!((alpha - 2.0).abs() < 1e-3, "{alpha}");
        }
        assert!(solution.bias.abs() < 1e-6);
        // A small C bounds both.
        let bounded = solve(&[1.0, k, k, 1.0], &[1.0, -1.0], 0.5);
        assert_eq!(bounded.alphas, [0.5, 0.5]);
    }

    #[test]
    fn exclusive_or_is_learned_with_a_wide_kernel() {
        let points = [[0.0, 0.0], [1.0, 1.0], [0.0, 1.0], [1.0, 0.0]];
        let labels = [0, 0, 1, 1];
        let svm = Svm::train(&kernel(&points, &points, 1.0), &labels, 2, 1e3).unwrap();
        assert_eq!(svm.n_unfinished(), 0);
        let shifted = points.map(|[x, y]| [x + 0.1, y - 0.1]);
        for (row, label) in kernel(&shifted, &points, 1.0).chunks(4).zip(labels) {
            assert_eq!(svm.predict(row), label);
        }
    }

    #[test]
    fn separable_clusters_are_told_apart_and_shuffled_labels_are_chance() {
        let mut rng = SplitMix64::new(3);
        let centres = [[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [4.0, 4.0], [2.0, 8.0]];
        let mut draw = |n: usize| -> (Vec<[f64; 2]>, Vec<usize>) {
            let point = |i: usize| {
                let [x, y] = centres[i % 5];
                ([x + rng.uniform_f64(), y + rng.uniform_f64()], i % 5)
            };
            (0..n).map(point).unzip()
        };
        let (train, labels) = draw(200);
        let (test, truth) = draw(500);
        let right = |labels: &[usize]| {
            let svm = Svm::train(&kernel(&train, &train, 0.5), labels, 5, 10.0).unwrap();
            let rows = kernel(&test, &train, 0.5);
            let rows = rows.chunks(200).zip(&truth);
            rows.filter(|(row, label)| svm.predict(row) == **label)
                .count()
        };
        assert_eq!(right(&labels), 500);
        // Labels that have nothing to do with the place: a fifth is right by chance, give or take the clusters.
        let shuffled: Vec<usize> = (0..200).map(|i| (i / 5) % 5).collect();
        assert!((25..=175).contains(&right(&shuffled)));
    }

    #[test]
    fn classes_without_rows_are_never_predicted() {
        let points = [[0.0, 0.0], [1.0, 0.0]];
        let svm = Svm::train(&kernel(&points, &points, 1.0), &[1, 4], 5, 1.0).unwrap();
        assert_eq!(svm.predict(&[1.0, 0.4]), 1);
        assert_eq!(svm.predict(&[0.4, 1.0]), 4);
        let one = Svm::train(&[1.0], &[2], 5, 1.0).unwrap();
        assert_eq!(one.predict(&[0.3]), 2);
        assert!(Svm::train(&[], &[], 5, 1.0).is_none());
        assert!(Svm::train(&[1.0], &[5], 5, 1.0).is_none());
    }
}
