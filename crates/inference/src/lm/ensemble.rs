//! Models that describe together: an ensemble.
//!
//! Models that were trained differently err differently. Each member encodes a window with its own radar tokenizer and
//! generates its own sentence; what is stated is decided by the probabilities that all members give to all sentences.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use radarllm_base::PointFrame;
use radarllm_engine::{Source, Watch};

use super::templates::EVALUATION_PROMPT;
use super::{GenerateOptions, LmError, Vocab};
use crate::backend::Backend;
use crate::tokenizer::{Encoded, context::context};

/// Most members of an ensemble.
const MAX_MEMBERS: usize = 8;

/// Folders of the members of the model in `dir`: `dir` itself, `dir/member-2`, `dir/member-3` and so on, as far as they
/// exist.
pub fn member_folders(dir: &Path) -> Vec<PathBuf> {
    let further = (2..=MAX_MEMBERS).map(|n| dir.join(format!("member-{n}")));
    let further = further.take_while(|folder| folder.is_dir());
    [dir.to_path_buf()].into_iter().chain(further).collect()
}

/// One or more models.
pub(crate) struct Ensemble {
    members: Vec<Box<dyn Backend>>,
}

/// The sentence about a window.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sentence {
    pub text: String,
    /// exp(mean log-probability of a token), 0..=1, where the log-probability of several members is their mean.
    pub confidence: f32,
}

impl Ensemble {
    pub fn new(member: Box<dyn Backend>) -> Self {
        Self {
            members: vec![member],
        }
    }

    /// Adds the members of another ensemble after those of this one.
    pub fn join(&mut self, other: Self) {
        self.members.extend(other.members);
    }

    /// Whether there is only one member.
    pub fn is_single(&self) -> bool {
        self.members.len() == 1
    }

    /// The member whose radar tokens are reported.
    pub fn first(&self) -> &dyn Backend {
        self.members[0].as_ref()
    }

    pub fn n_params(&self) -> usize {
        self.members.iter().map(|m| m.n_params()).sum()
    }

    /// Encodes windows, each with the height of its radar: `[windows][members]`.
    pub fn encode(&self, windows: &[(&[PointFrame], f32)]) -> Result<Vec<Vec<Encoded>>, LmError> {
        let mut all: Vec<Vec<Encoded>> = vec![Vec::new(); windows.len()];
        for member in &self.members {
            let mut encoded = member.encode(windows)?;
            if member.vocab().is_told_context() {
                let measured = encoded.iter_mut().zip(windows);
                measured.for_each(|(e, (frames, _))| e.context = Some(context(frames)));
            }
            all.iter_mut().zip(encoded).for_each(|(w, e)| w.push(e));
        }
        Ok(all)
    }

    /// The sentence about each encoded window. Of the sentences of several members it is the one with the highest mean
    /// log-probability of a token; only a single member reports tokens to `watch`.
    pub fn sentences(
        &self,
        windows: &[Vec<Encoded>],
        options: &GenerateOptions,
        watch: &mut Watch,
    ) -> Result<Vec<Sentence>, LmError> {
        let mut candidates: Vec<Vec<Sentence>> = vec![Vec::new(); windows.len()];
        for (i, member) in self.members.iter().enumerate() {
            let prompts: Vec<Source> = windows
                .iter()
                .map(|radar| prompt(member.vocab(), &radar[i]))
                .collect::<Result<_, _>>()?;
            let generated = match self.is_single() {
                true => member.generate(&prompts, options, watch)?,
                false => {
                    let mut silent = Watch {
                        on_token: &mut |_, _| {},
                        cancel: watch.cancel,
                    };
                    member.generate(&prompts, options, &mut silent)?
                }
            };
            for (candidates, generated) in candidates.iter_mut().zip(generated) {
                candidates.push(Sentence {
                    text: member.vocab().text(&generated.ids),
                    confidence: per_token(generated.log_prob, generated.ids.len()),
                });
            }
        }
        let elected = windows.iter().zip(candidates);
        elected.map(|(radar, all)| self.elect(radar, all)).collect()
    }

