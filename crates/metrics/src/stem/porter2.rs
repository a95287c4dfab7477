//! Snowball's "english" stemmer (Porter2) in its form of 2002 to 2015, which METEOR 1.5 uses.
//!
//! Rules: snowballstem.org, "The English (Porter2) stemming algorithm".

use super::{ends_with, replace_end};

const IRREGULAR: [(&str, &str); 18] = [
    ("skis", "ski"),
    ("skies", "sky"),
    ("dying", "die"),
    ("lying", "lie"),
    ("tying", "tie"),
    ("idly", "idl"),
    ("gently", "gentl"),
    ("ugly", "ugli"),
    ("early", "earli"),
    ("only", "onli"),
    ("singly", "singl"),
    ("sky", "sky"),
    ("news", "news"),
    ("howe", "howe"),
    ("atlas", "atlas"),
    ("cosmos", "cosmos"),
    ("bias", "bias"),
    ("andes", "andes"),
];
/// Words that are left as they are after step 1a.
const INVARIANT: [&str; 8] = [
    "inning", "outing", "canning", "herring", "earring", "proceed", "exceed", "succeed",
];
/// Suffixes and replacements. The longest matching suffix decides and must lie in R1. `None` marks a suffix with a rule
/// of its own.
const STEP_2: [(&str, Option<&str>); 24] = [
    ("ization", Some("ize")),
    ("ational", Some("ate")),
    ("fulness", Some("ful")),
    ("ousness", Some("ous")),
    ("iveness", Some("ive")),
    ("tional", Some("tion")),
    ("biliti", Some("ble")),
    ("lessli", Some("less")),
    ("entli", Some("ent")),
    ("ation", Some("ate")),
    ("alism", Some("al")),
    ("aliti", Some("al")),
    ("ousli", Some("ous")),
    ("iviti", Some("ive")),
    ("fulli", Some("ful")),
    ("enci", Some("ence")),
    ("anci", Some("ance")),
    ("abli", Some("able")),
    ("izer", Some("ize")),
    ("ator", Some("ate")),
    ("alli", Some("al")),
    ("bli", Some("ble")),
    ("ogi", None),
    ("li", None),
];
const STEP_3: [(&str, &str); 9] = [
    ("ational", "ate"),
    ("tional", "tion"),
    ("alize", "al"),
    ("icate", "ic"),
    ("iciti", "ic"),
    ("ative", ""),
    ("ical", "ic"),
    ("ness", ""),
    ("ful", ""),
];
const STEP_4: [&str; 18] = [
    "ement", "ance", "ence", "able", "ible", "ment", "ant", "ent", "ism", "ate", "iti", "ous",
    "ive", "ize", "ion", "al", "er", "ic",
];

/// Stem of a word in lower case.
pub fn porter2(word: &str) -> String {
    if let Some((_, stem)) = IRREGULAR.iter().find(|(form, _)| *form == word) {
        return (*stem).to_string();
    }
    let mut w: Vec<char> = word.chars().collect();
    if w.len() <= 2 {
        return word.to_string();
    }
    if w[0] == '\'' {
        w.remove(0);
    }
    // A y that is a consonant is written as Y until the end.
    for i in 0..w.len() {
        if w[i] == 'y' && (i == 0 || is_vowel(w[i - 1])) {
            w[i] = 'Y';
        }
    }
    let (r1, r2) = regions(&w);
    if let Some(suffix) = ["'s'", "'s", "'"].iter().find(|s| ends_with(&w, s)) {
        replace_end(&mut w, suffix.len(), "");
    }
    step_1a(&mut w);
    let form: String = w.iter().collect();
    if INVARIANT.contains(&form.as_str()) {
        return form;
    }
    step_1b(&mut w, r1);
    if let [.., before, 'y' | 'Y'] = w[..]
        && w.len() > 2
        && !is_vowel(before)
    {
        replace_end(&mut w, 1, "i");
    }
    step_2(&mut w, r1);
    step_3(&mut w, r1, r2);
    step_4(&mut w, r2);
    match w.last() {
        Some('e') => {
            let stem = &w[..w.len() - 1];
            if stem.len() >= r2 || stem.len() >= r1 && !ends_short(stem) {
                w.pop();
            }
        }
        Some('l') if w.len() > r2 && ends_with(&w, "ll") => {
            w.pop();
        }
        _ => {}
    }
    w.into_iter()
        .map(|c| if c == 'Y' { 'y' } else { c })
        .collect()
}

