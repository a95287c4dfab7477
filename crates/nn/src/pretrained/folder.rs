//! Opens any supported checkpoint folder in Hugging Face's layout by its `model_type`.

use std::path::Path;

use burn::tensor::{Device, Tensor};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::bert::Bert;
use super::gpt2::Gpt2;
use super::layers::Loader;
use super::qwen2::Qwen2;
use crate::lm::hf::{self, json_error, read, read_small, read_tensors};
use crate::lm::rows::Rows;
use crate::lm::t5::T5;
use radarllm_inference::checkpoint::NamedTensors;
use radarllm_inference::lm::{InputError, LmError, T5Config};

/// Maximum T5 sequence length. T5's relative positions are unbounded, but memory is not.
const LONGEST_T5: usize = 4096;

/// A network of one of the supported architectures.
#[derive(Debug)]
pub enum Pretrained {
    /// T5 and FLAN-T5.
    T5(Box<T5>),
    /// GPT-2.
    Gpt2(Box<Gpt2>),
    /// Qwen2.
    Qwen2(Box<Qwen2>),
    /// BERT and RoBERTa.
    Bert(Box<Bert>),
}

/// Input of a network. Rows of one field have equal lengths; padding may be at any position.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelInput {
    /// `[batch][length]`.
    pub input_ids: Vec<Vec<u32>>,
    /// 1 token, 0 padding; all ids are tokens if absent.
    #[serde(default)]
    pub attention_mask: Option<Vec<Vec<u32>>>,
    /// Input of the decoder of an encoder-decoder.
    #[serde(default)]
    pub decoder_input_ids: Option<Vec<Vec<u32>>>,
}

impl Pretrained {
    /// Reads a folder with `config.json` and `model.safetensors`, single or sharded.
    ///
    /// # Errors
    /// Missing or damaged files, an unknown architecture, missing tensors and mismatched shapes.
    pub fn open(dir: &Path, device: &Device) -> Result<Self, LmError> {
        let config_file = dir.join("config.json");
        let config = read_small(&config_file)?;
        let tensors = read_tensors(dir)?;
        Self::from_parts(&config, &config_file, tensors, device)
    }

    /// Builds a network from the text of a `config.json` and tensors; `file` is named in errors.
    ///
    /// # Errors
    /// See [`Self::open`].
    pub fn from_parts(
        config: &[u8],
        file: &Path,
        tensors: NamedTensors,
        device: &Device,
    ) -> Result<Self, LmError> {
        #[derive(Deserialize)]
        struct Kind {
            model_type: String,
        }
        let kind: Kind = parse(config, file)?;
        match kind.model_type.as_str() {
            "t5" => {
                let config = hf::untied(hf::parse_config(config, file)?, &tensors);
                let ours = hf::from_hf(tensors, &config, file)?;
                Ok(Self::T5(hf::build_t5(&config, ours, device, file)?.into()))
            }
            "gpt2" => {
                let from = Loader::new(stripped(tensors, &["transformer."]), file, false, device);
                Ok(Self::Gpt2(Gpt2::load(parse(config, file)?, from)?.into()))
            }
            "qwen2" => {
                let from = Loader::new(stripped(tensors, &["model."]), file, true, device);
                Ok(Self::Qwen2(Qwen2::load(parse(config, file)?, from)?.into()))
            }
            "bert" | "roberta" | "xlm-roberta" => {
                let from = Loader::new(
                    stripped(tensors, &["bert.", "roberta."]),
                    file,
                    true,
                    device,
                );
                Ok(Self::Bert(Bert::load(parse(config, file)?, from)?.into()))
            }
            other => Err(LmError::Config {
                field: "model_type",
                problem: format!(
                    "expected t5, gpt2, qwen2, bert, roberta or xlm-roberta, found `{other}`"
                ),
            }),
        }
    }

