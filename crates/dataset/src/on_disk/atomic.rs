//! Wraps [`radarllm_files::atomic`] with this crate's errors.

use std::fs::File;
use std::path::Path;

use radarllm_files::atomic::{self, Existing, WriteError};

use crate::{DatasetError, Overwrite};

/// Writes `path` through `write`, atomically.
pub(crate) fn write_atomic<E: From<DatasetError>>(
    path: &Path,
    overwrite: Overwrite,
    write: impl FnOnce(&mut File) -> Result<(), E>,
) -> Result<(), E> {
    let existing = match overwrite {
        Overwrite::Refuse => Existing::Refuse,
        Overwrite::Replace => Existing::Replace,
    };
    atomic::write_with(path, existing, write).map_err(|e| match e {
        WriteError::Exists { path } => DatasetError::Exists { path }.into(),
        WriteError::Io {
            path,
            operation,
            source,
        } => DatasetError::io(&path, operation)(source).into(),
        WriteError::Content(error) => error,
    })
}

/// Makes renames and removals in `dir` durable across a power failure.
pub(crate) fn sync_dir(dir: &Path) -> Result<(), DatasetError> {
    atomic::sync_folder(dir).map_err(DatasetError::io(dir, "sync"))
}
