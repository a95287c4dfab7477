//! A folder of motion files with sentences.
//!
//! Motions are BVH, AMC with its ASF, AMASS npz and HumanML3D npy files anywhere below the folder. Sentences are either
//! lines of JSON, one for each part of a motion ([`CaptionLine`]), or a folder of texts as HumanML3D has them: `ID.txt`
//! with lines `sentence#tokens#start#end`, and the ids of each split in `train.txt`, `val.txt` and `test.txt` beside the
//! folder.
//!
//! Parts that cannot be used are skipped and named in the manifest: files that are missing or broken, parts without a
//! sentence or with an unknown split, parts that are not inside the motion, that are too short, that occur twice, in which
//! nobody moves although the sentence says that a person walks, or whose walk shows a wrong frame rate.

use std::{
    collections::{HashMap, HashSet},
    hash::{DefaultHasher, Hash, Hasher},
    path::{Path, PathBuf},
};

use radarllm_base::{Motion, seed::derive_seed};
use radarllm_body::{
    despike::despike,
    gait::Gait,
    loaders::{MAX_FILE_BYTES, load_motion},
    sample::{bend_path, canonicalize, crop, mirror},
};
use radarllm_dataset::{FailedItem, record::Split};
use radarllm_files::bounded::{read_bytes, read_text};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{Corpus, CorpusError, CorpusItem, files_below, recipe_of};

/// Largest file with sentences, bytes.
const MAX_TEXT_BYTES: u64 = 256 << 20;
/// Shortest part of a motion, s.
const SHORTEST_S: f64 = 1.0;
/// Time by which the end of a part may be after the end of the motion, s: times are written with one decimal place.
const END_TOLERANCE_S: f64 = 0.1;
/// Who walks or runs moves by at least this distance, m.
const MIN_WAY_M: f32 = 0.3;
/// Standing heights of people, m.
const HEIGHTS_M: std::ops::RangeInclusive<f32> = 1.0..=2.3;
/// Extensions of motion files.
const EXTENSIONS: [&str; 4] = ["bvh", "amc", "npz", "npy"];

/// `kind = "files"` of a data set configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilesConfig {
    /// Folder with the motion files, relative to the configuration file.
    pub path: PathBuf,
    /// JSON lines or a folder of texts, relative to `path`.
    pub captions: PathBuf,
    /// Licence of motions and sentences, for the manifest.
    pub licence: String,
    /// Attribution, for the manifest.
    #[serde(default)]
    pub attribution: String,
    /// Whether walks and runs are kept whose steps show a wrong frame rate.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub any_frame_rate: bool,
}

impl FilesConfig {
    pub(crate) fn terms(&self) -> Terms {
        Terms {
            name: "files",
            licence: self.licence.clone(),
            attribution: self.attribution.clone(),
            may_repeat: false,
            any_frame_rate: self.any_frame_rate,
        }
    }
}

/// A line of the file with sentences.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CaptionLine {
    /// Motion file, relative to the folder.
    pub file: String,
    /// Sentences.
    #[serde(default)]
    pub captions: Vec<String>,
    /// Id in the data set; the file's path without extension, and the start, if omitted.
    pub id: Option<String>,
    /// Action label; the actions of the first sentence if omitted.
    pub action: Option<String>,
    /// `train`, `val` or `test`; drawn by group, eight to one to one, if omitted.
    pub split: Option<String>,
    /// Group, all of which is in one split; the file's folder if omitted, or the name of a file in the top folder.
    pub group: Option<String>,
    /// Start of the part, s after the skipped frames.
    pub start_s: Option<f64>,
    /// End of the part, s after the skipped frames.
    pub end_s: Option<f64>,
    /// Frames per second, where the file states none or a wrong number.
    pub fps: Option<f64>,
    /// Frames at the start of the file that are no motion, for example a T-pose.
    #[serde(default)]
    pub skip_frames: usize,
    /// Whether the motion is mirrored; the sentences are those about the mirrored motion.
    #[serde(default)]
    pub mirror: bool,
    /// Angle by which the path, which must be straight, is bent in its middle, degrees; positive is to the left. The
    /// sentences are those about the bent path.
    pub bend_deg: Option<f64>,
    /// Whether [`Self::end_s`] may be after the end of the motion, as some times of HumanML3D are.
    #[serde(skip)]
    pub may_end_early: bool,
}

