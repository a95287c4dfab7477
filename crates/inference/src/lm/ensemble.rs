//! Models that describe together: an ensemble.
//!
//! Models that were trained differently err differently. Each member encodes a window with its own radar tokenizer and
//! draws its own sentences, whose actions are counted like votes; or each searches for one sentence, and the probabilities
//! that all members give to all of them decide.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use radarllm_base::PointFrame;
use radarllm_engine::{Source, Watch};
use radarllm_facts::{Action, Direction, Side};

use super::consensus::content;
use super::cut::{RadarCut, WeightsCut};
use super::templates::EVALUATION_PROMPT;
use super::{GenerateOptions, LmError, Vocab};
use crate::backend::Backend;
use crate::checkpoint::{Checkpoint, CheckpointError};
use crate::evidence::{Content, Evidence, N_SIDES, SIDES, WindowValues, only_side};
use crate::tokenizer::{Encoded, context::context, encode::TokenizerFile};

/// Power of what the points say by themselves about actions, beside the share of draws: chosen among 0.5, 1 and 1.5 on
/// validation clips (docs/results/evidence.md).
const TRUST: f32 = 0.5;
/// Contents are at least this probable by the points, whatever they show.
const MIN_PROBABILITY: f32 = 1e-4;
/// Share of the draws that what nobody drew counts as: that of one of 32.
const UNDRAWN: f32 = 0.03;

/// Most members of an ensemble.
const MAX_MEMBERS: usize = 8;

/// Folders of the members of the model in `dir`: `dir` itself, `dir/member-2`, `dir/member-3` and so on, as far as they
/// exist.
pub fn member_folders(dir: &Path) -> Vec<PathBuf> {
    let further = (2..=MAX_MEMBERS).map(|n| dir.join(format!("member-{n}")));
    let further = further.take_while(|folder| folder.is_dir());
    [dir.to_path_buf()].into_iter().chain(further).collect()
}

/// The checkpoints of a radar tokenizer and of a language model that belong together: a model, or a member of an
/// ensemble.
#[derive(Debug)]
pub struct Member {
    /// The radar tokenizer.
    pub tokenizer: Checkpoint,
    /// The language model.
    pub lm: Checkpoint,
    /// What is cut between radar and language model, to measure what it is worth.
    pub cut: Option<RadarCut>,
}

impl Member {
    /// Folders of the two checkpoints in the folder of a member.
    pub const PARTS: [&str; 2] = ["lm", "tokenizer"];

    /// Opens `dir/tokenizer` and `dir/lm`, whose checksums are verified.
    ///
    /// # Errors
    /// If either is missing or damaged.
    pub fn open(dir: &Path) -> Result<Self, CheckpointError> {
        Ok(Self {
            tokenizer: Checkpoint::open(&dir.join("tokenizer"))?,
            lm: Checkpoint::open(&dir.join("lm"))?,
            cut: None,
        })
    }

    /// What is cut in the weights of the language model.
    ///
    /// # Errors
    /// If something is cut and the configuration of the tokenizer, which decides what enters the bypass, cannot be read.
    pub fn weights_cut(&self) -> Result<Option<WeightsCut>, CheckpointError> {
        let Some(cut) = self.cut else {
            return Ok(None);
        };
        let tokenizer = TokenizerFile::read(&self.tokenizer)?;
        Ok(Some(WeightsCut {
            cut,
            bypass_has_codes: tokenizer.model.residual_codes > 0,
        }))
    }
}

/// Opens all members of the model in `dir`; see [`member_folders`].
///
/// # Errors
/// If one is missing or damaged.
pub fn open_members(dir: &Path) -> Result<Vec<Member>, CheckpointError> {
    let folders = member_folders(dir);
    folders.iter().map(|folder| Member::open(folder)).collect()
}

/// One or more models.
pub(crate) struct Ensemble {
    members: Vec<Box<dyn Backend>>,
    /// Networks that weigh the sentences, if the model has them.
    evidence: Option<Evidence>,
}

