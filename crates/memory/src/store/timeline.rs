//! Reading the memory.

use std::path::{Path, PathBuf};

use radarllm_monitor::points::{self, FramePoints};
use radarllm_monitor::rows::{ActivityRow, EventKind, EventRow};
use rusqlite::{Connection, OptionalExtension, Row, Transaction, params_from_iter};
use serde::Serialize;

use super::convert;
use super::cursor::Cursor;
use super::filter::Filter;
use super::open::{self, FileId};
use crate::error::StoreError;

/// Most rows of a page.
pub const MAX_PAGE: usize = 500;
/// Most actions of a query.
pub const MAX_ACTIONS: usize = 32;

/// Which activities are wanted. The default is all of them.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct ActivityQuery {
    /// Activities that end after this time, milliseconds since 1970 in UTC.
    pub from_ms: Option<i64>,
    /// Activities that begin before this time.
    pub to_ms: Option<i64>,
    /// Activities of this track.
    pub person: Option<u32>,
    /// Activities with one of these actions; empty for all. At most [`MAX_ACTIONS`].
    pub actions: Vec<String>,
    /// Activities whose caption or action has all words of this text, in any inflection. A text without a word matches
    /// nothing.
    pub text: Option<String>,
}

/// Which events are wanted. The default is all of them.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct EventQuery {
    /// Events at or after this time, milliseconds since 1970 in UTC.
    pub from_ms: Option<i64>,
    /// Events before this time.
    pub to_ms: Option<i64>,
    /// Events of this track.
    pub person: Option<u32>,
    /// Events of one of these kinds; empty for all.
    pub kinds: Vec<EventKind>,
}

/// Rows of a list, newest first.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Page<T> {
    /// The rows.
    pub rows: Vec<T>,
    /// Where the next page begins, if there are more rows.
    #[serde(serialize_with = "as_text")]
    pub next: Option<Cursor>,
}

fn as_text<S: serde::Serializer>(cursor: &Option<Cursor>, s: S) -> Result<S::Ok, S::Error> {
    match cursor {
        Some(cursor) => s.collect_str(cursor),
        None => s.serialize_none(),
    }
}

/// Sums over the activities of a query. Times are cut at the ends of the query.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default, Serialize)]
pub struct Tally {
    /// Number of activities; those of one person that overlap count once.
    pub count: u64,
    /// Beginning of the first one, milliseconds since 1970 in UTC.
    pub first_ms: Option<i64>,
    /// Beginning of the last one.
    pub last_ms: Option<i64>,
    /// Duration of all together, ms. Two people at once count twice, and two activities of one person at once do not.
    pub total_ms: i64,
    /// Duration of the longest, ms.
    pub longest_ms: i64,
    /// Whether a simulated radar is among their origins.
    pub synthetic: bool,
}

/// Whose points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointsOf {
    /// Those of the activity with this number.
    Activity(i64),
    /// Those around the event with this number.
    Event(i64),
}

/// Order of a list by time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Order {
    NewestFirst,
    OldestFirst,
}

/// A view of the memory for reading. Any number of them can be open while one [`Store`](super::Store) writes, also in
/// other processes. A query sees what was committed before it.
#[derive(Debug)]
pub struct Timeline {
    pub(super) connection: Connection,
    pub(super) path: PathBuf,
    /// The file that is open; `None` if there is none.
    file: Option<FileId>,
}

