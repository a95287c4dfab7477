//! What `baselines render` writes for video language models, and what they answer.

use std::{
    io::{BufRead, BufReader, Read},
    path::{Component, Path, PathBuf},
};

use radarllm_dataset::Dataset;
use radarllm_files::bounded::{self as files, MAX_CONFIG_BYTES};
use radarllm_render::avi;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use crate::{
    commands::eval::captions::split,
    error::{CliError, CliResult},
};

/// Prompts, one line for each clip.
pub(super) const PROMPTS_FILE: &str = "prompts.jsonl";
/// How the videos were made; written last, so that a folder without it is not finished.
pub(super) const RENDER_FILE: &str = "render.json";
/// Maximum size of a file of prompts or answers, bytes.
const MAX_LINES_BYTES: u64 = 256 << 20;
/// Maximum length of a line of such a file, bytes: models say paragraphs.
const MAX_LINE_BYTES: u64 = 1 << 20;
/// Maximum number of lines: more clips than any split has.
const MAX_LINES: usize = 1_000_000;
/// Maximum number of frames in a folder of PNG files: ten minutes.
const MAX_FRAMES: usize = 12_000;

/// A line of [`PROMPTS_FILE`].
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Prompt {
    /// The clip.
    pub id: String,
    /// Name of the video in the folder: a file, or a folder of frames.
    pub video: String,
    /// What to ask.
    pub prompt: String,
    /// BLAKE3 of the video, lower-case hex; of frames, that of their bytes one after the other.
    pub blake3: String,
}

/// [`RENDER_FILE`].
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Render {
    /// Name of the data set.
    pub data: String,
    /// Seed of the data set.
    pub seed: u64,
    /// Split.
    pub split: String,
    /// Whose motions are shown: `true` or `estimated`.
    pub bodies: String,
    /// BLAKE3 of the weights of the pose network that estimated them.
    pub pose_blake3: Option<String>,
    /// Place of the camera.
    pub camera: String,
    /// Kind of the videos: `avi` or `png`.
    pub frames: FrameKind,
    /// Pixels of a side.
    pub size: usize,
    /// Frames per second.
    pub fps: u32,
    /// What is asked about each video.
    pub prompt: String,
    /// Number of videos.
    pub count: usize,
    /// BLAKE3 of [`PROMPTS_FILE`].
    pub prompts_blake3: String,
}

/// Kind of the videos.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub(crate) enum FrameKind {
    /// A file of Motion JPEG for each clip.
    Avi,
    /// A folder of PNG files for each clip, without loss.
    Png,
}

/// An answer of a video language model, one line for each clip.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Answer {
    /// The clip.
    pub id: String,
    /// What the model said, whole.
    pub text: String,
    /// BLAKE3 of the video that it saw.
    pub blake3: String,
    /// Name of the model.
    pub model: String,
    /// Which weights.
    pub weights: String,
    /// Commit of its code.
    pub commit: String,
}

/// A folder that `baselines render` finished.
#[derive(Debug)]
pub(super) struct Renders {
    folder: PathBuf,
    /// How the videos were made.
    pub render: Render,
    /// BLAKE3 of [`RENDER_FILE`], which stands for the whole folder because that file has the hash of the prompts and
    /// these have those of the videos.
    pub blake3: String,
    /// Not empty.
    pub prompts: Vec<Prompt>,
}

