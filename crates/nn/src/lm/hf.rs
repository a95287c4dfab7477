//! Hugging Face's T5 format: parameter names, file layout and configuration.
//!
//! A Hugging Face checkpoint is a folder with `config.json`, `tokenizer.json` and `model.safetensors`, or
//! shards listed in `model.safetensors.index.json`. Hugging Face stores linear weights as `[out, in]`; this crate
//! stores them as `[in, out]`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use burn::tensor::{Device, Tensor};
use radarllm_files::bounded::{self, ReadError};
use serde::Deserialize;

use super::t5::T5;
use crate::params::load_params;
use radarllm_inference::checkpoint::{CheckpointError, NamedTensors, read_floats};
use radarllm_inference::lm::LmError;
use radarllm_inference::lm::config::{FeedForward, T5Config};

/// The names of one parameter in both formats.
struct Name {
    ours: String,
    theirs: String,
    transposed: bool,
}

/// Every parameter of a network of this shape.
fn names(config: &T5Config) -> Vec<Name> {
    let mut out = Vec::new();
    let mut add = |ours: String, theirs: String, transposed: bool| {
        out.push(Name {
            ours,
            theirs: format!("{theirs}.weight"),
            transposed,
        });
    };
    add("shared".into(), "shared".into(), false);
    if !config.tie_embeddings {
        add("head".into(), "lm_head".into(), false);
    }
    for (stack, n_layers, is_decoder) in [
        ("encoder", config.n_encoder_layers, false),
        ("decoder", config.n_decoder_layers, true),
    ] {
        add(
            format!("{stack}.position_bias"),
            format!("{stack}.block.0.layer.0.SelfAttention.relative_attention_bias"),
            false,
        );
        add(
            format!("{stack}.norm"),
            format!("{stack}.final_layer_norm"),
            false,
        );
        for i in 0..n_layers {
            let mut attentions = vec![("attention", 0, "SelfAttention")];
            if is_decoder {
                attentions.push(("cross", 1, "EncDecAttention"));
            }
            let ours = format!("{stack}.blocks.{i}");
            let theirs = format!("{stack}.block.{i}.layer");
            let feed = attentions.len();
            for (name, layer, module) in attentions {
                add(
                    format!("{ours}.{name}_norm"),
                    format!("{theirs}.{layer}.layer_norm"),
                    false,
                );
                for part in ["q", "k", "v", "o"] {
                    let theirs = format!("{theirs}.{layer}.{module}.{part}");
                    add(format!("{ours}.{name}.{part}"), theirs, true);
                }
            }
            add(
                format!("{ours}.feed_norm"),
                format!("{theirs}.{feed}.layer_norm"),
                false,
            );
            let dense = format!("{theirs}.{feed}.DenseReluDense");
            match config.feed_forward {
                FeedForward::Relu => add(format!("{ours}.feed.wi"), format!("{dense}.wi"), true),
                FeedForward::GatedGelu => {
                    add(format!("{ours}.feed.wi"), format!("{dense}.wi_0"), true);
                    add(format!("{ours}.feed.gate"), format!("{dense}.wi_1"), true);
                }
            }
            add(format!("{ours}.feed.wo"), format!("{dense}.wo"), true);
        }
    }
    out
}

/// Converts Hugging Face names and layout to ours. `file` is named in errors.
///
/// # Errors
/// If a parameter is missing or unknown. Shapes are checked when the parameters are loaded.
pub fn from_hf(
    mut theirs: NamedTensors,
    config: &T5Config,
    file: &Path,
) -> Result<NamedTensors, LmError> {
    // Copies of the embedding that some checkpoints contain under other names.
    for copy in ["encoder.embed_tokens.weight", "decoder.embed_tokens.weight"] {
        if let Some(tensor) = theirs.remove(copy) {
            theirs.entry("shared.weight".into()).or_insert(tensor);
        }
    }
    if config.tie_embeddings {
        theirs.remove("lm_head.weight");
    }
    let mut ours = NamedTensors::new();
    for name in names(config) {
        let tensor = theirs
            .remove(&name.theirs)
            .ok_or_else(|| CheckpointError::MissingTensor {
                path: file.into(),
                tensor: name.theirs.clone(),
                expected: Vec::new(),
            })?;
        ours.insert(
            name.ours,
            if name.transposed {
                tensor.transposed()
            } else {
                tensor
            },
        );
    }
    match theirs.into_keys().next() {
        Some(tensor) => Err(CheckpointError::UnknownTensor {
            path: file.into(),
            tensor,
        }
        .into()),
        None => Ok(ours),
    }
}

