//! The Bandai-Namco Research motion data sets 1 and 2 with captions.
//!
//! The folder holds the BVH files, in folders of any depth, `captions.jsonl` (`clip, content, style, captions`) and
//! `splits.csv` (`clip,split,group`).

use std::{
    collections::{HashMap, hash_map::Entry},
    path::{Path, PathBuf},
};

use radarllm_base::Motion;
use radarllm_body::{loaders::load_motion, sample::canonicalize};
use radarllm_dataset::record::Split;
use radarllm_files::bounded;
use serde::Deserialize;
use serde_json::Value;

use super::files::text_of;
use super::{Corpus, CorpusError, CorpusItem, files_below, recipe_of};

/// Largest BVH file that is read, bytes (the largest real one has 6 MB).
const MAX_BVH_BYTES: u64 = 64 << 20;

/// Captioned clips of the two data sets.
pub struct BandaiNamco {
    folder: PathBuf,
    items: Vec<CorpusItem>,
    /// BVH file of every item, relative to the folder.
    files: Vec<PathBuf>,
}

#[derive(Deserialize)]
struct CaptionLine {
    clip: String,
    content: String,
    captions: Vec<String>,
}

impl BandaiNamco {
    /// Reads captions, splits and all motions below `folder`.
    ///
    /// # Errors
    /// Names the file and line that is missing or malformed. A clip without captions or split is
    /// an error, not a silent gap.
    pub fn open(folder: &Path) -> Result<Self, CorpusError> {
        let captions = read_captions(&folder.join("captions.jsonl"))?;
        let splits = read_splits(&folder.join("splits.csv"))?;
        let mut found: Vec<(CorpusItem, PathBuf)> = Vec::new();
        let mut paths: HashMap<String, PathBuf> = HashMap::new();
        for path in files_below(folder)? {
            if path.extension().is_none_or(|e| e != "bvh") {
                continue;
            }
            let stem = path.file_stem().unwrap_or_default();
            let clip = stem.to_string_lossy().into_owned();
            let problem = |problem: String| CorpusError::Motion {
                id: clip.clone(),
                problem,
            };
            let (Some(caption), Some((split, group))) = (captions.get(&clip), splits.get(&clip))
            else {
                return Err(problem(
                    "has no line in captions.jsonl or splits.csv".into(),
                ));
            };
            match paths.entry(clip.clone()) {
                Entry::Vacant(free) => free.insert(path.clone()),
                Entry::Occupied(other) => {
                    let (one, other) = (path.display(), other.get().display());
                    return Err(problem(format!("has two files, {other} and {one}")));
                }
            };
            motion_of(&path).map_err(problem)?;
            let item = CorpusItem {
                motion_id: clip,
                group: group.clone(),
                split: *split,
                action: caption.content.clone(),
                captions: caption.captions.clone(),
                is_continuous: false,
            };
            let file = path.strip_prefix(folder).unwrap_or(&path);
            found.push((item, file.into()));
        }
        if found.is_empty() {
            return Err(CorpusError::Format {
                path: folder.display().to_string(),
                line: 0,
                problem: "no BVH file in this folder or below; archives must be unpacked".into(),
            });
        }
        found.sort_by(|a, b| a.0.motion_id.cmp(&b.0.motion_id));
        let (items, files) = found.into_iter().unzip();
        Ok(Self {
            folder: folder.into(),
            items,
            files,
        })
    }

    /// Clips that were found before.
    ///
    /// # Errors
    /// A recipe of another source.
    pub(crate) fn of_items(
        folder: &Path,
        found: Vec<(CorpusItem, Value)>,
    ) -> Result<Self, CorpusError> {
        let (mut items, mut files) = (Vec::new(), Vec::new());
        for (item, recipe) in found {
            files.push(recipe_of(&item, recipe)?);
            items.push(item);
        }
        Ok(Self {
            folder: folder.into(),
            items,
            files,
        })
    }
}

/// The motion of a file, first pose at the origin.
fn motion_of(path: &Path) -> Result<Motion, String> {
    let bytes = bounded::read_bytes(path, MAX_BVH_BYTES).map_err(|e| e.to_string())?;
    let mut motion = load_motion(path, &bytes).map_err(|e| e.to_string())?.motion;
    canonicalize(&mut motion);
    Ok(motion)
}