    /// The architecture's name.
    pub fn architecture(&self) -> &'static str {
        match self {
            Self::T5(_) => "t5",
            Self::Gpt2(_) => "gpt2",
            Self::Qwen2(_) => "qwen2",
            Self::Bert(_) => "bert",
        }
    }

    /// Logits `[batch, step, vocab]`, or for BERT and RoBERTa the last hidden states
    /// `[batch, step, width]`, flattened, and that shape.
    ///
    /// # Errors
    /// [`LmError::Input`]: see [`Rows::new`]; also for decoder rows that are missing, or that are given to a network
    /// without such a decoder.
    pub fn logits(
        &self,
        input: &ModelInput,
        device: &Device,
    ) -> Result<(Vec<f32>, [usize; 3]), LmError> {
        let mask = input.attention_mask.as_deref();
        let alone = |name: &str| match &input.decoder_input_ids {
            None => Ok(()),
            Some(_) => Err(rows_error(format!("{name} takes no decoder_input_ids"))),
        };
        let (out, shape): (Tensor<2>, [usize; 2]) = match self {
            Self::T5(t5) => {
                let T5Config { vocab_size, .. } = *t5.config();
                let source = Rows::new(&input.input_ids, mask, vocab_size, LONGEST_T5)?;
                let target = input.decoder_input_ids.as_deref().ok_or_else(|| {
                    rows_error("t5 wants decoder_input_ids, which start with id 0".into())
                })?;
                let target = Rows::new(target, None, vocab_size, LONGEST_T5)?;
                if target.shape[0] != source.shape[0] {
                    let (n, m) = (source.shape[0], target.shape[0]);
                    let problem = format!("{n} encoder rows but {m} decoder rows");
                    return Err(rows_error(problem));
                }
                (t5.teacher_forced(&source, &target, device), target.shape)
            }
            Self::Gpt2(gpt2) => {
                alone("gpt2")?;
                let c = gpt2.config();
                let rows = Rows::new(&input.input_ids, mask, c.vocab_size, c.n_positions)?;
                (gpt2.logits(&rows, device), rows.shape)
            }
            Self::Qwen2(qwen2) => {
                alone("qwen2")?;
                let c = qwen2.config();
                let longest = c.max_position_embeddings;
                let rows = Rows::new(&input.input_ids, mask, c.vocab_size, longest)?;
                (qwen2.logits(&rows, device), rows.shape)
            }
            Self::Bert(bert) => {
                alone("an encoder")?;
                let c = bert.config();
                let rows = Rows::new(&input.input_ids, mask, c.vocab_size, c.longest())?;
                let states = bert.states(&rows, c.num_hidden_layers, device);
                (states, rows.shape)
            }
        };
        let width = out.dims()[1];
        Ok((read(out), [shape[0], shape[1], width]))
    }
}

/// Removes from each name the first of the prefixes that it has.
fn stripped(tensors: NamedTensors, prefixes: &[&str]) -> NamedTensors {
    let strip = |name: String| match prefixes.iter().find_map(|p| name.strip_prefix(p)) {
        Some(short) => short.to_string(),
        None => name,
    };
    tensors
        .into_iter()
        .map(|(name, tensor)| (strip(name), tensor))
        .collect()
}

fn parse<T: DeserializeOwned>(json: &[u8], file: &Path) -> Result<T, LmError> {
    serde_json::from_slice(json).map_err(|e| json_error(file, &e))
}

fn rows_error(problem: String) -> LmError {
    InputError::Rows { problem }.into()
}

#[cfg(test)]
pub(super) mod tests {
    use std::fs;

    use super::*;
    use radarllm_inference::checkpoint::{HostTensor, read_safetensors};

    struct Golden {
        config: String,
        tensors: NamedTensors,
        input: ModelInput,
        output: HostTensor,
    }

    fn golden(name: &str) -> Golden {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("tests/goldens")
            .join(name);
        let bytes = fs::read(&path).unwrap();
        let (_, metadata) = safetensors::SafeTensors::read_metadata(&bytes).unwrap();
        let mut tensors = read_safetensors(&path).unwrap();
        let rows = |tensor: HostTensor| -> Vec<Vec<u32>> {
            let rows = tensor.values.chunks(tensor.shape[1]);
            rows.map(|r| r.iter().map(|v| *v as u32).collect())
                .collect()
        };
        let input = ModelInput {
            input_ids: rows(tensors.remove("input_ids").unwrap()),
            attention_mask: tensors.remove("attention_mask").map(rows),
            decoder_input_ids: tensors.remove("decoder_input_ids").map(rows),
        };
        let output = tensors
            .remove("output")
            .or_else(|| tensors.remove("logits"))
            .unwrap();
        Golden {
            config: metadata.metadata().as_ref().unwrap()["config"].clone(),
            tensors,
            input,
            output,
        }
    }

