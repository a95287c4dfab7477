//! The model's captions by what they state: facts of each kind, and the clips of which no training caption tells.

use std::collections::{BTreeMap, BTreeSet};

use radarllm_facts::{
    Action, Kind, facts,
    score::{FactScores, Tally, score},
};
use radarllm_metrics::bootstrap::units_of_ids;
use serde::Serialize;

use super::{CaptionedClip, counted, mean};
use crate::{Estimate, EvalError};

/// Facts of captions beside those of references.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct FactCounts {
    /// All kinds but the subject.
    #[serde(flatten)]
    pub all: Tally,
    /// Facts that exclude what the references state, such as left for right.
    pub contradictions: usize,
}

impl FactCounts {
    /// Facts of captions, each beside those references of it that agree with it most.
    pub fn of<'a>(pairs: impl IntoIterator<Item = (&'a str, &'a [String])>) -> Self {
        let scores = score(pairs);
        Self {
            all: scores.all(),
            contradictions: scores.contradictions.values().sum(),
        }
    }
}

/// Facts of one kind in the model's captions.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FactsOfKind {
    /// Name of the kind.
    pub kind: &'static str,
    /// Those of the captions, of the references, and of both.
    #[serde(flatten)]
    pub tally: Tally,
    /// Facts that exclude what the references state.
    pub contradictions: usize,
}

/// The model on clips that resemble training clips to some degree.
#[derive(Clone, Debug, Serialize)]
pub struct NoveltySlice {
    /// What is new about the clips.
    pub name: &'static str,
    /// Clips in it.
    pub clips: usize,
    /// Share of captions with exactly the actions of one of the references, in order, 0..=1.
    pub same_actions: Estimate,
    /// Facts of the captions.
    pub facts: FactCounts,
    /// Mean ROUGE-L of the captions, 0..=1.
    pub rouge_l: Estimate,
    /// Mean confidence of the captions, 0..=1.
    pub confidence: f64,
}

/// 1 if a caption states exactly the actions of one of the counted references, in order, and else 0. A caption without an
/// action that the parser knows states none.
pub fn same_actions(caption: &str, references: &[String]) -> f64 {
    let actions = radarllm_inference::actions;
    let stated = actions(caption);
    let mut references = counted(references).iter();
    let is_same = !stated.is_empty() && references.any(|text| actions(text) == stated);
    f64::from(u8::from(is_same))
}

fn pair(clip: &CaptionedClip) -> (&str, &[String]) {
    (&clip.description.caption, counted(&clip.references))
}

/// Facts by kind; kinds that occur on neither side are left out.
pub fn by_kind(clips: &[CaptionedClip]) -> Vec<FactsOfKind> {
    let scores: FactScores = score(clips.iter().map(pair));
    let of_kind = |kind: Kind| {
        let tally = scores.of(kind);
        FactsOfKind {
            kind: kind.name(),
            tally,
            contradictions: scores.contradictions.get(&kind).copied().unwrap_or(0),
        }
    };
    let rows = Kind::ALL.into_iter().map(of_kind);
    rows.filter(|row| row.tally.candidate + row.tally.reference > 0)
        .collect()
}

/// Slices by what no training caption states, the most familiar first. A clip is in one slice by its motion, and also in
/// the last one if none of its references is a training caption.
pub fn by_novelty(
    clips: &[CaptionedClip],
    train_captions: &[&str],
    seed: u64,
) -> Result<Vec<NoveltySlice>, EvalError> {
    let known = Known::of(train_captions);
    let mut slices: BTreeMap<&'static str, Vec<&CaptionedClip>> = BTreeMap::new();
    for clip in clips {
        slices.entry(known.novelty(clip)).or_default().push(clip);
        if !counted(&clip.references)
            .iter()
            .any(|text| known.texts.contains(text.as_str()))
        {
            slices.entry(NEW_WORDING).or_default().push(clip);
        }
    }
    let names = [
        NOTHING_NEW,
        NEW_ATTRIBUTES,
        NEW_COMBINATION,
        NEW_ACTION,
        NEW_WORDING,
    ];
    let found = names
        .into_iter()
        .filter_map(|name| slices.remove(name).map(|members| (name, members)));
    found
        .map(|(name, members)| slice(name, &members, seed))
        .collect()
}

const NOTHING_NEW: &str = "none of the following";
const NEW_ATTRIBUTES: &str = "an action with new attributes";
const NEW_COMBINATION: &str = "a new combination of actions";
const NEW_ACTION: &str = "a new action";
const NEW_WORDING: &str = "new wording, whatever else is new";

fn slice(
    name: &'static str,
    members: &[&CaptionedClip],
    seed: u64,
) -> Result<NoveltySlice, EvalError> {
    let units = units_of_ids(members.iter().map(|c| c.id.as_str()));
    let same: Vec<f64> = members
        .iter()
        .map(|c| same_actions(&c.description.caption, &c.references))
        .collect();
    let rouge_l: Vec<f64> = members.iter().map(|c| c.rouge_l).collect();
    let confidences = members.iter().map(|c| f64::from(c.description.confidence));
    Ok(NoveltySlice {
        name,
        clips: members.len(),
        same_actions: mean(&same, &units, seed)?,
        facts: FactCounts::of(members.iter().map(|c| pair(c))),
        rouge_l: mean(&rouge_l, &units, seed)?,
        confidence: confidences.sum::<f64>() / members.len() as f64,
    })
}

