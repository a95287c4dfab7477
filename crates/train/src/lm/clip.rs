//! A captioned motion as training data of the language model.

use radarllm_inference::tokenizer::Encoded;

/// Codes and captions of one motion.
#[derive(Clone, Debug, PartialEq)]
pub struct LmClip {
    /// Motion id, for messages.
    pub id: String,
    /// Action label.
    pub action: String,
    /// Captions; at least one.
    pub captions: Vec<String>,
    /// Codes of each simulation of the motion; at least one.
    pub variants: Vec<Encoded>,
    /// Codes of the same simulations with points mirrored in x, or empty.
    pub flipped: Vec<Encoded>,
    /// Length of the motion, s.
    pub seconds: f32,
}
