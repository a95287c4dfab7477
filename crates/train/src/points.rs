//! Stage `points`: trains the decoder of radar codes, which generation needs.
//!
//! The tokenizer is frozen: its codes of the training clips enter, the points of the same clips are the targets. The loss
//! is the symmetric Chamfer distance between the points of each frame, plus the squared error of the scaled logarithm of
//! their number.

use std::path::Path;

use burn::tensor::{Int, Tensor, TensorData};
use radarllm_base::{PointFrame, stats::median_upper};
use radarllm_dataset::record::ClipRecord;
use radarllm_inference::tokenizer::points::{
    POINT_DIM, POINTS_KIND, PointsConfig, PointsFile, scaled_count, scaled_point,
};
use radarllm_inference::tokenizer::{FRAMES_PER_CODE, MAX_FRAMES, RadarTokenizer};
use radarllm_nn::tokenizer::points::{PointNet, window_rows};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

use crate::chamfer::{ChamferSide, chamfer};
use crate::data::{plan_batches, shuffle};
use crate::harness::{
    self, LoopConfig, Outcome, Stage, StepInfo, StepLoss, TrainError, Validation,
};
use crate::loop_config::{check_count, check_weight};

/// Settings of the stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PointsTrainConfig {
    /// Clips per batch.
    pub batch_size: usize,
    /// Codes of a clip in a batch, drawn at random.
    pub codes_per_clip: usize,
    /// Maximum number of target points per frame, drawn at random.
    pub targets_per_frame: usize,
    /// Weight of the loss on the number of points.
    pub count_weight: f64,
    /// Maximum number of clips used for validation.
    pub validate_clips: usize,
    /// Settings of the network.
    pub model: PointsConfig,
    /// Settings of the training loop.
    #[serde(rename = "loop")]
    pub run: LoopConfig,
}

impl Default for PointsTrainConfig {
    fn default() -> Self {
        Self {
            batch_size: 16,
            codes_per_clip: 8,
            targets_per_frame: 32,
            count_weight: 1.0,
            validate_clips: 200,
            model: PointsConfig::default(),
            run: LoopConfig {
                learning_rate: 1e-3,
                epochs: 20,
                ..LoopConfig::default()
            },
        }
    }
}

impl PointsTrainConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that cannot be used.
    pub fn validate(&self) -> Result<(), TrainError> {
        self.run.validate()?;
        for (field, value, max) in [
            ("batch_size", self.batch_size, 4096),
            (
                "codes_per_clip",
                self.codes_per_clip,
                MAX_FRAMES / FRAMES_PER_CODE,
            ),
            ("targets_per_frame", self.targets_per_frame, 4096),
        ] {
            check_count(field, value, max)?;
        }
        check_weight("count_weight", self.count_weight)?;
        let shape = self.model.shape(1).validate();
        shape.map_err(|e| TrainError::config("model", e.to_string()))
    }
}

/// Trains the decoder of the codes of `tokenizer`, whose weights have the hash `tokenizer_blake3`, and writes checkpoints
/// to `out_dir`.
///
/// # Errors
/// See [`TrainError`].
pub fn train(
    config: &PointsTrainConfig,
    tokenizer: &RadarTokenizer,
    tokenizer_blake3: &str,
    train: &[ClipRecord],
    val: &[ClipRecord],
    out_dir: &Path,
    resume: bool,
) -> Result<Outcome<PointNet>, TrainError> {
    config.validate()?;
    let mut val = val.to_vec();
    val.truncate(config.validate_clips);
    let mut stage = PointsStage {
        config: config.clone(),
        n_codes: tokenizer.config().codebook_size,
        tokenizer_blake3: tokenizer_blake3.into(),
        train: clips(tokenizer, train)?,
        val: clips(tokenizer, &val)?,
    };
    if stage.train.is_empty() {
        return Err(TrainError::NoData("no training clip"));
    }
    let shape = config.model.shape(stage.n_codes);
    let model = harness::seeded_network(&config.run, "points/init", |device| {
        PointNet::new(&shape, device)
    })?;
    harness::run(&mut stage, model, &config.run, out_dir, resume)
}