/// Terms of a source of motions.
#[derive(Clone, Debug)]
pub(crate) struct Terms {
    /// Name of the corpus.
    pub name: &'static str,
    /// Licence of motions and sentences.
    pub licence: String,
    /// Attribution.
    pub attribution: String,
    /// Whether one part of a motion may occur with several ids.
    pub may_repeat: bool,
    /// As [`FilesConfig::any_frame_rate`].
    pub any_frame_rate: bool,
}

/// Motion files with sentences.
pub struct MotionFiles {
    terms: Terms,
    folder: PathBuf,
    items: Vec<CorpusItem>,
    lines: Vec<CaptionLine>,
    skipped: Vec<FailedItem>,
}

impl MotionFiles {
    /// Reads the sentences and checks every motion. Relative paths are resolved against `base`.
    ///
    /// # Errors
    /// Sentences that cannot be read, with file and line; no usable motion at all.
    pub fn open(config: &FilesConfig, base: &Path) -> Result<Self, CorpusError> {
        let folder = base.join(&config.path);
        let captions = folder.join(&config.captions);
        let lines = match captions.is_dir() {
            true => read_texts(&captions, &folder)?,
            false => read_lines(&captions)?,
        };
        let skipped = unlabelled(&folder, &lines)?;
        Self::from_lines(config.terms(), &captions, folder, lines, skipped)
    }

    /// Parts that were checked before.
    ///
    /// # Errors
    /// A recipe of another source.
    pub(crate) fn of_items(
        terms: Terms,
        folder: PathBuf,
        checked: Vec<(CorpusItem, Value)>,
    ) -> Result<Self, CorpusError> {
        let (mut items, mut lines) = (Vec::new(), Vec::new());
        for (item, recipe) in checked {
            let Recipe {
                line,
                may_end_early,
            } = recipe_of(&item, recipe)?;
            lines.push(CaptionLine {
                may_end_early,
                ..line
            });
            items.push(item);
        }
        Ok(Self {
            terms,
            folder,
            items,
            lines,
            skipped: Vec::new(),
        })
    }

    /// Checks the motion of every line. `origin` is where the lines are from, for errors.
    pub(super) fn from_lines(
        terms: Terms,
        origin: &Path,
        folder: PathBuf,
        lines: Vec<CaptionLine>,
        skipped: Vec<FailedItem>,
    ) -> Result<Self, CorpusError> {
        let checked: Vec<Result<(CorpusItem, u64), FailedItem>> = lines
            .par_iter()
            .map(|line| {
                checked(&folder, line, terms.any_frame_rate).map_err(|reason| FailedItem {
                    id: id_of(line),
                    reason,
                })
            })
            .collect();
        let mut corpus = Self {
            terms,
            folder,
            items: Vec::new(),
            lines: Vec::new(),
            skipped,
        };
        let mut ids = HashSet::new();
        let mut contents: HashMap<u64, String> = HashMap::new();
        for (line, checked) in lines.into_iter().zip(checked) {
            let (item, content) = match checked {
                Ok(checked) => checked,
                Err(failed) => {
                    corpus.skipped.push(failed);
                    continue;
                }
            };
            let same = contents.get(&content).filter(|_| !corpus.terms.may_repeat);
            let repeats = match same {
                Some(other) => Some(format!("the same motion as `{other}`")),
                None if ids.contains(&item.motion_id) => Some("the second with this id".into()),
                None => None,
            };
            if let Some(reason) = repeats {
                corpus.skipped.push(FailedItem {
                    id: item.motion_id,
                    reason,
                });
                continue;
            }
            ids.insert(item.motion_id.clone());
            contents.insert(content, item.motion_id.clone());
            corpus.items.push(item);
            corpus.lines.push(line);
        }
        if corpus.items.is_empty() {
            let first = corpus.skipped.first();
            let why = first.map_or(String::new(), |s| format!(": {}: {}", s.id, s.reason));
            return Err(CorpusError::Format {
                path: origin.display().to_string(),
                line: 0,
                problem: format!("no usable motion, {} skipped{why}", corpus.skipped.len()),
            });
        }
        Ok(corpus)
    }
}

