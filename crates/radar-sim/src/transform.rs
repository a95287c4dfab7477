//! From the range grid to ADC samples: one inverse FFT per chirp and receiver, deapodisation, noise.
//!
//! Lanes are channels. A scene fills only a few of the M cells, so that most inputs of a transform over all M would be
//! zero. The transform is therefore split into R parts of m = M / R cells, where m is at least the number of cells in
//! use. Sample `R q + s` is number q of the transform over m cells of `x[k] exp(j 2 pi k s / M)`. Sixteen samples at a
//! time are then transposed to rows.

use num_complex::Complex32;

use crate::gridding::Kernel;
use crate::noise::gaussians;
use crate::spread::ChannelBlock;
use radarllm_simd::fft::{C, Pass, all_cell_passes, factors, passes, root};
use radarllm_simd::{Cell, LANES, SimdF32x16, SimdLevel, dispatch};

/// Maximum number of parts of a plan, which bounds the tables.
const MAX_PARTS: usize = 64;

/// Plans and buffers.
pub(crate) struct RangeTransform {
    level: SimdLevel,
    n_samples: usize,
    n_cells: usize,
    /// Plans in ascending order of the cells per part.
    plans: Vec<Plan>,
    /// (cos, sin) of `2 pi i / M`.
    roots: Vec<[f32; 2]>,
    /// Deapodisation factors of the samples, sixteen at a time.
    deapodisation: Vec<[f32; LANES]>,
    /// `[part][cell]`: (cos, sin) of `2 pi k s / M`.
    turns: Vec<[f32; 2]>,
    /// The cells of a part, and the workspace of the transform. From here to `spectrum`, real and imaginary parts are
    /// exchanged, which turns the forward transform into the inverse one.
    part: Vec<Cell>,
    spare: Vec<Cell>,
    /// `[part][number]`.
    spectrum: Vec<Cell>,
    /// `[channel][sample / 16]`.
    rows: Vec<Cell>,
}

/// The transform in R parts of m cells.
struct Plan {
    n_parts: usize,
    part_cells: usize,
    passes: Vec<Pass>,
    /// Positions of the samples in the spectrum, sixteen at a time.
    places: Vec<[usize; LANES]>,
}

impl RangeTransform {
    pub(crate) fn new(level: SimdLevel, n_samples: usize, n_cells: usize, kernel: &Kernel) -> Self {
        let n_blocks = n_samples.div_ceil(LANES);
        let plans = (1..=MAX_PARTS).rev();
        let plans = plans.filter(|n| n_cells.is_multiple_of(*n));
        let plans: Vec<Plan> = plans
            .filter_map(|n_parts| {
                let part_cells = n_cells / n_parts;
                // Sample i is n = i - n_samples / 2. Negative n are at the end of the transform.
                let place = |i: usize| {
                    let n = (i + n_cells - n_samples / 2) % n_cells;
                    n % n_parts * part_cells + n / n_parts
                };
                let block = |block: usize| {
                    std::array::from_fn(|i| place((LANES * block + i).min(n_samples - 1)))
                };
                Some(Plan {
                    n_parts,
                    part_cells,
                    passes: passes(part_cells, &factors(part_cells, level)?),
                    places: (0..n_blocks).map(block).collect(),
                })
            })
            .collect();
        let mut deapodisation = vec![[0.0; LANES]; n_blocks];
        for (to, factor) in deapodisation
            .as_flattened_mut()
            .iter_mut()
            .zip(kernel.deapodisation(n_samples, n_cells))
        {
            *to = factor;
        }
        Self {
            level,
            n_samples,
            n_cells,
            plans,
            roots: (0..n_cells).map(|i| inverse_root(i, n_cells)).collect(),
            deapodisation,
            turns: Vec::new(),
            part: vec![Cell::ZERO; n_cells],
            spare: vec![Cell::ZERO; n_cells],
            spectrum: vec![Cell::ZERO; n_cells],
            rows: vec![Cell::ZERO; LANES * n_blocks],
        }
    }
}

/// (cos, sin) of `2 pi index / len`.
fn inverse_root(index: usize, len: usize) -> [f32; 2] {
    let [cos, sin] = root(index, len);
    [cos, -sin]
}

/// Rows of samples as cells of sixteen, `[row][sample / 16]`; the last one of a row is filled up with zeros.
pub(crate) fn sample_cells(samples: &[Complex32], n_samples: usize) -> Vec<Cell> {
    let blocks = samples
        .chunks_exact(n_samples)
        .flat_map(|row| row.chunks(LANES));
    blocks
        .map(|block| {
            let part =
                |of: fn(&Complex32) -> f32| std::array::from_fn(|i| block.get(i).map_or(0.0, of));
            Cell {
                re: part(|z| z.re),
                im: part(|z| z.im),
            }
        })
        .collect()
}

