//! Files appear whole or not at all.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use crate::{DatasetError, Overwrite};

/// Writes `path` through `write` into a temporary neighbour, then fsync, rename, fsync of the
/// directory. A crash at any moment leaves the old file, or none, under the final name.
pub(crate) fn write_atomic(
    path: &Path,
    overwrite: Overwrite,
    write: impl FnOnce(&mut File) -> Result<(), DatasetError>,
) -> Result<(), DatasetError> {
    if overwrite == Overwrite::Refuse && path.exists() {
        return Err(DatasetError::Exists {
            path: path.to_path_buf(),
        });
    }
    let Some(name) = path.file_name() else {
        return Err(DatasetError::corrupt(path, "not a file name"));
    };
    let dir = match path.parent() {
        Some(dir) if !dir.as_os_str().is_empty() => dir.to_path_buf(),
        _ => PathBuf::from("."),
    };
    let mut temp_name = std::ffi::OsString::from(".");
    temp_name.push(name);
    // The process id keeps two writers of the same name apart; the suffix marks leftovers.
    temp_name.push(format!(".{}.tmp", std::process::id()));
    let temp = dir.join(temp_name);

    let result = (|| {
        let mut file = File::create(&temp).map_err(DatasetError::io(&temp, "create"))?;
        write(&mut file)?;
        file.sync_all().map_err(DatasetError::io(&temp, "sync"))?;
        drop(file);
        fs::rename(&temp, path).map_err(DatasetError::io(path, "rename into place"))?;
        sync_dir(&dir)
    })();
    if result.is_err() {
        // Best effort: the error that matters is the first one.
        let _ = fs::remove_file(&temp);
    }
    result
}

/// Makes renames and removals in `dir` survive a power cut.
pub(crate) fn sync_dir(dir: &Path) -> Result<(), DatasetError> {
    // Directories cannot be opened for syncing on every system; where they can, it must work.
    if cfg!(unix) {
        File::open(dir)
            .and_then(|d| d.sync_all())
            .map_err(DatasetError::io(dir, "sync"))?;
    }
    Ok(())
}
