//! The thread that writes into the memory.
//!
//! The pipeline never waits for a disk. What it wants to be kept goes through a queue to this thread, which also
//! publishes the rows of the timeline, because they have their numbers from the database. While the database cannot be
//! written, rows are published with negative numbers and not kept; this is counted and reported with the health, and writing is
//! tried again after a minute. Events such as falls wait until then, and are written with the time at which they happened.
//!
//! The thread also writes every few seconds until when the radar has been watched, so that the memory denies nothing of a time
//! in which nobody watched.

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use radarllm_memory::StoreError;
use radarllm_memory::store::{EventQuery, Retention, Store, Timeline};
use radarllm_monitor::falls::EarlierFall;
use radarllm_monitor::messages::{Body, Stamp};
use radarllm_monitor::pipeline::Output;
use radarllm_monitor::rows::{Activity, ActivityRow, Event, EventKind, EventRow, Growth, Origin};

use crate::bus::Bus;
use crate::http::Forget;
use crate::local_time::now_ms;
use crate::metrics::Metrics;
use crate::mqtt::Status;
use crate::runs::{REFRESH, Runs};

/// Rows and events that may wait.
const QUEUE: usize = 1_024;
/// Events that wait until the database can be written again. Of more, the oldest ones are given up and counted.
const MAX_WAITING_EVENTS: usize = 1_024;
/// Time between two attempts to write after a failure.
const RETRY: Duration = Duration::from_secs(60);
/// The same after the database was deleted or replaced, when a new one can be begun.
const REOPEN: Duration = Duration::from_secs(2);
/// For how long the system's clock must have gone like a clock before rows are deleted by its time alone.
const STEADY: Duration = Duration::from_secs(3_600);
/// A difference between the system's clock and a steady one that is a step of the former, ms.
const STEP_MS: i64 = 10_000;
/// Time between two prunings.
const PRUNE: Duration = Duration::from_secs(3_600);
/// How often the thread looks whether something is to be done.
const TICK: Duration = Duration::from_millis(200);
/// Oldest fall that is taken over from an earlier run, ms.
const OPEN_FALL_MS: i64 = 86_400_000;
/// Rows that may still grow and whose numbers are remembered.
const MAX_OPEN_ROWS: usize = 1_024;

enum Record {
    Row(Stamp, u64, Activity),
    Event(Event),
}

/// The writing thread. It ends, with everything written, when this is dropped.
pub struct StoreWriter {
    sender: Option<SyncSender<Record>>,
    thread: Option<JoinHandle<()>>,
    store: Option<Arc<Mutex<Store>>>,
    /// Events that could not be written.
    waiting: Arc<Mutex<VecDeque<Event>>>,
    runs: Arc<Mutex<Runs>>,
    bus: Arc<Bus>,
    metrics: Arc<Metrics>,
    broker: Option<Status>,
}

impl StoreWriter {
    /// Starts the thread. Without a store, rows are published only. Problems of the store and of the broker are added to
    /// the health.
    ///
    /// # Errors
    /// If the system has no thread to give.
    pub fn start(
        store: Option<Store>,
        retention: Retention,
        bus: Arc<Bus>,
        metrics: Arc<Metrics>,
        broker: Option<Status>,
    ) -> std::io::Result<Self> {
        // A memory that cannot be read is found when it is written.
        let newest = |store: &Store| store.timeline().newest_ms().ok().flatten();
        let newest_ms = store.as_ref().and_then(newest);
        let store = store.map(|store| Arc::new(Mutex::new(store)));
        let (sender, receiver) = sync_channel(QUEUE);
        let waiting = Arc::<Mutex<VecDeque<Event>>>::default();
        let runs = Arc::<Mutex<Runs>>::default();
        let writer = Writer {
            store: store.clone(),
            retention,
            origin: bus.about().origin,
            bus: Arc::clone(&bus),
            metrics: Arc::clone(&metrics),
            known: BTreeMap::new(),
            waiting: Arc::clone(&waiting),
            runs: Arc::clone(&runs),
            alive: None,
            failed: None,
            retry: RETRY,
            is_replaced: false,
            pruned: None,
            clock: Clock::new(newest_ms),
        };
        let thread = std::thread::Builder::new()
            .name("radarllm-store".into())
            .spawn(move || writer.run(&receiver))?;
        Ok(Self {
            sender: Some(sender),
            thread: Some(thread),
            store,
            waiting,
            runs,
            bus,
            metrics,
            broker,
        })
    }

