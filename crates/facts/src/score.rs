//! Facts of one sentence beside those of another: precision and recall by kind of fact, and contradictions.
//!
//! Actions are aligned in order of time, so that as many names as possible agree, and among those alignments as many
//! attributes. Attributes count on aligned actions only.
//!
//! ```
//! use radarllm_facts::{Kind, facts, score::compare};
//!
//! let said = facts("a person walks forward, then waves with the left hand");
//! let true_facts = facts("a person walks forward and waves three times with the right hand");
//! let scores = compare(&said, &true_facts);
//! assert_eq!(scores.of(Kind::Action).precision(), Some(1.0));
//! assert_eq!(scores.of(Kind::Count).recall(), Some(0.0));
//! assert_eq!(scores.contradictions, [(Kind::Side, 1)].into());
//! ```

use std::collections::BTreeMap;

use serde::{Serialize, Serializer, ser::SerializeStruct};

use crate::action::{Action, Count, Direction, Extent, Facts, Kind, Side, Tempo};

/// How many facts of a kind two sides state, and how many they share. Serialized with precision, recall and F1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Facts that both state.
    pub common: usize,
    /// Facts of the candidates.
    pub candidate: usize,
    /// Facts of the references.
    pub reference: usize,
}

impl Tally {
    /// Share of the candidates' facts that the references state; `None` without any.
    pub fn precision(&self) -> Option<f64> {
        share(self.common, self.candidate)
    }

    /// Share of the references' facts that the candidates state; `None` without any.
    pub fn recall(&self) -> Option<f64> {
        share(self.common, self.reference)
    }

    /// Harmonic mean of precision and recall; `None` if neither side states anything.
    pub fn f1(&self) -> Option<f64> {
        share(2 * self.common, self.candidate + self.reference)
    }

    fn add(&mut self, other: Self) {
        self.common += other.common;
        self.candidate += other.candidate;
        self.reference += other.reference;
    }
}

impl Serialize for Tally {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut row = serializer.serialize_struct("Tally", 6)?;
        row.serialize_field("common", &self.common)?;
        row.serialize_field("candidate", &self.candidate)?;
        row.serialize_field("reference", &self.reference)?;
        row.serialize_field("precision", &self.precision())?;
        row.serialize_field("recall", &self.recall())?;
        row.serialize_field("f1", &self.f1())?;
        row.end()
    }
}

fn share(part: usize, all: usize) -> Option<f64> {
    (all > 0).then(|| part as f64 / all as f64)
}

/// Facts of candidates beside those of references.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FactScores {
    tallies: BTreeMap<Kind, Tally>,
    /// Number of facts by kind that exclude what the reference states: left for right, forward for backward, once for
    /// several times.
    pub contradictions: BTreeMap<Kind, usize>,
}

impl FactScores {
    /// The counts of a kind.
    pub fn of(&self, kind: Kind) -> Tally {
        self.tallies.get(&kind).copied().unwrap_or_default()
    }

    /// The counts of all kinds but the subject together.
    pub fn all(&self) -> Tally {
        let mut all = Tally::default();
        for (kind, tally) in &self.tallies {
            if *kind != Kind::Subject {
                all.add(*tally);
            }
        }
        all
    }

    /// Adds the counts of another pair.
    pub fn add(&mut self, other: &Self) {
        for (kind, tally) in &other.tallies {
            self.tallies.entry(*kind).or_default().add(*tally);
        }
        for (kind, n) in &other.contradictions {
            *self.contradictions.entry(*kind).or_default() += n;
        }
    }

    fn count(&mut self, kind: Kind, common: bool, candidate: bool, reference: bool) {
        self.tallies.entry(kind).or_default().add(Tally {
            common: common.into(),
            candidate: candidate.into(),
            reference: reference.into(),
        });
    }
}

