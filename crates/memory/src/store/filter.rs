//! Queries to SQL conditions.

use std::fmt::Write as _;

use rusqlite::types::Value;

use super::cursor::Cursor;
use super::limits::MAX_ACTIVITY_MS;
use super::text::fts_query;
use super::timeline::{ActivityQuery, MAX_ACTIONS};
use crate::error::StoreError;

/// Conditions and the values of their question marks, in the same order.
#[derive(Default)]
pub(super) struct Filter {
    conditions: String,
    pub(super) values: Vec<Value>,
}

impl Filter {
    /// The conditions of a query, or `None` if it matches nothing.
    pub(super) fn of_activities(query: &ActivityQuery) -> Result<Option<Self>, StoreError> {
        let mut filter = Self::default();
        if let Some(from_ms) = query.from_ms {
            // The first condition lets the index skip older rows, because no activity is longer. An activity without
            // duration counts at its time.
            let first_ms = from_ms.saturating_sub(MAX_ACTIVITY_MS);
            filter.and("a.start_ms >= ?", [first_ms.into()]);
            filter.and(
                "(a.end_ms > ? OR a.start_ms >= ?)",
                [from_ms.into(), from_ms.into()],
            );
        }
        filter.and_some("a.start_ms < ?", query.to_ms);
        filter.and_some("a.person = ?", query.person.map(i64::from));
        if query.actions.len() > MAX_ACTIONS {
            return Err(StoreError::invalid(
                "actions",
                "at most 32",
                query.actions.len(),
            ));
        }
        filter.and_any("a.action", query.actions.iter().cloned().map(Value::from));
        if let Some(text) = &query.text {
            let Some(words) = fts_query(text) else {
                return Ok(None);
            };
            filter.and(
                "a.id IN (SELECT rowid FROM activity_fts WHERE activity_fts MATCH ?)",
                [words.into()],
            );
        }
        Ok(Some(filter))
    }

    pub(super) fn and(&mut self, condition: &str, values: impl IntoIterator<Item = Value>) {
        let word = match self.conditions.is_empty() {
            true => "WHERE",
            false => " AND",
        };
        // Writing to a string does not fail.
        let _ = write!(self.conditions, "{word} {condition}");
        self.values.extend(values);
    }

    pub(super) fn and_some(&mut self, condition: &str, value: Option<i64>) {
        if let Some(value) = value {
            self.and(condition, [value.into()]);
        }
    }

    /// The column has one of the values; without values, any.
    pub(super) fn and_any(&mut self, column: &str, values: impl Iterator<Item = Value>) {
        let values: Vec<Value> = values.collect();
        if !values.is_empty() {
            let marks = vec!["?"; values.len()].join(", ");
            self.and(&format!("{column} IN ({marks})"), values);
        }
    }

    pub(super) fn before(&mut self, time: &str, id: &str, cursor: Option<Cursor>) {
        if let Some(Cursor { at_ms, id: number }) = cursor {
            let condition = format!("({time}, {id}) < (?, ?)");
            self.and(&condition, [at_ms.into(), number.into()]);
        }
    }

    pub(super) fn sql(&self) -> &str {
        &self.conditions
    }
}
