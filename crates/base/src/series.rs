//! Time series of values that may be missing.

/// Missing values (NaN) by linear interpolation; the first and the last value are held at the ends. Zeros if all values
/// are missing.
///
/// ```
/// use radarllm_base::series::interpolated;
///
/// let gap = f64::NAN;
/// assert_eq!(interpolated(&[gap, 1.0, gap, 2.0, gap]), [1.0, 1.0, 1.5, 2.0, 2.0]);
/// ```
pub fn interpolated(series: &[f64]) -> Vec<f64> {
    let known: Vec<(usize, f64)> = series
        .iter()
        .copied()
        .enumerate()
        .filter(|(_, v)| v.is_finite())
        .collect();
    let at = |i: usize| {
        let next = known.partition_point(|(k, _)| *k < i);
        match (next.checked_sub(1).map(|p| known[p]), known.get(next)) {
            (_, Some(&(k, v))) if k == i => v,
            (Some((a, x)), Some(&(b, y))) => x + (y - x) * (i - a) as f64 / (b - a) as f64,
            (Some((_, v)), None) | (None, Some(&(_, v))) => v,
            (None, None) => 0.0,
        }
    };
    (0..series.len()).map(at).collect()
}