/// A part of a motion file, as the index of a data set has it.
#[derive(Serialize, Deserialize)]
struct Recipe {
    line: CaptionLine,
    may_end_early: bool,
}

impl Corpus for MotionFiles {
    fn name(&self) -> &str {
        self.terms.name
    }

    fn licence(&self) -> &str {
        &self.terms.licence
    }

    fn attribution(&self) -> &str {
        &self.terms.attribution
    }

    fn items(&self) -> &[CorpusItem] {
        &self.items
    }

    fn skipped(&self) -> &[FailedItem] {
        &self.skipped
    }

    fn motion(&self, item_idx: usize) -> Result<Motion, CorpusError> {
        let (motion, _) =
            part(&self.folder, &self.lines[item_idx]).map_err(|problem| CorpusError::Motion {
                id: self.items[item_idx].motion_id.clone(),
                problem,
            })?;
        Ok(motion)
    }

    fn recipe(&self, item_idx: usize) -> Value {
        let line = CaptionLine {
            // The item has them.
            captions: Vec::new(),
            ..self.lines[item_idx].clone()
        };
        let may_end_early = line.may_end_early;
        serde_json::json!(Recipe {
            line,
            may_end_early
        })
    }
}

/// The item of a line and a hash of its motion, or why it is skipped.
fn checked(
    folder: &Path,
    line: &CaptionLine,
    any_frame_rate: bool,
) -> Result<(CorpusItem, u64), String> {
    let captions: Vec<String> = line
        .captions
        .iter()
        .map(|caption| caption.trim().to_string())
        .filter(|caption| !caption.is_empty())
        .collect();
    let Some(first) = captions.first() else {
        return Err("no sentence".into());
    };
    let group = match &line.group {
        Some(group) => group.clone(),
        None => match line.file.rsplit_once('/') {
            Some((folder, _)) => folder.into(),
            None => stem(&line.file).into(),
        },
    };
    let split = match &line.split {
        Some(name) => *Split::ALL
            .iter()
            .find(|split| split.name() == name)
            .ok_or_else(|| format!("unknown split `{name}`"))?,
        None => match derive_seed(1, &group) % 10 {
            0 => Split::Val,
            1 => Split::Test,
            _ => Split::Train,
        },
    };
    let (motion, content) = part(folder, line)?;
    let seconds = motion.duration_s();
    if seconds < SHORTEST_S {
        return Err(format!(
            "{seconds:.1} s, at least {SHORTEST_S} s are needed"
        ));
    }
    let clauses = radarllm_facts::parse(first);
    let actions: Vec<&str> = clauses
        .iter()
        .flat_map(|c| &c.actions)
        .map(|a| a.name)
        .collect();
    let way_m = way_m(&motion);
    if let [only @ ("walk" | "run" | "pace" | "circle")] = actions[..]
        && way_m < MIN_WAY_M
    {
        return Err(format!(
            "`{first}` states `{only}`, but the pelvis moves by {way_m:.2} m"
        ));
    }
    if let [only @ ("walk" | "run" | "pace")] = actions[..]
        && !any_frame_rate
        && let Some(problem) = Gait::of(&motion).and_then(|gait| gait.problem())
    {
        return Err(format!("`{first}` states `{only}`, but {problem}"));
    }
    let action = match (&line.action, actions.is_empty()) {
        (Some(action), _) => action.clone(),
        (None, false) => actions.join(" then "),
        (None, true) => "other".into(),
    };
    let item = CorpusItem {
        motion_id: id_of(line),
        group,
        split,
        action,
        captions,
        is_continuous: false,
    };
    Ok((item, content))
}

