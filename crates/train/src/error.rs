//! Why training stops without a result.

use std::path::PathBuf;

use radarllm_dataset::DatasetError;
use radarllm_inference::checkpoint::CheckpointError;
use radarllm_inference::lm::LmError;
use radarllm_inference::tokenizer::EncodeError;

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
    Processor(#[from] radarllm_nn::device::ProcessorError),
    /// There is nothing to train on.
    #[error("training data: {0}")]
    NoData(&'static str),
    /// A clip cannot be trained on.
    #[error("training data: clip {id}: {source}")]
    Clip {
        /// Id of the clip.
        id: String,
        /// Cause.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// Clips of one motion have different captions.
    #[error("training data: {0}")]
    Captions(String),
    /// A data set cannot be read.
    #[error("training data: {0}")]
    Dataset(#[from] DatasetError),
    /// Clips cannot be encoded by the radar tokenizer.
    #[error("training data: {0}")]
    Encode(#[from] EncodeError),
    /// An earlier stage has left no checkpoint.
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
    /// The language model refused files or inputs.
    #[error(transparent)]
    Lm(#[from] LmError),
    /// The run was too short to have a codebook.
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
    /// Averaged weights that do not fit.
    #[error("the averaged weights of the checkpoint do not fit this network")]
    Average,
    /// A configuration that TOML cannot express.
    #[error("configuration: {0}")]
    Toml(#[from] toml::ser::Error),
}

impl TrainError {
    /// A clip that cannot be trained on.
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
