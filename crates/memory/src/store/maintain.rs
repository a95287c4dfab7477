//! Keeping the memory small, and forgetting.

use radarllm_base::civil::DAY_MS;
use radarllm_monitor::rows::EventKind;
use rusqlite::{ToSql, TransactionBehavior, params};
use serde::Serialize;

use super::Store;
use super::limits::check_time;
use crate::error::StoreError;

/// Rows that are deleted in one transaction. A short transaction keeps the write-ahead log short.
const BATCH_ROWS: i64 = 1_000;
/// As [`BATCH_ROWS`], for points: a blob can have megabytes, all of which pass through the write-ahead log as zeros.
const BATCH_BLOBS: i64 = 64;
/// Pages that are given back to the file system in one transaction.
const BATCH_PAGES: u32 = 2_000;

/// How long rows are kept, and how large the database may become.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Retention {
    /// Age at which activities are deleted, ms after their end.
    pub activities_ms: i64,
    /// Age at which events are deleted, with the points around them, ms.
    pub events_ms: i64,
    /// Age at which points of activities are deleted, ms after their end.
    pub points_ms: i64,
    /// Largest size of the database without free pages, bytes. Above it, points of activities are deleted first, then
    /// points around events, then activities, the oldest first. Events stay.
    pub max_bytes: u64,
}

impl Default for Retention {
    /// Activities for 30 days, events for 365, no points of activities; 512 MiB.
    fn default() -> Self {
        Self {
            activities_ms: 30 * DAY_MS,
            events_ms: 365 * DAY_MS,
            points_ms: 0,
            max_bytes: 512 << 20,
        }
    }
}

/// Numbers of deleted rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize)]
pub struct Deleted {
    /// Activities.
    pub activities: u64,
    /// Events.
    pub events: u64,
    /// Stretches of points that were deleted by themselves, not together with their activity or event.
    pub points: u64,
}

/// Result of a checkpoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Checkpoint {
    /// The write-ahead log is empty.
    Complete,
    /// A reader still needs the write-ahead log.
    ReaderActive,
}

/// Oldest rows of a table, as many as the last parameter says.
const OLD_ACTIVITIES: &str = "DELETE FROM activity WHERE id IN
    (SELECT id FROM activity WHERE start_ms < ?1 AND end_ms < ?1 ORDER BY start_ms LIMIT ?2)";
const OLD_EVENTS: &str = "DELETE FROM event WHERE id IN
    (SELECT id FROM event WHERE at_ms < ?1 ORDER BY at_ms LIMIT ?2)";
const OLD_POINTS: &str = "DELETE FROM points WHERE id IN
    (SELECT id FROM points WHERE start_ms < ?1 AND end_ms < ?1 AND activity IS NOT NULL ORDER BY start_ms LIMIT ?2)";
const OLD_EVENT_POINTS: &str = "DELETE FROM points WHERE id IN
    (SELECT id FROM points WHERE start_ms < ?1 AND event IS NOT NULL ORDER BY start_ms LIMIT ?2)";
/// Runs of a time before which all events were deleted.
const OLD_RUNS: &str =
    "DELETE FROM run WHERE id IN (SELECT id FROM run WHERE end_ms < ?1 LIMIT ?2)";
/// Activities before a time were deleted: that they are not there does not mean that nothing happened.
const FORGET_ACTIVITIES: &str =
    "UPDATE run SET activities_ms = ?1 WHERE start_ms < ?1 AND activities_ms < ?1";
const UNUSED_ORIGINS: &str = "DELETE FROM origin WHERE id IN (SELECT id FROM origin o
    WHERE NOT EXISTS (SELECT 1 FROM activity WHERE origin = o.id)
    AND NOT EXISTS (SELECT 1 FROM event WHERE origin = o.id) LIMIT ?1)";

impl Store {
    /// Deletes what is older than the retention permits, then what exceeds the size, and gives the space back.
    ///
    /// # Errors
    /// A database that cannot be written. What was deleted before stays deleted.
    pub fn prune(&mut self, now_ms: i64, retention: &Retention) -> Result<Deleted, StoreError> {
        check_time("now_ms", now_ms)?;
        let before = |age_ms: i64| now_ms.saturating_sub(age_ms.max(0));
        let points_ms = before(retention.points_ms);
        let activities_ms = before(retention.activities_ms);
        let events_ms = before(retention.events_ms);
        let mut deleted = Deleted {
            points: self.delete_all(OLD_POINTS, &[&points_ms, &BATCH_BLOBS])?,
            activities: self.delete_all(OLD_ACTIVITIES, &[&activities_ms, &BATCH_ROWS])?,
            events: self.delete_all(OLD_EVENTS, &[&events_ms, &BATCH_ROWS])?,
        };
        for sql in [OLD_POINTS, OLD_EVENT_POINTS] {
            deleted.points += self.shrink(retention.max_bytes, sql, BATCH_BLOBS)?;
        }
        let n_shrunk = self.shrink(retention.max_bytes, OLD_ACTIVITIES, BATCH_ROWS)?;
        deleted.activities += n_shrunk;
        self.delete_all(OLD_RUNS, &[&events_ms, &BATCH_ROWS])?;
        self.delete(
            "UPDATE run SET start_ms = ?1 WHERE start_ms < ?1",
            &[&events_ms],
        )?;
        self.delete(FORGET_ACTIVITIES, &[&activities_ms])?;
        if n_shrunk > 0 {
            let oldest = "SELECT coalesce(min(start_ms), ?1) FROM activity";
            let connection = &self.timeline.connection;
            let kept_ms: i64 = connection
                .query_row(oldest, [now_ms], |row| row.get(0))
                .map_err(|e| self.timeline.error("read the oldest time", e))?;
            self.delete(FORGET_ACTIVITIES, &[&kept_ms])?;
        }
        self.delete_all(UNUSED_ORIGINS, &[&BATCH_ROWS])?;
        self.give_back()?;
        Ok(deleted)
    }

