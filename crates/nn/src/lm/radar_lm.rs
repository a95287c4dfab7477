//! The network with its vocabulary, in memory and on disk.

use std::path::Path;

use burn::module::Module;
use burn::tensor::Device;
use radarllm_engine::MAX_SOURCE;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::Deserialize;

use super::hf;
use super::t5::{RadarT5, T5};
use super::text::{extend_decoder, extend_pretrained, read_files};
use crate::params::{collect_params, load_model, load_params};
use crate::pretrained::decoder::{DecoderOnlyNet, RadarDecoder};
use crate::pretrained::decoder_files::{
    Adapters, RADAR_FILE, absolute, hf_config, read_adapters, read_base,
};
use crate::pretrained::layers::LoraConfig;
use radarllm_inference::checkpoint::{
    CONFIG_FILE, Checkpoint, CheckpointError, CheckpointFiles, HostTensor, MODEL_FILE, NamedTensors,
};
use radarllm_inference::lm::card::{Learned, LmCard, LmFiles, TEXT_TOKENIZER_FILE};
use radarllm_inference::lm::config::{LmConfig, NetworkConfig};
use radarllm_inference::lm::templates::EVALUATION_PROMPT;
use radarllm_inference::lm::vocab::Vocab;
use radarllm_inference::lm::{EngineLm, InputError, LmError, Precision, Source};
use radarllm_inference::tokenizer::{Encoded, context::N_CONTEXT};

/// Number of sentinels of a pretrained decoder, which has none of its own; the presets have the same number.
const DECODER_SENTINELS: usize = 32;

/// The network of a radar-language model.
#[derive(Module, Debug)]
pub enum RadarNet {
    /// Encoder-decoder network.
    T5(RadarT5),
    /// Decoder-only network.
    Decoder(RadarDecoder),
}

impl RadarNet {
    /// The network, if it is a T5.
    pub fn t5(&self) -> Option<&RadarT5> {
        match self {
            Self::T5(net) => Some(net),
            Self::Decoder(_) => None,
        }
    }

    /// The device that stores its weights.
    pub fn device(&self) -> Device {
        match self {
            Self::T5(net) => net.device(),
            Self::Decoder(net) => net.device(),
        }
    }
}

/// The radar-language model.
pub struct RadarLm {
    /// The network, on a device without autodiff.
    pub net: RadarNet,
    /// The vocabulary: token ids.
    pub vocab: Vocab,
    /// Architecture.
    pub config: LmConfig,
    /// Adapters of a network whose other weights are frozen.
    pub adapters: Option<Adapters>,
    /// What the model was trained to do, if it is known.
    pub learned: Option<Learned>,
}

/// A model card as `config.json`. For a decoder-only network, it contains Hugging Face's fields, and the others under
/// `radarllm`.
pub fn card_to_json(card: &LmCard) -> serde_json::Value {
    let mut value = serde_json::to_value(card).unwrap_or_default();
    if card.lm.t5().is_some() {
        return value;
    }
    if let Some(lm) = value["lm"].as_object_mut() {
        lm.remove(card.lm.network.backbone().name());
    }
    let mut config = hf_config(&card.lm.network, card.vocab.end);
    config["radarllm"] = value;
    config
}

impl RadarLm {
    /// A model with random weights drawn from `seed`, for the vocabulary's size.
    ///
    /// # Errors
    /// If the configuration is impossible.
    pub fn new(
        mut config: LmConfig,
        vocab: Vocab,
        seed: u64,
        device: &Device,
    ) -> Result<Self, LmError> {
        config.network.set_vocab_size(vocab.layout().size());
        config.n_codes = vocab.layout().n_codes as usize;
        config.validate()?;
        let net = match &config.network {
            NetworkConfig::T5(t5) => RadarNet::T5(RadarT5::new(t5, &config, seed, device)),
            network => {
                let decoder = DecoderOnlyNet::new(network, seed, device)?;
                RadarNet::Decoder(RadarDecoder::new(decoder, &config, seed, device))
            }
        };
        Ok(Self {
            net,
            vocab,
            config,
            adapters: None,
            learned: None,
        })
    }

