//! Tokenisations. Every reported value names the tokenisation that it used.

use serde::{Deserialize, Serialize};

use crate::{ptb::ptb, stem::porter};

/// A named set of rules: tokenisation, scoring code, reference rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, Default)]
pub enum Protocol {
    /// Lower case, ASCII punctuation characters replaced by spaces, split at white space; COCO scoring code.
    #[default]
    #[serde(rename = "plain")]
    Plain,
    /// Only stripped and split, as in nlg-eval: case and punctuation are significant.
    #[serde(rename = "nlg-eval")]
    NlgEval,
    /// Stanford PTB tokens, as the COCO caption evaluation does.
    #[serde(rename = "coco")]
    Coco,
    /// Parity with MotionGPT's released metric code, which uses nlg-metricverse: BLEU with the shortest reference,
    /// nltk's METEOR, three references by repetition.
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

    /// Description of the tokenisation in one sentence, for reports.
    pub fn tokenisation(self) -> &'static str {
        match self {
            Protocol::Plain => "lower case, ASCII punctuation to spaces, split",
            Protocol::NlgEval => "strip and split only",
            Protocol::Coco => "Stanford PTBTokenizer 3.4.1, lower case, punctuation dropped",
            Protocol::MotionGpt => {
                "ASCII punctuation to spaces, split, lower case; CIDEr: strip and split only"
            }
        }
    }

    /// The input text of BLEU, METEOR and COCO's ROUGE-L, which split it themselves.
    pub fn normalise(self, text: &str) -> String {
        match self {
            Protocol::Plain => plain(text).join(" "),
            Protocol::NlgEval => raw(text).to_string(),
            Protocol::Coco => ptb(text).join(" "),
            Protocol::MotionGpt => nm_default(text).join(" "),
        }
    }

    /// The input text of CIDEr.
    pub(crate) fn normalise_for_cider(self, text: &str) -> String {
        match self {
            Protocol::MotionGpt => raw(text).to_string(),
            other => other.normalise(text),
        }
    }
}

/// Only strips surrounding white space.
pub fn raw(text: &str) -> &str {
    text.trim_matches(is_space)
}

/// nlg-metricverse's default: each of the 32 ASCII punctuation characters is replaced by a space, then the text is
/// split and converted to lower case.
pub fn nm_default(text: &str) -> Vec<String> {
    let spaced = text.replace(|c: char| c.is_ascii_punctuation(), " ");
    words(&spaced).map(str::to_lowercase).collect()
}

/// mteval-v13a tokenisation as in sacrebleu. Case is kept.
pub fn thirteen_a(text: &str) -> Vec<String> {
    let mut text = text
        .replace("<skipped>", "")
        .replace("-\n", "")
        .replace('\n', " ");
    if text.contains('&') {
        for (entity, sign) in [
            ("&quot;", "\""),
            ("&amp;", "&"),
            ("&lt;", "<"),
            ("&gt;", ">"),
        ] {
            text = text.replace(entity, sign);
        }
    }
    let mut spaced = vec![' '];
    for c in text.chars() {
        if matches!(c, '{'..='~' | '['..='`' | ' '..='&' | '('..='+' | ':'..='@' | '/') {
            spaced.extend([' ', c, ' ']);
        } else {
            spaced.push(c);
        }
    }
    spaced.push(' ');
    let is_mark = |c: char| c == '.' || c == ',';
    let not_digit = |c: char| !c.is_ascii_digit();
    let spaced = pairs(
        &spaced,
        |a, b| not_digit(a) && is_mark(b),
        [false, true, true],
    );
    let spaced = pairs(
        &spaced,
        |a, b| is_mark(a) && not_digit(b),
        [true, true, false],
    );
    let spaced = pairs(
        &spaced,
        |a, b| a.is_ascii_digit() && b == '-',
        [false, true, true],
    );
    let spaced: String = spaced.into_iter().collect();
    words(&spaced).map(str::to_string).collect()
}

/// Inserts spaces before, between and after pairs of characters that fit. No character belongs to two pairs.
fn pairs(text: &[char], fits: impl Fn(char, char) -> bool, spaces: [bool; 3]) -> Vec<char> {
    let mut out = Vec::with_capacity(text.len() + 8);
    let mut rest = text;
    while let [a, ..] = rest {
        let pair = rest.get(1).filter(|b| fits(*a, **b));
        let put = |out: &mut Vec<char>, i: usize| out.extend(spaces[i].then_some(' '));
        match pair {
            Some(b) => {
                put(&mut out, 0);
                out.push(*a);
                put(&mut out, 1);
                out.push(*b);
                put(&mut out, 2);
                rest = &rest[2..];
            }
            None => {
                out.push(*a);
                rest = &rest[1..];
            }
        }
    }
    out
}

/// Converts to lower case, replaces each of the 32 ASCII punctuation characters by a space, and splits.
pub fn plain(text: &str) -> Vec<String> {
    let lower = text.to_lowercase();
    let spaced = lower.replace(|c: char| c.is_ascii_punctuation(), " ");
    words(&spaced).map(str::to_string).collect()
}

/// Tokens of rouge-score without stemming: lower case, separated by runs of characters other than `a-z0-9`.
pub fn rouge_score(text: &str) -> Vec<String> {
    let lower = text.to_lowercase();
    let is_part = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit();
    lower
        .split(|c| !is_part(c))
        .filter(|t| !t.is_empty())
        .map(str::to_string)
        .collect()
}

/// Tokens of rouge-score with stemming. Words of more than three characters are stemmed by nltk's Porter stemmer.
pub fn rouge_score_stemmed(text: &str) -> Vec<String> {
    let stem = |word: String| if word.len() > 3 { porter(&word) } else { word };
    rouge_score(text).into_iter().map(stem).collect()
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
        assert_eq!(Protocol::NlgEval.normalise(" A  b.\n"), "A  b.");
        assert_eq!(
            Protocol::Coco.normalise("(A) man's."),
            "-lrb- a -rrb- man 's"
        );
        assert_eq!(
            words("a\u{1f}b\u{a0}c").collect::<Vec<_>>(),
            ["a", "b", "c"]
        );
    }
}
