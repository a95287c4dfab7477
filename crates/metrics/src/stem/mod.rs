//! Two stemmers of English. METEOR 1.5 and ROUGE compare stems, and each uses its own stemmer.

mod porter;
mod porter2;

pub use porter::porter;
pub use porter2::porter2;

/// Whether `word` ends in `suffix`.
fn ends_with(word: &[char], suffix: &str) -> bool {
    let n = suffix.chars().count();
    word.len() >= n && word[word.len() - n..].iter().copied().eq(suffix.chars())
}

/// Replaces the last `n` characters by `replacement`.
fn replace_end(word: &mut Vec<char>, n: usize, replacement: &str) {
    word.truncate(word.len().saturating_sub(n));
    word.extend(replacement.chars());
}