/// A clip as codes and frames of scaled points.
struct Clip {
    id: String,
    codes: Vec<u32>,
    /// Points of each frame.
    frames: Vec<Vec<[f32; POINT_DIM]>>,
}

fn clips(tokenizer: &RadarTokenizer, records: &[ClipRecord]) -> Result<Vec<Clip>, TrainError> {
    /// Number of clips that are encoded at once.
    const CHUNK: usize = 128;
    let records: Vec<&ClipRecord> = records.iter().filter(|r| !r.frames.is_empty()).collect();
    let mut out = Vec::with_capacity(records.len());
    for chunk in records.chunks(CHUNK) {
        let beginning = |r: &ClipRecord| r.frames.len().min(MAX_FRAMES);
        let inputs: Vec<(&[PointFrame], f32)> = chunk
            .iter()
            .map(|r| (&r.frames[..beginning(r)], r.radar_height_m))
            .collect();
        let encoded = tokenizer.encode_batch(&inputs)?;
        for ((record, (frames, height_m)), encoded) in chunk.iter().zip(&inputs).zip(encoded) {
            let db = frames
                .iter()
                .flat_map(|f| f.points.iter().map(|p| p.intensity_db));
            let median_db = median_upper(db).unwrap_or(0.0);
            let scaled = |f: &PointFrame| {
                let points = f.points.iter();
                points
                    .map(|p| scaled_point(p, *height_m, median_db))
                    .collect()
            };
            out.push(Clip {
                id: record.id.clone(),
                codes: encoded.codes,
                frames: frames.iter().map(scaled).collect(),
            });
        }
    }
    Ok(out)
}

struct PointsStage {
    config: PointsTrainConfig,
    n_codes: usize,
    tokenizer_blake3: String,
    train: Vec<Clip>,
    val: Vec<Clip>,
}

/// Losses of a batch.
struct Losses {
    total: Tensor<1>,
    chamfer: f64,
    count: f64,
}

impl PointsStage {
    fn losses(&self, model: &PointNet, clips: &[&Clip], rng: &mut ChaCha8Rng) -> Losses {
        let shape = self.config.model.shape(self.n_codes);
        let max = self.config.targets_per_frame;
        let mut rows = Vec::new();
        let mut counts = Vec::new();
        // Frames with points, their targets and which of these are no padding.
        let (mut frame_rows, mut targets, mut valid) = (Vec::new(), Vec::new(), Vec::new());
        let mut n_frames = 0i64;
        for clip in clips {
            let mut chosen: Vec<usize> = (0..clip.codes.len()).collect();
            shuffle(&mut chosen, rng);
            chosen.truncate(self.config.codes_per_clip);
            for index in chosen {
                rows.extend(window_rows(&clip.codes, index, &shape));
                for i in 0..FRAMES_PER_CODE {
                    // The last code may cover fewer frames, the rest of which count as empty.
                    let at = index * FRAMES_PER_CODE + i;
                    let points = clip.frames.get(at).map_or(&[][..], Vec::as_slice);
                    counts.push(scaled_count(points.len()));
                    if !points.is_empty() {
                        frame_rows.push(n_frames);
                        for slot in 0..max {
                            let point = match points.len() > max {
                                true => points[rng.random_range(0..points.len())],
                                false => points.get(slot).copied().unwrap_or_default(),
                            };
                            targets.extend(point);
                            valid.push(f32::from(u8::from(slot < points.len())));
                        }
                    }
                    n_frames += 1;
                }
            }
        }
        let n_frames = n_frames as usize;
        let device = model.device();
        let outputs = model.forward(rows, &shape);
        let outputs = outputs.reshape([n_frames, shape.frame_outputs()]);
        let n_values = shape.points * POINT_DIM;
        let predicted = outputs.clone().slice([0..n_frames, n_values..n_values + 1]);
        let counts = Tensor::<2>::from_data(TensorData::new(counts, [n_frames, 1]), &device);
        let count = (predicted - counts).square().mean();
        let number = |t: &Tensor<1>| f64::from(t.clone().into_scalar::<f32>());
        let mut losses = Losses {
            chamfer: 0.0,
            count: number(&count),
            total: count * self.config.count_weight,
        };
        let n = frame_rows.len();
        if n > 0 {
            let frames = Tensor::<1, Int>::from_data(TensorData::new(frame_rows, [n]), &device);
            let points = outputs.slice([0..n_frames, 0..n_values]).select(0, frames);
            let targets = TensorData::new(targets, [n, max, POINT_DIM]);
            let targets = Tensor::<3>::from_data(targets, &device);
            let valid = Tensor::<2>::from_data(TensorData::new(valid, [n, max]), &device);
            let points = points.reshape([n, shape.points, POINT_DIM]);
            let distance = chamfer(points, targets, valid, ChamferSide::Symmetric);
            losses.chamfer = number(&distance);
            losses.total = losses.total + distance;
        }
        losses
    }
}

