//! HumanML3D (Guo et al., CVPR 2022): motions with sentences that people wrote.
//!
//! Its sentences are free, its motions are not: most come from AMASS, whose licence forbids passing them on. There are two
//! ways to have them.
//!
//! - `amass = DIR`: a folder of AMASS as its site packs it. All of HumanML3D but HumanAct12 is built.
//! - `motions = DIR`: the CMU database's own files (`SS_TT.amc` with `SS.asf`, or `SS_TT.bvh`) anywhere below a folder. Only
//!   parts from CMU are built; `trials`, a table with `trial,file,true_fps,skip_first_frames`, gives frame rates and lead-in
//!   poses that the files do not state.
//!
//! `path` is the data set's own folder (`index.csv`, `texts/`, `train.txt`, `val.txt`, `test.txt`), or one with
//! `texts.jsonl`: a part on each line, with its sentences. Mirrored parts are made here from the latter; the former has
//! texts of its own for them. Parts without a motion are named in the manifest as all parts that cannot be used.

use std::{
    collections::HashMap,
    path::{Path, PathBuf},
};

use radarllm_dataset::{FailedItem, record::Split};
use radarllm_facts::swap_sides;
use serde::{Deserialize, Serialize};

use super::files::{CaptionLine, MotionFiles, Terms, read_humanml3d_text, text_of};
use super::{CorpusError, files_below};

/// Frames per second of the data set's frame numbers.
const FRAME_RATE_HZ: f64 = 20.0;
/// Time at the start of the motions of some sources that HumanML3D leaves out, s.
const LEAD_IN_S: [(&str, f64); 5] = [
    ("Eyes_Japan_Dataset/", 3.0),
    ("MPI_HDM05/", 3.0),
    ("TotalCapture/", 1.0),
    ("MPI_Limits/", 1.0),
    ("Transitions_mocap/", 0.5),
];

/// `kind = "humanml3d"` of a data set configuration. Paths are relative to the configuration file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HumanMl3dConfig {
    /// Folder of HumanML3D, or a folder with `texts.jsonl`.
    pub path: PathBuf,
    /// Folder of AMASS.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub amass: Option<PathBuf>,
    /// Folder with files of the CMU database, if there is no AMASS.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motions: Option<PathBuf>,
    /// Table of these files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trials: Option<PathBuf>,
    /// Whether every part of `texts.jsonl` is also used mirrored.
    #[serde(default = "yes")]
    pub mirror: bool,
    /// Licence of motions and sentences, for the manifest.
    pub licence: String,
    /// Attribution, for the manifest.
    #[serde(default)]
    pub attribution: String,
}

impl HumanMl3dConfig {
    pub(crate) fn terms(&self) -> Terms {
        Terms {
            name: "humanml3d",
            licence: self.licence.clone(),
            attribution: self.attribution.clone(),
            // Two parts of the data set may be one motion with different sentences.
            may_repeat: true,
            any_frame_rate: false,
        }
    }
}

fn yes() -> bool {
    true
}

/// A part of a motion with its sentences.
#[derive(Clone, Debug, Deserialize)]
struct Part {
    id: String,
    split: String,
    source_path: String,
    start_frame: i64,
    /// -1 for the end of the motion.
    end_frame: i64,
    #[serde(default)]
    sentences: Vec<Sentence>,
    #[serde(skip)]
    is_mirrored: bool,
}

/// A sentence about a part, or about a time within it, s.
#[derive(Clone, Debug, Deserialize)]
struct Sentence {
    text: String,
    #[serde(default)]
    start: f64,
    #[serde(default)]
    end: f64,
}

/// A motion file.
#[derive(Clone, Debug, Default)]
struct MotionFile {
    path: PathBuf,
    /// Time before the first frame of HumanML3D, s.
    lead_in_s: f64,
    fps: Option<f64>,
    skip_frames: usize,
}

/// Where motions are.
enum Motions {
    /// Folder of AMASS.
    Amass(PathBuf),
    /// Files of the CMU database by trial, and what is known of the trials: frame rate and number of lead-in poses.
    Cmu(HashMap<String, PathBuf>, HashMap<String, (f64, usize)>),
}

impl Motions {
    fn open(config: &HumanMl3dConfig, base: &Path) -> Result<Self, CorpusError> {
        match (&config.amass, &config.motions) {
            (Some(amass), None) => Ok(Self::Amass(base.join(amass))),
            (None, Some(motions)) => {
                let table = config.trials.as_ref().map(|table| base.join(table));
                let trials = table.map(|table| read_trials(&table)).transpose()?;
                let files = cmu_files(&base.join(motions))?;
                Ok(Self::Cmu(files, trials.unwrap_or_default()))
            }
            _ => Err(format_error(
                &base.join(&config.path),
                0,
                "HumanML3D needs its motions: give either `amass` or `motions`".into(),
            )),
        }
    }

