//! The sentences of overlapping windows, combined to segments.
//!
//! A recording that is longer than one window is described in the windows of [`WINDOWS`]: short ones show changes, long
//! ones more of what goes on. Each window has readings: its own sentence and those of the windows near it, with the
//! probabilities that the model gives them for this window. Each hop of [`HOP_FRAMES`] is covered by up to six windows. A
//! window votes for the clauses of its readings that cover the hop, with their probabilities as weights. The segments are the most probable sequence of clauses, in which
//! every change has a price, so that a change must be seen in several windows (Viterbi algorithm).

use std::{
    collections::{BTreeMap, HashMap},
    sync::Arc,
};

use radarllm_facts::{Clause, parse};

use super::captioner::Segment;
use crate::tokenizer::MAX_FRAMES;

/// Length and distance of windows, frames: 6 s every 2 s, and 9.6 s every 4 s.
pub const WINDOWS: [(usize, usize); 2] = [(60, HOP_FRAMES), (MAX_FRAMES, 2 * HOP_FRAMES)];
/// Resolution of the segments, frames: 2 s.
pub(super) const HOP_FRAMES: usize = 20;

/// Actions that may take less than two hops.
const SHORT: [&str; 9] = [
    "fall", "sit_down", "stand_up", "lie_down", "pick_up", "bow", "jump", "turn", "throw",
];

/// Price of a change between hops, in units of log-probability.
const CHANGE: f32 = 1.0;
/// The same for a change to or from one of the [`SHORT`] actions.
const SHORT_CHANGE: f32 = 0.3;
/// Share of the votes that every clause has in every hop, so that one hop excludes nothing.
const FLOOR: f32 = 0.02;

/// The readings of a window.
#[derive(Clone, Debug)]
pub(crate) struct WindowReadings {
    /// First frame.
    pub start: usize,
    /// Frame after the last one.
    pub end: usize,
    /// Sentences that may describe it.
    pub readings: Vec<Reading>,
}

/// A sentence that may describe a window.
#[derive(Clone, Debug)]
pub(crate) struct Reading {
    /// Its clauses; a sentence without any states nothing.
    pub clauses: Arc<[Stated]>,
    /// Probability among the readings of the window.
    pub probability: f32,
}

/// A clause with the number of its content: clauses with the same actions have one number.
#[derive(Clone, Debug)]
pub(crate) struct Stated {
    pub clause: Clause,
    content: usize,
}

/// The sentences of a recording, each parsed once.
#[derive(Debug, Default)]
pub(super) struct Sentences {
    parsed: HashMap<String, Arc<[Stated]>>,
    contents: HashMap<(Vec<&'static str>, Option<String>), usize>,
}

impl Sentences {
    /// The clauses of a sentence that state something.
    pub(super) fn clauses(&mut self, text: &str) -> Arc<[Stated]> {
        if let Some(clauses) = self.parsed.get(text) {
            return Arc::clone(clauses);
        }
        let clauses = parse(text).into_iter().filter(|c| !c.text.is_empty());
        let clauses: Arc<[Stated]> = clauses
            .map(|clause| {
                let (names, words) = content(&clause);
                let key = (names, words.map(String::from));
                let next = self.contents.len();
                let content = *self.contents.entry(key).or_insert(next);
                Stated { clause, content }
            })
            .collect();
        self.parsed.insert(text.into(), Arc::clone(&clauses));
        clauses
    }

    /// A sentence with its probability.
    pub(super) fn reading(&mut self, text: &str, probability: f32) -> Reading {
        Reading {
            clauses: self.clauses(text),
            probability,
        }
    }
}

/// First and last frame (exclusive) of every window of a recording, in order. The last window of each length ends with
/// the recording.
pub(crate) fn windows(n_frames: usize) -> Vec<(usize, usize)> {
    let mut all: Vec<(usize, usize)> = Vec::new();
    for (length, distance) in WINDOWS {
        let last = n_frames.saturating_sub(length);
        let starts = (0..last).step_by(distance).chain([last]);
        all.extend(starts.map(|start| (start, (start + length).min(n_frames))));
    }
    all.sort_unstable();
    all
}

/// The votes for a hop.
struct Hop<'a> {
    /// Clauses with their weights, of every reading of every window that covers the hop.
    votes: Vec<(&'a Stated, f32)>,
    n_windows: usize,
}

impl Hop<'_> {
    /// Sum of the weights for a content.
    fn support(&self, content: usize) -> f32 {
        let agreeing = self
            .votes
            .iter()
            .filter(|(other, _)| other.content == content);
        agreeing.map(|(_, weight)| weight).sum()
    }

