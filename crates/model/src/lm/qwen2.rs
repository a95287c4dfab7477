//! Qwen2: a decoder with rotary positions, RMS norms, grouped key and value heads and a gated
//! feed-forward. DeepSeek-R1-Distill-Qwen-1.5B is one.
//!
//! Yang et al., *Qwen2 Technical Report*, 2024; rotary positions: Su et al., *RoFormer*, 2021.

use burn::module::Module;
use burn::tensor::activation::silu;
use burn::tensor::{Device, Tensor, TensorData};
use serde::Deserialize;

use super::LmError;
use super::layers::{Embedding, Linear, Loader, Norm, Rows, attend, split_heads};

/// The fields of a Qwen2 `config.json` that matter here.
#[derive(Clone, Debug, Deserialize)]
pub struct Qwen2Config {
    /// Embedding rows.
    pub vocab_size: usize,
    /// Width.
    pub hidden_size: usize,
    /// Inner width of the feed-forward.
    pub intermediate_size: usize,
    /// Blocks.
    pub num_hidden_layers: usize,
    /// Query heads.
    pub num_attention_heads: usize,
    /// Key and value heads.
    pub num_key_value_heads: usize,
    /// Longest sequence.
    #[serde(default = "longest")]
    pub max_position_embeddings: usize,
    /// Added to the mean square.
    #[serde(default = "epsilon")]
    pub rms_norm_eps: f64,
    /// Output rows are the embedding.
    #[serde(default)]
    pub tie_word_embeddings: bool,
    /// Only `silu` is known.
    #[serde(default = "silu_name")]
    pub hidden_act: String,
    #[serde(default)]
    rope_theta: Option<f64>,
    /// Where newer files keep the base of the rotation.
    #[serde(default)]
    rope_parameters: Option<RopeParameters>,
    #[serde(default)]
    rope_scaling: Option<serde_json::Value>,
    #[serde(default)]
    use_sliding_window: bool,
}

#[derive(Clone, Debug, Deserialize)]
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
    /// Refuses what cannot be, or is not known here.
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
        let theta = self.theta();
        if !(theta.is_finite() && theta > 0.0) {
            let problem = format!("must be positive, found {theta}");
            return fail("rope_theta", problem);
        }
        Ok(())
    }

    /// Base of the rotary positions.
    fn theta(&self) -> f64 {
        let newer = self.rope_parameters.as_ref().map(|r| r.rope_theta);
        newer.or(self.rope_theta).unwrap_or(10_000.0)
    }

    fn head_width(&self) -> usize {
        self.hidden_size / self.num_attention_heads
    }
}

/// The network.
#[derive(Module, Debug)]
pub struct Qwen2 {
    embed_tokens: Embedding,
    layers: Vec<Block>,
    norm: Norm,
    /// Output rows; the embedding without them.
    lm_head: Option<Embedding>,
    #[module(skip)]
    config: Qwen2Config,
}

#[derive(Module, Debug)]
struct Block {
    input_norm: Norm,
    q: Linear,
    k: Linear,
    v: Linear,
    o: Linear,
    post_norm: Norm,
    gate: Linear,
    up: Linear,
    down: Linear,
}

impl Qwen2 {
    /// Makes a network from a checkpoint's tensors, names without `model.`.
    ///
    /// # Errors
    /// Missing or unknown tensors, other shapes, impossible configurations.
    pub fn load(config: Qwen2Config, mut from: Loader) -> Result<Self, LmError> {
        config.validate()?;
        let (d, inner) = (config.hidden_size, config.intermediate_size);
        let narrow = config.num_key_value_heads * config.head_width();
        let embed_tokens = from.embedding("embed_tokens", [config.vocab_size, d])?;
        let mut layers = Vec::new();
        for i in 0..config.num_hidden_layers {
            let name = |part: &str| format!("layers.{i}.{part}");
            layers.push(Block {
                input_norm: from.norm(&name("input_layernorm"), d, false)?,
                q: from.linear(&name("self_attn.q_proj"), [d, d], true)?,
                k: from.linear(&name("self_attn.k_proj"), [d, narrow], true)?,
                v: from.linear(&name("self_attn.v_proj"), [d, narrow], true)?,
                o: from.linear(&name("self_attn.o_proj"), [d, d], false)?,
                post_norm: from.norm(&name("post_attention_layernorm"), d, false)?,
                gate: from.linear(&name("mlp.gate_proj"), [d, inner], false)?,
                up: from.linear(&name("mlp.up_proj"), [d, inner], false)?,
                down: from.linear(&name("mlp.down_proj"), [inner, d], false)?,
            });
        }
        let norm = from.norm("norm", d, false)?;
        let lm_head = (!config.tie_word_embeddings || from.has("lm_head.weight"))
            .then(|| from.embedding("lm_head", [config.vocab_size, d]))
            .transpose()?;
        from.finish(|name| name.ends_with("rotary_emb.inv_freq"))?;
        Ok(Self {
            embed_tokens,
            layers,
            norm,
            lm_head,
            config,
        })
    }

