//! The precision of matrix products while a language model learns.
//!
//! Weights, their gradients' sums, norms, softmax and losses stay in f32; where a half precision is asked for, the factors of
//! a product are rounded to it, forward and backward, and the result goes on in f32 (Micikevicius et al., *Mixed Precision
//! Training*, ICLR 2018).

use std::cell::Cell;

use burn::tensor::{Device, FloatDType, Tensor};
use serde::{Deserialize, Serialize};

/// Precision of the factors of matrix products.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// 24 bits.
    #[default]
    F32,
    /// 8 bits, f32's range.
    Bf16,
    /// 11 bits, 6e-8 to 65,504: small gradients need a factor on the loss.
    F16,
}

thread_local! {
    static CURRENT: Cell<Precision> = const { Cell::new(Precision::F32) };
}

impl Precision {
    /// Whether a processor computes in it; drivers differ.
    pub fn is_known_to(self, device: &Device) -> bool {
        match self {
            Self::F32 => true,
            Self::Bf16 => device.supports_dtype(FloatDType::BF16),
            Self::F16 => device.supports_dtype(FloatDType::F16),
        }
    }

    /// Runs `work` with this precision in this thread.
    pub fn during<R>(self, work: impl FnOnce() -> R) -> R {
        /// Restores the precision before, also when `work` panics.
        struct Restore(Precision);
        impl Drop for Restore {
            fn drop(&mut self) {
                CURRENT.set(self.0);
            }
        }
        let _restore = Restore(CURRENT.replace(self));
        work()
    }
}

/// Matrix products of the precision asked for.
pub(crate) trait Product {
    /// Product over the last two axes, in the precision of [`Precision::during`].
    fn product(self, other: Self) -> Self;
}

impl<const D: usize> Product for Tensor<D> {
    fn product(self, other: Self) -> Self {
        let half = match CURRENT.get() {
            Precision::F32 => return self.matmul(other),
            Precision::Bf16 => FloatDType::BF16,
            Precision::F16 => FloatDType::F16,
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
        let square = |precision: Precision| {
            precision.during(|| {
                let a = Tensor::<2>::from_data([[x]], &device).require_grad();
                let y = a.clone().product(Tensor::from_data([[x]], &device));
                let grads = y.backward();
                let slope = a.grad(&grads).map(|g| g.into_scalar::<f32>());
                (y.into_scalar::<f32>(), slope)
            })
        };
        assert_eq!(square(Precision::F32), (x * x, Some(x)));
        assert_eq!(square(Precision::Bf16), (1.0, Some(1.0)));
        // 1 + 2^-8 + 2^-18, rounded to 1 + 2^-8.
        assert_eq!(square(Precision::F16), (1.0 + 2_f32.powi(-8), Some(x)));
    }

    #[test]
    fn the_precision_ends_with_its_work() {
        let inside = Precision::F16.during(|| Precision::Bf16.during(|| CURRENT.get()));
        assert_eq!((inside, CURRENT.get()), (Precision::Bf16, Precision::F32));
        let result = std::panic::catch_unwind(|| Precision::F16.during(|| panic!("on purpose")));
        assert!(result.is_err());
        assert_eq!(CURRENT.get(), Precision::F32);
    }
}
