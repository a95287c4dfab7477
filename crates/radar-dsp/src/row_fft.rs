//! Windowed FFTs of single rows, such as the range spectrum of a chirp. They are forward and not normalised.
//!
//! A row of n = 16 m numbers consists of m vectors of sixteen neighbours. With sample index 16 a + b and bin index c +
//! m d, `exp(-j 2 pi (16 a + b)(c + m d) / n)` is `exp(-j 2 pi a c / m) exp(-j 2 pi b c / n) exp(-j 2 pi b d / 16)`.
//! The FFT therefore consists of transforms over the vectors (from a to c), a multiplication by twiddle factors, a
//! transposition of sixteen vectors at a time, and transforms over the former lanes (from b to d).
//!
//! The window is applied when samples are loaded. Bins are written in blocks of sixteen, as the Doppler FFTs require.
//! `rustfft` transforms other lengths than multiples of 256 with prime factors of at most 7.

use std::sync::Arc;

use num_complex::Complex32;
use radarllm_simd::any_length::{self, Fft};
use radarllm_simd::{Cell, LANES, SimdF32x16, SimdLevel, dispatch, prefetch};

use crate::kernels::{weighted, window};
use radarllm_simd::fft::{
    C, Pass, Source, all_cell_passes, all_passes, dft16, factors, passes, root,
};

/// Plan and workspace.
pub(crate) struct RowFft {
    level: SimdLevel,
    /// One weight per sample.
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
        /// Windowed samples followed by zeros, if there are fewer samples than bins.
        padded: Vec<Cell>,
    },
    Rows {
        fft: Arc<dyn Fft<f32>>,
        row: Vec<Complex32>,
        scratch: Vec<Complex32>,
    },
}

/// Rows of samples that start `stride` samples apart.
#[derive(Clone, Copy)]
pub(crate) struct SampleRows<'a> {
    /// Samples from the first one of the first row on.
    pub data: &'a [Complex32],
    pub stride: usize,
    pub n_rows: usize,
}

impl SampleRows<'_> {
    #[inline(always)]
    fn row(&self, row: usize, len: usize) -> &[Complex32] {
        &self.data[row * self.stride..][..len]
    }
}

/// Destination of spectra. Block b of row r, with the bins from 16 b on, is written to
/// `cells[(b - first) * stride + r]`. If there is no such cell, the block is dropped.
pub(crate) struct Blocks<'a> {
    pub cells: &'a mut [Cell],
    pub first: usize,
    pub stride: usize,
}

impl Blocks<'_> {
    #[inline(always)]
    fn get(&mut self, block: usize, row: usize) -> Option<&mut Cell> {
        let offset = block.checked_sub(self.first)? * self.stride;
        self.cells.get_mut(offset + row)
    }
}

/// Input and workspace of the plan with vectors.
struct Job<'a> {
    level: SimdLevel,
    samples: SampleRows<'a>,
    window: &'a [f32],
    passes: &'a [Pass],
    twiddles: &'a [Cell],
    work: &'a mut [Cell],
    spare: &'a mut [Cell],
    padded: &'a mut [Cell],
    out: Blocks<'a>,
}

impl RowFft {
    /// Plans transforms of as many samples as `window` has weights, zero-padded to `n`.
    pub(crate) fn new(level: SimdLevel, window: Vec<f32>, n: usize) -> Self {
        let m = n / LANES;
        let radices = (n.is_multiple_of(LANES * LANES) && n > 0)
            .then(|| factors(m, level))
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
                    padded: vec![Cell::ZERO; m],
                }
            }
            None => {
                let fft = any_length::forward(n);
                Plan::Rows {
                    row: vec![Complex32::ZERO; n],
                    scratch: vec![Complex32::ZERO; fft.get_inplace_scratch_len()],
                    fft,
                }
            }
        };
        Self {
            level,
            window,
            n,
            plan,
        }
    }

    /// Number of blocks of a spectrum. The last one may be padded with zeros.
    pub(crate) fn n_blocks(&self) -> usize {
        self.n.div_ceil(LANES)
    }

    /// Writes the spectra of rows of samples times the window to `out`. If a sample is not finite, no bin of its row is
    /// finite.
    ///
    /// # Panics
    /// If `samples` ends before its last row has as many samples as there are weights.
    pub(crate) fn process(&mut self, samples: SampleRows<'_>, mut out: Blocks<'_>) {
        let level = self.level;
        match &mut self.plan {
            Plan::Vectors {
                passes,
                twiddles,
                work,
                spare,
                padded,
            } => all_rows(
                level,
                Job {
                    level,
                    samples,
                    window: &self.window,
                    passes,
                    twiddles,
                    work,
                    spare,
                    padded,
                    out,
                },
            ),
            Plan::Rows { fft, row, scratch } => {
                for r in 0..samples.n_rows {
                    let (start, padding) = row.split_at_mut(self.window.len());
                    let samples = samples.row(r, start.len());
                    window(level, start, samples, &self.window);
                    padding.fill(Complex32::ZERO);
                    fft.process_with_scratch(row, scratch);
                    for (block, bins) in row.chunks(LANES).enumerate() {
                        if let Some(to) = out.get(block, r) {
                            *to = Cell::ZERO;
                            for (i, z) in bins.iter().enumerate() {
                                (to.re[i], to.im[i]) = (z.re, z.im);
                            }
                        }
                    }
                }
            }
        }
    }
}

