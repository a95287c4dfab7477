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

/// What is cut in the weights of the language model of a member.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WeightsCut {
    /// The way that is cut.
    pub cut: RadarCut,
    /// Whether codes enter the bypass ([`crate::tokenizer::residual`]), which then belongs to the tokens.
    pub bypass_has_codes: bool,
}

impl WeightsCut {
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
        if let Some(bypass) = weights.get_mut(BYPASS) {
            match (self.cut, self.bypass_has_codes) {
                (RadarCut::AllButTokens, false) | (RadarCut::Tokens, true) => {
                    bypass.values.fill(0.0);
                }
                // No value of a vector keeps its own weights.
                (RadarCut::TokenMeaning, true) => {
                    let n_rows = bypass.values.len() / width;
                    bypass.values.rotate_left(n_rows / 2 * width);
                }
                (RadarCut::AllButTokens, true)
                | (RadarCut::Tokens | RadarCut::TokenMeaning, false) => {}
            }
        }
        let wanted = match self.cut {
            RadarCut::AllButTokens => context,
            RadarCut::Tokens | RadarCut::TokenMeaning => codes,
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
        match self.cut {
            RadarCut::AllButTokens => rows.fill(0.0),
            RadarCut::Tokens => {
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
            RadarCut::TokenMeaning => rows.rotate_left(n_rows / 2 * width),
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

    fn cut(cut: RadarCut, bypass_has_codes: bool) -> (Vec<f32>, Vec<f32>) {
        let card = card();
        let width = card.lm.network.width();
        let shared = HostTensor {
            shape: vec![13, width],
            values: (0..13).flat_map(|row| vec![row as f32; width]).collect(),
        };
        let bypass = HostTensor {
            shape: vec![3, width],
            values: (1..4).flat_map(|row| vec![row as f32; width]).collect(),
        };
        let mut weights = NamedTensors::from([(EMBEDDING.into(), shared), (BYPASS.into(), bypass)]);
        let cut = WeightsCut {
            cut,
            bypass_has_codes,
        };
        cut.apply(&mut weights, &card, Path::new("model")).unwrap();
        let firsts = |name: &str| weights[name].values.chunks(width).map(|r| r[0]).collect();
        (firsts(EMBEDDING), firsts(BYPASS))
    }

    #[test]
    fn each_cut_changes_its_rows_alone() {
        let other = [0.0, 1.0, 2.0, 3.0, 4.0];
        let ends = [9.0, 10.0];
        let all =
            |codes: [f32; 4], context: [f32; 2]| [&other[..], &codes, &ends, &context].concat();
        let codes = [5.0, 6.0, 7.0, 8.0];
        let context = [11.0, 12.0];
        let bypass = vec![1.0, 2.0, 3.0];
        for (what, has_codes, embeddings, of_bypass) in [
            (
                RadarCut::AllButTokens,
                false,
                all(codes, [0.0; 2]),
                vec![0.0; 3],
            ),
            (
                RadarCut::AllButTokens,
                true,
                all(codes, [0.0; 2]),
                bypass.clone(),
            ),
            (
                RadarCut::Tokens,
                false,
                all([6.5; 4], context),
                bypass.clone(),
            ),
            (RadarCut::Tokens, true, all([6.5; 4], context), vec![0.0; 3]),
            (
                RadarCut::TokenMeaning,
                false,
                all([7.0, 8.0, 5.0, 6.0], context),
                bypass.clone(),
            ),
            (
                RadarCut::TokenMeaning,
                true,
                all([7.0, 8.0, 5.0, 6.0], context),
                vec![2.0, 3.0, 1.0],
            ),
        ] {
            assert_eq!(cut(what, has_codes), (embeddings, of_bypass), "{what:?}");
        }
    }
}
