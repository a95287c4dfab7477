//! METEOR 1.5 (Denkowski and Lavie, "Meteor Universal", WMT 2014), English, task `rank`, `-norm`.
//!
//! Checked against METEOR's jar in `tests/it/meteor.rs`. Exact, stem and synonym matches are built in. METEOR's
//! own function words, abbreviations and paraphrases are LGPL data that are only read from the user's folder.

mod align;
pub mod nltk;
mod normalise;
mod paraphrase;

use std::collections::{HashMap, HashSet};

use crate::{stem, wordnet::WordNet};
pub use paraphrase::Paraphrases;

/// Exact, stem, synonym, paraphrase.
const N_MODULES: usize = 4;
const MODULE_NAMES: [&str; N_MODULES] = ["exact", "stem", "synonym", "paraphrase"];
const MODULE_WEIGHTS: [f64; N_MODULES] = [1.0, 0.6, 0.8, 0.6];
const ALPHA: f64 = 0.85;
const BETA: f64 = 0.20;
const GAMMA: f64 = 0.60;
const DELTA: f64 = 0.75;

/// Function words that are used without METEOR's own list.
const FUNCTION_WORDS: &str = include_str!("../../data/function_words.txt");
/// Abbreviations that keep their dot, used without METEOR's own list.
const ABBREVIATIONS: &str = include_str!("../../data/abbreviations.txt");

/// Why a table of words or phrases cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {problem}")]
pub struct TableError {
    /// Line, from 1.
    pub line: usize,
    /// What is wrong.
    pub problem: String,
}

impl TableError {
    fn new(line: usize, problem: &str) -> Self {
        Self {
            line,
            problem: problem.to_string(),
        }
    }
}

/// The tables that METEOR needs.
#[derive(Clone, Debug)]
pub struct Resources {
    function_words: HashSet<String>,
    abbreviations: HashMap<String, normalise::Abbreviation>,
    paraphrases: Option<Paraphrases>,
    synonyms: bool,
    own_function_words: bool,
}

impl Default for Resources {
    /// The built-in tables: function words and abbreviations of this project, WordNet's synonyms, no paraphrases.
    fn default() -> Self {
        Self {
            function_words: parse_words(FUNCTION_WORDS),
            abbreviations: parse_abbreviations(ABBREVIATIONS),
            paraphrases: None,
            synonyms: true,
            own_function_words: true,
        }
    }
}

impl Resources {
    /// Uses METEOR's `function/english.words`: one word per line.
    pub fn with_function_words(self, text: &str) -> Self {
        Self {
            function_words: text.lines().map(str::to_string).collect(),
            own_function_words: false,
            ..self
        }
    }

    /// Uses METEOR's `nonbreaking/english.prefixes`: one abbreviation per line without its dot,
    /// `#NUMERIC_ONLY#` after those that only keep it before numbers, `#` at the start of a comment.
    pub fn with_abbreviations(self, text: &str) -> Self {
        Self {
            abbreviations: parse_abbreviations(text),
            ..self
        }
    }

    /// Uses a paraphrase table.
    pub fn with_paraphrases(self, paraphrases: Paraphrases) -> Self {
        Self {
            paraphrases: Some(paraphrases),
            ..self
        }
    }

    /// Disables WordNet.
    pub fn without_synonyms(self) -> Self {
        Self {
            synonyms: false,
            ..self
        }
    }

    /// Names of the enabled matchers.
    pub fn matchers(&self) -> Vec<&'static str> {
        let runs = [true, true, self.synonyms, self.paraphrases.is_some()];
        let named = MODULE_NAMES.into_iter().zip(runs);
        named
            .filter(|(_, runs)| *runs)
            .map(|(name, _)| name)
            .collect()
    }

    /// Origin of the function words: `radarllm` (built in) or `meteor` (the user's file).
    pub fn function_word_list(&self) -> &'static str {
        if self.own_function_words {
            "radarllm"
        } else {
            "meteor"
        }
    }
}

fn parse_words(text: &str) -> HashSet<String> {
    text.lines()
        .filter(|l| !l.starts_with("# "))
        .flat_map(str::split_whitespace)
        .map(str::to_string)
        .collect()
}

fn parse_abbreviations(text: &str) -> HashMap<String, normalise::Abbreviation> {
    use normalise::Abbreviation::{Always, BeforeNumber};
    text.lines()
        .filter(|l| !l.starts_with('#'))
        .filter_map(|line| {
            let mut words = line.split_whitespace();
            let word = words.next()?;
            let kind = words.next().map_or(Always, |_| BeforeNumber);
            Some((word.to_string(), kind))
        })
        .collect()
}

/// The properties of a word that the matchers compare.
#[derive(Clone, Debug)]
struct Word {
    number: u32,
    stem: u32,
    /// Sorted.
    synsets: Vec<u32>,
    paraphrase_word: Option<u32>,
    is_function: bool,
}

/// Additive statistics of a candidate and its best-scoring reference, or of a corpus.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct MeteorStats {
    /// Numbers of words and, below, of function words among them: `[candidate, reference]`.
    len: [f64; 2],
    function_len: [f64; 2],
    /// Matched content and function words by module: `[candidate, reference][module]`.
    content: [[f64; N_MODULES]; 2],
    function: [[f64; N_MODULES]; 2],
    chunks: f64,
}

impl MeteorStats {
    /// Columns of one segment in corpus sums.
    pub const WIDTH: usize = 21;

