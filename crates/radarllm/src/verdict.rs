//! Whether a sentence is right about what is known to have been performed.

use std::fmt;

use radarllm_facts::{Kind, facts, score::compare};

/// Whether a sentence is right about what was performed; what it leaves out is not wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The same actions, and no side or direction that contradicts.
    Right,
    /// The same actions with a side or a direction that contradicts.
    WrongSide,
    /// Other actions.
    WrongAction,
}

impl Verdict {
    /// Judges a sentence by another one about what was performed. Counts, tempo and manner are not judged.
    ///
    /// ```
    /// use radarllm::Verdict;
    ///
    /// let performed = "a person waves with the left hand";
    /// assert_eq!(Verdict::of("someone waves slowly", performed), Verdict::Right);
    /// assert_eq!(Verdict::of("a person waves both hands", performed), Verdict::WrongSide);
    /// assert_eq!(Verdict::of("a person claps", performed), Verdict::WrongAction);
    /// ```
    pub fn of(sentence: &str, performed: &str) -> Self {
        let scores = compare(&facts(sentence), &facts(performed));
        let actions = scores.of(Kind::Action);
        let is_wrong = |kind| scores.contradictions.contains_key(&kind);
        if actions.common < actions.candidate.max(actions.reference) {
            Self::WrongAction
        } else if is_wrong(Kind::Side) || is_wrong(Kind::Direction) {
            Self::WrongSide
        } else {
            Self::Right
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Right => "right",
            Self::WrongSide => "wrong side or direction",
            Self::WrongAction => "wrong action",
        })
    }
}
