//! Rows of tables to the types of [`rows`](radarllm_monitor::rows), with bounds on what is read.

use radarllm_monitor::rows::{Activity, ActivityRow, Event, EventKind, EventRow, Origin};
use rusqlite::Row;
use rusqlite::types::{FromSqlError, Type};

use super::limits::{MAX_ACTION_BYTES, MAX_CAPTION_BYTES, MAX_DATA_BYTES, MAX_ORIGIN_BYTES};

/// Columns for [`activity`]: the table `activity` is `a`, `origin` is `o`.
pub(super) const ACTIVITY_COLUMNS: &str = "a.id, a.start_ms, a.end_ms, a.person, a.action, a.caption, a.confidence, \
     a.windows, a.points, a.place, o.source, o.radar, o.model, o.decoder, o.version, o.synthetic";
/// Columns for [`event`]: the table `event` is `e`, `origin` is `o`.
pub(super) const EVENT_COLUMNS: &str = "e.id, e.at_ms, e.kind, e.person, e.data, \
     o.source, o.radar, o.model, o.decoder, o.version, o.synthetic";
/// Longest text of a place, bytes.
const MAX_PLACE_BYTES: usize = 100;

pub(super) fn activity(row: &Row<'_>) -> rusqlite::Result<ActivityRow> {
    Ok(ActivityRow {
        id: row.get(0)?,
        activity: Activity {
            start_ms: row.get(1)?,
            end_ms: row.get(2)?,
            person: row.get(3)?,
            action: text(row, 4, MAX_ACTION_BYTES)?,
            caption: text(row, 5, MAX_CAPTION_BYTES)?,
            confidence: row.get(6)?,
            windows: row.get(7)?,
            points: row.get(8)?,
            place_m: json(row, 9, MAX_PLACE_BYTES)?,
        },
        origin: origin(row, 10)?,
    })
}

pub(super) fn event(row: &Row<'_>) -> rusqlite::Result<EventRow> {
    let kind = row.get_ref(2)?.as_str().map(EventKind::from_name);
    let Ok(Some(kind)) = kind else {
        return Err(wrong(2, "an unknown kind of event"));
    };
    Ok(EventRow {
        id: row.get(0)?,
        event: Event {
            at_ms: row.get(1)?,
            kind,
            person: row.get(3)?,
            data: json(row, 4, MAX_DATA_BYTES)?,
        },
        origin: origin(row, 5)?,
    })
}

fn origin(row: &Row<'_>, first: usize) -> rusqlite::Result<Origin> {
    Ok(Origin {
        source: text(row, first, MAX_ORIGIN_BYTES)?,
        radar: text(row, first + 1, MAX_ORIGIN_BYTES)?,
        model: text(row, first + 2, MAX_ORIGIN_BYTES)?,
        decoder: text(row, first + 3, MAX_ORIGIN_BYTES)?,
        version: text(row, first + 4, MAX_ORIGIN_BYTES)?,
        synthetic: row.get(first + 5)?,
    })
}

/// A text that is no longer than what is written. A damaged row is not copied.
fn text(row: &Row<'_>, column: usize, max_bytes: usize) -> rusqlite::Result<String> {
    match row.get_ref(column)?.as_str() {
        Ok(text) if text.len() <= max_bytes => Ok(text.to_string()),
        Ok(_) => Err(wrong(column, "a text longer than any that is written")),
        Err(e) => Err(conversion(column, e)),
    }
}

fn json<T: serde::de::DeserializeOwned>(
    row: &Row<'_>,
    column: usize,
    max_bytes: usize,
) -> rusqlite::Result<Option<T>> {
    match row.get_ref(column)?.as_str_or_null() {
        Ok(None) => Ok(None),
        Ok(Some(text)) if text.len() <= max_bytes => {
            serde_json::from_str(text).map(Some).map_err(|e| {
                rusqlite::Error::FromSqlConversionFailure(column, Type::Text, Box::new(e))
            })
        }
        Ok(Some(_)) => Err(wrong(column, "a text longer than any that is written")),
        Err(e) => Err(conversion(column, e)),
    }
}

fn wrong(column: usize, problem: &'static str) -> rusqlite::Error {
    rusqlite::Error::FromSqlConversionFailure(column, Type::Text, problem.into())
}

fn conversion(column: usize, e: FromSqlError) -> rusqlite::Error {
    rusqlite::Error::FromSqlConversionFailure(column, Type::Text, Box::new(e))
}
