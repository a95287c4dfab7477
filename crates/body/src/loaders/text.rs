//! Tokenizer for words and numbers of text formats, with line numbers.

use crate::error::{MotionError, excerpt};

/// Maximum magnitude of any coordinate (file units) or angle (degrees) in a text format. This is a
/// kilometre in millimetres; beyond it, f32 rounding would be visible in the motion.
pub(crate) const MAX_MAGNITUDE: f64 = 1e6;

/// A cursor over bytes that are not required to be UTF-8.
pub(crate) struct Words<'a> {
    file: &'a str,
    bytes: &'a [u8],
    at: usize,
    /// Line of the next word, from 1.
    pub line: usize,
}

impl<'a> Words<'a> {
    pub(super) fn new(file: &'a str, bytes: &'a [u8]) -> Self {
        let at = if bytes.starts_with(b"\xef\xbb\xbf") {
            3
        } else {
            0
        };
        Self {
            file,
            bytes,
            at,
            line: 1,
        }
    }

    /// Number of bytes not yet read.
    pub(super) fn remaining(&self) -> usize {
        self.bytes.len() - self.at
    }

    /// Next word, if any.
    pub(super) fn next(&mut self) -> Option<&'a [u8]> {
        while let Some(byte) = self.bytes.get(self.at) {
            if !byte.is_ascii_whitespace() && *byte != 0 {
                break;
            }
            self.line += usize::from(*byte == b'\n');
            self.at += 1;
        }
        let start = self.at;
        while self
            .bytes
            .get(self.at)
            .is_some_and(|b| !b.is_ascii_whitespace() && *b != 0)
        {
            self.at += 1;
        }
        (self.at > start).then(|| &self.bytes[start..self.at])
    }

    /// Next word without consuming it.
    pub(super) fn peek(&mut self) -> Option<&'a [u8]> {
        let before = (self.at, self.line);
        let word = self.next();
        (self.at, self.line) = before;
        word
    }

    /// Rest of the current line, trimmed; the line break is not consumed.
    pub(super) fn rest_of_line(&mut self) -> String {
        let start = self.at;
        while self
            .bytes
            .get(self.at)
            .is_some_and(|b| *b != b'\n' && *b != b'\r')
        {
            self.at += 1;
        }
        String::from_utf8_lossy(&self.bytes[start..self.at])
            .trim()
            .to_owned()
    }

    /// Next line, trimmed, or `None` at the end.
    pub(super) fn next_line(&mut self) -> Option<&'a [u8]> {
        if self.at >= self.bytes.len() {
            return None;
        }
        let start = self.at;
        while self.bytes.get(self.at).is_some_and(|b| *b != b'\n') {
            self.at += 1;
        }
        let line = self.bytes[start..self.at].trim_ascii();
        self.at = (self.at + 1).min(self.bytes.len());
        self.line += 1;
        Some(line)
    }

    /// Consumes the next word, which must equal `word` regardless of case.
    pub(super) fn expect(&mut self, word: &str) -> Result<(), MotionError> {
        match self.next() {
            Some(found) if found.eq_ignore_ascii_case(word.as_bytes()) => Ok(()),
            found => Err(self.wrong(format!("`{word}`"), found)),
        }
    }

    /// Reads the next word as a finite number within the limits.
    pub(super) fn number(&mut self, what: &str) -> Result<f64, MotionError> {
        let word = self.next();
        number(self.file, self.line, what, word)
    }

    /// Reads the next word as a count.
    pub(super) fn count(&mut self, what: &str) -> Result<usize, MotionError> {
        let word = self.next();
        word.and_then(|w| std::str::from_utf8(w).ok())
            .and_then(|w| w.parse().ok())
            .ok_or_else(|| self.wrong(what.to_owned(), word))
    }

    /// Creates an error at the current line.
    pub(super) fn wrong(&self, expected: String, found: Option<&[u8]>) -> MotionError {
        wrong(self.file, self.line, expected, found)
    }
}

/// Parses a word as a finite number within the limits.
pub(crate) fn number(
    file: &str,
    line: usize,
    what: &str,
    word: Option<&[u8]>,
) -> Result<f64, MotionError> {
    let value: f64 = word
        .and_then(|w| std::str::from_utf8(w).ok())
        .and_then(|w| w.parse().ok())
        .ok_or_else(|| wrong(file, line, what.to_owned(), word))?;
    if value.is_finite() && value.abs() <= MAX_MAGNITUDE {
        Ok(value)
    } else {
        Err(MotionError::NotFinite {
            file: file.into(),
            place: format!("line {line}, {what}"),
            value,
        })
    }
}

/// Creates an error of a text format.
pub(crate) fn wrong(
    file: &str,
    line: usize,
    expected: String,
    found: Option<&[u8]>,
) -> MotionError {
    let found = found.map_or("the end of the file".into(), |w| {
        excerpt(&String::from_utf8_lossy(&w[..w.len().min(80)]))
    });
    MotionError::Text {
        file: file.into(),
        line,
        expected,
        found,
    }
}
