//! Writing to the memory.

use std::path::Path;

use radarllm_monitor::points::{FramePoints, PointsError, encode};
use radarllm_monitor::rows::{Activity, Event, Growth, Origin};
use rusqlite::{OptionalExtension, Transaction, params};

use super::limits::{
    MAX_DATA_BYTES, check_activity, check_end, check_growth, check_origin, check_time,
};
use super::runs::Run;
use super::timeline::PointsOf;
use crate::error::StoreError;

/// A transaction: what is written through it is committed together or not at all.
#[derive(Debug)]
pub struct Batch<'a> {
    pub(super) transaction: Transaction<'a>,
    pub(super) path: &'a Path,
}

impl Batch<'_> {
    /// Adds an activity and returns its number.
    ///
    /// # Errors
    /// A value that is not kept ([`StoreError::Invalid`]), or a database that cannot be written.
    pub fn insert_activity(&self, activity: &Activity, origin: &Origin) -> Result<i64, StoreError> {
        check_activity(activity)?;
        let origin = self.origin(origin)?;
        let place = activity.place_m.map(place_json);
        let values = params![
            activity.start_ms,
            activity.end_ms,
            activity.person,
            activity.action,
            activity.caption,
            activity.confidence,
            activity.windows,
            activity.points,
            place,
            origin
        ];
        self.execute(
            "add an activity",
            "INSERT INTO activity (start_ms, end_ms, person, action, caption, confidence, windows, points, place, origin)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)",
            values,
        )?;
        Ok(self.transaction.last_insert_rowid())
    }

    /// Lets an activity last longer.
    ///
    /// # Errors
    /// [`StoreError::Missing`] if the activity is gone, [`StoreError::Invalid`] for a value that is not kept and for an end
    /// before the end so far, or a database that cannot be written.
    pub fn extend_activity(&self, id: i64, growth: &Growth) -> Result<(), StoreError> {
        check_growth(growth)?;
        let read = || {
            let sql = "SELECT start_ms, end_ms FROM activity WHERE id = ?1";
            let mut statement = self.transaction.prepare_cached(sql)?;
            statement
                .query_row([id], |row| Ok((row.get(0)?, row.get(1)?)))
                .optional()
        };
        let found: Option<(i64, i64)> = read().map_err(|e| self.error("read an activity", e))?;
        let Some((start_ms, end_ms)) = found else {
            return Err(StoreError::Missing {
                table: "activity",
                id,
            });
        };
        check_end(start_ms, growth.end_ms)?;
        if growth.end_ms < end_ms {
            return Err(StoreError::invalid(
                "end_ms",
                "no time before the end so far",
                growth.end_ms,
            ));
        }
        let place = growth.place_m.map(place_json);
        let values = params![
            id,
            growth.end_ms,
            growth.caption,
            growth.confidence,
            growth.windows,
            growth.points,
            place
        ];
        self.execute(
            "extend an activity",
            "UPDATE activity SET end_ms = ?2, caption = ?3, confidence = ?4, windows = ?5, points = ?6, place = ?7
             WHERE id = ?1",
            values,
        )?;
        Ok(())
    }

    /// Adds an event and returns its number.
    ///
    /// # Errors
    /// A value that is not kept ([`StoreError::Invalid`]), or a database that cannot be written.
    pub fn insert_event(&self, event: &Event, origin: &Origin) -> Result<i64, StoreError> {
        check_time("at_ms", event.at_ms)?;
        let data = event.data.as_ref().map(ToString::to_string);
        if let Some(data) = data.as_ref().filter(|d| d.len() > MAX_DATA_BYTES) {
            let found = format!("{} bytes", data.len());
            return Err(StoreError::invalid(
                "data",
                "at most 4096 bytes of JSON",
                found,
            ));
        }
        let origin = self.origin(origin)?;
        self.execute(
            "add an event",
            "INSERT INTO event (at_ms, kind, person, data, origin) VALUES (?1, ?2, ?3, ?4, ?5)",
            params![event.at_ms, event.kind.name(), event.person, data, origin],
        )?;
        Ok(self.transaction.last_insert_rowid())
    }

    /// Adds a run, or lets the run with a number last until the end that is given here, and returns its number. A run that is
    /// gone is added again.
    ///
    /// # Errors
    /// [`StoreError::Invalid`] for a time that is not kept or an end before the start, or a database that cannot be written.
    pub fn write_run(&self, id: Option<i64>, run: &Run) -> Result<i64, StoreError> {
        check_time("start_ms", run.start_ms)?;
        check_time("end_ms", run.end_ms)?;
        if run.end_ms < run.start_ms {
            let expected = "no time before the start";
            return Err(StoreError::invalid("end_ms", expected, run.end_ms));
        }
        if let Some(id) = id {
            let sql = "UPDATE run SET end_ms = max(end_ms, ?2), is_over = ?3 WHERE id = ?1";
            let values = params![id, run.end_ms, run.is_over];
            if self.execute("extend a run", sql, values)? > 0 {
                return Ok(id);
            }
        }
        self.execute(
            "add a run",
            "INSERT INTO run (start_ms, end_ms, is_over) VALUES (?1, ?2, ?3)",
            params![run.start_ms, run.end_ms, run.is_over],
        )?;
        Ok(self.transaction.last_insert_rowid())
    }

    /// Keeps the points of an activity, or those around an event, in place of those that it had. The first frame is at
    /// `start_ms`, milliseconds since 1970 in UTC. Returns how many points were left out because they have no packed
    /// form ([`Packed::left_out`](radarllm_monitor::points::Packed::left_out)).
    ///
    /// # Errors
    /// [`StoreError::Missing`] if the row is gone, [`StoreError::Invalid`] for too many points, or a database that cannot
    /// be written.
    pub fn store_points(
        &self,
        of: PointsOf,
        start_ms: i64,
        frames: &[FramePoints],
    ) -> Result<usize, StoreError> {
        check_time("start_ms", start_ms)?;
        let longest_ms = frames.iter().map(|f| f.offset_ms).max().unwrap_or(0);
        let end_ms = start_ms.saturating_add(longest_ms.into());
        let packed = encode(frames).map_err(|e: PointsError| {
            StoreError::invalid("frames", "fewer points", e.to_string())
        })?;
        let (table, id, activity, event) = match of {
            PointsOf::Activity(id) => ("activity", id, Some(id), None),
            PointsOf::Event(id) => ("event", id, None, Some(id)),
        };
        let known = format!("SELECT 1 FROM {table} WHERE id = ?1");
        let known = self
            .transaction
            .prepare_cached(&known)
            .and_then(|mut s| s.exists([id]))
            .map_err(|e| self.error("find the row of points", e))?;
        if !known {
            return Err(StoreError::Missing { table, id });
        }
        self.execute(
            "store points",
            "INSERT OR REPLACE INTO points (start_ms, end_ms, activity, event, blob) VALUES (?1, ?2, ?3, ?4, ?5)",
            params![start_ms, end_ms, activity, event, packed.blob],
        )?;
        Ok(packed.left_out)
    }

    /// The number of an origin, which is added if it is new.
    fn origin(&self, origin: &Origin) -> Result<i64, StoreError> {
        check_origin(origin)?;
        let values = params![
            origin.source,
            origin.radar,
            origin.model,
            origin.decoder,
            origin.version,
            origin.synthetic
        ];
        let find = || {
            let sql = "SELECT id FROM origin WHERE source = ?1 AND radar = ?2 AND model = ?3 AND decoder = ?4
                       AND version = ?5 AND synthetic = ?6";
            let mut statement = self.transaction.prepare_cached(sql)?;
            statement.query_row(values, |row| row.get(0)).optional()
        };
        if let Some(id) = find().map_err(|e| self.error("find an origin", e))? {
            return Ok(id);
        }
        self.execute(
            "add an origin",
            "INSERT INTO origin (source, radar, model, decoder, version, synthetic)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
            values,
        )?;
        Ok(self.transaction.last_insert_rowid())
    }

    fn execute(
        &self,
        operation: &'static str,
        sql: &str,
        values: &[&dyn rusqlite::ToSql],
    ) -> Result<usize, StoreError> {
        self.transaction
            .prepare_cached(sql)
            .and_then(|mut statement| statement.execute(values))
            .map_err(|e| self.error(operation, e))
    }

    fn error(&self, operation: &'static str, e: rusqlite::Error) -> StoreError {
        StoreError::of(self.path, operation, e)
    }
}

/// A place as JSON, to the millimetre.
fn place_json([x_m, y_m]: [f64; 2]) -> String {
    format!("[{x_m:.3},{y_m:.3}]")
}
