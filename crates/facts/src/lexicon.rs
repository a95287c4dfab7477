//! The words that state an action: the patterns of `data/patterns.tsv`.

use std::sync::LazyLock;

use crate::tables::{self, PATTERNS};

/// A pattern of words, and the action that it states.
///
/// A pattern is a sequence of words separated by spaces, each with alternatives separated by `|`. A word that ends with
/// `*` matches every word that begins like it. The words must occur in this order, with at most [`MAX_GAP`] other words
/// between two of them. `+` before a word allows no other word before it. `?` before a pattern: it counts only where no
/// other pattern states anything in this part of the sentence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pattern {
    /// Name of the action.
    pub action: &'static str,
    /// The words.
    pub words: &'static str,
}

/// Words that may stand between two words of a pattern: "raises *the right* hand *and* waves".
pub const MAX_GAP: usize = 4;

/// Name of the patterns that state nothing.
const NOTHING: &str = "-";

static STATING: LazyLock<Vec<Pattern>> = LazyLock::new(|| {
    let stating = PATTERNS.iter().filter(|(action, _)| *action != NOTHING);
    stating
        .map(|&(action, words)| Pattern { action, words })
        .collect()
});

static IDIOMS: LazyLock<Vec<&str>> = LazyLock::new(|| {
    let idioms = PATTERNS.iter().filter(|(action, _)| *action == NOTHING);
    idioms.map(|&(_, words)| words).collect()
});

/// All patterns in order of precedence. The words of a match are not matched again, so that a compound action
/// ("raises a hand and waves") stands before its parts ("raises a hand").
pub fn patterns() -> &'static [Pattern] {
    &STATING
}

/// Phrases of words that elsewhere state actions, and here state none. They are matched before all patterns.
pub(crate) fn idioms() -> &'static [&'static str] {
    &IDIOMS
}

/// Words that state attributes, and words that state nothing, one a line.
const OTHER_WORDS: &str = include_str!("../data/words.txt");

/// Whether a word of [`crate::words::words`] is in the lexicon: in a pattern, as an attribute, or as a word that states
/// nothing.
pub fn knows(word: &str) -> bool {
    let in_pattern = |pattern: &Pattern| {
        pattern.words.split([' ', '|']).any(|w| {
            let w = w.trim_start_matches(['+', '?']);
            match w.strip_suffix('*') {
                Some(start) => word.starts_with(start),
                None => word == w,
            }
        })
    };
    crate::words::number(word).is_some()
        || OTHER_WORDS.lines().any(|known| known == word)
        || patterns().iter().any(in_pattern)
}

/// The name of an action as the table has it; `None` if there is no such action.
pub fn name(name: &str) -> Option<&'static str> {
    tables::action_words(name).map(|words| words.name)
}
