//! Distances between two samples of a quantity and between two point clouds: how similar a simulation is to a
//! recording.
//!
//! ```
//! use radarllm_eval::points::{kolmogorov_smirnov, wasserstein_1};
//!
//! // Ranges of four points, m: the second sample is half a metre farther.
//! let (a, b) = ([1.0, 2.0, 3.0, 4.0], [1.5, 2.5, 3.5, 4.5]);
//! assert_eq!(wasserstein_1(&a, &b), Some(0.5));
//! assert_eq!(kolmogorov_smirnov(&a, &b), Some(0.25));
//! ```

/// Wasserstein-1 (earth mover's) distance between two samples, in their unit: the mean distance that
/// mass has to travel. `None` if either is empty or holds a NaN.
///
/// The integral of |F - G| over the line; samples may differ in size.
pub fn wasserstein_1(a: &[f64], b: &[f64]) -> Option<f64> {
    let mut total = 0.0;
    sweep(a, b, |from, to, difference| {
        total += (to - from) * difference.abs();
    })?;
    Some(total)
}

/// Kolmogorov-Smirnov distance, 0..=1: the largest difference of the cumulative distributions. `None`
/// as for [`wasserstein_1`].
pub fn kolmogorov_smirnov(a: &[f64], b: &[f64]) -> Option<f64> {
    let mut largest = 0.0_f64;
    sweep(a, b, |from, to, difference| {
        if to > from {
            largest = largest.max(difference.abs());
        }
    })?;
    Some(largest)
}

/// Calls `step(from, to, F - G)` for every piece between sorted values on which both cumulative
/// distributions are constant.
fn sweep(a: &[f64], b: &[f64], mut step: impl FnMut(f64, f64, f64)) -> Option<()> {
    if a.is_empty() || b.is_empty() || a.iter().chain(b).any(|v| v.is_nan()) {
        return None;
    }
    let sorted = |values: &[f64]| {
        let mut values = values.to_vec();
        values.sort_unstable_by(f64::total_cmp);
        values
    };
    let (a, b) = (sorted(a), sorted(b));
    let (mut i, mut j) = (0, 0);
    let mut last = a[0].min(b[0]);
    while i < a.len() || j < b.len() {
        let next = match (a.get(i), b.get(j)) {
            (Some(x), Some(y)) => x.min(*y),
            (Some(x), None) | (None, Some(x)) => *x,
            (None, None) => break,
        };
        step(
            last,
            next,
            i as f64 / a.len() as f64 - j as f64 / b.len() as f64,
        );
        while a.get(i).is_some_and(|x| *x <= next) {
            i += 1;
        }
        while b.get(j).is_some_and(|y| *y <= next) {
            j += 1;
        }
        last = next;
    }
    Some(())
}

/// Chamfer distance between two clouds, m: the mean distance from a point to the nearest of the
/// other cloud, averaged over both directions. `None` if either is empty.
///
/// Work and memory: |a| |b| distances, none kept.
pub fn chamfer(a: &[[f32; 3]], b: &[[f32; 3]]) -> Option<f64> {
    let one_way = |from: &[[f32; 3]], to: &[[f32; 3]]| {
        let sum: f64 = from
            .iter()
            .map(|p| {
                to.iter()
                    .map(|q| {
                        p.iter()
                            .zip(q)
                            .map(|(u, v)| f64::from(u - v).powi(2))
                            .sum::<f64>()
                    })
                    .fold(f64::INFINITY, f64::min)
                    .sqrt()
            })
            .sum();
        sum / from.len() as f64
    };
    (!a.is_empty() && !b.is_empty()).then(|| 0.5 * (one_way(a, b) + one_way(b, a)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_of_known_samples() {
        let a = [0.0, 1.0, 2.0, 3.0];
        // A shift moves every mass by itself, whatever the order.
        let shifted = [2.5, 0.5, 3.5, 1.5];
        assert_eq!(wasserstein_1(&a, &shifted), Some(0.5));
        assert_eq!(kolmogorov_smirnov(&a, &shifted), Some(0.25));
        assert_eq!(wasserstein_1(&a, &a), Some(0.0));
        assert_eq!(kolmogorov_smirnov(&a, &a), Some(0.0));
        // Half of the mass travels 1: sizes differ.
        assert_eq!(wasserstein_1(&[0.0], &[0.0, 1.0]), Some(0.5));
        assert_eq!(kolmogorov_smirnov(&[0.0], &[0.0, 1.0]), Some(0.5));
        // Apart altogether.
        assert_eq!(kolmogorov_smirnov(&[0.0, 0.0], &[5.0]), Some(1.0));
        assert_eq!(wasserstein_1(&[0.0, 0.0], &[5.0]), Some(5.0));
        assert_eq!(wasserstein_1(&[], &a), None);
        assert_eq!(kolmogorov_smirnov(&a, &[f64::NAN]), None);
    }

    #[test]
    fn chamfer_is_symmetric_and_zero_only_on_equal_sets() {
        let a = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
        let b = [[0.0, 3.0, 4.0]];
        // From a: 5 and sqrt(26); from b: 5.
        let expected = 0.5 * ((5.0 + 26_f64.sqrt()) / 2.0 + 5.0);
        assert!((chamfer(&a, &b).unwrap() - expected).abs() < 1e-12);
        assert_eq!(chamfer(&a, &b), chamfer(&b, &a));
        assert_eq!(chamfer(&a, &[a[1], a[0], a[0]]), Some(0.0));
        assert_eq!(chamfer(&a, &[]), None);
    }
}
