//! Builds a data set resumably and independently of the number of threads.
//!
//! Items are assigned to shards by their order in the plan, split by split. A shard appears under
//! its name only when it is complete (temporary file, fsync, rename); then its sidecar in `.shards/`
//! records its hash. A killed build therefore leaves only complete shards. A second run of the same
//! plan keeps those whose bytes still match their sidecar and builds the others. The manifest is written
//! last.

use std::collections::{HashMap, HashSet};
use std::fs::{self, File};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use serde::{Deserialize, Serialize};

use crate::atomic::{sync_dir, write_atomic};
use crate::manifest::{MANIFEST_NAME, SCHEMA_VERSION, ShardEntry, hash_file, read_json};
use crate::{
    ClipRecord, DatasetError, FailedItem, Manifest, Overwrite, SourceLicence, Split, card,
    check_record, guard, shard,
};

/// Directory of the state that a build needs to resume.
const STATE_DIR: &str = ".shards";
/// Directory of shards.
const DATA_DIR: &str = "data";
const MAX_SIDECAR_BYTES: u64 = 64 << 20;

/// One clip to generate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ItemId {
    /// Clip id; unique in the plan.
    pub id: String,
    /// Group whose items must be in the same split.
    pub group: String,
    /// Split of the group.
    pub split: Split,
}

/// What to build. Together with the function that makes clips, it determines every byte.
#[derive(Clone, Debug)]
pub struct BuildPlan {
    /// Name of the data set.
    pub name: String,
    /// Version of the program that builds the data set.
    pub tool_version: String,
    /// Radar name.
    pub radar: String,
    /// Radar frames per second.
    pub frame_rate_hz: f64,
    /// Data set seed.
    pub seed: u64,
    /// Configuration, verbatim.
    pub config_toml: String,
    /// Licences by source.
    pub licences: Vec<SourceLicence>,
    /// Motions of the sources that are left out.
    pub skipped: Vec<FailedItem>,
    /// Maximum number of clips per shard, 1..=100,000. Memory contains about one shard per thread.
    pub shard_size: usize,
    /// Clips, in order.
    pub items: Vec<ItemId>,
}

/// How to build. These options do not change the result.
#[derive(Clone, Copy, Debug)]
pub struct BuildOptions {
    /// Worker threads, at least 1.
    pub threads: usize,
    /// [`Overwrite::Replace`] discards another data set in the directory.
    pub overwrite: Overwrite,
    /// Also rebuilds finished shards that have failed items (for failures with an external cause).
    pub retry_failed: bool,
}

/// State of a running build.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Number of items of the plan.
    pub n_items: usize,
    /// Number of finished items, including those of kept shards and failures.
    pub n_done: usize,
    /// Number of failed items, including those of kept shards.
    pub n_failed: usize,
    /// Number of shards of the plan.
    pub n_shards: usize,
    /// Number of shards on disk.
    pub n_shards_done: usize,
}

/// Summary of a finished build.
#[derive(Clone, Debug)]
pub struct BuildReport {
    /// The manifest that was written to the directory.
    pub manifest: Manifest,
    /// Number of intact shards that were kept.
    pub n_kept_shards: usize,
    /// Number of shards that were built in this run.
    pub n_made_shards: usize,
}

