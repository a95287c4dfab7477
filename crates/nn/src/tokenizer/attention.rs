//! Transformer layer over (step, anchor), factorised: attention among the anchors of a step, then
//! among the steps of an anchor, then a feed-forward part. Pre-norm, residual.

use burn::module::Module;
use burn::nn::{LayerNorm, LayerNormConfig, Linear, LinearConfig};
use burn::tensor::activation::{relu, softmax};
use burn::tensor::{Device, Tensor};

/// Axis along which cells attend to one another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Axis {
    Anchors,
    Steps,
}

/// Sizes of a batch of cells: clips, steps, anchors.
#[derive(Clone, Copy, Debug)]
pub struct Cells {
    /// B.
    pub n_clips: usize,
    /// S.
    pub n_steps: usize,
    /// A.
    pub n_anchors: usize,
}

#[derive(Module, Debug)]
struct SelfAttention {
    norm: LayerNorm,
    // Three maps rather than one map to 3 C, because the gradient of a slice is a padded copy of the whole.
    query: Linear,
    key: Linear,
    value: Linear,
    out: Linear,
    #[module(skip)]
    heads: usize,
}

impl SelfAttention {
    fn new(width: usize, heads: usize, device: &Device) -> Self {
        Self {
            norm: LayerNormConfig::new(width).init(device),
            query: LinearConfig::new(width, width).init(device),
            key: LinearConfig::new(width, width).init(device),
            value: LinearConfig::new(width, width).init(device),
            out: LinearConfig::new(width, width).init(device),
            heads,
        }
    }

    /// `x` is `[B S A, C]`; `bias` is added to the scores, `[B, 1, 1, 1, keys]`.
    fn forward(
        &self,
        x: Tensor<2>,
        cells: Cells,
        axis: Axis,
        bias: Option<Tensor<5>>,
    ) -> Tensor<2> {
        let [n, width] = x.dims();
        let head_dim = width / self.heads;
        let Cells {
            n_clips,
            n_steps,
            n_anchors,
        } = cells;
        let x = self.norm.forward(x);
        let part = |linear: &Linear| {
            let part = linear.forward(x.clone());
            let part = part.reshape([n_clips, n_steps, n_anchors, self.heads, head_dim]);
            // Products accept strided operands, so these views need no copy.
            match axis {
                Axis::Anchors => part.permute([0, 1, 3, 2, 4]),
                Axis::Steps => part.permute([0, 2, 3, 1, 4]),
            }
        };
        let scale = 1.0 / (head_dim as f64).sqrt();
        let mut scores = (part(&self.query) * scale).matmul(part(&self.key).swap_dims(3, 4));
        if let Some(bias) = bias {
            scores = scores + bias;
        }
        let mixed = softmax(scores, 4).matmul(part(&self.value));
        let mixed = match axis {
            Axis::Anchors => mixed.permute([0, 1, 3, 2, 4]),
            Axis::Steps => mixed.permute([0, 3, 1, 2, 4]),
        };
        self.out.forward(mixed.reshape([n, width]))
    }
}

/// One factorised layer.
#[derive(Module, Debug)]
pub struct FactorisedLayer {
    space: SelfAttention,
    time: SelfAttention,
    norm: LayerNorm,
    widen: Linear,
    narrow: Linear,
}

impl FactorisedLayer {
    /// A layer with random weights.
    pub fn new(width: usize, heads: usize, ffn_ratio: usize, device: &Device) -> Self {
        Self {
            space: SelfAttention::new(width, heads, device),
            time: SelfAttention::new(width, heads, device),
            norm: LayerNormConfig::new(width).init(device),
            widen: LinearConfig::new(width, ffn_ratio * width).init(device),
            narrow: LinearConfig::new(ffn_ratio * width, width).init(device),
        }
    }

    /// `x`: `[B S A, C]`; `time_bias`: `[B, 1, 1, 1, S]`, a large negative number at padded steps.
    pub fn forward(&self, x: Tensor<2>, cells: Cells, time_bias: &Tensor<5>) -> Tensor<2> {
        let x = x.clone() + self.space.forward(x, cells, Axis::Anchors, None);
        let x = x.clone()
            + self
                .time
                .forward(x, cells, Axis::Steps, Some(time_bias.clone()));
        let hidden = relu(self.widen.forward(self.norm.forward(x.clone())));
        x + self.narrow.forward(hidden)
    }
}
