//! The default model: `models/default` of the repository, bundled with the library.

use std::path::Path;

use radarllm_inference::{Captioner, Precision, checkpoint::Checkpoint};
use radarllm_io::{Error, Result};

/// Name of the bundled model in reports.
pub const NAME: &str = "default (embedded)";

/// A file of `models/default`.
macro_rules! model_file {
    ($path:literal) => {
        (
            $path,
            include_bytes!(concat!("../../../models/default/", $path)),
        )
    };
}

/// The files that inference reads, by their path in the model's folder. Of the language model's two sets of weights,
/// only the one that its `config.json` names is here; the other serves further training.
static FILES: [(&str, &[u8]); 5] = [
    model_file!("lm/average.safetensors"),
    model_file!("lm/config.json"),
    model_file!("lm/tokenizer.json"),
    model_file!("tokenizer/config.json"),
    model_file!("tokenizer/model.safetensors"),
];

/// A file of the bundled model, by its path in the model's folder.
pub fn file(path: &str) -> Option<&'static [u8]> {
    FILES
        .iter()
        .find(|(p, _)| *p == path)
        .map(|(_, bytes)| *bytes)
}

/// Name and contents of the bundled files in a folder of the model, sorted by name.
pub fn files(folder: &str) -> Vec<(&'static str, &'static [u8])> {
    let inside = |(path, bytes): &(&'static str, &'static [u8])| {
        let name = path.strip_prefix(folder)?.strip_prefix('/')?;
        Some((name, *bytes))
    };
    FILES.iter().filter_map(inside).collect()
}

/// Loads the bundled model, straight from the program's own bytes.
///
/// # Errors
/// If the files do not belong together, which a test excludes.
pub fn load(precision: Precision) -> Result<Captioner> {
    let (tokenizer, lm) = checkpoints();
    Captioner::from_checkpoints(&tokenizer, lm, precision).map_err(Error::input)
}

/// The checkpoints of the bundled tokenizer and language model.
pub fn checkpoints() -> (Checkpoint, Checkpoint) {
    (checkpoint("tokenizer"), checkpoint("lm"))
}

fn checkpoint(part: &str) -> Checkpoint {
    let named = files(part)
        .into_iter()
        .map(|(name, bytes)| (name.to_string(), bytes));
    Checkpoint::carried(&Path::new("models/default").join(part), named)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bundled files are not hashed at every start; here they are, once.
    #[test]
    fn checksums_of_the_bundled_files_agree() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/default");
        for (part, weights) in [
            ("tokenizer", "model.safetensors"),
            ("lm", "average.safetensors"),
        ] {
            let written = Checkpoint::open(&folder.join(part)).unwrap();
            let bundled = checkpoint(part);
            assert_eq!(
                written.bytes("config.json").unwrap(),
                bundled.bytes("config.json").unwrap()
            );
            assert_eq!(
                written.tensors(weights).unwrap(),
                bundled.tensors(weights).unwrap()
            );
        }
    }

    #[test]
    fn the_bundled_weights_are_those_that_the_configuration_names() {
        let config = String::from_utf8(file("lm/config.json").unwrap().to_vec()).unwrap();
        assert!(config.contains(r#""weights": "average.safetensors""#));
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