/// The part of the motion that a line describes, first pose at the origin, and a hash of file and part.
fn part(folder: &Path, line: &CaptionLine) -> Result<(Motion, u64), String> {
    let path = folder.join(&line.file);
    let bytes = read_bytes(&path, MAX_FILE_BYTES).map_err(|e| e.to_string())?;
    let mut hasher = DefaultHasher::new();
    bytes.hash(&mut hasher);
    let (start_s, end_s) = (line.start_s.unwrap_or(0.0), line.end_s);
    (start_s.to_bits(), end_s.map(f64::to_bits), line.mirror).hash(&mut hasher);
    if let Some(bend_deg) = line.bend_deg {
        bend_deg.to_bits().hash(&mut hasher);
    }
    let loaded = load_motion(&path, &bytes).map_err(|e| e.to_string())?;
    if !HEIGHTS_M.contains(&loaded.height_m) {
        return Err(format!(
            "a person of {:.2} m: is the unit wrong?",
            loaded.height_m
        ));
    }
    let mut motion = loaded.motion;
    if let Some(fps) = line.fps {
        if !(1.0..=1000.0).contains(&fps) {
            return Err(format!("fps {fps}: must be in 1..=1000"));
        }
        motion.fps = fps;
    }
    let skipped_s = line.skip_frames as f64 / motion.fps;
    let last_s = motion.duration_s();
    let own_s = last_s - skipped_s;
    let max_s = match line.may_end_early {
        true => f64::INFINITY,
        false => own_s + END_TOLERANCE_S,
    };
    if let Some(end_s) = end_s
        && !(start_s < end_s && end_s <= max_s)
    {
        return Err(format!(
            "the part from {start_s} s to {end_s} s is not inside the motion of {own_s:.1} s"
        ));
    }
    let end_s = end_s.map_or(last_s, |end_s| (end_s + skipped_s).min(last_s));
    if !(start_s >= 0.0 && start_s + skipped_s < end_s) {
        return Err(format!(
            "the part from {start_s} s is not inside the motion of {own_s:.1} s"
        ));
    }
    let mut motion = crop(&motion, start_s + skipped_s, end_s);
    despike(&mut motion)?;
    if line.mirror {
        motion = mirror(&motion);
    }
    if let Some(bend_deg) = line.bend_deg {
        if !(-180.0..=180.0).contains(&bend_deg) {
            return Err(format!("bend_deg {bend_deg}: must be in -180..=180"));
        }
        motion = bend_path(&motion, bend_deg.to_radians() as f32).map_err(|e| e.to_string())?;
    }
    canonicalize(&mut motion);
    Ok((motion, hasher.finish()))
}

/// Largest distance of the pelvis from its start on the floor, m.
fn way_m(motion: &Motion) -> f32 {
    let place = |pose: &radarllm_base::Pose| pose.root_in_world.truncate();
    let Some(start) = motion.poses.first().map(place) else {
        return 0.0;
    };
    let way = motion.poses.iter().map(|pose| place(pose).distance(start));
    way.fold(0.0, f32::max)
}

fn id_of(line: &CaptionLine) -> String {
    if let Some(id) = &line.id {
        return id.clone();
    }
    let stem = stem(&line.file);
    match line.start_s {
        Some(start_s) if start_s > 0.0 => format!("{stem}@{start_s}"),
        _ => stem.into(),
    }
}

/// A file's path without its extension.
fn stem(file: &str) -> &str {
    file.rsplit_once('.').map_or(file, |(stem, _)| stem)
}

/// Motion files that no line names.
fn unlabelled(folder: &Path, lines: &[CaptionLine]) -> Result<Vec<FailedItem>, CorpusError> {
    let named: HashSet<PathBuf> = lines.iter().map(|l| folder.join(&l.file)).collect();
    let mut found = Vec::new();
    for path in files_below(folder)? {
        let is_motion = path
            .extension()
            .is_some_and(|e| EXTENSIONS.iter().any(|known| e == *known));
        if is_motion && !named.contains(&path) {
            let id = path.strip_prefix(folder).unwrap_or(&path);
            found.push(FailedItem {
                id: id.display().to_string(),
                reason: "no sentence".into(),
            });
        }
    }
    found.sort_by(|a, b| a.id.cmp(&b.id));
    Ok(found)
}

