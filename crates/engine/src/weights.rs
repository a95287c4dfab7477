//! Named weights of a network of a given shape. Each weight is checked before it is packed.

use std::collections::BTreeMap;

use crate::EngineError;

/// A dense f32 array in host memory, row-major.
///
/// # Example
/// ```
/// use radarllm_engine::HostTensor;
///
/// // PyTorch keeps a linear map as [out, in], the engine as [in, out].
/// let linear = HostTensor { shape: vec![2, 3], values: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0] };
/// let transposed = linear.transposed();
/// assert_eq!(transposed.shape, [3, 2]);
/// assert_eq!(transposed.values, [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct HostTensor {
    /// Length of each axis; empty for a scalar.
    pub shape: Vec<usize>,
    /// As many values as the product of `shape`.
    pub values: Vec<f32>,
}

impl HostTensor {
    /// Creates a vector.
    pub fn vector(values: Vec<f32>) -> Self {
        Self {
            shape: vec![values.len()],
            values,
        }
    }

    /// Returns a matrix with rows and columns exchanged, and any other array unchanged.
    pub fn transposed(self) -> Self {
        let [rows, columns] = self.shape[..] else {
            return self;
        };
        let mut values = Vec::with_capacity(self.values.len());
        for column in 0..columns {
            values.extend((0..rows).map(|row| self.values[row * columns + column]));
        }
        Self {
            shape: vec![columns, rows],
            values,
        }
    }
}

/// Arrays by name.
pub type NamedTensors = BTreeMap<String, HostTensor>;

/// Shape of a T5 encoder-decoder (Raffel et al. 2020) and of its radar input.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// Number of rows of the embedding (vocabulary size).
    pub vocab_size: usize,
    /// Width of the residual stream.
    pub d_model: usize,
    /// Width of one attention head.
    pub d_kv: usize,
    /// Number of attention heads.
    pub n_heads: usize,
    /// Inner width of the feed-forward network.
    pub d_ff: usize,
    /// Number of encoder blocks.
    pub n_encoder_layers: usize,
    /// Number of decoder blocks.
    pub n_decoder_layers: usize,
    /// `wo(gelu(wi x) * gate x)` (v1.1) instead of `wo(relu(wi x))` (the original).
    pub gated: bool,
    /// The output projection is tied to the embedding.
    pub tied: bool,
    /// Hidden states are scaled by `d_model^-0.5` before the output projection.
    pub scaled: bool,
    /// Number of buckets of the relative position bias.
    pub relative_buckets: usize,
    /// Distance from which on all keys share the last bucket.
    pub relative_max_distance: usize,
    /// Epsilon that RMS norm adds to the mean square.
    pub norm_eps: f32,
    /// Width of the radar feature that is projected and added to the embedding of a code; `None` without this bypass.
    pub bypass: Option<usize>,
}

/// Maximum width. Sums of this many products of bytes still fit 32 bits.
pub(crate) const MAX_WIDTH: usize = 1 << 16;

impl Shape {
    /// Width of all heads together.
    pub fn inner(&self) -> usize {
        self.n_heads * self.d_kv
    }

    /// Checks that the shape is valid and that the sums of the network cannot overflow.
    ///
    /// # Errors
    /// [`EngineError::Shape`] names the first field out of range.
    pub fn validate(&self) -> Result<(), EngineError> {
        for (field, value, min, max) in [
            ("vocab_size", self.vocab_size, 2, 1 << 22),
            ("d_model", self.d_model, 1, MAX_WIDTH),
            ("d_kv", self.d_kv, 1, MAX_WIDTH),
            ("n_heads", self.n_heads, 1, 1024),
            ("d_ff", self.d_ff, 1, MAX_WIDTH),
            ("n_encoder_layers", self.n_encoder_layers, 1, 128),
            ("n_decoder_layers", self.n_decoder_layers, 1, 128),
            ("relative_buckets", self.relative_buckets, 4, 4096),
            (
                "relative_max_distance",
                self.relative_max_distance,
                self.relative_buckets,
                1 << 20,
            ),
            ("bypass", self.bypass.unwrap_or(1), 1, MAX_WIDTH),
            // Heads are padded to a multiple of 16.
            (
                "n_heads * d_kv",
                self.n_heads * self.d_kv.next_multiple_of(16),
                1,
                MAX_WIDTH,
            ),
        ] {
            if value < min || value > max {
                let problem = format!("must be in {min}..={max}, found {value}");
                return Err(EngineError::Shape { field, problem });
            }
        }
        if !(self.norm_eps.is_finite() && self.norm_eps > 0.0) {
            return Err(EngineError::Shape {
                field: "norm_eps",
                problem: format!("must be finite and positive, found {}", self.norm_eps),
            });
        }
        Ok(())
    }
}

/// Returns weights by name, and checks that each has the form that the network needs.
pub(crate) struct Taker(pub NamedTensors);

impl Taker {
    pub(crate) fn take(&mut self, name: &str, expected: &[usize]) -> Result<Vec<f32>, EngineError> {
        let Some(tensor) = self.0.remove(name) else {
            return Err(EngineError::MissingWeight {
                name: name.into(),
                expected: expected.into(),
            });
        };
        let n_values = expected.iter().product::<usize>();
        if tensor.shape != expected || tensor.values.len() != n_values {
            return Err(EngineError::WeightShape {
                name: name.into(),
                expected: expected.into(),
                found: tensor.shape,
                values: tensor.values.len(),
            });
        }
        match tensor.values.iter().position(|v| !v.is_finite()) {
            Some(index) => Err(EngineError::NotFinite {
                name: name.into(),
                index,
            }),
            None => Ok(tensor.values),
        }
    }

    /// Refuses weights that the network did not use.
    pub(crate) fn finish(self) -> Result<(), EngineError> {
        match self.0.into_keys().next() {
            Some(name) => Err(EngineError::UnknownWeight { name }),
            None => Ok(()),
        }
    }
}
