//! Variety of sentences among each other: distinct-n, Self-BLEU and the number of words.
//!
//! ```
//! use radarllm_metrics::variety::{Variety, variety};
//!
//! let sentences = ["a person walks", "a person walks", "somebody sits down"].map(String::from);
//! let Variety { words, distinct, .. } = variety(&sentences);
//! assert_eq!(words, 6);
//! // Six different words of nine, four different pairs of six.
//! assert_eq!(distinct[..2], [6.0 / 9.0, 4.0 / 6.0]);
//! ```

use std::collections::BTreeSet;

use crate::{grams::Vocabulary, self_bleu, tokens};

/// How much sentences differ from each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Variety {
    /// Number of different words.
    pub words: usize,
    /// Different n-grams over all n-grams, n = 1..4 (Li et al. 2016, over all sentences together); 0 without n-grams.
    pub distinct: [f64; 4],
    /// Mean Self-BLEU; `None` for fewer than two sentences.
    pub self_bleu: Option<f64>,
}

/// The variety of sentences under the plain tokenisation.
pub fn variety(sentences: &[String]) -> Variety {
    let texts: Vec<String> = sentences
        .iter()
        .map(|s| tokens::plain(s).join(" "))
        .collect();
    let grams = Vocabulary::default().grams(&texts);
    let scores = self_bleu::self_bleu(&grams);
    let distinct: [(usize, f64); 4] = std::array::from_fn(|i| {
        let counted = grams.iter().flat_map(|g| &g.counts[i]);
        let different: BTreeSet<_> = counted.clone().map(|(gram, _)| gram).collect();
        let all: u64 = counted.map(|(_, n)| u64::from(*n)).sum();
        (different.len(), different.len() as f64 / all.max(1) as f64)
    });
    Variety {
        words: distinct[0].0,
        distinct: distinct.map(|(_, share)| share),
        self_bleu: (!scores.is_empty()).then(|| scores.iter().sum::<f64>() / scores.len() as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_sentences_have_no_variety() {
        let same = vec!["a person walks forward slowly".to_string(); 4];
        let found = variety(&same);
        assert_eq!((found.words, found.self_bleu), (5, Some(1.0)));
        assert_eq!(found.distinct, [0.25; 4]);
        let one = variety(&same[..1]);
        assert_eq!((one.self_bleu, one.distinct), (None, [1.0; 4]));
        assert_eq!(variety(&[]).distinct, [0.0; 4]);
    }
}
