//! Builds a data set resumably, independently of the number of threads, processes and machines.
//!
//! Items are assigned to shards by their order in the plan, split by split. A build has three steps:
//!
//! 1. [`Builder::prepare`], alone in the folder: foreign content is refused, leftovers of killed processes are removed,
//!    `.shards/plan.json` records what every process must agree on, and an index what each shard is made of.
//! 2. [`Builder::build_shards`], by any number of processes on any number of machines. A shard appears under its name
//!    only when it is complete (temporary file, fsync, rename); then its sidecar in `.shards/` records its hash.
//!    Shards whose bytes match their sidecar are kept, so that a second run only builds what is missing. Two processes
//!    that build the same shard write the same bytes under the same name.
//! 3. [`Builder::finish`], alone again: every hash is read again; the card and, last, the manifest are written.
//!
//! [`Builder::build`] does all three in one process. A process that builds a part of the shards has [`Builder::of_part`],
//! which reads no more than that part of the index.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;

use super::card;
use super::folder::{Folder, Identity, write_json, write_text};
use super::index::{self, PreparedPlan};
use super::manifest::{MANIFEST_NAME, SCHEMA_VERSION, ShardEntry};
use super::plan::Shard;
use super::work::{Job, Work};
use crate::{ClipRecord, DatasetError, Manifest, Overwrite};

pub use super::plan::{BuildPlan, ItemId};

/// How to build. These options do not change the result.
#[derive(Clone, Copy, Debug)]
pub struct BuildOptions {
    /// Worker threads, at least 1.
    pub threads: usize,
    /// [`Overwrite::Replace`] discards another data set in the directory. Only [`Builder::build`] looks at it.
    pub overwrite: Overwrite,
    /// Also rebuilds finished shards that have failed items (for failures with an external cause).
    pub retry_failed: bool,
}

/// State of a running build, or of the part of it that this process builds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Number of items.
    pub n_items: usize,
    /// Number of finished items, including those of kept shards and failures.
    pub n_done: usize,
    /// Number of failed items, including those of kept shards.
    pub n_failed: usize,
    /// Number of shards.
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

/// Shards that are on disk, of those that were asked for.
#[derive(Clone, Debug)]
pub struct BuiltShards {
    /// One entry for each shard, in the order in which they were asked for.
    pub entries: Vec<ShardEntry>,
    /// Number of intact shards that were kept; the others were built in this run.
    pub n_kept: usize,
}

/// Builds the data set of one plan, in three steps or at once.
#[derive(Clone, Debug)]
pub struct Builder {
    plan: BuildPlan,
    config_blake3: String,
    n_shards: usize,
    /// By their numbers; of a part, its shards alone, and the plan has their clips alone.
    shards: BTreeMap<usize, Shard>,
}

impl Builder {
    /// Checks a plan and assigns its items to shards.
    ///
    /// # Errors
    /// A plan with duplicate ids or a group in two splits, or numbers out of range.
    pub fn new(plan: BuildPlan) -> Result<Self, DatasetError> {
        plan.check()?;
        let shards: BTreeMap<usize, Shard> = plan.shards().into_iter().enumerate().collect();
        Ok(Self {
            config_blake3: plan.hash()?,
            n_shards: shards.len(),
            shards,
            plan,
        })
    }

    /// Some shards of a folder that was prepared, with the recipes of their clips in the order of [`BuildPlan::items`].
    /// `tool_version` and `arithmetic` are those of this process.
    ///
    /// # Errors
    /// A shard that the folder does not have; an index that is damaged.
    pub fn of_part(
        prepared: PreparedPlan,
        shards: &[usize],
        tool_version: String,
        arithmetic: String,
    ) -> Result<(Self, Vec<Value>), DatasetError> {
        let part = prepared.part(shards, tool_version, arithmetic)?;
        let builder = Self {
            plan: part.plan,
            config_blake3: part.config_blake3,
            n_shards: part.n_shards,
            shards: part.shards,
        };
        Ok((builder, part.recipes))
    }

    /// The plan.
    pub fn plan(&self) -> &BuildPlan {
        &self.plan
    }

    /// Number of shards of the whole data set. They are numbered from 0, train first.
    pub fn n_shards(&self) -> usize {
        self.n_shards
    }

    /// Hash of the plan, which the manifest records as `config_blake3`.
    pub fn fingerprint(&self) -> &str {
        &self.config_blake3
    }

