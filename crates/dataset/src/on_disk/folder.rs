//! The folder of a data set under construction: lock, plan, sidecars, leftovers.

use std::collections::HashSet;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::atomic::{sync_dir, write_atomic};
use super::file_system::{Access, check_abilities, check_place, try_lock, wait_for_lock};
use super::index;
use super::manifest::{MANIFEST_NAME, SCHEMA_VERSION, ShardEntry, hash_file, read_json};
use super::plan::Shard;
use crate::{BuildPlan, DatasetError, Overwrite, Split};

/// Directory of the state that a build needs to resume.
pub(crate) const STATE_DIR: &str = ".shards";
/// Directory of shards.
pub(crate) const DATA_DIR: &str = "data";
const MAX_SIDECAR_BYTES: u64 = 64 << 20;

/// Identity of the data set under construction: `.shards/plan.json`. Every process that works in the folder compares
/// it with its own.
#[derive(Serialize, Deserialize)]
struct PlanFile {
    schema_version: u32,
    name: String,
    config_blake3: String,
    /// This field and the next two are absent where an earlier version of this program prepared the folder.
    #[serde(default)]
    tool_version: Option<String>,
    #[serde(default)]
    n_shards: Option<usize>,
    /// See [`BuildPlan::arithmetic`]: that of the machine that prepared the folder.
    #[serde(default)]
    arithmetic: Option<String>,
}

/// Sidecar of a finished shard.
#[derive(Serialize, Deserialize)]
struct Sidecar {
    config_blake3: String,
    shard: ShardEntry,
}

/// A plan with what identifies it.
pub(crate) struct Identity<'a> {
    pub plan: &'a BuildPlan,
    pub config_blake3: &'a str,
    pub n_shards: usize,
}

/// Writes what the processes of a plan need beside its identity, in the folder that it is given.
pub(crate) type WriteIndex<'a> = &'a dyn Fn(&Path) -> Result<(), DatasetError>;

/// A folder that this process has locked and that holds the build of its plan.
pub(crate) struct Folder {
    dir: PathBuf,
    config_blake3: String,
    /// See [`PlanFile::arithmetic`].
    arithmetic: Option<String>,
    _lock: File,
}

impl Folder {
    /// Creates the directories, acquires the exclusive lock, rejects foreign content, removes leftovers and writes the
    /// index and, last, the plan.
    pub(crate) fn prepare(
        dir: &Path,
        own: &Identity<'_>,
        overwrite: Overwrite,
        write_index: WriteIndex<'_>,
    ) -> Result<Self, DatasetError> {
        check_place(dir)?;
        let state_dir = dir.join(STATE_DIR);
        let plan_path = plan_path(dir);
        let ours = state_dir.is_dir() || dir.join(MANIFEST_NAME).is_file();
        let is_new = !dir.exists();
        if !ours && !is_new {
            let mut entries = fs::read_dir(dir).map_err(DatasetError::io(dir, "list"))?;
            // Another process that prepares the folder at this moment creates its state first.
            if entries.next().is_some() && !state_dir.is_dir() {
                return Err(DatasetError::NotADataset { dir: dir.into() });
            }
        }
        for d in [&state_dir, &dir.join(DATA_DIR)] {
            fs::create_dir_all(d).map_err(DatasetError::io(d, "create"))?;
        }
        let lock_path = lock_path(dir);
        let able = try_lock(&lock_path, dir, Access::Exclusive)
            .and_then(|lock| check_abilities(dir, &state_dir, &lock_path).map(|()| lock));
        let lock = match able {
            Ok(lock) => lock,
            Err(e) => {
                if matches!(e, DatasetError::Unsuitable { .. }) && !ours {
                    remove_empty(dir, is_new);
                }
                return Err(e);
            }
        };

        let mut arithmetic = Some(own.plan.arithmetic.clone());
        if overwrite == Overwrite::Replace {
            remove_content(dir)?;
        } else if plan_path.is_file() {
            let found: PlanFile = read_json(&plan_path, MAX_SIDECAR_BYTES)?;
            if let Some(problem) = disagreement(&found, own) {
                return Err(DatasetError::Foreign {
                    dir: dir.into(),
                    problem: format!("holds data set `{}`, {problem}", found.name),
                });
            }
            // Shards that are there already stay, and those to come must fit them.
            arithmetic = found.arithmetic.or(arithmetic);
        } else if dir.join(MANIFEST_NAME).is_file() {
            let problem = "holds a finished data set without the state that resuming needs".into();
            return Err(DatasetError::Foreign {
                dir: dir.into(),
                problem,
            });
        }
        remove_leftovers(dir)?;
        write_index(dir)?;
        let plan_file = PlanFile {
            schema_version: SCHEMA_VERSION,
            name: own.plan.name.clone(),
            config_blake3: own.config_blake3.into(),
            tool_version: Some(own.plan.tool_version.clone()),
            n_shards: Some(own.n_shards),
            arithmetic: arithmetic.clone(),
        };
        write_json(&plan_path, &plan_file)?;
        Ok(Self {
            dir: dir.into(),
            config_blake3: own.config_blake3.into(),
            arithmetic,
            _lock: lock,
        })
    }

