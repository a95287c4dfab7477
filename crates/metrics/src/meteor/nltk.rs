//! METEOR as nltk computes it. Its parameters, aligner and corpus rule differ from those of METEOR 1.5.
//!
//! Lavie and Agarwal 2007 with nltk's choices: greedy matches from the last word backwards, Porter's
//! stemmer with nltk's extensions, and WordNet look-ups of the *stems* that were not matched.

use crate::{stem, wordnet::WordNet};

const ALPHA: f64 = 0.9;
const BETA: f64 = 3.0;
const GAMMA: f64 = 0.5;

/// Positions and words that have not been matched yet.
type Left = Vec<(usize, String)>;

/// Maximum score over references, 0..1. The words are already tokenised; they are compared in lower case.
pub fn meteor_nltk<S: AsRef<str>>(candidate: &[S], references: &[Vec<S>]) -> f64 {
    references
        .iter()
        .map(|r| single(candidate, r))
        .fold(0.0, f64::max)
}

fn single<S: AsRef<str>>(candidate: &[S], reference: &[S]) -> f64 {
    let lower = |words: &[S]| -> Left {
        let words = words.iter().map(|w| w.as_ref().to_lowercase());
        words.enumerate().collect()
    };
    let (mut c, mut r) = (lower(candidate), lower(reference));
    let mut matches = Vec::new();
    take_matches(&mut c, &mut r, &mut matches, |c, r| c == r);
    for (_, word) in c.iter_mut().chain(&mut r) {
        *word = stem::porter(word);
    }
    take_matches(&mut c, &mut r, &mut matches, |c, r| c == r);
    let mut asked: Option<(String, Vec<&'static str>)> = None;
    take_matches(&mut c, &mut r, &mut matches, |c, r| {
        if asked.as_ref().is_none_or(|(word, _)| word != c) {
            asked = Some((c.to_string(), WordNet::get().nltk_synonyms(c)));
        }
        let synonyms = asked.iter().flat_map(|(_, synonyms)| synonyms);
        c == r || synonyms.copied().any(|s| s == r)
    });
    matches.sort_unstable();
    let n = matches.len() as f64;
    if matches.is_empty() {
        return 0.0;
    }
    let precision = n / candidate.len() as f64;
    let recall = n / reference.len() as f64;
    let f_mean = precision * recall / (ALPHA * precision + (1.0 - ALPHA) * recall);
    let breaks = matches
        .windows(2)
        .filter(|w| w[1] != (w[0].0 + 1, w[0].1 + 1))
        .count();
    let fragmentation = (breaks + 1) as f64 / n;
    (1.0 - GAMMA * fragmentation.powf(BETA)) * f_mean
}

/// Matches from the last candidate word backwards. Each word takes the last unmatched reference word that fits.
fn take_matches(
    c: &mut Left,
    r: &mut Left,
    matches: &mut Vec<(usize, usize)>,
    mut fits: impl FnMut(&str, &str) -> bool,
) {
    for i in (0..c.len()).rev() {
        if let Some(j) = r.iter().rposition(|(_, word)| fits(&c[i].1, word)) {
            matches.push((c.remove(i).0, r.remove(j).0));
        }
    }
}
