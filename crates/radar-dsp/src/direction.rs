//! Angle estimation for one range-Doppler cell from the phases across the virtual array.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use num_complex::{Complex32, Complex64};
use radarllm_base::RadarConfig;
use radarllm_base::radar_config::TxMultiplexing;
use radarllm_simd::any_length::{self, Fft};

use crate::array::{Element, VirtualArray};
use crate::options::DspOptions;
use crate::spectrum::signed_doppler;

/// Minimum size of the azimuth FFT. Longer rows get at least four bins per element.
const MIN_AZIMUTH_FFT: usize = 64;

/// Steps between elements that differ by less than this are treated as equal, m. The resulting phases differ by less
/// than rounding.
const SAME_STEP_M: f64 = 1e-15;

/// Direction cosines of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    /// Component to the right.
    pub u_x: f64,
    /// Component upwards.
    pub u_z: f64,
}

/// Plan and workspace of the angle estimation.
pub struct DirectionFinder {
    array: VirtualArray,
    wavelength_m: f64,
    refine: bool,
    /// Quantisation step of the amplitudes of the azimuth spectrum. 0 disables quantisation.
    step: f32,
    fft: Arc<dyn Fft<f32>>,
    scratch: Vec<Complex32>,
    row: Vec<Complex32>,
    n_rx: usize,
    n_loops: usize,
    /// See [`tdm_phases`].
    tdm_phases: Vec<Complex32>,
}

impl DirectionFinder {
    /// Plans for a valid radar.
    pub fn new(radar: &RadarConfig, options: &DspOptions) -> Self {
        let array = VirtualArray::new(radar);
        let n_fft = MIN_AZIMUTH_FFT.max((4 * array.azimuth_row.len()).next_power_of_two());
        let fft = any_length::forward(n_fft);
        Self {
            wavelength_m: radar.wavelength_m(),
            refine: options.refine_azimuth,
            step: options.azimuth_step_db.map_or(0.0, |db| {
                array.azimuth_row.len() as f32 * 10_f64.powf(db / 20.0) as f32
            }),
            scratch: vec![Complex32::ZERO; fft.get_inplace_scratch_len()],
            row: vec![Complex32::ZERO; n_fft],
            fft,
            n_rx: radar.rx.len(),
            n_loops: radar.n_loops,
            tdm_phases: tdm_phases(
                radar.tx.len(),
                radar.n_loops,
                // Decoding binary phase modulation already refers both transmitters to the same time.
                options.compensate_tdm && radar.multiplexing == TxMultiplexing::Tdm,
            ),
            array,
        }
    }

    /// The derived array.
    pub fn array(&self) -> &VirtualArray {
        &self.array
    }

    /// Number of azimuth bins of [`Self::azimuth_spectrum`].
    pub fn n_azimuth(&self) -> usize {
        self.row.len()
    }

    /// Direction cosine `u_x` of a target that causes this phase step per row element: the inverse of
    /// `-2 pi spacing / lambda * u_x`.
    pub fn u_x_of_phase_step(&self, step_rad: f64) -> f64 {
        -step_rad * self.wavelength_m / (TAU * self.array.spacing_m)
    }

    /// Direction of the strongest target in one cell.
    ///
    /// `value(channel)` is the cell's spectrum in channel `slot * n_rx + rx`, and `doppler` is its signed bin. The
    /// cosines may lie outside the unit disc. The caller decides how to treat such a cell.
    pub fn direction(&mut self, doppler: i64, value: impl Fn(usize) -> Complex32) -> Direction {
        if !self.array.has_azimuth() {
            return Direction {
                u_x: 0.0,
                u_z: self.elevation(0.0, doppler, &value),
            };
        }
        let step = self.step;
        let spectrum = self.azimuth_spectrum(doppler, &value);
        let n = spectrum.len();
        let mut peak = 0;
        if step > 0.0 {
            let level = |bin: usize| (spectrum[bin].norm() / step).floor();
            // A phase that falls from element to element corresponds to a target on the right, so that the search
            // starts there.
            for bin in (1..n).rev() {
                if level(bin) > level(peak) {
                    peak = bin;
                }
            }
        } else {
            for (i, v) in spectrum.iter().enumerate() {
                if v.norm_sqr() > spectrum[peak].norm_sqr() {
                    peak = i;
                }
            }
        }
        let mut bin = peak as f64;
        if self.refine {
            let power = |i: usize| self.row[i % n].norm_sqr();
            bin += parabola_offset(power(peak + n - 1), power(peak), power(peak + 1));
        }
        let step_rad = wrap_pi(TAU * bin / n as f64);
        let u_x = self.u_x_of_phase_step(step_rad);
        let u_z = self.elevation(step_rad, doppler, &value);
        Direction { u_x, u_z }
    }

