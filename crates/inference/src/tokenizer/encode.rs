//! The trained tokenizer on the inference engine: encodes points as codes.

use std::path::Path;

use radarllm_base::PointFrame;
use radarllm_engine::tokenizer::{Codes, TubeClip};
use radarllm_engine::{EngineError, tokenizer as engine};
use serde::{Deserialize, Serialize};

use super::config::{MAX_STEPS, TokenizerConfig};
use super::context::CONTEXT_LEN;
use super::doppler_profile::PROFILE_DIM;
use super::grouping::{Grouped, GroupingError, group};
use super::residual::TwoCodebooks;
use crate::checkpoint::{CONFIG_FILE, Checkpoint, CheckpointError, MODEL_FILE, NamedTensors};

/// `kind` in a tokenizer's `config.json`.
pub const TOKENIZER_KIND: &str = "radar_tokenizer";

/// `config.json` of a tokenizer checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TokenizerFile {
    /// [`TOKENIZER_KIND`].
    pub kind: String,
    /// Architecture.
    pub model: TokenizerConfig,
    /// Training settings, for the record. Encoding does not use them. `radar lint` compares a radar with `radars`, the
    /// names of the radars of the training clips.
    #[serde(default)]
    pub training: serde_json::Value,
}

/// Codes of one clip.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Encoded {
    /// One code per four frames (0.4 s). The last code may cover fewer.
    pub codes: Vec<u32>,
    /// Second codes of the steps ([`super::residual`]); empty if the tokenizer has one codebook.
    pub residual_codes: Vec<u32>,
    /// Features before quantization, `[n_codes][code_dim]` flattened. Of a tokenizer with two codebooks, the sums of the
    /// vectors of both codes.
    pub features: Vec<f32>,
    /// Number of points within the radius of an anchor.
    pub n_points_used: usize,
    /// Tempo and board ([`super::context`]), which a tokenizer does not measure: a model that is told the context needs
    /// them.
    pub context: Option<[u32; CONTEXT_LEN]>,
}

/// Reasons why a clip cannot be encoded.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum EncodeError {
    /// The points of the clip are invalid.
    #[error("clip {clip}: {source}")]
    Clip {
        /// Index in the batch.
        clip: usize,
        /// Cause.
        source: GroupingError,
    },
    /// The network produced a value that is not finite, which means that its weights are damaged.
    #[error("clip {clip}: the tokenizer's output is not finite")]
    NotFinite {
        /// Index in the batch.
        clip: usize,
    },
    /// Grouped clips do not fit the network.
    #[error(transparent)]
    Engine(EngineError),
}

/// A trained tokenizer with packed weights.
pub struct RadarTokenizer {
    config: TokenizerConfig,
    network: engine::Tokenizer,
    /// If each step has a second code.
    codebooks: Option<TwoCodebooks>,
    n_params: usize,
}

impl TokenizerConfig {
    /// Shape of the network in the form that the engine uses.
    pub fn engine_shape(&self) -> engine::TokenizerShape {
        engine::TokenizerShape {
            n_anchors: self.n_anchors(),
            max_steps: MAX_STEPS,
            width: self.width,
            n_layers: self.layers,
            n_heads: self.heads,
            d_ff: self.ffn_ratio * self.width,
            pool_queries: self.pool_queries,
            per_anchor: self.per_anchor_channels(),
            profile: self.doppler_profile.then_some(PROFILE_DIM),
            tube_statistics: self.tube_statistics,
            code_dim: self.code_dim,
            n_codes: self.codebook_size,
        }
    }

    /// Weights that are used only in training.
    fn training_weights(&self) -> Vec<(String, Vec<usize>)> {
        let (c, dim) = (self.width, self.code_dim);
        let points = self.reconstruction_points * self.reconstruction_dim();
        let mut out = vec![("mask".to_string(), vec![1, c])];
        for (name, from, to) in [
            ("head_in", c, c),
            ("head_out", c, points),
            ("guidance", dim, self.guidance_dim),
            ("words", dim, self.caption_words),
            ("motion_codes", dim, self.motion_codes),
        ] {
            if to > 0 {
                out.push((format!("{name}.weight"), vec![from, to]));
                out.push((format!("{name}.bias"), vec![to]));
            }
        }
        out
    }
}

impl RadarTokenizer {
    /// Loads a checkpoint directory.
    ///
    /// # Errors
    /// If it is missing, damaged, not a tokenizer, or does not fit its own configuration.
    pub fn load(dir: &Path) -> Result<Self, CheckpointError> {
        Self::from_checkpoint(&Checkpoint::open(dir)?)
    }

    /// Packs the weights of a checkpoint.
    ///
    /// # Errors
    /// Those of [`Self::load`].
    pub fn from_checkpoint(checkpoint: &Checkpoint) -> Result<Self, CheckpointError> {
        let file = TokenizerFile::read(checkpoint)?;
        let weights = checkpoint.tensors(MODEL_FILE)?;
        let codebooks = TwoCodebooks::read(checkpoint, &file.model)?;
        let mut tokenizer =
            Self::from_weights(file.model, weights, &checkpoint.dir().join(MODEL_FILE))?;
        tokenizer.n_params += codebooks.as_ref().map_or(0, TwoCodebooks::n_params);
        tokenizer.codebooks = codebooks;
        Ok(tokenizer)
    }

