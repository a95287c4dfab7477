//! The Bandai-Namco Research motion data sets 1 and 2 with captions.
//!
//! The folder holds `dataset-*.tar.zst` (BVH files inside), `captions.jsonl`
//! (`clip, content, style, captions`) and `splits.csv` (`clip,split,group`). Archives are read as
//! they are; nothing is unpacked to disk.

use std::{
    collections::HashMap,
    fs,
    io::{BufReader, Read},
    path::{Path, PathBuf},
};

use radarllm_base::Motion;
use radarllm_body::{loaders::load_motion, sample::canonicalize};
use radarllm_dataset::record::Split;
use serde::Deserialize;

use super::{Corpus, CorpusError, CorpusItem};

/// Largest BVH file accepted from an archive, bytes (the largest real one has 6 MB).
const MAX_BVH_BYTES: u64 = 64 << 20;

/// Captioned clips of the two data sets.
pub struct BandaiNamco {
    items: Vec<CorpusItem>,
    motions: Vec<Motion>,
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
        let mut found: Vec<(CorpusItem, Motion)> = Vec::new();
        for archive in archives(folder)? {
            read_archive(&archive, |clip, path, bytes| {
                let (Some(caption), Some((split, group))) = (captions.get(clip), splits.get(clip))
                else {
                    return Err(CorpusError::Motion {
                        id: clip.into(),
                        problem: "has no line in captions.jsonl or splits.csv".into(),
                    });
                };
                let loaded = load_motion(path, bytes).map_err(|e| CorpusError::Motion {
                    id: clip.into(),
                    problem: e.to_string(),
                })?;
                let mut motion = loaded.motion;
                canonicalize(&mut motion);
                let item = CorpusItem {
                    motion_id: clip.into(),
                    group: group.clone(),
                    split: *split,
                    action: caption.content.clone(),
                    captions: caption.captions.clone(),
                    is_continuous: false,
                };
                found.push((item, motion));
                Ok(())
            })?;
        }
        if found.is_empty() {
            return Err(CorpusError::Format {
                path: folder.display().to_string(),
                line: 0,
                problem: "no dataset-*.tar.zst with BVH files in this folder".into(),
            });
        }
        found.sort_by(|a, b| a.0.motion_id.cmp(&b.0.motion_id));
        let (items, motions) = found.into_iter().unzip();
        Ok(Self { items, motions })
    }
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
        Ok(self.motions[item_idx].clone())
    }
}

fn io_error(path: &Path) -> impl FnOnce(std::io::Error) -> CorpusError {
    let path = path.display().to_string();
    move |source| CorpusError::Io { path, source }
}

fn archives(folder: &Path) -> Result<Vec<PathBuf>, CorpusError> {
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(io_error(folder))? {
        let path = entry.map_err(io_error(folder))?.path();
        let name = path
            .file_name()
            .map(|n| n.to_string_lossy().into_owned())
            .unwrap_or_default();
        if name.starts_with("dataset-") && name.ends_with(".tar.zst") {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

/// Calls `each(clip name, path inside the archive, bytes)` for every BVH file of an archive.
fn read_archive(
    archive: &Path,
    mut each: impl FnMut(&str, &Path, &[u8]) -> Result<(), CorpusError>,
) -> Result<(), CorpusError> {
    let file = fs::File::open(archive).map_err(io_error(archive))?;
    let decoder = ruzstd::decoding::StreamingDecoder::new(BufReader::new(file)).map_err(|e| {
        CorpusError::Format {
            path: archive.display().to_string(),
            line: 0,
            problem: format!("not a zstd stream: {e}"),
        }
    })?;
    let mut tar = tar::Archive::new(decoder);
    for entry in tar.entries().map_err(io_error(archive))? {
        let mut entry = entry.map_err(io_error(archive))?;
        let path = entry.path().map_err(io_error(archive))?.into_owned();
        if path.extension().is_none_or(|e| e != "bvh") {
            continue;
        }
        let size = entry.size();
        if size > MAX_BVH_BYTES {
            return Err(CorpusError::Format {
                path: format!("{}:{}", archive.display(), path.display()),
                line: 0,
                problem: format!("{size} bytes, more than the {MAX_BVH_BYTES} accepted"),
            });
        }
        let mut bytes = Vec::new();
        entry
            .by_ref()
            .take(MAX_BVH_BYTES)
            .read_to_end(&mut bytes)
            .map_err(io_error(archive))?;
        let clip = path
            .file_stem()
            .map(|s| s.to_string_lossy().into_owned())
            .unwrap_or_default();
        each(&clip, &path, &bytes)?;
    }
    Ok(())
}

fn read_captions(path: &Path) -> Result<HashMap<String, CaptionLine>, CorpusError> {
    let text = fs::read_to_string(path).map_err(io_error(path))?;
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
    let text = fs::read_to_string(path).map_err(io_error(path))?;
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