fn read_lines(path: &Path) -> Result<Vec<CaptionLine>, CorpusError> {
    let text = text_of(path)?;
    let lines = text.lines().enumerate();
    lines
        .filter(|(_, line)| !line.trim().is_empty())
        .map(|(i, line)| {
            serde_json::from_str(line).map_err(|e| CorpusError::Format {
                path: path.display().to_string(),
                line: i + 1,
                problem: e.to_string(),
            })
        })
        .collect()
}

/// The texts of HumanML3D. Sentences about a part of a motion are lines of their own.
fn read_texts(texts: &Path, folder: &Path) -> Result<Vec<CaptionLine>, CorpusError> {
    let beside = texts.parent().unwrap_or(texts);
    let mut lines = Vec::new();
    for split in Split::ALL {
        let list = beside.join(format!("{split}.txt"));
        for (i, id) in text_of(&list)?.lines().enumerate() {
            let id = id.trim();
            if id.is_empty() {
                continue;
            }
            if id.contains(['/', '\\']) || id == ".." {
                return Err(CorpusError::Format {
                    path: list.display().to_string(),
                    line: i + 1,
                    problem: format!("`{id}` is no plain id"),
                });
            }
            let path = texts.join(format!("{id}.txt"));
            let extension = EXTENSIONS
                .iter()
                .find(|e| folder.join(format!("{id}.{e}")).exists());
            let whole = CaptionLine {
                file: format!("{id}.{}", extension.unwrap_or(&"npy")),
                id: Some(id.into()),
                group: Some(id.trim_start_matches('M').into()),
                split: Some(split.name().into()),
                may_end_early: true,
                ..CaptionLine::default()
            };
            let mut parts: Vec<CaptionLine> = vec![whole];
            // A text that is missing leaves its motion without a sentence, which is reported with the motion.
            let sentences = match path.exists() {
                true => read_humanml3d_text(&path)?,
                false => Vec::new(),
            };
            for (caption, [start_s, end_s]) in sentences {
                let is_whole = start_s == 0.0 && end_s == 0.0;
                let same = parts.iter_mut().find(|p| {
                    (p.start_s, p.end_s) == (Some(start_s), Some(end_s))
                        || is_whole && p.start_s.is_none()
                });
                match same {
                    Some(part) => part.captions.push(caption),
                    None => {
                        let mut part = parts[0].clone();
                        part.captions = vec![caption];
                        part.id = Some(format!("{id}@{start_s}-{end_s}"));
                        (part.start_s, part.end_s) = (Some(start_s), Some(end_s));
                        parts.push(part);
                    }
                }
            }
            if parts.len() > 1 && parts[0].captions.is_empty() {
                parts.remove(0);
            }
            lines.append(&mut parts);
        }
    }
    Ok(lines)
}

/// The sentences of a text of HumanML3D, each with start and end, s; both times are 0 for the whole motion.
pub(super) fn read_humanml3d_text(path: &Path) -> Result<Vec<(String, [f64; 2])>, CorpusError> {
    let text = text_of(path)?;
    let sentence = |(i, line): (usize, &str)| {
        humanml3d_line(line).ok_or_else(|| CorpusError::Format {
            path: path.display().to_string(),
            line: i + 1,
            problem: "expected `sentence#tokens#start#end`".into(),
        })
    };
    text.lines().enumerate().map(sentence).collect()
}

/// Sentence, start and end of a line; both times are 0 for the whole motion.
fn humanml3d_line(line: &str) -> Option<(String, [f64; 2])> {
    let mut fields = line.rsplitn(4, '#');
    let mut time = || {
        let time_s: f64 = fields.next()?.trim().parse().ok()?;
        // Some lines have `nan` for the whole motion.
        Some(if time_s.is_nan() { 0.0 } else { time_s })
    };
    let (end_s, start_s) = (time()?, time()?);
    let _tokens = fields.next()?;
    Some((fields.next()?.trim().into(), [start_s, end_s]))
}

