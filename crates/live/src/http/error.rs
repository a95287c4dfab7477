//! Reasons why the server cannot start.

use std::net::SocketAddr;

/// Reason why the server cannot start.
#[derive(Debug, thiserror::Error)]
pub enum HttpError {
    /// Others can reach the address, and nothing keeps them out.
    #[error(
        "{address} can be reached from other computers; expected a token, or an address such as 127.0.0.1:8741"
    )]
    NoToken {
        /// Address.
        address: SocketAddr,
    },
    /// The token cannot be sent in a header, or could be guessed.
    #[error("the token has {found}; expected 16 to 256 letters, digits and the characters - . _ ~")]
    Token {
        /// What is wrong, without the token.
        found: &'static str,
    },
    /// A name or an origin is none.
    #[error("`{found}` is no {expected}")]
    Name {
        /// What it should be, with an example.
        expected: &'static str,
        /// What was given.
        found: String,
    },
    /// One cannot listen on the address.
    #[error("cannot listen on {address}: {source}")]
    Listen {
        /// Address.
        address: SocketAddr,
        /// Cause.
        source: std::io::Error,
    },
    /// No thread could be started.
    #[error("cannot start the server: {source}")]
    Thread {
        /// Cause.
        source: std::io::Error,
    },
}