/// Converts our names and layout to Hugging Face's. Parameters that T5 lacks are left out.
pub fn to_hf(mut ours: NamedTensors, config: &T5Config) -> NamedTensors {
    names(config)
        .into_iter()
        .filter_map(|name| {
            let tensor = ours.remove(&name.ours)?;
            Some((
                name.theirs,
                if name.transposed {
                    tensor.transposed()
                } else {
                    tensor
                },
            ))
        })
        .collect()
}

/// The fields of a T5 `config.json` that are used here, with the reference defaults.
#[derive(Deserialize)]
struct HfConfig {
    vocab_size: usize,
    d_model: usize,
    d_kv: usize,
    d_ff: usize,
    num_layers: usize,
    num_decoder_layers: Option<usize>,
    num_heads: usize,
    #[serde(default = "relu")]
    feed_forward_proj: String,
    #[serde(default = "yes")]
    tie_word_embeddings: bool,
    /// Newer files specify this separately.
    #[serde(default)]
    scale_decoder_outputs: Option<bool>,
    #[serde(default = "buckets")]
    relative_attention_num_buckets: usize,
    #[serde(default = "distance")]
    relative_attention_max_distance: usize,
    #[serde(default = "dropout")]
    dropout_rate: f64,
    #[serde(default = "epsilon")]
    layer_norm_epsilon: f64,
}

fn relu() -> String {
    "relu".into()
}
fn yes() -> bool {
    true
}
fn buckets() -> usize {
    32
}
fn distance() -> usize {
    128
}
fn dropout() -> f64 {
    0.1
}
fn epsilon() -> f64 {
    1e-6
}

/// Reads a T5 `config.json`.
///
/// # Errors
/// If it is not JSON of that kind or describes an impossible network.
pub fn parse_config(json: &[u8], file: &Path) -> Result<T5Config, LmError> {
    let hf: HfConfig = serde_json::from_slice(json).map_err(|e| json_error(file, &e))?;
    let feed_forward = match hf.feed_forward_proj.as_str() {
        "relu" => FeedForward::Relu,
        "gated-gelu" => FeedForward::GatedGelu,
        other => {
            let problem = format!("expected `relu` or `gated-gelu`, found `{other}`");
            return Err(LmError::Config {
                field: "feed_forward_proj",
                problem,
            });
        }
    };
    let config = T5Config {
        vocab_size: hf.vocab_size,
        d_model: hf.d_model,
        d_kv: hf.d_kv,
        n_heads: hf.num_heads,
        d_ff: hf.d_ff,
        n_encoder_layers: hf.num_layers,
        n_decoder_layers: hf.num_decoder_layers.unwrap_or(hf.num_layers),
        feed_forward,
        tie_embeddings: hf.tie_word_embeddings,
        scale_outputs: hf.scale_decoder_outputs,
        relative_buckets: hf.relative_attention_num_buckets,
        relative_max_distance: hf.relative_attention_max_distance,
        dropout: hf.dropout_rate,
        norm_eps: hf.layer_norm_epsilon,
    };
    config.validate()?;
    Ok(config)
}

pub(crate) fn json_error(file: &Path, error: &serde_json::Error) -> LmError {
    CheckpointError::Json {
        path: file.into(),
        message: error.to_string(),
    }
    .into()
}

/// Reads a small file of a checkpoint. Genuine ones are far smaller than the limit of 64 MB.
pub(crate) fn read_small(path: &Path) -> Result<Vec<u8>, LmError> {
    let io = |e: ReadError| CheckpointError::Io {
        path: path.into(),
        source: e.into_io(),
    };
    Ok(bounded::read_bytes(path, 64 << 20).map_err(io)?)
}

#[derive(Deserialize)]
struct ShardIndex {
    weight_map: BTreeMap<String, String>,
}

/// Reads a Hugging Face T5 folder: shape and parameters under our names.
///
/// # Errors
/// If a file is missing, damaged or does not describe a T5.
pub fn read_folder(dir: &Path) -> Result<(T5Config, NamedTensors), LmError> {
    let config_path = dir.join("config.json");
    let config = parse_config(&read_small(&config_path)?, &config_path)?;
    let tensors = read_tensors(dir)?;
    let config = untied(config, &tensors);
    let tensors = from_hf(tensors, &config, &dir.join("model.safetensors"))?;
    Ok((config, tensors))
}

