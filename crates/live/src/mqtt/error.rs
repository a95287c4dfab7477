//! Reasons why publishing cannot start.

/// Reason why publishing cannot start.
#[derive(Debug, thiserror::Error)]
pub enum MqttError {
    /// The radar is simulated, and nobody allowed that its messages reach a broker.
    #[error(
        "the radar `{found}` is simulated; its falls and sentences are published only if simulated messages are allowed (--mqtt-simulated)"
    )]
    Synthetic {
        /// The source.
        found: String,
    },
    /// An address is none.
    #[error("`{found}` is no address of a broker; expected mqtt://HOST or mqtt://HOST:PORT{hint}")]
    Address {
        /// What was given.
        found: String,
        /// What else can be said, after a semicolon.
        hint: &'static str,
    },
    /// A name or a topic is none.
    #[error("`{found}` is no {what}; expected {expected}")]
    Name {
        /// What it should be.
        what: &'static str,
        /// What was given.
        found: String,
        /// What is allowed.
        expected: &'static str,
    },
    /// User and password do not fit the protocol.
    #[error("{found}; expected {expected}")]
    Login {
        /// What is wrong, without the password.
        found: &'static str,
        /// What is allowed.
        expected: &'static str,
    },
    /// The description of the device is longer than a message may be.
    #[error(
        "the description of the device with {actions} actions has {found} bytes; expected at most {expected}"
    )]
    TooLong {
        /// Number of actions.
        actions: usize,
        /// Bytes of the description.
        found: usize,
        /// Most bytes.
        expected: usize,
    },
    /// No thread could be started.
    #[error("cannot start the publisher: {source}")]
    Thread {
        /// Cause.
        source: std::io::Error,
    },
}
