//! The model that a command names, on the decoder that it names.

use std::path::Path;

use radarllm::{Captioner, Choices, Model, ModelFiles, ModelOptions, Precision};
#[cfg(feature = "eval")]
use radarllm_eval::ModelInfo;
#[cfg(feature = "eval")]
use radarllm_inference::lm::{RadarCut, vocab::TextKind};

use crate::{error::CliResult, model_args::DecoderName};

/// Loads a model folder, or the bundled model, for a decoder. Its name tells when it is an approximation.
pub(crate) fn open(folder: Option<&Path>, decoder: DecoderName) -> CliResult<Model> {
    Ok(Model::load(ModelFiles::of(folder), &options(decoder)?)?)
}

/// The model with each way from the radar into its language model cut, to measure what travels on it; none if the language
/// model is a decoder alone, for which this is not implemented.
#[cfg(feature = "eval")]
pub(crate) fn open_cut(model: &Model, decoder: DecoderName) -> CliResult<Vec<CutModel>> {
    if model.networks()?.vocab().layout().kind == TextKind::Decoder {
        return Ok(Vec::new());
    }
    let cuts = [
        RadarCut::AllButTokens,
        RadarCut::Tokens,
        RadarCut::TokenMeaning,
    ];
    cuts.into_iter()
        .map(|cut| {
            let options = ModelOptions {
                cut: Some(cut),
                ..options(decoder)?
            };
            let model = Model::load(model.files().clone(), &options)?;
            Ok(CutModel { cut, model })
        })
        .collect()
}

/// A model of which a way from the radar is cut.
#[cfg(feature = "eval")]
pub(crate) struct CutModel {
    /// What is cut.
    pub cut: RadarCut,
    /// The rest.
    pub model: Model,
}

/// As [`open`], ready to describe.
pub(crate) fn captioner(folder: Option<&Path>, decoder: DecoderName) -> CliResult<Captioner> {
    Ok(Captioner::new(open(folder, decoder)?))
}

/// A captioner that chooses among activities, if any are named.
pub(crate) fn restricted(captioner: Captioner, names: &[String]) -> CliResult<Captioner> {
    if names.is_empty() {
        return Ok(captioner);
    }
    let choices = Choices::new(names.iter().map(String::as_str))?;
    for name in choices.unknown() {
        note!("warning: `{name}` names no action that the model learned; it is scored as text");
    }
    Ok(captioner.with_choices(choices))
}

/// What reports repeat about a model.
#[cfg(feature = "eval")]
pub(crate) fn info(model: &Model, decoder: DecoderName) -> CliResult<ModelInfo> {
    let files = model.fingerprint()?;
    Ok(ModelInfo {
        name: model.name().into(),
        decoder: decoder.name(),
        bytes: files.bytes,
        fingerprint: files.hash,
    })
}

/// How a decoder computes. The inference engine runs T5 only; a build with training runs other language models on their
/// networks as trained.
#[cfg(feature = "train")]
fn options(decoder: DecoderName) -> CliResult<ModelOptions> {
    let (precision, backend): (_, radarllm_inference::LoadBackend) = match decoder {
        DecoderName::F32 => (Precision::F32, radarllm_nn::load_any),
        DecoderName::Int8 => (Precision::Int8, radarllm_nn::load_any),
        DecoderName::Training => (Precision::F32, radarllm_nn::load_reference),
    };
    Ok(ModelOptions {
        precision,
        backend,
        ..ModelOptions::default()
    })
}

/// How a decoder computes.
#[cfg(not(feature = "train"))]
fn options(decoder: DecoderName) -> CliResult<ModelOptions> {
    let precision = match decoder {
        DecoderName::F32 => Precision::F32,
        DecoderName::Int8 => Precision::Int8,
        DecoderName::Training => {
            return Err(crate::error::needs_training("--decoder training"));
        }
    };
    Ok(ModelOptions {
        precision,
        ..ModelOptions::default()
    })
}
