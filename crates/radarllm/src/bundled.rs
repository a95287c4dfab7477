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
static FILES: [(&str, &[u8]); 11] = [
    model_file!("confidence.toml"),
    model_file!("lm/average.safetensors"),
    model_file!("lm/config.json"),
    model_file!("lm/tokenizer.json"),
    model_file!("tokenizer/config.json"),
    model_file!("tokenizer/model.safetensors"),
    model_file!("member-2/lm/average.safetensors"),
    model_file!("member-2/lm/config.json"),
    model_file!("member-2/lm/tokenizer.json"),
    model_file!("member-2/tokenizer/config.json"),
    model_file!("member-2/tokenizer/model.safetensors"),
];

/// A file of the bundled model, by its path in the model's folder.
pub fn file(path: &str) -> Option<&'static [u8]> {
    FILES
        .iter()
        .find(|(p, _)| *p == path)
        .map(|(_, bytes)| *bytes)
}

/// Path in the model's folder and contents of the bundled files.
pub fn files() -> &'static [(&'static str, &'static [u8])] {
    &FILES
}

/// Loads the bundled model, straight from the program's own bytes.
///
/// # Errors
/// If the files do not belong together, which a test excludes.
pub fn load(precision: Precision) -> Result<Captioner> {
    let load = |(tokenizer, lm): (Checkpoint, Checkpoint)| {
        Captioner::from_checkpoints(&tokenizer, lm, precision).map_err(Error::wrap)
    };
    let [first, second] = members();
    Ok(load(first)?.join(load(second)?))
}

/// The checkpoints of the tokenizer and the language model of each member of the ensemble.
pub fn members() -> [(Checkpoint, Checkpoint); 2] {
    ["", "member-2/"].map(|member| {
        let part = |part: &str| checkpoint(&format!("{member}{part}"));
        (part("tokenizer"), part("lm"))
    })
}

fn checkpoint(part: &str) -> Checkpoint {
    let inside = |(path, bytes): &(&'static str, &'static [u8])| {
        let name = path.strip_prefix(part)?.strip_prefix('/')?;
        Some((name.to_string(), *bytes))
    };
    let named = FILES.iter().filter_map(inside);
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
            ("member-2/tokenizer", "model.safetensors"),
            ("member-2/lm", "average.safetensors"),
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
        for lm in ["lm", "member-2/lm"] {
            let config = file(&format!("{lm}/config.json")).unwrap();
            let config = String::from_utf8(config.to_vec()).unwrap();
            assert!(config.contains(r#""weights": "average.safetensors""#));
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
