//! The two language-model stages on the shared training loop.

use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::tensor::{Tensor, TensorData};
use radarllm_facts::swap_sides;
use radarllm_inference::checkpoint::{
    Checkpoint, CheckpointFiles, HostTensor, MODEL_FILE, NamedTensors,
};
use radarllm_inference::lm::card::{AVERAGE_FILE, TEXT_TOKENIZER_FILE};
use radarllm_inference::lm::templates::{Task, all_text};
use radarllm_inference::lm::vocab::PAD;
use radarllm_inference::lm::{GenerateOptions, Source, Vocab};
use radarllm_metrics::rouge::rouge_l;
use radarllm_metrics::tokens::rouge_score;
use radarllm_nn::lm::radar_lm::card_to_json;
use radarllm_nn::lm::t5::EncoderOutput;
use radarllm_nn::lm::{RadarLm, RadarNet, RadarT5, SourceBatch, TrainingPass};
use radarllm_nn::params::{collect_some_params, replace_params};
use radarllm_nn::precision::ProductPrecision;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;

use super::clip::LmClip;
use super::config::LmTrainConfig;
use super::contrast::{contrast, mean_rows};
use super::examples::{Example, ExampleMaker, Item, LmStageKind, samples_of_writing};
use super::loss::cross_entropy;
use super::sentences::read_sentences;
use crate::average::WeightAverage;
use crate::harness::{
    Ending, Outcome, Stage, StepInfo, StepLoss, TrainError, Validation, cpu_device, run,
};

/// Sentences that are written from a caption for the words of the vocabulary, if captions are written anew.
const N_WRITTEN: u64 = 8;

/// Result of a language-model stage.
#[derive(Debug)]
pub struct LmOutcome {
    /// Directory that [`RadarLm::load`] opens: the best checkpoint by validation, or the last one.
    pub checkpoint: PathBuf,
    /// Reason for the end of the run.
    pub ending: Ending,
    /// Number of updates in all sessions.
    pub steps: u64,
    /// Training time in all sessions, s.
    pub seconds: f64,
    /// Lowest validation loss of radar-to-text, nats per token.
    pub best_score: Option<f64>,
}

/// Pretrains a language model on radar prediction, radar to text and text to radar.
///
/// Training starts from `config.hf_folder` if it is given. Otherwise it starts from a new network of the preset, whose
/// vocabulary is built from `clips` (and their mirrored captions) and from `config.sentences`. `n_codes` is the size of the radar codebook. Without
/// `val`, the result is the last weights.
///
/// # Errors
/// See [`TrainError`]. Clips are checked before any file is written.
pub fn pretrain(
    config: &LmTrainConfig,
    n_codes: usize,
    clips: &[LmClip],
    val: &[LmClip],
    out: &Path,
    resume: bool,
) -> Result<LmOutcome, TrainError> {
    config.validate()?;
    let first = clips.first().and_then(|c| c.variants.first());
    let code_dim = first.map_or(0, |e| e.features.len() / e.codes.len().max(1));
    if code_dim == 0 {
        return Err(TrainError::NoData(
            "the first clip has no codes with features",
        ));
    }
    let device = cpu_device();
    let lm = match &config.hf_folder {
        Some(dir) => {
            let bypass = config.bypass.unwrap_or(false);
            let seed = config.run.seed;
            let mut lm = RadarLm::from_hf_folder(
                dir,
                config.lora,
                n_codes,
                code_dim,
                bypass,
                seed,
                &device,
            )?;
            let found = lm.config.network.backbone();
            if found != config.backbone {
                return Err(TrainError::Config {
                    field: "backbone".into(),
                    problem: format!(
                        "is `{}`, but {} holds a `{}`",
                        config.backbone.name(),
                        dir.display(),
                        found.name()
                    ),
                });
            }
            if let Some(dropout) = config.dropout {
                lm.set_dropout(dropout);
            }
            lm
        }
        None => {
            if config.lora.is_some() {
                return Err(TrainError::Config {
                    field: "lora".into(),
                    problem: "adapters need a pretrained network: set `from` to its folder".into(),
                });
            }
            let shape = config.lm_config(n_codes, code_dim)?;
            let mirrored: Vec<String> = clips
                .iter()
                .flat_map(|c| &c.captions)
                .map(|c| swap_sides(c))
                .collect();
            let captions = clips.iter().flat_map(|c| &c.captions).chain(&mirrored);
            let written: Vec<String> = match config.rewrite_captions > 0.0 {
                true => {
                    samples_of_writing(captions.clone().map(String::as_str), N_WRITTEN).collect()
                }
                false => Vec::new(),
            };
            let sentences = read_sentences(&config.sentences)?;
            let captions = captions.chain(&written).chain(&sentences);
            let mut vocab = Vocab::learn(
                captions.map(String::as_str),
                all_text(),
                shape.max_text_vocab,
                shape.n_sentinels,
                n_codes,
            )?;
            if config.context {
                vocab = vocab.with_context();
            }
            RadarLm::new(shape, vocab, config.run.seed, &device)?
        }
    };
    train(config, lm, LmStageKind::Pretrain, clips, val, out, resume)
}

