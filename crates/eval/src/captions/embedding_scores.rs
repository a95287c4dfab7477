//! BERTScore and SimCSE: captions and references compared by a sentence encoder.
//!
//! The encoder is whatever implements [`SentenceEncoder`], so that this crate needs no learning framework.

use std::collections::BTreeMap;

use radarllm_metrics::{
    Candidate, Protocol, Reference, Scores,
    bootstrap::{mean_interval, units_of_ids},
    embedding::{BertScore, Idf, Padding, Sentence, bert_score, cosine, padding},
};

use crate::{EvalError, interval::N_RESAMPLES};

/// Items whose token states are in memory at once.
const CHUNK: usize = 256;

/// Result of an encoder; its error is shown as it is.
pub type EncoderResult<T> = Result<T, Box<dyn std::error::Error + Send + Sync>>;

/// Tokens of a sentence with their states in one layer.
pub struct EncodedSentence {
    /// Token ids; the first and the last are special tokens.
    pub ids: Vec<u32>,
    /// States: `[token][width]`.
    pub states: Vec<f32>,
}

/// A network such as BERT that turns sentences into vectors.
pub trait SentenceEncoder {
    /// Width of a state.
    fn width(&self) -> usize;
    /// Token ids of sentences.
    ///
    /// # Errors
    /// Sentences that the encoder refuses.
    fn ids(&self, texts: &[String]) -> EncoderResult<Vec<Vec<u32>>>;
    /// States of all tokens in one layer.
    ///
    /// # Errors
    /// Sentences or a layer that the encoder refuses.
    fn encode(&self, texts: &[String], layer: usize) -> EncoderResult<Vec<EncodedSentence>>;
    /// One vector for each sentence.
    ///
    /// # Errors
    /// Sentences that the encoder refuses.
    fn embed(&self, texts: &[String]) -> EncoderResult<Vec<Vec<f32>>>;
}

/// How BERTScore is computed.
#[derive(Clone, Debug)]
pub struct BertScoreOptions {
    /// Layer whose states are compared.
    pub layer: usize,
    /// F1 baseline by which values are rescaled; as they are without it.
    pub baseline: Option<f64>,
}

/// One clip: the caption, and the references that count.
struct Item<'a> {
    id: &'a str,
    candidate: &'a str,
    references: Vec<&'a str>,
}

/// Adds BERTScore to the scores of the same captions. `name` is the encoder's; `seed` is the bootstrap's.
///
/// # Errors
/// Sentences that the encoder refuses.
pub fn add_bert_score(
    scores: &mut Scores,
    captions: (&[Candidate], &[Reference]),
    encoder: &dyn SentenceEncoder,
    name: &str,
    options: &BertScoreOptions,
    seed: u64,
) -> Result<(), EvalError> {
    let items = items(scores, captions);
    let with_idf = scores.protocol == Protocol::MotionGpt;
    let values = bert_scores(encoder, options, with_idf, &items)?;
    scores.bert_score = Some(mean(&values));
    scores.bert_score_rules = Some(format!(
        "{name}, layer {}, F1, best reference, {} idf, {}",
        options.layer,
        if with_idf { "with" } else { "without" },
        match options.baseline {
            Some(b) => format!("rescaled by {b}"),
            None => "not rescaled".into(),
        }
    ));
    add_interval(scores, "bert_score", &values, &items, seed);
    Ok(())
}

