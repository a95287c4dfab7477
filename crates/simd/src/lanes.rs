//! Levels, the trait and its implementations, and the macro that makes entry points.

use num_complex::Complex32;

use crate::Cell;

/// Instruction set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SimdLevel {
    /// 512-bit vectors with fused multiply-add.
    Avx512,
    /// 256-bit vectors with fused multiply-add.
    Avx2,
    /// Whatever the build target has.
    Portable,
}

impl SimdLevel {
    /// The best level of this machine.
    pub fn detect() -> Self {
        [Self::Avx512, Self::Avx2]
            .into_iter()
            .find(|l| l.is_available())
            .unwrap_or(Self::Portable)
    }

    /// Whether this machine can run it.
    pub fn is_available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512vl")
                    && Self::Avx2.is_available()
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 => false,
            Self::Portable => true,
        }
    }
}

/// Sixteen floats.
///
/// Name the implementing types only through [`dispatch!`](crate::dispatch): their methods are the
/// instructions of their level.
pub trait Lanes: Copy {
    /// Whether sixteen floats are one or two registers.
    const HAS_VECTORS: bool = true;
    /// Rows and vectors of a matrix tile: as many sums as registers hold.
    const TILE: (usize, usize);
    /// `x` in every lane.
    fn splat(x: f32) -> Self;
    /// From memory.
    fn load(from: &[f32; 16]) -> Self;
    /// To memory.
    fn store(self, to: &mut [f32; 16]);
    /// Real and imaginary parts of sixteen complex numbers.
    fn load_complex(from: &[Complex32; 16]) -> (Self, Self);
    /// The inverse of [`Self::load_complex`].
    fn store_complex(re: Self, im: Self, to: &mut [Complex32; 16]);
    /// Stores one number a lane past the cache, for what is not read soon: the cache line need not be fetched to be
    /// overwritten. [`Self::fence`] before another thread may look.
    #[inline(always)]
    fn stream(re: Self, im: Self, to: &mut Cell) {
        re.store(&mut to.re);
        im.store(&mut to.im);
    }
    /// Waits for what [`Self::stream`] stored.
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
    /// `self * factor + term`.
    fn fma(self, factor: Self, term: Self) -> Self;
    /// `term - self * factor`.
    fn fnma(self, factor: Self, term: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// To the nearest integer, ties to even.
    fn round(self) -> Self;
    /// The smaller; `other` where either is NaN.
    fn min(self, other: Self) -> Self;
    /// The larger; `other` where either is NaN.
    fn max(self, other: Self) -> Self;
    /// `if self < limit { yes } else { no }`, lane by lane.
    fn select_lt(self, limit: Self, yes: Self, no: Self) -> Self;

    /// 2 to the power of an integer in -126..=127.
    fn pow2(self) -> Self;
    /// Truncates integers in -128..=127 to bytes.
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

    /// Sum of the lanes, in pairs.
    #[inline(always)]
    fn sum(self) -> f32 {
        let mut a = self.array();
        for half in [8, 4, 2, 1] {
            for i in 0..half {
                a[i] += a[i + half];
            }
        }
        a[0]
    }

    /// Largest lane.
    #[inline(always)]
    fn most(self) -> f32 {
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
pub fn sin_cos_turns<L: Lanes>(x: L) -> (L, L) {
    // q in [-1/2, 1/2] turns; polynomials give the half angle (pi q in [-pi/2, pi/2]), the
    // double-angle formulas the rest: no quadrant logic.
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

/// Portable lanes.
#[doc(hidden)]
#[derive(Clone, Copy)]
pub struct Array16([f32; 16]);

impl Array16 {
    #[inline(always)]
    fn map2(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }
}

impl Lanes for Array16 {
    const HAS_VECTORS: bool = false;
    const TILE: (usize, usize) = (2, 1);
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([x; 16])
    }
    #[inline(always)]
    fn load(from: &[f32; 16]) -> Self {
        Self(*from)
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; 16]) {
        *to = self.0;
    }
    #[inline(always)]
    fn load_complex(from: &[Complex32; 16]) -> (Self, Self) {
        (Self(from.map(|z| z.re)), Self(from.map(|z| z.im)))
    }
    #[inline(always)]
    fn store_complex(re: Self, im: Self, to: &mut [Complex32; 16]) {
        for ((to, re), im) in to.iter_mut().zip(re.0).zip(im.0) {
            *to = Complex32::new(re, im);
        }
    }
    #[inline(always)]
    fn transpose(rows: &mut [Self; 16]) {
        let from = *rows;
        for (i, row) in rows.iter_mut().enumerate() {
            for (to, from) in row.0.iter_mut().zip(&from) {
                *to = from.0[i];
            }
        }
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.map2(other, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.map2(other, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.map2(other, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.map2(other, |a, b| a / b)
    }
    #[inline(always)]
    fn fma(self, factor: Self, term: Self) -> Self {
        self.mul(factor).add(term)
    }
    #[inline(always)]
    fn fnma(self, factor: Self, term: Self) -> Self {
        term.sub(self.mul(factor))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }
    #[inline(always)]
    fn round(self) -> Self {
        // Adding 1.5 * 2^23 rounds to the nearest integer without a library call; |x| < 2^22.
        const MAGIC: f32 = 12_582_912.0;
        Self(self.0.map(|x| (x + MAGIC) - MAGIC))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.map2(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.map2(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn pow2(self) -> Self {
        Self(
            self.0
                .map(|n| f32::from_bits(((n as i32 + 127) as u32) << 23)),
        )
    }
    #[inline(always)]
    fn store_bytes(self, to: &mut [i8; 16]) {
        *to = self.0.map(|x| x as i8);
    }
    #[inline(always)]
    fn select_lt(self, limit: Self, yes: Self, no: Self) -> Self {
        Self(std::array::from_fn(|i| {
            if self.0[i] < limit.0[i] {
                yes.0[i]
            } else {
                no.0[i]
            }
        }))
    }
}

#[cfg(target_arch = "x86_64")]
#[doc(hidden)]
pub use x86::{Avx2x2, Avx512};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use num_complex::Complex32;

    use super::{Cell, Lanes};

    /// Calls one intrinsic.
    ///
    /// The types of this module are named only by entry points that `dispatch!` makes, which are
    /// compiled for, and called only after detecting, the features concerned.
    macro_rules! intrinsic {
        ($call:expr) => {{
            // SAFETY: the module's types are used only on machines where `SimdLevel::is_available`
            // said yes, and pointers come from references to 16 floats or complex numbers, aligned to 64 bytes in cells.
            unsafe { $call }
        }};
    }

    /// One 512-bit register.
    #[derive(Clone, Copy)]
    pub struct Avx512(__m512);

    impl Avx512 {
        /// Exchanges 128-bit quarters: `a`'s and `b`'s even ones, and their odd ones.
        #[inline(always)]
        fn quarters(a: Self, b: Self) -> (Self, Self) {
            (
                Self(intrinsic!(_mm512_shuffle_f32x4::<0b10_00_10_00>(a.0, b.0))),
                Self(intrinsic!(_mm512_shuffle_f32x4::<0b11_01_11_01>(a.0, b.0))),
            )
        }
    }

    impl Lanes for Avx512 {
        // 24 sums, 4 weights, 1 activation of 32 registers.
        const TILE: (usize, usize) = (6, 4);
        #[inline(always)]
        fn splat(x: f32) -> Self {
            Self(intrinsic!(_mm512_set1_ps(x)))
        }
        #[inline(always)]
        fn load(from: &[f32; 16]) -> Self {
            Self(intrinsic!(_mm512_loadu_ps(from.as_ptr())))
        }
        #[inline(always)]
        fn store(self, to: &mut [f32; 16]) {
            intrinsic!(_mm512_storeu_ps(to.as_mut_ptr(), self.0));
        }
        #[inline(always)]
        fn stream(re: Self, im: Self, to: &mut Cell) {
            intrinsic!(_mm512_stream_ps(to.re.as_mut_ptr(), re.0));
            intrinsic!(_mm512_stream_ps(to.im.as_mut_ptr(), im.0));
        }
        #[inline(always)]
        fn fence() {
            intrinsic!(_mm_sfence());
        }
        #[inline(always)]
        fn load_complex(from: &[Complex32; 16]) -> (Self, Self) {
            let from: *const f32 = from.as_ptr().cast();
            let a = intrinsic!(_mm512_loadu_ps(from));
            let b = intrinsic!(_mm512_loadu_ps(from.add(16)));
            let even = intrinsic!(_mm512_setr_epi32(
                0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30
            ));
            let odd = intrinsic!(_mm512_setr_epi32(
                1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31
            ));
            (
                Self(intrinsic!(_mm512_permutex2var_ps(a, even, b))),
                Self(intrinsic!(_mm512_permutex2var_ps(a, odd, b))),
            )
        }
        #[inline(always)]
        fn store_complex(re: Self, im: Self, to: &mut [Complex32; 16]) {
            let to: *mut f32 = to.as_mut_ptr().cast();
            let low = intrinsic!(_mm512_setr_epi32(
                0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23
            ));
            let high = intrinsic!(_mm512_setr_epi32(
                8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31
            ));
            let (a, b) = (
                intrinsic!(_mm512_permutex2var_ps(re.0, low, im.0)),
                intrinsic!(_mm512_permutex2var_ps(re.0, high, im.0)),
            );
            intrinsic!(_mm512_storeu_ps(to, a));
            intrinsic!(_mm512_storeu_ps(to.add(16), b));
        }
        #[inline(always)]
        fn transpose(rows: &mut [Self; 16]) {
            // 4 x 4 blocks within the 128-bit quarters: afterwards vector 4 g + c holds, in quarter q,
            // column 4 q + c of rows 4 g ..
            let mut t = *rows;
            for g in (0..16).step_by(4) {
                let [a, b, c, d] = [rows[g].0, rows[g + 1].0, rows[g + 2].0, rows[g + 3].0];
                let (ab0, ab1) = (
                    intrinsic!(_mm512_castps_pd(_mm512_unpacklo_ps(a, b))),
                    intrinsic!(_mm512_castps_pd(_mm512_unpackhi_ps(a, b))),
                );
                let (cd0, cd1) = (
                    intrinsic!(_mm512_castps_pd(_mm512_unpacklo_ps(c, d))),
                    intrinsic!(_mm512_castps_pd(_mm512_unpackhi_ps(c, d))),
                );
                t[g] = Self(intrinsic!(_mm512_castpd_ps(_mm512_unpacklo_pd(ab0, cd0))));
                t[g + 1] = Self(intrinsic!(_mm512_castpd_ps(_mm512_unpackhi_pd(ab0, cd0))));
                t[g + 2] = Self(intrinsic!(_mm512_castpd_ps(_mm512_unpacklo_pd(ab1, cd1))));
                t[g + 3] = Self(intrinsic!(_mm512_castpd_ps(_mm512_unpackhi_pd(ab1, cd1))));
            }
            // Then the quarters.
            for c in 0..4 {
                let (even_a, odd_a) = Self::quarters(t[c], t[4 + c]);
                let (even_b, odd_b) = Self::quarters(t[8 + c], t[12 + c]);
                (rows[c], rows[8 + c]) = Self::quarters(even_a, even_b);
                (rows[4 + c], rows[12 + c]) = Self::quarters(odd_a, odd_b);
            }
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            Self(intrinsic!(_mm512_add_ps(self.0, other.0)))
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            Self(intrinsic!(_mm512_sub_ps(self.0, other.0)))
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            Self(intrinsic!(_mm512_mul_ps(self.0, other.0)))
        }
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            Self(intrinsic!(_mm512_div_ps(self.0, other.0)))
        }
        #[inline(always)]
        fn fma(self, factor: Self, term: Self) -> Self {
            Self(intrinsic!(_mm512_fmadd_ps(self.0, factor.0, term.0)))
        }
        #[inline(always)]
        fn fnma(self, factor: Self, term: Self) -> Self {
            Self(intrinsic!(_mm512_fnmadd_ps(self.0, factor.0, term.0)))
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            Self(intrinsic!(_mm512_sqrt_ps(self.0)))
        }
        #[inline(always)]
        fn round(self) -> Self {
            Self(intrinsic!(_mm512_roundscale_ps::<0>(self.0)))
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            Self(intrinsic!(_mm512_min_ps(self.0, other.0)))
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            Self(intrinsic!(_mm512_max_ps(self.0, other.0)))
        }
        #[inline(always)]
        fn pow2(self) -> Self {
            Self(intrinsic!({
                let exponent = _mm512_add_epi32(_mm512_cvtps_epi32(self.0), _mm512_set1_epi32(127));
                _mm512_castsi512_ps(_mm512_slli_epi32::<23>(exponent))
            }))
        }
        #[inline(always)]
        fn store_bytes(self, to: &mut [i8; 16]) {
            intrinsic!(_mm_storeu_si128(
                to.as_mut_ptr().cast(),
                _mm512_cvtsepi32_epi8(_mm512_cvtps_epi32(self.0))
            ));
        }
        #[inline(always)]
        fn sum(self) -> f32 {
            intrinsic!(_mm512_reduce_add_ps(self.0))
        }
        #[inline(always)]
        fn most(self) -> f32 {
            intrinsic!(_mm512_reduce_max_ps(self.0))
        }
        #[inline(always)]
        fn select_lt(self, limit: Self, yes: Self, no: Self) -> Self {
            Self(intrinsic!(_mm512_mask_blend_ps(
                _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, limit.0),
                no.0,
                yes.0
            )))
        }
    }

    /// Two 256-bit registers.
    #[derive(Clone, Copy)]
    pub struct Avx2x2(__m256, __m256);

    macro_rules! both {
        ($f:ident, $($x:expr),+) => {
            Self(intrinsic!($f($($x.0),+)), intrinsic!($f($($x.1),+)))
        };
    }

    impl Avx2x2 {
        /// Transposes 8 x 8 floats.
        #[inline(always)]
        fn transpose_block(r: &mut [__m256; 8]) {
            let mut t = *r;
            for g in [0, 4] {
                let (ab0, ab1) = (
                    intrinsic!(_mm256_castps_pd(_mm256_unpacklo_ps(r[g], r[g + 1]))),
                    intrinsic!(_mm256_castps_pd(_mm256_unpackhi_ps(r[g], r[g + 1]))),
                );
                let (cd0, cd1) = (
                    intrinsic!(_mm256_castps_pd(_mm256_unpacklo_ps(r[g + 2], r[g + 3]))),
                    intrinsic!(_mm256_castps_pd(_mm256_unpackhi_ps(r[g + 2], r[g + 3]))),
                );
                t[g] = intrinsic!(_mm256_castpd_ps(_mm256_unpacklo_pd(ab0, cd0)));
                t[g + 1] = intrinsic!(_mm256_castpd_ps(_mm256_unpackhi_pd(ab0, cd0)));
                t[g + 2] = intrinsic!(_mm256_castpd_ps(_mm256_unpacklo_pd(ab1, cd1)));
                t[g + 3] = intrinsic!(_mm256_castpd_ps(_mm256_unpackhi_pd(ab1, cd1)));
            }
            for c in 0..4 {
                r[c] = intrinsic!(_mm256_permute2f128_ps::<0x20>(t[c], t[4 + c]));
                r[4 + c] = intrinsic!(_mm256_permute2f128_ps::<0x31>(t[c], t[4 + c]));
            }
        }

        /// Real and imaginary parts of eight complex numbers.
        #[inline(always)]
        fn split(a: __m256, b: __m256) -> (__m256, __m256) {
            // Within 128-bit halves, then the quarters a0 b0 a1 b1 into order.
            let order = |v| {
                intrinsic!(_mm256_castpd_ps(_mm256_permute4x64_pd::<0b11_01_10_00>(
                    _mm256_castps_pd(v)
                )))
            };
            (
                order(intrinsic!(_mm256_shuffle_ps::<0b10_00_10_00>(a, b))),
                order(intrinsic!(_mm256_shuffle_ps::<0b11_01_11_01>(a, b))),
            )
        }

        /// The inverse of [`Self::split`].
        #[inline(always)]
        fn join(re: __m256, im: __m256) -> (__m256, __m256) {
            let (low, high) = (
                intrinsic!(_mm256_unpacklo_ps(re, im)),
                intrinsic!(_mm256_unpackhi_ps(re, im)),
            );
            (
                intrinsic!(_mm256_permute2f128_ps::<0x20>(low, high)),
                intrinsic!(_mm256_permute2f128_ps::<0x31>(low, high)),
            )
        }
    }

    impl Lanes for Avx2x2 {
        // 8 registers of sums, 2 of weights, 1 activation of 16.
        const TILE: (usize, usize) = (4, 1);
        #[inline(always)]
        fn splat(x: f32) -> Self {
            let v = intrinsic!(_mm256_set1_ps(x));
            Self(v, v)
        }
        #[inline(always)]
        fn load(from: &[f32; 16]) -> Self {
            Self(
                intrinsic!(_mm256_loadu_ps(from.as_ptr())),
                intrinsic!(_mm256_loadu_ps(from.as_ptr().add(8))),
            )
        }
        #[inline(always)]
        fn store(self, to: &mut [f32; 16]) {
            intrinsic!(_mm256_storeu_ps(to.as_mut_ptr(), self.0));
            intrinsic!(_mm256_storeu_ps(to.as_mut_ptr().add(8), self.1));
        }
        #[inline(always)]
        fn stream(re: Self, im: Self, to: &mut Cell) {
            for (part, to) in [(re, &mut to.re), (im, &mut to.im)] {
                intrinsic!(_mm256_stream_ps(to.as_mut_ptr(), part.0));
                intrinsic!(_mm256_stream_ps(to.as_mut_ptr().add(8), part.1));
            }
        }
        #[inline(always)]
        fn fence() {
            intrinsic!(_mm_sfence());
        }
        #[inline(always)]
        fn load_complex(from: &[Complex32; 16]) -> (Self, Self) {
            let from: *const f32 = from.as_ptr().cast();
            let quarter = |i: usize| intrinsic!(_mm256_loadu_ps(from.add(8 * i)));
            let (re0, im0) = Self::split(quarter(0), quarter(1));
            let (re1, im1) = Self::split(quarter(2), quarter(3));
            (Self(re0, re1), Self(im0, im1))
        }
        #[inline(always)]
        fn store_complex(re: Self, im: Self, to: &mut [Complex32; 16]) {
            let to: *mut f32 = to.as_mut_ptr().cast();
            let (a, b) = Self::join(re.0, im.0);
            let (c, d) = Self::join(re.1, im.1);
            for (i, quarter) in [a, b, c, d].into_iter().enumerate() {
                intrinsic!(_mm256_storeu_ps(to.add(8 * i), quarter));
            }
        }
        #[inline(always)]
        fn transpose(rows: &mut [Self; 16]) {
            let mut blocks = [[rows[0].0; 8]; 4];
            for i in 0..8 {
                (blocks[0][i], blocks[1][i]) = (rows[i].0, rows[i].1);
                (blocks[2][i], blocks[3][i]) = (rows[8 + i].0, rows[8 + i].1);
            }
            // A loop: what an iterator calls is compiled without this level's instructions unless it is inlined.
            for block in &mut blocks {
                Self::transpose_block(block);
            }
            for i in 0..8 {
                rows[i] = Self(blocks[0][i], blocks[2][i]);
                rows[8 + i] = Self(blocks[1][i], blocks[3][i]);
            }
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            both!(_mm256_add_ps, self, other)
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            both!(_mm256_sub_ps, self, other)
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            both!(_mm256_mul_ps, self, other)
        }
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            both!(_mm256_div_ps, self, other)
        }
        #[inline(always)]
        fn fma(self, factor: Self, term: Self) -> Self {
            both!(_mm256_fmadd_ps, self, factor, term)
        }
        #[inline(always)]
        fn fnma(self, factor: Self, term: Self) -> Self {
            both!(_mm256_fnmadd_ps, self, factor, term)
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            both!(_mm256_sqrt_ps, self)
        }
        #[inline(always)]
        fn round(self) -> Self {
            Self(
                intrinsic!(_mm256_round_ps::<0>(self.0)),
                intrinsic!(_mm256_round_ps::<0>(self.1)),
            )
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            both!(_mm256_min_ps, self, other)
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            both!(_mm256_max_ps, self, other)
        }
        #[inline(always)]
        fn pow2(self) -> Self {
            let half = |x| {
                intrinsic!({
                    let exponent = _mm256_add_epi32(_mm256_cvtps_epi32(x), _mm256_set1_epi32(127));
                    _mm256_castsi256_ps(_mm256_slli_epi32::<23>(exponent))
                })
            };
            Self(half(self.0), half(self.1))
        }
        #[inline(always)]
        fn store_bytes(self, to: &mut [i8; 16]) {
            *to = self.array().map(|x| x as i8);
        }
        #[inline(always)]
        fn select_lt(self, limit: Self, yes: Self, no: Self) -> Self {
            let mask = |a, b| intrinsic!(_mm256_cmp_ps::<_CMP_LT_OQ>(a, b));
            Self(
                intrinsic!(_mm256_blendv_ps(no.0, yes.0, mask(self.0, limit.0))),
                intrinsic!(_mm256_blendv_ps(no.1, yes.1, mask(self.1, limit.1))),
            )
        }
    }
}

/// Defines `$name(level, args)`, which runs the generic `$body::<L>(args)` compiled for `level`, or
/// for [`SimdLevel::Portable`] where this machine cannot run `level`.
///
/// The body, and whatever it calls with lanes, must be `#[inline(always)]`, and loops rather than iterators' methods: what
/// those call is compiled without the level's instructions unless it happens to be inlined, and then every instruction is
/// a call. `nm -C` on a binary shows such calls as functions of `core_arch`.
#[macro_export]
macro_rules! dispatch {
    ($(#[$meta:meta])* $vis:vis fn $name:ident => $body:ident ( $($arg:ident : $ty:ty),* $(,)? )) => {
        $(#[$meta])*
        $vis fn $name(level: $crate::SimdLevel, $($arg: $ty),*) {
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma")]
            fn avx512($($arg: $ty),*) {
                $body::<$crate::lanes::Avx512>($($arg),*);
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2($($arg: $ty),*) {
                $body::<$crate::lanes::Avx2x2>($($arg),*);
            }
            match level {
                #[cfg(target_arch = "x86_64")]
                $crate::SimdLevel::Avx512 if level.is_available() => {
                    // SAFETY: this machine has the features, it was just asked.
                    unsafe { avx512($($arg),*) }
                }
                #[cfg(target_arch = "x86_64")]
                $crate::SimdLevel::Avx2 if level.is_available() => {
                    // SAFETY: as above.
                    unsafe { avx2($($arg),*) }
                }
                _ => $body::<$crate::lanes::Array16>($($arg),*),
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[inline(always)]
    fn sin_cos_body<L: Lanes>(x: &[f32; 16], out: &mut [[f32; 16]; 2]) {
        let (s, c) = sin_cos_turns(L::load(x));
        s.store(&mut out[0]);
        c.store(&mut out[1]);
    }
    dispatch!(fn sin_cos => sin_cos_body(x: &[f32; 16], out: &mut [[f32; 16]; 2]));

    #[test]
    fn sine_and_cosine_are_accurate_at_every_level() {
        for level in [SimdLevel::Avx512, SimdLevel::Avx2, SimdLevel::Portable] {
            if !level.is_available() {
                continue;
            }
            for i in 0..4000 {
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
    fn shuffle_body<L: Lanes>(
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
        for level in [SimdLevel::Avx512, SimdLevel::Avx2, SimdLevel::Portable] {
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
}