/// Pretrains a model that was trained before on further clips, with its own vocabulary: new words are spelled.
///
/// # Errors
/// See [`TrainError`]. Clips are checked before any file is written.
pub fn pretrain_further(
    config: &LmTrainConfig,
    start: RadarLm,
    clips: &[LmClip],
    val: &[LmClip],
    out: &Path,
    resume: bool,
) -> Result<LmOutcome, TrainError> {
    config.validate()?;
    let kind = LmStageKind::Pretrain;
    train(config, start, kind, clips, val, out, resume)
}

/// Fine-tunes a pretrained model on prompt templates and sub-tasks.
///
/// # Errors
/// See [`TrainError`]. Clips are checked before any file is written.
pub fn instruct(
    config: &LmTrainConfig,
    start: RadarLm,
    clips: &[LmClip],
    val: &[LmClip],
    out: &Path,
    resume: bool,
) -> Result<LmOutcome, TrainError> {
    config.validate()?;
    if config.lora.is_some() && start.adapters.is_none() {
        return Err(TrainError::Config {
            field: "lora".into(),
            problem: "the pretrained model has no adapters: set `lora` there".into(),
        });
    }
    train(
        config,
        start,
        LmStageKind::Instruct,
        clips,
        val,
        out,
        resume,
    )
}

fn train(
    config: &LmTrainConfig,
    lm: RadarLm,
    kind: LmStageKind,
    clips: &[LmClip],
    val: &[LmClip],
    out: &Path,
    resume: bool,
) -> Result<LmOutcome, TrainError> {
    if clips.is_empty() {
        return Err(TrainError::NoData("no clips"));
    }
    let mut run_config = config.run.clone();
    if val.is_empty() {
        run_config.validate_every = u64::MAX;
    }
    let (mut stage, net) = LmStage::new(config, lm, kind, clips, val)?;
    let outcome: Outcome<RadarNet> = run(&mut stage, net, &run_config, out, resume)?;
    Ok(LmOutcome {
        checkpoint: outcome.checkpoint,
        ending: outcome.ending,
        steps: outcome.steps,
        seconds: outcome.seconds,
        best_score: outcome.best_score,
    })
}

/// Losses of a batch, `[1]` each.
struct Losses {
    /// Cross-entropy of the target tokens.
    tokens: Tensor<1>,
    /// Contrastive loss, if it is enabled and at least two examples take part.
    contrast: Option<Tensor<1>>,
}

