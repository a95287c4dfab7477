//! Shapes of the language model, and named presets.

use serde::{Deserialize, Serialize};

use super::gpt2_config::Gpt2Config;
use super::qwen2_config::Qwen2Config;
use super::{LmError, Source};

/// Variant of the feed-forward network of a T5 block.
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
/// Raffel et al., *Exploring the Limits of Transfer Learning*, JMLR 2020; v1.1 differs in the feed-forward network and
/// in not tying the output projection to the embedding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct T5Config {
    /// Number of rows of the embedding: text, sentinels, radar codes, markers.
    pub vocab_size: usize,
    /// Width of the residual stream.
    pub d_model: usize,
    /// Width of one attention head.
    pub d_kv: usize,
    /// Number of attention heads.
    pub n_heads: usize,
    /// Inner width of the feed-forward network.
    pub d_ff: usize,
    /// Number of encoder blocks.
    pub n_encoder_layers: usize,
    /// Number of decoder blocks.
    pub n_decoder_layers: usize,
    /// Variant of the feed-forward network.
    pub feed_forward: FeedForward,
    /// The output projection is tied to the embedding, and scaled by `d_model^-0.5`.
    pub tie_embeddings: bool,
    /// Whether hidden states are scaled by `d_model^-0.5` before the output projection; if it is not set, the value of
    /// `tie_embeddings` applies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale_outputs: Option<bool>,
    /// Number of buckets of the relative position bias.
    pub relative_buckets: usize,
    /// Distance from which on all keys share the last bucket.
    pub relative_max_distance: usize,
    /// Dropout probability in training.
    pub dropout: f64,
    /// Epsilon that RMS norm adds to the mean square.
    pub norm_eps: f64,
}

/// Architectures that can be trained.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Backbone {
    /// Encoder-decoder.
    #[default]
    T5,
    /// Decoder-only, with learned positions.
    Gpt2,
    /// Decoder-only, with rotary positions; DeepSeek-R1-Distill-Qwen is one.
    Qwen2,
}

/// Shape of a network of one of the architectures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NetworkConfig {
    /// T5.
    T5(T5Config),
    /// GPT-2.
    Gpt2(Gpt2Config),
    /// Qwen2.
    Qwen2(Qwen2Config),
}

/// A language model and its radar input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LmConfig {
    /// The network. The size of its vocabulary is set from the vocabulary.
    #[serde(flatten)]
    pub network: NetworkConfig,
    /// Text vocabulary size when it is learned from captions, markers included.
    pub max_text_vocab: usize,
    /// Number of sentinels for span masking.
    pub n_sentinels: usize,
    /// Number of codes of the radar tokenizer.
    pub n_codes: usize,
    /// Width of the radar tokenizer's continuous feature.
    pub code_dim: usize,
    /// Adds the projected continuous feature to the code embedding (off in the paper).
    pub bypass: bool,
    /// Every code of a prompt is read as one mark with its projected feature, so that the feature alone tells codes apart
    /// ([`Self::project`]). Only the networks in burn run such a model.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub projected: bool,
}

impl LmConfig {
    /// Replaces the codes of a prompt by one mark if the model reads projected features alone; `mark` is the id of a code.
    pub fn project(&self, source: &mut Source, mark: u32) {
        if self.projected {
            for &position in &source.feature_positions {
                if let Some(id) = source.ids.get_mut(position as usize) {
                    *id = mark;
                }
            }
        }
    }
}

/// Named shapes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LmPreset {
    /// T5-small, the paper's: 6 + 6 layers, 8 heads, ReLU, tied, 60 M parameters.
    T5Small,
    /// FLAN-T5-small: 8 + 8 layers, 6 heads of 64, gated GELU, untied, 77 M parameters.
    FlanT5Small,
    /// T5: 3 + 3 layers of width 128, which can be trained on one CPU core, with the continuous bypass. GPT-2: its
    /// smallest published shape, 124 M parameters. Qwen2: 0.5B.
    Small,
    /// For one CPU core, with the continuous bypass. T5: 2 + 2 layers of width 64. GPT-2 and Qwen2: 3
    /// layers of width 128.
    Tiny,
    /// T5: T5-base, 223 M parameters. GPT-2: GPT-2 Medium, 355 M. Qwen2: 1.5B.
    Medium,
}

