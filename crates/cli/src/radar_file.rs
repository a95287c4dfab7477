//! Radars that are named by the user.

use std::path::Path;

use radarllm::OpenedRadar;

use crate::error::{CliError, CliResult};

/// Opens a radar by built-in name or file, with a hint on failure.
pub(crate) fn open(name: &str) -> CliResult<OpenedRadar> {
    radarllm::open_radar(name).map_err(|error| {
        if Path::new(name).is_file() {
            return CliError::new(error).hint(format!(
                "`radarllm radar lint {name}` shows the place in the file"
            ));
        }
        unknown(error)
    })
}

/// An error about a radar that is not a file, with a hint at the built-in ones.
pub(crate) fn unknown(error: impl std::fmt::Display) -> CliError {
    CliError::new(error)
        .hint("`radarllm radar list` names the built-in radars; files end in .toml, .cfg or .json")
}