/// Newer files specify that the output rows are tied, whether they are or not. Output rows that differ from the
/// embedding are not tied.
pub(crate) fn untied(mut config: T5Config, theirs: &NamedTensors) -> T5Config {
    let head = theirs.get("lm_head.weight");
    if config.tie_embeddings && head.is_some_and(|h| theirs.get("shared.weight") != Some(h)) {
        config.scale_outputs = Some(config.scales_outputs());
        config.tie_embeddings = false;
    }
    config
}

/// All tensors of a folder in Hugging Face's layout, single or sharded.
///
/// # Errors
/// If a file is missing or damaged.
pub(crate) fn read_tensors(dir: &Path) -> Result<NamedTensors, LmError> {
    let single = dir.join("model.safetensors");
    let index = dir.join("model.safetensors.index.json");
    let mut tensors = NamedTensors::new();
    if single.is_file() || !index.is_file() {
        tensors = read_floats(&single)?;
    } else {
        let map: ShardIndex =
            serde_json::from_slice(&read_small(&index)?).map_err(|e| json_error(&index, &e))?;
        let shards: BTreeSet<&String> = map.weight_map.values().collect();
        for shard in shards {
            // A shard name from a file must not refer to a path outside the folder.
            if Path::new(shard)
                .file_name()
                .is_none_or(|name| name != shard.as_str())
            {
                let message = format!("`{shard}` is not a plain file name");
                return Err(CheckpointError::Json {
                    path: index,
                    message,
                }
                .into());
            }
            tensors.extend(read_floats(&dir.join(shard))?);
        }
    }
    Ok(tensors)
}

/// Makes a network from parameters under our names, once their shapes have been checked.
pub(crate) fn build_t5(
    config: &T5Config,
    tensors: NamedTensors,
    device: &Device,
    file: &Path,
) -> Result<T5, LmError> {
    check_shapes(config, &tensors, file)?;
    Ok(load_params(T5::new(config, 0, device), tensors, file)?)
}

/// Checks that the large parameters have the size that the configuration specifies before a network of that size
/// is allocated.
fn check_shapes(config: &T5Config, ours: &NamedTensors, file: &Path) -> Result<(), LmError> {
    let (d, inner) = (config.d_model, config.inner());
    for name in names(config) {
        let last = name.ours.rsplit('.').next().unwrap_or_default();
        let expected = match last {
            "shared" | "head" => vec![config.vocab_size, d],
            "position_bias" => vec![config.relative_buckets, config.n_heads],
            "q" | "k" | "v" => vec![d, inner],
            "o" => vec![inner, d],
            "wi" | "gate" => vec![d, config.d_ff],
            "wo" => vec![config.d_ff, d],
            _ => vec![d],
        };
        let path = file.into();
        match ours.get(&name.ours) {
            Some(tensor) if tensor.shape == expected => {}
            Some(tensor) => {
                let found = tensor.shape.clone();
                let tensor = name.theirs;
                return Err(CheckpointError::Shape {
                    path,
                    tensor,
                    expected,
                    found,
                }
                .into());
            }
            None => {
                let tensor = name.theirs;
                return Err(CheckpointError::MissingTensor {
                    path,
                    tensor,
                    expected,
                }
                .into());
            }
        }
    }
    Ok(())
}

