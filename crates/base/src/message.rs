//! Messages that name options of the library without spelling them for one interface.
//!
//! The same option is `frame_rate` in the library, `--frame-rate` on the command line and `frame_rate_hz` in Python. A
//! message therefore consists of pieces, and an option is a piece of its own type. Whoever shows the message says what
//! options are called there:
//!
//! ```
//! use radarllm_base::message::{option, text};
//!
//! let message = text("raw samples need ").option("radar");
//! assert_eq!(message.to_string(), "raw samples need `radar`");
//! let shown = message.with_options(|name| format!("--{name}"));
//! assert_eq!(shown, "raw samples need --radar");
//! assert_eq!(option("seconds").text(" is needed").to_string(), "`seconds` is needed");
//! ```

use std::{borrow::Cow, fmt};

/// A piece of a [`Message`].
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Piece {
    /// Plain text.
    Text(Cow<'static, str>),
    /// An option, by its name in the library.
    Option(&'static str),
}

/// A sentence for users in which options of the library are marked.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Message {
    pieces: Vec<Piece>,
}

/// Begins a message with plain text.
pub fn text(text: impl Into<Cow<'static, str>>) -> Message {
    Message::default().text(text)
}

/// Begins a message with an option.
pub fn option(name: &'static str) -> Message {
    Message::default().option(name)
}

impl Message {
    /// Appends plain text.
    #[must_use]
    pub fn text(mut self, text: impl Into<Cow<'static, str>>) -> Self {
        self.pieces.push(Piece::Text(text.into()));
        self
    }

    /// Appends an option.
    #[must_use]
    pub fn option(mut self, name: &'static str) -> Self {
        self.pieces.push(Piece::Option(name));
        self
    }

    /// Appends another message.
    #[must_use]
    pub fn then(mut self, other: Self) -> Self {
        self.pieces.extend(other.pieces);
        self
    }

    /// Returns the pieces in their order.
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Returns the text, in which each option is written as `written` returns it.
    pub fn with_options<S: AsRef<str>>(&self, written: impl Fn(&'static str) -> S) -> String {
        let mut shown = String::new();
        for piece in &self.pieces {
            match piece {
                Piece::Text(text) => shown.push_str(text),
                Piece::Option(name) => shown.push_str(written(name).as_ref()),
            }
        }
        shown
    }
}

/// Options stand in backticks, by their names in the library.
impl fmt::Display for Message {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for piece in &self.pieces {
            match piece {
                Piece::Text(text) => f.write_str(text)?,
                Piece::Option(name) => write!(f, "`{name}`")?,
            }
        }
        Ok(())
    }
}

impl From<&'static str> for Message {
    fn from(message: &'static str) -> Self {
        text(message)
    }
}

impl From<String> for Message {
    fn from(message: String) -> Self {
        text(message)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Text in backticks that happens to be the name of an option, such as that of a radar, stays as it is.
    #[test]
    fn only_options_are_renamed() {
        let message = option("iq")
            .text(" is needed for radar `iq`")
            .then(Message::from(", as ").option("lanes"));
        assert_eq!(
            message.to_string(),
            "`iq` is needed for radar `iq`, as `lanes`"
        );
        assert_eq!(
            message.with_options(|name| format!("--{name}")),
            "--iq is needed for radar `iq`, as --lanes"
        );
        assert_eq!(message.pieces().len(), 4);
    }
}
