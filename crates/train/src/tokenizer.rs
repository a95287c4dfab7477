//! Stage `tokenizer`: trains the radar tokenizer (Aggregate VQ-VAE).
//!
//! Loss = reconstruction of masked anchors' points + motion guidance + caption words + captions + motion codes + spread +
//! commitment. [`TokenizerTrainConfig::paper`] gives the exact form of the paper, which has neither words, captions
//! nor motion codes.
//! Every departure from the paper is a separate field.

use std::{
    collections::{BTreeSet, HashMap},
    path::Path,
};

use burn::module::Module;
use burn::tensor::{Device, Int, Tensor, TensorData};
use radarllm_base::{
    PointFrame,
    disturb::{Pace, disturb},
    seed::derive_seed,
};
use radarllm_dataset::record::ClipRecord;
use radarllm_inference::checkpoint::{Checkpoint, CheckpointFiles, MODEL_FILE, NamedTensors};
use radarllm_inference::tokenizer::encode::{TOKENIZER_KIND, TokenizerFile};
use radarllm_inference::tokenizer::grouping::{Grouped, MaskedClip, group, group_masked};
use radarllm_inference::tokenizer::{FRAMES_PER_CODE, MAX_FRAMES, TokenizerConfig};
use radarllm_nn::lm::{RadarT5, TrainingPass};
use radarllm_nn::motion_vqvae::{MOTION_DIM, MotionTeacher, mirror_motion_features};
use radarllm_nn::params::{collect_params, load_model, load_params};
use radarllm_nn::tokenizer::batch::{ClipBatch, ClipInput};
use radarllm_nn::tokenizer::codebook::{EmaCodebook, code_usage, nearest_codes};
use radarllm_nn::tokenizer::network::TokenizerNet;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

use crate::caption_words::CaptionWords;
use crate::chamfer::chamfer;
use crate::code_captions::CodeCaptions;
use crate::data::{augment_points, plan_batches, shuffle};
use crate::harness::{self, Outcome, Stage, StepInfo, StepLoss, TrainError, Validation};
use crate::lm::loss::cross_entropy;
pub use crate::tokenizer_config::{
    CodeGradient, CodebookUpdate, GuidanceOn, Hides, Lookup, Reconstruct, TokenizerLossConfig,
    TokenizerTrainConfig,
};

/// Weights of the network that writes captions from codes, in checkpoints of this stage.
const CAPTIONER_FILE: &str = "captioner.safetensors";

/// Trains the tokenizer and writes checkpoints to `out_dir`.
///
/// `teacher` is the frozen motion VQ-VAE; `None` trains without guidance. The width of the teacher overrides
/// `model.guidance_dim`. Clips without motion features contribute to the reconstruction loss only.
///
/// # Errors
/// See [`TrainError`].
pub fn train(
    config: &TokenizerTrainConfig,
    train: &[ClipRecord],
    val: &[ClipRecord],
    teacher: Option<&MotionTeacher>,
    out_dir: &Path,
    resume: bool,
) -> Result<Outcome<TokenizerNet>, TrainError> {
    let mut config = config.clone();
    config.model.guidance_dim = match teacher {
        Some(teacher) if config.loss.guidance_weight > 0.0 => teacher.width(),
        _ => 0,
    };
    config.model.motion_codes = match teacher {
        Some(teacher) if config.loss.motion_codes_weight > 0.0 => teacher.n_codes(),
        _ => 0,
    };
    config.model.caption_words = 0;
    let mut words = None;
    if config.loss.words_weight > 0.0 {
        let captions = train.iter().map(|clip| clip.captions.as_slice());
        let counted = CaptionWords::count(captions, config.augment.flip > 0.0);
        config.model.caption_words = counted.len();
        words = Some(counted).filter(|w| !w.is_empty());
    }
    config.validate()?;
    let mut code_captions = None;
    if config.loss.captions_weight > 0.0 {
        let captions = train.iter().flat_map(|clip| &clip.captions);
        let captions = captions.map(String::as_str);
        let mirror = config.augment.flip > 0.0;
        code_captions = Some(CodeCaptions::learn(
            captions,
            mirror,
            config.model.code_dim,
        )?);
    }
    let targets = TargetKinds {
        teacher: teacher.filter(|_| config.loss.needs_teacher()),
        words,
        captions: code_captions,
    };
    let mut stage = TokenizerStage::new(config.clone(), train, val, targets)?;
    tracing::info!(
        "tokenizer: {} training clips ({} with motion guidance), {} for validation, {} caption words",
        stage.train.len(),
        stage
            .train
            .iter()
            .filter(|c| !(c.targets.guide.is_empty() && c.targets.motion_codes.is_empty()))
            .count(),
        stage.val.len(),
        config.model.caption_words,
    );
    let seed = derive_seed(config.run.seed, "tokenizer/captioner");
    let model = harness::seeded_network(&config.run, "tokenizer/init", |device| {
        let captions = stage.captions.as_ref();
        Networks {
            tokenizer: TokenizerNet::new(&config.model, device),
            captioner: captions.and_then(|captions| captions.network(seed, device)),
        }
    })?;
    let outcome = harness::run(&mut stage, model, &config.run, out_dir, resume)?;
    harness::require_codebook("tokenizer", &stage.codebook, outcome.ending)?;
    Ok(outcome.map(|networks| networks.tokenizer))
}

