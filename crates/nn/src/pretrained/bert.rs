//! BERT and RoBERTa: bidirectional encoders with layer norms after each sublayer. The metrics BERTScore and
//! SimCSE use them to embed text.
//!
//! Devlin et al., *BERT*, 2019; Liu et al., *RoBERTa*, 2019.

use burn::module::Module;
use burn::tensor::activation::{gelu, tanh};
use burn::tensor::{Device, Tensor};
use serde::Deserialize;

use super::layers::{Embedding, Linear, Loader, Norm, attend, split_heads};
use crate::lm::rows::{Rows, ids_1d};
use radarllm_inference::lm::LmError;

/// The fields of a BERT or RoBERTa `config.json` that are used here.
#[derive(Clone, Debug, Deserialize)]
pub struct BertConfig {
    /// `bert`, `roberta` or `xlm-roberta`. The last two count positions from the padding id.
    pub model_type: String,
    /// Embedding rows.
    pub vocab_size: usize,
    /// Width.
    pub hidden_size: usize,
    /// Blocks.
    pub num_hidden_layers: usize,
    /// Heads.
    pub num_attention_heads: usize,
    /// Inner width of the feed-forward.
    pub intermediate_size: usize,
    /// Position rows.
    pub max_position_embeddings: usize,
    /// Segment rows.
    pub type_vocab_size: usize,
    /// Epsilon that is added to the variance.
    #[serde(default = "epsilon")]
    pub layer_norm_eps: f64,
    /// Only `gelu`, the exact form, is supported.
    #[serde(default = "gelu_name")]
    pub hidden_act: String,
    /// Id of padding.
    #[serde(default)]
    pub pad_token_id: Option<usize>,
    #[serde(default)]
    position_embedding_type: Option<String>,
}

fn epsilon() -> f64 {
    1e-12
}
fn gelu_name() -> String {
    "gelu".into()
}

impl BertConfig {
    /// Rejects impossible and unsupported configurations.
    ///
    /// # Errors
    /// [`LmError::Config`].
    pub fn validate(&self) -> Result<(), LmError> {
        let fail = |field, problem| Err(LmError::Config { field, problem });
        let heads = self.num_attention_heads;
        if heads == 0 || !self.hidden_size.is_multiple_of(heads) {
            let problem = format!("{heads} heads do not divide {}", self.hidden_size);
            return fail("num_attention_heads", problem);
        }
        if self.hidden_act != "gelu" {
            let problem = format!("expected `gelu`, found `{}`", self.hidden_act);
            return fail("hidden_act", problem);
        }
        let positions = self
            .position_embedding_type
            .as_deref()
            .unwrap_or("absolute");
        if positions != "absolute" {
            let problem = format!("expected `absolute`, found `{positions}`");
            return fail("position_embedding_type", problem);
        }
        if self.longest() == 0 {
            let problem = format!("{} rows leave no position", self.max_position_embeddings);
            return fail("max_position_embeddings", problem);
        }
        Ok(())
    }

    /// Position of the first token.
    fn first_position(&self) -> usize {
        match self.model_type.as_str() {
            "bert" => 0,
            _ => self.pad().saturating_add(1),
        }
    }

    fn pad(&self) -> usize {
        match self.model_type.as_str() {
            "bert" => self.pad_token_id.unwrap_or(0),
            _ => self.pad_token_id.unwrap_or(1),
        }
    }

    /// Maximum sequence length.
    pub fn longest(&self) -> usize {
        self.max_position_embeddings
            .saturating_sub(self.first_position())
    }
}

/// The network.
#[derive(Module, Debug)]
pub struct Bert {
    words: Embedding,
    positions: Embedding,
    segments: Embedding,
    norm: Norm,
    layers: Vec<Block>,
    /// Dense layer over the first token's state. Checkpoints of the encoder alone have none.
    pooler: Option<Linear>,
    #[module(skip)]
    config: BertConfig,
}

#[derive(Module, Debug)]
struct Block {
    query: Linear,
    key: Linear,
    value: Linear,
    attention_out: Linear,
    attention_norm: Norm,
    inner: Linear,
    out: Linear,
    out_norm: Norm,
}

