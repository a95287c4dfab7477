//! Qwen2: a decoder with rotary positions, RMS norms, grouped key and value heads and a gated
//! feed-forward. DeepSeek-R1-Distill-Qwen-1.5B is one.
//!
//! Yang et al., *Qwen2 Technical Report*, 2024; rotary positions: Su et al., *RoFormer*, 2021.

use burn::module::Module;
use burn::tensor::activation::silu;
use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};

use super::LmError;
use super::layers::{Embedding, Linear, Loader, Norm, Past, Rows, Steps, attend_with, split_heads};
use super::t5::Drop;

/// The fields of a Qwen2 `config.json` that matter here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
    /// Dropout probability of attention weights in training.
    #[serde(default)]
    pub attention_dropout: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rope_theta: Option<f64>,
    /// Where newer files keep the base of the rotation.
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
    /// A shape with tied rows; `heads` are of queries and of keys and values.
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

    /// Base of the rotary positions.
    fn theta(&self) -> f64 {
        let newer = self.rope_parameters.as_ref().map(|r| r.rope_theta);
        newer.or(self.rope_theta).unwrap_or(10_000.0)
    }

    fn head_width(&self) -> usize {
        self.hidden_size / self.num_attention_heads
    }
}

/// The network. Fields are named as the checkpoint's tensors are.
#[derive(Module, Debug)]
pub struct Qwen2 {
    pub(super) embed_tokens: Embedding,
    layers: Vec<Block>,
    norm: Norm,
    /// Output rows; the embedding without them.
    pub(super) lm_head: Option<Embedding>,
    #[module(skip)]
    config: Qwen2Config,
}

#[derive(Module, Debug)]
struct Block {
    input_layernorm: Norm,
    self_attn: Attention,
    post_attention_layernorm: Norm,
    mlp: Mlp,
}

#[derive(Module, Debug)]
struct Attention {
    q_proj: Linear,
    k_proj: Linear,
    v_proj: Linear,
    o_proj: Linear,
}

#[derive(Module, Debug)]
struct Mlp {
    gate_proj: Linear,
    up_proj: Linear,
    down_proj: Linear,
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
                input_layernorm: from.norm(&name("input_layernorm"), d, false)?,
                self_attn: Attention {
                    q_proj: from.linear(&name("self_attn.q_proj"), [d, d], true)?,
                    k_proj: from.linear(&name("self_attn.k_proj"), [d, narrow], true)?,
                    v_proj: from.linear(&name("self_attn.v_proj"), [d, narrow], true)?,
                    o_proj: from.linear(&name("self_attn.o_proj"), [d, d], false)?,
                },
                post_attention_layernorm: from.norm(&name("post_attention_layernorm"), d, false)?,
                mlp: Mlp {
                    gate_proj: from.linear(&name("mlp.gate_proj"), [d, inner], false)?,
                    up_proj: from.linear(&name("mlp.up_proj"), [d, inner], false)?,
                    down_proj: from.linear(&name("mlp.down_proj"), [inner, d], false)?,
                },
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

    /// A network drawn from `seed`: normal numbers of standard deviation 0.02, as the reference draws.
    ///
    /// # Errors
    /// Impossible configurations.
    pub fn new(config: Qwen2Config, seed: u64, device: &Device) -> Result<Self, LmError> {
        Self::load(config, Loader::random(seed, 0.02, 0.02, device))
    }

    /// The shape.
    pub fn config(&self) -> &Qwen2Config {
        &self.config
    }

    /// Sets the dropout probability in training.
    pub(super) fn set_dropout(&mut self, p: f64) {
        self.config.attention_dropout = p;
    }

    /// The layers that take adapters: queries and values.
    pub(super) fn adapted(&mut self) -> impl Iterator<Item = &mut Linear> {
        let attentions = self.layers.iter_mut().map(|block| &mut block.self_attn);
        attentions.flat_map(|a| [&mut a.q_proj, &mut a.v_proj])
    }

    /// Logits `[batch * length, vocab_size]`. Positions count from the row's first id, padding or not
    /// (only their differences matter).
    pub fn logits(&self, rows: &Rows, device: &Device) -> Tensor<2> {
        let x = self.embed_tokens.forward(rows.tensor(device));
        let x = self.states(x, &rows.steps(false, device), None, &mut Drop::none());
        self.head().products(x, self.config.vocab_size)
    }

    /// Output rows.
    pub(super) fn head(&self) -> &Embedding {
        self.lm_head.as_ref().unwrap_or(&self.embed_tokens)
    }

    /// Final states `[batch * length, hidden_size]` of embedded ids, after what `past` holds.
    pub(super) fn states(
        &self,
        x: Tensor<2>,
        steps: &Steps,
        mut past: Option<&mut Past>,
        drop: &mut Drop,
    ) -> Tensor<2> {
        let c = &self.config;
        let eps = c.rms_norm_eps;
        let (cos, sin) = self.rotation(steps, &x.device());
        let mut x = x;
        for (i, block) in self.layers.iter().enumerate() {
            let y = block.input_layernorm.forward(x.clone(), eps);
            let a = &block.self_attn;
            let mut heads = |linear: &Linear, n: usize| {
                split_heads(linear.forward_with(y.clone(), drop), steps.shape, n)
            };
            let q = rotated(heads(&a.q_proj, c.num_attention_heads), &cos, &sin);
            let mut k = rotated(heads(&a.k_proj, c.num_key_value_heads), &cos, &sin);
            let mut v = heads(&a.v_proj, c.num_key_value_heads);
            if let Some(past) = &mut past {
                (k, v) = past.extend(i, k, v);
            }
            let copies = c.num_attention_heads / c.num_key_value_heads;
            let (k, v) = (repeated(k, copies), repeated(v, copies));
            x = x + a
                .o_proj
                .forward(attend_with(q, k, v, steps.bias.clone(), drop));
            let y = block.post_attention_layernorm.forward(x.clone(), eps);
            let m = &block.mlp;
            let inner = silu(m.gate_proj.forward(y.clone())) * m.up_proj.forward(y);
            x = x + m.down_proj.forward(inner);
        }
        self.norm.forward(x, eps)
    }

    /// Cosines and sines `[batch, 1, length, head width]`: each half of a head turns by
    /// `position theta^(-2 i / width)`.
    fn rotation(&self, steps: &Steps, device: &Device) -> (Tensor<4>, Tensor<4>) {
        let [batch, length] = steps.shape;
        let width = self.config.head_width();
        let half = width / 2;
        let angle = |position: usize, i: usize| {
            let exponent = -2.0 * (i % half) as f64 / width as f64;
            position as f64 * self.config.theta().powf(exponent)
        };
        let table = |f: fn(f64) -> f64| {
            let positions = steps.positions.iter();
            let values: Vec<f32> = positions
                .flat_map(|p| (0..width).map(move |i| (*p, i)))
                .map(|(p, i)| f(angle(p, i)) as f32)
                .collect();
            Tensor::from_data(TensorData::new(values, [batch, 1, length, width]), device)
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