/// Adds SimCSE to the scores of the same captions. `name` is the encoder's, `pooling` says how it makes one vector of a
/// sentence; `seed` is the bootstrap's.
///
/// # Errors
/// Sentences that the encoder refuses.
pub fn add_sim_cse(
    scores: &mut Scores,
    captions: (&[Candidate], &[Reference]),
    encoder: &dyn SentenceEncoder,
    name: &str,
    pooling: &str,
    seed: u64,
) -> Result<(), EvalError> {
    let items = items(scores, captions);
    let values = similarities(encoder, &items)?;
    scores.sim_cse = Some(mean(&values));
    scores.sim_cse_rules = Some(format!("{name}, pooling {pooling}, cosine, best reference"));
    add_interval(scores, "sim_cse", &values, &items, seed);
    Ok(())
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn add_interval(scores: &mut Scores, field: &str, values: &[f64], items: &[Item], seed: u64) {
    scores.reason.remove(field);
    let units = units_of_ids(items.iter().map(|item| item.id));
    if let Some(found) = mean_interval(values, &units, N_RESAMPLES, seed) {
        scores.ci95.insert(field.into(), found);
    }
}

/// Items in the order of the references, with the references that the protocol counts: at most so many,
/// and, for `motiongpt`, repeated in turn up to that number. Ids agree, scoring has checked them.
fn items<'a>(
    scores: &Scores,
    (candidates, references): (&'a [Candidate], &'a [Reference]),
) -> Vec<Item<'a>> {
    let captions: BTreeMap<&str, &str> = candidates
        .iter()
        .map(|c| (c.id.as_str(), c.text.as_str()))
        .collect();
    let max = match scores.max_references {
        0 => usize::MAX,
        max => max,
    };
    references
        .iter()
        .filter_map(|reference| {
            let texts = reference.texts.iter().map(String::as_str);
            let references = match scores.protocol {
                Protocol::MotionGpt => texts.cycle().take(max).collect(),
                _ => texts.take(max).collect(),
            };
            Some(Item {
                id: &reference.id,
                candidate: captions.get(reference.id.as_str())?,
                references,
            })
        })
        .collect()
}

fn texts<'a>(items: &'a [Item], of: impl Fn(&'a Item) -> Vec<&'a str>) -> Vec<String> {
    items.iter().flat_map(of).map(String::from).collect()
}

fn bert_scores(
    encoder: &dyn SentenceEncoder,
    options: &BertScoreOptions,
    with_idf: bool,
    items: &[Item],
) -> Result<Vec<f64>, EvalError> {
    let idf = match with_idf {
        false => None,
        true => {
            let references = texts(items, |item| item.references.clone());
            let ids = encoder.ids(&references).map_err(EvalError::Encoder)?;
            Some(Idf::of(ids.iter().map(Vec::as_slice)))
        }
    };
    // The special tokens at both ends have no weight, but other tokens may be matched with them.
    let weights = |text: &EncodedSentence| -> Vec<f64> {
        let last = text.ids.len() - 1;
        let weight = |(i, &id): (usize, &u32)| match &idf {
            _ if i == 0 || i == last => 0.0,
            None => 1.0,
            Some(idf) => idf.weight(id),
        };
        text.ids.iter().enumerate().map(weight).collect()
    };
    let encode = |texts: &[String]| {
        encoder
            .encode(texts, options.layer)
            .map_err(EvalError::Encoder)
    };
    let mut paddings = paddings(encoder, items)?.into_iter();
    let mut out = Vec::with_capacity(items.len());
    for chunk in items.chunks(CHUNK) {
        let candidates = encode(&texts(chunk, |item| vec![item.candidate]))?;
        let references = encode(&texts(chunk, |item| item.references.clone()))?;
        let mut references = references.iter();
        for (item, candidate) in chunk.iter().zip(&candidates) {
            let candidate_weights = weights(candidate);
            let mut scores = Vec::with_capacity(item.references.len());
            for reference in references.by_ref().take(item.references.len()) {
                let reference_weights = weights(reference);
                scores.push(bert_score(
                    Sentence {
                        embeddings: &candidate.states,
                        weights: &candidate_weights,
                    },
                    Sentence {
                        embeddings: &reference.states,
                        weights: &reference_weights,
                    },
                    encoder.width(),
                    paddings.next().unwrap_or_default(),
                )?);
            }
            let best = BertScore::best(scores).unwrap_or_default();
            let rescaled = |b: f64| (best.f1 - b) / (1.0 - b);
            out.push(options.baseline.map_or(best.f1, rescaled));
        }
    }
    Ok(out)
}