    /// Publishes messages, and hands over what is to be kept. It never waits.
    pub fn accept(&self, output: Output) {
        {
            let mut runs = lock(&self.runs);
            match &output {
                Output::Message(stamp, _) | Output::Row { stamp, .. } => runs.live(stamp.utc_ms),
                Output::Event(event) => {
                    runs.live(event.at_ms);
                    runs.hear(event.kind);
                }
            }
        }
        let record = match output {
            Output::Message(stamp, mut body) => {
                if let Body::Health(health) = &mut body {
                    health.problems.extend(self.metrics.store_problem.get());
                    let problem = self.broker.as_ref().and_then(Status::problem);
                    let in_words = |p| format!("the broker cannot be used: {p}");
                    health.problems.extend(problem.map(in_words));
                }
                return self.bus.publish(stamp, body);
            }
            Output::Row {
                stamp,
                row,
                activity,
            } => Record::Row(stamp, row, activity),
            Output::Event(event) => Record::Event(event),
        };
        let Some(sender) = &self.sender else {
            return;
        };
        if let Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) = sender.try_send(record)
        {
            self.metrics.store_failures.add(1);
        }
    }

    /// How the HTTP server forgets; `None` without a store.
    pub fn forget(&self) -> Option<Forget> {
        let store = Arc::clone(self.store.as_ref()?);
        let (waiting, runs) = (Arc::clone(&self.waiting), Arc::clone(&self.runs));
        Some(Arc::new(move |from_ms, to_ms| {
            lock(&waiting).retain(|event| !(from_ms..to_ms).contains(&event.at_ms));
            // No run is written meanwhile.
            let mut store = lock(&store);
            lock(&runs).forget(from_ms, to_ms);
            store.forget(Some(from_ms), to_ms)
        }))
    }
}

impl Drop for StoreWriter {
    fn drop(&mut self) {
        drop(self.sender.take());
        if let Some(thread) = self.thread.take() {
            // A panic of the thread was printed by it.
            let _ = thread.join();
        }
    }
}

struct Writer {
    store: Option<Arc<Mutex<Store>>>,
    retention: Retention,
    origin: Origin,
    bus: Arc<Bus>,
    metrics: Arc<Metrics>,
    /// Number in the database and end of the rows that may still grow, by the pipeline's number.
    known: BTreeMap<u64, (i64, i64)>,
    /// Events that could not be written.
    waiting: Arc<Mutex<VecDeque<Event>>>,
    runs: Arc<Mutex<Runs>>,
    /// When the last sign of life was written.
    alive: Option<Instant>,
    failed: Option<Instant>,
    /// Time between two attempts to write after a failure.
    retry: Duration,
    /// Whether the database was deleted or replaced, and no other one could be opened since.
    is_replaced: bool,
    pruned: Option<Instant>,
    clock: Clock,
}

/// The system's clock beside a steady one.
struct Clock {
    /// When the memory was opened.
    opened: Instant,
    /// The newest row at that time.
    newest_ms: Option<i64>,
    /// When both clocks were last read.
    last: (Instant, i64),
    /// Since when both go alike.
    steady_since: Instant,
}

impl Clock {
    fn new(newest_ms: Option<i64>) -> Self {
        let now = Instant::now();
        Self {
            opened: now,
            newest_ms,
            last: (now, now_ms()),
            steady_since: now,
        }
    }

    /// The time by which rows are old: the system's, or, while it is not known to be right, at most that of the newest row
    /// that was there and the time since. A clock that is years ahead after a start would let everything be too old.
    fn age_ms(&mut self, now: Instant, now_ms: i64) -> i64 {
        let between = |from: Instant| millis(now.saturating_duration_since(from));
        let expected_ms = self.last.1.saturating_add(between(self.last.0));
        if now_ms.saturating_sub(expected_ms).abs() > STEP_MS {
            self.steady_since = now;
        }
        self.last = (now, now_ms);
        match self.newest_ms {
            Some(newest_ms) if now.saturating_duration_since(self.steady_since) < STEADY => {
                now_ms.min(newest_ms.saturating_add(between(self.opened)))
            }
            _ => now_ms,
        }
    }
}