    /// Sum of the weights for every content that has votes.
    fn supports(&self) -> BTreeMap<usize, f32> {
        let mut supports = BTreeMap::new();
        for (stated, weight) in &self.votes {
            *supports.entry(stated.content).or_default() += weight;
        }
        supports
    }
}

/// Combines the readings of windows to segments. `time_s` gives the time at which a frame begins; frame `n_frames` is
/// the end of the recording. Hops that no window describes have no segment.
pub(crate) fn segments(
    windows: &[WindowReadings],
    n_frames: usize,
    time_s: impl Fn(usize) -> f64,
) -> Vec<Segment> {
    let n_hops = n_frames.div_ceil(HOP_FRAMES);
    let hops: Vec<Hop> = (0..n_hops).map(|h| votes(h, n_frames, windows)).collect();
    let mut segments = Vec::new();
    let mut first = 0;
    for described in hops.chunk_by(|a, b| a.votes.is_empty() == b.votes.is_empty()) {
        if !described[0].votes.is_empty() {
            let mut start = 0;
            let sequence = most_probable(described);
            for run in sequence.chunk_by(|a, b| a.content == b.content) {
                let hops = &described[start..start + run.len()];
                let (from, to) = (first + start, first + start + run.len());
                let span_s = [from, to].map(|hop| time_s((hop * HOP_FRAMES).min(n_frames)));
                segments.push(segment(run[0], hops, span_s));
                start += run.len();
            }
        }
        first += described.len();
    }
    segments
}

/// The votes of the windows that cover the middle of a hop.
fn votes(hop: usize, n_frames: usize, windows: &[WindowReadings]) -> Hop<'_> {
    let start = hop * HOP_FRAMES;
    let middle = (start + (start + HOP_FRAMES).min(n_frames)) / 2;
    let mut hop = Hop {
        votes: Vec::new(),
        n_windows: 0,
    };
    // The windows are in order of their starts, and none is longer than the longest.
    let longest = WINDOWS.map(|(length, _)| length).into_iter().max();
    let first = (middle + 1).saturating_sub(longest.unwrap_or_default());
    let from = windows.partition_point(|w| w.start < first);
    let to = windows.partition_point(|w| w.start <= middle);
    for window in &windows[from..to] {
        if window.end <= middle {
            continue;
        }
        let stating = window.readings.iter().filter(|r| !r.clauses.is_empty());
        let before = hop.votes.len();
        hop.votes.extend(stating.map(|reading| {
            let clauses = &reading.clauses;
            let position = (middle - window.start) * clauses.len() / (window.end - window.start);
            (
                &clauses[position.min(clauses.len() - 1)],
                reading.probability,
            )
        }));
        hop.n_windows += usize::from(hop.votes.len() > before);
    }
    hop
}

/// Where the most probable sequence up to a hop comes from.
#[derive(Clone, Copy)]
enum Origin {
    /// The same content.
    Same,
    /// The best content with an action of [`SHORT`].
    Short,
    /// The best other content.
    Long,
}