    /// METEOR, 0..1.
    pub fn score(&self) -> f64 {
        let mut ratios = [0.0; 2];
        for (side, ratio) in ratios.iter_mut().enumerate() {
            let function_len = self.function_len[side];
            let len = DELTA * (self.len[side] - function_len) + (1.0 - DELTA) * function_len;
            let weigh = |matches: &[f64; N_MODULES], share: f64| -> f64 {
                matches
                    .iter()
                    .zip(MODULE_WEIGHTS)
                    .map(|(m, w)| m * w * share)
                    .sum()
            };
            let matches =
                weigh(&self.content[side], DELTA) + weigh(&self.function[side], 1.0 - DELTA);
            *ratio = matches / len;
        }
        let [precision, recall] = ratios;
        let mean = 1.0 / ((1.0 - ALPHA) / precision + ALPHA / recall);
        let fragmentation = if self.is_one_chunk() {
            0.0
        } else {
            self.chunks / ((self.matched(0) + self.matched(1)) / 2.0)
        };
        let score = mean * (1.0 - GAMMA * fragmentation.powf(BETA));
        // If nothing matched or a sentence is empty, the value is 0/0.
        if score.is_nan() { 0.0 } else { score.max(0.0) }
    }

    /// Adds an item. If the words of the item match completely in one chunk, that chunk is not counted in a corpus.
    pub fn add(&mut self, item: &Self) {
        let sums = self.columns();
        let mut total = item.corpus_columns();
        total.iter_mut().zip(sums).for_each(|(t, s)| *t += s);
        *self = Self::from_columns(&total);
    }

    /// Whether every word is matched, in one chunk.
    fn is_one_chunk(&self) -> bool {
        self.matched(0) == self.len[0] && self.matched(1) == self.len[1] && self.chunks == 1.0
    }

    fn matched(&self, side: usize) -> f64 {
        self.content[side].iter().chain(&self.function[side]).sum()
    }

    /// [`MeteorStats::columns`] as a contribution to corpus sums; see [`MeteorStats::add`].
    pub(crate) fn corpus_columns(&self) -> [f64; Self::WIDTH] {
        let mut item = *self;
        if self.is_one_chunk() {
            item.chunks = 0.0;
        }
        item.columns()
    }

    fn columns(&self) -> [f64; Self::WIDTH] {
        let mut out = [0.0; Self::WIDTH];
        let lens = self.len.iter().chain(&self.function_len);
        let matches = self.content.iter().chain(&self.function).flatten();
        let all = lens.chain(matches).chain([&self.chunks]);
        out.iter_mut().zip(all).for_each(|(o, v)| *o = *v);
        out
    }

    /// Inverse of [`MeteorStats::columns`].
    pub(crate) fn from_columns(c: &[f64; Self::WIDTH]) -> Self {
        let module_row = |start: usize| std::array::from_fn(|i| c[start + i]);
        Self {
            len: [c[0], c[1]],
            function_len: [c[2], c[3]],
            content: [module_row(4), module_row(8)],
            function: [module_row(12), module_row(16)],
            chunks: c[20],
        }
    }
}

/// A scorer that caches look-ups of words.
pub struct Meteor<'a> {
    resources: &'a Resources,
    words: HashMap<String, Word>,
    stems: HashMap<String, u32>,
}

impl<'a> Meteor<'a> {
    /// Creates a scorer.
    pub fn new(resources: &'a Resources) -> Self {
        Self {
            resources,
            words: HashMap::new(),
            stems: HashMap::new(),
        }
    }

    /// Statistics of a candidate with its best-scoring reference, the first one on a tie. All zero without references.
    pub fn stats<S: AsRef<str>>(&mut self, candidate: &str, references: &[S]) -> MeteorStats {
        let candidate = normalise::tokens(candidate, self.resources);
        let mut best: Option<(f64, MeteorStats)> = None;
        for reference in references {
            let reference = normalise::tokens(reference.as_ref(), self.resources);
            let stats = self.pair(&candidate, &reference);
            let score = stats.score();
            if best.is_none_or(|(b, _)| score > b) {
                best = Some((score, stats));
            }
        }
        best.map_or_else(MeteorStats::default, |(_, stats)| stats)
    }

    fn pair(&mut self, candidate: &[String], reference: &[String]) -> MeteorStats {
        for word in candidate.iter().chain(reference) {
            self.look_up(word);
        }
        let words = |tokens: &[String]| -> Vec<&Word> {
            tokens.iter().filter_map(|t| self.words.get(t)).collect()
        };
        let sides = [words(candidate), words(reference)];
        let paraphrases = self.resources.paraphrases.as_ref();
        let alignment = align::align(&sides[0], &sides[1], self.resources.synonyms, paraphrases);
        let n_function = |side: &[&Word]| side.iter().filter(|w| w.is_function).count() as f64;
        let mut stats = MeteorStats {
            len: [0, 1].map(|i: usize| sides[i].len() as f64),
            function_len: [0, 1].map(|i: usize| n_function(&sides[i])),
            chunks: alignment.chunks as f64,
            ..Default::default()
        };
        for m in &alignment.matches {
            for (side, (start, n)) in [m.candidate, m.reference].into_iter().enumerate() {
                for word in &sides[side][start..start + n] {
                    let row = if word.is_function {
                        &mut stats.function
                    } else {
                        &mut stats.content
                    };
                    row[side][m.module] += 1.0;
                }
            }
        }
        stats
    }

    fn look_up(&mut self, word: &str) {
        if self.words.contains_key(word) {
            return;
        }
        let n_stems = self.stems.len() as u32;
        let entry = Word {
            number: self.words.len() as u32,
            stem: *self.stems.entry(stem::porter2(word)).or_insert(n_stems),
            synsets: if self.resources.synonyms {
                WordNet::get().meteor_synsets(word)
            } else {
                Vec::new()
            },
            paraphrase_word: self
                .resources
                .paraphrases
                .as_ref()
                .and_then(|p| p.word(word)),
            is_function: self.resources.function_words.contains(word),
        };
        self.words.insert(word.to_string(), entry);
    }
}
