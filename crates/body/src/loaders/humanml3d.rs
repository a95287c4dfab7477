//! HumanML3D arrays (npy): joint positions `(T, 22, 3)` or feature vectors `(T, 263)`, 20 fps.

use super::{LoadedMotion, read_array};
use crate::error::MotionError;
use crate::features::{HUMANML3D_DIM, HUMANML3D_FPS, joints_from_features};
use crate::retarget::motion_from_positions;
use glam::Vec3;
use radarllm_base::skeleton::N_JOINTS;

/// Reads `new_joints` or `new_joint_vecs`.
pub(crate) fn load_humanml3d(file: &str, bytes: &[u8]) -> Result<LoadedMotion, MotionError> {
    let member_error = |expected: String, found: String| MotionError::Member {
        file: file.into(),
        member: "array".into(),
        expected,
        found,
    };
    let array = read_array(file, bytes)?;
    let shape = array.shape();
    let is_joints = matches!(shape[..], [_, N_JOINTS, 3]);
    let is_features = matches!(shape[..], [_, HUMANML3D_DIM]);
    if !(is_joints || is_features) || shape[0] == 0 || shape[0] > super::bvh::MAX_FRAMES {
        return Err(member_error(
            "shape (frames, 22, 3) or (frames, 263)".into(),
            format!("{shape:?} of {}", array.header.descr()),
        ));
    }
    let values = array.numbers().ok_or_else(|| {
        member_error(
            "real numbers".into(),
            format!("type {}", array.header.descr()),
        )
    })?;
    if let Some(i) = values.iter().position(|v| v.is_nan() || v.abs() >= 1e4) {
        return Err(MotionError::NotFinite {
            file: file.into(),
            place: format!("element {i}"),
            value: values[i],
        });
    }
    let mut skipped = Vec::new();
    let mut warnings = vec!["roll of bones is inferred from joint positions".into()];
    let frames: Vec<[Vec3; N_JOINTS]> = if is_joints {
        values
            .chunks_exact(N_JOINTS * 3)
            .map(|row| {
                std::array::from_fn(|j| {
                    // From y up and z forward to z up and -y forward.
                    let [x, y, z] = [0, 1, 2].map(|a| row[j * 3 + a] as f32);
                    Vec3::new(x, -z, y)
                })
            })
            .collect()
    } else {
        skipped.push("feature columns 67 to 262 (rotations, velocities, contacts)".into());
        warnings.push("joints are summed up from the features' root velocities".into());
        let features: Vec<f32> = values.iter().map(|v| *v as f32).collect();
        joints_from_features(&features)
    };
    let motion = motion_from_positions(file, &frames, HUMANML3D_FPS)?;
    Ok(LoadedMotion::new(
        motion,
        "humanml3d-npy",
        N_JOINTS,
        ("metre".into(), 1.0),
        skipped,
        warnings,
    ))
}
