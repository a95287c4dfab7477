//! Checks a data set directory from the first byte to the last.

use std::collections::HashMap;
use std::path::Path;

use serde::Serialize;

use crate::manifest::{ShardEntry, hash_file};
use crate::near::{self, LEAK_DISTANCE, MotionClip, Sketch};
use crate::shard::ShardReader;
use crate::{ClipRecord, Columns, Dataset, DatasetError, Split, check_record};

/// Something wrong with a data set.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// File below the data set directory, or `manifest.json`.
    pub file: String,
    /// Clip, where it concerns one.
    pub id: Option<String>,
    /// What is wrong.
    pub problem: String,
}

/// What [`validate`] found.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Validation {
    /// None in a sound data set.
    pub problems: Vec<Problem>,
    /// How near validation and test motions are to training motions.
    pub held_out: HeldOut,
}

/// Distances of held-out motions to the nearest training motion, by [`near`].
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct HeldOut {
    /// Validation and test clips that were compared.
    pub judged: usize,
    /// Those without joints, shorter than a second, nearly still, or without training motions to compare
    /// with: nothing is known of them.
    pub not_judged: usize,
    /// Distances below this are problems.
    pub leak_distance: f64,
    /// Smallest, 5 %, median distance of those judged; none without any.
    pub distances: Option<[f64; 3]>,
}

/// Reads everything and reports every problem found: hashes, sizes and rows against the manifest;
/// per clip what [`check_record`] checks; ids that occur twice; groups or motions in two splits; held-out
/// motions that are nearly the same as a training motion ([`near`]); sources without a licence line.
///
/// Training motions are held in memory meanwhile: 15 kB for ten seconds.
///
/// # Errors
/// Only if the manifest cannot be read at all.
pub fn validate(dir: &Path) -> Result<Validation, DatasetError> {
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
        if let Err(e) = check_shard(dir, shard, &mut seen, &mut report) {
            report(None, e.to_string());
        }
    }
    let held_out = compare_splits(&seen, &mut problems);
    let manifest = dataset.manifest();
    let mut report = |problem: String| {
        problems.push(Problem {
            file: crate::manifest::MANIFEST_NAME.into(),
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
    Ok(Validation { problems, held_out })
}

/// Reports held-out motions that nearly stand in training.
fn compare_splits(seen: &Seen, problems: &mut Vec<Problem>) -> HeldOut {
    let sketches: Vec<Sketch> = seen.held_out.iter().map(|(_, s)| s.clone()).collect();
    let found = near::nearest(&seen.train, &sketches);
    let mut distances = Vec::new();
    for ((file, _), nearest) in seen.held_out.iter().zip(found) {
        let Some(n) = nearest else { continue };
        distances.push(n.distance);
        if n.distance < LEAK_DISTANCE {
            let mirrored = if n.mirrored { " mirrored," } else { "" };
            problems.push(Problem {
                file: file.clone(),
                id: Some(n.id),
                problem: format!(
                    "nearly the same motion as training clip `{}`:{mirrored} distance {:.4} rad over {:.1} s from {:.1} s of it, \
                     less than {LEAK_DISTANCE}",
                    n.train_id, n.distance, n.overlap_s, n.shift_s
                ),
            });
        }
    }
    distances.sort_by(f64::total_cmp);
    let at = |q: f64| distances[((distances.len() - 1) as f64 * q).round() as usize];
    HeldOut {
        judged: distances.len(),
        not_judged: seen.n_held_out - distances.len(),
        leak_distance: LEAK_DISTANCE,
        distances: (!distances.is_empty()).then(|| [at(0.0), at(0.05), at(0.5)]),
    }
}

#[derive(Default)]
struct Seen {
    ids: HashMap<String, String>,
    /// Split and first clip.
    split_of_group: HashMap<String, (Split, String)>,
    split_of_motion: HashMap<String, (Split, String)>,
    sources: std::collections::BTreeMap<String, ()>,
    train: Vec<Sketch>,
    /// Validation and test, with their files.
    held_out: Vec<(String, Sketch)>,
    n_held_out: usize,
}

impl Seen {
    fn add_motion(&mut self, record: &ClipRecord, file: &str) {
        let sketch = Sketch::of(MotionClip {
            id: &record.id,
            fps: f64::from(record.motion_fps),
            joints: &record.joints,
        });
        self.n_held_out += usize::from(record.split != Split::Train);
        match (record.split, sketch) {
            (Split::Train, Some(sketch)) => self.train.push(sketch),
            (_, Some(sketch)) => self.held_out.push((file.into(), sketch)),
            (_, None) => {}
        }
    }
}

fn check_shard(
    dir: &Path,
    shard: &ShardEntry,
    seen: &mut Seen,
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
        seen.add_motion(&record, &shard.file);
        seen.sources.entry(record.source).or_default();
    }
    Ok(())
}