    /// The shape.
    pub fn config(&self) -> &Qwen2Config {
        &self.config
    }

    /// Logits `[batch * length, vocab_size]`. Positions count from the row's first id, padding or not
    /// (only their differences matter).
    pub fn logits(&self, rows: &Rows, device: &Device) -> Tensor<2> {
        let c = &self.config;
        let eps = c.rms_norm_eps;
        let (cos, sin) = self.rotation(rows.shape[1], device);
        let bias = rows.bias(true, device);
        let mut x = self.embed_tokens.forward(rows.tensor(device));
        for block in &self.layers {
            let y = block.input_norm.forward(x.clone(), eps);
            let heads =
                |linear: &Linear, n: usize| split_heads(linear.forward(y.clone()), rows.shape, n);
            let q = rotated(heads(&block.q, c.num_attention_heads), &cos, &sin);
            let k = rotated(heads(&block.k, c.num_key_value_heads), &cos, &sin);
            let v = heads(&block.v, c.num_key_value_heads);
            let copies = c.num_attention_heads / c.num_key_value_heads;
            let mixed = attend(q, repeated(k, copies), repeated(v, copies), bias.clone());
            x = x + block.o.forward(mixed);
            let y = block.post_norm.forward(x.clone(), eps);
            let inner = silu(block.gate.forward(y.clone())) * block.up.forward(y);
            x = x + block.down.forward(inner);
        }
        let x = self.norm.forward(x, eps);
        let head = self.lm_head.as_ref().unwrap_or(&self.embed_tokens);
        x.matmul(head.weight.val().swap_dims(0, 1))
    }

    /// Cosines and sines `[1, 1, length, head width]`: each half of a head turns by
    /// `position theta^(-2 i / width)`.
    fn rotation(&self, length: usize, device: &Device) -> (Tensor<4>, Tensor<4>) {
        let width = self.config.head_width();
        let half = width / 2;
        let angle = |position: usize, i: usize| {
            let exponent = -2.0 * (i % half) as f64 / width as f64;
            position as f64 * self.config.theta().powf(exponent)
        };
        let table = |f: fn(f64) -> f64| {
            let values: Vec<f32> = (0..length)
                .flat_map(|p| (0..width).map(move |i| (p, i)))
                .map(|(p, i)| f(angle(p, i)) as f32)
                .collect();
            Tensor::from_data(TensorData::new(values, [1, 1, length, width]), device)
        };
        (table(f64::cos), table(f64::sin))
    }
}

/// Turns the pairs (i, i + half) of `[batch, heads, length, width]`.
fn rotated(x: Tensor<4>, cos: &Tensor<4>, sin: &Tensor<4>) -> Tensor<4> {
    let half = x.dims()[3] / 2;
    let (first, second) = (
        x.clone().narrow(3, 0, half),
        x.clone().narrow(3, half, half),
    );
    let turned = Tensor::cat(vec![second.neg(), first], 3);
    x * cos.clone() + turned * sin.clone()
}

/// Every head `copies` times in a row.
fn repeated(x: Tensor<4>, copies: usize) -> Tensor<4> {
    let [batch, heads, length, width] = x.dims();
    x.reshape([batch, heads, 1, length, width])
        .repeat_dim(2, copies)
        .reshape([batch, heads * copies, length, width])
}
