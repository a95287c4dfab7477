//! Errors of training.

use std::path::PathBuf;

use radarllm_base::message::{Message, text};
use radarllm_dataset::DatasetError;
use radarllm_inference::checkpoint::CheckpointError;
use radarllm_inference::lm::LmError;
use radarllm_inference::tokenizer::EncodeError;

/// Error that stopped training.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainError {
    /// A setting is invalid.
    #[error("{field}: {problem}")]
    Config {
        /// Name of the field.
        field: String,
        /// Description of the problem.
        problem: String,
    },
    /// The configuration file is not valid TOML or does not have the expected structure.
    #[error("{path}: {message}")]
    ConfigFile {
        /// File.
        path: PathBuf,
        /// Line, column and cause.
        message: String,
    },
    /// The requested processor cannot be used.
    #[error("device: {0}")]
    Processor(#[from] radarllm_nn::device::ProcessorError),
    /// There are no training data.
    #[error("training data: {0}")]
    NoData(&'static str),
    /// Too few clips state what the networks that weigh sentences learn.
    #[error(
        "training data: [evidence]: {what} is stated by {needed} training clips, which is the minimum; the largest number is {found}"
    )]
    TooFewClips {
        /// What is missing: no action, or no side of an action.
        what: &'static str,
        /// Largest number of clips that state the same.
        found: usize,
        /// Minimum number of clips.
        needed: usize,
    },
    /// A clip cannot be used for training.
    #[error("training data: clip {id}: {source}")]
    Clip {
        /// Id of the clip.
        id: String,
        /// Cause.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// Clips of the same motion have different captions.
    #[error("training data: {0}")]
    Captions(String),
    /// A data set cannot be read.
    #[error("training data: {0}")]
    Dataset(#[from] DatasetError),
    /// Clips cannot be encoded by the radar tokenizer.
    #[error("training data: {0}")]
    Encode(#[from] EncodeError),
    /// There is no checkpoint of an earlier stage.
    #[error("training data: {path}: no checkpoint; run stage `{stage}` first")]
    StageMissing {
        /// Folder of the stage.
        path: PathBuf,
        /// Name of the stage.
        stage: &'static str,
    },
    /// A loss or gradient is NaN or infinite.
    #[error("step {step}: {what} is not finite ({value}); clips of the batch: {}", ids.join(", "))]
    NotFinite {
        /// Number of the update.
        step: u64,
        /// Name of the quantity.
        what: String,
        /// Value of the quantity.
        value: f64,
        /// Ids of the clips in the batch.
        ids: Vec<String>,
    },
    /// The output directory already contains a run.
    #[error("{path}: holds an earlier run; resume it, or remove it to start again")]
    OutputExists {
        /// Directory.
        path: PathBuf,
    },
    /// There is no run to resume.
    #[error("{path}: no checkpoint to resume from")]
    NothingToResume {
        /// Directory.
        path: PathBuf,
    },
    /// The checkpoint was written with other settings.
    #[error("{path}: {message}")]
    ResumeMismatch {
        /// Checkpoint.
        path: PathBuf,
        /// Description of the difference.
        message: String,
    },
    /// A checkpoint cannot be written or read.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A file system operation failed.
    #[error("{path}: {source}")]
    Io {
        /// File.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The language model rejected files or inputs.
    #[error(transparent)]
    Lm(#[from] LmError),
    /// The run was too short to initialise the codebook.
    #[error(
        "{stage}: too few steps to initialise the codebook: train longer or lower codebook.init_after and \
         codebook.init_inputs_per_code"
    )]
    Codebook {
        /// Name of the stage.
        stage: &'static str,
    },
    /// The state of a stage in a checkpoint does not fit the stage.
    #[error("stage state: `{name}` does not fit")]
    StageState {
        /// Name of the tensor.
        name: String,
    },
    /// The averaged weights do not fit the network.
    #[error("the averaged weights of the checkpoint do not fit this network")]
    Average,
    /// The configuration cannot be expressed in TOML.
    #[error("configuration: {0}")]
    Toml(#[from] toml::ser::Error),
}

impl TrainError {
    /// How the user can resolve the error.
    pub fn hint(&self) -> Option<Message> {
        Some(match self {
            Self::ResumeMismatch { path, .. } => {
                let folder = path.parent().unwrap_or(path).display();
                text(format!(
                    "remove {folder}, and the folders of the stages that learn from it, to train them anew, or name another folder as `out`"
                ))
            }
            Self::TooFewClips { .. } => text(
                "train on more clips of each action, or leave the table [evidence] out of the recipe",
            ),
            _ => return None,
        })
    }

    /// The same error of a table of a recipe.
    pub(crate) fn in_table(self, table: &str) -> Self {
        match self {
            Self::Config { field, problem } => Self::Config {
                field: format!("{table}.{field}"),
                problem,
            },
            other => other,
        }
    }

    /// Error for a setting that cannot be used.
    pub(crate) fn config(field: &str, problem: impl Into<String>) -> Self {
        Self::Config {
            field: field.into(),
            problem: problem.into(),
        }
    }

    /// Error for a clip that cannot be used for training.
    pub(crate) fn clip(
        id: &str,
        source: impl Into<Box<dyn std::error::Error + Send + Sync>>,
    ) -> Self {
        Self::Clip {
            id: id.into(),
            source: source.into(),
        }
    }
}
