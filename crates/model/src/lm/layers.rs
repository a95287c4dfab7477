//! Layers that GPT-2, Qwen2 and BERT share, made straight from the tensors of a checkpoint.
//!
//! Activations are `[batch * length, width]`, as in [`super::t5`].

use std::path::{Path, PathBuf};

use burn::module::{Module, Param};
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Int, Tensor, TensorData};

use super::LmError;
use crate::checkpoint::{CheckpointError, HostTensor, NamedTensors};

/// Added to the scores of keys that must not be seen; finite, as in [`super::t5`].
const HIDDEN: f32 = -1e9;

/// `x W + b`.
#[derive(Module, Debug)]
pub struct Linear {
    /// `[in, out]`.
    pub weight: Param<Tensor<2>>,
    /// `[out]`.
    pub bias: Option<Param<Tensor<1>>>,
}

impl Linear {
    /// `[rows, in]` to `[rows, out]`.
    pub fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        let y = x.matmul(self.weight.val());
        match &self.bias {
            Some(bias) => y + bias.val().unsqueeze::<2>(),
            None => y,
        }
    }
}

/// Normalisation over the last axis: with an offset by mean and variance, without one by the root mean
/// square alone.
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

/// Rows by id.
#[derive(Module, Debug)]
pub struct Embedding {
    /// `[rows, width]`.
    pub weight: Param<Tensor<2>>,
}

impl Embedding {
    /// `[ids]` to `[ids, width]`.
    pub fn forward(&self, ids: Tensor<1, Int>) -> Tensor<2> {
        self.weight.val().select(0, ids)
    }
}

/// `[batch * length, heads * width]` to `[batch, heads, length, width]`.
pub fn split_heads(x: Tensor<2>, [batch, length]: [usize; 2], heads: usize) -> Tensor<4> {
    let width = x.dims()[1] / heads;
    x.reshape([batch, length, heads, width]).swap_dims(1, 2)
}

/// Scaled dot-product attention over `[batch, heads, length, width]`; `[batch * length, heads * width]`
/// comes back. `bias` is added to the scores.
pub fn attend(q: Tensor<4>, k: Tensor<4>, v: Tensor<4>, bias: Option<Tensor<4>>) -> Tensor<2> {
    let [batch, heads, length, width] = q.dims();
    let mut scores = q
        .matmul(k.swap_dims(2, 3))
        .mul_scalar((width as f64).powf(-0.5));
    if let Some(bias) = bias {
        scores = scores + bias;
    }
    softmax(scores, 3)
        .matmul(v)
        .swap_dims(1, 2)
        .reshape([batch * length, heads * width])
}

/// Equally long rows of ids, and which of them are tokens.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    /// `[batch * length]`.
    pub ids: Vec<u32>,
    /// `[batch * length]`, false for padding; padding may stand anywhere.
    pub is_token: Vec<bool>,
    /// Rows and their length.
    pub shape: [usize; 2],
}

impl Rows {
    /// Checks `ids` and `mask` (1 token, 0 padding; all tokens without it) against a vocabulary and the
    /// longest row that a network takes.
    ///
    /// # Errors
    /// [`LmError::Input`] on no or empty rows, ragged rows, too long rows and ids beyond the vocabulary.
    pub fn new(
        ids: &[Vec<u32>],
        mask: Option<&[Vec<u32>]>,
        vocab_size: usize,
        longest: usize,
    ) -> Result<Self, LmError> {
        let fail = |problem: String| Err(LmError::Input(problem));
        let length = ids.first().map_or(0, Vec::len);
        if length == 0 || length > longest {
            return fail(format!(
                "rows must have 1 to {longest} ids, row 0 has {length}"
            ));
        }
        if let Some(mask) = mask
            && (mask.len() != ids.len() || mask.iter().any(|row| row.len() != length))
        {
            return fail(format!(
                "attention_mask must have the shape of the ids, {} rows of {length}",
                ids.len()
            ));
        }
        for (i, row) in ids.iter().enumerate() {
            if row.len() != length {
                return fail(format!("row {i} has {} ids, row 0 has {length}", row.len()));
            }
            if let Some(id) = row.iter().find(|id| **id as usize >= vocab_size) {
                return fail(format!(
                    "row {i}: id {id} is beyond the vocabulary of {vocab_size}"
                ));
            }
        }
        let is_token = match mask {
            Some(mask) => mask.iter().flatten().map(|m| *m != 0).collect(),
            None => vec![true; ids.len() * length],
        };
        Ok(Self {
            ids: ids.concat(),
            is_token,
            shape: [ids.len(), length],
        })
    }