    /// Zero-padded, TDM-compensated FFT over the azimuth row of one cell, in FFT order. Bin k corresponds to the phase
    /// step 2 pi k / n per element.
    pub fn azimuth_spectrum(
        &mut self,
        doppler: i64,
        value: impl Fn(usize) -> Complex32,
    ) -> &[Complex32] {
        self.row.fill(Complex32::ZERO);
        for (i, element) in self.array.azimuth_row.iter().enumerate() {
            self.row[i] = value(element.channel) * self.tdm_phase(element.channel, doppler);
        }
        self.fft
            .process_with_scratch(&mut self.row, &mut self.scratch);
        &self.row
    }

    /// Direction cosine u_z from the phase between the azimuth row and the elevation row, both steered to the estimated
    /// azimuth.
    fn elevation(&self, step_rad: f64, doppler: i64, value: &impl Fn(usize) -> Complex32) -> f64 {
        if !self.array.has_elevation() {
            return 0.0;
        }
        let low = self.steered(&self.array.azimuth_row, step_rad, doppler, value);
        let high = self.steered(&self.array.elevation_row, step_rad, doppler, value);
        let phase_rad = (high * low.conj()).arg();
        -phase_rad * self.wavelength_m / (TAU * self.array.height_m)
    }

    fn steered(
        &self,
        row: &[Element],
        step_rad: f64,
        doppler: i64,
        value: &impl Fn(usize) -> Complex32,
    ) -> Complex64 {
        let first_m = self.array.azimuth_row[0].x_m;
        let per_metre = if self.array.spacing_m > 0.0 {
            step_rad / self.array.spacing_m
        } else {
            0.0
        };
        // Most elements follow each other at the same distance, so that sine and cosine are computed once instead of
        // for every element.
        let (mut x_m, mut step_m) = (first_m, 0.0);
        let (mut phasor, mut turn) = (Complex64::ONE, Complex64::ONE);
        let mut sum = Complex64::ZERO;
        for e in row {
            let dx_m = e.x_m - x_m;
            if (dx_m - step_m).abs() > SAME_STEP_M {
                (step_m, turn) = (dx_m, Complex64::cis(-per_metre * dx_m));
            }
            (phasor, x_m) = (phasor * turn, e.x_m);
            let v = value(e.channel) * self.tdm_phase(e.channel, doppler);
            sum += Complex64::new(f64::from(v.re), f64::from(v.im)) * phasor;
        }
        sum
    }

    /// TDM compensation: slot i fires i chirps later, and a target in Doppler bin k accumulates the phase 2 pi k i /
    /// (slots * loops) until then. This function removes it.
    pub(crate) fn tdm_phase(&self, channel: usize, doppler: i64) -> Complex32 {
        let slot = channel / self.n_rx;
        let index = doppler.rem_euclid(self.n_loops as i64) as usize;
        self.tdm_phases[slot * self.n_loops + index]
    }
}

/// TDM compensation factors, which remove the phase that a target accumulates until its slot, `[slot][doppler in FFT
/// order]`.
fn tdm_phases(n_slots: usize, n_loops: usize, compensate: bool) -> Vec<Complex32> {
    let factor = |slot: usize, index: usize| {
        if !compensate {
            return Complex32::ONE;
        }
        let cycles = signed_doppler(index, n_loops) as f64 * slot as f64;
        let (sin, cos) = (TAU * cycles / (n_slots * n_loops) as f64).sin_cos();
        Complex32::new(cos as f32, -sin as f32)
    };
    (0..n_slots)
        .flat_map(|slot| (0..n_loops).map(move |index| factor(slot, index)))
        .collect()
}

/// Vertex of the parabola through three log powers at -1, 0, 1. It is in -0.5..=0.5 if the middle is the largest. The
/// logarithm of a zero-padded main lobe is nearly a parabola.
fn parabola_offset(before: f32, peak: f32, after: f32) -> f64 {
    let [a, b, c] = [before, peak, after].map(|p| f64::from(p.max(f32::MIN_POSITIVE)).ln());
    let bend = a - 2.0 * b + c;
    if bend < 0.0 {
        (0.5 * (a - c) / bend).clamp(-0.5, 0.5)
    } else {
        0.0
    }
}

/// Wraps an angle in -2 pi..2 pi into -pi..=pi.
fn wrap_pi(angle_rad: f64) -> f64 {
    if angle_rad > PI {
        angle_rad - TAU
    } else if angle_rad < -PI {
        angle_rad + TAU
    } else {
        angle_rad
    }
}
