//! Files of decoder-only networks: Hugging Face's names, shards, and PEFT's adapters.
//!
//! A whole model consists of `config.json`, `tokenizer.json` and `model.safetensors` (or shards with an index), so that
//! other programs can open it. Settings that they do not support (vocabulary layout, radar) are under `radarllm` in
//! `config.json`. A model with adapters does not copy the base: `adapter_model.safetensors` and `adapter_config.json`
//! have PEFT's format (names: <https://huggingface.co/docs/peft/developer_guides/checkpoint>), and `radar.safetensors`
//! contains the rows of new ids. In both forms, it also contains the radar bypass.

use std::fs;
use std::path::{Path, PathBuf};

use burn::tensor::Device;
use serde::{Deserialize, Serialize};

use super::decoder::{DecoderOnlyNet, RadarDecoder};
use super::folder::Pretrained;
use super::layers::LoraConfig;
use crate::lm::hf::{read_small, read_tensors};
use crate::params::{
    collect_params, collect_some_params, load_params, param_shapes, replace_params,
};
use radarllm_inference::checkpoint::{
    CONFIG_FILE, Checkpoint, CheckpointError, CheckpointFiles, HostTensor, MODEL_FILE, NamedTensors,
};
use radarllm_inference::lm::LmError;
use radarllm_inference::lm::config::NetworkConfig;

/// PEFT's adapter weights.
pub const ADAPTER_FILE: &str = "adapter_model.safetensors";
/// PEFT's adapter settings.
pub const ADAPTER_CONFIG_FILE: &str = "adapter_config.json";
/// Rows of new ids that accompany adapters, and the radar bypass.
pub const RADAR_FILE: &str = "radar.safetensors";
/// The index that lists the shards of a large model.
const INDEX_FILE: &str = "model.safetensors.index.json";
/// Weights that exceed this many bytes are written in shards (5 GB, as in older Hugging Face versions).
const SHARD_BYTES: usize = 5_000_000_000;

/// Adapters of a model, and the base checkpoint that they belong to.
#[derive(Clone, Debug, PartialEq)]
pub struct Adapters {
    /// Settings.
    pub config: LoraConfig,
    /// Folder of the base checkpoint.
    pub base: PathBuf,
    /// [`fingerprint`] of its weights.
    pub base_blake3: String,
}

/// The fields of PEFT's `adapter_config.json` that are used here.
#[derive(Debug, Serialize, Deserialize)]
struct PeftConfig {
    peft_type: String,
    task_type: String,
    base_model_name_or_path: PathBuf,
    r: usize,
    lora_alpha: f64,
    lora_dropout: f64,
    target_modules: Vec<String>,
    /// GPT-2 stores its weights as `[in, out]`.
    fan_in_fan_out: bool,
    bias: String,
    inference_mode: bool,
    #[serde(default)]
    use_dora: bool,
    #[serde(default)]
    use_rslora: bool,
    /// Scales of single modules.
    #[serde(default, skip_serializing_if = "serde_json::Map::is_empty")]
    alpha_pattern: serde_json::Map<String, serde_json::Value>,
    /// Ranks of single modules.
    #[serde(default, skip_serializing_if = "serde_json::Map::is_empty")]
    rank_pattern: serde_json::Map<String, serde_json::Value>,
}

/// A pretrained decoder.
pub struct Base {
    /// The network.
    pub decoder: DecoderOnlyNet,
    /// The checkpoint's end token.
    pub end: Option<u32>,
    /// [`fingerprint`] of the weights.
    pub blake3: String,
}

/// Reads a decoder's folder in Hugging Face's layout.
///
/// # Errors
/// Missing or damaged files, tensors that do not fit, an architecture that is not decoder-only.
pub fn read_base(dir: &Path, device: &Device) -> Result<Base, LmError> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Ids {
        One(u32),
        Many(Vec<u32>),
    }
    #[derive(Deserialize)]
    struct End {
        #[serde(default)]
        eos_token_id: Option<Ids>,
    }
    let file = dir.join(CONFIG_FILE);
    let config = read_small(&file)?;
    let end: End =
        serde_json::from_slice(&config).map_err(|e| crate::lm::hf::json_error(&file, &e))?;
    let mut tensors = read_tensors(dir)?;
    let blake3 = fingerprint(&tensors);
    let mut json: serde_json::Value =
        serde_json::from_slice(&config).map_err(|e| crate::lm::hf::json_error(&file, &e))?;
    // A copy of the embedding under the head's name would be trained separately from it.
    for embedding in [
        "transformer.wte.weight",
        "wte.weight",
        "model.embed_tokens.weight",
    ] {
        if tensors.contains_key(embedding)
            && tensors.get(embedding) == tensors.get("lm_head.weight")
        {
            tensors.remove("lm_head.weight");
            if let Some(object) = json.as_object_mut() {
                object.insert("tie_word_embeddings".into(), true.into());
            }
        }
    }
    let config = json.to_string();
    let decoder = match Pretrained::from_parts(config.as_bytes(), &file, tensors, device)? {
        Pretrained::Gpt2(net) => DecoderOnlyNet::Gpt2(*net),
        Pretrained::Qwen2(net) => DecoderOnlyNet::Qwen2(*net),
        other => {
            return Err(LmError::Config {
                field: "model_type",
                problem: format!("expected gpt2 or qwen2, found `{}`", other.architecture()),
            });
        }
    };
    Ok(Base {
        decoder,
        end: end.eos_token_id.and_then(|ids| match ids {
            Ids::One(id) => Some(id),
            Ids::Many(ids) => ids.first().copied(),
        }),
        blake3,
    })
}