impl Renders {
    /// Opens a folder and checks it: the hash of the prompts, their number, and that no clip occurs twice.
    pub(super) fn open(folder: &Path) -> CliResult<Self> {
        let path = folder.join(RENDER_FILE);
        let text = files::read_text(&path, MAX_CONFIG_BYTES).map_err(|e| {
            CliError::from(e).hint("give a folder that `radarllm baselines render` finished")
        })?;
        let render: Render = serde_json::from_str(&text)
            .map_err(|e| CliError::new(format!("{}: {e}", path.display())))?;
        let prompts_path = folder.join(PROMPTS_FILE);
        let bytes = files::read_bytes(&prompts_path, MAX_LINES_BYTES)?;
        let hash = hash_of(&bytes);
        if hash != render.prompts_blake3 {
            return Err(CliError::new(format!(
                "{}: its BLAKE3 is {hash}, and {} states {}",
                prompts_path.display(),
                path.display(),
                render.prompts_blake3
            )));
        }
        let lines: Vec<(usize, Prompt)> = json_lines(&prompts_path, bytes.as_slice())?;
        if lines.len() != render.count || lines.is_empty() {
            return Err(CliError::new(format!(
                "{}: {} prompts, and {} states {}",
                prompts_path.display(),
                lines.len(),
                path.display(),
                render.count
            )));
        }
        let prompts: Vec<Prompt> = lines.into_iter().map(|(_, prompt)| prompt).collect();
        let mut ids: Vec<&str> = prompts.iter().map(|p| p.id.as_str()).collect();
        ids.sort_unstable();
        if let Some(pair) = ids.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(CliError::new(format!(
                "{}: clip `{}` has two prompts",
                prompts_path.display(),
                pair[0]
            )));
        }
        Ok(Self {
            folder: folder.into(),
            blake3: hash_of(text.as_bytes()),
            render,
            prompts,
        })
    }

    /// Path of the file of prompts, for errors.
    pub(super) fn prompts_path(&self) -> PathBuf {
        self.folder.join(PROMPTS_FILE)
    }

    /// Checks that the videos are of this data set.
    pub(super) fn check_data(&self, folder: &Path) -> CliResult {
        let data = Dataset::open(folder)?;
        let manifest = data.manifest();
        let (found, stated) = (
            format!("data set `{}` with seed {}", manifest.name, manifest.seed),
            format!(
                "data set `{}` with seed {}",
                self.render.data, self.render.seed
            ),
        );
        if found != stated {
            return Err(CliError::new(format!(
                "{} is {found}, and the videos of {} are of {stated}",
                folder.display(),
                self.folder.display()
            )));
        }
        let mut ids: Vec<&str> = data
            .shards(split(&self.render.split)?)
            .flat_map(|shard| shard.ids.iter().map(String::as_str))
            .collect();
        ids.sort_unstable();
        let is_unknown = |prompt: &&Prompt| ids.binary_search(&prompt.id.as_str()).is_err();
        match self.prompts.iter().find(is_unknown) {
            Some(prompt) => Err(CliError::new(format!(
                "{}: clip `{}` is not in split `{}` of {}",
                self.prompts_path().display(),
                prompt.id,
                self.render.split,
                folder.display()
            ))),
            None => Ok(()),
        }
    }

    /// The frames of a video, each a JPEG or PNG file, after its hash has been compared.
    pub(super) fn frames_of(&self, prompt: &Prompt) -> CliResult<Vec<Vec<u8>>> {
        let mut parts = Path::new(&prompt.video).components();
        let (Some(Component::Normal(_)), None) = (parts.next(), parts.next()) else {
            return Err(CliError::new(format!(
                "{}: clip `{}`: the video `{}` is not a name in its folder",
                self.prompts_path().display(),
                prompt.id,
                prompt.video
            )));
        };
        let path = self.folder.join(&prompt.video);
        let max_bytes = avi::MAX_BYTES as u64;
        let (frames, hash) = match self.render.frames {
            FrameKind::Avi => {
                let file = files::read_bytes(&path, max_bytes)?;
                let frames = avi::frames(&file)
                    .map_err(|e| CliError::new(format!("{}: {e}", path.display())))?;
                (
                    frames.into_iter().map(<[u8]>::to_vec).collect(),
                    hash_of(&file),
                )
            }
            FrameKind::Png => {
                let mut frames = Vec::new();
                let mut left = max_bytes;
                loop {
                    let frame = path.join(frame_name(frames.len()));
                    if !frame.is_file() || frames.len() == MAX_FRAMES {
                        break;
                    }
                    let bytes = files::read_bytes(&frame, left)?;
                    left = left.saturating_sub(bytes.len() as u64);
                    frames.push(bytes);
                }
                let hash = hash_of_all(&frames);
                (frames, hash)
            }
        };
        if hash != prompt.blake3 {
            return Err(CliError::new(format!(
                "{}: its BLAKE3 is {hash}, and {} states {} for clip `{}`",
                path.display(),
                self.prompts_path().display(),
                prompt.blake3,
                prompt.id
            )));
        }
        match frames.is_empty() {
            true => Err(CliError::new(format!("{}: no frames", path.display()))),
            false => Ok(frames),
        }
    }
}

/// Name of a frame in its folder.
pub(super) fn frame_name(index: usize) -> String {
    format!("{index:05}.png")
}

/// BLAKE3, lower-case hex.
pub(super) fn hash_of(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// BLAKE3 of parts, one after the other.
pub(super) fn hash_of_all(parts: &[Vec<u8>]) -> String {
    let mut hasher = blake3::Hasher::new();
    parts.iter().for_each(|part| {
        hasher.update(part);
    });
    hasher.finalize().to_hex().to_string()
}

/// A name that every file system takes, for a text from outside: other characters than ASCII letters, digits, `.`, `_` and
/// `-` become `_`. Different texts may become the same name.
pub(super) fn file_name_of(text: &str) -> String {
    // With a number and an extension, well below the 255 bytes of file systems.
    const MAX_CHARS: usize = 80;
    let plain = |c: char| match c {
        'a'..='z' | 'A'..='Z' | '0'..='9' | '.' | '_' | '-' => c,
        _ => '_',
    };
    text.chars().map(plain).take(MAX_CHARS).collect()
}

/// Answers of a file with their line numbers, from 1.
pub(super) fn read_answers(path: &Path) -> CliResult<Vec<(usize, Answer)>> {
    let hint =
        r#"expected {"id", "text", "blake3", "model", "weights", "commit"}, one answer a line"#;
    let file = files::open(path)?.take(MAX_LINES_BYTES + 1);
    json_lines(path, file).map_err(|e| e.hint(hint))
}

/// JSON objects, one a line, with their line numbers from 1. Blank lines are skipped.
fn json_lines<T: DeserializeOwned>(path: &Path, from: impl Read) -> CliResult<Vec<(usize, T)>> {
    let mut from = BufReader::new(from);
    let (mut found, mut line, mut total) = (Vec::new(), Vec::new(), 0_u64);
    for number in 1_usize.. {
        line.clear();
        let n = (&mut from)
            .take(MAX_LINE_BYTES + 1)
            .read_until(b'\n', &mut line)
            .map_err(|e| CliError::io(path, e))? as u64;
        if n == 0 {
            break;
        }
        total += n;
        let fail = |problem: String| {
            Err(CliError::new(format!(
                "{}, line {number}: {problem}",
                path.display()
            )))
        };
        if n > MAX_LINE_BYTES {
            return fail(format!("longer than {MAX_LINE_BYTES} bytes"));
        }
        if total > MAX_LINES_BYTES || found.len() == MAX_LINES {
            return fail(format!(
                "more than the {MAX_LINES_BYTES} bytes or {MAX_LINES} lines that are read"
            ));
        }
        match std::str::from_utf8(&line) {
            Ok(text) if text.trim().is_empty() => {}
            Ok(text) => match serde_json::from_str(text) {
                Ok(item) => found.push((number, item)),
                Err(e) => return fail(e.to_string()),
            },
            Err(e) => return fail(format!("not UTF-8 after {} bytes", e.valid_up_to())),
        }
    }
    Ok(found)
}