impl Timeline {
    /// Opens an existing database for reading.
    ///
    /// # Errors
    /// A file that does not exist, is locked, damaged, of another program or of a newer version.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        let path = open::absolute(path)?;
        let connection = open::reader(&path)?;
        Ok(Self::of(connection, path))
    }

    /// The memory through a connection to the database of this path, which was opened just now.
    pub(super) fn of(connection: Connection, path: PathBuf) -> Self {
        let file = FileId::of(&path);
        Self {
            connection,
            path,
            file,
        }
    }

    /// A memory of which no file is open.
    pub(super) fn nowhere(connection: Connection, path: PathBuf) -> Self {
        Self {
            connection,
            path,
            file: None,
        }
    }

    /// Whether the database is still the file of its path. It is not if somebody deleted or replaced it; SQLite would go on
    /// with the file that has no name any more.
    pub fn is_in_place(&self) -> bool {
        self.file.is_some() && self.file == FileId::of(&self.path)
    }

    /// The activities of a query, newest first by their beginning, at most `limit` (and at most [`MAX_PAGE`]), from the
    /// row after `before` on. Following [`Page::next`] returns every row once.
    ///
    /// # Errors
    /// A query with too many actions, or a database that cannot be read.
    pub fn activities(
        &self,
        query: &ActivityQuery,
        before: Option<Cursor>,
        limit: usize,
    ) -> Result<Page<ActivityRow>, StoreError> {
        let Some(mut filter) = Filter::of_activities(query)? else {
            return Ok(Page::empty());
        };
        filter.before("a.start_ms", "a.id", before);
        let limit = limit.min(MAX_PAGE);
        let rows = self.select_activities(filter, Order::NewestFirst, limit + 1)?;
        Ok(Page::new(rows, limit, |row| Cursor {
            at_ms: row.activity.start_ms,
            id: row.id,
        }))
    }

    /// The activity with a number, or `None`.
    ///
    /// # Errors
    /// A database that cannot be read.
    pub fn activity(&self, id: i64) -> Result<Option<ActivityRow>, StoreError> {
        let mut filter = Filter::default();
        filter.and("a.id = ?", [id.into()]);
        let rows = self.select_activities(filter, Order::NewestFirst, 1)?;
        Ok(rows.into_iter().next())
    }

    /// The events of a query, newest first, at most `limit` (and at most [`MAX_PAGE`]), from the row after `before` on.
    ///
    /// # Errors
    /// A database that cannot be read.
    pub fn events(
        &self,
        query: &EventQuery,
        before: Option<Cursor>,
        limit: usize,
    ) -> Result<Page<EventRow>, StoreError> {
        let mut filter = Filter::default();
        filter.and_some("e.at_ms >= ?", query.from_ms);
        filter.and_some("e.at_ms < ?", query.to_ms);
        filter.and_some("e.person = ?", query.person.map(i64::from));
        // A kind that is asked for twice changes nothing, and the list is bounded.
        let kinds = EventKind::ALL
            .into_iter()
            .filter(|k| query.kinds.contains(k));
        filter.and_any("e.kind", kinds.map(|k| k.name().to_string().into()));
        filter.before("e.at_ms", "e.id", before);
        let limit = limit.min(MAX_PAGE);
        let sql = format!(
            "SELECT {} FROM event e JOIN origin o ON o.id = e.origin {}
             ORDER BY e.at_ms DESC, e.id DESC LIMIT ?",
            convert::EVENT_COLUMNS,
            filter.sql()
        );
        let rows = self.select("read events", &sql, filter, limit + 1, convert::event)?;
        Ok(Page::new(rows, limit, |row| Cursor {
            at_ms: row.event.at_ms,
            id: row.id,
        }))
    }

    /// The points of an activity or around an event, or `None` if none are kept.
    ///
    /// # Errors
    /// A database that cannot be read, or points that are damaged.
    pub fn points(&self, of: PointsOf) -> Result<Option<Vec<FramePoints>>, StoreError> {
        let (sql, id) = match of {
            PointsOf::Activity(id) => ("SELECT blob FROM points WHERE activity = ?1", id),
            PointsOf::Event(id) => ("SELECT blob FROM points WHERE event = ?1", id),
        };
        let read = || {
            let mut statement = self.connection.prepare_cached(sql)?;
            let blob = |row: &Row<'_>| Ok(points::decode(row.get_ref(0)?.as_blob()?));
            statement.query_row([id], blob).optional()
        };
        match read().map_err(|e| self.error("read points", e))? {
            None => Ok(None),
            Some(Ok(frames)) => Ok(Some(frames)),
            Some(Err(problem)) => Err(StoreError::Damaged {
                path: self.path.clone(),
                problem: problem.to_string(),
            }),
        }
    }

    /// Counts and sums the activities of a query.
    ///
    /// # Errors
    /// A query with too many actions, or a database that cannot be read.
    pub fn tally(&self, query: &ActivityQuery) -> Result<Tally, StoreError> {
        let Some(filter) = Filter::of_activities(query)? else {
            return Ok(Tally::default());
        };
        let sql = format!(
            // What is done for a part of a time in which the same person does another thing of the query counts once, as often
            // and as long.
            "SELECT count(*) FILTER (WHERE before IS NULL OR b >= before), min(start_ms), max(start_ms), sum(max(0, e - max(b, coalesce(before, b)))),
                    max(max(0, e - b)), max(synthetic) FROM (
                SELECT start_ms, synthetic, b, e, max(e) OVER (
                    PARTITION BY origin, person ORDER BY b, e ROWS BETWEEN UNBOUNDED PRECEDING AND 1 PRECEDING
                ) AS before FROM (
                    SELECT a.start_ms AS start_ms, a.origin AS origin, a.person AS person, o.synthetic AS synthetic,
                           max(a.start_ms, ?) AS b, min(a.end_ms, ?) AS e
                    FROM activity a JOIN origin o ON o.id = a.origin {}
                )
            )",
            filter.sql()
        );
        let ends = [
            rusqlite::types::Value::from(query.from_ms.unwrap_or(0)),
            query.to_ms.unwrap_or(i64::MAX).into(),
        ];
        let tally = |row: &Row<'_>| {
            Ok(Tally {
                count: row.get(0)?,
                first_ms: row.get(1)?,
                last_ms: row.get(2)?,
                total_ms: row.get::<_, Option<i64>>(3)?.unwrap_or(0),
                longest_ms: row.get::<_, Option<i64>>(4)?.unwrap_or(0),
                synthetic: row.get::<_, Option<bool>>(5)?.unwrap_or(false),
            })
        };
        let values = ends.into_iter().chain(filter.values);
        self.connection
            .prepare_cached(&sql)
            .and_then(|mut s| s.query_row(params_from_iter(values), tally))
            .map_err(|e| self.error("count activities", e))
    }

    /// The end of the newest activity or the time of the newest event, milliseconds since 1970 in UTC, or `None` if the memory
    /// is empty.
    ///
    /// # Errors
    /// A database that cannot be read.
    pub fn newest_ms(&self) -> Result<Option<i64>, StoreError> {
        let sql = "SELECT max(ms) FROM (SELECT max(end_ms) AS ms FROM activity
                   UNION ALL SELECT max(at_ms) FROM event)";
        self.time_ms("read the newest time", sql)
    }

    /// The time of the oldest activity or event, milliseconds since 1970 in UTC, or `None` if the memory is empty.
    ///
    /// # Errors
    /// A database that cannot be read.
    pub fn oldest_ms(&self) -> Result<Option<i64>, StoreError> {
        let sql = "SELECT min(ms) FROM (SELECT min(start_ms) AS ms FROM activity
                   UNION ALL SELECT min(at_ms) FROM event)";
        self.time_ms("read the oldest time", sql)
    }

    /// The time that a query without parameters selects.
    pub(super) fn time_ms(
        &self,
        operation: &'static str,
        sql: &str,
    ) -> Result<Option<i64>, StoreError> {
        let selected = self.connection.query_row(sql, [], |row| row.get(0));
        selected.map_err(|e| self.error(operation, e))
    }

    /// Lets all queries until the guard is dropped see one state of the memory. To be held briefly: the write-ahead log
    /// grows meanwhile.
    pub(crate) fn snapshot(&self) -> Result<Transaction<'_>, StoreError> {
        let begun = self.connection.unchecked_transaction();
        begun.map_err(|e| self.error("begin to read", e))
    }

    /// The first or the last activities of a query.
    pub(crate) fn some_activities(
        &self,
        query: &ActivityQuery,
        order: Order,
        limit: usize,
    ) -> Result<Vec<ActivityRow>, StoreError> {
        match Filter::of_activities(query)? {
            Some(filter) => self.select_activities(filter, order, limit),
            None => Ok(Vec::new()),
        }
    }

    fn select_activities(
        &self,
        filter: Filter,
        order: Order,
        limit: usize,
    ) -> Result<Vec<ActivityRow>, StoreError> {
        let order = match order {
            Order::NewestFirst => "a.start_ms DESC, a.id DESC",
            Order::OldestFirst => "a.start_ms, a.id",
        };
        let sql = format!(
            "SELECT {} FROM activity a JOIN origin o ON o.id = a.origin {} ORDER BY {order} LIMIT ?",
            convert::ACTIVITY_COLUMNS,
            filter.sql()
        );
        self.select("read activities", &sql, filter, limit, convert::activity)
    }

    pub(super) fn select<T>(
        &self,
        operation: &'static str,
        sql: &str,
        filter: Filter,
        limit: usize,
        convert: fn(&Row<'_>) -> rusqlite::Result<T>,
    ) -> Result<Vec<T>, StoreError> {
        let limit = i64::try_from(limit).unwrap_or(i64::MAX);
        let values = filter.values.into_iter().chain([limit.into()]);
        let read = || {
            let mut statement = self.connection.prepare_cached(sql)?;
            statement
                .query_map(params_from_iter(values), convert)?
                .collect::<rusqlite::Result<Vec<T>>>()
        };
        read().map_err(|e| self.error(operation, e))
    }

    pub(crate) fn error(&self, operation: &'static str, e: rusqlite::Error) -> StoreError {
        StoreError::of(&self.path, operation, e)
    }
}

impl<T> Page<T> {
    fn empty() -> Self {
        Self {
            rows: Vec::new(),
            next: None,
        }
    }

    /// A page of rows of which one more than `limit` was read.
    fn new(mut rows: Vec<T>, limit: usize, cursor: impl Fn(&T) -> Cursor) -> Self {
        let has_more = rows.len() > limit;
        rows.truncate(limit);
        let next = rows.last().filter(|_| has_more).map(cursor);
        Self { rows, next }
    }
}
