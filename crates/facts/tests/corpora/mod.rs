//! The human sentences of HumanML3D and KIT-ML where they are on this machine. They are never part of the repository.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{BufReader, Read},
    path::{Path, PathBuf},
};

use radarllm_base::seed::derive_seed;
use serde_json::Value;

/// Seed of every random choice of sentences.
pub const SEED: u64 = 22;

/// Most bytes of one unpacked corpus file.
const MAX_BYTES: u64 = 256 << 20;

/// A sentence that somebody wrote.
#[derive(Clone, Debug)]
pub struct Sentence {
    /// `h:CLIP:NUMBER` (HumanML3D) or `k:ENTRY:NUMBER` (KIT-ML), numbers from 0.
    pub id: String,
    /// The sentence as it was written.
    pub text: String,
}

/// The folder `data` of the folder `RADARLLM_SHARED`, or of `shared` beside the repository.
pub fn folder() -> PathBuf {
    let shared = std::env::var_os("RADARLLM_SHARED").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared"),
        PathBuf::from,
    );
    shared.join("data")
}

/// All human sentences in the order of the files, without KIT-ML's mirrored copies; `None` without the data.
pub fn sentences() -> Option<Vec<Sentence>> {
    let folder = folder();
    let mut all = Vec::new();
    for name in ["texts.jsonl", "texts-no-motion.jsonl.zst"] {
        humanml3d(&folder.join("humanml3d-cmu").join(name), &mut all)?;
    }
    kit_ml(&folder.join("kit-ml/annotations.json"), &mut all)?;
    Some(all)
}

/// The sentences in an order that depends on nothing but a seed and their ids.
pub fn shuffled(mut all: Vec<Sentence>, seed: u64) -> Vec<Sentence> {
    all.sort_by_cached_key(|s| (derive_seed(seed, &s.id), s.id.clone()));
    all
}

fn read(path: &Path) -> Option<String> {
    let file = BufReader::new(File::open(path).ok()?);
    let mut text = String::new();
    if path.extension().is_some_and(|e| e == "zst") {
        let decoder = ruzstd::decoding::StreamingDecoder::new(file).ok()?;
        decoder.take(MAX_BYTES).read_to_string(&mut text).ok()?;
    } else {
        file.take(MAX_BYTES).read_to_string(&mut text).ok()?;
    }
    Some(text)
}

fn humanml3d(path: &Path, all: &mut Vec<Sentence>) -> Option<()> {
    for line in read(path)?.lines() {
        let clip: Value = serde_json::from_str(line).ok()?;
        let id = clip["id"].as_str()?;
        for (n, sentence) in clip["sentences"].as_array()?.iter().enumerate() {
            all.push(Sentence {
                id: format!("h:{id}:{n}"),
                text: sentence["text"].as_str()?.to_string(),
            });
        }
    }
    Some(())
}

fn kit_ml(path: &Path, all: &mut Vec<Sentence>) -> Option<()> {
    let entries: BTreeMap<String, Value> = serde_json::from_str(&read(path)?).ok()?;
    for (id, entry) in &entries {
        if entry["path"].as_str()?.starts_with("M/") {
            continue;
        }
        for (n, sentence) in entry["annotations"].as_array()?.iter().enumerate() {
            all.push(Sentence {
                id: format!("k:{id}:{n}"),
                text: sentence["text"].as_str()?.to_string(),
            });
        }
    }
    Some(())
}
