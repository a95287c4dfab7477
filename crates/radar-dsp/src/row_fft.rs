//! Windowed FFTs of single rows: a chirp's range spectrum.
//!
//! A row of n = 16 m numbers is m vectors of sixteen neighbours. With sample 16 a + b and bin c + m d,
//! `exp(-j 2 pi (16 a + b)(c + m d) / n)` is `exp(-j 2 pi a c / m) exp(-j 2 pi b c / n) exp(-j 2 pi b d / 16)`: transforms
//! over the vectors, one twiddle, and after a transposition of sixteen vectors transforms over what were the lanes.
//! The window is applied as samples are loaded, and bins come out in order. Other lengths go through `rustfft`.
//! Forward, not normalised.

use std::sync::Arc;

use num_complex::Complex32;
use radarllm_simd::{Cell, LANES, Lanes, SimdLevel, dispatch};
use rustfft::{Fft, FftPlanner};

use crate::kernels::{are_zero, weighted, window};
use crate::lane_fft::{C, Pass, all_passes_body, dft16, factors, passes, root};

/// Plan and workspace.
pub(crate) struct RowFft {
    /// One weight a sample.
    window: Vec<f32>,
    n: usize,
    plan: Plan,
}

enum Plan {
    Vectors {
        /// Transforms over the m vectors.
        passes: Vec<Pass>,
        /// `[c]`, lane b: `exp(-j 2 pi b c / n)`.
        twiddles: Vec<Cell>,
        work: Vec<Cell>,
        spare: Vec<Cell>,
    },
    Rows {
        fft: Arc<dyn Fft<f32>>,
        scratch: Vec<Complex32>,
    },
}

/// What one row needs.
struct Job<'a> {
    samples: &'a [Complex32],
    window: &'a [f32],
    passes: &'a [Pass],
    twiddles: &'a [Cell],
    work: &'a mut [Cell],
    spare: &'a mut [Cell],
    out: &'a mut [Complex32],
    finite: &'a mut bool,
}

impl RowFft {
    /// Plans transforms of as many samples as `window` has weights, with zeros after them up to `n`.
    pub fn new(window: Vec<f32>, n: usize) -> Self {
        let m = n / LANES;
        let radices = (n.is_multiple_of(LANES * LANES) && n > 0)
            .then(|| factors(m))
            .flatten();
        let plan = match radices {
            Some(radices) => {
                let twiddle = |c: usize| {
                    let roots: [[f32; 2]; LANES] = std::array::from_fn(|b| root(b * c, n));
                    Cell {
                        re: roots.map(|r| r[0]),
                        im: roots.map(|r| r[1]),
                    }
                };
                Plan::Vectors {
                    passes: passes(m, &radices),
                    twiddles: (0..m).map(twiddle).collect(),
                    work: vec![Cell::ZERO; m],
                    spare: vec![Cell::ZERO; m],
                }
            }
            None => {
                let fft = FftPlanner::new().plan_fft_forward(n);
                Plan::Rows {
                    scratch: vec![Complex32::ZERO; fft.get_inplace_scratch_len()],
                    fft,
                }
            }
        };
        Self { window, n, plan }
    }

    /// Writes the spectrum of `samples` times the window to `out`; false if a sample is not finite.
    ///
    /// # Panics
    /// If there are not as many samples as weights, or `out` is shorter than the transform.
    pub fn process(
        &mut self,
        level: SimdLevel,
        samples: &[Complex32],
        out: &mut [Complex32],
    ) -> bool {
        assert_eq!(samples.len(), self.window.len());
        let out = &mut out[..self.n];
        let mut finite = true;
        match &mut self.plan {
            Plan::Vectors {
                passes,
                twiddles,
                work,
                spare,
            } => row(
                level,
                Job {
                    samples,
                    window: &self.window,
                    passes,
                    twiddles,
                    work,
                    spare,
                    out,
                    finite: &mut finite,
                },
            ),
            Plan::Rows { fft, scratch } => {
                let (row, padding) = out.split_at_mut(samples.len());
                window(level, row, samples, &self.window, &mut finite);
                padding.fill(Complex32::ZERO);
                fft.process_with_scratch(out, scratch);
            }
        }
        finite
    }
}