    /// Enters a prepared folder, beside other processes that build there, and checks that its plan is this one.
    pub(crate) fn enter(dir: &Path, own: &Identity<'_>) -> Result<Self, DatasetError> {
        // Another process may be preparing the folder at this moment.
        wait_for_lock(|| Self::open(dir, own, Access::Shared))
    }

    /// Enters a prepared folder alone.
    pub(crate) fn enter_alone(dir: &Path, own: &Identity<'_>) -> Result<Self, DatasetError> {
        Self::open(dir, own, Access::Exclusive)
    }

    /// Prepares the folder unless that has been done. Of several processes that start at the same time, one does it,
    /// and the others wait for it.
    pub(crate) fn prepare_once(
        dir: &Path,
        own: &Identity<'_>,
        write_index: WriteIndex<'_>,
    ) -> Result<(), DatasetError> {
        wait_for_lock(|| match is_prepared(dir) {
            true => Ok(()),
            false => Self::prepare(dir, own, Overwrite::Refuse, write_index).map(drop),
        })
    }

    fn open(dir: &Path, own: &Identity<'_>, access: Access) -> Result<Self, DatasetError> {
        check_place(dir)?;
        if !is_prepared(dir) {
            return Err(DatasetError::NotPrepared { dir: dir.into() });
        }
        let lock = try_lock(&lock_path(dir), dir, access)?;
        // Read under the lock: a process that starts over may have changed it.
        let found: PlanFile = read_json(&plan_path(dir), MAX_SIDECAR_BYTES)?;
        if let Some(problem) = disagreement(&found, own) {
            return Err(DatasetError::Disagreement {
                dir: dir.into(),
                problem: format!("this is the folder of data set `{}`, {problem}", found.name),
            });
        }
        Ok(Self {
            dir: dir.into(),
            config_blake3: own.config_blake3.into(),
            arithmetic: found.arithmetic,
            _lock: lock,
        })
    }

    pub(crate) fn dir(&self) -> &Path {
        &self.dir
    }

    pub(crate) fn config_blake3(&self) -> &str {
        &self.config_blake3
    }

    /// Refuses to compute on a machine whose shards would not be those of the others.
    pub(crate) fn check_arithmetic(&self, plan: &BuildPlan) -> Result<(), DatasetError> {
        match &self.arithmetic {
            Some(found) if *found != plan.arithmetic => Err(DatasetError::Disagreement {
                dir: self.dir.clone(),
                problem: format!(
                    "the build was begun on a machine that computes as `{found}`, this one computes as `{}`, and \
                     results may differ in the last bit",
                    plan.arithmetic
                ),
            }),
            _ => Ok(()),
        }
    }

