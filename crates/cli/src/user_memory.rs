//! Where the memory of taught activities is kept.

use std::path::{Path, PathBuf};

use radarllm::teach::Memory;

use crate::error::{CliError, CliResult};

/// The file of a memory: the one named, or the user's own.
///
/// # Errors
/// No home folder, and none named.
pub(crate) fn memory_path(named: Option<&Path>) -> CliResult<PathBuf> {
    let from = |variable: &str| std::env::var_os(variable).filter(|v| !v.is_empty());
    if let Some(path) = named {
        return Ok(path.into());
    }
    let data = from("XDG_DATA_HOME").map(PathBuf::from);
    let home = || from("HOME").map(|home| PathBuf::from(home).join(".local/share"));
    match data.or_else(home) {
        Some(folder) => Ok(folder.join("radarllm/memory.json")),
        None => Err(CliError::new("no home folder for the memory").hint("name a file by --memory")),
    }
}

/// The memory for descriptions: the one named, or the user's own if it exists.
///
/// # Errors
/// A named file that does not exist, or a damaged one.
pub(crate) fn load_memory(named: Option<&Path>) -> CliResult<Option<Memory>> {
    match (named, memory_path(named)) {
        (Some(path), _) => Ok(Some(Memory::load(path)?)),
        (None, Ok(path)) if path.exists() => Ok(Some(Memory::load(&path)?)),
        (None, _) => Ok(None),
    }
}
