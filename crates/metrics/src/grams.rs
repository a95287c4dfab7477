//! Counted n-grams, n = 1..4, in a fixed order so that sums of floats never depend on hashing.

use std::collections::HashMap;

/// Up to four word numbers, padded with [`NONE`].
pub(crate) type Gram = [u32; 4];
const NONE: u32 = u32::MAX;

/// Numbers words in order of first appearance.
#[derive(Default)]
pub(crate) struct Vocabulary {
    numbers: HashMap<String, u32>,
}

impl Vocabulary {
    pub(crate) fn number(&mut self, word: &str) -> u32 {
        if let Some(&n) = self.numbers.get(word) {
            return n;
        }
        // Memory is exhausted long before there are 2^32 - 1 distinct words, so that the cast cannot wrap.
        let n = self.numbers.len() as u32;
        self.numbers.insert(word.to_string(), n);
        n
    }

    /// N-grams of a text that is split at white space.
    pub(crate) fn one(&mut self, text: &str) -> Grams {
        Grams::of(&self.numbers(crate::tokens::words(text)))
    }

    /// N-grams of several texts.
    pub(crate) fn grams(&mut self, texts: &[String]) -> Vec<Grams> {
        texts.iter().map(|t| self.one(t)).collect()
    }

    pub(crate) fn numbers<'a>(&mut self, words: impl Iterator<Item = &'a str>) -> Vec<u32> {
        words.map(|w| self.number(w)).collect()
    }
}

/// N-grams of one sentence with their counts.
#[derive(Clone, Debug, Default)]
pub(crate) struct Grams {
    /// Words.
    pub len: usize,
    /// Per n - 1: (n-gram, count), sorted by n-gram.
    pub counts: [Vec<(Gram, u32)>; 4],
}

impl Grams {
    pub(crate) fn of(words: &[u32]) -> Self {
        let counts = std::array::from_fn(|i| {
            let mut grams: Vec<Gram> = words
                .windows(i + 1)
                .map(|w| std::array::from_fn(|j| w.get(j).copied().unwrap_or(NONE)))
                .collect();
            grams.sort_unstable();
            let mut counted: Vec<(Gram, u32)> = Vec::new();
            for gram in grams {
                match counted.last_mut() {
                    Some((last, count)) if *last == gram => *count += 1,
                    _ => counted.push((gram, 1)),
                }
            }
            counted
        });
        Self {
            len: words.len(),
            counts,
        }
    }

    /// Number of n-grams for n = i + 1.
    pub(crate) fn total(&self, i: usize) -> u32 {
        (self.len.saturating_sub(i)) as u32
    }
}

/// Calls `both` for every n-gram that occurs in both of two sorted lists.
pub(crate) fn intersect<A: Copy, B: Copy>(
    a: &[(Gram, A)],
    b: &[(Gram, B)],
    mut both: impl FnMut(Gram, A, B),
) {
    let (mut i, mut j) = (0, 0);
    while let (Some(&(ga, va)), Some(&(gb, vb))) = (a.get(i), b.get(j)) {
        match ga.cmp(&gb) {
            std::cmp::Ordering::Less => i += 1,
            std::cmp::Ordering::Greater => j += 1,
            std::cmp::Ordering::Equal => {
                both(ga, va, vb);
                i += 1;
                j += 1;
            }
        }
    }
}
