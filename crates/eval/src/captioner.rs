//! The model under evaluation. All modules of this crate ask for captions here.

use radarllm_base::Clip;
use radarllm_inference::lm::captioner::N_DRAWS;
use radarllm_inference::{Captioner, DescribeOptions, Description, LmError, PreparedClip};

use crate::EvalError;

/// Facts about a model that reports repeat.
#[derive(Clone, Debug)]
pub struct ModelInfo {
    /// Name in reports.
    pub name: String,
    /// What decodes sentences, and in which precision.
    pub decoder: &'static str,
    /// Size of the model's files, bytes.
    pub bytes: u64,
    /// Hash of the model's files: distinguishes models of one name.
    pub fingerprint: u64,
}

/// How sentences are decided, in words.
pub(crate) fn decision(beam: Option<usize>) -> String {
    match beam {
        None => format!("vote of {N_DRAWS} draws"),
        Some(n) => format!("beam {n}"),
    }
}

/// Captions of clips, in their order; with `beam` as in [`DescribeOptions`].
pub(crate) fn caption_clips(
    captioner: &Captioner,
    clips: &[&Clip],
    beam: Option<usize>,
) -> Result<Vec<Description>, EvalError> {
    let options = DescribeOptions {
        beam,
        ..DescribeOptions::default()
    };
    let prepared = clips.iter().map(|clip| PreparedClip::of(clip));
    let prepared = prepared.collect::<Result<Vec<_>, _>>();
    let prepared = prepared.map_err(LmError::from)?;
    let prepared: Vec<&PreparedClip> = prepared.iter().collect();
    Ok(captioner.describe_batch(&prepared, &options)?)
}
