//! Whether a folder can hold a build by several processes: locks and atomic renames.

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use radarllm_files::atomic::temporary_name;

use crate::DatasetError;

/// Who may work in a folder at the same time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Access {
    /// One process alone.
    Exclusive,
    /// Any number of processes.
    Shared,
}

/// How long a process waits for a lock: more than preparing a folder takes.
const MAX_WAIT: Duration = Duration::from_secs(30);
const WAIT_STEP: Duration = Duration::from_millis(20);

/// Names by which mounted object stores appear in the table of mounts.
const OBJECT_STORES: [&str; 10] = [
    "s3fs",
    "mountpoint-s3",
    "goofys",
    "geesefs",
    "gcsfuse",
    "blobfuse",
    "rclone",
    "ossfs",
    "cosfs",
    "hf-mount",
];

/// Locks a file, which is created if absent, or fails if another process holds it.
///
/// The operating system releases the lock when the file is closed or the process ends, so a killed build does not
/// block the next one.
pub(crate) fn try_lock(path: &Path, dir: &Path, access: Access) -> Result<File, DatasetError> {
    // NFS grants shared locks only on files that are open for reading, and exclusive ones on files open for writing.
    let file = File::options()
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .open(path)
        .map_err(DatasetError::io(path, "create"))?;
    let locked = match access {
        Access::Exclusive => file.try_lock(),
        Access::Shared => file.try_lock_shared(),
    };
    match locked {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(DatasetError::Locked { dir: dir.into() }),
        Err(TryLockError::Error(e)) => Err(unsuitable(dir, format!("no locks: {e}"))),
    }
}

/// Repeats an attempt to lock for some time while another process holds the lock.
pub(crate) fn wait_for_lock<T>(
    mut attempt: impl FnMut() -> Result<T, DatasetError>,
) -> Result<T, DatasetError> {
    let start = Instant::now();
    loop {
        match attempt() {
            Err(DatasetError::Locked { .. }) if start.elapsed() < MAX_WAIT => {
                std::thread::sleep(WAIT_STEP);
            }
            result => return result,
        }
    }
}

/// Refuses addresses and mounts of object stores, which have neither locks nor renames. Nothing is created.
pub(crate) fn check_place(dir: &Path) -> Result<(), DatasetError> {
    if let Some((scheme, _)) = dir.to_string_lossy().split_once(":/")
        && scheme.len() > 1
        && scheme.bytes().all(|b| b.is_ascii_alphanumeric())
    {
        let problem = format!("`{scheme}:` is an address and not a folder");
        return Err(unsuitable(dir, problem));
    }
    // Where there is no such table, the checks of `check_abilities` remain.
    if let Ok(table) = fs::read_to_string("/proc/self/mountinfo")
        && let Some(existing) = nearest_existing(dir)
        && let Some(store) = object_store(&table, &existing)
    {
        return Err(unsuitable(dir, format!("is on `{store}`, an object store")));
    }
    Ok(())
}

/// Tries what a build needs of the file system in `state_dir`, whose lock file this process holds exclusively.
pub(crate) fn check_abilities(
    dir: &Path,
    state_dir: &Path,
    lock_path: &Path,
) -> Result<(), DatasetError> {
    match try_lock(lock_path, dir, Access::Exclusive) {
        Err(DatasetError::Locked { .. }) => {}
        Err(e) => return Err(e),
        Ok(_) => return Err(unsuitable(dir, "locks have no effect".into())),
    }
    let [from, to] = ["new", "old"].map(|name| state_dir.join(temporary_name(name.as_ref())));
    let replaced = (|| {
        fs::write(&to, b"old").map_err(DatasetError::io(&to, "write"))?;
        fs::write(&from, b"new").map_err(DatasetError::io(&from, "write"))?;
        fs::rename(&from, &to)
            .map_err(|e| unsuitable(dir, format!("files cannot be renamed: {e}")))?;
        let found = fs::read(&to).map_err(DatasetError::io(&to, "read"))?;
        match found.as_slice() == b"new" && !from.exists() {
            true => Ok(()),
            false => Err(unsuitable(dir, "renaming does not replace a file".into())),
        }
    })();
    // Best effort: the first error is the one to report, and leftovers are removed later.
    let _ = (fs::remove_file(&from), fs::remove_file(&to));
    replaced
}

