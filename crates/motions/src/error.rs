//! What can be wrong with the name of a built-in motion.

/// A request that names no motion we can perform.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BuiltinError {
    /// Nothing between the prefix and the keys.
    #[error("no motion named; write for example `builtin:walk?speed=slow`")]
    Empty,
    /// Longer than any sensible request.
    #[error("the request is {length} bytes long, at most {limit} are read")]
    TooLong {
        /// Bytes given.
        length: usize,
        /// Bytes accepted.
        limit: usize,
    },
    /// An unknown motion.
    #[error("no built-in motion `{name}`; there are: {allowed}")]
    Motion {
        /// Name as written (shortened).
        name: String,
        /// All names.
        allowed: String,
    },
    /// A malformed chain of motions.
    #[error(
        "cannot read `{text}`: motions are joined by `+then+` or `+while+`, at most {limit} in all, and one `+while+` follows one motion"
    )]
    Chain {
        /// The chain (shortened).
        text: String,
        /// Most parts in a request.
        limit: usize,
    },
    /// A key without `=`.
    #[error("cannot read `{text}`: expected key=value")]
    Pair {
        /// The text between two `&`.
        text: String,
    },
    /// A key that nothing in the request knows.
    #[error("`{motion}` has no key `{key}`; it has: {allowed}")]
    Key {
        /// Key as written (shortened).
        key: String,
        /// Motion or motions asked.
        motion: String,
        /// Keys that would do.
        allowed: String,
    },
    /// The same key twice for the same part.
    #[error("`{key}` is given twice")]
    Twice {
        /// Key as written.
        key: String,
    },
    /// A value outside the key's range, or no value at all.
    #[error("`{key}={value}` is not possible; allowed: {allowed}")]
    Value {
        /// The key.
        key: &'static str,
        /// Value as written (shortened).
        value: String,
        /// What the key accepts.
        allowed: String,
    },
    /// Keys that contradict each other.
    #[error("`{motion}`: {reason}")]
    Conflict {
        /// The motion.
        motion: &'static str,
        /// What contradicts what, and what would be possible.
        reason: String,
    },
    /// A motion that cannot follow the one before.
    #[error("`{next}` starts {starts}, but `{before}` ends {ends}{help}")]
    Seam {
        /// First motion.
        before: &'static str,
        /// Its final posture.
        ends: &'static str,
        /// Second motion.
        next: &'static str,
        /// Its first posture.
        starts: &'static str,
        /// What to write instead, or empty.
        help: &'static str,
    },
    /// A motion on the wrong side of `+while+`.
    #[error("`{name}` cannot stand {place} `while`; possible are: {allowed}")]
    Overlay {
        /// The motion.
        name: &'static str,
        /// "before" or "after".
        place: &'static str,
        /// Names that can.
        allowed: String,
    },
}
