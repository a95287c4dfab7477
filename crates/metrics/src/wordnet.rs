//! Synonyms of single words from WordNet 3.0, as METEOR 1.5 and nltk's METEOR look them up.
//!
//! The table `data/wordnet.txt` is made by `data/wordnet_table.py` and carries WordNet's notice.

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::LazyLock;

static TABLE: LazyLock<WordNet> =
    LazyLock::new(|| WordNet::parse(include_str!("../data/wordnet.txt")));

/// Suffixes of inflected forms and their replacements in base forms, by part of speech.
const NOUN: &[(&str, &str)] = &[
    ("s", ""),
    ("ses", "s"),
    ("ves", "f"),
    ("xes", "x"),
    ("zes", "z"),
    ("ches", "ch"),
    ("shes", "sh"),
    ("men", "man"),
    ("ies", "y"),
];
const VERB: &[(&str, &str)] = &[
    ("s", ""),
    ("ies", "y"),
    ("es", "e"),
    ("es", ""),
    ("ed", "e"),
    ("ed", ""),
    ("ing", "e"),
    ("ing", ""),
];
const ADJECTIVE: &[(&str, &str)] = &[("er", ""), ("est", ""), ("er", "e"), ("est", "e")];
/// The same in the order of the table's sections.
const DETACHMENTS: [&[(&str, &str)]; 4] = [NOUN, VERB, ADJECTIVE, &[]];
/// METEOR 1.5 has no rule for -ves.
const METEOR_SKIPS: &str = "ves";
const PARTS: [&str; 4] = ["noun", "verb", "adj", "adv"];
/// Section of the synsets that share a number in METEOR's jar, after the four parts of speech.
const SHARED: usize = 4;

/// The indexed table.
pub(crate) struct WordNet {
    /// Words of each synset: a line of the table.
    synsets: Vec<&'static str>,
    /// Maps a word in lower case to pairs of section and synset.
    entries: HashMap<Cow<'static, str>, Vec<(u8, u32)>>,
    /// Maps an irregular form to its base forms, by part of speech. There is one list for each line of the table.
    exceptions: [HashMap<&'static str, Vec<Vec<&'static str>>>; 4],
}

impl WordNet {
    /// The built-in table, which is indexed at the first call.
    pub(crate) fn get() -> &'static WordNet {
        &TABLE
    }

    fn parse(text: &'static str) -> Self {
        let mut this = Self {
            synsets: Vec::new(),
            entries: HashMap::new(),
            exceptions: std::array::from_fn(|_| HashMap::new()),
        };
        let (mut section, mut is_exception) = (0, false);
        for line in text.lines().filter(|l| !l.starts_with('#')) {
            if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
                let part = name.split(' ').next().unwrap_or_default();
                is_exception = name.ends_with("exceptions");
                section = PARTS.iter().position(|p| *p == part).unwrap_or(SHARED);
            } else if is_exception {
                let mut words = line.split(' ');
                if let (Some(form), Some(exceptions)) =
                    (words.next(), this.exceptions.get_mut(section))
                {
                    exceptions.entry(form).or_default().push(words.collect());
                }
            } else {
                let number = this.synsets.len() as u32;
                this.synsets.push(line);
                for word in line.split(' ') {
                    let key = if word.bytes().any(|b| b.is_ascii_uppercase()) {
                        Cow::Owned(word.to_ascii_lowercase())
                    } else {
                        Cow::Borrowed(word)
                    };
                    this.entries
                        .entry(key)
                        .or_default()
                        .push((section as u8, number));
                }
            }
        }
        this
    }

    /// Sorted synsets by METEOR 1.5's rule: those of the word itself and those of its base forms. Base forms are the
    /// irregular ones if there are any, and otherwise the first regular one that exists.
    pub(crate) fn meteor_synsets(&self, word: &str) -> Vec<u32> {
        let mut found: Vec<u32> = Vec::new();
        let mut add = |form: &str| {
            let entries = self.entries.get(form).into_iter().flatten();
            found.extend(entries.map(|&(_, synset)| synset));
        };
        add(word);
        let irregular: Vec<&str> = self
            .exceptions
            .iter()
            .filter_map(|e| e.get(word))
            .flatten()
            .flatten()
            .copied()
            .collect();
        if !irregular.is_empty() {
            irregular.into_iter().for_each(add);
        } else if let Some(base) = self.meteor_base(word) {
            add(&base);
        }
        found.sort_unstable();
        found.dedup();
        found
    }

    fn meteor_base(&self, word: &str) -> Option<String> {
        if word.ends_with("ss") || word.encode_utf16().count() <= 2 {
            return None;
        }
        let rules = DETACHMENTS
            .into_iter()
            .flatten()
            .filter(|(s, _)| *s != METEOR_SKIPS);
        rules
            .filter_map(|(suffix, replacement)| {
                Some(format!("{}{replacement}", word.strip_suffix(suffix)?))
            })
            .find(|base| self.entries.contains_key(base.as_str()))
    }

    /// All words of all synsets of a word by nltk's rules: of its own form and of its base forms in each part of
    /// speech. Names keep their case, as in nltk.
    pub(crate) fn nltk_synonyms(&self, word: &str) -> Vec<&'static str> {
        let word = word.to_lowercase();
        let mut found = Vec::new();
        for (part, detachments) in DETACHMENTS.into_iter().enumerate() {
            // If a form has several lines, nltk uses the last one.
            let irregular = self.exceptions[part].get(word.as_str());
            let bases: Vec<String> = match irregular.and_then(|lines| lines.last()) {
                Some(bases) => bases.iter().map(|b| (*b).to_string()).collect(),
                None => detachments
                    .iter()
                    .filter_map(|(suffix, replacement)| {
                        Some(format!("{}{replacement}", word.strip_suffix(suffix)?))
                    })
                    .collect(),
            };
            for form in std::iter::once(&word).chain(&bases) {
                let entries = self.entries.get(form.as_str()).into_iter().flatten();
                let here = entries.filter(|(section, _)| usize::from(*section) == part);
                found
                    .extend(here.flat_map(|&(_, synset)| self.synsets[synset as usize].split(' ')));
            }
        }
        found
    }
}
