//! METEOR's paraphrase table: phrases of one to a few words that can replace each other.

use std::collections::HashMap;
use std::io::BufRead;

use super::TableError;

/// Maximum line length, phrase length and table size. METEOR's English table has lines below
/// 100 bytes, phrases of up to 7 words and 5.3 million pairs.
const MAX_LINE_BYTES: usize = 1000;
const MAX_PHRASE_WORDS: usize = 32;
const MAX_PAIRS: usize = 20_000_000;

/// Number of a word in the table.
type WordNumber = u32;

/// A loaded table.
#[derive(Clone, Debug, Default)]
pub struct Paraphrases {
    words: HashMap<String, WordNumber>,
    /// Tree of the left phrases: (node, word) to node. Node 0 is the root.
    steps: HashMap<(u32, WordNumber), u32>,
    /// Right phrases by the node where their left phrase ends, in the order of the file.
    emitted: HashMap<u32, Vec<std::ops::Range<usize>>>,
    /// Words of all right phrases.
    right: Vec<WordNumber>,
    n_pairs: usize,
}

impl Paraphrases {
    /// Reads the text of the table. Each pair takes three lines: a probability, which is not used, and two phrases of
    /// words separated by spaces.
    ///
    /// # Errors
    /// See [`TableError`], with the line.
    pub fn read(mut from: impl BufRead) -> Result<Self, TableError> {
        let mut this = Self::default();
        let mut line = Vec::new();
        let mut number = 0;
        let mut n_nodes = 1;
        loop {
            if !next_line(&mut from, &mut line, &mut number)? {
                return Ok(this);
            }
            let probability = std::str::from_utf8(&line)
                .ok()
                .and_then(|t| t.trim().parse::<f64>().ok());
            if probability.is_none() {
                return Err(TableError::new(number, "expected a probability"));
            }
            let mut phrases = [Vec::new(), Vec::new()];
            for phrase in &mut phrases {
                if !next_line(&mut from, &mut line, &mut number)? {
                    return Err(TableError::new(number, "the file ends within a pair"));
                }
                let text =
                    std::str::from_utf8(&line).map_err(|_| TableError::new(number, "not UTF-8"))?;
                for word in text.split_ascii_whitespace() {
                    phrase.push(this.number(word));
                }
                if phrase.is_empty() || phrase.len() > MAX_PHRASE_WORDS {
                    return Err(TableError::new(
                        number,
                        "expected a phrase of 1 to 32 words",
                    ));
                }
            }
            this.n_pairs += 1;
            if this.n_pairs > MAX_PAIRS {
                return Err(TableError::new(number, "more than 20 million pairs"));
            }
            let [left, right] = phrases;
            let mut node = 0;
            for word in left {
                node = *this.steps.entry((node, word)).or_insert_with(|| {
                    n_nodes += 1;
                    n_nodes - 1
                });
            }
            let start = this.right.len();
            this.right.extend(right);
            this.emitted
                .entry(node)
                .or_default()
                .push(start..this.right.len());
        }
    }

    fn number(&mut self, word: &str) -> WordNumber {
        if let Some(&n) = self.words.get(word) {
            return n;
        }
        // At most 20 million pairs of 32 words: below 2^32.
        let n = self.words.len() as WordNumber;
        self.words.insert(word.to_string(), n);
        n
    }

    /// Number of pairs in the table.
    pub fn len(&self) -> usize {
        self.n_pairs
    }

    /// Whether the table is empty.
    pub fn is_empty(&self) -> bool {
        self.n_pairs == 0
    }

    /// Number of a word, or `None` if no phrase contains it.
    pub(super) fn word(&self, word: &str) -> Option<WordNumber> {
        self.words.get(word).copied()
    }

    /// Calls `found` for every pair of a left phrase in `a` and its right phrase in `b`, in METEOR's order. Both are
    /// given as first word and length.
    pub(super) fn matches(
        &self,
        a: &[Option<WordNumber>],
        b: &[Option<WordNumber>],
        mut found: impl FnMut((usize, usize), (usize, usize)),
    ) {
        for start in 0..a.len() {
            let mut node = 0;
            for (i, word) in a[start..].iter().enumerate() {
                let step = word.and_then(|w| self.steps.get(&(node, w)));
                let Some(&next) = step else { break };
                node = next;
                for phrase in self.emitted.get(&node).into_iter().flatten() {
                    let phrase = &self.right[phrase.clone()];
                    for (at, window) in b.windows(phrase.len()).enumerate() {
                        if window.iter().zip(phrase).all(|(w, p)| *w == Some(*p)) {
                            found((start, i + 1), (at, phrase.len()));
                        }
                    }
                }
            }
        }
    }
}

/// Reads the next line without its end; false at the end of the file.
fn next_line(
    from: &mut impl BufRead,
    line: &mut Vec<u8>,
    number: &mut usize,
) -> Result<bool, TableError> {
    line.clear();
    *number += 1;
    let mut limited = std::io::Read::take(from, MAX_LINE_BYTES as u64 + 1);
    let n = limited
        .read_until(b'\n', line)
        .map_err(|e| TableError::new(*number, &e.to_string()))?;
    if n > MAX_LINE_BYTES {
        return Err(TableError::new(*number, "longer than 1000 bytes"));
    }
    Ok(n > 0)
}