    /// The network of a golden file.
    pub fn golden_network(name: &str) -> Pretrained {
        network(&golden(name)).unwrap()
    }

    fn network(golden: &Golden) -> Result<Pretrained, LmError> {
        let file = Path::new("config.json");
        let tensors = golden.tensors.clone();
        Pretrained::from_parts(golden.config.as_bytes(), file, tensors, &Device::flex())
    }

    const ALL: [&str; 7] = [
        "t5_v10.safetensors",
        "t5_v11.safetensors",
        "t5_left.safetensors",
        "gpt2.safetensors",
        "qwen2.safetensors",
        "bert.safetensors",
        "roberta.safetensors",
    ];

    /// Tolerance: f32 rounding of sums in another order; values are of order 1 to 10.
    #[test]
    fn every_architecture_equals_the_reference() {
        for name in ALL {
            let golden = golden(name);
            let (found, shape) = network(&golden)
                .unwrap()
                .logits(&golden.input, &Device::flex())
                .unwrap();
            assert_eq!(shape.to_vec(), golden.output.shape, "{name}");
            let is_decoded = golden.input.decoder_input_ids.is_some();
            let is_token: Vec<u32> = match &golden.input.attention_mask {
                Some(mask) if !is_decoded => mask.concat(),
                _ => vec![1; shape[0] * shape[1]],
            };
            let mut worst = 0.0_f32;
            for (i, (a, b)) in found.iter().zip(&golden.output.values).enumerate() {
                if is_token[i / shape[2]] == 1 {
                    worst = worst.max((a - b).abs());
                }
            }
            assert!(worst < 1e-4, "{name}: {worst}");
        }
    }

    #[test]
    fn missing_unknown_and_misshapen_tensors_are_named() {
        for name in ALL {
            let whole = golden(name);
            for tensor in whole.tensors.keys().cloned().collect::<Vec<_>>() {
                let mut bad = golden(name);
                let mut taken = bad.tensors.remove(&tensor).unwrap();
                let problem = match network(&bad) {
                    Err(error) => error.to_string(),
                    // Tied output rows and the pooler may be absent.
                    Ok(_) if tensor.contains("lm_head") || tensor.contains("pooler") => continue,
                    Ok(_) => panic!("{name}: {tensor} was not missed"),
                };
                let last = tensor.rsplit('.').nth(1).unwrap();
                assert!(problem.contains(last), "{name} {tensor}: {problem}");
                taken.shape[0] += 1;
                let width: usize = taken.shape[1..].iter().product();
                taken.values.extend(vec![0.0; width]);
                bad.tensors.insert(tensor.clone(), taken);
                let problem = network(&bad).unwrap_err().to_string();
                assert!(problem.contains(last), "{name} {tensor}: {problem}");
            }
            let mut bad = golden(name);
            let stray = HostTensor::vector(vec![1.0]);
            bad.tensors.insert("stray.weight".into(), stray);
            let problem = network(&bad).unwrap_err().to_string();
            assert!(problem.contains("stray.weight"), "{name}: {problem}");
        }
    }

    #[test]
    fn bad_inputs_are_errors() {
        let golden = golden("gpt2.safetensors");
        let gpt2 = network(&golden).unwrap();
        let row = |ids: &[u32]| ModelInput {
            input_ids: vec![ids.to_vec()],
            ..ModelInput::default()
        };
        let bad = [
            ModelInput::default(),
            row(&[]),
            row(&[40]),
            row(&[1; 25]),
            ModelInput {
                input_ids: vec![vec![1, 2], vec![1]],
                ..ModelInput::default()
            },
            ModelInput {
                attention_mask: Some(vec![vec![1]]),
                ..row(&[1, 2])
            },
            ModelInput {
                decoder_input_ids: Some(vec![vec![0]]),
                ..row(&[1])
            },
        ];
        for input in bad {
            assert!(gpt2.logits(&input, &Device::flex()).is_err(), "{input:?}");
        }
        let unknown = golden.config.replace("\"gpt2\"", "\"llama\"");
        let tensors = golden.tensors;
        let file = Path::new("config.json");
        let error =
            Pretrained::from_parts(unknown.as_bytes(), file, tensors, &Device::flex()).unwrap_err();
        assert!(error.to_string().contains("llama"), "{error}");
    }
}
