//! Writes files and folders atomically.
//!
//! The content is written to a temporary file in the same folder, which is synced and renamed; then the folder is
//! synced. After a crash at any moment, the final name refers to the old file, to the complete new file, or to none.
//! A new folder is made in the same way.
//! The crate `tempfile` would do the same, but gives the finished file the permissions 0600, which prevent other users
//! of a shared data set from reading it.

use std::convert::Infallible;
use std::ffi::{OsStr, OsString};
use std::fs::{self, File};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What to do with an existing file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// Keep it and fail.
    Refuse,
    /// Replace it.
    Replace,
}

/// Reason why a file or folder was not written. `E` is the error type of the function that writes the content.
#[derive(Debug, thiserror::Error)]
pub enum WriteError<E> {
    /// The file or folder exists, and its replacement was not requested.
    #[error("{path}: already exists", path = path.display())]
    Exists {
        /// File or folder.
        path: PathBuf,
    },
    /// The operating system reported an error.
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

/// Writes `path` through `write`, which receives the temporary file and need not sync it. Intended for content that
/// does not fit into memory or that is generated while it is written.
///
/// # Errors
/// [`WriteError`]. In that case the temporary file has been removed, and `path` is unchanged.
pub fn write_with<E>(
    path: &Path,
    existing: Existing,
    write: impl FnOnce(&mut File) -> Result<(), E>,
) -> Result<(), WriteError<E>> {
    if existing == Existing::Refuse && path.exists() {
        return Err(WriteError::Exists { path: path.into() });
    }
    let (folder, name) = folder_and_name(path)?;
    remove_leftovers(folder, name);
    let temporary = folder.join(temporary_name(name));
    let result = (|| {
        let mut file = File::create_new(&temporary).map_err(fail(&temporary, "create"))?;
        write(&mut file).map_err(WriteError::Content)?;
        file.sync_all().map_err(fail(&temporary, "sync"))?;
        drop(file);
        fs::rename(&temporary, path).map_err(fail(path, "rename into place"))?;
        sync_folder(folder).map_err(fail(folder, "sync"))
    })();
    if result.is_err() {
        // Best effort: the first error is the one to report.
        let _ = fs::remove_file(&temporary);
    }
    result
}

/// Makes the folder `path` through `write`, which receives the path of an empty temporary folder beside it. `write` syncs
/// the files that it writes.
///
/// # Errors
/// [`WriteError`]; `path` must not exist, because what is in it would be lost. After an error, the temporary folder has
/// been removed.
pub fn create_folder_with<E>(
    path: &Path,
    write: impl FnOnce(&Path) -> Result<(), E>,
) -> Result<(), WriteError<E>> {
    let (folder, name) = folder_and_name(path)?;
    remove_leftovers(folder, name);
    // Also a link to nothing exists.
    if path.symlink_metadata().is_ok() {
        return Err(WriteError::Exists { path: path.into() });
    }
    let temporary = folder.join(temporary_name(name));
    let result = (|| {
        fs::create_dir(&temporary).map_err(fail(&temporary, "create"))?;
        write(&temporary).map_err(WriteError::Content)?;
        sync_folder(&temporary).map_err(fail(&temporary, "sync"))?;
        fs::rename(&temporary, path).map_err(fail(path, "rename into place"))?;
        sync_folder(folder).map_err(fail(folder, "sync"))
    })();
    if result.is_err() {
        // Best effort: the first error is the one to report.
        let _ = fs::remove_dir_all(&temporary);
    }
    result
}

/// The folder that holds `path`, and its name there.
fn folder_and_name<E>(path: &Path) -> Result<(&Path, &OsStr), WriteError<E>> {
    let Some(name) = path.file_name() else {
        let source = io::Error::from(io::ErrorKind::InvalidInput);
        return Err(fail(path, "write something that is no file name")(source));
    };
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    Ok((folder, name))
}

/// Turns an error of the operating system into one that names path and operation.
fn fail<E>(path: &Path, operation: &'static str) -> impl FnOnce(io::Error) -> WriteError<E> {
    let path = path.to_path_buf();
    move |source| WriteError::Io {
        path,
        operation,
        source,
    }
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

/// A name for a temporary file or folder beside `name` that no other process and no other thread uses, also not on another
/// machine that shares the folder: `.NAME.HOST.PID.RANDOM.tmp`. Host and process tell whose it is when a crash left it
/// behind; containers may agree in both, so that the random part is needed.
pub fn temporary_name(name: &OsStr) -> OsString {
    // File systems limit names to 255 bytes; host, process and random part need up to 60.
    const MAX_NAME_CHARS: usize = 48;
    let name: String = name
        .to_string_lossy()
        .chars()
        .take(MAX_NAME_CHARS)
        .collect();
    let random = RandomState::new().build_hasher().finish();
    let process = std::process::id();
    format!(".{name}.{}.{process}.{random:016x}.tmp", host_name()).into()
}

/// Removes what killed runs of this machine left of a file or folder: temporaries of processes that do not exist any more
/// and wrote nothing for a while. Best effort, and only where the system tells which processes exist.
pub fn remove_leftovers(folder: &Path, name: &OsStr) {
    // Long enough for a process of another container with the same name and folder to write its next piece.
    const SILENCE: Duration = Duration::from_secs(600);
    // Of a folder with many files only the first ones are looked at, because this is done at every write.
    const MAX_LISTED: usize = 1_000;
    let processes = Path::new("/proc");
    let own = processes.join(std::process::id().to_string());
    let (true, Ok(entries)) = (own.exists(), fs::read_dir(folder)) else {
        return;
    };
    // `.NAME.HOST.` is what temporaries of one file and machine have in common.
    let pattern = temporary_name(name);
    let pattern = pattern.to_string_lossy();
    let Some(common) = pattern.rsplitn(4, '.').nth(3) else {
        return;
    };
    for entry in entries.flatten().take(MAX_LISTED) {
        let file = entry.file_name();
        let file = file.to_string_lossy();
        let rest = file
            .strip_suffix(".tmp")
            .and_then(|rest| rest.strip_prefix(common))
            .and_then(|rest| rest.strip_prefix('.'));
        let Some((process, random)) = rest.and_then(|rest| rest.split_once('.')) else {
            continue;
        };
        let is_ours = process.parse::<u32>().is_ok()
            && random.len() == 16
            && random.chars().all(|c| c.is_ascii_hexdigit());
        let is_silent = entry
            .metadata()
            .and_then(|found| found.modified())
            .is_ok_and(|at| at.elapsed().is_ok_and(|passed| passed > SILENCE));
        if is_ours && is_silent && !processes.join(process).exists() {
            let _ = match entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                true => fs::remove_dir_all(entry.path()),
                false => fs::remove_file(entry.path()),
            };
        }
    }
}

/// Name of this machine or container, of at most 24 letters, digits and hyphens.
fn host_name() -> String {
    const MAX_CHARS: usize = 24;
    // The kernel's name on Linux; elsewhere the variables that shells and services set.
    let name = fs::read_to_string("/proc/sys/kernel/hostname")
        .or_else(|_| std::env::var("HOSTNAME"))
        .or_else(|_| std::env::var("COMPUTERNAME"))
        .unwrap_or_else(|_| "host".into());
    let clean = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
    name.trim().chars().take(MAX_CHARS).map(clean).collect()
}

/// Whether a name is that of a temporary file or folder, which a crash can leave behind.
pub fn is_leftover(name: &str) -> bool {
    name.starts_with('.') && name.ends_with(".tmp")
}

/// Makes renames and removals in a folder durable across a power failure.
///
/// # Errors
/// The error of the operating system. The function does nothing on systems that cannot open a folder as a file; these
/// journal their renames.
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
    fn temporary_names_differ_name_their_process_and_fit() {
        let long = "é".repeat(127);
        for name in ["train-00000-of-00002.parquet", &long] {
            let [a, b] = [0, 1].map(|_| temporary_name(OsStr::new(name)).into_string().unwrap());
            assert_ne!(a, b);
            assert!(is_leftover(&a) && a.len() <= 200, "{a}");
            let parts: Vec<&str> = a.rsplit('.').collect();
            assert_eq!(parts[2], std::process::id().to_string(), "{a}");
            let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
            if !host.trim().is_empty()
                && host.trim().bytes().all(|b| b.is_ascii_alphanumeric())
                && host.len() <= 24
            {
                assert_eq!(parts[3], host.trim(), "{a}");
            }
        }
        // A file of 254 bytes can be written, although its temporary name contains more than the name.
        let dir = tempfile::tempdir().unwrap();
        write_bytes(&dir.path().join(&long), Existing::Refuse, b"x").unwrap();
        assert_eq!(names(dir.path()), [long]);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn leftovers_of_processes_that_ended_are_removed() {
        let dir = tempfile::tempdir().unwrap();
        let host = host_name();
        let (own, random) = (std::process::id(), "0123456789abcdef");
        // No process has this number: the largest one is 2^22.
        let dead = 1 << 23;
        let old = std::time::SystemTime::now() - Duration::from_secs(3_600);
        let make = |name: String, is_old: bool| {
            let file = File::create(dir.path().join(&name)).unwrap();
            if is_old {
                file.set_modified(old).unwrap();
            }
            name
        };
        let gone = make(format!(".a.bin.{host}.{dead}.{random}.tmp"), true);
        let mut kept = vec![
            make(format!(".a.bin.{host}.{dead}.{random}1.tmp"), true),
            make(format!(".a.bin.{host}.{own}.{random}.tmp"), true),
            make(format!(".a.bin.other.{dead}.{random}.tmp"), true),
            make(format!(".b.bin.{host}.{dead}.{random}.tmp"), true),
            make(format!(".a.bin.{host}.{dead}.fedcba9876543210.tmp"), false),
            "a.bin".into(),
        ];
        write_bytes(&dir.path().join("a.bin"), Existing::Replace, b"x").unwrap();
        let mut found = names(dir.path());
        found.sort();
        kept.sort();
        assert_eq!(found, kept, "{gone}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn folders_of_processes_that_ended_are_removed() {
        let dir = tempfile::tempdir().unwrap();
        // No process has this number: the largest one is 2^22.
        let (host, dead) = (host_name(), 1 << 23);
        let old = std::time::SystemTime::now() - Duration::from_secs(3_600);
        let make = |random: &str, is_old: bool| {
            let name = format!(".a.{host}.{dead}.{random}.tmp");
            let folder = dir.path().join(&name);
            fs::create_dir_all(folder.join("part")).unwrap();
            fs::write(folder.join("part/half"), b"half a file").unwrap();
            if is_old {
                File::open(folder).unwrap().set_modified(old).unwrap();
            }
            name
        };
        let gone = make("0123456789abcdef", true);
        let kept = make("fedcba9876543210", false);
        let fill = |folder: &Path| fs::write(folder.join("whole"), b"x");
        create_folder_with(&dir.path().join("a"), fill).unwrap();
        let mut found = names(dir.path());
        found.sort();
        assert_eq!(found, [kept, "a".into()], "{gone}");
    }

    #[test]
    fn a_folder_appears_with_all_that_is_in_it() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        create_folder_with(&path, |folder| {
            assert!(!path.exists());
            let here = names(dir.path());
            assert!(here.iter().all(|name| is_leftover(name)), "{here:?}");
            fs::create_dir(folder.join("part"))?;
            fs::write(folder.join("part/file"), b"one")
        })
        .unwrap();
        assert_eq!(fs::read(path.join("part/file")).unwrap(), b"one");
        assert_eq!(names(dir.path()), ["a"]);
        // What exists is not replaced, and nothing is written for it.
        let error = create_folder_with(&path, |_| Err(io::Error::other("called"))).unwrap_err();
        assert!(matches!(error, WriteError::Exists { .. }), "{error}");
        assert_eq!(names(&path), ["part"]);
        assert!(create_folder_with(Path::new(".."), |_| io::Result::Ok(())).is_err());
    }

    #[test]
    fn a_folder_that_is_not_finished_leaves_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let failed = create_folder_with(&dir.path().join("a"), |folder| {
            fs::write(folder.join("half"), b"half").map_err(|e| e.to_string())?;
            Err("no more".to_string())
        });
        assert!(matches!(failed, Err(WriteError::Content(why)) if why == "no more"));
        assert_eq!(names(dir.path()), [""; 0]);
        let nowhere = dir.path().join("no/such/folder/a");
        let error = create_folder_with(&nowhere, |_| io::Result::Ok(())).unwrap_err();
        assert!(error.to_string().contains("cannot create"), "{error}");
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
