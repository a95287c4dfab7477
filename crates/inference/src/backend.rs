//! Backends that run the networks of a captioner.

use std::sync::atomic::AtomicBool;

use radarllm_base::PointFrame;
use radarllm_engine::{Engine, Precision, Source, Watch};

use crate::checkpoint::Checkpoint;
use crate::lm::config::LmConfig;
use crate::lm::ensemble::Member;
use crate::lm::generate::{draw, score};
use crate::lm::{EngineLm, GenerateOptions, Generated, Learned, LmError, LmFiles, Vocab};
use crate::tokenizer::{EncodeError, Encoded, RadarTokenizer, TokenizerConfig};

/// A radar tokenizer and a language model that belong together, independent of how they are computed.
///
/// [`EngineBackend`] uses `radarllm-engine`. `radarllm-nn` has another implementation, which runs the networks in the
/// form in which they are trained.
pub trait Backend: Send + Sync {
    /// Encodes windows of 1 to 96 frames at 10 frames per second as codes. Each window comes with the height of its
    /// radar above the floor, in m. Windows are independent of one another.
    ///
    /// # Errors
    /// If a window is empty, too long, or has a value that is not finite.
    fn encode(&self, windows: &[(&[PointFrame], f32)]) -> Result<Vec<Encoded>, EncodeError>;

    /// Decodes every prompt, and reports tokens to `watch` as they are generated.
    ///
    /// # Errors
    /// If a prompt does not fit the model; [`radarllm_engine::EngineError::Cancelled`] if `watch` cancels.
    fn generate(
        &self,
        prompts: &[Source],
        options: &GenerateOptions,
        watch: &mut Watch,
    ) -> Result<Vec<Generated>, LmError>;

    /// Draws `n` sequences for every prompt, `[prompts][n]`: see [`radarllm_engine::search::draw`].
    ///
    /// # Errors
    /// As [`Self::generate`].
    fn draw(
        &self,
        prompts: &[Source],
        n: usize,
        options: &GenerateOptions,
        cancel: &AtomicBool,
    ) -> Result<Vec<Vec<Generated>>, LmError>;

    /// Log-probability of each text, given as token ids, after a prompt.
    ///
    /// # Errors
    /// If the prompt or a text does not fit the model.
    fn score(&self, prompt: &Source, texts: &[Vec<u32>]) -> Result<Vec<f32>, LmError>;

    /// Token ids of words and radar codes.
    fn vocab(&self) -> &Vocab;

    /// Number of weights of both networks.
    fn n_params(&self) -> usize;

    /// What the language model was trained to do, if it is known.
    fn learned(&self) -> Option<&Learned> {
        None
    }
}

/// A backend on the inference engine: packed weights, without a learning framework.
pub struct EngineBackend {
    tokenizer: RadarTokenizer,
    lm: EngineLm,
}

impl EngineBackend {
    /// Combines a radar tokenizer and a language model.
    ///
    /// # Errors
    /// If they do not belong together: see [`check_pair`].
    pub fn new(tokenizer: RadarTokenizer, lm: EngineLm) -> Result<Self, LmError> {
        check_pair(tokenizer.config(), lm.config())?;
        Ok(Self { tokenizer, lm })
    }

    /// Packs the networks of the files of both.
    ///
    /// # Errors
    /// If a file is missing or damaged, or they do not belong together; [`LmError::NotT5`] if the language model has
    /// another architecture.
    pub fn from_files(
        tokenizer: &Checkpoint,
        lm: LmFiles,
        precision: Precision,
    ) -> Result<Self, LmError> {
        let tokenizer = RadarTokenizer::from_checkpoint(tokenizer)?;
        Self::new(tokenizer, EngineLm::from_files(lm, precision)?)
    }
}

/// Loads the networks of a model, or of a member of an ensemble, on a backend. A [`Precision`] that the backend does not
/// have is an error or is computed exactly, as the backend says.
pub type LoadBackend = fn(Member, Precision) -> Result<Box<dyn Backend>, LmError>;

/// Packs the networks of a member for the inference engine.
///
/// # Errors
/// If a file is missing or damaged, or they do not belong together; [`LmError::NotT5`] if the language model has another
/// architecture.
pub fn load_engine(member: Member, precision: Precision) -> Result<Box<dyn Backend>, LmError> {
    let lm = LmFiles {
        cut: member.weights_cut()?,
        ..LmFiles::of(member.lm)?
    };
    let backend = EngineBackend::from_files(&member.tokenizer, lm, precision)?;
    Ok(Box::new(backend))
}

impl Backend for EngineBackend {
    fn encode(&self, windows: &[(&[PointFrame], f32)]) -> Result<Vec<Encoded>, EncodeError> {
        self.tokenizer.encode_batch(windows)
    }

    fn generate(
        &self,
        prompts: &[Source],
        options: &GenerateOptions,
        watch: &mut Watch,
    ) -> Result<Vec<Generated>, LmError> {
        let engine = self.lm.engine();
        let mut session = engine.session(threads(engine));
        self.lm.generate(&mut session, prompts, options, watch)
    }

    fn draw(
        &self,
        prompts: &[Source],
        n: usize,
        options: &GenerateOptions,
        cancel: &AtomicBool,
    ) -> Result<Vec<Vec<Generated>>, LmError> {
        let engine = self.lm.engine();
        let mut session = engine.session(threads(engine));
        draw(&mut session, self.lm.vocab(), prompts, n, options, cancel)
    }

    fn score(&self, prompt: &Source, texts: &[Vec<u32>]) -> Result<Vec<f32>, LmError> {
        let engine = self.lm.engine();
        let mut session = engine.session(threads(engine));
        score(&mut session, self.lm.vocab(), prompt, texts)
    }

    fn vocab(&self) -> &Vocab {
        self.lm.vocab()
    }

    fn n_params(&self) -> usize {
        self.tokenizer.n_params() + self.lm.n_params()
    }

    fn learned(&self) -> Option<&Learned> {
        self.lm.learned()
    }
}

/// Checks that a language model was built for the codes and features of a tokenizer.
///
/// # Errors
/// If the codebook sizes or the feature widths differ.
pub fn check_pair(tokenizer: &TokenizerConfig, lm: &LmConfig) -> Result<(), LmError> {
    let (size, dim) = (tokenizer.codebook_size, tokenizer.code_dim);
    if size != lm.n_codes || (lm.bypass && dim != lm.code_dim) {
        let problem = format!(
            "the tokenizer has {size} codes of width {dim}, the language model knows {} of {}",
            lm.n_codes, lm.code_dim
        );
        return Err(LmError::Config {
            field: "n_codes",
            problem,
        });
    }
    Ok(())
}

/// Small models fit the caches of one core and are fastest there. Large models are limited by memory bandwidth, of
/// which several cores can use more.
fn threads(engine: &Engine) -> usize {
    const LARGE_BYTES: usize = 32 << 20;
    if engine.bytes() < LARGE_BYTES {
        return 1;
    }
    std::thread::available_parallelism().map_or(1, usize::from)
}
