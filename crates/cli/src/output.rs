//! Data are written to stdout, all other output to stderr. Files and folders are written atomically.

use std::{
    fs::{self, File},
    io::{self, ErrorKind, Write},
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

/// Values as JSON, one on each line.
#[cfg(feature = "eval")]
pub(crate) fn json_lines(values: impl IntoIterator<Item = impl Serialize>) -> CliResult<String> {
    let mut lines = String::new();
    for value in values {
        lines += &serde_json::to_string(&value)?;
        lines.push('\n');
    }
    Ok(lines)
}

/// Prints a JSON document on a line of its own.
pub(crate) fn print_json_line(value: &impl Serialize) -> CliResult {
    print_line(&serde_json::to_string(value)?);
    Ok(())
}

/// Writes a line to stderr; the macro `note!` formats it.
pub(crate) fn note(text: std::fmt::Arguments<'_>) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

/// Prints a line to stdout. A closed pipe ends the process quietly, as other tools do; a line that cannot be written for
/// another reason, such as a full disk, ends it with an error, because nobody has the result.
#[expect(
    clippy::disallowed_methods,
    reason = "results are written nowhere else, so that there is nothing left to do"
)]
pub(crate) fn print_line(text: &str) {
    match try_print_line(text) {
        Ok(true) => {}
        Ok(false) => std::process::exit(0),
        Err(error) => {
            error.report();
            std::process::exit(1);
        }
    }
}

/// As [`print_line`], for programs that have something to put in order before they end. Returns whether there is still a
/// reader.
///
/// # Errors
/// A line that cannot be written although its reader is there.
pub(crate) fn try_print_line(text: &str) -> CliResult<bool> {
    let mut stdout = std::io::stdout().lock();
    let written = writeln!(stdout, "{text}").and_then(|()| stdout.flush());
    match written {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(stdout_error(&error)),
    }
}

/// The error for standard output that cannot be written.
pub(crate) fn stdout_error(error: &io::Error) -> CliError {
    CliError::new(format!("standard output cannot be written: {error}"))
}

/// Refuses to touch an existing path without `--force`.
pub(crate) fn check_free(path: &Path, force: bool) -> CliResult {
    if path.exists() && !force {
        return Err(CliError::new(format!("{} exists already", path.display()))
            .hint("give another --out, or --force to replace it"));
    }
    Ok(())
}

/// Refuses to touch an existing path, for commands that replace nothing.
#[cfg(feature = "train")]
pub(crate) fn check_new(path: &Path) -> CliResult {
    match path.exists() {
        true => {
            let problem = format!("{} exists already", path.display());
            Err(CliError::new(problem).hint("give another --out"))
        }
        false => Ok(()),
    }
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
    create_parents(path)?;
    atomic::write_with(path, Existing::Replace, write).map_err(|e| write_error(path, e))
}

/// Makes a new folder atomically: `write` fills a temporary one. Missing parent folders are created.
#[cfg(feature = "train")]
pub(crate) fn create_folder_with(path: &Path, write: impl FnOnce(&Path) -> CliResult) -> CliResult {
    create_parents(path)?;
    atomic::create_folder_with(path, write).map_err(|e| write_error(path, e))
}

/// Creates the missing folders above a path.
fn create_parents(path: &Path) -> CliResult {
    match path.parent().filter(|p| !p.as_os_str().is_empty()) {
        Some(folder) => fs::create_dir_all(folder).map_err(|e| CliError::io(folder, e)),
        None => Ok(()),
    }
}

/// The error of something that was not written, with the path that the user named.
fn write_error(path: &Path, error: WriteError<CliError>) -> CliError {
    match error {
        WriteError::Content(error) => error,
        WriteError::Io { source, .. } => CliError::io(path, source),
        WriteError::Exists { path } => CliError::new(format!("{} exists already", path.display())),
    }
}
