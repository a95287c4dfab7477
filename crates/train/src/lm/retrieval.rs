//! Embeddings of codes and of sentences by the encoder of a language model that was trained with the contrastive loss
//! ([`super::contrast`]), for retrieval.

use burn::tensor::Tensor;
use radarllm_inference::lm::{LmError, Source};
use radarllm_inference::tokenizer::Encoded;
use radarllm_nn::lm::{RadarLm, SourceBatch};

use super::contrast::mean_rows;
use crate::harness::TrainError;

/// Inputs that are encoded at once.
const BATCH: usize = 64;

/// Embeddings of clips: the mean states of their codes, `[clip][width]`.
///
/// # Errors
/// Codes that do not fit the model, or a model without an encoder.
pub fn embed_codes(lm: &RadarLm, clips: &[Encoded]) -> Result<Vec<Vec<f32>>, TrainError> {
    let prompts: Vec<Source> = clips
        .iter()
        .map(|codes| lm.describe_prompt(codes))
        .collect::<Result<_, LmError>>()?;
    embed(lm, &prompts, |source| {
        source
            .feature_positions
            .iter()
            .map(|p| *p as usize)
            .collect()
    })
}

/// Embeddings of sentences: the mean states of their tokens, `[sentence][width]`.
///
/// # Errors
/// Sentences that cannot be encoded, or a model without an encoder.
pub fn embed_texts<S: AsRef<str>>(lm: &RadarLm, texts: &[S]) -> Result<Vec<Vec<f32>>, TrainError> {
    let end = lm.vocab.layout().end;
    let sources: Vec<Source> = texts
        .iter()
        .map(|text| {
            let mut ids = lm.vocab.text_ids(text.as_ref())?;
            // Targets of training end so.
            ids.push(end);
            Ok(Source {
                ids,
                ..Source::default()
            })
        })
        .collect::<Result<_, LmError>>()?;
    embed(lm, &sources, |source| (0..source.ids.len()).collect())
}

fn embed(
    lm: &RadarLm,
    sources: &[Source],
    rows_of: impl Fn(&Source) -> Vec<usize>,
) -> Result<Vec<Vec<f32>>, TrainError> {
    let net = lm.net.t5().ok_or_else(|| TrainError::Config {
        field: "backbone".into(),
        problem: "retrieval needs an encoder, which only t5 has".into(),
    })?;
    let mut all = Vec::with_capacity(sources.len());
    for chunk in sources.chunks(BATCH) {
        let batch: Vec<&Source> = chunk.iter().collect();
        let batch = SourceBatch::new(&batch, lm.config.code_dim, &net.device());
        let encoded = net.encode(&batch, None);
        let groups: Vec<Vec<usize>> = chunk
            .iter()
            .enumerate()
            .map(|(i, source)| {
                rows_of(source)
                    .iter()
                    .map(|row| i * encoded.length + row)
                    .collect()
            })
            .collect();
        let means: Tensor<2> = mean_rows(encoded.states, &groups);
        let [_, width] = means.dims();
        let values: Vec<f32> = means.into_data().try_into_vec().unwrap_or_default();
        all.extend(values.chunks_exact(width.max(1)).map(<[f32]>::to_vec));
    }
    Ok(all)
}