/// The sentence about a window.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sentence {
    pub text: String,
    /// exp(mean log-probability of a token), 0..=1, where the log-probability of several members is their mean; of a
    /// vote, the share of the draws that state the same actions.
    pub confidence: f32,
    /// Probability of the stated sides among the sides that drawn sentences with the same actions state, 0..=1. `None` if
    /// the sentence states no side or was searched for.
    pub side_confidence: Option<f32>,
}

/// What the members of an ensemble read of a window.
#[derive(Clone, Debug, Default)]
pub(crate) struct EncodedWindow {
    /// Codes, features and context by each member.
    pub members: Vec<Encoded>,
    /// What the points say by themselves, if that weighs the sentences.
    pub evidence: Option<WindowEvidence>,
}

/// What the points of a window say by themselves.
#[derive(Clone, Debug)]
pub(crate) struct WindowEvidence {
    values: WindowValues,
    /// Probabilities of the contents.
    contents: Vec<f32>,
}

impl Ensemble {
    pub(crate) fn new(member: Box<dyn Backend>) -> Self {
        Self {
            members: vec![member],
            evidence: None,
        }
    }

    /// The same, with sentences weighed by what the points say by themselves.
    pub(crate) fn with_evidence(self, mut evidence: Evidence) -> Self {
        let knows = |member: &dyn Backend, text: &str| member.vocab().text_ids(text).is_ok();
        evidence.keep_sentences(|text| self.members.iter().all(|m| knows(m.as_ref(), text)));
        Self {
            evidence: Some(evidence),
            ..self
        }
    }

    /// Adds the members of another ensemble after those of this one.
    pub(crate) fn join(&mut self, other: Self) {
        self.members.extend(other.members);
    }

    /// Whether there is only one member.
    pub(crate) fn is_single(&self) -> bool {
        self.members.len() == 1
    }

    /// The member whose radar tokens are reported.
    pub(crate) fn first(&self) -> &dyn Backend {
        self.members[0].as_ref()
    }

    pub(crate) fn n_params(&self) -> usize {
        let members: usize = self.members.iter().map(|m| m.n_params()).sum();
        members + self.evidence.as_ref().map_or(0, Evidence::n_params)
    }

    /// Encodes windows, each with the height of its radar.
    pub(crate) fn encode(
        &self,
        windows: &[(&[PointFrame], f32)],
    ) -> Result<Vec<EncodedWindow>, LmError> {
        self.encode_by(windows, self.members.len(), true)
    }

    /// As [`Self::encode`], by the first `n_members` members, which alone describe these windows then; `weighed` says whether
    /// what the points say by themselves weighs their sentences.
    pub(crate) fn encode_by(
        &self,
        windows: &[(&[PointFrame], f32)],
        n_members: usize,
        weighed: bool,
    ) -> Result<Vec<EncodedWindow>, LmError> {
        let evidence = self.evidence.as_ref().filter(|_| weighed);
        let of = |(frames, height_m): &(&[PointFrame], f32)| EncodedWindow {
            members: Vec::new(),
            evidence: evidence.and_then(|networks| {
                let values = WindowValues::of(frames, *height_m)?;
                let contents = networks.contents(&values);
                Some(WindowEvidence { values, contents })
            }),
        };
        let mut all: Vec<EncodedWindow> = windows.iter().map(of).collect();
        // The same for all members.
        let has_context = |member: &dyn Backend| member.vocab().has_context();
        let contexts: Vec<_> = match self.members.iter().any(|m| has_context(m.as_ref())) {
            true => windows.iter().map(|(frames, _)| context(frames)).collect(),
            false => Vec::new(),
        };
        for member in self.members.iter().take(n_members) {
            let mut encoded = member.encode(windows)?;
            if has_context(member.as_ref()) {
                let measured = encoded.iter_mut().zip(&contexts);
                measured.for_each(|(e, context)| e.context = Some(*context));
            }
            all.iter_mut()
                .zip(encoded)
                .for_each(|(w, e)| w.members.push(e));
        }
        Ok(all)
    }

