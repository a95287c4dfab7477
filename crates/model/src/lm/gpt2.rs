//! GPT-2: a decoder with learned positions and layer norms before each part.
//!
//! Radford et al., *Language Models are Unsupervised Multitask Learners*, 2019. Checkpoints keep linear
//! weights as `[in, out]` and put query, key and value into one product.

use burn::module::Module;
use burn::tensor::activation::gelu_approximate;
use burn::tensor::{Device, Tensor};
use serde::Deserialize;

use super::LmError;
use super::layers::{Embedding, Linear, Loader, Norm, Rows, attend, ids_1d, split_heads};

/// The fields of a GPT-2 `config.json` that matter here.
#[derive(Clone, Debug, Deserialize)]
pub struct Gpt2Config {
    /// Embedding rows.
    pub vocab_size: usize,
    /// Width.
    pub n_embd: usize,
    /// Blocks.
    pub n_layer: usize,
    /// Heads.
    pub n_head: usize,
    /// Longest sequence.
    pub n_positions: usize,
    /// Inner width; four times the width without it.
    #[serde(default)]
    pub n_inner: Option<usize>,
    /// Added to the variance.
    #[serde(default = "epsilon")]
    pub layer_norm_epsilon: f64,
    /// Only `gelu_new`, the tanh form, is known.
    #[serde(default = "gelu")]
    pub activation_function: String,
    #[serde(default)]
    scale_attn_by_inverse_layer_idx: bool,
}

fn epsilon() -> f64 {
    1e-5
}

fn gelu() -> String {
    "gelu_new".into()
}

impl Gpt2Config {
    /// Refuses what cannot be, or is not known here.
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
        if self.scale_attn_by_inverse_layer_idx {
            return fail(
                "scale_attn_by_inverse_layer_idx",
                "attention scaled by layer is not known here".into(),
            );
        }
        Ok(())
    }
}

/// The network. Fields are named as the checkpoint's tensors are.
#[derive(Module, Debug)]
pub struct Gpt2 {
    wte: Embedding,
    wpe: Embedding,
    h: Vec<Block>,
    ln_f: Norm,
    /// Output rows; the embedding without them.
    lm_head: Option<Embedding>,
    #[module(skip)]
    config: Gpt2Config,
}

#[derive(Module, Debug)]
struct Block {
    ln_1: Norm,
    c_attn: Linear,
    attn_proj: Linear,
    ln_2: Norm,
    c_fc: Linear,
    mlp_proj: Linear,
}

impl Gpt2 {
    /// Makes a network from a checkpoint's tensors, names without `transformer.`.
    ///
    /// # Errors
    /// Missing or unknown tensors, other shapes, impossible configurations.
    pub fn load(config: Gpt2Config, mut from: Loader) -> Result<Self, LmError> {
        config.validate()?;
        let d = config.n_embd;
        let inner = config.n_inner.unwrap_or(d.saturating_mul(4));
        let wte = from.embedding("wte", [config.vocab_size, d])?;
        let wpe = from.embedding("wpe", [config.n_positions, d])?;
        let mut h = Vec::new();
        for i in 0..config.n_layer {
            h.push(Block {
                ln_1: from.norm(&format!("h.{i}.ln_1"), d, true)?,
                c_attn: from.linear(
                    &format!("h.{i}.attn.c_attn"),
                    [d, d.saturating_mul(3)],
                    true,
                )?,
                attn_proj: from.linear(&format!("h.{i}.attn.c_proj"), [d, d], true)?,
                ln_2: from.norm(&format!("h.{i}.ln_2"), d, true)?,
                c_fc: from.linear(&format!("h.{i}.mlp.c_fc"), [d, inner], true)?,
                mlp_proj: from.linear(&format!("h.{i}.mlp.c_proj"), [inner, d], true)?,
            });
        }
        let ln_f = from.norm("ln_f", d, true)?;
        let lm_head = from
            .has("lm_head.weight")
            .then(|| from.embedding("lm_head", [config.vocab_size, d]))
            .transpose()?;
        // Causal masks lie in old files as if they were weights.
        from.finish(|name| name.ends_with(".attn.bias") || name.ends_with(".attn.masked_bias"))?;
        Ok(Self {
            wte,
            wpe,
            h,
            ln_f,
            lm_head,
            config,
        })
    }

    /// The shape.
    pub fn config(&self) -> &Gpt2Config {
        &self.config
    }

    /// Logits `[batch * length, vocab_size]`. Positions count from the row's first id, padding or not.
    pub fn logits(&self, rows: &Rows, device: &Device) -> Tensor<2> {
        let [batch, length] = rows.shape;
        let eps = self.config.layer_norm_epsilon;
        let positions = (0..batch).flat_map(|_| 0..length as i32).collect();
        let mut x =
            self.wte.forward(rows.tensor(device)) + self.wpe.forward(ids_1d(positions, device));
        let bias = rows.bias(true, device);
        let d = self.config.n_embd;
        for block in &self.h {
            let qkv = block.c_attn.forward(block.ln_1.forward(x.clone(), eps));
            let part = |i: usize| {
                let part = qkv.clone().narrow(1, i * d, d);
                split_heads(part, rows.shape, self.config.n_head)
            };
            let mixed = attend(part(0), part(1), part(2), bias.clone());
            x = x + block.attn_proj.forward(mixed);
            let inner = block.c_fc.forward(block.ln_2.forward(x.clone(), eps));
            x = x + block.mlp_proj.forward(gelu_approximate(inner));
        }
        let x = self.ln_f.forward(x, eps);
        let head = self.lm_head.as_ref().unwrap_or(&self.wte);
        x.matmul(head.weight.val().swap_dims(0, 1))
    }
}
