//! Data are written to stdout, all other output to stderr. Files are written atomically.

use std::{
    fs::{self, File},
    io::Write,
    path::Path,
};

use radarllm_files::atomic::{self, Existing, WriteError};
use serde::Serialize;

use crate::error::{CliError, CliResult};

/// Prints one JSON document.
pub(crate) fn print_json(value: &impl Serialize) -> CliResult {
    let text = serde_json::to_string_pretty(value)?;
    print_line(&text);
    Ok(())
}

/// Writes a line to stderr; the macro `note!` formats it.
pub(crate) fn note(text: std::fmt::Arguments<'_>) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

/// Prints a line to stdout; a closed pipe ends the process quietly, as other tools do.
#[expect(
    clippy::disallowed_methods,
    reason = "the reader has gone, and results are written nowhere else"
)]
pub(crate) fn print_line(text: &str) {
    if writeln!(std::io::stdout().lock(), "{text}").is_err() {
        std::process::exit(0);
    }
}

/// Refuses to touch an existing path without `--force`.
pub(crate) fn check_free(path: &Path, force: bool) -> CliResult {
    if path.exists() && !force {
        return Err(CliError::new(format!("{} exists already", path.display()))
            .hint("give another --out, or --force to replace it"));
    }
    Ok(())
}

/// Refuses a path of another extension than that of what will be written there: readers go by it.
pub(crate) fn check_extension(path: &Path, extension: &str) -> CliResult {
    if path.extension().is_some_and(|e| e == extension) {
        return Ok(());
    }
    Err(CliError::new(format!(
        "{}: the output is a .{extension} file",
        path.display()
    ))
    .hint(format!("end the name in .{extension}")))
}

/// Writes a file atomically; missing parent folders are created.
pub(crate) fn write_atomic(path: &Path, bytes: &[u8]) -> CliResult {
    write_atomic_with(path, |file| {
        file.write_all(bytes).map_err(|e| CliError::io(path, e))
    })
}

/// The same for content that `write` makes piece by piece.
pub(crate) fn write_atomic_with(
    path: &Path,
    write: impl FnOnce(&mut File) -> CliResult,
) -> CliResult {
    if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        fs::create_dir_all(folder).map_err(|e| CliError::io(folder, e))?;
    }
    atomic::write_with(path, Existing::Replace, write).map_err(|e| match e {
        WriteError::Content(error) => error,
        WriteError::Io { source, .. } => CliError::io(path, source),
        WriteError::Exists { path } => CliError::new(format!("{} exists already", path.display())),
    })
}