    /// A pretrained T5, GPT-2 or Qwen2 from a Hugging Face folder, with new rows for radar codes.
    ///
    /// New embedding rows are drawn with the standard deviation of the existing rows, so that a new code has the same
    /// magnitude as a word. With `lora`, a decoder's own weights are frozen and adapters are added.
    ///
    /// # Errors
    /// If the folder contains none of them with `tokenizer.json`, or if adapters are requested for a T5.
    pub fn from_hf_folder(
        dir: &Path,
        lora: Option<LoraConfig>,
        n_codes: usize,
        code_dim: usize,
        bypass: bool,
        seed: u64,
        device: &Device,
    ) -> Result<Self, LmError> {
        #[derive(Deserialize)]
        struct Kind {
            model_type: Option<String>,
        }
        let file = dir.join(CONFIG_FILE);
        let kind: Kind = serde_json::from_slice(&hf::read_small(&file)?)
            .map_err(|e| hf::json_error(&file, &e))?;
        // Old T5 folders have no `model_type`.
        if kind.model_type.is_none_or(|kind| kind == "t5") {
            if lora.is_some() {
                return Err(LmError::Config {
                    field: "lora",
                    problem: "T5 is trained whole; GPT-2 and Qwen2 take adapters".into(),
                });
            }
            return Self::from_hf_t5(dir, n_codes, code_dim, bypass, seed, device);
        }
        let json = hf::read_small(&dir.join(TEXT_TOKENIZER_FILE))?;
        let base = read_base(dir, device)?;
        let mut decoder = base.decoder;
        let mut network = decoder.config();
        let n_rows = network.vocab_size();
        let vocab = extend_decoder(&json, n_rows, base.end, DECODER_SENTINELS, n_codes)?;
        network.set_vocab_size(vocab.layout().size());
        let config = LmConfig {
            network,
            max_text_vocab: vocab.layout().n_text as usize,
            n_sentinels: DECODER_SENTINELS,
            n_codes,
            code_dim,
            bypass,
            projected: false,
        };
        config.validate()?;
        decoder.extend(vocab.layout().size() - n_rows, seed);
        let adapters = match lora {
            None => None,
            Some(config) => {
                config.validate()?;
                decoder.adapt(config, seed ^ 0x6c6f_7261);
                Some(Adapters {
                    config,
                    base: absolute(dir)?,
                    base_blake3: base.blake3,
                })
            }
        };
        Ok(Self {
            net: RadarNet::Decoder(RadarDecoder::new(decoder, &config, seed, device)),
            vocab,
            config,
            adapters,
            learned: None,
        })
    }

    fn from_hf_t5(
        dir: &Path,
        n_codes: usize,
        code_dim: usize,
        bypass: bool,
        seed: u64,
        device: &Device,
    ) -> Result<Self, LmError> {
        let (mut t5, mut tensors) = hf::read_folder(dir)?;
        let json = hf::read_small(&dir.join(TEXT_TOKENIZER_FILE))?;
        let vocab = extend_pretrained(&json, t5.vocab_size, n_codes)?;
        let old_rows = t5.vocab_size;
        t5.vocab_size = vocab.layout().size();
        let names = ["shared", "head"];
        add_rows(
            &mut tensors,
            names,
            [old_rows, t5.vocab_size],
            t5.d_model,
            seed,
        );
        let config = LmConfig {
            max_text_vocab: vocab.layout().n_text as usize,
            n_sentinels: vocab.layout().n_sentinels as usize,
            n_codes,
            code_dim,
            bypass,
            projected: false,
            network: NetworkConfig::T5(t5.clone()),
        };
        config.validate()?;
        let t5 = hf::build_t5(&t5, tensors, device, &dir.join(MODEL_FILE))?;
        let bypass = RadarT5::new_bypass(&config, seed, device);
        Ok(Self {
            net: RadarNet::T5(RadarT5 { t5, bypass }),
            vocab,
            config,
            adapters: None,
            learned: None,
        })
    }

