//! Stage `pose` end to end.

use std::fs;

use radarllm_base::{Joint, PointFrame, RadarPoint};
use radarllm_dataset::record::ClipRecord;
use radarllm_inference::checkpoint::{Checkpoint, MODEL_FILE};
use radarllm_nn::pose::{PoseConfig, PoseEstimator};
use radarllm_train::harness::TrainError;
use radarllm_train::pose::{self, PoseTrainConfig};

use super::{killed_after, scratch, steps, synthetic};

/// Clips whose people stand at places of their own and swing an arm; a few points lie on trunk and wrist.
fn clips(n: usize, n_frames: usize) -> Vec<ClipRecord> {
    let mut clips = synthetic::clips(n, n_frames, 1);
    for (seed, clip) in clips.iter_mut().enumerate() {
        let height = 1.6 + 0.05 * seed as f32;
        let skeleton = radarllm_body::canonical_skeleton(height);
        let upright = glam::Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
        let root = glam::Vec3::new(0.2 * seed as f32 - 0.6, 2.0 + 0.3 * seed as f32, 0.92);
        let pose = |frame: usize| {
            let swing = (0.4 * frame as f32 + seed as f32).sin();
            let mut rotations = [glam::Quat::IDENTITY; 22];
            rotations[0] = glam::Quat::from_rotation_z(0.3 * seed as f32) * upright;
            rotations[Joint::LeftShoulder as usize] = glam::Quat::from_rotation_z(swing);
            radarllm_base::Pose {
                root_in_world: root,
                rotations,
            }
        };
        clip.body_height_m = height;
        for motion_frame in 0..2 * n_frames {
            let pose = pose(motion_frame);
            let below_radar = |p: glam::Vec3| (p - glam::Vec3::Z * clip.radar_height_m).to_array();
            clip.joints.push(skeleton.forward(&pose).0.map(below_radar));
            clip.rotations6d.push(pose.rotations.map(|q| {
                let m = glam::Mat3::from_quat(q);
                let (x, y) = (m.x_axis, m.y_axis);
                [x.x, x.y, x.z, y.x, y.y, y.z]
            }));
        }
        let frame = |f: usize| PointFrame {
            frame: f as u32,
            time_s: f as f64 * 0.1,
            points: [
                Joint::Pelvis,
                Joint::Spine3,
                Joint::LeftWrist,
                Joint::RightWrist,
            ]
            .map(|joint| {
                let [x_m, y_m, z_m] = clip.joints[2 * f][joint as usize];
                RadarPoint {
                    x_m,
                    y_m,
                    z_m,
                    range_m: (x_m * x_m + y_m * y_m + z_m * z_m).sqrt(),
                    velocity_mps: 0.1,
                    intensity_db: 20.0,
                }
            })
            .into(),
            board: None,
        };
        clip.frames = (0..n_frames).map(frame).collect();
    }
    clips
}

fn tiny(n_steps: u64) -> PoseTrainConfig {
    let mut run = steps(n_steps);
    run.learning_rate = 5e-3;
    PoseTrainConfig {
        batch_size: 4,
        crop_frames: 6,
        flip: false,
        model: PoseConfig {
            neighbours: 2,
            relative_translation: true,
            ..PoseConfig::paper()
        },
        run,
        ..PoseTrainConfig::default()
    }
}

#[test]
fn poses_are_learned_and_estimated() {
    let dir = scratch("pose-overfit");
    let clips = clips(4, 6);
    let outcome = pose::train(&tiny(400), &["d".into()], &clips, &clips, &dir, false).unwrap();
    let estimator = PoseEstimator::load(&outcome.checkpoint).unwrap();
    assert_eq!(estimator.data(), ["d"]);
    let mut sum_m = 0.0;
    let mut n = 0.0;
    for clip in &clips {
        let motion = estimator
            .estimate(&clip.frames, clip.radar_height_m)
            .unwrap();
        assert_eq!(motion.poses.len(), clip.frames.len());
        for (frame, joints) in motion.joints_in_world().iter().enumerate() {
            for (found, [x, y, z]) in joints.iter().zip(clip.joints[2 * frame]) {
                let truth = glam::Vec3::new(x, y, z + clip.radar_height_m);
                sum_m += found.distance(truth);
                n += 1.0;
            }
        }
    }
    let mpjpe_m = sum_m / n;
    assert!(mpjpe_m < 0.06, "{mpjpe_m} m");
    // Rotations that no position shows, of the head and the feet among them, are learned as well.
    let mut sum_rad = 0.0;
    for clip in &clips {
        let motion = estimator
            .estimate(&clip.frames, clip.radar_height_m)
            .unwrap();
        for (frame, pose) in motion.poses.iter().enumerate() {
            for (found, six) in pose.rotations.iter().zip(clip.rotations6d[2 * frame]) {
                let [x, y] = [&six[..3], &six[3..]].map(glam::Vec3::from_slice);
                let truth = glam::Quat::from_mat3(&glam::Mat3::from_cols(x, y, x.cross(y)));
                sum_rad += found.angle_between(truth);
            }
        }
    }
    let mpjre_deg = (sum_rad / n).to_degrees();
    assert!(mpjre_deg < 15.0, "{mpjre_deg} degrees");
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn resumed_runs_equal_uninterrupted_ones() {
    let dir = scratch("pose-resume");
    let clips = clips(3, 8);
    let mut config = tiny(6);
    config.flip = true;
    config.run.checkpoint_every_steps = 4;
    let (whole, again) = (dir.join("whole"), dir.join("again"));
    pose::train(&config, &[], &clips, &clips, &whole, false).unwrap();
    killed_after(&whole, "step-00000004", &again);
    pose::train(&config, &[], &clips, &clips, &again, true).unwrap();
    let weights = |run: &std::path::Path| {
        let checkpoint = Checkpoint::open(&run.join("step-00000006")).unwrap();
        checkpoint.tensors(MODEL_FILE).unwrap()
    };
    assert_eq!(weights(&whole), weights(&again));
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn clips_without_rotations_are_named() {
    let mut clips = clips(2, 6);
    clips[1].rotations6d.clear();
    let error = pose::train(&tiny(1), &[], &clips, &[], &scratch("pose-old"), false).unwrap_err();
    assert!(matches!(error, TrainError::Clip { .. }), "{error}");
    assert!(error.to_string().contains(&clips[1].id), "{error}");
}
