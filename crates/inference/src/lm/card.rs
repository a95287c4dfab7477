//! Files of a language model: `config.json`, `tokenizer.json` and the weights file that the configuration names.

use std::collections::BTreeSet;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::LmError;
use super::config::LmConfig;
use super::cut::WeightsCut;
use super::templates::Task;
use super::vocab::{Layout, ReadPretrainedText, Vocab};
use crate::checkpoint::{CONFIG_FILE, Checkpoint, CheckpointError, MODEL_FILE, NamedTensors};

/// Name of the text tokenizer's file.
pub const TEXT_TOKENIZER_FILE: &str = "tokenizer.json";
/// Name of the file with averaged weights.
pub const AVERAGE_FILE: &str = "average.safetensors";

/// `config.json` of a language model. For a decoder-only model it contains the fields of Hugging Face, and these fields
/// under `radarllm`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LmCard {
    /// Shape of the network.
    pub lm: LmConfig,
    /// Layout of the token ids.
    pub vocab: Layout,
    /// Weights file that inference uses: [`MODEL_FILE`] or [`AVERAGE_FILE`].
    pub weights: String,
    /// For a model with adapters: the base model to which they belong.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_blake3: Option<String>,
    /// What the model was trained to do; `None` for models that were trained before this was recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub learned: Option<Learned>,
}

/// Tasks of whose examples a language model learned, as its training recorded them.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Learned {
    /// Tasks of pretraining, which always asks in the same words.
    pub pretrained: BTreeSet<Task>,
    /// Tasks of instruction tuning, which asks in the words of all templates.
    pub tuned: BTreeSet<Task>,
}

impl Learned {
    /// Whether the model was trained on the task in any stage.
    pub fn knows(&self, task: Task) -> bool {
        self.pretrained.contains(&task) || self.tuned.contains(&task)
    }
}

impl LmCard {
    fn read(checkpoint: &Checkpoint) -> Result<Self, LmError> {
        let mut value: serde_json::Value = checkpoint.json(CONFIG_FILE)?;
        let radar = value.as_object_mut().and_then(|v| v.remove("radarllm"));
        if let Some(mut card) = radar {
            let kind = value["model_type"].as_str().unwrap_or_default().to_string();
            if kind != "gpt2" && kind != "qwen2" {
                return Err(LmError::Config {
                    field: "model_type",
                    problem: format!("expected gpt2 or qwen2, found `{kind}`"),
                });
            }
            if let Some(lm) = card.get_mut("lm").and_then(|lm| lm.as_object_mut()) {
                lm.insert(kind, value);
            }
            value = card;
        }
        let json = |e: serde_json::Error| CheckpointError::Json {
            path: checkpoint.dir().join(CONFIG_FILE),
            message: e.to_string(),
        };
        Ok(serde_json::from_value(value).map_err(json)?)
    }
}

/// A checkpoint of a language model whose weights have not been read yet.
pub struct LmFiles {
    /// The configuration.
    pub card: LmCard,
    /// Layout of the token ids.
    pub vocab: Vocab,
    /// The files.
    pub checkpoint: Checkpoint,
    /// What is cut in the weights of a T5, to measure what it is worth.
    pub cut: Option<WeightsCut>,
}

impl LmFiles {
    /// Reads all files except the weights.
    ///
    /// # Errors
    /// If a file is missing or damaged, or the configuration is invalid; [`LmError::PretrainedText`].
    pub fn of(checkpoint: Checkpoint) -> Result<Self, LmError> {
        Self::of_any(checkpoint, None)
    }

    /// As [`Self::of`], also for the text tokenizer of a pretrained language model, which `read` reads.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn of_any(
        checkpoint: Checkpoint,
        read: Option<ReadPretrainedText>,
    ) -> Result<Self, LmError> {
        let card = LmCard::read(&checkpoint)?;
        card.lm.validate()?;
        let json = checkpoint.bytes(TEXT_TOKENIZER_FILE)?;
        let vocab = Vocab::from_parts(&json, card.vocab.clone(), read)?;
        if card.lm.network.vocab_size() != vocab.layout().size() {
            let problem = format!(
                "{} rows for a vocabulary of {}",
                card.lm.network.vocab_size(),
                vocab.layout().size()
            );
            return Err(LmError::Config {
                field: "vocab_size",
                problem,
            });
        }
        Ok(Self {
            card,
            vocab,
            checkpoint,
            cut: None,
        })
    }

    /// Returns whether the network is a T5, the only architecture that the inference engine supports.
    pub fn is_t5(&self) -> bool {
        self.card.lm.t5().is_some()
    }

    /// Reads the weights of a T5 and the path of their file. They are not yet compared with the configuration.
    ///
    /// # Errors
    /// If the file is missing or damaged.
    pub fn t5_weights(&self) -> Result<(NamedTensors, PathBuf), LmError> {
        let name = if self.card.weights == AVERAGE_FILE {
            AVERAGE_FILE
        } else {
            MODEL_FILE
        };
        let path = self.checkpoint.dir().join(name);
        let mut weights = self.checkpoint.tensors(name)?;
        if let Some(cut) = self.cut {
            cut.apply(&mut weights, &self.card, &path)?;
        }
        Ok((weights, path))
    }
}
