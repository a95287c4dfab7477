//! Vectors without vector instructions: arrays, compiled for the build target.

use num_complex::Complex32;

use crate::sealed::Sealed;
use crate::{ByteDot, SimdF32x16};

/// Sixteen floats in an array.
#[derive(Clone, Copy)]
pub(crate) struct Array16([f32; 16]);

impl Sealed for Array16 {}

impl Array16 {
    #[inline(always)]
    fn map2(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }
}

impl SimdF32x16 for Array16 {
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
/// Portable products of bytes.
#[derive(Clone, Copy)]
pub(crate) struct ArrayDot([i32; 16]);

impl Sealed for ArrayDot {}

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
    fn store_minus(self, offset: i32, to: &mut [f32; 16]) {
        *to = self.0.map(|sum| (sum - offset) as f32);
    }
}