    /// Opens a checkpoint: `config.json`, `tokenizer.json` and the weights it names.
    ///
    /// # Errors
    /// If a file is missing or damaged, or weights do not fit the configuration.
    pub fn load(dir: &Path, device: &Device) -> Result<Self, LmError> {
        Self::from_files(read_files(Checkpoint::open(dir)?)?, device)
    }

    /// Opens a checkpoint of a T5 whose vocabulary lacks tokens of the context, and adds rows for them, drawn with the
    /// standard deviation of the existing ones. A model that has them all stays as it is.
    ///
    /// # Errors
    /// As [`Self::load`]; a pretrained decoder has no context.
    pub fn load_with_context(dir: &Path, seed: u64, device: &Device) -> Result<Self, LmError> {
        let mut files = read_files(Checkpoint::open(dir)?)?;
        if files.vocab.layout().n_context == N_CONTEXT as u32 {
            return Self::from_files(files, device);
        }
        let NetworkConfig::T5(shape) = &mut files.card.lm.network else {
            return Err(LmError::Config {
                field: "context",
                problem: "a pretrained decoder has none".into(),
            });
        };
        files.vocab = files.vocab.with_context();
        files.card.vocab = files.vocab.layout().clone();
        let rows = [shape.vocab_size, files.vocab.layout().size()];
        shape.vocab_size = rows[1];
        let d_model = shape.d_model;
        let (mut tensors, path) = files.t5_weights()?;
        let names = ["t5.shared", "t5.head"];
        add_rows(&mut tensors, names, rows, d_model, seed);
        Ok(Self {
            net: RadarNet::T5(load_net(&files.card.lm, tensors, device, &path)?),
            vocab: files.vocab,
            config: files.card.lm,
            adapters: None,
            learned: files.card.learned,
        })
    }

    /// Opens a checkpoint of a T5 as a model that reads radar tokens alone, without context.
    ///
    /// With one code a step, it has no bypass: what the bypass makes of a code's vector is added to the embedding of the code,
    /// so that a token says what the feature of its code said. `codebook` is `[n_codes, code_dim]`, that of the tokenizer with
    /// which the model was trained. With two codes a step (`has_residual_codes`), the bypass stays, because what enters it is
    /// the sum of the vectors of both codes.
    ///
    /// # Errors
    /// As [`Self::load`]; a pretrained decoder, a model without bypass, or a codebook of another shape.
    pub fn load_tokens_only(
        dir: &Path,
        codebook: &HostTensor,
        has_residual_codes: bool,
        device: &Device,
    ) -> Result<Self, LmError> {
        let mut files = read_files(Checkpoint::open(dir)?)?;
        files.card.lm.require_engine_shape()?;
        let expected = [files.card.lm.n_codes, files.card.lm.code_dim];
        if codebook.shape != expected {
            let found = &codebook.shape;
            let problem =
                format!("the codebook of the tokenizer is {found:?}, expected {expected:?}");
            return Err(LmError::Config {
                field: "n_codes",
                problem,
            });
        }
        let (mut tensors, path) = files.t5_weights()?;
        let Some(bypass) = tensors.get("bypass").cloned() else {
            return Err(LmError::Config {
                field: "bypass",
                problem: "the model has none: it reads its radar tokens alone already".into(),
            });
        };
        files.vocab = files.vocab.without_context();
        files.card.vocab = files.vocab.layout().clone();
        let (n_rows, width) = (files.vocab.layout().size(), files.card.lm.network.width());
        files.card.lm.network.set_vocab_size(n_rows);
        for name in ["t5.shared", "t5.head"] {
            if let Some(rows) = tensors.get_mut(name) {
                rows.shape[0] = n_rows;
                rows.values.truncate(n_rows * width);
            }
        }
        if !has_residual_codes {
            files.card.lm.bypass = false;
            tensors.remove("bypass");
        }
        let first = files.vocab.layout().code(0) as usize * width;
        let rows = tensors.get_mut("t5.shared").filter(|_| !has_residual_codes);
        if let Some(rows) = rows.and_then(|shared| shared.values.get_mut(first..)) {
            let codes = codebook.values.chunks_exact(expected[1]);
            for (row, code) in rows.chunks_exact_mut(width).zip(codes) {
                // Features have unit mean square where they enter the bypass.
                let power = code.iter().map(|v| v * v).sum::<f32>() / code.len() as f32;
                let scale = (power + 1e-6).sqrt().recip();
                for (value, weights) in code.iter().zip(bypass.values.chunks_exact(width)) {
                    let both = row.iter_mut().zip(weights);
                    both.for_each(|(out, weight)| *out += scale * value * weight);
                }
            }
        }
        Ok(Self {
            net: RadarNet::T5(load_net(&files.card.lm, tensors, device, &path)?),
            vocab: files.vocab,
            config: files.card.lm,
            adapters: None,
            learned: files.card.learned,
        })
    }