    fn find(&self, source_path: &str) -> Result<MotionFile, String> {
        match self {
            Self::Amass(folder) => in_amass(folder, source_path),
            Self::Cmu(files, trials) => in_cmu(files, trials, source_path),
        }
    }
}

/// Opens the parts of HumanML3D whose motion is there.
///
/// # Errors
/// Texts, lists or tables that cannot be read, with file and line; neither or both of `amass` and `motions`; no usable
/// motion at all.
pub fn open(config: &HumanMl3dConfig, base: &Path) -> Result<MotionFiles, CorpusError> {
    let folder = base.join(&config.path);
    let jsonl = folder.join("texts.jsonl");
    let parts = match jsonl.exists() {
        true => read_jsonl(&jsonl, config.mirror)?,
        false => read_folder(&folder)?,
    };
    let motions = Motions::open(config, base)?;
    let (mut lines, mut missing) = (Vec::new(), Vec::new());
    for part in &parts {
        match motions.find(&part.source_path) {
            Ok(file) => lines.extend(caption_lines(part, &file)),
            Err(reason) => missing.push(FailedItem {
                id: part.id.clone(),
                reason,
            }),
        }
    }
    for line in &mut lines {
        // Relative to the configuration, as processes with another current folder have it.
        if let Ok(relative) = Path::new(&line.file).strip_prefix(base) {
            line.file = relative.display().to_string();
        }
    }
    MotionFiles::from_lines(config.terms(), &folder, base.into(), lines, missing)
}

/// A line for the whole part, and one for each time that has sentences of its own.
fn caption_lines(part: &Part, file: &MotionFile) -> Vec<CaptionLine> {
    let second = |frame: i64| frame.max(0) as f64 / FRAME_RATE_HZ + file.lead_in_s;
    let start_s = second(part.start_frame);
    let end_s = (part.end_frame >= 0).then(|| second(part.end_frame));
    let mut lines: Vec<(f64, f64, CaptionLine)> = Vec::new();
    for sentence in &part.sentences {
        let range = (sentence.start, sentence.end);
        let is_whole = !(range.1 > range.0 && range.0 >= 0.0);
        let range = if is_whole { (0.0, 0.0) } else { range };
        if let Some((.., line)) = lines.iter_mut().find(|l| (l.0, l.1) == range) {
            line.captions.push(sentence.text.clone());
            continue;
        }
        let own_end_s = start_s + range.1;
        let line = CaptionLine {
            file: file.path.display().to_string(),
            captions: vec![sentence.text.clone()],
            id: Some(match is_whole {
                true => part.id.clone(),
                false => format!("{}@{}-{}", part.id, range.0, range.1),
            }),
            split: Some(part.split.clone()),
            // The official splits cut some recordings into parts of several splits.
            group: Some(part.id.trim_start_matches('M').into()),
            start_s: Some(start_s + range.0),
            end_s: match is_whole {
                true => end_s,
                false => Some(end_s.map_or(own_end_s, |end_s| end_s.min(own_end_s))),
            },
            fps: file.fps,
            skip_frames: file.skip_frames,
            mirror: part.is_mirrored,
            may_end_early: true,
            ..CaptionLine::default()
        };
        lines.push((range.0, range.1, line));
    }
    if lines.is_empty() {
        // A part without a sentence is named as such.
        let line = CaptionLine {
            file: file.path.display().to_string(),
            id: Some(part.id.clone()),
            ..CaptionLine::default()
        };
        lines.push((0.0, 0.0, line));
    }
    lines.into_iter().map(|(.., line)| line).collect()
}

fn read_jsonl(path: &Path, mirror: bool) -> Result<Vec<Part>, CorpusError> {
    let text = text_of(path)?;
    let mut parts = Vec::new();
    for (i, line) in text.lines().enumerate() {
        if line.trim().is_empty() {
            continue;
        }
        let part: Part =
            serde_json::from_str(line).map_err(|e| format_error(path, i + 1, e.to_string()))?;
        let mirrored = mirror.then(|| {
            let mut other = part.clone();
            other.id = format!("M{}", part.id);
            other.is_mirrored = true;
            for sentence in &mut other.sentences {
                sentence.text = swap_sides(&sentence.text);
            }
            other
        });
        parts.push(part);
        parts.extend(mirrored);
    }
    Ok(parts)
}

