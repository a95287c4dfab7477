//! Corrections of raw samples before the signal chain: background subtraction, ADC offset removal, leakage removal, and
//! channel mismatch correction.
//!
//! All four are linear in the samples, so they can be applied before the windows and FFTs. For example, the FFT of the
//! mean chirp of a (slot, receiver) pair is the mean range profile of that virtual channel.

use std::f64::consts::TAU;

use num_complex::{Complex32, Complex64};
use radarllm_base::radar_config::TxMultiplexing;
use radarllm_base::{RadarConfig, RadarCube};

use crate::error::DspError;

/// Maximum number of tones in the leakage model, which corresponds to 32 range bins.
const MAX_TONES: usize = 67;
/// Minimum fraction of a tone's energy that must be orthogonal to the basis so far. A smaller part adds only rounding
/// errors.
const NEW_ENERGY: f64 = 1e-6;

/// Averages background frames, which are recorded without people, for later background subtraction.
///
/// # Example
/// ```
/// use radarllm_base::{RadarConfig, RadarCube};
/// use radarllm_radar_dsp::{Corrections, Corrector, EmptyRoom};
///
/// let radar = RadarConfig::awr1843boost();
/// // A wall: the same samples in every loop and frame.
/// let mut cube = RadarCube::zeros(128, 3, 4, 256);
/// cube.data.fill(num_complex::Complex32::new(3.0, -1.0));
///
/// let mut empty_room = EmptyRoom::new(&radar);
/// empty_room.push(&cube)?;
/// let background = empty_room.finish();
/// let corrections = Corrections { background, ..Corrections::default() };
/// Corrector::new(&radar, corrections)?.apply(&mut cube)?;
/// assert!(cube.data.iter().all(|sample| sample.norm() < 1e-6));
/// # Ok::<(), radarllm_radar_dsp::DspError>(())
/// ```
pub struct EmptyRoom {
    shape: [usize; 4],
    /// Sum of the frames' slow-time means, `[slot, rx, sample]`.
    sum: Vec<Complex64>,
    /// Sum of |mean chirp|^2 over the frames.
    power: f64,
    n_frames: usize,
}

/// The background: the mean chirp of every (slot, receiver) pair over all loops and frames of an empty scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Background {
    shape: [usize; 4],
    /// Mean chirps, `[slot, rx, sample]`, in the units of the samples.
    chirps: Vec<Complex32>,
    /// Number of frames in the mean.
    pub n_frames: usize,
    /// Mean power of the difference between a single frame's slow-time mean and this background, dB relative to the
    /// power of this background. Background subtraction cannot remove this part. It consists of noise and of changes of
    /// the room or the oscillator between frames. `None` for a single frame.
    pub drift_db: Option<f64>,
}

impl EmptyRoom {
    /// Creates an accumulator without frames for this radar.
    pub fn new(radar: &RadarConfig) -> Self {
        let shape = shape_of(radar);
        Self {
            shape,
            sum: vec![Complex64::ZERO; shape[1..].iter().product()],
            power: 0.0,
            n_frames: 0,
        }
    }

    /// Adds a frame without missing samples.
    ///
    /// # Errors
    /// Returns an error for a cube of another shape, or with values that are not finite.
    pub fn push(&mut self, cube: &RadarCube) -> Result<(), DspError> {
        check_shape(self.shape, cube)?;
        let is_bad = |z: &Complex32| !(z.re.is_finite() && z.im.is_finite());
        if let Some(i) = cube.data.iter().position(is_bad) {
            let [_, n_tx, n_rx, n_samples] = self.shape;
            let chirp = i / n_samples;
            let index = [
                chirp / (n_tx * n_rx),
                chirp / n_rx % n_tx,
                chirp % n_rx,
                i % n_samples,
            ];
            return Err(DspError::NotFinite { index });
        }
        let mean = slow_time_mean(cube);
        for (sum, value) in self.sum.iter_mut().zip(&mean) {
            *sum += value;
            self.power += value.norm_sqr();
        }
        self.n_frames += 1;
        Ok(())
    }

    /// Returns the mean of all frames, or `None` if there are none.
    pub fn finish(self) -> Option<Background> {
        if self.n_frames == 0 {
            return None;
        }
        let n = self.n_frames as f64;
        let mean_power: f64 = self.sum.iter().map(|z| (z / n).norm_sqr()).sum();
        let apart = (self.power / n - mean_power) / mean_power;
        Some(Background {
            shape: self.shape,
            chirps: self.sum.iter().map(|z| single(z / n)).collect(),
            n_frames: self.n_frames,
            // Rounding can make the difference of equal numbers negative.
            drift_db: (self.n_frames > 1 && mean_power > 0.0)
                .then(|| 10.0 * apart.max(1e-15).log10()),
        })
    }
}