/// One language-model stage.
pub(super) struct LmStage {
    config: LmTrainConfig,
    kind: LmStageKind,
    /// Vocabulary and configuration. Its network is replaced for validation.
    lm: RadarLm,
    train: ExampleMaker,
    val: ExampleMaker,
    /// Moving average of the weights.
    average: Option<WeightAverage>,
}

impl LmStage {
    /// Creates the stage, and the network to train on an autodiff device.
    pub(super) fn new(
        config: &LmTrainConfig,
        lm: RadarLm,
        kind: LmStageKind,
        clips: &[LmClip],
        val: &[LmClip],
    ) -> Result<(Self, RadarNet), TrainError> {
        let maker =
            |clips: &[LmClip]| ExampleMaker::new(&lm.vocab, lm.config.code_dim, clips, kind);
        let (mut train, mut val) = (maker(clips)?, maker(val)?);
        if config
            .trained_tasks(kind)
            .any(|task| task == Task::Question)
        {
            train.read_answers(&lm.vocab)?;
            val.read_answers(&lm.vocab)?;
        }
        if config.rewrite_captions > 0.0 {
            train.read_facts();
        }
        train.add_sentences(&lm.vocab, &read_sentences(&config.sentences)?)?;
        if config.captions_per_motion > 0 {
            train.keep_captions(config.captions_per_motion);
        }
        let mut lm = lm;
        let learned = lm.learned.get_or_insert_default();
        match kind {
            LmStageKind::Pretrain => &mut learned.pretrained,
            LmStageKind::Instruct => &mut learned.tuned,
        }
        .extend(config.trained_tasks(kind));
        let average = (config.average_decay > 0.0)
            .then(|| collect_some_params(&lm.net, &|path| lm.is_trained(path)))
            .map(WeightAverage::new);
        for device in config.run.processors.devices()? {
            if !config.precision.is_known_to(&device) {
                return Err(TrainError::Config {
                    field: "precision".into(),
                    problem: format!(
                        "`{}` does not compute in it: another precision or another device",
                        config.run.processors
                    ),
                });
            }
        }
        let device = config.run.processors.first().device()?.autodiff();
        let net = lm.net.clone().to_device(&device).train();
        Ok((
            Self {
                config: config.clone(),
                kind,
                lm,
                train,
                val,
                average,
            },
            net,
        ))
    }

    /// Computes the losses of examples.
    fn losses(
        &self,
        net: &RadarNet,
        examples: &[Example],
        smoothing: f64,
        training: Option<&mut TrainingPass>,
    ) -> Result<Losses, TrainError> {
        let (mut targets, mut weights) = (Vec::new(), Vec::new());
        for example in examples {
            targets.extend(&example.target);
            let lambda = self.config.lambda.of(example.task) as f32;
            weights.extend(std::iter::repeat_n(lambda, example.target.len()));
        }
        let n_rows = self.lm.config.network.vocab_size();
        let code_dim = self.lm.config.code_dim;
        let mut contrast = None;
        let precision = training
            .as_ref()
            .map_or_else(Default::default, |t| t.precision);
        let logits = match net {
            RadarNet::T5(net) => {
                let mut training = training;
                let sources: Vec<&Source> = examples.iter().map(|e| &e.source).collect();
                let batch = SourceBatch::new(&sources, code_dim, &net.device());
                let encoded = net.encode(&batch, training.as_deref_mut());
                let targets: Vec<&[u32]> = examples.iter().map(|e| e.target.as_slice()).collect();
                let states = target_states(net, &encoded, &targets, training.as_deref_mut());
                if self.config.contrastive_weight > 0.0 {
                    contrast = self.contrast(net, &encoded, examples, training);
                }
                net.t5.logits(states, n_rows, precision)
            }
            RadarNet::Decoder(net) => {
                let examples: Vec<(&Source, &[u32])> = examples
                    .iter()
                    .map(|e| (&e.source, e.target.as_slice()))
                    .collect();
                let states = net.target_states(&examples, code_dim, training)?;
                net.decoder.logits(states, n_rows, precision)
            }
        };
        Ok(Losses {
            tokens: cross_entropy(logits, &targets, &weights, smoothing),
            contrast,
        })
    }

