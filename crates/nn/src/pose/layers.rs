//! Layers of the pose network: normalisation over the points that exist, and an LSTM.

use burn::module::{Module, Param};
use burn::nn::{Initializer, Linear, LinearConfig};
use burn::tensor::activation::{relu, sigmoid, softmax, tanh};
use burn::tensor::{Device, Tensor, TensorData};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

/// Added to a variance before its root is taken.
const EPSILON: f64 = 1e-5;
/// Weight of a batch in the running statistics.
const MOMENTUM: f64 = 0.1;
/// Share of the values that a training pass drops between the layers of an LSTM.
const LSTM_DROPOUT: f32 = 0.1;
/// Added to the score of a point that does not exist.
const MASKED: f64 = -1e9;

/// One pass of training: its random choices, and the statistics of the batch that inference needs later.
#[derive(Debug)]
pub struct PosePass {
    rng: ChaCha8Rng,
    /// Mean and variance of the channels by normalisation, in the order of the forward pass.
    seen: Vec<(Tensor<1>, Tensor<1>)>,
}

impl PosePass {
    /// A pass with the random choices of `seed`.
    pub fn new(seed: u64) -> Self {
        Self {
            rng: ChaCha8Rng::seed_from_u64(seed),
            seen: Vec::new(),
        }
    }

    /// The statistics that the pass has seen.
    pub(super) fn seen(self) -> Vec<(Tensor<1>, Tensor<1>)> {
        self.seen
    }
}

/// Batch normalisation over the rows that exist.
#[derive(Module, Debug)]
pub(super) struct MaskedNorm {
    gain: Param<Tensor<1>>,
    shift: Param<Tensor<1>>,
    /// Moving averages of the batches' statistics, which inference uses.
    running_mean: Param<Tensor<1>>,
    running_variance: Param<Tensor<1>>,
}

impl MaskedNorm {
    fn new(width: usize, device: &Device) -> Self {
        Self {
            gain: Initializer::Ones.init([width], device),
            shift: Initializer::Zeros.init([width], device),
            running_mean: Initializer::Zeros.init([width], device),
            running_variance: Initializer::Ones.init([width], device),
        }
    }

    /// `x` is `[rows, width]`, `exists` is `[rows, 1]` with ones and zeros.
    fn forward(&self, x: Tensor<2>, exists: &Tensor<2>, pass: Option<&mut PosePass>) -> Tensor<2> {
        let (centred, variance) = match pass {
            Some(pass) => {
                let n = exists.clone().sum().reshape([1, 1]).clamp_min(1.0);
                let mean = (x.clone() * exists.clone()).sum_dim(0) / n.clone();
                let centred = x - mean.clone();
                let variance = (centred.clone().square() * exists.clone()).sum_dim(0) / n;
                let flat = |t: &Tensor<2>| t.clone().without_autodiff().flatten::<1>(0, 1);
                pass.seen.push((flat(&mean), flat(&variance)));
                (centred, variance)
            }
            None => {
                let mean = self.running_mean.val().unsqueeze::<2>();
                (x - mean, self.running_variance.val().unsqueeze::<2>())
            }
        };
        let scale = self.gain.val().unsqueeze::<2>() / (variance + EPSILON).sqrt();
        centred * scale + self.shift.val().unsqueeze::<2>()
    }

    /// Moves the running statistics towards those of a batch.
    pub(super) fn follow(mut self, (mean, variance): (Tensor<1>, Tensor<1>)) -> Self {
        let blend = |old: Tensor<1>, new: Tensor<1>| {
            let device = old.device();
            let [old, new] = [old, new].map(|t| {
                let values = t.without_autodiff().into_data().try_into_vec::<f32>();
                values.unwrap_or_default()
            });
            let blended: Vec<f32> = old
                .iter()
                .zip(&new)
                .map(|(a, b)| a + MOMENTUM as f32 * (b - a))
                .collect();
            let n = blended.len();
            Tensor::from_data(TensorData::new(blended, [n]), &device)
        };
        self.running_mean = self.running_mean.map(|old| blend(old, mean));
        self.running_variance = self.running_variance.map(|old| blend(old, variance));
        self
    }
}

/// Linear map, normalisation, ReLU; the same for every row.
#[derive(Module, Debug)]
pub(super) struct NormLayer {
    linear: Linear,
    pub(super) norm: MaskedNorm,
}