/// These limits are far above every published T5. They prevent a hostile file from requesting terabytes.
const MAX_ROWS: usize = 1 << 20;
const MAX_WIDTH: usize = 1 << 16;
const MAX_LAYERS: usize = 128;

impl LmPreset {
    /// Returns the T5 shape of this preset for a radar tokenizer of `n_codes` codes and `code_dim` features.
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
            Self::Tiny => (
                t5(64, 16, 4, 256, 2, FeedForward::Relu, true),
                2_000,
                32,
                true,
            ),
            Self::Medium => (
                t5(768, 64, 12, 3072, 12, FeedForward::Relu, true),
                32_000,
                100,
                false,
            ),
        };
        LmConfig {
            network: NetworkConfig::T5(t5),
            max_text_vocab,
            n_sentinels,
            n_codes,
            code_dim,
            bypass,
            projected: false,
        }
    }
}

impl Backbone {
    /// The shape that a preset has in this architecture. Shapes of decoders are those of the published
    /// `config.json` of gpt2, gpt2-medium, Qwen2-0.5B and Qwen2-1.5B.
    ///
    /// # Errors
    /// [`LmError::Config`] if the preset belongs to another architecture.
    pub fn config(
        self,
        preset: LmPreset,
        n_codes: usize,
        code_dim: usize,
    ) -> Result<LmConfig, LmError> {
        let network = match (self, preset) {
            (Self::T5, preset) => return Ok(preset.config(n_codes, code_dim)),
            (_, LmPreset::T5Small | LmPreset::FlanT5Small) => {
                return Err(LmError::Config {
                    field: "preset",
                    problem: "is T5's; gpt2 and qwen2 have tiny, small and medium".into(),
                });
            }
            (Self::Gpt2, LmPreset::Tiny) => NetworkConfig::Gpt2(Gpt2Config::new(128, 3, 256)),
            (Self::Gpt2, LmPreset::Small) => NetworkConfig::Gpt2(Gpt2Config::new(768, 12, 1024)),
            (Self::Gpt2, LmPreset::Medium) => NetworkConfig::Gpt2(Gpt2Config::new(1024, 24, 1024)),
            (Self::Qwen2, LmPreset::Tiny) => {
                NetworkConfig::Qwen2(Qwen2Config::new(128, 352, 3, [4, 2]))
            }
            (Self::Qwen2, LmPreset::Small) => {
                NetworkConfig::Qwen2(Qwen2Config::new(896, 4864, 24, [14, 2]))
            }
            (Self::Qwen2, LmPreset::Medium) => {
                NetworkConfig::Qwen2(Qwen2Config::new(1536, 8960, 28, [12, 2]))
            }
        };
        let is_tiny = preset == LmPreset::Tiny;
        Ok(LmConfig {
            network,
            max_text_vocab: if is_tiny { 2_000 } else { 32_000 },
            n_sentinels: 32,
            n_codes,
            code_dim,
            bypass: is_tiny,
            projected: false,
        })
    }

    /// Name, as in a `model_type`.
    pub fn name(self) -> &'static str {
        match self {
            Self::T5 => "t5",
            Self::Gpt2 => "gpt2",
            Self::Qwen2 => "qwen2",
        }
    }
}

impl NetworkConfig {
    /// The architecture.
    pub fn backbone(&self) -> Backbone {
        match self {
            Self::T5(_) => Backbone::T5,
            Self::Gpt2(_) => Backbone::Gpt2,
            Self::Qwen2(_) => Backbone::Qwen2,
        }
    }

