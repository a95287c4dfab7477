//! A file that is read, changed and written by one process after the other.

use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};

/// The lock of a file, held until this is dropped, or until the process ends in whatever way.
///
/// It is a file of its own beside the locked one, `NAME.lock`: the locked file is replaced as a whole
/// ([`crate::atomic`]), and a lock on it would stay with the file that was replaced. The file stays when the lock is given
/// back, because another process may wait for it already.
#[derive(Debug)]
pub struct Lock {
    _file: File,
}

impl Lock {
    /// Waits until no other process holds the lock of a file, which need not exist, and takes it. Missing folders are
    /// created.
    ///
    /// # Errors
    /// A folder or a lock file that cannot be created, or a file system without locks; the path is that of the lock file.
    pub fn wait(path: &Path) -> Result<Self, (PathBuf, io::Error)> {
        let mut name = path.as_os_str().to_owned();
        name.push(".lock");
        let lock = PathBuf::from(name);
        let taken = (|| {
            if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
                std::fs::create_dir_all(folder)?;
            }
            let mut options = OpenOptions::new();
            let file = options
                .create(true)
                .truncate(false)
                .write(true)
                .open(&lock)?;
            file.lock()?;
            Ok(file)
        })();
        match taken {
            Ok(file) => Ok(Self { _file: file }),
            Err(error) => Err((lock, error)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_after_the_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sub/counter");
        let add = || {
            for _ in 0..50 {
                let _lock = Lock::wait(&path).unwrap();
                let count: u32 =
                    std::fs::read_to_string(&path).map_or(0, |text| text.parse().unwrap());
                crate::atomic::write_bytes(
                    &path,
                    crate::atomic::Existing::Replace,
                    (count + 1).to_string().as_bytes(),
                )
                .unwrap();
            }
        };
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(add);
            }
        });
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "200");
    }

    #[test]
    fn a_folder_that_is_a_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("file"), "").unwrap();
        let (path, _) = Lock::wait(&folder.path().join("file/memory")).unwrap_err();
        assert_eq!(path, folder.path().join("file/memory.lock"));
    }
}