/// The corrections to apply to raw samples.
#[derive(Clone, Debug, Default)]
pub struct Corrections {
    /// Background to subtract. Intended for use with [`crate::ClutterFilter::Off`]. A clutter filter that removes each
    /// frame's own mean already removes everything static, including people who stand still, so that background
    /// subtraction would have no further effect.
    pub background: Option<Background>,
    /// Whether to remove every receiver's mean over a frame, which is the offset of its ADC.
    pub remove_offset: bool,
    /// If set, removes static echoes up to this range, m. These are leakage from the transmitters to the receivers.
    pub leakage_m: Option<f64>,
    /// Complex gain of every channel, index `slot * n_rx + rx`. The channel's samples are divided by it. Empty for no
    /// gain correction.
    pub channel_gains: Vec<Complex64>,
}

/// Corrections planned for a radar.
pub struct Corrector {
    shape: [usize; 4],
    corrections: Corrections,
    /// Orthonormal basis of chirps that spans the leakage.
    leakage: Vec<Vec<Complex64>>,
    /// Reciprocals of the channel gains.
    factors: Vec<Complex32>,
}

impl Corrector {
    /// Plans the corrections for a valid radar.
    ///
    /// # Errors
    /// [`DspError::Option`] in these cases: a background of another shape; a leakage range of less than half a bin or
    /// more than 32 bins; gains for another number of channels; gains that are zero or not finite; or per-channel gains
    /// with binary phase modulation, which mixes the transmitters.
    pub fn new(radar: &RadarConfig, corrections: Corrections) -> Result<Self, DspError> {
        let shape = shape_of(radar);
        let wrong = |field, problem| Err(DspError::Option { field, problem });
        if let Some(background) = &corrections.background
            && background.shape != shape
        {
            let problem = format!(
                "[loop, tx, rx, sample] = {:?}, the radar makes {shape:?}",
                background.shape
            );
            return wrong("background", problem);
        }
        let mut leakage = Vec::new();
        if let Some(leakage_m) = corrections.leakage_m {
            let n_bins = leakage_m / radar.range_resolution_m();
            let n_tones = 2.0 * n_bins + 3.0;
            if !(n_bins >= 0.5 && n_tones <= MAX_TONES as f64) {
                let problem = format!(
                    "must be from half a range bin to 32 of {:.4} m, found {leakage_m} m",
                    radar.range_resolution_m()
                );
                return wrong("leakage_m", problem);
            }
            leakage = tones(radar.n_samples, n_tones as usize);
        }
        let gains = &corrections.channel_gains;
        if !gains.is_empty() {
            let n_channels = shape[1] * shape[2];
            if gains.len() != n_channels {
                let problem = format!("{} for {n_channels} channels", gains.len());
                return wrong("channel_gains", problem);
            }
            if let Some(i) = gains.iter().position(|g| !g.finv().is_finite()) {
                return wrong("channel_gains", format!("channel {i}: {}", gains[i]));
            }
            if radar.multiplexing == TxMultiplexing::Bpm {
                let problem =
                    "single channels cannot be corrected in samples in which phase modulation has mixed \
                     the transmitters"
                        .into();
                return wrong("channel_gains", problem);
            }
        }
        Ok(Self {
            factors: gains.iter().map(|g| single(g.finv())).collect(),
            shape,
            corrections,
            leakage,
        })
    }

    /// Corrects a frame. Chirps whose samples are all zero were lost in transfer and remain zero.
    ///
    /// # Errors
    /// Returns an error for a cube of another shape.
    pub fn apply(&self, cube: &mut RadarCube) -> Result<(), DspError> {
        check_shape(self.shape, cube)?;
        let n_samples = self.shape[3];
        let mut still = match &self.corrections.background {
            Some(background) => background.chirps.clone(),
            None => vec![Complex32::ZERO; self.shape[1..].iter().product()],
        };
        if self.corrections.remove_offset {
            self.add_offsets(cube, &mut still);
        }
        if !self.leakage.is_empty() {
            let mut left = slow_time_mean(cube);
            for (left, still) in left.iter_mut().zip(&still) {
                *left -= Complex64::new(f64::from(still.re), f64::from(still.im));
            }
            for (left, still) in left
                .chunks_exact(n_samples)
                .zip(still.chunks_exact_mut(n_samples))
            {
                for tone in &self.leakage {
                    let part: Complex64 = tone.iter().zip(left).map(|(t, z)| t.conj() * z).sum();
                    let both = still.iter_mut().zip(tone);
                    both.for_each(|(still, tone)| *still += single(tone * part));
                }
            }
        }
        let subtracts = self.corrections.background.is_some()
            || self.corrections.remove_offset
            || !self.leakage.is_empty();
        let chirps = match subtracts {
            true => &mut cube.data[..],
            false => &mut [],
        };
        let stills = still.chunks_exact(n_samples).cycle();
        for (chirp, still) in chirps.chunks_exact_mut(n_samples).zip(stills) {
            if chirp.iter().any(|z| *z != Complex32::ZERO) {
                chirp.iter_mut().zip(still).for_each(|(z, s)| *z -= s);
            }
        }
        if !self.factors.is_empty() {
            let chirps = cube.data.chunks_exact_mut(n_samples);
            for (chirp, factor) in chirps.zip(self.factors.iter().cycle()) {
                chirp.iter_mut().for_each(|z| *z *= factor);
            }
        }
        Ok(())
    }

