//! Stage `motion`: trains the motion VQ-VAE, which later supervises the radar tokenizer.

use std::collections::BTreeSet;
use std::path::Path;

use burn::tensor::{Tensor, TensorData};
use radarllm_dataset::record::ClipRecord;
use radarllm_inference::checkpoint::{CheckpointFiles, HostTensor, NamedTensors};
use radarllm_nn::motion_vqvae::teacher::{MOTION_KIND, STATISTICS_FILE, standardised};
use radarllm_nn::motion_vqvae::{
    FRAMES_PER_FEATURE, MOTION_DIM, MotionFile, MotionNet, MotionTeacher, MotionVqVaeConfig,
    mirror_motion_features,
};
use radarllm_nn::tokenizer::codebook::{CodebookConfig, EmaCodebook, code_usage, nearest_codes};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

use crate::data::plan_batches;
use crate::harness::{
    self, LoopConfig, Outcome, Stage, StepInfo, StepLoss, TrainError, Validation,
};
use crate::loop_config::{check_count, check_weight};

/// Minimum standard deviation by which a feature is divided. Features with smaller ones are constants with noise.
const MIN_STD: f32 = 1e-3;
/// Joint positions in a feature vector. They have an additional loss term.
const POSITIONS: std::ops::Range<usize> = 4..67;

/// Settings of the stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotionTrainConfig {
    /// Motions per batch.
    pub batch_size: usize,
    /// Length of a training crop, frames at 20 per second. It must be a multiple of 8.
    pub crop_frames: usize,
    /// Also train on mirror images.
    pub mirror: bool,
    /// Weight of the additional loss on joint positions.
    pub position_weight: f64,
    /// Weight of the commitment loss.
    pub commit_weight: f64,
    /// Maximum number of motions used for validation.
    pub validate_motions: usize,
    /// Settings of the network.
    pub model: MotionVqVaeConfig,
    /// Settings of the codebook.
    pub codebook: CodebookConfig,
    /// Settings of the training loop.
    #[serde(rename = "loop")]
    pub run: LoopConfig,
}

impl Default for MotionTrainConfig {
    fn default() -> Self {
        let run = LoopConfig {
            learning_rate: 2e-4,
            ..LoopConfig::default()
        };
        Self {
            batch_size: 32,
            crop_frames: 64,
            mirror: true,
            position_weight: 0.5,
            commit_weight: 0.02,
            validate_motions: 200,
            model: MotionVqVaeConfig::default(),
            codebook: CodebookConfig::default(),
            run,
        }
    }
}

