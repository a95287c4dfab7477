//! Dynamic time warping of series of vectors, with a band (Sakoe and Chiba, 1978) and a lower bound (Keogh and Ratanamahatana,
//! 2005).
//!
//! ```
//! use radarllm_metrics::dtw::{Warping, warping};
//!
//! // The same series, one of them slower: nothing is left but time.
//! let (quick, slow) = ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0, 0.0]);
//! let Some(Warping { distance, steps }) = warping(&quick, &slow, 1, 3) else { panic!() };
//! assert_eq!((distance, steps), (0.0, 5));
//! ```

/// The best alignment of two series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Warping {
    /// Root of the sum of squared distances along the path.
    pub distance: f64,
    /// Pairs on the path; the shortest of the best paths.
    pub steps: usize,
}

impl Warping {
    /// Root of the mean squared distance over the steps of the path, so that the length of the series does not matter.
    pub fn normalised(&self) -> f64 {
        self.distance / (self.steps as f64).sqrt()
    }
}

/// Indices of the second series that may be aligned with index `i` of the first one: those that are less than `window` away
/// from both diagonals, where the diagonals of series of lengths `n` and `m` start at either end.
fn allowed(i: usize, n: usize, m: usize, window: usize) -> std::ops::Range<usize> {
    let low = (i + 1).saturating_sub(n.saturating_sub(m) + window);
    let high = (i + m.saturating_sub(n) + window).min(m);
    low..high
}

/// The best alignment within a band.
///
/// # Shapes
/// - `a`, `b`: `[step][width]` flattened
/// - `window`: shift from the diagonals below which steps may be aligned; 1 allows only the diagonals
/// - returns: `None` for series that are empty or no whole number of vectors, and for `window` or `width` 0
///
/// With the window of dtaidistance (`dtw_ndim.distance(a, b, window=window)`), the distance is that of this package.
pub fn warping(a: &[f64], b: &[f64], width: usize, window: usize) -> Option<Warping> {
    let (n, m) = lengths(a, b, width)?;
    if window == 0 {
        return None;
    }
    const FAR: (f64, usize) = (f64::INFINITY, usize::MAX);
    // Cost and steps of the best path to (i - 1, j - 1), with a border before the first step.
    let (mut previous, mut current) = (vec![FAR; m + 1], vec![FAR; m + 1]);
    previous[0] = (0.0, 0);
    for i in 0..n {
        current.fill(FAR);
        for j in allowed(i, n, m, window) {
            let cost = squared(row(a, i, width), row(b, j, width));
            let best = [previous[j], previous[j + 1], current[j]]
                .into_iter()
                .min_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)))?;
            current[j + 1] = (best.0 + cost, best.1.saturating_add(1));
        }
        std::mem::swap(&mut previous, &mut current);
    }
    let (cost, steps) = previous[m];
    cost.is_finite().then(|| Warping {
        distance: cost.sqrt(),
        steps,
    })
}

/// A value that no normalised distance of the two series is below.
///
/// # Shapes
/// As [`warping`]
pub fn lower_bound(a: &[f64], b: &[f64], width: usize, window: usize) -> Option<f64> {
    let (n, m) = lengths(a, b, width)?;
    let mut sum = 0.0;
    for i in 0..n {
        for d in 0..width {
            let value = a[i * width + d];
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for j in allowed(i, n, m, window) {
                low = low.min(b[j * width + d]);
                high = high.max(b[j * width + d]);
            }
            // Every step of `a` is aligned with some step of `b` within its band.
            let off = (low - value).max(value - high).max(0.0);
            sum += off * off;
        }
    }
    // No path has more than `n + m - 1` steps.
    Some((sum / (n + m - 1) as f64).sqrt())
}

fn lengths(a: &[f64], b: &[f64], width: usize) -> Option<(usize, usize)> {
    let fits = |s: &[f64]| width > 0 && !s.is_empty() && s.len().is_multiple_of(width);
    (fits(a) && fits(b)).then(|| (a.len() / width, b.len() / width))
}