/// Compares what two sentences state.
pub fn compare(candidate: &Facts, reference: &Facts) -> FactScores {
    let mut scores = FactScores::default();
    if candidate.subject.is_some() || reference.subject.is_some() {
        scores.count(
            Kind::Subject,
            candidate.subject == reference.subject,
            candidate.subject.is_some(),
            reference.subject.is_some(),
        );
    }
    let left: Vec<&Action> = candidate.actions().collect();
    let right: Vec<&Action> = reference.actions().collect();
    for (a, b) in align(&left, &right) {
        let both = a.is_some() && b.is_some();
        scores.count(Kind::Action, both, a.is_some(), b.is_some());
        let of = |action: Option<&Action>| action.map(Action::attributes).unwrap_or_default();
        let (own, other) = (of(a), of(b));
        for (kind, word) in &own {
            let common = both && other.contains(&(*kind, word.clone()));
            scores.count(*kind, common, true, false);
        }
        other
            .iter()
            .for_each(|(kind, _)| scores.count(*kind, false, false, true));
        if let (Some(a), Some(b)) = (a, b) {
            for kind in contradictions(a, b) {
                *scores.contradictions.entry(kind).or_default() += 1;
            }
        }
    }
    scores
}

/// Compares a candidate with the reference that agrees with it most; `None` without references.
pub fn compare_with_nearest(candidate: &Facts, references: &[Facts]) -> Option<FactScores> {
    let scores = references
        .iter()
        .map(|reference| compare(candidate, reference));
    scores.reduce(|best, next| {
        let rank = |s: &FactScores| (s.all().f1().unwrap_or(0.0), s.all().common);
        if rank(&next) > rank(&best) {
            next
        } else {
            best
        }
    })
}

/// Scores of pairs of a candidate and its references.
pub fn score<'a>(pairs: impl IntoIterator<Item = (&'a str, &'a [String])>) -> FactScores {
    let mut all = FactScores::default();
    for (candidate, references) in pairs {
        let references: Vec<Facts> = references.iter().map(|r| crate::facts(r)).collect();
        if let Some(scores) = compare_with_nearest(&crate::facts(candidate), &references) {
            all.add(&scores);
        }
    }
    all
}

/// Whether two names state the same action: "sits" may be what somebody does or is doing.
pub fn is_same_action(a: &str, b: &str) -> bool {
    let plain = |name| match name {
        "sit_still" => "sit_down",
        "lie_still" => "lie_down",
        other => other,
    };
    plain(a) == plain(b)
}