    /// Contrastive loss of the radar-to-text examples; `None` for fewer than two.
    fn contrast(
        &self,
        net: &RadarT5,
        encoded: &EncoderOutput,
        examples: &[Example],
        training: Option<&mut TrainingPass>,
    ) -> Option<Tensor<1>> {
        let (mut radar_rows, mut captions) = (Vec::new(), Vec::new());
        for (i, example) in examples.iter().enumerate() {
            let codes = &example.source.feature_positions;
            if example.task == Task::RadarToText && !codes.is_empty() {
                let row = |at: &u32| i * encoded.length + *at as usize;
                radar_rows.push(codes.iter().map(row).collect::<Vec<_>>());
                captions.push(example.target.as_slice());
            }
        }
        if captions.len() < 2 {
            return None;
        }
        let sources: Vec<Source> = captions
            .iter()
            .map(|ids| Source {
                ids: ids.to_vec(),
                ..Source::default()
            })
            .collect();
        let sources: Vec<&Source> = sources.iter().collect();
        let device = encoded.states.device();
        let batch = SourceBatch::new(&sources, self.lm.config.code_dim, &device);
        let text = net.encode(&batch, training);
        let text_rows: Vec<Vec<usize>> = captions
            .iter()
            .enumerate()
            .map(|(i, ids)| (i * text.length..i * text.length + ids.len()).collect())
            .collect();
        Some(contrast(
            mean_rows(encoded.states.clone(), &radar_rows),
            mean_rows(text.states, &text_rows),
            &captions,
            self.config.contrastive_temperature,
        ))
    }
}

/// Decoder states of the tokens of all targets, each of at least one, concatenated.
pub(crate) fn target_states(
    net: &RadarT5,
    encoded: &EncoderOutput,
    targets: &[&[u32]],
    training: Option<&mut TrainingPass>,
) -> Tensor<2> {
    let length = targets.iter().map(|t| t.len()).max().unwrap_or(1);
    let mut decoder = vec![PAD; targets.len() * length];
    let mut rows = Vec::new();
    for (i, target) in targets.iter().enumerate() {
        let n = target.len();
        // The decoder input is the target shifted by one, after the start token.
        decoder[i * length + 1..i * length + n].copy_from_slice(&target[..n - 1]);
        rows.extend((i * length..i * length + n).map(|r| r as i32));
    }
    let states = net.decode(encoded, &decoder, length, training);
    if rows.len() == decoder.len() {
        return states;
    }
    // Only target tokens enter the output layer, so padding adds neither computing time nor loss.
    let n = rows.len();
    let rows = Tensor::from_data(TensorData::new(rows, [n]), &states.device());
    states.select(0, rows)
}

impl Stage for LmStage {
    type Model = RadarNet;