    /// Number of rows of the embedding.
    pub fn vocab_size(&self) -> usize {
        match self {
            Self::T5(c) => c.vocab_size,
            Self::Gpt2(c) => c.vocab_size,
            Self::Qwen2(c) => c.vocab_size,
        }
    }

    /// Sets the number of rows of the embedding.
    pub fn set_vocab_size(&mut self, rows: usize) {
        match self {
            Self::T5(c) => c.vocab_size = rows,
            Self::Gpt2(c) => c.vocab_size = rows,
            Self::Qwen2(c) => c.vocab_size = rows,
        }
    }

    /// Sets the dropout probability in training.
    pub fn set_dropout(&mut self, p: f64) {
        match self {
            Self::T5(c) => c.dropout = p,
            Self::Gpt2(c) => c.resid_pdrop = p,
            Self::Qwen2(c) => c.attention_dropout = p,
        }
    }

    /// Width of the residual stream.
    pub fn width(&self) -> usize {
        match self {
            Self::T5(c) => c.d_model,
            Self::Gpt2(c) => c.n_embd,
            Self::Qwen2(c) => c.hidden_size,
        }
    }

    /// Checks that the shape is valid.
    ///
    /// # Errors
    /// [`LmError::Config`] names the first field out of range.
    pub fn validate(&self) -> Result<(), LmError> {
        match self {
            Self::T5(c) => c.validate(),
            Self::Gpt2(c) => c.validate(),
            Self::Qwen2(c) => c.validate(),
        }
    }
}

impl T5Config {
    /// Returns whether hidden states are scaled by `d_model^-0.5` before the output projection.
    pub fn scales_outputs(&self) -> bool {
        self.scale_outputs.unwrap_or(self.tie_embeddings)
    }

    /// Width of all heads together.
    pub fn inner(&self) -> usize {
        self.n_heads * self.d_kv
    }

    /// Checks that the shape is valid.
    ///
    /// # Errors
    /// [`LmError::Config`] names the first field out of range.
    pub fn validate(&self) -> Result<(), LmError> {
        for (field, value, min, max) in [
            ("vocab_size", self.vocab_size, 1, MAX_ROWS),
            ("d_model", self.d_model, 1, MAX_WIDTH),
            ("d_kv", self.d_kv, 1, MAX_WIDTH),
            ("n_heads", self.n_heads, 1, 1024),
            ("d_ff", self.d_ff, 1, MAX_WIDTH),
            ("n_encoder_layers", self.n_encoder_layers, 1, MAX_LAYERS),
            ("n_decoder_layers", self.n_decoder_layers, 1, MAX_LAYERS),
            // The bidirectional half is split again into exact and logarithmic buckets.
            ("relative_buckets", self.relative_buckets, 4, 4096),
            (
                "relative_max_distance",
                self.relative_max_distance,
                self.relative_buckets,
                1 << 20,
            ),
        ] {
            if value < min || value > max {
                let problem = format!("must be in {min}..={max}, found {value}");
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
    /// The shape of a T5.
    pub fn t5(&self) -> Option<&T5Config> {
        match &self.network {
            NetworkConfig::T5(t5) => Some(t5),
            _ => None,
        }
    }

    /// Checks the network's shape and the radar side.
    ///
    /// # Errors
    /// [`LmError::Config`] names the first field out of range.
    pub fn validate(&self) -> Result<(), LmError> {
        self.network.validate()?;
        for (field, value, min, max) in [
            ("max_text_vocab", self.max_text_vocab, 3, MAX_ROWS),
            ("n_sentinels", self.n_sentinels, 1, 1000),
            ("n_codes", self.n_codes, 1, MAX_ROWS),
            ("code_dim", self.code_dim, 1, MAX_WIDTH),
        ] {
            if value < min || value > max {
                let problem = format!("must be in {min}..={max}, found {value}");
                return Err(LmError::Config { field, problem });
            }
        }
        Ok(())
    }
}
