//! Calibration of the virtual channels' complex gains with a corner reflector in a known direction.

use std::f64::consts::{PI, TAU};

use num_complex::{Complex32, Complex64};
use radarllm_base::radar_config::TxMultiplexing;
use radarllm_base::{RadarConfig, RadarCube, SPEED_OF_LIGHT_MPS};

use crate::error::DspError;
use crate::spectrum::Spectrum;
use crate::{DspOptions, Window};

/// Search steps per range bin. Between two steps the main lobe of a Hamming window drops by less than 0.01 dB.
const STEPS_PER_BIN: usize = 16;
/// Number of chirps per channel that the search uses.
const SEARCHED_LOOPS: usize = 16;
/// Minimum signal-to-noise ratio of a channel's mean, dB. It corresponds to 0.07 rad of phase noise and 0.6 dB of gain
/// error.
const MIN_SNR_DB: f64 = 20.0;
/// Maximum speed of an echo that counts as static, m/s. At 2 cm/s the phases of the reference radar's slots differ by
/// 0.01 rad.
const STILL_MPS: f64 = 0.02;
/// Maximum phase variation of the whole array between frames, rad rms. It corresponds to a displacement of 0.15 mm.
const STEADY_RAD: f64 = 0.5;
/// Half width of a Hamming window's main lobe, range bins. It includes the reflector's position between two bins.
const LOBE_BINS: f64 = 2.5;
/// Maximum distance from the reflector at which other echoes are searched, range bins.
const SURROUNDINGS_BINS: f64 = 25.0;

/// Position of the reflector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reflector {
    /// Approximate distance from the radar, m.
    pub range_m: f64,
    /// Azimuth, positive to the right of boresight, rad. Its accuracy limits the accuracy of the points' angles.
    pub azimuth_rad: f64,
    /// Elevation, positive above boresight, rad.
    pub elevation_rad: f64,
    /// Half width of the search interval around `range_m`, m. The strongest echo in it is taken as the reflector.
    pub search_m: f64,
}

/// Result of a calibration with a reflector.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelGains {
    /// Complex gain of every channel, index `slot * n_rx + rx`, relative to the phases of a spherical wave from the
    /// reflector. The geometric mean of the amplitudes is 1, and the mean of the phases is 0.
    pub gains: Vec<Complex64>,
    /// Range at which the reflector was found, m.
    pub range_m: f64,
    /// Signal-to-noise ratio of the weakest channel's mean, dB.
    pub snr_db: f64,
    /// Ratio of the reflector's power to that of the strongest other static echo within 25 range bins, dB. Echoes in
    /// the reflector's own range bin cannot be separated from it and are the main source of error in the gains. Such an
    /// echo 20 dB below the reflector causes a phase error of up to 0.1 rad. This ratio indicates how strong such
    /// echoes may be.
    pub above_surroundings_db: f64,
    /// Repeatability: root of the mean of |gain / mean gain - 1|^2 over channels and half frames.
    pub residual: f64,
    /// Number of frames used.
    pub n_frames: usize,
}

