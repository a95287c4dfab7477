//! AdamW over the parameters of a module, with one pass over memory per parameter.
//!
//! The optimiser of the framework makes about ten whole-tensor temporaries per parameter and does not expose its
//! moments. This one keeps the moments as named arrays, which are written to a checkpoint unchanged. On a graphics
//! processor, gradients, moments and weights remain in its memory. The same update is done there by tensor operations,
//! which the driver fuses, and only one number per parameter is copied back, for the gradient norm.

use std::collections::BTreeMap;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Gradients, Tensor};
use radarllm_inference::checkpoint::NamedTensors;
use serde::{Deserialize, Serialize};

use crate::values::{Values, host};

/// Constants of AdamW (Loshchilov and Hutter, 2019, algorithm 2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AdamWConfig {
    /// Decay of the first moment.
    pub beta_1: f64,
    /// Decay of the second moment.
    pub beta_2: f64,
    /// Added to the square root of the second moment.
    pub epsilon: f64,
    /// Decoupled weight decay, multiplied by the learning rate. It does not apply to vectors and scalars.
    pub weight_decay: f64,
    /// Maximum norm of the whole gradient; larger gradients are clipped. 0 disables clipping.
    pub clip_norm: f64,
}

impl Default for AdamWConfig {
    fn default() -> Self {
        Self {
            beta_1: 0.9,
            beta_2: 0.99,
            epsilon: 1e-8,
            weight_decay: 0.01,
            clip_norm: 1.0,
        }
    }
}

/// Update rule of one parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParamRule {
    /// Factor on the learning rate; 0 freezes the parameter.
    pub lr_scale: f64,
    /// Factor on the weight decay.
    pub decay_scale: f64,
}

impl ParamRule {
    /// Rule by shape: weight decay applies to matrices, but not to vectors (biases, norms).
    pub fn by_shape(shape: &[usize]) -> Self {
        Self {
            lr_scale: 1.0,
            decay_scale: if shape.len() >= 2 { 1.0 } else { 0.0 },
        }
    }
}

/// Sum of the gradients of one or more batches, by parameter path.
pub struct GradientSum {
    grads: BTreeMap<String, Values>,
    n_batches: usize,
    /// Factor by which the losses were multiplied.
    loss_scale: f64,
}

impl Default for GradientSum {
    fn default() -> Self {
        Self::scaled(1.0)
    }
}

impl GradientSum {
    /// An empty sum for gradients of losses that are multiplied by a factor.
    pub fn scaled(loss_scale: f64) -> Self {
        Self {
            grads: BTreeMap::new(),
            n_batches: 0,
            loss_scale,
        }
    }

    /// Divisor that turns the sum into the mean gradient.
    fn divisor(&self) -> f64 {
        self.n_batches.max(1) as f64 * self.loss_scale
    }

    /// Adds the gradients of one batch.
    pub fn add<M: Module>(&mut self, model: &M, grads: Gradients) {
        struct Visit<'a> {
            path: Vec<String>,
            grads: Gradients,
            sum: &'a mut BTreeMap<String, Values>,
        }
        impl ModuleVisitor for Visit<'_> {
            fn enter_module(&mut self, name: &str, _container: &str) {
                self.path.push(name.to_string());
            }
            fn exit_module(&mut self, _name: &str, _container: &str) {
                self.path.pop();
            }
            fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
                let tensor = param.base();
                if !tensor.is_require_grad() {
                    return;
                }
                let Some(grad) = tensor.grad_remove(&mut self.grads) else {
                    return;
                };
                let path = self.path.join(".");
                let grad = Values::of(grad);
                let sum = match self.sum.remove(&path) {
                    Some(sum) => sum.plus(grad),
                    None => grad,
                };
                self.sum.insert(path, sum);
            }
        }
        model.visit(&mut Visit {
            path: Vec::new(),
            grads,
            sum: &mut self.grads,
        });
        self.n_batches += 1;
    }

    /// Number of batches added.
    pub fn n_batches(&self) -> usize {
        self.n_batches
    }

    /// L2 norm of the mean gradient.
    pub fn norm(&self) -> f64 {
        // Sums of blocks in f32 can be vectorised. Adding the block sums in f64 keeps the total accurate enough.
        let square = |g: &[f32]| -> f64 {
            g.chunks(256)
                .map(|block| f64::from(block.iter().map(|x| x * x).sum::<f32>()))
                .sum()
        };
        let mut sum = 0.0;
        let mut squares = Vec::new();
        for grad in self.grads.values() {
            match grad {
                Values::Cpu(values) => sum += square(values),
                Values::Gpu(tensor) => squares.push(tensor.clone().square().sum()),
            }
        }
        if !squares.is_empty() {
            // All squares are copied back together, so that the processor is waited for only once.
            let squares = host(Tensor::cat(squares, 0).into_data());
            sum += squares.into_iter().map(f64::from).sum::<f64>();
        }
        sum.sqrt() / self.divisor()
    }
}

