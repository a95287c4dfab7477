//! Language models with a way from the radar cut, to measure what travels on each of them.
//!
//! What a clip shows reaches the language model in up to three ways: as radar tokens, as the continuous features beside
//! them (the bypass), and as the context ([`crate::tokenizer::context`]). A model that loses nothing without its tokens does
//! not read them.

use std::path::Path;

use super::card::LmCard;
use crate::checkpoint::{CheckpointError, NamedTensors};

/// Name of the embedding in a T5's weights.
const EMBEDDING: &str = "t5.shared";
/// Name of the bypass in a T5's weights.
const BYPASS: &str = "bypass";

/// What is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RadarCut {
    /// Everything but the tokens: neither features nor context.
    AllButTokens,
    /// The tokens: every code has the mean of the codes' embeddings.
    Tokens,
    /// The meaning of the tokens: every code has the embedding of another one.
    TokenMeaning,
}

impl RadarCut {
    /// Cuts a way in the weights of a T5, which come from `file`. A model without bypass or context has nothing to cut there.
    ///
    /// # Errors
    /// Weights without the embedding of the vocabulary.
    pub(super) fn apply(
        self,
        weights: &mut NamedTensors,
        card: &LmCard,
        file: &Path,
    ) -> Result<(), CheckpointError> {
        let (vocab, width) = (&card.vocab, card.lm.network.width().max(1));
        let codes = vocab.code(0) as usize..vocab.som() as usize;
        let context = vocab.context(0) as usize..vocab.size();
        if self == Self::AllButTokens
            && let Some(bypass) = weights.get_mut(BYPASS)
        {
            bypass.values.fill(0.0);
        }
        let wanted = match self {
            Self::AllButTokens => context,
            Self::Tokens | Self::TokenMeaning => codes,
        };
        let embedding = weights.get_mut(EMBEDDING);
        let rows = embedding.and_then(|embedding| {
            let span = wanted.start * width..wanted.end * width;
            embedding.values.get_mut(span)
        });
        let Some(rows) = rows else {
            return Err(CheckpointError::MissingTensor {
                path: file.into(),
                tensor: EMBEDDING.into(),
                expected: vec![vocab.size(), width],
            });
        };
        let n_rows = rows.len() / width;
        match self {
            Self::AllButTokens => rows.fill(0.0),
            Self::Tokens => {
                let mut mean = vec![0.0; width];
                for row in rows.chunks_exact(width) {
                    mean.iter_mut()
                        .zip(row)
                        .for_each(|(m, v)| *m += v / n_rows as f32);
                }
                let rows = rows.chunks_exact_mut(width);
                rows.for_each(|row| row.copy_from_slice(&mean));
            }
            // Half of the codebook further: no code keeps its own embedding.
            Self::TokenMeaning => rows.rotate_left(n_rows / 2 * width),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checkpoint::HostTensor;
    use crate::lm::vocab::{Layout, TextKind};
    use crate::lm::{LmConfig, LmPreset};

    fn card() -> LmCard {
        let mut lm: LmConfig = LmPreset::Tiny.config(4, 3);
        lm.network.set_vocab_size(13);
        let vocab = Layout {
            kind: TextKind::Learned,
            n_text: 3,
            first_sentinel: 3,
            n_sentinels: 2,
            first_code: 5,
            n_codes: 4,
            n_context: 2,
            end: 1,
        };
        assert_eq!(vocab.size(), 13);
        LmCard {
            lm,
            vocab,
            weights: "model.safetensors".into(),
            base_blake3: None,
            learned: None,
        }
    }

    fn cut(cut: RadarCut) -> (Vec<f32>, Vec<f32>) {
        let card = card();
        let width = card.lm.network.width();
        let shared = HostTensor {
            shape: vec![13, width],
            values: (0..13).flat_map(|row| vec![row as f32; width]).collect(),
        };
        let bypass = HostTensor {
            shape: vec![3, width],
            values: vec![1.0; 3 * width],
        };
        let mut weights = NamedTensors::from([(EMBEDDING.into(), shared), (BYPASS.into(), bypass)]);
        cut.apply(&mut weights, &card, Path::new("model")).unwrap();
        let firsts = |name: &str| weights[name].values.chunks(width).map(|r| r[0]).collect();
        (firsts(EMBEDDING), firsts(BYPASS))
    }

    #[test]
    fn each_cut_changes_its_rows_alone() {
        let other = [0.0, 1.0, 2.0, 3.0, 4.0];
        let ends = [9.0, 10.0];
        let whole = [1.0; 3];
        let all =
            |codes: [f32; 4], context: [f32; 2]| [&other[..], &codes, &ends, &context].concat();
        let codes = [5.0, 6.0, 7.0, 8.0];
        let context = [11.0, 12.0];
        let found = cut(RadarCut::AllButTokens);
        assert_eq!(found, (all(codes, [0.0; 2]), vec![0.0; 3]));
        let found = cut(RadarCut::Tokens);
        assert_eq!(found, (all([6.5; 4], context), whole.to_vec()));
        let found = cut(RadarCut::TokenMeaning);
        assert_eq!(found, (all([7.0, 8.0, 5.0, 6.0], context), whole.to_vec()));
    }
}
