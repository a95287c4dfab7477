//! The words of actions: the tables `actions.tsv`, `patterns.tsv`, `captions.tsv` and `manners.tsv` of `data`.
//!
//! One table of actions serves reading ([`crate::lexicon`]), writing ([`crate::write`]), the captions of the motion
//! library and questions about a memory. The first lines of each table explain it.

use std::sync::LazyLock;

use crate::action::BodyPart;

/// An action and its words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ActionWords {
    /// Name in the notation of facts.
    pub name: &'static str,
    /// "get up"; `None` if no sentence states the action.
    pub infinitive: Option<&'static str>,
    /// "got up"; `None` if no sentence states the action.
    pub past: Option<&'static str>,
    /// The part of the body that acts where nothing else is stated.
    pub limb: BodyPart,
    /// Phrases of the writer.
    pub phrases: Vec<&'static str>,
}

/// Phrases for the captions of a motion whose values pass tests.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptionRow {
    /// Name of the motion.
    pub motion: &'static str,
    /// All of these have to hold.
    pub tests: Vec<Test>,
    /// The phrases.
    pub phrases: Vec<&'static str>,
}

/// A test of a motion's value.
#[derive(Clone, Debug, PartialEq)]
pub struct Test {
    /// Name of the value.
    pub key: &'static str,
    /// What the value has to be.
    pub is: Expected,
}

/// What a value has to be.
#[derive(Clone, Debug, PartialEq)]
pub enum Expected {
    /// One of these words.
    Word(Vec<&'static str>),
    /// This number or more.
    Min(f32),
    /// This number or less.
    Max(f32),
}

static ACTIONS: LazyLock<Vec<ActionWords>> =
    LazyLock::new(|| actions(include_str!("../data/actions.tsv")).unwrap_or_default());
static CAPTIONS: LazyLock<Vec<CaptionRow>> =
    LazyLock::new(|| captions(include_str!("../data/captions.tsv")).unwrap_or_default());
static MANNERS: LazyLock<Vec<(&str, Vec<&str>)>> =
    LazyLock::new(|| manners(include_str!("../data/manners.tsv")).unwrap_or_default());
/// Names of actions with their patterns, in order of precedence; `-` is no action.
pub(crate) static PATTERNS: LazyLock<Vec<(&str, &str)>> =
    LazyLock::new(|| patterns(include_str!("../data/patterns.tsv")).unwrap_or_default());

/// All actions with their words, in alphabetical order.
pub fn all_actions() -> &'static [ActionWords] {
    &ACTIONS
}

/// The words of an action; `None` if there is no such action.
pub fn action_words(name: &str) -> Option<&'static ActionWords> {
    let at = ACTIONS.binary_search_by_key(&name, |words| words.name);
    ACTIONS.get(at.ok()?)
}

/// Names of the actions that a sentence can state, in alphabetical order.
pub fn stated_actions() -> impl Iterator<Item = &'static str> {
    let stated = ACTIONS.iter().filter(|words| words.infinitive.is_some());
    stated.map(|words| words.name)
}

/// The rows of the captions of a motion, in order of precedence.
pub fn caption_rows(motion: &str) -> impl Iterator<Item = &'static CaptionRow> {
    CAPTIONS.iter().filter(move |row| row.motion == motion)
}

/// Adverbs that state a manner, by its word.
pub(crate) fn adverbs(manner: &str) -> &'static [&'static str] {
    let found = MANNERS.iter().find(|(word, _)| *word == manner);
    found.map_or(&[], |(_, adverbs)| adverbs.as_slice())
}