fn millis(time: Duration) -> i64 {
    i64::try_from(time.as_millis()).unwrap_or(i64::MAX)
}

impl Writer {
    fn run(mut self, receiver: &Receiver<Record>) {
        loop {
            match receiver.recv_timeout(TICK) {
                Ok(first) => {
                    let mut records = vec![first];
                    records.extend(receiver.try_iter());
                    // Before them, so that they are of a time that is known.
                    self.keep_alive(false);
                    self.write(records);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            self.catch_up();
            if self.alive.is_none_or(|at| at.elapsed() >= REFRESH) {
                self.keep_alive(false);
            }
            self.prune();
        }
        // The last attempt, also if it is not time yet.
        self.failed = None;
        self.catch_up();
        self.keep_alive(true);
        self.metrics
            .store_failures
            .add(lock(&self.waiting).len() as u64);
        if let Some(store) = &self.store {
            // A checkpoint that does not succeed is made when the database is opened next.
            let _ = lock(store).checkpoint();
        }
    }

    fn write(&mut self, records: Vec<Record>) {
        let ids = self.keep(&records);
        for (record, id) in records.into_iter().zip(ids) {
            if let Record::Row(stamp, row, activity) = record {
                let row = ActivityRow {
                    id: id.unwrap_or(-i64::try_from(row).unwrap_or(i64::MAX)),
                    activity,
                    origin: self.origin.clone(),
                };
                self.bus.publish(stamp, Body::Activity(Box::new(row)));
            }
        }
    }

    /// Writes events that wait, if it is time to try again. Returns whether writing may go on.
    fn catch_up(&mut self) -> bool {
        let Some(store) = self.store.clone() else {
            return false;
        };
        let retry = match self.is_replaced {
            true => self.retry.min(REOPEN),
            false => self.retry,
        };
        if self.failed.is_some_and(|at| at.elapsed() < retry) {
            return false;
        }
        if self.is_replaced {
            // Numbers of rows in the database that is lost mean nothing in the new one.
            self.known.clear();
            let reopened = lock(&store).reopen();
            if let Err(error) = reopened {
                self.fail(&error);
                return false;
            }
            self.is_replaced = false;
            self.failed = None;
            lock(&self.runs).begin_anew();
            self.metrics.store_problem.set(None);
        }
        let origin = &self.origin;
        let mut waiting = lock(&self.waiting);
        while !waiting.is_empty() {
            let all: Vec<Event> = waiting.iter().cloned().collect();
            let insert = |events: &[Event]| {
                lock(&store).write(|batch| {
                    let mut events = events.iter();
                    events.try_for_each(|event| batch.insert_event(event, origin).map(drop))
                })
            };
            match insert(&all) {
                Ok(()) => {
                    waiting.clear();
                    self.failed = None;
                    self.metrics.store_problem.set(None);
                }
                // One of them cannot be kept; the others can.
                Err(StoreError::Invalid { .. }) => match insert(&all[..1]) {
                    Ok(()) => drop(waiting.pop_front()),
                    Err(StoreError::Invalid { .. }) => {
                        waiting.pop_front();
                        self.metrics.store_failures.add(1);
                    }
                    Err(error) => {
                        drop(waiting);
                        self.fail(&error);
                        return false;
                    }
                },
                Err(error) => {
                    drop(waiting);
                    self.fail(&error);
                    return false;
                }
            }
        }
        true
    }

    /// Writes until when the radar has been watched, if it is time to write.
    fn keep_alive(&mut self, is_over: bool) {
        if !self.catch_up() {
            return;
        }
        let Some(store) = self.store.clone() else {
            return;
        };
        let mut store = lock(&store);
        let (mut runs, events) = lock(&self.runs).write_next(is_over);
        if runs.is_empty() {
            return;
        }
        let origin = &self.origin;
        let written = store.write(|batch| {
            for written in &mut runs {
                written.id = Some(batch.write_run(written.id, &written.run)?);
            }
            let mut events = events.iter();
            events.try_for_each(|event| batch.insert_event(event, origin).map(drop))
        });
        match written {
            Ok(()) => {
                lock(&self.runs).written(&runs, events.len());
                self.alive = Some(Instant::now());
                self.failed = None;
                self.metrics.store_problem.set(None);
            }
            Err(error) => {
                drop(store);
                self.fail(&error);
            }
        }
    }

    /// Remembers that the database cannot be written.
    fn fail(&mut self, error: &StoreError) {
        self.failed = Some(Instant::now());
        self.is_replaced |= matches!(error, StoreError::Replaced { .. });
        let problem = format!("the memory cannot be written: {error}");
        self.metrics.store_problem.set(Some(problem));
    }

    /// Lets the events among records wait, and counts the others.
    fn put_off(&self, records: &[Record]) {
        let mut waiting = lock(&self.waiting);
        for record in records {
            match record {
                Record::Event(event) => waiting.push_back(event.clone()),
                Record::Row(..) => self.metrics.store_failures.add(1),
            }
        }
        while waiting.len() > MAX_WAITING_EVENTS {
            waiting.pop_front();
            self.metrics.store_failures.add(1);
        }
    }

    /// Writes records in one transaction, after the events that wait. Returns the number of each in the database; `None`
    /// for what is not kept.
    fn keep(&mut self, records: &[Record]) -> Vec<Option<i64>> {
        let not_kept = vec![None; records.len()];
        let Some(store) = self.store.clone() else {
            return not_kept;
        };
        if !self.catch_up() {
            self.put_off(records);
            return not_kept;
        }
        let before = self.known.clone();
        let (known, origin) = (&mut self.known, &self.origin);
        let kept = lock(&store).write(|batch| {
            let ids = records.iter().map(|record| match record {
                Record::Row(_, row, activity) => keep_row(batch, known, *row, activity, origin),
                Record::Event(event) => batch.insert_event(event, origin),
            });
            ids.map(|id| id.map(Some)).collect()
        });
        while self.known.len() > MAX_OPEN_ROWS {
            self.known.pop_first();
        }
        match kept {
            Ok(ids) => {
                self.failed = None;
                self.metrics.store_problem.set(None);
                ids
            }
            Err(error) => {
                self.known = before;
                let is_invalid = matches!(error, StoreError::Invalid { .. });
                if is_invalid && records.len() > 1 {
                    // One of them cannot be kept; the others can.
                    return records.chunks(1).flat_map(|one| self.keep(one)).collect();
                }
                if is_invalid {
                    self.metrics.store_failures.add(records.len() as u64);
                } else {
                    self.put_off(records);
                    self.fail(&error);
                }
                not_kept
            }
        }
    }

    fn prune(&mut self) {
        let age_ms = self.clock.age_ms(Instant::now(), now_ms());
        let Some(store) = self.store.as_ref().filter(|_| !self.is_replaced) else {
            return;
        };
        if self.pruned.is_some_and(|at| at.elapsed() < PRUNE) {
            return;
        }
        self.pruned = Some(Instant::now());
        let mut store = lock(store);
        let pruned = store.prune(age_ms, &self.retention);
        if pruned.and_then(|_| store.checkpoint()).is_err() {
            self.metrics.store_failures.add(1);
        }
    }
}

/// Adds a row, or lets it grow. Returns its number in the database.
fn keep_row(
    batch: &radarllm_memory::store::Batch<'_>,
    known: &mut BTreeMap<u64, (i64, i64)>,
    row: u64,
    activity: &Activity,
    origin: &Origin,
) -> Result<i64, StoreError> {
    if let Some((id, kept_end_ms)) = known.get_mut(&row) {
        let growth = Growth {
            end_ms: activity.end_ms.max(*kept_end_ms),
            caption: activity.caption.clone(),
            confidence: activity.confidence,
            windows: activity.windows,
            points: activity.points,
            place_m: activity.place_m,
        };
        match batch.extend_activity(*id, &growth) {
            Ok(()) => {
                *kept_end_ms = growth.end_ms;
                return Ok(*id);
            }
            // It was forgotten meanwhile.
            Err(StoreError::Missing { .. }) => {}
            Err(error) => return Err(error),
        }
    }
    let id = batch.insert_activity(activity, origin)?;
    known.insert(row, (id, activity.end_ms));
    Ok(id)
}

/// Opens the memory at a path.
///
/// # Errors
/// As [`Store::open`].
pub fn open(path: &Path) -> Result<(Store, Option<PathBuf>), StoreError> {
    let opened = Store::open(path, now_ms())?;
    Ok((opened.store, opened.set_aside.map(|file| file.path)))
}

/// Falls of the last day that a radar suspected or confirmed and of which no end is known, the oldest first. A fall is over
/// when the person rises or a viewer says so; that a program ended and was started anew ends none.
///
/// # Errors
/// A database that cannot be read.
pub fn open_falls(
    timeline: &Timeline,
    origin: &Origin,
    now_ms: i64,
) -> Result<Vec<EarlierFall>, StoreError> {
    let query = EventQuery {
        from_ms: Some(now_ms.saturating_sub(OPEN_FALL_MS)),
        kinds: vec![
            EventKind::Suspected,
            EventKind::Confirmed,
            EventKind::Dismissed,
            EventKind::Recovered,
        ],
        ..EventQuery::default()
    };
    let (mut events, mut before) = (Vec::new(), None);
    loop {
        let page = timeline.events(&query, before, usize::MAX)?;
        events.extend(page.rows);
        before = page.next;
        if before.is_none() {
            break;
        }
    }
    let is_of_radar = |row: &EventRow| {
        row.origin.source == origin.source && row.origin.synthetic == origin.synthetic
    };
    let mut open: Vec<EarlierFall> = Vec::new();
    // Pages are newest first.
    for EventRow { event, .. } in events.into_iter().filter(is_of_radar).rev() {
        let data = event.data.unwrap_or_default();
        let Some(fall) = data["fall"].as_u64() else {
            continue;
        };
        match event.kind {
            EventKind::Suspected => {
                // Numbers begin anew with every run that had no open fall.
                open.retain(|known| known.fall != fall);
                let place_m: Result<[f64; 2], _> = serde_json::from_value(data["place_m"].clone());
                if let (Some(person), Ok(place_m)) = (event.person, place_m) {
                    open.push(EarlierFall {
                        fall,
                        person,
                        is_confirmed: false,
                        age_s: now_ms.saturating_sub(event.at_ms).max(0) as f64 / 1e3,
                        place_m,
                    });
                }
            }
            EventKind::Confirmed => {
                let known = open.iter_mut().filter(|known| known.fall == fall);
                known.for_each(|known| known.is_confirmed = true);
            }
            _ => open.retain(|known| known.fall != fall),
        }
    }
    Ok(open)
}

/// A panic of another thread while it held the lock leaves a database and a list that are complete.
fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use radarllm_memory::store::ActivityQuery;
    use radarllm_monitor::messages::About;

    use super::*;

    const START_MS: i64 = 1_795_455_492_000;

    #[test]
    fn falls_whose_end_is_unknown_are_open_and_others_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("live.db");
        let mut store = open(&path).unwrap().0;
        let origin = bus().about().origin;
        let other = Origin {
            source: "another port".into(),
            ..origin.clone()
        };
        let event = |at_s: i64, kind, fall: u64| Event {
            at_ms: START_MS + at_s * 1_000,
            kind,
            person: Some(3),
            data: Some(serde_json::json!({
                "fall": fall, "dwell_s": 0.0, "place_m": [0.5, 2.0],
            })),
        };
        use EventKind::{Confirmed, Dismissed, Recovered, Suspected};
        let day_s = 86_400;
        let rows = [
            // Longer ago than a day.
            (event(-day_s - 10, Suspected, 9), &origin),
            (event(0, Suspected, 1), &origin),
            (event(20, Confirmed, 1), &origin),
            (event(60, Recovered, 1), &origin),
            (event(100, Suspected, 2), &origin),
            (event(102, Dismissed, 2), &origin),
            (event(110, Suspected, 3), &origin),
            (event(130, Confirmed, 3), &origin),
            (event(140, Suspected, 4), &origin),
            (event(150, Suspected, 5), &other),
        ];
        store
            .write(|batch| {
                let mut rows = rows.iter();
                rows.try_for_each(|(event, origin)| batch.insert_event(event, origin).map(drop))
            })
            .unwrap();
        let open = open_falls(store.timeline(), &origin, START_MS + 150_000).unwrap();
        let expected = |fall, is_confirmed, age_s| EarlierFall {
            fall,
            person: 3,
            is_confirmed,
            age_s,
            place_m: [0.5, 2.0],
        };
        assert_eq!(open, [expected(3, true, 40.0), expected(4, false, 10.0)]);
    }

