//! The precision of matrix products while a language model learns.
//!
//! Weights, their gradients' sums, norms, softmax and losses stay in f32; where a half precision is asked for, the factors of
//! a product are rounded to it, forward and backward, and the result goes on in f32 (Micikevicius et al., *Mixed Precision
//! Training*, ICLR 2018).

use burn::tensor::{Device, FloatDType, Tensor};
use serde::{Deserialize, Serialize};

/// ProductPrecision of the factors of matrix products.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ProductPrecision {
    /// 24 bits.
    #[default]
    F32,
    /// 8 bits, f32's range.
    Bf16,
    /// 11 bits, 6e-8 to 65,504: small gradients need a factor on the loss.
    F16,
}

impl ProductPrecision {
    /// Whether a processor computes in it; drivers differ.
    pub fn is_known_to(self, device: &Device) -> bool {
        match self {
            Self::F32 => true,
            Self::Bf16 => device.supports_dtype(FloatDType::BF16),
            Self::F16 => device.supports_dtype(FloatDType::F16),
        }
    }
}

/// Matrix products of the precision asked for.
pub(crate) trait Product {
    /// Product over the last two axes.
    fn product(self, other: Self, precision: ProductPrecision) -> Self;
}

impl<const D: usize> Product for Tensor<D> {
    fn product(self, other: Self, precision: ProductPrecision) -> Self {
        let half = match precision {
            ProductPrecision::F32 => return self.matmul(other),
            ProductPrecision::Bf16 => FloatDType::BF16,
            ProductPrecision::F16 => FloatDType::F16,
        };
        self.cast(half)
            .matmul(other.cast(half))
            .cast(FloatDType::F32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1 + 2^-9 is between two bf16 and two f16 apart; its square tells which factors were rounded.
    #[test]
    fn factors_are_rounded_and_gradients_come_back_in_f32() {
        let device = Device::flex().autodiff();
        let x = 1.0 + 2_f32.powi(-9);
        let square = |precision: ProductPrecision| {
            let a = Tensor::<2>::from_data([[x]], &device).require_grad();
            let y = (a.clone()).product(Tensor::from_data([[x]], &device), precision);
            let grads = y.backward();
            let slope = a.grad(&grads).map(|g| g.into_scalar::<f32>());
            (y.into_scalar::<f32>(), slope)
        };
        assert_eq!(square(ProductPrecision::F32), (x * x, Some(x)));
        assert_eq!(square(ProductPrecision::Bf16), (1.0, Some(1.0)));
        // 1 + 2^-8 + 2^-18, rounded to 1 + 2^-8.
        assert_eq!(
            square(ProductPrecision::F16),
            (1.0 + 2_f32.powi(-8), Some(x))
        );
    }
}
