//! Caption metrics and, beside them, the facts of candidates and of their references.

use std::collections::{BTreeMap, HashMap};

use radarllm_facts::{
    Kind,
    score::{Tally, score},
};
use radarllm_metrics::{Candidate, Reference, Scores};
use serde::Serialize;

/// Scores of captions, as the command `score` prints them.
#[derive(Serialize)]
pub struct CaptionScores {
    /// Caption metrics.
    #[serde(flatten)]
    pub scores: Scores,
    /// Facts.
    pub facts: FactBlock,
}

impl CaptionScores {
    /// Scores of these candidates and references, with their facts.
    pub fn new(scores: Scores, candidates: &[Candidate], references: &[Reference]) -> Self {
        Self {
            scores,
            facts: block(candidates, references),
        }
    }
}

/// Precision and recall of facts.
#[derive(Serialize)]
pub struct FactBlock {
    /// All kinds but the subject together.
    all: Tally,
    by_kind: BTreeMap<&'static str, Tally>,
    /// Facts that exclude what the reference states, by kind: left for right, forward for backward, once for many.
    contradictions: BTreeMap<&'static str, usize>,
    rules: &'static str,
}

/// Compares every candidate with that of its references which agrees most. Candidates have references of the same id.
fn block(candidates: &[Candidate], references: &[Reference]) -> FactBlock {
    let texts: HashMap<&str, &[String]> = references
        .iter()
        .map(|reference| (reference.id.as_str(), &reference.texts[..]))
        .collect();
    let scores = score(candidates.iter().map(|candidate| {
        let own = texts.get(candidate.id.as_str());
        (candidate.text.as_str(), own.copied().unwrap_or_default())
    }));
    FactBlock {
        all: scores.all(),
        by_kind: Kind::ALL
            .into_iter()
            .map(|kind| (kind.name(), scores.of(kind)))
            .collect(),
        contradictions: scores
            .contradictions
            .iter()
            .map(|(kind, n)| (kind.name(), *n))
            .collect(),
        rules: "facts of both sides by the parser of radarllm-facts; of all references of an item, the one that agrees most",
    }
}
