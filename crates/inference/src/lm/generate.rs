//! Decoding options: allowed tokens, maximum length and number of beams. The engine and the trainable networks share
//! them.

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
    let layout = vocab.layout();
    let n_rows = options.allowed.n_rows(layout) as u32;
    let allowed: Vec<bool> = (0..n_rows)
        .map(|id| options.allowed.permits(id, layout))
        .collect();
    let search = SearchOptions {
        max_new_tokens: options.max_new_tokens.clamp(1, 512),
        beam: options.beam.clamp(1, 64),
        length_penalty: options.length_penalty,
        batch: options.batch,
        start: PAD,
        end: layout.end,
        allowed: &allowed,
    };
    Ok(search::search(backend, prompts, &search, watch)?)
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
