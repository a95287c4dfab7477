//! The secret of those who may ask.

use std::fmt;

use super::HttpError;

/// Shortest token, bytes.
const MIN_BYTES: usize = 16;
/// Longest token, bytes.
const MAX_BYTES: usize = 256;

/// A secret. It is never printed, and comparing it takes the same time for all that is not it.
#[derive(Clone)]
pub struct Token {
    text: String,
    hash: blake3::Hash,
}

impl Token {
    /// A token from the text of a file; white space around it is ignored. `openssl rand -hex 16` writes a good one.
    ///
    /// # Errors
    /// A text with other characters than letters, digits and `-._~`, or one of a length other than 16 to 256.
    pub fn new(text: &str) -> Result<Self, HttpError> {
        let text = text.trim();
        let is_safe = |b: u8| b.is_ascii_alphanumeric() || b"-._~".contains(&b);
        let found = match text.len() {
            0..MIN_BYTES => "too few characters",
            MIN_BYTES..=MAX_BYTES if text.bytes().all(is_safe) => {
                return Ok(Self {
                    text: text.into(),
                    hash: blake3::hash(text.as_bytes()),
                });
            }
            MIN_BYTES..=MAX_BYTES => "other characters",
            _ => "too many characters",
        };
        Err(HttpError::Token { found })
    }

    /// Whether a text is the token. Hashes are compared, in constant time.
    pub(super) fn is(&self, text: &str) -> bool {
        blake3::hash(text.as_bytes()) == self.hash
    }

    /// The token, for the cookie.
    pub(super) fn reveal(&self) -> &str {
        &self.text
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(..)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_are_long_plain_and_never_printed() {
        let token = Token::new(" 0123456789abcdef\n").unwrap();
        assert!(token.is("0123456789abcdef"));
        for other in [
            "",
            "0123456789abcdeF",
            "0123456789abcdef0",
            "0123456789abcde",
        ] {
            assert!(!token.is(other), "{other}");
        }
        assert_eq!(format!("{token:?}"), "Token(..)");
        for text in [
            "",
            "short",
            "0123456789 abcdef",
            "0123456789abcde;",
            &"a".repeat(257),
        ] {
            let error = Token::new(text).unwrap_err().to_string();
            assert!(text.is_empty() || !error.contains(text), "{error}");
        }
    }
}