    /// Adds every receiver's mean to `still`, after subtracting the part that `still` already contains. The mean is
    /// weighted with a Hamming window, so that echoes beyond the second range bin do not contribute to the offset.
    fn add_offsets(&self, cube: &RadarCube, still: &mut [Complex32]) {
        let [_, n_tx, n_rx, n_samples] = self.shape;
        let weights = crate::Window::Hamming.weights(n_samples);
        let sum: f32 = weights.iter().sum();
        let mut offsets = vec![Complex64::ZERO; n_rx];
        let left = slow_time_mean(cube);
        let chirps = left
            .chunks_exact(n_samples)
            .zip(still.chunks_exact(n_samples));
        for (channel, (left, still)) in chirps.enumerate() {
            for ((left, still), weight) in left.iter().zip(still).zip(&weights) {
                let still = Complex64::new(f64::from(still.re), f64::from(still.im));
                offsets[channel % n_rx] += (left - still) * f64::from(weight / sum) / n_tx as f64;
            }
        }
        for (channel, still) in still.chunks_exact_mut(n_samples).enumerate() {
            let offset = single(offsets[channel % n_rx]);
            still.iter_mut().for_each(|z| *z += offset);
        }
    }
}

fn shape_of(radar: &RadarConfig) -> [usize; 4] {
    [
        radar.n_loops,
        radar.tx.len(),
        radar.rx.len(),
        radar.n_samples,
    ]
}

fn check_shape(expected: [usize; 4], cube: &RadarCube) -> Result<(), DspError> {
    let found = [cube.n_loops, cube.n_tx, cube.n_rx, cube.n_samples];
    if found != expected {
        return Err(DspError::Shape { expected, found });
    }
    let n = expected.iter().product();
    if cube.data.len() != n {
        return Err(DspError::Length {
            shape: found,
            expected: n,
            found: cube.data.len(),
        });
    }
    Ok(())
}

/// Mean over the loops, `[slot, rx, sample]`.
fn slow_time_mean(cube: &RadarCube) -> Vec<Complex64> {
    let n = cube.n_tx * cube.n_rx * cube.n_samples;
    let mut mean = vec![Complex64::ZERO; n];
    for one in cube.data.chunks_exact(n.max(1)) {
        for (mean, z) in mean.iter_mut().zip(one) {
            *mean += Complex64::new(f64::from(z.re), f64::from(z.im)) / cube.n_loops as f64;
        }
    }
    mean
}

/// Orthonormal basis of chirps that spans tones at a spacing of half a bin, starting one bin below zero range. Leakage
/// with any beat frequency in this interval is a linear combination of them. The basis is computed by Gram-Schmidt
/// orthogonalisation, applied twice to limit rounding errors.
fn tones(n_samples: usize, n_tones: usize) -> Vec<Vec<Complex64>> {
    let mut basis: Vec<Vec<Complex64>> = Vec::new();
    for i in 0..n_tones {
        let cycles = (0.5 * i as f64 - 1.0) / n_samples as f64;
        let scale = 1.0 / (n_samples as f64).sqrt();
        let mut tone: Vec<Complex64> = (0..n_samples)
            .map(|n| Complex64::from_polar(scale, TAU * cycles * n as f64))
            .collect();
        for _ in 0..2 {
            for known in &basis {
                let part: Complex64 = known.iter().zip(&tone).map(|(k, t)| k.conj() * t).sum();
                tone.iter_mut().zip(known).for_each(|(t, k)| *t -= k * part);
            }
        }
        let energy: f64 = tone.iter().map(|t| t.norm_sqr()).sum();
        if energy > NEW_ENERGY {
            tone.iter_mut().for_each(|t| *t /= energy.sqrt());
            basis.push(tone);
        }
    }
    basis
}

fn single(z: Complex64) -> Complex32 {
    Complex32::new(z.re as f32, z.im as f32)
}
