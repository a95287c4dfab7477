//! A language model on disk: `config.json`, `tokenizer.json` and the weights it names.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::LmError;
use super::config::LmConfig;
use super::vocab::{Layout, Vocab};
use crate::checkpoint::{CONFIG_FILE, Checkpoint, MODEL_FILE, NamedTensors};

/// Name of the text tokenizer's file.
pub const TEXT_TOKENIZER_FILE: &str = "tokenizer.json";
/// Name of the file with averaged weights.
pub const AVERAGE_FILE: &str = "average.safetensors";

/// `config.json` of a language model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LmCard {
    /// Shape.
    pub lm: LmConfig,
    /// Ids.
    pub vocab: Layout,
    /// Weights file that inference uses: [`MODEL_FILE`] or [`AVERAGE_FILE`].
    pub weights: String,
}

/// What a checkpoint holds.
pub(super) struct LmFiles {
    pub config: LmConfig,
    pub vocab: Vocab,
    pub weights: NamedTensors,
    /// File of the weights.
    pub path: PathBuf,
}

impl LmFiles {
    /// Opens a checkpoint; weights are not yet compared with the configuration.
    ///
    /// # Errors
    /// If a file is missing or damaged, or the configuration cannot be.
    pub fn read(dir: &Path) -> Result<Self, LmError> {
        let checkpoint = Checkpoint::open(dir)?;
        let card: LmCard = checkpoint.json(CONFIG_FILE)?;
        card.lm.validate()?;
        let vocab = Vocab::from_parts(&checkpoint.bytes(TEXT_TOKENIZER_FILE)?, card.vocab)?;
        if card.lm.t5.vocab_size != vocab.layout().size() {
            let problem = format!(
                "{} rows for a vocabulary of {}",
                card.lm.t5.vocab_size,
                vocab.layout().size()
            );
            return Err(LmError::Config {
                field: "vocab_size",
                problem,
            });
        }
        let name = if card.weights == AVERAGE_FILE {
            AVERAGE_FILE
        } else {
            MODEL_FILE
        };
        Ok(Self {
            config: card.lm,
            vocab,
            weights: checkpoint.tensors(name)?,
            path: checkpoint.dir().join(name),
        })
    }
}
