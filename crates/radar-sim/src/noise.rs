//! White circular Gaussian noise, sixteen samples at a time.
//!
//! Sixteen interleaved xoshiro128++ generators (Blackman and Vigna 2021) feed the Box-Muller transform. The largest
//! possible deviate is 6.7 standard deviations.

use num_complex::Complex32;

use radarllm_base::random::step;
use radarllm_simd::{SimdF32x16, SimdLevel, dispatch};

/// A stream of complex Gaussians. The same seed gives the same stream on the same [`SimdLevel`].
///
/// Aligned to cache lines. On a stack that was aligned only to 16 bytes, about half of the processes took one and a
/// half times as long for their noise and FFTs.
#[derive(Clone, Debug)]
#[repr(C, align(64))]
pub struct NoiseGenerator {
    pub(crate) state: [[u32; 16]; 4],
    level: SimdLevel,
}

impl NoiseGenerator {
    /// Creates the stream of a seed.
    pub fn new(seed: u64, level: SimdLevel) -> Self {
        let mut counter = seed;
        let mut state = [[0; 16]; 4];
        #[expect(clippy::needless_range_loop, reason = "the lane is the second index")]
        for lane in 0..16 {
            for pair in 0..2 {
                // SplitMix64, as the authors recommend for seeding.
                let z = step(&mut counter);
                state[2 * pair][lane] = z as u32;
                // The generator must not start from the all-zero state.
                state[2 * pair + 1][lane] = (z >> 32) as u32 | 1;
            }
        }
        Self { state, level }
    }

    /// Adds noise of power `rms * rms` (both components together) to every sample.
    pub fn add(&mut self, samples: &mut [Complex32], rms: f32) {
        add_noise(self.level, &mut self.state, samples, rms);
    }
}

dispatch!(fn add_noise => add_noise_body(
    state: &mut [[u32; 16]; 4], samples: &mut [Complex32], rms: f32
));

#[inline(always)]
fn add_noise_body<L: SimdF32x16>(state: &mut [[u32; 16]; 4], samples: &mut [Complex32], rms: f32) {
    let (blocks, rest) = samples.as_chunks_mut();
    for block in blocks {
        let (re, im) = gaussians::<L>(state, rms);
        let (to_re, to_im) = L::load_complex(block);
        L::store_complex(to_re.add(re), to_im.add(im), block);
    }
    if !rest.is_empty() {
        let (re, im) = gaussians::<L>(state, rms);
        for (sample, (re, im)) in rest.iter_mut().zip(re.array().into_iter().zip(im.array())) {
            *sample += Complex32::new(re, im);
        }
    }
}

#[inline(always)]
fn next(s: &mut [[u32; 16]; 4]) -> [u32; 16] {
    let mut out = [0; 16];
    for i in 0..16 {
        out[i] = s[0][i]
            .wrapping_add(s[3][i])
            .rotate_left(7)
            .wrapping_add(s[0][i]);
        let t = s[1][i] << 9;
        s[2][i] ^= s[0][i];
        s[3][i] ^= s[1][i];
        s[1][i] ^= s[2][i];
        s[0][i] ^= s[3][i];
        s[2][i] ^= t;
        s[3][i] = s[3][i].rotate_left(11);
    }
    out
}

