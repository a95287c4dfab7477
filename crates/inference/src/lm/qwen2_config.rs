//! Shape of a Qwen2, with the field names of its `config.json`.

use serde::{Deserialize, Serialize};

use super::LmError;

/// The fields of a Qwen2 `config.json` that are used.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Qwen2Config {
    /// Number of rows of the embedding.
    pub vocab_size: usize,
    /// Width of the residual stream.
    pub hidden_size: usize,
    /// Inner width of the feed-forward network.
    pub intermediate_size: usize,
    /// Number of blocks.
    pub num_hidden_layers: usize,
    /// Number of query heads.
    pub num_attention_heads: usize,
    /// Number of key and value heads.
    pub num_key_value_heads: usize,
    /// Maximum length of a sequence.
    #[serde(default = "longest")]
    pub max_position_embeddings: usize,
    /// Epsilon that RMS norm adds to the mean square.
    #[serde(default = "epsilon")]
    pub rms_norm_eps: f64,
    /// Whether the output projection is tied to the embedding.
    #[serde(default)]
    pub tie_word_embeddings: bool,
    /// Activation function. Only `silu` is supported.
    #[serde(default = "silu_name")]
    pub hidden_act: String,
    /// Dropout probability of attention weights in training.
    #[serde(default)]
    pub attention_dropout: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rope_theta: Option<f64>,
    /// Newer files have the base of the rotary positions here.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rope_parameters: Option<RopeParameters>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rope_scaling: Option<serde_json::Value>,
    #[serde(default)]
    use_sliding_window: bool,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct RopeParameters {
    rope_theta: f64,
    #[serde(default = "default_rope")]
    rope_type: String,
}

fn longest() -> usize {
    32_768
}
fn epsilon() -> f64 {
    1e-6
}
fn silu_name() -> String {
    "silu".into()
}
fn default_rope() -> String {
    "default".into()
}

impl Qwen2Config {
    /// Creates a shape with tied embeddings. `heads` are the numbers of query heads and of key and value heads.
    pub fn new(hidden_size: usize, inner: usize, n_layers: usize, heads: [usize; 2]) -> Self {
        Self {
            vocab_size: 0,
            hidden_size,
            intermediate_size: inner,
            num_hidden_layers: n_layers,
            num_attention_heads: heads[0],
            num_key_value_heads: heads[1],
            max_position_embeddings: longest(),
            rms_norm_eps: epsilon(),
            tie_word_embeddings: true,
            hidden_act: silu_name(),
            attention_dropout: 0.0,
            rope_theta: Some(1e6),
            rope_parameters: None,
            rope_scaling: None,
            use_sliding_window: false,
        }
    }

    /// Checks that the shape is valid and supported.
    ///
    /// # Errors
    /// [`LmError::Config`].
    pub fn validate(&self) -> Result<(), LmError> {
        let fail = |field, problem| Err(LmError::Config { field, problem });
        let (heads, groups) = (self.num_attention_heads, self.num_key_value_heads);
        if heads == 0
            || !self.hidden_size.is_multiple_of(heads)
            || !(self.hidden_size / heads).is_multiple_of(2)
        {
            let problem = format!(
                "{heads} heads do not divide {} into even widths",
                self.hidden_size
            );
            return fail("num_attention_heads", problem);
        }
        if groups == 0 || !heads.is_multiple_of(groups) {
            let problem = format!("{groups} do not divide {heads} query heads");
            return fail("num_key_value_heads", problem);
        }
        if self.hidden_act != "silu" {
            let problem = format!("expected `silu`, found `{}`", self.hidden_act);
            return fail("hidden_act", problem);
        }
        if self.use_sliding_window {
            let problem = "sliding-window attention is not known here".into();
            return fail("use_sliding_window", problem);
        }
        let kind = self.rope_parameters.as_ref().map(|r| r.rope_type.as_str());
        if self.rope_scaling.is_some() || kind.is_some_and(|kind| kind != "default") {
            let problem = "scaled rotary positions are not known here".into();
            return fail("rope_scaling", problem);
        }
        if !(0.0..1.0).contains(&self.attention_dropout) {
            let problem = format!("must be in 0..1, found {}", self.attention_dropout);
            return fail("attention_dropout", problem);
        }
        let theta = self.theta();
        if !(theta.is_finite() && theta > 0.0) {
            let problem = format!("must be positive, found {theta}");
            return fail("rope_theta", problem);
        }
        Ok(())
    }

    /// Width of one head.
    pub fn head_width(&self) -> usize {
        self.hidden_size / self.num_attention_heads
    }

    /// Base of the rotary positions.
    pub fn theta(&self) -> f64 {
        let newer = self.rope_parameters.as_ref().map(|r| r.rope_theta);
        newer.or(self.rope_theta).unwrap_or(10_000.0)
    }
}
