//! Stage `pose`: trains the estimator of body pose from points, the first half of the comparison systems that describe an
//! estimated motion.
//!
//! Losses of mmMesh (Xue et al., MobiSys 2021) as means over their elements: the joints, the place on the floor and the
//! height, plus a squared one of the rotations, which the positions of the joints leave open. The term of the mesh's vertices is left
//! out.

use std::path::Path;

use burn::tensor::{Tensor, TensorData};
use radarllm_base::skeleton::N_JOINTS;
use radarllm_dataset::record::ClipRecord;
use radarllm_nn::motion_vqvae::layout::MIRRORED;
use radarllm_nn::pose::config::{POINT_INPUTS, REFERENCE_HEIGHT_M};
use radarllm_nn::pose::estimator::{batch_of, clip_inputs};
use radarllm_nn::pose::network::is_learned;
use radarllm_nn::pose::{POSE_KIND, PoseConfig, PoseFile, PoseNet, PoseOutput, PosePass};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

use crate::data::plan_batches;
use crate::harness::{
    self, LoopConfig, Outcome, Stage, StepInfo, StepLoss, TrainError, Validation,
};
use crate::loop_config::{check_count, check_weight};

/// Settings of the stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PoseTrainConfig {
    /// Clips per batch.
    pub batch_size: usize,
    /// Length of a training crop, radar frames.
    pub crop_frames: usize,
    /// Trains half of the crops on the mirror image.
    pub flip: bool,
    /// Weight of the loss on joints; 1 in the published system.
    pub joint_weight: f64,
    /// Weight of the loss on the place that the global branch finds; 1 in the published system.
    pub place_weight: f64,
    /// Weight of the loss on the logarithm of the height; 0.1, that of the shape in the published system.
    pub height_weight: f64,
    /// Weight of the loss on the rotations; 0 in the published system, where vertices constrain them.
    pub rotation_weight: f64,
    /// Maximum number of clips used for validation.
    pub validate_clips: usize,
    /// Settings of the network.
    pub model: PoseConfig,
    /// Settings of the training loop.
    #[serde(rename = "loop")]
    pub run: LoopConfig,
}

impl Default for PoseTrainConfig {
    fn default() -> Self {
        Self {
            batch_size: 8,
            crop_frames: 32,
            flip: true,
            joint_weight: 1.0,
            place_weight: 1.0,
            height_weight: 0.1,
            rotation_weight: 0.3,
            validate_clips: 100,
            model: PoseConfig::paper(),
            run: LoopConfig {
                learning_rate: 1e-3,
                epochs: 20,
                ..LoopConfig::default()
            },
        }
    }
}

impl PoseTrainConfig {
    /// The published system's batch, crop, losses and length: 400,000 updates, for a GPU.
    pub fn paper() -> Self {
        Self {
            batch_size: 32,
            crop_frames: 64,
            flip: false,
            rotation_weight: 0.0,
            run: LoopConfig {
                learning_rate: 1e-3,
                epochs: 0,
                max_steps: 400_000,
                ..LoopConfig::default()
            },
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
        check_count("crop_frames", self.crop_frames, 1024)?;
        for (field, weight) in [
            ("joint_weight", self.joint_weight),
            ("place_weight", self.place_weight),
            ("height_weight", self.height_weight),
            ("rotation_weight", self.rotation_weight),
        ] {
            check_weight(field, weight)?;
        }
        let model = self.model.validate();
        model.map_err(|e| TrainError::config("model", e))
    }
}

/// Trains the network on the motions of `train` and writes checkpoints to `out_dir`. `data` are the names of the data sets,
/// which the checkpoint records.
///
/// # Errors
/// See [`TrainError`]. Also if a clip has no rotations.
pub fn train(
    config: &PoseTrainConfig,
    data: &[String],
    train: &[ClipRecord],
    val: &[ClipRecord],
    out_dir: &Path,
    resume: bool,
) -> Result<Outcome<PoseNet>, TrainError> {
    config.validate()?;
    let clips = |records: &[ClipRecord]| records.iter().map(clip).collect::<Result<Vec<_>, _>>();
    let mut stage = PoseStage {
        config: config.clone(),
        data: data.to_vec(),
        train: clips(train)?,
        val: clips(&val[..val.len().min(config.validate_clips)])?,
        pass: None,
    };
    if stage.train.is_empty() {
        return Err(TrainError::NoData("no training clip"));
    }
    let model = harness::seeded_network(&config.run, "pose/init", |device| {
        PoseNet::new(&config.model, device)
    })?;
    harness::run(&mut stage, model, &config.run, out_dir, resume)
}

/// Points and true pose of a clip.
#[derive(Clone)]
struct Clip {
    id: String,
    frames: Vec<Vec<[f32; POINT_INPUTS]>>,
    poses: Vec<Target>,
}

/// True pose at a radar frame.
#[derive(Clone)]
struct Target {
    /// m, z above the floor.
    joints: [[f32; 3]; N_JOINTS],
    rotations6d: [[f32; 6]; N_JOINTS],
    /// Logarithm of the height over [`REFERENCE_HEIGHT_M`].
    log_height: f32,
}

fn clip(record: &ClipRecord) -> Result<Clip, TrainError> {
    let rotations = record
        .known_rotations()
        .map_err(|e| TrainError::clip(&record.id, e.to_string()))?;
    let frames = clip_inputs(&record.frames, record.radar_height_m)
        .map_err(|e| TrainError::clip(&record.id, e.to_string()))?;
    let log_height = (record.body_height_m / REFERENCE_HEIGHT_M).ln();
    let poses = record.frames.iter().map(|frame| {
        let at = record.motion_frame_at(frame.time_s);
        let above_floor = |[x, y, z]: [f32; 3]| [x, y, z + record.radar_height_m];
        Target {
            joints: record.joints[at].map(above_floor),
            rotations6d: rotations[at],
            log_height,
        }
    });
    Ok(Clip {
        id: record.id.clone(),
        poses: poses.collect(),
        frames,
    })
}

impl Clip {
    /// A part of the clip.
    fn part(&self, start: usize, end: usize) -> Self {
        Self {
            id: self.id.clone(),
            frames: self.frames[start..end].to_vec(),
            poses: self.poses[start..end].to_vec(),
        }
    }

