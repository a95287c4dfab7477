//! Porter's stemmer (Porter 1980) with the changes of nltk's default mode, `NLTK_EXTENSIONS`.

use super::{ends_with, replace_end};

/// Words for which the rules would give a wrong stem, and their stems.
const IRREGULAR: [(&str, &str); 16] = [
    ("sky", "sky"),
    ("skies", "sky"),
    ("dying", "die"),
    ("lying", "lie"),
    ("tying", "tie"),
    ("news", "news"),
    ("innings", "inning"),
    ("inning", "inning"),
    ("outings", "outing"),
    ("outing", "outing"),
    ("cannings", "canning"),
    ("canning", "canning"),
    ("howe", "howe"),
    ("proceed", "proceed"),
    ("exceed", "exceed"),
    ("succeed", "succeed"),
];

/// Suffixes and replacements of a step. The first matching suffix decides.
type Rules = &'static [(&'static str, &'static str)];

const STEP_2: Rules = &[
    ("ational", "ate"),
    ("tional", "tion"),
    ("enci", "ence"),
    ("anci", "ance"),
    ("izer", "ize"),
    ("bli", "ble"),
    ("alli", "al"),
    ("entli", "ent"),
    ("eli", "e"),
    ("ousli", "ous"),
    ("ization", "ize"),
    ("ation", "ate"),
    ("ator", "ate"),
    ("alism", "al"),
    ("iveness", "ive"),
    ("fulness", "ful"),
    ("ousness", "ous"),
    ("aliti", "al"),
    ("iviti", "ive"),
    ("biliti", "ble"),
    ("fulli", "ful"),
    ("logi", "log"),
];
const STEP_3: Rules = &[
    ("icate", "ic"),
    ("ative", ""),
    ("alize", "al"),
    ("iciti", "ic"),
    ("ical", "ic"),
    ("ful", ""),
    ("ness", ""),
];
const STEP_4: [&str; 19] = [
    "al", "ance", "ence", "er", "ic", "able", "ible", "ant", "ement", "ment", "ent", "ion", "ou",
    "ism", "ate", "iti", "ous", "ive", "ize",
];

/// Stem of a word, in lower case.
pub fn porter(word: &str) -> String {
    let word = word.to_lowercase();
    if let Some((_, stem)) = IRREGULAR.iter().find(|(form, _)| *form == word) {
        return (*stem).to_string();
    }
    let mut w: Vec<char> = word.chars().collect();
    if w.len() <= 2 {
        return word;
    }
    step_1a(&mut w);
    step_1b(&mut w);
    // y becomes i after a consonant, but not in words of two letters (an extension of nltk).
    if let Some((&'y', stem)) = w.split_last()
        && stem.len() > 1
        && is_consonant(stem, stem.len() - 1)
    {
        replace_end(&mut w, 1, "i");
    }
    step_2(&mut w);
    by_rules(&mut w, STEP_3);
    step_4(&mut w);
    if ends_with(&w, "e") {
        let stem = &w[..w.len() - 1];
        let m = measure(stem);
        if m > 1 || m == 1 && !ends_cvc(stem) {
            w.pop();
        }
    }
    if ends_with(&w, "ll") && measure(&w[..w.len() - 1]) > 1 {
        w.pop();
    }
    w.into_iter().collect()
}

fn step_1a(w: &mut Vec<char>) {
    if ends_with(w, "ies") {
        // dies, lies and ties keep their e (an extension of nltk).
        let short = w.len() == 4;
        replace_end(w, 3, if short { "ie" } else { "i" });
    } else if ends_with(w, "sses") {
        replace_end(w, 2, "");
    } else if ends_with(w, "s") && !ends_with(w, "ss") {
        w.pop();
    }
}

fn step_1b(w: &mut Vec<char>) {
    if ends_with(w, "ied") {
        let short = w.len() == 4;
        replace_end(w, 3, if short { "ie" } else { "i" });
        return;
    }
    if ends_with(w, "eed") {
        if measure(&w[..w.len() - 3]) > 0 {
            w.pop();
        }
        return;
    }
    let cut = ["ed", "ing"]
        .iter()
        .find(|s| ends_with(w, s) && (0..w.len() - s.len()).any(|i| !is_consonant(w, i)));
    let Some(suffix) = cut else { return };
    replace_end(w, suffix.len(), "");
    if ["at", "bl", "iz"].iter().any(|s| ends_with(w, s)) {
        w.push('e');
    } else if let [.., a, b] = w[..]
        && a == b
        && is_consonant(w, w.len() - 1)
    {
        if !['l', 's', 'z'].contains(&b) {
            w.pop();
        }
    } else if measure(w) == 1 && ends_cvc(w) {
        w.push('e');
    }
}

fn step_2(w: &mut Vec<char>) {
    // radicalli becomes radical, and the step is applied to the result again (an extension of nltk).
    while ends_with(w, "alli") && measure(&w[..w.len() - 4]) > 0 {
        replace_end(w, 2, "");
    }
    if ends_with(w, "logi") {
        // The l counts as part of the stem here.
        if measure(&w[..w.len() - 3]) > 0 {
            w.pop();
        }
        return;
    }
    by_rules(w, STEP_2);
}

fn step_4(w: &mut Vec<char>) {
    let Some(suffix) = STEP_4.iter().find(|s| ends_with(w, s)) else {
        return;
    };
    let stem = &w[..w.len() - suffix.len()];
    let fits = *suffix != "ion" || matches!(stem.last(), Some('s' | 't'));
    if measure(stem) > 1 && fits {
        replace_end(w, suffix.len(), "");
    }
}

/// Applies the first rule whose suffix fits, if there is a vowel-consonant pair before the suffix.
fn by_rules(w: &mut Vec<char>, rules: Rules) {
    if let Some((suffix, replacement)) = rules.iter().find(|(s, _)| ends_with(w, s))
        && measure(&w[..w.len() - suffix.len()]) > 0
    {
        replace_end(w, suffix.len(), replacement);
    }
}

/// y is a consonant at the start of a word and after a vowel.
fn is_consonant(w: &[char], i: usize) -> bool {
    // In a run of y, consonants and vowels alternate, beginning with the class of the first one.
    let run = w[..=i].iter().rev().take_while(|c| **c == 'y').count();
    if run == 0 {
        return !"aeiou".contains(w[i]);
    }
    let first = i + 1 - run;
    let first_is_consonant = first == 0 || "aeiou".contains(w[first - 1]);
    first_is_consonant == (run % 2 == 1)
}

/// Number of vowel-consonant pairs.
fn measure(w: &[char]) -> usize {
    (1..w.len())
        .filter(|&i| !is_consonant(w, i - 1) && is_consonant(w, i))
        .count()
}

/// Whether a word ends in consonant, vowel, and consonant other than w, x, y. A word of one vowel and one consonant
/// counts too (an extension of nltk).
fn ends_cvc(w: &[char]) -> bool {
    let n = w.len();
    if n == 2 {
        return !is_consonant(w, 0) && is_consonant(w, 1);
    }
    n >= 3
        && is_consonant(w, n - 3)
        && !is_consonant(w, n - 2)
        && is_consonant(w, n - 1)
        && !['w', 'x', 'y'].contains(&w[n - 1])
}
