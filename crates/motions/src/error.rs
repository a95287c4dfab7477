//! Errors in requests for built-in motions.

/// A request that does not describe a valid built-in motion.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BuiltinError {
    /// The request contains no motion name between the prefix and the keys.
    #[error("no motion named; write for example `builtin:walk?speed=slow`")]
    Empty,
    /// The request is longer than the limit.
    #[error("the request is {length} bytes long, at most {limit} are read")]
    TooLong {
        /// Length of the request, bytes.
        length: usize,
        /// Maximum length, bytes.
        limit: usize,
    },
    /// The motion name is unknown.
    #[error("no built-in motion `{name}`; there are: {allowed}")]
    Motion {
        /// Name as written (shortened).
        name: String,
        /// All valid names.
        allowed: String,
    },
    /// The chain of motions is malformed.
    #[error(
        "cannot read `{text}`: motions are joined by `+then+` or `+while+`, at most {limit} in all, and one `+while+` follows one motion"
    )]
    Chain {
        /// The chain (shortened).
        text: String,
        /// Maximum number of parts in a request.
        limit: usize,
    },
    /// A key has no `=`.
    #[error("cannot read `{text}`: expected key=value")]
    Pair {
        /// The text between two `&`.
        text: String,
    },
    /// No motion in the request has this key.
    #[error("`{motion}` has no key `{key}`; it has: {allowed}")]
    Key {
        /// Key as written (shortened).
        key: String,
        /// The motion or motions that were checked for the key.
        motion: String,
        /// Valid keys.
        allowed: String,
    },
    /// The same key occurs twice for the same part.
    #[error("`{key}` is given twice")]
    Twice {
        /// Key as written.
        key: String,
    },
    /// The value is missing or outside the range of the key.
    #[error("`{key}={value}` is not possible; allowed: {allowed}")]
    Value {
        /// The key.
        key: &'static str,
        /// Value as written (shortened).
        value: String,
        /// Values that the key accepts.
        allowed: String,
    },
    /// The values of several keys contradict each other.
    #[error("`{motion}`: {reason}")]
    Conflict {
        /// The motion.
        motion: &'static str,
        /// Description of the contradiction and of values that would be possible.
        reason: String,
    },
    /// A motion cannot follow the preceding motion.
    #[error("`{next}` starts {starts}, but `{before}` ends {ends}{help}")]
    Seam {
        /// The preceding motion.
        before: &'static str,
        /// Its final posture.
        ends: &'static str,
        /// The following motion.
        next: &'static str,
        /// Its initial posture.
        starts: &'static str,
        /// Suggested correction, or empty.
        help: &'static str,
    },
    /// A motion is on the wrong side of `+while+`.
    #[error("`{name}` cannot stand {place} `while`; possible are: {allowed}")]
    Overlay {
        /// The motion.
        name: &'static str,
        /// "before" or "after".
        place: &'static str,
        /// Names of the motions that are valid in this place.
        allowed: String,
    },
}