    /// The sentence about each encoded window. Of the sentences of several members it is the one with the highest mean
    /// log-probability of a token; only a single member reports tokens to `watch`.
    pub(crate) fn sentences(
        &self,
        windows: &[EncodedWindow],
        options: &GenerateOptions,
        watch: &mut Watch,
    ) -> Result<Vec<Sentence>, LmError> {
        let mut candidates: Vec<Vec<Sentence>> = vec![Vec::new(); windows.len()];
        let n_members = windows.first().map_or(0, |w| w.members.len());
        for (i, member) in self.members.iter().enumerate().take(n_members) {
            let prompts: Vec<Source> = windows
                .iter()
                .map(|window| prompt(member.vocab(), &window.members[i]))
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
                    side_confidence: None,
                });
            }
        }
        let elected = windows.iter().zip(candidates);
        elected
            .map(|(window, all)| self.elect(window, all))
            .collect()
    }

    /// The sentence about each encoded window by a vote of `n` draws from each member. The actions are those of most draws.
    /// Of the sentences with these actions, the sides are those with the largest sum of probabilities, the directions
    /// then those of most draws, and the sentence is the one with the highest mean log-probability of a token. Its
    /// confidence is the share of the draws that state these actions.
    ///
    /// The most probable sentence alone would prefer what has few wordings: what is said in many ways has little
    /// probability in each. For the same reason sides are decided before directions: "punches with the left fist" is said
    /// with "forward", "upward" and without either, "with both fists" is not. Sides are decided by probabilities and not by
    /// numbers of draws, because these are few, and odd ones would count as much as others.
    pub(crate) fn voted(
        &self,
        windows: &[EncodedWindow],
        n: usize,
        options: &GenerateOptions,
        cancel: &AtomicBool,
    ) -> Result<Vec<Sentence>, LmError> {
        let mut ballots: Vec<BTreeMap<String, usize>> = vec![BTreeMap::new(); windows.len()];
        let n_members = windows.first().map_or(0, |w| w.members.len());
        for (i, member) in self.members.iter().enumerate().take(n_members) {
            let prompts: Vec<Source> = windows
                .iter()
                .map(|window| prompt(member.vocab(), &window.members[i]))
                .collect::<Result<_, _>>()?;
            let draws = member.draw(&prompts, n, options, cancel)?;
            for (ballots, draws) in ballots.iter_mut().zip(draws) {
                for draw in draws {
                    *ballots.entry(member.vocab().text(&draw.ids)).or_default() += 1;
                }
            }
        }
        let votes = windows.iter().zip(ballots);
        votes
            .map(|(window, votes)| self.count(window, votes))
            .collect()
    }

    /// The sentence that a vote elects.
    fn count(
        &self,
        window: &EncodedWindow,
        votes: BTreeMap<String, usize>,
    ) -> Result<Sentence, LmError> {
        let (same_actions, confidence) = self.same_actions(window, votes.into_iter().collect());
        let (texts, numbers): (Vec<String>, Vec<usize>) = same_actions.into_iter().unzip();
        let log_probs = self.log_probs(window, &texts)?;
        let members: Vec<Vec<f32>> = log_probs.iter().map(|of| among_each_other(of)).collect();
        let (mut probabilities, log_probs) = (mean(&members), mean(&log_probs));
        self.weigh_sides(window, &texts, &mut probabilities);
        let drawn = texts.into_iter().zip(numbers).enumerate();
        let drawn = drawn.map(|(i, (text, n))| Drawn {
            text,
            n,
            probability: probabilities[i],
            log_prob: log_probs[i],
        });
        let (same_sides, side_confidence) =
            heaviest(drawn.collect(), sides_stated, |d| d.probability);
        let states_side = |drawn: &Drawn| sides_stated(&drawn.text).iter().any(Option::is_some);
        let side_confidence = same_sides
            .first()
            .is_some_and(states_side)
            .then_some(side_confidence);
        // Of sentences that nobody drew, the probabilities decide.
        let is_drawn = same_sides.iter().any(|d| d.n > 0);
        let weight = |d: &Drawn| if is_drawn { d.n as f32 } else { d.probability };
        let (same_directions, _) = heaviest(same_sides, directions_stated, weight);
        let mut sentences = Vec::with_capacity(same_directions.len());
        for drawn in same_directions {
            let n_tokens = self.first().vocab().text_ids(&drawn.text)?.len();
            sentences.push(Sentence {
                confidence: per_token(drawn.log_prob, n_tokens),
                text: drawn.text,
                side_confidence,
            });
        }
        Ok(Sentence {
            confidence,
            ..most_confident(sentences)
        })
    }

    /// The drawn sentences with the actions that are stated, and how certain these are, 0..=1: those of most draws, and the
    /// share of the draws that state them. If the points say something by themselves, the shares are multiplied by what they
    /// say; actions that nobody drew count as [`UNDRAWN`] of the draws, and are stated by sentences of their own.
    fn same_actions(&self, window: &EncodedWindow, votes: Votes) -> (Votes, f32) {
        let n: usize = votes.iter().map(|(_, n)| n).sum();
        let share =
            |group: &Votes| group.iter().map(|(_, n)| n).sum::<usize>() as f32 / n.max(1) as f32;
        let mut groups: BTreeMap<_, Votes> = BTreeMap::new();
        for (text, n) in votes {
            let actions = actions_stated(&text);
            groups.entry(actions).or_default().push((text, n));
        }
        let mut weighed: Vec<(f32, Votes)> = Vec::new();
        let mut drawn = BTreeSet::new();
        let evidence = self.evidence.as_ref().zip(window.evidence.as_ref());
        for group in groups.into_values() {
            let weight = evidence.map_or(1.0, |(networks, said)| {
                let text = group.first().map_or("", |(text, _)| text.as_str());
                let index = networks.file().index_of(text);
                drawn.extend(index);
                said.weight(index)
            });
            weighed.push((share(&group) * weight, group));
        }
        let undrawn: Vec<(f32, &Content)> = evidence.map_or(Vec::new(), |(networks, said)| {
            let contents = networks.file().contents.iter().enumerate();
            let can_be = contents.filter(|(i, c)| !drawn.contains(i) && !c.sentences.is_empty());
            can_be
                .map(|(i, content)| (UNDRAWN * said.weight(Some(i)), content))
                .collect()
        });
        let weights = weighed.iter().map(|(weight, _)| weight);
        let total: f32 = weights
            .chain(undrawn.iter().map(|(weight, _)| weight))
            .sum();
        let by_weight = |a: &f32, b: &f32| a.total_cmp(b);
        let best = weighed.into_iter().max_by(|a, b| by_weight(&a.0, &b.0));
        let (mut weight, mut group) = best.unwrap_or_default();
        let best_undrawn = undrawn.into_iter().max_by(|a, b| by_weight(&a.0, &b.0));
        if let Some((own, content)) = best_undrawn.filter(|(own, _)| *own >= weight) {
            weight = own;
            group = content
                .sentences
                .iter()
                .map(|text| (text.clone(), 0))
                .collect();
        }
        (group, weight / total.max(f32::MIN_POSITIVE))
    }

    /// The best of the sentences of the members.
    fn elect(
        &self,
        window: &EncodedWindow,
        candidates: Vec<Sentence>,
    ) -> Result<Sentence, LmError> {
        if self.is_single() {
            return Ok(most_confident(candidates));
        }
        let texts: BTreeSet<String> = candidates.into_iter().map(|c| c.text).collect();
        let texts: Vec<String> = texts.into_iter().collect();
        Ok(most_confident(self.scored(window, texts)?))
    }

    /// Texts with their probability by all members.
    fn scored(&self, window: &EncodedWindow, texts: Vec<String>) -> Result<Vec<Sentence>, LmError> {
        let log_probs = self.mean_log_probs(window, &texts)?;
        let mut all = Vec::with_capacity(texts.len());
        for (text, log_prob) in texts.into_iter().zip(log_probs) {
            let n_tokens = self.first().vocab().text_ids(&text)?.len();
            all.push(Sentence {
                text,
                confidence: per_token(log_prob, n_tokens),
                side_confidence: None,
            });
        }
        Ok(all)
    }

    /// Log-probability of each text for an encoded window, averaged over the members.
    pub(crate) fn mean_log_probs(
        &self,
        window: &EncodedWindow,
        texts: &[impl AsRef<str>],
    ) -> Result<Vec<f32>, LmError> {
        Ok(mean(&self.log_probs(window, texts)?))
    }

    /// Probability of each text among all of them for an encoded window, averaged over the members, and weighed
    /// with what the points say by themselves.
    pub(crate) fn probabilities(
        &self,
        window: &EncodedWindow,
        texts: &[impl AsRef<str>],
    ) -> Result<Vec<f32>, LmError> {
        let log_probs = self.log_probs(window, texts)?;
        let members: Vec<Vec<f32>> = log_probs.iter().map(|of| among_each_other(of)).collect();
        let mut probabilities = mean(&members);
        self.weigh_actions(window, texts, &mut probabilities);
        self.weigh_sides(window, texts, &mut probabilities);
        Ok(probabilities)
    }

    /// Multiplies the probabilities of texts by what the points say of their actions.
    fn weigh_actions(
        &self,
        window: &EncodedWindow,
        texts: &[impl AsRef<str>],
        probabilities: &mut [f32],
    ) {
        if let (Some(networks), Some(said)) = (&self.evidence, &window.evidence) {
            let weight = |text: &str| said.weight(networks.file().index_of(text));
            let all: Vec<usize> = (0..texts.len()).collect();
            weigh(probabilities, &all, |i| weight(texts[i].as_ref()));
        }
    }

    /// Multiplies the probabilities of texts by what the points say of their sides. What is probable of texts that state the
    /// same actions stays the same in all.
    fn weigh_sides(
        &self,
        window: &EncodedWindow,
        texts: &[impl AsRef<str>],
        probabilities: &mut [f32],
    ) {
        let (Some(networks), Some(said)) = (&self.evidence, &window.evidence) else {
            return;
        };
        let mut groups: BTreeMap<_, Vec<usize>> = BTreeMap::new();
        for (i, text) in texts.iter().enumerate() {
            let actions = actions_stated(text.as_ref());
            groups.entry(actions).or_default().push(i);
        }
        // Most texts state the same action, whose sides are computed once.
        let mut known = BTreeMap::new();
        let mut weight = |text: &str| {
            let (action, side) = only_side(text)?;
            let sides = || networks.sides(&said.values, action);
            let probabilities = (*known.entry(action).or_insert_with(sides))?;
            let index = SIDES.iter().position(|s| *s == side)?;
            Some(probabilities[index])
        };
        // Where a side cannot be told, because a text states none or several, it counts like chance.
        let chance = 1.0 / N_SIDES as f32;
        for group in groups.into_values() {
            weigh(probabilities, &group, |i| {
                weight(texts[i].as_ref()).unwrap_or(chance)
            });
        }
    }

    /// Log-probability of each text by each member: `[members][texts]`.
    fn log_probs(
        &self,
        window: &EncodedWindow,
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
        members.zip(&window.members).map(of_member).collect()
    }
}