/// Reasons for which a calibration fails.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum CalibrateError {
    /// A cube or an option is invalid.
    #[error(transparent)]
    Dsp(#[from] DspError),
    /// No frames were added.
    #[error("no frames")]
    NoFrames,
    /// The strongest echo is at the edge of the search interval.
    #[error(
        "no peak within {search_m} m of {range_m} m: the strongest echo there, at {found_m:.2} m, is the flank of another"
    )]
    NoPeak {
        /// Requested range, m.
        range_m: f64,
        /// Requested half width of the search interval, m.
        search_m: f64,
        /// Range of the maximum power, m.
        found_m: f64,
    },
    /// The signal-to-noise ratio of a channel is too low.
    #[error(
        "no reflector at {found_m:.2} m: channel {channel} (slot {slot}, receiver {receiver}) has {snr_db:.1} dB of \
         signal over noise, less than {MIN_SNR_DB} dB"
    )]
    Weak {
        /// Range of the maximum power, m.
        found_m: f64,
        /// Channel index, from 0.
        channel: usize,
        /// Slot index of the channel, from 0.
        slot: usize,
        /// Receiver index of the channel, from 0.
        receiver: usize,
        /// Signal-to-noise ratio of the mean over all loops and frames, dB.
        snr_db: f64,
    },
    /// The echo moves.
    #[error("the echo at {found_m:.2} m moves at {velocity_mps:.3} m/s: a reflector stands still")]
    Moving {
        /// Range of the echo, m.
        found_m: f64,
        /// Radial velocity, m/s, positive when receding.
        velocity_mps: f64,
    },
    /// The echo's phase changes from frame to frame.
    #[error(
        "the echo at {found_m:.2} m is not steady: its phase wanders by {phase_rad:.2} rad rms, as of somebody who breathes"
    )]
    Unsteady {
        /// Range of the echo, m.
        found_m: f64,
        /// Rms phase variation over half frames, rad.
        phase_rad: f64,
    },
}

/// Accumulates frames with a reflector and computes the channel gains.
pub struct CornerCalibrator {
    radar: RadarConfig,
    reflector: Reflector,
    spectrum: Spectrum,
    window: Vec<f64>,
    /// Beat frequency of the reflector, cycles per sample; determined from the first frame.
    cycles: Option<f64>,
    /// Power of all frames' slow-time means over range, to measure the surrounding echoes.
    profile: Vec<f64>,
    /// Mean value of every channel, one entry per half frame.
    halves: Vec<Vec<Complex64>>,
    /// Per channel: sum of the squared deviations from the half frame's mean. `n_noise` is their number.
    noise: Vec<f64>,
    n_noise: usize,
    /// Sum over channels and loops of each value times the conjugate of the previous one, and the sum of the squares.
    lag: Complex64,
    squares: f64,
}

impl CornerCalibrator {
    /// Creates a calibrator for a radar with time-division multiplexing.
    ///
    /// # Errors
    /// Returns an error for an invalid radar, binary phase modulation, fewer than four loops, or a search interval
    /// outside the usable range bins.
    pub fn new(radar: &RadarConfig, reflector: Reflector) -> Result<Self, DspError> {
        radar.validate()?;
        let wrong = |field, problem: String| Err(DspError::Option { field, problem });
        if radar.multiplexing == TxMultiplexing::Bpm {
            return wrong(
                "firing",
                "phase modulation mixes the transmitters: channels cannot be told apart".into(),
            );
        }
        if radar.n_loops < 4 {
            return wrong("n_loops", format!("{} are too few", radar.n_loops));
        }
        let bin_m = radar.range_resolution_m();
        let (near_m, far_m) = (
            reflector.range_m - reflector.search_m,
            reflector.range_m + reflector.search_m,
        );
        if !(reflector.search_m >= bin_m && near_m > bin_m && far_m < radar.max_range_m()) {
            return wrong(
                "range_m",
                format!(
                    "{} m with a search of {} m either way: expected at min a bin of {bin_m:.3} m, all of it between \
                     one bin and {:.2} m",
                    reflector.range_m,
                    reflector.search_m,
                    radar.max_range_m()
                ),
            );
        }
        if ![reflector.azimuth_rad, reflector.elevation_rad]
            .iter()
            .all(|a| a.abs() < 0.5 * PI)
        {
            return wrong("azimuth_rad", "must be in front of the radar".into());
        }
        let options = DspOptions {
            clutter: crate::ClutterFilter::Off,
            ..DspOptions::default()
        };
        let n_channels = radar.tx.len() * radar.rx.len();
        Ok(Self {
            spectrum: Spectrum::new(radar, &options)?,
            window: Window::Hamming
                .weights(radar.n_samples)
                .iter()
                .map(|w| f64::from(*w))
                .collect(),
            radar: radar.clone(),
            reflector,
            cycles: None,
            profile: vec![0.0; radar.n_samples],
            halves: Vec::new(),
            noise: vec![0.0; n_channels],
            n_noise: 0,
            lag: Complex64::ZERO,
            squares: 0.0,
        })
    }

