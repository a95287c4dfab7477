//! What can be wrong with a body.

use std::path::PathBuf;

/// A body could not be made or read.
#[derive(Debug, thiserror::Error)]
pub enum BodyError {
    /// The built-in body is shaped for this range only.
    #[error("a body of {height_m} m: heights from 1.0 to 2.0 m are supported")]
    Height { height_m: f32 },
    /// Finer meshes cost memory quadratically, coarser ones lose the limbs.
    #[error("facet edges of {facet_edge_m} m: 0.008 to 0.05 m are supported")]
    FacetEdge { facet_edge_m: f32 },
    /// The operating system refused the file.
    #[error("{path}: {source}")]
    Io {
        path: PathBuf,
        source: std::io::Error,
    },
    /// Not a zip archive of npy members.
    #[error("not an .npz archive: {reason}")]
    Archive { reason: String },
    /// A member the model cannot do without. `skipped` names members that hold Python pickles,
    /// which are never executed.
    #[error("no numeric member `{member}`{}", describe_skipped(.skipped))]
    Missing {
        member: &'static str,
        skipped: Vec<String>,
    },
    /// A member that is damaged, or larger than this reader accepts.
    #[error("member `{member}`: {reason}")]
    Member { member: String, reason: String },
    /// A member whose shape does not fit the others.
    #[error("member `{member}` has shape {found:?}, expected {expected}")]
    Shape {
        member: &'static str,
        found: Vec<usize>,
        expected: String,
    },
    /// A value that cannot be right.
    #[error("member `{member}`, entry {index}: {reason}")]
    Value {
        member: &'static str,
        index: usize,
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
