//! What can go wrong while a question is answered.

use radarllm_dataset::DatasetError;
use radarllm_inference::{LmError, PrepareError};
use radarllm_metrics::{ScoreError, embedding::EmbeddingError};
use radarllm_synth::SynthError;

use crate::{baselines::DescriptorError, pose::PoseError};

/// Why an evaluation has no report.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EvalError {
    /// A value of a configuration, with its name and what is expected.
    #[error("{0}")]
    Config(String),
    /// Nothing to evaluate.
    #[error("{0}")]
    Empty(String),
    /// Points that the virtual radar computed, where recordings are expected.
    #[error("{0}: simulated, not recorded")]
    Simulated(String),
    /// A motion or a radar frame that cannot be simulated, with the condition and the motion.
    #[error("{what}: {source}")]
    Simulation {
        /// Condition and motion.
        what: String,
        /// Cause.
        source: Box<SynthError>,
    },
    /// Arrays of an estimated body that do not fit those of the true one.
    #[error("{problem}")]
    Shape {
        /// What does not fit.
        problem: String,
        /// What would fit.
        expected: &'static str,
    },
    /// A kept result that belongs to other clips.
    #[error("{0}")]
    Stale(String),
    /// Poses cannot be compared.
    #[error("`{array}`: {source}")]
    Pose {
        /// Kind of array.
        array: &'static str,
        /// Cause.
        source: PoseError,
    },
    /// Points that the model cannot read.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
    /// The data set cannot be read.
    #[error("{0}")]
    Dataset(#[from] DatasetError),
    /// Captions cannot be scored.
    #[error(transparent)]
    Score(#[from] ScoreError),
    /// Sentence embeddings cannot be compared.
    #[error(transparent)]
    Embedding(#[from] EmbeddingError),
    /// A sentence encoder refused its input.
    #[error(transparent)]
    Encoder(Box<dyn std::error::Error + Send + Sync>),
    /// Descriptors of clips cannot be searched.
    #[error(transparent)]
    Descriptor(#[from] DescriptorError),
    /// The model refused a clip.
    #[error(transparent)]
    Model(#[from] LmError),
    /// A motion cannot be opened or simulated.
    #[error("{0}")]
    Motion(#[from] radarllm_io::Error),
    /// The simulator refused a configuration.
    #[error("{0}")]
    Synth(#[from] SynthError),
}