impl MotionTrainConfig {
    /// A teacher of the width of the paper's codes.
    pub fn paper() -> Self {
        Self {
            batch_size: 16,
            model: MotionVqVaeConfig::paper(),
            ..Self::default()
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that cannot be used.
    pub fn validate(&self) -> Result<(), TrainError> {
        self.run.validate()?;
        check_count("batch_size", self.batch_size, 4096)?;
        if self.crop_frames == 0
            || !self.crop_frames.is_multiple_of(FRAMES_PER_FEATURE)
            || self.crop_frames > 1024
        {
            let problem = format!(
                "must be a multiple of 8 in 8..=1024, found {}",
                self.crop_frames
            );
            return Err(TrainError::config("crop_frames", problem));
        }
        check_weight("position_weight", self.position_weight)?;
        check_weight("commit_weight", self.commit_weight)?;
        let model = self.model.validate();
        model.map_err(|problem| TrainError::config("model", problem))
    }
}

/// Trains the motion VQ-VAE on the motions of `train` and writes checkpoints to `out_dir`. One clip per `motion_id` is
/// used. Clips without motion features are left out.
///
/// # Errors
/// See [`TrainError`]. Also if no clip has motion features.
pub fn train(
    config: &MotionTrainConfig,
    train: &[ClipRecord],
    val: &[ClipRecord],
    out_dir: &Path,
    resume: bool,
) -> Result<Outcome<MotionNet>, TrainError> {
    config.validate()?;
    let mut stage = MotionStage::new(config.clone(), train, val)?;
    tracing::info!(
        "motion: {} training and {} validation motions; {} clips without motion features left out",
        stage.train.len(),
        stage.val.len(),
        train
            .iter()
            .filter(|c| c.motion_features.is_empty())
            .count(),
    );
    let model = harness::seeded_network(&config.run, "motion/init", |device| {
        MotionNet::new(&config.model, device)
    })?;
    let outcome = harness::run(&mut stage, model, &config.run, out_dir, resume)?;
    harness::require_codebook("motion", &stage.codebook, outcome.ending)?;
    Ok(outcome)
}

/// Loads the best (or final) network of a finished `motion` stage.
///
/// # Errors
/// If the checkpoint cannot be read.
pub fn load_teacher(checkpoint: &Path) -> Result<MotionTeacher, TrainError> {
    Ok(MotionTeacher::load(checkpoint)?)
}

struct Motion {
    id: String,
    /// `[frame][263]`.
    values: Vec<f32>,
}

struct MotionStage {
    config: MotionTrainConfig,
    train: Vec<Motion>,
    val: Vec<Motion>,
    mean: Vec<f32>,
    std: Vec<f32>,
    codebook: EmaCodebook,
    /// Codebook inputs and assigned codes since the last update.
    seen: (Vec<f32>, Vec<u32>),
}

struct Losses {
    total: Tensor<1>,
    reconstruction: f64,
    position: f64,
    commit: f64,
    inputs: Vec<f32>,
    codes: Vec<u32>,
}

impl MotionStage {
    fn new(
        config: MotionTrainConfig,
        train: &[ClipRecord],
        val: &[ClipRecord],
    ) -> Result<Self, TrainError> {
        let train = motions(train, config.mirror)?;
        let val = motions(val, false)?;
        if train.is_empty() {
            return Err(TrainError::NoData("no clip has motion features"));
        }
        let (mean, std) = mean_and_std(&train);
        let codebook = EmaCodebook::new(config.model.codebook_size, config.model.width);
        Ok(Self {
            config,
            train,
            val,
            mean,
            std,
            codebook,
            seen: Default::default(),
        })
    }

    /// `values`: `[n, frames, 263]`, standardised.
    fn losses(&self, model: &MotionNet, values: Vec<f32>, n: usize, frames: usize) -> Losses {
        let device = model.codebook.val().device();
        let motion =
            Tensor::<3>::from_data(TensorData::new(values, [n, frames, MOTION_DIM]), &device);
        let features = model.encode(motion.clone());
        let dims = features.dims();
        let inputs: Vec<f32> = features
            .clone()
            .without_autodiff()
            .into_data()
            .try_into_vec()
            .unwrap_or_default();
        let mut codes = Vec::new();
        let mut quantized = features.clone();
        let mut commit = None;
        if self.codebook.is_initialised() {
            let width = self.config.model.width;
            codes = nearest_codes(&inputs, self.codebook.codes(), width);
            let rows: Vec<f32> = codes
                .iter()
                .flat_map(|&k| &self.codebook.codes()[k as usize * width..][..width])
                .copied()
                .collect();
            let nearest = Tensor::<3>::from_data(TensorData::new(rows, dims), &device);
            commit = Some((features.clone() - nearest.clone()).square().mean());
            // Straight-through estimator: the value is that of the code, the gradient is that of the feature.
            quantized = features.clone() + (nearest - features.detach());
        }
        let predicted = model.decode(quantized);
        let d = (predicted - motion).abs();
        let small = d.clone().clamp_max(1.0);
        // Smooth L1 loss: d^2 / 2 below 1, d - 1/2 above.
        let error = small.clone().square() * 0.5 + (d - small);
        let position = error.clone().slice([0..n, 0..frames, POSITIONS]).mean();
        let reconstruction = error.mean();
        let mut total = reconstruction.clone() + position.clone() * self.config.position_weight;
        let number = |t: &Tensor<1>| f64::from(t.clone().into_scalar::<f32>());
        let mut commit_value = 0.0;
        if let Some(commit) = commit {
            commit_value = number(&commit);
            total = total + commit * self.config.commit_weight;
        }
        Losses {
            reconstruction: number(&reconstruction),
            position: number(&position),
            commit: commit_value,
            total,
            inputs,
            codes,
        }
    }
}

impl Stage for MotionStage {
    type Model = MotionNet;

    fn name(&self) -> &'static str {
        "motion"
    }

    fn plan_epoch(&self, epoch_seed: u64) -> Vec<Vec<usize>> {
        plan_batches(
            &vec![0; self.train.len()],
            self.config.batch_size,
            epoch_seed,
        )
    }

    fn ids(&self, batch: &[usize]) -> Vec<String> {
        batch.iter().map(|i| self.train[*i].id.clone()).collect()
    }

    fn loss(
        &mut self,
        model: &MotionNet,
        batch: &[usize],
        info: StepInfo,
    ) -> Result<StepLoss, TrainError> {
        let mut rng = ChaCha8Rng::seed_from_u64(info.seed);
        let crop = self.config.crop_frames;
        let mut values = Vec::with_capacity(batch.len() * crop * MOTION_DIM);
        for &i in batch {
            let motion = &self.train[i].values;
            let n_frames = motion.len() / MOTION_DIM;
            let start = rng.random_range(0..=n_frames.saturating_sub(crop));
            let end = (start + crop).min(n_frames);
            let own = &motion[start * MOTION_DIM..end * MOTION_DIM];
            values.extend(standardised(own, &self.mean, &self.std, crop));
        }
        let losses = self.losses(model, values, batch.len(), crop);
        let usage = code_usage(&losses.codes, self.config.model.codebook_size);
        let parts = vec![
            ("reconstruction", losses.reconstruction),
            ("position", losses.position),
            ("commit", losses.commit),
            ("batch_perplexity", usage.perplexity),
        ];
        self.seen.0.extend(losses.inputs);
        self.seen.1.extend(losses.codes);
        Ok(StepLoss {
            total: losses.total,
            parts,
        })
    }

    fn after_step(
        &mut self,
        mut model: MotionNet,
        info: StepInfo,
    ) -> Result<MotionNet, TrainError> {
        let (inputs, codes) = std::mem::take(&mut self.seen);
        self.codebook
            .update(&inputs, &codes, &self.config.codebook, info.seed);
        let (k, width) = (self.config.model.codebook_size, self.config.model.width);
        let data = TensorData::new(self.codebook.codes().to_vec(), [k, width]);
        model.codebook = model
            .codebook
            .map(|old| Tensor::from_data(data, &old.device()));
        Ok(model)
    }

    fn validate(&mut self, model: &MotionNet) -> Result<Validation, TrainError> {
        let (mut reconstruction, mut position, mut commit, mut weight) = (0.0, 0.0, 0.0, 0.0);
        let mut codes = Vec::new();
        for motion in self.val.iter().take(self.config.validate_motions) {
            let n_frames = motion.values.len() / MOTION_DIM;
            let padded = n_frames.div_ceil(FRAMES_PER_FEATURE) * FRAMES_PER_FEATURE;
            let values = standardised(&motion.values, &self.mean, &self.std, padded);
            let losses = self.losses(model, values, 1, padded);
            reconstruction += losses.reconstruction * padded as f64;
            position += losses.position * padded as f64;
            commit += losses.commit * padded as f64;
            weight += padded as f64;
            codes.extend(losses.codes);
        }
        let usage = code_usage(&codes, self.config.model.codebook_size);
        // Without a codebook or without motions the score is infinite: there is nothing to compare.
        let score = if self.codebook.is_initialised() && weight > 0.0 {
            (reconstruction + self.config.position_weight * position) / weight
        } else {
            f64::INFINITY
        };
        let values = vec![
            ("reconstruction", reconstruction / weight),
            ("position", position / weight),
            ("commit", commit / weight),
            ("code_usage", usage.used),
            ("perplexity", usage.perplexity),
        ];
        Ok(Validation { score, values })
    }

    fn config(&self) -> serde_json::Value {
        let c = &self.config;
        let file = MotionFile {
            kind: MOTION_KIND.into(),
            model: c.model.clone(),
            training: serde_json::json!({
                "batch_size": c.batch_size,
                "crop_frames": c.crop_frames,
                "mirror": c.mirror,
                "position_weight": c.position_weight,
                "commit_weight": c.commit_weight,
                "codebook": c.codebook,
                "train_motions": self.train.len(),
            }),
        };
        serde_json::to_value(file).unwrap_or_default()
    }

    fn add_files(&self, files: &mut CheckpointFiles) -> Result<(), TrainError> {
        let statistics = NamedTensors::from([
            ("mean".into(), HostTensor::vector(self.mean.clone())),
            ("std".into(), HostTensor::vector(self.std.clone())),
        ]);
        Ok(files.tensors(STATISTICS_FILE, &statistics)?)
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

/// One entry per motion with features; with `mirror`, also its mirror image.
fn motions(clips: &[ClipRecord], mirror: bool) -> Result<Vec<Motion>, TrainError> {
    let mut seen = BTreeSet::new();
    let mut out = Vec::new();
    for clip in clips {
        let features = &clip.motion_features;
        if features.is_empty() || !seen.insert(&clip.motion_id) {
            continue;
        }
        if !features.len().is_multiple_of(MOTION_DIM) || !features.iter().all(|v| v.is_finite()) {
            let problem = format!("motion features are not finite rows of {MOTION_DIM}");
            return Err(TrainError::clip(&clip.id, problem));
        }
        out.push(Motion {
            id: clip.motion_id.clone(),
            values: features.clone(),
        });
        if mirror {
            let mut values = features.clone();
            mirror_motion_features(&mut values);
            out.push(Motion {
                id: format!("{}/mirrored", clip.motion_id),
                values,
            });
        }
    }
    Ok(out)
}

fn mean_and_std(motions: &[Motion]) -> (Vec<f32>, Vec<f32>) {
    let mut sum = vec![0.0f64; MOTION_DIM];
    let mut squares = vec![0.0f64; MOTION_DIM];
    let mut n = 0.0f64;
    for frame in motions
        .iter()
        .flat_map(|m| m.values.chunks_exact(MOTION_DIM))
    {
        n += 1.0;
        for ((s, q), v) in sum.iter_mut().zip(&mut squares).zip(frame) {
            *s += f64::from(*v);
            *q += f64::from(*v) * f64::from(*v);
        }
    }
    let mean: Vec<f32> = sum.iter().map(|s| (s / n) as f32).collect();
    let std = sum
        .iter()
        .zip(&squares)
        .map(|(s, q)| ((q / n - (s / n).powi(2)).max(0.0).sqrt() as f32).max(MIN_STD))
        .collect();
    (mean, std)
}