    fn bus() -> Arc<Bus> {
        Arc::new(Bus::new(About {
            name: "lounge".into(),
            origin: Origin {
                source: "test:".into(),
                radar: "test".into(),
                model: "none".into(),
                decoder: "greedy".into(),
                version: "0".into(),
                synthetic: true,
            },
            radar_height_m: 1.0,
            frame_period_s: 0.1,
            zones: Vec::new(),
        }))
    }

    fn row(row: u64, end_s: i64, caption: &str) -> Output {
        Output::Row {
            stamp: Stamp {
                utc_ms: START_MS + end_s * 1_000,
                t_s: end_s as f64,
            },
            row,
            activity: Activity {
                start_ms: START_MS,
                end_ms: START_MS + end_s * 1_000,
                person: 1,
                action: "walk".into(),
                caption: caption.into(),
                confidence: Some(0.5),
                windows: 1,
                points: 100,
                place_m: None,
            },
        }
    }

    /// Numbers of the rows that were published.
    fn published(reader: &crate::bus::Reader) -> Vec<i64> {
        let next = || reader.recv_timeout(Duration::from_secs(10)).ok();
        let messages = std::iter::from_fn(next).map(|message| {
            let message: serde_json::Value = serde_json::from_str(&message.json).unwrap();
            message["id"].as_i64()
        });
        messages.flatten().collect()
    }