/// The data set's own folder.
fn read_folder(folder: &Path) -> Result<Vec<Part>, CorpusError> {
    let index = folder.join("index.csv");
    // Source path, first and last frame of every id.
    let mut sources: HashMap<String, (String, i64, i64)> = HashMap::new();
    for (i, line) in text_of(&index)?.lines().enumerate().skip(1) {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        let frames = |s: &str| s.parse::<i64>().ok();
        let row = match fields[..] {
            [source, start, end, name] => frames(start).zip(frames(end)).map(|(start, end)| {
                let id = name.trim_end_matches(".npy").to_string();
                (id, (source.to_string(), start, end))
            }),
            _ if line.trim().is_empty() => continue,
            _ => None,
        };
        let (id, source) = row.ok_or_else(|| {
            let expected = "expected `source_path,start_frame,end_frame,new_name`";
            format_error(&index, i + 1, expected.into())
        })?;
        sources.insert(id, source);
    }
    let mut parts = Vec::new();
    for split in Split::ALL {
        let list = folder.join(format!("{split}.txt"));
        for (i, id) in text_of(&list)?.lines().enumerate() {
            let id = id.trim();
            if id.is_empty() {
                continue;
            }
            let own = id.strip_prefix('M').unwrap_or(id);
            let Some((source_path, start_frame, end_frame)) = sources.get(own) else {
                let problem = format!("`{id}` is not in index.csv");
                return Err(format_error(&list, i + 1, problem));
            };
            let text = folder.join("texts").join(format!("{id}.txt"));
            let sentences = match text.exists() {
                true => read_humanml3d_text(&text)?,
                false => Vec::new(),
            };
            let sentence = |(text, [start, end]): (String, [f64; 2])| Sentence { text, start, end };
            parts.push(Part {
                id: id.into(),
                split: split.name().into(),
                source_path: source_path.clone(),
                start_frame: *start_frame,
                end_frame: *end_frame,
                sentences: sentences.into_iter().map(sentence).collect(),
                is_mirrored: id != own,
            });
        }
    }
    Ok(parts)
}

/// `./pose_data/CMU/60/60_01_poses.npy` is `CMU/60/60_01_poses.npz` of AMASS.
fn in_amass(amass: &Path, source_path: &str) -> Result<MotionFile, String> {
    let own = plain(source_path)?;
    if own.starts_with("humanact12/") {
        return Err("HumanAct12 is not part of AMASS".into());
    }
    let path = amass.join(own).with_extension("npz");
    if !path.is_file() {
        return Err(format!("no motion: {} is not there", path.display()));
    }
    let lead_in = LEAD_IN_S.iter().find(|(name, _)| own.starts_with(name));
    Ok(MotionFile {
        path,
        lead_in_s: lead_in.map_or(0.0, |(_, seconds)| *seconds),
        ..MotionFile::default()
    })
}

/// `./pose_data/CMU/60/60_01_poses.npy` is trial `60_01` of CMU.
fn in_cmu(
    files: &HashMap<String, PathBuf>,
    trials: &HashMap<String, (f64, usize)>,
    source_path: &str,
) -> Result<MotionFile, String> {
    let own = plain(source_path)?;
    let Some(name) = own.strip_prefix("CMU/") else {
        return Err("no motion: not from the CMU database".into());
    };
    let name = name.rsplit('/').next().unwrap_or(name);
    let trial = name.trim_end_matches(".npy").trim_end_matches("_poses");
    let Some(path) = files.get(trial) else {
        return Err(format!("no motion: no file of CMU's trial {trial}"));
    };
    let known = trials.get(trial);
    Ok(MotionFile {
        path: path.clone(),
        lead_in_s: 0.0,
        fps: known.map(|(fps, _)| *fps),
        skip_frames: known.map_or(0, |(_, skip)| *skip),
    })
}

/// The path below `pose_data`, which must stay below it.
fn plain(source_path: &str) -> Result<&str, String> {
    let own = source_path.trim_start_matches("./");
    let own = own.strip_prefix("pose_data/").unwrap_or(own);
    let is_plain = |part: &str| !part.is_empty() && part != ".." && !part.contains('\\');
    match own.split('/').all(is_plain) {
        true => Ok(own),
        false => Err(format!("`{source_path}` is no path of the data set")),
    }
}

