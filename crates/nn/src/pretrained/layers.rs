//! Layers that GPT-2, Qwen2 and BERT share, built directly from the tensors of a checkpoint or drawn at random.
//!
//! Activations are `[batch * length, width]`, as in [`crate::lm::t5`].

use std::path::{Path, PathBuf};

use burn::module::{Module, Param};
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Int, Tensor, TensorData};

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

use crate::lm::pass::ForwardPass;
use crate::lm::rows::ids_1d;
use crate::lm::t5::normal_values;
use crate::precision::{Product, ProductPrecision};
use radarllm_inference::checkpoint::{CheckpointError, HostTensor, NamedTensors};
use radarllm_inference::lm::LmError;

/// `x W + b`, with an adapter `x W + b + alpha / rank drop(x) A B`.
#[derive(Module, Debug)]
pub struct Linear {
    /// `[in, out]`.
    pub weight: Param<Tensor<2>>,
    /// `[out]`.
    pub bias: Option<Param<Tensor<1>>>,
    /// Low-rank adapter.
    pub lora: Option<Lora>,
}

/// Settings of low-rank adapters: Hu et al., *LoRA*, 2021; the paper's values are the defaults.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LoraConfig {
    /// Inner width r.
    pub rank: usize,
    /// The adapter's output is scaled by `alpha / rank`.
    pub alpha: f64,
    /// Dropout on the adapter's input, in training.
    pub dropout: f64,
}

impl Default for LoraConfig {
    fn default() -> Self {
        Self {
            rank: 8,
            alpha: 16.0,
            dropout: 0.05,
        }
    }
}

impl LoraConfig {
    /// Checks every number.
    ///
    /// # Errors
    /// [`LmError::Config`].
    pub fn validate(&self) -> Result<(), LmError> {
        let fail = |field, problem: String| Err(LmError::Config { field, problem });
        if self.rank == 0 || self.rank > 1024 {
            return fail(
                "lora.rank",
                format!("must be in 1..=1024, found {}", self.rank),
            );
        }
        if !(self.alpha.is_finite() && self.alpha > 0.0) {
            return fail(
                "lora.alpha",
                format!("must be positive, found {}", self.alpha),
            );
        }
        if !(0.0..1.0).contains(&self.dropout) {
            return fail(
                "lora.dropout",
                format!("must be in 0..1, found {}", self.dropout),
            );
        }
        Ok(())
    }
}

/// A low-rank adapter of a linear layer.
#[derive(Module, Debug)]
pub struct Lora {
    /// `[in, rank]`.
    pub a: Param<Tensor<2>>,
    /// `[rank, out]`.
    pub b: Param<Tensor<2>>,
    #[module(skip)]
    config: LoraConfig,
}

impl Lora {
    /// `alpha / rank`.
    fn scale(&self) -> f64 {
        self.config.alpha / self.config.rank as f64
    }
}

impl Linear {
    /// `[rows, in]` to `[rows, out]`.
    pub fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        self.forward_with(x, &mut ForwardPass::inference())
    }

    /// As `forward`; the adapter's dropout is applied if dropout is active in `drop`.
    pub(super) fn forward_with(&self, x: Tensor<2>, drop: &mut ForwardPass) -> Tensor<2> {
        let mut y = x.clone().product(self.weight.val(), drop.precision);
        if let Some(lora) = &self.lora {
            let inner = drop
                .apply_with(x, lora.config.dropout)
                .product(lora.a.val(), drop.precision);
            y = y + inner
                .product(lora.b.val(), drop.precision)
                .mul_scalar(lora.scale());
        }
        match &self.bias {
            Some(bias) => y + bias.val().unsqueeze::<2>(),
            None => y,
        }
    }

    /// Adds an adapter that does not change the output yet: A is uniform within `in^-0.5` and B is zero, as
    /// in PEFT's initialisation.
    pub fn adapt(&mut self, config: LoraConfig, rng: &mut ChaCha8Rng) {
        let [n_in, n_out] = self.weight.dims();
        let device = self.weight.val().device();
        let bound = (n_in as f32).powf(-0.5);
        let a = (0..n_in * config.rank)
            .map(|_| (2.0 * rng.random::<f32>() - 1.0) * bound)
            .collect();
        let a = Tensor::from_data(TensorData::new::<f32, _>(a, [n_in, config.rank]), &device);
        self.lora = Some(Lora {
            a: Param::from_tensor(a),
            b: Param::from_tensor(Tensor::zeros([config.rank, n_out], &device)),
            config,
        });
    }

    /// Merges the adapter into the weight; the function does not change.
    pub fn merge(&mut self) {
        if let Some(lora) = self.lora.take() {
            let scale = lora.scale();
            let product = lora.a.val().matmul(lora.b.val()).mul_scalar(scale);
            self.weight = Param::from_tensor(self.weight.val() + product);
        }
    }
}