dispatch!(fn row => row_body(job: Job<'_>));

#[inline(always)]
fn row_body<L: Lanes>(job: Job<'_>) {
    let Job { work, spare, .. } = job;
    let zero = L::splat(0.0);
    let mut zeros = zero;
    let (samples, rest) = job.samples.as_chunks::<LANES>();
    let (weights, weights_rest) = job.window.as_chunks::<LANES>();
    let n_whole = samples.len();
    for ((samples, weights), to) in samples.iter().zip(weights).zip(&mut *work) {
        let (re, im) = weighted(samples, weights, &mut zeros);
        C { re, im }.store(to);
    }
    if let Some(to) = work.get_mut(n_whole) {
        let (mut last, mut last_weights) = ([Complex32::ZERO; LANES], [0.0; LANES]);
        last[..rest.len()].copy_from_slice(rest);
        last_weights[..rest.len()].copy_from_slice(weights_rest);
        let (re, im) = weighted(&last, &last_weights, &mut zeros);
        C { re, im }.store(to);
        work[n_whole + 1..].fill(Cell::ZERO);
    }
    *job.finite &= are_zero(zeros);

    all_passes_body::<L>(job.passes, work, spare);
    let vectors: &[Cell] = if job.passes.len().is_multiple_of(2) {
        work
    } else {
        spare
    };
    let n_blocks = vectors.len() / LANES;
    let (bins, _) = job.out.as_chunks_mut::<LANES>();
    let blocks = vectors.as_chunks::<LANES>().0;
    let twiddles = job.twiddles.as_chunks::<LANES>().0;
    for (block, (vectors, twiddles)) in blocks.iter().zip(twiddles).enumerate() {
        let (mut re, mut im) = ([zero; LANES], [zero; LANES]);
        for i in 0..LANES {
            let (x, w) = (C::<L>::load(&vectors[i]), C::<L>::load(&twiddles[i]));
            re[i] = x.im.fnma(w.im, x.re.mul(w.re));
            im[i] = x.im.fma(w.re, x.re.mul(w.im));
        }
        L::transpose(&mut re);
        L::transpose(&mut im);
        let spectrum = dft16(std::array::from_fn(|b| C {
            re: re[b],
            im: im[b],
        }));
        for (d, z) in spectrum.into_iter().enumerate() {
            L::store_complex(z.re, z.im, &mut bins[block + n_blocks * d]);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::lane_fft::uniform;

    fn noise(n: usize) -> Vec<Complex32> {
        let mut next = uniform(7);
        (0..n).map(|_| Complex32::new(next(), next())).collect()
    }

    #[test]
    fn every_length_equals_the_definition_at_every_level() {
        for level in [SimdLevel::Avx512, SimdLevel::Avx2, SimdLevel::Portable] {
            for (n_samples, n) in [
                (256, 256),
                (240, 256),
                (251, 256),
                (5, 256),
                (512, 512),
                (700, 768),
                (1024, 1024),
                // No passes: rustfft.
                (100, 100),
                (250, 304),
                (2816, 2816),
            ] {
                let samples = noise(n_samples);
                let window: Vec<f32> = (0..n_samples).map(|i| 0.1 + i as f32 / 512.0).collect();
                let mut fft = RowFft::new(window.clone(), n);
                let mut out = vec![Complex32::ZERO; n];
                assert!(fft.process(level, &samples, &mut out));
                let (mut worst, mut peak) = (0.0_f64, 0.0_f64);
                for (k, found) in out.iter().enumerate().step_by(1 + n / 300) {
                    let (mut re, mut im) = (0.0, 0.0);
                    for (i, x) in samples.iter().enumerate() {
                        let (sin, cos) = (-TAU * (k * i % n) as f64 / n as f64).sin_cos();
                        let w = f64::from(window[i]);
                        let (x_re, x_im) = (f64::from(x.re), f64::from(x.im));
                        re += w * (x_re * cos - x_im * sin);
                        im += w * (x_re * sin + x_im * cos);
                    }
                    peak = peak.max(re.hypot(im));
                    worst = worst.max((f64::from(found.re) - re).hypot(f64::from(found.im) - im));
                }
                assert!(worst < 1e-6 * peak, "{level:?} {n}: {worst} of {peak}");
            }
        }
    }

    #[test]
    fn samples_that_are_not_finite_are_found() {
        for (n_samples, n) in [(250, 256), (100, 100)] {
            let mut fft = RowFft::new(vec![1.0; n_samples], n);
            let mut out = vec![Complex32::ZERO; n];
            for i in 0..n_samples {
                let mut samples = noise(n_samples);
                samples[i].im = [f32::NAN, f32::INFINITY][i % 2];
                assert!(
                    !fft.process(SimdLevel::detect(), &samples, &mut out),
                    "{n} {i}"
                );
            }
        }
    }
}
