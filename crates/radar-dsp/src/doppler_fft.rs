//! Doppler spectra of sixteen range bins at once: removal of the slow-time mean, window, FFT, power.
//!
//! The mean and the window are applied in the FFT's first pass and the power is computed in its last, so that a block
//! passes through the cache once. Lengths with prime factors other than 2, 3, 5 and 7 are transformed with `rustfft`
//! row by row.

use std::ops::Range;
use std::sync::Arc;

use num_complex::Complex32;
use radarllm_simd::any_length::{self, Fft};
use radarllm_simd::{Cell, LANES, SimdF32x16, SimdLevel, dispatch};

use crate::kernels::{add_power, grow};
use radarllm_simd::fft::{C, Pass, Sink, Source, all_passes, factors, passes, run_pass};

/// Plan and workspace.
pub(crate) struct DopplerFft {
    level: SimdLevel,
    /// Slow-time weights of the mean to subtract; empty to keep static echoes.
    mean_weights: Vec<f32>,
    /// One weight per loop.
    window: Vec<f32>,
    passes: Vec<Pass>,
    /// Used for lengths without SIMD passes.
    rows: Option<Rows>,
    spare: Vec<Cell>,
}

struct Rows {
    fft: Arc<dyn Fft<f32>>,
    row: Vec<Complex32>,
    scratch: Vec<Complex32>,
}

impl Rows {
    fn process(&mut self, block: &mut [Cell]) {
        for lane in 0..LANES {
            for (to, from) in self.row.iter_mut().zip(&*block) {
                *to = from.number(lane);
            }
            self.fft
                .process_with_scratch(&mut self.row, &mut self.scratch);
            for (to, from) in block.iter_mut().zip(&self.row) {
                (to.re[lane], to.im[lane]) = (from.re, from.im);
            }
        }
    }
}

impl DopplerFft {
    /// Plans transforms of as many loops as `window` has weights.
    pub(crate) fn new(level: SimdLevel, mean_weights: Vec<f32>, window: Vec<f32>) -> Self {
        let n = window.len();
        let radices = factors(n, level);
        let rows = radices.is_none().then(|| {
            let fft = any_length::forward(n);
            Rows {
                row: vec![Complex32::ZERO; n],
                scratch: vec![Complex32::ZERO; fft.get_inplace_scratch_len()],
                fft,
            }
        });
        Self {
            level,
            mean_weights,
            window,
            passes: passes(n, &radices.unwrap_or_default()),
            rows,
            spare: vec![Cell::ZERO; n],
        }
    }

    /// Writes the spectra of blocks of sixteen bins to `out`, `[block][doppler]`. Adds their powers to `powers`, of the
    /// same shape, if there are any. The chirps of block b start at `chirps[b * stride]`, one cell per loop.
    ///
    /// The mean is removed before the window. After the window, a static target would leave the window's own spectrum
    /// around bin 0.
    ///
    /// # Panics
    /// If a buffer is too short for the blocks that start in `chirps`.
    pub(crate) fn process(
        &mut self,
        chirps: &[Cell],
        stride: usize,
        out: &mut [Cell],
        powers: Option<&mut [[f32; LANES]]>,
    ) {
        let n = self.window.len();
        // With several passes, the last one adds the powers. Otherwise they are added after the transform.
        let (powers, powers_after) = if self.passes.len() > 1 {
            (powers, None)
        } else {
            (None, powers)
        };
        let level = self.level;
        all_blocks(
            level,
            Job {
                level,
                chirps,
                stride,
                mean_weights: &self.mean_weights,
                window: &self.window,
                passes: &self.passes,
                spare: &mut self.spare,
                out: &mut *out,
                powers,
            },
        );
        if let Some(rows) = &mut self.rows {
            out.chunks_exact_mut(n)
                .for_each(|block| rows.process(block));
        }
        if let Some(powers) = powers_after {
            add_power(level, powers, out);
        }
    }
}

