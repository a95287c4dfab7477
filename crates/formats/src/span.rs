//! Positions in radar files, so that a finding can refer to the value that it concerns.

use std::collections::BTreeMap;
use std::ops::Range;

/// A value in a radar file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Span {
    /// Line, from 1.
    pub line: usize,
    /// Columns, from 1, end exclusive, in characters.
    pub columns: Range<usize>,
    /// Which value this is, such as `profileCfg ramp end, us`.
    pub what: String,
}

/// Positions at which a file sets values: by field of [`radarllm_base::RadarConfig`], and by the names that the reader
/// of the format documents.
pub type Places = BTreeMap<&'static str, Span>;

impl Span {
    /// Returns the position of a byte range in a text. The range is cut at the end of the text and at the end of its
    /// first line.
    pub(crate) fn of_bytes(text: &str, bytes: Range<usize>, what: String) -> Self {
        let floor = |mut i: usize| {
            i = i.min(text.len());
            while !text.is_char_boundary(i) {
                i -= 1;
            }
            i
        };
        let (start, end) = (floor(bytes.start), floor(bytes.end));
        let before = &text[..start];
        let line_start = before.rfind('\n').map_or(0, |i| i + 1);
        let marked = text[start..end.max(start)].lines().next().unwrap_or("");
        let column = before[line_start..].chars().count() + 1;
        Self {
            line: before.matches('\n').count() + 1,
            columns: column..column + marked.chars().count().max(1),
            what,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_become_lines_and_character_columns() {
        let text = "a = 1\n\u{b5}s = 22\n";
        let of = |range| {
            let span = Span::of_bytes(text, range, String::new());
            (span.line, span.columns)
        };
        assert_eq!(of(4..5), (1, 5..6));
        // The micro sign takes two bytes and one column.
        assert_eq!(of(12..14), (2, 6..8));
        // Inside a character, across the end of a line, and beyond the text.
        assert_eq!(of(7..14), (2, 1..8));
        assert_eq!(of(4..9), (1, 5..6));
        assert_eq!(of(90..99), (3, 1..2));
    }
}