/// The sequence of clauses with the largest sum of log-shares, less the price of changes. All hops have votes.
fn most_probable<'a>(hops: &[Hop<'a>]) -> Vec<&'a Stated> {
    // The contents in the order in which they occur, and their places in it.
    let mut contents: Vec<&Stated> = Vec::new();
    let mut places: HashMap<usize, usize> = HashMap::new();
    for (stated, _) in hops.iter().flat_map(|h| &h.votes) {
        places.entry(stated.content).or_insert_with(|| {
            contents.push(stated);
            contents.len() - 1
        });
    }
    let is_short: Vec<bool> = contents.iter().map(|c| is_short(&c.clause)).collect();
    let all = 0..contents.len();
    let log_shares = |hop: &Hop| -> Vec<f32> {
        let total: f32 = hop.votes.iter().map(|(_, weight)| weight).sum();
        let log_share = |support: f32| (support / total.max(f32::MIN_POSITIVE) + FLOOR).ln();
        let mut shares = vec![log_share(0.0); contents.len()];
        for (content, support) in hop.supports() {
            shares[places[&content]] = log_share(support);
        }
        shares
    };
    let mut score = log_shares(&hops[0]);
    // For each hop after the first: the best short and the best other content of the hop before, and where each of its
    // contents comes from.
    let mut before: Vec<([Option<usize>; 2], Vec<Origin>)> = Vec::new();
    for hop in &hops[1..] {
        // Every change to a content has the same price from all contents of one kind, so that only the best of each kind counts.
        let best = |short: bool| {
            let of_kind = all.clone().filter(|i| is_short[*i] == short);
            of_kind.max_by(|a, b| score[*a].total_cmp(&score[*b]))
        };
        let (short, long) = (best(true), best(false));
        let came: Vec<(Origin, f32)> = (all.clone())
            .map(|to| {
                let change = if is_short[to] { SHORT_CHANGE } else { CHANGE };
                let same = (to, Origin::Same, score[to]);
                let short = short.map(|i| (i, Origin::Short, score[i] - SHORT_CHANGE));
                let long = long.map(|i| (i, Origin::Long, score[i] - change));
                let possible = [Some(same), short, long].into_iter().flatten();
                let best = possible.max_by(|a, b| a.2.total_cmp(&b.2).then(a.0.cmp(&b.0)));
                best.map_or((Origin::Same, score[to]), |(_, from, value)| (from, value))
            })
            .collect();
        let shares = log_shares(hop).into_iter();
        score = came
            .iter()
            .zip(shares)
            .map(|((_, v), share)| v + share)
            .collect();
        before.push((
            [short, long],
            came.into_iter().map(|(from, _)| from).collect(),
        ));
    }
    let best = all.max_by(|a, b| score[*a].total_cmp(&score[*b]));
    let mut at = best.unwrap_or_default();
    let mut sequence = vec![contents[at]];
    for ([short, long], from) in before.iter().rev() {
        at = match from[at] {
            Origin::Same => at,
            Origin::Short => short.unwrap_or(at),
            Origin::Long => long.unwrap_or(at),
        };
        sequence.push(contents[at]);
    }
    sequence.reverse();
    sequence
}

/// The segment of hops with one content: of the clauses with this content, that with the most votes.
fn segment(stated: &Stated, hops: &[Hop], [start_s, end_s]: [f64; 2]) -> Segment {
    let own = || {
        let votes = hops.iter().flat_map(|h| &h.votes);
        votes.filter(|(other, _)| other.content == stated.content)
    };
    let mut weights: BTreeMap<&str, f32> = BTreeMap::new();
    for (other, weight) in own() {
        *weights.entry(&other.clause.text).or_default() += weight;
    }
    let weight = |stated: &Stated| weights.get(stated.clause.text.as_str()).copied();
    let best = own().max_by(|a, b| {
        let (a, b) = (weight(a.0), weight(b.0));
        a.unwrap_or_default().total_cmp(&b.unwrap_or_default())
    });
    let clause = &best.map_or(stated, |(stated, _)| stated).clause;
    let confidence = |hop: &Hop| hop.support(stated.content) / hop.n_windows.max(1) as f32;
    Segment {
        start_s,
        end_s,
        caption: match hops.len() * HOP_FRAMES > MAX_FRAMES {
            // What a window counted is not the count of a longer time.
            true => clause.without_count().sentence(),
            false => clause.sentence(),
        },
        actions: clause.actions.iter().map(|a| a.name).collect(),
        confidence: hops.iter().map(confidence).sum::<f32>() / hops.len() as f32,
        side_confidence: None,
        taught: None,
        guess: None,
    }
}

fn is_short(clause: &Clause) -> bool {
    clause.actions.iter().any(|a| SHORT.contains(&a.name))
}