/// Input of the Doppler FFTs of one channel.
struct Job<'a> {
    level: SimdLevel,
    chirps: &'a [Cell],
    stride: usize,
    mean_weights: &'a [f32],
    window: &'a [f32],
    passes: &'a [Pass],
    spare: &'a mut [Cell],
    out: &'a mut [Cell],
    powers: Option<&'a mut [[f32; LANES]]>,
}

/// Chirps minus their mean, times the window.
struct SlowTime<'a, L> {
    chirps: &'a [Cell],
    mean: C<L>,
    window: &'a [f32],
}

impl<L: SimdF32x16> Source<L> for SlowTime<'_, L> {
    #[inline(always)]
    fn at(&self, i: usize) -> C<L> {
        let (z, weight) = (C::<L>::load(&self.chirps[i]), L::splat(self.window[i]));
        C {
            re: z.re.sub(self.mean.re).mul(weight),
            im: z.im.sub(self.mean.im).mul(weight),
        }
    }
}

/// Output spectra, and the powers to which theirs are added. The spectra are written past the cache, because those of
/// all channels exceed it and only detected cells are read again.
struct Measured<'a> {
    spectra: &'a mut [Cell],
    powers: &'a mut [[f32; LANES]],
}

impl<L: SimdF32x16> Sink<L> for Measured<'_> {
    const IS_LAST: bool = true;

    #[inline(always)]
    fn put(&mut self, i: usize, z: C<L>) {
        // SAFETY: `all_blocks_body`, the only user, calls `fence` before it returns the borrow of the spectra, and reads
        // none before.
        unsafe { L::stream(z.re, z.im, &mut self.spectra[i]) };
        grow(&mut self.powers[i], z);
    }
}

