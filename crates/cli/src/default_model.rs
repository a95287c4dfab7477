//! The default model: `models/default` of the repository, carried inside the binary.

use std::path::Path;

use include_dir::{Dir, include_dir};
use radarllm_inference::checkpoint::Checkpoint;
use radarllm_inference::lm::{Captioner, Decoder};

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

/// Loads the embedded model, straight from the program's own bytes.
pub fn load(decoder: Decoder) -> CliResult<Captioner> {
    if FILES.get_dir("lm").is_none() {
        return Err(
            CliError::new("this binary was built without models/default")
                .hint("build from a complete checkout, or give --model"),
        );
    }
    let [tokenizer, lm] = ["tokenizer", "lm"].map(checkpoint);
    Ok(Captioner::from_checkpoints(&tokenizer, lm, decoder)?)
}

fn checkpoint(part: &str) -> Checkpoint {
    let files = FILES.get_dir(part).into_iter().flat_map(Dir::files);
    let named = files.filter_map(|f| {
        let name = f.path().file_name()?.to_str()?;
        Some((name.to_string(), f.contents()))
    });
    Checkpoint::carried(&Path::new("models/default").join(part), named)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Carried files are not hashed at every start; here they are, once.
    #[test]
    fn checksums_of_the_embedded_files_agree() {
        let folder = tempfile::tempdir().unwrap();
        FILES.extract(folder.path()).unwrap();
        for part in ["tokenizer", "lm"] {
            let written = Checkpoint::open(&folder.path().join(part)).unwrap();
            for file in ["config.json", "model.safetensors"] {
                assert!(written.has(file) && checkpoint(part).has(file));
            }
            let weights = |c: &Checkpoint| c.tensors("model.safetensors").unwrap();
            assert_eq!(weights(&written), weights(&checkpoint(part)));
        }
    }

    #[test]
    fn what_a_carried_checkpoint_lacks_or_has_damaged_is_named() {
        let bytes = file("tokenizer/model.safetensors").unwrap();
        let cut = Checkpoint::carried(
            Path::new("here"),
            [("model.safetensors".to_string(), &bytes[..bytes.len() - 1])],
        );
        let error = cut.tensors("model.safetensors").unwrap_err().to_string();
        assert!(
            error.contains("here/model.safetensors") && error.contains("the header lists"),
            "{error}"
        );
        let error = cut.bytes("config.json").unwrap_err().to_string();
        assert_eq!(error, "here/config.json: missing from the checkpoint");
    }
}
