//! The tokenizer network between tubes and codes.

use burn::module::{Module, Param};
use burn::nn::{Initializer, LayerNorm, LayerNormConfig, Linear, LinearConfig};
use burn::tensor::activation::{relu, softmax};
use burn::tensor::{Device, Int, Tensor, TensorData};

use super::attention::{Cells, FactorisedLayer};
use super::batch::ClipBatch;
use super::point_conv::PointConv;
use radarllm_inference::tokenizer::config::{MAX_STEPS, TokenizerConfig};
use radarllm_inference::tokenizer::doppler_profile::PROFILE_DIM;
use radarllm_inference::tokenizer::grouping::{STEP_DIM, TUBE_DIM};

/// Added to the scores of masked keys.
const HIDDEN: f32 = -1e9;

/// Anchors' features, context and pooling.
#[derive(Module, Debug)]
pub struct TokenizerNet {
    point_conv: PointConv,
    tube_mlp: Linear,
    tube_statistics: Option<Linear>,
    /// Embedding of a cell without points, `[1, C]`.
    empty: Param<Tensor<2>>,
    /// Embedding of a masked cell, `[1, C]`.
    mask: Param<Tensor<2>>,
    anchor_in: Linear,
    anchor_out: Linear,
    step_in: Linear,
    /// Position in time, `[MAX_STEPS, C]`.
    time: Param<Tensor<2>>,
    layers: Vec<FactorisedLayer>,
    norm: LayerNorm,
    pool_scores: Linear,
    pool_out: Linear,
    /// Reduces the width of a cell, and joins the reduced cells of a step.
    per_anchor: Option<[Linear; 2]>,
    pool_step: Linear,
    /// Two layers over the step's velocity table. Their output is added after the anchors' context, so that
    /// no information about a masked anchor reaches its reconstruction.
    pool_profile: Option<[Linear; 2]>,
    merge: Linear,
    code_out: Linear,
    head_in: Linear,
    head_out: Linear,
    guidance: Option<Linear>,
    words: Option<Linear>,
    motion_codes: Option<Linear>,
    /// Codes, `[K, D]`; updated by moving averages unless they are trained by gradient.
    pub codebook: Param<Tensor<2>>,
}

/// The output of a forward pass.
pub struct TokenizerOutput {
    /// Context of every cell, `[B S A, C]`.
    pub cells: Tensor<2>,
    /// Features before quantization, `[B L, D]`.
    pub features: Tensor<2>,
}

impl TokenizerNet {
    /// Random weights, drawn from `device`'s generator.
    pub fn new(config: &TokenizerConfig, device: &Device) -> Self {
        let c = config.width;
        let normal = Initializer::Normal {
            mean: 0.0,
            std: 0.02,
        };
        let linear = |from: usize, to: usize| LinearConfig::new(from, to).init(device);
        let pooled = config.pool_queries * c;
        let narrow = config.per_anchor_channels();
        Self {
            point_conv: PointConv::new(c, device),
            tube_mlp: linear(c, c),
            tube_statistics: config.tube_statistics.then(|| linear(TUBE_DIM, c)),
            empty: normal.init([1, c], device),
            mask: normal.init([1, c], device),
            anchor_in: linear(3, c),
            anchor_out: linear(c, c),
            step_in: linear(STEP_DIM, c),
            time: normal.init([MAX_STEPS, c], device),
            layers: (0..config.layers)
                .map(|_| FactorisedLayer::new(c, config.heads, config.ffn_ratio, device))
                .collect(),
            norm: LayerNormConfig::new(c).init(device),
            pool_scores: linear(c, config.pool_queries),
            pool_out: linear(pooled, 2 * c),
            per_anchor: (narrow > 0).then(|| {
                [
                    linear(c, narrow),
                    linear(narrow * config.n_anchors(), 2 * c),
                ]
            }),
            pool_step: linear(STEP_DIM, 2 * c),
            pool_profile: config
                .doppler_profile
                .then(|| [linear(PROFILE_DIM, 2 * c), linear(2 * c, 2 * c)]),
            merge: linear(4 * c, 4 * c),
            code_out: linear(4 * c, config.code_dim),
            head_in: linear(c, c),
            head_out: linear(
                c,
                config.reconstruction_points * config.reconstruction_dim(),
            ),
            guidance: (config.guidance_dim > 0)
                .then(|| linear(config.code_dim, config.guidance_dim)),
            words: (config.caption_words > 0)
                .then(|| linear(config.code_dim, config.caption_words)),
            motion_codes: (config.motion_codes > 0)
                .then(|| linear(config.code_dim, config.motion_codes)),
            codebook: Initializer::Zeros.init([config.codebook_size, config.code_dim], device),
        }
    }

    /// Cells in context and features of every code of a padded batch.
    pub fn forward(&self, batch: &ClipBatch) -> TokenizerOutput {
        let device = self.empty.val().device();
        let (b, s, a) = (batch.n_clips, batch.n_steps, batch.n_anchors);
        let cells = Cells {
            n_clips: b,
            n_steps: s,
            n_anchors: a,
        };
        let steps = Tensor::<2>::from_data(
            TensorData::new(batch.steps.clone(), [b * s, STEP_DIM]),
            &device,
        );
        let mut x = self.embed(batch, &steps, &device);
        let key_bias: Vec<f32> = batch
            .step_valid
            .iter()
            .map(|v| (1.0 - v) * HIDDEN)
            .collect();
        let time_bias = Tensor::<5>::from_data(TensorData::new(key_bias, [b, 1, 1, 1, s]), &device);
        for layer in &self.layers {
            x = layer.forward(x, cells, &time_bias);
        }
        let context = self.norm.forward(x);
        let features = self.pool(context.clone(), batch, steps, &device);
        TokenizerOutput {
            cells: context,
            features,
        }
    }