/// Normalisation over the last axis. With an offset, it uses mean and variance; without one, only the root mean
/// square.
#[derive(Module, Debug)]
pub struct Norm {
    /// Gains, `[width]`.
    pub weight: Param<Tensor<1>>,
    /// Offsets, `[width]`.
    pub bias: Option<Param<Tensor<1>>>,
}

impl Norm {
    /// `[rows, width]` to the same shape.
    pub fn forward(&self, x: Tensor<2>, eps: f64) -> Tensor<2> {
        let x = match &self.bias {
            Some(_) => x.clone() - x.mean_dim(1),
            None => x,
        };
        let power = x.clone().square().mean_dim(1);
        let y = x * power.add_scalar(eps).sqrt().recip() * self.weight.val().unsqueeze::<2>();
        match &self.bias {
            Some(bias) => y + bias.val().unsqueeze::<2>(),
            None => y,
        }
    }
}

/// Embedding rows, indexed by id.
#[derive(Module, Debug)]
pub struct Embedding {
    /// `[rows, width]`.
    pub weight: Param<Tensor<2>>,
    /// Rows of ids that a checkpoint did not contain, `[added, width]`. They are stored separately, so that they can be
    /// trained while the others are frozen.
    pub added: Option<Param<Tensor<2>>>,
}

impl Embedding {
    /// `[ids]` to `[ids, width]`.
    pub fn forward(&self, ids: Tensor<1, Int>) -> Tensor<2> {
        let weight = self.weight.val();
        let Some(added) = &self.added else {
            return weight.select(0, ids);
        };
        let n = weight.dims()[0] as i32;
        let is_added = ids
            .clone()
            .greater_equal_elem(n)
            .float()
            .unsqueeze_dim::<2>(1);
        let old = weight.select(0, ids.clone().clamp_max(n - 1));
        let new = added.val().select(0, ids.sub_scalar(n).clamp_min(0));
        old * is_added.clone().neg().add_scalar(1.0) + new * is_added
    }

    /// Products `[rows, n]` of states `[rows, width]` with the first `n` rows.
    pub fn products(&self, x: Tensor<2>, n: usize, precision: ProductPrecision) -> Tensor<2> {
        let weight = self.weight.val();
        let n_old = weight.dims()[0];
        let product = |rows: Tensor<2>, n: usize| {
            let rows = if n < rows.dims()[0] {
                rows.narrow(0, 0, n)
            } else {
                rows
            };
            x.clone().product(rows.swap_dims(0, 1), precision)
        };
        let old = product(weight, n.min(n_old));
        match &self.added {
            Some(added) if n > n_old => Tensor::cat(vec![old, product(added.val(), n - n_old)], 1),
            _ => old,
        }
    }

    /// Appends `n` rows with the magnitude of the existing ones: uniform random numbers of the same mean square.
    pub fn extend(&mut self, n: usize, rng: &mut ChaCha8Rng) {
        let weight = self.weight.val();
        let width = weight.dims()[1];
        let device = weight.device();
        let power = weight.square().mean().into_scalar::<f32>();
        let half_width = (3.0 * power).sqrt();
        let values = (0..n * width)
            .map(|_| (2.0 * rng.random::<f32>() - 1.0) * half_width)
            .collect();
        let data = TensorData::new::<f32, _>(values, [n, width]);
        self.added = Some(Param::from_tensor(Tensor::from_data(data, &device)));
    }
}

