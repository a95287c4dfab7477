//! Qwen2: a decoder with rotary positions, RMS norms, grouped key and value heads and a gated
//! feed-forward. DeepSeek-R1-Distill-Qwen-1.5B is one.
//!
//! Yang et al., *Qwen2 Technical Report*, 2024; rotary positions: Su et al., *RoFormer*, 2021.

use burn::module::Module;
use burn::tensor::activation::silu;
use burn::tensor::{Device, Tensor, TensorData};

use super::layers::{Embedding, Linear, Loader, Norm, Past, attend_with, split_heads};
use crate::lm::pass::ForwardPass;
use crate::precision::ProductPrecision;
use radarllm_inference::lm::LmError;
use radarllm_inference::lm::qwen2_config::Qwen2Config;

use crate::lm::rows::{Rows, Steps};

/// The network. Fields have the names of the checkpoint's tensors.
#[derive(Module, Debug)]
pub struct Qwen2 {
    pub(super) embed_tokens: Embedding,
    layers: Vec<Block>,
    norm: Norm,
    /// Output rows. If absent, the embedding is used.
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
    /// Builds a network from a checkpoint's tensors, with names without `model.`.
    ///
    /// # Errors
    /// Missing or unknown tensors, mismatched shapes, impossible configurations.
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

    /// A network drawn from `seed`, with the reference initialisation: normal numbers of standard deviation 0.02.
    ///
    /// # Errors
    /// Impossible configurations.
    pub fn new(config: Qwen2Config, seed: u64, device: &Device) -> Result<Self, LmError> {
        Self::load(config, Loader::random(seed, 0.02, 0.02, device))
    }

    /// The architecture.
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
        let x = self.states(
            x,
            &rows.steps(false, device),
            None,
            &mut ForwardPass::inference(),
        );
        self.head()
            .products(x, self.config.vocab_size, ProductPrecision::F32)
    }

    /// Output rows.
    pub(super) fn head(&self) -> &Embedding {
        self.lm_head.as_ref().unwrap_or(&self.embed_tokens)
    }

    /// Final states `[batch * length, hidden_size]` of embedded ids that follow the content of `past`.
    pub(super) fn states(
        &self,
        x: Tensor<2>,
        steps: &Steps,
        mut past: Option<&mut Past>,
        drop: &mut ForwardPass,
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
                .forward_with(attend_with(q, k, v, steps.bias.clone(), drop), drop);
            let y = block.post_attention_layernorm.forward(x.clone(), eps);
            let m = &block.mlp;
            let inner =
                silu(m.gate_proj.forward_with(y.clone(), drop)) * m.up_proj.forward_with(y, drop);
            x = x + m.down_proj.forward_with(inner, drop);
        }
        self.norm.forward(x, eps)
    }

    /// Cosines and sines `[batch, 1, length, head width]` of the rotation angles
    /// `position theta^(-2 i / width)`, one per dimension i of half a head.
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

/// Rotates the pairs (i, i + half) of `[batch, heads, length, width]`.
fn rotated(x: Tensor<4>, cos: &Tensor<4>, sin: &Tensor<4>) -> Tensor<4> {
    let half = x.dims()[3] / 2;
    let (first, second) = (
        x.clone().narrow(3, 0, half),
        x.clone().narrow(3, half, half),
    );
    let turned = Tensor::cat(vec![second.neg(), first], 3);
    x * cos.clone() + turned * sin.clone()
}

/// Repeats every head `copies` times consecutively.
fn repeated(x: Tensor<4>, copies: usize) -> Tensor<4> {
    let [batch, heads, length, width] = x.dims();
    x.reshape([batch, heads, 1, length, width])
        .repeat_dim(2, copies)
        .reshape([batch, heads * copies, length, width])
}
