//! A model that reads radar tokens alone, made of one that reads features beside them, without training.
//!
//! The input of the language model for 0.4 s is the embedding of the code plus the projected feature (the bypass). A language
//! model that has the features learns nothing about the codes. Therefore the embedding of each code gets what the bypass makes
//! of its vector in the codebook: a token says what the feature of its code says.

use std::path::Path;

use radarllm_dataset::{Columns, Dataset, Split};
use radarllm_inference::checkpoint::{
    CONFIG_FILE, CheckpointFiles, HostTensor, MODEL_FILE, NamedTensors,
};
use radarllm_inference::lm::ensemble::Member;
use radarllm_inference::tokenizer::RadarTokenizer;
use radarllm_inference::tokenizer::encode::TokenizerFile;
use radarllm_inference::tokenizer::residual::{RESIDUAL_FILE, RESIDUAL_TENSOR, residuals};
use radarllm_nn::lm::RadarLm;
use radarllm_nn::tokenizer::codebook::{CodebookConfig, EmaCodebook};

use crate::harness::{TrainError, cpu_device};
use crate::recipe::lm_clips;

/// Second codes of a step, and the clips to which their codebook is fitted.
#[derive(Clone, Copy, Debug)]
pub struct ResidualCodes<'a> {
    /// Number of codes of the second codebook.
    pub n_codes: usize,
    /// Data sets, of whose training clips and their mirror images features are drawn.
    pub data: &'a [std::path::PathBuf],
}

/// Features of a step for each second code, from which it is fitted.
const FEATURES_PER_CODE: usize = 128;
/// Iterations of k-means.
const ROUNDS: usize = 30;
/// Seed of k-means.
const SEED: u64 = 0x7265_7369;

/// Makes a member of a model in `dir` read its radar tokens alone and writes it to the folders `tokenizer` and `lm` of `out`,
/// which are replaced. The tokenizer stays as it is, but for a second codebook if `residual_codes` are wanted.
///
/// # Errors
/// A folder without a model, a model whose language model has no bypass or is no T5, a tokenizer that has a second codebook
/// already, or data sets with fewer features than second codes.
pub fn tokens_only(
    dir: &Path,
    residual_codes: Option<ResidualCodes>,
    out: &Path,
) -> Result<(), TrainError> {
    let member = Member::open(dir)?;
    // Both must fit each other before anything is written.
    let tokenizer = RadarTokenizer::from_checkpoint(&member.tokenizer)?;
    let mut weights = member.tokenizer.tensors(MODEL_FILE)?;
    let codebook = weights.remove("codebook").unwrap_or(HostTensor {
        shape: vec![0, 0],
        values: Vec::new(),
    });
    let has_residual_codes = residual_codes.is_some();
    let lm = RadarLm::load_tokens_only(
        &dir.join("lm"),
        &codebook,
        has_residual_codes,
        &cpu_device(),
    )?;
    // Byte for byte, so that a decoder of its tokens fits both.
    let mut files = CheckpointFiles::default();
    for name in member.tokenizer.names() {
        files.bytes(name, member.tokenizer.bytes(name)?);
    }
    if let Some(wanted) = residual_codes {
        let mut file = TokenizerFile::read(&member.tokenizer)?;
        if file.model.residual_codes > 0 {
            return Err(TrainError::Config {
                field: "residual_codes".into(),
                problem: format!("{} has a second codebook already", dir.display()),
            });
        }
        let second = fit(&tokenizer, &codebook.values, wanted)?;
        file.model.residual_codes = wanted.n_codes;
        files.json(CONFIG_FILE, &file)?;
        let second = NamedTensors::from([(RESIDUAL_TENSOR.to_string(), second)]);
        files.tensors(RESIDUAL_FILE, &second)?;
    }
    files.write(&out.join("tokenizer"))?;
    lm.save(&out.join("lm"))?;
    Ok(())
}

/// A second codebook by k-means of what the first one leaves of the features of training clips.
fn fit(
    tokenizer: &RadarTokenizer,
    codebook: &[f32],
    wanted: ResidualCodes,
) -> Result<HostTensor, TrainError> {
    let dim = tokenizer.config().code_dim;
    let mut left = Vec::new();
    for dir in wanted.data {
        let clips: Result<Vec<_>, _> = Dataset::open(dir)?
            .iter_split(Split::Train, Columns::Points)
            .collect();
        for motion in lm_clips(tokenizer, &clips?, true, 0)? {
            for encoded in motion.variants.iter().chain(&motion.flipped) {
                left.extend(residuals(&encoded.features, &encoded.codes, codebook, dim));
            }
        }
    }
    let n_steps = left.len() / dim;
    if n_steps < wanted.n_codes {
        return Err(TrainError::Config {
            field: "residual_codes".into(),
            problem: format!(
                "{} codes need as many steps, the data sets have {n_steps}",
                wanted.n_codes
            ),
        });
    }
    // Evenly drawn, because clips of one motion follow each other.
    let every = n_steps.div_ceil(FEATURES_PER_CODE * wanted.n_codes);
    let drawn: Vec<f32> = left
        .chunks_exact(dim)
        .step_by(every)
        .flatten()
        .copied()
        .collect();
    let mut second = EmaCodebook::new(wanted.n_codes, dim);
    let config = CodebookConfig {
        init_after: 0,
        init_inputs_per_code: 1,
        init_rounds: ROUNDS,
        ..CodebookConfig::default()
    };
    second.update(&drawn, &[], &config, SEED);
    Ok(HostTensor {
        shape: vec![wanted.n_codes, dim],
        values: second.codes().to_vec(),
    })
}
