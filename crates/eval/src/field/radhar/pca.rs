//! Principal components of rows that are known by their scalar products.
//!
//! The left singular vectors of the centred rows are the eigenvectors of their Gram matrix, which is small where there are
//! far more columns than rows. They are found by the randomised range finder with subspace iteration (Halko, Martinsson
//! and Tropp, SIAM Review 53, 2011, algorithms 4.4 and 5.3). No matrix of the width of the rows is ever made.

use radarllm_base::random::nth_normal;
use rayon::prelude::*;

use super::sparse::Gram;

/// Random directions beyond the requested number of components.
const N_EXTRA: usize = 10;
/// Multiplications by the Gram matrix after the first one; each counts as a power iteration of the rows.
const N_ITERATIONS: usize = 3;
/// Sweeps of the Jacobi method; it converges quadratically, in fewer than ten.
const MAX_SWEEPS: usize = 30;

/// Principal components of some of the rows of a [`Gram`] matrix.
#[derive(Clone, Debug)]
pub struct Pca {
    /// The rows that it was fitted to.
    rows: Vec<usize>,
    /// Mean scalar product of each of these rows with all of them.
    means: Vec<f64>,
    /// Mean of `means`.
    grand_mean: f64,
    /// Of each fitted row, its coefficients in the components: `[row][component]`.
    coefficients: Vec<f64>,
    variances: Vec<f64>,
    total_variance: f64,
}

impl Pca {
    /// At most `n_components` components of these rows, in order of falling variance; fewer if the rows span fewer.
    ///
    /// `None` for fewer than two rows, or rows that are all equal.
    pub fn fit(gram: &Gram, rows: &[usize], n_components: usize, seed: u64) -> Option<Self> {
        let n = rows.len();
        if n < 2 || n_components == 0 {
            return None;
        }
        let means: Vec<f64> = rows.iter().map(|row| mean_of(gram, *row, rows)).collect();
        let grand_mean = means.iter().sum::<f64>() / n as f64;
        let centred: Vec<f64> = (0..n * n)
            .map(|i| {
                let (a, b) = (i / n, i % n);
                gram.product(rows[a], rows[b]) - means[a] - means[b] + grand_mean
            })
            .collect();
        let trace: f64 = (0..n).map(|i| centred[i * n + i]).sum();
        if trace.is_nan() || trace <= 0.0 {
            return None;
        }
        let m = (n_components + N_EXTRA).min(n - 1);
        let directions: Vec<f64> = (0..n * m).map(|i| nth_normal(seed, i as u64)).collect();
        let mut basis = orthonormal(multiplied(&centred, &directions, n, m), n, m);
        for _ in 0..N_ITERATIONS {
            basis = orthonormal(multiplied(&centred, &basis, n, m), n, m);
        }
        let image = multiplied(&centred, &basis, n, m);
        let mut small = vec![0.0; m * m];
        for (q, y) in basis.chunks_exact(m).zip(image.chunks_exact(m)) {
            for (q, small) in q.iter().zip(small.chunks_exact_mut(m)) {
                small.iter_mut().zip(y).for_each(|(s, y)| *s += q * y);
            }
        }
        let (values, vectors) = symmetric_eigen(small, m);
        let mut order: Vec<usize> = (0..m).collect();
        order.sort_by(|a, b| values[*b].total_cmp(&values[*a]));
        // Below this, an eigenvalue is rounding.
        order.retain(|i| values[*i] > 1e-10 * trace);
        order.truncate(n_components);
        let mut coefficients = Vec::with_capacity(n * order.len());
        for q in basis.chunks_exact(m) {
            for i in &order {
                let entry: f64 = (0..m).map(|j| q[j] * vectors[j * m + i]).sum();
                coefficients.push(entry / values[*i].sqrt());
            }
        }
        let degrees = (n - 1) as f64;
        Some(Self {
            rows: rows.to_vec(),
            means,
            grand_mean,
            coefficients,
            variances: order.iter().map(|i| values[*i] / degrees).collect(),
            total_variance: trace / degrees,
        })
    }

    /// Variance of each component over the fitted rows, n - 1 degrees of freedom.
    pub fn variances(&self) -> &[f64] {
        &self.variances
    }