/// Builds the data set `plan` in `dir`, calling `make` for every item that does not exist yet.
///
/// The result of `make` must depend only on the item and the plan; it runs on several threads. Its errors, its
/// panics and records that [`check_record`] rejects become [`FailedItem`]s in the manifest.
/// `progress` is called from worker threads after every item and shard.
///
/// # Errors
/// A plan with duplicate ids or a group in two splits; a directory that contains another data set (unless
/// [`Overwrite::Replace`]) or anything else; another build running in the directory; a file system error.
pub fn build<E: std::fmt::Display>(
    dir: &Path,
    plan: &BuildPlan,
    options: BuildOptions,
    make: impl Fn(&ItemId) -> Result<ClipRecord, E> + Sync,
    progress: impl Fn(Progress) + Sync,
) -> Result<BuildReport, DatasetError> {
    check_plan(plan)?;
    let config_blake3 = plan_hash(plan)?;
    let _lock = prepare_dir(dir, &plan.name, &config_blake3, options.overwrite)?;
    let mut shards = assign(plan);
    for shard in &mut shards {
        shard.entry = kept_entry(dir, shard, &config_blake3, options.retry_failed)?;
    }
    let n_kept_shards = shards.iter().filter(|s| s.entry.is_some()).count();

    let work = Work::new(dir, plan, &config_blake3, &shards);
    progress(work.progress());
    // Scoped threads instead of a shared pool: `make` may use rayon inside without deadlocks.
    std::thread::scope(|scope| {
        for _ in 0..options.threads.clamp(1, 1024) {
            scope.spawn(|| work.run(&make, &progress));
        }
    });
    let made = work.into_result()?;
    let n_made_shards = made.len();
    for (shard_idx, entry) in made {
        shards[shard_idx].entry = Some(entry);
    }

    let entries: Vec<ShardEntry> = shards.into_iter().filter_map(|s| s.entry).collect();
    let manifest = Manifest {
        schema_version: SCHEMA_VERSION,
        name: plan.name.clone(),
        tool_version: plan.tool_version.clone(),
        radar: plan.radar.clone(),
        frame_rate_hz: plan.frame_rate_hz,
        seed: plan.seed,
        config_blake3,
        config_toml: plan.config_toml.clone(),
        licences: plan.licences.clone(),
        skipped: plan.skipped.clone(),
        n_clips: entries.iter().map(|e| e.rows).sum(),
        n_failed: entries.iter().map(|e| e.failed.len() as u64).sum(),
        shards: entries,
    };
    write_text(&dir.join("README.md"), &card::dataset_card(&manifest))?;
    write_json(&dir.join(MANIFEST_NAME), &manifest)?;
    Ok(BuildReport {
        manifest,
        n_kept_shards,
        n_made_shards,
    })
}

/// A shard of the plan.
struct Shard<'a> {
    split: Split,
    /// `train-00000-of-00002`.
    stem: String,
    items: Vec<&'a ItemId>,
    /// Present when the shard is on disk.
    entry: Option<ShardEntry>,
}

/// Sidecar of a finished shard.
#[derive(Serialize, Deserialize)]
struct Sidecar {
    config_blake3: String,
    shard: ShardEntry,
}

/// Identity of the data set under construction.
#[derive(Serialize, Deserialize)]
struct PlanFile {
    schema_version: u32,
    name: String,
    config_blake3: String,
}

fn check_plan(plan: &BuildPlan) -> Result<(), DatasetError> {
    let fail = |problem: String| Err(DatasetError::Plan { problem });
    if !(1..=100_000).contains(&plan.shard_size) {
        return fail(format!(
            "shard_size must be in 1..=100000, found {}",
            plan.shard_size
        ));
    }
    if !(plan.frame_rate_hz.is_finite() && plan.frame_rate_hz > 0.0) {
        return fail(format!(
            "frame_rate_hz must be finite and positive, found {}",
            plan.frame_rate_hz
        ));
    }
    let mut ids = HashSet::new();
    let mut split_of_group: HashMap<&str, Split> = HashMap::new();
    for item in &plan.items {
        if !ids.insert(item.id.as_str()) {
            return fail(format!("id `{}` occurs twice", item.id));
        }
        let split = *split_of_group.entry(&item.group).or_insert(item.split);
        if split != item.split {
            return fail(format!(
                "group `{}` is in both {split} and {}",
                item.group, item.split
            ));
        }
    }
    Ok(())
}

/// Hash of everything that determines the content, so that a directory never mixes two builds.
fn plan_hash(plan: &BuildPlan) -> Result<String, DatasetError> {
    #[derive(Serialize)]
    struct Identity<'a> {
        schema_version: u32,
        name: &'a str,
        tool_version: &'a str,
        radar: &'a str,
        frame_rate_hz: f64,
        seed: u64,
        config_toml: &'a str,
        licences: &'a [SourceLicence],
        shard_size: usize,
        items: Vec<(&'a str, &'a str, &'a str)>,
    }
    let identity = Identity {
        schema_version: SCHEMA_VERSION,
        name: &plan.name,
        tool_version: &plan.tool_version,
        radar: &plan.radar,
        frame_rate_hz: plan.frame_rate_hz,
        seed: plan.seed,
        config_toml: &plan.config_toml,
        licences: &plan.licences,
        shard_size: plan.shard_size,
        items: plan
            .items
            .iter()
            .map(|i| (i.id.as_str(), i.group.as_str(), i.split.name()))
            .collect(),
    };
    let json = serde_json::to_vec(&identity).map_err(|e| DatasetError::Plan {
        problem: e.to_string(),
    })?;
    Ok(blake3::hash(&json).to_hex().to_string())
}