    #[test]
    fn rows_grow_and_keep_their_numbers() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("live.db");
        let (bus, metrics) = (bus(), Arc::new(Metrics::default()));
        let reader = bus.subscribe();
        let (store, damaged) = open(&path).unwrap();
        assert_eq!(damaged, None);
        let retention = Retention {
            activities_ms: i64::MAX / 4,
            ..Retention::default()
        };
        let store_writer = StoreWriter::start(
            Some(store),
            retention,
            Arc::clone(&bus),
            Arc::clone(&metrics),
            None,
        )
        .unwrap();
        store_writer.accept(row(1, 4, "a person walks"));
        store_writer.accept(row(2, 5, &"x".repeat(10_000)));
        store_writer.accept(row(1, 9, "a person walks"));
        store_writer.accept(Output::Event(Event {
            at_ms: START_MS,
            kind: EventKind::Present,
            person: None,
            data: None,
        }));
        drop(store_writer);
        bus.close();
        assert_eq!(published(&reader), [1, -2, 1]);
        assert_eq!(metrics.store_failures.get(), 1);
        let timeline = Timeline::open(&path).unwrap();
        let page = timeline
            .activities(&ActivityQuery::default(), None, 10)
            .unwrap();
        let ends: Vec<i64> = page.rows.iter().map(|r| r.activity.end_ms).collect();
        assert_eq!(ends, [START_MS + 9_000]);
        assert_eq!(timeline.oldest_ms().unwrap(), Some(START_MS));
        // The radar was watched from the first message to the last one.
        let watched = radarllm_memory::store::Run {
            start_ms: START_MS + 4_000,
            end_ms: START_MS + 9_000,
            is_over: true,
        };
        assert_eq!(timeline.newest_run().unwrap(), Some(watched));
    }

    /// A writer that tries again after 50 ms, and what it publishes.
    fn writer(path: &Path) -> (Writer, crate::bus::Reader) {
        let bus = bus();
        let reader = bus.subscribe();
        let (store, _) = open(path).unwrap();
        let writer = Writer {
            store: Some(Arc::new(Mutex::new(store))),
            retention: Retention::default(),
            origin: bus.about().origin,
            bus,
            metrics: Arc::default(),
            known: BTreeMap::new(),
            waiting: Arc::default(),
            runs: Arc::default(),
            alive: None,
            failed: None,
            retry: Duration::from_millis(50),
            is_replaced: false,
            pruned: None,
            clock: Clock::new(None),
        };
        (writer, reader)
    }

    fn records(outputs: &[Output]) -> Vec<Record> {
        let record = |output: &Output| match output.clone() {
            Output::Row {
                stamp,
                row,
                activity,
            } => Some(Record::Row(stamp, row, activity)),
            Output::Event(event) => Some(Record::Event(event)),
            Output::Message(..) => None,
        };
        outputs.iter().filter_map(record).collect()
    }

    /// A row is published with a negative number and counted while writing fails, nothing is tried before it is time, and
    /// everything before and after is kept, and every event. The problem is reported as long as it lasts.
    fn survives(path: &Path, fail: impl FnOnce(&Writer), heal: impl FnOnce(&Writer)) {
        let (mut writer, reader) = writer(path);
        let (metrics, bus) = (Arc::clone(&writer.metrics), Arc::clone(&writer.bus));
        writer.write(records(&[row(1, 4, "a person walks")]));
        fail(&writer);
        let long = "a person walks far ".repeat(100);
        let mut many: Vec<Output> = (10..40).map(|n| row(n, 5, &long)).collect();
        let fall = |kind, at_s: i64| {
            Output::Event(Event {
                at_ms: START_MS + 1_000 * at_s,
                kind,
                person: Some(1),
                data: None,
            })
        };
        many.push(fall(EventKind::Suspected, 5));
        assert_eq!(metrics.store_problem.get(), None);
        writer.write(records(&many));
        assert_eq!(metrics.store_failures.get(), 30);
        let problem = metrics.store_problem.get().unwrap();
        assert!(
            problem.starts_with("the memory cannot be written: "),
            "{problem}"
        );
        heal(&writer);
        writer.retry = Duration::from_secs(3_600);
        writer.write(records(&[row(2, 6, "a person sits down")]));
        writer.write(records(&[fall(EventKind::Confirmed, 25)]));
        writer.catch_up();
        assert_eq!(
            (metrics.store_failures.get(), lock(&writer.waiting).len()),
            (31, 2)
        );
        assert!(metrics.store_problem.get().is_some());
        writer.retry = Duration::ZERO;
        // A row that was kept grows, and one that was not is kept from now on.
        writer.write(records(&[
            row(1, 9, "a person walks"),
            row(2, 9, "a person sits down"),
        ]));
        assert_eq!(
            (metrics.store_failures.get(), lock(&writer.waiting).len()),
            (31, 0)
        );
        assert_eq!(metrics.store_problem.get(), None);
        let store = lock(writer.store.as_ref().unwrap());
        store.check_integrity().unwrap();
        drop(store);
        drop(writer);
        bus.close();
        let ids = published(&reader);
        assert!(ids[1..32].iter().all(|id| *id < 0), "{ids:?}");
        assert_eq!((ids[0], &ids[32..]), (1, &[1, 2][..]));
        let page = Timeline::open(path)
            .unwrap()
            .activities(&ActivityQuery::default(), None, 10)
            .unwrap();
        assert_eq!(page.rows.len(), 2);
        let events = Timeline::open(path).unwrap();
        let events = events.events(&EventQuery::default(), None, 10).unwrap();
        let mut kinds: Vec<_> = events
            .rows
            .iter()
            .map(|r| (r.event.at_ms, r.event.kind))
            .collect();
        kinds.sort_by_key(|(at_ms, _)| *at_ms);
        let expected = [
            (START_MS + 5_000, EventKind::Suspected),
            (START_MS + 25_000, EventKind::Confirmed),
        ];
        assert_eq!(kinds, expected);
    }

    #[test]
    fn a_full_disk_is_counted_and_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let limit = |pages: u32| {
            move |writer: &Writer| {
                let store = lock(writer.store.as_ref().unwrap());
                store.limit_pages(pages).unwrap();
            }
        };
        survives(&folder.path().join("live.db"), limit(1), limit(100_000));
    }

    #[test]
    fn a_database_that_another_program_locks_is_counted_and_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("live.db");
        let other = std::cell::OnceCell::new();
        survives(
            &path,
            |_| {
                let connection = rusqlite::Connection::open(&path).unwrap();
                connection.execute_batch("BEGIN IMMEDIATE").unwrap();
                other.set(connection).unwrap();
            },
            |_| other.get().unwrap().execute_batch("ROLLBACK").unwrap(),
        );
    }

    /// Deleted, moved away with its folder, and replaced: it is told, and what comes afterwards is kept.
    #[test]
    fn a_database_that_is_deleted_or_replaced_is_noticed_and_begun_anew() {
        for replace in [
            (|path: &Path| std::fs::remove_file(path).unwrap()) as fn(&Path),
            |path| std::fs::remove_dir_all(path.parent().unwrap()).unwrap(),
            |path| {
                let other = path.with_extension("other");
                drop(open(&other).unwrap());
                std::fs::rename(&other, path).unwrap();
            },
        ] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("sub/live.db");
            std::fs::create_dir(path.parent().unwrap()).unwrap();
            let (mut writer, _reader) = writer(&path);
            writer.write(records(&[row(1, 4, "a person walks")]));
            assert_eq!(writer.metrics.store_problem.get(), None);
            replace(&path);
            writer.write(records(&[row(1, 5, "a person walks")]));
            let problem = writer.metrics.store_problem.get().unwrap();
            assert!(
                problem.ends_with("was deleted or replaced while it was open"),
                "{problem}"
            );
            assert_eq!(writer.metrics.store_failures.get(), 1);
            std::thread::sleep(Duration::from_millis(60));
            if !path.parent().unwrap().exists() {
                writer.write(records(&[row(1, 6, "a person walks")]));
                let problem = writer.metrics.store_problem.get().unwrap();
                assert!(problem.contains("live.db.lock: cannot create"), "{problem}");
                std::fs::create_dir(path.parent().unwrap()).unwrap();
                std::thread::sleep(Duration::from_millis(60));
            }
            writer.write(records(&[row(1, 9, "a person walks")]));
            assert_eq!(writer.metrics.store_problem.get(), None);
            let timeline = Timeline::open(&path).unwrap();
            let page = timeline.activities(&ActivityQuery::default(), None, 10);
            let ends: Vec<i64> = page
                .unwrap()
                .rows
                .iter()
                .map(|r| r.activity.end_ms)
                .collect();
            assert_eq!(ends, [START_MS + 9_000]);
        }
    }

    #[test]
    fn a_clock_that_is_ahead_is_not_believed_before_it_was_steady() {
        let start = Instant::now();
        let (day_ms, s) = (86_400_000, Duration::from_secs);
        let mut clock = Clock {
            opened: start,
            newest_ms: Some(1_000),
            last: (start, 400 * day_ms),
            steady_since: start,
        };
        let ahead = |clock: &mut Clock, after: u64, days: i64| {
            let after_ms = i64::try_from(after).unwrap() * 1_000;
            clock.age_ms(start + s(after), days * day_ms + after_ms)
        };
        assert_eq!(ahead(&mut clock, 5, 400), 6_000);
        // Corrected by the network, then a step by hand.
        assert_eq!(ahead(&mut clock, 60, 0), 60_000);
        assert_eq!(ahead(&mut clock, 3_500, 40), 3_501_000);
        assert_eq!(ahead(&mut clock, 7_000, 40), 7_001_000);
        // An hour after the last step.
        assert_eq!(ahead(&mut clock, 7_101, 40), 40 * day_ms + 7_101_000);
        // An empty memory has nothing to lose.
        clock.newest_ms = None;
        assert_eq!(ahead(&mut clock, 7_102, 80), 80 * day_ms + 7_102_000);
    }

    #[test]
    fn without_a_store_rows_are_published_only() {
        let bus = bus();
        let reader = bus.subscribe();
        let store_writer = StoreWriter::start(
            None,
            Retention::default(),
            Arc::clone(&bus),
            Arc::default(),
            None,
        )
        .unwrap();
        assert!(store_writer.forget().is_none());
        store_writer.accept(row(3, 4, "a person walks"));
        drop(store_writer);
        bus.close();
        assert_eq!(published(&reader), [-3]);
    }
}
