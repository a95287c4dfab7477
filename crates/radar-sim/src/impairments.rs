//! Impairments of real receivers: leakage, channel mismatch, phase noise, ADC quantisation, and lost packets.
//!
//! Each impairment is a field with an off value. [`Impairments::default`] is an ideal receiver and
//! [`Impairments::typical`] a single-chip 77 GHz radar. They are applied to a finished cube in the order in which they
//! occur in the hardware: leakage is added to the echoes, phase noise is added, channel errors are applied, the ADC
//! quantises and clips, and packets are lost.

use std::f64::consts::{PI, TAU};

use num_complex::{Complex32, Complex64};
use radarllm_base::{
    RadarConfig, RadarCube, SPEED_OF_LIGHT_MPS,
    radar_config::TxMultiplexing,
    random::{nth_normal, nth_uniform},
    seed::derive_seed,
};

use crate::error::SimError;
use crate::noise::NoiseGenerator;
use radarllm_simd::{LANES, SimdF32x16, SimdLevel, dispatch};

/// Quantisation and clipping of I and Q by the ADC.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adc {
    /// Number of bits of one component, including the sign, 2..=16.
    pub bits: u32,
    /// Power of a tone whose peaks reach the largest code, dBm at the antenna.
    pub full_scale_dbm: f64,
}

/// Leakage from the transmitter into the receivers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leakage {
    /// Ratio of the transmit power to the leaked power, dB.
    pub isolation_db: f64,
    /// Length of the leakage path, m.
    pub path_m: f64,
}

/// Deviations from an ideal receiver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Impairments {
    /// Leakage; `None` disables it.
    pub leakage: Option<Leakage>,
    /// Single-sideband phase noise of the oscillator at 1 MHz offset, dBc/Hz. It falls with the square of
    /// the offset (free-running oscillator). `None` disables it.
    pub phase_noise_dbc_per_hz_at_1_mhz: Option<f64>,
    /// Standard deviation of each channel's phase error, rad; 0 disables it.
    pub channel_phase_rad: f64,
    /// Standard deviation of each channel's gain error, dB; 0 disables it.
    pub channel_gain_db: f64,
    /// The ADC; `None` keeps floating-point samples.
    pub adc: Option<Adc>,
    /// Probability that a packet is lost and its samples are zero; 0 disables it.
    pub packet_loss: f64,
    /// Standard deviation of the frame's start time, s; 0 disables it. The frame's time stamp is still the planned
    /// time.
    pub start_jitter_s: f64,
}

/// Bytes of samples in a packet of TI's DCA1000 (raw mode, without the 10 header bytes).
const PACKET_BYTES: usize = 1456;
/// Bytes of one complex sample in a packet.
const SAMPLE_BYTES: usize = 4;