/// BLAKE3 of names and values, independent of how the weights are distributed over files.
pub fn fingerprint(tensors: &NamedTensors) -> String {
    let mut hasher = blake3::Hasher::new();
    let mut bytes = Vec::new();
    for (name, tensor) in tensors {
        hasher.update(name.as_bytes());
        for chunk in tensor.values.chunks(1 << 16) {
            bytes.clear();
            bytes.extend(chunk.iter().flat_map(|v| v.to_le_bytes()));
            hasher.update(&bytes);
        }
    }
    hasher.finalize().to_hex().to_string()
}

impl DecoderOnlyNet {
    /// How paths in the module differ from the checkpoint's names.
    fn prefixes(&self) -> (&'static str, &'static str) {
        match self {
            Self::Gpt2(_) => ("Gpt2.", "transformer."),
            Self::Qwen2(_) => ("Qwen2.", "model."),
        }
    }

    fn target_modules(&self) -> &'static [&'static str] {
        match self {
            Self::Gpt2(_) => &["c_attn"],
            Self::Qwen2(_) => &["q_proj", "v_proj"],
        }
    }

    /// The checkpoint's name of a path in this module.
    fn name(&self, path: &str) -> String {
        let (ours, theirs) = self.prefixes();
        let path = path.strip_prefix(ours).unwrap_or(path);
        if path.starts_with("lm_head.") {
            path.into()
        } else {
            format!("{theirs}{path}")
        }
    }

    /// Whether a checkpoint stores this weight as `[out, in]`.
    fn is_transposed(&self, path: &str) -> bool {
        matches!(self, Self::Qwen2(_)) && path.ends_with("_proj.weight")
    }

    /// All weights under Hugging Face's names, with added rows after the others. Adapters are left out.
    pub fn to_hf(&self) -> NamedTensors {
        let mut params = collect_params(self);
        let added: Vec<(String, HostTensor)> = params
            .extract_if(.., |path, _| path.ends_with(".added"))
            .collect();
        for (path, rows) in added {
            let stem = path.trim_end_matches("added");
            if let Some(weight) = params.get_mut(&format!("{stem}weight")) {
                weight.shape[0] += rows.shape[0];
                weight.values.extend(rows.values);
            }
        }
        params
            .into_iter()
            .filter(|(path, _)| !path.contains(".lora."))
            .map(|(path, tensor)| {
                let tensor = if self.is_transposed(&path) {
                    tensor.transposed()
                } else {
                    tensor
                };
                (self.name(&path), tensor)
            })
            .collect()
    }

    /// This network with the weights that [`Self::to_hf`] names.
    ///
    /// # Errors
    /// Missing and unknown tensors, mismatched shapes.
    fn with_hf(self, mut theirs: NamedTensors, file: &Path) -> Result<Self, LmError> {
        let mut ours = NamedTensors::new();
        let shapes = param_shapes(&self);
        for (path, shape) in shapes.clone() {
            if path.ends_with(".added") {
                continue;
            }
            // `load_params` reports a missing tensor by name.
            let Some(mut tensor) = theirs.remove(&self.name(&path)) else {
                continue;
            };
            if self.is_transposed(&path) && tensor.shape.len() == 2 {
                tensor = tensor.transposed();
            }
            let stem = path.trim_end_matches("weight");
            if path.ends_with(".weight")
                && let Some(added) = shapes.get(&format!("{stem}added"))
                && tensor.shape == [shape[0] + added[0], shape[1]]
            {
                let values = tensor.values.split_off(shape[0] * shape[1]);
                tensor.shape[0] = shape[0];
                let shape = added.clone();
                ours.insert(format!("{stem}added"), HostTensor { shape, values });
            }
            ours.insert(path, tensor);
        }
        no_more(theirs, file)?;
        Ok(load_params(self, ours, file)?)
    }
}

