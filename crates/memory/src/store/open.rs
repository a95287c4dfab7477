//! Opening of the database: the lock, the file mode, the checks, and what happens to a damaged file.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use radarllm_base::civil;
use radarllm_monitor::points::MAX_BLOB_BYTES;
use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::{Connection, OpenFlags};

use super::schema::{self, Kind};
use crate::error::StoreError;

/// How long a statement waits for another connection, ms. Only a checkpoint or a vacuum makes one wait.
const BUSY_MS: u64 = 1_000;
/// Size to which the write-ahead log is cut when it begins anew, bytes.
const LOG_BYTES: u32 = 8 << 20;
/// Most damaged files of one second that are kept apart by a number.
const MAX_SAME_NAME: u32 = 99;

/// What distinguishes a file from another one that has its name later.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct FileId {
    device: u64,
    inode: u64,
}

impl FileId {
    /// The file of a path; `None` if there is none.
    pub(super) fn of(path: &Path) -> Option<Self> {
        fs::metadata(path).ok().map(|found| Self::from(&found))
    }
}

#[cfg(unix)]
impl From<&fs::Metadata> for FileId {
    fn from(found: &fs::Metadata) -> Self {
        use std::os::unix::fs::MetadataExt;
        Self {
            device: found.dev(),
            inode: found.ino(),
        }
    }
}

/// Other systems refuse to delete a file that is open; only its absence is seen there.
#[cfg(not(unix))]
impl From<&fs::Metadata> for FileId {
    fn from(_: &fs::Metadata) -> Self {
        Self {
            device: 0,
            inode: 0,
        }
    }
}

/// A path with something appended to its file name.
pub(super) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(suffix);
    name.into()
}

/// The absolute path. SQLite would read a relative path that begins with `file:` as a URI with options.
pub(super) fn absolute(path: &Path) -> Result<PathBuf, StoreError> {
    std::path::absolute(path).map_err(|source| StoreError::Io {
        path: path.into(),
        operation: "find",
        source,
    })
}

/// Locks the database for one writer. The lock is a file of its own: closing any handle of the database itself would
/// release the locks of SQLite (POSIX `fcntl`).
pub(super) fn lock(path: &Path) -> Result<File, StoreError> {
    let lock_path = with_suffix(path, ".lock");
    let io = |operation| {
        let path = lock_path.clone();
        move |source| StoreError::Io {
            path,
            operation,
            source,
        }
    };
    let mut options = OpenOptions::new();
    options.create(true).truncate(false).write(true);
    private(&mut options);
    let file = options.open(&lock_path).map_err(io("create"))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(StoreError::Locked { path: path.into() }),
        Err(TryLockError::Error(source)) => Err(io("lock")(source)),
    }
}

/// The write-ahead log of a database, if there is one.
pub(super) fn log_of(path: &Path) -> Option<FileId> {
    FileId::of(&with_suffix(path, "-wal"))
}

/// Removes the write-ahead log of a database that is gone, with its index, unless another file has its name meanwhile.
pub(super) fn remove_log(path: &Path, log: FileId) -> Result<(), StoreError> {
    if log_of(path) != Some(log) {
        return Ok(());
    }
    for file in ["-wal", "-shm"].map(|suffix| with_suffix(path, suffix)) {
        match fs::remove_file(&file) {
            Err(source) if source.kind() != io::ErrorKind::NotFound => {
                return Err(StoreError::Io {
                    path: file,
                    operation: "remove",
                    source,
                });
            }
            _ => {}
        }
    }
    Ok(())
}

/// Whether `lock` is still the lock of a database: if its file was deleted, another process can take a new one.
pub(super) fn holds(lock: &File, path: &Path) -> bool {
    let held = lock.metadata().ok().map(|found| FileId::from(&found));
    held.is_some() && held == FileId::of(&with_suffix(path, ".lock"))
}

/// Opens the database for writing, or creates it.
pub(super) fn writer(path: &Path) -> Result<Connection, StoreError> {
    create(path)?;
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(path, flags)
        .and_then(|c| harden(&c).map(|()| c))
        .map_err(|e| StoreError::of(path, "open", e))?;
    let kind = checked_kind(path, &connection)?;
    if kind != Kind::Empty {
        quick_check(path, &connection)?;
    }
    let sql = |operation| move |e| StoreError::of(path, operation, e);
    // `auto_vacuum` has an effect only before the first table.
    let mode: String = connection
        .execute_batch("PRAGMA auto_vacuum = INCREMENTAL")
        .and_then(|()| connection.query_row("PRAGMA journal_mode = WAL", [], |row| row.get(0)))
        .map_err(sql("begin a write-ahead log"))?;
    if mode != "wal" {
        return Err(unusable(
            path,
            format!("the file system permits the journal mode `{mode}` only, expected `wal`"),
        ));
    }
    connection
        .execute_batch(&format!(
            "PRAGMA synchronous = NORMAL;
             PRAGMA secure_delete = ON;
             PRAGMA foreign_keys = ON;
             PRAGMA journal_size_limit = {LOG_BYTES};"
        ))
        .map_err(sql("configure"))?;
    let version = match kind {
        Kind::Ours(version) => version,
        Kind::Empty | Kind::Foreign => 0,
    };
    schema::migrate(&connection, version).map_err(sql("create the tables"))?;
    check_tables(path, &connection)?;
    make_private(path)?;
    Ok(connection)
}

