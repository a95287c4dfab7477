//! Validates a complete data set directory.

use std::collections::HashMap;
use std::path::Path;

use serde::Serialize;

use super::manifest::{ShardEntry, hash_file};
use super::shard::ShardReader;
use crate::{ClipRecord, Columns, Dataset, DatasetError, Split, check_record};

/// A problem found in a data set.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// File below the data set directory, or `manifest.json`.
    pub file: String,
    /// Clip id, if the problem concerns one clip.
    pub id: Option<String>,
    /// What is wrong.
    pub problem: String,
}

/// Reads everything and returns every problem found: hashes, sizes and rows against the manifest;
/// the conditions of [`check_record`] for each clip; duplicate ids; groups or motions in two splits; sources without a
/// licence line.
///
/// # Errors
/// Only if the manifest cannot be read at all.
pub fn validate(dir: &Path) -> Result<Vec<Problem>, DatasetError> {
    validate_with(dir, |_, _| ())
}

/// As [`validate`], and passes every clip with its file below the data set directory to `visit`, so that a further
/// check need not read the data set again.
///
/// # Errors
/// As [`validate`].
pub fn validate_with(
    dir: &Path,
    mut visit: impl FnMut(&ClipRecord, &str),
) -> Result<Vec<Problem>, DatasetError> {
    let dataset = Dataset::open(dir)?;
    let mut seen = Seen::default();
    let mut problems = Vec::new();
    let mut n_clips = 0;
    for shard in &dataset.manifest().shards {
        let mut report = |id: Option<&str>, problem: String| {
            problems.push(Problem {
                file: shard.file.clone(),
                id: id.map(str::to_string),
                problem,
            });
        };
        n_clips += shard.rows;
        if let Err(e) = check_shard(dir, shard, &mut seen, &mut visit, &mut report) {
            report(None, e.to_string());
        }
    }
    let manifest = dataset.manifest();
    let mut report = |problem: String| {
        problems.push(Problem {
            file: super::manifest::MANIFEST_NAME.into(),
            id: None,
            problem,
        });
    };
    if n_clips != manifest.n_clips {
        report(format!(
            "n_clips is {}, the shards have {n_clips} rows",
            manifest.n_clips
        ));
    }
    let n_failed: u64 = manifest.shards.iter().map(|s| s.failed.len() as u64).sum();
    if n_failed != manifest.n_failed {
        report(format!(
            "n_failed is {}, the shards list {n_failed}",
            manifest.n_failed
        ));
    }
    for source in seen.sources.keys() {
        if !manifest.licences.iter().any(|l| l.source == *source) {
            report(format!("source `{source}` has no licence line"));
        }
    }
    Ok(problems)
}

#[derive(Default)]
struct Seen {
    ids: HashMap<String, String>,
    /// Split and first clip.
    split_of_group: HashMap<String, (Split, String)>,
    split_of_motion: HashMap<String, (Split, String)>,
    sources: std::collections::BTreeMap<String, ()>,
}

fn check_shard(
    dir: &Path,
    shard: &ShardEntry,
    seen: &mut Seen,
    visit: &mut impl FnMut(&ClipRecord, &str),
    report: &mut impl FnMut(Option<&str>, String),
) -> Result<(), DatasetError> {
    let path = shard.path(dir);
    let (blake3, bytes) = hash_file(&path)?;
    if bytes != shard.bytes {
        report(
            None,
            format!("{bytes} bytes, the manifest says {}", shard.bytes),
        );
    }
    if blake3 != shard.blake3 {
        report(
            None,
            format!("BLAKE3 is {blake3}, the manifest says {}", shard.blake3),
        );
    }
    let reader = ShardReader::open(&path, Columns::All)?;
    let n_rows = reader.n_rows();
    if n_rows != shard.rows || n_rows != shard.ids.len() as u64 {
        report(
            None,
            format!(
                "{n_rows} rows, the manifest says {} and lists {} ids",
                shard.rows,
                shard.ids.len()
            ),
        );
    }
    for (row, record) in reader.enumerate() {
        let record = record?;
        let id = Some(record.id.as_str());
        if let Err(DatasetError::Record { problem, .. }) = check_record(&record) {
            report(id, problem);
        }
        if shard
            .ids
            .get(row)
            .is_some_and(|listed| *listed != record.id)
        {
            report(
                id,
                format!("row {row} is `{}` in the manifest", shard.ids[row]),
            );
        }
        if record.split.name() != shard.split {
            report(
                id,
                format!("is in {}, its shard in {}", record.split, shard.split),
            );
        }
        if let Some(other) = seen.ids.insert(record.id.clone(), shard.file.clone()) {
            report(id, format!("the id also occurs in {other}"));
        }
        for (what, name, map) in [
            ("group", &record.group, &mut seen.split_of_group),
            ("motion", &record.motion_id, &mut seen.split_of_motion),
        ] {
            let (split, first) = map
                .entry(name.clone())
                .or_insert_with(|| (record.split, record.id.clone()));
            if *split != record.split {
                report(
                    id,
                    format!(
                        "{what} `{name}` is in both {split} and {}: clip `{first}` has it too",
                        record.split
                    ),
                );
            }
        }
        visit(&record, &shard.file);
        seen.sources.entry(record.source).or_default();
    }
    Ok(())
}
