//! What can go wrong around the language model.

use crate::checkpoint::CheckpointError;

/// Errors of the language model's files, vocabulary and inputs.
#[derive(Debug, thiserror::Error)]
pub enum LmError {
    /// A checkpoint file is missing, damaged or does not fit.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A configuration value that cannot be.
    #[error("language model configuration: {field}: {problem}")]
    Config {
        /// The field.
        field: &'static str,
        /// What is wrong, with numbers.
        problem: String,
    },
    /// The text tokenizer refused its file or its input.
    #[error("text tokenizer: {0}")]
    Tokenizer(String),
    /// An input that does not fit the model.
    #[error("language model input: {0}")]
    Input(String),
    /// The inference engine refused weights, an input or an option.
    #[error(transparent)]
    Engine(#[from] radarllm_engine::EngineError),
    /// The radar tokenizer failed.
    #[error("radar tokenizer: {0}")]
    RadarTokenizer(String),
}
