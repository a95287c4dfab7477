//! A range of time as lanes: when somebody was there, what they did, when they fell, and when the radar was silent.

use std::collections::BTreeMap;

use radarllm_monitor::rows::{EventKind, EventRow};
use rusqlite::Row;
use serde::{Deserialize, Serialize};

use super::{
    Timeline,
    filter::Filter,
    timeline::{ActivityQuery, EventQuery},
};
use crate::error::StoreError;

/// Activities of the same action that are nearer to each other than this share of the range are one stretch, so that no
/// range has more stretches than a screen has columns.
const COLUMNS: i64 = 1_000;
/// Longest range, ms: 32 days.
const MAX_RANGE_MS: i64 = 32 * 86_400_000;
/// Most events of a range; earlier ones are left out.
const MAX_EVENTS: usize = 10_000;

/// From one time to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stretch {
    /// Beginning, milliseconds since 1970 in UTC.
    pub start_ms: i64,
    /// End.
    pub end_ms: i64,
}

/// An action from one time to another.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ActionStretch {
    /// Name of the action, for example `sit_still`.
    pub action: String,
    /// When.
    #[serde(flatten)]
    pub stretch: Stretch,
}

/// A fall alarm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct FallAt {
    /// When, milliseconds since 1970 in UTC.
    pub at_ms: i64,
    /// Whether it was confirmed; otherwise it was suspected.
    pub is_confirmed: bool,
}

/// A range of time as lanes. Everything is in order of time.
#[derive(Clone, Debug, PartialEq, Eq, Default, Serialize)]
pub struct Lanes {
    /// When somebody was there.
    pub presence: Vec<Stretch>,
    /// What people did, by the beginning.
    pub actions: Vec<ActionStretch>,
    /// Fall alarms.
    pub falls: Vec<FallAt>,
    /// When the radar was silent.
    pub silence: Vec<Stretch>,
    /// Whether a simulated radar is among the origins.
    pub synthetic: bool,
}

impl Timeline {
    /// The lanes of a range of time. What lasts at its end ends there, or at the last sign of life of the run, if that is
    /// earlier.
    ///
    /// # Errors
    /// A range that is empty or longer than 32 days, or a database that cannot be read.
    pub fn lanes(&self, from_ms: i64, to_ms: i64) -> Result<Lanes, StoreError> {
        let length_ms = to_ms.saturating_sub(from_ms);
        if !(1..=MAX_RANGE_MS).contains(&length_ms) {
            let found = format_args!("{length_ms} ms");
            return Err(StoreError::invalid(
                "from and to",
                "more than 0 and at most 32 days",
                found,
            ));
        }
        let _snapshot = self.snapshot()?;
        let mut lanes = Lanes::default();
        self.add_actions(&mut lanes, from_ms, to_ms)?;
        let watched = self.watched([from_ms, to_ms], None)?;
        lanes.presence = watched.presence();
        lanes.silence = watched.silence;
        lanes.synthetic |= watched.synthetic;
        let kinds = [EventKind::Suspected, EventKind::Confirmed];
        for row in self.all_events(&kinds, [from_ms, to_ms])? {
            lanes.synthetic |= row.origin.synthetic;
            lanes.falls.push(FallAt {
                at_ms: row.event.at_ms,
                is_confirmed: row.event.kind == EventKind::Confirmed,
            });
        }
        Ok(lanes)
    }

    fn add_actions(&self, lanes: &mut Lanes, from_ms: i64, to_ms: i64) -> Result<(), StoreError> {
        let query = ActivityQuery {
            from_ms: Some(from_ms),
            to_ms: Some(to_ms),
            ..ActivityQuery::default()
        };
        let Some(filter) = Filter::of_activities(&query)? else {
            return Ok(());
        };
        let sql = format!(
            "SELECT a.action, a.start_ms, a.end_ms, o.synthetic
             FROM activity a JOIN origin o ON o.id = a.origin {} ORDER BY a.start_ms, a.id LIMIT ?",
            filter.sql()
        );
        let row = |row: &Row<'_>| -> rusqlite::Result<(String, i64, i64, bool)> {
            Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?))
        };
        let column_ms = (to_ms - from_ms) / COLUMNS;
        // The last stretch of each action.
        let mut open: BTreeMap<String, usize> = BTreeMap::new();
        for (action, start_ms, end_ms, synthetic) in
            self.select("read activities", &sql, filter, usize::MAX, row)?
        {
            lanes.synthetic |= synthetic;
            let (start_ms, end_ms) = (start_ms.max(from_ms), end_ms.min(to_ms));
            let last = open.get(&action).map(|at| &mut lanes.actions[*at].stretch);
            match last {
                Some(last) if start_ms.saturating_sub(last.end_ms) <= column_ms => {
                    last.end_ms = last.end_ms.max(end_ms);
                }
                _ => {
                    open.insert(action.clone(), lanes.actions.len());
                    let stretch = Stretch { start_ms, end_ms };
                    lanes.actions.push(ActionStretch { action, stretch });
                }
            }
        }
        Ok(())
    }

    /// The events of a range, the oldest first.
    pub(super) fn all_events(
        &self,
        kinds: &[EventKind],
        [from_ms, to_ms]: [i64; 2],
    ) -> Result<Vec<EventRow>, StoreError> {
        let query = EventQuery {
            from_ms: Some(from_ms),
            to_ms: Some(to_ms),
            kinds: kinds.to_vec(),
            ..EventQuery::default()
        };
        let mut rows = Vec::new();
        let mut before = None;
        loop {
            let page = self.events(&query, before, MAX_EVENTS)?;
            rows.extend(page.rows);
            before = page.next;
            if before.is_none() || rows.len() >= MAX_EVENTS {
                rows.reverse();
                return Ok(rows);
            }
        }
    }
}
