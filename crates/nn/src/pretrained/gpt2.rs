//! GPT-2: a decoder with learned positions and layer norms before each sublayer.
//!
//! Radford et al., *Language Models are Unsupervised Multitask Learners*, 2019. Checkpoints store linear
//! weights as `[in, out]` and combine query, key and value in one product.

use burn::module::Module;
use burn::tensor::activation::gelu_approximate;
use burn::tensor::{Device, Tensor};

use super::layers::{Embedding, Linear, Loader, Norm, Past, attend_with, split_heads};
use crate::lm::pass::ForwardPass;
use crate::lm::rows::{Rows, Steps, ids_1d};
use crate::precision::ProductPrecision;
use radarllm_inference::lm::LmError;
use radarllm_inference::lm::gpt2_config::Gpt2Config;

/// The network. Fields have the names of the checkpoint's tensors.
#[derive(Module, Debug)]
pub struct Gpt2 {
    pub(super) wte: Embedding,
    wpe: Embedding,
    h: Vec<Block>,
    ln_f: Norm,
    /// Output rows. If absent, the embedding is used.
    pub(super) lm_head: Option<Embedding>,
    #[module(skip)]
    config: Gpt2Config,
}

#[derive(Module, Debug)]
struct Block {
    ln_1: Norm,
    attn: Attention,
    ln_2: Norm,
    mlp: Mlp,
}

#[derive(Module, Debug)]
struct Attention {
    /// Query, key and value in one.
    c_attn: Linear,
    c_proj: Linear,
}

#[derive(Module, Debug)]
struct Mlp {
    c_fc: Linear,
    c_proj: Linear,
}

impl Gpt2 {
    /// Builds a network from a checkpoint's tensors, with names without `transformer.`.
    ///
    /// # Errors
    /// Missing or unknown tensors, mismatched shapes, impossible configurations.
    pub fn load(config: Gpt2Config, mut from: Loader) -> Result<Self, LmError> {
        config.validate()?;
        let d = config.n_embd;
        let inner = config.n_inner.unwrap_or(d.saturating_mul(4));
        let wte = from.embedding("wte", [config.vocab_size, d])?;
        let wpe = from.embedding("wpe", [config.n_positions, d])?;
        let mut h = Vec::new();
        for i in 0..config.n_layer {
            let name = |part: &str| format!("h.{i}.{part}");
            h.push(Block {
                ln_1: from.norm(&name("ln_1"), d, true)?,
                attn: Attention {
                    c_attn: from.linear(&name("attn.c_attn"), [d, d.saturating_mul(3)], true)?,
                    c_proj: from.linear(&name("attn.c_proj"), [d, d], true)?,
                },
                ln_2: from.norm(&name("ln_2"), d, true)?,
                mlp: Mlp {
                    c_fc: from.linear(&name("mlp.c_fc"), [d, inner], true)?,
                    c_proj: from.linear(&name("mlp.c_proj"), [inner, d], true)?,
                },
            });
        }
        let ln_f = from.norm("ln_f", d, true)?;
        let lm_head = from
            .has("lm_head.weight")
            .then(|| from.embedding("lm_head", [config.vocab_size, d]))
            .transpose()?;
        // Old files store causal masks as if they were weights.
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

    /// A network with the paper's initialisation, drawn from `seed`.
    ///
    /// # Errors
    /// Impossible configurations.
    pub fn new(config: Gpt2Config, seed: u64, device: &Device) -> Result<Self, LmError> {
        const STD: f64 = 0.02;
        // Every block adds two branches to the residual stream.
        let residual = STD / (2.0 * config.n_layer as f64).sqrt();
        Self::load(config, Loader::random(seed, STD, residual, device))
    }

    /// The architecture.
    pub fn config(&self) -> &Gpt2Config {
        &self.config
    }

    /// Sets the dropout probability in training.
    pub(super) fn set_dropout(&mut self, p: f64) {
        self.config.resid_pdrop = p;
    }

    /// The layers that take adapters: one per block, for query, key and value.
    pub(super) fn adapted(&mut self) -> impl Iterator<Item = &mut Linear> {
        self.h.iter_mut().map(|block| &mut block.attn.c_attn)
    }

    /// Logits `[batch * length, vocab_size]`. Positions count from the row's first id, padding or not.
    pub fn logits(&self, rows: &Rows, device: &Device) -> Tensor<2> {
        let x = self.wte.forward(rows.tensor(device));
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
        self.lm_head.as_ref().unwrap_or(&self.wte)
    }

    /// Final states `[batch * length, n_embd]` of embedded ids that follow the content of `past`.
    pub(super) fn states(
        &self,
        x: Tensor<2>,
        steps: &Steps,
        mut past: Option<&mut Past>,
        drop: &mut ForwardPass,
    ) -> Tensor<2> {
        let eps = self.config.layer_norm_epsilon;
        let d = self.config.n_embd;
        let positions = steps.positions.iter().map(|p| *p as i32).collect();
        let mut x = drop.apply(x.clone() + self.wpe.forward(ids_1d(positions, &x.device())));
        for (i, block) in self.h.iter().enumerate() {
            let y = block.ln_1.forward(x.clone(), eps);
            let qkv = block.attn.c_attn.forward_with(y, drop);
            let part = |i: usize| {
                let part = qkv.clone().narrow(1, i * d, d);
                split_heads(part, steps.shape, self.config.n_head)
            };
            let (q, mut k, mut v) = (part(0), part(1), part(2));
            if let Some(past) = &mut past {
                (k, v) = past.extend(i, k, v);
            }
            let mixed = attend_with(q, k, v, steps.bias.clone(), drop);
            let y = block.attn.c_proj.forward_with(mixed, drop);
            x = x + drop.apply(y);
            let inner = block
                .mlp
                .c_fc
                .forward_with(block.ln_2.forward(x.clone(), eps), drop);
            let y = (block.mlp.c_proj).forward_with(gelu_approximate(inner), drop);
            x = x + drop.apply(y);
        }
        self.ln_f.forward(x, eps)
    }
}
