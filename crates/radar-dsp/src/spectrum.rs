//! From samples to range-Doppler spectra: windows, FFTs, clutter removal, detection map.

use std::ops::Range;
use std::sync::Arc;

use num_complex::Complex32;
use radarllm_base::radar_config::Firing;
use radarllm_base::{RadarConfig, RadarCube};
use rustfft::{Fft, FftPlanner};

use crate::error::DspError;
use crate::options::{ClutterFilter, DspOptions, MapKind};

/// Rows transposed together: 8 complex values are one cache line.
const BLOCK: usize = 8;

/// Longest range FFT: eight times the most samples a chirp of the supported parts has.
const MAX_RANGE_FFT: usize = 1 << 16;

/// Plan and workspace of the range-Doppler stage.
///
/// # Shapes
/// - spectra: `[channel, gated range bin, doppler]`, channel = `tx * n_rx + rx`
/// - map: `[gated range bin, doppler]`
///
/// Doppler is kept in FFT order (bin 0 first); [`signed_doppler`] turns an index into the signed bin.
/// All FFTs are forward, e^{-j...}, unnormalised.
pub struct Spectrum {
    shape: [usize; 4],
    /// Range bins of the FFT: at least the number of samples.
    pub n_range: usize,
    /// Range from one bin to the next, m.
    pub range_step_m: f64,
    /// Range bins kept.
    pub gate: Range<usize>,
    map_kind: MapKind,
    /// Slow-time weights of the mean to subtract; empty to keep statics.
    mean_weights: Vec<f32>,
    range_window: Vec<f32>,
    doppler_window: Vec<f32>,
    /// Factor per Doppler index that takes slot 1 back to the time of slot 0; empty without binary
    /// phase modulation.
    bpm_factors: Vec<Complex32>,
    range_fft: Arc<dyn Fft<f32>>,
    doppler_fft: Arc<dyn Fft<f32>>,
    scratch: Vec<Complex32>,
    /// One channel's chirps, `[loop, range bin]`.
    chirps: Vec<Complex32>,
    mean: Vec<Complex32>,
    coherent: Vec<Complex32>,
    /// Complex spectra of the last cube.
    pub spectra: Vec<Complex32>,
    /// Detection power of the last cube: sum of |.|^2, or |sum|^2 for the coherent kind.
    pub map: Vec<f32>,
}

/// The signed Doppler bin of FFT index `index`: 0, 1, .., then negative, as after an fftshift.
pub fn signed_doppler(index: usize, n_loops: usize) -> i64 {
    if index < n_loops.div_ceil(2) {
        index as i64
    } else {
        index as i64 - n_loops as i64
    }
}

impl Spectrum {
    /// Plans for a valid radar.
    ///
    /// # Errors
    /// [`DspError::Option`] if the range gate holds no bin, or clutter removal has a single loop.
    pub fn new(radar: &RadarConfig, options: &DspOptions) -> Result<Self, DspError> {
        let (n_loops, n_samples) = (radar.n_loops, radar.n_samples);
        if options.clutter != ClutterFilter::Off && n_loops < 2 {
            return Err(DspError::Option {
                field: "clutter",
                problem: "the radar has a single loop per frame: nothing can be seen to move"
                    .into(),
            });
        }
        let n_range = options.range_fft_len.unwrap_or(n_samples);
        if !(n_samples..=MAX_RANGE_FFT.max(n_samples)).contains(&n_range) {
            return Err(DspError::Option {
                field: "range_fft_len",
                problem: format!(
                    "must be from the {n_samples} samples of a chirp to {MAX_RANGE_FFT}, found {n_range}"
                ),
            });
        }
        let range_step_m = radar.range_resolution_m() * n_samples as f64 / n_range as f64;
        let gate = range_gate(options, range_step_m, n_range)?;
        let n_channels = radar.tx.len() * radar.rx.len();
        let doppler_window = options.doppler_window.weights(n_loops);
        let mut planner = FftPlanner::new();
        let range_fft = planner.plan_fft_forward(n_range);
        let doppler_fft = planner.plan_fft_forward(n_loops);
        let n_scratch = range_fft
            .get_inplace_scratch_len()
            .max(doppler_fft.get_inplace_scratch_len());
        let n_cells = gate.len() * n_loops;
        let n_coherent = if options.map == MapKind::Coherent {
            n_cells
        } else {
            0
        };
        Ok(Self {
            shape: [n_loops, radar.tx.len(), radar.rx.len(), n_samples],
            n_range,
            range_step_m,
            map_kind: options.map,
            mean_weights: mean_weights(options.clutter, &doppler_window),
            range_window: options.range_window.weights(n_samples),
            doppler_window,
            bpm_factors: bpm_factors(radar, options),
            range_fft,
            doppler_fft,
            scratch: vec![Complex32::ZERO; n_scratch],
            chirps: vec![Complex32::ZERO; n_loops * n_range],
            mean: vec![Complex32::ZERO; gate.len()],
            coherent: vec![Complex32::ZERO; n_coherent],
            spectra: vec![Complex32::ZERO; n_channels * n_cells],
            map: vec![0.0; n_cells],
            gate,
        })
    }