    /// The best of the sentences of the members.
    fn elect(&self, radar: &[Encoded], mut candidates: Vec<Sentence>) -> Result<Sentence, LmError> {
        if !self.is_single() {
            let texts: BTreeSet<String> = candidates.into_iter().map(|c| c.text).collect();
            let texts: Vec<&String> = texts.iter().collect();
            let log_probs = self.mean_log_probs(radar, &texts)?;
            candidates = Vec::with_capacity(texts.len());
            for (text, log_prob) in texts.into_iter().zip(log_probs) {
                let n_tokens = self.first().vocab().text_ids(text)?.len();
                candidates.push(Sentence {
                    text: text.clone(),
                    confidence: per_token(log_prob, n_tokens),
                });
            }
        }
        let best = candidates
            .into_iter()
            .max_by(|a, b| a.confidence.total_cmp(&b.confidence));
        Ok(best.unwrap_or(Sentence {
            text: String::new(),
            confidence: 0.0,
        }))
    }

    /// Log-probability of each text for an encoded window, averaged over the members.
    pub fn mean_log_probs(
        &self,
        radar: &[Encoded],
        texts: &[impl AsRef<str>],
    ) -> Result<Vec<f32>, LmError> {
        Ok(mean(&self.log_probs(radar, texts)?))
    }

    /// Probability of each text among all of them for an encoded window, averaged over the members.
    pub fn probabilities(
        &self,
        radar: &[Encoded],
        texts: &[impl AsRef<str>],
    ) -> Result<Vec<f32>, LmError> {
        let log_probs = self.log_probs(radar, texts)?;
        let members: Vec<Vec<f32>> = log_probs.iter().map(|of| among_each_other(of)).collect();
        Ok(mean(&members))
    }

    /// Log-probability of each text by each member: `[members][texts]`.
    fn log_probs(
        &self,
        radar: &[Encoded],
        texts: &[impl AsRef<str>],
    ) -> Result<Vec<Vec<f32>>, LmError> {
        let of_member = |(member, radar): (&dyn Backend, &Encoded)| {
            let vocab = member.vocab();
            let ids: Vec<Vec<u32>> = texts
                .iter()
                .map(|text| vocab.text_ids(text.as_ref()))
                .collect::<Result<_, _>>()?;
            member.score(&prompt(vocab, radar)?, &ids)
        };
        let members = self.members.iter().map(AsRef::as_ref);
        members.zip(radar).map(of_member).collect()
    }
}

fn prompt(vocab: &Vocab, radar: &Encoded) -> Result<Source, LmError> {
    vocab.prompt(EVALUATION_PROMPT, Some(radar), None)
}

/// exp(mean log-probability) of `n_tokens` and the end token.
fn per_token(log_prob: f32, n_tokens: usize) -> f32 {
    (log_prob / (n_tokens + 1) as f32).exp().clamp(0.0, 1.0)
}

/// Mean of the members' values for each text.
fn mean(members: &[Vec<f32>]) -> Vec<f32> {
    let n_texts = members.first().map_or(0, Vec::len);
    let of = |i: usize| members.iter().map(|of| of[i]).sum::<f32>() / members.len() as f32;
    (0..n_texts).map(of).collect()
}