/// The padding of all pairs of a candidate and a reference, in the order in which bert_score compares them: item by item,
/// reference by reference.
fn paddings(encoder: &dyn SentenceEncoder, items: &[Item]) -> Result<Vec<Padding>, EvalError> {
    let n_tokens = |texts: &[String]| -> Result<Vec<usize>, EvalError> {
        let ids = encoder.ids(texts).map_err(EvalError::Encoder)?;
        Ok(ids.iter().map(Vec::len).collect())
    };
    let mut lengths = Vec::with_capacity(items.len());
    for chunk in items.chunks(CHUNK) {
        let candidates = n_tokens(&texts(chunk, |item| vec![item.candidate]))?;
        let references = n_tokens(&texts(chunk, |item| item.references.clone()))?;
        let mut references = references.into_iter();
        for (item, candidate) in chunk.iter().zip(candidates) {
            let own = references.by_ref().take(item.references.len());
            lengths.extend(own.map(|reference| (candidate, reference)));
        }
    }
    Ok(padding(&lengths))
}

fn similarities(encoder: &dyn SentenceEncoder, items: &[Item]) -> Result<Vec<f64>, EvalError> {
    let embed = |texts: &[String]| encoder.embed(texts).map_err(EvalError::Encoder);
    let mut out = Vec::with_capacity(items.len());
    for chunk in items.chunks(CHUNK) {
        let candidates = embed(&texts(chunk, |item| vec![item.candidate]))?;
        let references = embed(&texts(chunk, |item| item.references.clone()))?;
        let mut references = references.iter();
        for (item, candidate) in chunk.iter().zip(&candidates) {
            let mut best = f64::NEG_INFINITY;
            for reference in references.by_ref().take(item.references.len()) {
                best = best.max(cosine(candidate, reference)?);
            }
            out.push(best);
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use radarllm_metrics::{ScoreOptions, score};

    use super::*;

    /// Every letter of the alphabet is a token with a direction of its own.
    struct Letters;

    impl SentenceEncoder for Letters {
        fn width(&self) -> usize {
            32
        }

        fn ids(&self, texts: &[String]) -> EncoderResult<Vec<Vec<u32>>> {
            let letters = |text: &String| text.bytes().filter(u8::is_ascii_lowercase).collect();
            let with_ends = |letters: Vec<u8>| {
                let inner = letters.into_iter().map(|b| u32::from(b - b'a'));
                [30].into_iter().chain(inner).chain([31]).collect()
            };
            Ok(texts.iter().map(letters).map(with_ends).collect())
        }

        fn encode(&self, texts: &[String], _: usize) -> EncoderResult<Vec<EncodedSentence>> {
            let encoded = |ids: Vec<u32>| EncodedSentence {
                states: ids
                    .iter()
                    .flat_map(|&id| (0..32).map(move |i| f32::from(u8::from(i == id))))
                    .collect(),
                ids,
            };
            Ok(self.ids(texts)?.into_iter().map(encoded).collect())
        }

        fn embed(&self, texts: &[String]) -> EncoderResult<Vec<Vec<f32>>> {
            let counts = |ids: Vec<u32>| {
                let count = |i: u32| ids.iter().filter(|id| **id == i).count() as f32;
                (0..26).map(count).collect()
            };
            Ok(self.ids(texts)?.into_iter().map(counts).collect())
        }
    }

    #[test]
    fn the_best_reference_counts() {
        let candidates = ["ab", "cd"].iter().enumerate().map(|(i, text)| Candidate {
            id: i.to_string(),
            text: (*text).into(),
        });
        let references = [["xy", "ab"], ["cx", "xc"]].iter().enumerate();
        let references = references.map(|(i, texts)| Reference {
            id: i.to_string(),
            texts: texts.map(String::from).to_vec(),
        });
        let candidates: Vec<_> = candidates.collect();
        let references: Vec<_> = references.collect();
        let mut scores = score(&candidates, &references, &ScoreOptions::default()).unwrap();
        let captions = (candidates.as_slice(), references.as_slice());
        let options = BertScoreOptions {
            layer: 1,
            baseline: None,
        };
        add_bert_score(&mut scores, captions, &Letters, "letters", &options, 1).unwrap();
        // The first caption is a reference; of the second one letter of two agrees.
        assert!((scores.bert_score.unwrap() - 0.75).abs() < 1e-6);
        assert!(
            scores.ci95.contains_key("bert_score") && !scores.reason.contains_key("bert_score")
        );
        add_sim_cse(&mut scores, captions, &Letters, "letters", "counts", 1).unwrap();
        assert!((scores.sim_cse.unwrap() - 0.75).abs() < 1e-6);
    }
}