/// Files of CMU's trials by their names. An AMC is preferred to a BVH.
fn cmu_files(folder: &Path) -> Result<HashMap<String, PathBuf>, CorpusError> {
    let mut found: HashMap<String, PathBuf> = HashMap::new();
    for path in files_below(folder)? {
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        let is_amc = extension.eq_ignore_ascii_case("amc");
        if !is_amc && !extension.eq_ignore_ascii_case("bvh") {
            continue;
        }
        let trial = path.file_stem().unwrap_or_default();
        let trial = trial.to_string_lossy().into_owned();
        if is_amc || !found.contains_key(&trial) {
            found.insert(trial, path);
        }
    }
    Ok(found)
}

/// Frame rate and number of lead-in poses of trials.
fn read_trials(path: &Path) -> Result<HashMap<String, (f64, usize)>, CorpusError> {
    let text = text_of(path)?;
    let mut lines = text.lines().enumerate();
    let names: Vec<&str> = lines.next().map_or("", |(_, l)| l).split(',').collect();
    let column = |name: &str| {
        let found = names.iter().position(|n| n.trim() == name);
        found.ok_or_else(|| format_error(path, 1, format!("no column `{name}`")))
    };
    let [trial, fps, skip] = [
        column("trial")?,
        column("true_fps")?,
        column("skip_first_frames")?,
    ];
    let mut trials = HashMap::new();
    for (i, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        let row = || {
            let name = (*fields.get(trial)?).to_string();
            let fps = fields.get(fps)?.parse().ok()?;
            Some((name, (fps, fields.get(skip)?.parse().ok()?)))
        };
        let (name, known) = row().ok_or_else(|| {
            let expected = "expected a name, a frame rate and a number of frames";
            format_error(path, i + 1, expected.into())
        })?;
        trials.insert(name, known);
    }
    Ok(trials)
}