    /// Adds a frame without missing samples.
    ///
    /// # Errors
    /// Returns an error for a cube of another shape, or with values that are not finite.
    pub fn push(&mut self, cube: &RadarCube) -> Result<(), DspError> {
        self.spectrum.check_shape(cube)?;
        let n_loops = self.radar.n_loops;
        for channel in 0..self.noise.len() {
            let mut mean = vec![Complex64::ZERO; self.profile.len()];
            for chirp in self.spectrum.range_spectra(cube, channel)? {
                for (mean, z) in mean.iter_mut().zip(chirp) {
                    *mean += double(z) / n_loops as f64;
                }
            }
            for (sum, mean) in self.profile.iter_mut().zip(&mean) {
                *sum += mean.norm_sqr();
            }
        }
        let cycles = match self.cycles {
            Some(cycles) => cycles,
            None => *self.cycles.insert(self.strongest(cube)),
        };
        let kernel = self.kernel(cycles);
        let n_rx = self.radar.rx.len();
        let half = n_loops / 2;
        let mut means = [0, 1].map(|_| Vec::with_capacity(self.noise.len()));
        for channel in 0..self.noise.len() {
            let values: Vec<Complex64> = (0..n_loops)
                .map(|l| correlate(&kernel, cube.chirp(l, channel / n_rx, channel % n_rx)))
                .collect();
            for pair in values.windows(2) {
                self.lag += pair[1] * pair[0].conj();
                self.squares += 0.5 * (pair[0].norm_sqr() + pair[1].norm_sqr());
            }
            for (values, means) in [&values[..half], &values[half..]].iter().zip(&mut means) {
                let mean = values.iter().sum::<Complex64>() / values.len() as f64;
                self.noise[channel] += values.iter().map(|z| (z - mean).norm_sqr()).sum::<f64>();
                means.push(mean);
            }
        }
        self.n_noise += n_loops - 2;
        self.halves.extend(means);
        Ok(())
    }