    fn name(&self) -> &'static str {
        match self.kind {
            LmStageKind::Pretrain => "pretrain",
            LmStageKind::Instruct => "instruct",
        }
    }

    fn plan_epoch(&self, epoch_seed: u64) -> Vec<Vec<usize>> {
        let items = self.train.draw_epoch(&self.config, epoch_seed);
        let batches = self.train.batches(items, self.config.batch, epoch_seed ^ 1);
        batches
            .into_iter()
            .map(|b| b.into_iter().map(Item::pack).collect())
            .collect()
    }

    fn ids(&self, batch: &[usize]) -> Vec<String> {
        let clips = self.train.clips();
        let id = |n: &usize| {
            let item = Item::unpack(*n);
            match item.task {
                Task::TextPrediction => Some(format!("sentence {}", item.clip + 1)),
                _ => Some(clips.get(item.clip)?.id.clone()),
            }
        };
        batch.iter().filter_map(id).collect()
    }

    fn loss(
        &mut self,
        model: &RadarNet,
        batch: &[usize],
        info: StepInfo,
    ) -> Result<StepLoss, TrainError> {
        let rng = &mut ChaCha8Rng::seed_from_u64(info.seed);
        let mut examples = Vec::with_capacity(batch.len());
        for n in batch {
            let item = Item::unpack(*n);
            examples.push(
                self.train
                    .example(&self.lm.vocab, &self.config, &item, rng)?,
            );
        }
        self.project(&mut examples);
        let mut training = TrainingPass::new(info.seed ^ 0x6472_6f70, self.config.precision);
        let smoothing = self.config.label_smoothing;
        let losses = self.losses(model, &examples, smoothing, Some(&mut training))?;
        let (mut total, mut parts) = (losses.tokens, Vec::new());
        if let Some(contrast) = losses.contrast {
            let value = contrast.clone().into_scalar::<f32>();
            parts.push(("contrast", f64::from(value)));
            total = total + contrast * self.config.contrastive_weight;
        }
        Ok(StepLoss { total, parts })
    }

    fn after_step(&mut self, model: RadarNet, info: StepInfo) -> Result<RadarNet, TrainError> {
        if let Some(average) = &mut self.average {
            // The decay is smaller at first. Otherwise the random initial weights would influence the average for a
            // thousand updates.
            let n = info.step as f64;
            let decay = self.config.average_decay.min((1.0 + n) / (10.0 + n)) as f32;
            average.follow(&model, decay);
        }
        Ok(model)
    }

    fn needs_loss_scale(&self) -> bool {
        self.config.precision == ProductPrecision::F16
    }

    fn is_trained(&self, path: &str) -> bool {
        self.lm.is_trained(path)
    }

    /// A T5 checkpoint contains both the last weights and their average, and its configuration defines which file to
    /// use. Other programs read only one file.
    fn for_inference(&self, model: &RadarNet) -> RadarNet {
        match model {
            RadarNet::T5(_) => model.clone(),
            RadarNet::Decoder(_) => self.averaged(model),
        }
    }

    fn add_weights(&self, model: &RadarNet, files: &mut CheckpointFiles) -> Result<(), TrainError> {
        Ok(self.lm.add_weights(model, files)?)
    }

    fn load_weights(
        &self,
        model: RadarNet,
        checkpoint: &Checkpoint,
    ) -> Result<RadarNet, TrainError> {
        Ok(self.lm.load_weights(model, checkpoint)?)
    }

    fn validate(&mut self, model: &RadarNet) -> Result<Validation, TrainError> {
        let net = self.averaged(model);
        // Validation uses unaugmented codes, the evaluation prompt, every caption, and the first simulation.
        let plain_config = LmTrainConfig {
            drop_code: 0.0,
            replace_code: 0.0,
            feature_noise: 0.0,
            rewrite_captions: 0.0,
            ..self.config.clone()
        };
        let mut items = Vec::new();
        for (clip, record) in self.val.clips().iter().enumerate() {
            for caption in 0..record.captions.len().min(4) {
                items.push(Item {
                    clip,
                    task: Task::RadarToText,
                    variant: 0,
                    flipped: false,
                    caption,
                    prompt: 0,
                });
            }
        }
        let rng = &mut ChaCha8Rng::seed_from_u64(0);
        let (mut sum, mut n_tokens) = (0.0, 0);
        let mut contrasts = Vec::new();
        for batch in self.val.batches(items, self.config.batch.max(32), 0) {
            let mut examples = batch
                .iter()
                .map(|item| self.val.example(&self.lm.vocab, &plain_config, item, rng))
                .collect::<Result<Vec<_>, _>>()?;
            self.project(&mut examples);
            let n: usize = examples.iter().map(|e| e.target.len()).sum();
            let losses = self.losses(&net, &examples, 0.0, None)?;
            let contrast = losses.contrast.map(|c| c.into_scalar::<f32>());
            contrasts.extend(contrast.map(f64::from));
            let loss = losses.tokens.into_scalar::<f32>();
            sum += f64::from(loss) * n as f64;
            n_tokens += n;
        }
        // Without validation data the score is NaN, which is never the best score.
        let score = sum / n_tokens as f64;
        let mut values = vec![("radar_to_text_nats", score)];
        if !contrasts.is_empty() {
            let mean = contrasts.iter().sum::<f64>() / contrasts.len() as f64;
            values.push(("contrast", mean));
        }
        self.lm.net = net;
        values.extend(self.quick_score()?);
        Ok(Validation { score, values })
    }

    fn config(&self) -> serde_json::Value {
        let is_t5 = self.lm.config.t5().is_some();
        let weights = if self.average.is_some() && is_t5 {
            AVERAGE_FILE
        } else {
            MODEL_FILE
        };
        card_to_json(&self.lm.card(weights))
    }

    fn add_files(&self, files: &mut CheckpointFiles) -> Result<(), TrainError> {
        files.bytes(
            TEXT_TOKENIZER_FILE,
            self.lm.vocab.tokenizer_json()?.into_bytes(),
        );
        if let (Some(average), RadarNet::T5(_)) = (&self.average, &self.lm.net) {
            let plain = |(path, tensor): (String, HostTensor)| {
                (path.trim_start_matches("T5.").into(), tensor)
            };
            let average = average.tensors().into_iter().map(plain).collect();
            files.tensors(AVERAGE_FILE, &average)?;
        }
        Ok(())
    }

    fn state(&self) -> NamedTensors {
        let average = self.average.as_ref();
        average.map(WeightAverage::tensors).unwrap_or_default()
    }

    fn load_state(&mut self, state: NamedTensors) -> Result<(), TrainError> {
        if let Some(average) = &mut self.average {
            if !average.fits(&state) {
                return Err(TrainError::Average);
            }
            *average = WeightAverage::new(state);
        }
        Ok(())
    }
}

