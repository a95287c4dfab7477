//! A model that reads radar tokens alone, made of one that reads features beside them, without training.
//!
//! The input of the language model for 0.4 s is the embedding of the code plus the projected feature (the bypass). A language
//! model that has the features learns nothing about the codes. Therefore the embedding of each code gets what the bypass makes
//! of its vector in the codebook: a token says what the feature of its code says.

use std::path::Path;

use radarllm_inference::checkpoint::{CheckpointFiles, HostTensor, MODEL_FILE};
use radarllm_inference::lm::ensemble::Member;
use radarllm_inference::tokenizer::RadarTokenizer;
use radarllm_nn::lm::RadarLm;

use crate::harness::{TrainError, cpu_device};

/// Makes a member of a model in `dir` read its radar tokens alone and writes it to `out`, which must not exist. The tokenizer
/// stays as it is.
///
/// # Errors
/// A folder without a model, or a model whose language model has no bypass or is no T5.
pub fn tokens_only(dir: &Path, out: &Path) -> Result<(), TrainError> {
    let member = Member::open(dir)?;
    // Both must fit each other before anything is written.
    RadarTokenizer::from_checkpoint(&member.tokenizer)?;
    let mut weights = member.tokenizer.tensors(MODEL_FILE)?;
    let codebook = weights.remove("codebook").unwrap_or(HostTensor {
        shape: vec![0, 0],
        values: Vec::new(),
    });
    let lm = RadarLm::load_tokens_only(&dir.join("lm"), &codebook, &cpu_device())?;
    // Byte for byte, so that a decoder of its tokens fits both.
    let mut files = CheckpointFiles::default();
    for name in member.tokenizer.names() {
        files.bytes(name, member.tokenizer.bytes(name)?);
    }
    files.write(&out.join("tokenizer"))?;
    lm.save(&out.join("lm"))?;
    Ok(())
}