/// What this stage trains.
#[derive(Module, Debug)]
struct Networks {
    tokenizer: TokenizerNet,
    /// Writes captions from codes; none if [`TokenizerLossConfig::captions_weight`] is 0.
    captioner: Option<RadarT5>,
}

/// What the targets of clips are made with.
struct TargetKinds<'t> {
    teacher: Option<&'t MotionTeacher>,
    words: Option<CaptionWords>,
    captions: Option<CodeCaptions>,
}

struct Clip<'a> {
    id: &'a str,
    frames: &'a [PointFrame],
    radar_height_m: f32,
    targets: Supervision,
    /// Targets of the mirrored motion; empty if clips are not mirrored.
    mirrored: Supervision,
}

/// Targets that the codes of a clip are trained to predict.
#[derive(Clone, Default)]
struct Supervision {
    /// Teacher features `[code][width]`, standardised; empty if the motion is unknown or is not used for guidance. They
    /// may cover fewer codes than the clip has.
    guide: Vec<f32>,
    /// Codes of the teacher, as many as there are features; empty if no codes are predicted.
    motion_codes: Vec<u32>,
    /// Target of every caption word; empty if no words are predicted.
    words: Vec<f32>,
    /// Tokens of the captions; empty if none are written. The first one is the target.
    captions: Vec<Vec<u32>>,
}

impl Supervision {
    /// Supervision without the targets of the first codes.
    fn after_codes(&self, first: usize, width: usize) -> Self {
        Self {
            guide: self.guide.get(first * width..).unwrap_or_default().to_vec(),
            motion_codes: self.motion_codes.get(first..).unwrap_or_default().to_vec(),
            words: self.words.clone(),
            captions: self.captions.clone(),
        }
    }

    /// Tokens of the caption to write; none without captions.
    fn caption(&self) -> &[u32] {
        self.captions.first().map_or(&[], Vec::as_slice)
    }
}

/// A clip as it is drawn for a batch, before its points are grouped.
struct Draft<'a> {
    clip: &'a Clip<'a>,
    frames: Vec<PointFrame>,
    targets: Supervision,
    /// Per anchor: whether its trajectory is masked.
    masked: Vec<bool>,
    /// Whether the mask divides the points.
    hides_points: bool,
}

/// A clip in a batch.
struct Sample {
    grouped: Grouped,
    targets: Supervision,
    masked: Vec<bool>,
    /// What the mask leaves and hides, if it hides points.
    parts: Option<MaskedClip>,
}

impl Sample {
    fn input(&self) -> ClipInput<'_> {
        ClipInput {
            clip: &self.grouped,
            masked: &self.masked,
            parts: self.parts.as_ref(),
        }
    }

    fn unmask(&mut self) {
        self.masked.fill(false);
        self.parts = None;
    }
}

struct TokenizerStage<'a> {
    config: TokenizerTrainConfig,
    train: Vec<Clip<'a>>,
    val: Vec<Clip<'a>>,
    /// Names of the radars of the training clips.
    radars: BTreeSet<&'a str>,
    words: Option<CaptionWords>,
    captions: Option<CodeCaptions>,
    codebook: EmaCodebook,
    /// Codebook inputs and assigned codes since the last update.
    seen: (Vec<f32>, Vec<u32>),
}

struct Losses {
    total: Tensor<1>,
    parts: Vec<(&'static str, f64)>,
    inputs: Vec<f32>,
    codes: Vec<u32>,
}

impl<'a> TokenizerStage<'a> {
    fn new(
        config: TokenizerTrainConfig,
        train: &'a [ClipRecord],
        val: &'a [ClipRecord],
        targets: TargetKinds,
    ) -> Result<Self, TrainError> {
        let flips = config.augment.flip > 0.0;
        let radars = train.iter().map(|c| c.radar.as_str()).collect();
        let mut train = clips(&config.model, train, &targets, flips)?;
        let mut val = clips(&config.model, val, &targets, false)?;
        if train.is_empty() {
            return Err(TrainError::NoData("no training clip"));
        }
        standardise_guides(&mut train, &mut val, config.model.guidance_dim);
        val.truncate(config.validate_clips);
        let (n_codes, dim) = (config.model.codebook_size, config.model.code_dim);
        let codebook = match config.loss.lookup {
            Lookup::Distance => EmaCodebook::new(n_codes, dim),
            Lookup::Cosine => EmaCodebook::of_unit_length(n_codes, dim),
        };
        Ok(Self {
            config,
            train,
            val,
            radars,
            words: targets.words,
            captions: targets.captions,
            codebook,
            seen: Default::default(),
        })
    }

