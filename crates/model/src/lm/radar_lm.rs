//! Network and vocabulary together, in memory and on disk.

use std::path::Path;

use burn::tensor::Device;
use radarllm_engine::MAX_SOURCE;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::card::LmFiles;
use super::config::LmConfig;
use super::hf;
use super::t5::RadarT5;
use super::templates::EVALUATION_PROMPT;
use super::vocab::Vocab;
use super::{LmError, Source, t5::T5};
use crate::checkpoint::{
    CONFIG_FILE, CheckpointError, CheckpointFiles, MODEL_FILE, NamedTensors, collect_params,
    load_params,
};
use crate::tokenizer::Encoded;

pub use super::card::{AVERAGE_FILE, LmCard, TEXT_TOKENIZER_FILE};

/// The radar-language model.
pub struct RadarLm {
    /// The network, on a device without autodiff.
    pub net: RadarT5,
    /// Ids.
    pub vocab: Vocab,
    /// Shape.
    pub config: LmConfig,
    device: Device,
}

impl RadarLm {
    /// A model drawn from `seed`, with the vocabulary's size.
    ///
    /// # Errors
    /// If the configuration cannot be.
    pub fn new(
        mut config: LmConfig,
        vocab: Vocab,
        seed: u64,
        device: &Device,
    ) -> Result<Self, LmError> {
        config.t5.vocab_size = vocab.layout().size();
        config.n_codes = vocab.layout().n_codes as usize;
        config.validate()?;
        let net = RadarT5::new(&config, seed, device);
        Ok(Self {
            net,
            vocab,
            config,
            device: device.clone(),
        })
    }

    /// A pretrained T5 from a Hugging Face folder, with new rows for radar codes.
    ///
    /// New embedding rows are drawn with the spread of the old ones, so that a fresh code is as
    /// loud as a word.
    ///
    /// # Errors
    /// If the folder holds no T5 with `tokenizer.json`.
    pub fn from_hf_folder(
        dir: &Path,
        n_codes: usize,
        code_dim: usize,
        bypass: bool,
        seed: u64,
        device: &Device,
    ) -> Result<Self, LmError> {
        let (mut t5, mut tensors) = hf::read_folder(dir)?;
        let json = hf::read_small(&dir.join(TEXT_TOKENIZER_FILE))?;
        let vocab = Vocab::extend_pretrained(&json, t5.vocab_size, n_codes)?;
        let old_rows = t5.vocab_size;
        t5.vocab_size = vocab.layout().size();
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        for name in ["shared", "head"] {
            let Some(tensor) = tensors.get_mut(name) else {
                continue;
            };
            if tensor.shape != [old_rows, t5.d_model] {
                continue; // Reported with both shapes below.
            }
            let n = tensor.values.len() as f32;
            let spread = (tensor.values.iter().map(|v| v * v).sum::<f32>() / n).sqrt();
            // Uniform numbers of that standard deviation.
            let half_width = spread * 3f32.sqrt();
            let new = (t5.vocab_size - old_rows) * t5.d_model;
            tensor
                .values
                .extend((0..new).map(|_| (2.0 * rng.random::<f32>() - 1.0) * half_width));
            tensor.shape[0] = t5.vocab_size;
        }
        let config = LmConfig {
            max_text_vocab: vocab.layout().n_text as usize,
            n_sentinels: vocab.layout().n_sentinels as usize,
            n_codes,
            code_dim,
            bypass,
            t5,
        };
        config.validate()?;
        let t5 = hf::build_t5(&config.t5, tensors, device, &dir.join(MODEL_FILE))?;
        let bypass = RadarT5::new_bypass(&config, seed, device);
        Ok(Self {
            net: RadarT5 { t5, bypass },
            vocab,
            config,
            device: device.clone(),
        })
    }

    /// Opens a checkpoint: `config.json`, `tokenizer.json` and the weights it names.
    ///
    /// # Errors
    /// If a file is missing or damaged, or weights do not fit the configuration.
    pub fn load(dir: &Path, device: &Device) -> Result<Self, LmError> {
        let LmFiles {
            config,
            vocab,
            weights,
            path,
        } = LmFiles::read(dir)?;
        let net = load_net(&config, weights, device, &path)?;
        Ok(Self {
            net,
            vocab,
            config,
            device: device.clone(),
        })
    }