/// PEFT's name of one of our adapter matrices, `a` or `b`.
fn peft_name(decoder: &DecoderOnlyNet, path: &str) -> Option<String> {
    let (stem, matrix) = path.rsplit_once(".lora.")?;
    let name = decoder.name(stem);
    let matrix = matrix.to_uppercase();
    Some(format!("base_model.model.{name}.lora_{matrix}.weight"))
}

impl RadarDecoder {
    /// Adds the weights to a checkpoint: whole, or the adapters alone.
    ///
    /// # Errors
    /// If a file cannot be encoded.
    pub fn add_to(
        &self,
        adapters: Option<&Adapters>,
        files: &mut CheckpointFiles,
    ) -> Result<(), LmError> {
        let mut radar = NamedTensors::new();
        match adapters {
            None => add_shards(files, self.decoder.to_hf(), SHARD_BYTES)?,
            Some(adapters) => {
                let mut peft = NamedTensors::new();
                let wanted = |path: &str| path.contains(".lora.") || path.ends_with(".added");
                for (path, tensor) in collect_some_params(&self.decoder, &wanted) {
                    if let Some(name) = peft_name(&self.decoder, &path) {
                        peft.insert(name, tensor.transposed());
                    } else {
                        radar.insert(self.decoder.name(&path), tensor);
                    }
                }
                files.tensors(ADAPTER_FILE, &peft)?;
                let modules = self.decoder.target_modules();
                let config = PeftConfig {
                    peft_type: "LORA".into(),
                    task_type: "CAUSAL_LM".into(),
                    base_model_name_or_path: adapters.base.clone(),
                    r: adapters.config.rank,
                    lora_alpha: adapters.config.alpha,
                    lora_dropout: adapters.config.dropout,
                    target_modules: modules.iter().map(|m| (*m).into()).collect(),
                    fan_in_fan_out: matches!(self.decoder, DecoderOnlyNet::Gpt2(_)),
                    bias: "none".into(),
                    inference_mode: true,
                    use_dora: false,
                    use_rslora: false,
                    alpha_pattern: Default::default(),
                    rank_pattern: Default::default(),
                };
                files.json(ADAPTER_CONFIG_FILE, &config)?;
            }
        }
        radar.extend(collect_some_params(self, &|path| path == "bypass"));
        if !radar.is_empty() {
            files.tensors(RADAR_FILE, &radar)?;
        }
        Ok(())
    }

    /// Returns this network with the weights of a checkpoint that [`Self::add_to`] wrote: the same architecture, with
    /// adapters and added rows at the same places.
    ///
    /// # Errors
    /// Missing and unknown tensors, mismatched shapes.
    pub fn load_from(self, checkpoint: &Checkpoint, has_adapters: bool) -> Result<Self, LmError> {
        let Self { decoder, bypass } = self;
        let mut radar = radar_tensors(checkpoint)?;
        let decoder = if has_adapters {
            load_adapters(decoder, checkpoint, &mut radar)?
        } else {
            let tensors = read_tensors(checkpoint.dir())?;
            decoder.with_hf(tensors, &checkpoint.dir().join(MODEL_FILE))?
        };
        Self { decoder, bypass }.with_bypass(radar, checkpoint)
    }

    /// Loads only the bypass of a checkpoint; this network already has its other weights.
    ///
    /// # Errors
    /// Missing and unknown tensors, mismatched shapes.
    pub fn load_bypass(self, checkpoint: &Checkpoint) -> Result<Self, LmError> {
        let radar = radar_tensors(checkpoint)?;
        self.with_bypass(radar, checkpoint)
    }

    /// Any remaining tensor of a checkpoint's [`RADAR_FILE`] must be the bypass.
    fn with_bypass(
        self,
        mut radar: NamedTensors,
        checkpoint: &Checkpoint,
    ) -> Result<Self, LmError> {
        let file = checkpoint.dir().join(RADAR_FILE);
        let mut tensors = NamedTensors::new();
        if let Some(bypass) = &self.bypass {
            let name = "bypass".to_string();
            let found = take(&mut radar, &name, &bypass.dims(), &file)?;
            tensors.insert(name, found);
        }
        no_more(radar, &file)?;
        Ok(replace_params(self, tensors))
    }
}

/// Takes a tensor of a file, and checks its shape.
fn take(
    tensors: &mut NamedTensors,
    name: &str,
    expected: &[usize],
    file: &Path,
) -> Result<HostTensor, CheckpointError> {
    let (path, tensor, expected) = (file.into(), name.to_string(), expected.to_vec());
    match tensors.remove(name) {
        Some(found) if found.shape == expected => Ok(found),
        Some(found) => Err(CheckpointError::Shape {
            path,
            tensor,
            expected,
            found: found.shape,
        }),
        None => Err(CheckpointError::MissingTensor {
            path,
            tensor,
            expected,
        }),
    }
}