/// Probabilities of texts among each other; all the same if none of them is possible.
fn among_each_other(log_probs: &[f32]) -> Vec<f32> {
    let most = log_probs.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    if most == f32::NEG_INFINITY {
        return vec![1.0 / log_probs.len() as f32; log_probs.len()];
    }
    let weights: Vec<f32> = log_probs.iter().map(|x| (x - most).exp()).collect();
    let sum: f32 = weights.iter().sum();
    weights.iter().map(|w| w / sum).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::super::{Generated, templates};
    use super::*;
    use crate::tokenizer::EncodeError;

    const WALKS: &str = "a person walks";
    const JUMPS: &str = "a person jumps up and down";

    /// A model with one sentence and fixed probabilities of texts.
    struct Fixed {
        vocab: Vocab,
        says: &'static str,
        log_probs: HashMap<&'static str, f32>,
    }

    impl Fixed {
        fn boxed(says: &'static str, log_probs: [(&'static str, f32); 2]) -> Box<dyn Backend> {
            let texts = [WALKS, JUMPS];
            let vocab = Vocab::learn(texts.into_iter(), templates::all_text(), 500, 4, 8);
            Box::new(Self {
                vocab: vocab.unwrap(),
                says,
                log_probs: log_probs.into(),
            })
        }
    }

    impl Backend for Fixed {
        fn encode(&self, windows: &[(&[PointFrame], f32)]) -> Result<Vec<Encoded>, EncodeError> {
            let encoded = Encoded {
                codes: vec![1],
                features: vec![0.0],
                ..Encoded::default()
            };
            Ok(vec![encoded; windows.len()])
        }

        fn generate(
            &self,
            prompts: &[Source],
            _options: &GenerateOptions,
            watch: &mut Watch,
        ) -> Result<Vec<Generated>, LmError> {
            (watch.on_token)(0, 1);
            let ids = self.vocab.text_ids(self.says)?;
            let n_scored = ids.len() + 1;
            let generated = Generated::new(ids, self.log_probs[self.says], n_scored);
            Ok(vec![generated; prompts.len()])
        }

        fn score(&self, _prompt: &Source, texts: &[Vec<u32>]) -> Result<Vec<f32>, LmError> {
            let log_prob = |ids: &Vec<u32>| self.log_probs[self.vocab.text(ids).as_str()];
            Ok(texts.iter().map(log_prob).collect())
        }

        fn vocab(&self) -> &Vocab {
            &self.vocab
        }

        fn n_params(&self) -> usize {
            3
        }
    }

    fn ensemble(members: [Box<dyn Backend>; 2]) -> Ensemble {
        let [first, second] = members.map(Ensemble::new);
        let mut both = first;
        both.join(second);
        both
    }

    fn sentence(ensemble: &Ensemble) -> (Sentence, usize) {
        let frames = [PointFrame::default()];
        let encoded = ensemble.encode(&[(&frames, 1.0)]).unwrap();
        let mut n_tokens = 0;
        let mut watch = Watch {
            on_token: &mut |_, _| n_tokens += 1,
            cancel: &false.into(),
        };
        let sentences = ensemble.sentences(&encoded, &GenerateOptions::default(), &mut watch);
        (sentences.unwrap().remove(0), n_tokens)
    }

    #[test]
    fn the_sentence_that_all_find_most_probable_is_stated() {
        // Seven tokens of -0.7 and the average of four tokens of -0.2 and -2: the second member is sure.
        let unsure = || Fixed::boxed(WALKS, [(WALKS, -0.8), (JUMPS, -5.6)]);
        let sure = || Fixed::boxed(JUMPS, [(WALKS, -8.0), (JUMPS, -0.7)]);
        for members in [[unsure(), sure()], [sure(), unsure()]] {
            let both = ensemble(members);
            assert_eq!(both.n_params(), 6);
            let (sentence, n_tokens) = sentence(&both);
            assert_eq!(sentence.text, JUMPS);
            // The mean log-probability -3.15 of six words and the end token.
            assert!((sentence.confidence - (-0.45_f32).exp()).abs() < 1e-6);
            assert_eq!(n_tokens, 0, "tokens of members are not the caption");
        }
        let (alone, n_tokens) = sentence(&Ensemble::new(unsure()));
        assert_eq!((alone.text.as_str(), n_tokens), (WALKS, 1));
        assert!((alone.confidence - (-0.2_f32).exp()).abs() < 1e-6);
    }

    #[test]
    fn probabilities_are_averaged_over_members() {
        let even = Fixed::boxed(WALKS, [(WALKS, -3.0), (JUMPS, -3.0)]);
        let sure = Fixed::boxed(WALKS, [(WALKS, -1.0), (JUMPS, f32::NEG_INFINITY)]);
        let both = ensemble([even, sure]);
        let frames = [PointFrame::default()];
        let radar = &both.encode(&[(&frames, 1.0)]).unwrap()[0];
        let texts = [WALKS, JUMPS];
        assert_eq!(both.probabilities(radar, &texts).unwrap(), [0.75, 0.25]);
        let log_probs = both.mean_log_probs(radar, &texts).unwrap();
        assert_eq!(log_probs, [-2.0, f32::NEG_INFINITY]);
        assert_eq!(
            among_each_other(&[f32::NEG_INFINITY; 2]),
            [0.5, 0.5],
            "no text is possible"
        );
    }

    #[test]
    fn members_are_counted_without_gaps() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["member-2", "member-3", "member-5"] {
            std::fs::create_dir(dir.path().join(name)).unwrap();
        }
        std::fs::write(dir.path().join("member-4"), "a file").unwrap();
        let folders = member_folders(dir.path());
        let names = ["", "member-2", "member-3"].map(|name| dir.path().join(name));
        assert_eq!(folders.len(), 3);
        assert!(
            folders
                .iter()
                .zip(names)
                .all(|(a, b)| *a == b || a.join("") == b)
        );
    }
}
