//! Signal statistics of raw samples per receiver: offset, level, I/Q balance, saturation, silence.

use num_complex::Complex32;
use radarllm_base::RadarCube;
use radarllm_simd::{SimdF32x16, SimdLevel, dispatch};

/// Fraction of samples at full scale from which a channel is reported as saturated.
const SATURATED_SHARE: f64 = 1e-3;
/// Level relative to the strongest channel below which a channel is reported as silent, dB.
const SILENT_DB: f64 = 40.0;
/// Ratio of offset to signal level from which it is reported.
const OFFSET_RATIO: f64 = 1.0;
/// I/Q imbalance from which it is reported: an image 26 dB below the signal.
const GAIN_DB: f64 = 1.0;
const PHASE_RAD: f64 = 0.1;

/// Number of bins of a histogram: two per octave of 1 + |value| on each side of zero. With uniform bins, a normal
/// signal, which has a few hundred counts of 32767, would be in a single bin.
pub const HISTOGRAM_BINS: usize = 2 * HISTOGRAM_SIDE + 1;
const HISTOGRAM_SIDE: usize = 30;

/// Levels and histogram use one loop in this many, if a frame has enough loops. They are averages, and processing every
/// value takes longer than extracting the points of the frame.
const LOOP_STEP: usize = 8;
/// Minimum number of loops that are used, if a frame has them.
const MIN_LOOPS: usize = 8;
/// The same holds for frames: of a recording, one in this many.
const FRAME_STEP: u64 = 4;

/// Statistics of one receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelStats {
    /// Mean of I and of Q, counts.
    pub mean: [f64; 2],
    /// Rms of I and Q together, without their means, counts.
    pub rms: f64,
    /// Ratio of the level of I to that of Q, dB; 0 where either is silent. Like the angle below, it uses only the part
    /// that changes from loop to loop, because leakage of a fraction of a cycle has an arbitrary phase in the I/Q
    /// plane.
    pub gain_imbalance_db: f64,
    /// Deviation of the angle between I and Q from a right angle, rad; 0 where either is silent.
    pub phase_imbalance_rad: f64,
    /// Fraction of all samples in which I or Q is at full scale.
    pub saturated: f64,
    /// Number of samples received.
    pub n_samples: u64,
}

#[derive(Clone, Copy)]
struct Sums {
    n_samples: u64,
    saturated: u64,
    /// Number of samples in the sums below.
    n: u64,
    sum: [f64; 2],
    /// Sum of squares of I and Q.
    squares: f64,
    /// Squares of I and Q and their product, without the part that is constant from loop to loop.
    moving: [f64; 3],
    /// Counts of I and Q values together.
    histogram: [u64; HISTOGRAM_BINS],
}

impl Default for Sums {
    fn default() -> Self {
        Self {
            n_samples: 0,
            saturated: 0,
            n: 0,
            sum: [0.0; 2],
            squares: 0.0,
            moving: [0.0; 3],
            histogram: [0; HISTOGRAM_BINS],
        }
    }
}

/// Statistics accumulated over many frames.
#[derive(Clone)]
pub struct AdcStats {
    full_scale: f32,
    channels: Vec<Sums>,
    n_frames: u64,
    level: SimdLevel,
}

impl AdcStats {
    /// Creates statistics for `n_rx` receivers and an ADC of `bits` (12, 14 or 16), whose range is +-2^(bits - 1)
    /// counts.
    pub fn new(n_rx: usize, bits: u32) -> Self {
        Self {
            full_scale: (1_u32 << (bits.clamp(2, 16) - 1)) as f32 - 1.0,
            channels: vec![Sums::default(); n_rx],
            n_frames: 0,
            level: SimdLevel::detect(),
        }
    }

    /// Adds a frame in counts. Receivers beyond `n_rx` are ignored.
    pub fn push(&mut self, cube: &RadarCube) {
        let (n_rx, n_samples) = (cube.n_rx.max(1), cube.n_samples.max(1));
        let loop_len = cube.n_tx * n_rx * n_samples;
        if loop_len == 0 {
            return;
        }
        for (i, chirp) in cube.data.chunks_exact(n_samples).enumerate() {
            let Some(sums) = self.channels.get_mut(i % n_rx) else {
                continue;
            };
            sums.saturated += u64::from(n_saturated(self.level, chirp, self.full_scale));
            sums.n_samples += n_samples as u64;
        }
        let is_used = self.n_frames.is_multiple_of(FRAME_STEP);
        self.n_frames += 1;
        if !is_used {
            return;
        }
        let step = match cube.n_loops >= MIN_LOOPS * LOOP_STEP {
            true => LOOP_STEP,
            false => 1,
        };
        let loops = || cube.data.chunks_exact(loop_len).step_by(step);
        let mut still = vec![Complex32::ZERO; loop_len];
        if loops().len() > 1 {
            let share = 1.0 / loops().len() as f32;
            for one in loops() {
                for (sum, value) in still.iter_mut().zip(one) {
                    *sum += value * share;
                }
            }
        }
        let chirps = loops().flat_map(|one| one.chunks_exact(n_samples));
        let stills = still.chunks_exact(n_samples).cycle();
        for ((i, chirp), still) in chirps.enumerate().zip(stills) {
            if let Some(sums) = self.channels.get_mut(i % n_rx) {
                sums.add(chirp, still);
            }
        }
    }

