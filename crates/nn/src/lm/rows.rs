//! Rows of ids as networks read them: padded, positioned, with what attention must not see.

use burn::tensor::{Device, Int, Tensor, TensorData};
use radarllm_inference::lm::{InputError, LmError};

/// Added to the scores of keys that must not be seen. Finite, so that a row of nothing but such keys gives equal
/// weights instead of NaN.
pub(crate) const HIDDEN: f32 = -1e9;

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

    /// Rows of different lengths with padding before (`left`) or after them; id 0 pads.
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

    /// Steps whose positions count the row's tokens (`by_token`) or all its ids.
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

/// Where the columns of a causal network's input stand.
pub struct Steps {
    /// Rows, and columns that are computed now.
    pub shape: [usize; 2],
    /// Position of each, `[batch * length]`.
    pub positions: Vec<usize>,
    /// Added to the scores, `[batch, 1, length, keys]`; keys of earlier calls come first.
    pub bias: Option<Tensor<4>>,
}
