//! Encodes sentences by a BERT or RoBERTa: states of their tokens, and one vector per sentence.
//!
//! BERTScore and SimCSE are computed from these states; their arithmetic is in `radarllm-metrics`. The text tokenizer
//! is the checkpoint's `tokenizer.json`, whose own truncation and padding settings are disabled.

use std::path::Path;

use burn::tensor::{Device, Tensor};
use tokenizers::Tokenizer;

use super::bert::Bert;
use super::folder::Pretrained;
use crate::lm::hf::{read, read_small};
use crate::lm::rows::Rows;
use crate::lm::text::text_error;
use radarllm_inference::lm::{InputError, LmError};

/// Maximum sentence length, tokens. Longer sentences are truncated, as BERTScore does.
const LONGEST: usize = 512;
/// Number of sentences per forward pass.
const BATCH: usize = 64;

/// How a sentence is reduced to one vector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pooling {
    /// Mean over all tokens, the special ones included.
    Mean,
    /// The first token's state (unsupervised SimCSE).
    Cls,
    /// The first token's state through the pooler, `tanh(W x + b)` (supervised SimCSE).
    Pooler,
}

impl Pooling {
    /// `mean`, `cls` or `pooler`.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "mean" => Some(Self::Mean),
            "cls" => Some(Self::Cls),
            "pooler" => Some(Self::Pooler),
            _ => None,
        }
    }
}

/// One sentence.
#[derive(Clone, Debug, PartialEq)]
pub struct EncodedText {
    /// Token ids. The first and the last are special tokens.
    pub ids: Vec<u32>,
    /// `[ids.len(), width]`.
    pub states: Vec<f32>,
}

/// A network and its text tokenizer.
pub struct TextEncoder {
    bert: Bert,
    tokenizer: Tokenizer,
    device: Device,
}

impl TextEncoder {
    /// Reads a folder with `config.json`, `model.safetensors` and `tokenizer.json`.
    ///
    /// # Errors
    /// Missing or damaged files; an architecture other than BERT or RoBERTa.
    pub fn open(dir: &Path, device: &Device) -> Result<Self, LmError> {
        let bert = match Pretrained::open(dir, device)? {
            Pretrained::Bert(bert) => *bert,
            other => {
                return Err(LmError::Config {
                    field: "model_type",
                    problem: format!(
                        "{}: expected bert or roberta, found {}",
                        dir.display(),
                        other.architecture()
                    ),
                });
            }
        };
        let json = read_small(&dir.join("tokenizer.json"))?;
        Self::new(
            bert,
            Tokenizer::from_bytes(json).map_err(text_error)?,
            device,
        )
    }

    fn new(bert: Bert, mut tokenizer: Tokenizer, device: &Device) -> Result<Self, LmError> {
        tokenizer.with_padding(None);
        tokenizer.with_truncation(None).map_err(text_error)?;
        Ok(Self {
            bert,
            tokenizer,
            device: device.clone(),
        })
    }

    /// Number of blocks of the network.
    pub fn n_layers(&self) -> usize {
        self.bert.config().num_hidden_layers
    }

    /// Width of a state.
    pub fn width(&self) -> usize {
        self.bert.config().hidden_size
    }

    /// Whether [`Pooling::Pooler`] is available.
    pub fn has_pooler(&self) -> bool {
        self.bert.has_pooler()
    }

    /// Token ids of every sentence, special tokens included. RoBERTa reads a sentence as if it occurred
    /// within a text, after a space.
    ///
    /// # Errors
    /// Errors of the text tokenizer; ids outside the network's vocabulary.
    pub fn ids(&self, texts: &[String]) -> Result<Vec<Vec<u32>>, LmError> {
        let is_roberta = self.bert.config().model_type != "bert";
        let longest = LONGEST.min(self.bert.config().longest());
        texts
            .iter()
            .map(|text| {
                let text = text.trim();
                let text = if is_roberta && !text.is_empty() {
                    format!(" {text}")
                } else {
                    text.to_string()
                };
                let encoding = self.tokenizer.encode(text, true).map_err(text_error)?;
                let mut ids = encoding.get_ids().to_vec();
                // The last token is special and is kept.
                if ids.len() > longest {
                    let last = ids[ids.len() - 1];
                    ids.truncate(longest);
                    ids[longest - 1] = last;
                }
                Ok(ids)
            })
            .collect()
    }

