//! Python literals, as in headers of npy files and in calibration files written with `repr`. They are parsed, never
//! evaluated.
//!
//! ```
//! use radarllm_files::literal::parse_literal;
//!
//! let literal = parse_literal("{'shape': (3, 2), 'fortran_order': False}")?;
//! assert_eq!(literal.get("shape").and_then(|s| s.items()).map(<[_]>::len), Some(2));
//! assert_eq!(parse_literal("[1, open('x')]").unwrap_err().byte, 4);
//! # Ok::<(), radarllm_files::literal::LiteralError>(())
//! ```

/// Maximum nesting depth. Headers of npy files need 3, calibration files 4.
const MAX_DEPTH: usize = 16;

/// A literal. Tuples and lists are not distinguished.
#[derive(Clone, Debug, PartialEq)]
pub enum Literal {
    /// `None`.
    None,
    /// `True` or `False`.
    Bool(bool),
    /// A number; integers are exact up to 2^53.
    Number(f64),
    /// A string. The only escapes supported are `\\`, `\'` and `\"`.
    Text(String),
    /// `[...]` or `(...)`.
    List(Vec<Literal>),
    /// `{...}` with keys of any kind, in order.
    Dict(Vec<(Literal, Literal)>),
}

impl Literal {
    /// The value of a text key of a dictionary; `None` for other literals and absent keys.
    pub fn get(&self, key: &str) -> Option<&Self> {
        let Self::Dict(entries) = self else {
            return None;
        };
        let is_key = |k: &Self| matches!(k, Self::Text(t) if t == key);
        entries.iter().find(|(k, _)| is_key(k)).map(|(_, v)| v)
    }

    /// The items of a list; `None` for other literals.
    pub fn items(&self) -> Option<&[Self]> {
        match self {
            Self::List(items) => Some(items),
            _ => None,
        }
    }

    /// The value of a number; `None` for other literals.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Number(v) => Some(*v),
            _ => None,
        }
    }

    /// The content of a string; `None` for other literals.
    pub fn text(&self) -> Option<&str> {
        match self {
            Self::Text(t) => Some(t),
            _ => None,
        }
    }
}

/// Reason why a text is not a literal.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("byte {byte}: expected {expected}")]
pub struct LiteralError {
    /// Byte offset, from 0.
    pub byte: usize,
    /// What the syntax requires at this position.
    pub expected: &'static str,
}

/// Parses a text that consists of one literal, apart from surrounding white space.
///
/// # Errors
/// [`LiteralError`] at the first unexpected byte; also for nesting deeper than 16.
pub fn parse_literal(text: &str) -> Result<Literal, LiteralError> {
    let mut parser = Parser {
        bytes: text.as_bytes(),
        at: 0,
    };
    let value = parser.value(0)?;
    parser.skip_space();
    if parser.at < parser.bytes.len() {
        return Err(parser.fail("the end"));
    }
    Ok(value)
}

