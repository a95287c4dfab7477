//! Errors of the language model.

use radarllm_engine::EngineError;

use super::templates::Task;
use crate::checkpoint::CheckpointError;
use crate::prepare::PrepareError;
use crate::tokenizer::EncodeError;

/// Errors in the files, the vocabulary and the inputs of the language model.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LmError {
    /// A checkpoint file is missing, damaged or does not fit.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// A configuration value is invalid.
    #[error("language model configuration: {field}: {problem}")]
    Config {
        /// Name of the field.
        field: &'static str,
        /// What is wrong, with numbers.
        problem: String,
    },
    /// The inference engine supports only T5.
    #[error("the inference engine runs T5 only, this language model is a {backbone}")]
    NotT5 {
        /// Name of the architecture.
        backbone: &'static str,
    },
    /// The text tokenizer refused its file or its input.
    #[error("text tokenizer: {0}")]
    Tokenizer(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The text tokenizer of a pretrained language model, which a program without training does not read.
    #[error(
        "the language model has the text tokenizer of a pretrained one, which this build does not read"
    )]
    PretrainedText,
    /// An input that does not fit the model.
    #[error("language model input: {0}")]
    Input(#[from] InputError),
    /// The clip cannot be read by the model.
    #[error(transparent)]
    Clip(#[from] PrepareError),
    /// The inference engine refused weights, an input or an option.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The model was not trained on a task, or not in the words in which it was asked.
    #[error("the model did not learn {}{}: {why}", task.name(), in_words(*tuned))]
    NotLearned {
        /// The task.
        task: Task,
        /// Whether it was asked in other words than those of pretraining.
        tuned: bool,
        /// What its files say about it.
        why: Unlearned,
    },
    /// The radar tokenizer failed.
    #[error("radar tokenizer: {0}")]
    RadarTokenizer(#[from] EncodeError),
}

impl LmError {
    /// Returns whether the caller of a watched generation cancelled it.
    pub fn is_cancelled(&self) -> bool {
        matches!(self, Self::Engine(EngineError::Cancelled))
    }
}

fn in_words(tuned: bool) -> &'static str {
    match tuned {
        true => " in other words than those of pretraining",
        false => "",
    }
}

/// Reasons why a model did not learn a task.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unlearned {
    /// The model's files do not say on which tasks it was trained.
    #[error("its config.json has no record of its tasks (`learned`)")]
    NoRecord,
    /// The task is not among those of its training.
    #[error("no example of its training had this task")]
    Never,
    /// The task was trained in the words of pretraining only.
    #[error("it was not tuned on instructions of this task")]
    NotTuned,
}

/// Reasons why an input does not fit a language model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// A prompt needs the context of its clip.
    #[error("the model is told the context of a clip, which was not measured")]
    NoContext,
    /// A text longer than any caption.
    #[error("text of {found} bytes, at most {max}")]
    TextTooLong {
        /// Length found, bytes.
        found: usize,
        /// Maximum length, bytes.
        max: usize,
    },
    /// A placeholder of a prompt has no value.
    #[error("the prompt needs {name}")]
    Placeholder {
        /// The placeholder.
        name: String,
    },
    /// An instruction that cannot be followed.
    #[error("instruction: {problem}")]
    Instruction {
        /// What is wrong.
        problem: String,
    },
    /// A sentence for which radar codes cannot be generated.
    #[error("sentence {index}: {problem}")]
    Sentence {
        /// Index among the sentences.
        index: usize,
        /// What is wrong.
        problem: String,
    },
    /// A radar code beyond the codebook.
    #[error("radar code {code} is beyond the codebook of {n_codes}")]
    Code {
        /// The code.
        code: u32,
        /// Size of the codebook.
        n_codes: u32,
    },
    /// A prompt has no tokens, or too many.
    #[error("{found} tokens, expected 1..={max}")]
    Tokens {
        /// Number of tokens found.
        found: usize,
        /// Maximum number of tokens.
        max: usize,
    },
    /// An id beyond the vocabulary.
    #[error("id {id} is beyond the vocabulary")]
    Id {
        /// The id.
        id: u32,
    },
    /// Features that do not fit their codes.
    #[error("{found} feature values, expected {expected}")]
    Features {
        /// Number of values found.
        found: usize,
        /// Number of values expected.
        expected: usize,
    },
    /// A feature that is NaN or infinite.
    #[error("a feature is not finite")]
    FeatureNotFinite,
    /// A feature that belongs to no token.
    #[error("a feature's position is beyond the tokens")]
    FeaturePosition,
    /// A prompt and the tokens to generate do not fit the network.
    #[error(
        "a prompt of {found} tokens and {steps} new ones, but the network has {positions} positions"
    )]
    Positions {
        /// Number of tokens of the prompt.
        found: usize,
        /// Number of tokens to generate.
        steps: usize,
        /// Number of positions of the network.
        positions: usize,
    },
    /// A prompt and its answer do not fit the network.
    #[error(
        "a prompt and its answer have {found} tokens, but the network has {positions} positions"
    )]
    Example {
        /// Tokens of both.
        found: usize,
        /// Positions of the network.
        positions: usize,
    },
    /// Rows of ids that do not fit one another or the network.
    #[error("{problem}")]
    Rows {
        /// What is wrong, with numbers.
        problem: String,
    },
    /// A layer that the network does not have.
    #[error("layer {found}: the network has {n_layers}")]
    Layer {
        /// Index of the requested layer.
        found: usize,
        /// Number of layers of the network.
        n_layers: usize,
    },
    /// A checkpoint lacks the requested pooler.
    #[error("the checkpoint has no pooler; ask for cls or mean")]
    NoPooler,
    /// A sentence without any token.
    #[error("sentence {sentence} has no token: the tokenizer adds no special ones")]
    NoToken {
        /// Position of the sentence.
        sentence: usize,
    },
    /// A training clip that cannot be used.
    #[error("clip {id}: {problem}")]
    Clip {
        /// Id of the clip.
        id: String,
        /// What is wrong, with numbers.
        problem: String,
    },
}
