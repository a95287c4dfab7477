//! Checkpoints: directories of JSON and safetensors files that are written atomically.
//!
//! | file | holds | needed for |
//! |---|---|---|
//! | `config.json` | architecture and configuration | inference |
//! | `model.safetensors` | weights, `module.path.weight` names, f32, or bytes with a scale for each row | inference |
//! | `train_state.json`, `optimizer.safetensors`, ... | step, moments, code statistics | resuming |
//! | `checksums.json` | size and BLAKE3 of every other file | opening |
//!
//! A checkpoint is first written to a sibling directory. Every file is synced, then one rename gives the directory its
//! final name. A process that is killed at any moment leaves either the old checkpoint or the new one. Opening verifies
//! every checksum. Loading checks names, shapes and types, and that every value is finite.

#![allow(
    clippy::disallowed_methods,
    reason = "checkpoints are files; weights are too large to be read at once"
)]

use std::collections::BTreeMap;
use std::fs;
use std::io::{Cursor, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use half::{bf16, f16};
use radarllm_engine::EngineError;
pub use radarllm_engine::{HostTensor, NamedTensors};
use radarllm_files::atomic::sync_folder;
use safetensors::tensor::{Dtype, Metadata, TensorView};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Name of the configuration file.
pub const CONFIG_FILE: &str = "config.json";
/// Name of the weights file.
pub const MODEL_FILE: &str = "model.safetensors";
/// Name of the checksum file.
pub const CHECKSUM_FILE: &str = "checksums.json";
/// End of the name of a checkpoint that is being written.
pub const UNFINISHED_SUFFIX: &str = ".tmp";
/// End of the name of a checkpoint while a new one takes its place.
pub const REPLACED_SUFFIX: &str = ".old";

/// Maximum size of a JSON or other small file, in bytes: far above any tokenizer vocabulary.
const MAX_SMALL_FILE_BYTES: u64 = 64 << 20;
/// Maximum size of a weights file, in bytes.
const MAX_TENSOR_FILE_BYTES: u64 = 16 << 30;

/// Maximum length of a safetensors header, in bytes: the format's own limit.
const MAX_HEADER_BYTES: u64 = 100_000_000;
/// Number of bytes of a file read at a time.
const PIECE_BYTES: usize = 1 << 16;

/// Reasons why a checkpoint cannot be written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// The file system reported an error.
    #[error("{path}: {source}")]
    Io {
        /// File or directory.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The directory contains no checkpoint.
    #[error("{path}: not a checkpoint: no {CHECKSUM_FILE}")]
    NotACheckpoint {
        /// Directory.
        path: PathBuf,
    },
    /// A file is larger than the limit.
    #[error("{path}: {found} bytes, at most {limit} are read")]
    TooLarge {
        /// File.
        path: PathBuf,
        /// Size found, in bytes.
        found: u64,
        /// Limit, in bytes.
        limit: u64,
    },
    /// The content differs from what was written.
    #[error("{path}: damaged: checksum or size differs from {CHECKSUM_FILE}")]
    Checksum {
        /// File.
        path: PathBuf,
    },
    /// A required file is not listed.
    #[error("{path}: missing from the checkpoint")]
    MissingFile {
        /// File.
        path: PathBuf,
    },
    /// The file is not valid JSON, or does not have the expected structure.
    #[error("{path}: {message}")]
    Json {
        /// File.
        path: PathBuf,
        /// Line, column and cause.
        message: String,
    },
    /// The file is not a valid safetensors file.
    #[error("{path}: {message}")]
    Safetensors {
        /// File.
        path: PathBuf,
        /// Cause.
        message: String,
    },
    /// The element type is not supported.
    #[error("{path}: tensor `{tensor}`: type {found}, expected F32, F16, BF16 or I8")]
    Dtype {
        /// File.
        path: PathBuf,
        /// Tensor.
        tensor: String,
        /// Type found.
        found: String,
    },
    /// The shape differs from that of the model.
    #[error("{path}: tensor `{tensor}`: shape {found:?}, expected {expected:?}")]
    Shape {
        /// File.
        path: PathBuf,
        /// Tensor.
        tensor: String,
        /// Expected shape.
        expected: Vec<usize>,
        /// Shape found.
        found: Vec<usize>,
    },
    /// A value is NaN or infinite.
    #[error("{path}: tensor `{tensor}`: value {index} is not finite")]
    NotFinite {
        /// File.
        path: PathBuf,
        /// Tensor.
        tensor: String,
        /// Index of the first such value.
        index: usize,
    },
    /// The file lacks a tensor that the model needs.
    #[error("{path}: tensor `{tensor}` of shape {expected:?} is missing")]
    MissingTensor {
        /// File.
        path: PathBuf,
        /// Tensor.
        tensor: String,
        /// Expected shape.
        expected: Vec<usize>,
    },
    /// The file has a tensor that the model does not have.
    #[error("{path}: tensor `{tensor}` is not part of this model")]
    UnknownTensor {
        /// File.
        path: PathBuf,
        /// Tensor.
        tensor: String,
    },
    /// A value of the configuration is invalid.
    #[error("{path}: {message}")]
    Config {
        /// File.
        path: PathBuf,
        /// Field and cause.
        message: String,
    },
}

impl CheckpointError {
    /// An error of the engine about weights, with the file that contains them.
    pub fn from_engine(error: EngineError, path: &Path) -> Self {
        let path = path.to_path_buf();
        match error {
            EngineError::MissingWeight { name, expected } => Self::MissingTensor {
                path,
                tensor: name,
                expected,
            },
            EngineError::WeightShape {
                name,
                expected,
                found,
                ..
            } => Self::Shape {
                path,
                tensor: name,
                expected,
                found,
            },
            EngineError::NotFinite { name, index } => Self::NotFinite {
                path,
                tensor: name,
                index,
            },
            EngineError::UnknownWeight { name } => Self::UnknownTensor { path, tensor: name },
            other => Self::Config {
                path,
                message: other.to_string(),
            },
        }
    }
}

fn io_error(path: &Path) -> impl FnOnce(std::io::Error) -> CheckpointError {
    let path = path.to_path_buf();
    move |source| CheckpointError::Io { path, source }
}

#[derive(Serialize, Deserialize)]
struct FileSum {
    bytes: u64,
    blake3: String,
}

/// Files of a checkpoint that is to be written.
#[derive(Default)]
pub struct CheckpointFiles {
    files: BTreeMap<String, Vec<u8>>,
}

impl CheckpointFiles {
    /// Adds a JSON document.
    ///
    /// # Errors
    /// If the value cannot be serialized as JSON.
    pub fn json<T: Serialize>(&mut self, file: &str, value: &T) -> Result<(), CheckpointError> {
        let bytes = serde_json::to_vec_pretty(value).map_err(|e| CheckpointError::Json {
            path: file.into(),
            message: e.to_string(),
        })?;
        self.bytes(file, bytes);
        Ok(())
    }

    /// Adds named arrays as a safetensors file (f32).
    ///
    /// # Errors
    /// If the shape of an array does not match its number of values.
    pub fn tensors(&mut self, file: &str, tensors: &NamedTensors) -> Result<(), CheckpointError> {
        let bytes = encode_safetensors(Path::new(file), tensors)?;
        self.bytes(file, bytes);
        Ok(())
    }

    /// Adds named arrays as a safetensors file of a quarter of the size: matrices as signed bytes with a scale for each row,
    /// `NAME.scale`, which rounds a value by at most 1/254 of the largest of its row; everything else as f32.
    ///
    /// # Errors
    /// If the shape of an array does not match its number of values.
    pub fn tensors_as_bytes(
        &mut self,
        file: &str,
        tensors: &NamedTensors,
    ) -> Result<(), CheckpointError> {
        let bytes = encode_as_bytes(Path::new(file), tensors)?;
        self.bytes(file, bytes);
        Ok(())
    }

    /// Adds a file unchanged. `file` must be a plain name.
    pub fn bytes(&mut self, file: &str, bytes: Vec<u8>) {
        self.files.insert(file.to_string(), bytes);
    }

    /// Writes the checkpoint to `dir` atomically, replacing any existing content.
    ///
    /// # Errors
    /// If the file system reports an error; `dir` is then unchanged, and the files that were written are removed.
    pub fn write(&self, dir: &Path) -> Result<(), CheckpointError> {
        let parent = parent_of(dir);
        fs::create_dir_all(parent).map_err(io_error(parent))?;
        let staging = sibling(dir, UNFINISHED_SUFFIX);
        let written = self
            .write_staging(&staging)
            .and_then(|()| replace(dir, &staging));
        if written.is_err() {
            // Best effort: the first error is the one to report.
            let _ = fs::remove_dir_all(&staging);
        }
        written
    }

    fn write_staging(&self, staging: &Path) -> Result<(), CheckpointError> {
        remove_dir(staging)?;
        fs::create_dir(staging).map_err(io_error(staging))?;
        let mut sums = BTreeMap::new();
        for (name, bytes) in &self.files {
            let sum = FileSum {
                bytes: bytes.len() as u64,
                blake3: blake3::hash(bytes).to_hex().to_string(),
            };
            sums.insert(name.clone(), sum);
            write_synced(&staging.join(name), bytes)?;
        }
        let listing = serde_json::to_vec_pretty(&sums).map_err(|e| CheckpointError::Json {
            path: CHECKSUM_FILE.into(),
            message: e.to_string(),
        })?;
        write_synced(&staging.join(CHECKSUM_FILE), &listing)?;
        sync_folder(staging).map_err(io_error(staging))
    }
}

/// Gives a complete checkpoint its name.
fn replace(dir: &Path, staging: &Path) -> Result<(), CheckpointError> {
    // A directory cannot be renamed over a directory that is not empty, so the old checkpoint is renamed first.
    // `Checkpoint::open` finds it under that name if the process dies between the two renames.
    let aside = sibling(dir, REPLACED_SUFFIX);
    if dir.exists() {
        remove_dir(&aside)?;
        fs::rename(dir, &aside).map_err(io_error(dir))?;
    }
    fs::rename(staging, dir).map_err(io_error(dir))?;
    let parent = parent_of(dir);
    sync_folder(parent).map_err(io_error(parent))?;
    remove_dir(&aside)
}

/// Removes a checkpoint. It is first renamed to one that is being written, so that a process that is killed at any moment
/// leaves no incomplete checkpoint under its name.
///
/// # Errors
/// If the file system reports an error.
pub fn remove_checkpoint(dir: &Path) -> Result<(), CheckpointError> {
    let unfinished = sibling(dir, UNFINISHED_SUFFIX);
    remove_dir(&unfinished)?;
    fs::rename(dir, &unfinished).map_err(io_error(dir))?;
    let parent = parent_of(dir);
    sync_folder(parent).map_err(io_error(parent))?;
    remove_dir(&unfinished)
}

fn parent_of(dir: &Path) -> &Path {
    match dir.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

fn sibling(dir: &Path, suffix: &str) -> PathBuf {
    let mut name = dir.file_name().unwrap_or_default().to_os_string();
    name.push(suffix);
    dir.with_file_name(name)
}

fn remove_dir(dir: &Path) -> Result<(), CheckpointError> {
    match fs::remove_dir_all(dir) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(io_error(dir)(e)),
        _ => Ok(()),
    }
}

fn write_synced(path: &Path, bytes: &[u8]) -> Result<(), CheckpointError> {
    let mut file = fs::File::create(path).map_err(io_error(path))?;
    file.write_all(bytes).map_err(io_error(path))?;
    file.sync_all().map_err(io_error(path))
}

/// Calls `visit` with path and contents of every plain file in a directory, in order of their names, whatever its
/// checksums say.
///
/// # Errors
/// If the directory or a file cannot be read.
pub fn visit_files(
    dir: &Path,
    visit: &mut impl FnMut(&Path, &[u8]),
) -> Result<(), CheckpointError> {
    let entries = fs::read_dir(dir).map_err(io_error(dir))?;
    let mut paths = entries
        .map(|entry| entry.map(|e| e.path()))
        .collect::<Result<Vec<_>, _>>()
        .map_err(io_error(dir))?;
    paths.retain(|path| path.is_file());
    paths.sort();
    for path in paths {
        let bytes = fs::read(&path).map_err(io_error(&path))?;
        visit(&path, &bytes);
    }
    Ok(())
}

/// An opened checkpoint: a directory whose checksums were verified, or files embedded in the program.
#[derive(Debug)]
pub struct Checkpoint {
    dir: PathBuf,
    files: Files,
}

#[derive(Debug)]
enum Files {
    /// Names.
    Directory(Vec<String>),
    /// Names and contents.
    Carried(BTreeMap<String, &'static [u8]>),
}

/// Source of the weights.
trait Input: Read + Seek {}
impl<T: Read + Seek> Input for T {}

impl Checkpoint {
    /// Opens a checkpoint and verifies the checksum of every file.
    ///
    /// # Errors
    /// If `dir` contains no checkpoint or a damaged one.
    pub fn open(dir: &Path) -> Result<Self, CheckpointError> {
        let mut dir = dir.to_path_buf();
        let aside = sibling(&dir, REPLACED_SUFFIX);
        if !dir.exists() && aside.exists() {
            dir = aside;
        }
        let listing_path = dir.join(CHECKSUM_FILE);
        if !listing_path.is_file() {
            return Err(CheckpointError::NotACheckpoint { path: dir });
        }
        let sums: BTreeMap<String, FileSum> = parse_json(
            &listing_path,
            &read_limited(&listing_path, MAX_SMALL_FILE_BYTES)?,
        )?;
        for (name, sum) in &sums {
            let path = dir.join(name);
            let plain = Path::new(name)
                .file_name()
                .is_some_and(|f| f == name.as_str());
            if !plain {
                return Err(CheckpointError::Json {
                    path: listing_path,
                    message: format!("`{name}` is not a plain file name"),
                });
            }
            if !path.is_file() {
                return Err(CheckpointError::MissingFile { path });
            }
            let found = fs::metadata(&path).map_err(io_error(&path))?.len();
            if found != sum.bytes {
                return Err(CheckpointError::Checksum { path });
            }
            if hash_of(&path)?.to_hex().as_str() != sum.blake3 {
                return Err(CheckpointError::Checksum { path });
            }
        }
        Ok(Self {
            dir,
            files: Files::Directory(sums.into_keys().collect()),
        })
    }

    /// Creates a checkpoint from files that are embedded in the program. They are read from where the system has mapped
    /// them, and are not verified by checksums. Errors name them as files of `dir`.
    pub fn carried(dir: &Path, files: impl IntoIterator<Item = (String, &'static [u8])>) -> Self {
        Self {
            dir: dir.into(),
            files: Files::Carried(files.into_iter().collect()),
        }
    }

    /// Directory of the files; for embedded files, the name used in errors.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Returns true if the checkpoint has this file.
    pub fn has(&self, file: &str) -> bool {
        match &self.files {
            Files::Directory(names) => names.iter().any(|f| f == file),
            Files::Carried(files) => files.contains_key(file),
        }
    }

    /// Names of the files, without that of the checksums.
    pub fn names(&self) -> Vec<&str> {
        match &self.files {
            Files::Directory(names) => names.iter().map(String::as_str).collect(),
            Files::Carried(files) => files.keys().map(String::as_str).collect(),
        }
    }

    fn path(&self, file: &str) -> Result<PathBuf, CheckpointError> {
        let path = self.dir.join(file);
        if self.has(file) {
            Ok(path)
        } else {
            Err(CheckpointError::MissingFile { path })
        }
    }

    fn carried_file(&self, file: &str) -> Option<&'static [u8]> {
        match &self.files {
            Files::Directory(_) => None,
            Files::Carried(files) => files.get(file).copied(),
        }
    }

    /// Reads a JSON document.
    ///
    /// # Errors
    /// If the file is missing or cannot be parsed as a `T`.
    pub fn json<T: DeserializeOwned>(&self, file: &str) -> Result<T, CheckpointError> {
        parse_json(&self.path(file)?, &self.bytes(file)?)
    }

    /// Reads a small file as bytes.
    ///
    /// # Errors
    /// If the file is missing or too large.
    pub fn bytes(&self, file: &str) -> Result<Vec<u8>, CheckpointError> {
        let path = self.path(file)?;
        match self.carried_file(file) {
            Some(bytes) => Ok(bytes.to_vec()),
            None => read_limited(&path, MAX_SMALL_FILE_BYTES),
        }
    }

    /// Reads named arrays.
    ///
    /// # Errors
    /// See [`read_safetensors`].
    pub fn tensors(&self, file: &str) -> Result<NamedTensors, CheckpointError> {
        let path = self.path(file)?;
        match self.carried_file(file) {
            Some(bytes) => arrays_of(&path, &mut Cursor::new(bytes), bytes.len() as u64, false),
            None => read_safetensors(&path),
        }
    }

    /// Reads a model's `config.json`: it must parse, be of the expected kind and pass validation.
    ///
    /// # Errors
    /// If it cannot be read, is of another kind, or `validate` refuses it.
    pub fn config<T: DeserializeOwned>(
        &self,
        expected_kind: &str,
        kind: impl Fn(&T) -> &str,
        validate: impl Fn(&T) -> Result<(), String>,
    ) -> Result<T, CheckpointError> {
        let config: T = self.json(CONFIG_FILE)?;
        let checked = match kind(&config) {
            found if found != expected_kind => {
                Err(format!("kind is `{found}`, expected `{expected_kind}`"))
            }
            _ => validate(&config),
        };
        match checked {
            Ok(()) => Ok(config),
            Err(message) => Err(CheckpointError::Config {
                path: self.dir().join(CONFIG_FILE),
                message,
            }),
        }
    }
}

/// Computes the hash of a file in blocks, because weights files are large and are read again later.
fn hash_of(path: &Path) -> Result<blake3::Hash, CheckpointError> {
    let mut file = fs::File::open(path).map_err(io_error(path))?;
    let mut hasher = blake3::Hasher::new();
    let mut piece = vec![0; PIECE_BYTES];
    loop {
        match file.read(&mut piece) {
            Ok(0) => return Ok(hasher.finalize()),
            Ok(n) => {
                hasher.update(&piece[..n]);
            }
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(io_error(path)(e)),
        }
    }
}

fn read_limited(path: &Path, limit: u64) -> Result<Vec<u8>, CheckpointError> {
    let found = fs::metadata(path).map_err(io_error(path))?.len();
    if found > limit {
        return Err(CheckpointError::TooLarge {
            path: path.into(),
            found,
            limit,
        });
    }
    fs::read(path).map_err(io_error(path))
}

fn parse_json<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T, CheckpointError> {
    serde_json::from_slice(bytes).map_err(|e| CheckpointError::Json {
        path: path.into(),
        message: e.to_string(),
    })
}

/// Type, shape and bytes of an array of a file.
type Stored = (Dtype, Vec<usize>, Vec<u8>);

fn encode_safetensors(path: &Path, tensors: &NamedTensors) -> Result<Vec<u8>, CheckpointError> {
    let stored = tensors.iter().map(|(name, tensor)| {
        let stored = as_floats(&tensor.shape, &tensor.values);
        (name.clone(), stored)
    });
    encode(path, stored.collect())
}

fn encode_as_bytes(path: &Path, tensors: &NamedTensors) -> Result<Vec<u8>, CheckpointError> {
    let mut stored = BTreeMap::new();
    for (name, tensor) in tensors {
        let [n_rows, width] = tensor.shape[..] else {
            stored.insert(name.clone(), as_floats(&tensor.shape, &tensor.values));
            continue;
        };
        let (mut bytes, mut scales) = (Vec::with_capacity(tensor.values.len()), Vec::new());
        for row in tensor.values.chunks(width.max(1)) {
            let largest = row.iter().fold(0.0_f32, |largest, v| largest.max(v.abs()));
            let scale = largest / f32::from(i8::MAX);
            let byte = |v: &f32| (v / scale.max(f32::MIN_POSITIVE)).round() as i8;
            bytes.extend(row.iter().map(|v| byte(v).cast_unsigned()));
            scales.push(scale);
        }
        stored.insert(name.clone(), (Dtype::I8, tensor.shape.clone(), bytes));
        stored.insert(scale_of(name), as_floats(&[n_rows], &scales));
    }
    encode(path, stored)
}

/// Name of the scales of the rows of an array that is stored as bytes.
fn scale_of(name: &str) -> String {
    format!("{name}.scale")
}

fn as_floats(shape: &[usize], values: &[f32]) -> Stored {
    let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    (Dtype::F32, shape.to_vec(), bytes)
}

fn encode(path: &Path, stored: BTreeMap<String, Stored>) -> Result<Vec<u8>, CheckpointError> {
    let fail = |message: String| CheckpointError::Safetensors {
        path: path.into(),
        message,
    };
    let mut views = BTreeMap::new();
    for (name, (dtype, shape, bytes)) in &stored {
        let view = TensorView::new(*dtype, shape.clone(), bytes)
            .map_err(|e| fail(format!("tensor `{name}`: {e}")))?;
        views.insert(name.as_str(), view);
    }
    safetensors::serialize(views, None).map_err(|e| fail(e.to_string()))
}

/// Reads a safetensors file of F32, F16 or BF16 arrays, widened to f32, and of bytes with scales
/// ([`CheckpointFiles::tensors_as_bytes`]).
///
/// # Errors
/// If the file is malformed, contains another element type, or a value is NaN or infinite.
pub fn read_safetensors(path: &Path) -> Result<NamedTensors, CheckpointError> {
    read_arrays(path, false)
}

/// Like [`read_safetensors`], for files written by other programs. Integer and boolean arrays are skipped, because in
/// these files they are tables and masks and not weights.
///
/// # Errors
/// See [`read_safetensors`]; F64 is refused, not skipped.
pub fn read_floats(path: &Path) -> Result<NamedTensors, CheckpointError> {
    read_arrays(path, true)
}

fn read_arrays(path: &Path, skip_integers: bool) -> Result<NamedTensors, CheckpointError> {
    let mut file = fs::File::open(path).map_err(io_error(path))?;
    let found = file.metadata().map_err(io_error(path))?.len();
    arrays_of(path, &mut file, found, skip_integers)
}

/// Reads the arrays of a file `path` of `found` bytes one by one, so that memory holds the arrays but not the file in
/// addition.
fn arrays_of(
    path: &Path,
    file: &mut dyn Input,
    found: u64,
    skip_integers: bool,
) -> Result<NamedTensors, CheckpointError> {
    let fail = |message: String| CheckpointError::Safetensors {
        path: path.into(),
        message,
    };
    if found > MAX_TENSOR_FILE_BYTES {
        return Err(CheckpointError::TooLarge {
            path: path.into(),
            found,
            limit: MAX_TENSOR_FILE_BYTES,
        });
    }
    // The file consists of eight bytes with the length of the header, the header, and the arrays.
    let mut length = [0; 8];
    file.read_exact(&mut length).map_err(io_error(path))?;
    let header_bytes = u64::from_le_bytes(length);
    if header_bytes > MAX_HEADER_BYTES.min(found.saturating_sub(8)) {
        return Err(fail(format!(
            "a header of {header_bytes} bytes in a file of {found}"
        )));
    }
    let mut header = vec![0; header_bytes as usize];
    file.read_exact(&mut header).map_err(io_error(path))?;
    let metadata: Metadata = serde_json::from_slice(&header).map_err(|e| fail(e.to_string()))?;
    let data_start = 8 + header_bytes;
    let data_bytes = found - data_start;
    // The parser has checked that the arrays are contiguous and that each has the length that its shape implies.
    if data_bytes != metadata.data_len() as u64 {
        return Err(fail(format!(
            "{data_bytes} bytes of arrays, the header lists {}",
            metadata.data_len()
        )));
    }
    let mut tensors = NamedTensors::new();
    let mut in_bytes = Vec::new();
    for (name, info) in metadata.tensors() {
        if matches!(
            info.dtype,
            Dtype::BOOL | Dtype::U8 | Dtype::I8 | Dtype::I32 | Dtype::I64
        ) && skip_integers
        {
            continue;
        }
        let (start, end) = info.data_offsets;
        file.seek(SeekFrom::Start(data_start + start as u64))
            .map_err(io_error(path))?;
        let values = read_values(file, info.dtype, end - start, path, &name)?;
        if let Some(index) = values.iter().position(|v| !v.is_finite()) {
            return Err(CheckpointError::NotFinite {
                path: path.into(),
                tensor: name,
                index,
            });
        }
        if info.dtype == Dtype::I8 {
            in_bytes.push(name.clone());
        }
        let shape = info.shape.clone();
        tensors.insert(name, HostTensor { shape, values });
    }
    for name in in_bytes {
        scale_rows(path, &mut tensors, &name)?;
    }
    Ok(tensors)
}

/// Multiplies the rows of an array that was stored as bytes by their scales, which are taken out of the arrays.
fn scale_rows(path: &Path, tensors: &mut NamedTensors, name: &str) -> Result<(), CheckpointError> {
    let scales = tensors.remove(&scale_of(name));
    let Some(tensor) = tensors.get_mut(name) else {
        return Ok(());
    };
    let expected = tensor.shape.get(..1).unwrap_or_default().to_vec();
    let scales = scales.ok_or_else(|| CheckpointError::MissingTensor {
        path: path.into(),
        tensor: scale_of(name),
        expected: expected.clone(),
    })?;
    if scales.shape != expected {
        return Err(CheckpointError::Shape {
            path: path.into(),
            tensor: scale_of(name),
            expected,
            found: scales.shape,
        });
    }
    let width = (tensor.values.len() / scales.values.len().max(1)).max(1);
    for (row, scale) in tensor.values.chunks_mut(width).zip(&scales.values) {
        row.iter_mut().for_each(|v| *v *= scale);
    }
    Ok(())
}

/// Reads floats from `n_bytes` bytes of a file, and widens them to f32 in blocks.
fn read_values(
    file: &mut dyn Input,
    dtype: Dtype,
    n_bytes: usize,
    path: &Path,
    tensor: &str,
) -> Result<Vec<f32>, CheckpointError> {
    let width = match dtype {
        Dtype::F32 => 4,
        Dtype::BF16 | Dtype::F16 => 2,
        Dtype::I8 => 1,
        other => {
            return Err(CheckpointError::Dtype {
                path: path.into(),
                tensor: tensor.into(),
                found: format!("{other:?}"),
            });
        }
    };
    // The file was checked to have this length.
    let mut values = Vec::with_capacity(n_bytes / width);
    let mut piece = vec![0; PIECE_BYTES.min(n_bytes)];
    let mut left = n_bytes;
    while left > 0 {
        let piece = &mut piece[..left.min(PIECE_BYTES)];
        file.read_exact(piece).map_err(io_error(path))?;
        let (fours, twos) = (piece.as_chunks().0.iter(), piece.as_chunks().0.iter());
        match dtype {
            Dtype::F32 => values.extend(fours.map(|b| f32::from_le_bytes(*b))),
            Dtype::I8 => values.extend(piece.iter().map(|b| f32::from(b.cast_signed()))),
            Dtype::BF16 => values.extend(twos.map(|b| bf16::from_le_bytes(*b).to_f32())),
            _ => values.extend(twos.map(|b| f16::from_le_bytes(*b).to_f32())),
        }
        left -= piece.len();
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scratch(name: &str) -> PathBuf {
        let dir = std::env::temp_dir().join(format!("radarllm-ckpt-{}-{name}", std::process::id()));
        let _ = fs::remove_dir_all(&dir);
        fs::create_dir_all(&dir).unwrap();
        dir
    }

    fn weights() -> NamedTensors {
        let tensor = |shape: &[usize]| HostTensor {
            shape: shape.to_vec(),
            values: (0..shape.iter().product::<usize>())
                .map(|i| (i as f32 + 0.1).sin())
                .collect(),
        };
        [("weight", &[3, 2][..]), ("bias", &[2])]
            .map(|(name, shape)| (name.to_string(), tensor(shape)))
            .into()
    }

    fn files() -> CheckpointFiles {
        let mut files = CheckpointFiles::default();
        files
            .json(CONFIG_FILE, &serde_json::json!({"width": 3}))
            .unwrap();
        files.tensors(MODEL_FILE, &weights()).unwrap();
        files
    }

    #[test]
    fn weights_survive_a_round_trip_bit_for_bit() {
        let root = scratch("round");
        files().write(&root.join("c")).unwrap();
        let checkpoint = Checkpoint::open(&root.join("c")).unwrap();
        assert_eq!(checkpoint.tensors(MODEL_FILE).unwrap(), weights());
        fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn weights_as_bytes_are_off_by_half_a_step_of_their_row() {
        let root = scratch("bytes");
        let mut files = CheckpointFiles::default();
        let mut weights = weights();
        let zeros = HostTensor {
            shape: vec![2, 2],
            values: vec![0.0; 4],
        };
        weights.insert("zeros".into(), zeros);
        files.tensors_as_bytes(MODEL_FILE, &weights).unwrap();
        files.write(&root.join("c")).unwrap();
        let read = Checkpoint::open(&root.join("c")).unwrap();
        let read = read.tensors(MODEL_FILE).unwrap();
        assert_eq!(read.keys().collect::<Vec<_>>(), ["bias", "weight", "zeros"]);
        assert_eq!(read["bias"], weights["bias"]);
        assert_eq!(read["zeros"], weights["zeros"]);
        let rows = read["weight"]
            .values
            .chunks(2)
            .zip(weights["weight"].values.chunks(2));
        for (row, exact) in rows {
            let largest = exact.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
            for (v, exact) in row.iter().zip(exact) {
                assert!((v - exact).abs() <= largest / 254.0 * 1.001, "{v} {exact}");
            }
        }
        // What was read is written as the same bytes again.
        let mut again = CheckpointFiles::default();
        again.tensors_as_bytes(MODEL_FILE, &read).unwrap();
        assert_eq!(again.files, files.files);
        fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn bytes_without_fitting_scales_are_errors() {
        let root = scratch("scales");
        let path = root.join("x.safetensors");
        let bytes = |n| (Dtype::I8, vec![n, 2], vec![3; 2 * n]);
        let mut stored = BTreeMap::from([("w".to_string(), bytes(2))]);
        fs::write(&path, encode(&path, stored.clone()).unwrap()).unwrap();
        let error = read_safetensors(&path).unwrap_err().to_string();
        assert!(
            error.contains("`w.scale` of shape [2] is missing"),
            "{error}"
        );
        stored.insert("w.scale".into(), as_floats(&[3], &[1.0; 3]));
        fs::write(&path, encode(&path, stored).unwrap()).unwrap();
        let error = read_safetensors(&path).unwrap_err().to_string();
        assert!(error.contains("shape [3], expected [2]"), "{error}");
        fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn interrupted_writes_leave_a_checkpoint_that_opens() {
        let root = scratch("kill");
        let dir = root.join("c");
        files().write(&dir).unwrap();
        // The process was killed while writing the sibling directory, which contains half a file.
        fs::create_dir(root.join("c.tmp")).unwrap();
        fs::write(root.join("c.tmp").join(MODEL_FILE), b"half").unwrap();
        Checkpoint::open(&dir).unwrap();
        // The process was killed between the two renames: only the old checkpoint exists, under its temporary name.
        fs::rename(&dir, root.join("c.old")).unwrap();
        Checkpoint::open(&dir).unwrap();
        // The next write restores the normal state.
        files().write(&dir).unwrap();
        Checkpoint::open(&dir).unwrap();
        assert!(!root.join("c.tmp").exists() && !root.join("c.old").exists());
        fs::remove_dir_all(root).unwrap();
    }

    fn names(dir: &Path) -> Vec<String> {
        let entries = fs::read_dir(dir).unwrap();
        let mut names: Vec<String> = entries
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_checkpoint_that_cannot_be_written_leaves_nothing() {
        let root = scratch("unwritten");
        let dir = root.join("c");
        // The folder of this file is missing. It comes after the others, which are written before.
        let mut unwritable = files();
        unwritable.bytes("no/such/folder", Vec::new());
        let assert_refused = || {
            let error = unwritable.write(&dir).unwrap_err();
            let CheckpointError::Io { path, source } = error else {
                panic!("{error}");
            };
            assert!(path.ends_with("no/such/folder"), "{}", path.display());
            assert_eq!(source.kind(), std::io::ErrorKind::NotFound);
        };
        assert_refused();
        assert_eq!(names(&root), [""; 0]);
        // An earlier checkpoint stays as it is.
        files().write(&dir).unwrap();
        assert_refused();
        assert_eq!(names(&root), ["c"]);
        Checkpoint::open(&dir).unwrap();
        fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn a_checkpoint_loses_its_name_before_its_files() {
        let root = scratch("remove");
        let dir = root.join("c");
        files().write(&dir).unwrap();
        // An earlier process was killed while it removed or wrote a checkpoint of the same name.
        fs::create_dir(root.join("c.tmp")).unwrap();
        fs::write(root.join("c.tmp").join(MODEL_FILE), b"half").unwrap();
        remove_checkpoint(&dir).unwrap();
        assert_eq!(names(&root), [""; 0]);
        assert!(remove_checkpoint(&dir).is_err());
        // A plain file cannot be removed as a directory, so that the removal ends as if the process were killed.
        fs::write(&dir, b"").unwrap();
        assert!(remove_checkpoint(&dir).is_err());
        assert_eq!(names(&root), ["c.tmp"]);
        fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn damage_is_found_wherever_it_is() {
        let root = scratch("damage");
        let dir = root.join("c");
        files().write(&dir).unwrap();
        let path = dir.join(MODEL_FILE);
        let good = fs::read(&path).unwrap();
        for at in [0, 9, good.len() / 2, good.len() - 1] {
            let mut bad = good.clone();
            bad[at] ^= 0x10;
            fs::write(&path, &bad).unwrap();
            let err = Checkpoint::open(&dir).unwrap_err();
            assert!(matches!(err, CheckpointError::Checksum { .. }), "{err}");
        }
        fs::write(&path, &good[..good.len() - 4]).unwrap();
        assert!(Checkpoint::open(&dir).is_err());
        fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn hostile_safetensors_are_errors() {
        let root = scratch("hostile");
        let path = root.join("x.safetensors");
        let mut cases: Vec<Vec<u8>> = vec![
            vec![],
            vec![0xff; 8],
            u64::MAX.to_le_bytes().to_vec(),
            b"\x02\0\0\0\0\0\0\0{}".to_vec()[..9].to_vec(),
        ];
        // A header that declares 4 GiB of floats in a file with four bytes of data.
        let header = br#"{"a":{"dtype":"F32","shape":[1073741824],"data_offsets":[0,4294967296]}}"#;
        let mut claim = (header.len() as u64).to_le_bytes().to_vec();
        claim.extend_from_slice(header);
        claim.extend_from_slice(&[0; 4]);
        cases.push(claim);
        for bytes in cases {
            fs::write(&path, &bytes).unwrap();
            assert!(read_safetensors(&path).is_err(), "{bytes:?}");
        }
        let mut tensors = NamedTensors::new();
        tensors.insert("a".into(), HostTensor::vector(vec![1.0, f32::NAN]));
        fs::write(&path, encode_safetensors(&path, &tensors).unwrap()).unwrap();
        let err = read_safetensors(&path).unwrap_err();
        assert!(
            matches!(err, CheckpointError::NotFinite { index: 1, .. }),
            "{err}"
        );
        fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn half_precision_widens_exactly() {
        let root = scratch("half");
        let path = root.join("x.safetensors");
        // IEEE 754 examples: 1, -2, 65504 (largest), 2^-24 (smallest subnormal), 1/3 rounded.
        let f16 = [0x3c00_u16, 0xc000, 0x7bff, 0x0001, 0x3555];
        let widened = vec![1.0, -2.0, 65504.0, 2f32.powi(-24), 0.333_251_95];
        // The upper halves of 1, -2, 2^127 and 1/3.
        let bf16 = [0x3f80_u16, 0xc000, 0x7f00, 0x3eaa];
        let widened_bf16 = vec![1.0, -2.0, 2f32.powi(127), 0.332_031_25];
        for (dtype, bits, widened) in [
            (Dtype::F16, &f16[..], widened),
            (Dtype::BF16, &bf16, widened_bf16),
        ] {
            let bytes: Vec<u8> = bits.iter().flat_map(|b| b.to_le_bytes()).collect();
            let view = TensorView::new(dtype, vec![bits.len()], &bytes).unwrap();
            fs::write(&path, safetensors::serialize([("a", view)], None).unwrap()).unwrap();
            let read = read_safetensors(&path).unwrap();
            assert_eq!(read["a"].values, widened, "{dtype:?}");
        }
        fs::remove_dir_all(root).unwrap();
    }
}
