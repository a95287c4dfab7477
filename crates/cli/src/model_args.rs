//! Arguments that name models: the decoder of a language model, and sentence encoders.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

/// Decoder of the language model.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum DecoderName {
    /// The inference engine with 32-bit weights.
    F32,
    /// The inference engine with 8-bit weights: faster for large models; sentences may differ.
    Int8,
    /// The networks used in training (feature `train`): slow; same sentences as `f32`.
    Training,
}

impl DecoderName {
    /// Name in reports.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::F32 => "inference engine, f32",
            Self::Int8 => "inference engine, int8",
            Self::Training => "training network",
        }
    }
}

/// Sentence encoders for BERTScore and SimCSE (feature `train`).
#[derive(Args)]
pub(crate) struct EncoderArgs {
    /// BERT or RoBERTa folder (config.json, model.safetensors, tokenizer.json) for BERTScore. Protocol
    /// motiongpt weights words by idf, the others do not.
    #[arg(long, value_name = "DIR")]
    pub bert_score: Option<PathBuf>,
    /// Layer for BERTScore, 17 for roberta-large, 6 for all-MiniLM-L6-v2.
    #[arg(long, requires = "bert_score")]
    pub layer: Option<usize>,
    /// F1 baseline that rescales BERTScore, 0.83122575 for layer 17 of roberta-large.
    #[arg(long, value_name = "F1", requires = "bert_score")]
    pub bert_baseline: Option<f64>,
    /// BERT or RoBERTa folder for SimCSE.
    #[arg(long, value_name = "DIR")]
    pub sim_cse: Option<PathBuf>,
    /// Pooling for SimCSE: pooler (supervised), cls (unsupervised) or mean.
    #[arg(long, requires = "sim_cse")]
    pub pooling: Option<String>,
    /// Device for BERT and RoBERTa: cpu (default), gpu, gpu:N, cuda or cuda:N (docs/guides/training-on-gpus.md).
    #[arg(long)]
    pub device: Option<String>,
}

impl EncoderArgs {
    /// Whether an encoder is named.
    pub(crate) fn are_given(&self) -> bool {
        self.bert_score.is_some() || self.sim_cse.is_some()
    }
}