    /// The mirror image: left and right exchanged.
    fn mirror(&mut self) {
        for point in self.frames.iter_mut().flatten() {
            point[0] = -point[0];
        }
        for pose in &mut self.poses {
            *pose = pose.mirrored();
        }
    }
}

impl Target {
    fn mirrored(&self) -> Self {
        Self {
            joints: std::array::from_fn(|j| {
                let [x, y, z] = self.joints[MIRRORED[j]];
                [-x, y, z]
            }),
            // M R M with M = diag(-1, 1, 1).
            rotations6d: std::array::from_fn(|j| {
                let [a, b, c, d, e, f] = self.rotations6d[MIRRORED[j]];
                [a, -b, -c, -d, e, f]
            }),
            log_height: self.log_height,
        }
    }
}

struct PoseStage {
    config: PoseTrainConfig,
    data: Vec<String>,
    train: Vec<Clip>,
    val: Vec<Clip>,
    /// The last step's pass, whose statistics the network follows.
    pass: Option<PosePass>,
}

/// Losses of a batch, as means over their elements.
struct Losses {
    total: Tensor<1>,
    parts: Vec<(&'static str, f64)>,
    /// Mean distance of the joints, m.
    distance_m: f64,
}

impl PoseStage {
    fn losses(&self, out: &PoseOutput, clips: &[Clip]) -> Losses {
        let device = out.place.device();
        let n_frames = clips.iter().map(|c| c.frames.len()).max().unwrap_or(0);
        let n = clips.len() * n_frames;
        let (mut joints, mut columns) = (vec![0.0; n * N_JOINTS * 3], [(); 2].map(|()| Vec::new()));
        let (mut heights, mut exists) = (vec![0.0; n], vec![0.0_f32; n]);
        let mut places = vec![0.0; 2 * n];
        for column in &mut columns {
            *column = vec![0.0_f32; n * N_JOINTS * 3];
        }
        for (index, clip) in clips.iter().enumerate() {
            for (frame, pose) in clip.poses.iter().enumerate() {
                let row = index * n_frames + frame;
                exists[row] = 1.0;
                heights[row] = pose.log_height;
                places[2 * row..2 * row + 2].copy_from_slice(&pose.joints[0][..2]);
                let at = row * N_JOINTS * 3;
                joints[at..at + N_JOINTS * 3].copy_from_slice(pose.joints.as_flattened());
                for (joint, six) in pose.rotations6d.iter().enumerate() {
                    for (column, values) in columns.iter_mut().zip(six.chunks_exact(3)) {
                        column[at + 3 * joint..at + 3 * joint + 3].copy_from_slice(values);
                    }
                }
            }
        }
        let n_real: f32 = exists.iter().sum();
        let tensor3 =
            |v: Vec<f32>| Tensor::<3>::from_data(TensorData::new(v, [n, N_JOINTS, 3]), &device);
        let exists = Tensor::<2>::from_data(TensorData::new(exists, [n, 1]), &device);
        let exists3 = exists.clone().reshape([n, 1, 1]);
        let mean = |t: Tensor<3>, width: usize| {
            (t * exists3.clone()).sum() / f64::from(n_real.max(1.0)) / width as f64
        };
        let off = out.joints.clone() - tensor3(joints);
        let number = |t: &Tensor<1>| f64::from(t.clone().into_scalar::<f32>());
        let distance = off.clone().without_autodiff().square().sum_dim(2).sqrt();
        let distance_m = number(&mean(distance, N_JOINTS));
        let joint = mean(off.abs(), 3 * N_JOINTS);
        let flat = |t: Tensor<2>, width: usize| mean(t.reshape([n, 1, width]), width);
        let places = Tensor::<2>::from_data(TensorData::new(places, [n, 2]), &device);
        let place = flat((out.place.clone() - places).abs(), 2);
        let heights = Tensor::<2>::from_data(TensorData::new(heights, [n, 1]), &device);
        let height = flat((out.log_height.clone() - heights).abs(), 1);
        let [x, y] = columns.map(tensor3);
        // Squared, because the absolute error of unit vectors has minima at every axis: a head could stay upside down.
        let turned = |found: &Tensor<3>, wanted: Tensor<3>| {
            mean((found.clone() - wanted).square(), 3 * N_JOINTS)
        };
        let [found_x, found_y, _] = &out.rotations.columns;
        let rotation = (turned(found_x, x) + turned(found_y, y)) * 0.5;
        let parts = vec![
            ("joints", number(&joint)),
            ("place", number(&place)),
            ("height", number(&height)),
            ("rotations", number(&rotation)),
            ("mpjpe_cm", 100.0 * distance_m),
        ];
        let c = &self.config;
        Losses {
            total: joint * c.joint_weight
                + place * c.place_weight
                + height * c.height_weight
                + rotation * c.rotation_weight,
            parts,
            distance_m,
        }
    }
}

impl Stage for PoseStage {
    type Model = PoseNet;