    /// Builds the network of a checkpoint.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn from_files(files: LmFiles, device: &Device) -> Result<Self, LmError> {
        let (net, adapters) = if files.is_t5() {
            let (weights, path) = files.t5_weights()?;
            let net = load_net(&files.card.lm, weights, device, &path)?;
            (RadarNet::T5(net), None)
        } else {
            load_decoder(&files.card, &files.checkpoint, device)?
        };
        Ok(Self {
            net,
            vocab: files.vocab,
            config: files.card.lm,
            adapters,
            learned: files.card.learned,
        })
    }

    /// Adds this model's files to a checkpoint.
    ///
    /// # Errors
    /// If one cannot be encoded.
    pub fn add_to(&self, files: &mut CheckpointFiles) -> Result<(), LmError> {
        files.json(CONFIG_FILE, &card_to_json(&self.card(MODEL_FILE)))?;
        files.bytes(
            TEXT_TOKENIZER_FILE,
            self.vocab.tokenizer_json()?.into_bytes(),
        );
        self.add_weights(&self.net, files)
    }

    /// The content of `config.json`; `weights` is a T5's file for inference.
    pub fn card(&self, weights: &str) -> LmCard {
        LmCard {
            lm: self.config.clone(),
            vocab: self.vocab.layout().clone(),
            weights: weights.into(),
            base_blake3: self.adapters.as_ref().map(|a| a.base_blake3.clone()),
            learned: self.learned.clone(),
        }
    }

    /// Adds the weights of `net`, a network of this model's architecture, to a checkpoint.
    ///
    /// # Errors
    /// If they cannot be encoded.
    pub fn add_weights(&self, net: &RadarNet, files: &mut CheckpointFiles) -> Result<(), LmError> {
        match net {
            RadarNet::T5(net) => Ok(files.tensors(MODEL_FILE, &collect_params(net))?),
            RadarNet::Decoder(net) => net.add_to(self.adapters.as_ref(), files),
        }
    }

    /// Returns `net`, a network of this model's architecture, with the weights of a checkpoint.
    ///
    /// # Errors
    /// Missing and unknown tensors, mismatched shapes.
    pub fn load_weights(
        &self,
        net: RadarNet,
        checkpoint: &Checkpoint,
    ) -> Result<RadarNet, LmError> {
        Ok(match net {
            RadarNet::T5(net) => RadarNet::T5(load_model(checkpoint, net)?),
            RadarNet::Decoder(net) => {
                RadarNet::Decoder(net.load_from(checkpoint, self.adapters.is_some())?)
            }
        })
    }

    /// Whether a parameter, identified by its path in [`Self::net`], is trained. With adapters, only the adapters, the
    /// rows of new ids and the bypass are trained.
    pub fn is_trained(&self, path: &str) -> bool {
        self.adapters.is_none()
            || path.contains(".lora.")
            || path.ends_with(".added")
            || path.ends_with("bypass")
    }

    /// Sets the dropout probability in training.
    pub fn set_dropout(&mut self, p: f64) {
        self.config.network.set_dropout(p);
        match &mut self.net {
            RadarNet::T5(net) => net.t5.set_dropout(p),
            RadarNet::Decoder(net) => net.decoder.set_dropout(p),
        }
    }

    /// Merges the adapters into the weights, so that the model can be saved as a whole.
    pub fn merge(&mut self) {
        if let RadarNet::Decoder(net) = &mut self.net {
            net.decoder.merge();
        }
        self.adapters = None;
    }

    /// Writes a checkpoint that [`Self::load`] opens.
    ///
    /// # Errors
    /// If the file system reports an error.
    pub fn save(&self, dir: &Path) -> Result<(), LmError> {
        let mut files = CheckpointFiles::default();
        self.add_to(&mut files)?;
        Ok(files.write(dir)?)
    }

    /// Packs the current weights for the inference engine.
    ///
    /// # Errors
    /// [`LmError::NotT5`] for a decoder-only network; an error if the engine does not support the architecture.
    pub fn pack(&self, precision: Precision) -> Result<EngineLm, LmError> {
        let weights = match &self.net {
            RadarNet::T5(net) => collect_params(net),
            RadarNet::Decoder(_) => NamedTensors::new(),
        };
        let file = Path::new("language model in memory");
        EngineLm::from_weights(
            self.config.clone(),
            self.vocab.clone(),
            weights,
            precision,
            file,
        )
    }

    /// The prompt that asks for a description, which training always includes.
    ///
    /// # Errors
    /// If a code is outside the codebook or the features do not fit the codes.
    pub fn describe_prompt(&self, radar: &Encoded) -> Result<Source, LmError> {
        let mut source = self.vocab.prompt(EVALUATION_PROMPT, Some(radar), None)?;
        self.config
            .project(&mut source, self.vocab.layout().code(0));
        self.check(&source)?;
        Ok(source)
    }

    /// Checks that an input fits the network.
    ///
    /// # Errors
    /// [`LmError::Input`] describes the mismatch.
    pub fn check(&self, source: &Source) -> Result<(), LmError> {
        let found = source.ids.len();
        if found == 0 || found > MAX_SOURCE {
            let max = MAX_SOURCE;
            return Err(InputError::Tokens { found, max }.into());
        }
        let vocab_size = self.config.network.vocab_size();
        if let Some(&id) = source.ids.iter().find(|id| **id as usize >= vocab_size) {
            return Err(InputError::Id { id }.into());
        }
        // A model without the bypass does not use features, so their width is irrelevant.
        let expected = source.feature_positions.len() * self.config.code_dim;
        let found = source.features.len();
        if self.config.bypass && found != expected {
            return Err(InputError::Features { found, expected }.into());
        }
        if source.features.iter().any(|v| !v.is_finite()) {
            return Err(InputError::FeatureNotFinite.into());
        }
        // A decoder-only network reads the last token, an end token, as the first step of decoding.
        let n = source.ids.len() - usize::from(self.config.t5().is_none());
        if source.feature_positions.iter().any(|p| *p as usize >= n) {
            return Err(InputError::FeaturePosition.into());
        }
        Ok(())
    }
}

