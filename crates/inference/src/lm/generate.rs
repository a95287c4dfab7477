//! Decoding options: allowed tokens, maximum length and number of beams. The engine and the trainable networks share
//! them.

use std::sync::atomic::AtomicBool;

pub use radarllm_engine::Generated;
use radarllm_engine::{SearchOptions, Source, search};

use super::LmError;
use super::vocab::{Layout, PAD, Vocab};

/// Set of tokens that may be produced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Allowed {
    /// Words.
    Text,
    /// Radar codes.
    Radar,
}

impl Allowed {
    /// Number of output rows that must be computed.
    pub fn n_rows(self, layout: &Layout) -> usize {
        match self {
            Allowed::Text => layout.n_text.max(layout.end + 1) as usize,
            Allowed::Radar => layout.som() as usize,
        }
    }

    /// For each output row, whether its id may be produced.
    fn ids(self, layout: &Layout) -> Vec<bool> {
        (0..self.n_rows(layout) as u32)
            .map(|id| self.permits(id, layout))
            .collect()
    }

    /// Returns whether an id may be produced.
    pub fn permits(self, id: u32, layout: &Layout) -> bool {
        id == layout.end
            || match self {
                Allowed::Text => layout.is_word(id),
                Allowed::Radar => layout.code_of(id).is_some(),
            }
    }
}

/// Decoding options.
#[derive(Clone, Debug, PartialEq)]
pub struct GenerateOptions {
    /// Maximum number of tokens produced, including the end token.
    pub max_new_tokens: usize,
    /// Number of beams; 1 is greedy search.
    pub beam: usize,
    /// Length penalty: finished beams are compared by their log-probability divided by length to this power.
    pub length_penalty: f32,
    /// Which tokens may be produced.
    pub allowed: Allowed,
    /// Sequences decoded together.
    pub batch: usize,
}

impl GenerateOptions {
    fn search<'a>(&self, layout: &Layout, allowed: &'a [bool]) -> SearchOptions<'a> {
        SearchOptions {
            max_new_tokens: self.max_new_tokens.clamp(1, 512),
            beam: self.beam.clamp(1, 64),
            length_penalty: self.length_penalty,
            batch: self.batch,
            start: PAD,
            end: layout.end,
            allowed,
        }
    }
}

impl Default for GenerateOptions {
    fn default() -> Self {
        Self {
            max_new_tokens: 40,
            beam: 1,
            length_penalty: 1.0,
            allowed: Allowed::Text,
            batch: 64,
        }
    }
}

/// Decodes every prompt on `backend`, and reports tokens to `watch` as they are generated.
///
/// # Errors
/// If a prompt does not fit the network; [`radarllm_engine::EngineError::Cancelled`].
pub fn decode<D>(
    backend: &mut D,
    vocab: &Vocab,
    prompts: &[Source],
    options: &GenerateOptions,
    watch: &mut search::Watch,
) -> Result<Vec<Generated>, LmError>
where
    D: search::DecodingBackend,
    LmError: From<D::Error>,
{
    let allowed = options.allowed.ids(vocab.layout());
    let options = options.search(vocab.layout(), &allowed);
    Ok(search::search(backend, prompts, &options, watch)?)
}

/// Draws `n` sequences for every prompt: see [`search::draw`].
///
/// # Errors
/// If a prompt does not fit the network; [`radarllm_engine::EngineError::Cancelled`].
pub fn draw<D>(
    backend: &mut D,
    vocab: &Vocab,
    prompts: &[Source],
    n: usize,
    options: &GenerateOptions,
    cancel: &AtomicBool,
) -> Result<Vec<Vec<Generated>>, LmError>
where
    D: search::DecodingBackend,
    LmError: From<D::Error>,
{
    let allowed = options.allowed.ids(vocab.layout());
    let options = options.search(vocab.layout(), &allowed);
    Ok(search::draw(backend, prompts, n, &options, cancel)?)
}

/// Log-probability of each text, given as token ids, after a prompt: see [`search::score`].
///
/// # Errors
/// If the prompt or a text does not fit the network.
pub fn score<D>(
    backend: &mut D,
    vocab: &Vocab,
    prompt: &Source,
    texts: &[Vec<u32>],
) -> Result<Vec<f32>, LmError>
where
    D: search::DecodingBackend,
    LmError: From<D::Error>,
{
    let allowed = Allowed::Text.ids(vocab.layout());
    let options = GenerateOptions::default();
    let options = options.search(vocab.layout(), &allowed);
    Ok(search::score(backend, prompt, texts, &options)?)
}

/// Like [`decode`], without reporting tokens and without cancellation.
///
/// # Errors
/// If a prompt does not fit the network.
pub fn decode_all<D>(
    backend: &mut D,
    vocab: &Vocab,
    prompts: &[Source],
    options: &GenerateOptions,
) -> Result<Vec<Generated>, LmError>
where
    D: search::DecodingBackend,
    LmError: From<D::Error>,
{
    search::unwatched(|watch| decode(backend, vocab, prompts, options, watch))
}