/// Real and imaginary parts of sixteen deviates with a mean square of `rms * rms`, by Box-Muller. The polynomials have
/// errors of 1e-5 of a deviate.
#[inline(always)]
pub(crate) fn gaussians<L: SimdF32x16>(state: &mut [[u32; 16]; 4], rms: f32) -> (L, L) {
    let (first, second) = (next(state), next(state));
    let (mut mantissa, mut exponent, mut turns) = ([0.0; 16], [0.0; 16], [0.0; 16]);
    for i in 0..16 {
        // u in (0, 1] has 31 bits, because AVX2 converts only signed integers. It is split into 2^e m with m in
        // [sqrt(1/2), sqrt 2).
        let u = (first[i] >> 1) as i32 as f32 * (1.0 / 2_147_483_648.0) + 1.0 / 4_294_967_296.0;
        let bits = u.to_bits() as i32;
        let e = (bits - 0x3f35_04f3) >> 23;
        exponent[i] = e as f32;
        mantissa[i] = f32::from_bits((bits - (e << 23)) as u32);
        turns[i] = second[i] as i32 as f32 * (1.0 / 4_294_967_296.0);
    }
    // -2 ln m over x = m - 1 in -0.293..0.414, minimax: relative error 1.1e-6.
    let x = L::load(&mantissa).sub(L::splat(1.0));
    let minus_two_ln_m = x.mul(x.polynomial(&[
        -2.000_002,
        1.000_022_3,
        -0.666_290_16,
        0.498_194_87,
        -0.409_926_6,
        0.373_357_1,
        -0.237_922_13,
    ]));
    let square = L::load(&exponent).fma(L::splat(-2.0 * std::f32::consts::LN_2), minus_two_ln_m);
    let radius = square
        .max(L::splat(0.0))
        .sqrt()
        .mul(L::splat(rms * std::f32::consts::FRAC_1_SQRT_2));
    // Half the angle is pi q. Sine over q and cosine are minimax polynomials in q^2, with errors of 9e-7 and 7e-6.
    let q = L::load(&turns);
    let y = q.mul(q);
    let sin = q.mul(y.polynomial(&[3.141_589_6, -5.167_368, 2.543_604_9, -0.558_396_04]));
    let cos = y.polynomial(&[0.999_993_3, -4.933_938, 4.041_283_6, -1.222_127_1]);
    let two_sin = sin.add(sin);
    let re = two_sin.fnma(sin, L::splat(1.0)).mul(radius);
    (re, two_sin.mul(cos).mul(radius))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stream(n: usize, level: SimdLevel) -> Vec<Complex32> {
        let mut out = vec![Complex32::ZERO; n];
        NoiseGenerator::new(11, level).add(&mut out, 1.0);
        out
    }

    #[test]
    fn moments_are_those_of_a_circular_gaussian() {
        let n = 1 << 21;
        let data = stream(n, SimdLevel::detect());
        let mean_of = |f: &dyn Fn(f64, f64) -> f64| {
            data.iter()
                .map(|z| f(f64::from(z.re), f64::from(z.im)))
                .sum::<f64>()
                / n as f64
        };
        // Five standard deviations of each estimator, sqrt(var / n) with n = 2^21.
        let five = |variance: f64| 5.0 * (variance / n as f64).sqrt();
        assert!(mean_of(&|a, _| a).abs() < five(0.5));
        assert!(mean_of(&|_, b| b).abs() < five(0.5));
        assert!((mean_of(&|a, b| a * a + b * b) - 1.0).abs() < five(1.0));
        assert!(mean_of(&|a, b| a * a - b * b).abs() < five(1.0));
        assert!(mean_of(&|a, b| a * b).abs() < five(0.25));
        // Fourth and sixth moments of N(0, 1/2): 3/4 and 15/8; variances 96/16 and 10170/64.
        assert!((mean_of(&|a, _| a.powi(4)) - 0.75).abs() < five(6.0));
        assert!((mean_of(&|_, b| b.powi(6)) - 1.875).abs() < five(158.9));
        // Tail beyond four standard deviations of a component: 6.334e-5 (two sides).
        let tail = mean_of(&|a, _| f64::from(u8::from(a.abs() > 4.0 * 0.5_f64.sqrt())));
        assert!((tail - 6.334e-5).abs() < five(6.334e-5), "{tail}");
    }

    #[test]
    fn samples_are_uncorrelated_at_all_lags_and_white() {
        let n = 1 << 16;
        let mut data = stream(n, SimdLevel::detect());
        for lag in [1, 2, 3, 4, 8, 15, 16, 17, 32, 256, 1024, 3072] {
            let sum: Complex32 = data
                .iter()
                .zip(&data[lag..])
                .map(|(a, b)| a.conj() * b)
                .sum();
            // Each estimate has a standard deviation of 1/sqrt(n). The limit is five of them.
            assert!(
                (sum / (n - lag) as f32).norm() < 5.0 / (n as f32).sqrt(),
                "lag {lag}"
            );
        }
        radarllm_simd::any_length::forward(n).process(&mut data);
        // Bin powers of white noise are exponential with mean n. The largest of n of them is below ln(n) + 7 (relative
        // to the mean) with probability 1 - 1e-3. The mean square is 2 within 5 sqrt(20 / n).
        let powers: Vec<f64> = data
            .iter()
            .map(|z| f64::from(z.norm_sqr()) / n as f64)
            .collect();
        assert!(powers.iter().fold(0.0_f64, |m, &p| m.max(p)) < (n as f64).ln() + 7.0);
        let mean_square = powers.iter().map(|p| p * p).sum::<f64>() / n as f64;
        assert!(
            (mean_square - 2.0).abs() < 5.0 * (20.0 / n as f64).sqrt(),
            "{mean_square}"
        );
    }

    #[test]
    fn levels_agree_within_rounding_and_seeds_differ() {
        let reference = stream(1000, SimdLevel::PORTABLE);
        for level in SimdLevel::available() {
            for (a, b) in stream(1000, level).iter().zip(&reference) {
                // A few roundings of 6e-8 on values of up to 5. Near u = 1, the square root increases the logarithm's
                // rounding to sqrt(1e-7).
                assert!((a - b).norm() < 5e-4, "{a} {b}");
            }
        }
        let mut other = vec![Complex32::ZERO; 1000];
        NoiseGenerator::new(12, SimdLevel::PORTABLE).add(&mut other, 1.0);
        assert!(other.iter().zip(&reference).all(|(a, b)| a != b));
    }
}