/// Checks that no tensor of a file remains unused.
fn no_more(tensors: NamedTensors, file: &Path) -> Result<(), CheckpointError> {
    match tensors.into_keys().next() {
        Some(tensor) => Err(CheckpointError::UnknownTensor {
            path: file.into(),
            tensor,
        }),
        None => Ok(()),
    }
}

fn radar_tensors(checkpoint: &Checkpoint) -> Result<NamedTensors, LmError> {
    match checkpoint.has(RADAR_FILE) {
        true => Ok(checkpoint.tensors(RADAR_FILE)?),
        false => Ok(NamedTensors::new()),
    }
}

/// Keeps the base's own weights, and loads adapters and added rows from the checkpoint.
fn load_adapters(
    decoder: DecoderOnlyNet,
    checkpoint: &Checkpoint,
    radar: &mut NamedTensors,
) -> Result<DecoderOnlyNet, LmError> {
    let file = checkpoint.dir().join(ADAPTER_FILE);
    let radar_file = checkpoint.dir().join(RADAR_FILE);
    let mut peft = checkpoint.tensors(ADAPTER_FILE)?;
    let mut tensors = NamedTensors::new();
    for (path, mut shape) in param_shapes(&decoder) {
        let found = if let Some(name) = peft_name(&decoder, &path) {
            shape.reverse();
            take(&mut peft, &name, &shape, &file)?.transposed()
        } else if path.ends_with(".added") {
            take(radar, &decoder.name(&path), &shape, &radar_file)?
        } else {
            continue;
        };
        tensors.insert(path, found);
    }
    no_more(peft, &file)?;
    Ok(replace_params(decoder, tensors))
}

/// PEFT's settings of a checkpoint.
///
/// # Errors
/// If they are missing, or of an unsupported kind.
pub fn read_adapters(
    checkpoint: &Checkpoint,
    base_blake3: String,
    decoder: impl FnOnce(&Path) -> Result<Base, LmError>,
) -> Result<(Adapters, DecoderOnlyNet), LmError> {
    let peft: PeftConfig = checkpoint.json(ADAPTER_CONFIG_FILE)?;
    let file = checkpoint.dir().join(ADAPTER_CONFIG_FILE);
    let fail = |message: String| {
        let path = file.clone();
        Err(CheckpointError::Config { path, message }.into())
    };
    if peft.peft_type != "LORA" || peft.use_dora || peft.use_rslora || peft.bias != "none" {
        return fail(format!(
            "expected plain LORA without biases, found {}{}{}, bias {}",
            peft.peft_type,
            if peft.use_dora { ", DoRA" } else { "" },
            if peft.use_rslora {
                ", rank-stabilised"
            } else {
                ""
            },
            peft.bias
        ));
    }
    for (field, pattern) in [
        ("alpha_pattern", &peft.alpha_pattern),
        ("rank_pattern", &peft.rank_pattern),
    ] {
        if !pattern.is_empty() {
            return fail(format!(
                "{field}: expected none, found one for {:?}; adapters here have one rank and one scale",
                pattern.keys().collect::<Vec<_>>()
            ));
        }
    }
    let config = LoraConfig {
        rank: peft.r,
        alpha: peft.lora_alpha,
        dropout: peft.lora_dropout,
    };
    config.validate()?;
    let base = decoder(&peft.base_model_name_or_path)?;
    let expected = base.decoder.target_modules();
    // PEFT writes the modules of a set, in any order.
    let is_expected = peft.target_modules.len() == expected.len()
        && expected
            .iter()
            .all(|module| peft.target_modules.iter().any(|found| found == module));
    if !is_expected {
        return fail(format!(
            "target_modules: expected {expected:?}, found {:?}",
            peft.target_modules
        ));
    }
    if base.blake3 != base_blake3 {
        return fail(format!(
            "{}: is not the base these adapters were trained on",
            peft.base_model_name_or_path.display()
        ));
    }
    let adapters = Adapters {
        config,
        base: peft.base_model_name_or_path,
        base_blake3,
    };
    Ok((adapters, base.decoder))
}