/// Values of an f32 tensor. Reading memory of the CPU backend cannot fail.
pub(crate) fn read<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor
        .into_data_as::<f32>()
        .try_into_vec::<f32>()
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use radarllm_engine::{Engine, Precision, SimdLevel};

    use crate::params::collect_params;
    use radarllm_engine::Source;
    use radarllm_inference::checkpoint::{CheckpointFiles, HostTensor, read_safetensors};
    use std::fs;

    use radarllm_inference::lm::{LmConfig, LmPreset, NetworkConfig};

    fn golden(name: &str) -> (T5Config, NamedTensors, std::path::PathBuf) {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("tests/goldens")
            .join(name);
        let bytes = fs::read(&path).unwrap();
        let (_, metadata) = safetensors::SafeTensors::read_metadata(&bytes).unwrap();
        let json = metadata.metadata().as_ref().unwrap()["config"].clone();
        (
            parse_config(json.as_bytes(), &path).unwrap(),
            read_safetensors(&path).unwrap(),
            path,
        )
    }

    fn rows(tensor: &HostTensor) -> Vec<Vec<u32>> {
        tensor
            .values
            .chunks(tensor.shape[1])
            .map(|r| r.iter().map(|v| *v as u32).collect())
            .collect()
    }

    /// Tolerance: f32 rounding of sums in another order; the inference engine, step by step, with the instructions of
    /// every level this machine has.
    #[test]
    fn logits_of_the_engine_equal_the_reference() {
        for name in ["t5_v10.safetensors", "t5_v11.safetensors"] {
            let (t5, mut tensors, path) = golden(name);
            let mut take = |n: &str| tensors.remove(n).unwrap();
            let (input, mask) = (rows(&take("input_ids")), rows(&take("attention_mask")));
            let decoder = rows(&take("decoder_input_ids"));
            let expected = take("logits").values;
            let weights: NamedTensors = from_hf(tensors, &t5, &path)
                .unwrap()
                .into_iter()
                .map(|(name, tensor)| (format!("t5.{name}"), tensor))
                .collect();
            let sources: Vec<Source> = (input.into_iter().zip(&mask))
                .map(|(ids, mask)| Source {
                    ids: ids[..mask.iter().sum::<u32>() as usize].to_vec(),
                    ..Source::default()
                })
                .collect();
            let (vocab, steps, n) = (t5.vocab_size, decoder[0].len(), sources.len());
            let lm = LmPreset::Small.config(1, 1);
            let shape = LmConfig {
                network: NetworkConfig::T5(t5),
                bypass: false,
                ..lm
            }
            .engine_shape()
            .unwrap();
            for level in SimdLevel::available() {
                let (shape, weights) = (shape.clone(), weights.clone());
                let engine = Engine::with_level(shape, Precision::F32, weights, level).unwrap();
                let mut session = engine.session(1);
                session
                    .start(&sources.iter().collect::<Vec<_>>(), 1, steps)
                    .unwrap();
                for step in 0..steps {
                    let last: Vec<u32> = decoder.iter().map(|ids| ids[step]).collect();
                    let logits = session.logits(&last, vocab);
                    for (row, found) in logits.chunks(logits.len() / n).enumerate() {
                        let expected = &expected[(row * steps + step) * vocab..][..vocab];
                        for (e, f) in expected.iter().zip(found) {
                            let close = (e - f).abs() < 1e-4;
                            assert!(close, "{name} {level:?} row {row} step {step}: {f}, {e}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn names_survive_the_round_trip() {
        let (config, mut tensors, path) = golden("t5_v11.safetensors");
        for extra in ["input_ids", "attention_mask", "decoder_input_ids", "logits"] {
            tensors.remove(extra);
        }
        let ours = from_hf(tensors.clone(), &config, &path).unwrap();
        assert_eq!(to_hf(ours.clone(), &config), tensors);
        let t5 = build_t5(&config, ours.clone(), &Device::flex(), &path).unwrap();
        assert_eq!(collect_params(&t5), ours);
        // A folder in Hugging Face's layout, sharded in two.
        let dir = std::env::temp_dir().join(format!("radarllm-hf-{}", std::process::id()));
        let mut files = CheckpointFiles::default();
        let (_, metadata) =
            safetensors::SafeTensors::read_metadata(&fs::read(&path).unwrap()).unwrap();
        let json = metadata.metadata().as_ref().unwrap()["config"].clone();
        files.bytes("config.json", json.into_bytes());
        let mut first = tensors.clone();
        let second = first.split_off("encoder");
        let map: BTreeMap<&String, &str> = (first.keys().map(|k| (k, "a.safetensors")))
            .chain(second.keys().map(|k| (k, "b.safetensors")))
            .collect();
        files
            .json(
                "model.safetensors.index.json",
                &serde_json::json!({"weight_map": map}),
            )
            .unwrap();
        files.tensors("a.safetensors", &first).unwrap();
        files.tensors("b.safetensors", &second).unwrap();
        files.write(&dir).unwrap();
        assert_eq!(read_folder(&dir).unwrap(), (config, ours));
        fs::remove_dir_all(dir).unwrap();
    }

    #[test]
    fn impossible_configurations_are_errors() {
        let bad = [
            r#"{"vocab_size":1,"d_model":99999999999,"d_kv":1,"d_ff":1,"num_layers":1,"num_heads":1}"#,
            r#"{"vocab_size":1,"d_model":8,"d_kv":1,"d_ff":1,"num_layers":0,"num_heads":1}"#,
            r#"{"d_model":8}"#,
            "[",
        ];
        for json in bad {
            assert!(
                parse_config(json.as_bytes(), Path::new("config.json")).is_err(),
                "{json}"
            );
        }
    }
}