fn format_error(path: &Path, line: usize, problem: String) -> CorpusError {
    CorpusError::Format {
        path: path.display().to_string(),
        line,
        problem,
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::corpus::Corpus;
    use crate::corpus::files::tests::bvh;

    fn config() -> HumanMl3dConfig {
        HumanMl3dConfig {
            path: "texts".into(),
            amass: None,
            motions: Some("cmu".into()),
            trials: Some("trials.csv".into()),
            mirror: true,
            licence: "own".into(),
            attribution: String::new(),
        }
    }

    fn folder(files: &[(&str, String)]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = dir.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        dir
    }

    /// The texts of three parts: of a trial that is there, of one that is not, and of another source.
    fn texts() -> String {
        let part = |id: &str, source: &str, [start, end]: [i32; 2], sentences: &str| {
            format!(
                r#"{{"id": "{id}", "split": "test", "source_path": "./pose_data/{source}_poses.npy", "cmu": "x", "start_frame": {start}, "end_frame": {end}, "sentences": [{sentences}]}}"#
            )
        };
        [
            part(
                "1",
                "CMU/07/07_01",
                [20, 100],
                r#"{"text": "a man turns to his left"}, {"text": "he steps", "start": 1.0, "end": 3.5}, {"text": "someone turns"}"#,
            ),
            part("2", "CMU/08/08_01", [0, -1], r#"{"text": "a person waves"}"#),
            part("3", "KIT/3/kick", [0, 40], r#"{"text": "a person kicks"}"#),
        ]
        .join("\n")
    }

    const TRIALS: &str = "trial,file,kind,true_fps,skip_first_frames\n07_01,a,bvh,20,1\n";

    #[test]
    fn parts_of_cmu_trials_are_cut_with_their_sentences_and_mirrored() {
        // 6.1 s at the true rate, and one lead-in frame.
        let dir = folder(&[
            ("texts/texts.jsonl", texts()),
            ("trials.csv", TRIALS.into()),
            ("cmu/bvh/07/07_01.bvh", bvh(122, 5.0)),
        ]);
        let corpus = open(&config(), dir.path()).unwrap();
        let items: Vec<(&str, Vec<&str>)> = corpus
            .items()
            .iter()
            .map(|i| {
                (
                    i.motion_id.as_str(),
                    i.captions.iter().map(String::as_str).collect(),
                )
            })
            .collect();
        let expected = [
            ("1", vec!["a man turns to his left", "someone turns"]),
            ("1@1-3.5", vec!["he steps"]),
            ("M1", vec!["a man turns to his right", "someone turns"]),
            ("M1@1-3.5", vec!["he steps"]),
        ];
        assert_eq!(items, expected);
        assert!(corpus.items().iter().all(|i| i.split == Split::Test));
        let groups: Vec<&str> = corpus.items().iter().map(|i| i.group.as_str()).collect();
        assert!(groups.iter().all(|g| *g == groups[0]));
        // From 1 s to 5 s, and from 2 s to 4.5 s.
        let seconds: Vec<f64> = (0..2)
            .map(|i| corpus.motion(i).unwrap().duration_s())
            .collect();
        assert!(
            (seconds[0] - 4.0).abs() < 0.06 && (seconds[1] - 2.5).abs() < 0.06,
            "{seconds:?}"
        );
        let [own, mirrored] = [0, 2].map(|i| corpus.motion(i).unwrap());
        let reflected = radarllm_body::sample::mirror(&own);
        let roots = reflected.poses.iter().zip(&mirrored.poses);
        assert!(roots.len() == 80 || roots.len() == 81);
        for (one, other) in roots {
            assert!(one.root_in_world.distance(other.root_in_world) < 1e-4);
        }
        let skipped: Vec<(&str, &str)> = corpus
            .skipped()
            .iter()
            .map(|s| (s.id.as_str(), s.reason.as_str()))
            .collect();
        for (id, word) in [
            ("2", "trial 08_01"),
            ("M2", "trial 08_01"),
            ("3", "not from the CMU"),
        ] {
            assert!(
                skipped.iter().any(|s| s.0 == id && s.1.contains(word)),
                "{skipped:?}"
            );
        }
        assert_eq!(corpus.name(), "humanml3d");
    }

    #[test]
    fn all_of_the_data_set_is_read_from_its_own_folder() {
        let index = "source_path,start_frame,end_frame,new_name\n\
            ./pose_data/CMU/07/07_01_poses.npy,0,80,000001.npy\n\
            ./pose_data/humanact12/humanact12/P01.npy,0,-1,000002.npy\n";
        let files = |list: &str| {
            vec![
                ("texts/index.csv", index.to_string()),
                ("texts/train.txt", list.to_string()),
                ("texts/val.txt", String::new()),
                ("texts/test.txt", "000002\n".into()),
                (
                    "texts/texts/000001.txt",
                    "a man steps left#x#0.0#0.0\n".into(),
                ),
                (
                    "texts/texts/M000001.txt",
                    "a man steps right#x#0.0#nan\n".into(),
                ),
                ("texts/texts/000002.txt", "a man bows#x#0.0#0.0\n".into()),
                // Not an archive: the loader decides by content.
                ("amass/CMU/07/07_01_poses.npz", bvh(60, 5.0)),
            ]
        };
        let config = HumanMl3dConfig {
            amass: Some("amass".into()),
            motions: None,
            trials: None,
            ..config()
        };
        let dir = folder(&files("000001\nM000001\n"));
        let corpus = open(&config, dir.path()).unwrap();
        let items: Vec<(&str, &str)> = corpus
            .items()
            .iter()
            .map(|i| (i.motion_id.as_str(), i.captions[0].as_str()))
            .collect();
        assert_eq!(
            items,
            [
                ("000001", "a man steps left"),
                ("M000001", "a man steps right")
            ]
        );
        assert!(corpus.skipped()[0].reason.contains("HumanAct12"));

        let dir = folder(&files("000009\n"));
        let error = open(&config, dir.path()).err().unwrap().to_string();
        assert!(
            error.contains("train.txt:1: `000009` is not in index.csv"),
            "{error}"
        );
    }

    #[test]
    fn what_is_wrong_is_named() {
        let error = |config: &HumanMl3dConfig, files: &[(&str, String)]| {
            let dir = folder(files);
            open(config, dir.path()).err().unwrap().to_string()
        };
        let text = ("texts/texts.jsonl", texts());
        let motion = ("cmu/07_01.bvh", bvh(122, 5.0));
        let both = HumanMl3dConfig {
            amass: Some("amass".into()),
            ..config()
        };
        let found = error(&both, std::slice::from_ref(&text));
        assert!(found.contains("either `amass` or `motions`"), "{found}");
        for (table, word) in [
            ("a,b\n", "no column `trial`"),
            ("trial,true_fps,skip_first_frames\n1,x,0\n", "trials.csv:2"),
        ] {
            let found = error(
                &config(),
                &[text.clone(), motion.clone(), ("trials.csv", table.into())],
            );
            assert!(found.contains(word), "{found}");
        }
        let broken = ("texts/texts.jsonl", "{\"id\": 1}".to_string());
        let found = error(&config(), &[broken, motion, ("trials.csv", TRIALS.into())]);
        assert!(found.contains("texts.jsonl:1"), "{found}");
        for path in ["./pose_data/../../x.npy", "/etc/passwd", "a\\..\\b"] {
            assert!(plain(path).is_err(), "{path}");
        }
    }
}