    /// Number of Doppler bins.
    pub fn n_doppler(&self) -> usize {
        self.shape[0]
    }

    /// Channels, slots times receivers.
    pub fn n_channels(&self) -> usize {
        self.shape[1] * self.shape[2]
    }

    /// Fills [`Self::spectra`] and [`Self::map`] from a cube.
    ///
    /// # Errors
    /// Wrong shape, a sample that is not finite, or power beyond `f32`.
    pub fn run(&mut self, cube: &RadarCube) -> Result<(), DspError> {
        self.check_shape(cube)?;
        let n_cells = self.map.len();
        self.map.fill(0.0);
        self.coherent.fill(Complex32::ZERO);
        for channel in 0..self.n_channels() {
            self.range_spectra(cube, channel)?;
            let spectra = &mut self.spectra[channel * n_cells..][..n_cells];
            gated_slow_time(
                &self.chirps,
                self.n_range,
                self.gate.clone(),
                &self.mean_weights,
                &mut self.mean,
                &self.doppler_window,
                spectra,
            );
            self.doppler_fft
                .process_with_scratch(spectra, &mut self.scratch);
            if self.bpm_factors.is_empty() {
                self.add_to_map(channel);
            }
        }
        if !self.bpm_factors.is_empty() {
            self.decode_bpm();
            for channel in 0..self.n_channels() {
                self.add_to_map(channel);
            }
        }
        add_power(&mut self.map[..self.coherent.len()], &self.coherent);
        if self.map_kind == MapKind::MeanLog {
            let per_channel = 1.0 / self.n_channels() as f32;
            for value in &mut self.map {
                *value = (*value * per_channel).exp();
            }
        }
        // Non-negative or NaN, so the largest value shows any that is not finite.
        match self.map.iter().position(|p| !p.is_finite()) {
            None => Ok(()),
            Some(cell) => Err(DspError::Overflow {
                range_bin: self.gate.start + cell / self.shape[0],
                doppler_bin: signed_doppler(cell % self.shape[0], self.shape[0]),
            }),
        }
    }

    fn add_to_map(&mut self, channel: usize) {
        let n_cells = self.map.len();
        let spectra = &self.spectra[channel * n_cells..][..n_cells];
        match self.map_kind {
            MapKind::NonCoherent => add_power(&mut self.map, spectra),
            MapKind::MeanLog => add_log_power(&mut self.map, spectra),
            MapKind::Coherent => {
                for (sum, value) in self.coherent.iter_mut().zip(spectra) {
                    *sum += value;
                }
            }
        }
    }