/// Adds weights as one file, or as shards of up to `most` bytes with an index.
fn add_shards(
    files: &mut CheckpointFiles,
    tensors: NamedTensors,
    max: usize,
) -> Result<(), CheckpointError> {
    let bytes_of = |tensor: &HostTensor| 4 * tensor.values.len();
    let total: usize = tensors.values().map(bytes_of).sum();
    if total <= max {
        return files.tensors(MODEL_FILE, &tensors);
    }
    let mut shards = vec![NamedTensors::new()];
    let mut filled = 0;
    for (name, tensor) in tensors {
        let bytes = bytes_of(&tensor);
        if filled > 0 && filled + bytes > max {
            shards.push(NamedTensors::new());
            filled = 0;
        }
        filled += bytes;
        if let Some(shard) = shards.last_mut() {
            shard.insert(name, tensor);
        }
    }
    let n = shards.len();
    let mut map = serde_json::Map::new();
    for (i, shard) in shards.iter().enumerate() {
        let file = format!("model-{:05}-of-{n:05}.safetensors", i + 1);
        files.tensors(&file, shard)?;
        map.extend(shard.keys().map(|name| (name.clone(), file.clone().into())));
    }
    let index = serde_json::json!({"metadata": {"total_size": total}, "weight_map": map});
    files.json(INDEX_FILE, &index)
}

/// The absolute path of a base, so that a model can be opened from any working directory.
pub fn absolute(dir: &Path) -> Result<PathBuf, LmError> {
    let io = |source| CheckpointError::Io {
        path: dir.into(),
        source,
    };
    Ok(fs::canonicalize(dir).map_err(io)?)
}

