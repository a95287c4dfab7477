//! Reads and writes the parameters of burn modules by name.

use std::collections::BTreeMap;
use std::path::Path;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Tensor, TensorData};

use radarllm_inference::checkpoint::{
    Checkpoint, CheckpointError, HostTensor, MODEL_FILE, NamedTensors,
};

/// Loads `model.safetensors` into `model`. Names and shapes must agree exactly.
///
/// # Errors
/// See [`load_params`].
pub fn load_model<M: Module>(checkpoint: &Checkpoint, model: M) -> Result<M, CheckpointError> {
    let path = checkpoint.dir().join(MODEL_FILE);
    load_params(model, checkpoint.tensors(MODEL_FILE)?, &path)
}

/// All float parameters of a module by path (`encoder.layers.0.weight`).
pub fn collect_params<M: Module>(model: &M) -> NamedTensors {
    collect_some_params(model, &|_| true)
}

/// Number of float parameters of a module.
pub fn n_params<M: Module>(model: &M) -> usize {
    let shapes = param_shapes(model);
    shapes
        .values()
        .map(|shape| shape.iter().product::<usize>())
        .sum()
}

/// The float parameters of a module whose paths satisfy `wanted`; the others are not copied.
pub fn collect_some_params<M: Module>(model: &M, wanted: &dyn Fn(&str) -> bool) -> NamedTensors {
    struct Collect<'a> {
        path: Vec<String>,
        wanted: &'a dyn Fn(&str) -> bool,
        out: NamedTensors,
    }
    impl ModuleVisitor for Collect<'_> {
        fn enter_module(&mut self, name: &str, _container: &str) {
            self.path.push(name.to_string());
        }
        fn exit_module(&mut self, _name: &str, _container: &str) {
            self.path.pop();
        }
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let path = self.path.join(".");
            if !(self.wanted)(&path) {
                return;
            }
            let tensor = param.base().without_autodiff();
            let shape = tensor.dims().to_vec();
            // Parameters are f32 by construction; a read failure would be a defect of the backend.
            let values = tensor
                .into_data_as::<f32>()
                .try_into_vec::<f32>()
                .unwrap_or_default();
            self.out.insert(path, HostTensor { shape, values });
        }
    }
    let mut visitor = Collect {
        path: Vec::new(),
        wanted,
        out: NamedTensors::new(),
    };
    model.visit(&mut visitor);
    visitor.out
}

/// Paths and shapes of all float parameters of a module.
pub fn param_shapes<M: Module>(model: &M) -> BTreeMap<String, Vec<usize>> {
    struct Shapes {
        path: Vec<String>,
        out: BTreeMap<String, Vec<usize>>,
    }
    impl ModuleVisitor for Shapes {
        fn enter_module(&mut self, name: &str, _container: &str) {
            self.path.push(name.to_string());
        }
        fn exit_module(&mut self, _name: &str, _container: &str) {
            self.path.pop();
        }
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            self.out
                .insert(self.path.join("."), param.lazy_shape().to_vec());
        }
    }
    let mut visitor = Shapes {
        path: Vec::new(),
        out: BTreeMap::new(),
    };
    model.visit(&mut visitor);
    visitor.out
}

/// Loads the parameters in `tensors` into a module; `file` is named in errors.
///
/// # Errors
/// If a name is missing or unknown, or if a shape differs. In that case nothing is loaded.
pub fn load_params<M: Module>(
    model: M,
    tensors: NamedTensors,
    file: &Path,
) -> Result<M, CheckpointError> {
    let expected = param_shapes(&model);
    for (name, shape) in &expected {
        match tensors.get(name) {
            None => {
                return Err(CheckpointError::MissingTensor {
                    path: file.into(),
                    tensor: name.clone(),
                    expected: shape.clone(),
                });
            }
            Some(found) if found.shape != *shape => {
                return Err(CheckpointError::Shape {
                    path: file.into(),
                    tensor: name.clone(),
                    expected: shape.clone(),
                    found: found.shape.clone(),
                });
            }
            Some(_) => {}
        }
    }
    if let Some(name) = tensors.keys().find(|name| !expected.contains_key(*name)) {
        return Err(CheckpointError::UnknownTensor {
            path: file.into(),
            tensor: name.clone(),
        });
    }
    Ok(replace_params(model, tensors))
}

/// Replaces the parameters named in `tensors`; the others keep their values.
///
/// Shapes must fit: see [`load_params`] for the checked form.
pub fn replace_params<M: Module>(model: M, tensors: NamedTensors) -> M {
    struct Replace {
        path: Vec<String>,
        tensors: NamedTensors,
    }
    impl ModuleMapper for Replace {
        fn enter_module(&mut self, name: &str, _container: &str) {
            self.path.push(name.to_string());
        }
        fn exit_module(&mut self, _name: &str, _container: &str) {
            self.path.pop();
        }
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            let Some(host) = self.tensors.remove(&self.path.join(".")) else {
                return param;
            };
            let device = param.lazy_device();
            let tensor = Tensor::from_data(TensorData::new(host.values, host.shape), &device);
            let id = param.id;
            param.transform_for_load(tensor, id)
        }
    }
    model.map(&mut Replace {
        path: Vec::new(),
        tensors,
    })
}

#[cfg(test)]
mod tests {
    use burn::nn::{Linear, LinearConfig};
    use burn::tensor::Device;

    use super::*;

    fn linear() -> Linear {
        LinearConfig::new(3, 2).init(&Device::flex())
    }

    #[test]
    fn weights_survive_a_round_trip_bit_for_bit() {
        let params = collect_params(&linear());
        let loaded = load_params(linear(), params.clone(), Path::new("f")).unwrap();
        assert_eq!(collect_params(&loaded), params);
    }

    #[test]
    fn wrong_names_and_shapes_are_named() {
        let mut tensors = collect_params(&linear());
        let weight = tensors.remove("weight").unwrap();
        let file = Path::new("f");
        let err = load_params(linear(), tensors.clone(), file).unwrap_err();
        assert_eq!(
            err.to_string(),
            "f: tensor `weight` of shape [3, 2] is missing"
        );
        let bad = HostTensor {
            shape: vec![2, 3],
            values: weight.values.clone(),
        };
        tensors.insert("weight".into(), bad);
        let err = load_params(linear(), tensors.clone(), file).unwrap_err();
        assert_eq!(
            err.to_string(),
            "f: tensor `weight`: shape [2, 3], expected [3, 2]"
        );
        tensors.insert("weight".into(), weight);
        tensors.insert("other".into(), HostTensor::vector(vec![0.0]));
        let err = load_params(linear(), tensors, file).unwrap_err();
        assert_eq!(
            err.to_string(),
            "f: tensor `other` is not part of this model"
        );
    }
}
