//! The threads that make the clips of shards and write them.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use super::atomic::write_atomic;
use super::builder::Progress;
use super::folder::Folder;
use super::guard;
use super::manifest::{SCHEMA_VERSION, ShardEntry, hash_file};
use super::plan::Shard;
use crate::{
    BuildPlan, ClipRecord, DatasetError, FailedItem, ItemId, Overwrite, check_record, shard,
};

/// Results of the items of one shard in progress, in item order.
type Slots = Vec<Option<Result<ClipRecord, FailedItem>>>;

/// A shard that was asked for, and its entry if it is on disk.
pub(crate) struct Job<'a> {
    pub shard: &'a Shard,
    pub entry: Option<ShardEntry>,
}

/// Shared state of the worker threads.
pub(crate) struct Work<'a> {
    folder: &'a Folder,
    plan: &'a BuildPlan,
    jobs: &'a [Job<'a>],
    /// (job, item) of all items to generate, in job order.
    queue: Vec<(usize, usize)>,
    next: AtomicUsize,
    slots: Vec<Mutex<Slots>>,
    remaining: Vec<AtomicUsize>,
    n_items: usize,
    n_done: AtomicUsize,
    n_failed: AtomicUsize,
    n_shards_done: AtomicUsize,
    stop: AtomicBool,
    made: Mutex<Vec<(usize, ShardEntry)>>,
    error: Mutex<Option<DatasetError>>,
}