    /// Packs the weights of a network with one codebook. Errors contain `file`.
    ///
    /// # Errors
    /// If a weight is missing, unknown or of another shape.
    pub fn from_weights(
        config: TokenizerConfig,
        mut weights: NamedTensors,
        file: &Path,
    ) -> Result<Self, CheckpointError> {
        let n_params = weights.values().map(|t| t.values.len()).sum();
        for (tensor, expected) in config.training_weights() {
            let path = file.into();
            match weights.remove(&tensor) {
                Some(found) if found.shape == expected => {}
                Some(found) => {
                    return Err(CheckpointError::Shape {
                        path,
                        tensor,
                        expected,
                        found: found.shape,
                    });
                }
                None => {
                    return Err(CheckpointError::MissingTensor {
                        path,
                        tensor,
                        expected,
                    });
                }
            }
        }
        let network = engine::Tokenizer::new(config.engine_shape(), weights)
            .map_err(|e| CheckpointError::from_engine(e, file))?;
        Ok(Self {
            config,
            network,
            codebooks: None,
            n_params,
        })
    }

    /// Architecture.
    pub fn config(&self) -> &TokenizerConfig {
        &self.config
    }

    /// The packed network.
    pub fn engine(&self) -> &engine::Tokenizer {
        &self.network
    }

    /// Number of weights of the checkpoint, including the codebook and the weights that are used only in training.
    pub fn n_params(&self) -> usize {
        self.n_params
    }

    /// Encodes one clip of 1 to 96 frames at 10 per second.
    ///
    /// # Errors
    /// If there is no frame, too many, or a value is not finite.
    pub fn encode(
        &self,
        frames: &[PointFrame],
        radar_height_m: f32,
    ) -> Result<Encoded, EncodeError> {
        let mut encoded = self.encode_batch(&[(frames, radar_height_m)])?;
        encoded.pop().ok_or(EncodeError::Clip {
            clip: 0,
            source: GroupingError::Empty,
        })
    }

    /// Encodes several clips, each with the height of its radar. Clips are independent of one another.
    ///
    /// # Errors
    /// Those of [`Self::encode`], with the index of the clip.
    pub fn encode_batch(
        &self,
        clips: &[(&[PointFrame], f32)],
    ) -> Result<Vec<Encoded>, EncodeError> {
        let grouped = group_all(clips, &self.config)?;
        self.encode_grouped(&grouped.iter().collect::<Vec<_>>())
    }

    /// Encodes clips that are already grouped, on as many threads as there are cores.
    ///
    /// # Errors
    /// If the network's output is not finite.
    pub fn encode_grouped(&self, clips: &[&Grouped]) -> Result<Vec<Encoded>, EncodeError> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let mut session = self.network.session(cores.min(clips.len()));
        let inputs: Vec<TubeClip> = clips.iter().map(|clip| clip.tubes()).collect();
        let mut out: Vec<Codes> = Vec::new();
        session.encode(&inputs, &mut out).map_err(|e| match e {
            EngineError::Output { index } => EncodeError::NotFinite { clip: index },
            other => EncodeError::Engine(other),
        })?;
        let encoded = |(codes, clip): (Codes, &&Grouped)| {
            let mut encoded = Encoded {
                codes: codes.codes,
                residual_codes: Vec::new(),
                features: codes.features,
                n_points_used: clip.n_points_used,
                context: None,
            };
            if let Some(codebooks) = &self.codebooks {
                codebooks.quantise(&mut encoded);
            }
            encoded
        };
        Ok(out.into_iter().zip(clips).map(encoded).collect())
    }
}

impl TokenizerFile {
    /// Reads and checks the `config.json` of a tokenizer's checkpoint.
    ///
    /// # Errors
    /// If it cannot be read, does not describe a tokenizer, or contains an invalid value.
    pub fn read(checkpoint: &Checkpoint) -> Result<Self, CheckpointError> {
        let file: Self =
            checkpoint.config(TOKENIZER_KIND, |f: &Self| &f.kind, |f| f.model.validate())?;
        // A valid configuration must also fit the engine, so that errors are reported in one place.
        match file.model.engine_shape().validate() {
            Ok(()) => Ok(file),
            Err(e) => Err(CheckpointError::from_engine(
                e,
                &checkpoint.dir().join(CONFIG_FILE),
            )),
        }
    }
}

impl Grouped {
    /// Converts the clip to the input of the engine.
    pub fn tubes(&self) -> TubeClip<'_> {
        TubeClip {
            tubes: &self.tubes,
            neighbours: &self.neighbours,
            steps: &self.steps,
            profiles: self.profiles.as_flattened(),
            anchors: &self.anchors,
        }
    }
}

/// Groups clips; an error names the clip that cannot be grouped.
///
/// # Errors
/// [`EncodeError::Clip`].
pub fn group_all(
    clips: &[(&[PointFrame], f32)],
    config: &TokenizerConfig,
) -> Result<Vec<Grouped>, EncodeError> {
    let mut grouped = Vec::with_capacity(clips.len());
    for (clip, (frames, height_m)) in clips.iter().enumerate() {
        let result = group(frames, *height_m, &config.grouping);
        grouped.push(result.map_err(|source| EncodeError::Clip { clip, source })?);
    }
    Ok(grouped)
}