fn assign(plan: &BuildPlan) -> Vec<Shard<'_>> {
    let mut shards = Vec::new();
    for split in Split::ALL {
        let items: Vec<&ItemId> = plan.items.iter().filter(|i| i.split == split).collect();
        let n = items.len().div_ceil(plan.shard_size);
        for (i, chunk) in items.chunks(plan.shard_size).enumerate() {
            let stem = format!("{split}-{i:05}-of-{n:05}");
            shards.push(Shard {
                split,
                stem,
                items: chunk.to_vec(),
                entry: None,
            });
        }
    }
    shards
}

/// Creates the directories, acquires the lock, rejects foreign content and removes leftovers.
fn prepare_dir(
    dir: &Path,
    name: &str,
    config_blake3: &str,
    overwrite: Overwrite,
) -> Result<File, DatasetError> {
    let state_dir = dir.join(STATE_DIR);
    let plan_path = state_dir.join("plan.json");
    let ours = state_dir.is_dir() || dir.join(MANIFEST_NAME).is_file();
    if !ours && dir.exists() {
        let mut entries = fs::read_dir(dir).map_err(DatasetError::io(dir, "list"))?;
        if entries.next().is_some() {
            return Err(DatasetError::NotADataset { dir: dir.into() });
        }
    }
    for d in [&state_dir, &dir.join(DATA_DIR)] {
        fs::create_dir_all(d).map_err(DatasetError::io(d, "create"))?;
    }
    let lock_path = state_dir.join("lock");
    // The operating system releases the lock when the process ends, so a killed build does not block the next one.
    let lock = File::create(&lock_path).map_err(DatasetError::io(&lock_path, "create"))?;
    match lock.try_lock() {
        Ok(()) => {}
        Err(fs::TryLockError::WouldBlock) => return Err(DatasetError::Locked { dir: dir.into() }),
        Err(fs::TryLockError::Error(e)) => return Err(DatasetError::io(&lock_path, "lock")(e)),
    }

    if overwrite == Overwrite::Replace {
        remove_content(dir)?;
    } else if plan_path.is_file() {
        let found: PlanFile = read_json(&plan_path, MAX_SIDECAR_BYTES)?;
        if found.config_blake3 != config_blake3 {
            return Err(DatasetError::Foreign {
                dir: dir.into(),
                problem: format!(
                    "holds data set `{}` built from another configuration ({}..., this one is {}...)",
                    found.name,
                    found.config_blake3.get(..12).unwrap_or_default(),
                    &config_blake3[..12]
                ),
            });
        }
    } else if dir.join(MANIFEST_NAME).is_file() {
        let problem = "holds a finished data set without the state that resuming needs".into();
        return Err(DatasetError::Foreign {
            dir: dir.into(),
            problem,
        });
    }
    remove_leftovers(dir)?;
    let plan_file = PlanFile {
        schema_version: SCHEMA_VERSION,
        name: name.into(),
        config_blake3: config_blake3.into(),
    };
    write_json(&plan_path, &plan_file)?;
    Ok(lock)
}

/// Removes the files that earlier builds wrote, and nothing else.
fn remove_content(dir: &Path) -> Result<(), DatasetError> {
    // The manifest first: without it the directory no longer claims to be complete.
    for file in [dir.join(MANIFEST_NAME), dir.join("README.md")] {
        remove_if_there(&file)?;
    }
    remove_matching(&dir.join(STATE_DIR), |name| name.ends_with(".json"))?;
    remove_matching(&dir.join(DATA_DIR), |name| {
        name.ends_with(".parquet")
            && Split::ALL
                .iter()
                .any(|s| name.starts_with(&format!("{s}-")))
    })
}

