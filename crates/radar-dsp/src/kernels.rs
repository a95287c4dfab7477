//! The chain's loops over all samples and all cells, compiled for every [`SimdLevel`].
//!
//! Whole blocks of sixteen go through lanes; what is left over goes one number at a time.

use num_complex::Complex32;
use radarllm_simd::{Cell, LANES, Lanes, dispatch};

dispatch!(
    /// Writes samples times weights. `finite` becomes false if a sample is NaN or infinite, and else
    /// stays as it is.
    pub(crate) fn window => window_body(
        out: &mut [Complex32], samples: &[Complex32], weights: &[f32], finite: &mut bool
    )
);

#[inline(always)]
fn window_body<L: Lanes>(
    out: &mut [Complex32],
    samples: &[Complex32],
    weights: &[f32],
    finite: &mut bool,
) {
    let mut zeros = L::splat(0.0);
    let (out, out_rest) = out.as_chunks_mut::<LANES>();
    let (samples, samples_rest) = samples.as_chunks::<LANES>();
    let (weights, weights_rest) = weights.as_chunks::<LANES>();
    for ((out, samples), weights) in out.iter_mut().zip(samples).zip(weights) {
        let (re, im) = weighted(samples, weights, &mut zeros);
        L::store_complex(re, im, out);
    }
    *finite &= are_zero(zeros);
    for ((out, sample), weight) in out_rest.iter_mut().zip(samples_rest).zip(weights_rest) {
        *finite &= sample.re.is_finite() && sample.im.is_finite();
        *out = sample * weight;
    }
}

/// Sixteen samples times their weights. `zeros` stay zero, or become NaN if a sample is not finite: zero times anything
/// finite is zero, and times anything else NaN.
#[inline(always)]
pub(crate) fn weighted<L: Lanes>(
    samples: &[Complex32; LANES],
    weights: &[f32; LANES],
    zeros: &mut L,
) -> (L, L) {
    let (re, im) = L::load_complex(samples);
    let zero = L::splat(0.0);
    *zeros = im.fma(zero, re.fma(zero, *zeros));
    let weights = L::load(weights);
    (re.mul(weights), im.mul(weights))
}

/// Whether no lane of [`weighted`]'s `zeros` has become NaN.
#[inline(always)]
pub(crate) fn are_zero<L: Lanes>(zeros: L) -> bool {
    let mut lanes = [0.0; LANES];
    zeros.store(&mut lanes);
    lanes.iter().all(|&x| x == 0.0)
}

/// Sixteen range bins of one channel on their way to a Doppler FFT.
pub(crate) struct SlowTime<'a> {
    /// Range spectra from the first of the bins on, `[loop][stride]`.
    pub chirps: &'a [Complex32],
    pub stride: usize,
    /// Slow-time weights of the mean to subtract; empty to keep statics.
    pub mean_weights: &'a [f32],
    /// Doppler window, one weight a loop.
    pub window: &'a [f32],
    /// One cell a loop.
    pub out: &'a mut [Cell],
}