fn row(series: &[f64], i: usize, width: usize) -> &[f64] {
    &series[i * width..(i + 1) * width]
}

fn squared(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum()
}

#[cfg(test)]
mod tests {
    use radarllm_base::random::SplitMix64;

    use super::*;

    fn series(n: usize, seed: f64) -> Vec<f64> {
        let value = |i: usize| {
            let i = i as f64;
            [(0.7 * i + seed).sin(), (0.3 * i * seed + 0.1).cos()]
        };
        (0..n).flat_map(value).collect()
    }

    /// `dtaidistance.dtw_ndim.distance(a, b, window=w)` of dtaidistance 2.5.1, with the series of [`series`], seeds 1 and 2.
    #[test]
    fn distances_are_those_of_dtaidistance() {
        for (n, m, window, expected) in [
            (6, 6, 2, 1.4979115888994106),
            (8, 5, 2, 0.9574028237142382),
            (5, 9, 3, 3.070083159402173),
            (12, 12, 1, 4.463114383084542),
            (7, 7, 7, 1.4578725205321001),
        ] {
            let found = warping(&series(n, 1.0), &series(m, 2.0), 2, window).unwrap();
            assert!(
                (found.distance - expected).abs() < 1e-9,
                "{n} {m} {window}: {found:?}"
            );
        }
    }

    /// All paths, by recursion.
    fn slow(a: &[f64], b: &[f64], window: usize) -> f64 {
        fn best(a: &[f64], b: &[f64], i: usize, j: usize, window: usize) -> f64 {
            if !allowed(i, a.len(), b.len(), window).contains(&j) {
                return f64::INFINITY;
            }
            let cost = (a[i] - b[j]).powi(2);
            let before = match (i, j) {
                (0, 0) => 0.0,
                (0, _) => best(a, b, i, j - 1, window),
                (_, 0) => best(a, b, i - 1, j, window),
                _ => best(a, b, i - 1, j - 1, window)
                    .min(best(a, b, i - 1, j, window))
                    .min(best(a, b, i, j - 1, window)),
            };
            before + cost
        }
        best(a, b, a.len() - 1, b.len() - 1, window).sqrt()
    }

    #[test]
    fn the_best_path_is_found_and_never_below_its_bound() {
        let mut rng = SplitMix64::new(5);
        for case in 0..200 {
            let (n, m, window) = (1 + rng.below(7), 1 + rng.below(7), 1 + rng.below(4));
            let mut draw =
                |n: usize| -> Vec<f64> { (0..n).map(|_| rng.below(1000) as f64 / 100.0).collect() };
            let (a, b) = (draw(n), draw(m));
            let found = warping(&a, &b, 1, window).unwrap();
            assert!(
                (found.distance - slow(&a, &b, window)).abs() < 1e-12,
                "{case}"
            );
            assert!(
                found.steps >= n.max(m) && found.steps < n + m,
                "{case}: {found:?}"
            );
            let bound = lower_bound(&a, &b, 1, window).unwrap();
            assert!(
                bound <= found.normalised() + 1e-12,
                "{case}: {bound} {found:?}"
            );
        }
    }

    #[test]
    fn the_normalised_distance_does_not_depend_on_the_length() {
        for n in [3, 30] {
            let (low, high) = (vec![1.0; n], vec![3.0; n]);
            let found = warping(&low, &high, 1, 2).unwrap();
            assert_eq!((found.steps, found.normalised()), (n, 2.0));
        }
    }

    #[test]
    fn series_without_vectors_have_no_distance() {
        assert_eq!(warping(&[], &[1.0], 1, 1), None);
        assert_eq!(warping(&[1.0, 2.0, 3.0], &[1.0, 2.0], 2, 1), None);
        assert_eq!(warping(&[1.0], &[1.0], 0, 1), None);
        assert_eq!(warping(&[1.0], &[1.0], 1, 0), None);
        assert_eq!(lower_bound(&[], &[], 1, 1), None);
    }
}