    /// States of all tokens after `layer` blocks.
    ///
    /// # Errors
    /// [`LmError::Input`] for a layer that the network lacks and for sentences without any token; see
    /// also [`Self::ids`].
    pub fn encode(&self, texts: &[String], layer: usize) -> Result<Vec<EncodedText>, LmError> {
        if layer > self.n_layers() {
            let (found, n_layers) = (layer, self.n_layers());
            return Err(InputError::Layer { found, n_layers }.into());
        }
        let mut out = vec![None; texts.len()];
        self.batches(
            texts,
            |indices, lengths, ids, states, length| {
                let width = states.dims()[1];
                let states = read(states);
                for (row, (&index, &n)) in indices.iter().zip(lengths).enumerate() {
                    let from = row * length;
                    out[index] = Some(EncodedText {
                        ids: ids[from..from + n].to_vec(),
                        states: states[from * width..(from + n) * width].to_vec(),
                    });
                }
                Ok(())
            },
            layer,
        )?;
        // Every sentence was in a batch.
        Ok(out.into_iter().flatten().collect())
    }

    /// One vector per sentence, `[texts.len()][width]`, not normalised.
    ///
    /// # Errors
    /// [`LmError::Input`] if the requested pooler is absent; see also [`Self::encode`].
    pub fn sentences(&self, texts: &[String], pooling: Pooling) -> Result<Vec<Vec<f32>>, LmError> {
        let mut out = vec![vec![]; texts.len()];
        let layer = self.n_layers();
        self.batches(
            texts,
            |indices, lengths, _, states, length| {
                let width = states.dims()[1];
                let n_rows = indices.len();
                let first = || {
                    let states = states.clone().reshape([n_rows, length * width]);
                    states.narrow(1, 0, width)
                };
                let vectors = match pooling {
                    Pooling::Cls => read(first()),
                    Pooling::Pooler => {
                        let pooled = self.bert.pooled(first());
                        read(pooled.ok_or(InputError::NoPooler)?)
                    }
                    Pooling::Mean => {
                        let states = read(states.clone());
                        let mut means = vec![0.0; n_rows * width];
                        for (row, (mean, &n)) in
                            means.chunks_exact_mut(width).zip(lengths).enumerate()
                        {
                            for state in states[row * length * width..].chunks_exact(width).take(n)
                            {
                                for (mean, value) in mean.iter_mut().zip(state) {
                                    *mean += value / n as f32;
                                }
                            }
                        }
                        means
                    }
                };
                for (&index, vector) in indices.iter().zip(vectors.chunks_exact(width)) {
                    out[index] = vector.to_vec();
                }
                Ok(())
            },
            layer,
        )?;
        Ok(out)
    }

