//! The files that a model consists of.

use std::{fs, path::Path};

use radarllm::{Captioner, bundled};
use radarllm_base::hash::Fnv1a;
use radarllm_eval::ModelInfo;
use radarllm_inference::lm::ensemble::member_folders;

use crate::{
    commands::describe,
    error::{CliError, CliResult},
    model_args::DecoderName,
};

/// Loads a model for a decoder, with the facts that reports repeat.
pub fn load(model: Option<&Path>, decoder: DecoderName) -> CliResult<(Captioner, ModelInfo)> {
    let captioner = describe::load_decoder(model, decoder)?;
    let (bytes, fingerprint) = size_and_fingerprint(model)?;
    let info = ModelInfo {
        name: captioner.name().into(),
        decoder: decoder.name(),
        bytes,
        fingerprint,
    };
    Ok((captioner, info))
}

/// Size and FNV-1a hash of the files in `tokenizer/` and `lm/` of a model folder, or of the embedded default, and of the
/// further members of an ensemble.
fn size_and_fingerprint(model: Option<&Path>) -> CliResult<(u64, u64)> {
    let (mut size, mut hash) = (0, Fnv1a::new());
    let mut add = |name: &str, bytes: &[u8]| {
        size += bytes.len() as u64;
        hash.write(name.as_bytes());
        hash.write(bytes);
    };
    let Some(model) = model else {
        for (name, bytes) in bundled::files() {
            add(name, bytes);
        }
        return Ok((size, hash.finish()));
    };
    for member in member_folders(model) {
        for part in ["lm", "tokenizer"] {
            let folder = member.join(part);
            let io = |e| CliError::io(&folder, e);
            let mut paths = fs::read_dir(&folder)
                .map_err(io)?
                .map(|entry| entry.map(|e| e.path()))
                .collect::<Result<Vec<_>, _>>()
                .map_err(io)?;
            paths.retain(|path| path.is_file());
            paths.sort();
            for path in paths {
                let bytes = fs::read(&path).map_err(|e| CliError::io(&path, e))?;
                let name = path.strip_prefix(model).unwrap_or(&path);
                add(&name.to_string_lossy(), &bytes);
            }
        }
    }
    Ok((size, hash.finish()))
}
