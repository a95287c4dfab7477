//! Small files read whole, and never more of them than expected: a device or a growing file has no end.

use std::{fs::File, io::Read, path::Path};

use crate::error::{CliError, CliResult};

/// Most bytes of a file that people write: configurations, scenes, calibrations.
pub const MAX_CONFIG_BYTES: u64 = 16 << 20;

/// All bytes of a file that has at most `most`.
pub fn read_bytes(path: &Path, most: u64) -> CliResult<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(most + 1).read_to_end(&mut bytes))
        .map_err(|e| CliError::io(path, e))?;
    if bytes.len() as u64 > most {
        return Err(CliError::new(format!(
            "{}: more than the {most} bytes that are read",
            path.display()
        )));
    }
    Ok(bytes)
}

/// The text of a file that has at most `most` bytes.
pub fn read_text(path: &Path, most: u64) -> CliResult<String> {
    String::from_utf8(read_bytes(path, most)?).map_err(|e| {
        let place = e.utf8_error().valid_up_to();
        CliError::new(format!("{}: byte {place}: expected UTF-8", path.display()))
    })
}
