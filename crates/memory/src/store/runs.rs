//! Of which time something is known: runs of a radar that was watched, without the times at which it was silent.
//!
//! A run lasts from the first frame to the last sign of life, which whoever watches writes every few seconds. Presence is
//! known within a run only: a new run begins with an empty room, and what a silent radar would have shown is unknown.

use radarllm_monitor::rows::EventKind;
use rusqlite::{OptionalExtension, Row};

use super::Timeline;
use super::lanes::Stretch;
use super::limits::MAX_TIME_MS;
use crate::error::StoreError;

/// Age up to which the last sign of life shows that a run goes on, ms: three times the time between two signs.
pub const ALIVE_MS: i64 = 30_000;
/// Time after the beginning of a run, or after a silence, in which somebody who is there is not detected yet, ms.
const SETTLE_MS: i64 = 10_000;
/// Most runs of a range that are looked at; earlier ones are left out.
const MAX_RUNS: usize = 10_000;

/// A stretch of time in which a radar was watched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// Its beginning, milliseconds since 1970 in UTC.
    pub start_ms: i64,
    /// The last sign of life.
    pub end_ms: i64,
    /// Whether it ended in order. A program that was killed, or a computer that was switched off, leaves a run that is not
    /// over and has no sign of life any more.
    pub is_over: bool,
}

/// What is known of a range of time.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub(crate) struct Watched {
    /// Times of which something is known.
    pub known: Vec<Known>,
    /// When the radar was silent while it was watched.
    pub silence: Vec<Stretch>,
    /// Whether a simulated radar is among the origins of the events.
    pub synthetic: bool,
}

/// A stretch of time without a gap in what is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Known {
    pub stretch: Stretch,
    /// When somebody was there. What begins with the stretch may have begun before.
    pub presence: Vec<Stretch>,
    /// Whether somebody was there at the end of the stretch, so that the last presence may have lasted longer.
    pub is_present_at_end: bool,
    /// Activities before this time were deleted.
    pub activities_ms: i64,
}

impl Watched {
    /// When somebody was there.
    pub(crate) fn presence(&self) -> Vec<Stretch> {
        let known = self.known.iter();
        known.flat_map(|known| known.presence.clone()).collect()
    }
}

