//! Shards of data sets in Parquet: clips, points alone, tables and summaries.
#![no_main]

use std::fs;
use std::path::Path;

use libfuzzer_sys::fuzz_target;
use radarllm_dataset::shard::ShardReader;
use radarllm_dataset::{Columns, Dataset, Manifest, ShardEntry, Split, check_record};
use radarllm_fuzz::only_our_panics;

const FILE: &str = "data/train-00000-of-00001.parquet";

fuzz_target!(init: only_our_panics(), |bytes: &[u8]| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join(FILE);
    fs::create_dir(folder.path().join("data")).expect("a temporary folder");
    fs::write(&path, bytes).expect("a temporary file");
    let mut rows = None;
    for columns in [Columns::All, Columns::Points] {
        if let Ok(reader) = ShardReader::open(&path, columns) {
            rows = Some(reader.n_rows());
            for record in reader.map_while(Result::ok) {
                let _ = check_record(&record);
            }
        }
    }
    // The other readers need a manifest, which is right.
    if let Some(rows) = rows {
        write_manifest(folder.path(), rows);
        let dataset = Dataset::open(folder.path()).expect("a data set");
        let _ = dataset.info();
        dataset.iter_batches(Split::Train).map_while(Result::ok).for_each(drop);
        dataset.iter_split(Split::Train, Columns::All).map_while(Result::ok).for_each(drop);
    }
});

fn write_manifest(folder: &Path, rows: u64) {
    let manifest = Manifest {
        schema_version: radarllm_dataset::manifest::SCHEMA_VERSION,
        name: "fuzz".into(),
        tool_version: "0".into(),
        radar: "awr1843boost".into(),
        frame_rate_hz: 10.0,
        seed: 7,
        config_blake3: String::new(),
        config_toml: String::new(),
        licences: Vec::new(),
        skipped: Vec::new(),
        n_clips: rows,
        n_failed: 0,
        shards: vec![ShardEntry {
            file: FILE.into(),
            split: "train".into(),
            rows,
            bytes: 0,
            blake3: String::new(),
            ids: Vec::new(),
            failed: Vec::new(),
        }],
    };
    let text = serde_json::to_vec(&manifest).expect("JSON");
    fs::write(folder.join("manifest.json"), text).expect("a temporary file");
}
