//! `lm`: computes the logits of a checkpoint in Hugging Face's layout, and merges adapters into weights.

use std::path::{Path, PathBuf};

use radarllm_files::{bounded as files, npy::NpyWriter};
use radarllm_inference::{
    checkpoint::{CONFIG_FILE, Checkpoint, CheckpointFiles, MODEL_FILE},
    lm::{
        LmError, LmFiles,
        card::TEXT_TOKENIZER_FILE,
        ensemble::{Member, member_folders},
    },
};
use radarllm_nn::Device;
use radarllm_nn::lm::RadarLm;
use radarllm_nn::pretrained::{ModelInput, Pretrained};
use radarllm_train::tokens_only::{ResidualCodes, tokens_only};
use serde::Serialize;

use super::LmVerb;
use crate::{
    error::{CliError, CliResult},
    output,
};

/// Files of a language model that inference reads, besides its weights.
const KEPT: [&str; 2] = [CONFIG_FILE, TEXT_TOKENIZER_FILE];
/// Maximum size of a file of ids, bytes.
const MAX_IDS_BYTES: u64 = 256 << 20;

#[derive(Serialize)]
struct Report {
    architecture: &'static str,
    output: &'static str,
    shape: [usize; 3],
}

/// Runs the command.
pub(crate) fn run(verb: &LmVerb) -> CliResult {
    match verb {
        LmVerb::Logits {
            weights,
            ids,
            out,
            force,
            json,
        } => logits(weights, ids, out, *force, *json),
        LmVerb::Tokens {
            model,
            residual_codes,
            data,
            out,
        } => {
            let residual_codes = residual_codes.map(|n_codes| ResidualCodes { n_codes, data });
            tokens(model, residual_codes, out)
        }
        LmVerb::Pack { model, out } => pack(model, out),
        LmVerb::Merge { model, out } => merge(model, out),
    }
}

fn tokens(model: &Path, residual_codes: Option<ResidualCodes>, out: &Path) -> CliResult {
    output::check_new(out)?;
    for (member, _) in members(model, out) {
        open_member(&member)?;
    }
    output::create_folder_with(out, |out| {
        for (member, out) in members(model, out) {
            tokens_only(&member, residual_codes, &out)?;
        }
        Ok(())
    })?;
    output::print_line(&out.display().to_string());
    Ok(())
}

/// Folders of the members of a model, and of those of a new one.
fn members(model: &Path, out: &Path) -> Vec<(PathBuf, PathBuf)> {
    let members = member_folders(model).into_iter().zip(1..);
    members
        .map(|(member, n)| match n {
            1 => (member, out.to_path_buf()),
            n => (member, out.join(format!("member-{n}"))),
        })
        .collect()
}

/// Opens a member of the model that `--model` names.
fn open_member(folder: &Path) -> CliResult<Member> {
    Member::open(folder).map_err(|e| {
        CliError::new(e).hint(
            "--model wants a folder made by `radarllm train all`, which holds `tokenizer` and `lm`; a bundled model is no folder",
        )
    })
}

/// Name of the weights file of the language model of a member, which has to be a T5.
fn t5_weights(folder: &Path) -> CliResult<String> {
    match LmFiles::of(open_member(folder)?.lm) {
        Ok(files) if files.is_t5() => Ok(files.card.weights),
        Ok(_) | Err(LmError::PretrainedText) => {
            let lm = folder.join("lm");
            let problem = format!("{}: its backbone is not t5", lm.display());
            Err(CliError::new(problem).hint(
                "only a T5 is read from bytes; models with the backbones gpt2 and qwen2 stay as they are",
            ))
        }
        Err(e) => Err(e.into()),
    }
}

fn pack(model: &Path, out: &Path) -> CliResult {
    output::check_new(out)?;
    // All members are checked before anything is written.
    let lm_weights = member_folders(model)
        .iter()
        .map(|member| t5_weights(member))
        .collect::<CliResult<Vec<_>>>()?;
    output::create_folder_with(out, |out| {
        for ((member, out), lm_weights) in members(model, out).iter().zip(&lm_weights) {
            pack_member(member, lm_weights, out)?;
        }
        Ok(())
    })?;
    output::print_line(&out.display().to_string());
    Ok(())
}

/// Packs a member, whose language model has the weights file `lm_weights`, and the networks of its model, if it holds them.
fn pack_member(member: &Path, lm_weights: &str, out: &Path) -> CliResult {
    // The decoder of radar tokens and the networks that weigh sentences are no parts of a member.
    for part in Member::PARTS.into_iter().chain(["points", "evidence"]) {
        let folder = member.join(part);
        if !folder.is_dir() {
            continue;
        }
        let checkpoint = Checkpoint::open(&folder)?;
        let weights = match part {
            "lm" => Some(lm_weights),
            "points" | "evidence" => Some(MODEL_FILE),
            _ => None,
        };
        let mut files = CheckpointFiles::default();
        for name in checkpoint.names() {
            match weights {
                Some(weights) if weights == name => {
                    files.tensors_as_bytes(name, &checkpoint.tensors(name)?)?;
                }
                // The other set of weights, and what only training reads.
                Some(_) if !KEPT.contains(&name) => {}
                _ => files.bytes(name, checkpoint.bytes(name)?),
            }
        }
        files.write(&out.join(part))?;
    }
    Ok(())
}

fn merge(model: &Path, out: &Path) -> CliResult {
    // Saving replaces a folder as a whole, so the content of an existing folder would be lost.
    output::check_new(out)?;
    let mut lm = RadarLm::load(model, &Device::flex())
        .map_err(|e| CliError::new(e).hint("--model wants the `lm` folder of a trained model"))?;
    if lm.adapters.is_none() {
        return Err(
            CliError::new(format!("{}: has no adapters", model.display()))
                .hint("a model trained whole needs no merging"),
        );
    }
    lm.merge();
    lm.save(out)?;
    output::print_line(&out.display().to_string());
    Ok(())
}

fn logits(weights: &Path, ids: &Path, out: &Path, force: bool, json: bool) -> CliResult {
    output::check_free(out, force)?;
    let input = read_ids(ids)?;
    let device = Device::flex();
    let network = Pretrained::open(weights, &device)
        .map_err(|e| CliError::new(e).hint("a folder with config.json and model.safetensors"))?;
    let (values, shape) = network
        .logits(&input, &device)
        .map_err(|e| CliError::new(format!("{}: {e}", ids.display())))?;
    let mut npy = Vec::new();
    let mut writer = NpyWriter::new(&mut npy, &shape)?;
    writer.extend(values)?;
    writer.finish()?;
    output::write_atomic(out, &npy)?;
    let report = Report {
        architecture: network.architecture(),
        output: match network {
            Pretrained::Bert(_) => "hidden states",
            _ => "logits",
        },
        shape,
    };
    if json {
        return output::print_json(&report);
    }
    output::print_line(&format!(
        "{}: {} {:?} -> {}",
        report.architecture,
        report.output,
        report.shape,
        out.display()
    ));
    Ok(())
}

fn read_ids(path: &Path) -> CliResult<ModelInput> {
    let bytes = files::read_bytes(path, MAX_IDS_BYTES)?;
    serde_json::from_slice(&bytes).map_err(|e| {
        CliError::new(format!("{}: {e}", path.display()))
            .hint(r#"{"input_ids": [[..]], "decoder_input_ids": [[..]], "attention_mask": [[..]]}, the last two where needed"#)
    })
}