pub(super) fn text_of(path: &Path) -> Result<String, CorpusError> {
    let text = read_text(path, MAX_TEXT_BYTES).map_err(|e| CorpusError::Format {
        path: path.display().to_string(),
        line: 0,
        problem: e.to_string(),
    })?;
    // Some editors write a byte order mark.
    Ok(match text.strip_prefix('\u{feff}') {
        Some(text) => text.into(),
        None => text,
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use std::fs;

    use super::*;

    /// A BVH file of a figure that moves forward by `way_m` in `n_frames` at 10 frames/s.
    pub fn bvh(n_frames: usize, way_m: f32) -> String {
        let mut text = String::from(
            "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation\n",
        );
        let joint = |name: &str, offset: &str, inner: &str| {
            format!(
                "JOINT {name}\n{{\nOFFSET {offset}\nCHANNELS 3 Zrotation Yrotation Xrotation\n{inner}}}\n"
            )
        };
        let end = |offset: &str| format!("End Site\n{{\nOFFSET {offset}\n}}\n");
        let mut n_joints = 1;
        let mut limb = |names: [&str; 3], offsets: [&str; 3], tip: &str| {
            n_joints += 3;
            let last = joint(names[2], offsets[2], &end(tip));
            joint(names[0], offsets[0], &joint(names[1], offsets[1], &last))
        };
        for (side, x) in [("Left", 10), ("Right", -10)] {
            let names = ["UpLeg", "Leg", "Foot"].map(|name| format!("{side}{name}"));
            let names = [&names[0], &names[1], &names[2]].map(String::as_str);
            text += &limb(
                names,
                [&format!("{x} 0 0"), "0 -42 0", "0 -42 0"],
                "0 -6 15",
            );
        }
        let mut arms = String::new();
        for (side, x) in [("Left", 1), ("Right", -1)] {
            let names = ["Arm", "ForeArm", "Hand"].map(|name| format!("{side}{name}"));
            let names = [&names[0], &names[1], &names[2]].map(String::as_str);
            let [a, b, c] = [18, 28, 25].map(|d| format!("{} 0 0", x * d));
            arms += &limb(names, [&a, &b, &c], &format!("{} 0 0", x * 15));
        }
        n_joints += 2;
        let head = joint("Head", "0 25 0", &end("0 18 0"));
        text += &joint("Spine", "0 25 0", &format!("{arms}{head}"));
        text += &format!("}}\nMOTION\nFrames: {n_frames}\nFrame Time: 0.1\n");
        for i in 0..n_frames {
            let z_cm = 100.0 * way_m * i as f32 / n_frames as f32;
            text += &format!("0 92 {z_cm} {}\n", "0 ".repeat(3 * n_joints));
        }
        text
    }

    fn config() -> FilesConfig {
        FilesConfig {
            path: "motions".into(),
            captions: "captions.jsonl".into(),
            licence: "own".into(),
            attribution: String::new(),
            any_frame_rate: false,
        }
    }

    fn folder(files: &[(&str, String)]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = dir.path().join("motions").join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        dir
    }

    #[test]
    fn usable_motions_are_items_and_the_others_are_named() {
        let lines = [
            r#"{"file": "a/1.bvh", "captions": ["a person walks forward"], "split": "train"}"#,
            r#"{"file": "a/1.bvh", "captions": ["a person walks"], "start_s": 2.0, "end_s": 4.0, "skip_frames": 10}"#,
            r#"{"file": "a/1.bvh", "captions": ["a person strolls forward"], "id": "again"}"#,
            r#"{"file": "a/broken.bvh", "captions": ["a person walks"]}"#,
            r#"{"file": "a/none.bvh", "captions": ["a person walks"]}"#,
            r#"{"file": "b/2.bvh", "captions": ["  "]}"#,
            r#"{"file": "b/2.bvh", "captions": ["a person walks"], "id": "still"}"#,
            r#"{"file": "b/2.bvh", "captions": ["a person waves"], "split": "exam"}"#,
            r#"{"file": "b/2.bvh", "captions": ["a person waves"], "end_s": 0.5}"#,
            r#"{"file": "b/2.bvh", "captions": ["a person waves"], "id": "wave", "action": "greet", "group": "g"}"#,
            r#"{"file": "a/1.bvh", "captions": ["a person walks, then turns left"], "id": "left", "bend_deg": 90.0}"#,
            r#"{"file": "a/1.bvh", "captions": ["a person walks"], "id": "round", "bend_deg": 270.0}"#,
            r#"{"file": "b/2.bvh", "captions": ["a person turns left"], "id": "spot", "bend_deg": 90.0}"#,
        ];
        let dir = folder(&[
            ("captions.jsonl", lines.join("\n")),
            ("a/1.bvh", bvh(60, 5.0)),
            ("a/broken.bvh", "HIERARCHY\nROOT".into()),
            ("b/2.bvh", bvh(60, 0.0)),
            ("c/unnamed.bvh", bvh(60, 0.0)),
        ]);
        let corpus = MotionFiles::open(&config(), dir.path()).unwrap();
        let items: Vec<(&str, &str, &str)> = corpus
            .items()
            .iter()
            .map(|i| (i.motion_id.as_str(), i.action.as_str(), i.group.as_str()))
            .collect();
        assert_eq!(
            items,
            [
                ("a/1", "walk", "a"),
                ("a/1@2", "walk", "a"),
                ("wave", "greet", "g"),
                ("left", "walk then turn", "a"),
            ]
        );
        assert!((corpus.motion(0).unwrap().duration_s() - 6.0).abs() < 0.11);
        assert!((corpus.motion(1).unwrap().duration_s() - 2.0).abs() < 0.11);
        let skipped: Vec<(&str, &str)> = corpus
            .skipped()
            .iter()
            .map(|s| (s.id.as_str(), s.reason.as_str()))
            .collect();
        for (id, word) in [
            ("c/unnamed.bvh", "no sentence"),
            ("again", "the same motion as `a/1`"),
            ("a/broken", "broken.bvh"),
            ("a/none", "none.bvh"),
            ("b/2", "no sentence"),
            ("still", "moves by 0.00 m"),
            ("b/2", "unknown split `exam`"),
            ("b/2", "at least 1 s"),
            ("round", "bend_deg 270: must be in -180..=180"),
            ("spot", "moves by 0.00 m"),
        ] {
            assert!(
                skipped.iter().any(|s| s.0 == id && s.1.contains(word)),
                "{id} {word}: {skipped:?}"
            );
        }
        assert_eq!(skipped.len(), 10);
    }

    #[test]
    fn parts_and_mirror_images_of_a_file_are_in_one_split() {
        let line = |i: usize| {
            let (start_s, mirror) = (0.1 * i as f64, i % 2 == 1);
            format!(
                r#"{{"file": "a.bvh", "captions": ["a person walks"], "id": "p{i}", "start_s": {start_s}, "mirror": {mirror}}}"#
            )
        };
        let mut lines: Vec<String> = (0..24).map(line).collect();
        lines.push(r#"{"file": "b.bvh", "captions": ["a person walks"]}"#.into());
        lines.push(r#"{"file": "c/d.bvh", "captions": ["a person walks"]}"#.into());
        let dir = folder(&[
            ("captions.jsonl", lines.join("\n")),
            ("a.bvh", bvh(60, 5.0)),
            ("b.bvh", bvh(60, 4.0)),
            ("c/d.bvh", bvh(60, 3.0)),
        ]);
        let corpus = MotionFiles::open(&config(), dir.path()).unwrap();
        let (parts, others) = corpus.items().split_at(24);
        assert!(
            parts
                .iter()
                .all(|i| i.group == "a" && i.split == parts[0].split)
        );
        let groups: Vec<&str> = others.iter().map(|i| i.group.as_str()).collect();
        assert_eq!(groups, ["b", "c"]);
    }

    #[test]
    fn parts_that_end_after_the_motion_are_named() {
        let lines = [
            r#"{"file": "a.bvh", "captions": ["a person walks"], "id": "late", "start_s": 2, "end_s": 50}"#,
            r#"{"file": "a.bvh", "captions": ["a person walks"], "id": "never", "start_s": 7}"#,
            r#"{"file": "a.bvh", "captions": ["a person walks"], "id": "back", "start_s": 3, "end_s": 2}"#,
            r#"{"file": "a.bvh", "captions": ["a person walks"], "id": "skipped", "end_s": 6, "skip_frames": 10}"#,
            r#"{"file": "a.bvh", "captions": ["a person walks"], "id": "rounded", "end_s": 6.05}"#,
        ];
        // With a byte order mark.
        let dir = folder(&[
            ("captions.jsonl", format!("\u{feff}{}", lines.join("\n"))),
            ("a.bvh", bvh(60, 5.0)),
        ]);
        let corpus = MotionFiles::open(&config(), dir.path()).unwrap();
        let ids: Vec<&str> = corpus
            .items()
            .iter()
            .map(|i| i.motion_id.as_str())
            .collect();
        assert_eq!(ids, ["rounded"]);
        for (id, reason) in [
            (
                "late",
                "the part from 2 s to 50 s is not inside the motion of 6.0 s",
            ),
            (
                "never",
                "the part from 7 s is not inside the motion of 6.0 s",
            ),
            (
                "back",
                "the part from 3 s to 2 s is not inside the motion of 6.0 s",
            ),
            (
                "skipped",
                "the part from 0 s to 6 s is not inside the motion of 5.0 s",
            ),
        ] {
            let found = corpus.skipped().iter().find(|s| s.id == id);
            assert_eq!(found.map(|s| s.reason.as_str()), Some(reason));
        }
    }

    #[test]
    fn texts_of_humanml3d_are_read_with_their_splits_and_parts() {
        let dir = folder(&[
            ("7.bvh", bvh(80, 5.0)),
            ("M7.bvh", bvh(80, 4.0)),
            ("8.bvh", bvh(80, 0.0)),
            ("texts/7.txt", "a person walks.#a/DET person/NOUN walk/VERB#0.0#0.0\na man # walks on#x#0.0#nan\nthey step#x#2.0#5.0\n".into()),
            ("texts/M7.txt", "a person walks.#x#0.0#0.0\n".into()),
            ("train.txt", "7\nM7\n".into()),
            ("val.txt", "8\n".into()),
            ("test.txt", String::new()),
        ]);
        let config = FilesConfig {
            captions: "texts".into(),
            ..config()
        };
        let corpus = MotionFiles::open(&config, dir.path()).unwrap();
        let items: Vec<(&str, &str, usize)> = corpus
            .items()
            .iter()
            .map(|i| (i.motion_id.as_str(), i.group.as_str(), i.captions.len()))
            .collect();
        assert_eq!(items, [("7", "7", 2), ("7@2-5", "7", 1), ("M7", "7", 1)]);
        assert_eq!(corpus.items()[0].captions[1], "a man # walks on");
        assert_eq!(corpus.skipped().len(), 1);
        assert_eq!(corpus.skipped()[0].id, "8");

        let outside = folder(&[
            ("texts/a.txt", "x#x#0#0\n".into()),
            ("train.txt", "../a\n".into()),
        ]);
        let error = MotionFiles::open(&config, outside.path()).err().unwrap();
        assert!(error.to_string().contains("train.txt:1: `../a`"), "{error}");
    }

    #[test]
    fn a_folder_without_a_usable_motion_is_refused() {
        let lines = r#"{"file": "1.bvh", "captions": ["a person walks"]}"#;
        for (text, word) in [
            (lines, "no usable motion, 1 skipped: 1: "),
            ("{\"file\": 1}", "captions.jsonl:1: "),
            ("", "no usable motion, 0 skipped"),
        ] {
            let dir = folder(&[("captions.jsonl", text.into())]);
            let error = MotionFiles::open(&config(), dir.path()).err().unwrap();
            assert!(error.to_string().contains(word), "{error}");
        }
    }
}