    fn draw<'s>(&self, clip: &'s Clip, rng: &mut ChaCha8Rng) -> Draft<'s> {
        // Long clips are cropped at code boundaries, so that radar and motion remain aligned.
        let spare = clip.frames.len().saturating_sub(MAX_FRAMES) / FRAMES_PER_CODE;
        let first_code = rng.random_range(0..=spare);
        let start = first_code * FRAMES_PER_CODE;
        let end = (start + MAX_FRAMES).min(clip.frames.len());
        let mut frames = clip.frames[start..end].to_vec();
        let flip = rng.random::<f64>() < self.config.augment.flip;
        if flip {
            frames.iter_mut().for_each(PointFrame::mirror);
        }
        if self.config.augment.disturb > 0.0 && rng.random::<f64>() < self.config.augment.disturb {
            let rate_hz = f64::from(radarllm_inference::FRAME_RATE_HZ);
            frames = disturb(&frames, rate_hz, Pace::Kept, rng.random());
        }
        augment_points(&mut frames, &self.config.augment, rng);
        let targets = if flip { &clip.mirrored } else { &clip.targets };
        let mut targets = targets.after_codes(first_code, self.config.model.guidance_dim);
        if targets.captions.len() > 1 {
            let chosen = rng.random_range(0..targets.captions.len());
            targets.captions.swap(0, chosen);
        }
        self.masked_draft(clip, frames, targets, rng)
    }

    /// Draws a mask.
    fn masked_draft<'s>(
        &self,
        clip: &'s Clip,
        frames: Vec<PointFrame>,
        targets: Supervision,
        rng: &mut ChaCha8Rng,
    ) -> Draft<'s> {
        let n_anchors = self.config.model.n_anchors();
        let mut masked = vec![false; n_anchors];
        let n_masked = (self.config.loss.mask_ratio * n_anchors as f64).floor() as usize;
        let has_mask = rng.random::<f64>() < self.config.loss.masked_clips;
        if has_mask {
            masked[..n_masked].fill(true);
            shuffle(&mut masked, rng);
        }
        Draft {
            clip,
            frames,
            targets,
            hides_points: has_mask && n_masked > 0 && self.config.loss.hides != Hides::Tubes,
            masked,
        }
    }

    /// Groups the points of clips, one by one on all cores: at the paper's size this takes longer than a GPU takes for the
    /// rest of an update.
    fn samples(&self, drafts: Vec<Draft>) -> Result<Vec<Sample>, TrainError> {
        let grouping = &self.config.model.grouping;
        let sample = |draft: Draft| {
            let (frames, height_m) = (&draft.frames, draft.clip.radar_height_m);
            let fail = |e| TrainError::clip(draft.clip.id, e);
            let hides = self.config.loss.hides;
            let parts = draft
                .hides_points
                .then(|| group_masked(frames, height_m, grouping, &draft.masked, hides));
            Ok(Sample {
                grouped: group(frames, height_m, grouping).map_err(fail)?,
                targets: draft.targets,
                parts: parts.transpose().map_err(fail)?,
                masked: draft.masked,
            })
        };
        drafts.into_par_iter().map(sample).collect()
    }

    fn losses(
        &self,
        networks: &Networks,
        samples: &[Sample],
        rng: &mut ChaCha8Rng,
        training: bool,
    ) -> Losses {
        let model = &networks.tokenizer;
        let inputs: Vec<ClipInput> = samples.iter().map(Sample::input).collect();
        let batch = ClipBatch::new(&self.config.model, &inputs);
        let device = model.codebook.val().device();
        let output = model.forward(&batch);
        let number = |t: &Tensor<1>| f64::from(t.clone().into_scalar::<f32>());
        let loss = &self.config.loss;
        let mut parts = Vec::new();

        let rows = batch.code_rows();
        let mut z = output
            .features
            .select(0, indices(rows.iter().map(|r| *r as i64), &device));
        // A zero term keeps `total` on the autodiff graph even if all other terms are disabled.
        let mut total = z.clone().mean() * 0.0;
        if loss.lookup == Lookup::Cosine {
            z = unit_rows(z);
        }
        if loss.spread_weight > 0.0 {
            let spread = spread(z.clone());
            parts.push(("spread", number(&spread)));
            total = total + spread * loss.spread_weight;
        }
        let inputs: Vec<f32> = z
            .clone()
            .without_autodiff()
            .into_data()
            .try_into_vec()
            .unwrap_or_default();
        let mut codes = Vec::new();
        let mut quantized = None;
        if self.codebook.is_initialised() {
            let nearest = self.nearest(model, &inputs, &z, &device, &mut codes);
            let commit = (z.clone() - nearest.clone().detach()).square().mean();
            parts.push(("commit", number(&commit)));
            total = total + commit * loss.commit_weight;
            if loss.codebook_update == CodebookUpdate::Gradient {
                let book = (nearest.clone() - z.clone().detach()).square().mean();
                parts.push(("codebook", number(&book)));
                total = total + book * loss.commit_weight;
            }
            if self.config.model.quantize {
                quantized = Some(match loss.code_gradient {
                    // Straight-through estimator: the value is that of the code, the gradient is that of the feature.
                    CodeGradient::Copy => z.clone() + (nearest - z.clone()).detach(),
                    CodeGradient::Rotate => rotated(z.clone(), nearest),
                });
            }
        }
        if let (Some(captions), Some(net), Some(codes)) =
            (&self.captions, &networks.captioner, &quantized)
        {
            let n_codes: Vec<usize> = samples.iter().map(|s| s.grouped.n_codes).collect();
            let targets: Vec<&[u32]> = samples.iter().map(|s| s.targets.caption()).collect();
            let mut pass = training.then(|| TrainingPass::new(rng.random(), Default::default()));
            let written = captions.loss(net, codes.clone(), &n_codes, &targets, pass.as_mut());
            if let Some(written) = written {
                parts.push(("captions", number(&written)));
                total = total + written * loss.captions_weight;
            }
        }
        // Supervision applies to the features before quantization or, with half the weight each, to the features and
        // the codes.
        let predictors =
            match quantized.filter(|_| loss.guidance_on == GuidanceOn::FeaturesAndCodes) {
                Some(quantized) => vec![z, quantized],
                None => vec![z],
            };
        let [words, sides] = self.word_losses(model, &predictors, samples, &device);
        let terms = [
            (
                ["guidance", "guidance_codes"],
                loss.guidance_weight,
                self.guidance(model, &predictors, samples, &device),
            ),
            (["words", "words_codes"], loss.words_weight, words),
            (["sides", "sides_codes"], loss.sides_weight, sides),
            (
                ["motion_code", "motion_code_codes"],
                loss.motion_codes_weight,
                self.motion_code_loss(model, &predictors, samples, &device),
            ),
        ];
        for (names, weight, values) in terms {
            let share = 1.0 / values.len().max(1) as f64;
            for (name, value) in names.into_iter().zip(values) {
                parts.push((name, number(&value)));
                total = total + value * (weight * share);
            }
        }
        if let Some(rec) = self.reconstruction(model, output.cells, &batch, samples, rng, &device) {
            parts.push(("reconstruction", number(&rec)));
            total = total + rec * loss.reconstruction_weight;
        }
        Losses {
            total,
            parts,
            inputs,
            codes,
        }
    }

    /// Code vectors of the inputs. They are on the autodiff graph if the codebook is trained by gradient.
    fn nearest(
        &self,
        model: &TokenizerNet,
        inputs: &[f32],
        z: &Tensor<2>,
        device: &Device,
        codes: &mut Vec<u32>,
    ) -> Tensor<2> {
        let dim = self.config.model.code_dim;
        match self.config.loss.codebook_update {
            CodebookUpdate::MovingAverage => {
                *codes = nearest_codes(inputs, self.codebook.codes(), dim);
                let rows: Vec<f32> = codes
                    .iter()
                    .flat_map(|&k| &self.codebook.codes()[k as usize * dim..][..dim])
                    .copied()
                    .collect();
                Tensor::from_data(TensorData::new(rows, z.dims()), device)
            }
            CodebookUpdate::Gradient => {
                let book = model.codebook.val();
                let values: Vec<f32> = book
                    .clone()
                    .without_autodiff()
                    .into_data()
                    .try_into_vec()
                    .unwrap_or_default();
                *codes = nearest_codes(inputs, &values, dim);
                book.select(0, indices(codes.iter().map(|k| i64::from(*k)), device))
            }
        }
    }

    /// Mean squared error to the teacher's features for each of `predictors`; empty without a teacher.
    fn guidance(
        &self,
        model: &TokenizerNet,
        predictors: &[Tensor<2>],
        samples: &[Sample],
        device: &Device,
    ) -> Vec<Tensor<1>> {
        let width = self.config.model.guidance_dim;
        if width == 0 {
            return Vec::new();
        }
        let supervised =
            supervised_features(predictors, samples, |t| t.guide.len() / width, device);
        if supervised.is_empty() {
            return Vec::new();
        }
        let targets: Vec<f32> = samples
            .iter()
            .flat_map(|s| s.targets.guide.iter().take(s.grouped.n_codes * width))
            .copied()
            .collect();
        let shape = [targets.len() / width, width];
        let target = Tensor::<2>::from_data(TensorData::new(targets, shape), device);
        supervised
            .into_iter()
            .filter_map(|features| model.guide(features))
            .map(|predicted| (predicted - target.clone()).square().mean())
            .collect()
    }

    /// Cross-entropy per clip of the caption words, and of those that name a side, for each of `predictors`; empty without
    /// such words.
    fn word_losses(
        &self,
        model: &TokenizerNet,
        predictors: &[Tensor<2>],
        samples: &[Sample],
        device: &Device,
    ) -> [Vec<Tensor<1>>; 2] {
        let Some(words) = &self.words else {
            return Default::default();
        };
        let n_codes: Vec<usize> = samples.iter().map(|s| s.grouped.n_codes).collect();
        let targets: Vec<f32> = samples
            .iter()
            .flat_map(|s| s.targets.words.clone())
            .collect();
        let losses: Vec<Tensor<2>> = predictors
            .iter()
            .filter_map(|features| model.word_logits(features.clone()))
            .map(|logits| words.losses(logits, &n_codes, targets.clone(), device))
            .collect();
        let per_clip = |losses: Tensor<2>| losses.sum() / samples.len().max(1) as f64;
        let sides = words.sides();
        let of_sides = losses.iter().filter(|_| !sides.is_empty()).map(|losses| {
            let rows = indices(sides.iter().map(|row| *row as i64), device);
            per_clip(losses.clone().select(1, rows))
        });
        let of_sides = of_sides.collect();
        [losses.into_iter().map(per_clip).collect(), of_sides]
    }

    /// Cross-entropy of the teacher's codes for each of `predictors`; empty if no code is known.
    fn motion_code_loss(
        &self,
        model: &TokenizerNet,
        predictors: &[Tensor<2>],
        samples: &[Sample],
        device: &Device,
    ) -> Vec<Tensor<1>> {
        let supervised = supervised_features(predictors, samples, |t| t.motion_codes.len(), device);
        let targets: Vec<u32> = samples
            .iter()
            .flat_map(|s| s.targets.motion_codes.iter().take(s.grouped.n_codes))
            .copied()
            .collect();
        let weights = vec![1.0; targets.len()];
        supervised
            .into_iter()
            .filter_map(|features| model.motion_code_logits(features))
            .map(|logits| cross_entropy(logits, &targets, &weights, 0.0))
            .collect()
    }

    fn reconstruction(
        &self,
        model: &TokenizerNet,
        cells: Tensor<2>,
        batch: &ClipBatch,
        samples: &[Sample],
        rng: &mut ChaCha8Rng,
        device: &Device,
    ) -> Option<Tensor<1>> {
        let loss = &self.config.loss;
        let mut chosen: Vec<(usize, usize, usize)> = match loss.reconstruct {
            Reconstruct::Nothing => Vec::new(),
            Reconstruct::Masked => batch
                .hidden
                .iter()
                .map(|h| (h.cell, h.clip, h.tube))
                .collect(),
            Reconstruct::All => samples
                .iter()
                .enumerate()
                .flat_map(|(clip, sample)| {
                    sample
                        .grouped
                        .tubes
                        .iter()
                        .enumerate()
                        .map(move |(i, tube)| {
                            let step = clip * batch.n_steps + tube.step as usize;
                            (step * batch.n_anchors + tube.anchor as usize, clip, i)
                        })
                })
                .collect(),
        };
        if chosen.is_empty() || loss.reconstruction_weight == 0.0 {
            return None;
        }
        shuffle(&mut chosen, rng);
        chosen.truncate(loss.tubes_per_clip * samples.len());
        let dim = self.config.model.reconstruction_dim();
        let max = loss.targets_per_tube;
        let mut targets = vec![0.0f32; chosen.len() * max * dim];
        let mut valid = vec![0.0f32; chosen.len() * max];
        for (row, (_, clip, tube)) in chosen.iter().enumerate() {
            let grouped = match loss.reconstruct {
                Reconstruct::Masked => samples[*clip].input().hidden(),
                Reconstruct::All | Reconstruct::Nothing => &samples[*clip].grouped,
            };
            let tube = &grouped.tubes[*tube];
            let mut points: Vec<usize> = (tube.start as usize..tube.end as usize).collect();
            if points.len() > max {
                shuffle(&mut points, rng);
            }
            for (slot, point) in points.iter().take(max).enumerate() {
                let n = &grouped.neighbours[*point];
                // Position in units of the radius; velocity in the scale of the network.
                let values = [n[0], n[1], n[2], n[5]];
                let at = (row * max + slot) * dim;
                targets[at..at + dim].copy_from_slice(&values[..dim]);
                valid[row * max + slot] = 1.0;
            }
        }
        let n = chosen.len();
        let rows = indices(chosen.iter().map(|c| c.0 as i64), device);
        let points = self.config.model.reconstruction_points;
        let predicted = model.reconstruct(cells.select(0, rows), points);
        let targets = Tensor::<3>::from_data(TensorData::new(targets, [n, max, dim]), device);
        let valid = Tensor::<2>::from_data(TensorData::new(valid, [n, max]), device);
        Some(chamfer(predicted, targets, valid, loss.chamfer))
    }
}

