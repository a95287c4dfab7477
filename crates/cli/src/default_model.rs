//! The default model: `models/default` of the repository, carried inside the binary.

use include_dir::{Dir, include_dir};
use radarllm_model::lm::{Captioner, Decoder};

use crate::error::{CliError, CliResult};

static FILES: Dir = include_dir!("$CARGO_MANIFEST_DIR/../../models/default");

/// A file of the embedded model; `None` if the binary was built without.
pub fn file(path: &str) -> Option<&'static [u8]> {
    FILES.get_file(path).map(include_dir::File::contents)
}

/// Name and contents of the files in a folder of the embedded model, sorted by name.
pub fn files(folder: &str) -> Vec<(String, &'static [u8])> {
    let files = FILES.get_dir(folder).into_iter().flat_map(Dir::files);
    let mut files: Vec<_> = files
        .map(|f| (f.path().display().to_string(), f.contents()))
        .collect();
    files.sort();
    files
}

/// Loads the embedded model.
///
/// Checkpoints load from a folder, so the files (a few MB) pass through a temporary one; the same
/// code then checks them as it checks a user's.
pub fn load(decoder: Decoder) -> CliResult<Captioner> {
    if FILES.get_dir("lm").is_none() {
        return Err(
            CliError::new("this binary was built without models/default")
                .hint("build from a complete checkout, or give --model"),
        );
    }
    let folder = tempfile::tempdir().map_err(|e| {
        CliError::new(format!("cannot make a temporary folder: {e}"))
            .hint("TMPDIR must be writable")
    })?;
    FILES
        .extract(folder.path())
        .map_err(|e| CliError::io(folder.path(), e))?;
    Ok(Captioner::load(folder.path(), decoder)?)
}