    /// Share of the variance of the fitted rows that the components have, 0..=1.
    pub fn explained(&self) -> f64 {
        self.variances.iter().sum::<f64>() / self.total_variance
    }

    /// Scores of a row of the Gram matrix: its coordinates along the components, from the mean of the fitted rows.
    pub fn scores(&self, gram: &Gram, row: usize) -> Vec<f64> {
        let n_components = self.variances.len();
        let mean = mean_of(gram, row, &self.rows);
        let mut scores = vec![0.0; n_components];
        let coefficients = self.coefficients.chunks_exact(n_components.max(1));
        for ((fitted, own_mean), coefficients) in
            self.rows.iter().zip(&self.means).zip(coefficients)
        {
            let product = gram.product(row, *fitted) - mean - own_mean + self.grand_mean;
            for (score, coefficient) in scores.iter_mut().zip(coefficients) {
                *score += product * coefficient;
            }
        }
        scores
    }
}

/// Mean scalar product of a row with some rows.
fn mean_of(gram: &Gram, row: usize, rows: &[usize]) -> f64 {
    let products = gram.row(row);
    rows.iter().map(|other| products[*other]).sum::<f64>() / rows.len() as f64
}

/// A symmetric `n x n` matrix times an `n x m` one.
fn multiplied(matrix: &[f64], other: &[f64], n: usize, m: usize) -> Vec<f64> {
    let mut out = vec![0.0; n * m];
    out.par_chunks_mut(m.max(1))
        .zip(matrix.par_chunks(n))
        .for_each(|(out, row)| {
            for (factor, other) in row.iter().zip(other.chunks_exact(m)) {
                for (out, value) in out.iter_mut().zip(other) {
                    *out += factor * value;
                }
            }
        });
    out
}

/// Orthonormal columns of the same span, by Gram-Schmidt, twice for accuracy. Columns that depend on others become zero.
fn orthonormal(matrix: Vec<f64>, n: usize, m: usize) -> Vec<f64> {
    let mut columns: Vec<Vec<f64>> = (0..m)
        .map(|j| (0..n).map(|i| matrix[i * m + j]).collect())
        .collect();
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    for j in 0..m {
        let (before, rest) = columns.split_at_mut(j);
        let column = &mut rest[0];
        let length = dot(column, column).sqrt();
        for _ in 0..2 {
            for other in before.iter() {
                let product = dot(column, other);
                for (value, other) in column.iter_mut().zip(other) {
                    *value -= product * other;
                }
            }
        }
        let left = dot(column, column).sqrt();
        let factor = match left > 1e-12 * length {
            true => 1.0 / left,
            false => 0.0,
        };
        column.iter_mut().for_each(|value| *value *= factor);
    }
    let mut out = vec![0.0; n * m];
    for (j, column) in columns.iter().enumerate() {
        for (i, value) in column.iter().enumerate() {
            out[i * m + j] = *value;
        }
    }
    out
}

/// Eigenvalues and eigenvectors (columns) of a symmetric `m x m` matrix by the cyclic Jacobi method (Golub and Van Loan,
/// Matrix Computations, section 8.5).
fn symmetric_eigen(mut a: Vec<f64>, m: usize) -> (Vec<f64>, Vec<f64>) {
    let mut vectors = vec![0.0; m * m];
    (0..m).for_each(|i| vectors[i * m + i] = 1.0);
    let total: f64 = a.iter().map(|v| v * v).sum();
    for _ in 0..MAX_SWEEPS {
        let off: f64 = (0..m * m)
            .filter(|i| i / m != i % m)
            .map(|i| a[i] * a[i])
            .sum();
        if off <= 1e-24 * total {
            break;
        }
        for p in 0..m {
            for q in p + 1..m {
                let apq = a[p * m + q];
                if apq == 0.0 {
                    continue;
                }
                let tau = (a[q * m + q] - a[p * m + p]) / (2.0 * apq);
                let t = tau.signum() / (tau.abs() + tau.hypot(1.0));
                let cos = 1.0 / t.hypot(1.0);
                let sin = t * cos;
                for k in 0..m {
                    let (kp, kq) = (a[k * m + p], a[k * m + q]);
                    a[k * m + p] = cos * kp - sin * kq;
                    a[k * m + q] = sin * kp + cos * kq;
                }
                for k in 0..m {
                    let (pk, qk) = (a[p * m + k], a[q * m + k]);
                    a[p * m + k] = cos * pk - sin * qk;
                    a[q * m + k] = sin * pk + cos * qk;
                    let (vp, vq) = (vectors[k * m + p], vectors[k * m + q]);
                    vectors[k * m + p] = cos * vp - sin * vq;
                    vectors[k * m + q] = sin * vp + cos * vq;
                }
            }
        }
    }
    ((0..m).map(|i| a[i * m + i]).collect(), vectors)
}