impl Corpus for BandaiNamco {
    fn name(&self) -> &str {
        "bandai-namco"
    }

    fn licence(&self) -> &str {
        "CC BY-NC 4.0 (non-commercial)"
    }

    fn attribution(&self) -> &str {
        "Bandai-Namco-Research-Motiondataset; Kobayashi et al., arXiv:2306.08861"
    }

    fn items(&self) -> &[CorpusItem] {
        &self.items
    }

    fn motion(&self, item_idx: usize) -> Result<Motion, CorpusError> {
        let path = self.folder.join(&self.files[item_idx]);
        motion_of(&path).map_err(|problem| CorpusError::Motion {
            id: self.items[item_idx].motion_id.clone(),
            problem,
        })
    }

    fn recipe(&self, item_idx: usize) -> Value {
        serde_json::json!(self.files[item_idx])
    }
}

fn read_captions(path: &Path) -> Result<HashMap<String, CaptionLine>, CorpusError> {
    let text = text_of(path)?;
    let mut captions = HashMap::new();
    for (line_idx, line) in text.lines().enumerate() {
        let problem = |problem: String| CorpusError::Format {
            path: path.display().to_string(),
            line: line_idx + 1,
            problem,
        };
        let parsed: CaptionLine = serde_json::from_str(line).map_err(|e| problem(e.to_string()))?;
        if parsed.captions.iter().all(|c| c.trim().is_empty()) {
            return Err(problem(format!("clip `{}` has no caption", parsed.clip)));
        }
        captions.insert(parsed.clip.clone(), parsed);
    }
    Ok(captions)
}

fn read_splits(path: &Path) -> Result<HashMap<String, (Split, String)>, CorpusError> {
    let text = text_of(path)?;
    let mut splits = HashMap::new();
    for (line_idx, line) in text.lines().enumerate().skip(1) {
        let problem = |problem: String| CorpusError::Format {
            path: path.display().to_string(),
            line: line_idx + 1,
            problem,
        };
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        let [clip, split, group] = fields[..] else {
            return Err(problem(format!(
                "expected `clip,split,group`, found {} fields",
                fields.len()
            )));
        };
        let split = match split {
            "train" => Split::Train,
            "val" => Split::Val,
            "test" => Split::Test,
            other => return Err(problem(format!("unknown split `{other}`"))),
        };
        splits.insert(clip.to_string(), (split, group.to_string()));
    }
    Ok(splits)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::files::tests::bvh;
    use super::*;

    #[test]
    fn clips_below_the_folder_are_items_in_order_of_their_names() {
        let dir = tempfile::tempdir().unwrap();
        let put = |name: &str, text: &str| {
            let path = dir.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        let problem = || {
            let opened = BandaiNamco::open(dir.path());
            opened.map(|_| ()).unwrap_err().to_string()
        };
        let line = |clip: &str| {
            format!(r#"{{"clip": "{clip}", "content": "walk", "captions": ["a person walks"]}}"#)
        };
        put("captions.jsonl", &[line("b_1"), line("a_2")].join("\n"));
        put("splits.csv", "clip,split,group\nb_1,train,b\na_2,test,a\n");
        assert!(problem().contains("archives must be unpacked"));
        put("data/deep/b_1.bvh", &bvh(20, 2.0));
        put("data/a_2.bvh", &bvh(20, 1.0));
        put("data/notes.txt", "none");
        let corpus = BandaiNamco::open(dir.path()).unwrap();
        let ids: Vec<&str> = corpus.items().iter().map(|i| &*i.motion_id).collect();
        assert_eq!(ids, ["a_2", "b_1"]);
        assert_eq!(corpus.items()[0].split, Split::Test);
        put("more/b_1.bvh", &bvh(20, 2.0));
        assert!(problem().contains("`b_1`: has two files"));
        put("more/b_1.bvh", "HIERARCHY");
        put("more/c_3.bvh", &bvh(20, 2.0));
        fs::remove_file(dir.path().join("more/b_1.bvh")).unwrap();
        assert!(problem().contains("`c_3`: has no line in captions.jsonl"));
    }
}