/// Sentences, each with the number of its draws.
type Votes = Vec<(String, usize)>;

/// A drawn sentence.
struct Drawn {
    text: String,
    /// Number of its draws.
    n: usize,
    /// Probability among the drawn sentences with the same actions, averaged over the members.
    probability: f32,
    /// Log-probability, averaged over the members.
    log_prob: f32,
}

/// The sentences with the content that has the largest sum of weights, and its share of all weights.
fn heaviest<K: Ord>(
    drawn: Vec<Drawn>,
    content: impl Fn(&str) -> K,
    weight: impl Fn(&Drawn) -> f32,
) -> (Vec<Drawn>, f32) {
    let total: f32 = drawn.iter().map(&weight).sum();
    let mut groups: BTreeMap<K, Vec<Drawn>> = BTreeMap::new();
    for one in drawn {
        groups.entry(content(&one.text)).or_default().push(one);
    }
    let sum = |group: &Vec<Drawn>| group.iter().map(&weight).sum::<f32>();
    let groups = groups.into_values().map(|group| (sum(&group), group));
    let heaviest = groups.max_by(|a, b| a.0.total_cmp(&b.0));
    let (sum, group) = heaviest.unwrap_or_default();
    (group, sum / total.max(f32::MIN_POSITIVE))
}