impl Impairments {
    /// Returns the impairments of a single-chip 77 GHz radar. Phase noise of -93 dBc/Hz and the channel mismatch follow
    /// TI's AWR1843 data sheet and calibration notes. Isolation and full scale are this project's estimates.
    pub fn typical() -> Self {
        Self {
            leakage: Some(Leakage {
                isolation_db: 40.0,
                path_m: 0.05,
            }),
            phase_noise_dbc_per_hz_at_1_mhz: Some(-93.0),
            channel_phase_rad: 2.5_f64.to_radians(),
            channel_gain_db: 0.3,
            adc: Some(Adc {
                bits: 16,
                full_scale_dbm: -20.0,
            }),
            packet_loss: 0.0,
            start_jitter_s: 50e-6,
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// Returns an error for the first field that is out of range.
    pub fn validate(&self) -> Result<(), SimError> {
        let mut checks = vec![
            ("channel_phase_rad", self.channel_phase_rad, 0.0, 4.0),
            ("channel_gain_db", self.channel_gain_db, 0.0, 30.0),
            ("packet_loss", self.packet_loss, 0.0, 1.0),
            ("start_jitter_s", self.start_jitter_s, 0.0, 1.0),
        ];
        if let Some(leakage) = self.leakage {
            checks.push(("leakage.isolation_db", leakage.isolation_db, 0.0, 200.0));
            checks.push(("leakage.path_m", leakage.path_m, 0.0, 10.0));
        }
        if let Some(level) = self.phase_noise_dbc_per_hz_at_1_mhz {
            checks.push(("phase_noise_dbc_per_hz_at_1_mhz", level, -200.0, -40.0));
        }
        if let Some(adc) = self.adc {
            checks.push(("adc.bits", f64::from(adc.bits), 2.0, 16.0));
            checks.push(("adc.full_scale_dbm", adc.full_scale_dbm, -200.0, 60.0));
        }
        for (option, value, low, high) in checks {
            if !(low..=high).contains(&value) {
                return Err(SimError::Option {
                    option,
                    problem: format!("{value} is not in {low}..={high}"),
                });
            }
        }
        Ok(())
    }

    /// Returns the delay of a frame's start relative to the plan, s.
    pub fn start_delay_s(&self, seed: u64, frame_idx: u64) -> f64 {
        self.start_jitter_s * nth_normal(derive_seed(seed, "start jitter"), frame_idx)
    }

    /// Applies the impairments to a cube. `seed` determines the channel errors for a whole clip. `seed` and `frame_idx`
    /// together determine noise and losses.
    ///
    /// # Errors
    /// Returns an error for a field that is out of range, or for channel errors with [`TxMultiplexing::Bpm`].
    pub fn apply(
        &self,
        config: &RadarConfig,
        cube: &mut RadarCube,
        seed: u64,
        frame_idx: u64,
    ) -> Result<(), SimError> {
        self.validate()?;
        if let Some(leakage) = self.leakage {
            leakage.add(config, cube, seed);
        }
        if let Some(level) = self.phase_noise_dbc_per_hz_at_1_mhz {
            add_phase_noise(
                config,
                cube,
                level,
                derive_seed(seed, "phase noise") ^ frame_idx,
            );
        }
        if self.channel_phase_rad > 0.0 || self.channel_gain_db > 0.0 {
            if config.multiplexing == TxMultiplexing::Bpm {
                return Err(SimError::Option {
                    option: "channel_phase_rad",
                    problem: "errors of single channels cannot be added to a cube in which binary \
                        phase modulation has already mixed the transmitters"
                        .into(),
                });
            }
            let gains = self.channel_gains(cube.n_tx * cube.n_rx, seed);
            let chirps = cube.data.chunks_exact_mut(cube.n_samples);
            for (chirp, gain) in chirps.zip(gains.iter().cycle()) {
                chirp.iter_mut().for_each(|z| *z *= gain);
            }
        }
        if let Some(adc) = self.adc {
            adc.convert(&mut cube.data);
        }
        if self.packet_loss > 0.0 {
            let stream = derive_seed(seed, "packet loss");
            let packets = cube.data.chunks_mut(PACKET_BYTES / SAMPLE_BYTES);
            let first = frame_idx.wrapping_mul(1 << 32);
            for (index, packet) in packets.enumerate() {
                if nth_uniform(stream, first.wrapping_add(index as u64)) < self.packet_loss {
                    packet.fill(Complex32::ZERO);
                }
            }
        }
        Ok(())
    }

    fn channel_gains(&self, n: usize, seed: u64) -> Vec<Complex32> {
        let (phase, gain) = (
            derive_seed(seed, "channel phase"),
            derive_seed(seed, "channel gain"),
        );
        (0..n as u64)
            .map(|channel| {
                let db = self.channel_gain_db * nth_normal(gain, channel);
                let rad = self.channel_phase_rad * nth_normal(phase, channel);
                Complex32::from_polar(10_f64.powf(db / 20.0) as f32, rad as f32)
            })
            .collect()
    }
}

impl Leakage {
    /// Adds a static path to every channel, with a separate phase for each channel.
    fn add(&self, config: &RadarConfig, cube: &mut RadarCube, seed: u64) {
        let power_w = 10_f64.powf((config.tx_power_dbm - 30.0 - self.isolation_db) / 10.0);
        let amplitude = power_w.sqrt();
        let tau_s = self.path_m / SPEED_OF_LIGHT_MPS;
        let stream = derive_seed(seed, "leakage phase");
        let n_channels = cube.n_tx * cube.n_rx;
        let tones: Vec<Vec<Complex32>> = (0..n_channels as u64)
            .map(|channel| {
                let offset = nth_uniform(stream, channel);
                (0..cube.n_samples)
                    .map(|n| {
                        let t = config.adc_start_s + n as f64 / config.sample_rate_hz;
                        let turns = (config.start_hz + config.slope_hz_per_s * t) * tau_s + offset;
                        let z = Complex64::from_polar(amplitude, TAU * turns.fract());
                        Complex32::new(z.re as f32, z.im as f32)
                    })
                    .collect()
            })
            .collect();
        let chirps = cube.data.chunks_exact_mut(cube.n_samples);
        for (chirp, tone) in chirps.zip(tones.iter().cycle()) {
            chirp.iter_mut().zip(tone).for_each(|(z, t)| *z += t);
        }
    }
}

impl Adc {
    /// Rounds to the nearest code and clips.
    fn convert(&self, samples: &mut [Complex32]) {
        let largest = f64::from((1u32 << (self.bits - 1)) - 1);
        let full_scale = 10_f64.powf((self.full_scale_dbm - 30.0) / 20.0);
        let codes = Codes {
            up: (largest / full_scale) as f32,
            down: (full_scale / largest) as f32,
            top: largest as f32,
        };
        convert(SimdLevel::detect(), samples, codes);
    }
}

/// Quantisation parameters of an ADC.
#[derive(Clone, Copy)]
struct Codes {
    /// Codes per sqrt(W), and the reciprocal.
    up: f32,
    down: f32,
    /// The largest code.
    top: f32,
}

dispatch!(fn convert => convert_body(samples: &mut [Complex32], codes: Codes));

#[inline(always)]
fn convert_body<L: SimdF32x16>(samples: &mut [Complex32], codes: Codes) {
    let (chunks, rest) = samples.as_chunks_mut();
    for chunk in chunks {
        convert_chunk::<L>(chunk, codes);
    }
    let mut last = [Complex32::ZERO; LANES];
    last[..rest.len()].copy_from_slice(rest);
    convert_chunk::<L>(&mut last, codes);
    rest.copy_from_slice(&last[..rest.len()]);
}

#[inline(always)]
fn convert_chunk<L: SimdF32x16>(samples: &mut [Complex32; LANES], codes: Codes) {
    let (re, im) = L::load_complex(samples);
    L::store_complex(converted(re, codes), converted(im, codes), samples);
}

#[inline(always)]
fn converted<L: SimdF32x16>(x: L, Codes { up, down, top }: Codes) -> L {
    // Clip first, because the rounding method requires small numbers.
    let code = x.mul(L::splat(up)).min(L::splat(top));
    code.max(L::splat(-top - 1.0)).round().mul(L::splat(down))
}

/// Sums over all pairs of neighbouring samples within chirps.
#[derive(Default)]
struct Lags {
    /// Power of all samples except each chirp's last.
    zero: f64,
    /// Sum of the products of every sample with the conjugate of the previous one.
    one: Complex64,
}

dispatch!(fn lags => lags_body(samples: &[Complex32], n_samples: usize, sums: &mut Lags));

#[inline(always)]
fn lags_body<L: SimdF32x16>(samples: &[Complex32], n_samples: usize, sums: &mut Lags) {
    for chirp in samples.chunks_exact(n_samples) {
        // Accumulate in f32 within a chirp, and in f64 over chirps.
        let (mut zero, mut re, mut im) = (L::splat(0.0), L::splat(0.0), L::splat(0.0));
        let mut i = 0;
        while let (Some(now), Some(next)) = (
            chirp[i..].first_chunk(),
            chirp.get(i + 1..).and_then(<[_]>::first_chunk),
        ) {
            let ((a_re, a_im), (b_re, b_im)) = (L::load_complex(now), L::load_complex(next));
            zero = a_im.fma(a_im, a_re.fma(a_re, zero));
            re = a_im.fma(b_im, a_re.fma(b_re, re));
            im = a_im.fnma(b_re, a_re.fma(b_im, im));
            i += LANES;
        }
        sums.zero += f64::from(zero.reduce_sum());
        sums.one += Complex64::new(f64::from(re.reduce_sum()), f64::from(im.reduce_sum()));
        for pair in chirp[i..].windows(2) {
            let product = pair[1] * pair[0].conj();
            sums.one += Complex64::new(f64::from(product.re), f64::from(product.im));
            sums.zero += f64::from(pair[0].norm_sqr());
        }
    }
}

/// Adds white noise as a model of phase noise.
///
/// The phase of a free-running oscillator is a random walk. Mixing an echo with the transmitted signal leaves only the
/// part of the walk within the delay tau (range correlation; Budge and Burt, 1993). These increments are independent
/// from sample to sample, because tau is below the sample period. The result is therefore white, with the variance
/// `integral over f > 0 of 2 L(f) 4 sin^2(pi f tau) df = 4 pi^2 k tau`, `L(f) = k / f^2`, times each echo's power. The
/// sum over echoes of power times tau equals the cube's power times its mean beat frequency divided by the slope.
///
/// The noise is drawn as circular noise, so that half of its power is in phase with the echo. Phase noise of a single
/// echo would be in quadrature to it only: it changes the phase of the echo but not its amplitude.
fn add_phase_noise(config: &RadarConfig, cube: &mut RadarCube, dbc_per_hz: f64, seed: u64) {
    let k_hz = 10_f64.powf(dbc_per_hz / 10.0) * 1e12;
    let mut sums = Lags::default();
    lags(SimdLevel::detect(), &cube.data, cube.n_samples, &mut sums);
    let n = (cube.data.len() - cube.data.len() / cube.n_samples).max(1) as f64;
    let cycles = (sums.one.arg() / TAU).rem_euclid(1.0);
    let tau_s = cycles * config.sample_rate_hz / config.slope_hz_per_s;
    let power_w = 4.0 * PI * PI * k_hz * tau_s * sums.zero / n;
    NoiseGenerator::new(seed, SimdLevel::detect()).add(&mut cube.data, power_w.sqrt() as f32);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Noise, PointTarget, Scene, SimOptions, Simulator};
    use glam::DVec3;

    fn echo(range_m: f64) -> (RadarConfig, RadarCube) {
        let config = RadarConfig::awr1843boost();
        let scene = Scene {
            surfaces: vec![],
            points: vec![PointTarget::at(DVec3::Y * range_m, 1.0)],
            noise: Noise::Off,
        };
        let mut simulator = Simulator::new(&config, SimOptions::default()).unwrap();
        let mut cube = simulator.new_cube();
        simulator
            .simulate_frame(&scene, 0, 0.0, 1, &mut cube)
            .unwrap();
        (config, cube)
    }

    fn power(samples: &[Complex32]) -> f64 {
        let sum: f64 = samples.iter().map(|z| f64::from(z.norm_sqr())).sum();
        sum / samples.len() as f64
    }

    fn difference(a: &RadarCube, b: &RadarCube) -> Vec<Complex32> {
        a.data.iter().zip(&b.data).map(|(a, b)| a - b).collect()
    }

    #[test]
    fn an_ideal_receiver_changes_nothing() {
        let (config, clean) = echo(3.0);
        let mut cube = clean.clone();
        Impairments::default()
            .apply(&config, &mut cube, 1, 0)
            .unwrap();
        assert_eq!(cube.data, clean.data);
        assert_eq!(Impairments::default().start_delay_s(1, 5), 0.0);
        Impairments::typical().validate().unwrap();
    }

    #[test]
    fn phase_noise_grows_with_range_as_the_walk_does() {
        for range_m in [2.0, 8.0] {
            let (config, clean) = echo(range_m);
            let mut cube = clean.clone();
            let impairments = Impairments {
                phase_noise_dbc_per_hz_at_1_mhz: Some(-80.0),
                ..Impairments::default()
            };
            impairments.apply(&config, &mut cube, 1, 0).unwrap();
            let found = power(&difference(&cube, &clean)) / power(&clean.data);
            // 4 pi^2 k tau, k = 1e-8 * 1e12 Hz. The estimate is a mean of 393,216 exponentials (0.16 %). The beat
            // frequency of one tone is exact except for the size of the array.
            let expected = 4.0 * PI * PI * 1e4 * 2.0 * range_m / SPEED_OF_LIGHT_MPS;
            assert!((found / expected - 1.0).abs() < 0.02, "{found} {expected}");
        }
    }

    #[test]
    fn leakage_stands_at_its_range_with_its_power() {
        let (config, mut cube) = echo(3.0);
        cube.data.fill(Complex32::ZERO);
        let impairments = Impairments {
            leakage: Some(Leakage {
                isolation_db: 40.0,
                path_m: 0.05,
            }),
            ..Impairments::default()
        };
        impairments.apply(&config, &mut cube, 1, 0).unwrap();
        // 12 dBm minus 40 dB.
        assert!((10.0 * (power(&cube.data) * 1e3).log10() + 28.0).abs() < 1e-3);
        // S tau / fs = 60.012e12 * 1.668e-10 / 4.4e6 cycles per sample.
        let z = cube.chirp(5, 1, 2)[1] * cube.chirp(5, 1, 2)[0].conj();
        let cycles = f64::from(z.arg()) / TAU;
        assert!((cycles / 2.2748e-3 - 1.0).abs() < 1e-2, "{cycles}");
        assert_eq!(cube.chirp(0, 0, 0), cube.chirp(90, 0, 0));
        assert_ne!(cube.chirp(0, 0, 0), cube.chirp(0, 0, 1));
    }

    #[test]
    fn quantisation_noise_is_a_twelfth_of_a_step_squared_and_peaks_are_clipped() {
        let (config, clean) = echo(3.0);
        let peak_dbm = 10.0 * (power(&clean.data) * 1e3).log10();
        let convert = |bits, full_scale_dbm| {
            let mut cube = clean.clone();
            let impairments = Impairments {
                adc: Some(Adc {
                    bits,
                    full_scale_dbm,
                }),
                ..Impairments::default()
            };
            impairments.apply(&config, &mut cube, 1, 0).unwrap();
            cube
        };
        let cube = convert(10, peak_dbm + 1.0);
        let step = 10_f64.powf((peak_dbm + 1.0 - 30.0) / 20.0) / 511.0;
        let found = power(&difference(&cube, &clean));
        // Two components of step^2 / 12 each. The rounding errors of a tone are nearly uniform.
        assert!((found / (step * step / 6.0) - 1.0).abs() < 0.05, "{found}");
        let clipped = convert(10, peak_dbm - 6.0);
        let top = 10_f64.powf((peak_dbm - 6.0 - 30.0) / 20.0) as f32;
        assert!(
            clipped
                .data
                .iter()
                .all(|z| z.re <= top * 1.0001 && z.re >= -top * 1.003)
        );
        assert!(clipped.data.iter().any(|z| z.re >= top * 0.9999));
    }

    #[test]
    fn channels_differ_alike_in_every_frame_and_packets_vanish_at_their_rate() {
        let (config, clean) = echo(3.0);
        let mismatch = Impairments {
            channel_phase_rad: 0.05,
            channel_gain_db: 0.5,
            ..Impairments::default()
        };
        let (mut first, mut second) = (clean.clone(), clean.clone());
        mismatch.apply(&config, &mut first, 7, 0).unwrap();
        mismatch.apply(&config, &mut second, 7, 9).unwrap();
        assert_eq!(first.data, second.data);
        let ratio =
            |cube: &RadarCube, rx: usize| cube.chirp(3, 0, rx)[9] / clean.chirp(3, 0, rx)[9];
        assert_ne!(ratio(&first, 0), ratio(&first, 1));
        assert!((ratio(&first, 0).arg()).abs() < 0.25);

        let lossy = Impairments {
            packet_loss: 0.1,
            ..Impairments::default()
        };
        lossy.apply(&config, &mut second, 7, 2).unwrap();
        let zeros = second.data.iter().filter(|z| z.norm_sqr() == 0.0).count();
        let share = zeros as f64 / second.data.len() as f64;
        // 1,081 packets: tolerance of five standard deviations of sqrt(0.09 / 1081).
        assert!((share - 0.1).abs() < 0.046, "{share}");
    }

    #[test]
    fn lanes_convert_and_correlate_as_one_sample_after_the_other() {
        // 77 samples: whole SIMD chunks and a remainder. Some samples clip, and none is halfway between two codes.
        let sample = |i: usize| {
            let x = (i as f32 * 0.618_034).fract() - 0.5;
            Complex32::new(3.0 * x, 0.7 - x)
        };
        let samples: Vec<Complex32> = (0..154).map(sample).collect();
        let codes = Codes {
            up: 100.0,
            down: 0.01,
            top: 127.0,
        };
        let one = |x: f32| (x * 100.0).round().clamp(-128.0, 127.0) * 0.01;
        let mut power = 0.0;
        let mut product = Complex64::ZERO;
        for chirp in samples.chunks_exact(77) {
            for pair in chirp.windows(2) {
                let [a, b] = [0, 1].map(|i| Complex64::new(pair[i].re.into(), pair[i].im.into()));
                power += a.norm_sqr();
                product += b * a.conj();
            }
        }
        for level in SimdLevel::available() {
            let mut found = samples.clone();
            convert(level, &mut found, codes);
            for (found, exact) in found.iter().zip(&samples) {
                assert_eq!((found.re, found.im), (one(exact.re), one(exact.im)));
            }
            let mut sums = Lags::default();
            lags(level, &samples, 77, &mut sums);
            assert!((sums.zero / power - 1.0).abs() < 1e-6);
            assert!((sums.one - product).norm() < 1e-6 * power);
        }
    }

    #[test]
    fn fields_out_of_range_are_named() {
        for (bad, word) in [
            (
                Impairments {
                    packet_loss: 1.5,
                    ..Impairments::default()
                },
                "packet_loss",
            ),
            (
                Impairments {
                    adc: Some(Adc {
                        bits: 99,
                        full_scale_dbm: 0.0,
                    }),
                    ..Impairments::default()
                },
                "adc.bits",
            ),
            (
                Impairments {
                    channel_gain_db: f64::NAN,
                    ..Impairments::default()
                },
                "channel_gain_db",
            ),
        ] {
            let error = bad.validate().unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }
}
