//! Motions as codes of the motion VQ-VAE, from which the language model of a comparison system learns instead of radar codes.

use radarllm_base::seed::derive_seed;
use radarllm_body::features::humanml3d_features;
use radarllm_dataset::record::ClipRecord;
use radarllm_inference::tokenizer::Encoded;
use radarllm_nn::motion_vqvae::{FRAMES_PER_FEATURE, MotionTeacher, mirror_motion_features};
use radarllm_nn::pose::PoseEstimator;

use crate::harness::TrainError;
use crate::lm::{LmClip, Motions};

/// Codes of a motion, given as HumanML3D features, with the vectors of these codes as features.
///
/// # Errors
/// If the motion cannot be encoded.
pub fn motion_codes(teacher: &MotionTeacher, features: &[f32]) -> Result<Encoded, String> {
    let encoded = teacher.features(features).map_err(|e| e.to_string())?;
    let codes = teacher.codes(&encoded);
    Ok(Encoded {
        features: teacher.vectors(&codes),
        codes,
        ..Encoded::default()
    })
}

/// HumanML3D features of the motion that a pose network sees in a clip.
///
/// # Errors
/// If the pose cannot be estimated, or the clip has fewer than two frames.
pub fn estimated_features(
    estimator: &PoseEstimator,
    record: &ClipRecord,
) -> Result<Vec<f32>, String> {
    let motion = estimator
        .estimate(&record.frames, record.radar_height_m)
        .map_err(|e| e.to_string())?;
    let features = humanml3d_features(&motion);
    match features.is_empty() {
        true => Err("fewer than two frames have no motion".into()),
        false => Ok(features),
    }
}

/// Half of the motions, 0 or 1, to which a motion belongs. Variants of a motion are in the same half.
pub fn half_of(motion_id: &str) -> usize {
    usize::from(derive_seed(1, motion_id).is_multiple_of(2))
}

/// Which motion of a clip becomes codes.
pub(crate) enum MotionOf<'a> {
    /// Its true one.
    Truth,
    /// The one that a pose network estimates; the network of a half is for the clips of that half.
    Estimated([&'a PoseEstimator; 2]),
}

/// Encodes the motions of clips and combines the variants of a motion; with `flip` also their mirror images.
///
/// # Errors
/// A clip without motion features, or whose motion cannot be encoded.
pub(crate) fn motion_clips(
    teacher: &MotionTeacher,
    clips: &[ClipRecord],
    motion: &MotionOf,
    flip: bool,
) -> Result<Vec<LmClip>, TrainError> {
    let mut motions = Motions::default();
    for clip in clips {
        let problem = |problem: String| TrainError::clip(&clip.id, problem);
        let mut features = match motion {
            MotionOf::Truth => clip.motion_features.clone(),
            MotionOf::Estimated(estimators) => {
                let estimator = estimators[half_of(&clip.motion_id)];
                estimated_features(estimator, clip).map_err(problem)?
            }
        };
        let encoded = motion_codes(teacher, &features).map_err(problem)?;
        let seconds = (encoded.codes.len() * FRAMES_PER_FEATURE) as f32 / clip.motion_fps;
        let mirrored = match flip {
            true => {
                mirror_motion_features(&mut features);
                Some(motion_codes(teacher, &features).map_err(problem)?)
            }
            false => None,
        };
        motions.add(clip, seconds, encoded, mirrored);
    }
    Ok(motions.into_clips())
}