/// Number of a line of a table, and its fields.
type Row<const N: usize> = (usize, [&'static str; N]);

/// The lines of a table that are neither empty nor comments.
fn rows<const N: usize>(table: &'static str) -> Result<Vec<Row<N>>, String> {
    let lines = table.lines().enumerate().map(|(n, line)| (n + 1, line));
    let lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let row = |(n, line): (usize, &'static str)| {
        let fields: Vec<&str> = line.split('\t').collect();
        match <[&str; N]>::try_from(fields) {
            Ok(fields) => Ok((n, fields)),
            Err(_) => Err(format!("line {n}: expected {N} fields: {line}")),
        }
    };
    lines.map(row).collect()
}

/// A field that may be missing.
fn optional(field: &'static str) -> Option<&'static str> {
    (field != "-").then_some(field)
}

/// A field of several values.
fn list(field: &'static str) -> Vec<&'static str> {
    optional(field).map_or_else(Vec::new, |field| field.split(" | ").collect())
}

fn actions(table: &'static str) -> Result<Vec<ActionWords>, String> {
    rows::<5>(table)?.into_iter().map(action).collect()
}

fn action((n, [name, infinitive, past, limb, phrases]): Row<5>) -> Result<ActionWords, String> {
    let limb = match optional(limb) {
        None => BodyPart::Hand,
        Some(word) => BodyPart::from_word(word)
            .ok_or_else(|| format!("line {n}: `{word}` is no part of the body"))?,
    };
    Ok(ActionWords {
        name,
        infinitive: optional(infinitive),
        past: optional(past),
        limb,
        phrases: list(phrases),
    })
}

fn captions(table: &'static str) -> Result<Vec<CaptionRow>, String> {
    rows::<3>(table)?.into_iter().map(caption).collect()
}

fn caption((n, [motion, tests, phrases]): Row<3>) -> Result<CaptionRow, String> {
    let tests = optional(tests).into_iter().flat_map(|t| t.split(' '));
    let test = |text| test(text).ok_or_else(|| format!("line {n}: `{text}` is no test"));
    Ok(CaptionRow {
        motion,
        tests: tests.map(test).collect::<Result<_, String>>()?,
        phrases: list(phrases),
    })
}

fn test(text: &'static str) -> Option<Test> {
    let (key, is) = if let Some((key, min)) = text.split_once(">=") {
        (key, Expected::Min(min.parse().ok()?))
    } else if let Some((key, max)) = text.split_once("<=") {
        (key, Expected::Max(max.parse().ok()?))
    } else {
        let (key, words) = text.split_once('=')?;
        (key, Expected::Word(words.split('|').collect()))
    };
    Some(Test { key, is })
}

fn manners(table: &'static str) -> Result<Vec<(&'static str, Vec<&'static str>)>, String> {
    let manners = rows::<2>(table)?.into_iter();
    Ok(manners
        .map(|(_, [word, adverbs])| (word, list(adverbs)))
        .collect())
}

fn patterns(table: &'static str) -> Result<Vec<(&'static str, &'static str)>, String> {
    let patterns = rows::<2>(table)?.into_iter();
    Ok(patterns.map(|(_, [name, words])| (name, words)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::action::Manner;
    use crate::lexicon;

    #[test]
    fn the_tables_are_read_without_problems() {
        let actions = actions(include_str!("../data/actions.tsv")).unwrap();
        assert!(actions.is_sorted_by(|a, b| a.name < b.name));
        for action in &actions {
            let words = [action.infinitive, action.past];
            assert!(
                words.iter().all(Option::is_some) || words.iter().all(Option::is_none),
                "{}",
                action.name
            );
            assert_eq!(action.infinitive.is_some(), !action.phrases.is_empty());
        }
        let captions = captions(include_str!("../data/captions.tsv")).unwrap();
        assert!(captions.iter().all(|row| !row.phrases.is_empty()));
        let manners = manners(include_str!("../data/manners.tsv")).unwrap();
        let words: Vec<&str> = manners.iter().map(|(word, _)| *word).collect();
        let all: Vec<&str> = Manner::ALL.iter().map(|manner| manner.word()).collect();
        assert_eq!(words.len(), all.len());
        assert!(all.iter().all(|word| words.contains(word)));
        assert!(
            !patterns(include_str!("../data/patterns.tsv"))
                .unwrap()
                .is_empty()
        );
    }

    #[test]
    fn exactly_the_actions_with_verbs_have_patterns() {
        let mut stated: Vec<&str> = lexicon::patterns().iter().map(|p| p.action).collect();
        stated.sort_unstable();
        stated.dedup();
        assert!(stated_actions().eq(stated));
        assert!(action_words("cartwheel").unwrap().phrases.is_empty());
        assert_eq!(action_words("fly"), None);
    }

    #[test]
    fn a_wrong_row_is_named() {
        assert_eq!(
            actions("# head\n\nwalk\twalk").unwrap_err(),
            "line 3: expected 5 fields: walk\twalk"
        );
        assert_eq!(
            actions("walk\twalk\twalked\twing\t-").unwrap_err(),
            "line 1: `wing` is no part of the body"
        );
        assert_eq!(
            captions("walk\tradius_m>=x\t[walk]").unwrap_err(),
            "line 1: `radius_m>=x` is no test"
        );
    }

    #[test]
    fn a_row_of_captions_has_tests_and_phrases() {
        let rows = captions("jump\tdirection=up|left size>=1.2\t[jump] up | [leap]").unwrap();
        let expected = CaptionRow {
            motion: "jump",
            tests: vec![
                Test {
                    key: "direction",
                    is: Expected::Word(vec!["up", "left"]),
                },
                Test {
                    key: "size",
                    is: Expected::Min(1.2),
                },
            ],
            phrases: vec!["[jump] up", "[leap]"],
        };
        assert_eq!(rows, [expected]);
    }
}