    /// Adds this model's files to a checkpoint.
    ///
    /// # Errors
    /// If one cannot be encoded.
    pub fn add_to(&self, files: &mut CheckpointFiles) -> Result<(), LmError> {
        let card = LmCard {
            lm: self.config.clone(),
            vocab: self.vocab.layout().clone(),
            weights: MODEL_FILE.into(),
        };
        files.json(CONFIG_FILE, &card)?;
        files.bytes(
            TEXT_TOKENIZER_FILE,
            self.vocab.tokenizer_json()?.into_bytes(),
        );
        files.tensors(MODEL_FILE, &collect_params(&self.net))?;
        Ok(())
    }

    /// Writes a checkpoint that [`Self::load`] opens.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn save(&self, dir: &Path) -> Result<(), LmError> {
        let mut files = CheckpointFiles::default();
        self.add_to(&mut files)?;
        Ok(files.write(dir)?)
    }

    /// The device.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// The prompt that asks for a description: the one training always holds.
    ///
    /// # Errors
    /// If a code is beyond the codebook or features do not fit codes.
    pub fn describe_prompt(&self, radar: &Encoded) -> Result<Source, LmError> {
        let source = self.vocab.prompt(EVALUATION_PROMPT, Some(radar), None)?;
        self.check(&source)?;
        Ok(source)
    }

    /// Checks that an input fits the network.
    ///
    /// # Errors
    /// [`LmError::Input`] says what does not.
    pub fn check(&self, source: &Source) -> Result<(), LmError> {
        let fail = |problem: String| Err(LmError::Input(problem));
        if source.ids.is_empty() || source.ids.len() > MAX_SOURCE {
            return fail(format!(
                "{} tokens, expected 1..={MAX_SOURCE}",
                source.ids.len()
            ));
        }
        if let Some(id) = source
            .ids
            .iter()
            .find(|id| **id as usize >= self.config.t5.vocab_size)
        {
            return fail(format!("id {id} is beyond the vocabulary"));
        }
        // A model without the bypass never looks at features, so their width is not its business.
        let expected = source.feature_positions.len() * self.config.code_dim;
        if self.config.bypass && source.features.len() != expected {
            return fail(format!(
                "{} feature values, expected {expected}",
                source.features.len()
            ));
        }
        if source.features.iter().any(|v| !v.is_finite()) {
            return fail("a feature is not finite".into());
        }
        if source
            .feature_positions
            .iter()
            .any(|p| *p as usize >= source.ids.len())
        {
            return fail("a feature's position is beyond the tokens".into());
        }
        Ok(())
    }
}