dispatch!(fn all_rows => all_rows_body(job: Job<'_>));

#[inline(always)]
fn all_rows_body<L: SimdF32x16>(mut job: Job<'_>) {
    for row in 0..job.samples.n_rows {
        row_body::<L>(&mut job, row);
    }
}

/// Windowed samples.
struct Windowed<'a> {
    samples: &'a [[Complex32; LANES]],
    window: &'a [[f32; LANES]],
    /// Samples of the next row, which are prefetched.
    next: &'a [[Complex32; LANES]],
}

impl<L: SimdF32x16> Source<L> for Windowed<'_> {
    #[inline(always)]
    fn at(&self, i: usize) -> C<L> {
        // Rows can be pages apart, and the hardware prefetcher does not cross pages. The next row is therefore
        // prefetched here, in small portions, because many requests at once would have to wait for room in the queue.
        if let Some(soon) = self.next.get(i) {
            prefetch(soon);
        }
        let (re, im) = weighted(&self.samples[i], &self.window[i]);
        C { re, im }
    }
}

#[inline(always)]
fn row_body<L: SimdF32x16>(job: &mut Job<'_>, row: usize) {
    let (work, spare) = (&mut *job.work, &mut *job.spare);
    let n_samples = job.window.len();
    let (samples, rest) = job.samples.row(row, n_samples).as_chunks();
    let (window, window_rest) = job.window.as_chunks();
    if samples.len() == work.len() {
        let next = if row + 1 < job.samples.n_rows {
            job.samples.row(row + 1, n_samples)
        } else {
            &[]
        };
        let source = Windowed {
            samples,
            window,
            next: next.as_chunks().0,
        };
        all_passes::<L, _>(job.level, job.passes, source, work, spare);
    } else {
        // If there are fewer samples than bins, zeros follow the samples.
        let padded = &mut *job.padded;
        padded.fill(Cell::ZERO);
        for ((samples, window), to) in samples.iter().zip(window).zip(&mut *padded) {
            let (re, im) = weighted(samples, window);
            C::<L> { re, im }.store(to);
        }
        let last = &mut padded[samples.len()];
        for (i, (sample, weight)) in rest.iter().zip(window_rest).enumerate() {
            (last.re[i], last.im[i]) = (sample.re * weight, sample.im * weight);
        }
        all_cell_passes(job.level, job.passes, padded, work, spare);
    }

    let zero = L::splat(0.0);
    let vectors = &*work;
    let n_blocks = vectors.len() / LANES;
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
            if let Some(to) = job.out.get(block + n_blocks * d, row) {
                z.store(to);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::tests::uniform;

    fn noise(n: usize) -> Vec<Complex32> {
        let mut next = uniform(7);
        (0..n).map(|_| Complex32::new(next(), next())).collect()
    }

    fn rows(data: &[Complex32], stride: usize, n_rows: usize) -> SampleRows<'_> {
        SampleRows {
            data,
            stride,
            n_rows,
        }
    }

    fn spectrum(fft: &mut RowFft, samples: &[Complex32]) -> Vec<Complex32> {
        let mut cells = vec![Cell::ZERO; fft.n_blocks()];
        let out = Blocks {
            cells: &mut cells,
            first: 0,
            stride: 1,
        };
        fft.process(rows(samples, 0, 1), out);
        let bins = cells.iter().flat_map(Cell::numbers);
        bins.take(fft.n).collect()
    }

    #[test]
    fn rows_go_to_their_places_and_blocks_outside_the_room_nowhere() {
        let level = SimdLevel::detect();
        for n in [256, 100] {
            let mut fft = RowFft::new(level, vec![1.0; n], n);
            let (n_rows, between) = (3, n + 5);
            let samples = noise(n_rows * between);
            let expected: Vec<_> = (0..n_rows)
                .map(|r| spectrum(&mut fft, &samples[r * between..][..n]))
                .collect();
            let mut cells = [Cell::ZERO; 11];
            let out = Blocks {
                cells: &mut cells,
                first: 2,
                stride: 4,
            };
            fft.process(rows(&samples, between, n_rows), out);
            for (i, cell) in cells.iter().enumerate() {
                for (lane, found) in cell.numbers().into_iter().enumerate() {
                    let row = expected.get(i % 4);
                    let value = row.and_then(|row| row.get(LANES * (2 + i / 4) + lane));
                    assert_eq!(found, value.copied().unwrap_or_default(), "{n} {i} {lane}");
                }
            }
        }
    }

    #[test]
    fn every_length_equals_the_definition_at_every_level() {
        for level in SimdLevel::available() {
            for (n_samples, n) in [
                (256, 256),
                (240, 256),
                (251, 256),
                (5, 256),
                (512, 512),
                (700, 768),
                (1024, 1024),
                // Lengths without passes, which rustfft transforms.
                (100, 100),
                (250, 304),
                (2816, 2816),
            ] {
                let samples = noise(n_samples);
                let window: Vec<f32> = (0..n_samples).map(|i| 0.1 + i as f32 / 512.0).collect();
                let mut fft = RowFft::new(level, window.clone(), n);
                let out = spectrum(&mut fft, &samples);
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
    fn a_sample_that_is_not_finite_leaves_no_bin_finite() {
        for level in SimdLevel::available() {
            for (n_samples, n) in [(256, 256), (250, 256), (512, 512), (100, 100)] {
                let mut fft = RowFft::new(level, vec![0.0; n_samples], n);
                for i in 0..n_samples {
                    let mut samples = noise(n_samples);
                    samples[i].im = [f32::NAN, f32::INFINITY][i % 2];
                    let bins = spectrum(&mut fft, &samples);
                    let is_finite = |z: &Complex32| z.re.is_finite() && z.im.is_finite();
                    assert!(!bins.iter().any(is_finite), "{level:?} {n} {i}");
                }
            }
        }
    }
}