impl WindowEvidence {
    /// How much a content counts; one that the networks do not know counts like chance.
    fn weight(&self, content: Option<usize>) -> f32 {
        let chance = 1.0 / self.contents.len().max(1) as f32;
        let p = content.map_or(chance, |i| self.contents[i]);
        p.max(MIN_PROBABILITY).powf(TRUST)
    }
}

/// Multiplies some of the probabilities by weights. Their sum stays the same.
fn weigh(probabilities: &mut [f32], some: &[usize], mut weight: impl FnMut(usize) -> f32) {
    let sum = |of: &[f32]| some.iter().map(|i| of[*i]).sum::<f32>();
    let before = sum(probabilities);
    for i in some {
        probabilities[*i] *= weight(*i);
    }
    let after = sum(probabilities);
    if after > 0.0 {
        some.iter()
            .for_each(|i| probabilities[*i] *= before / after);
    }
}

/// What each clause states: [`content`].
fn actions_stated(text: &str) -> Vec<(Vec<&'static str>, Option<String>)> {
    let clauses = radarllm_facts::parse(text);
    let stated = clauses.iter().map(content);
    stated
        .map(|(names, words)| (names, words.map(String::from)))
        .collect()
}

/// Sides of the actions, in order.
fn sides_stated(text: &str) -> Vec<Option<Side>> {
    stated(text, |action| action.side)
}