/// A decoder-only network: a whole model, or its base with adapters.
fn load_decoder(
    card: &LmCard,
    checkpoint: &Checkpoint,
    device: &Device,
) -> Result<(RadarNet, Option<Adapters>), LmError> {
    let Some(base_blake3) = &card.base_blake3 else {
        let base = read_base(checkpoint.dir(), device)?;
        let net = RadarDecoder::new(base.decoder, &card.lm, 0, device);
        return Ok((RadarNet::Decoder(net.load_bypass(checkpoint)?), None));
    };
    let (adapters, mut decoder) = read_adapters(checkpoint, base_blake3.clone(), |dir| {
        read_base(dir, device)
    })?;
    let mut shape = decoder.config();
    let n_rows = shape.vocab_size();
    shape.set_vocab_size(card.lm.network.vocab_size());
    if shape.backbone() != card.lm.network.backbone() || n_rows >= shape.vocab_size() {
        return Err(LmError::Config {
            field: "base_model_name_or_path",
            problem: format!(
                "a {} of {n_rows} rows is no base of a {} of {}",
                shape.backbone().name(),
                card.lm.network.backbone().name(),
                shape.vocab_size()
            ),
        });
    }
    // The specified layout is not trusted: the file must contain this number of rows.
    let n_added = shape.vocab_size() - n_rows;
    let file = checkpoint.tensors(RADAR_FILE)?;
    let has_rows = |(name, t): (&String, &HostTensor)| {
        name.ends_with(".added") && t.shape.first() == Some(&n_added)
    };
    if !file.iter().any(has_rows) {
        return Err(LmError::Config {
            field: "vocab_size",
            problem: format!("{RADAR_FILE} has no {n_added} rows of new ids"),
        });
    }
    decoder.extend(n_added, 0);
    decoder.adapt(adapters.config, 0);
    let net = RadarDecoder::new(decoder, &card.lm, 0, device);
    let net = net.load_from(checkpoint, true)?;
    Ok((RadarNet::Decoder(net), Some(adapters)))
}