fn is_vowel(c: char) -> bool {
    "aeiouy".contains(c)
}

/// Starts of R1 and R2. R1 is the region after the first non-vowel that follows a vowel. R2 is determined in the same
/// way within R1.
fn regions(w: &[char]) -> (usize, usize) {
    let after = |from: usize| {
        let pair = (from + 1..w.len()).find(|&i| is_vowel(w[i - 1]) && !is_vowel(w[i]));
        pair.map_or(w.len(), |i| i + 1)
    };
    let prefix = ["gener", "commun", "arsen"]
        .iter()
        .find(|p| p.chars().eq(w.iter().copied().take(p.len())));
    let r1 = prefix.map_or_else(|| after(0), |p| p.len());
    (r1, after(r1))
}

/// Whether the word ends in a short syllable (non-vowel, vowel, non-vowel other than w, x, Y), or consists of a vowel
/// and a non-vowel.
fn ends_short(w: &[char]) -> bool {
    match w {
        [a, b] => is_vowel(*a) && !is_vowel(*b),
        [.., a, b, c] => {
            !is_vowel(*a) && is_vowel(*b) && !is_vowel(*c) && !['w', 'x', 'Y'].contains(c)
        }
        _ => false,
    }
}

fn step_1a(w: &mut Vec<char>) {
    if ends_with(w, "sses") {
        replace_end(w, 2, "");
    } else if ends_with(w, "ied") || ends_with(w, "ies") {
        let short = w.len() <= 4;
        replace_end(w, 3, if short { "ie" } else { "i" });
    } else if ends_with(w, "s") && !ends_with(w, "us") && !ends_with(w, "ss") {
        // A vowel directly before the s does not count, so that gas and this remain unchanged.
        let vowel_before = w.len() > 2 && w[..w.len() - 2].iter().copied().any(is_vowel);
        if vowel_before {
            w.pop();
        }
    }
}

fn step_1b(w: &mut Vec<char>, r1: usize) {
    let suffixes = ["eedly", "ingly", "edly", "eed", "ing", "ed"];
    let Some(suffix) = suffixes.iter().find(|s| ends_with(w, s)) else {
        return;
    };
    let stem_len = w.len() - suffix.len();
    if suffix.starts_with("ee") {
        if stem_len >= r1 {
            replace_end(w, suffix.len(), "ee");
        }
        return;
    }
    if !w[..stem_len].iter().copied().any(is_vowel) {
        return;
    }
    w.truncate(stem_len);
    if ["at", "bl", "iz"].iter().any(|s| ends_with(w, s)) {
        w.push('e');
    } else if let [.., a, b] = w[..]
        && a == b
        && "bdfgmnprt".contains(b)
    {
        w.pop();
    } else if w.len() == r1 && ends_short(w) {
        w.push('e');
    }
}

fn step_2(w: &mut Vec<char>, r1: usize) {
    let Some((suffix, replacement)) = STEP_2.iter().find(|(s, _)| ends_with(w, s)) else {
        return;
    };
    let stem_len = w.len() - suffix.len();
    if stem_len < r1 {
        return;
    }
    let before = stem_len.checked_sub(1).map(|i| w[i]);
    match (replacement, *suffix) {
        (Some(replacement), _) => replace_end(w, suffix.len(), replacement),
        (None, "ogi") if before == Some('l') => replace_end(w, 1, ""),
        (None, "li") if before.is_some_and(|c| "cdeghkmnrt".contains(c)) => replace_end(w, 2, ""),
        _ => {}
    }
}

fn step_3(w: &mut Vec<char>, r1: usize, r2: usize) {
    let Some((suffix, replacement)) = STEP_3.iter().find(|(s, _)| ends_with(w, s)) else {
        return;
    };
    let needed = if *suffix == "ative" { r2 } else { r1 };
    if w.len() - suffix.len() >= needed {
        replace_end(w, suffix.len(), replacement);
    }
}

fn step_4(w: &mut Vec<char>, r2: usize) {
    let Some(suffix) = STEP_4.iter().find(|s| ends_with(w, s)) else {
        return;
    };
    let stem = &w[..w.len() - suffix.len()];
    let fits = *suffix != "ion" || matches!(stem.last(), Some('s' | 't'));
    if stem.len() >= r2 && fits {
        replace_end(w, suffix.len(), "");
    }
}
