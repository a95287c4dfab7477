//! Products of bytes ([`ByteDot`]) beside vectors of sixteen floats ([`radarllm_simd::Lanes`]).
//!
//! An instruction set is chosen once per [`crate::Engine`] at run time; [`dispatch!`] compiles a
//! generic body for each. Results are equal within rounding between float implementations and to
//! the bit between those of bytes, whose sums are integers.

use crate::EngineError;

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
            Self::Avx512 => radarllm_simd::SimdLevel::Avx512.is_available(),
            Self::Avx2 => radarllm_simd::SimdLevel::Avx2.is_available(),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512Vnni => false,
            Self::Portable => true,
        }
    }

    /// Refuses a level that this machine cannot run.
    pub(crate) fn require(self) -> Result<(), EngineError> {
        if self.is_available() {
            return Ok(());
        }
        Err(EngineError::Option {
            field: "level",
            problem: format!("this machine lacks {self:?}"),
        })
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
pub(crate) use x86::{Avx2Dot, Avx512Dot, VnniDot};

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use super::ByteDot;

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
                $body::<radarllm_simd::lanes::Avx512, $crate::simd::VnniDot>($($arg),*)
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma")]
            fn avx512($($arg: $ty),*) $(-> $out)? {
                $body::<radarllm_simd::lanes::Avx512, $crate::simd::Avx512Dot>($($arg),*)
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2($($arg: $ty),*) $(-> $out)? {
                $body::<radarllm_simd::lanes::Avx2x2, $crate::simd::Avx2Dot>($($arg),*)
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
                _ => $body::<radarllm_simd::lanes::Array16, $crate::simd::ArrayDot>($($arg),*),
            }
        }
    };
}
pub(crate) use dispatch;

#[cfg(test)]
mod tests {
    use radarllm_simd::Lanes;

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
    #[expect(
        clippy::extra_unused_type_parameters,
        reason = "dispatched like bodies that compute with lanes"
    )]
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
