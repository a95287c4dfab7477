//! Errors of body models.

use std::path::PathBuf;

/// A body could not be generated or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BodyError {
    /// The height is outside the range supported by the built-in body.
    #[error("a body of {height_m} m: heights from 1.0 to 2.0 m are supported")]
    Height {
        /// Standing height found, m.
        height_m: f32,
    },
    /// The facet edge is out of range: finer meshes use quadratically more memory, coarser ones
    /// lose the limbs.
    #[error("facet edges of {facet_edge_m} m: 0.008 to 0.05 m are supported")]
    FacetEdge {
        /// Edge length found, m.
        facet_edge_m: f32,
    },
    /// The operating system could not open or read the file.
    #[error("{path}: {source}")]
    Io {
        /// File.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The file is not a zip archive of npy members.
    #[error("not an .npz archive: {reason}")]
    Archive {
        /// What is wrong.
        reason: String,
    },
    /// A required member is missing.
    #[error("no numeric member `{member}`{}", describe_skipped(.skipped))]
    Missing {
        /// Name of the member.
        member: &'static str,
        /// Members that contain Python pickles, which are never executed.
        skipped: Vec<String>,
    },
    /// A member is damaged, or larger than this reader accepts.
    #[error("member `{member}`: {reason}")]
    Member {
        /// Name of the member.
        member: String,
        /// What is wrong.
        reason: String,
    },
    /// The shape of a member does not match the others.
    #[error("member `{member}` has shape {found:?}, expected {expected}")]
    Shape {
        /// Name of the member.
        member: &'static str,
        /// Shape found.
        found: Vec<usize>,
        /// Shape expected.
        expected: String,
    },
    /// A member contains an invalid value.
    #[error("member `{member}`, entry {index}: {reason}")]
    Value {
        /// Name of the member.
        member: &'static str,
        /// Index of the entry, from 0.
        index: usize,
        /// What is wrong.
        reason: String,
    },
}

fn describe_skipped(skipped: &[String]) -> String {
    if skipped.is_empty() {
        return String::new();
    }
    let hint =
        "hint: save the model again with plain arrays, numpy.savez(path, v_template=..., ...)";
    format!(" (skipped Python pickles: {}; {hint})", skipped.join(", "))
}