/// State of AdamW: moments by parameter path, and the number of updates.
#[derive(Clone, Debug, Default)]
pub struct AdamW {
    moments: BTreeMap<String, Moments>,
    n_updates: u64,
}

#[derive(Clone, Debug)]
struct Moments {
    shape: Vec<usize>,
    first: Values,
    second: Values,
}

impl AdamW {
    /// Performs one update with the mean of the accumulated gradients; `norm` is [`GradientSum::norm`].
    pub fn step<M: Module>(
        &mut self,
        config: &AdamWConfig,
        learning_rate: f64,
        rule: &dyn Fn(&str, &[usize]) -> ParamRule,
        model: M,
        grads: GradientSum,
        norm: f64,
    ) -> M {
        self.n_updates += 1;
        let clip = if config.clip_norm > 0.0 && norm > config.clip_norm {
            config.clip_norm / norm
        } else {
            1.0
        };
        let mut mapper = Update {
            path: Vec::new(),
            scale: (clip / grads.divisor()) as f32,
            grads: grads.grads,
            config,
            learning_rate,
            rule,
            correction_1: 1.0 - config.beta_1.powf(self.n_updates as f64),
            correction_2: 1.0 - config.beta_2.powf(self.n_updates as f64),
            moments: &mut self.moments,
        };
        model.map(&mut mapper)
    }

    /// Returns the moments as named arrays (`first.<path>`, `second.<path>`) and the number of updates.
    pub fn state(&self) -> (NamedTensors, u64) {
        let mut out = NamedTensors::new();
        for (path, m) in &self.moments {
            out.insert(format!("first.{path}"), m.first.to_host(&m.shape));
            out.insert(format!("second.{path}"), m.second.to_host(&m.shape));
        }
        (out, self.n_updates)
    }

    /// Restores the state from the result of [`Self::state`]. `shapes` holds the shape of each parameter.
    ///
    /// # Errors
    /// Returns the name of the first array that does not belong to a parameter or does not have its shape.
    pub fn from_state(
        mut tensors: NamedTensors,
        n_updates: u64,
        shapes: &BTreeMap<String, Vec<usize>>,
    ) -> Result<Self, String> {
        let mut moments = BTreeMap::new();
        let paths: Vec<String> = tensors
            .keys()
            .filter_map(|k| k.strip_prefix("first."))
            .map(String::from)
            .collect();
        for path in paths {
            let first = tensors.remove(&format!("first.{path}"));
            let second = tensors.remove(&format!("second.{path}"));
            match (shapes.get(&path), first, second) {
                (Some(shape), Some(a), Some(b)) if a.shape == *shape && b.shape == *shape => {
                    let m = Moments {
                        shape: a.shape,
                        first: Values::Cpu(a.values),
                        second: Values::Cpu(b.values),
                    };
                    moments.insert(path, m);
                }
                _ => return Err(format!("first.{path}")),
            }
        }
        match tensors.into_keys().next() {
            Some(name) => Err(name),
            None => Ok(Self { moments, n_updates }),
        }
    }
}

struct Update<'a> {
    path: Vec<String>,
    grads: BTreeMap<String, Values>,
    scale: f32,
    config: &'a AdamWConfig,
    learning_rate: f64,
    rule: &'a dyn Fn(&str, &[usize]) -> ParamRule,
    correction_1: f64,
    correction_2: f64,
    moments: &'a mut BTreeMap<String, Moments>,
}