/// What the training captions state.
#[derive(Default)]
struct Known<'a> {
    texts: BTreeSet<&'a str>,
    actions: BTreeSet<&'static str>,
    /// Names of the actions of a caption, in order.
    combinations: BTreeSet<Vec<&'static str>>,
    attributes: BTreeSet<(&'static str, Vec<String>)>,
}

impl<'a> Known<'a> {
    fn of(captions: &[&'a str]) -> Self {
        let mut known = Self::default();
        for &text in captions {
            if !known.texts.insert(text) {
                continue;
            }
            let facts = facts(text);
            known.combinations.insert(names(facts.actions()));
            for action in facts.actions() {
                known.actions.insert(action.name);
                known.attributes.insert(with_attributes(action));
            }
        }
        known
    }

    /// The most that is new about the motion of a clip by any of its references.
    fn novelty(&self, clip: &CaptionedClip) -> &'static str {
        let all: Vec<_> = counted(&clip.references)
            .iter()
            .map(|text| facts(text))
            .collect();
        let any_action = |is_new: &dyn Fn(&Action) -> bool| {
            all.iter().flat_map(|facts| facts.actions()).any(is_new)
        };
        if any_action(&|a| !self.actions.contains(a.name)) {
            return NEW_ACTION;
        }
        let mut combinations = all.iter().map(|facts| names(facts.actions()));
        if combinations.any(|of| !self.combinations.contains(&of)) {
            return NEW_COMBINATION;
        }
        match any_action(&|a| !self.attributes.contains(&with_attributes(a))) {
            true => NEW_ATTRIBUTES,
            false => NOTHING_NEW,
        }
    }
}

fn names<'f>(actions: impl Iterator<Item = &'f Action>) -> Vec<&'static str> {
    actions.map(|a| a.name).collect()
}

/// An action with all that is stated of it but how often and how long: those are numbers that seldom agree.
fn with_attributes(action: &Action) -> (&'static str, Vec<String>) {
    let attributes = action.attributes().into_iter();
    let kept = attributes.filter(|(kind, _)| !matches!(kind, Kind::Count | Kind::Duration));
    (action.name, kept.map(|(_, word)| word).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::captions::tests::captioned;

    fn clip(id: &str, caption: &str, references: &[&str]) -> CaptionedClip {
        let mut clip = captioned(id, "any", None);
        clip.description.caption = caption.into();
        clip.references = references.iter().map(|text| (*text).into()).collect();
        clip
    }

    #[test]
    fn what_is_new_about_a_clip_is_told_by_its_references() {
        let train = [
            "a person walks forward",
            "a person walks forward, then sits down",
            "a person waves with the left hand",
            "someone waves with the right hand twice",
        ];
        let says = "a person walks forward";
        let clips = [
            clip("a#0", says, &["a person walks forward"]),
            clip(
                "b#0",
                says,
                &["a person waves with the left hand three times"],
            ),
            clip("c#0", says, &["a person walks backward"]),
            clip("d#0", says, &["a person sits down, then walks forward"]),
            clip("e#0", says, &["a person kneels"]),
        ];
        let slices = by_novelty(&clips, &train, 1).unwrap();
        let rows: Vec<(&str, usize, f64)> = slices
            .iter()
            .map(|s| (s.name, s.clips, s.same_actions.value))
            .collect();
        assert_eq!(
            rows,
            [
                (NOTHING_NEW, 2, 0.5),
                (NEW_ATTRIBUTES, 1, 1.0),
                (NEW_COMBINATION, 1, 0.0),
                (NEW_ACTION, 1, 0.0),
                (NEW_WORDING, 4, 0.25),
            ]
        );
        assert_eq!(slices[1].facts.contradictions, 1, "forward for backward");
    }

    #[test]
    fn facts_are_counted_by_kind() {
        let clips = [
            clip(
                "a#0",
                "a person waves with the left hand",
                &["a person waves with the right hand"],
            ),
            clip("b#0", "a person walks", &["a person walks slowly"]),
        ];
        let rows = by_kind(&clips);
        let of = |kind: &str| rows.iter().find(|row| row.kind == kind).unwrap();
        let action = of("action");
        let two = Tally {
            common: 2,
            candidate: 2,
            reference: 2,
        };
        assert_eq!(action.tally, two);
        let side = of("side");
        assert_eq!(
            (side.tally.candidate, side.tally.common, side.contradictions),
            (1, 0, 1)
        );
        let tempo = of("tempo");
        assert_eq!((tempo.tally.candidate, tempo.tally.reference), (0, 1));
        assert!(rows.iter().all(|row| row.kind != "posture"));
    }
}
