//! Vectors of AVX-512 and AVX2.
//!
//! These types must not be named outside this crate, because their methods are safe to call only on a processor that
//! has the instructions. [`SimdLevel`](crate::SimdLevel) passes them to kernels after it has checked the processor.

use std::arch::x86_64::*;

use num_complex::Complex32;

use crate::sealed::Sealed;
use crate::{ByteDot, Cell, SimdF32x16};

/// Calls intrinsics.
macro_rules! intrinsic {
    ($call:expr) => {{
        // SAFETY: the types of this module are reached only through `SimdLevel::run` and `run_bytes`, whose level was
        // made after the processor had been found to have the instructions. Pointers come from references to at least as
        // many bytes as are read or written; those of streaming stores are aligned to 64 bytes, as cells are.
        unsafe { $call }
    }};
}

/// One 512-bit register.
#[derive(Clone, Copy)]
pub(crate) struct Avx512(__m512);

impl Avx512 {
    /// Returns the even 128-bit quarters of `a` and `b`, and the odd ones.
    #[inline(always)]
    fn quarters(a: Self, b: Self) -> (Self, Self) {
        (
            Self(intrinsic!(_mm512_shuffle_f32x4::<0b10_00_10_00>(a.0, b.0))),
            Self(intrinsic!(_mm512_shuffle_f32x4::<0b11_01_11_01>(a.0, b.0))),
        )
    }
}

impl Sealed for Avx512 {}

impl SimdF32x16 for Avx512 {
    // 24 sums, 4 weights and 1 activation use 29 of 32 registers.
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
    unsafe fn stream(re: Self, im: Self, to: &mut Cell) {
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
        // Transpose 4 x 4 blocks within the 128-bit quarters. Quarter q of vector 4 g + c then contains column 4 q + c
        // of the four rows from 4 g on.
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
        // Then transpose the quarters.
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
    fn reduce_sum(self) -> f32 {
        intrinsic!(_mm512_reduce_add_ps(self.0))
    }
    #[inline(always)]
    fn reduce_max(self) -> f32 {
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
pub(crate) struct Avx2x2(__m256, __m256);

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
        // The shuffle works within 128-bit halves. `order` then restores the order of the quarters a0 b0 a1 b1.
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

impl Sealed for Avx2x2 {}

impl SimdF32x16 for Avx2x2 {
    // 8 sums, 2 weights and 1 activation use 11 of 16 registers.
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
    unsafe fn stream(re: Self, im: Self, to: &mut Cell) {
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
        // A loop, because a closure of an iterator is compiled without this level's instructions unless it is inlined.
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

/// Four bytes as one number, which is broadcast to all lanes.
#[inline(always)]
fn four(activation: [i8; 4]) -> i32 {
    i32::from_le_bytes(activation.map(|a| a as u8))
}

/// Sixteen sums in one register, computed with the VNNI instruction for products of bytes.
#[derive(Clone, Copy)]
pub(crate) struct VnniDot(__m512i);

impl Sealed for VnniDot {}

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
    fn store_minus(self, offset: i32, to: &mut [f32; 16]) {
        intrinsic!({
            let sum = _mm512_sub_epi32(self.0, _mm512_set1_epi32(offset));
            _mm512_storeu_ps(to.as_mut_ptr(), _mm512_cvtepi32_ps(sum));
        });
    }
}

/// Sixteen sums in one register. Bytes are widened first, because the instruction that multiplies bytes directly
/// saturates.
#[derive(Clone, Copy)]
pub(crate) struct Avx512Dot(__m512i);

impl Sealed for Avx512Dot {}

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
            // Bytes 0 and 2 of every four, then bytes 1 and 3.
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
    fn store_minus(self, offset: i32, to: &mut [f32; 16]) {
        VnniDot(self.0).store_minus(offset, to);
    }
}

/// Sixteen sums in two registers. Bytes are widened as in [`Avx512Dot`].
#[derive(Clone, Copy)]
pub(crate) struct Avx2Dot(__m256i, __m256i);

impl Sealed for Avx2Dot {}

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
    fn store_minus(self, offset: i32, to: &mut [f32; 16]) {
        intrinsic!({
            let offset = _mm256_set1_epi32(offset);
            let half = |sum| _mm256_cvtepi32_ps(_mm256_sub_epi32(sum, offset));
            _mm256_storeu_ps(to.as_mut_ptr(), half(self.0));
            _mm256_storeu_ps(to.as_mut_ptr().add(8), half(self.1));
        });
    }
}
