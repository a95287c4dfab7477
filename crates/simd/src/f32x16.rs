//! Sixteen `f32` at once: the trait that kernels are written with.

use num_complex::Complex32;

use crate::Cell;
use crate::sealed::Sealed;

/// Sixteen floats, the lanes of a vector.
///
/// A kernel receives an implementation from [`SimdLevel::run`](crate::SimdLevel::run), after a check that the processor
/// has the instructions. No other code can name one:
///
/// ```compile_fail,E0603
/// use radarllm_simd::SimdF32x16;
///
/// // On a processor without AVX-512 this would be undefined behaviour.
/// let ones = radarllm_simd::x86::Avx512::splat(1.0);
/// ```
pub trait SimdF32x16: Copy + Sealed {
    /// Whether the sixteen floats are in one or two vector registers, not in an array.
    const HAS_VECTORS: bool = true;
    /// Numbers of rows and vectors of a tile of a matrix product. They are chosen so that the sums fit into the
    /// registers.
    const TILE: (usize, usize);
    /// `x` in every lane.
    fn splat(x: f32) -> Self;
    /// Loads from memory, which need not be aligned.
    fn load(from: &[f32; 16]) -> Self;
    /// Stores to memory, which need not be aligned.
    fn store(self, to: &mut [f32; 16]);
    /// Real and imaginary parts of sixteen complex numbers.
    fn load_complex(from: &[Complex32; 16]) -> (Self, Self);
    /// The inverse of [`Self::load_complex`].
    fn store_complex(re: Self, im: Self, to: &mut [Complex32; 16]);
    /// Stores one complex number per lane past the cache, where the level has such stores. It suits results that are not
    /// read soon: the cache line is not fetched only to be overwritten.
    ///
    /// # Safety
    /// The thread must call [`Self::fence`] before anything else reads or writes `to`: such stores are not ordered with
    /// other accesses to memory.
    #[inline(always)]
    unsafe fn stream(re: Self, im: Self, to: &mut Cell) {
        re.store(&mut to.re);
        im.store(&mut to.im);
    }
    /// Orders all of this thread's [`Self::stream`] stores before what follows.
    #[inline(always)]
    fn fence() {}
    /// Lane `j` of vector `i` becomes lane `i` of vector `j`.
    fn transpose(rows: &mut [Self; 16]);
    /// `self + other`.
    fn add(self, other: Self) -> Self;
    /// `self - other`.
    fn sub(self, other: Self) -> Self;
    /// `self * other`.
    fn mul(self, other: Self) -> Self;
    /// `self / other`.
    fn div(self, other: Self) -> Self;
    /// `self * factor + term`, rounded once where the level has vectors and twice on the portable one.
    fn fma(self, factor: Self, term: Self) -> Self;
    /// `term - self * factor`, rounded as [`Self::fma`].
    fn fnma(self, factor: Self, term: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// To the nearest integer, ties to even; for absolute values below 2^22.
    fn round(self) -> Self;
    /// The smaller of two; `other` where either is NaN.
    fn min(self, other: Self) -> Self;
    /// The larger of two; `other` where either is NaN.
    fn max(self, other: Self) -> Self;
    /// `if self < limit { yes } else { no }`, lane by lane.
    fn select_lt(self, limit: Self, yes: Self, no: Self) -> Self;

    /// 2 to the power of an integer in -126..=127.
    fn pow2(self) -> Self;
    /// Stores integers in -128..=127 as bytes.
    fn store_bytes(self, to: &mut [i8; 16]);

    /// Absolute values.
    #[inline(always)]
    fn abs(self) -> Self {
        self.max(Self::splat(0.0).sub(self))
    }

    /// The sixteen floats.
    #[inline(always)]
    fn array(self) -> [f32; 16] {
        let mut out = [0.0; 16];
        self.store(&mut out);
        out
    }

    /// Sum of the lanes, added in pairs: a tree of four levels.
    #[inline(always)]
    fn reduce_sum(self) -> f32 {
        let mut a = self.array();
        for half in [8, 4, 2, 1] {
            for i in 0..half {
                a[i] += a[i + half];
            }
        }
        a[0]
    }

    /// Largest lane; the lanes must not be NaN.
    #[inline(always)]
    fn reduce_max(self) -> f32 {
        let mut a = self.array();
        for half in [8, 4, 2, 1] {
            for i in 0..half {
                a[i] = if a[i + half] > a[i] {
                    a[i + half]
                } else {
                    a[i]
                };
            }
        }
        a[0]
    }

    /// e to the power of x, relative error below 3e-7 for -87 <= x <= 88; 0 below -87.
    #[inline(always)]
    fn exp(self) -> Self {
        // x = n ln 2 + r with |r| <= ln 2 / 2; ln 2 in two parts so that n ln 2 is exact enough.
        let x = self.min(Self::splat(88.0)).max(Self::splat(-87.3));
        let n = x.mul(Self::splat(std::f32::consts::LOG2_E)).round();
        let r = n.fma(Self::splat(-0.693_359_4), x);
        let r = n.fma(Self::splat(2.121_944_4e-4), r);
        // exp(r) to the term r^7 / 7!: the rest is below 1e-8.
        let mut sum = Self::splat(1.0 / 5040.0);
        for c in [
            1.0 / 720.0,
            1.0 / 120.0,
            1.0 / 24.0,
            1.0 / 6.0,
            0.5,
            1.0,
            1.0,
        ] {
            sum = sum.fma(r, Self::splat(c));
        }
        sum.mul(n.pow2())
    }

    /// `c[0] + c[1] x + ...`.
    #[inline(always)]
    fn polynomial<const N: usize>(self, c: &[f32; N]) -> Self {
        let mut sum = Self::splat(c[N - 1]);
        for i in (0..N - 1).rev() {
            sum = sum.fma(self, Self::splat(c[i]));
        }
        sum
    }
}

/// Sine and cosine of `2 pi x`, absolute error below 1e-6 for |x| < 1e4 (beyond the input's own
/// rounding).
#[inline(always)]
pub fn sin_cos_turns<L: SimdF32x16>(x: L) -> (L, L) {
    // q is in [-1/2, 1/2] turns. Polynomials give sine and cosine of half the angle (pi q in [-pi/2, pi/2]), and the
    // double-angle formulas give those of the angle. No case distinction by quadrant is needed.
    let q = x.sub(x.round());
    let y = q.mul(q);
    // Minimax over |q| <= 1/2 of sin(pi q)/q (times q) and cos(pi q) in q^2: errors of 3e-9 and 5e-8.
    let s = y
        .polynomial(&[
            std::f32::consts::PI,
            -5.167_707,
            2.550_031_4,
            -0.598_045_2,
            0.077_220_13,
        ])
        .mul(q);
    let c = y.polynomial(&[1.0, -4.934_793, 4.058_412, -1.331_880_2, 0.219_696_8]);
    let two_s = s.add(s);
    (two_s.mul(c), two_s.fnma(s, L::splat(1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SimdLevel, dispatch};

    #[inline(always)]
    fn sin_cos_body<L: SimdF32x16>(x: &[f32; 16], out: &mut [[f32; 16]; 2]) {
        let (s, c) = sin_cos_turns(L::load(x));
        s.store(&mut out[0]);
        c.store(&mut out[1]);
    }
    dispatch!(fn sin_cos => sin_cos_body(x: &[f32; 16], out: &mut [[f32; 16]; 2]));

    #[test]
    fn sine_and_cosine_are_accurate_at_every_level() {
        for level in SimdLevel::available() {
            for i in (0..4000).step_by(if cfg!(miri) { 97 } else { 1 }) {
                let x: [f32; 16] = std::array::from_fn(|j| (i * 16 + j) as f32 * 7.3e-4 - 20.0);
                let mut out = [[0.0; 16]; 2];
                sin_cos(level, &x, &mut out);
                for j in 0..16 {
                    let (s, c) = (f64::from(x[j]) * std::f64::consts::TAU).sin_cos();
                    // f32 evaluation of a degree-6 polynomial: a few roundings of 1.2e-7, doubled once.
                    assert!(
                        (f64::from(out[0][j]) - s).abs() < 1e-6,
                        "{level:?} sin {}",
                        x[j]
                    );
                    assert!(
                        (f64::from(out[1][j]) - c).abs() < 1e-6,
                        "{level:?} cos {}",
                        x[j]
                    );
                }
            }
        }
    }

    #[inline(always)]
    fn shuffle_body<L: SimdF32x16>(
        from: &[[Complex32; 16]; 16],
        turned: &mut [[Complex32; 16]; 16],
        back: &mut [[Complex32; 16]; 16],
    ) {
        let (mut re, mut im) = ([L::splat(0.0); 16], [L::splat(0.0); 16]);
        for (i, row) in from.iter().enumerate() {
            (re[i], im[i]) = L::load_complex(row);
            L::store_complex(re[i], im[i], &mut back[i]);
        }
        L::transpose(&mut re);
        L::transpose(&mut im);
        for (i, row) in turned.iter_mut().enumerate() {
            L::store_complex(re[i], im[i], row);
        }
    }
    dispatch!(fn shuffle => shuffle_body(
        from: &[[Complex32; 16]; 16],
        turned: &mut [[Complex32; 16]; 16],
        back: &mut [[Complex32; 16]; 16],
    ));

    #[test]
    fn transposition_and_interleaving_move_every_number_to_its_place() {
        let from: [[Complex32; 16]; 16] = std::array::from_fn(|i| {
            std::array::from_fn(|j| Complex32::new((16 * i + j) as f32, -((16 * i + j) as f32)))
        });
        for level in SimdLevel::available() {
            let mut turned = [[Complex32::ZERO; 16]; 16];
            let mut back = turned;
            shuffle(level, &from, &mut turned, &mut back);
            assert_eq!(back, from, "{level:?}");
            for (i, row) in turned.iter().enumerate() {
                for (j, &z) in row.iter().enumerate() {
                    assert_eq!(z, from[j][i], "{level:?} {i} {j}");
                }
            }
        }
    }

    #[inline(always)]
    fn exp_body<L: SimdF32x16>(x: &[f32; 16]) -> [f32; 16] {
        L::load(x).exp().array()
    }
    dispatch!(fn exp => exp_body(x: &[f32; 16]) -> [f32; 16]);

    #[inline(always)]
    fn reduce_body<L: SimdF32x16>(x: &[f32; 16]) -> (f32, f32) {
        (L::load(x).reduce_sum(), L::load(x).reduce_max())
    }
    dispatch!(fn reduce => reduce_body(x: &[f32; 16]) -> (f32, f32));

    #[test]
    fn exponentials_are_accurate_at_every_level() {
        for level in SimdLevel::available() {
            for i in (0..10_900).step_by(if cfg!(miri) { 97 } else { 1 }) {
                let x: [f32; 16] = std::array::from_fn(|j| (i * 16 + j) as f32 * 1e-3 - 87.0);
                for (x, found) in x.iter().zip(exp(level, &x)) {
                    let expected = f64::from(*x).exp();
                    let error = (f64::from(found) / expected - 1.0).abs();
                    assert!(error < 3e-7, "{level:?}: exp({x}) = {found}, error {error}");
                }
            }
            assert_eq!(exp(level, &[0.0; 16]), [1.0; 16]);
            assert!(exp(level, &[f32::NEG_INFINITY; 16])[0] < 2e-38);
        }
    }

    #[test]
    fn sums_and_maxima_are_those_of_the_lanes() {
        for level in SimdLevel::available() {
            let x: [f32; 16] = std::array::from_fn(|i| ((i * 7) % 16) as f32 - 8.0);
            assert_eq!(reduce(level, &x), (-8.0, 7.0));
        }
    }
}
