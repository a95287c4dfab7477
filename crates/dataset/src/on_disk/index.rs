//! The index of a plan: what every shard is made of, so that a process that builds a part of a data set reads that part
//! and nothing else.
//!
//! Whoever prepares the folder of a data set writes two files. `.shards/items.jsonl` has a line for each clip, shard by
//! shard: its id, its group, and a recipe for whoever makes clips. `.shards/index.json` has what is common to all, and for
//! each shard its bytes in the first file with their hash.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::atomic::write_atomic;
use super::folder::{STATE_DIR, write_json};
use super::manifest::read_json;
use super::plan::Shard;
use crate::{BuildPlan, DatasetError, FailedItem, ItemId, Overwrite, SourceLicence, Split};

const INDEX_NAME: &str = "index.json";
pub(crate) const ITEMS_NAME: &str = "items.jsonl";
/// Maximum size of the index, bytes. Ten thousand shards need about 2 MB.
const MAX_INDEX_BYTES: u64 = 512 << 20;
/// Maximum size of the lines of one shard, bytes. A hundred thousand clips need about 100 MB.
const MAX_SHARD_BYTES: u64 = 1 << 30;

/// `.shards/index.json`.
#[derive(Serialize, Deserialize)]
struct IndexFile {
    config_blake3: String,
    name: String,
    radar: String,
    frame_rate_hz: f64,
    seed: u64,
    config_toml: String,
    licences: Vec<SourceLicence>,
    skipped: Vec<FailedItem>,
    shard_size: usize,
    shards: Vec<IndexedShard>,
}

/// A shard and its lines in `.shards/items.jsonl`.
#[derive(Clone, Serialize, Deserialize)]
struct IndexedShard {
    stem: String,
    split: String,
    n_items: usize,
    offset: u64,
    bytes: u64,
    blake3: String,
}

/// A line of `.shards/items.jsonl`.
#[derive(Serialize, Deserialize)]
struct IndexedItem {
    id: String,
    group: String,
    recipe: Value,
}

/// Shards of a plan by their numbers, with all clips of the plan that are in them.
pub(crate) struct Part {
    pub plan: BuildPlan,
    pub config_blake3: String,
    pub n_shards: usize,
    pub shards: BTreeMap<usize, Shard>,
    /// Recipe of every clip of the plan, in its order.
    pub recipes: Vec<Value>,
}

/// The index of a folder that was prepared.
pub struct PreparedPlan {
    dir: PathBuf,
    index: IndexFile,
}

impl PreparedPlan {
    /// Reads the index of a folder. Returns nothing if the folder was not prepared, or by an earlier version of this
    /// program, which wrote no index.
    ///
    /// # Errors
    /// An index that is damaged.
    pub fn read(dir: &Path) -> Result<Option<Self>, DatasetError> {
        let path = dir.join(STATE_DIR).join(INDEX_NAME);
        if !super::folder::is_prepared(dir) || !path.is_file() {
            return Ok(None);
        }
        let index = read_json(&path, MAX_INDEX_BYTES)?;
        let dir = dir.into();
        Ok(Some(Self { dir, index }))
    }

    /// Number of shards of the whole data set.
    pub fn n_shards(&self) -> usize {
        self.index.shards.len()
    }

    /// Configuration, verbatim.
    pub fn config_toml(&self) -> &str {
        &self.index.config_toml
    }

    pub(crate) fn config_blake3(&self) -> &str {
        &self.index.config_blake3
    }

    /// The clips of some shards. `tool_version` and `arithmetic` are those of this process.
    pub(crate) fn part(
        self,
        numbers: &[usize],
        tool_version: String,
        arithmetic: String,
    ) -> Result<Part, DatasetError> {
        let index = self.index;
        let n_shards = index.shards.len();
        let mut part = Part {
            plan: BuildPlan {
                name: index.name,
                tool_version,
                arithmetic,
                radar: index.radar,
                frame_rate_hz: index.frame_rate_hz,
                seed: index.seed,
                config_toml: index.config_toml,
                licences: index.licences,
                skipped: index.skipped,
                shard_size: index.shard_size,
                items: Vec::new(),
            },
            config_blake3: index.config_blake3,
            n_shards,
            shards: BTreeMap::new(),
            recipes: Vec::new(),
        };
        let path = self.dir.join(STATE_DIR).join(ITEMS_NAME);
        let mut file = File::open(&path).map_err(DatasetError::io(&path, "open"))?;
        for &number in numbers {
            let shard = index.shards.get(number).ok_or(DatasetError::Plan {
                problem: no_shard(number, n_shards),
            })?;
            part.add(number, shard, &path, &mut file)?;
        }
        Ok(part)
    }
}