/// `[batch * length, heads * width]` to `[batch, heads, length, width]`.
pub fn split_heads(x: Tensor<2>, [batch, length]: [usize; 2], heads: usize) -> Tensor<4> {
    let width = x.dims()[1] / heads;
    x.reshape([batch, length, heads, width]).swap_dims(1, 2)
}

/// Scaled dot-product attention over `[batch, heads, length, width]`. Returns `[batch * length, heads * width]`.
/// `bias` is added to the scores.
pub fn attend(q: Tensor<4>, k: Tensor<4>, v: Tensor<4>, bias: Option<Tensor<4>>) -> Tensor<2> {
    attend_with(q, k, v, bias, &mut ForwardPass::inference())
}

/// As `attend`, with dropout on the attention weights.
pub(super) fn attend_with(
    q: Tensor<4>,
    k: Tensor<4>,
    v: Tensor<4>,
    bias: Option<Tensor<4>>,
    drop: &mut ForwardPass,
) -> Tensor<2> {
    let [batch, heads, length, width] = q.dims();
    let mut scores = q
        .product(k.swap_dims(2, 3), drop.precision)
        .mul_scalar((width as f64).powf(-0.5));
    if let Some(bias) = bias {
        scores = scores + bias;
    }
    drop.apply(softmax(scores, 3))
        .product(v, drop.precision)
        .swap_dims(1, 2)
        .reshape([batch * length, heads * width])
}

/// Keys and values `[batch, heads, columns, width]` of the columns computed so far, one pair per block.
#[derive(Clone, Debug, Default)]
pub struct Past {
    blocks: Vec<(Tensor<4>, Tensor<4>)>,
}

impl Past {
    /// Appends the newly computed columns of block `i` and returns all.
    pub fn extend(&mut self, i: usize, k: Tensor<4>, v: Tensor<4>) -> (Tensor<4>, Tensor<4>) {
        let all = match self.blocks.get(i) {
            Some((old_k, old_v)) => (
                Tensor::cat(vec![old_k.clone(), k], 2),
                Tensor::cat(vec![old_v.clone(), v], 2),
            ),
            None => (k, v),
        };
        if i < self.blocks.len() {
            self.blocks[i] = all.clone();
        } else {
            self.blocks.push(all.clone());
        }
        all
    }

    /// Keeps the given rows of the batch, in this order; rows may repeat.
    pub fn select(&mut self, rows: &[usize]) {
        for (k, v) in &mut self.blocks {
            let rows = ids_1d(rows.iter().map(|r| *r as i32).collect(), &k.device());
            *k = k.clone().select(0, rows.clone());
            *v = v.clone().select(0, rows);
        }
    }
}

enum Values {
    File(NamedTensors),
    /// Normally distributed numbers of standard deviation `std`, or `residual` for the products that end a residual
    /// branch of GPT-2. Gains are one and offsets are zero.
    Drawn {
        rng: Box<ChaCha8Rng>,
        std: f64,
        residual: f64,
    },
}

/// Provides a checkpoint's tensors by name. A requested tensor must exist with the shape that
/// the configuration specifies, so that a configuration alone never determines an allocation.
pub struct Loader {
    values: Values,
    /// The file that is named in errors.
    file: PathBuf,
    /// Whether linear weights are stored as `[out, in]`.
    transposed: bool,
    device: Device,
}

impl Loader {
    /// A checkpoint whose linear weights are stored as `[out, in]` or, if not `transposed`, as `[in, out]`.
    pub fn new(tensors: NamedTensors, file: &Path, transposed: bool, device: &Device) -> Self {
        Self {
            values: Values::File(tensors),
            file: file.into(),
            transposed,
            device: device.clone(),
        }
    }

    /// Draws requested tensors from `seed`. `std` is 0.02 in both papers. `residual` is the standard
    /// deviation of `c_proj`, which GPT-2 divides by the root of the number of residual branches.
    pub fn random(seed: u64, std: f64, residual: f64, device: &Device) -> Self {
        let rng = Box::new(ChaCha8Rng::seed_from_u64(seed));
        Self {
            values: Values::Drawn { rng, std, residual },
            file: PathBuf::new(),
            transposed: false,
            device: device.clone(),
        }
    }

    /// Whether a tensor of this name exists.
    pub fn has(&self, name: &str) -> bool {
        matches!(&self.values, Values::File(tensors) if tensors.contains_key(name))
    }