/// Removes temporary files of killed builds. This is safe while the lock is held.
fn remove_leftovers(dir: &Path) -> Result<(), DatasetError> {
    for d in [dir.to_path_buf(), dir.join(STATE_DIR), dir.join(DATA_DIR)] {
        remove_matching(&d, radarllm_files::atomic::is_leftover)?;
    }
    Ok(())
}

fn remove_matching(dir: &Path, matches: impl Fn(&str) -> bool) -> Result<(), DatasetError> {
    for entry in fs::read_dir(dir).map_err(DatasetError::io(dir, "list"))? {
        let entry = entry.map_err(DatasetError::io(dir, "list"))?;
        if entry.file_name().to_str().is_some_and(&matches) {
            remove_if_there(&entry.path())?;
        }
    }
    sync_dir(dir)
}

fn remove_if_there(path: &Path) -> Result<(), DatasetError> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(DatasetError::io(path, "remove")(e))
        }
        _ => Ok(()),
    }
}

fn write_text(path: &Path, text: &str) -> Result<(), DatasetError> {
    use std::io::Write;
    write_atomic(path, Overwrite::Replace, |file| {
        file.write_all(text.as_bytes())
            .map_err(DatasetError::io(path, "write"))
    })
}

fn write_json(path: &Path, value: &impl Serialize) -> Result<(), DatasetError> {
    let mut text =
        serde_json::to_string_pretty(value).map_err(|e| DatasetError::corrupt(path, e))?;
    text.push('\n');
    write_text(path, &text)
}

fn sidecar_path(dir: &Path, stem: &str) -> PathBuf {
    dir.join(STATE_DIR).join(format!("{stem}.json"))
}

/// The entry of a shard that is on disk, complete and part of this plan.
fn kept_entry(
    dir: &Path,
    shard: &Shard<'_>,
    config_blake3: &str,
    retry_failed: bool,
) -> Result<Option<ShardEntry>, DatasetError> {
    let sidecar_path = sidecar_path(dir, &shard.stem);
    if !sidecar_path.is_file() {
        return Ok(None);
    }
    // A damaged sidecar or shard is rebuilt: it is either part of this plan or worthless.
    let Ok(sidecar) = read_json::<Sidecar>(&sidecar_path, MAX_SIDECAR_BYTES) else {
        return Ok(None);
    };
    let entry = sidecar.shard;
    let n_items = entry.rows.saturating_add(entry.failed.len() as u64);
    let fits = sidecar.config_blake3 == config_blake3
        && entry.file == format!("{DATA_DIR}/{}.parquet", shard.stem)
        && n_items == shard.items.len() as u64
        && (!retry_failed || entry.failed.is_empty());
    if !fits || !entry.path(dir).is_file() {
        return Ok(None);
    }
    let (blake3, bytes) = hash_file(&entry.path(dir))?;
    Ok((blake3 == entry.blake3 && bytes == entry.bytes).then_some(entry))
}

/// Results of the items of one shard in progress, in item order.
type Slots = Vec<Option<Result<ClipRecord, FailedItem>>>;

/// Shared state of the worker threads.
struct Work<'a> {
    dir: &'a Path,
    plan: &'a BuildPlan,
    config_blake3: &'a str,
    shards: &'a [Shard<'a>],
    /// (shard, item) of all items to generate, in shard order.
    queue: Vec<(usize, usize)>,
    next: AtomicUsize,
    slots: Vec<Mutex<Slots>>,
    remaining: Vec<AtomicUsize>,
    n_done: AtomicUsize,
    n_failed: AtomicUsize,
    n_shards_done: AtomicUsize,
    stop: AtomicBool,
    made: Mutex<Vec<(usize, ShardEntry)>>,
    error: Mutex<Option<DatasetError>>,
}