/// Pairs of actions in order; an action without a partner stands alone.
fn align<'a>(
    left: &[&'a Action],
    right: &[&'a Action],
) -> Vec<(Option<&'a Action>, Option<&'a Action>)> {
    let width = right.len() + 1;
    let gain = |a: &Action, b: &Action| -> usize {
        if !is_same_action(a.name, b.name) {
            return 0;
        }
        let other = b.attributes();
        let common = a.attributes().iter().filter(|x| other.contains(x)).count();
        // A name outweighs all attributes.
        20 + common
    };
    let mut best = vec![0; (left.len() + 1) * width];
    for i in (0..left.len()).rev() {
        for j in (0..right.len()).rev() {
            let skip = best[(i + 1) * width + j].max(best[i * width + j + 1]);
            let pair = gain(left[i], right[j]);
            best[i * width + j] = match pair {
                0 => skip,
                _ => skip.max(pair + best[(i + 1) * width + j + 1]),
            };
        }
    }
    let mut pairs = Vec::with_capacity(left.len().max(right.len()));
    let (mut i, mut j) = (0, 0);
    while i < left.len() && j < right.len() {
        let here = best[i * width + j];
        let pair = gain(left[i], right[j]);
        if pair > 0 && here == pair + best[(i + 1) * width + j + 1] {
            pairs.push((Some(left[i]), Some(right[j])));
            (i, j) = (i + 1, j + 1);
        } else if here == best[(i + 1) * width + j] {
            pairs.push((Some(left[i]), None));
            i += 1;
        } else {
            pairs.push((None, Some(right[j])));
            j += 1;
        }
    }
    pairs.extend(left[i..].iter().map(|a| (Some(*a), None)));
    pairs.extend(right[j..].iter().map(|b| (None, Some(*b))));
    pairs
}

/// Kinds of facts of which two actions state values that exclude each other.
pub fn contradictions(a: &Action, b: &Action) -> Vec<Kind> {
    let is_more = |count: Count| count != Count::Exactly(1) && count != Count::Exactly(0);
    let side = matches!((a.side, b.side), (Some(x), Some(y)) if x != y
        && (x != Side::Both || y != Side::Both));
    let direction = matches!(
        (a.direction, b.direction),
        (Some(Direction::Forward), Some(Direction::Backward))
            | (Some(Direction::Backward), Some(Direction::Forward))
            | (Some(Direction::Left), Some(Direction::Right))
            | (Some(Direction::Right), Some(Direction::Left))
            | (Some(Direction::Up), Some(Direction::Down))
            | (Some(Direction::Down), Some(Direction::Up))
    );
    let count = match (a.count, b.count) {
        (Some(Count::Exactly(x)), Some(Count::Exactly(y))) => x != y,
        (Some(x), Some(y)) => is_more(x) != is_more(y),
        _ => false,
    };
    let tempo = matches!(
        (a.tempo, b.tempo),
        (Some(Tempo::Slow), Some(Tempo::Fast)) | (Some(Tempo::Fast), Some(Tempo::Slow))
    );
    let extent = match (a.extent, b.extent) {
        (Some(Extent::Degrees(x)), Some(Extent::Degrees(y))) => x != y,
        (Some(Extent::Small), Some(Extent::Large)) | (Some(Extent::Large), Some(Extent::Small)) => {
            true
        }
        _ => false,
    };
    [
        (side, Kind::Side),
        (direction, Kind::Direction),
        (count, Kind::Count),
        (tempo, Kind::Tempo),
        (extent, Kind::Extent),
    ]
    .into_iter()
    .filter_map(|(yes, kind)| yes.then_some(kind))
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facts(line: &str) -> Facts {
        line.parse().unwrap()
    }

    #[test]
    fn actions_are_aligned_in_order_and_attributes_with_them() {
        let scores = compare(
            &facts("person: walk forward; turn to_left; walk slow"),
            &facts("man: walk forward slow; walk slow; wave x3"),
        );
        let tally = |kind| {
            let t = scores.of(kind);
            (t.common, t.candidate, t.reference)
        };
        assert_eq!(tally(Kind::Subject), (0, 1, 1));
        assert_eq!(tally(Kind::Action), (2, 3, 3));
        assert_eq!(tally(Kind::Direction), (1, 2, 1));
        assert_eq!(tally(Kind::Tempo), (1, 1, 2));
        assert_eq!(tally(Kind::Count), (0, 0, 1));
        assert_eq!(tally(Kind::Side), (0, 0, 0));
        assert!(scores.contradictions.is_empty());
    }

    #[test]
    fn opposites_are_contradictions_and_other_differences_are_not() {
        for (a, b, kinds) in [
            ("kick left", "kick right", vec![Kind::Side]),
            ("wave left", "wave both", vec![Kind::Side]),
            ("walk forward", "walk backward", vec![Kind::Direction]),
            ("walk forward", "walk to_left", vec![]),
            ("jump x1", "jump xmany", vec![Kind::Count]),
            ("jump x3", "jump xmany", vec![]),
            ("jump x3", "jump x4", vec![Kind::Count]),
            ("walk slow", "walk fast", vec![Kind::Tempo]),
            ("walk slow", "walk moderate", vec![]),
            ("turn 90deg", "turn 180deg", vec![Kind::Extent]),
            ("turn 90deg", "turn small", vec![]),
            ("walk slow", "walk", vec![]),
        ] {
            let (a, b) = (format!("-: {a}"), format!("-: {b}"));
            let scores = compare(&facts(&a), &facts(&b));
            let found: Vec<Kind> = scores.contradictions.keys().copied().collect();
            assert_eq!(found, kinds, "{a} {b}");
        }
    }

    #[test]
    fn the_nearest_reference_counts() {
        let references = [
            "somebody sits down".to_string(),
            "a man walks backward".to_string(),
        ];
        let scores = score([("a person walks backward slowly", &references[..])]);
        assert_eq!(scores.of(Kind::Action).f1(), Some(1.0));
        assert_eq!(scores.of(Kind::Direction).f1(), Some(1.0));
        assert_eq!(scores.of(Kind::Tempo).precision(), Some(0.0));
        assert_eq!(score([("a person walks", &[][..])]), FactScores::default());
    }
}
