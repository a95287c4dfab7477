//! Shapes of the language model and the presets that name them.

use serde::{Deserialize, Serialize};

use super::LmError;

/// Feed-forward flavour of a T5 block.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FeedForward {
    /// `wo(relu(wi x))`, the original T5.
    Relu,
    /// `wo(gelu(wi_0 x) * wi_1 x)` with the tanh form of GELU, T5 v1.1 and FLAN-T5.
    GatedGelu,
}

/// Shape of a T5 encoder-decoder.
///
/// Raffel et al., *Exploring the Limits of Transfer Learning*, JMLR 2020; v1.1 differs in the
/// feed-forward and in not tying the output rows to the embedding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct T5Config {
    /// Embedding rows: text, sentinels, radar codes, markers.
    pub vocab_size: usize,
    /// Width of the residual stream.
    pub d_model: usize,
    /// Width of one head.
    pub d_kv: usize,
    /// Heads.
    pub n_heads: usize,
    /// Inner width of the feed-forward.
    pub d_ff: usize,
    /// Encoder blocks.
    pub n_encoder_layers: usize,
    /// Decoder blocks.
    pub n_decoder_layers: usize,
    /// Feed-forward flavour.
    pub feed_forward: FeedForward,
    /// Output rows are the embedding, scaled by `d_model^-0.5`.
    pub tie_embeddings: bool,
    /// Whether states are scaled by `d_model^-0.5` before the output rows; as `tie_embeddings` says
    /// without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale_outputs: Option<bool>,
    /// Buckets of the relative position bias.
    pub relative_buckets: usize,
    /// Distance at which the buckets saturate.
    pub relative_max_distance: usize,
    /// Dropout probability in training.
    pub dropout: f64,
    /// Added to the mean square in RMS norm.
    pub norm_eps: f64,
}

/// A language model and how radar enters it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LmConfig {
    /// The network; `vocab_size` is set from the vocabulary.
    pub t5: T5Config,
    /// Text vocabulary size when it is learned from captions, markers included.
    pub max_text_vocab: usize,
    /// Span-masking sentinels.
    pub n_sentinels: usize,
    /// Codes of the radar tokenizer.
    pub n_codes: usize,
    /// Width of the radar tokenizer's continuous feature.
    pub code_dim: usize,
    /// Adds the projected continuous feature to the code embedding (off in the paper).
    pub bypass: bool,
}

/// Named shapes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LmPreset {
    /// T5-small, the paper's: 6 + 6 layers, 8 heads, ReLU, tied, 60 M parameters.
    T5Small,
    /// FLAN-T5-small: 8 + 8 layers, 6 heads of 64, gated GELU, untied, 77 M parameters.
    FlanT5Small,
    /// 3 + 3 layers of width 128 that train on one CPU core, with the continuous bypass.
    Small,
}

/// No published T5 comes near these; they keep a hostile file from asking for terabytes.
const MOST_ROWS: usize = 1 << 20;
const MOST_WIDTH: usize = 1 << 16;
const MOST_LAYERS: usize = 128;

impl LmPreset {
    /// The preset's shape for a radar tokenizer of `n_codes` codes and `code_dim` features.
    pub fn config(self, n_codes: usize, code_dim: usize) -> LmConfig {
        let t5 = |d_model, d_kv, n_heads, d_ff, n_layers, feed_forward, tie_embeddings| T5Config {
            vocab_size: 0,
            d_model,
            d_kv,
            n_heads,
            d_ff,
            n_encoder_layers: n_layers,
            n_decoder_layers: n_layers,
            feed_forward,
            tie_embeddings,
            scale_outputs: None,
            relative_buckets: 32,
            relative_max_distance: 128,
            dropout: 0.1,
            norm_eps: 1e-6,
        };
        let (t5, max_text_vocab, n_sentinels, bypass) = match self {
            Self::T5Small => (
                t5(512, 64, 8, 2048, 6, FeedForward::Relu, true),
                32_000,
                100,
                false,
            ),
            Self::FlanT5Small => (
                t5(512, 64, 6, 1024, 8, FeedForward::GatedGelu, false),
                32_000,
                100,
                false,
            ),
            Self::Small => (
                t5(128, 32, 4, 512, 3, FeedForward::Relu, true),
                2_000,
                32,
                true,
            ),
        };
        LmConfig {
            t5,
            max_text_vocab,
            n_sentinels,
            n_codes,
            code_dim,
            bypass,
        }
    }
}

impl T5Config {
    /// Whether states are scaled by `d_model^-0.5` before the output rows.
    pub fn scales_outputs(&self) -> bool {
        self.scale_outputs.unwrap_or(self.tie_embeddings)
    }

    /// Width of all heads together.
    pub fn inner(&self) -> usize {
        self.n_heads * self.d_kv
    }

    /// Checks that the network can exist.
    ///
    /// # Errors
    /// [`LmError::Config`] names the first field out of range.
    pub fn validate(&self) -> Result<(), LmError> {
        for (field, value, least, most) in [
            ("vocab_size", self.vocab_size, 1, MOST_ROWS),
            ("d_model", self.d_model, 1, MOST_WIDTH),
            ("d_kv", self.d_kv, 1, MOST_WIDTH),
            ("n_heads", self.n_heads, 1, 1024),
            ("d_ff", self.d_ff, 1, MOST_WIDTH),
            ("n_encoder_layers", self.n_encoder_layers, 1, MOST_LAYERS),
            ("n_decoder_layers", self.n_decoder_layers, 1, MOST_LAYERS),
            // The bidirectional half is split again into exact and logarithmic buckets.
            ("relative_buckets", self.relative_buckets, 4, 4096),
            (
                "relative_max_distance",
                self.relative_max_distance,
                self.relative_buckets,
                1 << 20,
            ),
        ] {
            if value < least || value > most {
                let problem = format!("must be in {least}..={most}, found {value}");
                return Err(LmError::Config { field, problem });
            }
        }
        if !(0.0..1.0).contains(&self.dropout) {
            let problem = format!("must be in 0..1, found {}", self.dropout);
            return Err(LmError::Config {
                field: "dropout",
                problem,
            });
        }
        if !(self.norm_eps.is_finite() && self.norm_eps > 0.0) {
            let problem = format!("must be finite and positive, found {}", self.norm_eps);
            return Err(LmError::Config {
                field: "norm_eps",
                problem,
            });
        }
        Ok(())
    }
}

impl LmConfig {
    /// Checks the network's shape and the radar side.
    ///
    /// # Errors
    /// [`LmError::Config`] names the first field out of range.
    pub fn validate(&self) -> Result<(), LmError> {
        self.t5.validate()?;
        for (field, value, least, most) in [
            ("max_text_vocab", self.max_text_vocab, 3, MOST_ROWS),
            ("n_sentinels", self.n_sentinels, 1, 1000),
            ("n_codes", self.n_codes, 1, MOST_ROWS),
            ("code_dim", self.code_dim, 1, MOST_WIDTH),
        ] {
            if value < least || value > most {
                let problem = format!("must be in {least}..={most}, found {value}");
                return Err(LmError::Config { field, problem });
            }
        }
        Ok(())
    }
}
