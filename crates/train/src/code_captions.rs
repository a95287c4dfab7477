//! Supervision by captions: a small T5 writes a clip's caption from its code vectors and nothing else, and the
//! cross-entropy of its words reaches the tokenizer through the codes.
//!
//! [`crate::caption_words`] says which words a caption uses; a caption also says in which order and of whom. The T5 is used
//! in this stage only: the language model reads ids of codes and is trained from nothing. The paper has no such term.

use burn::tensor::{Device, Tensor};
use radarllm_facts::swap_sides;
use radarllm_inference::lm::vocab::EOS;
use radarllm_inference::lm::{LmConfig, LmError, LmPreset, Vocab};
use radarllm_nn::lm::{RadarT5, SourceBatch, TrainingPass};

use crate::lm::loss::cross_entropy;
use crate::lm::target_states;

/// Share of the target probability that is spread over the vocabulary.
const LABEL_SMOOTHING: f64 = 0.1;

/// Vocabulary and shape of the network that writes captions from codes.
pub struct CodeCaptions {
    vocab: Vocab,
    shape: LmConfig,
}

impl CodeCaptions {
    /// Learns the vocabulary from the captions of the training clips; with `mirror`, also from those of their mirror images.
    ///
    /// # Errors
    /// If there are too many different characters for the vocabulary.
    pub fn learn<'a>(
        captions: impl Iterator<Item = &'a str> + Clone,
        mirror: bool,
        code_dim: usize,
    ) -> Result<Self, LmError> {
        // One code stands for all: what differs between codes are their vectors.
        let mut shape = LmPreset::Tiny.config(1, code_dim);
        let mirrored: Vec<String> = match mirror {
            true => captions.clone().map(swap_sides).collect(),
            false => Vec::new(),
        };
        let vocab = Vocab::learn(
            captions
                .map(|caption| caption as &str)
                .chain(mirrored.iter().map(String::as_str)),
            std::iter::empty(),
            shape.max_text_vocab,
            shape.n_sentinels,
            shape.n_codes,
        )?;
        shape.network.set_vocab_size(vocab.layout().size());
        Ok(Self { vocab, shape })
    }

    /// A network drawn from `seed`.
    pub fn network(&self, seed: u64, device: &Device) -> Option<RadarT5> {
        let t5 = self.shape.t5()?;
        Some(RadarT5::new(t5, &self.shape, seed, device))
    }

    /// The caption as target tokens.
    ///
    /// # Errors
    /// If the text is longer than any caption could be.
    pub fn target(&self, caption: &str, mirrored: bool) -> Result<Vec<u32>, LmError> {
        let mut ids = match mirrored {
            true => self.vocab.text_ids(&swap_sides(caption))?,
            false => self.vocab.text_ids(caption)?,
        };
        ids.push(EOS);
        Ok(ids)
    }

    /// Cross-entropy of captions given the codes of their clips, nats per token; `None` if no clip has a caption.
    ///
    /// # Shapes
    /// - `codes`: `[codes of all clips, code_dim]`, clip by clip
    /// - `n_codes`: codes of each clip, each at least 1
    /// - `targets`: tokens of each clip's caption, empty without a caption
    pub fn loss(
        &self,
        net: &RadarT5,
        codes: Tensor<2>,
        n_codes: &[usize],
        targets: &[&[u32]],
        training: Option<&mut TrainingPass>,
    ) -> Option<Tensor<1>> {
        let mut first = 0;
        let (mut clips, mut rows, mut counts) = (Vec::new(), Vec::new(), Vec::new());
        for (n, target) in n_codes.iter().zip(targets) {
            if !target.is_empty() {
                clips.push(*target);
                rows.extend((first..first + n).map(|row| row as i64));
                counts.push(*n);
            }
            first += n;
        }
        if clips.is_empty() {
            return None;
        }
        let device = codes.device();
        let codes = codes.select(0, crate::tokenizer::indices(rows.into_iter(), &device));
        let code = self.vocab.layout().code(0);
        let source = SourceBatch::of_vectors(code, &counts, codes);
        let mut training = training;
        let encoded = net.encode(&source, training.as_deref_mut());
        let states = target_states(net, &encoded, &clips, training);
        let n_rows = self.shape.network.vocab_size();
        let logits = net.t5.logits(states, n_rows, Default::default());
        let targets: Vec<u32> = clips.concat();
        let weights = vec![1.0; targets.len()];
        Some(cross_entropy(logits, &targets, &weights, LABEL_SMOOTHING))
    }
}