    /// First step: makes `dir` the folder of this data set, or of its build that was begun before. `recipe` says what a
    /// clip is made of, for the index.
    ///
    /// # Errors
    /// A directory that contains another data set (unless [`Overwrite::Replace`]) or anything else; another process that
    /// builds in the directory; a file system without locks or renames; a file system error.
    pub fn prepare(
        &self,
        dir: &Path,
        overwrite: Overwrite,
        recipe: &dyn Fn(&ItemId) -> Value,
    ) -> Result<(), DatasetError> {
        let write_index = |dir: &Path| self.write_index(dir, recipe);
        Folder::prepare(dir, &self.identity(), overwrite, &write_index).map(drop)
    }

    /// As [`Self::prepare`], unless another process has done that or is doing it: for processes that start at the same
    /// time and that no other program coordinates.
    ///
    /// # Errors
    /// As [`Self::prepare`] without replacing.
    pub fn prepare_once(
        &self,
        dir: &Path,
        recipe: &dyn Fn(&ItemId) -> Value,
    ) -> Result<(), DatasetError> {
        let write_index = |dir: &Path| self.write_index(dir, recipe);
        Folder::prepare_once(dir, &self.identity(), &write_index)
    }

    /// Second step: builds shards in a prepared folder, calling `make` for every item of those that do not exist yet.
    ///
    /// The result of `make` must depend only on the item and the plan; it runs on several threads. Its errors, its
    /// panics and records that [`crate::check_record`] rejects become [`crate::FailedItem`]s of the shard. `progress` is
    /// called from worker threads after every item and shard. `stop` is asked before every item; when it returns `true`,
    /// complete shards stay, as after a kill.
    ///
    /// # Errors
    /// A shard that the plan does not have; a folder that was not prepared, or for another plan or by another version of
    /// the program; a shard to build on a machine with another [`BuildPlan::arithmetic`];
    /// [`DatasetError::Interrupted`] if it was stopped; a file system error.
    pub fn build_shards<E: std::fmt::Display>(
        &self,
        dir: &Path,
        shards: impl IntoIterator<Item = usize>,
        options: BuildOptions,
        make: impl Fn(&ItemId) -> Result<ClipRecord, E> + Sync,
        progress: impl Fn(Progress) + Sync,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<BuiltShards, DatasetError> {
        let shards = shards
            .into_iter()
            .map(|i| {
                self.shards.get(&i).ok_or_else(|| DatasetError::Plan {
                    problem: index::no_shard(i, self.n_shards),
                })
            })
            .collect::<Result<Vec<&Shard>, DatasetError>>()?;
        let folder = Folder::enter(dir, &self.identity())?;
        self.build_in(&folder, shards, options, make, progress, stop)
    }

    /// Third step: checks that every shard is there, reads every hash again, and writes the card and the manifest.
    ///
    /// # Errors
    /// [`DatasetError::Incomplete`] with the shards that are missing or damaged; a file that bears the name of a shard and
    /// is none; other processes that still build; a folder that was not prepared, or for another plan or by another version of the program; a file system error.
    pub fn finish(&self, dir: &Path) -> Result<Manifest, DatasetError> {
        self.finish_in(&Folder::enter_alone(dir, &self.identity())?)
    }

    /// All three steps in one process, which is alone in the folder meanwhile.
    ///
    /// # Errors
    /// As [`Self::prepare`] and [`Self::build_shards`].
    pub fn build<E: std::fmt::Display>(
        &self,
        dir: &Path,
        options: BuildOptions,
        recipe: &dyn Fn(&ItemId) -> Value,
        make: impl Fn(&ItemId) -> Result<ClipRecord, E> + Sync,
        progress: impl Fn(Progress) + Sync,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<BuildReport, DatasetError> {
        let write_index = |dir: &Path| self.write_index(dir, recipe);
        let folder = Folder::prepare(dir, &self.identity(), options.overwrite, &write_index)?;
        let shards = self.shards.values();
        let built = self.build_in(&folder, shards, options, make, progress, stop)?;
        Ok(BuildReport {
            manifest: self.finish_in(&folder)?,
            n_kept_shards: built.n_kept,
            n_made_shards: built.entries.len() - built.n_kept,
        })
    }

    fn identity(&self) -> Identity<'_> {
        Identity {
            plan: &self.plan,
            config_blake3: &self.config_blake3,
            n_shards: self.n_shards,
        }
    }

    fn write_index(
        &self,
        dir: &Path,
        recipe: &dyn Fn(&ItemId) -> Value,
    ) -> Result<(), DatasetError> {
        self.check_whole()?;
        index::write(dir, &self.plan, &self.config_blake3, &self.shards, recipe)
    }

    /// Refuses what only whoever knows all shards can do.
    fn check_whole(&self) -> Result<(), DatasetError> {
        if self.shards.len() == self.n_shards {
            return Ok(());
        }
        Err(DatasetError::Plan {
            problem: format!(
                "{} of {} shards are known, all are needed",
                self.shards.len(),
                self.n_shards
            ),
        })
    }

    fn build_in<'a, E: std::fmt::Display>(
        &self,
        folder: &Folder,
        shards: impl IntoIterator<Item = &'a Shard>,
        options: BuildOptions,
        make: impl Fn(&ItemId) -> Result<ClipRecord, E> + Sync,
        progress: impl Fn(Progress) + Sync,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<BuiltShards, DatasetError> {
        let mut jobs = Vec::new();
        for shard in shards {
            let entry = folder.kept_entry(&self.plan, shard, options.retry_failed)?;
            jobs.push(Job { shard, entry });
        }
        let n_kept = jobs.iter().filter(|j| j.entry.is_some()).count();
        if n_kept < jobs.len() {
            folder.check_arithmetic(&self.plan)?;
        }
        let work = Work::new(folder, &self.plan, &jobs);
        progress(work.progress());
        // Scoped threads instead of a shared pool: `make` may use rayon inside without deadlocks.
        std::thread::scope(|scope| {
            for _ in 0..options.threads.clamp(1, 1024) {
                scope.spawn(|| work.run(&make, &progress, stop));
            }
        });
        for (job_idx, entry) in work.into_result()? {
            jobs[job_idx].entry = Some(entry);
        }
        let n_jobs = jobs.len();
        let entries: Vec<ShardEntry> = jobs.into_iter().filter_map(|j| j.entry).collect();
        if entries.len() < n_jobs {
            let dir = folder.dir().into();
            return Err(DatasetError::Interrupted { dir });
        }
        Ok(BuiltShards { entries, n_kept })
    }

    fn finish_in(&self, folder: &Folder) -> Result<Manifest, DatasetError> {
        self.check_whole()?;
        let (mut entries, mut missing) = (Vec::new(), Vec::new());
        for shard in self.shards.values() {
            match folder.kept_entry(&self.plan, shard, false)? {
                Some(entry) => entries.push(entry),
                None => missing.push(shard.stem.clone()),
            }
        }
        if !missing.is_empty() {
            return Err(DatasetError::Incomplete {
                dir: folder.dir().into(),
                missing,
                n_shards: self.n_shards,
            });
        }
        folder.check_strays(&entries)?;
        folder.remove_leftovers()?;
        let plan = &self.plan;
        let manifest = Manifest {
            schema_version: SCHEMA_VERSION,
            name: plan.name.clone(),
            tool_version: plan.tool_version.clone(),
            radar: plan.radar.clone(),
            frame_rate_hz: plan.frame_rate_hz,
            seed: plan.seed,
            config_blake3: self.config_blake3.clone(),
            config_toml: plan.config_toml.clone(),
            licences: plan.licences.clone(),
            skipped: plan.skipped.clone(),
            n_clips: entries.iter().map(|e| e.rows).sum(),
            n_failed: entries.iter().map(|e| e.failed.len() as u64).sum(),
            shards: entries,
        };
        let dir = folder.dir();
        write_text(&dir.join("README.md"), &card::dataset_card(&manifest))?;
        write_json(&dir.join(MANIFEST_NAME), &manifest)?;
        Ok(manifest)
    }
}

/// Builds the data set `plan` in `dir` in one process: [`Builder::build`] without a way to stop it.
///
/// # Errors
/// As [`Builder::new`] and [`Builder::build`].
pub fn build<E: std::fmt::Display>(
    dir: &Path,
    plan: &BuildPlan,
    options: BuildOptions,
    make: impl Fn(&ItemId) -> Result<ClipRecord, E> + Sync,
    progress: impl Fn(Progress) + Sync,
) -> Result<BuildReport, DatasetError> {
    let builder = Builder::new(plan.clone())?;
    builder.build(dir, options, &no_recipe, make, progress, &|| false)
}

/// The recipe of clips that are not made of anything that another process could open, as those of recordings.
pub fn no_recipe(_: &ItemId) -> Value {
    Value::Null
}