    /// Removes temporary files of killed processes. To be called alone in the folder.
    pub(crate) fn remove_leftovers(&self) -> Result<(), DatasetError> {
        remove_leftovers(&self.dir)
    }

    /// The entry of a shard that is on disk, complete and part of this plan.
    pub(crate) fn kept_entry(
        &self,
        plan: &BuildPlan,
        shard: &Shard,
        retry_failed: bool,
    ) -> Result<Option<ShardEntry>, DatasetError> {
        let sidecar_path = self.sidecar_path(shard);
        if !sidecar_path.is_file() {
            return Ok(None);
        }
        // A damaged sidecar or shard is rebuilt: it is either part of this plan or worthless.
        let Ok(sidecar) = read_json::<Sidecar>(&sidecar_path, MAX_SIDECAR_BYTES) else {
            return Ok(None);
        };
        let entry = sidecar.shard;
        let fits = sidecar.config_blake3 == self.config_blake3
            && entry.file == shard.file()
            && has_items_of(&entry, shard, plan)
            && (!retry_failed || entry.failed.is_empty());
        if !fits || !entry.path(&self.dir).is_file() {
            return Ok(None);
        }
        let (blake3, bytes) = hash_file(&entry.path(&self.dir))?;
        Ok((blake3 == entry.blake3 && bytes == entry.bytes).then_some(entry))
    }

    /// Refuses files that bear the name of a shard and are not in `entries`: the card names shards by a pattern, so that
    /// readers would load them too.
    pub(crate) fn check_strays(&self, entries: &[ShardEntry]) -> Result<(), DatasetError> {
        let data_dir = self.dir.join(DATA_DIR);
        let known: HashSet<&str> = entries.iter().map(|e| e.file.as_str()).collect();
        let fail = || DatasetError::io(&data_dir, "list");
        for entry in fs::read_dir(&data_dir).map_err(fail())? {
            let name = entry.map_err(fail())?.file_name();
            let name = name.to_string_lossy();
            if is_shard_name(&name) && !known.contains(format!("{DATA_DIR}/{name}").as_str()) {
                let path = data_dir.join(&*name);
                return Err(DatasetError::Stray { path });
            }
        }
        Ok(())
    }

    /// Records a shard that is complete under its name.
    pub(crate) fn write_sidecar(
        &self,
        shard: &Shard,
        entry: &ShardEntry,
    ) -> Result<(), DatasetError> {
        let sidecar = Sidecar {
            config_blake3: self.config_blake3.clone(),
            shard: entry.clone(),
        };
        write_json(&self.sidecar_path(shard), &sidecar)
    }

    fn sidecar_path(&self, shard: &Shard) -> PathBuf {
        self.dir
            .join(STATE_DIR)
            .join(format!("{}.json", shard.stem))
    }
}

impl Shard {
    /// Path below the folder of the data set.
    pub(crate) fn file(&self) -> String {
        format!("{DATA_DIR}/{}.parquet", self.stem)
    }
}

/// Whether a shard has the items that the plan assigns to it, each as a clip or as a failure, in order.
fn has_items_of(entry: &ShardEntry, shard: &Shard, plan: &BuildPlan) -> bool {
    let mut ids = entry.ids.iter().peekable();
    let mut failed = entry.failed.iter().map(|f| &f.id).peekable();
    let has_all = shard.items.iter().all(|&item| {
        let id = &plan.items[item].id;
        ids.next_if_eq(&id).is_some() || failed.next_if_eq(&id).is_some()
    });
    has_all
        && ids.peek().is_none()
        && failed.peek().is_none()
        && entry.rows == entry.ids.len() as u64
}

fn plan_path(dir: &Path) -> PathBuf {
    dir.join(STATE_DIR).join("plan.json")
}

fn lock_path(dir: &Path) -> PathBuf {
    dir.join(STATE_DIR).join("lock")
}