    /// Slot spectra into transmitter spectra, both as of slot 0: with A = S1 + S2 and the later slot
    /// B = (S1 - S2) e^{j phi}, S1 = (A + B e^{-j phi}) / 2 and S2 = (A - B e^{-j phi}) / 2. The echo of
    /// either is as strong as in time division, the noise of two slots is averaged.
    fn decode_bpm(&mut self) {
        let (first, second) = self.spectra.split_at_mut(self.shape[2] * self.map.len());
        let n_loops = self.shape[0];
        let rows = first.chunks_exact_mut(n_loops);
        for (a_row, b_row) in rows.zip(second.chunks_exact_mut(n_loops)) {
            for ((a, b), factor) in a_row.iter_mut().zip(b_row).zip(&self.bpm_factors) {
                let (sum, difference) = (*a, *b * factor);
                *a = (sum + difference) * 0.5;
                *b = (sum - difference) * 0.5;
            }
        }
    }

    /// Windowed range FFTs of all chirps of one channel, `[loop, range bin]`, all bins. With binary
    /// phase modulation these are the slots', not the transmitters'.
    ///
    /// # Errors
    /// [`DspError::NotFinite`].
    pub fn range_spectra(
        &mut self,
        cube: &RadarCube,
        channel: usize,
    ) -> Result<&[Complex32], DspError> {
        let [n_loops, _, n_rx, n_samples] = self.shape;
        let n_range = self.n_range;
        let (slot, rx) = (channel / n_rx, channel % n_rx);
        for loop_idx in 0..n_loops {
            let samples = cube.chirp(loop_idx, slot, rx);
            let out = &mut self.chirps[loop_idx * n_range..][..n_range];
            let (out, padding) = out.split_at_mut(n_samples);
            padding.fill(Complex32::ZERO);
            if !window_into(out, samples, &self.range_window) {
                let bad = samples
                    .iter()
                    .position(|s| !(s.re.is_finite() && s.im.is_finite()));
                let index = [loop_idx, slot, rx, bad.unwrap_or(0)];
                return Err(DspError::NotFinite { index });
            }
        }
        self.range_fft
            .process_with_scratch(&mut self.chirps, &mut self.scratch);
        Ok(&self.chirps)
    }

    /// Refuses a cube of another shape, or one whose data does not fill its shape.
    ///
    /// # Errors
    /// [`DspError::Shape`], [`DspError::Length`], [`DspError::Time`].
    pub fn check_shape(&self, cube: &RadarCube) -> Result<(), DspError> {
        let found = [cube.n_loops, cube.n_tx, cube.n_rx, cube.n_samples];
        if found != self.shape {
            return Err(DspError::Shape {
                expected: self.shape,
                found,
            });
        }
        let expected = self.shape.iter().product();
        if cube.data.len() != expected {
            return Err(DspError::Length {
                shape: found,
                expected,
                found: cube.data.len(),
            });
        }
        if !cube.time_s.is_finite() {
            return Err(DspError::Time);
        }
        Ok(())
    }
}

/// A target in Doppler bin k gains the phase 2 pi k / (2 n_loops) in half a loop. Within a bin it is off
/// by up to pi / (2 n_loops), which leaves -44 dB of one transmitter in the other at 128 loops.
fn bpm_factors(radar: &RadarConfig, options: &DspOptions) -> Vec<Complex32> {
    if radar.firing != Firing::Bpm {
        return vec![];
    }
    let n_loops = radar.n_loops;
    (0..n_loops)
        .map(|index| {
            if !options.compensate_tdm {
                return Complex32::ONE;
            }
            let turns = signed_doppler(index, n_loops) as f64 / (2 * n_loops) as f64;
            let (sin, cos) = (std::f64::consts::TAU * turns).sin_cos();
            Complex32::new(cos as f32, -sin as f32)
        })
        .collect()
}

