//! AMASS archives (npz): pose parameters of SMPL-H (156 values per frame) or SMPL-X (165).

use super::{LoadedMotion, read_archive};
use crate::error::MotionError;
use crate::proportions::{DEFAULT_HEIGHT_M, canonical_skeleton};
use crate::retarget::check_finite;
use crate::sample::{check_fps, ground};
use glam::{Quat, Vec3};
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::{Motion, Pose};

const MEMBERS: [&str; 7] = [
    "poses",
    "trans",
    "betas",
    "gender",
    "mocap_framerate",
    "mocap_frame_rate",
    "fps",
];

/// Reads an AMASS archive.
pub(crate) fn load_amass(file: &str, bytes: &[u8]) -> Result<LoadedMotion, MotionError> {
    let (arrays, mut skipped) = read_archive(file, bytes, &MEMBERS)?;
    let member_error = |member: &str, expected: String, found: String| MotionError::Member {
        file: file.into(),
        member: member.into(),
        expected,
        found,
    };
    let get = |name: &str| arrays.iter().find(|(n, _)| n == name).map(|(_, a)| a);
    let numbers = |name: &str| -> Result<(Vec<usize>, Vec<f64>), MotionError> {
        let array = get(name).ok_or_else(|| {
            let found: Vec<&str> = arrays.iter().map(|(n, _)| n.as_str()).collect();
            let pickled = skipped
                .iter()
                .any(|s| s.starts_with(&format!("{name} (pickled")));
            let found = if pickled {
                "pickled objects, which are never read".into()
            } else {
                format!("members {found:?}")
            };
            member_error(
                name,
                "a numeric array of this name (an AMASS archive)".into(),
                found,
            )
        })?;
        let values = array.numbers().ok_or_else(|| {
            member_error(
                name,
                "real numbers".into(),
                format!("type {}", array.header.descr()),
            )
        })?;
        match values.iter().position(|v| v.is_nan() || v.abs() >= 1e4) {
            Some(i) => Err(MotionError::NotFinite {
                file: file.into(),
                place: format!("{name}, element {i}"),
                value: values[i],
            }),
            None => Ok((array.shape(), values)),
        }
    };

    let (poses_shape, pose_values) = numbers("poses")?;
    // The first 66 numbers are the body; hands, jaw and eyes follow.
    let [n_frames, width] = poses_shape[..] else {
        return Err(member_error(
            "poses",
            "shape (frames, 156 or 165)".into(),
            format!("{:?}", poses_shape),
        ));
    };
    if n_frames == 0 || width < 66 || width % 3 != 0 || n_frames > super::bvh::MAX_FRAMES {
        return Err(member_error(
            "poses",
            "shape (frames, 156 or 165)".into(),
            format!("{:?}", poses_shape),
        ));
    }
    let (trans_shape, trans_values) = numbers("trans")?;
    if trans_shape != [n_frames, 3] {
        return Err(member_error(
            "trans",
            format!("shape [{n_frames}, 3]"),
            format!("{:?}", trans_shape),
        ));
    }
    let rate_name = ["mocap_framerate", "mocap_frame_rate", "fps"]
        .into_iter()
        .find(|n| get(n).is_some());
    let rate_name = rate_name.unwrap_or("mocap_framerate");
    let rate = numbers(rate_name)?.1.first().copied().unwrap_or(f64::NAN);
    let fps = check_fps(rate).map_err(|_| {
        member_error(
            rate_name,
            "0.1 to 10000 frames a second".into(),
            rate.to_string(),
        )
    })?;

    let mut warnings = Vec::new();
    let gender = get("gender")
        .and_then(|array| array.text())
        .unwrap_or_else(|| "unknown".into());
    let n_betas = get("betas").map_or(0, |b| b.len());
    if n_betas > 0 {
        numbers("betas")?;
    }
    warnings.push(format!(
        "bone lengths are those of an average body of {DEFAULT_HEIGHT_M} m: {n_betas} shape coefficients ({gender}) mean something only to the SMPL body model"
    ));
    if width > 66 {
        skipped.push(format!(
            "pose values 66 to {} of each frame (hands and face)",
            width - 1
        ));
    }

    let mut motion_poses = Vec::with_capacity(n_frames);
    for t in 0..n_frames {
        let row = &pose_values[t * width..t * width + 66];
        let mut rotations = [Quat::IDENTITY; N_JOINTS];
        for (rotation, axis_angle) in rotations.iter_mut().zip(row.chunks_exact(3)) {
            *rotation = quat_from_axis_angle(axis_angle);
        }
        let root = Vec3::from_array([0, 1, 2].map(|a| trans_values[t * 3 + a] as f32));
        motion_poses.push(Pose {
            root_in_world: root,
            rotations,
        });
    }
    let mut motion = Motion {
        fps,
        skeleton: canonical_skeleton(DEFAULT_HEIGHT_M),
        poses: motion_poses,
    };
    // AMASS is z-up; some re-exports are y-up, which is detected from the mean up direction of the
    // pelvis.
    let up: Vec3 = motion
        .poses
        .iter()
        .map(|p| p.rotations[0] * Vec3::Y)
        .sum::<Vec3>()
        / n_frames as f32;
    if up.y > 0.7 {
        warnings.push("the bodies stand along y: turned to z up".into());
        let turn = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
        for pose in &mut motion.poses {
            pose.root_in_world = turn * pose.root_in_world;
            pose.rotations[0] = (turn * pose.rotations[0]).normalize();
        }
    }
    check_finite(file, &motion)?;
    ground(&mut motion);
    Ok(LoadedMotion::new(
        motion,
        "amass-npz",
        width / 3,
        ("metre".into(), 1.0),
        skipped,
        warnings,
    ))
}

/// Rotation from an axis-angle vector in radians.
fn quat_from_axis_angle(v: &[f64]) -> Quat {
    let angle_rad = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    // sin(a/2)/a, whose limit at zero is 1/2.
    let scale = if angle_rad < 1e-8 {
        0.5
    } else {
        (0.5 * angle_rad).sin() / angle_rad
    };
    let [x, y, z] = [v[0], v[1], v[2]].map(|c| (c * scale) as f32);
    Quat::from_xyzw(x, y, z, (0.5 * angle_rad).cos() as f32).normalize()
}