    fn take(&mut self, tensor: String, expected: &[usize]) -> Result<HostTensor, LmError> {
        let (path, expected) = (self.file.clone(), expected.to_vec());
        let tensors = match &mut self.values {
            Values::File(tensors) => tensors,
            Values::Drawn { rng, std, residual } => {
                let len = expected.iter().product();
                let values = match (expected.len(), tensor.ends_with(".bias")) {
                    (_, true) => vec![0.0; len],
                    (1, false) => vec![1.0; len],
                    _ if tensor.ends_with("c_proj.weight") => normal_values(rng, len, *residual),
                    _ => normal_values(rng, len, *std),
                };
                return Ok(HostTensor {
                    shape: expected,
                    values,
                });
            }
        };
        match tensors.remove(&tensor) {
            Some(found) if found.shape == expected => Ok(found),
            Some(found) => Err(CheckpointError::Shape {
                path,
                tensor,
                expected,
                found: found.shape,
            }
            .into()),
            None => Err(CheckpointError::MissingTensor {
                path,
                tensor,
                expected,
            }
            .into()),
        }
    }

    fn param<const D: usize>(&self, tensor: HostTensor, shape: [usize; D]) -> Param<Tensor<D>> {
        let data = TensorData::new(tensor.values, shape);
        Param::from_tensor(Tensor::from_data(data, &self.device))
    }

    /// `{name}.weight`.
    ///
    /// # Errors
    /// A missing tensor or a mismatched shape, here and below.
    pub fn embedding(&mut self, name: &str, shape: [usize; 2]) -> Result<Embedding, LmError> {
        let tensor = self.take(format!("{name}.weight"), &shape)?;
        let weight = self.param(tensor, shape);
        Ok(Embedding {
            weight,
            added: None,
        })
    }

    /// `{name}.weight` from `n_in` to `n_out`, and `{name}.bias`.
    ///
    /// # Errors
    /// See [`Self::embedding`].
    pub fn linear(
        &mut self,
        name: &str,
        [n_in, n_out]: [usize; 2],
        has_bias: bool,
    ) -> Result<Linear, LmError> {
        let tensor = if self.transposed {
            self.take(format!("{name}.weight"), &[n_out, n_in])?
                .transposed()
        } else {
            self.take(format!("{name}.weight"), &[n_in, n_out])?
        };
        let weight = self.param(tensor, [n_in, n_out]);
        let bias = has_bias.then(|| self.vector(format!("{name}.bias"), n_out));
        Ok(Linear {
            weight,
            bias: bias.transpose()?,
            lora: None,
        })
    }

    /// `{name}.weight` and `{name}.bias`, or, in old files, `{name}.gamma` and `{name}.beta`.
    ///
    /// # Errors
    /// See [`Self::embedding`].
    pub fn norm(&mut self, name: &str, width: usize, has_bias: bool) -> Result<Norm, LmError> {
        let old = format!("{name}.gamma");
        let [weight, bias] = if self.has(&old) {
            [old, format!("{name}.beta")]
        } else {
            [format!("{name}.weight"), format!("{name}.bias")]
        };
        let weight = self.vector(weight, width)?;
        let bias = has_bias.then(|| self.vector(bias, width)).transpose()?;
        Ok(Norm { weight, bias })
    }

    fn vector(&mut self, name: String, len: usize) -> Result<Param<Tensor<1>>, LmError> {
        let tensor = self.take(name, &[len])?;
        Ok(self.param(tensor, [len]))
    }

