//! Exponential moving averages of weights.

use std::collections::BTreeMap;

use burn::module::{Module, ModuleVisitor, Param};
use burn::tensor::Tensor;
use radarllm_inference::checkpoint::{HostTensor, NamedTensors};

use crate::values::Values;

/// Averages of weights by parameter path. Each average is on the device on which its weight was last seen.
pub(crate) struct WeightAverage {
    means: BTreeMap<String, (Vec<usize>, Values)>,
}

impl WeightAverage {
    /// Starts or continues the averages from the given values.
    pub(crate) fn new(weights: NamedTensors) -> Self {
        let of = |(path, t): (String, HostTensor)| (path, (t.shape, Values::Cpu(t.values)));
        Self {
            means: weights.into_iter().map(of).collect(),
        }
    }

    /// Moves the averages by a fraction of `1 - decay` towards the current weights.
    pub(crate) fn follow<M: Module>(&mut self, model: &M, decay: f32) {
        struct Follow<'a> {
            path: Vec<String>,
            means: &'a mut BTreeMap<String, (Vec<usize>, Values)>,
            share: f32,
        }
        impl ModuleVisitor for Follow<'_> {
            fn enter_module(&mut self, name: &str, _container: &str) {
                self.path.push(name.to_string());
            }
            fn exit_module(&mut self, _name: &str, _container: &str) {
                self.path.pop();
            }
            fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
                let Some((_, mean)) = self.means.get_mut(&self.path.join(".")) else {
                    return;
                };
                let before = std::mem::replace(mean, Values::Cpu(Vec::new()));
                *mean = match Values::of(param.base().without_autodiff()) {
                    Values::Cpu(now) => {
                        let mut mean = before.into_vec();
                        for (mean, now) in mean.iter_mut().zip(&now) {
                            *mean += self.share * (now - *mean);
                        }
                        Values::Cpu(mean)
                    }
                    Values::Gpu(now) => {
                        let mean = before.into_tensor(&now.device());
                        Values::Gpu(mean.clone() + (now - mean) * self.share)
                    }
                };
            }
        }
        model.visit(&mut Follow {
            path: Vec::new(),
            means: &mut self.means,
            share: 1.0 - decay,
        });
    }

    /// Returns the averages.
    pub(crate) fn tensors(&self) -> NamedTensors {
        let means = self.means.iter();
        let host = means.map(|(path, (shape, mean))| (path.clone(), mean.to_host(shape)));
        host.collect()
    }

    /// Whether the tensors are averages of the same parameters.
    pub(crate) fn fits(&self, tensors: &NamedTensors) -> bool {
        let ours = self.means.iter().map(|(path, (shape, _))| (path, shape));
        ours.eq(tensors.iter().map(|(path, t)| (path, &t.shape)))
    }
}
