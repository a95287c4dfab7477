//! Reads small files as a whole, up to an expected size. The limit protects against devices and growing files, which
//! may never end.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Maximum size of a file that people write: configurations, scenes, calibrations.
pub const MAX_CONFIG_BYTES: u64 = 16 << 20;

/// Reason why a file was not read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The operating system reported an error.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// File.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The file is larger than expected for its kind.
    #[error("{path}: more than the {max_bytes} bytes that are read", path = path.display())]
    TooLarge {
        /// File.
        path: PathBuf,
        /// Maximum size accepted, bytes.
        max_bytes: u64,
    },
    /// A text file is not valid UTF-8.
    #[error("{path}: byte {byte}: expected UTF-8", path = path.display())]
    NotUtf8 {
        /// File.
        path: PathBuf,
        /// Offset of the first invalid byte, from 0.
        byte: usize,
    },
}

impl ReadError {
    /// The error as one of the operating system, for errors that name the file themselves.
    pub fn into_io(self) -> std::io::Error {
        match self {
            Self::Io { source, .. } => source,
            Self::TooLarge { max_bytes, .. } => std::io::Error::new(
                std::io::ErrorKind::FileTooLarge,
                format!("more than the {max_bytes} bytes that are read"),
            ),
            Self::NotUtf8 { byte, .. } => std::io::Error::new(
                std::io::ErrorKind::InvalidData,
                format!("byte {byte}: expected UTF-8"),
            ),
        }
    }
}

/// Opens a file that is read piece by piece. The caller bounds what it keeps.
///
/// # Errors
/// [`ReadError::Io`].
pub fn open(path: &Path) -> Result<File, ReadError> {
    File::open(path).map_err(|source| ReadError::Io {
        path: path.into(),
        source,
    })
}

/// Reads all bytes of a file that has at most `max_bytes`.
///
/// # Errors
/// [`ReadError::Io`] and [`ReadError::TooLarge`].
pub fn read_bytes(path: &Path, max_bytes: u64) -> Result<Vec<u8>, ReadError> {
    let io = |source| ReadError::Io {
        path: path.into(),
        source,
    };
    let file = File::open(path).map_err(io)?;
    let found = file.metadata().map_err(io)?;
    // A regular file has a size, so that one that is too large is refused before it is read, and the bytes of any other one
    // are never copied from a smaller buffer to a larger one. A file that grows meanwhile is bounded as a device is.
    if !found.is_file() {
        return read_bytes_from(file, path, max_bytes);
    }
    if found.len() > max_bytes {
        return Err(ReadError::TooLarge {
            path: path.into(),
            max_bytes,
        });
    }
    let capacity = usize::try_from(found.len()).unwrap_or(usize::MAX);
    read_into(Vec::with_capacity(capacity), file, path, max_bytes)
}

/// As [`read_bytes`], from a file that is open; `path` names it in errors.
///
/// # Errors
/// [`ReadError::Io`] and [`ReadError::TooLarge`].
pub fn read_bytes_from(file: impl Read, path: &Path, max_bytes: u64) -> Result<Vec<u8>, ReadError> {
    read_into(Vec::new(), file, path, max_bytes)
}

fn read_into(
    mut bytes: Vec<u8>,
    file: impl Read,
    path: &Path,
    max_bytes: u64,
) -> Result<Vec<u8>, ReadError> {
    file.take(max_bytes.saturating_add(1))
        .read_to_end(&mut bytes)
        .map_err(|source| ReadError::Io {
            path: path.into(),
            source,
        })?;
    if bytes.len() as u64 > max_bytes {
        return Err(ReadError::TooLarge {
            path: path.into(),
            max_bytes,
        });
    }
    Ok(bytes)
}

/// Reads the text of a file that has at most `max_bytes`.
///
/// # Errors
/// [`ReadError`].
pub fn read_text(path: &Path, max_bytes: u64) -> Result<String, ReadError> {
    text_of(read_bytes(path, max_bytes)?, path)
}

/// The text of bytes; `path` names them in errors.
///
/// # Errors
/// [`ReadError::NotUtf8`].
pub fn text_of(bytes: Vec<u8>, path: &Path) -> Result<String, ReadError> {
    String::from_utf8(bytes).map_err(|e| ReadError::NotUtf8 {
        path: path.into(),
        byte: e.utf8_error().valid_up_to(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_up_to_their_limit() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        std::fs::write(&path, b"ab\xffc").unwrap();
        assert_eq!(read_bytes(&path, 4).unwrap(), b"ab\xffc");
        assert!(matches!(
            read_bytes(&path, 3),
            Err(ReadError::TooLarge { max_bytes: 3, .. })
        ));
        assert!(matches!(
            read_text(&path, 4),
            Err(ReadError::NotUtf8 { byte: 2, .. })
        ));
        assert!(matches!(
            read_bytes(dir.path(), 4),
            Err(ReadError::Io { .. })
        ));
    }

    #[cfg(unix)]
    #[test]
    fn a_device_without_an_end_is_refused() {
        let error = read_bytes(Path::new("/dev/zero"), 1 << 16).unwrap_err();
        assert!(error.to_string().contains("65536"), "{error}");
    }
}