    /// Forgets everything before a time, or between two times, milliseconds since 1970 in UTC: activities that overlap
    /// the range, events in it, and points from it. `from_ms` belongs to the range, `to_ms` does not. Nothing is known of the
    /// range afterwards, not even that nothing happened: runs that overlap it are cut.
    ///
    /// Afterwards the bytes are neither in the database nor in its write-ahead log: the rows are overwritten, the
    /// full-text index is built anew, the database is rewritten, and the log is emptied. This needs free space for twice
    /// the database, partly in the folder for temporary files, where SQLite puts a copy of the remaining rows and removes
    /// it. Blocks that the file system freed are its own affair, and so are backups.
    ///
    /// # Errors
    /// [`StoreError::Invalid`] for an empty range, [`StoreError::LogInUse`] if a reader prevents the log from being
    /// emptied, [`StoreError::Replaced`], or a database that cannot be written. The call can then be repeated.
    pub fn forget(&mut self, from_ms: Option<i64>, to_ms: i64) -> Result<Deleted, StoreError> {
        let from_ms = from_ms.unwrap_or(i64::MIN);
        if from_ms >= to_ms {
            return Err(StoreError::invalid(
                "to_ms",
                "a time after `from_ms`",
                to_ms,
            ));
        }
        if !self.timeline.is_in_place() {
            let path = self.timeline.path.clone();
            return Err(StoreError::Replaced { path });
        }
        self.keep_states(from_ms, to_ms)?;
        let mut delete = |sql, n_rows: i64| self.delete_all(sql, &[&from_ms, &to_ms, &n_rows]);
        let deleted = Deleted {
            points: delete(
                "DELETE FROM points WHERE id IN (SELECT id FROM points
                 WHERE start_ms < ?2 AND (end_ms > ?1 OR start_ms >= ?1) LIMIT ?3)",
                BATCH_BLOBS,
            )?,
            activities: delete(
                "DELETE FROM activity WHERE id IN (SELECT id FROM activity
                 WHERE start_ms < ?2 AND (end_ms > ?1 OR start_ms >= ?1) LIMIT ?3)",
                BATCH_ROWS,
            )?,
            events: delete(
                "DELETE FROM event WHERE id IN (SELECT id FROM event
                 WHERE at_ms >= ?1 AND at_ms < ?2 LIMIT ?3)",
                BATCH_ROWS,
            )?,
        };
        for sql in [
            "INSERT INTO run (start_ms, end_ms, is_over, activities_ms)
             SELECT start_ms, ?1, 1, activities_ms FROM run WHERE start_ms < ?1 AND end_ms > ?2",
            "DELETE FROM run WHERE start_ms >= ?1 AND end_ms <= ?2",
        ] {
            self.delete(sql, &[&from_ms, &to_ms])?;
        }
        let begin_later = "UPDATE run SET start_ms = ?1 WHERE start_ms < ?1 AND end_ms > ?1";
        self.delete(begin_later, &[&to_ms])?;
        let end_earlier =
            "UPDATE run SET end_ms = ?1, is_over = 1 WHERE start_ms < ?1 AND end_ms > ?1";
        self.delete(end_earlier, &[&from_ms])?;
        self.delete_all(UNUSED_ORIGINS, &[&BATCH_ROWS])?;
        // First the zeros of `secure_delete` reach the database, then the rewritten database.
        self.checkpoint()?;
        self.execute(
            "rewrite the database",
            "INSERT INTO activity_fts (activity_fts) VALUES ('rebuild'); VACUUM;",
        )?;
        match self.checkpoint()? {
            Checkpoint::Complete => Ok(deleted),
            Checkpoint::ReaderActive => Err(StoreError::LogInUse {
                path: self.timeline.path.clone(),
            }),
        }
    }

    /// Keeps what was so at the end of a range that is forgotten, as an event of that moment: that somebody was there, and that
    /// the radar was silent.
    fn keep_states(&mut self, from_ms: i64, to_ms: i64) -> Result<(), StoreError> {
        let states = [
            [EventKind::Present, EventKind::Absent],
            [EventKind::SourceLost, EventKind::SourceBack],
        ];
        for [begun, ended] in states {
            self.delete(
                "UPDATE event SET at_ms = ?2, person = NULL, data = NULL WHERE kind = ?3 AND at_ms >= ?1 AND id = (
                    SELECT e.id FROM event e JOIN run r ON r.start_ms <= e.at_ms AND r.start_ms < ?2 AND r.end_ms > ?2
                    WHERE e.kind IN (?3, ?4) AND e.at_ms < ?2 ORDER BY e.at_ms DESC, e.id DESC LIMIT 1)",
                &[&from_ms, &to_ms, &begun.name(), &ended.name()],
            )?;
        }
        Ok(())
    }

    /// Writes the log into the database and empties it. To be called every hour or so.
    ///
    /// # Errors
    /// A database that cannot be written.
    pub fn checkpoint(&mut self) -> Result<Checkpoint, StoreError> {
        let busy: bool = self
            .timeline
            .connection
            .query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |row| row.get(0))
            .map_err(|e| self.timeline.error("empty the write-ahead log", e))?;
        Ok(match busy {
            true => Checkpoint::ReaderActive,
            false => Checkpoint::Complete,
        })
    }

    /// Checks the whole database, including the full-text index.
    ///
    /// # Errors
    /// [`StoreError::Damaged`] with the first problem, or a database that cannot be read.
    pub fn check_integrity(&self) -> Result<(), StoreError> {
        let found: String = self
            .timeline
            .connection
            .query_row("PRAGMA integrity_check(1)", [], |row| row.get(0))
            .map_err(|e| self.timeline.error("check", e))?;
        match found.as_str() {
            "ok" => Ok(()),
            problem => Err(StoreError::Damaged {
                path: self.timeline.path.clone(),
                problem: problem.chars().take(200).collect(),
            }),
        }
    }

    /// Size of the database without its free pages, bytes.
    ///
    /// # Errors
    /// A database that cannot be read.
    pub fn used_bytes(&self) -> Result<u64, StoreError> {
        let sql = "SELECT (page_count - freelist_count) * page_size
                   FROM pragma_page_count, pragma_freelist_count, pragma_page_size";
        self.timeline
            .connection
            .query_row(sql, [], |row| row.get(0))
            .map_err(|e| self.timeline.error("read the size", e))
    }

    /// Deletes the oldest rows in batches until the database is small enough or nothing is left to delete.
    fn shrink(&mut self, max_bytes: u64, sql: &str, n_rows: i64) -> Result<u64, StoreError> {
        let mut n_deleted = 0;
        while self.used_bytes()? > max_bytes {
            match self.delete(sql, params![i64::MAX, n_rows])? {
                0 => break,
                n => n_deleted += n,
            }
            if sql == OLD_ACTIVITIES {
                // The pages of the full-text index stay half empty until they are merged. Without this, more rows would
                // be deleted than necessary.
                self.execute(
                    "merge the full-text index",
                    "INSERT INTO activity_fts (activity_fts) VALUES ('optimize')",
                )?;
            }
        }
        Ok(n_deleted)
    }

    /// Gives free pages at the end of the database back to the file system.
    fn give_back(&mut self) -> Result<(), StoreError> {
        let free = |store: &Self| {
            let sql = "PRAGMA freelist_count";
            let read = store
                .timeline
                .connection
                .query_row(sql, [], |row| row.get(0));
            read.map_err(|e| store.timeline.error("read the size", e))
        };
        let mut n_free: u64 = free(self)?;
        while n_free > 0 {
            self.execute(
                "give space back",
                &format!("PRAGMA incremental_vacuum({BATCH_PAGES})"),
            )?;
            let rest = free(self)?;
            if rest >= n_free {
                break;
            }
            n_free = rest;
        }
        Ok(())
    }

    /// Deletes in batches until nothing is left to delete.
    fn delete_all(&mut self, sql: &str, values: &[&dyn ToSql]) -> Result<u64, StoreError> {
        let mut n_deleted = 0;
        loop {
            match self.delete(sql, values)? {
                0 => return Ok(n_deleted),
                n => n_deleted += n,
            }
        }
    }

    /// Deletes or changes rows in one transaction. Returns how many.
    fn delete(&mut self, sql: &str, values: &[&dyn ToSql]) -> Result<u64, StoreError> {
        let path = &self.timeline.path;
        let mut delete = || {
            let transaction = self
                .timeline
                .connection
                .transaction_with_behavior(TransactionBehavior::Immediate)?;
            let n_deleted = transaction.prepare_cached(sql)?.execute(values)?;
            transaction.commit()?;
            Ok(n_deleted as u64)
        };
        delete().map_err(|e| StoreError::of(path, "delete rows", e))
    }

    fn execute(&self, operation: &'static str, sql: &str) -> Result<(), StoreError> {
        self.timeline
            .connection
            .execute_batch(sql)
            .map_err(|e| self.timeline.error(operation, e))
    }
}
