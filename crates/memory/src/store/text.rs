//! Words of a user to a full-text query.

/// Most words of a query. A caption has fewer.
pub(crate) const MAX_WORDS: usize = 32;
/// Longest word of a query, bytes; longer ones are cut.
const MAX_WORD_BYTES: usize = 64;

/// The FTS5 query for rows that have all words of a text, or `None` if the text has no word.
///
/// Each run of letters and digits becomes a quoted string. Operators, column filters, quotes and NUL bytes of the user
/// therefore never reach the grammar of FTS5.
pub(crate) fn fts_query(text: &str) -> Option<String> {
    let words = text
        .split(|c: char| !c.is_alphanumeric())
        .filter(|word| !word.is_empty())
        .take(MAX_WORDS);
    let mut query = String::new();
    for word in words {
        let end = word.floor_char_boundary(MAX_WORD_BYTES);
        query.push_str(if query.is_empty() { "\"" } else { " \"" });
        query.push_str(&word[..end]);
        query.push('"');
    }
    (!query.is_empty()).then_some(query)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_and_nothing_else_is_left() {
        for (text, expected) in [
            ("sits down", Some("\"sits\" \"down\"")),
            (
                "\"; DROP TABLE activity; --",
                Some("\"DROP\" \"TABLE\" \"activity\""),
            ),
            (
                "caption:fall* NOT ^(a)",
                Some("\"caption\" \"fall\" \"NOT\" \"a\""),
            ),
            ("NEAR(a b, 2)", Some("\"NEAR\" \"a\" \"b\" \"2\"")),
            ("nul\0byte", Some("\"nul\" \"byte\"")),
            ("Stürzt 跌倒", Some("\"Stürzt\" \"跌倒\"")),
            ("\"'*():^-+{}", None),
            ("", None),
        ] {
            assert_eq!(fts_query(text).as_deref(), expected, "{text}");
        }
    }

    #[test]
    fn long_texts_make_short_queries() {
        let query = fts_query(&"ä".repeat(1_000_000)).unwrap();
        assert_eq!(query.len(), 2 + MAX_WORD_BYTES);
        let query = fts_query(&"a ".repeat(1_000_000)).unwrap();
        assert_eq!(query.matches("\"a\"").count(), MAX_WORDS);
    }
}
