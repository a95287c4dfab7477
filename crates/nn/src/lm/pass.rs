//! The differences between a forward pass in training and in inference: dropout, and the precision of matrix products.

use burn::tensor::Tensor;

use super::DropoutRng;
use crate::precision::ProductPrecision;

/// Training options of a language model's forward pass. Inference has none: no dropout, products in f32.
pub struct TrainingPass {
    /// Generator of dropout masks.
    pub dropout: DropoutRng,
    /// Precision of matrix products.
    pub precision: ProductPrecision,
}

impl TrainingPass {
    /// A pass with dropout masks from a seed.
    pub fn new(seed: u64, precision: ProductPrecision) -> Self {
        Self {
            dropout: DropoutRng::new(seed),
            precision,
        }
    }
}

/// Options of a forward pass, as passed to the layers.
pub(crate) struct ForwardPass<'a> {
    p: f64,
    rng: Option<&'a mut DropoutRng>,
    /// Precision of matrix products.
    pub(crate) precision: ProductPrecision,
}

impl<'a> ForwardPass<'a> {
    /// With dropout of probability `p` if `training` is given.
    pub(crate) fn new(p: f64, training: Option<&'a mut TrainingPass>) -> Self {
        let precision = training
            .as_ref()
            .map_or_else(Default::default, |t| t.precision);
        Self {
            p,
            rng: training.map(|t| &mut t.dropout),
            precision,
        }
    }

    /// No dropout, products in f32.
    pub(crate) fn inference() -> Self {
        Self::new(0.0, None)
    }

    /// Dropout in training, identity otherwise.
    pub(crate) fn apply<const D: usize>(&mut self, x: Tensor<D>) -> Tensor<D> {
        self.apply_with(x, self.p)
    }

    /// As `apply`, with another probability.
    pub(crate) fn apply_with<const D: usize>(&mut self, x: Tensor<D>, p: f64) -> Tensor<D> {
        match &mut self.rng {
            Some(rng) if p > 0.0 => {
                let mask = rng.mask(x.dims(), p, &x.device());
                x * mask
            }
            _ => x,
        }
    }
}