impl NormLayer {
    pub(super) fn new(from: usize, to: usize, device: &Device) -> Self {
        Self {
            linear: LinearConfig::new(from, to).init(device),
            norm: MaskedNorm::new(to, device),
        }
    }

    /// `x` is `[rows, from]`, `exists` is `[rows, 1]`; returns `[rows, to]`.
    pub(super) fn forward(
        &self,
        x: Tensor<2>,
        exists: &Tensor<2>,
        pass: Option<&mut PosePass>,
    ) -> Tensor<2> {
        relu(self.norm.forward(self.linear.forward(x), exists, pass))
    }
}

/// Weighted sum over the points of a group, with weights by softmax over those that exist.
#[derive(Module, Debug)]
pub(super) struct Pool {
    score: Linear,
}

impl Pool {
    pub(super) fn new(width: usize, device: &Device) -> Self {
        Self {
            score: LinearConfig::new(width, 1).init(device),
        }
    }

    /// `x` is `[groups * size, width]`, `exists` is `[groups * size, 1]`; returns `[groups, width]`, zero for groups in
    /// which nothing exists.
    pub(super) fn forward(&self, x: Tensor<2>, exists: &Tensor<2>, size: usize) -> Tensor<2> {
        let [rows, width] = x.dims();
        let groups = rows / size;
        let exists = exists.clone().reshape([groups, size]);
        let scores = self.score.forward(x.clone()).reshape([groups, size]);
        let weights = softmax(scores + (exists.clone() - 1.0) * -MASKED, 1) * exists;
        let weighted = x.reshape([groups, size, width]) * weights.reshape([groups, size, 1]);
        weighted.sum_dim(1).reshape([groups, width])
    }
}

#[derive(Module, Debug)]
struct LstmLayer {
    input: Linear,
    hidden: Linear,
}

/// Several LSTM layers from zero state.
#[derive(Module, Debug)]
pub(super) struct Lstm {
    layers: Vec<LstmLayer>,
    #[module(skip)]
    width: usize,
}

impl Lstm {
    pub(super) fn new(width: usize, layers: usize, device: &Device) -> Self {
        let linear = || LinearConfig::new(width, 4 * width).init(device);
        let layer = |_| LstmLayer {
            input: linear(),
            hidden: linear(),
        };
        Self {
            layers: (0..layers).map(layer).collect(),
            width,
        }
    }

    /// `x` is `[clips, frames, width]`; returns the states of the last layer, of the same shape.
    pub(super) fn forward(&self, x: Tensor<3>, mut pass: Option<&mut PosePass>) -> Tensor<3> {
        let [n, frames, width] = x.dims();
        let device = x.device();
        let mut steps: Vec<Tensor<2>> = (0..frames)
            .map(|t| {
                x.clone()
                    .slice([0..n, t..t + 1, 0..width])
                    .reshape([n, width])
            })
            .collect();
        for (index, layer) in self.layers.iter().enumerate() {
            if let (true, Some(pass)) = (index > 0, pass.as_deref_mut()) {
                for step in &mut steps {
                    *step = step.clone() * kept(&mut pass.rng, [n, width], &device);
                }
            }
            let mut state = Tensor::<2>::zeros([n, self.width], &device);
            let mut cell = state.clone();
            for step in &mut steps {
                let sums = layer.input.forward(step.clone()) + layer.hidden.forward(state);
                let gate = |i: usize| sums.clone().slice([0..n, i * width..(i + 1) * width]);
                cell = sigmoid(gate(1)) * cell + sigmoid(gate(0)) * tanh(gate(2));
                state = sigmoid(gate(3)) * tanh(cell.clone());
                *step = state.clone();
            }
        }
        let steps: Vec<Tensor<3>> = steps
            .into_iter()
            .map(|s| s.reshape([n, 1, width]))
            .collect();
        Tensor::cat(steps, 1)
    }
}

/// Factors of a dropout: zero, or the inverse of the share that is kept.
fn kept(rng: &mut ChaCha8Rng, shape: [usize; 2], device: &Device) -> Tensor<2> {
    let factor = |_| match rng.random::<f32>() < LSTM_DROPOUT {
        true => 0.0,
        false => 1.0 / (1.0 - LSTM_DROPOUT),
    };
    let factors: Vec<f32> = (0..shape[0] * shape[1]).map(factor).collect();
    Tensor::from_data(TensorData::new(factors, shape), device)
}