/// The names of a clause's actions in alphabetical order, and the words of a clause without a known action.
pub(super) fn content(clause: &Clause) -> (Vec<&'static str>, Option<&str>) {
    let mut names: Vec<&str> = clause.actions.iter().map(|a| a.name).collect();
    names.sort_unstable();
    let words = names.is_empty().then_some(clause.text.as_str());
    (names, words)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn windows_of(sentences: &[&str]) -> Vec<WindowReadings> {
        let mut known = Sentences::default();
        let sentence = |(i, text): (usize, &&str)| WindowReadings {
            start: i * HOP_FRAMES,
            end: i * HOP_FRAMES + WINDOWS[0].0,
            readings: vec![known.reading(text, 1.0)],
        };
        sentences.iter().enumerate().map(sentence).collect()
    }

    fn segments_of(sentences: &[&str]) -> Vec<(f64, f64, String)> {
        let windows = windows_of(sentences);
        let n_frames = windows.last().unwrap().end;
        segments(&windows, n_frames, |frame| frame as f64 / 10.0)
            .into_iter()
            .map(|s| (s.start_s, s.end_s, s.caption))
            .collect()
    }

    #[test]
    fn windows_cover_every_frame() {
        for n in [97, 100, 119, 120, 121, 601] {
            let all = windows(n);
            assert!(all.is_sorted(), "{n}");
            for (length, distance) in WINDOWS {
                let own: Vec<_> = all.iter().filter(|(a, b)| b - a == length).collect();
                assert_eq!((own[0].0, own[own.len() - 1].1), (0, n), "{n}");
                assert!(
                    own.windows(2)
                        .all(|w| w[1].0 > w[0].0 && w[1].0 - w[0].0 <= distance),
                    "{n}"
                );
            }
        }
    }

    #[test]
    fn agreement_is_one_segment() {
        let walk = "a person walks forward";
        assert_eq!(segments_of(&[walk; 5]), [(0.0, 14.0, walk.to_string())]);
    }

    #[test]
    fn counts_of_windows_are_not_those_of_the_recording() {
        let claps = "a person claps three times";
        assert_eq!(segments_of(&[claps]), [(0.0, 6.0, claps.to_string())]);
        assert_eq!(
            segments_of(&[claps; 5]),
            [(0.0, 14.0, "a person claps".to_string())]
        );
    }

    #[test]
    fn one_window_that_disagrees_is_outvoted() {
        let all = segments_of(&[
            "a person walks",
            "a person walks",
            "a person bows",
            "a person walks",
            "a person walks",
        ]);
        assert_eq!(all, [(0.0, 14.0, "a person walks".to_string())]);
    }

    #[test]
    fn clauses_vote_for_their_part_of_the_window() {
        // Someone walks for 6 s and sits down: windows across the change have two clauses.
        let all = segments_of(&[
            "a person walks",
            "a person walks, then sits down",
            "a person walks, then sits down",
            "a person sits down",
        ]);
        let texts: Vec<&str> = all.iter().map(|s| s.2.as_str()).collect();
        assert_eq!(texts, ["a person walks", "a person sits down"]);
        assert_eq!((all[0].0, all[1].1), (0.0, 12.0));
        assert_eq!(all[0].1, all[1].0);
    }

    #[test]
    fn a_fall_between_is_kept() {
        let all = segments_of(&[
            "a person walks",
            "a person walks, then walks, then falls forward",
            "a person walks, then falls forward, then walks",
            "a person falls forward, then walks, then walks",
            "a person walks",
        ]);
        let texts: Vec<&str> = all.iter().map(|s| s.2.as_str()).collect();
        assert_eq!(
            texts,
            ["a person walks", "a person falls forward", "a person walks"]
        );
    }

    #[test]
    fn empty_sentences_state_nothing() {
        assert_eq!(segments_of(&["", ""]), []);
        let all = segments_of(&["", "a person walks", ""]);
        assert_eq!(all, [(2.0, 8.0, "a person walks".to_string())]);
    }

    #[test]
    fn disagreement_lowers_confidence() {
        let windows = windows_of(&["a person walks", "a person bows", "a person walks"]);
        let all = segments(&windows, 100, |frame| frame as f64 / 10.0);
        assert!(all.iter().any(|s| s.confidence < 0.8));
        let agreed = segments(&windows_of(&["a person walks"; 3]), 100, |f| {
            f as f64 / 10.0
        });
        assert!(agreed.iter().all(|s| (s.confidence - 1.0).abs() < 1e-6));
    }
}
