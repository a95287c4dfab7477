//! BERTScore and SimCSE for `score`, computed with a checkpoint that the user specifies.

use std::path::Path;

use radarllm_eval::embedding_scores::{
    BertScoreOptions, EncodedSentence, EncoderResult, SentenceEncoder, add_bert_score, add_sim_cse,
};
use radarllm_metrics::{Candidate, Reference, Scores};
use radarllm_nn::{
    Device,
    device::Processor,
    pretrained::{Pooling, TextEncoder},
};

use crate::{
    args::ScoreArgs,
    error::{CliError, CliResult, processor_error},
};

/// A checkpoint as a sentence encoder.
struct Checkpoint {
    encoder: TextEncoder,
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

/// Adds the scores that `--bert-score` and `--sim-cse` request.
pub fn add(
    scores: &mut Scores,
    args: &ScoreArgs,
    candidates: &[Candidate],
    references: &[Reference],
) -> CliResult {
    if args.bert_score.is_none() && args.sim_cse.is_none() {
        return Ok(());
    }
    let device = args.device.as_deref().unwrap_or("cpu").parse::<Processor>();
    let device = device.and_then(Processor::device);
    let device = device.map_err(|e| processor_error("--device: ", &e))?;
    let captions = (candidates, references);
    if let Some(dir) = &args.bert_score {
        let layer = args.layer.ok_or_else(|| {
            CliError::new("--bert-score needs --layer")
                .hint("17 for roberta-large, 9 for bert-base-uncased")
        })?;
        let encoder = open(dir, &device, Pooling::Cls)?;
        let options = BertScoreOptions {
            layer,
            baseline: args.bert_baseline,
        };
        let name = dir.display().to_string();
        add_bert_score(scores, captions, &encoder, &name, &options, args.seed)?;
    }
    if let Some(dir) = &args.sim_cse {
        let name = args.pooling.as_deref().ok_or_else(|| {
            CliError::new("--sim-cse needs --pooling").hint("pooler (supervised), cls or mean")
        })?;
        let pooling = Pooling::from_name(name).ok_or_else(|| {
            CliError::new(format!("--pooling {name}: unknown")).hint("pooler, cls or mean")
        })?;
        let encoder = open(dir, &device, pooling)?;
        let checkpoint = dir.display().to_string();
        add_sim_cse(scores, captions, &encoder, &checkpoint, name, args.seed)?;
    }
    Ok(())
}

fn open(dir: &Path, device: &Device, pooling: Pooling) -> CliResult<Checkpoint> {
    let encoder = TextEncoder::open(dir, device).map_err(|e| {
        CliError::new(e).hint("a folder with config.json, model.safetensors and tokenizer.json")
    })?;
    Ok(Checkpoint { encoder, pooling })
}
