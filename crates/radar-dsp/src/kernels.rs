//! The chain's loops over all samples and all cells, compiled for every [`SimdLevel`].
//!
//! Whole blocks of sixteen are processed in SIMD lanes. The remainder is processed one number at a time.

use num_complex::Complex32;
use radarllm_simd::{Cell, LANES, SimdF32x16, dispatch};

use radarllm_simd::fft::C;

dispatch!(
    /// Writes samples times weights.
    pub(crate) fn window => window_body(
        out: &mut [Complex32], samples: &[Complex32], weights: &[f32]
    )
);

#[inline(always)]
fn window_body<L: SimdF32x16>(out: &mut [Complex32], samples: &[Complex32], weights: &[f32]) {
    let (out, out_rest) = out.as_chunks_mut::<LANES>();
    let (samples, samples_rest) = samples.as_chunks::<LANES>();
    let (weights, weights_rest) = weights.as_chunks::<LANES>();
    for ((out, samples), weights) in out.iter_mut().zip(samples).zip(weights) {
        let (re, im) = weighted(samples, weights);
        L::store_complex(re, im, out);
    }
    for ((out, sample), weight) in out_rest.iter_mut().zip(samples_rest).zip(weights_rest) {
        *out = sample * weight;
    }
}

/// Sixteen samples times their weights.
#[inline(always)]
pub(crate) fn weighted<L: SimdF32x16>(
    samples: &[Complex32; LANES],
    weights: &[f32; LANES],
) -> (L, L) {
    let (re, im) = L::load_complex(samples);
    let weights = L::load(weights);
    (re.mul(weights), im.mul(weights))
}

dispatch!(
    /// `powers += |cells|^2`.
    pub(crate) fn add_power => add_power_body(powers: &mut [[f32; LANES]], cells: &[Cell])
);

#[inline(always)]
fn add_power_body<L: SimdF32x16>(powers: &mut [[f32; LANES]], cells: &[Cell]) {
    for (sum, cell) in powers.iter_mut().zip(cells) {
        grow(sum, C::<L>::load(cell));
    }
}

/// `power += |z|^2`.
#[inline(always)]
pub(crate) fn grow<L: SimdF32x16>(power: &mut [f32; LANES], z: C<L>) {
    z.im.fma(z.im, z.re.fma(z.re, L::load(power))).store(power);
}

dispatch!(
    /// `sums += cells`.
    pub(crate) fn add => add_body(sums: &mut [Cell], cells: &[Cell])
);

#[inline(always)]
fn add_body<L: SimdF32x16>(sums: &mut [Cell], cells: &[Cell]) {
    for (sum, cell) in sums.iter_mut().zip(cells) {
        L::load(&sum.re).add(L::load(&cell.re)).store(&mut sum.re);
        L::load(&sum.im).add(L::load(&cell.im)).store(&mut sum.im);
    }
}

dispatch!(
    /// The largest of powers, at least zero, or NaN if one of them is not finite.
    pub(crate) fn peak => peak_body(powers: &[f32], peak: &mut f32)
);

#[inline(always)]
fn peak_body<L: SimdF32x16>(powers: &[f32], peak: &mut f32) {
    let zero = L::splat(0.0);
    let (mut largest, mut zeros) = (zero, zero);
    let (chunks, rest) = powers.as_chunks::<LANES>();
    for chunk in chunks {
        let x = L::load(chunk);
        largest = largest.max(x);
        zeros = x.fma(zero, zeros);
    }
    *peak = largest.reduce_max();
    // Zero times a finite value is zero, and zero times any other value is NaN.
    let mut finite = zeros.array() == [0.0; LANES];
    for &x in rest {
        *peak = peak.max(x);
        finite &= x.is_finite();
    }
    if !finite {
        *peak = f32::NAN;
    }
}

dispatch!(
    /// Number of values that are smaller than `limit`, for up to 2^28 values.
    pub(crate) fn count_below => count_below_body(values: &[f32], limit: f32, count: &mut usize)
);

#[inline(always)]
fn count_below_body<L: SimdF32x16>(values: &[f32], limit: f32, count: &mut usize) {
    let (zero, one, limits) = (L::splat(0.0), L::splat(1.0), L::splat(limit));
    let mut sums = [zero; 4];
    let (chunks, rest) = values.as_chunks::<{ 4 * LANES }>();
    for chunk in chunks {
        let (vectors, _) = chunk.as_chunks::<LANES>();
        for (sum, vector) in sums.iter_mut().zip(vectors) {
            *sum = sum.add(L::load(vector).select_lt(limits, one, zero));
        }
    }
    *count = rest.iter().filter(|x| **x < limit).count();
    for sum in sums {
        // The counts of a lane are exact in f32 up to 2^24.
        for n in sum.array() {
            *count += n as usize;
        }
    }
}