impl<'a> Work<'a> {
    fn new(
        dir: &'a Path,
        plan: &'a BuildPlan,
        config_blake3: &'a str,
        shards: &'a [Shard<'a>],
    ) -> Self {
        let kept = || {
            shards
                .iter()
                .filter_map(|s| s.entry.as_ref().map(|e| (s, e)))
        };
        let missing = shards.iter().enumerate().filter(|(_, s)| s.entry.is_none());
        Self {
            dir,
            plan,
            config_blake3,
            shards,
            queue: missing
                .flat_map(|(s, shard)| (0..shard.items.len()).map(move |i| (s, i)))
                .collect(),
            next: AtomicUsize::new(0),
            slots: shards.iter().map(|_| Mutex::new(Vec::new())).collect(),
            remaining: shards
                .iter()
                .map(|s| AtomicUsize::new(s.items.len()))
                .collect(),
            n_done: AtomicUsize::new(kept().map(|(s, _)| s.items.len()).sum()),
            n_failed: AtomicUsize::new(kept().map(|(_, e)| e.failed.len()).sum()),
            n_shards_done: AtomicUsize::new(kept().count()),
            stop: AtomicBool::new(false),
            made: Mutex::new(Vec::new()),
            error: Mutex::new(None),
        }
    }

    fn progress(&self) -> Progress {
        Progress {
            n_items: self.plan.items.len(),
            n_done: self.n_done.load(Ordering::Relaxed),
            n_failed: self.n_failed.load(Ordering::Relaxed),
            n_shards: self.shards.len(),
            n_shards_done: self.n_shards_done.load(Ordering::Relaxed),
        }
    }

    /// One worker thread. It takes items until none remains. The worker that finishes a shard's last item writes the
    /// shard.
    fn run<E: std::fmt::Display>(
        &self,
        make: &(impl Fn(&ItemId) -> Result<ClipRecord, E> + Sync),
        progress: &(impl Fn(Progress) + Sync),
    ) {
        while !self.stop.load(Ordering::Relaxed) {
            let Some(&(shard_idx, item_idx)) =
                self.queue.get(self.next.fetch_add(1, Ordering::Relaxed))
            else {
                return;
            };
            let result = make_item(self.shards[shard_idx].items[item_idx], make);
            self.n_failed
                .fetch_add(usize::from(result.is_err()), Ordering::Relaxed);
            {
                let mut slots = lock(&self.slots[shard_idx]);
                slots.resize_with(self.shards[shard_idx].items.len(), || None);
                slots[item_idx] = Some(result);
            }
            self.n_done.fetch_add(1, Ordering::Relaxed);
            // Release/acquire ordering: the last worker sees the slots of all others.
            if self.remaining[shard_idx].fetch_sub(1, Ordering::AcqRel) == 1 {
                let slots = std::mem::take(&mut *lock(&self.slots[shard_idx]));
                match self.write(&self.shards[shard_idx], slots) {
                    Ok(entry) => {
                        lock(&self.made).push((shard_idx, entry));
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

    fn write(&self, shard: &Shard<'_>, slots: Slots) -> Result<ShardEntry, DatasetError> {
        let mut records = Vec::with_capacity(slots.len());
        let mut failed = Vec::new();
        for result in slots.into_iter().flatten() {
            match result {
                Ok(record) => records.push(record),
                Err(failure) => failed.push(failure),
            }
        }
        let file = format!("{DATA_DIR}/{}.parquet", shard.stem);
        let path = self.dir.join(&file);
        let metadata = [
            ("radarllm.schema_version", SCHEMA_VERSION.to_string()),
            ("radarllm.dataset", self.plan.name.clone()),
            ("radarllm.shard", shard.stem.clone()),
            ("radarllm.split", shard.split.name().into()),
            ("radarllm.radar", self.plan.radar.clone()),
            ("radarllm.frame_rate_hz", self.plan.frame_rate_hz.to_string()),
            ("radarllm.seed", self.plan.seed.to_string()),
            ("radarllm.config_blake3", self.config_blake3.into()),
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
        let sidecar = Sidecar {
            config_blake3: self.config_blake3.into(),
            shard: entry.clone(),
        };
        write_json(&sidecar_path(self.dir, &shard.stem), &sidecar)?;
        Ok(entry)
    }

    fn into_result(self) -> Result<Vec<(usize, ShardEntry)>, DatasetError> {
        match self
            .error
            .into_inner()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
        {
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
