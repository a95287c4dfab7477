//! Captioned motions: the list of available items and how to load each.

pub mod bandai_namco;
pub mod files;
pub mod humanml3d;
pub mod procedural;

use std::fs;
use std::path::{Path, PathBuf};

use radarllm_base::Motion;
use radarllm_dataset::{FailedItem, record::Split};
use serde::de::DeserializeOwned;
use serde_json::Value;

/// A captioned motion, without the motion itself.
#[derive(Clone, Debug, PartialEq)]
pub struct CorpusItem {
    /// Unique within the data set.
    pub motion_id: String,
    /// Items of one group are in the same split.
    pub group: String,
    /// Split.
    pub split: Split,
    /// Action label.
    pub action: String,
    /// At least one caption.
    pub captions: Vec<String>,
    /// Whether any part of the motion, however short, is described by the captions.
    pub is_continuous: bool,
}

/// A source of captioned motions.
pub trait Corpus: Send + Sync {
    /// Name recorded with every clip.
    fn name(&self) -> &str;
    /// Licence line for the manifest.
    fn licence(&self) -> &str;
    /// Attribution or citation; empty if there is none.
    fn attribution(&self) -> &str;
    /// All items, in a fixed order.
    fn items(&self) -> &[CorpusItem];
    /// Motions that are left out, with the reasons.
    fn skipped(&self) -> &[FailedItem] {
        &[]
    }
    /// The canonical motion (first pose at the origin facing the radar) of an item.
    ///
    /// # Errors
    /// Names the item and what is wrong with it.
    fn motion(&self, item_idx: usize) -> Result<Motion, CorpusError>;
    /// What the motion of an item is made of, from which the source opens it again without looking at all others. Nothing
    /// for a source that is no part of a data set's configuration.
    fn recipe(&self, _item_idx: usize) -> Value {
        Value::Null
    }
}

/// Reads a recipe.
///
/// # Errors
/// One that is not of this source.
pub(crate) fn recipe_of<T: DeserializeOwned>(
    item: &CorpusItem,
    recipe: Value,
) -> Result<T, CorpusError> {
    serde_json::from_value(recipe).map_err(|e| CorpusError::Motion {
        id: item.motion_id.clone(),
        problem: format!("its recipe in the index of the data set: {e}"),
    })
}

/// Why a corpus or one of its motions cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CorpusError {
    /// A file cannot be read.
    #[error("{path}: {source}")]
    Io {
        /// File.
        path: String,
        /// Cause.
        source: std::io::Error,
    },
    /// The content of a file is invalid.
    #[error("{path}:{line}: {problem}")]
    Format {
        /// File.
        path: String,
        /// Line, from 1; 0 if the problem concerns the whole file.
        line: usize,
        /// What is wrong.
        problem: String,
    },
    /// A motion cannot be used.
    #[error("motion `{id}`: {problem}")]
    Motion {
        /// Motion id.
        id: String,
        /// What is wrong.
        problem: String,
    },
}

pub(crate) fn io_error(path: &Path) -> impl FnOnce(std::io::Error) -> CorpusError {
    let path = path.display().to_string();
    move |source| CorpusError::Io { path, source }
}

/// All files in a folder and below, sorted.
fn files_below(folder: &Path) -> Result<Vec<PathBuf>, CorpusError> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(at) = open.pop() {
        for entry in fs::read_dir(&at).map_err(io_error(&at))? {
            let entry = entry.map_err(io_error(&at))?;
            // The type of a link is not that of its target, so that links cannot form circles.
            match entry.file_type().map_err(io_error(&at))?.is_dir() {
                true => open.push(entry.path()),
                false => found.push(entry.path()),
            }
        }
    }
    found.sort();
    Ok(found)
}