    /// Statistics of each receiver.
    pub fn channels(&self) -> Vec<ChannelStats> {
        self.channels.iter().map(Sums::stats).collect()
    }

    /// Numbers of I and Q values of a receiver in each of [`HISTOGRAM_BINS`]; `None` for an unknown receiver. Of
    /// every fourth frame one loop in eight is counted, or all loops of frames with fewer than 64. Bin `HISTOGRAM_BINS / 2` is zero. The bin `n` places to its
    /// right contains the values for which 2 log2(1 + |value|) is between n and n + 1; the last bin contains all larger
    /// values.
    pub fn histogram(&self, receiver: usize) -> Option<&[u64; HISTOGRAM_BINS]> {
        Some(&self.channels.get(receiver)?.histogram)
    }

    /// Describes problems in words for reports; empty for a normal signal.
    pub fn problems(&self) -> Vec<String> {
        let channels = self.channels();
        let loudest = channels.iter().fold(0.0, |m: f64, c| m.max(c.rms));
        if channels.iter().all(|c| c.n_samples == 0) {
            return vec!["no samples".into()];
        }
        if loudest == 0.0 && channels.iter().all(|c| c.saturated == 0.0) {
            return vec!["all channels are silent".into()];
        }
        let mut problems = Vec::new();
        for (i, c) in channels.iter().enumerate() {
            let rx = i + 1;
            if c.saturated >= SATURATED_SHARE {
                problems.push(format!(
                    "ADC saturated in {:.1} % of the samples of channel {rx}: less receiver gain or more distance",
                    c.saturated * 100.0
                ));
            } else if c.rms <= loudest * 10_f64.powf(-SILENT_DB / 20.0) {
                problems.push(format!(
                    "channel {rx} is silent: {:.1} counts rms, the loudest has {loudest:.1}",
                    c.rms
                ));
                continue;
            }
            let offset = c.mean[0].hypot(c.mean[1]);
            if offset > OFFSET_RATIO * c.rms {
                problems.push(format!(
                    "channel {rx} has an offset of {offset:.1} counts, more than its signal of {:.1}",
                    c.rms
                ));
            }
            if c.gain_imbalance_db.abs() > GAIN_DB || c.phase_imbalance_rad.abs() > PHASE_RAD {
                problems.push(format!(
                    "I and Q of channel {rx} differ by {:+.1} dB and miss a right angle by {:+.1} degrees: \
                     every target has a mirror image",
                    c.gain_imbalance_db,
                    c.phase_imbalance_rad.to_degrees()
                ));
            }
        }
        problems
    }
}

/// Number of samples of which I or Q is at full scale.
#[expect(
    clippy::extra_unused_type_parameters,
    reason = "`dispatch!` compiles it for every instruction set"
)]
#[inline(always)]
fn n_saturated_body<L: SimdF32x16>(chirp: &[Complex32], full_scale: f32) -> u32 {
    let is_full = |z: &Complex32| z.re.abs().max(z.im.abs()) >= full_scale;
    chirp.iter().map(|z| u32::from(is_full(z))).sum()
}

dispatch!(fn n_saturated => n_saturated_body(chirp: &[Complex32], full_scale: f32) -> u32);

/// Bin of a value: twice the exponent of 1 + |value|, plus one if the significand is at least sqrt(2). Both are read
/// from the bits of the float.
fn histogram_bin(value: f32) -> usize {
    const SQRT_2: u32 = std::f32::consts::SQRT_2.to_bits() & 0x7f_ffff;
    // NaN counts as zero.
    let bits = (1.0 + value.abs().max(0.0)).to_bits();
    let octaves = 2 * (bits >> 23).saturating_sub(127) + u32::from(bits & 0x7f_ffff >= SQRT_2);
    let octaves = (octaves as usize).min(HISTOGRAM_SIDE);
    if value < 0.0 {
        HISTOGRAM_SIDE - octaves
    } else {
        HISTOGRAM_SIDE + octaves
    }
}