    /// Computes the gains of the channels.
    ///
    /// # Errors
    /// Returns the [`CalibrateError`] that describes why the calibration failed.
    pub fn finish(self) -> Result<ChannelGains, CalibrateError> {
        let Some(cycles) = self.cycles else {
            return Err(CalibrateError::NoFrames);
        };
        let found_m = self.range_m(cycles);
        let Reflector {
            range_m, search_m, ..
        } = self.reflector;
        let bin_m = self.radar.range_resolution_m();
        // A maximum at the edge of the search interval is not a peak, because the power rises further outside the
        // interval.
        if (found_m - range_m).abs() > search_m - bin_m / STEPS_PER_BIN as f64 {
            return Err(CalibrateError::NoPeak {
                range_m,
                search_m,
                found_m,
            });
        }
        let velocity = |turn: Complex64, loops: f64| {
            turn.arg() * self.radar.wavelength_m() / (4.0 * PI * loops * self.radar.loop_period_s())
        };
        let moving = |velocity_mps: f64| CalibrateError::Moving {
            found_m,
            velocity_mps,
        };
        // A consistent phase step from loop to loop indicates an echo. If the step is also not zero, the echo moves.
        let by_loops = velocity(self.lag, 1.0);
        if self.lag.norm() > 0.5 * self.squares
            && by_loops.abs() > 0.5 * self.radar.velocity_resolution_mps()
        {
            return Err(moving(by_loops));
        }
        let n_channels = self.noise.len();
        let n_halves = self.halves.len() as f64;
        let (aligned, turns) = align(&self.halves);
        let mean: Vec<Complex64> = (0..n_channels)
            .map(|c| aligned.iter().map(|h| h[c]).sum::<Complex64>() / n_halves)
            .collect();
        let n_loops = 0.5 * n_halves * self.radar.n_loops as f64;
        let mut snr_db = f64::INFINITY;
        for (channel, (mean, noise)) in mean.iter().zip(&self.noise).enumerate() {
            let variance = noise / self.n_noise as f64 / n_loops;
            let db = 10.0 * (mean.norm_sqr() / variance.max(f64::MIN_POSITIVE)).log10();
            // A channel without any signal has no noise either.
            if !(db >= MIN_SNR_DB && mean.norm_sqr() > 0.0) {
                let n_rx = self.radar.rx.len();
                return Err(CalibrateError::Weak {
                    found_m,
                    channel,
                    slot: channel / n_rx,
                    receiver: channel % n_rx,
                    snr_db: db,
                });
            }
            snr_db = snr_db.min(db);
        }
        let half_loops = 0.5 * self.radar.n_loops as f64;
        let slow = self
            .halves
            .chunks_exact(2)
            .flat_map(|pair| pair[1].iter().zip(&pair[0]))
            .map(|(b, a)| b * a.conj())
            .sum();
        let by_halves = velocity(slow, half_loops);
        if by_halves.abs() > STILL_MPS {
            return Err(moving(by_halves));
        }
        let wander = turns.iter().map(|t| t * t).sum::<f64>() / n_halves;
        if wander.sqrt() > STEADY_RAD {
            return Err(CalibrateError::Unsteady {
                found_m,
                phase_rad: wander.sqrt(),
            });
        }
        let residual = aligned
            .iter()
            .flat_map(|h| h.iter().zip(&mean))
            .map(|(h, mean)| (h / mean - 1.0).norm_sqr())
            .sum::<f64>()
            / (n_halves * n_channels as f64);
        let (expected, range_m) = self.expected(cycles);
        let gains: Vec<Complex64> = mean.iter().zip(&expected).map(|(m, e)| m / e).collect();
        let amplitude =
            (gains.iter().map(|g| g.norm().ln()).sum::<f64>() / n_channels as f64).exp();
        let phase: Complex64 = gains.iter().map(|g| g / g.norm()).sum();
        let unit = Complex64::from_polar(amplitude, phase.arg());
        Ok(ChannelGains {
            gains: gains.iter().map(|g| g / unit).collect(),
            range_m,
            snr_db,
            above_surroundings_db: self.above_surroundings_db(cycles),
            residual: residual.sqrt(),
            n_frames: self.halves.len() / 2,
        })
    }

    /// Beat frequency with the maximum power near the reflector, over all channels and a subset of the loops.
    fn strongest(&self, cube: &RadarCube) -> f64 {
        let n = self.radar.n_samples as f64;
        let bin_m = self.radar.range_resolution_m();
        let step = 1.0 / STEPS_PER_BIN as f64;
        let first = (self.reflector.range_m - self.reflector.search_m) / bin_m;
        let n_steps = (2.0 * self.reflector.search_m / bin_m / step) as usize;
        let every = self.radar.n_loops.div_ceil(SEARCHED_LOOPS);
        let power = |cycles: f64| -> f64 {
            let kernel = self.kernel(cycles);
            (0..cube.n_loops)
                .step_by(every)
                .flat_map(|l| (0..cube.n_tx).map(move |tx| (l, tx)))
                .flat_map(|(l, tx)| (0..cube.n_rx).map(move |rx| (l, tx, rx)))
                .map(|(l, tx, rx)| correlate(&kernel, cube.chirp(l, tx, rx)).norm_sqr())
                .sum()
        };
        (0..=n_steps)
            .map(|i| (first + i as f64 * step) / n)
            .map(|cycles| (power(cycles), cycles))
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(0.0, |(_, cycles)| cycles)
    }

    /// Window multiplied by the conjugate tone.
    fn kernel(&self, cycles: f64) -> Vec<Complex64> {
        let tone = |n: usize| Complex64::cis(-TAU * cycles * n as f64);
        let weights = self.window.iter().enumerate();
        weights.map(|(n, w)| tone(n) * *w).collect()
    }