impl Stage for PointsStage {
    type Model = PointNet;

    fn name(&self) -> &'static str {
        "points"
    }

    fn plan_epoch(&self, epoch_seed: u64) -> Vec<Vec<usize>> {
        let lengths: Vec<usize> = self.train.iter().map(|c| c.codes.len()).collect();
        plan_batches(&lengths, self.config.batch_size, epoch_seed)
    }

    fn ids(&self, batch: &[usize]) -> Vec<String> {
        batch.iter().map(|i| self.train[*i].id.clone()).collect()
    }

    fn loss(
        &mut self,
        model: &PointNet,
        batch: &[usize],
        info: StepInfo,
    ) -> Result<StepLoss, TrainError> {
        let mut rng = ChaCha8Rng::seed_from_u64(info.seed);
        let clips: Vec<&Clip> = batch.iter().map(|i| &self.train[*i]).collect();
        let losses = self.losses(model, &clips, &mut rng);
        Ok(StepLoss {
            total: losses.total,
            parts: vec![("chamfer", losses.chamfer), ("count", losses.count)],
        })
    }

    fn validate(&mut self, model: &PointNet) -> Result<Validation, TrainError> {
        // The same codes and targets in every validation, so that scores are comparable.
        let mut rng = ChaCha8Rng::seed_from_u64(self.config.run.seed);
        let (mut chamfer, mut count, mut n) = (0.0, 0.0, 0.0);
        let clips: Vec<&Clip> = self.val.iter().collect();
        for chunk in clips.chunks(self.config.batch_size) {
            let losses = self.losses(model, chunk, &mut rng);
            chamfer += losses.chamfer * chunk.len() as f64;
            count += losses.count * chunk.len() as f64;
            n += chunk.len() as f64;
        }
        // Without validation clips the score is NaN, which is never the best one.
        let values = vec![("chamfer", chamfer / n), ("count", count / n)];
        Ok(Validation {
            score: (chamfer + self.config.count_weight * count) / n,
            values,
        })
    }

    fn config(&self) -> serde_json::Value {
        let c = &self.config;
        let file = PointsFile {
            kind: POINTS_KIND.into(),
            model: c.model.clone(),
            n_codes: self.n_codes,
            tokenizer_blake3: self.tokenizer_blake3.clone(),
            training: serde_json::json!({
                "batch_size": c.batch_size,
                "codes_per_clip": c.codes_per_clip,
                "targets_per_frame": c.targets_per_frame,
                "count_weight": c.count_weight,
                "train_clips": self.train.len(),
            }),
        };
        serde_json::to_value(file).unwrap_or_default()
    }
}