impl LmStage {
    /// Makes the prompts of examples those of a model that reads projected codes alone, if this is one.
    fn project(&self, examples: &mut [Example]) {
        let mark = self.lm.vocab.layout().code(0);
        for example in examples {
            self.lm.config.project(&mut example.source, mark);
        }
    }

    /// The network with the moving average of its weights, if there is one.
    fn averaged(&self, net: &RadarNet) -> RadarNet {
        match &self.average {
            Some(average) => replace_params(net.clone(), average.tensors()),
            None => net.clone(),
        }
    }

    /// Greedy captions of validation motions: mean ROUGE-L, and the number of distinct captions.
    fn quick_score(&self) -> Result<Vec<(&'static str, f64)>, TrainError> {
        let n = self.config.quick_score_clips.min(self.val.clips().len());
        if n == 0 {
            return Ok(Vec::new());
        }
        // The motions are spread over the set, because adjacent ones are often takes of the same action.
        let all = self.val.clips();
        let clips: Vec<&LmClip> = (0..n).map(|i| &all[i * all.len() / n]).collect();
        let sources = clips
            .iter()
            .map(|c| self.lm.describe_prompt(&c.variants[0]))
            .collect::<Result<Vec<_>, _>>()?;
        let generated = self.lm.generate(&sources, &GenerateOptions::default())?;
        let mut sum = 0.0;
        let mut different = std::collections::BTreeSet::new();
        for (clip, result) in clips.iter().zip(&generated) {
            let text = self.lm.vocab.text(&result.ids);
            let references: Vec<Vec<String>> =
                clip.captions.iter().map(|c| rouge_score(c)).collect();
            sum += rouge_l(&rouge_score(&text), &references);
            different.insert(text);
        }
        Ok(vec![
            ("rouge_l", sum / n as f64),
            ("different_captions", different.len() as f64 / n as f64),
        ])
    }
}
