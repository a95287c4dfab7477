//! The precision of matrix products when a language model is trained.
//!
//! Weights, sums of gradients, norms, softmax and losses are always in f32. If half precision is requested, the factors
//! of a product are rounded to it, in the forward and the backward pass, and the result is kept in f32 (Micikevicius et
//! al., *Mixed Precision Training*, ICLR 2018).

use burn::tensor::{Device, FloatDType, Tensor};
use serde::{Deserialize, Serialize};

/// Precision of the factors of matrix products.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ProductPrecision {
    /// 24-bit significand.
    #[default]
    F32,
    /// 8-bit significand, with the range of f32.
    Bf16,
    /// 11-bit significand, 6e-8 to 65,504: small gradients need loss scaling.
    F16,
}

impl ProductPrecision {
    /// Whether a device supports this precision, which depends on its driver.
    pub fn is_known_to(self, device: &Device) -> bool {
        match self {
            Self::F32 => true,
            Self::Bf16 => device.supports_dtype(FloatDType::BF16),
            Self::F16 => device.supports_dtype(FloatDType::F16),
        }
    }
}

/// Matrix products in the requested precision.
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

    /// 1 + 2^-9 is between two adjacent bf16 numbers and two f16 steps above 1. Its square shows which factors were
    /// rounded.
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
