//! Health of raw samples: offset, level, balance of I and Q, saturation, silence; per receiver.

use num_complex::Complex32;
use radarllm_base::RadarCube;

/// Share of samples at full scale from which a channel is called saturated.
const SATURATED_SHARE: f64 = 1e-3;
/// Level below the loudest channel from which one is called silent, dB.
const SILENT_DB: f64 = 40.0;
/// Offset over signal level from which it is worth a word.
const OFFSET_RATIO: f64 = 1.0;
/// Imbalance of I and Q from which it is worth a word: an image 26 dB below the signal.
const GAIN_DB: f64 = 1.0;
const PHASE_RAD: f64 = 0.1;

/// Bins of a histogram: two an octave of 1 + |value| to either side of zero. Equal bins would put all of a healthy signal, a
/// few hundred counts of 32767, into one.
pub const HISTOGRAM_BINS: usize = 2 * HISTOGRAM_SIDE + 1;
const HISTOGRAM_SIDE: usize = 30;

/// Figures of one receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelStats {
    /// Mean of I and of Q, counts.
    pub mean: [f64; 2],
    /// Root of the mean square of I and Q together, without their means, counts.
    pub rms: f64,
    /// Level of I over that of Q, dB; 0 where either is silent. As the angle below, of what changes from
    /// loop to loop: leakage of a fraction of a cycle lies anywhere between I and Q.
    pub gain_imbalance_db: f64,
    /// Angle by which I and Q miss a right angle, rad; 0 where either is silent.
    pub phase_imbalance_rad: f64,
    /// Share of the samples of which I or Q is at full scale.
    pub saturated: f64,
    /// Samples looked at.
    pub n_samples: u64,
}

#[derive(Clone, Copy)]
struct Sums {
    n: u64,
    sum: [f64; 2],
    /// Of I and Q together.
    squares: f64,
    /// Squares of I and Q and their product, without what stays from loop to loop.
    moving: [f64; 3],
    saturated: u64,
    /// Of I and Q values together.
    histogram: [u64; HISTOGRAM_BINS],
}

impl Default for Sums {
    fn default() -> Self {
        Self {
            n: 0,
            sum: [0.0; 2],
            squares: 0.0,
            moving: [0.0; 3],
            saturated: 0,
            histogram: [0; HISTOGRAM_BINS],
        }
    }
}

/// Sums over many frames.
pub struct AdcStats {
    full_scale: f32,
    channels: Vec<Sums>,
}

impl AdcStats {
    /// For `n_rx` receivers and an ADC of `bits` (12, 14 or 16), whose range is +-2^(bits - 1) counts.
    pub fn new(n_rx: usize, bits: u32) -> Self {
        Self {
            full_scale: (1_u32 << (bits.clamp(2, 16) - 1)) as f32 - 1.0,
            channels: vec![Sums::default(); n_rx],
        }
    }

    /// Adds a frame in counts; receivers beyond the planned number are left out.
    pub fn push(&mut self, cube: &RadarCube) {
        let (n_rx, n_samples) = (cube.n_rx.max(1), cube.n_samples.max(1));
        let loop_len = cube.n_tx * n_rx * n_samples;
        if loop_len == 0 {
            return;
        }
        let mut still = vec![Complex32::ZERO; loop_len];
        if cube.n_loops > 1 {
            for one in cube.data.chunks_exact(loop_len) {
                for (sum, value) in still.iter_mut().zip(one) {
                    *sum += value / cube.n_loops as f32;
                }
            }
        }
        let stills = still.chunks_exact(n_samples).cycle();
        for ((i, chirp), still) in cube.data.chunks_exact(n_samples).enumerate().zip(stills) {
            let Some(sums) = self.channels.get_mut(i % n_rx) else {
                continue;
            };
            for (value, still) in chirp.iter().zip(still) {
                sums.n += 1;
                sums.sum[0] += f64::from(value.re);
                sums.sum[1] += f64::from(value.im);
                sums.squares += f64::from(value.norm_sqr());
                let moving = value - still;
                let (re, im) = (f64::from(moving.re), f64::from(moving.im));
                sums.moving[0] += re * re;
                sums.moving[1] += im * im;
                sums.moving[2] += re * im;
                let peak = value.re.abs().max(value.im.abs());
                sums.saturated += u64::from(peak >= self.full_scale);
                for part in [value.re, value.im] {
                    sums.histogram[histogram_bin(part)] += 1;
                }
            }
        }
    }

    /// Figures by receiver.
    pub fn channels(&self) -> Vec<ChannelStats> {
        self.channels.iter().map(Sums::stats).collect()
    }

    /// How many values of I and Q of a receiver lie in each of [`HISTOGRAM_BINS`]; `None` beyond the receivers. Bin
    /// `HISTOGRAM_BINS / 2` is zero, the one `n` to its right holds |value| with 2 log2(1 + |value|) from n to n + 1, the
    /// last all beyond.
    pub fn histogram(&self, receiver: usize) -> Option<&[u64; HISTOGRAM_BINS]> {
        Some(&self.channels.get(receiver)?.histogram)
    }

    /// What is wrong, in words, for reports; empty for a healthy signal.
    pub fn problems(&self) -> Vec<String> {
        let channels = self.channels();
        let loudest = channels.iter().fold(0.0, |m: f64, c| m.max(c.rms));
        if channels.iter().all(|c| c.n_samples == 0) {
            return vec!["no samples".into()];
        }
        if loudest == 0.0 {
            return vec!["all channels are silent".into()];
        }
        let mut problems = Vec::new();
        for (i, c) in channels.iter().enumerate() {
            let rx = i + 1;
            if c.rms <= loudest * 10_f64.powf(-SILENT_DB / 20.0) {
                problems.push(format!(
                    "channel {rx} is silent: {:.1} counts rms, the loudest has {loudest:.1}",
                    c.rms
                ));
                continue;
            }
            if c.saturated >= SATURATED_SHARE {
                problems.push(format!(
                    "ADC saturated in {:.1} % of the samples of channel {rx}: less receiver gain or more distance",
                    c.saturated * 100.0
                ));
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

fn histogram_bin(value: f32) -> usize {
    // The cast saturates, and what is no number is zero.
    let octaves = (2.0 * (1.0 + value.abs()).log2()) as usize;
    let octaves = octaves.min(HISTOGRAM_SIDE);
    if value < 0.0 {
        HISTOGRAM_SIDE - octaves
    } else {
        HISTOGRAM_SIDE + octaves
    }
}

impl Sums {
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
            saturated: self.saturated as f64 / n,
            n_samples: self.n,
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
        ] {
            assert_eq!(histogram_bin(value), bin, "{value}");
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
}
