//! Tokenisations. Which one was used is part of every number.

use serde::{Deserialize, Serialize};

/// A named set of rules: tokenisation, scoring code, reference rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, Default)]
pub enum Protocol {
    /// Lower case, every ASCII punctuation character to a space, split; COCO scoring code.
    #[default]
    #[serde(rename = "plain")]
    Plain,
    /// Nothing but strip and split, as nlg-eval does: case and punctuation count.
    #[serde(rename = "nlg-eval")]
    NlgEval,
    /// Stanford PTB tokens, as the COCO caption evaluation does. Not supported yet.
    #[serde(rename = "coco")]
    Coco,
    /// Parity with MotionGPT's released metric code. Not supported yet.
    #[serde(rename = "motiongpt")]
    MotionGpt,
}

impl Protocol {
    /// All protocols.
    pub const ALL: [Protocol; 4] = [
        Protocol::Plain,
        Protocol::NlgEval,
        Protocol::Coco,
        Protocol::MotionGpt,
    ];

    /// Name on the command line and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Protocol::Plain => "plain",
            Protocol::NlgEval => "nlg-eval",
            Protocol::Coco => "coco",
            Protocol::MotionGpt => "motiongpt",
        }
    }

    /// Inverse of [`Protocol::name`].
    pub fn from_name(name: &str) -> Option<Protocol> {
        Protocol::ALL.into_iter().find(|p| p.name() == name)
    }

    /// One sentence on the tokenisation, for reports.
    pub fn tokenisation(self) -> &'static str {
        match self {
            Protocol::Plain => "lower case, ASCII punctuation to spaces, split",
            Protocol::NlgEval => "strip and split only",
            Protocol::Coco => "Stanford PTBTokenizer 3.4.1, lower case, punctuation dropped",
            Protocol::MotionGpt => "nlg-metricverse default",
        }
    }

    /// The text that BLEU, CIDEr and COCO's ROUGE-L see; they split it themselves. `None` for
    /// protocols that are not supported yet.
    pub fn normalise(self, text: &str) -> Option<String> {
        match self {
            Protocol::Plain => Some(plain(text).join(" ")),
            Protocol::NlgEval => Some(text.trim_matches(is_space).to_string()),
            Protocol::Coco | Protocol::MotionGpt => None,
        }
    }
}

/// Lower case, every one of the 32 ASCII punctuation characters to a space, split.
pub fn plain(text: &str) -> Vec<String> {
    let lower = text.to_lowercase();
    let spaced = lower.replace(|c: char| c.is_ascii_punctuation(), " ");
    words(&spaced).map(str::to_string).collect()
}

/// Tokens of rouge-score without stemming: lower case, runs of anything but `a-z0-9` separate.
pub fn rouge_score(text: &str) -> Vec<String> {
    let lower = text.to_lowercase();
    let is_part = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit();
    lower
        .split(|c| !is_part(c))
        .filter(|t| !t.is_empty())
        .map(str::to_string)
        .collect()
}

/// Python's `str.split()`.
pub(crate) fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(is_space).filter(|w| !w.is_empty())
}

/// Python's `str.isspace`: Unicode white space plus the four ASCII separators.
fn is_space(c: char) -> bool {
    c.is_whitespace() || ('\u{1c}'..='\u{1f}').contains(&c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_differ_where_they_should() {
        let text = " A man's half-turn,  at 1,000 m/s: d\u{e9}j\u{e0} vu.";
        assert_eq!(
            plain(text).join("|"),
            "a|man|s|half|turn|at|1|000|m|s|d\u{e9}j\u{e0}|vu"
        );
        assert_eq!(
            rouge_score(text).join("|"),
            "a|man|s|half|turn|at|1|000|m|s|d|j|vu"
        );
        assert_eq!(
            Protocol::NlgEval.normalise(" A  b.\n").as_deref(),
            Some("A  b.")
        );
        assert_eq!(Protocol::Coco.normalise("a"), None);
        assert_eq!(
            words("a\u{1f}b\u{a0}c").collect::<Vec<_>>(),
            ["a", "b", "c"]
        );
    }
}