    fn range_m(&self, cycles: f64) -> f64 {
        cycles * self.radar.n_samples as f64 * self.radar.range_resolution_m()
    }

    /// Values that ideal channels would measure for a reflector with this beat frequency, and the reflector's range, m.
    fn expected(&self, cycles: f64) -> (Vec<Complex64>, f64) {
        let radar = &self.radar;
        let (azimuth, elevation) = (self.reflector.azimuth_rad, self.reflector.elevation_rad);
        let unit = [
            elevation.cos() * azimuth.sin(),
            elevation.cos() * azimuth.cos(),
            elevation.sin(),
        ];
        let paths_m = |range_m: f64| -> Vec<f64> {
            let [x, y, z] = unit.map(|u| u * range_m);
            let to =
                |a: &radarllm_base::radar_config::Antenna| (x - a.x_m).hypot(y).hypot(z - a.z_m);
            let pairs = radar
                .tx
                .iter()
                .flat_map(|t| radar.rx.iter().map(move |r| (t, r)));
            pairs.map(|(t, r)| to(t) + to(r)).collect()
        };
        // The mean path length is known. The range from the origin follows from it in a few iterations.
        let mean_m = 2.0 * self.range_m(cycles);
        let mut range_m = 0.5 * mean_m;
        for _ in 0..4 {
            let paths = paths_m(range_m);
            range_m += 0.5 * (mean_m - paths.iter().sum::<f64>() / paths.len() as f64);
        }
        let kernel = self.kernel(cycles);
        let values = paths_m(range_m)
            .into_iter()
            .map(|path_m| {
                let tau = path_m / SPEED_OF_LIGHT_MPS;
                let sum = kernel.iter().enumerate().map(|(n, k)| {
                    let t = radar.adc_start_s + n as f64 / radar.sample_rate_hz;
                    let turns = (radar.start_hz + radar.slope_hz_per_s * t) * tau
                        - 0.5 * radar.slope_hz_per_s * tau * tau;
                    k * Complex64::cis(TAU * turns.fract())
                });
                sum.sum()
            })
            .collect();
        (values, range_m)
    }

    fn above_surroundings_db(&self, cycles: f64) -> f64 {
        let place = cycles * self.radar.n_samples as f64;
        let (mut peak, mut beside) = (0.0_f64, f64::MIN_POSITIVE);
        for (bin, power) in self.profile.iter().enumerate() {
            let apart = (bin as f64 - place).abs();
            if apart <= LOBE_BINS {
                peak = peak.max(*power);
            } else if apart <= SURROUNDINGS_BINS {
                beside = beside.max(*power);
            }
        }
        10.0 * (peak / beside).log10()
    }
}

/// Rotates the values of every half frame to the phase of the first one. Also returns each half frame's phase relative
/// to the mean phase, rad.
fn align(halves: &[Vec<Complex64>]) -> (Vec<Vec<Complex64>>, Vec<f64>) {
    let against = |reference: &[Complex64], half: &[Complex64]| -> Complex64 {
        reference.iter().zip(half).map(|(r, h)| h * r.conj()).sum()
    };
    let Some(first) = halves.first() else {
        return (vec![], vec![]);
    };
    let phases: Vec<f64> = halves.iter().map(|h| against(first, h).arg()).collect();
    let mean = phases.iter().map(|p| Complex64::cis(*p)).sum::<Complex64>();
    let turns = phases
        .iter()
        .map(|p| (Complex64::cis(*p) * mean.conj()).arg())
        .collect();
    let turned = halves.iter().zip(&phases).map(|(half, phase)| {
        let back = Complex64::cis(-phase);
        half.iter().map(|h| h * back).collect()
    });
    (turned.collect(), turns)
}

fn correlate(kernel: &[Complex64], chirp: &[Complex32]) -> Complex64 {
    kernel.iter().zip(chirp).map(|(k, z)| k * double(*z)).sum()
}

fn double(z: Complex32) -> Complex64 {
    Complex64::new(f64::from(z.re), f64::from(z.im))
}
