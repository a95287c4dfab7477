//! Dot products of bytes, for networks with int8 weights.

use crate::sealed::Sealed;

/// Sixteen sums of products of bytes. Results are bit-identical on every level, because the sums are integers.
///
/// A kernel receives an implementation from [`SimdLevel::run_bytes`](crate::SimdLevel::run_bytes); nothing else can name
/// one.
pub trait ByteDot: Copy + Sealed {
    /// Sixteen zeros.
    fn zero() -> Self;
    /// Adds to each lane the product of its four weights, 0..=255, with the four bytes of
    /// `activation`, -127..=127.
    fn add_dot(self, weights: &[u8; 64], activation: [i8; 4]) -> Self;
    /// Stores the sums minus `offset` as floats.
    fn store_minus(self, offset: i32, to: &mut [f32; 16]);
}

#[cfg(test)]
mod tests {
    use crate::{ByteDot, SimdF32x16, SimdLevel, dispatch};

    #[inline(always)]
    #[expect(
        clippy::extra_unused_type_parameters,
        reason = "dispatched like bodies that compute with vectors"
    )]
    fn dot_body<L: SimdF32x16, D: ByteDot>(w: &[u8; 64], a: [i8; 4], offset: i32) -> [f32; 16] {
        let mut out = [0.0; 16];
        D::zero()
            .add_dot(w, a)
            .add_dot(w, a)
            .store_minus(offset, &mut out);
        out
    }
    dispatch!(bytes fn dot => dot_body(w: &[u8; 64], a: [i8; 4], offset: i32) -> [f32; 16]);

    /// At these extreme values, an instruction that saturates would give a wrong result.
    #[test]
    fn products_of_bytes_are_exact_at_every_level() {
        for level in SimdLevel::available() {
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
