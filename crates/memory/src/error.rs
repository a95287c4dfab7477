//! Reasons why the memory cannot be opened, read or written.

use std::path::{Path, PathBuf};

use rusqlite::ErrorCode;

/// Reason why an operation of the memory failed.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The operating system reported an error.
    #[error("{path}: cannot {operation}: {source}", path = path.display())]
    Io {
        /// File.
        path: PathBuf,
        /// Verb, for example `create`.
        operation: &'static str,
        /// Cause.
        source: std::io::Error,
    },
    /// Another process writes to the database, or holds a lock on it for longer than the store waits.
    #[error("{path}: the database is in use by another process", path = path.display())]
    Locked {
        /// Database.
        path: PathBuf,
    },
    /// A later version of the program wrote the database.
    #[error(
        "{path}: schema version {found} is newer than {known}, the newest that this program knows",
        path = path.display()
    )]
    Newer {
        /// Database.
        path: PathBuf,
        /// Schema version of the file.
        found: i64,
        /// Newest schema version that is understood.
        known: i64,
    },
    /// The file is intact, but it cannot hold the memory.
    #[error("{path}: {problem}", path = path.display())]
    Unusable {
        /// Database.
        path: PathBuf,
        /// What is wrong, for example that another program made the file.
        problem: String,
    },
    /// The content of the file is not that of a database, or contradicts itself.
    #[error("{path}: the database is damaged: {problem}", path = path.display())]
    Damaged {
        /// Database.
        path: PathBuf,
        /// What SQLite or the reader found.
        problem: String,
    },
    /// The file that is open is not the one of this name any more: what would be written to it is lost.
    #[error("{path}: the database was deleted or replaced while it was open", path = path.display())]
    Replaced {
        /// Database.
        path: PathBuf,
    },
    /// The disk is full.
    #[error("{path}: the disk is full", path = path.display())]
    Full {
        /// Database.
        path: PathBuf,
    },
    /// Rows are deleted, but their bytes remain in the write-ahead log.
    #[error(
        "{path}: the rows are deleted, but another process is reading, so that their bytes remain in the write-ahead log; try again",
        path = path.display()
    )]
    LogInUse {
        /// Database.
        path: PathBuf,
    },
    /// A value that the memory does not keep, or a query that it does not answer.
    #[error("`{field}`: expected {expected}, found {found}")]
    Invalid {
        /// Name of the field.
        field: &'static str,
        /// Permitted values.
        expected: &'static str,
        /// Value found, shortened.
        found: String,
    },
    /// No row has this number.
    #[error("no {table} has the number {id}")]
    Missing {
        /// `activity` or `event`.
        table: &'static str,
        /// Number of the row.
        id: i64,
    },
    /// SQLite reported another error.
    #[error("{path}: cannot {operation}: {source}", path = path.display())]
    Sqlite {
        /// Database.
        path: PathBuf,
        /// Verb phrase, for example `read activities`.
        operation: &'static str,
        /// Cause.
        source: rusqlite::Error,
    },
}

impl StoreError {
    /// The error of a SQLite operation on a file.
    pub(crate) fn of(path: &Path, operation: &'static str, source: rusqlite::Error) -> Self {
        use rusqlite::Error as E;
        let path = path.to_path_buf();
        let is_content = matches!(
            source,
            E::FromSqlConversionFailure(..)
                | E::IntegralValueOutOfRange(..)
                | E::InvalidColumnType(..)
                | E::Utf8Error(..)
        );
        match source.sqlite_error_code() {
            Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked) => Self::Locked { path },
            Some(ErrorCode::DiskFull) => Self::Full { path },
            Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase) => Self::Damaged {
                path,
                problem: source.to_string(),
            },
            None if is_content => Self::Damaged {
                path,
                problem: source.to_string(),
            },
            _ => Self::Sqlite {
                path,
                operation,
                source,
            },
        }
    }

    /// A value outside what a field permits. The value is shortened.
    pub(crate) fn invalid(
        field: &'static str,
        expected: &'static str,
        found: impl std::fmt::Debug,
    ) -> Self {
        let mut found = format!("{found:?}");
        if let Some((at, _)) = found.char_indices().nth(60) {
            found.truncate(at);
            found.push_str("...");
        }
        Self::Invalid {
            field,
            expected,
            found,
        }
    }
}
