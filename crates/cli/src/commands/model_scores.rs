//! BERTScore and SimCSE for `score` and `eval`, computed with a checkpoint that the user specifies.

use std::path::Path;

use radarllm_eval::{
    EvalError,
    embedding_scores::{
        BertScoreOptions, EncodedSentence, EncoderResult, SentenceEncoder, add_bert_score,
        add_sim_cse,
    },
};
use radarllm_metrics::{Candidate, Reference, Scores};
use radarllm_nn::{
    Device,
    device::Processor,
    pretrained::{Pooling, TextEncoder},
};

use crate::{
    error::{CliError, CliResult, processor_error},
    model_args::EncoderArgs,
};

/// A checkpoint as a sentence encoder.
struct Checkpoint {
    encoder: TextEncoder,
    /// Folder of the checkpoint, its name in reports.
    name: String,
    /// How a sentence is reduced to one vector.
    pooling: Pooling,
}

impl SentenceEncoder for Checkpoint {
    fn width(&self) -> usize {
        self.encoder.width()
    }

    fn ids(&self, texts: &[String]) -> EncoderResult<Vec<Vec<u32>>> {
        Ok(self.encoder.ids(texts)?)
    }

    fn encode(&self, texts: &[String], layer: usize) -> EncoderResult<Vec<EncodedSentence>> {
        let encoded = self.encoder.encode(texts, layer)?.into_iter();
        let sentence = encoded.map(|text| EncodedSentence {
            ids: text.ids,
            states: text.states,
        });
        Ok(sentence.collect())
    }

    fn embed(&self, texts: &[String]) -> EncoderResult<Vec<Vec<f32>>> {
        Ok(self.encoder.sentences(texts, self.pooling)?)
    }
}

/// The encoders of a command, opened once.
pub(crate) struct Encoders {
    bert_score: Option<(Checkpoint, BertScoreOptions)>,
    /// With the name of the pooling.
    sim_cse: Option<(Checkpoint, String)>,
}

impl Encoders {
    /// Opens what `--bert-score` and `--sim-cse` name; `None` without either.
    pub(crate) fn open(args: &EncoderArgs) -> CliResult<Option<Self>> {
        if !args.are_given() {
            return Ok(None);
        }
        let device = args.device.as_deref().unwrap_or("cpu").parse::<Processor>();
        let device = device.and_then(Processor::device);
        let device = device.map_err(|e| processor_error("--device: ", &e))?;
        let mut encoders = Self {
            bert_score: None,
            sim_cse: None,
        };
        if let Some(dir) = &args.bert_score {
            let layer = args.layer.ok_or_else(|| {
                CliError::new("--bert-score needs --layer")
                    .hint("17 for roberta-large, 9 for bert-base-uncased, 6 for all-MiniLM-L6-v2")
            })?;
            let options = BertScoreOptions {
                layer,
                baseline: args.bert_baseline,
            };
            encoders.bert_score = Some((open(dir, &device, Pooling::Cls)?, options));
        }
        if let Some(dir) = &args.sim_cse {
            let name = args.pooling.as_deref().ok_or_else(|| {
                CliError::new("--sim-cse needs --pooling").hint("pooler (supervised), cls or mean")
            })?;
            let pooling = Pooling::from_name(name).ok_or_else(|| {
                CliError::new(format!("--pooling {name}: unknown")).hint("pooler, cls or mean")
            })?;
            encoders.sim_cse = Some((open(dir, &device, pooling)?, name.into()));
        }
        Ok(Some(encoders))
    }

    /// Adds their scores to those of the same captions.
    pub(crate) fn add(
        &self,
        scores: &mut Scores,
        candidates: &[Candidate],
        references: &[Reference],
        seed: u64,
    ) -> Result<(), EvalError> {
        let captions = (candidates, references);
        if let Some((encoder, options)) = &self.bert_score {
            add_bert_score(scores, captions, encoder, &encoder.name, options, seed)?;
        }
        if let Some((encoder, pooling)) = &self.sim_cse {
            add_sim_cse(scores, captions, encoder, &encoder.name, pooling, seed)?;
        }
        Ok(())
    }
}

fn open(dir: &Path, device: &Device, pooling: Pooling) -> CliResult<Checkpoint> {
    let encoder = TextEncoder::open(dir, device).map_err(|e| {
        CliError::new(e).hint("a folder with config.json, model.safetensors and tokenizer.json")
    })?;
    Ok(Checkpoint {
        encoder,
        name: dir.display().to_string(),
        pooling,
    })
}