pub(crate) fn is_prepared(dir: &Path) -> bool {
    plan_path(dir).is_file()
}

/// What a folder and a plan do not agree in.
fn disagreement(found: &PlanFile, own: &Identity<'_>) -> Option<String> {
    if found.schema_version != SCHEMA_VERSION {
        return Some(format!(
            "with the layout of version {}; this program builds version {SCHEMA_VERSION}",
            found.schema_version
        ));
    }
    let own_version = &own.plan.tool_version;
    if let Some(version) = found.tool_version.as_ref().filter(|v| *v != own_version) {
        return Some(format!(
            "begun by version {version} of this program, which is version {own_version}"
        ));
    }
    if found.config_blake3 != own.config_blake3 {
        return Some(format!(
            "built from another configuration ({}..., this one is {}...)",
            found.config_blake3.get(..12).unwrap_or_default(),
            own.config_blake3.get(..12).unwrap_or_default()
        ));
    }
    let n_shards = found.n_shards.filter(|n| *n != own.n_shards)?;
    Some(format!(
        "in {n_shards} shards; this configuration has {}",
        own.n_shards
    ))
}

/// Removes the files that earlier builds wrote, and nothing else.
fn remove_content(dir: &Path) -> Result<(), DatasetError> {
    // The manifest first: without it the directory no longer claims to be complete.
    for file in [dir.join(MANIFEST_NAME), dir.join("README.md")] {
        remove_if_there(&file)?;
    }
    let is_state = |name: &str| name.ends_with(".json") || name == index::ITEMS_NAME;
    remove_matching(&dir.join(STATE_DIR), is_state)?;
    remove_matching(&dir.join(DATA_DIR), is_shard_name)
}

/// Whether a file below `data/` has the name of a shard.
pub(crate) fn is_shard_name(name: &str) -> bool {
    name.ends_with(".parquet")
        && Split::ALL
            .iter()
            .any(|s| name.starts_with(&format!("{s}-")))
}

fn remove_leftovers(dir: &Path) -> Result<(), DatasetError> {
    for d in [dir.to_path_buf(), dir.join(STATE_DIR), dir.join(DATA_DIR)] {
        remove_matching(&d, radarllm_files::atomic::is_leftover)?;
    }
    Ok(())
}

/// Removes the directories that [`Folder::prepare`] has created. Best effort: another error is the one to report.
fn remove_empty(dir: &Path, with_dir: bool) {
    let _ = fs::remove_file(lock_path(dir));
    let _ = fs::remove_dir(dir.join(STATE_DIR));
    let _ = fs::remove_dir(dir.join(DATA_DIR));
    if with_dir {
        let _ = fs::remove_dir(dir);
    }
}

/// Removes the files of a directory whose names match.
pub(crate) fn remove_matching(
    dir: &Path,
    matches: impl Fn(&str) -> bool,
) -> Result<(), DatasetError> {
    for entry in fs::read_dir(dir).map_err(DatasetError::io(dir, "list"))? {
        let entry = entry.map_err(DatasetError::io(dir, "list"))?;
        if entry.file_name().to_str().is_some_and(&matches) {
            remove_if_there(&entry.path())?;
        }
    }
    sync_dir(dir)
}

/// Removes a file, which need not exist.
pub(crate) fn remove_if_there(path: &Path) -> Result<(), DatasetError> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(DatasetError::io(path, "remove")(e))
        }
        _ => Ok(()),
    }
}

pub(crate) fn write_text(path: &Path, text: &str) -> Result<(), DatasetError> {
    use std::io::Write;
    write_atomic(path, Overwrite::Replace, |file| {
        file.write_all(text.as_bytes())
            .map_err(DatasetError::io(path, "write"))
    })
}

pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), DatasetError> {
    let mut text =
        serde_json::to_string_pretty(value).map_err(|e| DatasetError::corrupt(path, e))?;
    text.push('\n');
    write_text(path, &text)
}