/// Directions of the actions, in order.
fn directions_stated(text: &str) -> Vec<Option<Direction>> {
    stated(text, |action| action.direction)
}

fn stated<K>(text: &str, of: impl Fn(&Action) -> K) -> Vec<K> {
    let clauses = radarllm_facts::parse(text);
    clauses.iter().flat_map(|c| &c.actions).map(of).collect()
}

fn prompt(vocab: &Vocab, radar: &Encoded) -> Result<Source, LmError> {
    vocab.prompt(EVALUATION_PROMPT, Some(radar), None)
}

/// The sentence with the highest confidence, empty if there is none.
fn most_confident(sentences: Vec<Sentence>) -> Sentence {
    let best = sentences
        .into_iter()
        .max_by(|a, b| a.confidence.total_cmp(&b.confidence));
    best.unwrap_or(Sentence {
        text: String::new(),
        confidence: 0.0,
        side_confidence: None,
    })
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
    let max = log_probs.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    if max == f32::NEG_INFINITY {
        return vec![1.0 / log_probs.len() as f32; log_probs.len()];
    }
    let weights: Vec<f32> = log_probs.iter().map(|x| (x - max).exp()).collect();
    let sum: f32 = weights.iter().sum();
    weights.iter().map(|w| w / sum).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::super::{Generated, templates};
    use super::*;
    use crate::evidence::tests as evidence;
    use crate::tokenizer::EncodeError;

    const WALKS: &str = "a person walks";
    const JUMPS: &str = "a person jumps up and down";

    /// A model with one sentence, fixed probabilities of texts, and fixed draws.
    struct Fixed {
        vocab: Vocab,
        says: &'static str,
        log_probs: HashMap<&'static str, f32>,
        draws: Vec<&'static str>,
    }

    impl Fixed {
        fn boxed(says: &'static str, log_probs: [(&'static str, f32); 2]) -> Box<dyn Backend> {
            let texts = [WALKS, JUMPS];
            let vocab = Vocab::learn(texts.into_iter(), templates::all_text(), 500, 4, 8);
            Box::new(Self {
                vocab: vocab.unwrap(),
                says,
                log_probs: log_probs.into(),
                draws: Vec::new(),
            })
        }

        /// A model that draws sentences; the first are the more probable ones.
        fn drawing(draws: &[&'static str]) -> Box<dyn Backend> {
            let vocab = Vocab::learn(draws.iter().copied(), templates::all_text(), 500, 4, 8);
            let log_probs = draws.iter().rev().enumerate();
            Box::new(Self {
                vocab: vocab.unwrap(),
                says: draws[0],
                log_probs: log_probs
                    .map(|(i, text)| (*text, i as f32 - 20.0))
                    .collect(),
                draws: draws.to_vec(),
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

        fn draw(
            &self,
            prompts: &[Source],
            n: usize,
            _options: &GenerateOptions,
            _cancel: &AtomicBool,
        ) -> Result<Vec<Vec<Generated>>, LmError> {
            let texts = self.draws.iter().cycle().take(n);
            let draws = texts.map(|text| {
                let ids = self.vocab.text_ids(text)?;
                Ok(Generated::new(ids, self.log_probs[text], 1))
            });
            let draws = draws.collect::<Result<Vec<_>, LmError>>()?;
            Ok(vec![draws; prompts.len()])
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
    fn the_actions_of_most_draws_are_stated_however_they_are_worded() {
        // Each wording of raising is less probable than the wave.
        let texts = [
            "a person waves with the left hand",
            "a person raises the left arm",
            "a person lifts the left arm",
            "a person waves with the left hand",
            "a person raises the left hand",
            "a person raises the right arm",
        ];
        let vote = |members: &[&[&'static str]], n: usize| {
            let mut members = members
                .iter()
                .map(|draws| Ensemble::new(Fixed::drawing(draws)));
            let mut all = members.next().unwrap();
            members.for_each(|other| all.join(other));
            let frames = [PointFrame::default()];
            let encoded = all.encode(&[(&frames, 1.0), (&frames, 1.0)]).unwrap();
            let sentences = all.voted(&encoded, n, &GenerateOptions::default(), &false.into());
            let sentences = sentences.unwrap();
            assert_eq!(sentences[0], sentences[1]);
            sentences[0].clone()
        };
        for members in [&[&texts[..]][..], &[&texts, &texts]] {
            let sentence = vote(members, 6);
            // The most probable wording with the side of most of them.
            assert_eq!(sentence.text, "a person raises the left arm");
            assert!((sentence.confidence - 4.0 / 6.0).abs() < 1e-6);
        }
        // Words without a known action are their own content.
        let unknown = ["a person ponders", "a person walks", "a person ponders"];
        assert_eq!(vote(&[&unknown], 3).text, "a person ponders");
        assert_eq!(vote(&[&unknown], 1).confidence, 1.0);
    }

    #[test]
    fn a_side_that_is_said_with_many_directions_is_stated() {
        const BOTH: &str = "a person punches with both fists";
        const LEFT: [&str; 3] = [
            "a person punches forward with the left fist",
            "a person punches upward with the left fist",
            "a person punches with the left fist",
        ];
        let draws = [BOTH, BOTH, BOTH, LEFT[0], LEFT[1], LEFT[2], LEFT[0]];
        let vocab = Vocab::learn(draws.into_iter(), templates::all_text(), 500, 4, 8);
        let log_probs = [
            (BOTH, -4.0),
            (LEFT[0], -4.1),
            (LEFT[1], -4.5),
            (LEFT[2], -5.0),
        ];
        let model = Ensemble::new(Box::new(Fixed {
            vocab: vocab.unwrap(),
            says: BOTH,
            log_probs: log_probs.into(),
            draws: draws.to_vec(),
        }));
        let frames = [PointFrame::default()];
        let encoded = model.encode(&[(&frames, 1.0)]).unwrap();
        let options = GenerateOptions::default();
        let sentences = model.voted(&encoded, draws.len(), &options, &false.into());
        let sentence = sentences.unwrap().remove(0);
        assert_eq!(sentence.text, LEFT[0]);
        assert_eq!(sentence.confidence, 1.0, "all draws punch");
        let sum = |texts: &[(&str, f32)]| texts.iter().map(|(_, p)| p.exp()).sum::<f32>();
        let expected = sum(&log_probs[1..]) / sum(&log_probs);
        assert!((sentence.side_confidence.unwrap() - expected).abs() < 1e-6);
    }

    /// An ensemble of one model that draws sentences, the first of them the most probable ones, with networks that say
    /// "punch", with the left hand, of the points of `punches`.
    fn weighed(draws: &[&'static str]) -> (Ensemble, EncodedWindow) {
        let mut file = evidence::file(&["punch", "walk"], &[("punch", false)]);
        file.contents[0].sentences = vec!["a person punches with the left fist".into()];
        let model = Ensemble::new(Fixed::drawing(draws)).with_evidence(evidence::networks(file));
        let frames = evidence::punches(0.3, 1.0);
        let window = model.encode(&[(&frames, 1.0)]).unwrap().remove(0);
        (model, window)
    }

    fn drawn(model: &Ensemble, window: &EncodedWindow, n: usize) -> Sentence {
        let options = GenerateOptions::default();
        let windows = std::slice::from_ref(window);
        let sentences = model.voted(windows, n, &options, &false.into());
        sentences.unwrap().remove(0)
    }

    #[test]
    fn fewer_draws_with_what_the_points_say_are_stated() {
        const PUNCHES: &str = "a person punches with the left fist";
        let (model, window) = weighed(&[WALKS, WALKS, PUNCHES]);
        let said = window.evidence.as_ref().unwrap().contents.clone();
        let sentence = drawn(&model, &window, 3);
        assert_eq!(sentence.text, PUNCHES);
        let (walks, punches) = (2.0 * said[1].sqrt(), said[0].sqrt());
        let expected = punches / (walks + punches);
        assert!((sentence.confidence - expected).abs() < 1e-5, "{said:?}");
        // Without what the points say, most draws decide.
        let without = EncodedWindow {
            evidence: None,
            ..window.clone()
        };
        let sentence = drawn(&model, &without, 3);
        assert_eq!(sentence.text, WALKS);
        assert!((sentence.confidence - 2.0 / 3.0).abs() < 1e-6);
        // Readings of a window are weighed, too.
        let texts = [WALKS, PUNCHES];
        let of = |window| model.probabilities(window, &texts).unwrap();
        let (with, without) = (of(&window), of(&without));
        assert!(with[1] > without[1]);
        assert!((with.iter().sum::<f32>() - 1.0).abs() < 1e-5);
    }

    #[test]
    fn what_nobody_drew_counts_as_one_draw() {
        let (model, window) = weighed(&[WALKS, "a person punches with the left fist"]);
        // All draws walk; the points would have to be a thousand times as sure of punches.
        let sentence = drawn(&model, &window, 1);
        assert_eq!(sentence.text, WALKS);
        let said = window.evidence.as_ref().unwrap().contents.clone();
        let (walks, punches) = (said[1].sqrt(), UNDRAWN * said[0].sqrt());
        assert!((sentence.confidence - walks / (walks + punches)).abs() < 1e-5);
        let mut sure = window;
        sure.evidence.as_mut().unwrap().contents = vec![1.0, 0.0];
        let sentence = drawn(&model, &sure, 1);
        assert_eq!(sentence.text, "a person punches with the left fist");
    }

    #[test]
    fn the_side_that_the_points_say_is_stated() {
        const LEFT: &str = "a person punches with the left fist";
        const RIGHT: &str = "a person punches with the right fist";
        let (model, window) = weighed(&[RIGHT, LEFT]);
        let sentence = drawn(&model, &window, 2);
        assert_eq!(sentence.text, LEFT);
        assert!(sentence.side_confidence.unwrap() > 0.5);
        let without = EncodedWindow {
            evidence: None,
            ..window
        };
        assert_eq!(drawn(&model, &without, 2).text, RIGHT);
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
