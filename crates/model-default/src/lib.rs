//! The bundled models, embedded in the program: the files of `weights/` and of `tokens/`.
//!
//! Nothing enters and bytes leave, by their path in the folder of the model. `radarllm` reads them as it reads a model
//! folder. The crate is one of its own, so that a changed weight recompiles no code and the library can be packaged with
//! its models. It computes nothing and depends on nothing; its build script compares the files with `checksums.txt`.
//!
//! | model | what its sentences are made of | what it learned |
//! |---|---|---|
//! | [`FEATURES`], the default | radar tokens, the features beside them and the context, by an ensemble of two | radar to text |
//! | [`TOKENS`] | radar tokens alone, as in the published method | radar to text, text to radar, radar prediction, instructions |

#![cfg_attr(
    test,
    allow(clippy::disallowed_methods, unreachable_pub, reason = "tests")
)]

/// A model that comes with the library.
#[derive(Debug, PartialEq, Eq)]
pub struct Bundled {
    /// Name in reports.
    pub name: &'static str,
    /// What it was trained on, what it can do and what it cannot, in Markdown.
    pub card: &'static str,
    /// The files that inference reads, by their path in the model's folder. Of a language model's sets of weights, only the
    /// one that its `config.json` names is here.
    pub files: &'static [(&'static str, &'static [u8])],
    /// Folders of its members in the folder of the model.
    pub members: &'static [&'static str],
}

/// A file by its path in the model's folder and its place in this crate.
macro_rules! model_file {
    ($path:literal, $place:literal) => {
        ($path, include_bytes!(concat!("../", $place)))
    };
}

/// The default model.
pub static FEATURES: Bundled = Bundled {
    name: "default (embedded)",
    card: include_str!("../weights/README.md"),
    files: &[
        model_file!("confidence.toml", "weights/confidence.toml"),
        model_file!("lm/average.safetensors", "weights/lm/average.safetensors"),
        model_file!("lm/config.json", "weights/lm/config.json"),
        model_file!("lm/tokenizer.json", "weights/lm/tokenizer.json"),
        model_file!("evidence/config.json", "weights/evidence/config.json"),
        model_file!(
            "evidence/model.safetensors",
            "weights/evidence/model.safetensors"
        ),
        model_file!("tokenizer/config.json", "weights/tokenizer/config.json"),
        model_file!(
            "tokenizer/model.safetensors",
            "weights/tokenizer/model.safetensors"
        ),
        model_file!(
            "member-2/lm/average.safetensors",
            "weights/member-2/lm/average.safetensors"
        ),
        model_file!("member-2/lm/config.json", "weights/member-2/lm/config.json"),
        model_file!(
            "member-2/lm/tokenizer.json",
            "weights/member-2/lm/tokenizer.json"
        ),
        model_file!(
            "member-2/tokenizer/config.json",
            "weights/member-2/tokenizer/config.json"
        ),
        model_file!(
            "member-2/tokenizer/model.safetensors",
            "weights/member-2/tokenizer/model.safetensors"
        ),
    ],
    members: &["", "member-2/"],
};

/// The model that reads its radar tokens alone. Its tokenizers are those of the members of [`FEATURES`]. The second member only
/// describes.
pub static TOKENS: Bundled = Bundled {
    name: "tokens (embedded)",
    card: include_str!("../tokens/README.md"),
    files: &[
        model_file!("confidence.toml", "weights/confidence.toml"),
        model_file!("lm/average.safetensors", "tokens/lm/average.safetensors"),
        model_file!("lm/config.json", "tokens/lm/config.json"),
        model_file!("lm/tokenizer.json", "weights/lm/tokenizer.json"),
        model_file!("points/config.json", "tokens/points/config.json"),
        model_file!(
            "points/model.safetensors",
            "tokens/points/model.safetensors"
        ),
        model_file!("tokenizer/config.json", "weights/tokenizer/config.json"),
        model_file!(
            "tokenizer/model.safetensors",
            "weights/tokenizer/model.safetensors"
        ),
        model_file!(
            "member-2/lm/average.safetensors",
            "tokens/member-2/lm/average.safetensors"
        ),
        model_file!("member-2/lm/config.json", "tokens/member-2/lm/config.json"),
        model_file!(
            "member-2/lm/tokenizer.json",
            "weights/member-2/lm/tokenizer.json"
        ),
        model_file!(
            "member-2/tokenizer/config.json",
            "weights/member-2/tokenizer/config.json"
        ),
        model_file!(
            "member-2/tokenizer/model.safetensors",
            "weights/member-2/tokenizer/model.safetensors"
        ),
    ],
    members: &["", "member-2/"],
};

impl Bundled {
    /// A file by its path in the model's folder.
    pub fn file(&self, path: &str) -> Option<&'static [u8]> {
        let found = self.files.iter().find(|(name, _)| *name == path);
        found.map(|(_, bytes)| *bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_weights_are_those_that_the_configuration_names() {
        for model in [&FEATURES, &TOKENS] {
            for member in model.members {
                let config = model.file(&format!("{member}lm/config.json")).unwrap();
                let config = String::from_utf8(config.to_vec()).unwrap();
                assert!(config.contains(r#""weights": "average.safetensors""#));
            }
            assert!(model.file("lm/model.safetensors").is_none());
            assert!(model.card.starts_with("# "));
        }
    }

    /// `build.rs` checks the files that `checksums.txt` names.
    #[test]
    fn every_file_has_a_checksum() {
        let checksums = include_str!("../checksums.txt");
        for model in [&FEATURES, &TOKENS] {
            let card = ("README.md", model.card.as_bytes());
            for (path, bytes) in model.files.iter().copied().chain([card]) {
                let hash = blake3::hash(bytes).to_hex();
                assert!(checksums.contains(hash.as_str()), "{}: {path}", model.name);
            }
        }
    }

    /// What crates.io accepts of a package, and what a clone may bring.
    #[test]
    fn both_models_are_small() {
        let mut places: Vec<(*const u8, usize)> = [&FEATURES, &TOKENS]
            .into_iter()
            .flat_map(|model| {
                model
                    .files
                    .iter()
                    .map(|(_, bytes)| (bytes.as_ptr(), bytes.len()))
            })
            .collect();
        places.sort_unstable();
        places.dedup();
        let bytes: usize = places.iter().map(|(_, n)| n).sum();
        assert!(bytes < 10_000_000, "{bytes} bytes");
    }
}
