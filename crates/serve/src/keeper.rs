//! The thread that writes into the memory.
//!
//! The pipeline never waits for a disk. What it wants to be kept goes through a queue to this thread, which also
//! publishes the rows of the timeline, because they have their numbers from the database. While the database cannot be
//! written, rows are published with negative numbers and not kept; this is counted, and writing is tried again after a
//! minute.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::bus::Bus;
use crate::error::StoreError;
use crate::http::Forget;
use crate::messages::{Body, Stamp};
use crate::metrics::Metrics;
use crate::pipeline::Output;
use crate::store::{Activity, ActivityRow, Event, Growth, Origin, Retention, Store};

/// Rows and events that may wait.
const QUEUE: usize = 1_024;
/// Time between two attempts to write after a failure.
const RETRY: Duration = Duration::from_secs(60);
/// Time between two prunings.
const PRUNE: Duration = Duration::from_secs(3_600);
/// How often the thread looks whether something is to be done.
const TICK: Duration = Duration::from_millis(200);
/// Rows that may still grow and whose numbers are remembered.
const MAX_OPEN_ROWS: usize = 1_024;

enum Record {
    Row(Stamp, u64, Activity),
    Event(Event),
}

/// The writing thread. It ends, with everything written, when this is dropped.
pub struct Keeper {
    sender: Option<SyncSender<Record>>,
    thread: Option<JoinHandle<()>>,
    store: Option<Arc<Mutex<Store>>>,
    bus: Arc<Bus>,
    metrics: Arc<Metrics>,
}

impl Keeper {
    /// Starts the thread. Without a store, rows are published only.
    ///
    /// # Errors
    /// If the system has no thread to give.
    pub fn start(
        store: Option<Store>,
        retention: Retention,
        bus: Arc<Bus>,
        metrics: Arc<Metrics>,
    ) -> std::io::Result<Self> {
        let store = store.map(|store| Arc::new(Mutex::new(store)));
        let (sender, receiver) = sync_channel(QUEUE);
        let writer = Writer {
            store: store.clone(),
            retention,
            origin: bus.about().origin,
            bus: Arc::clone(&bus),
            metrics: Arc::clone(&metrics),
            known: BTreeMap::new(),
            failed: None,
            retry: RETRY,
            pruned: None,
        };
        let thread = std::thread::Builder::new()
            .name("radarllm-store".into())
            .spawn(move || writer.run(&receiver))?;
        Ok(Self {
            sender: Some(sender),
            thread: Some(thread),
            store,
            bus,
            metrics,
        })
    }