dispatch!(
    /// Transposes `[doppler][bin of sixteen]` to `[bin][doppler]`, from bin `first` on, for as many bins as `map` has
    /// room for.
    pub(crate) fn rows_of_bins => rows_of_bins_body(
        powers: &[[f32; LANES]], first: usize, map: &mut [f32]
    )
);

#[inline(always)]
fn rows_of_bins_body<L: SimdF32x16>(powers: &[[f32; LANES]], first: usize, map: &mut [f32]) {
    let n_doppler = powers.len();
    let whole = n_doppler - n_doppler % LANES;
    for start in (0..whole).step_by(LANES) {
        let mut block = std::array::from_fn(|i| L::load(&powers[start + i]));
        L::transpose(&mut block);
        let bins = block.into_iter().skip(first);
        for (row, bin) in map.chunks_exact_mut(n_doppler).zip(bins) {
            if let Some(to) = row[start..].first_chunk_mut() {
                bin.store(to);
            }
        }
    }
    for (bin, row) in map.chunks_exact_mut(n_doppler).enumerate() {
        for (to, from) in row[whole..].iter_mut().zip(&powers[whole..]) {
            *to = from[first + bin];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_simd::SimdLevel;

    fn noise(n: usize) -> Vec<Complex32> {
        (0..n as u32)
            .map(|i| {
                let part = |k: u32| (i.wrapping_mul(k) >> 8) as f32 / (1 << 23) as f32 - 1.0;
                Complex32::new(part(2_654_435_761), part(2_246_822_519))
            })
            .collect()
    }

    #[test]
    fn powers_are_added_and_turned_into_rows() {
        for level in SimdLevel::available() {
            for (n_doppler, first, n_bins) in [
                (16, 0, 16),
                (37, 0, 5),
                (7, 0, 16),
                (16, 3, 13),
                (37, 15, 1),
            ] {
                let cells: Vec<Cell> = (0..n_doppler)
                    .map(|d| Cell {
                        re: std::array::from_fn(|bin| (16 * d + bin) as f32),
                        im: [2.0; LANES],
                    })
                    .collect();
                let mut powers = vec![[1.0; LANES]; n_doppler];
                add_power(level, &mut powers, &cells);
                let mut map = vec![0.0; n_bins * n_doppler];
                rows_of_bins(level, &powers, first, &mut map);
                for bin in 0..n_bins {
                    for d in 0..n_doppler {
                        let expected = ((16 * d + first + bin) as f32).powi(2) + 5.0;
                        assert_eq!(map[bin * n_doppler + d], expected, "{level:?} {bin} {d}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_peak_is_the_largest_power_and_damage_shows() {
        for level in SimdLevel::available() {
            let powers: Vec<f32> = (0..37).map(|i| ((i * 7) % 37) as f32).collect();
            let mut found = 0.0;
            peak(level, &powers, &mut found);
            assert_eq!(found, 36.0);
            peak(level, &[], &mut found);
            assert_eq!(found, 0.0);
            for i in 0..37 {
                for bad in [f32::NAN, f32::INFINITY] {
                    let mut powers = powers.clone();
                    powers[i] = bad;
                    peak(level, &powers, &mut found);
                    assert!(found.is_nan(), "{level:?} {i} {bad}");
                }
            }
        }
    }

    #[test]
    fn values_below_a_limit_are_counted() {
        let values: Vec<f32> = (0..203).map(|i| ((i * 5) % 203) as f32).collect();
        for level in SimdLevel::available() {
            for limit in [-1.0, 0.0, 0.5, 100.0, 500.0] {
                let mut count = 0;
                count_below(level, &values, limit, &mut count);
                assert_eq!(count, limit.ceil().clamp(0.0, 203.0) as usize, "{level:?}");
            }
        }
    }

    #[test]
    fn windowing_multiplies_every_sample() {
        let weights: Vec<f32> = (0..37).map(|i| i as f32).collect();
        let samples = noise(37);
        for level in SimdLevel::available() {
            let mut out = vec![Complex32::ZERO; 37];
            window(level, &mut out, &samples, &weights);
            assert!((0..37).all(|i| out[i] == samples[i] * weights[i]));
        }
    }
}
