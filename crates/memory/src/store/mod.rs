//! The memory: an SQLite database with activities, events, points, where they come from, and when a radar was watched.
//!
//! One [`Store`] writes; any number of [`Timeline`]s read, also in other processes. Times are milliseconds since 1970 in
//! UTC; the present time is always given by the caller.
//!
//! What is kept is in [`rows`](radarllm_monitor::rows).
//!
//! Reading order: [`limits`] (of what is kept), [`timeline`] (queries), [`runs`] (of which time something is known),
//! [`lanes`] (a range of time for a page), `falls` (alarms), [`write`](mod@write) (transactions), [`maintain`]
//! (retention, forgetting, checks); private: `schema` (tables), `open` (lock, file mode, damaged files), `cursor` (pages), `filter`
//! (queries to SQL conditions), `convert` (rows of tables to types), `text` (words of a user to a full-text query).

mod convert;
mod cursor;
pub(crate) mod falls;
mod filter;
pub mod lanes;
pub mod limits;
pub mod maintain;
mod open;
pub mod runs;
mod schema;
#[cfg(test)]
pub(crate) mod tests;
pub(crate) mod text;
pub mod timeline;
pub mod write;

use std::fs::File;
use std::path::{Path, PathBuf};

use rusqlite::{Connection, TransactionBehavior};

pub use cursor::Cursor;
pub use maintain::{Checkpoint, Deleted, Retention};
pub use runs::Run;
pub use timeline::{ActivityQuery, EventQuery, Page, PointsOf, Tally, Timeline};
pub use write::Batch;

use crate::error::StoreError;
use open::FileId;

/// The memory, open for writing. Only one can be open for a database.
#[derive(Debug)]
pub struct Store {
    timeline: Timeline,
    /// The write-ahead log; `None` before the first row was written.
    log: Option<FileId>,
    /// Dropped last: another store may open only after the connection is closed.
    lock: File,
}

/// A store that was opened.
#[derive(Debug)]
pub struct Opened {
    /// The store.
    pub store: Store,
    /// Where the former database is now, if it was damaged. The store is then a new, empty one, and the user should know.
    pub set_aside: Option<DamagedFile>,
}

/// A damaged database that was set aside.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DamagedFile {
    /// Its new name.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: String,
}

impl Store {
    /// Opens a database for writing, or creates it with a mode that only the owner reads (0600). A damaged one is
    /// renamed to `NAME.damaged-UTC`, and a new one is created. Beside the database there are `NAME.lock`, `NAME-wal`
    /// and `NAME-shm`.
    ///
    /// # Errors
    /// [`StoreError::Locked`] if another process writes, [`StoreError::Newer`] for a database of a later version,
    /// [`StoreError::Unusable`] for one of another program, or an error of the operating system. The file is then
    /// unchanged.
    pub fn open(path: &Path, now_ms: i64) -> Result<Opened, StoreError> {
        let path = open::absolute(path)?;
        let lock = open::lock(&path)?;
        let (connection, set_aside) = match open::writer(&path) {
            Ok(connection) => (connection, None),
            Err(StoreError::Damaged { problem, .. }) => {
                let aside = DamagedFile {
                    path: open::set_aside(&path, now_ms)?,
                    problem,
                };
                (open::writer(&path)?, Some(aside))
            }
            Err(e) => return Err(e),
        };
        let store = Self {
            timeline: Timeline::of(connection, path),
            log: None,
            lock,
        };
        Ok(Opened { store, set_aside })
    }

    /// Opens the database of the path again, or creates it: what somebody deleted or replaced stays lost, and what comes is
    /// kept. Until this succeeds, writing fails with [`StoreError::Replaced`].
    ///
    /// # Errors
    /// As [`Self::open`], and [`StoreError::Damaged`].
    pub fn reopen(&mut self) -> Result<(), StoreError> {
        let path = self.timeline.path.clone();
        let sql = |e| StoreError::of(&path, "open", e);
        // The old connection is closed first. SQLite leaves its log where it is, because the database is not there any more;
        // beside another database, it would be taken for the log of that one.
        let nowhere = Connection::open_in_memory().map_err(sql)?;
        self.timeline = Timeline::nowhere(nowhere, path.clone());
        if let Some(log) = self.log.take() {
            open::remove_log(&path, log)?;
        }
        if !open::holds(&self.lock, &path) {
            self.lock = open::lock(&path)?;
        }
        self.timeline = Timeline::of(open::writer(&path)?, path);
        Ok(())
    }

    /// The memory for reading, through the connection of this store.
    pub fn timeline(&self) -> &Timeline {
        &self.timeline
    }

    /// Limits the database to a number of pages, or to its present size if that is more. What would make it larger then
    /// fails with [`StoreError::Full`], as on a full disk.
    ///
    /// # Errors
    /// A database that cannot be read.
    pub fn limit_pages(&self, pages: u32) -> Result<(), StoreError> {
        let sql = format!("PRAGMA max_page_count = {pages}");
        let limited = self.timeline.connection.execute_batch(&sql);
        limited.map_err(|e| self.timeline.error("limit the size", e))
    }

    /// Writes in one transaction. If `work` fails, nothing of it is kept.
    ///
    /// # Errors
    /// The error of `work`, a database that cannot be written, or [`StoreError::Replaced`].
    pub fn write<T>(
        &mut self,
        work: impl FnOnce(&Batch<'_>) -> Result<T, StoreError>,
    ) -> Result<T, StoreError> {
        let path = self.timeline.path.as_path();
        if !self.timeline.is_in_place() {
            return Err(StoreError::Replaced { path: path.into() });
        }
        let error = |e| StoreError::of(path, "write", e);
        let transaction = self
            .timeline
            .connection
            .transaction_with_behavior(TransactionBehavior::Immediate)
            .map_err(error)?;
        let batch = Batch { transaction, path };
        let result = work(&batch)?;
        batch.transaction.commit().map_err(error)?;
        if self.log.is_none() {
            self.log = open::log_of(&self.timeline.path);
        }
        Ok(result)
    }
}