impl Timeline {
    /// The run with the newest sign of life, or `None` if nothing was ever watched.
    ///
    /// # Errors
    /// A database that cannot be read.
    pub fn newest_run(&self) -> Result<Option<Run>, StoreError> {
        let sql = "SELECT start_ms, end_ms, is_over FROM run ORDER BY end_ms DESC, id DESC LIMIT 1";
        let run = |row: &Row<'_>| {
            Ok(Run {
                start_ms: row.get(0)?,
                end_ms: row.get(1)?,
                is_over: row.get(2)?,
            })
        };
        let selected = self.connection.query_row(sql, [], run).optional();
        selected.map_err(|e| self.error("read the newest run", e))
    }

    /// The beginning of the first run, milliseconds since 1970 in UTC.
    pub(crate) fn first_run_ms(&self) -> Result<Option<i64>, StoreError> {
        self.time_ms("read the first run", "SELECT min(start_ms) FROM run")
    }

    /// What is known of a range of time. A run that goes on lasts until `now_ms`, if the present time is given.
    pub(crate) fn watched(
        &self,
        [from_ms, to_ms]: [i64; 2],
        now_ms: Option<i64>,
    ) -> Result<Watched, StoreError> {
        let mut watched = Watched::default();
        for (mut run, activities_ms) in self.runs([from_ms.saturating_sub(ALIVE_MS), to_ms])? {
            if let Some(now_ms) = now_ms.filter(|now_ms| run.is_alive(*now_ms)) {
                run.end_ms = run.end_ms.max(now_ms);
            }
            if run.end_ms >= from_ms {
                self.add_run(run, activities_ms, [from_ms, to_ms], &mut watched)?;
            }
        }
        Ok(watched)
    }

    /// Runs that overlap a range, in order of time, each with the time before which its activities were deleted. Those that
    /// overlap each other, as after a clock went back, are one.
    fn runs(&self, [from_ms, to_ms]: [i64; 2]) -> Result<Vec<(Run, i64)>, StoreError> {
        let read = || {
            let sql = format!(
                "SELECT * FROM (
                    SELECT start_ms, end_ms, is_over, activities_ms FROM run
                    WHERE end_ms >= ?1 AND end_ms <= {MAX_TIME_MS} AND start_ms < ?2 AND start_ms BETWEEN 0 AND end_ms
                    ORDER BY start_ms DESC, id DESC LIMIT {MAX_RUNS}
                 ) ORDER BY start_ms"
            );
            let mut statement = self.connection.prepare_cached(&sql)?;
            let row = |row: &Row<'_>| {
                let run = Run {
                    start_ms: row.get(0)?,
                    end_ms: row.get(1)?,
                    is_over: row.get(2)?,
                };
                Ok((run, row.get(3)?))
            };
            let rows = statement.query_map([from_ms, to_ms], row)?;
            rows.collect::<rusqlite::Result<Vec<(Run, i64)>>>()
        };
        let all = read().map_err(|e| self.error("read runs", e))?;
        let mut runs: Vec<(Run, i64)> = Vec::with_capacity(all.len());
        for (run, activities_ms) in all {
            match runs
                .last_mut()
                .filter(|(last, _)| run.start_ms < last.end_ms)
            {
                Some((last, deleted_ms)) => {
                    last.is_over = match last.end_ms <= run.end_ms {
                        true => run.is_over,
                        false => last.is_over,
                    };
                    last.end_ms = last.end_ms.max(run.end_ms);
                    *deleted_ms = (*deleted_ms).max(activities_ms);
                }
                None => runs.push((run, activities_ms)),
            }
        }
        Ok(runs)
    }

    /// Adds what is known of a range from one run.
    fn add_run(
        &self,
        run: Run,
        activities_ms: i64,
        [from_ms, to_ms]: [i64; 2],
        watched: &mut Watched,
    ) -> Result<(), StoreError> {
        let begin_ms = from_ms.max(run.start_ms);
        let end_ms = to_ms.min(run.end_ms);
        if begin_ms > end_ms {
            return Ok(());
        }
        let presence = [EventKind::Present, EventKind::Absent];
        let source = [EventKind::SourceLost, EventKind::SourceBack];
        let before = |kinds| self.last_kind(kinds, [run.start_ms, begin_ms]);
        let mut is_present = match before(presence)? {
            Some(kind) => kind == EventKind::Present,
            // Who leaves without having come was there from the beginning: what was before it was forgotten.
            None => self.first_kind(presence, [begin_ms, run.end_ms])? == Some(EventKind::Absent),
        };
        let mut known: Option<Known> = None;
        let mut silent_ms = None;
        let mut since_ms = None;
        // Whether what is known begins where the stretch does, and was not only asked for from there on.
        let mut is_beginning = run.start_ms >= from_ms;
        let begin = |at_ms| Known {
            stretch: Stretch {
                start_ms: at_ms,
                end_ms: at_ms,
            },
            presence: Vec::new(),
            is_present_at_end: false,
            activities_ms,
        };
        match before(source)? {
            Some(EventKind::SourceLost) => silent_ms = Some(begin_ms),
            _ => {
                known = Some(begin(begin_ms));
                since_ms = is_present.then_some(begin_ms);
            }
        }
        let kinds = [presence, source].concat();
        for row in self.all_events(&kinds, [begin_ms, end_ms.saturating_add(1)])? {
            watched.synthetic |= row.origin.synthetic;
            let at_ms = row.event.at_ms;
            match row.event.kind {
                EventKind::Present => {
                    is_present = true;
                    if let Some(known) = &mut known {
                        let start_ms = known.stretch.start_ms;
                        let is_first = known.presence.is_empty() && since_ms.is_none();
                        // Whether somebody came or had been there is not known.
                        if is_first && is_beginning && at_ms - start_ms <= SETTLE_MS {
                            known.stretch.start_ms = at_ms;
                        }
                        since_ms = since_ms.or(Some(at_ms));
                    }
                }
                EventKind::Absent => {
                    is_present = false;
                    if let (Some(known), Some(start_ms)) = (&mut known, since_ms.take()) {
                        let end_ms = at_ms;
                        known.presence.push(Stretch { start_ms, end_ms });
                    }
                }
                EventKind::SourceLost => {
                    if let Some(mut known) = known.take() {
                        // The room counts as empty from the moment at which the radar is silent, but nobody left.
                        let last = known.presence.last();
                        known.is_present_at_end = last.is_some_and(|last| last.end_ms == at_ms);
                        watched.end(known, since_ms.take(), at_ms);
                        silent_ms = Some(at_ms);
                    }
                }
                EventKind::SourceBack => {
                    if let Some(start_ms) = silent_ms.take() {
                        let end_ms = at_ms;
                        watched.silence.push(Stretch { start_ms, end_ms });
                        known = Some(begin(at_ms));
                        since_ms = is_present.then_some(at_ms);
                        is_beginning = true;
                    }
                }
                _ => {}
            }
        }
        if let Some(known) = known {
            watched.end(known, since_ms, end_ms);
        }
        if let Some(start_ms) = silent_ms {
            watched.silence.push(Stretch { start_ms, end_ms });
        }
        Ok(())
    }

    /// The kind of the last event of these kinds from one time to before another one.
    fn last_kind(
        &self,
        kinds: [EventKind; 2],
        range_ms: [i64; 2],
    ) -> Result<Option<EventKind>, StoreError> {
        self.one_kind(
            kinds,
            range_ms,
            "at_ms >= ?3 AND at_ms < ?4 ORDER BY at_ms DESC, id DESC",
        )
    }

    /// The kind of the first event of these kinds from one time to another one.
    fn first_kind(
        &self,
        kinds: [EventKind; 2],
        range_ms: [i64; 2],
    ) -> Result<Option<EventKind>, StoreError> {
        self.one_kind(
            kinds,
            range_ms,
            "at_ms >= ?3 AND at_ms <= ?4 ORDER BY at_ms, id",
        )
    }

    fn one_kind(
        &self,
        kinds: [EventKind; 2],
        [from_ms, to_ms]: [i64; 2],
        which: &str,
    ) -> Result<Option<EventKind>, StoreError> {
        let sql = format!("SELECT kind FROM event WHERE kind IN (?1, ?2) AND {which} LIMIT 1");
        let values = rusqlite::params![kinds[0].name(), kinds[1].name(), from_ms, to_ms];
        let read = || {
            let mut statement = self.connection.prepare_cached(&sql)?;
            let kind = |row: &Row<'_>| row.get::<_, String>(0);
            statement.query_row(values, kind).optional()
        };
        let name = read().map_err(|e| self.error("read an event", e))?;
        Ok(name.as_deref().and_then(EventKind::from_name))
    }
}

impl Watched {
    /// Ends a stretch of which something is known, with the presence that goes on.
    fn end(&mut self, mut known: Known, since_ms: Option<i64>, end_ms: i64) {
        if let Some(start_ms) = since_ms {
            known.presence.push(Stretch { start_ms, end_ms });
            known.is_present_at_end = true;
        }
        known.stretch.end_ms = end_ms;
        // A radar that is silent from the beginning tells nothing.
        if known.stretch.start_ms < end_ms || !known.presence.is_empty() {
            self.known.push(known);
        }
    }
}

impl Run {
    /// Whether the run goes on at a time.
    pub fn is_alive(&self, now_ms: i64) -> bool {
        !self.is_over && now_ms.saturating_sub(self.end_ms).abs() <= ALIVE_MS
    }
}
