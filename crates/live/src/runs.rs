//! When the radar is watched, as the memory is to know it.
//!
//! Every message is a sign of life. A time without any, such as that of a suspended computer, ends a run, and another one
//! begins; the memory then hears again what was so before. A silent radar sends no message: the program still runs, and the
//! memory knows of the silence by its event.

use std::time::{Duration, Instant};

use radarllm_memory::store::Run;
use radarllm_monitor::rows::{Event, EventKind};

/// Time between two signs of life in the database; [`ALIVE_MS`](radarllm_memory::store::runs::ALIVE_MS) is longer.
pub(crate) const REFRESH: Duration = Duration::from_secs(8);
/// Longest time between two signs of life of one run, ms. A radar is lost after 5 s without a frame.
const MAX_GAP_MS: i64 = 15_000;
/// Runs that wait until the database can be written again. Of more, the oldest ones are given up.
const MAX_WAITING: usize = 256;

/// Runs that are to be written.
#[derive(Debug, Default)]
pub(crate) struct Runs {
    current: Option<WrittenRun>,
    /// Runs that have ended and were not written since.
    ended: Vec<WrittenRun>,
    /// Events that tell a new run what was so before it.
    events: Vec<Event>,
    is_present: bool,
    /// Until when the silence of the radar has been counted, if it is silent.
    silent: Option<Instant>,
}

/// A run, and its number in the database if it was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct WrittenRun {
    pub(crate) id: Option<i64>,
    pub(crate) run: Run,
}

impl Runs {
    /// A sign of life at a time of the stream, milliseconds since 1970 in UTC.
    pub(crate) fn live(&mut self, at_ms: i64) {
        // Before the first frame, no time is known.
        if at_ms <= 0 {
            return;
        }
        match &mut self.current {
            Some(WrittenRun { run, .. })
                if at_ms >= run.start_ms && at_ms.saturating_sub(run.end_ms) <= MAX_GAP_MS =>
            {
                run.end_ms = run.end_ms.max(at_ms);
            }
            _ => {
                self.end();
                self.begin(at_ms);
            }
        }
    }

    /// An event that is to be kept.
    pub(crate) fn hear(&mut self, kind: EventKind) {
        match kind {
            EventKind::Present => self.is_present = true,
            EventKind::Absent => self.is_present = false,
            EventKind::SourceLost => self.silent = Some(Instant::now()),
            EventKind::SourceBack => self.silent = None,
            _ => {}
        }
    }

    /// What is to be written now: runs, the current one last, and events.
    pub(crate) fn write_next(&mut self, is_over: bool) -> (Vec<WrittenRun>, Vec<Event>) {
        if let (Some(silent), Some(current)) = (&mut self.silent, &mut self.current) {
            let passed = silent.elapsed();
            *silent += passed;
            let passed_ms = i64::try_from(passed.as_millis()).unwrap_or(i64::MAX);
            current.run.end_ms = current.run.end_ms.saturating_add(passed_ms);
        }
        let current = self.current.map(|mut current| {
            current.run.is_over = is_over;
            current
        });
        let runs = self.ended.iter().copied().chain(current).collect();
        (runs, self.events.clone())
    }

    /// Runs that [`Self::write_next`] returned were written and have these numbers now, and so many of its events.
    pub(crate) fn written(&mut self, written: &[WrittenRun], n_events: usize) {
        for run in self.ended.iter_mut().chain(&mut self.current) {
            let known = written.iter().find(|w| w.run.start_ms == run.run.start_ms);
            run.id = run.id.or(known.and_then(|known| known.id));
        }
        // A run may have grown and ended since.
        self.ended
            .retain(|ended| written.iter().all(|written| written.run != ended.run));
        self.events.drain(..n_events.min(self.events.len()));
    }

    /// A range of time is forgotten in the database.
    pub(crate) fn forget(&mut self, from_ms: i64, to_ms: i64) {
        let overlaps = |run: &Run| run.start_ms < to_ms && run.end_ms >= from_ms;
        self.ended.retain(|ended| !overlaps(&ended.run));
        self.events
            .retain(|event| !(from_ms..to_ms).contains(&event.at_ms));
        let Some(current) = self.current.as_mut().filter(|c| overlaps(&c.run)) else {
            return;
        };
        match current.run.end_ms {
            end_ms if end_ms <= to_ms => self.begin(end_ms),
            // The database cuts the run, and what is after the range keeps its number.
            _ => current.run.start_ms = current.run.start_ms.max(to_ms),
        }
    }

    /// Another database is written from now on.
    pub(crate) fn begin_anew(&mut self) {
        self.ended.clear();
        self.events.clear();
        if let Some(current) = self.current.take() {
            self.begin(current.run.end_ms);
        }
    }

