//! Vectors of sixteen lanes: floats ([`Lanes`]) and products of bytes ([`ByteDot`]).
//!
//! An instruction set is chosen once per [`crate::Engine`] at run time; [`dispatch!`] compiles a
//! generic body for each. Results are equal within rounding between float implementations and to
//! the bit between those of bytes, whose sums are integers.

/// Instruction set of an engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SimdLevel {
    /// 512-bit vectors with products of bytes.
    Avx512Vnni,
    /// 512-bit vectors.
    Avx512,
    /// 256-bit vectors with fused multiply-add.
    Avx2,
    /// Whatever the build target has.
    Portable,
}

impl SimdLevel {
    /// All levels, best first.
    pub const ALL: [Self; 4] = [Self::Avx512Vnni, Self::Avx512, Self::Avx2, Self::Portable];

    /// The best level of this machine.
    pub fn detect() -> Self {
        Self::ALL
            .into_iter()
            .find(|level| level.is_available())
            .unwrap_or(Self::Portable)
    }

    /// Whether this machine can run it.
    pub fn is_available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512Vnni => {
                is_x86_feature_detected!("avx512vnni") && Self::Avx512.is_available()
            }
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
            Self::Avx512Vnni | Self::Avx512 | Self::Avx2 => false,
            Self::Portable => true,
        }
    }
}

/// Sixteen floats.
pub(crate) trait Lanes: Copy {
    /// Rows and vectors of a matrix tile: as many sums as registers hold.
    const TILE: (usize, usize);