    /// Publishes messages, and hands over what is to be kept. It never waits.
    pub fn take(&self, output: Output) {
        let record = match output {
            Output::Message(stamp, body) => return self.bus.publish(stamp, body),
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
        Some(Arc::new(move |from_ms, to_ms| {
            lock(&store).forget(Some(from_ms), to_ms)
        }))
    }
}

impl Drop for Keeper {
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
    failed: Option<Instant>,
    /// Time between two attempts to write after a failure.
    retry: Duration,
    pruned: Option<Instant>,
}

impl Writer {
    fn run(mut self, receiver: &Receiver<Record>) {
        loop {
            match receiver.recv_timeout(TICK) {
                Ok(first) => {
                    let mut records = vec![first];
                    records.extend(receiver.try_iter());
                    self.write(records);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            self.prune();
        }
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

    /// Writes records in one transaction. Returns the number of each in the database; `None` for what is not kept.
    fn keep(&mut self, records: &[Record]) -> Vec<Option<i64>> {
        let not_kept = vec![None; records.len()];
        let Some(store) = &self.store else {
            return not_kept;
        };
        if self.failed.is_some_and(|at| at.elapsed() < self.retry) {
            self.metrics.store_failures.add(records.len() as u64);
            return not_kept;
        }
        let before = self.known.clone();
        let (known, origin) = (&mut self.known, &self.origin);
        let kept = lock(store).write(|batch| {
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
                ids
            }
            Err(error) => {
                self.known = before;
                let is_invalid = matches!(error, StoreError::Invalid { .. });
                if is_invalid && records.len() > 1 {
                    // One of them cannot be kept; the others can.
                    return records.chunks(1).flat_map(|one| self.keep(one)).collect();
                }
                self.metrics.store_failures.add(records.len() as u64);
                self.failed = (!is_invalid).then(Instant::now);
                not_kept
            }
        }
    }

    fn prune(&mut self) {
        let Some(store) = &self.store else {
            return;
        };
        if self.pruned.is_some_and(|at| at.elapsed() < PRUNE) {
            return;
        }
        self.pruned = Some(Instant::now());
        let mut store = lock(store);
        let pruned = store.prune(now_ms(), &self.retention);
        if pruned.and_then(|_| store.checkpoint()).is_err() {
            self.metrics.store_failures.add(1);
        }
    }
}

/// Adds a row, or lets it grow. Returns its number in the database.
fn keep_row(
    batch: &crate::store::Batch<'_>,
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

/// The time of the computer, milliseconds since 1970 in UTC.
pub fn now_ms() -> i64 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    now.map_or(0, |d| i64::try_from(d.as_millis()).unwrap_or(i64::MAX))
}

/// A panic of another thread while it held the lock leaves a database that is complete.
fn lock(store: &Mutex<Store>) -> MutexGuard<'_, Store> {
    store.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use crate::messages::About;
    use crate::store::{ActivityQuery, EventKind, Timeline};

    use super::*;

    const START_MS: i64 = 1_795_455_492_000;

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
        let keeper = Keeper::start(
            Some(store),
            retention,
            Arc::clone(&bus),
            Arc::clone(&metrics),
        )
        .unwrap();
        keeper.take(row(1, 4, "a person walks"));
        keeper.take(row(2, 5, &"x".repeat(10_000)));
        keeper.take(row(1, 9, "a person walks"));
        keeper.take(Output::Event(Event {
            at_ms: START_MS,
            kind: EventKind::Present,
            person: None,
            data: None,
        }));
        drop(keeper);
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
            failed: None,
            retry: Duration::from_millis(50),
            pruned: None,
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

    /// A row is told with a negative number and counted while writing fails, nothing is tried before it is time, and
    /// everything before and after is kept.
    fn survives(path: &Path, fail: impl FnOnce(&Writer), heal: impl FnOnce(&Writer)) {
        let (mut writer, reader) = writer(path);
        let (metrics, bus) = (Arc::clone(&writer.metrics), Arc::clone(&writer.bus));
        writer.write(records(&[row(1, 4, "a person walks")]));
        fail(&writer);
        let long = "a person walks far ".repeat(100);
        let many: Vec<Output> = (10..40).map(|n| row(n, 5, &long)).collect();
        writer.write(records(&many));
        assert_eq!(metrics.store_failures.get(), 30);
        heal(&writer);
        writer.retry = Duration::from_secs(3_600);
        writer.write(records(&[row(2, 6, "a person sits down")]));
        assert_eq!(metrics.store_failures.get(), 31);
        writer.retry = Duration::ZERO;
        // A row that was kept grows, and one that was not is kept from now on.
        writer.write(records(&[
            row(1, 9, "a person walks"),
            row(2, 9, "a person sits down"),
        ]));
        assert_eq!(metrics.store_failures.get(), 31);
        let store = lock(writer.store.as_ref().unwrap());
        store.check_integrity().unwrap();
        drop(store);
        drop(writer);
        bus.close();
        let told = published(&reader);
        assert!(told[1..32].iter().all(|id| *id < 0), "{told:?}");
        assert_eq!((told[0], &told[32..]), (1, &[1, 2][..]));
        let page = Timeline::open(path)
            .unwrap()
            .activities(&ActivityQuery::default(), None, 10)
            .unwrap();
        assert_eq!(page.rows.len(), 2);
    }

    #[test]
    fn a_full_disk_is_counted_and_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let limit = |pages: u32| {
            move |writer: &Writer| {
                let store = lock(writer.store.as_ref().unwrap());
                store.limit_pages(pages);
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

    #[test]
    fn without_a_store_rows_are_published_only() {
        let bus = bus();
        let reader = bus.subscribe();
        let keeper =
            Keeper::start(None, Retention::default(), Arc::clone(&bus), Arc::default()).unwrap();
        assert!(keeper.forget().is_none());
        keeper.take(row(3, 4, "a person walks"));
        drop(keeper);
        bus.close();
        assert_eq!(published(&reader), [-3]);
    }
}