fn unsuitable(dir: &Path, problem: String) -> DatasetError {
    DatasetError::Unsuitable {
        dir: dir.into(),
        problem,
    }
}

/// The folder itself or the nearest folder above that exists, without links.
fn nearest_existing(dir: &Path) -> Option<PathBuf> {
    std::path::absolute(dir)
        .ok()?
        .ancestors()
        .find_map(|folder| folder.canonicalize().ok())
}

/// Name of the object store that holds `path`, by the table of mounts of Linux (`/proc/self/mountinfo`).
fn object_store(table: &str, path: &Path) -> Option<&'static str> {
    // ID PARENT MAJOR:MINOR ROOT MOUNT-POINT OPTIONS [TAGS...] - TYPE SOURCE OPTIONS; spaces are written as \040.
    let mounts = table.lines().filter_map(|line| {
        let (place, kind) = line.split_once(" - ")?;
        let point = place.split(' ').nth(4)?.replace("\\040", " ");
        path.starts_with(&point).then_some((point.len(), kind))
    });
    // The innermost mount counts, of several at one place the last.
    let (_, kind) = mounts.max_by_key(|(len, _)| *len)?;
    let mut fields = kind.split(' ');
    let [kind, source] = [fields.next()?, fields.next().unwrap_or_default()];
    let found = OBJECT_STORES.into_iter().find(|store| {
        kind.strip_prefix("fuse.")
            .is_some_and(|k| k.starts_with(store))
            || (kind == "fuse" && source.starts_with(store))
    })?;
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn object_stores_are_recognised_by_the_innermost_mount() {
        let table = "\
22 1 254:0 / / rw,relatime shared:1 - ext4 /dev/vda rw\n\
30 22 0:40 / /mnt/bucket rw,nosuid - fuse.gcsfuse bucket rw\n\
31 22 0:41 / /mnt/my\\040s3 rw - fuse mountpoint-s3 rw\n\
32 30 0:42 / /mnt/bucket/local rw - ext4 /dev/vdb rw\n\
33 22 0:43 / /mnt/ssh rw - fuse.sshfs host:/ rw\n\
not a mount\n";
        for (path, store) in [
            ("/mnt/bucket/data", Some("gcsfuse")),
            ("/mnt/my s3/data", Some("mountpoint-s3")),
            ("/mnt/bucket/local/data", None),
            ("/mnt/bucketful", None),
            ("/mnt/ssh/data", None),
            ("/home/me", None),
        ] {
            assert_eq!(object_store(table, Path::new(path)), store, "{path}");
        }
        assert_eq!(object_store("", Path::new("/a")), None);
    }

    #[test]
    fn addresses_are_refused_and_folders_are_not() {
        for address in [
            "s3://bucket/data",
            "gs://b",
            "hf:/datasets/me/x",
            "https://h/x",
        ] {
            let error = check_place(Path::new(address)).unwrap_err();
            assert!(error.to_string().contains(address), "{error}");
            let hint = error.hint().unwrap().to_string();
            assert!(hint.contains("export"), "{hint}");
        }
        // A drive letter is one letter long.
        for folder in ["data", "./a:b", "/data/x:y/z", "C:/data", "a b:/c"] {
            check_place(Path::new(folder)).unwrap();
        }
    }

    #[test]
    fn a_local_folder_has_all_abilities_and_keeps_no_trace() {
        let dir = tempfile::tempdir().unwrap();
        let lock_path = dir.path().join("lock");
        let _lock = try_lock(&lock_path, dir.path(), Access::Exclusive).unwrap();
        check_abilities(dir.path(), dir.path(), &lock_path).unwrap();
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        let error = try_lock(&lock_path, dir.path(), Access::Shared).unwrap_err();
        assert!(matches!(error, DatasetError::Locked { .. }), "{error}");
    }

    #[test]
    fn shared_locks_exclude_exclusive_ones_only() {
        let dir = tempfile::tempdir().unwrap();
        let lock_path = dir.path().join("lock");
        let take = |access| try_lock(&lock_path, dir.path(), access);
        let (_a, _b) = (take(Access::Shared).unwrap(), take(Access::Shared).unwrap());
        assert!(take(Access::Exclusive).is_err());
    }
}
