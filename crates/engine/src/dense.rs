//! Linear layers of networks that are so small that they need no vector instructions.

use crate::EngineError;
use crate::weights::Taker;

/// A linear layer.
pub(crate) struct Dense {
    /// `[from, to]`.
    weight: Vec<f32>,
    bias: Vec<f32>,
}

impl Dense {
    /// Takes the layer `name` out of a network's weights.
    ///
    /// # Errors
    /// If the weights or the bias are missing or have another shape, or a value is not finite.
    pub(crate) fn take(
        weights: &mut Taker,
        name: &str,
        from: usize,
        to: usize,
    ) -> Result<Self, EngineError> {
        Ok(Self {
            weight: weights.take(&format!("{name}.weight"), &[from, to])?,
            bias: weights.take(&format!("{name}.bias"), &[to])?,
        })
    }

    /// `x W + b`.
    pub(crate) fn apply(&self, x: &[f32]) -> Vec<f32> {
        let mut out = self.bias.clone();
        for (value, row) in x.iter().zip(self.weight.chunks_exact(out.len())) {
            for (sum, weight) in out.iter_mut().zip(row) {
                *sum += value * weight;
            }
        }
        out
    }

    /// `max(x W + b, 0)`.
    pub(crate) fn apply_relu(&self, x: &[f32]) -> Vec<f32> {
        let mut out = self.apply(x);
        out.iter_mut().for_each(|v| *v = v.max(0.0));
        out
    }
}