impl Sums {
    /// Adds a chirp; `still` is the part that is constant from loop to loop.
    fn add(&mut self, chirp: &[Complex32], still: &[Complex32]) {
        for (value, still) in chirp.iter().zip(still) {
            self.sum[0] += f64::from(value.re);
            self.sum[1] += f64::from(value.im);
            self.squares += f64::from(value.norm_sqr());
            let moving = value - still;
            let (re, im) = (f64::from(moving.re), f64::from(moving.im));
            self.moving[0] += re * re;
            self.moving[1] += im * im;
            self.moving[2] += re * im;
            for part in [value.re, value.im] {
                self.histogram[histogram_bin(part)] += 1;
            }
        }
        self.n += chirp.len() as u64;
    }

    fn stats(&self) -> ChannelStats {
        let n = self.n.max(1) as f64;
        let mean = self.sum.map(|s| s / n);
        // Rounding can make the difference of equal numbers negative.
        let variance = self.squares / n - mean[0] * mean[0] - mean[1] * mean[1];
        let [i, q, product] = self.moving;
        let (mut gain_imbalance_db, mut phase_imbalance_rad) = (0.0, 0.0);
        if i > 0.0 && q > 0.0 {
            gain_imbalance_db = 10.0 * (i / q).log10();
            phase_imbalance_rad = (product / (i * q).sqrt()).clamp(-1.0, 1.0).asin();
        }
        ChannelStats {
            mean,
            rms: variance.max(0.0).sqrt(),
            gain_imbalance_db,
            phase_imbalance_rad,
            saturated: self.saturated as f64 / self.n_samples.max(1) as f64,
            n_samples: self.n_samples,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_counted_by_half_octaves() {
        // 2 log2(1 + 3) = 4, 2 log2(1 + 2.9) = 3.9, 2 log2(32768) = 30.
        for (value, bin) in [
            (0.0, 30),
            (3.0, 34),
            (2.9, 33),
            (-3.0, 26),
            (32767.0, 60),
            (-32768.0, 0),
            (f32::INFINITY, 60),
            (f32::NAN, 30),
            (f32::MAX, 60),
        ] {
            assert_eq!(histogram_bin(value), bin, "{value}");
        }
        for value in 0..=32768 {
            let octaves = 2.0 * (1.0 + f64::from(value)).log2();
            assert_eq!(
                histogram_bin(value as f32),
                30 + octaves as usize,
                "{value}"
            );
        }
        let mut stats = AdcStats::new(2, 16);
        let mut cube = RadarCube::zeros(1, 1, 2, 3);
        cube.data[4] = Complex32::new(3.0, -40_000.0);
        stats.push(&cube);
        assert_eq!(stats.histogram(0).unwrap()[30], 6);
        let second = stats.histogram(1).unwrap();
        assert_eq!([second[30], second[34], second[0]], [4, 1, 1]);
        assert!(stats.histogram(2).is_none());
    }

    /// A receiver that is always at full scale is not reported as silent, although its values do not change.
    #[test]
    fn what_is_constant_at_full_scale_is_saturated() {
        let mut stats = AdcStats::new(1, 16);
        let mut cube = RadarCube::zeros(4, 1, 1, 8);
        cube.data.fill(Complex32::new(32767.0, -32768.0));
        stats.push(&cube);
        let problems = stats.problems();
        assert!(
            problems[0].starts_with("ADC saturated in 100.0 %"),
            "{problems:?}"
        );
        cube.data.fill(Complex32::ZERO);
        let mut stats = AdcStats::new(1, 16);
        stats.push(&cube);
        assert_eq!(stats.problems(), ["all channels are silent"]);
    }

    /// Levels use one loop in eight, saturation uses all loops.
    #[test]
    fn one_saturated_sample_of_many_loops_is_counted() {
        let mut stats = AdcStats::new(1, 16);
        let mut cube = RadarCube::zeros(64, 1, 1, 4);
        for (i, z) in cube.data.iter_mut().enumerate() {
            *z = Complex32::new(100.0 * if i % 8 < 4 { 1.0 } else { -1.0 }, 0.0);
        }
        cube.data[7].im = 32767.0;
        stats.push(&cube);
        let [c] = stats.channels()[..] else { panic!() };
        assert_eq!((c.n_samples, c.saturated), (256, 1.0 / 256.0));
        assert_eq!(stats.histogram(0).unwrap().iter().sum::<u64>(), 2 * 32);
    }
}
