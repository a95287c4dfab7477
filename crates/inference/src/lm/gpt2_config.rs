//! Shape of a GPT-2, with the field names of its `config.json`.

use serde::{Deserialize, Serialize};

use super::LmError;

/// The fields of a GPT-2 `config.json` that are used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gpt2Config {
    /// Number of rows of the embedding.
    pub vocab_size: usize,
    /// Width of the residual stream.
    pub n_embd: usize,
    /// Number of blocks.
    pub n_layer: usize,
    /// Number of attention heads.
    pub n_head: usize,
    /// Maximum length of a sequence.
    pub n_positions: usize,
    /// Inner width of the feed-forward network. `None` means four times the width.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub n_inner: Option<usize>,
    /// Epsilon that layer norm adds to the variance.
    #[serde(default = "epsilon")]
    pub layer_norm_epsilon: f64,
    /// Activation function. Only `gelu_new`, the tanh form, is supported.
    #[serde(default = "gelu")]
    pub activation_function: String,
    /// Dropout probability in training, also applied to embeddings and attention.
    #[serde(default = "dropout")]
    pub resid_pdrop: f64,
    #[serde(default)]
    pub(super) scale_attn_by_inverse_layer_idx: bool,
}

fn epsilon() -> f64 {
    1e-5
}

fn gelu() -> String {
    "gelu_new".into()
}

fn dropout() -> f64 {
    0.1
}

impl Gpt2Config {
    /// Creates a shape with heads of width 64, or of width 32 below a width of 256.
    pub fn new(n_embd: usize, n_layer: usize, n_positions: usize) -> Self {
        let head_width = if n_embd < 256 { 32 } else { 64 };
        Self {
            vocab_size: 0,
            n_embd,
            n_layer,
            n_head: n_embd / head_width,
            n_positions,
            n_inner: None,
            layer_norm_epsilon: epsilon(),
            activation_function: gelu(),
            resid_pdrop: dropout(),
            scale_attn_by_inverse_layer_idx: false,
        }
    }

    /// Checks that the shape is valid and supported.
    ///
    /// # Errors
    /// [`LmError::Config`].
    pub fn validate(&self) -> Result<(), LmError> {
        let fail = |field, problem| Err(LmError::Config { field, problem });
        if self.n_head == 0 || !self.n_embd.is_multiple_of(self.n_head) {
            let problem = format!("{} heads do not divide {}", self.n_head, self.n_embd);
            return fail("n_head", problem);
        }
        if self.activation_function != "gelu_new" {
            let problem = format!("expected `gelu_new`, found `{}`", self.activation_function);
            return fail("activation_function", problem);
        }
        if !(0.0..1.0).contains(&self.resid_pdrop) {
            let problem = format!("must be in 0..1, found {}", self.resid_pdrop);
            return fail("resid_pdrop", problem);
        }
        if self.scale_attn_by_inverse_layer_idx {
            return fail(
                "scale_attn_by_inverse_layer_idx",
                "attention scaled by layer is not known here".into(),
            );
        }
        Ok(())
    }
}
