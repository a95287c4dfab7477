//! The words that state an action: the patterns of `data/patterns.tsv`.

use std::{collections::HashMap, sync::LazyLock};

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

static STATING_INDEX: LazyLock<Index> = LazyLock::new(|| {
    let states = |(action, _): &&(&str, &str)| *action != NOTHING;
    Index::new(PATTERNS.iter().filter(states))
});

static IDIOM_INDEX: LazyLock<Index> = LazyLock::new(|| {
    let states_nothing = |(action, _): &&(&str, &str)| *action == NOTHING;
    Index::new(PATTERNS.iter().filter(states_nothing))
});

/// All patterns in order of precedence. The words of a match are not matched again, so that a compound action
/// ("raises a hand and waves") stands before its parts ("raises a hand").
pub fn patterns() -> &'static [Pattern] {
    &STATING
}

/// [`patterns`] by their first words.
pub(crate) fn stating() -> &'static Index {
    &STATING_INDEX
}

/// Phrases of words that elsewhere state actions, and here state none. They are matched before all patterns.
pub(crate) fn idioms() -> &'static Index {
    &IDIOM_INDEX
}

/// The alternatives of one word of a pattern.
#[derive(Debug)]
pub(crate) struct Slot {
    /// Whether no other word may stand before it.
    is_adjacent: bool,
    alternatives: Vec<Alternative>,
}

#[derive(Debug)]
enum Alternative {
    Word(&'static str),
    /// Every word that begins like this.
    Start(&'static str),
}

impl Slot {
    fn new(word: &'static str) -> Self {
        let alternatives = word.trim_start_matches('+').split('|');
        Self {
            is_adjacent: word.starts_with('+'),
            alternatives: alternatives
                .map(|a| match a.strip_suffix('*') {
                    Some(start) => Alternative::Start(start),
                    None => Alternative::Word(a),
                })
                .collect(),
        }
    }

    fn matches(&self, word: &str) -> bool {
        self.alternatives.iter().any(|a| match a {
            Alternative::Word(own) => word == *own,
            Alternative::Start(start) => word.starts_with(start),
        })
    }
}

/// A pattern whose words were split.
#[derive(Debug)]
pub(crate) struct Prepared {
    /// Name of the action.
    pub action: &'static str,
    /// Whether it counts only where no other pattern states anything in this part of the sentence.
    pub only_alone: bool,
    slots: Vec<Slot>,
}

impl Prepared {
    /// Positions of the words of the pattern among the unused words of a clause.
    pub(crate) fn find(&self, words: &[&str], used: &[bool]) -> Option<Vec<usize>> {
        (0..words.len()).find_map(|start| {
            let mut at = Vec::new();
            let mut next = start..start + 1;
            for slot in &self.slots {
                if slot.is_adjacent {
                    next.end = next.end.min(next.start + 1);
                }
                let end = next.end.min(words.len());
                let found = (next.start..end).find(|i| !used[*i] && slot.matches(words[*i]))?;
                at.push(found);
                next = found + 1..found + 2 + MAX_GAP;
            }
            Some(at)
        })
    }
}

/// Patterns that are found by the words of a clause: only those whose first word stands in it can match.
#[derive(Debug)]
pub(crate) struct Index {
    patterns: Vec<Prepared>,
    /// Patterns by a word that they may begin with.
    by_word: HashMap<&'static str, Vec<usize>>,
    /// Patterns by the start of a word that they may begin with.
    by_start: Vec<(&'static str, usize)>,
}

impl Index {
    fn new<'a>(patterns: impl Iterator<Item = &'a (&'static str, &'static str)>) -> Self {
        let mut index = Self {
            patterns: Vec::new(),
            by_word: HashMap::new(),
            by_start: Vec::new(),
        };
        for (i, &(action, words)) in patterns.enumerate() {
            let slots: Vec<Slot> = words
                .trim_start_matches('?')
                .split(' ')
                .map(Slot::new)
                .collect();
            for alternative in slots.first().iter().flat_map(|slot| &slot.alternatives) {
                match alternative {
                    Alternative::Word(word) => index.by_word.entry(*word).or_default().push(i),
                    Alternative::Start(start) => index.by_start.push((*start, i)),
                }
            }
            index.patterns.push(Prepared {
                action,
                only_alone: words.starts_with('?'),
                slots,
            });
        }
        index
    }

    /// The patterns that may match a clause with these words, in order of precedence.
    pub(crate) fn candidates(&self, words: &[&str]) -> impl Iterator<Item = &Prepared> {
        let mut found: Vec<usize> = Vec::new();
        for word in words {
            found.extend(self.by_word.get(word).into_iter().flatten());
            let starts = self
                .by_start
                .iter()
                .filter(|(start, _)| word.starts_with(start));
            found.extend(starts.map(|(_, i)| i));
        }
        found.sort_unstable();
        found.dedup();
        found.into_iter().map(|i| &self.patterns[i])
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// What the index leaves out cannot match: a clause of the words of a pattern has the pattern among its candidates.
    #[test]
    fn every_pattern_is_a_candidate_of_its_own_words() {
        for (index, n_patterns) in [
            (stating(), STATING.len()),
            (idioms(), IDIOM_INDEX.patterns.len()),
        ] {
            assert_eq!(index.patterns.len(), n_patterns);
            for (i, pattern) in index.patterns.iter().enumerate() {
                for first in &pattern.slots[0].alternatives {
                    let word = |alternative: &Alternative| match alternative {
                        Alternative::Word(word) | Alternative::Start(word) => *word,
                    };
                    let rest = pattern.slots[1..]
                        .iter()
                        .map(|slot| word(&slot.alternatives[0]));
                    let words: Vec<&str> = [word(first)].into_iter().chain(rest).collect();
                    let is_candidate = index.candidates(&words).any(|p| std::ptr::eq(p, pattern));
                    assert!(is_candidate, "pattern {i}: {words:?}");
                    assert!(pattern.find(&words, &vec![false; words.len()]).is_some());
                }
            }
        }
    }
}
