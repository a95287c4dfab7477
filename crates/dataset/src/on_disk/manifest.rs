//! `manifest.json`: the contents of a data set directory.

use std::io::Read;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::{DatasetError, FailedItem, Split};

/// Version of the directory layout, the columns and this file, as this program writes them. Version 2 added the columns
/// `rotations6d` and `body_height_m`.
pub const SCHEMA_VERSION: u32 = 2;
/// Oldest version that this program reads.
pub const OLDEST_SCHEMA_VERSION: u32 = 1;
/// File name in the data set directory.
pub const MANIFEST_NAME: &str = "manifest.json";
/// Maximum size of a manifest, bytes. A million clips need about 50 MB.
const MAX_MANIFEST_BYTES: u64 = 512 << 20;

/// Licence of one source of motions, which accompanies everything made from it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SourceLicence {
    /// Source name, as in [`crate::ClipRecord::source`].
    pub source: String,
    /// SPDX expression or name.
    pub licence: String,
    /// Attribution, location of the source, and changes.
    pub attribution: String,
    /// Whether the radar points of this source are simulated. Not stored where it is true, as in all data sets so far.
    #[serde(default = "yes", skip_serializing_if = "is_true")]
    pub synthetic: bool,
}

fn yes() -> bool {
    true
}

fn is_true(value: &bool) -> bool {
    *value
}

/// One shard.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ShardEntry {
    /// Path below the data set directory, `data/<split>-<i>-of-<n>.parquet`.
    pub file: String,
    /// Split name.
    pub split: String,
    /// Number of rows.
    pub rows: u64,
    /// Size, bytes.
    pub bytes: u64,
    /// BLAKE3 of the file, lower-case hex.
    pub blake3: String,
    /// Clip ids, in row order.
    pub ids: Vec<String>,
    /// Items of this shard that failed.
    pub failed: Vec<FailedItem>,
}

/// The whole file. Written last: a directory with a manifest is complete.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`OLDEST_SCHEMA_VERSION`] to [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// Name of the data set.
    pub name: String,
    /// Version of the program that built the data set.
    pub tool_version: String,
    /// Radar name.
    pub radar: String,
    /// Radar frames per second.
    pub frame_rate_hz: f64,
    /// Seed from which every clip's seed is derived.
    pub seed: u64,
    /// BLAKE3 of everything that determines the content: configuration, seed, radar, items.
    pub config_blake3: String,
    /// Configuration from which the data set was built, verbatim.
    pub config_toml: String,
    /// Licences by source.
    pub licences: Vec<SourceLicence>,
    /// Motions of the sources that are left out, with the reasons.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub skipped: Vec<FailedItem>,
    /// Number of clips in all shards.
    pub n_clips: u64,
    /// Number of failed items in all shards.
    pub n_failed: u64,
    /// Shards, train first.
    pub shards: Vec<ShardEntry>,
}

impl Manifest {
    /// Reads and checks the manifest of a data set directory.
    ///
    /// # Errors
    /// Absent or unreadable file, invalid JSON, another schema version, shard paths
    /// outside the directory.
    pub fn read(dir: &Path) -> Result<Self, DatasetError> {
        let path = dir.join(MANIFEST_NAME);
        let manifest: Manifest = read_json(&path, MAX_MANIFEST_BYTES)?;
        let bad = |field: &str, problem: String| DatasetError::Metadata {
            path: path.clone(),
            field: field.into(),
            problem,
        };
        if !(OLDEST_SCHEMA_VERSION..=SCHEMA_VERSION).contains(&manifest.schema_version) {
            return Err(bad(
                "schema_version",
                format!(
                    "{} is not in {OLDEST_SCHEMA_VERSION}..={SCHEMA_VERSION}, which this program reads",
                    manifest.schema_version
                ),
            ));
        }
        if !(manifest.frame_rate_hz.is_finite() && manifest.frame_rate_hz > 0.0) {
            return Err(bad(
                "frame_rate_hz",
                format!("must be positive, found {}", manifest.frame_rate_hz),
            ));
        }
        for shard in &manifest.shards {
            if !is_shard_path(&shard.file) {
                return Err(bad(
                    "shards.file",
                    format!("{:?} is not data/<name>.parquet", shard.file),
                ));
            }
            if Split::from_name(&shard.split).is_none() {
                return Err(bad(
                    "shards.split",
                    format!("{:?} is not train, val or test", shard.split),
                ));
            }
        }
        Ok(manifest)
    }
}

impl ShardEntry {
    /// Path of the shard.
    pub fn path(&self, dir: &Path) -> PathBuf {
        dir.join(&self.file)
    }
}

/// Whether a path is a plain file name below `data/`: manifests from other sources must not refer to other files.
fn is_shard_path(file: &str) -> bool {
    file.strip_prefix("data/").is_some_and(|name| {
        name.ends_with(".parquet")
            && !name.starts_with('.')
            && name
                .bytes()
                .all(|b| b.is_ascii_alphanumeric() || b"-_.".contains(&b))
    })
}

/// Reads a JSON file of bounded size.
pub(crate) fn read_json<T: serde::de::DeserializeOwned>(
    path: &Path,
    max: u64,
) -> Result<T, DatasetError> {
    let file = std::fs::File::open(path).map_err(DatasetError::io(path, "open"))?;
    let mut text = String::new();
    file.take(max + 1)
        .read_to_string(&mut text)
        .map_err(DatasetError::io(path, "read"))?;
    if text.len() as u64 > max {
        return Err(DatasetError::Limit {
            path: path.into(),
            what: "file size in bytes".into(),
            found: text.len() as u64,
            max,
        });
    }
    serde_json::from_str(&text).map_err(|e| DatasetError::corrupt(path, e))
}

/// BLAKE3 of a file, lower-case hex, and its length.
pub(crate) fn hash_file(path: &Path) -> Result<(String, u64), DatasetError> {
    let mut file = std::fs::File::open(path).map_err(DatasetError::io(path, "open"))?;
    let mut hasher = blake3::Hasher::new();
    let mut buffer = vec![0_u8; 1 << 20];
    let mut bytes = 0;
    loop {
        let n = file
            .read(&mut buffer)
            .map_err(DatasetError::io(path, "read"))?;
        if n == 0 {
            return Ok((hasher.finalize().to_hex().to_string(), bytes));
        }
        hasher.update(&buffer[..n]);
        bytes += n as u64;
    }
}
