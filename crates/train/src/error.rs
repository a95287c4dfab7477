//! Why training stops without a result.

use std::path::PathBuf;

use radarllm_inference::checkpoint::CheckpointError;

/// Why training stopped without a result.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A setting cannot be used.
    #[error("{field}: {problem}")]
    Config {
        /// Field.
        field: String,
        /// Problem.
        problem: String,
    },
    /// The configuration file is not valid TOML of this shape.
    #[error("{path}: {message}")]
    ConfigFile {
        /// File.
        path: PathBuf,
        /// Line, column and cause.
        message: String,
    },
    /// The processor asked for cannot be used.
    #[error("device: {0}")]
    Processor(#[from] radarllm_inference::device::ProcessorError),
    /// The data cannot be trained on.
    #[error("training data: {0}")]
    Data(String),
    /// A loss or gradient is NaN or infinite.
    #[error("step {step}: {what} is not finite ({value}); clips of the batch: {}", ids.join(", "))]
    NotFinite {
        /// Update.
        step: u64,
        /// Which quantity.
        what: String,
        /// Its value.
        value: f64,
        /// Ids of the batch.
        ids: Vec<String>,
    },
    /// The output directory already holds a run.
    #[error("{path}: holds an earlier run; resume it, or remove it to start again")]
    OutputExists {
        /// Directory.
        path: PathBuf,
    },
    /// There is nothing to resume.
    #[error("{path}: no checkpoint to resume from")]
    NothingToResume {
        /// Directory.
        path: PathBuf,
    },
    /// The checkpoint was made with other settings.
    #[error("{path}: {message}")]
    ResumeMismatch {
        /// Checkpoint.
        path: PathBuf,
        /// What differs.
        message: String,
    },
    /// A checkpoint could not be written or read.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The file system refused.
    #[error("{path}: {source}")]
    Io {
        /// File.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The stage's own failure.
    #[error("{0}")]
    Stage(String),
}