impl ModuleMapper for Update<'_> {
    fn enter_module(&mut self, name: &str, _container: &str) {
        self.path.push(name.to_string());
    }
    fn exit_module(&mut self, _name: &str, _container: &str) {
        self.path.pop();
    }
    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let path = self.path.join(".");
        let Some(grad) = self.grads.remove(&path) else {
            return param;
        };
        let shape = param.lazy_shape().to_vec();
        let rule = (self.rule)(&path, &shape);
        if rule.lr_scale == 0.0 {
            return param;
        }
        let (id, tensor, mapper) = param.consume();
        let tensor = tensor.without_autodiff();
        let device = tensor.device();
        let moments = (self.moments.remove(&path)).unwrap_or_else(|| Moments {
            shape: shape.clone(),
            first: Values::zeros_like(&grad),
            second: Values::zeros_like(&grad),
        });
        let lr = self.learning_rate * rule.lr_scale;
        let update = Step {
            scale: self.scale,
            beta_1: self.config.beta_1 as f32,
            beta_2: self.config.beta_2 as f32,
            epsilon: self.config.epsilon as f32,
            keep: (1.0 - lr * self.config.weight_decay * rule.decay_scale) as f32,
            step: (lr / self.correction_1) as f32,
            inverse_c2: (1.0 / self.correction_2) as f32,
        };
        let (first, second, updated);
        match grad {
            Values::Cpu(grad) => {
                let mut data = tensor.into_data();
                let (mut m, mut v) = (moments.first.into_vec(), moments.second.into_vec());
                if let Ok(values) = data.as_mut_slice::<f32>() {
                    update.on_cpu(values, &grad, &mut m, &mut v);
                }
                updated = Tensor::from_data(data, &device);
                (first, second) = (Values::Cpu(m), Values::Cpu(v));
            }
            Values::Gpu(grad) => {
                let dims: [usize; D] = tensor.dims();
                let m = moments.first.into_tensor(&device);
                let v = moments.second.into_tensor(&device);
                let n = grad.dims();
                let (value, m, v) = update.on_gpu(tensor.reshape(n), grad, m, v);
                updated = value.reshape(dims);
                (first, second) = (Values::Gpu(m), Values::Gpu(v));
            }
        }
        let shape = moments.shape;
        let moments = Moments {
            shape,
            first,
            second,
        };
        self.moments.insert(path, moments);
        Param::from_mapped_value(id, updated.autodiff().require_grad(), mapper)
    }
}

/// Coefficients of the update of one parameter, with gradient g times `scale`:
/// theta <- theta (1 - lr wd) - lr/c1 * m / (sqrt(v / c2) + eps).
struct Step {
    scale: f32,
    beta_1: f32,
    beta_2: f32,
    epsilon: f32,
    /// 1 - lr wd.
    keep: f32,
    /// lr / c1.
    step: f32,
    /// 1 / c2.
    inverse_c2: f32,
}

impl Step {
    fn on_cpu(&self, values: &mut [f32], grad: &[f32], m: &mut [f32], v: &mut [f32]) {
        // Copied to local variables, so that the loop keeps them in registers.
        let Self {
            scale,
            beta_1,
            beta_2,
            epsilon,
            keep,
            step,
            inverse_c2,
        } = *self;
        for ((value, g), (m, v)) in values.iter_mut().zip(grad).zip(m.iter_mut().zip(v)) {
            let g = g * scale;
            *m = beta_1 * *m + (1.0 - beta_1) * g;
            *v = beta_2 * *v + (1.0 - beta_2) * g * g;
            *value = keep * *value - step * *m / ((*v * inverse_c2).sqrt() + epsilon);
        }
    }

