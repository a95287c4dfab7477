//! A trained network, applied to clips.

use std::path::Path;

use burn::module::Module;
use burn::tensor::Device;
use glam::{Mat3, Quat, Vec3};
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::stats::median_upper;
use radarllm_base::{Motion, PointFrame, Pose};
use radarllm_body::canonical_skeleton;
use radarllm_inference::checkpoint::{Checkpoint, CheckpointError};

use super::config::{
    MAX_POINTS, POINT_INPUTS, POSE_KIND, PoseConfig, PoseFile, REFERENCE_HEIGHT_M,
};
use super::network::{PoseBatch, PoseNet};
use crate::params::load_model;

/// Frames per second that the network was trained on.
const FRAME_RATE_HZ: f64 = 10.0;
/// Maximum number of frames whose pose is estimated at once (ten minutes).
const MAX_FRAMES: usize = 6_000;

/// Why the pose of a clip cannot be estimated.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum PoseError {
    /// No frames, or more than any clip has.
    #[error("{found} frames; a pose is estimated of 1 to {MAX_FRAMES} frames")]
    Length {
        /// Number of frames.
        found: usize,
    },
    /// A value of a point is NaN or infinite.
    #[error("frame {frame}: a point is not finite")]
    NotFinite {
        /// Number of the frame.
        frame: u32,
    },
}

/// A trained network.
#[derive(Debug, Clone)]
pub struct PoseEstimator {
    file: PoseFile,
    net: PoseNet,
}

impl PoseEstimator {
    /// Loads a checkpoint directory.
    ///
    /// # Errors
    /// If it is missing, damaged, no pose network, or inconsistent with its own configuration.
    pub fn load(dir: &Path) -> Result<Self, CheckpointError> {
        let checkpoint = Checkpoint::open(dir)?;
        let file: PoseFile =
            checkpoint.config(POSE_KIND, |f: &PoseFile| &f.kind, |f| f.model.validate())?;
        let net = load_model(&checkpoint, PoseNet::new(&file.model, &Device::flex()))?;
        let net = net.valid();
        Ok(Self { file, net })
    }

    /// Shape of the network.
    pub fn config(&self) -> &PoseConfig {
        &self.file.model
    }

    /// Names of the data sets on which the network was trained.
    pub fn data(&self) -> &[String] {
        &self.file.data
    }

    /// The motion of the person in a clip, one pose a frame: axes of the radar, with z above the floor.
    ///
    /// `frames` are 10 a second; every frame gets a pose, also one without points.
    ///
    /// # Errors
    /// See [`PoseError`].
    pub fn estimate(
        &self,
        frames: &[PointFrame],
        radar_height_m: f32,
    ) -> Result<Motion, PoseError> {
        if frames.is_empty() || frames.len() > MAX_FRAMES {
            return Err(PoseError::Length {
                found: frames.len(),
            });
        }
        let inputs = clip_inputs(frames, radar_height_m)?;
        let batch = batch_of(&[&inputs]);
        let out = self.net.forward(&batch, None);
        let host =
            |values: burn::tensor::TensorData| values.try_into_vec::<f32>().unwrap_or_default();
        let [x, y, _] = out.rotations.columns.map(|c| host(c.into_data()));
        let joints = host(out.joints.into_data());
        let heights = host(out.log_height.into_data());
        let log_height = median_upper(heights).unwrap_or(0.0);
        let poses = (0..frames.len()).map(|frame| {
            let rotation = |joint: usize| {
                let at = 3 * (frame * N_JOINTS + joint);
                let [x, y] = [&x, &y].map(|c| Vec3::from_slice(&c[at..at + 3]));
                Quat::from_mat3(&Mat3::from_cols(x, y, x.cross(y))).normalize()
            };
            Pose {
                root_in_world: Vec3::from_slice(&joints[3 * frame * N_JOINTS..][..3]),
                rotations: std::array::from_fn(rotation),
            }
        });
        Ok(Motion {
            fps: FRAME_RATE_HZ,
            skeleton: canonical_skeleton(REFERENCE_HEIGHT_M * log_height.clamp(-0.75, 0.75).exp()),
            poses: poses.collect(),
        })
    }

    /// Number of learned parameters.
    pub fn n_params(&self) -> usize {
        let shapes = crate::params::param_shapes(&self.net);
        let learned = shapes
            .iter()
            .filter(|(path, _)| super::network::is_learned(path));
        learned
            .map(|(_, shape)| shape.iter().product::<usize>())
            .sum()
    }
}

/// Inputs of a clip: those of the points of each frame, the strongest [`MAX_POINTS`].
///
/// # Errors
/// [`PoseError::NotFinite`].
pub fn clip_inputs(
    frames: &[PointFrame],
    radar_height_m: f32,
) -> Result<Vec<Vec<[f32; POINT_INPUTS]>>, PoseError> {
    let db = frames
        .iter()
        .flat_map(|f| f.points.iter().map(|p| p.intensity_db));
    let median_db = median_upper(db).unwrap_or(0.0);
    frames
        .iter()
        .map(|frame| {
            let mut points = frame.points.clone();
            points.sort_by(|a, b| b.intensity_db.total_cmp(&a.intensity_db));
            points.truncate(MAX_POINTS);
            let inputs: Vec<[f32; POINT_INPUTS]> = points
                .iter()
                .map(|p| {
                    let level = (p.intensity_db - median_db) / 10.0;
                    let height_m = p.z_m + radar_height_m;
                    [p.x_m, p.y_m, height_m, p.velocity_mps, level, p.range_m]
                })
                .collect();
            match inputs.as_flattened().iter().all(|v| v.is_finite()) {
                true => Ok(inputs),
                false => Err(PoseError::NotFinite { frame: frame.frame }),
            }
        })
        .collect()
}

/// A batch of clips, each as the points of its frames; shorter clips and emptier frames are filled.
pub fn batch_of(clips: &[&Vec<Vec<[f32; POINT_INPUTS]>>]) -> PoseBatch {
    let n_frames = clips.iter().map(|c| c.len()).max().unwrap_or(0);
    let all = clips.iter().flat_map(|c| c.iter());
    let n_points = all.map(Vec::len).max().unwrap_or(0).max(1);
    let mut batch = PoseBatch {
        n_clips: clips.len(),
        n_frames,
        n_points,
        points: vec![0.0; clips.len() * n_frames * n_points * POINT_INPUTS],
        exists: vec![0.0; clips.len() * n_frames * n_points],
    };
    for (clip, frames) in clips.iter().enumerate() {
        for (frame, points) in frames.iter().enumerate() {
            let at = (clip * n_frames + frame) * n_points;
            batch.exists[at..at + points.len()].fill(1.0);
            let values = points.as_flattened();
            batch.points[at * POINT_INPUTS..][..values.len()].copy_from_slice(values);
        }
    }
    batch
}
