//! Errors of file operations, with their positions.

use std::path::PathBuf;

use radarllm_base::message::{Message, option, text};

/// Why a data set or points file could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// The operating system reported an error.
    #[error("{path}: cannot {operation}: {source}", path = path.display())]
    Io {
        /// File or directory.
        path: PathBuf,
        /// Verb, for example `open`.
        operation: &'static str,
        /// Cause.
        source: std::io::Error,
    },
    /// This build reads no Parquet.
    #[error("{path}: this program was built without the feature `parquet`", path = path.display())]
    WithoutParquet {
        /// File.
        path: PathBuf,
    },
    /// The output exists and its replacement was not requested.
    #[error("{path}: already exists", path = path.display())]
    Exists {
        /// Existing output.
        path: PathBuf,
    },
    /// The bytes do not conform to their format.
    #[error("{path}: damaged or not the expected format: {problem}", path = path.display())]
    Corrupt {
        /// File.
        path: PathBuf,
        /// The message of the decoder, with the offset if it is known.
        problem: String,
    },
    /// The bytes of a shard are not those that the manifest lists.
    #[error("{path}: damaged or not the expected format: {problem}", path = path.display())]
    Changed {
        /// Shard.
        path: PathBuf,
        /// What differs from the manifest.
        problem: String,
    },
    /// A column is absent or of the wrong type.
    #[error("{path}: column `{column}`: expected {expected}, found {found}", path = path.display())]
    Column {
        /// File.
        path: PathBuf,
        /// Column name.
        column: String,
        /// Requested type.
        expected: String,
        /// Type in the file, or `nothing`.
        found: String,
    },
    /// A value is out of its domain.
    #[error("{path}: column `{column}`, row {row}: {problem}", path = path.display())]
    Value {
        /// File.
        path: PathBuf,
        /// Column name.
        column: String,
        /// Row in the file, from 0.
        row: u64,
        /// What is wrong.
        problem: String,
    },
    /// A file exceeds a limit of this reader.
    #[error("{path}: {what} is {found}, more than the limit of {max}", path = path.display())]
    Limit {
        /// File.
        path: PathBuf,
        /// The limited quantity.
        what: String,
        /// Value in the file.
        found: u64,
        /// Maximum value.
        max: u64,
    },
    /// A metadata entry or manifest field is invalid.
    #[error("{path}: `{field}`: {problem}", path = path.display())]
    Metadata {
        /// File.
        path: PathBuf,
        /// Key or field.
        field: String,
        /// What is wrong.
        problem: String,
    },
    /// A clip cannot be stored.
    #[error("clip `{id}`: {problem}")]
    Record {
        /// Clip id.
        id: String,
        /// What is wrong.
        problem: String,
    },
    /// A build plan is inconsistent.
    #[error("build plan: {problem}")]
    Plan {
        /// What is wrong.
        problem: String,
    },
    /// The directory holds another data set.
    #[error("{dir}: {problem}", dir = dir.display())]
    Foreign {
        /// Directory.
        dir: PathBuf,
        /// The content of the directory.
        problem: String,
    },
    /// Nothing may be copied to the directory, whatever the options.
    #[error("{dir}: {problem}", dir = dir.display())]
    Target {
        /// Directory.
        dir: PathBuf,
        /// Why it is refused.
        problem: String,
    },
    /// A file that bears the name of a shard does not belong to the data set.
    #[error("{path}: not a shard of this data set, but readers would take it for one", path = path.display())]
    Stray {
        /// File.
        path: PathBuf,
    },
    /// The directory contains something that is not a data set.
    #[error("{dir}: not empty and not a data set", dir = dir.display())]
    NotADataset {
        /// Directory.
        dir: PathBuf,
    },
    /// The build was stopped before it was complete.
    #[error("{dir}: stopped before it was complete; the next build goes on from here", dir = dir.display())]
    Interrupted {
        /// Directory.
        dir: PathBuf,
    },
    /// No build was begun in the directory.
    #[error("{dir}: not prepared for a build", dir = dir.display())]
    NotPrepared {
        /// Directory.
        dir: PathBuf,
    },
    /// The directory was prepared by a process that this one does not agree with.
    #[error("{dir}: {problem}", dir = dir.display())]
    Disagreement {
        /// Directory.
        dir: PathBuf,
        /// What differs.
        problem: String,
    },
    /// Shards are missing or damaged, so that the data set cannot be finished.
    #[error("{dir}: {} of {n_shards} shards are missing or damaged: {}", missing.len(), first_names(missing), dir = dir.display())]
    Incomplete {
        /// Directory.
        dir: PathBuf,
        /// Names of the shards, such as `train-00000-of-00002`.
        missing: Vec<String>,
        /// Number of shards of the data set.
        n_shards: usize,
    },
    /// The file system of the directory lacks what is needed to write safely.
    #[error("{dir}: {problem}", dir = dir.display())]
    Unsuitable {
        /// Directory.
        dir: PathBuf,
        /// What it lacks.
        problem: String,
    },
    /// Another process builds in the same directory or exports to it.
    #[error("{dir}: another process is working in this directory", dir = dir.display())]
    Locked {
        /// Directory.
        dir: PathBuf,
    },
}