    /// The ids on a device.
    pub fn tensor(&self, device: &Device) -> Tensor<1, Int> {
        ids_1d(self.ids.iter().map(|id| *id as i32).collect(), device)
    }

    /// What to add to scores `[batch, heads, query, key]` so that padding, and with `causal` whatever
    /// comes later, is not seen; none where everything is.
    pub fn bias(&self, causal: bool, device: &Device) -> Option<Tensor<4>> {
        let [batch, length] = self.shape;
        if !causal && self.is_token.iter().all(|t| *t) {
            return None;
        }
        let n_queries = if causal { length } else { 1 };
        let mut values = Vec::with_capacity(batch * n_queries * length);
        for row in self.is_token.chunks_exact(length) {
            for query in 0..n_queries {
                values.extend(row.iter().enumerate().map(|(key, is_token)| {
                    let seen = *is_token && (!causal || key <= query);
                    if seen { 0.0 } else { HIDDEN }
                }));
            }
        }
        let data = TensorData::new(values, [batch, 1, n_queries, length]);
        Some(Tensor::from_data(data, device))
    }
}

/// Ids to a device.
pub fn ids_1d(ids: Vec<i32>, device: &Device) -> Tensor<1, Int> {
    let len = ids.len();
    Tensor::from_data(TensorData::new(ids, [len]), device)
}

/// Hands a checkpoint's tensors out by name; what a network asks for must be there with the shape that
/// its configuration claims, so that nothing is allocated on a configuration's word alone.
pub struct Loader {
    tensors: NamedTensors,
    /// Named in errors.
    file: PathBuf,
    /// Whether linear weights lie as `[out, in]`.
    transposed: bool,
    device: Device,
}

impl Loader {
    /// A checkpoint whose linear weights lie as `[out, in]`, or, not `transposed`, as `[in, out]`.
    pub fn new(tensors: NamedTensors, file: &Path, transposed: bool, device: &Device) -> Self {
        Self {
            tensors,
            file: file.into(),
            transposed,
            device: device.clone(),
        }
    }

    /// Whether a tensor of this name is there.
    pub fn has(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }

    fn take(&mut self, tensor: String, expected: &[usize]) -> Result<HostTensor, LmError> {
        let (path, expected) = (self.file.clone(), expected.to_vec());
        match self.tensors.remove(&tensor) {
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
    /// A missing tensor or another shape, here and below.
    pub fn embedding(&mut self, name: &str, shape: [usize; 2]) -> Result<Embedding, LmError> {
        let tensor = self.take(format!("{name}.weight"), &shape)?;
        let weight = self.param(tensor, shape);
        Ok(Embedding { weight })
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

    /// Makes sure that nothing is left but what `is_known` names.
    ///
    /// # Errors
    /// [`CheckpointError::UnknownTensor`].
    pub fn finish(self, is_known: impl Fn(&str) -> bool) -> Result<(), LmError> {
        match self.tensors.into_keys().find(|name| !is_known(name)) {
            Some(tensor) => Err(CheckpointError::UnknownTensor {
                path: self.file,
                tensor,
            }
            .into()),
            None => Ok(()),
        }
    }
}
