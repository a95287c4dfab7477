//! Errors of file operations, with their positions.

use std::path::PathBuf;

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
    /// The output exists and its replacement was not requested.
    #[error("{path}: already exists; hint: --force replaces it", path = path.display())]
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
    #[error("{path}: {what} is {found}, more than the limit of {most}", path = path.display())]
    Limit {
        /// File.
        path: PathBuf,
        /// The limited quantity.
        what: String,
        /// Value in the file.
        found: u64,
        /// Maximum value.
        most: u64,
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
    #[error("{dir}: {problem}; hint: choose another directory, or --force starts over", dir = dir.display())]
    Foreign {
        /// Directory.
        dir: PathBuf,
        /// The content of the directory.
        problem: String,
    },
    /// The directory contains something that is not a data set.
    #[error("{dir}: not empty and not a data set; hint: choose another directory", dir = dir.display())]
    NotADataset {
        /// Directory.
        dir: PathBuf,
    },
    /// Another process builds in the same directory.
    #[error("{dir}: another build is running in this directory", dir = dir.display())]
    Locked {
        /// Directory.
        dir: PathBuf,
    },
}

impl DatasetError {
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

    /// Shorthand for an error message of a decoder.
    pub(crate) fn corrupt(path: &std::path::Path, problem: impl ToString) -> Self {
        Self::Corrupt {
            path: path.to_path_buf(),
            problem: problem.to_string(),
        }
    }
}