/// A decoder's architecture as Hugging Face's `config.json`, without this project's own fields.
pub fn hf_config(config: &NetworkConfig, end: u32) -> serde_json::Value {
    let (value, architecture) = match config {
        NetworkConfig::T5(c) => (serde_json::to_value(c), "T5ForConditionalGeneration"),
        NetworkConfig::Gpt2(c) => (serde_json::to_value(c), "GPT2LMHeadModel"),
        NetworkConfig::Qwen2(c) => (serde_json::to_value(c), "Qwen2ForCausalLM"),
    };
    let mut value = value.unwrap_or_default();
    value["model_type"] = config.backbone().name().into();
    value["architectures"] = serde_json::json!([architecture]);
    for token in ["bos_token_id", "eos_token_id"] {
        value[token] = end.into();
    }
    value
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::lm::hf::read;
    use crate::lm::radar_lm::card_to_json;
    use crate::lm::{RadarLm, RadarNet};
    use radarllm_inference::checkpoint::read_safetensors;
    use radarllm_inference::lm::card::TEXT_TOKENIZER_FILE;
    use radarllm_inference::lm::{GenerateOptions, Source};
    use radarllm_inference::tokenizer::Encoded;

    const KINDS: [&str; 2] = ["gpt2", "qwen2"];

    fn golden(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("tests/goldens")
            .join(format!("{name}.safetensors"))
    }

    pub fn scratch(name: &str) -> PathBuf {
        let name = format!("radarllm-decoder-{}-{name}", std::process::id());
        let dir = std::env::temp_dir().join(name);
        let _ = fs::remove_dir_all(&dir);
        dir
    }

    /// A small pretrained folder: golden weights of 40 rows, a word tokenizer of 30 words, and an
    /// end token at 39.
    pub fn write_base(kind: &str, dir: &Path) {
        let bytes = fs::read(golden(kind)).unwrap();
        let (_, metadata) = safetensors::SafeTensors::read_metadata(&bytes).unwrap();
        let config = metadata.metadata().as_ref().unwrap()["config"].clone();
        let mut config: serde_json::Value = serde_json::from_str(&config).unwrap();
        config["eos_token_id"] = 39.into();
        config["resid_pdrop"] = 0.0.into();
        if kind == "gpt2" {
            config["n_positions"] = 24.into();
        }
        let mut tensors = read_safetensors(&golden(kind)).unwrap();
        for extra in ["input_ids", "attention_mask", "output"] {
            tensors.remove(extra);
        }
        let mut words = vec!["describe".to_string(), "walks".into(), "person".into()];
        words.extend((3..30).map(|i| format!("word{i}")));
        let ids: std::collections::BTreeMap<_, _> = words.into_iter().zip(0..).collect();
        let tokenizer = serde_json::json!({
            "version": "1.0", "truncation": null, "padding": null,
            "added_tokens": [{
                "id": 30, "content": "<|endoftext|>", "single_word": false, "lstrip": false,
                "rstrip": false, "normalized": false, "special": true,
            }],
            "normalizer": null, "pre_tokenizer": {"type": "WhitespaceSplit"},
            "post_processor": null, "decoder": null,
            "model": {"type": "WordLevel", "vocab": ids, "unk_token": "word3"},
        });
        let mut files = CheckpointFiles::default();
        files.json(CONFIG_FILE, &config).unwrap();
        files.json(TEXT_TOKENIZER_FILE, &tokenizer).unwrap();
        files.tensors(MODEL_FILE, &tensors).unwrap();
        files.write(dir).unwrap();
    }

    fn radar(n: u32) -> Encoded {
        Encoded {
            codes: (0..n).map(|i| (i * 3 + n) % 4).collect(),
            features: (0..n * 2).map(|i| (i as f32 * 0.7).sin()).collect(),
            ..Encoded::default()
        }
    }

    /// Logits after every id of one row.
    fn logits(net: &RadarDecoder, ids: &[u32], n_rows: usize) -> Vec<f32> {
        let source = Source {
            ids: ids[..1].to_vec(),
            ..Source::default()
        };
        // The value of the last target token is irrelevant: it predicts nothing.
        let target = [&ids[1..], &[0]].concat();
        let states = net.target_states(&[(&source, &target)], 2, None).unwrap();
        read(
            net.decoder
                .logits(states, n_rows, crate::precision::ProductPrecision::F32),
        )
    }

    fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
        assert_eq!(a.len(), b.len());
        (a.iter().zip(b)).fold(0.0, |max, (a, b)| max.max((a - b).abs()))
    }

    /// Tolerance: f32 rounding of sums in another order; logits are of order 10.
    #[test]
    fn adapters_equal_the_reference_and_their_merged_form() {
        let device = &Device::flex();
        for kind in KINDS {
            let dir = scratch(&format!("golden-{kind}"));
            write_base(kind, &dir.join("base"));
            let mut tensors = read_safetensors(&golden(&format!("lora_{kind}"))).unwrap();
            let input = tensors.remove("input_ids").unwrap();
            let expected = tensors.remove("output").unwrap();
            let rows = tensors.extract_if(.., |name, _| name.ends_with(".added"));
            let rows: NamedTensors = rows.collect();
            let mut files = CheckpointFiles::default();
            files.tensors(ADAPTER_FILE, &tensors).unwrap();
            files.tensors(RADAR_FILE, &rows).unwrap();
            files.write(&dir.join("adapters")).unwrap();
            let mut decoder = read_base(&dir.join("base"), device).unwrap().decoder;
            decoder.extend(5, 1);
            let config = LoraConfig {
                rank: 3,
                alpha: 6.0,
                dropout: 0.0,
            };
            decoder.adapt(config, 1);
            let net = RadarDecoder {
                decoder,
                bypass: None,
            };
            let checkpoint = Checkpoint::open(&dir.join("adapters")).unwrap();
            let net = net.load_from(&checkpoint, true).unwrap();
            let mut merged = net.clone();
            merged.decoder.merge();
            assert!(!collect_params(&merged).keys().any(|k| k.contains("lora")));
            let [n, length, vocab] = expected.shape[..] else {
                panic!("three axes");
            };
            for row in 0..n {
                let ids: Vec<u32> = input.values[row * length..(row + 1) * length]
                    .iter()
                    .map(|v| *v as u32)
                    .collect();
                let found = logits(&net, &ids, vocab);
                let expected = &expected.values[row * length * vocab..][..length * vocab];
                let difference = largest_difference(&found, expected);
                assert!(difference < 1e-4, "{kind}: {difference}");
                let size = expected.iter().fold(0.0_f32, |max, v| max.max(v.abs()));
                let difference = largest_difference(&found, &logits(&merged, &ids, vocab));
                assert!(
                    difference < 1e-5 * size,
                    "{kind} merged: {difference} of {size}"
                );
            }
            fs::remove_dir_all(dir).unwrap();
        }
    }

    fn adapted(kind: &str, dir: &Path) -> RadarLm {
        write_base(kind, &dir.join("base"));
        let lora = Some(LoraConfig::default());
        RadarLm::from_hf_folder(&dir.join("base"), lora, 4, 2, true, 1, &Device::flex()).unwrap()
    }

    /// Sets the adapters to values that change the output.
    fn shake(lm: &mut RadarLm) {
        let mut params = collect_params(&lm.net);
        params.retain(|path, _| lm.is_trained(path));
        for (i, tensor) in params.values_mut().enumerate() {
            for (k, value) in tensor.values.iter_mut().enumerate() {
                *value += 0.2 * ((i * 31 + k) as f32).sin();
            }
        }
        lm.net = crate::params::replace_params(lm.net.clone(), params);
    }

    fn decoder(lm: &RadarLm) -> &RadarDecoder {
        match &lm.net {
            RadarNet::Decoder(net) => net,
            RadarNet::T5(_) => panic!("a decoder"),
        }
    }

    #[test]
    fn a_pretrained_decoder_gains_radar_rows_and_says_the_same_after_saving() {
        for kind in KINDS {
            let dir = scratch(&format!("saved-{kind}"));
            let mut lm = adapted(kind, &dir);
            let layout = lm.vocab.layout().clone();
            assert_eq!(
                (layout.n_text, layout.end, layout.first_sentinel),
                (30, 39, 40)
            );
            assert_eq!((layout.first_code, layout.size()), (72, 78));
            let sources: Vec<Source> = [3, 8, 5]
                .iter()
                .map(|n| lm.describe_prompt(&radar(*n)).unwrap())
                .collect();
            assert_eq!(sources[0].ids[..3], [0, layout.som(), layout.code(3)]);
            assert_eq!(sources[0].ids.last(), Some(&39));
            // A text cannot contain the end token.
            assert_eq!(
                lm.vocab.text_ids("walks <|endoftext|> person").unwrap(),
                [1, 2]
            );
            shake(&mut lm);
            let options = GenerateOptions {
                max_new_tokens: 8,
                ..GenerateOptions::default()
            };
            let expected = lm.generate(&sources, &options).unwrap();
            lm.save(&dir.join("adapters")).unwrap();
            let back = RadarLm::load(&dir.join("adapters"), &Device::flex()).unwrap();
            assert_eq!(collect_params(&lm.net), collect_params(&back.net));
            assert_eq!((&lm.adapters, &lm.config), (&back.adapters, &back.config));
            assert_eq!(back.generate(&sources, &options).unwrap(), expected);
            // PEFT's names and layout, without weights of the base.
            let open = |name: &str| Checkpoint::open(&dir.join(name)).unwrap();
            let peft = open("adapters").tensors(ADAPTER_FILE).unwrap();
            let (name, width) = match kind {
                "gpt2" => ("transformer.h.1.attn.c_attn", 16),
                _ => ("model.layers.1.self_attn.v_proj", 24),
            };
            let a = &peft[&format!("base_model.model.{name}.lora_A.weight")];
            assert_eq!(a.shape, [8, width]);
            assert!(peft.keys().all(|name| name.contains(".lora_")));
            let config: serde_json::Value = open("adapters").json(ADAPTER_CONFIG_FILE).unwrap();
            assert_eq!(
                (&config["r"], &config["peft_type"]),
                (&8.into(), &"LORA".into())
            );
            // The whole model: another program's layout, and the same sentences.
            lm.merge();
            lm.save(&dir.join("whole")).unwrap();
            let whole = RadarLm::load(&dir.join("whole"), &Device::flex()).unwrap();
            let found = whole.generate(&sources, &options).unwrap();
            for (a, b) in expected.iter().zip(&found) {
                assert_eq!(a.ids, b.ids, "{kind}");
            }
            let file = dir.join("whole");
            let opened = Pretrained::open(&file, &Device::flex()).unwrap();
            assert_eq!(opened.architecture(), kind);
            fs::remove_dir_all(dir).unwrap();
        }
    }

    #[test]
    fn shards_are_read_back() {
        for kind in KINDS {
            let dir = scratch(&format!("shards-{kind}"));
            let lm = adapted(kind, &dir);
            let tensors = decoder(&lm).decoder.to_hf();
            let mut files = CheckpointFiles::default();
            add_shards(&mut files, tensors.clone(), 4000).unwrap();
            files.write(&dir.join("shards")).unwrap();
            let n_files = fs::read_dir(dir.join("shards")).unwrap().count();
            assert!(n_files > 4, "{n_files}");
            assert!(!dir.join("shards").join(MODEL_FILE).exists());
            assert_eq!(read_tensors(&dir.join("shards")).unwrap(), tensors);
            fs::remove_dir_all(dir).unwrap();
        }
    }

    #[test]
    fn damaged_adapters_are_named() {
        let dir = scratch("damaged");
        let lm = adapted("gpt2", &dir);
        let problem = |change: &dyn Fn(&mut NamedTensors, &mut serde_json::Value)| {
            lm.save(&dir.join("a")).unwrap();
            let good = Checkpoint::open(&dir.join("a")).unwrap();
            let mut tensors = good.tensors(ADAPTER_FILE).unwrap();
            let mut config: serde_json::Value = good.json(ADAPTER_CONFIG_FILE).unwrap();
            change(&mut tensors, &mut config);
            let mut files = CheckpointFiles::default();
            lm.add_to(&mut files).unwrap();
            files.tensors(ADAPTER_FILE, &tensors).unwrap();
            files.json(ADAPTER_CONFIG_FILE, &config).unwrap();
            files.write(&dir.join("a")).unwrap();
            let loaded = RadarLm::load(&dir.join("a"), &Device::flex());
            loaded.err().map(|e| e.to_string()).unwrap_or_default()
        };
        let a = "base_model.model.transformer.h.0.attn.c_attn.lora_A.weight";
        assert_eq!(problem(&|_, _| {}), "");
        let found = problem(&|t, _| t.get_mut(a).unwrap().shape.reverse());
        assert!(
            found.contains(a) && found.contains("[16, 8], expected [8, 16]"),
            "{found}"
        );
        let found = problem(&|t, _| drop(t.remove(a)));
        assert!(found.contains(a) && found.contains("missing"), "{found}");
        let stray = |t: &mut NamedTensors, _: &mut serde_json::Value| {
            t.insert("stray".into(), HostTensor::vector(vec![1.0]));
        };
        assert!(problem(&stray).contains("`stray` is not part"));
        let found = problem(&|_, c| c["r"] = 4.into());
        assert!(found.contains("[8, 16], expected [4, 16]"), "{found}");
        assert!(problem(&|_, c| c["r"] = (1_u64 << 40).into()).contains("lora.rank"));
        assert!(problem(&|_, c| c["use_dora"] = true.into()).contains("DoRA"));
        for field in ["alpha_pattern", "rank_pattern"] {
            let pattern = serde_json::json!({ "h.0.attn.c_attn": 4 });
            assert!(problem(&|_, c| c[field] = pattern.clone()).contains(field));
            assert_eq!(problem(&|_, c| c[field] = serde_json::json!({})), "");
        }
        assert!(problem(&|_, c| c["target_modules"] = ["c_fc"].into()).contains("c_fc"));
        let mut files = CheckpointFiles::default();
        lm.add_to(&mut files).unwrap();
        let mut card = lm.card(MODEL_FILE);
        card.vocab.n_codes = 1 << 20;
        card.lm.network.set_vocab_size(card.vocab.size());
        files.json(CONFIG_FILE, &card_to_json(&card)).unwrap();
        files.write(&dir.join("a")).unwrap();
        let found = RadarLm::load(&dir.join("a"), &Device::flex())
            .err()
            .unwrap();
        assert!(found.to_string().contains("rows of new ids"), "{found}");
        let gone = "/no/such/base";
        assert!(problem(&|_, c| c["base_model_name_or_path"] = gone.into()).contains(gone));
        // Another checkpoint of the same shape under the base's name.
        let other = dir.join("base").join(MODEL_FILE);
        let mut tensors = read_safetensors(&other).unwrap();
        tensors.get_mut("transformer.ln_f.bias").unwrap().values[0] += 1.0;
        let mut files = CheckpointFiles::default();
        files.tensors(MODEL_FILE, &tensors).unwrap();
        files.write(&dir.join("other")).unwrap();
        fs::copy(dir.join("other").join(MODEL_FILE), other).unwrap();
        assert!(problem(&|_, _| {}).contains("not the base"));
        fs::remove_dir_all(dir).unwrap();
    }

    #[test]
    fn folders_and_prompts_that_do_not_fit_are_refused() {
        let dir = scratch("refused");
        let lm = adapted("gpt2", &dir);
        // 24 positions: 13 codes, two markers, a word and the end leave room for 7.
        let source = lm.describe_prompt(&radar(13)).unwrap();
        let run = |max| {
            let options = GenerateOptions {
                max_new_tokens: max,
                ..GenerateOptions::default()
            };
            lm.generate(std::slice::from_ref(&source), &options)
        };
        assert!(run(7).is_ok());
        let problem = run(8).unwrap_err().to_string();
        assert!(problem.contains("17 tokens and 8 new ones") && problem.contains("24 positions"));
        let long = vec![0; 9];
        let problem = decoder(&lm).target_states(&[(&source, &long)], 2, None);
        assert!(problem.unwrap_err().to_string().contains("25 tokens"));
        let mut bad = source.clone();
        bad.ids[0] = 78;
        assert!(lm.generate(&[bad], &GenerateOptions::default()).is_err());
        let base = dir.join("base");
        let open = |lora| RadarLm::from_hf_folder(&base, lora, 4, 2, false, 1, &Device::flex());
        let with = |key: &str, value: serde_json::Value| {
            write_base("gpt2", &base);
            let file = base.join(CONFIG_FILE);
            let mut config: serde_json::Value =
                serde_json::from_slice(&fs::read(&file).unwrap()).unwrap();
            config[key] = value;
            fs::write(&file, config.to_string()).unwrap();
            open(None).err().map(|e| e.to_string()).unwrap_or_default()
        };
        assert!(with("model_type", "llama".into()).contains("llama"));
        assert!(with("model_type", "bert".into()).contains("missing field"));
        // The end token among the words, and beyond the rows.
        assert!(with("eos_token_id", 5.into()).contains("end token 5"));
        assert!(with("eos_token_id", 50256.into()).contains("end token 50256"));
        assert!(with("n_embd", 32.into()).contains("[40, 16], expected [40, 32]"));
        let model_type = |dir: &Path| {
            fs::write(dir.join(CONFIG_FILE), r#"{"model_type": "t5"}"#).unwrap();
        };
        model_type(&base);
        let problem = open(Some(LoraConfig::default())).err().unwrap().to_string();
        assert!(problem.contains("T5 is trained whole"), "{problem}");
        fs::remove_dir_all(dir).unwrap();
    }
}