    /// Runs sentences of similar length together and passes on, per batch: their indices in `texts`, their
    /// lengths, ids `[row][length]`, states `[rows * length, width]` and the padded length.
    fn batches(
        &self,
        texts: &[String],
        mut each: impl FnMut(&[usize], &[usize], &[u32], Tensor<2>, usize) -> Result<(), LmError>,
        layer: usize,
    ) -> Result<(), LmError> {
        let config = self.bert.config();
        let ids = self.ids(texts)?;
        if let Some(sentence) = ids.iter().position(Vec::is_empty) {
            return Err(InputError::NoToken { sentence }.into());
        }
        let mut order: Vec<usize> = (0..texts.len()).collect();
        order.sort_by_key(|&i| ids[i].len());
        for indices in order.chunks(BATCH) {
            let lengths: Vec<usize> = indices.iter().map(|&i| ids[i].len()).collect();
            let length = lengths.iter().copied().max().unwrap_or(0);
            let padded = |i: usize, fill: u32| {
                let mut row = ids[i].clone();
                row.resize(length, fill);
                row
            };
            let pad = config.pad_token_id.unwrap_or(0) as u32;
            let rows: Vec<Vec<u32>> = indices.iter().map(|&i| padded(i, pad)).collect();
            let mask: Vec<Vec<u32>> = lengths
                .iter()
                .map(|&n| (0..length).map(|k| u32::from(k < n)).collect())
                .collect();
            let rows = Rows::new(&rows, Some(&mask), config.vocab_size, config.longest())?;
            let states = self.bert.states(&rows, layer, &self.device);
            each(indices, &lengths, &rows.ids, states, length)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pretrained::folder::tests::golden_network;

    /// Words w3..w39 are ids 3..39; `[CLS]` 1, `[SEP]` 2, padding 0.
    fn encoder(golden: &str) -> TextEncoder {
        let words: Vec<String> = (3..40).map(|i| format!("\"w{i}\":{i}")).collect();
        let json = format!(
            r#"{{"version":"1.0","truncation":{{"direction":"Right","max_length":4,"strategy":"LongestFirst","stride":0}},
            "padding":null,"added_tokens":[],"normalizer":null,"pre_tokenizer":{{"type":"Whitespace"}},
            "post_processor":{{"type":"BertProcessing","sep":["[SEP]",2],"cls":["[CLS]",1]}},"decoder":null,
            "model":{{"type":"WordLevel","unk_token":"[UNK]","vocab":{{"[UNK]":0,"[CLS]":1,"[SEP]":2,{}}}}}}}"#,
            words.join(",")
        );
        let Pretrained::Bert(bert) = golden_network(golden) else {
            panic!("{golden} is no encoder");
        };
        let tokenizer = Tokenizer::from_bytes(json).unwrap();
        TextEncoder::new(*bert, tokenizer, &Device::flex()).unwrap()
    }

    fn texts() -> Vec<String> {
        ["w3 w4 w5", "w9", "", "w30 w31 w32 w33 w34 w35 w36", "w3 w4"]
            .map(String::from)
            .to_vec()
    }

    #[test]
    fn a_sentence_is_the_same_alone_and_among_others() {
        for golden in ["bert.safetensors", "roberta.safetensors"] {
            let encoder = encoder(golden);
            for layer in 0..=encoder.n_layers() {
                let together = encoder.encode(&texts(), layer).unwrap();
                assert_eq!(together.len(), texts().len());
                for (text, found) in texts().into_iter().zip(&together) {
                    let n_words = text.split_whitespace().count();
                    // The tokenizer's own truncation to four is disabled.
                    assert_eq!(found.ids.len(), n_words + 2, "{golden} {text}");
                    let alone = &encoder.encode(&[text], layer).unwrap()[0];
                    assert_eq!(alone.ids, found.ids);
                    for (a, b) in alone.states.iter().zip(&found.states) {
                        assert!((a - b).abs() < 1e-5, "{golden}: {a} {b}");
                    }
                }
            }
            assert!(encoder.encode(&texts(), encoder.n_layers() + 1).is_err());
        }
    }

    #[test]
    fn vectors_are_made_from_the_states() {
        let encoder = encoder("bert.safetensors");
        let width = encoder.width();
        let states = encoder.encode(&texts(), encoder.n_layers()).unwrap();
        let means = encoder.sentences(&texts(), Pooling::Mean).unwrap();
        let firsts = encoder.sentences(&texts(), Pooling::Cls).unwrap();
        for ((text, mean), first) in states.iter().zip(&means).zip(&firsts) {
            assert_eq!(first.as_slice(), &text.states[..width]);
            for (i, mean) in mean.iter().enumerate() {
                let column = text.states.iter().skip(i).step_by(width);
                let expected = column.sum::<f32>() / text.ids.len() as f32;
                assert!((mean - expected).abs() < 1e-5);
            }
        }
        // Through tanh, one vector per sentence.
        let pooled = encoder.sentences(&texts(), Pooling::Pooler).unwrap();
        for (vector, first) in pooled.iter().zip(&firsts) {
            assert!(vector.len() == width && vector != first);
            assert!(vector.iter().all(|x| x.abs() <= 1.0));
        }
    }
}