    fn begin(&mut self, at_ms: i64) {
        let run = Run {
            start_ms: at_ms,
            end_ms: at_ms,
            is_over: false,
        };
        self.current = Some(WrittenRun { id: None, run });
        let present = self.is_present.then_some(EventKind::Present);
        let silent = self.silent.map(|_| EventKind::SourceLost);
        let event = |kind| Event {
            at_ms,
            kind,
            person: None,
            data: None,
        };
        self.events
            .extend(present.into_iter().chain(silent).map(event));
    }

    fn end(&mut self) {
        if let Some(mut ended) = self.current.take() {
            ended.run.is_over = true;
            self.ended.push(ended);
        }
        if self.ended.len() > MAX_WAITING {
            self.ended.remove(0);
        }
        // Each run has two at most.
        let n_events = self.events.len().saturating_sub(2 * MAX_WAITING);
        self.events.drain(..n_events);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START_MS: i64 = 1_795_455_492_000;

    fn run(from_s: i64, to_s: i64, is_over: bool) -> Run {
        Run {
            start_ms: START_MS + 1_000 * from_s,
            end_ms: START_MS + 1_000 * to_s,
            is_over,
        }
    }

    fn live(runs: &mut Runs, seconds: impl Iterator<Item = i64>) {
        for at_s in seconds {
            runs.live(START_MS + 1_000 * at_s);
        }
    }

    /// Runs with the row that they change, and events with their time.
    type Written = (Vec<(Option<i64>, Run)>, Vec<(i64, EventKind)>);

    fn write_next(runs: &mut Runs) -> Written {
        let (runs, events) = runs.write_next(false);
        let events = events
            .iter()
            .map(|e| ((e.at_ms - START_MS) / 1_000, e.kind));
        let runs = runs.iter().map(|written| (written.id, written.run));
        (runs.collect(), events.collect())
    }

    /// Everything is written, and the last run has a number.
    fn written(runs: &mut Runs, id: i64) {
        let (mut written, events) = runs.write_next(false);
        for run in &mut written {
            run.id = run.id.or(Some(id));
        }
        runs.written(&written, events.len());
    }

    #[test]
    fn a_run_grows_and_a_gap_begins_another_one_that_knows_who_is_there() {
        let mut runs = Runs::default();
        assert_eq!(write_next(&mut runs), (vec![], vec![]));
        runs.live(0);
        live(&mut runs, 0..=60);
        assert_eq!(
            write_next(&mut runs),
            (vec![(None, run(0, 60, false))], vec![])
        );
        written(&mut runs, 7);
        runs.hear(EventKind::Present);
        // A computer that was suspended, and a clock that went back.
        live(&mut runs, 61..=75);
        live(&mut runs, 500..=510);
        live(&mut runs, -100..=-90);
        let expected = vec![
            (Some(7), run(0, 75, true)),
            (None, run(500, 510, true)),
            (None, run(-100, -90, false)),
        ];
        let events = vec![(500, EventKind::Present), (-100, EventKind::Present)];
        assert_eq!(write_next(&mut runs), (expected, events));
        written(&mut runs, 9);
        assert_eq!(
            write_next(&mut runs),
            (vec![(Some(9), run(-100, -90, false))], vec![])
        );
        let (over, _) = runs.write_next(true);
        assert!(over[0].run.is_over);
    }

    #[test]
    fn a_silent_radar_ends_no_run() {
        let mut runs = Runs::default();
        live(&mut runs, 0..=10);
        runs.hear(EventKind::SourceLost);
        std::thread::sleep(Duration::from_millis(30));
        let (written, _) = runs.write_next(false);
        let passed_ms = written[0].run.end_ms - START_MS - 10_000;
        assert!((20..10_000).contains(&passed_ms), "{passed_ms} ms");
        // It is heard again.
        runs.hear(EventKind::SourceBack);
        live(&mut runs, 20..=21);
        let (written, _) = write_next(&mut runs);
        assert_eq!(written, [(None, run(0, 21, false))]);
    }

    #[test]
    fn what_is_forgotten_is_not_written_again() {
        let mut runs = Runs::default();
        live(&mut runs, 0..=100);
        runs.hear(EventKind::Present);
        written(&mut runs, 3);
        let forget = |runs: &mut Runs, from_s: i64, to_s: i64| {
            runs.forget(START_MS + 1_000 * from_s, START_MS + 1_000 * to_s);
            write_next(runs)
        };
        let unchanged = (vec![(Some(3), run(0, 100, false))], vec![]);
        assert_eq!(forget(&mut runs, -50, 0), unchanged);
        let later = (vec![(Some(3), run(20, 100, false))], vec![]);
        assert_eq!(forget(&mut runs, 10, 20), later);
        let anew = (
            vec![(None, run(100, 100, false))],
            vec![(100, EventKind::Present)],
        );
        assert_eq!(forget(&mut runs, 50, 1_000), anew);
        live(&mut runs, 101..=102);
        runs.begin_anew();
        let other = (
            vec![(None, run(102, 102, false))],
            vec![(102, EventKind::Present)],
        );
        assert_eq!(write_next(&mut runs), other);
    }
}
