//! AdamW over the parameters of a module, with one pass over memory per parameter.
//!
//! The framework's own optimiser makes about ten whole-tensor temporaries per parameter and hides
//! its moments; this one keeps them as named arrays that go into a checkpoint as they are.

use std::collections::BTreeMap;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Gradients, Tensor, TensorData};
use radarllm_model::checkpoint::{HostTensor, NamedTensors};
use serde::{Deserialize, Serialize};

/// Constants of AdamW (Loshchilov and Hutter, 2019, algorithm 2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AdamWConfig {
    /// Decay of the first moment.
    pub beta_1: f64,
    /// Decay of the second moment.
    pub beta_2: f64,
    /// Added to the root of the second moment.
    pub epsilon: f64,
    /// Decoupled decay, multiplied by the learning rate; spares vectors and scalars.
    pub weight_decay: f64,
    /// Largest norm of the whole gradient; 0 leaves it alone.
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

/// How one parameter is updated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParamRule {
    /// Factor on the learning rate; 0 freezes.
    pub lr_scale: f64,
    /// Factor on the weight decay.
    pub decay_scale: f64,
}

impl ParamRule {
    /// Matrices decay, vectors (biases, norms) do not.
    pub fn by_shape(shape: &[usize]) -> Self {
        Self {
            lr_scale: 1.0,
            decay_scale: if shape.len() >= 2 { 1.0 } else { 0.0 },
        }
    }
}

/// Gradients of one or more batches, by parameter path.
pub struct GradientSum {
    grads: BTreeMap<String, TensorData>,
    n_batches: usize,
    /// Factor on the losses.
    loss_scale: f64,
}

impl Default for GradientSum {
    fn default() -> Self {
        Self::scaled(1.0)
    }
}

impl GradientSum {
    /// Of losses that were multiplied by a factor.
    pub fn scaled(loss_scale: f64) -> Self {
        Self {
            grads: BTreeMap::new(),
            n_batches: 0,
            loss_scale,
        }
    }

    /// What the sum is divided by.
    fn divisor(&self) -> f64 {
        self.n_batches.max(1) as f64 * self.loss_scale
    }

    /// Adds the gradients of one batch.
    pub fn add<M: Module>(&mut self, model: &M, grads: Gradients) {
        struct Visit<'a> {
            path: Vec<String>,
            grads: Gradients,
            sum: &'a mut BTreeMap<String, TensorData>,
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
                let mut data = grad.into_data();
                if let Some(previous) = self.sum.remove(&self.path.join("."))
                    && let (Ok(to), Ok(from)) =
                        (data.as_mut_slice::<f32>(), previous.as_slice::<f32>())
                {
                    to.iter_mut().zip(from).for_each(|(t, f)| *t += f);
                }
                self.sum.insert(self.path.join("."), data);
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
        let sum: f64 = self
            .grads
            .values()
            .filter_map(|data| data.as_slice::<f32>().ok())
            .map(|g| {
                // Blocks in f32 vectorise; their sums in f64 keep the total exact enough.
                g.chunks(256)
                    .map(|block| f64::from(block.iter().map(|x| x * x).sum::<f32>()))
                    .sum::<f64>()
            })
            .sum();
        sum.sqrt() / self.divisor()
    }
}

/// AdamW's state: moments by parameter path, and the number of updates.
#[derive(Clone, Debug, Default)]
pub struct AdamW {
    moments: BTreeMap<String, Moments>,
    n_updates: u64,
}

#[derive(Clone, Debug)]
struct Moments {
    shape: Vec<usize>,
    first: Vec<f32>,
    second: Vec<f32>,
}

impl AdamW {
    /// One update with the mean of the gathered gradients; `norm` is [`GradientSum::norm`].
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

    /// Moments as named arrays (`first.<path>`, `second.<path>`) and the number of updates.
    pub fn state(&self) -> (NamedTensors, u64) {
        let mut out = NamedTensors::new();
        for (path, m) in &self.moments {
            let tensor = |values: &Vec<f32>| HostTensor {
                shape: m.shape.clone(),
                values: values.clone(),
            };
            out.insert(format!("first.{path}"), tensor(&m.first));
            out.insert(format!("second.{path}"), tensor(&m.second));
        }
        (out, self.n_updates)
    }

    /// The reverse of [`Self::state`]; names that fit no shape in `shapes` give their name back.
    ///
    /// # Errors
    /// The name of the first array that does not belong to a parameter.
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
                        first: a.values,
                        second: b.values,
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
    grads: BTreeMap<String, TensorData>,
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
        let Ok(grad) = grad.as_slice::<f32>() else {
            return param;
        };
        let shape = param.lazy_shape().to_vec();
        let rule = (self.rule)(&path, &shape);
        if rule.lr_scale == 0.0 {
            return param;
        }
        let (id, tensor, mapper) = param.consume();
        let device = tensor.device();
        let mut data = tensor.without_autodiff().into_data();
        let moments = self.moments.entry(path).or_insert_with(|| Moments {
            shape,
            first: vec![0.0; grad.len()],
            second: vec![0.0; grad.len()],
        });
        if let Ok(values) = data.as_mut_slice::<f32>() {
            let lr = self.learning_rate * rule.lr_scale;
            // theta <- theta (1 - lr wd) - lr/c1 * m / (sqrt(v / c2) + eps)
            let keep = (1.0 - lr * self.config.weight_decay * rule.decay_scale) as f32;
            let step = (lr / self.correction_1) as f32;
            let inverse_c2 = (1.0 / self.correction_2) as f32;
            let (b1, b2) = (self.config.beta_1 as f32, self.config.beta_2 as f32);
            let epsilon = self.config.epsilon as f32;
            let scale = self.scale;
            let state = moments.first.iter_mut().zip(moments.second.iter_mut());
            for ((value, g), (m, v)) in values.iter_mut().zip(grad).zip(state) {
                let g = g * scale;
                *m = b1 * *m + (1.0 - b1) * g;
                *v = b2 * *v + (1.0 - b2) * g * g;
                *value = keep * *value - step * *m / ((*v * inverse_c2).sqrt() + epsilon);
            }
        }
        let updated = Tensor::from_data(data, &device).require_grad();
        Param::from_mapped_value(id, updated, mapper)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::nn::{Linear, LinearConfig};
    use burn::tensor::Device;
    use radarllm_model::checkpoint::collect_params;

    /// Two steps against the update written out by hand in f64.
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
