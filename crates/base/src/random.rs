//! Random streams with a fixed algorithm: SplitMix64, and normal numbers computed from uniform ones.
//!
//! Data sets, training runs and reported intervals record a seed and depend on the exact bits that it generates. The
//! generator is therefore part of this project, because the next version of a library could draw different numbers. It
//! is good enough for simulation and resampling, and not suitable for cryptography.
//!
//! ```
//! use radarllm_base::random::{SplitMix64, nth};
//!
//! let mut stream = SplitMix64::new(42);
//! let draws = [stream.next_u64(), stream.next_u64()];
//! // The same numbers by their place, for loops whose order is not fixed.
//! assert_eq!(draws, [nth(42, 0), nth(42, 1)]);
//! assert!((0.0..1.0).contains(&stream.uniform_f64()));
//! ```
//!
//! Source: Steele, Lea and Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014.

use std::f64::consts::TAU;

/// Increment of the state per number.
pub const INCREMENT: u64 = 0x9e37_79b9_7f4a_7c15;
/// The two factors of [`mix`].
pub const MIX_FACTORS: [u64; 2] = [0xbf58_476d_1ce4_e5b9, 0x94d0_49bb_1331_11eb];

/// The output function: turns a state into 64 random bits.
#[inline]
pub const fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(MIX_FACTORS[0]);
    z = (z ^ (z >> 27)).wrapping_mul(MIX_FACTORS[1]);
    z ^ (z >> 31)
}

/// Advances a state and returns its next 64 random bits.
#[inline]
pub const fn step(state: &mut u64) -> u64 {
    *state = state.wrapping_add(INCREMENT);
    mix(*state)
}

/// Number `index`, from 0, of the stream that starts at `seed`.
#[inline]
pub const fn nth(seed: u64, index: u64) -> u64 {
    mix(seed.wrapping_add(index.wrapping_add(1).wrapping_mul(INCREMENT)))
}

/// Number `index` of a stream, uniform in 0..1 with 53 bits.
#[inline]
pub fn nth_uniform(seed: u64, index: u64) -> f64 {
    unit_f64(nth(seed, index))
}

/// Standard normal number `index` of a stream: the cosine of [`normal_polar`] of the uniform numbers `2 * index` and
/// `2 * index + 1`.
pub fn nth_normal(seed: u64, index: u64) -> f64 {
    let (radius, angle_rad) = normal_polar(
        1.0 - nth_uniform(seed, 2 * index),
        nth_uniform(seed, 2 * index + 1),
    );
    radius * angle_rad.cos()
}

/// Two independent standard normal numbers, as radius and angle (rad), from two uniform ones: `u` in (0, 1], `v` in
/// \[0, 1). The numbers are `radius * cos(angle)` and `radius * sin(angle)`.
///
/// Box and Muller, Annals of Mathematical Statistics 29, 1958.
#[inline]
pub fn normal_polar(u: f64, v: f64) -> (f64, f64) {
    ((-2.0 * u.ln()).sqrt(), TAU * v)
}

/// [`normal_polar`] in single precision.
#[inline]
pub fn normal_polar_f32(u: f32, v: f32) -> (f32, f32) {
    ((-2.0 * u.ln()).sqrt(), std::f32::consts::TAU * v)
}

/// The upper 53 bits as a number in 0..1.
#[inline]
fn unit_f64(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1_u64 << 53) as f64
}

/// A stream of random numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SplitMix64 {
    state: u64,
}

impl SplitMix64 {
    /// The stream of a seed.
    pub const fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// 64 random bits.
    #[inline]
    pub const fn next_u64(&mut self) -> u64 {
        step(&mut self.state)
    }

    /// Uniform in 0..1, 24 bits.
    #[inline]
    pub fn uniform_f32(&mut self) -> f32 {
        (self.next_u64() >> 40) as f32 / (1_u64 << 24) as f32
    }

    /// Uniform in 0..1, 53 bits.
    #[inline]
    pub fn uniform_f64(&mut self) -> f64 {
        unit_f64(self.next_u64())
    }

    /// Uniform in `0..n`; 0 for n = 0. The bias of the multiply-shift is below n / 2^64.
    #[inline]
    pub fn below(&mut self, n: usize) -> usize {
        ((u128::from(self.next_u64()) * n as u128) >> 64) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first three values are those of the reference implementation (Vigna, splitmix64.c, seed 0). The others were
    /// taken from the crates that had a generator of their own.
    #[test]
    fn streams_never_change() {
        let mut stream = SplitMix64::new(0);
        let bits = [stream.next_u64(), stream.next_u64(), stream.next_u64()];
        assert_eq!(
            bits,
            [
                0xe220_a839_7b1d_cdaf,
                0x6e78_9e6a_a1b9_65f4,
                0x06c4_5d18_8009_454f
            ]
        );
        assert_eq!(bits[2], nth(0, 2));
        let draws = [
            nth_uniform(5, 0),
            nth_uniform(5, 9),
            nth_normal(5, 0),
            nth_normal(5, 9),
        ];
        assert_eq!(
            draws.map(f64::to_bits),
            [
                4600639013628994160,
                4603610528859558714,
                4579417040242189131,
                13826610115377000005
            ]
        );
    }

    #[test]
    fn normal_numbers_have_mean_0_and_variance_1() {
        let draws: Vec<f64> = (0..20_000).map(|i| nth_normal(1, i)).collect();
        let n = draws.len() as f64;
        let mean = draws.iter().sum::<f64>() / n;
        let variance = draws.iter().map(|x| x * x).sum::<f64>() / n;
        // Standard errors 0.007 and 0.01; the tolerance is five of them.
        assert!(
            mean.abs() < 0.035 && (variance - 1.0).abs() < 0.05,
            "{mean} {variance}"
        );
    }

    #[test]
    fn draws_stay_in_range() {
        let mut stream = SplitMix64::new(9);
        for n in [0, 1, 7, usize::MAX] {
            assert!(stream.below(n) < n.max(1));
        }
        for _ in 0..1000 {
            assert!((0.0..1.0).contains(&stream.uniform_f32()));
            assert!((0.0..1.0).contains(&stream.uniform_f64()));
        }
    }
}
