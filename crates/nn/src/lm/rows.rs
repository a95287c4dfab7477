//! Rows of token ids as network input: padding, positions and attention masks.

use burn::tensor::{Device, Int, Tensor, TensorData};
use radarllm_inference::lm::{InputError, LmError};

/// Added to the scores of masked keys. The value is finite, so that a row with only masked keys gives equal
/// weights instead of NaN.
pub(crate) const HIDDEN: f32 = -1e9;

/// Rows of ids of equal length, and which of the ids are tokens.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    /// `[batch * length]`.
    pub ids: Vec<u32>,
    /// `[batch * length]`, false for padding. Padding may be at any position.
    pub is_token: Vec<bool>,
    /// Number of rows and their length.
    pub shape: [usize; 2],
}

impl Rows {
    /// Checks `ids` and `mask` (1 token, 0 padding; all ids are tokens if absent) against a vocabulary and the
    /// maximum row length of a network.
    ///
    /// # Errors
    /// [`LmError::Input`] for no rows, empty rows, ragged rows, rows that are too long and ids outside the vocabulary.
    pub fn new(
        ids: &[Vec<u32>],
        mask: Option<&[Vec<u32>]>,
        vocab_size: usize,
        longest: usize,
    ) -> Result<Self, LmError> {
        let fail = |problem: String| Err(InputError::Rows { problem }.into());
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

    /// Pads rows of different lengths with id 0, before (`left`) or after the tokens.
    pub fn padded(rows: &[Vec<u32>], left: bool) -> Self {
        let length = rows.iter().map(Vec::len).max().unwrap_or(0);
        let mut ids = vec![0; rows.len() * length];
        let mut is_token = vec![false; ids.len()];
        for (i, row) in rows.iter().enumerate() {
            let start = i * length + if left { length - row.len() } else { 0 };
            ids[start..start + row.len()].copy_from_slice(row);
            is_token[start..start + row.len()].fill(true);
        }
        Self {
            ids,
            is_token,
            shape: [rows.len(), length],
        }
    }

    /// Positions and attention bias of these rows. Positions count the row's tokens (`by_token`) or all its ids.
    pub fn steps(&self, by_token: bool, device: &Device) -> Steps {
        let mut positions = Vec::with_capacity(self.ids.len());
        for row in self.is_token.chunks_exact(self.shape[1].max(1)) {
            let mut position = 0;
            for is_token in row {
                positions.push(position);
                position += usize::from(*is_token || !by_token);
            }
        }
        Steps {
            shape: self.shape,
            positions,
            bias: self.bias(true, device),
        }
    }

    /// The ids on a device.
    pub fn tensor(&self, device: &Device) -> Tensor<1, Int> {
        ids_1d(self.ids.iter().map(|id| *id as i32).collect(), device)
    }

    /// The bias of the scores `[batch, heads, query, key]` that masks padding and, with `causal`, all later
    /// positions; none if nothing is masked.
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

/// Moves ids to a device.
pub(crate) fn ids_1d(ids: Vec<i32>, device: &Device) -> Tensor<1, Int> {
    let len = ids.len();
    Tensor::from_data(TensorData::new(ids, [len]), device)
}

/// Positions and attention bias of the columns of a causal network's input.
pub struct Steps {
    /// Number of rows, and of columns that are computed in this call.
    pub shape: [usize; 2],
    /// Position of each, `[batch * length]`.
    pub positions: Vec<usize>,
    /// Added to the scores, `[batch, 1, length, keys]`. The keys of earlier calls come first.
    pub bias: Option<Tensor<4>>,
}