    fn splat(x: f32) -> Self;
    fn load(from: &[f32; 16]) -> Self;
    fn store(self, to: &mut [f32; 16]);
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    /// `self * factor + term`.
    fn fma(self, factor: Self, term: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn min(self, other: Self) -> Self;
    /// To the nearest integer, ties to even; |x| < 2^22.
    fn round(self) -> Self;
    /// 2 to the power of an integer in -126..=127.
    fn pow2(self) -> Self;
    /// Truncates integers in -128..=127 to bytes.
    fn store_bytes(self, to: &mut [i8; 16]);

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
}

/// Sixteen sums of products of bytes.
pub(crate) trait ByteDot: Copy {
    fn zero() -> Self;
    /// Adds to each lane the product of its four weights, 0..=255, with the four bytes of
    /// `activation`, -127..=127.
    fn add_dot(self, weights: &[u8; 64], activation: [i8; 4]) -> Self;
    /// The sums less `offset`, as floats.
    fn less(self, offset: i32, to: &mut [f32; 16]);
}

/// Portable lanes.
#[derive(Clone, Copy)]
pub(crate) struct Array16([f32; 16]);

impl Array16 {
    #[inline(always)]
    fn map2(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }
}

impl Lanes for Array16 {
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
    fn max(self, other: Self) -> Self {
        self.map2(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.map2(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn round(self) -> Self {
        // Adding 1.5 * 2^23 rounds to the nearest integer without a library call; |x| < 2^22.
        const MAGIC: f32 = 12_582_912.0;
        Self(self.0.map(|x| (x + MAGIC) - MAGIC))
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
}

/// Portable products of bytes.
#[derive(Clone, Copy)]
pub(crate) struct ArrayDot([i32; 16]);

impl ByteDot for ArrayDot {
    #[inline(always)]
    fn zero() -> Self {
        Self([0; 16])
    }
    #[inline(always)]
    fn add_dot(mut self, weights: &[u8; 64], activation: [i8; 4]) -> Self {
        for (sum, w) in self.0.iter_mut().zip(weights.as_chunks::<4>().0) {
            for (w, a) in w.iter().zip(activation) {
                *sum += i32::from(*w) * i32::from(a);
            }
        }
        self
    }
    #[inline(always)]
    fn less(self, offset: i32, to: &mut [f32; 16]) {
        *to = self.0.map(|sum| (sum - offset) as f32);
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) use x86::{Avx2Dot, Avx2x2, Avx512, Avx512Dot, VnniDot};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use super::{ByteDot, Lanes};

    /// Calls one intrinsic.
    ///
    /// The types of this module are named only by the `dispatch!`ed entry points of this crate,
    /// which are compiled for, and called only after detecting, the features concerned.
    macro_rules! intrinsic {
        ($call:expr) => {{
            // SAFETY: the module's types are used only on machines where `SimdLevel::is_available`
            // said yes, and pointers come from references to as many elements as are read or written.
            unsafe { $call }
        }};
    }

    /// One 512-bit register.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx512(__m512);

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
        fn max(self, other: Self) -> Self {
            Self(intrinsic!(_mm512_max_ps(self.0, other.0)))
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            Self(intrinsic!(_mm512_min_ps(self.0, other.0)))
        }
        #[inline(always)]
        fn round(self) -> Self {
            Self(intrinsic!(_mm512_roundscale_ps::<0>(self.0)))
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
    }

    /// Four bytes as one number, to be copied into every lane.
    #[inline(always)]
    fn four(activation: [i8; 4]) -> i32 {
        i32::from_le_bytes(activation.map(|a| a as u8))
    }

    /// Sixteen sums in one register, with the instruction for products of bytes.
    #[derive(Clone, Copy)]
    pub(crate) struct VnniDot(__m512i);

    impl ByteDot for VnniDot {
        #[inline(always)]
        fn zero() -> Self {
            Self(intrinsic!(_mm512_setzero_si512()))
        }
        #[inline(always)]
        fn add_dot(self, weights: &[u8; 64], activation: [i8; 4]) -> Self {
            Self(intrinsic!({
                let weights = _mm512_loadu_si512(weights.as_ptr().cast());
                _mm512_dpbusd_epi32(self.0, weights, _mm512_set1_epi32(four(activation)))
            }))
        }
        #[inline(always)]
        fn less(self, offset: i32, to: &mut [f32; 16]) {
            intrinsic!({
                let sum = _mm512_sub_epi32(self.0, _mm512_set1_epi32(offset));
                _mm512_storeu_ps(to.as_mut_ptr(), _mm512_cvtepi32_ps(sum));
            });
        }
    }

    /// Sixteen sums in one register; bytes are widened, because the instruction that multiplies
    /// bytes without widening saturates.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx512Dot(__m512i);

    impl ByteDot for Avx512Dot {
        #[inline(always)]
        fn zero() -> Self {
            Self(intrinsic!(_mm512_setzero_si512()))
        }
        #[inline(always)]
        fn add_dot(self, weights: &[u8; 64], activation: [i8; 4]) -> Self {
            Self(intrinsic!({
                let w = _mm512_loadu_si512(weights.as_ptr().cast());
                let a = _mm512_set1_epi32(four(activation));
                // Bytes 0 and 2 of every four, then 1 and 3.
                let even_w = _mm512_and_si512(w, _mm512_set1_epi16(0xff));
                let odd_w = _mm512_srli_epi16::<8>(w);
                let even_a = _mm512_srai_epi16::<8>(_mm512_slli_epi16::<8>(a));
                let odd_a = _mm512_srai_epi16::<8>(a);
                let even = _mm512_madd_epi16(even_w, even_a);
                let odd = _mm512_madd_epi16(odd_w, odd_a);
                _mm512_add_epi32(self.0, _mm512_add_epi32(even, odd))
            }))
        }
        #[inline(always)]
        fn less(self, offset: i32, to: &mut [f32; 16]) {
            VnniDot(self.0).less(offset, to);
        }
    }

    /// Two 256-bit registers.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx2x2(__m256, __m256);

    macro_rules! both {
        ($f:ident, $($x:expr),+) => {
            Self(intrinsic!($f($($x.0),+)), intrinsic!($f($($x.1),+)))
        };
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
        fn max(self, other: Self) -> Self {
            both!(_mm256_max_ps, self, other)
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            both!(_mm256_min_ps, self, other)
        }
        #[inline(always)]
        fn round(self) -> Self {
            Self(
                intrinsic!(_mm256_round_ps::<0>(self.0)),
                intrinsic!(_mm256_round_ps::<0>(self.1)),
            )
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
    }

    /// Sixteen sums in two registers; bytes are widened as in [`Avx512Dot`].
    #[derive(Clone, Copy)]
    pub(crate) struct Avx2Dot(__m256i, __m256i);

    impl ByteDot for Avx2Dot {
        #[inline(always)]
        fn zero() -> Self {
            let zero = intrinsic!(_mm256_setzero_si256());
            Self(zero, zero)
        }
        #[inline(always)]
        fn add_dot(self, weights: &[u8; 64], activation: [i8; 4]) -> Self {
            intrinsic!({
                let a = _mm256_set1_epi32(four(activation));
                let even_a = _mm256_srai_epi16::<8>(_mm256_slli_epi16::<8>(a));
                let odd_a = _mm256_srai_epi16::<8>(a);
                let half = |sum, from: *const u8| {
                    let w = _mm256_loadu_si256(from.cast());
                    let even_w = _mm256_and_si256(w, _mm256_set1_epi16(0xff));
                    let odd_w = _mm256_srli_epi16::<8>(w);
                    let even = _mm256_madd_epi16(even_w, even_a);
                    let odd = _mm256_madd_epi16(odd_w, odd_a);
                    _mm256_add_epi32(sum, _mm256_add_epi32(even, odd))
                };
                Self(
                    half(self.0, weights.as_ptr()),
                    half(self.1, weights.as_ptr().add(32)),
                )
            })
        }
        #[inline(always)]
        fn less(self, offset: i32, to: &mut [f32; 16]) {
            intrinsic!({
                let offset = _mm256_set1_epi32(offset);
                let half = |sum| _mm256_cvtepi32_ps(_mm256_sub_epi32(sum, offset));
                _mm256_storeu_ps(to.as_mut_ptr(), half(self.0));
                _mm256_storeu_ps(to.as_mut_ptr().add(8), half(self.1));
            });
        }
    }
}

/// Defines `$name(level, args)`, which runs the generic `$body::<L, D>(args)` compiled for `level`;
/// `L` is [`Lanes`], `D` is [`ByteDot`].
macro_rules! dispatch {
    ($(#[$meta:meta])* $vis:vis fn $name:ident => $body:ident
        ( $($arg:ident : $ty:ty),* $(,)? ) $(-> $out:ty)?) => {
        $(#[$meta])*
        $vis fn $name(level: $crate::simd::SimdLevel, $($arg: $ty),*) $(-> $out)? {
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx512vnni,avx2,fma")]
            fn vnni($($arg: $ty),*) $(-> $out)? {
                $body::<$crate::simd::Avx512, $crate::simd::VnniDot>($($arg),*)
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma")]
            fn avx512($($arg: $ty),*) $(-> $out)? {
                $body::<$crate::simd::Avx512, $crate::simd::Avx512Dot>($($arg),*)
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2($($arg: $ty),*) $(-> $out)? {
                $body::<$crate::simd::Avx2x2, $crate::simd::Avx2Dot>($($arg),*)
            }
            match level {
                // SAFETY: an engine takes a level only after `is_available`.
                #[cfg(target_arch = "x86_64")]
                $crate::simd::SimdLevel::Avx512Vnni => unsafe { vnni($($arg),*) },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                $crate::simd::SimdLevel::Avx512 => unsafe { avx512($($arg),*) },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                $crate::simd::SimdLevel::Avx2 => unsafe { avx2($($arg),*) },
                _ => $body::<$crate::simd::Array16, $crate::simd::ArrayDot>($($arg),*),
            }
        }
    };
}
pub(crate) use dispatch;

#[cfg(test)]
mod tests {
    use super::*;

    #[inline(always)]
    fn exp_body<L: Lanes, D: ByteDot>(x: &[f32; 16]) -> [f32; 16] {
        L::load(x).exp().array()
    }
    dispatch!(fn exp => exp_body(x: &[f32; 16]) -> [f32; 16]);

    #[inline(always)]
    fn sum_body<L: Lanes, D: ByteDot>(x: &[f32; 16]) -> (f32, f32) {
        (L::load(x).sum(), L::load(x).most())
    }
    dispatch!(fn sum_and_most => sum_body(x: &[f32; 16]) -> (f32, f32));

    #[inline(always)]
    fn dot_body<L: Lanes, D: ByteDot>(w: &[u8; 64], a: [i8; 4], offset: i32) -> [f32; 16] {
        let mut out = [0.0; 16];
        D::zero().add_dot(w, a).add_dot(w, a).less(offset, &mut out);
        out
    }
    dispatch!(fn dot => dot_body(w: &[u8; 64], a: [i8; 4], offset: i32) -> [f32; 16]);

    fn levels() -> impl Iterator<Item = SimdLevel> {
        SimdLevel::ALL.into_iter().filter(|l| l.is_available())
    }

    #[test]
    fn exponentials_are_accurate_at_every_level() {
        for level in levels() {
            for i in 0..10_900 {
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
        for level in levels() {
            let x: [f32; 16] = std::array::from_fn(|i| ((i * 7) % 16) as f32 - 8.0);
            assert_eq!(sum_and_most(level, &x), (-8.0, 7.0));
        }
    }

    /// The extremes are where the saturating instruction would be wrong.
    #[test]
    fn products_of_bytes_are_exact_at_every_level() {
        for level in levels() {
            for activation in [[127; 4], [-127; 4], [1, -2, 127, -127]] {
                let weights: [u8; 64] =
                    std::array::from_fn(|i| if i < 32 { 255 } else { (i * 37) as u8 });
                let found = dot(level, &weights, activation, 1000);
                for (found, weights) in found.iter().zip(weights.as_chunks::<4>().0) {
                    let products = weights.iter().zip(activation);
                    let sum: i32 = products.map(|(w, a)| i32::from(*w) * i32::from(a)).sum();
                    assert_eq!(*found, (2 * sum - 1000) as f32, "{level:?}");
                }
            }
        }
    }
}