/// Extends matrices of `d_model` columns from `before` to `after` rows by uniform random numbers with the standard
/// deviation of the existing ones. Matrices of another shape stay; loading reports them with both shapes.
fn add_rows(
    tensors: &mut NamedTensors,
    names: [&str; 2],
    [before, after]: [usize; 2],
    d_model: usize,
    seed: u64,
) {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    for name in names {
        let Some(tensor) = tensors.get_mut(name) else {
            continue;
        };
        if tensor.shape != [before, d_model] {
            continue;
        }
        let n = tensor.values.len() as f32;
        let spread = (tensor.values.iter().map(|v| v * v).sum::<f32>() / n).sqrt();
        let half_width = spread * 3f32.sqrt();
        let new = (after - before) * d_model;
        tensor
            .values
            .extend((0..new).map(|_| (2.0 * rng.random::<f32>() - 1.0) * half_width));
        tensor.shape[0] = after;
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
    let NetworkConfig::T5(shape) = &config.network else {
        return Err(LmError::Config {
            field: "network",
            problem: "expected a T5".into(),
        });
    };
    let t5: T5 = hf::build_t5(shape, t5, device, file)?;
    let expected = vec![config.code_dim, shape.d_model];
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
    use radarllm_inference::lm::{T5Config, templates};

    /// A small pretrained folder: the golden v1.1 weights with a word tokenizer that has
    /// T5's special tokens at T5's ids.
    #[test]
    fn a_pretrained_t5_gains_radar_rows_and_keeps_its_own() {
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/goldens/t5_v11.safetensors");
        let bytes = std::fs::read(&golden).unwrap();
        let (_, metadata) = safetensors::SafeTensors::read_metadata(&bytes).unwrap();
        let config = metadata.metadata().as_ref().unwrap()["config"].clone();
        let mut tensors = radarllm_inference::checkpoint::read_safetensors(&golden).unwrap();
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
        let lm = RadarLm::from_hf_folder(&dir, None, 8, 4, true, 1, &Device::flex()).unwrap();
        std::fs::remove_dir_all(&dir).unwrap();
        let layout = lm.vocab.layout();
        assert_eq!(
            (layout.n_text, layout.first_code, layout.size()),
            (5, 40, 50)
        );
        assert_eq!((layout.sentinel(0), layout.sentinel(1)), (6, 5));
        let shared = &collect_params(lm.net.t5().unwrap())["t5.shared"];
        assert_eq!(shared.shape, [50, 16]);
        assert_eq!(shared.values[..old.values.len()], old.values);
        // New rows have the same magnitude as old ones: 160 values, so the rms is known to about 10 %.
        let rms = |v: &[f32]| (v.iter().map(|x| x * x).sum::<f32>() / v.len() as f32).sqrt();
        let ratio = rms(&shared.values[old.values.len()..]) / rms(&old.values);
        assert!((0.75..1.25).contains(&ratio), "{ratio}");
        let radar = Encoded {
            codes: vec![1, 7],
            features: vec![0.5; 8],
            ..Encoded::default()
        };
        let source = lm.describe_prompt(&radar).unwrap();
        assert_eq!(source.ids, [3, 48, 41, 47, 49, 1]);
        assert!(lm.generate(&[source], &Default::default()).is_ok());
    }

    fn small() -> RadarLm {
        let texts = ["a person walks"];
        let vocab = Vocab::learn(texts.into_iter(), templates::all_text(), 600, 4, 8).unwrap();
        let shape = radarllm_inference::lm::LmPreset::Small.config(8, 4);
        RadarLm::new(shape, vocab, 1, &Device::flex()).unwrap()
    }

    #[test]
    fn a_model_gains_rows_for_the_context_and_keeps_its_own() {
        let lm = small();
        let dir = std::env::temp_dir().join(format!("radarllm-lm-told-{}", std::process::id()));
        let (first, second) = (dir.join("without"), dir.join("with"));
        std::fs::create_dir_all(&dir).unwrap();
        let write = |lm: &RadarLm, dir: &Path| {
            let mut files = CheckpointFiles::default();
            lm.add_to(&mut files).unwrap();
            files.write(dir).unwrap();
        };
        write(&lm, &first);
        let with_context = RadarLm::load_with_context(&first, 1, &Device::flex()).unwrap();
        let (old, new) = (lm.vocab.layout(), with_context.vocab.layout());
        assert!(!lm.vocab.has_context() && with_context.vocab.has_context());
        assert!(new.size() > old.size());
        let [before, after] = [&lm, &with_context].map(|lm| collect_params(lm.net.t5().unwrap()));
        for (name, tensor) in &before {
            let found = &after[name];
            assert_eq!(found.values[..tensor.values.len()], tensor.values, "{name}");
            if name.ends_with("shared") || name.ends_with("head") {
                assert_eq!(found.shape[0], new.size());
            } else {
                assert_eq!(found.shape, tensor.shape, "{name}");
            }
        }
        // A model that has the rows is loaded as it is.
        write(&with_context, &second);
        let again = RadarLm::load_with_context(&second, 2, &Device::flex()).unwrap();
        let again = collect_params(again.net.t5().unwrap());
        assert!(after.iter().all(|(name, t)| again[name].values == t.values));
        std::fs::remove_dir_all(&dir).unwrap();
    }

    /// With features that are the vectors of the codes, a model with bypass reads what the one with tokens alone reads.
    #[test]
    fn tokens_alone_say_what_the_vectors_of_their_codes_said() {
        let device = Device::flex();
        let lm = small();
        let dir = std::env::temp_dir().join(format!("radarllm-lm-tokens-{}", std::process::id()));
        std::fs::create_dir_all(&dir).unwrap();
        let folder = dir.join("model");
        let mut files = CheckpointFiles::default();
        lm.add_to(&mut files).unwrap();
        files.write(&folder).unwrap();
        // A model with context loses its rows.
        let with_context = RadarLm::load_with_context(&folder, 1, &device).unwrap();
        let mut files = CheckpointFiles::default();
        with_context.add_to(&mut files).unwrap();
        files.write(&dir.join("context")).unwrap();
        let codebook = HostTensor {
            shape: vec![8, 4],
            values: (0..32).map(|i| ((i * 7 % 11) as f32 - 5.0) * 0.3).collect(),
        };
        let codes = vec![3, 0, 7, 7, 5];
        let vectors = codes
            .iter()
            .flat_map(|k| &codebook.values[4 * *k as usize..][..4]);
        let features = vectors.copied().collect();
        let radar = Encoded {
            codes,
            features,
            ..Encoded::default()
        };
        let logits = |lm: &RadarLm| -> Vec<f32> {
            let net = lm.net.t5().unwrap();
            let source = lm.describe_prompt(&radar).unwrap();
            let batch = crate::lm::SourceBatch::new(&[&source], lm.config.code_dim, &device);
            let states = net.forward(&batch, &[0, 30, 31], 3, None);
            let n_rows = lm.config.network.vocab_size();
            let logits = net.t5.logits(states, n_rows, Default::default());
            logits.into_data().try_into_vec().unwrap()
        };
        let expected = logits(&lm);
        for name in ["model", "context"] {
            let alone =
                RadarLm::load_tokens_only(&dir.join(name), &codebook, false, &device).unwrap();
            assert!(!alone.config.bypass && !alone.vocab.has_context());
            assert_eq!(alone.vocab.layout(), lm.vocab.layout());
            // Rows of the output are tied to the embeddings, so that those of the codes change: words are compared.
            let n_rows = lm.config.network.vocab_size();
            let n_words = lm.vocab.layout().n_text as usize;
            let words = |all: &[f32]| -> Vec<f32> {
                let rows = all.chunks_exact(n_rows);
                rows.flat_map(|row| &row[..n_words]).copied().collect()
            };
            for (found, expected) in words(&logits(&alone)).iter().zip(words(&expected)) {
                assert!((found - expected).abs() < 1e-3, "{found} {expected}");
            }
        }
        // The vectors of both codes enter the bypass, so that weights and words stay as they are.
        let two = RadarLm::load_tokens_only(&folder, &codebook, true, &device).unwrap();
        assert!(two.config.bypass && !two.vocab.has_context());
        assert_eq!(logits(&two), expected);
        let other = HostTensor {
            shape: vec![4, 8],
            ..codebook.clone()
        };
        let refused = |dir: &Path, codebook: &HostTensor| {
            let opened = RadarLm::load_tokens_only(dir, codebook, false, &device);
            opened.err().unwrap().to_string()
        };
        let error = refused(&folder, &other);
        assert!(error.contains("[4, 8], expected [8, 4]"), "{error}");
        let alone = RadarLm::load_tokens_only(&folder, &codebook, false, &device).unwrap();
        alone.save(&dir.join("alone")).unwrap();
        let error = refused(&dir.join("alone"), &codebook);
        assert!(
            error.contains("reads its radar tokens alone already"),
            "{error}"
        );
        std::fs::remove_dir_all(&dir).unwrap();
    }

    fn t5(card: &mut LmCard) -> &mut T5Config {
        let NetworkConfig::T5(t5) = &mut card.lm.network else {
            panic!("not a T5");
        };
        t5
    }

    #[test]
    fn damaged_models_are_errors() {
        let lm = small();
        let dir = std::env::temp_dir().join(format!("radarllm-lm-bad-{}", std::process::id()));
        let card = |change: &dyn Fn(&mut LmCard)| {
            let mut files = CheckpointFiles::default();
            lm.add_to(&mut files).unwrap();
            let vocab = lm.vocab.layout().clone();
            let mut card = LmCard {
                vocab,
                ..lm.card(MODEL_FILE)
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
            // This size would need terabytes if it were trusted.
            &(|c: &mut LmCard| t5(c).d_ff = 60_000) as &dyn Fn(&mut LmCard),
            &|c| t5(c).n_encoder_layers = 4,
            &|c| c.lm.bypass = false,
            &|c| c.lm.code_dim = 5,
            &|c| c.vocab.n_codes += 1,
            &|c| t5(c).dropout = 2.0,
            &|c| c.weights = "average.safetensors".into(),
        ] {
            assert!(card(change).is_some());
        }
        std::fs::remove_dir_all(dir).unwrap();
    }
}
