//! Tokenises text as METEOR 1.5 does with `-l en -norm`: punctuation is kept as separate tokens, `'s` and
//! `n't` keep their apostrophe, hyphens separate words, and everything is in lower case.
//!
//! The steps are in METEOR's order. Each step processes the text once without considering
//! characters that it has already replaced, which determines the result of cases like `,,,`.

use super::Resources;

/// Placeholder for a dot in a run of dots until tokenisation ends. It is a noncharacter, which text does not contain.
const RUN_DOT: char = '\u{10ffff}';

/// When an abbreviation keeps its dot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Abbreviation {
    Always,
    BeforeNumber,
}

/// Tokens of a sentence.
pub(super) fn tokens(text: &str, resources: &Resources) -> Vec<String> {
    let mut s: Vec<char> = vec![' '];
    for c in text.chars() {
        let stays = is_letter(c)
            || c.is_ascii_digit()
            || is_java_space(c)
            || ".'`,-\u{2018}\u{2019}".contains(c);
        if stays {
            s.push(c);
        } else {
            s.extend([' ', c, ' ']);
        }
    }
    s.push(' ');
    let s = split_dot_runs(&s);
    let not_digit = |c: char| !c.is_ascii_digit();
    let digit = |c: char| c.is_ascii_digit();
    let s = between(s, not_digit, ',', not_digit, " , ");
    let s = between(s, digit, ',', not_digit, " , ");
    let mut s = between(s, not_digit, ',', digit, " , ");
    for c in &mut s {
        if "`\u{2018}\u{2019}".contains(*c) {
            *c = '\'';
        }
    }
    let s = replace(s, &['\u{201c}'], " \" ");
    let s = replace(s, &['\u{201d}'], " \" ");
    let s = replace(s, &['\'', '\''], " \" ");
    let s = replace(s, &['\u{2013}'], "-");
    let s = replace(s, &['-', '-'], "-");
    let part = |c: char| is_letter(c) || digit(c);
    let s = between(s, |c| part(c) || c == '.', '-', part, " ");
    let not_letter = |c: char| !is_letter(c);
    let s = between(s, not_letter, '\'', not_letter, " ' ");
    let s = between(s, |c| not_letter(c) && not_digit(c), '\'', is_letter, " ' ");
    let s = between(s, is_letter, '\'', not_letter, " ' ");
    let s = between(s, is_letter, '\'', is_letter, " '");
    let s = between(s, digit, '\'', |c| c == 's', " '");

    let joined: String = s.into_iter().collect();
    let words: Vec<&str> = java_tokens(&joined).collect();
    let mut out = String::new();
    for (i, &word) in words.iter().enumerate() {
        final_dot(&mut out, word, words.get(i + 1).copied(), resources);
        out.push(' ');
    }
    let out = out
        .replace(RUN_DOT, ".")
        .replace(is_wide_space, " ")
        .to_lowercase();
    java_tokens(&out).map(str::to_string).collect()
}

/// Appends a word, and separates the dot at its end unless the dot belongs to the word.
fn final_dot(out: &mut String, word: &str, next: Option<&str>, resources: &Resources) {
    let Some(stem) = word.strip_suffix('.').filter(|s| !s.is_empty()) else {
        return out.push_str(word);
    };
    if stem.contains('.') && stem.chars().any(is_letter) {
        // p.m. becomes pm.
        return out.extend(word.chars().filter(|&c| c != '.'));
    }
    let abbreviation = resources.abbreviations.get(stem);
    let next_starts = |f: fn(&u8) -> bool| next.and_then(|n| n.as_bytes().first()).is_some_and(f);
    let stays = abbreviation == Some(&Abbreviation::Always)
        || next_starts(u8::is_ascii_lowercase)
        || abbreviation == Some(&Abbreviation::BeforeNumber) && next_starts(u8::is_ascii_digit);
    out.push_str(if stays { word } else { stem });
    if !stays {
        out.push_str(" .");
    }
}

/// Every run of two or more dots becomes a token of its own.
fn split_dot_runs(s: &[char]) -> Vec<char> {
    let mut out = Vec::with_capacity(s.len());
    let mut rest = s;
    while let Some(&c) = rest.first() {
        let run = rest.iter().take_while(|c| **c == '.').count();
        if run > 1 {
            out.push(' ');
            out.extend(std::iter::repeat_n(RUN_DOT, run));
            out.push(' ');
            rest = &rest[run..];
        } else {
            out.push(c);
            rest = &rest[1..];
        }
    }
    out
}

/// Replaces `middle` where both neighbours fit. The right neighbour of one match cannot be the left neighbour of
/// another.
fn between(
    s: Vec<char>,
    left: impl Fn(char) -> bool,
    middle: char,
    right: impl Fn(char) -> bool,
    replacement: &str,
) -> Vec<char> {
    if !s.contains(&middle) {
        return s;
    }
    let mut out = Vec::with_capacity(s.len() + 8);
    let mut i = 0;
    while i < s.len() {
        match s[i..] {
            [a, m, b, ..] if m == middle && left(a) && right(b) => {
                out.push(a);
                out.extend(replacement.chars());
                out.push(b);
                i += 3;
            }
            _ => {
                out.push(s[i]);
                i += 1;
            }
        }
    }
    out
}

fn replace(s: Vec<char>, from: &[char], to: &str) -> Vec<char> {
    if !s.windows(from.len()).any(|w| w == from) {
        return s;
    }
    let mut out = Vec::with_capacity(s.len() + 8);
    let mut rest = &s[..];
    while let Some(&c) = rest.first() {
        if rest.starts_with(from) {
            out.extend(to.chars());
            rest = &rest[from.len()..];
        } else {
            out.push(c);
            rest = &rest[1..];
        }
    }
    out
}

/// METEOR's letters: Latin, Cyrillic and phonetic extensions.
fn is_letter(c: char) -> bool {
    matches!(c,
        'A'..='Z' | 'a'..='z' | '\u{c0}'..='\u{d6}' | '\u{d8}'..='\u{f6}' | '\u{f8}'..='\u{17e}' |
        '\u{400}'..='\u{527}' | '\u{a640}'..='\u{a66e}' | '\u{a67e}'..='\u{a697}' | '\u{1d00}'..='\u{1d7f}')
}

/// Java's `\s`.
fn is_java_space(c: char) -> bool {
    matches!(c, ' ' | '\t' | '\n' | '\u{b}' | '\u{c}' | '\r')
}

/// Spaces that METEOR turns into the plain one.
fn is_wide_space(c: char) -> bool {
    matches!(
        c,
        '\u{2000}'..='\u{200a}' | '\u{202f}' | '\u{205f}' | '\u{3000}' | '\u{a0}'
    )
}

/// Java's `StringTokenizer`.
fn java_tokens(text: &str) -> impl Iterator<Item = &str> {
    text.split([' ', '\t', '\n', '\r', '\u{c}'])
        .filter(|w| !w.is_empty())
}
