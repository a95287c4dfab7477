//! What a build makes: clips, in order, and their assignment to shards.

use std::collections::{HashMap, HashSet};

use serde::Serialize;

use super::manifest::SCHEMA_VERSION;
use crate::{DatasetError, FailedItem, SourceLicence, Split};

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
    /// How this machine computes: machines whose results may differ in the last bit have different names. It is not
    /// part of the data set; shards of machines that differ are not mixed.
    pub arithmetic: String,
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

/// A shard of a plan.
#[derive(Clone, Debug)]
pub(crate) struct Shard {
    pub split: Split,
    /// `train-00000-of-00002`.
    pub stem: String,
    /// Indices into [`BuildPlan::items`].
    pub items: Vec<usize>,
}

impl BuildPlan {
    /// Rejects duplicate ids, a group in two splits and numbers out of range.
    pub(crate) fn check(&self) -> Result<(), DatasetError> {
        let fail = |problem: String| Err(DatasetError::Plan { problem });
        if !(1..=100_000).contains(&self.shard_size) {
            return fail(format!(
                "shard_size must be in 1..=100000, found {}",
                self.shard_size
            ));
        }
        if !(self.frame_rate_hz.is_finite() && self.frame_rate_hz > 0.0) {
            return fail(format!(
                "frame_rate_hz must be finite and positive, found {}",
                self.frame_rate_hz
            ));
        }
        let mut ids = HashSet::new();
        let mut split_of_group: HashMap<&str, Split> = HashMap::new();
        for item in &self.items {
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
    pub(crate) fn hash(&self) -> Result<String, DatasetError> {
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
            name: &self.name,
            tool_version: &self.tool_version,
            radar: &self.radar,
            frame_rate_hz: self.frame_rate_hz,
            seed: self.seed,
            config_toml: &self.config_toml,
            licences: &self.licences,
            shard_size: self.shard_size,
            items: self
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

    /// The shards, split by split, each with its items in the order of the plan.
    pub(crate) fn shards(&self) -> Vec<Shard> {
        let mut shards = Vec::new();
        for split in Split::ALL {
            let items: Vec<usize> = (0..self.items.len())
                .filter(|&i| self.items[i].split == split)
                .collect();
            let n = items.len().div_ceil(self.shard_size);
            for (i, chunk) in items.chunks(self.shard_size).enumerate() {
                shards.push(Shard {
                    split,
                    stem: format!("{split}-{i:05}-of-{n:05}"),
                    items: chunk.to_vec(),
                });
            }
        }
        shards
    }
}