impl Stage for TokenizerStage<'_> {
    type Model = Networks;

    fn name(&self) -> &'static str {
        "tokenizer"
    }

    fn plan_epoch(&self, epoch_seed: u64) -> Vec<Vec<usize>> {
        let lengths: Vec<usize> = self
            .train
            .iter()
            .map(|c| c.frames.len().min(MAX_FRAMES))
            .collect();
        plan_batches(&lengths, self.config.batch_size, epoch_seed)
    }

    fn ids(&self, batch: &[usize]) -> Vec<String> {
        batch
            .iter()
            .map(|i| self.train[*i].id.to_string())
            .collect()
    }

    fn loss(
        &mut self,
        model: &Networks,
        batch: &[usize],
        info: StepInfo,
    ) -> Result<StepLoss, TrainError> {
        let mut rng = ChaCha8Rng::seed_from_u64(info.seed);
        let clips = batch.iter().map(|i| &self.train[*i]);
        let drafts = clips.map(|clip| self.draw(clip, &mut rng)).collect();
        let samples = self.samples(drafts)?;
        let mut losses = self.losses(model, &samples, &mut rng, true);
        let usage = code_usage(&losses.codes, self.config.model.codebook_size);
        losses.parts.push(("batch_perplexity", usage.perplexity));
        self.seen.0.extend(losses.inputs);
        self.seen.1.extend(losses.codes);
        Ok(StepLoss {
            total: losses.total,
            parts: losses.parts,
        })
    }

    fn after_step(&mut self, mut model: Networks, info: StepInfo) -> Result<Networks, TrainError> {
        let (inputs, codes) = std::mem::take(&mut self.seen);
        let gradient = self.config.loss.codebook_update == CodebookUpdate::Gradient;
        let was_initialised = self.codebook.is_initialised();
        if gradient && was_initialised {
            return Ok(model);
        }
        self.codebook
            .update(&inputs, &codes, &self.config.codebook, info.seed);
        let (k, dim) = (self.config.model.codebook_size, self.config.model.code_dim);
        let data = TensorData::new(self.codebook.codes().to_vec(), [k, dim]);
        model.tokenizer.codebook = model.tokenizer.codebook.map(|old| {
            let tensor = Tensor::from_data(data, &old.device());
            if gradient {
                tensor.require_grad()
            } else {
                tensor
            }
        });
        Ok(model)
    }

    fn validate(&mut self, model: &Networks) -> Result<Validation, TrainError> {
        // The masks and targets are the same in every validation, so that scores are comparable.
        let mut rng = ChaCha8Rng::seed_from_u64(self.config.run.seed);
        let mut codes = Vec::new();
        let mut sums: Vec<(&'static str, f64, f64)> = Vec::new();
        let mut order: Vec<&Clip> = self.val.iter().collect();
        order.sort_by_key(|c| c.frames.len());
        for chunk in order.chunks(self.config.batch_size) {
            let drafts = chunk.iter().map(|clip| {
                let frames = clip.frames[..clip.frames.len().min(MAX_FRAMES)].to_vec();
                self.masked_draft(clip, frames, clip.targets.clone(), &mut rng)
            });
            let mut samples = self.samples(drafts.collect())?;
            let n = samples.len() as f64;
            let masked = self.losses(model, &samples, &mut rng, false);
            let mut parts = masked.parts;
            // Codes and guidance as in inference, without masks.
            samples.iter_mut().for_each(Sample::unmask);
            let plain = self.losses(model, &samples, &mut rng, false);
            parts.retain(|(name, _)| *name == "reconstruction");
            parts.extend(
                plain
                    .parts
                    .into_iter()
                    .filter(|(name, _)| *name != "reconstruction"),
            );
            codes.extend(plain.codes);
            for (name, value) in parts {
                match sums.iter_mut().find(|s| s.0 == name) {
                    Some(sum) => {
                        sum.1 += value * n;
                        sum.2 += n;
                    }
                    None => sums.push((name, value * n, n)),
                }
            }
        }
        let mut values: Vec<(&'static str, f64)> = sums.iter().map(|s| (s.0, s.1 / s.2)).collect();
        let value = |name: &str| values.iter().find(|v| v.0 == name).map_or(0.0, |v| v.1);
        let loss = &self.config.loss;
        let codes_or_features = |codes: &str, features: &str| {
            let of_codes = values.iter().find(|v| v.0 == codes);
            of_codes.map_or_else(|| value(features), |v| v.1)
        };
        // The score is dominated by how well the codes predict the motion. Reconstruction breaks ties, and is decisive
        // without a teacher. Before the codebook is initialised, the score is infinite: there is no network to keep.
        let score = if self.codebook.is_initialised() && !self.val.is_empty() {
            loss.guidance_weight * codes_or_features("guidance_codes", "guidance")
                + loss.words_weight * codes_or_features("words_codes", "words")
                + loss.sides_weight * codes_or_features("sides_codes", "sides")
                + loss.motion_codes_weight * codes_or_features("motion_code_codes", "motion_code")
                + loss.captions_weight * value("captions")
                + 0.1 * loss.reconstruction_weight * value("reconstruction")
                + loss.commit_weight * value("commit")
        } else {
            f64::INFINITY
        };
        let usage = code_usage(&codes, self.config.model.codebook_size);
        values.push(("code_usage", usage.used));
        values.push(("perplexity", usage.perplexity));
        Ok(Validation { score, values })
    }

    fn config(&self) -> serde_json::Value {
        let c = &self.config;
        let file = TokenizerFile {
            kind: TOKENIZER_KIND.into(),
            model: c.model.clone(),
            training: serde_json::json!({
                "batch_size": c.batch_size,
                "loss": c.loss,
                "codebook": c.codebook,
                "augment": c.augment,
                "train_clips": self.train.len(),
                "radars": self.radars,
            }),
        };
        serde_json::to_value(file).unwrap_or_default()
    }

    // Inference reads the tokenizer; the network that writes captions is in a file of its own.
    fn add_weights(&self, model: &Networks, files: &mut CheckpointFiles) -> Result<(), TrainError> {
        files.tensors(MODEL_FILE, &collect_params(&model.tokenizer))?;
        if let Some(captioner) = &model.captioner {
            files.tensors(CAPTIONER_FILE, &collect_params(captioner))?;
        }
        Ok(())
    }

    fn load_weights(
        &self,
        model: Networks,
        checkpoint: &Checkpoint,
    ) -> Result<Networks, TrainError> {
        let file = checkpoint.dir().join(CAPTIONER_FILE);
        let captioner = model
            .captioner
            .map(|net| load_params(net, checkpoint.tensors(CAPTIONER_FILE)?, &file));
        Ok(Networks {
            tokenizer: load_model(checkpoint, model.tokenizer)?,
            captioner: captioner.transpose()?,
        })
    }

    fn state(&self) -> NamedTensors {
        self.codebook.state()
    }

    fn load_state(&mut self, state: NamedTensors) -> Result<(), TrainError> {
        self.codebook
            .load_state(state)
            .map_err(|name| TrainError::StageState { name })
    }
}

/// For each of `predictors`, the rows of the codes that have targets: the first `n_targets` of each clip, among the
/// codes of all clips. Empty if no code has a target.
fn supervised_features(
    predictors: &[Tensor<2>],
    samples: &[Sample],
    n_targets: impl Fn(&Supervision) -> usize,
    device: &Device,
) -> Vec<Tensor<2>> {
    let mut first = 0;
    let mut rows = Vec::new();
    for sample in samples {
        let n_codes = sample.grouped.n_codes;
        rows.extend((first..first + n_targets(&sample.targets).min(n_codes)).map(|row| row as i64));
        first += n_codes;
    }
    if rows.is_empty() {
        return Vec::new();
    }
    let rows = indices(rows.into_iter(), device);
    predictors
        .iter()
        .map(|features| features.clone().select(0, rows.clone()))
        .collect()
}

/// Rows of length 1; rows of zeros stay as they are.
fn unit_rows(rows: Tensor<2>) -> Tensor<2> {
    let length = (rows.clone().square().sum_dim(1) + 1e-12).sqrt();
    rows / length
}

/// Logarithm of the mean of exp(-2 d^2) over all pairs of rows, where d is their distance: low if unit vectors are spread
/// over the sphere.
fn spread(rows: Tensor<2>) -> Tensor<1> {
    let n = rows.dims()[0] as f64;
    // The distance of unit vectors: d^2 = 2 - 2 cos.
    let cosines = rows.clone().matmul(rows.transpose());
    // Every row is at distance 0 from itself.
    let pairs = ((cosines - 1.0) * 4.0).exp().sum() - n;
    (pairs / (n * (n - 1.0)).max(1.0) + 1e-6).log()
}

/// Codes as a rotation and scaling of their features. Rotation and scale are constants on the autodiff graph, so that a
/// gradient keeps its angle to the code when it reaches the feature.
fn rotated(features: Tensor<2>, codes: Tensor<2>) -> Tensor<2> {
    let length = |rows: &Tensor<2>| (rows.clone().square().sum_dim(1) + 1e-12).sqrt();
    let from = features.clone().detach();
    let codes = codes.detach();
    let scale = length(&codes) / length(&from);
    let (from, to) = (unit_rows(from), unit_rows(codes));
    // The product of two reflections: along `between`, and along `to`.
    let between = unit_rows(from.clone() + to.clone());
    let along = |axis: &Tensor<2>| (features.clone() * axis.clone()).sum_dim(1);
    let turned =
        features.clone() - between.clone() * along(&between) * 2.0 + to * along(&from) * 2.0;
    turned * scale
}

pub(crate) fn indices(rows: impl Iterator<Item = i64>, device: &Device) -> Tensor<1, Int> {
    let rows: Vec<i64> = rows.collect();
    let n = rows.len();
    Tensor::from_data(TensorData::new(rows, [n]), device)
}

fn clips<'a>(
    model: &TokenizerConfig,
    records: &'a [ClipRecord],
    kinds: &TargetKinds,
    mirror: bool,
) -> Result<Vec<Clip<'a>>, TrainError> {
    let mut out = Vec::new();
    // Variants of a motion share their targets.
    let mut known: HashMap<&str, [Supervision; 2]> = HashMap::new();
    for record in records.iter().filter(|r| !r.frames.is_empty()) {
        let [targets, mirrored] = match known.get(record.motion_id.as_str()) {
            Some(both) => both.clone(),
            None => {
                let plain = targets_of(model, record, kinds, false)?;
                let mirrored = match mirror {
                    true => targets_of(model, record, kinds, true)?,
                    false => Supervision::default(),
                };
                let both = [plain, mirrored];
                known.insert(&record.motion_id, both.clone());
                both
            }
        };
        out.push(Clip {
            id: &record.id,
            frames: &record.frames,
            radar_height_m: record.radar_height_m,
            targets,
            mirrored,
        });
    }
    Ok(out)
}

