//! The default model: `models/default` of the repository, carried inside the binary.

use include_dir::{Dir, include_dir};
use radarllm_model::lm::Captioner;

use crate::error::{CliError, CliResult};

static FILES: Dir = include_dir!("$CARGO_MANIFEST_DIR/../../models/default");

/// Loads the embedded model.
///
/// Checkpoints load from a folder, so the files (a few MB) pass through a temporary one; the same
/// code then checks them as it checks a user's.
pub fn load() -> CliResult<Captioner> {
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
    Ok(Captioner::load(folder.path())?)
}
