//! Supervision by caption words: predicts which words the captions of a motion use, so that radar codes represent the
//! action.
//!
//! Each code gives one logit per word. The logit of a clip is the log-mean-exp over its codes, so that one informative
//! code is enough: not every code of "walks, then sits down" has to predict both actions. The target is the share of
//! the motion's captions that use the word. The paper has no such term.

use std::collections::{BTreeMap, BTreeSet};

use burn::tensor::activation::sigmoid;
use burn::tensor::{Device, Int, Tensor, TensorData};
use radarllm_facts::swap_sides;

/// Minimum share of motions in which a word occurs. Rarer words are left out because they have too few examples.
const RAREST: f64 = 0.004;
/// Maximum share of motions in which a word occurs. More frequent words are left out because they carry no information.
const MOST_FREQUENT: f64 = 0.8;
/// Maximum number of words; the most frequent ones are kept.
const MAX_WORDS: usize = 256;
/// Score of a padding code.
const HIDDEN: f32 = -1e9;

/// The words to predict and their frequencies.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptionWords {
    /// Index of each word.
    index: BTreeMap<String, usize>,
    /// Log-odds of the mean target: the prediction for a word without radar data.
    prior: Vec<f32>,
}

impl CaptionWords {
    /// Counts the words in the captions of each training clip; with `mirror`, also those of their mirror images.
    pub fn count<'a>(clips: impl Iterator<Item = &'a [String]>, mirror: bool) -> Self {
        let mut frequency: BTreeMap<String, f64> = BTreeMap::new();
        let mut n = 0.0f64;
        for captions in clips {
            for mirrored in [false, true].into_iter().take(1 + usize::from(mirror)) {
                n += 1.0;
                for (word, share) in shares(captions, mirrored) {
                    *frequency.entry(word).or_default() += share;
                }
            }
        }
        let n = n.max(1.0);
        let mut kept: Vec<(String, f64)> = frequency
            .into_iter()
            .map(|(word, count)| (word, count / n))
            .filter(|(_, share)| (RAREST..=MOST_FREQUENT).contains(share))
            .collect();
        kept.sort_by(|a, b| b.1.total_cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
        kept.truncate(MAX_WORDS);
        let prior = kept
            .iter()
            .map(|(_, p)| (p / (1.0 - p)).ln() as f32)
            .collect();
        let index = kept
            .into_iter()
            .enumerate()
            .map(|(i, (word, _))| (word, i))
            .collect();
        Self { index, prior }
    }

    /// Number of words.
    pub fn len(&self) -> usize {
        self.prior.len()
    }

    /// Whether there are no words.
    pub fn is_empty(&self) -> bool {
        self.prior.is_empty()
    }

    /// Target of each word: the share of the captions that use it. With `mirrored`, the captions are those of the
    /// mirror image.
    pub fn targets(&self, captions: &[String], mirrored: bool) -> Vec<f32> {
        let mut targets = vec![0.0; self.len()];
        for (word, share) in shares(captions, mirrored) {
            if let Some(&row) = self.index.get(&word) {
                targets[row] = share as f32;
            }
        }
        targets
    }

    /// Rows of the words "left" and "right".
    pub fn sides(&self) -> Vec<usize> {
        let rows = ["left", "right"].map(|side| self.index.get(side).copied());
        rows.into_iter().flatten().collect()
    }

    /// Binary cross-entropy of each word of each clip, nats.
    ///
    /// # Shapes
    /// - `logits`: `[codes of all clips, words]`, clip by clip, without the prior
    /// - `n_codes`: codes of each clip, each at least 1
    /// - `targets`: `[clip][word]` flattened
    /// - returns: `[clips, words]`
    pub fn losses(
        &self,
        logits: Tensor<2>,
        n_codes: &[usize],
        targets: Vec<f32>,
        device: &Device,
    ) -> Tensor<2> {
        let (n_clips, n_words) = (n_codes.len(), self.len());
        let longest = n_codes.iter().copied().max().unwrap_or(1);
        let (mut rows, mut bias) = (Vec::new(), Vec::new());
        let mut first = 0;
        for &n in n_codes {
            for code in 0..longest {
                let real = code < n;
                rows.push((first + if real { code } else { 0 }) as i64);
                bias.push(if real { -(n as f32).ln() } else { HIDDEN });
            }
            first += n;
        }
        let rows = Tensor::<1, Int>::from_data(TensorData::new(rows, [n_clips * longest]), device);
        let bias = Tensor::<3>::from_data(TensorData::new(bias, [n_clips, longest, 1]), device);
        let x = logits.select(0, rows).reshape([n_clips, longest, n_words]) + bias;
        // Log-sum-exp over the codes.
        let peak = x.clone().detach().max_dim(1);
        let pooled = (x - peak.clone()).exp().sum_dim(1).log() + peak;
        let prior =
            Tensor::<2>::from_data(TensorData::new(self.prior.clone(), [1, n_words]), device);
        let x = pooled.reshape([n_clips, n_words]) + prior;
        let t = Tensor::<2>::from_data(TensorData::new(targets, [n_clips, n_words]), device);
        // -t ln s(x) - (1 - t) ln(1 - s(x)) = max(x, 0) - x t + ln(1 + exp(-|x|)). The last term is -ln s(|x|), and
        // s(|x|) is at least 0.5.
        let tail = sigmoid(x.clone().abs()).log();
        x.clone().clamp_min(0.0) - x * t - tail
    }
}