    fn embed(&self, batch: &ClipBatch, steps: &Tensor<2>, device: &Device) -> Tensor<2> {
        let (b, s, a) = (batch.n_clips, batch.n_steps, batch.n_anchors);
        let mut rows = Vec::new();
        if let Some(tubes) = self.point_conv.forward(batch) {
            let mut tubes = self.tube_mlp.forward(relu(tubes));
            if let Some(linear) = &self.tube_statistics {
                let flat: Vec<f32> = batch.tube_statistics.concat();
                let data = TensorData::new(flat, [batch.tubes.len(), TUBE_DIM]);
                tubes = tubes + linear.forward(Tensor::from_data(data, device));
            }
            rows.push(tubes);
        }
        rows.push(self.empty.val());
        rows.push(self.mask.val());
        let source = TensorData::new(batch.cell_source.clone(), [b * s * a]);
        let x = Tensor::cat(rows, 0).select(0, Tensor::<1, Int>::from_data(source, device));
        let width = x.dims()[1];
        let flat: Vec<f32> = batch.anchors.concat();
        let n_positions = batch.anchors.len();
        let anchors = Tensor::<2>::from_data(TensorData::new(flat, [n_positions, 3]), device);
        let anchors = self
            .anchor_out
            .forward(relu(self.anchor_in.forward(anchors)));
        let anchors = match n_positions == a {
            true => anchors.reshape([1, 1, a, width]),
            false => anchors.reshape([b, s, a, width]),
        };
        let time = self
            .time
            .val()
            .slice([0..s, 0..width])
            .unsqueeze_dim::<3>(0);
        let step = self.step_in.forward(steps.clone()).reshape([b, s, width]) + time;
        let x = x.reshape([b, s, a, width]) + anchors + step.reshape([b, s, 1, width]);
        x.reshape([b * s * a, width])
    }

    /// Attention over the anchors that have points (over all if none has), pair-merge, code.
    fn pool(
        &self,
        context: Tensor<2>,
        batch: &ClipBatch,
        steps: Tensor<2>,
        device: &Device,
    ) -> Tensor<2> {
        let (n, a) = (batch.n_clips * batch.n_steps, batch.n_anchors);
        let [_, width] = context.dims();
        let scores = self.pool_scores.forward(context.clone());
        let queries = scores.dims()[1];
        let bias: Vec<f32> = batch
            .cell_filled
            .chunks_exact(a)
            .flat_map(|step| {
                let none = step.iter().all(|f| *f == 0.0);
                step.iter()
                    .map(move |f| if *f > 0.0 || none { 0.0 } else { HIDDEN })
            })
            .collect();
        let bias = Tensor::<3>::from_data(TensorData::new(bias, [n, 1, a]), device);
        let scores = scores.reshape([n, a, queries]).swap_dims(1, 2) + bias;
        let pooled = softmax(scores, 2).matmul(context.clone().reshape([n, a, width]));
        let mut step = self.pool_out.forward(pooled.reshape([n, queries * width]));
        if let Some([narrow, join]) = &self.per_anchor {
            let cells = relu(narrow.forward(context));
            let channels = cells.dims()[1];
            step = step + join.forward(cells.reshape([n, a * channels]));
        }
        if let Some([widen, join]) = &self.pool_profile {
            let data = TensorData::new(batch.profiles.clone(), [n, PROFILE_DIM]);
            let profile = Tensor::<2>::from_data(data, device);
            step = step + join.forward(relu(widen.forward(profile)));
        }
        // The person's position and movement are added again, because re-centring removed them from the cells.
        let step = relu(step + self.pool_step.forward(steps));
        let valid =
            Tensor::<2>::from_data(TensorData::new(batch.step_valid.clone(), [n, 1]), device);
        let pairs = (step * valid).reshape([n / 2, 4 * width]);
        self.code_out.forward(relu(self.merge.forward(pairs)))
    }

    /// Predicted points of cells, `[n, points, 3 or 4]`, in units of the radius around the anchor.
    pub fn reconstruct(&self, cells: Tensor<2>, points: usize) -> Tensor<3> {
        let n = cells.dims()[0];
        let flat = self.head_out.forward(relu(self.head_in.forward(cells)));
        let dim = flat.dims()[1] / points;
        flat.reshape([n, points, dim])
    }

    /// Features in the motion teacher's space, `[n, guidance_dim]`; `None` without a teacher.
    pub fn guide(&self, features: Tensor<2>) -> Option<Tensor<2>> {
        self.guidance
            .as_ref()
            .map(|linear| linear.forward(features))
    }

    /// Logit of every caption word, `[n, caption_words]`; `None` when none is predicted.
    pub fn word_logits(&self, features: Tensor<2>) -> Option<Tensor<2>> {
        self.words.as_ref().map(|linear| linear.forward(features))
    }

    /// Logit of every code of the motion teacher, `[n, motion_codes]`; `None` when none is predicted.
    pub fn motion_code_logits(&self, features: Tensor<2>) -> Option<Tensor<2>> {
        self.motion_codes
            .as_ref()
            .map(|linear| linear.forward(features))
    }
}