dispatch!(fn all_blocks => all_blocks_body(job: Job<'_>));

#[inline(always)]
fn all_blocks_body<L: SimdF32x16>(mut job: Job<'_>) {
    let n = job.window.len();
    for (block, chirps) in job.chirps.chunks(job.stride).enumerate() {
        let place = block * n..(block + 1) * n;
        block_body::<L>(&mut job, &chirps[..n], place);
    }
    // The spectra may have been written with non-temporal stores: see `Measured`.
    L::fence();
}

#[inline(always)]
fn block_body<L: SimdF32x16>(job: &mut Job<'_>, chirps: &[Cell], place: Range<usize>) {
    let (out, spare) = (&mut job.out[place.clone()], &mut *job.spare);
    let mut mean = C {
        re: L::splat(0.0),
        im: L::splat(0.0),
    };
    for (cell, &weight) in chirps.iter().zip(job.mean_weights) {
        let weight = L::splat(weight);
        mean.re = L::load(&cell.re).fma(weight, mean.re);
        mean.im = L::load(&cell.im).fma(weight, mean.im);
    }
    let chirps = SlowTime {
        chirps,
        mean,
        window: job.window,
    };
    let powers = job.powers.as_deref_mut().map(|p| &mut p[place]);
    let (before, last) = match (powers, job.passes) {
        (Some(powers), [before @ .., last]) => (before, Some((powers, last))),
        _ => (job.passes, None),
    };
    let (to, other) = match last {
        Some(_) => (&mut *spare, &mut *out),
        None => (&mut *out, &mut *spare),
    };
    all_passes::<L, _>(job.level, before, chirps, to, other);
    if let Some((powers, last)) = last {
        let measured = Measured {
            spectra: out,
            powers,
        };
        run_pass::<L, _, _>(last, &*spare, measured);
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::tests::uniform;

    /// Largest error of any lane against the definition in f64, relative to the largest value, for the spectra and for
    /// the powers.
    fn errors(n: usize, level: SimdLevel) -> [f64; 2] {
        // Each lane has a different signal.
        let mut next = uniform(1);
        let mut cell = || Cell {
            re: std::array::from_fn(|_| next()),
            im: std::array::from_fn(|_| next()),
        };
        // The second of two blocks is tested. One cell lies between the blocks.
        let chirps: Vec<Cell> = (0..2 * n + 1).map(|_| cell()).collect();
        let window: Vec<f32> = (0..n).map(|l| 0.5 + l as f32 / n as f32).collect();
        let mean_weights = vec![1.0 / n as f32; n - n % 2];
        let mut fft = DopplerFft::new(level, mean_weights.clone(), window.clone());
        let mut out = vec![cell(); 2 * n];
        let mut powers = vec![[0.25; LANES]; 2 * n];
        fft.process(&chirps, n + 1, &mut out, Some(&mut powers));
        let mut without_powers = vec![cell(); 2 * n];
        fft.process(&chirps, n + 1, &mut without_powers, None);
        assert_eq!(out, without_powers, "{level:?} {n}");
        let (chirps, out, powers) = (&chirps[n + 1..], &out[n..], &powers[n..]);

        let (mut worst, mut peaks) = ([0.0_f64; 2], [0.0_f64; 2]);
        for lane in 0..LANES {
            let input = |l: usize| {
                let z = chirps[l].number(lane);
                [f64::from(z.re), f64::from(z.im)]
            };
            let mut mean = [0.0; 2];
            for (l, weight) in mean_weights.iter().enumerate() {
                mean[0] += f64::from(*weight) * input(l)[0];
                mean[1] += f64::from(*weight) * input(l)[1];
            }
            for ((k, cell), powers) in out.iter().enumerate().zip(powers) {
                let (mut re, mut im) = (0.0, 0.0);
                for (l, weight) in window.iter().enumerate() {
                    let (sin, cos) = (-TAU * (k * l % n) as f64 / n as f64).sin_cos();
                    let x: [f64; 2] =
                        std::array::from_fn(|i| (input(l)[i] - mean[i]) * f64::from(*weight));
                    re += x[0] * cos - x[1] * sin;
                    im += x[0] * sin + x[1] * cos;
                }
                let found = cell.number(lane);
                let power = re * re + im * im;
                let error = (f64::from(found.re) - re).hypot(f64::from(found.im) - im);
                let power_error = (f64::from(powers[lane]) - 0.25 - power).abs();
                worst = [worst[0].max(error), worst[1].max(power_error)];
                peaks = [peaks[0].max(power.sqrt()), peaks[1].max(power)];
            }
        }
        [0, 1].map(|i| worst[i] / peaks[i])
    }

    #[test]
    fn every_length_equals_the_definition() {
        // All radices alone and combined, usual numbers of loops, and primes without a pass.
        for n in (2..=50).chain([64, 96, 100, 112, 128, 225, 251, 255, 256, 512]) {
            let errors = errors(n, SimdLevel::detect());
            // Rounding grows with the number of passes, by 6e-8 each. A power has twice the error.
            assert!(errors[0] < 1e-6 && errors[1] < 2e-6, "{n}: {errors:?}");
        }
    }

    #[test]
    fn levels_agree() {
        for level in SimdLevel::available() {
            for n in [12, 35, 37, 256] {
                let errors = errors(n, level);
                assert!(
                    errors[0] < 1e-6 && errors[1] < 2e-6,
                    "{level:?} {n}: {errors:?}"
                );
            }
        }
    }

    #[test]
    fn a_single_loop_is_its_own_spectrum() {
        let chirp = Cell {
            re: [3.0; LANES],
            im: [-4.0; LANES],
        };
        let (mut out, mut powers) = ([Cell::ZERO], [[1.0; LANES]]);
        let mut fft = DopplerFft::new(SimdLevel::detect(), vec![], vec![0.5]);
        fft.process(&[chirp], 1, &mut out, Some(&mut powers));
        assert_eq!(out[0].number(7), Complex32::new(1.5, -2.0));
        assert_eq!(powers, [[7.25; LANES]]);
    }
}