dispatch!(
    /// Takes sixteen bins out of all loops, less their slow-time mean, times the window.
    ///
    /// The mean goes before the window: after it, a static target would leave the window's own
    /// spectrum around bin 0.
    pub(crate) fn slow_time => slow_time_body(job: SlowTime<'_>)
);

#[inline(always)]
fn slow_time_body<L: Lanes>(job: SlowTime<'_>) {
    let rows = job.chirps.chunks(job.stride);
    let mean_weights = job.mean_weights.iter().chain(std::iter::repeat(&0.0));
    let (mut mean_re, mut mean_im) = (L::splat(0.0), L::splat(0.0));
    for ((row, cell), &weight) in rows.zip(&mut *job.out).zip(mean_weights) {
        if let Some(row) = row.first_chunk() {
            let (re, im) = L::load_complex(row);
            re.store(&mut cell.re);
            im.store(&mut cell.im);
            let weight = L::splat(weight);
            mean_re = re.fma(weight, mean_re);
            mean_im = im.fma(weight, mean_im);
        }
    }
    for (cell, &weight) in job.out.iter_mut().zip(job.window) {
        let weight = L::splat(weight);
        L::load(&cell.re)
            .sub(mean_re)
            .mul(weight)
            .store(&mut cell.re);
        L::load(&cell.im)
            .sub(mean_im)
            .mul(weight)
            .store(&mut cell.im);
    }
}

dispatch!(
    /// `powers += |cells|^2`.
    pub(crate) fn add_power => add_power_body(powers: &mut [[f32; LANES]], cells: &[Cell])
);

#[inline(always)]
fn add_power_body<L: Lanes>(powers: &mut [[f32; LANES]], cells: &[Cell]) {
    for (sum, cell) in powers.iter_mut().zip(cells) {
        let (re, im) = (L::load(&cell.re), L::load(&cell.im));
        im.fma(im, re.fma(re, L::load(sum))).store(sum);
    }
}

dispatch!(
    /// `sums += cells`.
    pub(crate) fn add => add_body(sums: &mut [Cell], cells: &[Cell])
);

#[inline(always)]
fn add_body<L: Lanes>(sums: &mut [Cell], cells: &[Cell]) {
    for (sum, cell) in sums.iter_mut().zip(cells) {
        L::load(&sum.re).add(L::load(&cell.re)).store(&mut sum.re);
        L::load(&sum.im).add(L::load(&cell.im)).store(&mut sum.im);
    }
}

dispatch!(
    /// Turns `[doppler][bin of sixteen]` into `[bin][doppler]`, as many bins as `map` has room for.
    pub(crate) fn rows_of_bins => rows_of_bins_body(
        powers: &[[f32; LANES]], map: &mut [f32]
    )
);

#[inline(always)]
fn rows_of_bins_body<L: Lanes>(powers: &[[f32; LANES]], map: &mut [f32]) {
    let n_doppler = powers.len();
    let whole = n_doppler - n_doppler % LANES;
    for first in (0..whole).step_by(LANES) {
        let mut block = std::array::from_fn(|i| L::load(&powers[first + i]));
        L::transpose(&mut block);
        for (row, bin) in map.chunks_exact_mut(n_doppler).zip(block) {
            if let Some(to) = row[first..].first_chunk_mut() {
                bin.store(to);
            }
        }
    }
    for (bin, row) in map.chunks_exact_mut(n_doppler).enumerate() {
        for (to, from) in row[whole..].iter_mut().zip(&powers[whole..]) {
            *to = from[bin];
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
    fn slow_time_is_the_windowed_difference_from_the_mean() {
        for level in [SimdLevel::Avx512, SimdLevel::Avx2, SimdLevel::Portable] {
            for (n_loops, stride, first) in [(1, 16, 0), (15, 40, 1), (128, 48, 32)] {
                let chirps = noise(n_loops * stride);
                let window: Vec<f32> = (0..n_loops).map(|l| 0.1 + l as f32 / 64.0).collect();
                let mean_weights = vec![1.0 / n_loops as f32; n_loops];
                let mut out = vec![Cell::ZERO; n_loops];
                let job = SlowTime {
                    chirps: &chirps[first..],
                    stride,
                    mean_weights: &mean_weights,
                    window: &window,
                    out: &mut out,
                };
                slow_time(level, job);
                for lane in 0..LANES {
                    let at = |l: usize| chirps[l * stride + first + lane];
                    let mean = (0..n_loops).map(at).sum::<Complex32>() / n_loops as f32;
                    for (l, cell) in out.iter().enumerate() {
                        let found = Complex32::new(cell.re[lane], cell.im[lane]);
                        let error = found - (at(l) - mean) * window[l];
                        // A few roundings of 6e-8 of values below 3.
                        assert!(error.norm() < 2e-6, "{level:?} {n_loops} {l}: {error}");
                    }
                }
            }
        }
    }

    #[test]
    fn powers_are_added_and_turned_into_rows() {
        for level in [SimdLevel::Avx512, SimdLevel::Avx2, SimdLevel::Portable] {
            for (n_doppler, n_bins) in [(16, 16), (37, 5), (7, 16)] {
                let cells: Vec<Cell> = (0..n_doppler)
                    .map(|d| Cell {
                        re: std::array::from_fn(|bin| (16 * d + bin) as f32),
                        im: [2.0; LANES],
                    })
                    .collect();
                let mut powers = vec![[1.0; LANES]; n_doppler];
                add_power(level, &mut powers, &cells);
                let mut map = vec![0.0; n_bins * n_doppler];
                rows_of_bins(level, &powers, &mut map);
                for bin in 0..n_bins {
                    for d in 0..n_doppler {
                        let expected = ((16 * d + bin) as f32).powi(2) + 5.0;
                        assert_eq!(map[bin * n_doppler + d], expected, "{level:?} {bin} {d}");
                    }
                }
            }
        }
    }

    #[test]
    fn windowing_finds_every_sample_that_is_not_finite() {
        let weights: Vec<f32> = (0..37).map(|i| i as f32).collect();
        for level in [SimdLevel::Avx512, SimdLevel::Avx2, SimdLevel::Portable] {
            let samples = noise(37);
            let mut out = vec![Complex32::ZERO; 37];
            let mut finite = true;
            window(level, &mut out, &samples, &weights, &mut finite);
            assert!(finite);
            assert!((0..37).all(|i| out[i] == samples[i] * weights[i]));
            for i in 0..37 {
                for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                    let mut samples = samples.clone();
                    samples[i].im = bad;
                    let mut finite = true;
                    window(level, &mut out, &samples, &weights, &mut finite);
                    assert!(!finite, "{level:?} {i} {bad}");
                }
            }
        }
    }
}