#[cfg(test)]
mod tests {
    use super::super::sparse::SparseRows;
    use super::*;

    fn gram(rows: &[Vec<f64>]) -> Gram {
        let mut sparse = SparseRows::new(rows[0].len());
        for row in rows {
            sparse.push(row.iter().map(|v| *v as f32).enumerate());
        }
        sparse.gram()
    }

    #[test]
    fn components_of_a_known_covariance_are_its_axes() {
        // Points at +-a along one axis and +-b along another, from a mean far from the origin: the covariance is known.
        let axes = [[0.6, 0.8, 0.0], [0.8, -0.6, 0.0]];
        let lengths = [3.0, 1.0];
        let mean = [10.0, -4.0, 2.0];
        let mut rows = Vec::new();
        for (axis, length) in axes.iter().zip(lengths) {
            for sign in [-1.0, 1.0] {
                let place = |k: usize| mean[k] + sign * length * axis[k];
                rows.push((0..3).map(place).collect::<Vec<f64>>());
            }
        }
        // A further row that is not fitted.
        rows.push(vec![10.0 + 0.6, -4.0 + 0.8, 7.0]);
        let gram = gram(&rows);
        let pca = Pca::fit(&gram, &[0, 1, 2, 3], 5, 1).unwrap();
        // Two points at +-a among four: variance 2 a^2 / 3. The third direction has none.
        let expected = [6.0, 2.0 / 3.0];
        assert_eq!(pca.variances().len(), 2);
        for (variance, expected) in pca.variances().iter().zip(expected) {
            assert!((variance / expected - 1.0).abs() < 1e-5, "{variance}");
        }
        assert!((pca.explained() - 1.0).abs() < 1e-5);
        // One metre along the first axis; what is orthogonal to both is lost.
        let scores = pca.scores(&gram, 4);
        assert!((scores[0].abs() - 1.0).abs() < 1e-5, "{scores:?}");
        assert!(scores[1].abs() < 1e-5, "{scores:?}");
    }

    #[test]
    fn all_components_keep_distances_and_few_keep_the_largest() {
        let rows: Vec<Vec<f64>> = (0..40)
            .map(|i| {
                let value = |k: u64| nth_normal(7, i * 30 + k) * 0.8_f64.powi(k as i32);
                (0..30).map(value).collect()
            })
            .collect();
        let gram = gram(&rows);
        let fitted: Vec<usize> = (0..40).collect();
        let all = Pca::fit(&gram, &fitted, 40, 1).unwrap();
        assert_eq!(all.variances().len(), 30);
        let scores: Vec<Vec<f64>> = (0..40).map(|row| all.scores(&gram, row)).collect();
        for (a, b) in [(0, 1), (5, 17), (38, 39)] {
            let pairs = scores[a].iter().zip(&scores[b]);
            let squared: f64 = pairs.map(|(x, y)| (x - y) * (x - y)).sum();
            assert!((squared / gram.squared_distance(a, b) - 1.0).abs() < 1e-4);
        }
        let few = Pca::fit(&gram, &fitted, 5, 2).unwrap();
        for (few, all) in few.variances().iter().zip(all.variances()) {
            // The randomised method sees 15 of 30 directions, with four multiplications.
            assert!((few / all - 1.0).abs() < 1e-3, "{few} {all}");
        }
        assert!(few.explained() < 0.95);
    }

    #[test]
    fn equal_rows_have_no_components() {
        let gram = gram(&vec![vec![1.0, 2.0]; 5]);
        assert!(Pca::fit(&gram, &[0, 1, 2, 3, 4], 2, 1).is_none());
        assert!(Pca::fit(&gram, &[0], 2, 1).is_none());
    }
}
