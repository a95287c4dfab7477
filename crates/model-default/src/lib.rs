//! The default model: the files of `weights/`, embedded in the program.
//!
//! Nothing enters and bytes leave, by their path in the folder of the model. `radarllm` reads them as it reads a model
//! folder. The crate is one of its own, so that a changed weight recompiles no code and the library can be packaged with
//! its model. It computes nothing and depends on nothing.

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

/// Name of the model in reports.
pub const NAME: &str = "default (embedded)";

/// The model card: what the model was trained on, what it can do and what it cannot.
pub const CARD: &str = include_str!("../weights/README.md");

/// A file of `weights/`.
macro_rules! model_file {
    ($path:literal) => {
        ($path, include_bytes!(concat!("../weights/", $path)))
    };
}

/// The files that inference reads, by their path in the model's folder. Of a language model's sets of weights, only the
/// one that its `config.json` names is here.
pub static FILES: [(&str, &[u8]); 11] = [
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

/// A file by its path in the model's folder.
pub fn file(path: &str) -> Option<&'static [u8]> {
    let found = FILES.iter().find(|(name, _)| *name == path);
    found.map(|(_, bytes)| *bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weights_are_those_that_the_configuration_names() {
        for lm in ["lm", "member-2/lm"] {
            let config = file(&format!("{lm}/config.json")).unwrap();
            let config = String::from_utf8(config.to_vec()).unwrap();
            assert!(config.contains(r#""weights": "average.safetensors""#));
        }
        assert!(file("lm/model.safetensors").is_none());
        assert!(CARD.starts_with("# "));
    }
}