/// Targets of a clip, or of its mirror image.
fn targets_of(
    model: &TokenizerConfig,
    record: &ClipRecord,
    kinds: &TargetKinds,
    mirrored: bool,
) -> Result<Supervision, TrainError> {
    let words = kinds.words.as_ref();
    let mut targets = Supervision {
        words: words.map_or_else(Vec::new, |w| w.targets(&record.captions, mirrored)),
        ..Supervision::default()
    };
    if let Some(captions) = &kinds.captions {
        let ids = |caption: &String| captions.target(caption, mirrored);
        targets.captions = record.captions.iter().map(ids).collect::<Result<_, _>>()?;
    }
    let teacher = kinds.teacher;
    let Some(teacher) = teacher.filter(|_| record.motion_features.len() >= MOTION_DIM) else {
        return Ok(targets);
    };
    let mut motion = record.motion_features.clone();
    if mirrored {
        mirror_motion_features(&mut motion);
    }
    let features = teacher
        .features(&motion)
        .map_err(|e| TrainError::clip(&record.id, e))?;
    if model.motion_codes > 0 {
        targets.motion_codes = teacher.codes(&features);
    }
    if model.guidance_dim > 0 {
        targets.guide = features;
    }
    Ok(targets)
}

/// Standardises the teacher's channels to mean 0 and standard deviation 1 over the training clips.
fn standardise_guides<'a>(train: &mut [Clip<'a>], val: &mut [Clip<'a>], width: usize) {
    if width == 0 {
        return;
    }
    let (mut n, mut sum, mut squares) = (0.0f64, vec![0.0f64; width], vec![0.0f64; width]);
    for row in train
        .iter()
        .flat_map(|c| c.targets.guide.chunks_exact(width))
    {
        n += 1.0;
        for ((s, q), v) in sum.iter_mut().zip(&mut squares).zip(row) {
            *s += f64::from(*v);
            *q += f64::from(*v) * f64::from(*v);
        }
    }
    let n = n.max(1.0);
    let scale: Vec<(f32, f32)> = sum
        .iter()
        .zip(&squares)
        .map(|(s, q)| {
            let mean = s / n;
            // A constant channel remains zero instead of becoming amplified noise.
            let deviation = (q / n - mean * mean).max(0.0).sqrt().max(1e-4);
            (mean as f32, (1.0 / deviation) as f32)
        })
        .collect();
    for clip in train.iter_mut().chain(val) {
        for row in [&mut clip.targets.guide, &mut clip.mirrored.guide] {
            for values in row.chunks_exact_mut(width) {
                for (v, (mean, inverse)) in values.iter_mut().zip(&scale) {
                    *v = ((*v - mean) * inverse).clamp(-8.0, 8.0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(values: &[[f32; 3]], device: &Device) -> Tensor<2> {
        let data = TensorData::new(values.as_flattened().to_vec(), [values.len(), 3]);
        Tensor::from_data(data, device)
    }

    fn values(tensor: Tensor<2>) -> Vec<f32> {
        tensor
            .without_autodiff()
            .into_data()
            .try_into_vec()
            .unwrap()
    }

    /// The value is that of the code. A gradient keeps its length, times the ratio of the lengths, and its angle to the code
    /// becomes its angle to the feature.
    #[test]
    fn codes_are_rotated_features_and_gradients_turn_with_them() {
        let device = Device::flex().autodiff();
        let features = rows(&[[0.3, -0.4, 1.2], [2.0, 0.0, 0.1]], &device).require_grad();
        let codes = rows(&[[1.0, 0.5, 0.2], [0.0, 0.6, 0.8]], &device);
        let gradients = rows(&[[0.2, 0.7, -0.4], [1.0, 0.0, 0.0]], &device);
        let turned = rotated(features.clone(), codes.clone());
        for (found, expected) in values(turned.clone()).iter().zip(values(codes.clone())) {
            assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        }
        let loss = (turned * gradients.clone()).sum();
        let reached = features.grad(&loss.backward()).unwrap();
        let (reached, given) = (values(reached), values(gradients));
        let (features, codes) = (values(features), values(codes));
        for i in 0..2 {
            let row = |all: &[f32]| [all[3 * i], all[3 * i + 1], all[3 * i + 2]];
            let dot = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
            let length = |a: [f32; 3]| dot(a, a).sqrt();
            let [feature, code, given, reached] =
                [&features, &codes, &given, &reached].map(|all| row(all));
            let ratio = length(code) / length(feature);
            assert!((length(reached) - ratio * length(given)).abs() < 1e-4);
            let cosine = |a, b| dot(a, b) / length(a) / length(b);
            assert!((cosine(reached, feature) - cosine(given, code)).abs() < 1e-4);
        }
    }

    #[test]
    fn features_that_are_spread_cost_less() {
        let device = Device::flex();
        let cost = |rows: Tensor<2>| spread(rows).into_scalar::<f32>();
        let apart = rows(&[[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], &device);
        // exp(-2 d^2) of the only pair, at distance 2.
        assert!((cost(apart) - (f64::exp(-8.0) + 1e-6).ln() as f32).abs() < 1e-3);
        let together = rows(&[[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], &device);
        assert!(cost(together).abs() < 1e-3);
    }
}
