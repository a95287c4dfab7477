//! Percentile bootstrap over units (motions). It is seeded, and all metrics use the same resamples.

use radarllm_base::random::SplitMix64;
use radarllm_base::stats::quantile_linear;

/// Lower and upper bound.
pub type Interval = [f64; 2];

/// 95 % intervals of `statistic`, a function of column sums, under resampling of units.
///
/// # Shapes
/// - `rows`: `[item][column]`, additive statistics; all rows of one width
/// - `units`: unit number of each item; items of one unit are drawn together, because variants
///   of one motion are not independent
/// - `statistic`: column sums to values; always the same number of values
/// - returns: one interval per value; empty when there are no items
///
/// Percentiles 2.5 and 97.5 with linear interpolation.
pub fn intervals(
    rows: &[Vec<f64>],
    units: &[usize],
    n_resamples: usize,
    seed: u64,
    statistic: impl Fn(&[f64]) -> Vec<f64>,
) -> Vec<Interval> {
    let Some(width) = rows.first().map(Vec::len) else {
        return Vec::new();
    };
    let n_units = units.iter().max().map_or(0, |m| m + 1);
    let mut sums = vec![0.0; n_units * width];
    for (row, &unit) in rows.iter().zip(units) {
        for (sum, v) in sums[unit * width..].iter_mut().zip(row) {
            *sum += v;
        }
    }
    intervals_of_sums(&sums, width, n_resamples, seed, statistic)
}

/// As [`intervals`], from sums per unit, `[unit][column]`.
pub(crate) fn intervals_of_sums(
    sums: &[f64],
    width: usize,
    n_resamples: usize,
    seed: u64,
    statistic: impl Fn(&[f64]) -> Vec<f64>,
) -> Vec<Interval> {
    let n_units = sums.len() / width.max(1);
    let mut rng = SplitMix64::new(seed);
    let mut samples: Vec<Vec<f64>> = Vec::new();
    let mut total = vec![0.0; width];
    for _ in 0..n_resamples {
        total.fill(0.0);
        for _ in 0..n_units {
            let unit = rng.below(n_units);
            for (sum, v) in total.iter_mut().zip(&sums[unit * width..]) {
                *sum += v;
            }
        }
        let values = statistic(&total);
        samples.resize_with(values.len(), Vec::new);
        for (sample, v) in samples.iter_mut().zip(values) {
            sample.push(v);
        }
    }
    samples
        .into_iter()
        .map(|mut sample| {
            sample.sort_unstable_by(f64::total_cmp);
            [0.025, 0.975].map(|share| quantile_linear(&sample, share).unwrap_or(f64::NAN))
        })
        .collect()
}

/// 95 % interval of a mean over items, resampling units. `None` without items or resamples.
pub fn mean_interval(
    values: &[f64],
    units: &[usize],
    n_resamples: usize,
    seed: u64,
) -> Option<Interval> {
    let rows: Vec<Vec<f64>> = values.iter().map(|&v| vec![v, 1.0]).collect();
    intervals(&rows, units, n_resamples, seed, |s| vec![s[0] / s[1]])
        .first()
        .copied()
}

/// Numbers units by the part of the id before `#`, in order of appearance: clip ids are
/// `<motion>#<variant>`. An id without `#` is its own motion.
pub fn units_of_ids<'a>(ids: impl IntoIterator<Item = &'a str>) -> Vec<usize> {
    let mut numbers = std::collections::HashMap::new();
    ids.into_iter()
        .map(|id| {
            let motion = id.split_once('#').map_or(id, |(motion, _)| motion);
            let next = numbers.len();
            *numbers.entry(motion).or_insert(next)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values from the first release. They must not change, because reported intervals depend on them.
    #[test]
    fn intervals_never_change() {
        let values = [0.1, 0.9, 0.4, 0.7, 0.3, 0.65];
        let interval = mean_interval(&values, &[0, 1, 1, 2, 3, 4], 200, 7).unwrap();
        assert_eq!(
            interval.map(f64::to_bits),
            [4598895795485655696, 4604142891158651910]
        );
    }
}