/// Builds a network from named parameters.
fn load_net(
    config: &LmConfig,
    mut tensors: NamedTensors,
    device: &Device,
    file: &Path,
) -> Result<RadarT5, LmError> {
    let bypass = tensors.remove("bypass");
    let mut t5 = NamedTensors::new();
    for (name, tensor) in tensors {
        match name.strip_prefix("t5.") {
            Some(rest) => {
                t5.insert(rest.to_string(), tensor);
            }
            None => {
                let path = file.into();
                return Err(CheckpointError::UnknownTensor { path, tensor: name }.into());
            }
        }
    }
    let t5: T5 = hf::build_t5(&config.t5, t5, device, file)?;
    let expected = vec![config.code_dim, config.t5.d_model];
    let bypass = match (config.bypass, bypass) {
        (false, None) => None,
        (true, Some(tensor)) if tensor.shape == expected => Some(tensor),
        (true, Some(tensor)) => {
            let (path, found) = (file.into(), tensor.shape);
            let tensor = "bypass".into();
            return Err(CheckpointError::Shape {
                path,
                tensor,
                expected,
                found,
            }
            .into());
        }
        (true, None) => {
            let (path, tensor) = (file.into(), "bypass".into());
            return Err(CheckpointError::MissingTensor {
                path,
                tensor,
                expected,
            }
            .into());
        }
        (false, Some(_)) => {
            let (path, tensor) = (file.into(), "bypass".into());
            return Err(CheckpointError::UnknownTensor { path, tensor }.into());
        }
    };
    let net = RadarT5 {
        t5,
        bypass: RadarT5::new_bypass(config, 0, device),
    };
    match bypass {
        None => Ok(net),
        Some(tensor) => {
            let mut all = collect_params(&net);
            all.insert("bypass".into(), tensor);
            Ok(load_params(net, all, file)?)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checkpoint::HostTensor;
    use crate::lm::templates;

    /// A pretrained folder in miniature: the golden v1.1 weights with a word tokenizer that has
    /// T5's special tokens at T5's places.
    #[test]
    fn a_pretrained_t5_gains_radar_rows_and_keeps_its_own() {
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/goldens/t5_v11.safetensors");
        let bytes = std::fs::read(&golden).unwrap();
        let (_, metadata) = safetensors::SafeTensors::read_metadata(&bytes).unwrap();
        let config = metadata.metadata().as_ref().unwrap()["config"].clone();
        let mut tensors = crate::checkpoint::read_safetensors(&golden).unwrap();
        for extra in ["input_ids", "attention_mask", "decoder_input_ids", "logits"] {
            tensors.remove(extra);
        }
        let old: HostTensor = tensors["shared.weight"].clone();
        let words = [
            "<pad>",
            "</s>",
            "<unk>",
            "describe",
            "walks",
            "<extra_id_1>",
            "<extra_id_0>",
        ];
        let ids: std::collections::BTreeMap<_, _> = words.into_iter().zip(0..).collect();
        let tokenizer = serde_json::json!({
            "version": "1.0", "truncation": null, "padding": null, "added_tokens": [],
            "normalizer": null, "pre_tokenizer": {"type": "Whitespace"}, "post_processor": null,
            "decoder": null,
            "model": {"type": "WordLevel", "vocab": ids, "unk_token": "<unk>"},
        });
        let dir = std::env::temp_dir().join(format!("radarllm-hf-lm-{}", std::process::id()));
        let mut files = CheckpointFiles::default();
        files.bytes(CONFIG_FILE, config.into_bytes());
        files.json(TEXT_TOKENIZER_FILE, &tokenizer).unwrap();
        files.tensors(MODEL_FILE, &tensors).unwrap();
        files.write(&dir).unwrap();
        let lm = RadarLm::from_hf_folder(&dir, 8, 4, true, 1, &Device::flex()).unwrap();
        std::fs::remove_dir_all(&dir).unwrap();
        let layout = lm.vocab.layout();
        assert_eq!(
            (layout.n_text, layout.first_code, layout.size()),
            (5, 40, 50)
        );
        assert_eq!((layout.sentinel(0), layout.sentinel(1)), (6, 5));
        let shared = &collect_params(&lm.net)["t5.shared"];
        assert_eq!(shared.shape, [50, 16]);
        assert_eq!(shared.values[..old.values.len()], old.values);
        // New rows are as loud as old ones: 160 values, so the rms is known to about 10 %.
        let rms = |v: &[f32]| (v.iter().map(|x| x * x).sum::<f32>() / v.len() as f32).sqrt();
        let ratio = rms(&shared.values[old.values.len()..]) / rms(&old.values);
        assert!((0.75..1.25).contains(&ratio), "{ratio}");
        let radar = Encoded {
            codes: vec![1, 7],
            features: vec![0.5; 8],
            n_points_used: 0,
        };
        let source = lm.describe_prompt(&radar).unwrap();
        assert_eq!(source.ids, [3, 48, 41, 47, 49, 1]);
        assert!(lm.generate(&[source], &Default::default()).is_ok());
    }

    #[test]
    fn damaged_models_are_errors() {
        let texts = ["a person walks"];
        let vocab = Vocab::learn(texts.into_iter(), templates::all_text(), 600, 4, 8).unwrap();
        let shape = crate::lm::LmPreset::Small.config(8, 4);
        let lm = RadarLm::new(shape, vocab, 1, &Device::flex()).unwrap();
        let dir = std::env::temp_dir().join(format!("radarllm-lm-bad-{}", std::process::id()));
        let card = |change: &dyn Fn(&mut LmCard)| {
            let mut files = CheckpointFiles::default();
            lm.add_to(&mut files).unwrap();
            let vocab = lm.vocab.layout().clone();
            let mut card = LmCard {
                lm: lm.config.clone(),
                vocab,
                weights: MODEL_FILE.into(),
            };
            change(&mut card);
            files.json(CONFIG_FILE, &card).unwrap();
            files.write(&dir).unwrap();
            RadarLm::load(&dir, &Device::flex())
                .err()
                .map(|e| e.to_string())
        };
        assert_eq!(card(&|_| {}), None);
        for change in [
            // Would be terabytes if it were believed.
            &(|c: &mut LmCard| c.lm.t5.d_ff = 60_000) as &dyn Fn(&mut LmCard),
            &|c| c.lm.t5.n_encoder_layers = 4,
            &|c| c.lm.bypass = false,
            &|c| c.lm.code_dim = 5,
            &|c| c.vocab.n_codes += 1,
            &|c| c.lm.t5.dropout = 2.0,
            &|c| c.weights = "average.safetensors".into(),
        ] {
            assert!(card(change).is_some());
        }
        std::fs::remove_dir_all(dir).unwrap();
    }
}