/// The words of the captions, with the share of the captions that use each word.
fn shares(captions: &[String], mirrored: bool) -> BTreeMap<String, f64> {
    let mut out = BTreeMap::new();
    for caption in captions {
        let caption = match mirrored {
            true => swap_sides(caption).to_lowercase(),
            false => caption.to_lowercase(),
        };
        let words: BTreeSet<&str> = caption
            .split(|c: char| !c.is_alphabetic())
            .filter(|word| !word.is_empty())
            .collect();
        for word in words {
            *out.entry(word.to_owned()).or_insert(0.0) += 1.0 / captions.len() as f64;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words() -> CaptionWords {
        let owned = |captions: &[&str]| captions.iter().map(|c| (*c).to_owned()).collect();
        let clips: [Vec<String>; 2] = [
            owned(&["a person waves", "A person waves the left hand"]),
            owned(&["a person sits", "a man sits down"]),
        ];
        CaptionWords::count(clips.iter().map(Vec::as_slice), true)
    }

    #[test]
    fn targets_are_shares_and_the_mirror_swaps_sides() {
        let words = words();
        let target = |mirrored: bool, word: &str| {
            let captions = ["Waves the left hand".to_owned(), "a wave".to_owned()];
            words.targets(&captions, mirrored)[words.index[word]]
        };
        assert_eq!(target(false, "waves"), 0.5);
        assert_eq!(target(false, "sits"), 0.0);
        assert_eq!((target(false, "left"), target(false, "right")), (0.5, 0.0));
        assert_eq!((target(true, "left"), target(true, "right")), (0.0, 0.5));
        // "a" is in every caption and carries no information.
        assert!(!words.index.contains_key("a"));
    }

    #[test]
    fn loss_is_the_binary_cross_entropy_of_the_pooled_logits() {
        let words = words();
        let (n, device) = (words.len(), Device::flex());
        let n_codes = [3, 1];
        let logit = |code: usize, word: usize| ((code * 7 + word * 3) % 11) as f32 * 0.7 - 3.0;
        let flat: Vec<f32> = (0..4)
            .flat_map(|c| (0..n).map(move |w| logit(c, w)))
            .collect();
        let targets: Vec<f32> = (0..2 * n).map(|i| (i % 3) as f32 * 0.5).collect();
        let mut expected = 0.0f64;
        for (clip, codes) in [(0, 0..3), (1, 3..4)] {
            for word in 0..n {
                let sum: f64 = codes.clone().map(|c| f64::from(logit(c, word)).exp()).sum();
                let x = (sum / codes.len() as f64).ln() + f64::from(words.prior[word]);
                let p = 1.0 / (1.0 + (-x).exp());
                let t = f64::from(targets[clip * n + word]);
                expected -= (t * p.ln() + (1.0 - t) * (1.0 - p).ln()) / 2.0;
            }
        }
        let logits = Tensor::<2>::from_data(TensorData::new(flat, [4, n]), &device);
        let loss = words.losses(logits, &n_codes, targets, &device).sum() / 2.0;
        let found = f64::from(loss.into_scalar::<f32>());
        assert!(
            (found - expected).abs() < 1e-4 * expected,
            "{found} {expected}"
        );
    }
}
