//! Data to stdout, everything else to stderr; files appear whole or not at all.

use std::{
    fs,
    io::Write,
    path::{Path, PathBuf},
};

use serde::Serialize;

use crate::error::{CliError, CliResult};

/// Prints one JSON document.
pub fn print_json(value: &impl Serialize) -> CliResult {
    let text = serde_json::to_string_pretty(value)?;
    print_line(&text);
    Ok(())
}

/// Prints a line to stdout; a closed pipe ends the process quietly, as other tools do.
pub fn print_line(text: &str) {
    if writeln!(std::io::stdout().lock(), "{text}").is_err() {
        std::process::exit(0);
    }
}

/// Refuses to touch an existing path without `--force`.
pub fn check_free(path: &Path, force: bool) -> CliResult {
    if path.exists() && !force {
        return Err(CliError::new(format!("{} exists already", path.display()))
            .hint("give another --out, or --force to replace it"));
    }
    Ok(())
}

/// Writes a file under a temporary name, syncs it and renames it.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> CliResult {
    if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        fs::create_dir_all(folder).map_err(|e| CliError::io(folder, e))?;
    }
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(format!(".{}.tmp", std::process::id()));
    let temporary: PathBuf = path.with_file_name(name);
    let write = || -> std::io::Result<()> {
        let mut file = fs::File::create(&temporary)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&temporary, path)
    };
    write().map_err(|e| {
        let _ = fs::remove_file(&temporary);
        CliError::io(path, e)
    })
}
