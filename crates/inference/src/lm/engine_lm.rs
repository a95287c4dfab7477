//! The language model on [`radarllm_engine`]: packed weights, without a learning framework.

use std::path::Path;

use radarllm_engine::{Engine, Precision, Session, Shape, Source, Watch};

use super::LmError;
use super::card::{Learned, LmFiles};
use super::config::{FeedForward, LmConfig};
use super::generate::{GenerateOptions, Generated, decode};
use super::vocab::Vocab;
use crate::checkpoint::{Checkpoint, CheckpointError, NamedTensors};

impl LmConfig {
    /// Shape of the network in the form that the engine uses; `None` for a decoder-only network and for a model of projected
    /// codes, which the engine does not support.
    pub fn engine_shape(&self) -> Option<Shape> {
        let c = self.t5().filter(|_| !self.projected)?;
        Some(Shape {
            vocab_size: c.vocab_size,
            d_model: c.d_model,
            d_kv: c.d_kv,
            n_heads: c.n_heads,
            d_ff: c.d_ff,
            n_encoder_layers: c.n_encoder_layers,
            n_decoder_layers: c.n_decoder_layers,
            gated: c.feed_forward == FeedForward::GatedGelu,
            tied: c.tie_embeddings,
            scaled: c.scales_outputs(),
            relative_buckets: c.relative_buckets,
            relative_max_distance: c.relative_max_distance,
            norm_eps: c.norm_eps as f32,
            bypass: self.bypass.then_some(self.code_dim),
        })
    }

    /// Returns [`Self::engine_shape`], or an error that names the architecture.
    ///
    /// # Errors
    /// [`LmError::NotT5`].
    pub fn require_engine_shape(&self) -> Result<Shape, LmError> {
        self.engine_shape().ok_or_else(|| LmError::NotT5 {
            backbone: self.network.backbone().name(),
        })
    }
}

/// The language model with packed weights.
pub struct EngineLm {
    config: LmConfig,
    vocab: Vocab,
    engine: Engine,
    n_params: usize,
    learned: Option<Learned>,
}

impl EngineLm {
    /// Opens a checkpoint: `config.json`, `tokenizer.json` and the weights it names.
    ///
    /// # Errors
    /// If a file is missing or damaged, or weights do not fit the configuration.
    pub fn load(dir: &Path, precision: Precision) -> Result<Self, LmError> {
        Self::from_files(LmFiles::of(Checkpoint::open(dir)?)?, precision)
    }

    /// Packs the weights of a checkpoint.
    ///
    /// # Errors
    /// Those of [`Self::load`], and [`LmError::NotT5`].
    pub fn from_files(files: LmFiles, precision: Precision) -> Result<Self, LmError> {
        files.card.lm.require_engine_shape()?;
        let (weights, path) = files.t5_weights()?;
        let lm = Self::from_weights(files.card.lm, files.vocab, weights, precision, &path)?;
        Ok(Self {
            learned: files.card.learned,
            ..lm
        })
    }

    /// Packs named weights. Errors contain `file`.
    ///
    /// # Errors
    /// If the network is not a T5, or the weights do not fit the configuration.
    pub fn from_weights(
        config: LmConfig,
        vocab: Vocab,
        weights: NamedTensors,
        precision: Precision,
        file: &Path,
    ) -> Result<Self, LmError> {
        let shape = config.require_engine_shape()?;
        let n_params = weights.values().map(|t| t.values.len()).sum();
        let engine = Engine::new(shape, precision, weights)
            .map_err(|e| CheckpointError::from_engine(e, file))?;
        Ok(Self {
            config,
            vocab,
            engine,
            n_params,
            learned: None,
        })
    }

    /// Shape of the network.
    pub fn config(&self) -> &LmConfig {
        &self.config
    }

    /// Layout of the token ids.
    pub fn vocab(&self) -> &Vocab {
        &self.vocab
    }

    /// The packed weights.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    /// What the model was trained to do, if its files say so.
    pub fn learned(&self) -> Option<&Learned> {
        self.learned.as_ref()
    }

    /// Number of weights.
    pub fn n_params(&self) -> usize {
        self.n_params
    }

    /// Decodes every prompt on a session of [`Self::engine`], and reports tokens to `watch` as they are generated.
    ///
    /// # Errors
    /// If a prompt does not fit the model; [`radarllm_engine::EngineError::Cancelled`].
    pub fn generate(
        &self,
        session: &mut Session,
        prompts: &[Source],
        options: &GenerateOptions,
        watch: &mut Watch,
    ) -> Result<Vec<Generated>, LmError> {
        decode(session, &self.vocab, prompts, options, watch)
    }
}
