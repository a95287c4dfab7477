//! Errors of motion file loading.

/// A motion file that could not be read.
///
/// Every variant carries the file's name as given by the caller.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MotionError {
    /// The file could not be opened or read.
    #[error("{file}: {source}")]
    Io {
        /// File.
        file: String,
        /// Cause.
        source: std::io::Error,
    },
    /// The file is larger than the loaders accept.
    #[error("{file}: {size_bytes} bytes is more than the limit of {limit_bytes} bytes")]
    TooLarge {
        /// File.
        file: String,
        /// Size found.
        size_bytes: u64,
        /// Largest size accepted.
        limit_bytes: u64,
    },
    /// No loader recognises the contents.
    #[error(
        "{file}: not a motion file this version reads (BVH, ASF with AMC, AMASS npz, HumanML3D joints npy, Kinect joints csv): {reason}"
    )]
    UnknownFormat {
        /// File.
        file: String,
        /// Description of the contents found.
        reason: String,
    },
    /// A line of a text format is invalid.
    #[error("{file}:{line}: expected {expected}, found {found}")]
    Text {
        /// File.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Content that the format requires.
        expected: String,
        /// Content found instead.
        found: String,
    },
    /// A member of a binary file is invalid.
    #[error("{file}: {member}: expected {expected}, found {found}")]
    Member {
        /// File.
        file: String,
        /// Array or archive member.
        member: String,
        /// Content that the format requires.
        expected: String,
        /// Content found instead.
        found: String,
    },
    /// A number is NaN, infinite or outside the range of human motion.
    #[error("{file}: {place}: {value} is not a usable number")]
    NotFinite {
        /// File.
        file: String,
        /// Line, frame or member.
        place: String,
        /// The number.
        value: f64,
    },
    /// The joints are not those of a person, or have names that are not known.
    #[error(
        "{file}: no person recognised by the names of its {n_joints} joints: {found}; expected hips and knees with a head or \
         with shoulders and elbows, of both sides, as in LeftUpLeg, LeftLeg, Head, LeftArm, LeftForeArm. The joints are {names}"
    )]
    NoPerson {
        /// File.
        file: String,
        /// Number of joints.
        n_joints: usize,
        /// The joints that were recognised.
        found: String,
        /// Names of the first joints.
        names: String,
    },
    /// An AMC file has no ASF skeleton file beside it.
    #[error("{file}: an AMC file needs its ASF skeleton beside it (looked for {looked_for})")]
    MissingSkeleton {
        /// File.
        file: String,
        /// File names that were tried.
        looked_for: String,
    },
}

/// Shortens text from a file for an error message: at most 40 characters, control characters
/// escaped.
pub(crate) fn excerpt(text: &str) -> String {
    let mut out: String = text.chars().take(40).flat_map(char::escape_debug).collect();
    if text.chars().nth(40).is_some() {
        out.push_str("...");
    }
    if out.is_empty() {
        "nothing".into()
    } else {
        format!("`{out}`")
    }
}