impl Bert {
    /// Builds a network from a checkpoint's tensors, with names without `bert.` or `roberta.`. Heads for
    /// other tasks are ignored.
    ///
    /// # Errors
    /// Missing tensors, mismatched shapes, impossible configurations.
    pub fn load(config: BertConfig, mut from: Loader) -> Result<Self, LmError> {
        config.validate()?;
        let (d, inner) = (config.hidden_size, config.intermediate_size);
        let words = from.embedding("embeddings.word_embeddings", [config.vocab_size, d])?;
        let positions = from.embedding(
            "embeddings.position_embeddings",
            [config.max_position_embeddings, d],
        )?;
        let segments = from.embedding(
            "embeddings.token_type_embeddings",
            [config.type_vocab_size, d],
        )?;
        let norm = from.norm("embeddings.LayerNorm", d, true)?;
        let mut layers = Vec::new();
        for i in 0..config.num_hidden_layers {
            let name = |part: &str| format!("encoder.layer.{i}.{part}");
            layers.push(Block {
                query: from.linear(&name("attention.self.query"), [d, d], true)?,
                key: from.linear(&name("attention.self.key"), [d, d], true)?,
                value: from.linear(&name("attention.self.value"), [d, d], true)?,
                attention_out: from.linear(&name("attention.output.dense"), [d, d], true)?,
                attention_norm: from.norm(&name("attention.output.LayerNorm"), d, true)?,
                inner: from.linear(&name("intermediate.dense"), [d, inner], true)?,
                out: from.linear(&name("output.dense"), [inner, d], true)?,
                out_norm: from.norm(&name("output.LayerNorm"), d, true)?,
            });
        }
        let pooler = from
            .has("pooler.dense.weight")
            .then(|| from.linear("pooler.dense", [d, d], true))
            .transpose()?;
        from.finish(|name| {
            ["cls.", "lm_head.", "classifier.", "embeddings.position_ids"]
                .iter()
                .any(|known| name.starts_with(known))
        })?;
        Ok(Self {
            words,
            positions,
            segments,
            norm,
            layers,
            pooler,
            config,
        })
    }

    /// The architecture.
    pub fn config(&self) -> &BertConfig {
        &self.config
    }

    /// Hidden states `[batch * length, hidden_size]` after `n_layers` blocks (0: the embeddings). `n_layers` is limited
    /// to the number of blocks.
    pub fn states(&self, rows: &Rows, n_layers: usize, device: &Device) -> Tensor<2> {
        let c = &self.config;
        let eps = c.layer_norm_eps;
        let segments = vec![0; rows.ids.len()];
        let mut x = self.words.forward(rows.tensor(device))
            + self
                .positions
                .forward(ids_1d(self.position_ids(rows), device))
            + self.segments.forward(ids_1d(segments, device));
        x = self.norm.forward(x, eps);
        let bias = rows.bias(false, device);
        for block in self.layers.iter().take(n_layers) {
            let heads = |linear: &Linear| {
                split_heads(linear.forward(x.clone()), rows.shape, c.num_attention_heads)
            };
            let (q, k, v) = (heads(&block.query), heads(&block.key), heads(&block.value));
            let mixed = block.attention_out.forward(attend(q, k, v, bias.clone()));
            let y = block.attention_norm.forward(x + mixed, eps);
            let fed = block.out.forward(gelu(block.inner.forward(y.clone())));
            x = block.out_norm.forward(y + fed, eps);
        }
        x
    }

    /// Whether the checkpoint has a pooler.
    pub fn has_pooler(&self) -> bool {
        self.pooler.is_some()
    }

    /// `tanh(W first + b)` of the first tokens' states `[batch, hidden_size]`; `None` without a pooler.
    pub fn pooled(&self, first: Tensor<2>) -> Option<Tensor<2>> {
        Some(tanh(self.pooler.as_ref()?.forward(first)))
    }

    /// BERT counts positions; RoBERTa counts the ids that are not padding, from the padding id.
    fn position_ids(&self, rows: &Rows) -> Vec<i32> {
        let length = rows.shape[1];
        let pad = self.config.pad();
        let is_bert = self.config.model_type == "bert";
        let mut out = Vec::with_capacity(rows.ids.len());
        for row in rows.ids.chunks_exact(length) {
            let mut seen = 0;
            for (place, &id) in row.iter().enumerate() {
                seen += usize::from(id as usize != pad);
                let position = if is_bert {
                    place
                } else if id as usize == pad {
                    pad
                } else {
                    pad + seen
                };
                out.push(position as i32);
            }
        }
        out
    }
}
