//! What decoding is asked: which tokens, how many, how many beams. The same for the engine (`on_engine`) and for
//! the networks as trained (`decode`).

pub use radarllm_engine::Generated;

use super::vocab::Layout;

/// Which tokens may be produced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Allowed {
    /// Words.
    Text,
    /// Radar codes.
    Radar,
}

impl Allowed {
    /// Output rows that have to be computed.
    pub(super) fn n_rows(self, layout: &Layout) -> usize {
        match self {
            Allowed::Text => layout.n_text.max(layout.end + 1) as usize,
            Allowed::Radar => layout.som() as usize,
        }
    }

    pub(super) fn permits(self, id: u32, layout: &Layout) -> bool {
        id == layout.end
            || match self {
                Allowed::Text => layout.is_word(id),
                Allowed::Radar => layout.code_of(id).is_some(),
            }
    }
}

/// How to decode.
#[derive(Clone, Debug, PartialEq)]
pub struct GenerateOptions {
    /// Most tokens produced, end token included.
    pub max_new_tokens: usize,
    /// Beams; 1 is greedy.
    pub beam: usize,
    /// Finished beams compare by log-probability over length to this power.
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