    fn name(&self) -> &'static str {
        "pose"
    }

    fn plan_epoch(&self, epoch_seed: u64) -> Vec<Vec<usize>> {
        let longest = self.config.crop_frames;
        let lengths: Vec<usize> = self
            .train
            .iter()
            .map(|c| c.frames.len().min(longest))
            .collect();
        plan_batches(&lengths, self.config.batch_size, epoch_seed)
    }

    fn ids(&self, batch: &[usize]) -> Vec<String> {
        batch.iter().map(|i| self.train[*i].id.clone()).collect()
    }

    fn loss(
        &mut self,
        model: &PoseNet,
        batch: &[usize],
        info: StepInfo,
    ) -> Result<StepLoss, TrainError> {
        let mut rng = ChaCha8Rng::seed_from_u64(info.seed);
        let clips: Vec<Clip> = batch
            .iter()
            .map(|&i| {
                let clip = &self.train[i];
                let spare = clip.frames.len().saturating_sub(self.config.crop_frames);
                let start = rng.random_range(0..=spare);
                let end = (start + self.config.crop_frames).min(clip.frames.len());
                let mut part = clip.part(start, end);
                if self.config.flip && rng.random::<bool>() {
                    part.mirror();
                }
                part
            })
            .collect();
        let inputs: Vec<_> = clips.iter().map(|c| &c.frames).collect();
        let mut pass = PosePass::new(info.seed ^ 0x706f_7365);
        let out = model.forward(&batch_of(&inputs), Some(&mut pass));
        self.pass = Some(pass);
        let losses = self.losses(&out, &clips);
        Ok(StepLoss {
            total: losses.total,
            parts: losses.parts,
        })
    }

    fn after_step(&mut self, model: PoseNet, _: StepInfo) -> Result<PoseNet, TrainError> {
        Ok(match self.pass.take() {
            Some(pass) => model.follow(pass),
            None => model,
        })
    }

    fn is_trained(&self, path: &str) -> bool {
        is_learned(path)
    }

    fn validate(&mut self, model: &PoseNet) -> Result<Validation, TrainError> {
        let (mut distance, mut n) = (0.0, 0.0);
        for chunk in self.val.chunks(self.config.batch_size) {
            let inputs: Vec<_> = chunk.iter().map(|c| &c.frames).collect();
            let out = model.forward(&batch_of(&inputs), None);
            let frames: usize = chunk.iter().map(|c| c.frames.len()).sum();
            distance += self.losses(&out, chunk).distance_m * frames as f64;
            n += frames as f64;
        }
        // Without validation clips the score is NaN, which is never the best one.
        Ok(Validation {
            score: distance / n,
            values: vec![("mpjpe_cm", 100.0 * distance / n)],
        })
    }

    fn config(&self) -> serde_json::Value {
        let c = &self.config;
        let file = PoseFile {
            kind: POSE_KIND.into(),
            model: c.model.clone(),
            data: self.data.clone(),
            training: serde_json::json!({
                "batch_size": c.batch_size,
                "crop_frames": c.crop_frames,
                "flip": c.flip,
                "joint_weight": c.joint_weight,
                "place_weight": c.place_weight,
                "height_weight": c.height_weight,
                "rotation_weight": c.rotation_weight,
                "train_clips": self.train.len(),
            }),
        };
        serde_json::to_value(file).unwrap_or_default()
    }
}