    /// Returns weights and moments after the update.
    fn on_gpu(
        &self,
        value: Tensor<1>,
        grad: Tensor<1>,
        m: Tensor<1>,
        v: Tensor<1>,
    ) -> (Tensor<1>, Tensor<1>, Tensor<1>) {
        let g = grad * self.scale;
        let m = m * self.beta_1 + g.clone() * (1.0 - self.beta_1);
        let v = v * self.beta_2 + g.square() * (1.0 - self.beta_2);
        let root = (v.clone() * self.inverse_c2).sqrt() + self.epsilon;
        let value = value * self.keep - m.clone() * self.step / root;
        (value, m, v)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::nn::{Linear, LinearConfig};
    use burn::tensor::{Device, TensorData};
    use radarllm_nn::params::collect_params;

    /// Compares two steps with the update written out in f64.
    #[test]
    fn matches_the_published_update() {
        let device = Device::flex().autodiff();
        let mut model: Linear = LinearConfig::new(2, 1).with_bias(false).init(&device);
        let config = AdamWConfig {
            clip_norm: 0.0,
            weight_decay: 0.1,
            ..Default::default()
        };
        let start = collect_params(&model)["weight"].values.clone();
        let mut optimizer = AdamW::default();
        let mut expected: Vec<f64> = start.iter().map(|v| f64::from(*v)).collect();
        let (mut m, mut v) = ([0.0f64; 2], [0.0f64; 2]);
        for t in 1..=2 {
            let x = Tensor::<2>::from_data([[1.0, -2.0 * t as f32]], &device);
            let loss = model.forward(x).sum();
            let mut sum = GradientSum::default();
            sum.add(&model, loss.backward());
            let norm = sum.norm();
            model = optimizer.step(
                &config,
                0.1,
                &|_, s| ParamRule::by_shape(s),
                model,
                sum,
                norm,
            );
            for (i, g) in [1.0, -2.0 * f64::from(t)].into_iter().enumerate() {
                m[i] = 0.9 * m[i] + 0.1 * g;
                v[i] = 0.99 * v[i] + 0.01 * g * g;
                let mh = m[i] / (1.0 - 0.9f64.powi(t));
                let vh = v[i] / (1.0 - 0.99f64.powi(t));
                expected[i] = expected[i] * (1.0 - 0.1 * 0.1) - 0.1 * mh / (vh.sqrt() + 1e-8);
            }
        }
        for (found, expected) in collect_params(&model)["weight"].values.iter().zip(expected) {
            // f32 against f64 over two steps: a few ulp of values below 2.
            assert!(
                (f64::from(*found) - expected).abs() < 2e-6,
                "{found} {expected}"
            );
        }
    }

    /// Runs the update for GPUs on the CPU's tensors.
    #[test]
    fn tensors_learn_as_loops_do() {
        let device = Device::flex().autodiff();
        let start: Linear = LinearConfig::new(37, 11).init(&device);
        let train = |on_gpu: bool| {
            let (mut model, mut optimizer) = (start.clone(), AdamW::default());
            let mut norms = Vec::new();
            for t in 0..5 {
                let mut sum = GradientSum::default();
                for batch in 0..2 {
                    let x: Vec<f32> = (0..37)
                        .map(|i| ((i * 7 + t * 3 + batch) as f32).sin())
                        .collect();
                    let x = Tensor::<2>::from_data(TensorData::new(x, [1, 37]), &device);
                    sum.add(&model, model.forward(x).square().sum().backward());
                    if on_gpu {
                        for grad in sum.grads.values_mut() {
                            *grad = Values::Gpu(grad.clone().into_tensor(&Device::flex()));
                        }
                    }
                }
                let norm = sum.norm();
                norms.push(norm);
                let rule = |_: &str, s: &[usize]| ParamRule::by_shape(s);
                model = optimizer.step(&AdamWConfig::default(), 0.1, &rule, model, sum, norm);
            }
            (collect_params(&model), optimizer.state().0, norms)
        };
        let (loops, tensors) = (train(false), train(true));
        for (a, b) in loops.2.iter().zip(&tensors.2) {
            assert!((a / b - 1.0).abs() < 1e-6, "{a} {b}");
        }
        assert_eq!(loops.1.len(), 4);
        for (ours, theirs) in [(&loops.0, &tensors.0), (&loops.1, &tensors.1)] {
            for (name, a) in ours {
                let b = &theirs[name];
                assert_eq!(a.shape, b.shape, "{name}");
                for (a, b) in a.values.iter().zip(&b.values) {
                    // Five updates in f32, with the products in another order.
                    assert!((a - b).abs() <= 2e-5 * (1.0 + a.abs()), "{name}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn clipping_bounds_the_norm_and_means_are_taken_over_batches() {
        let device = Device::flex().autodiff();
        let model: Linear = LinearConfig::new(2, 1).with_bias(false).init(&device);
        let mut sum = GradientSum::default();
        for x in [[3.0f32, 0.0], [3.0, 8.0]] {
            let loss = model.forward(Tensor::<2>::from_data([x], &device)).sum();
            sum.add(&model, loss.backward());
        }
        // Mean of (3, 0) and (3, 8) is (3, 4).
        assert!((sum.norm() - 5.0).abs() < 1e-6);
    }
}