impl<'a> Work<'a> {
    pub(crate) fn new(folder: &'a Folder, plan: &'a BuildPlan, jobs: &'a [Job<'a>]) -> Self {
        let kept = || jobs.iter().filter_map(|j| j.entry.as_ref().map(|e| (j, e)));
        let missing = jobs.iter().enumerate().filter(|(_, j)| j.entry.is_none());
        Self {
            folder,
            plan,
            jobs,
            queue: missing
                .flat_map(|(j, job)| (0..job.shard.items.len()).map(move |i| (j, i)))
                .collect(),
            next: AtomicUsize::new(0),
            slots: jobs.iter().map(|_| Mutex::new(Vec::new())).collect(),
            remaining: jobs
                .iter()
                .map(|j| AtomicUsize::new(j.shard.items.len()))
                .collect(),
            n_items: jobs.iter().map(|j| j.shard.items.len()).sum(),
            n_done: AtomicUsize::new(kept().map(|(j, _)| j.shard.items.len()).sum()),
            n_failed: AtomicUsize::new(kept().map(|(_, e)| e.failed.len()).sum()),
            n_shards_done: AtomicUsize::new(kept().count()),
            stop: AtomicBool::new(false),
            made: Mutex::new(Vec::new()),
            error: Mutex::new(None),
        }
    }

    pub(crate) fn progress(&self) -> Progress {
        Progress {
            n_items: self.n_items,
            n_done: self.n_done.load(Ordering::Relaxed),
            n_failed: self.n_failed.load(Ordering::Relaxed),
            n_shards: self.jobs.len(),
            n_shards_done: self.n_shards_done.load(Ordering::Relaxed),
        }
    }

    /// One worker thread. It takes items until none remains. The worker that finishes a shard's last item writes the
    /// shard.
    pub(crate) fn run<E: std::fmt::Display>(
        &self,
        make: &(impl Fn(&ItemId) -> Result<ClipRecord, E> + Sync),
        progress: &(impl Fn(Progress) + Sync),
        stop: &(dyn Fn() -> bool + Sync),
    ) {
        while !self.stop.load(Ordering::Relaxed) && !stop() {
            let Some(&(job_idx, item_idx)) =
                self.queue.get(self.next.fetch_add(1, Ordering::Relaxed))
            else {
                return;
            };
            let shard = self.jobs[job_idx].shard;
            let result = make_item(&self.plan.items[shard.items[item_idx]], make);
            self.n_failed
                .fetch_add(usize::from(result.is_err()), Ordering::Relaxed);
            {
                let mut slots = lock(&self.slots[job_idx]);
                slots.resize_with(shard.items.len(), || None);
                slots[item_idx] = Some(result);
            }
            self.n_done.fetch_add(1, Ordering::Relaxed);
            // Release/acquire ordering: the last worker sees the slots of all others.
            if self.remaining[job_idx].fetch_sub(1, Ordering::AcqRel) == 1 {
                let slots = std::mem::take(&mut *lock(&self.slots[job_idx]));
                match self.write(shard, slots) {
                    Ok(entry) => {
                        lock(&self.made).push((job_idx, entry));
                        self.n_shards_done.fetch_add(1, Ordering::Relaxed);
                    }
                    Err(e) => {
                        lock(&self.error).get_or_insert(e);
                        self.stop.store(true, Ordering::Relaxed);
                    }
                }
            }
            progress(self.progress());
        }
    }

    fn write(&self, shard: &Shard, slots: Slots) -> Result<ShardEntry, DatasetError> {
        let mut records = Vec::with_capacity(slots.len());
        let mut failed = Vec::new();
        for result in slots.into_iter().flatten() {
            match result {
                Ok(record) => records.push(record),
                Err(failure) => failed.push(failure),
            }
        }
        let file = shard.file();
        let path = self.folder.dir().join(&file);
        let metadata = [
            ("radarllm.schema_version", SCHEMA_VERSION.to_string()),
            ("radarllm.dataset", self.plan.name.clone()),
            ("radarllm.shard", shard.stem.clone()),
            ("radarllm.split", shard.split.name().into()),
            ("radarllm.radar", self.plan.radar.clone()),
            ("radarllm.frame_rate_hz", self.plan.frame_rate_hz.to_string()),
            ("radarllm.seed", self.plan.seed.to_string()),
            ("radarllm.config_blake3", self.folder.config_blake3().into()),
            ("radarllm.tool_version", self.plan.tool_version.clone()),
            (
                "radarllm.units",
                "points: x, y, z, range in m, velocity in m/s (positive when receding), intensity in dB; \
                 axes: x right, y away from the radar, z up; joints in m; times in s"
                    .into(),
            ),
        ];
        let metadata = metadata
            .into_iter()
            .map(|(key, value)| (key.to_string(), value))
            .collect();
        write_atomic(&path, Overwrite::Replace, |out| {
            shard::write_shard(&path, out, &records, metadata)
        })?;
        let (blake3, bytes) = hash_file(&path)?;
        let entry = ShardEntry {
            file,
            split: shard.split.name().into(),
            rows: records.len() as u64,
            bytes,
            blake3,
            ids: records.into_iter().map(|r| r.id).collect(),
            failed,
        };
        self.folder.write_sidecar(shard, &entry)?;
        Ok(entry)
    }

    /// Shards that were made, by their job.
    pub(crate) fn into_result(self) -> Result<Vec<(usize, ShardEntry)>, DatasetError> {
        let error = self.error.into_inner();
        match error.unwrap_or_else(std::sync::PoisonError::into_inner) {
            Some(e) => Err(e),
            None => Ok(self
                .made
                .into_inner()
                .unwrap_or_else(std::sync::PoisonError::into_inner)),
        }
    }
}

/// Locks a mutex. No code panics while a lock is held, except when memory is exhausted.
fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// Calls `make` and checks the result. One bad motion must not end a build of hours, so a
/// panic is caught, recorded and counted as well.
fn make_item<E: std::fmt::Display>(
    item: &ItemId,
    make: &impl Fn(&ItemId) -> Result<ClipRecord, E>,
) -> Result<ClipRecord, FailedItem> {
    let fail = |reason: String| {
        Err(FailedItem {
            id: item.id.clone(),
            reason,
        })
    };
    let record = match catch_unwind(AssertUnwindSafe(|| make(item))) {
        Ok(Ok(record)) => record,
        Ok(Err(e)) => return fail(e.to_string()),
        Err(panic) => return fail(format!("panicked: {}", guard::panic_message(&*panic))),
    };
    if record.id != item.id || record.group != item.group || record.split != item.split {
        return fail(format!(
            "made clip `{}` of group `{}` in {}, not the one asked for",
            record.id, record.group, record.split
        ));
    }
    match check_record(&record) {
        Ok(()) => Ok(record),
        Err(e) => fail(e.to_string()),
    }
}
