//! A language model on disk: `config.json`, `tokenizer.json` and the weights it names.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::LmError;
use super::config::LmConfig;
use super::vocab::{Layout, Vocab};
use crate::checkpoint::{CONFIG_FILE, Checkpoint, CheckpointError, MODEL_FILE, NamedTensors};

/// Name of the text tokenizer's file.
pub const TEXT_TOKENIZER_FILE: &str = "tokenizer.json";
/// Name of the file with averaged weights.
pub const AVERAGE_FILE: &str = "average.safetensors";

/// `config.json` of a language model. A decoder alone has Hugging Face's fields there, and these under
/// `radarllm`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LmCard {
    /// Shape.
    pub lm: LmConfig,
    /// Ids.
    pub vocab: Layout,
    /// Weights file that inference uses: [`MODEL_FILE`] or [`AVERAGE_FILE`].
    pub weights: String,
    /// Of a model with adapters: which base they belong to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub base_blake3: Option<String>,
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
    /// Ids.
    pub vocab: Vocab,
    /// The files.
    pub checkpoint: Checkpoint,
}

impl LmFiles {
    /// Reads what is no weight.
    ///
    /// # Errors
    /// If a file is missing or damaged, or the configuration cannot be.
    pub fn of(checkpoint: Checkpoint) -> Result<Self, LmError> {
        let card = LmCard::read(&checkpoint)?;
        card.lm.validate()?;
        let vocab = Vocab::from_parts(&checkpoint.bytes(TEXT_TOKENIZER_FILE)?, card.vocab.clone())?;
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
        })
    }

    /// Whether the network is a T5, the only one that the inference engine runs.
    pub fn is_t5(&self) -> bool {
        self.card.lm.t5().is_some()
    }

    /// Weights of a T5 and the file they are in; they are not yet compared with the configuration.
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
        Ok((self.checkpoint.tensors(name)?, path))
    }
}