/// Input and output of one pass.
pub(crate) struct TransformJob<'a> {
    pub transform: &'a mut RangeTransform,
    pub channels: &'a ChannelBlock,
    /// `[loop][cell]`, cells from `first_cell`.
    pub grid: &'a [Cell],
    pub first_cell: i32,
    pub n_cells: usize,
    /// Samples that are added to those of every loop, `[lane][sample / 16]`; see [`sample_cells`].
    pub constant: Option<&'a [Cell]>,
    /// Samples of the segment's loops, `[loop][channel][sample]`.
    pub out: &'a mut [Complex32],
    pub n_channels: usize,
    /// State of the noise generator and rms of the noise, if this pass adds noise.
    pub noise: Option<(&'a mut [[u32; 16]; 4], f32)>,
    /// Receives the sum of |signal|^2, noise not included.
    pub energy: &'a mut f64,
}

dispatch!(
    /// Writes the samples of all loops for the channels of one block.
    pub(crate) fn transform => transform_body(job: TransformJob<'_>)
);

#[inline(always)]
fn transform_body<L: SimdF32x16>(mut job: TransformJob<'_>) {
    let RangeTransform {
        level,
        n_samples,
        n_cells: m,
        plans,
        roots,
        deapodisation,
        turns,
        part,
        spare,
        spectrum,
        rows,
    } = job.transform;
    let (n_samples, m) = (*n_samples, *m);
    let ChannelBlock { first, len, .. } = *job.channels;
    // The last plan has a single part with all cells. If more cells than that are in use, they are folded onto one
    // another.
    let fits = |plan: &&Plan| plan.part_cells >= job.n_cells || plan.n_parts == 1;
    let Some(plan) = plans.iter().find(fits) else {
        return;
    };
    let (n_parts, part_cells) = (plan.n_parts, plan.part_cells);
    let (part, spare) = (&mut part[..part_cells], &mut spare[..part_cells]);
    part.fill(Cell::ZERO);
    let first_cell = job.first_cell.rem_euclid(m as i32) as usize;
    turns.clear();
    for s in 0..n_parts {
        turns.extend((0..job.n_cells).map(|i| roots[(first_cell + i) * s % m]));
    }
    for (l, samples) in job
        .out
        .chunks_exact_mut(job.n_channels * n_samples)
        .enumerate()
    {
        let cells = &job.grid[l * job.n_cells..(l + 1) * job.n_cells];
        let samples = &mut samples[first * n_samples..(first + len) * n_samples];
        for s in 0..n_parts {
            let turns = &turns[s * job.n_cells..(s + 1) * job.n_cells];
            fill_part::<L>(part, first_cell, cells, turns);
            let out = &mut spectrum[s * part_cells..(s + 1) * part_cells];
            all_cell_passes(*level, &plan.passes, part, out, spare);
        }
        let constant = job.constant;
        *job.energy += to_rows::<L>(spectrum, &plan.places, deapodisation, constant, len, rows);
        for (samples, row) in samples
            .chunks_exact_mut(n_samples)
            .zip(rows.chunks_exact(deapodisation.len()))
        {
            write_row::<L>(row, &mut job.noise, samples);
        }
    }
}

/// Multiplies cells by phasors and stores them, with real and imaginary parts exchanged, where the transform of a part
/// reads them.
#[inline(always)]
fn fill_part<L: SimdF32x16>(part: &mut [Cell], first: usize, cells: &[Cell], turns: &[[f32; 2]]) {
    let m = part.len();
    let mut at = first % m;
    for (i, (cell, &turn)) in cells.iter().zip(turns).enumerate() {
        let turned = C::<L>::load(cell).turned(turn);
        let (mut re, mut im) = (turned.im, turned.re);
        let to = &mut part[at];
        // Cells that are folded onto earlier ones.
        if i >= m {
            re = re.add(L::load(&to.re));
            im = im.add(L::load(&to.im));
        }
        C { re, im }.store(to);
        at = if at + 1 == m { 0 } else { at + 1 };
    }
}

/// Writes the samples of the first `len` lanes row by row, with the constant ones added, and returns the sum of their squares.
#[inline(always)]
fn to_rows<L: SimdF32x16>(
    spectrum: &[Cell],
    places: &[[usize; LANES]],
    deapodisation: &[[f32; LANES]],
    constant: Option<&[Cell]>,
    len: usize,
    rows: &mut [Cell],
) -> f64 {
    let zero = L::splat(0.0);
    let mut energy = zero;
    let n_blocks = deapodisation.len();
    for (block, (places, factors)) in places.iter().zip(deapodisation).enumerate() {
        let (mut re, mut im) = ([zero; LANES], [zero; LANES]);
        for i in 0..LANES {
            // Exchanges real and imaginary parts back.
            let Cell { re: z_im, im: z_re } = &spectrum[places[i]];
            (re[i], im[i]) = (L::load(z_re), L::load(z_im));
        }
        L::transpose(&mut re);
        L::transpose(&mut im);
        let factors = L::load(factors);
        for lane in 0..len {
            let (mut re, mut im) = (re[lane].mul(factors), im[lane].mul(factors));
            if let Some(constant) = constant {
                let more = &constant[lane * n_blocks + block];
                re = re.add(L::load(&more.re));
                im = im.add(L::load(&more.im));
            }
            energy = re.fma(re, im.fma(im, energy));
            C { re, im }.store(&mut rows[lane * n_blocks + block]);
        }
    }
    f64::from(energy.reduce_sum())
}

/// Writes the samples of a row, with noise if there is any.
#[inline(always)]
fn write_row<L: SimdF32x16>(
    row: &[Cell],
    noise: &mut Option<(&mut [[u32; 16]; 4], f32)>,
    samples: &mut [Complex32],
) {
    let (blocks, rest) = samples.as_chunks_mut::<LANES>();
    for (i, cell) in row.iter().enumerate() {
        let (mut re, mut im) = (L::load(&cell.re), L::load(&cell.im));
        if let Some((state, rms)) = noise {
            let (more_re, more_im) = gaussians::<L>(state, *rms);
            re = re.add(more_re);
            im = im.add(more_im);
        }
        if let Some(block) = blocks.get_mut(i) {
            L::store_complex(re, im, block);
        } else {
            let mut block = [Complex32::ZERO; LANES];
            L::store_complex(re, im, &mut block);
            rest.copy_from_slice(&block[..rest.len()]);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use radarllm_base::RadarConfig;

    use super::*;
    use crate::gridding::grid_cells;

    /// Tests few cells, cells across the end of the grid, more cells than the grid has, and rows whose length is not a
    /// multiple of sixteen.
    #[test]
    fn samples_are_the_inverse_transform_of_the_cells() {
        for (n_samples, first_cell, n_used) in [
            (256, 98, 21),
            (256, -9, 45),
            (100, 140, 60),
            (37, -3, 130),
            (64, 5, 0),
        ] {
            let config = RadarConfig {
                n_samples,
                ..RadarConfig::awr1843boost()
            };
            let n_channels = config.tx.len() * config.rx.len();
            let channels = &ChannelBlock::all(&config, Default::default())[0];
            let (n_loops, m) = (2, grid_cells(n_samples));
            let kernel = Kernel::new(m as f64 / n_samples as f64);
            let random = |i: usize| ((i * 7 + 3) as f32 * 0.618_034).fract() - 0.5;
            let grid: Vec<Cell> = (0..n_loops * n_used)
                .map(|i| Cell {
                    re: std::array::from_fn(|lane| random(32 * i + lane)),
                    im: std::array::from_fn(|lane| random(32 * i + lane + 16)),
                })
                .collect();
            let more: Vec<Complex32> = (0..n_channels * n_samples)
                .map(|i| Complex32::new(random(5 * i), random(5 * i + 2)))
                .collect();
            let constant = sample_cells(&more, n_samples);
            for level in SimdLevel::available() {
                let mut plan = RangeTransform::new(level, n_samples, m, &kernel);
                let mut out = vec![Complex32::ONE; n_loops * n_channels * n_samples];
                let mut energy = 0.0;
                let job = TransformJob {
                    transform: &mut plan,
                    channels,
                    grid: &grid,
                    first_cell,
                    n_cells: n_used,
                    constant: (n_used == 21).then_some(&constant[..]),
                    out: &mut out,
                    n_channels,
                    noise: None,
                    energy: &mut energy,
                };
                transform(level, job);
                let factors = kernel.deapodisation(n_samples, m);
                let mut sum = 0.0;
                for (i, found) in out.iter().enumerate() {
                    let (row, sample) = (i / n_samples, i % n_samples);
                    let (l, lane) = (row / n_channels, row % n_channels);
                    let n = sample as f64 - (n_samples / 2) as f64;
                    let (mut re, mut im) = (0.0, 0.0);
                    for (k, cell) in grid[l * n_used..(l + 1) * n_used].iter().enumerate() {
                        let k = f64::from(first_cell) + k as f64;
                        let (sin, cos) = (TAU * k * n / m as f64).sin_cos();
                        let (x, y) = (f64::from(cell.re[lane]), f64::from(cell.im[lane]));
                        re += x * cos - y * sin;
                        im += x * sin + y * cos;
                    }
                    let factor = f64::from(factors[sample]);
                    let more = if n_used == 21 {
                        more[lane * n_samples + sample]
                    } else {
                        Complex32::ZERO
                    };
                    let error = (f64::from(found.re - more.re) - factor * re)
                        .hypot(f64::from(found.im - more.im) - factor * im);
                    // Sums of up to 130 numbers of about 0.4, in f32. The factors are below 3.
                    assert!(error < 1e-5, "{level:?} {n_samples} {i}: {error}");
                    sum += f64::from(found.norm_sqr());
                }
                assert!((energy - sum).abs() <= 1e-5 * sum, "{energy} {sum}");
            }
        }
    }
}