fn range_gate(options: &DspOptions, bin_m: f64, n_range: usize) -> Result<Range<usize>, DspError> {
    for (field, value) in [
        ("min_range_m", options.min_range_m),
        ("max_range_m", options.max_range_m),
    ] {
        if !(value.is_finite() && value >= 0.0) {
            let problem = format!("must be finite and not negative, found {value}");
            return Err(DspError::Option { field, problem });
        }
    }
    // Saturating casts: a gate beyond the last bin ends there.
    let first = (options.min_range_m / bin_m).ceil() as usize;
    let end = ((options.max_range_m / bin_m).floor() as usize)
        .saturating_add(1)
        .min(n_range);
    if first >= end {
        return Err(DspError::Option {
            field: "min_range_m",
            problem: format!(
                "no range bin between {} m and {} m: bins are {bin_m:.4} m wide and end at {:.2} m",
                options.min_range_m,
                options.max_range_m,
                bin_m * n_range as f64
            ),
        });
    }
    Ok(first..end)
}

/// Writes samples times weights; false if a sample is NaN or infinite.
///
/// Exponent bits all ones mean not finite; integer operations let the loop vectorise.
fn window_into(out: &mut [Complex32], samples: &[Complex32], weights: &[f32]) -> bool {
    const EXPONENT: u32 = 0x7f80_0000;
    let mut bad = 0_u32;
    for ((out, s), weight) in out.iter_mut().zip(samples).zip(weights) {
        bad |= u32::from(s.re.to_bits() & EXPONENT == EXPONENT);
        bad |= u32::from(s.im.to_bits() & EXPONENT == EXPONENT);
        *out = s * weight;
    }
    bad == 0
}

/// Weights that sum to one, or none.
fn mean_weights(clutter: ClutterFilter, window: &[f32]) -> Vec<f32> {
    let weights: Vec<f64> = match clutter {
        ClutterFilter::Off => vec![],
        ClutterFilter::Mean => vec![1.0; window.len()],
        ClutterFilter::WeightedMean => window.iter().map(|w| f64::from(*w)).collect(),
    };
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| (w / sum) as f32).collect()
}

/// Transposes the gated bins to `[range bin, loop]`, less their slow-time mean, times the window.
///
/// The mean goes before the window: after it, a static target would leave the window's own spectrum
/// around bin 0.
fn gated_slow_time(
    chirps: &[Complex32],
    n_range: usize,
    gate: Range<usize>,
    mean_weights: &[f32],
    mean: &mut [Complex32],
    window: &[f32],
    out: &mut [Complex32],
) {
    let n_loops = window.len();
    let rows = || chirps.chunks_exact(n_range).map(|row| &row[gate.clone()]);
    mean.fill(Complex32::ZERO);
    for (row, &weight) in rows().zip(mean_weights) {
        for (sum, value) in mean.iter_mut().zip(row) {
            *sum += value * weight;
        }
    }
    for (block_idx, out) in out.chunks_mut(BLOCK * n_loops).enumerate() {
        let first = block_idx * BLOCK;
        let n = out.len() / n_loops;
        let mut offset = [Complex32::ZERO; BLOCK];
        offset[..n].copy_from_slice(&mean[first..first + n]);
        if n == BLOCK {
            // Fixed size: the compiler unrolls this, the common case.
            for (l, (row, &weight)) in rows().zip(window).enumerate() {
                let row = &row[first..first + BLOCK];
                for i in 0..BLOCK {
                    out[i * n_loops + l] = (row[i] - offset[i]) * weight;
                }
            }
        } else {
            for (l, (row, &weight)) in rows().zip(window).enumerate() {
                for (i, &value) in row[first..first + n].iter().enumerate() {
                    out[i * n_loops + l] = (value - offset[i]) * weight;
                }
            }
        }
    }
}

fn add_power(map: &mut [f32], spectra: &[Complex32]) {
    for (power, value) in map.iter_mut().zip(spectra) {
        *power += value.re * value.re + value.im * value.im;
    }
}

/// Adds ln |.|^2; an exact zero counts as the smallest positive number.
fn add_log_power(sum: &mut [f32], spectra: &[Complex32]) {
    for (sum, value) in sum.iter_mut().zip(spectra) {
        *sum += (value.re * value.re + value.im * value.im)
            .max(f32::MIN_POSITIVE)
            .ln();
    }
}
