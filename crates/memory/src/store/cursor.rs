//! Places in lists that are read page by page.

use std::fmt;
use std::str::FromStr;

use super::limits::MAX_TIME_MS;
use crate::error::StoreError;

/// A place in a list that is sorted by time: the row after which the next page begins. Its text form is
/// `TIME_MS-ID`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cursor {
    /// Time of the row, milliseconds since 1970 in UTC.
    pub at_ms: i64,
    /// Number of the row.
    pub id: i64,
}

impl fmt::Display for Cursor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-{}", self.at_ms, self.id)
    }
}

impl FromStr for Cursor {
    type Err = StoreError;

    fn from_str(text: &str) -> Result<Self, StoreError> {
        let parsed = text
            .split_once('-')
            .and_then(|(at_ms, id)| Some((at_ms.parse().ok()?, id.parse().ok()?)));
        match parsed {
            Some((at_ms @ 0..=MAX_TIME_MS, id @ 0..)) => Ok(Self { at_ms, id }),
            _ => Err(StoreError::invalid("before", "TIME_MS-ID", text)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cursors_have_a_text_form() {
        let cursor = Cursor {
            at_ms: 1_763_900_000_123,
            id: 42,
        };
        assert_eq!(cursor.to_string(), "1763900000123-42");
        assert_eq!("1763900000123-42".parse::<Cursor>().unwrap(), cursor);
        for text in [
            "",
            "-",
            "1",
            "1-",
            "-1-2",
            "1--2",
            "x-1",
            "99999999999999999999-1",
            "1-2-3",
        ] {
            assert!(text.parse::<Cursor>().is_err(), "{text}");
        }
    }
}