struct Parser<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Parser<'_> {
    fn fail(&self, expected: &'static str) -> LiteralError {
        LiteralError {
            byte: self.at,
            expected,
        }
    }

    fn peek(&self) -> Option<u8> {
        self.bytes.get(self.at).copied()
    }

    fn skip_space(&mut self) {
        while self.peek().is_some_and(|b| b.is_ascii_whitespace()) {
            self.at += 1;
        }
    }

    fn take(&mut self, byte: u8) -> bool {
        let found = self.peek() == Some(byte);
        self.at += usize::from(found);
        found
    }

    fn value(&mut self, depth: usize) -> Result<Literal, LiteralError> {
        if depth > MAX_DEPTH {
            return Err(self.fail("less nesting"));
        }
        self.skip_space();
        match self.peek() {
            Some(b'[') => self.list(b']', depth),
            Some(b'(') => self.list(b')', depth),
            Some(b'{') => self.dict(depth),
            Some(quote @ (b'\'' | b'"')) => self.text(quote),
            Some(b'0'..=b'9' | b'+' | b'-' | b'.') => self.number(),
            Some(_) => self.word(),
            None => Err(self.fail("a literal")),
        }
    }

    fn list(&mut self, close: u8, depth: usize) -> Result<Literal, LiteralError> {
        self.at += 1;
        let mut items = Vec::new();
        loop {
            self.skip_space();
            if self.take(close) {
                return Ok(Literal::List(items));
            }
            items.push(self.value(depth + 1)?);
            self.skip_space();
            if !self.take(b',') && self.peek() != Some(close) {
                return Err(self.fail("`,` or the end of the list"));
            }
        }
    }

    fn dict(&mut self, depth: usize) -> Result<Literal, LiteralError> {
        self.at += 1;
        let mut entries = Vec::new();
        loop {
            self.skip_space();
            if self.take(b'}') {
                return Ok(Literal::Dict(entries));
            }
            let key = self.value(depth + 1)?;
            self.skip_space();
            if !self.take(b':') {
                return Err(self.fail("`:`"));
            }
            entries.push((key, self.value(depth + 1)?));
            self.skip_space();
            if !self.take(b',') && self.peek() != Some(b'}') {
                return Err(self.fail("`,` or `}`"));
            }
        }
    }

    fn text(&mut self, quote: u8) -> Result<Literal, LiteralError> {
        self.at += 1;
        let mut out = Vec::new();
        loop {
            match self.peek() {
                None | Some(b'\n') => return Err(self.fail("a closing quote")),
                Some(b) if b == quote => break,
                Some(b'\\') => {
                    self.at += 1;
                    match self.peek() {
                        Some(b @ (b'\\' | b'\'' | b'"')) => out.push(b),
                        _ => return Err(self.fail("\\\\, \\' or \\\"")),
                    }
                }
                Some(b) => out.push(b),
            }
            self.at += 1;
        }
        self.at += 1;
        // The text is cut at ASCII quotes only, so no character is divided.
        Ok(Literal::Text(String::from_utf8_lossy(&out).into_owned()))
    }

    fn number(&mut self) -> Result<Literal, LiteralError> {
        let start = self.at;
        while self
            .peek()
            .is_some_and(|b| b.is_ascii_alphanumeric() || b"+-._".contains(&b))
        {
            self.at += 1;
        }
        // Python 2 wrote long integers with the suffix L.
        let digits = &self.bytes[start..self.at];
        let digits = digits.strip_suffix(b"L").unwrap_or(digits);
        std::str::from_utf8(digits)
            .ok()
            .and_then(|t| t.parse::<f64>().ok())
            .filter(|v| v.is_finite())
            .map(Literal::Number)
            .ok_or(LiteralError {
                byte: start,
                expected: "a finite number",
            })
    }

    fn word(&mut self) -> Result<Literal, LiteralError> {
        let words = [
            (&b"True"[..], Literal::Bool(true)),
            (b"False", Literal::Bool(false)),
            (b"None", Literal::None),
        ];
        for (word, value) in words {
            if self.bytes[self.at..].starts_with(word) {
                self.at += word.len();
                return Ok(value);
            }
        }
        Err(self.fail("a literal; names and calls are never evaluated"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_of_npy_headers_and_calibrations() {
        let v = parse_literal(
            "{'descr': [('x', '<f4'), ('y', '>f8')], 'fortran_order': False, 'shape': (3,), }",
        )
        .unwrap();
        assert_eq!(v.get("fortran_order"), Some(&Literal::Bool(false)));
        let descr = v.get("descr").unwrap().items().unwrap();
        assert_eq!(descr[1].items().unwrap()[0].text(), Some("y"));
        let shape = v.get("shape").unwrap().items().unwrap();
        assert_eq!(shape[0].number(), Some(3.0));
        assert_eq!(
            parse_literal(" -1.5e-3 ").unwrap(),
            Literal::Number(-1.5e-3)
        );
    }

    #[test]
    fn code_and_damage_are_refused_at_their_place() {
        let byte = |t: &str| parse_literal(t).unwrap_err().byte;
        assert_eq!(byte("{'a': __import__('os')}"), 6);
        assert_eq!(byte("[1, 2"), 5);
        assert_eq!(byte("[1 2]"), 3);
        assert_eq!(byte("'abc"), 4);
        assert_eq!(byte("1 + 2"), 2);
        assert_eq!(byte("nan"), 0);
        assert_eq!(byte(&"[".repeat(100_000)), MAX_DEPTH + 1);
    }
}
