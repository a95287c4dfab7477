//! From the range grid to ADC samples: one inverse FFT per chirp and receiver, deapodisation, noise.

use std::sync::Arc;

use num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

use crate::gridding::Kernel;
use crate::noise::add_noise_body;
use crate::spread::ChannelBlock;
use radarllm_simd::{Cell, LANES, Lanes, as_complex, dispatch};

/// Plan and buffers.
pub(crate) struct RangeTransform {
    fft: Arc<dyn Fft<f32>>,
    /// Factors by sample.
    deapodisation: Vec<f32>,
    n_cells: usize,
    /// Complex numbers in the memory of cells, which starts on a cache line.
    row: Vec<Cell>,
    scratch: Vec<Cell>,
}

impl RangeTransform {
    pub fn new(n_samples: usize, n_cells: usize, kernel: &Kernel) -> Self {
        let fft = FftPlanner::new().plan_fft_inverse(n_cells);
        let room = |n: usize| vec![Cell::ZERO; n.div_ceil(LANES)];
        Self {
            deapodisation: kernel.deapodisation(n_samples, n_cells),
            n_cells,
            row: room(n_cells),
            scratch: room(fft.get_inplace_scratch_len()),
            fft,
        }
    }
}

/// What one pass needs.
pub(crate) struct TransformJob<'a> {
    pub transform: &'a mut RangeTransform,
    pub channels: &'a ChannelBlock,
    /// `[loop][cell]`, cells from `first_cell`.
    pub grid: &'a [Cell],
    pub first_cell: i32,
    pub n_cells: usize,
    /// Samples of the segment's loops, `[loop][channel][sample]`.
    pub out: &'a mut [Complex32],
    pub n_channels: usize,
    /// State of the noise generator and rms, if the noise goes in here.
    pub noise: Option<(&'a mut [[u32; 16]; 4], f32)>,
    /// Receives the sum of |signal|^2, noise not included.
    pub energy: &'a mut f64,
}

dispatch!(
    /// Writes the samples of all loops for the channels of one block.
    pub(crate) fn transform => transform_body(job: TransformJob<'_>)
);

#[inline(always)]
fn transform_body<L: Lanes>(mut job: TransformJob<'_>) {
    let RangeTransform {
        fft,
        deapodisation,
        n_cells,
        row,
        scratch,
    } = job.transform;
    let (n_samples, m) = (deapodisation.len(), *n_cells);
    let (row, scratch) = (&mut as_complex(row)[..m], as_complex(scratch));
    // Sample i is n = i - half; negative n sit at the end of the transform.
    let half = n_samples / 2;
    let start = job.first_cell.rem_euclid(m as i32) as usize;
    let ChannelBlock { first, len, .. } = *job.channels;
    for (l, samples) in job
        .out
        .chunks_exact_mut(job.n_channels * n_samples)
        .enumerate()
    {
        let cells = &job.grid[l * job.n_cells..(l + 1) * job.n_cells];
        let samples = &mut samples[first * n_samples..(first + len) * n_samples];
        for (lane, samples) in samples.chunks_exact_mut(n_samples).enumerate() {
            if cells.is_empty() {
                samples.fill(Complex32::ZERO);
            } else {
                row.fill(Complex32::ZERO);
                let mut at = start;
                for cell in cells {
                    row[at] += Complex32::new(cell.re[lane], cell.im[lane]);
                    at = if at + 1 == m { 0 } else { at + 1 };
                }
                fft.process_with_scratch(row, scratch);
                let (negative, positive) = samples.split_at_mut(half);
                let (factor_negative, factor_positive) = deapodisation.split_at(half);
                let parts = [
                    (negative, &row[m - half..], factor_negative),
                    (positive, &row[..n_samples - half], factor_positive),
                ];
                let mut energy = 0.0_f32;
                for (to, from, factors) in parts {
                    energy += scale(to, from, factors);
                }
                *job.energy += f64::from(energy);
            }
            if let Some((state, rms)) = &mut job.noise {
                add_noise_body::<L>(state, samples, *rms);
            }
        }
    }
}

/// `to = from * factors`; returns the sum of squares, in sixteen partial sums for vectors.
#[inline(always)]
fn scale(to: &mut [Complex32], from: &[Complex32], factors: &[f32]) -> f32 {
    let mut sums = [0.0_f32; 16];
    let n = to.len().min(from.len()).min(factors.len());
    let mut i = 0;
    while i + 16 <= n {
        let (to, from, factors) = (&mut to[i..i + 16], &from[i..i + 16], &factors[i..i + 16]);
        for k in 0..16 {
            let z = from[k] * factors[k];
            sums[k] += z.re * z.re + z.im * z.im;
            to[k] = z;
        }
        i += 16;
    }
    for k in i..n {
        let z = from[k] * factors[k];
        sums[0] += z.norm_sqr();
        to[k] = z;
    }
    sums.iter().sum()
}