/// Opens an existing database for reading. One of an earlier version gets the tables of this one first.
pub(super) fn reader(path: &Path) -> Result<Connection, StoreError> {
    fs::metadata(path).map_err(|source| StoreError::Io {
        path: path.into(),
        operation: "open",
        source,
    })?;
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(path, flags)
        .and_then(|c| harden(&c).map(|()| c))
        .map_err(|e| StoreError::of(path, "open", e))?;
    match checked_kind(path, &connection)? {
        Kind::Ours(schema::NEWEST) => check_tables(path, &connection)?,
        Kind::Ours(_) => {
            drop(connection);
            let lock = lock(path)?;
            let connection = writer(path)?;
            connection
                .pragma_update(None, "query_only", true)
                .map_err(|e| StoreError::of(path, "configure", e))?;
            drop(lock);
            return Ok(connection);
        }
        Kind::Empty | Kind::Foreign => {
            return Err(unusable(path, "the database has no timeline".into()));
        }
    }
    Ok(connection)
}

/// Renames a damaged database to `NAME.damaged-UTC` and returns the new path. Its write-ahead log goes with it, so that
/// both can still be examined.
pub(super) fn set_aside(path: &Path, now_ms: i64) -> Result<PathBuf, StoreError> {
    let io = |source| StoreError::Io {
        path: path.into(),
        operation: "set the damaged database aside",
        source,
    };
    let stamp = with_suffix(path, &format!(".damaged-{}", civil::compact_utc(now_ms)));
    let numbered = (2..=MAX_SAME_NAME).map(|n| with_suffix(&stamp, &format!("-{n}")));
    let aside = std::iter::once(stamp.clone())
        .chain(numbered)
        .find(|name| fs::symlink_metadata(name).is_err())
        .ok_or_else(|| io(io::ErrorKind::AlreadyExists.into()))?;
    fs::rename(path, &aside).map_err(io)?;
    let log = with_suffix(path, "-wal");
    if fs::symlink_metadata(&log).is_ok() {
        fs::rename(&log, with_suffix(&aside, "-wal")).map_err(io)?;
    }
    // The index of the log; SQLite makes a new one.
    match fs::remove_file(with_suffix(path, "-shm")) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(io(e)),
        _ => Ok(aside),
    }
}

/// The kind of the file, or an error if it is a foreign or a newer one.
fn checked_kind(path: &Path, connection: &Connection) -> Result<Kind, StoreError> {
    match schema::kind(connection).map_err(|e| StoreError::of(path, "read", e))? {
        Kind::Foreign => Err(unusable(
            path,
            "this is a database of another program".into(),
        )),
        Kind::Ours(found) if found > schema::NEWEST => Err(StoreError::Newer {
            path: path.into(),
            found,
            known: schema::NEWEST,
        }),
        kind => Ok(kind),
    }
}

fn check_tables(path: &Path, connection: &Connection) -> Result<(), StoreError> {
    match schema::is_genuine(connection).map_err(|e| StoreError::of(path, "read the tables", e))? {
        true => Ok(()),
        false => Err(unusable(
            path,
            format!(
                "the tables are not those of schema version {}",
                schema::NEWEST
            ),
        )),
    }
}

fn quick_check(path: &Path, connection: &Connection) -> Result<(), StoreError> {
    let found: String = connection
        .query_row("PRAGMA quick_check(1)", [], |row| row.get(0))
        .map_err(|e| StoreError::of(path, "check", e))?;
    match found.as_str() {
        "ok" => Ok(()),
        problem => Err(StoreError::Damaged {
            path: path.into(),
            problem: problem.chars().take(200).collect(),
        }),
    }
}

/// Limits what a file from elsewhere can do: no code in its definitions is trusted, and no value is longer than ours.
fn harden(connection: &Connection) -> rusqlite::Result<()> {
    connection.busy_timeout(Duration::from_millis(BUSY_MS))?;
    connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, 2 * MAX_BLOB_BYTES as i32)?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true)?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
    connection.execute_batch("PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0;")
}

/// Creates an empty file that only its owner reads. SQLite gives its log the mode of the database.
fn create(path: &Path) -> Result<(), StoreError> {
    let mut options = OpenOptions::new();
    options.create_new(true).write(true);
    private(&mut options);
    match options.open(path) {
        Err(e) if e.kind() != io::ErrorKind::AlreadyExists => Err(StoreError::Io {
            path: path.into(),
            operation: "create",
            source: e,
        }),
        _ => Ok(()),
    }
}

#[cfg(unix)]
fn private(options: &mut OpenOptions) {
    use std::os::unix::fs::OpenOptionsExt;
    options.mode(0o600);
}

#[cfg(not(unix))]
fn private(_: &mut OpenOptions) {}

/// Takes the permission to read from others, if the file had another mode.
#[cfg(unix)]
fn make_private(path: &Path) -> Result<(), StoreError> {
    use std::os::unix::fs::PermissionsExt;
    for file in ["", "-wal", "-shm"].map(|suffix| with_suffix(path, suffix)) {
        match fs::set_permissions(&file, fs::Permissions::from_mode(0o600)) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => {
                return Err(StoreError::Io {
                    path: file,
                    operation: "make private",
                    source: e,
                });
            }
            _ => {}
        }
    }
    Ok(())
}

#[cfg(not(unix))]
fn make_private(_: &Path) -> Result<(), StoreError> {
    Ok(())
}

fn unusable(path: &Path, problem: String) -> StoreError {
    StoreError::Unusable {
        path: path.into(),
        problem,
    }
}
