//! Files appear whole or not at all.
//!
//! The content goes to a temporary neighbour, which is synced and renamed; then the folder is synced. A crash at any
//! moment leaves the old file, or none, under the final name. `tempfile` would do the same, but gives the finished file
//! the rights of a secret (0600), which nobody else who shares a data set could read.

use std::convert::Infallible;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// What happens to a file that is already there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// It stays, and writing fails.
    Refuse,
    /// It is replaced.
    Replace,
}

/// Why a file was not written. `E` is what the content's own writer fails with.
#[derive(Debug, thiserror::Error)]
pub enum WriteError<E> {
    /// The file exists and replacing it was not asked for.
    #[error("{path}: already exists", path = path.display())]
    Exists {
        /// File.
        path: PathBuf,
    },
    /// The operating system refused.
    #[error("{path}: cannot {operation}: {source}", path = path.display())]
    Io {
        /// File or folder.
        path: PathBuf,
        /// Verb, for example `create`.
        operation: &'static str,
        /// Cause.
        source: io::Error,
    },
    /// The content could not be written.
    #[error(transparent)]
    Content(E),
}

/// Writes `path` through `write`, which gets the temporary file and need not sync it. For content that does not fit
/// into memory, or that is made while it is written.
///
/// # Errors
/// [`WriteError`]; the temporary file is gone then, and what was under `path` is untouched.
pub fn write_with<E>(
    path: &Path,
    existing: Existing,
    write: impl FnOnce(&mut File) -> Result<(), E>,
) -> Result<(), WriteError<E>> {
    if existing == Existing::Refuse && path.exists() {
        return Err(WriteError::Exists { path: path.into() });
    }
    let fail = |path: &Path, operation: &'static str| {
        let path = path.to_path_buf();
        move |source| WriteError::Io {
            path,
            operation,
            source,
        }
    };
    let Some(name) = path.file_name() else {
        let source = io::Error::from(io::ErrorKind::InvalidInput);
        return Err(fail(path, "write something that is no file name")(source));
    };
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    // The process id keeps two writers of the same name apart.
    let mut temporary = OsString::from(".");
    temporary.push(name);
    temporary.push(format!(".{}.tmp", std::process::id()));
    let temporary = folder.join(temporary);
    let result = (|| {
        let mut file = File::create(&temporary).map_err(fail(&temporary, "create"))?;
        write(&mut file).map_err(WriteError::Content)?;
        file.sync_all().map_err(fail(&temporary, "sync"))?;
        drop(file);
        fs::rename(&temporary, path).map_err(fail(path, "rename into place"))?;
        sync_folder(folder).map_err(fail(folder, "sync"))
    })();
    if result.is_err() {
        // Best effort: the error that matters is the first one.
        let _ = fs::remove_file(&temporary);
    }
    result
}

/// Writes bytes.
///
/// # Errors
/// As [`write_with`].
pub fn write_bytes(
    path: &Path,
    existing: Existing,
    bytes: &[u8],
) -> Result<(), WriteError<Infallible>> {
    let written = write_with(path, existing, |file| file.write_all(bytes));
    written.map_err(|e| match e {
        WriteError::Exists { path } => WriteError::Exists { path },
        WriteError::Io {
            path,
            operation,
            source,
        } => WriteError::Io {
            path,
            operation,
            source,
        },
        WriteError::Content(source) => WriteError::Io {
            path: path.into(),
            operation: "write",
            source,
        },
    })
}

/// Whether a file's name is that of a temporary neighbour, left behind by a crash.
pub fn is_leftover(name: &str) -> bool {
    name.starts_with('.') && name.ends_with(".tmp")
}

/// Makes renames and removals in a folder survive a power cut.
///
/// # Errors
/// What the operating system says. Systems that cannot open a folder as a file journal their renames; nothing happens
/// there.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) {
        File::open(folder)?.sync_all()?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let entries = fs::read_dir(dir).unwrap();
        entries
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    #[test]
    fn files_are_written_refused_and_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        write_bytes(&path, Existing::Refuse, b"one").unwrap();
        let error = write_bytes(&path, Existing::Refuse, b"two").unwrap_err();
        assert!(matches!(error, WriteError::Exists { .. }), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"one");
        write_bytes(&path, Existing::Replace, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(names(dir.path()), ["a.bin"]);
    }

    #[test]
    fn a_failure_leaves_the_old_file_alone() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bin");
        fs::write(&path, b"old").unwrap();
        let failed = write_with(&path, Existing::Replace, |file| {
            file.write_all(b"half").map_err(|e| e.to_string())?;
            let here = names(dir.path());
            assert!(here.iter().any(|name| is_leftover(name)), "{here:?}");
            Err("no more".to_string())
        });
        assert!(matches!(failed, Err(WriteError::Content(why)) if why == "no more"));
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(names(dir.path()), ["a.bin"]);
        let nowhere = dir.path().join("no/such/folder/a.bin");
        let error = write_bytes(&nowhere, Existing::Replace, b"").unwrap_err();
        assert!(error.to_string().contains("cannot create"), "{error}");
        assert!(write_bytes(Path::new(".."), Existing::Replace, b"").is_err());
    }
}