    /// Checks that no tensors remain except those that `is_known` accepts.
    ///
    /// # Errors
    /// [`CheckpointError::UnknownTensor`].
    pub fn finish(self, is_known: impl Fn(&str) -> bool) -> Result<(), LmError> {
        let Values::File(tensors) = self.values else {
            return Ok(());
        };
        match tensors.into_keys().find(|name| !is_known(name)) {
            Some(tensor) => Err(CheckpointError::UnknownTensor {
                path: self.file,
                tensor,
            }
            .into()),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lm::hf::read;

    fn wave<const D: usize>(shape: [usize; D], phase: f32, device: &Device) -> Tensor<D> {
        let n: usize = shape.iter().product();
        let values = (0..n).map(|i| (i as f32 * 0.9 + phase).sin()).collect();
        Tensor::from_data(TensorData::new::<f32, _>(values, shape), device)
    }

    /// An adapted layer from 3 to 4 with rank 2 and an adapter that changes the output.
    fn adapted(device: &Device) -> Linear {
        let mut linear = Linear {
            weight: Param::from_tensor(wave([3, 4], 0.1, device)),
            bias: Some(Param::from_tensor(wave([4], 0.2, device))),
            lora: None,
        };
        let config = LoraConfig {
            rank: 2,
            alpha: 3.0,
            dropout: 0.0,
        };
        linear.adapt(config, &mut ChaCha8Rng::seed_from_u64(1));
        if let Some(lora) = &mut linear.lora {
            lora.b = Param::from_tensor(wave([2, 4], 0.3, device));
        }
        linear
    }

    /// Central differences of a quadratic loss are exact except for rounding, about 1e-7 / 1e-2 of values near
    /// ten.
    #[test]
    fn gradients_of_an_adapter_are_those_of_finite_differences() {
        let device = &Device::flex().autodiff();
        let linear = adapted(device);
        let x = wave([5, 3], 0.4, device);
        let loss = |linear: &Linear| linear.forward(x.clone()).square().sum();
        let grads = loss(&linear).backward();
        let Some(lora) = &linear.lora else {
            panic!("adapted");
        };
        for is_a in [true, false] {
            let of = |lora: &Lora| if is_a { lora.a.val() } else { lora.b.val() };
            let found = read(of(lora).grad(&grads).unwrap());
            let shape = of(lora).dims();
            for (i, found) in found.iter().enumerate() {
                let at = |step: f32| {
                    let mut values = read(of(lora));
                    values[i] += step;
                    let moved = Tensor::from_data(TensorData::new(values, shape), device);
                    let mut linear = linear.clone();
                    if let Some(lora) = &mut linear.lora {
                        let place = if is_a { &mut lora.a } else { &mut lora.b };
                        *place = Param::from_tensor(moved);
                    }
                    loss(&linear).into_scalar::<f32>()
                };
                let expected = (at(1e-2) - at(-1e-2)) / 2e-2;
                let close = (found - expected).abs() < 1e-3 * (1.0 + expected.abs());
                assert!(close, "{is_a} {i}: {found} {expected}");
            }
        }
    }

    #[test]
    fn a_new_adapter_changes_nothing_and_a_merged_one_says_the_same() {
        let device = &Device::flex();
        let x = wave([5, 3], 0.4, device);
        let mut linear = adapted(device);
        let with = read(linear.forward(x.clone()));
        linear.merge();
        let merged = read(linear.forward(x.clone()));
        assert!(with.iter().zip(&merged).all(|(a, b)| (a - b).abs() < 1e-5));
        let mut fresh = linear.clone();
        fresh.adapt(LoraConfig::default(), &mut ChaCha8Rng::seed_from_u64(2));
        assert_eq!(read(fresh.forward(x)), merged);
    }

    /// Separately stored rows give the same table as rows stored together.
    #[test]
    fn added_rows_follow_the_others() {
        let device = &Device::flex();
        let mut apart = Embedding {
            weight: Param::from_tensor(wave([4, 3], 0.1, device)),
            added: None,
        };
        apart.extend(2, &mut ChaCha8Rng::seed_from_u64(1));
        let added = apart.added.as_ref().unwrap().val();
        let whole = Embedding {
            weight: Param::from_tensor(Tensor::cat(vec![apart.weight.val(), added], 0)),
            added: None,
        };
        let ids = || ids_1d(vec![5, 0, 4, 3, 3], device);
        assert_eq!(read(apart.forward(ids())), read(whole.forward(ids())));
        let x = wave([2, 3], 0.6, device);
        for n in 1..=6 {
            let (a, b) = (
                apart.products(x.clone(), n, ProductPrecision::F32),
                whole.products(x.clone(), n, ProductPrecision::F32),
            );
            assert_eq!((a.dims(), read(a)), (b.dims(), read(b)), "{n}");
        }
    }
}