/// The first names of a list and the number of the others.
fn first_names(names: &[String]) -> String {
    const MAX_NAMES: usize = 20;
    let mut text = names[..names.len().min(MAX_NAMES)].join(", ");
    if names.len() > MAX_NAMES {
        text.push_str(&format!(" and {} more", names.len() - MAX_NAMES));
    }
    text
}

impl DatasetError {
    /// How the user can resolve the error.
    pub fn hint(&self) -> Option<Message> {
        Some(match self {
            Self::Exists { .. } => option("overwrite").text(" replaces it"),
            Self::Changed { .. } => {
                text("copy the data set again, or build it again, which replaces this shard")
            }
            Self::Foreign { .. } => text("choose another directory, or ")
                .option("overwrite")
                .text(" starts over"),
            Self::Target { .. } => text("choose another folder"),
            Self::Stray { .. } => text("remove it"),
            Self::NotADataset { .. } => text("choose another directory"),
            Self::Disagreement { .. } => text(
                "all processes of a build need the same program, the same configuration and processors with the same instructions",
            ),
            Self::Incomplete { .. } => text("build them, the others are kept"),
            Self::Unsuitable { .. } => text(
                "choose a folder on a file system with locks and renames (a local disk, NFS, Lustre with `flock`); what `radarllm dataset export` copies there can be uploaded",
            ),
            _ => return None,
        })
    }

    #[cfg(feature = "parquet")]
    /// Shorthand for `map_err`.
    pub(crate) fn io(
        path: &std::path::Path,
        operation: &'static str,
    ) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Io {
            path,
            operation,
            source,
        }
    }

    /// The reason why Parquet could not be written: an error of the operating system, such as a full disk, or data that have
    /// no form in Parquet.
    #[cfg(feature = "parquet")]
    pub(crate) fn of_writing(path: &std::path::Path, error: parquet::errors::ParquetError) -> Self {
        use parquet::errors::ParquetError;
        match error {
            ParquetError::External(cause) if cause.is::<std::io::Error>() => {
                let source = cause.downcast().map_or_else(
                    |cause| std::io::Error::other(cause.to_string()),
                    |source: Box<std::io::Error>| *source,
                );
                Self::Io {
                    path: path.to_path_buf(),
                    operation: "write",
                    source,
                }
            }
            error => Self::corrupt(path, error),
        }
    }

    /// Shorthand for an error message of a decoder.
    #[cfg(feature = "parquet")]
    pub(crate) fn corrupt(path: &std::path::Path, problem: impl ToString) -> Self {
        Self::Corrupt {
            path: path.to_path_buf(),
            problem: problem.to_string(),
        }
    }
}
