//! A second code for each step: of a codebook of its own, the one nearest to what the first code leaves of the feature
//! (residual vector quantization with two stages).
//!
//! The paper has one code of 9 bits for 0.4 s. A second codebook of 512 codes adds 9 bits. What the language model reads is
//! still discrete: the sum of a vector of each codebook takes the place of the feature.

use super::config::TokenizerConfig;
use super::encode::Encoded;
use super::nearest::nearest_codes;
use crate::checkpoint::{Checkpoint, CheckpointError, MODEL_FILE};

/// File of the second codebook in the folder of a tokenizer.
pub const RESIDUAL_FILE: &str = "residual.safetensors";
/// Name of the second codebook in its file: `[residual_codes, code_dim]`.
pub const RESIDUAL_TENSOR: &str = "residual_codebook";

/// The codebooks of a tokenizer with two codes a step.
pub struct TwoCodebooks {
    /// `[codebook_size][code_dim]`.
    first: Vec<f32>,
    /// `[residual_codes][code_dim]`.
    second: Vec<f32>,
    /// Width of a code.
    dim: usize,
}

impl TwoCodebooks {
    /// Reads both codebooks of a tokenizer; `None` if it has one.
    ///
    /// # Errors
    /// If a file is missing or damaged, or a codebook has another shape than `config` says.
    pub fn read(
        checkpoint: &Checkpoint,
        config: &TokenizerConfig,
    ) -> Result<Option<Self>, CheckpointError> {
        let (n_first, n_second, dim) =
            (config.codebook_size, config.residual_codes, config.code_dim);
        if n_second == 0 {
            return Ok(None);
        }
        let codebook = |file, name: &str, n| codebook(checkpoint, file, name, [n, dim]);
        Ok(Some(Self {
            first: codebook(MODEL_FILE, "codebook", n_first)?,
            second: codebook(RESIDUAL_FILE, RESIDUAL_TENSOR, n_second)?,
            dim,
        }))
    }

    /// Number of weights of the second codebook.
    pub fn n_params(&self) -> usize {
        self.second.len()
    }

    /// Finds the second codes, and replaces the features by the sums of the vectors of both codes.
    pub fn quantise(&self, encoded: &mut Encoded) {
        let left = residuals(&encoded.features, &encoded.codes, &self.first, self.dim);
        encoded.residual_codes = nearest_codes(&left, &self.second, self.dim);
        let codes = encoded.codes.iter().zip(&encoded.residual_codes);
        let features = encoded.features.chunks_exact_mut(self.dim);
        for (feature, (&first, &second)) in features.zip(codes) {
            let (first, second) = (
                row(&self.first, first, self.dim),
                row(&self.second, second, self.dim),
            );
            for (value, (a, b)) in feature.iter_mut().zip(first.iter().zip(second)) {
                *value = a + b;
            }
        }
    }
}

/// Reads a codebook of shape `expected`.
fn codebook(
    checkpoint: &Checkpoint,
    file: &str,
    name: &str,
    expected: [usize; 2],
) -> Result<Vec<f32>, CheckpointError> {
    let path = checkpoint.dir().join(file);
    let (tensor, expected) = (name.to_string(), expected.to_vec());
    match checkpoint.tensors(file)?.remove(name) {
        Some(found) if found.shape == expected => Ok(found.values),
        Some(found) => Err(CheckpointError::Shape {
            path,
            tensor,
            expected,
            found: found.shape,
        }),
        None => Err(CheckpointError::MissingTensor {
            path,
            tensor,
            expected,
        }),
    }
}

/// What the codes of a codebook leave of the features, `[n_codes][dim]` flattened.
pub fn residuals(features: &[f32], codes: &[u32], codebook: &[f32], dim: usize) -> Vec<f32> {
    let steps = features.chunks_exact(dim.max(1)).zip(codes);
    let difference = |(feature, code): (&[f32], &u32)| {
        let code = row(codebook, *code, dim);
        let pairs = feature.iter().zip(code);
        pairs.map(|(f, c)| f - c).collect::<Vec<_>>()
    };
    steps.flat_map(difference).collect()
}

/// The vector of a code.
fn row(codebook: &[f32], code: u32, dim: usize) -> &[f32] {
    &codebook[code as usize * dim..][..dim]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Features of width 2 that lie beside the codes of a first codebook.
    #[test]
    fn the_sum_of_both_codes_takes_the_place_of_the_feature() {
        let codebooks = TwoCodebooks {
            first: vec![0.0, 0.0, 10.0, 10.0],
            second: vec![1.0, 0.0, 0.0, -1.0, 0.0, 0.0],
            dim: 2,
        };
        let mut encoded = Encoded {
            codes: vec![0, 1, 1],
            features: vec![0.9, 0.1, 10.2, 8.9, 10.1, 10.1],
            ..Encoded::default()
        };
        codebooks.quantise(&mut encoded);
        assert_eq!(encoded.codes, [0, 1, 1]);
        assert_eq!(encoded.residual_codes, [0, 1, 2]);
        assert_eq!(encoded.features, [1.0, 0.0, 10.0, 9.0, 10.0, 10.0]);
        assert_eq!(codebooks.n_params(), 6);
    }
}