impl Part {
    fn add(
        &mut self,
        number: usize,
        shard: &IndexedShard,
        path: &Path,
        file: &mut File,
    ) -> Result<(), DatasetError> {
        let damaged = |problem: String| {
            let at = format!("offset {}, {} bytes", shard.offset, shard.bytes);
            DatasetError::corrupt(path, format!("{at}, shard {}: {problem}", shard.stem))
        };
        let split = Split::ALL.into_iter().find(|s| s.name() == shard.split);
        let split = split.ok_or_else(|| damaged(format!("unknown split `{}`", shard.split)))?;
        if shard.bytes > MAX_SHARD_BYTES {
            return Err(DatasetError::Limit {
                path: path.into(),
                what: format!("size of the clips of shard {} in bytes", shard.stem),
                found: shard.bytes,
                max: MAX_SHARD_BYTES,
            });
        }
        file.seek(SeekFrom::Start(shard.offset))
            .map_err(DatasetError::io(path, "read"))?;
        let mut text = Vec::new();
        let read = file.take(shard.bytes).read_to_end(&mut text);
        read.map_err(DatasetError::io(path, "read"))?;
        if blake3::hash(&text).to_hex().as_str() != shard.blake3 {
            return Err(damaged("the hash is not that of the index".into()));
        }
        let mut items = Vec::new();
        for line in text.split(|b| *b == b'\n').filter(|line| !line.is_empty()) {
            let item: IndexedItem =
                serde_json::from_slice(line).map_err(|e| damaged(e.to_string()))?;
            items.push(self.plan.items.len());
            self.plan.items.push(ItemId {
                id: item.id,
                group: item.group,
                split,
            });
            self.recipes.push(item.recipe);
        }
        if items.len() != shard.n_items {
            let found = items.len();
            return Err(damaged(format!(
                "expected {} clips, found {found}",
                shard.n_items
            )));
        }
        let stem = shard.stem.clone();
        self.shards.insert(number, Shard { split, stem, items });
        Ok(())
    }
}

/// Writes the index of a plan, unless it is there.
pub(crate) fn write(
    dir: &Path,
    plan: &BuildPlan,
    config_blake3: &str,
    shards: &BTreeMap<usize, Shard>,
    recipe: &dyn Fn(&ItemId) -> Value,
) -> Result<(), DatasetError> {
    let state_dir = dir.join(STATE_DIR);
    let (index_path, items_path) = (state_dir.join(INDEX_NAME), state_dir.join(ITEMS_NAME));
    let found = PreparedPlan::read(dir).ok().flatten();
    if items_path.is_file() && found.is_some_and(|found| found.config_blake3() == config_blake3) {
        return Ok(());
    }
    // Without the index, the other file says nothing.
    if index_path.is_file() {
        fs::remove_file(&index_path).map_err(DatasetError::io(&index_path, "remove"))?;
    }
    let mut indexed = Vec::with_capacity(shards.len());
    write_atomic(&items_path, Overwrite::Replace, |file| {
        let fail = || DatasetError::io(&items_path, "write");
        let mut out = BufWriter::new(file);
        let mut offset = 0_u64;
        for shard in shards.values() {
            let mut text = Vec::new();
            for &item in &shard.items {
                let id = &plan.items[item];
                let item = IndexedItem {
                    id: id.id.clone(),
                    group: id.group.clone(),
                    recipe: recipe(id),
                };
                serde_json::to_writer(&mut text, &item).map_err(|e| DatasetError::Plan {
                    problem: e.to_string(),
                })?;
                text.push(b'\n');
            }
            out.write_all(&text).map_err(fail())?;
            indexed.push(IndexedShard {
                stem: shard.stem.clone(),
                split: shard.split.name().into(),
                n_items: shard.items.len(),
                offset,
                bytes: text.len() as u64,
                blake3: blake3::hash(&text).to_hex().to_string(),
            });
            offset += text.len() as u64;
        }
        out.flush().map_err(fail())
    })?;
    let index = IndexFile {
        config_blake3: config_blake3.into(),
        name: plan.name.clone(),
        radar: plan.radar.clone(),
        frame_rate_hz: plan.frame_rate_hz,
        seed: plan.seed,
        config_toml: plan.config_toml.clone(),
        licences: plan.licences.clone(),
        skipped: plan.skipped.clone(),
        shard_size: plan.shard_size,
        shards: indexed,
    };
    write_json(&index_path, &index)
}

/// What is said of a shard that there is not.
pub(crate) fn no_shard(number: usize, n_shards: usize) -> String {
    format!("there is no shard {number}: the data set has {n_shards}, numbered from 0")
}
