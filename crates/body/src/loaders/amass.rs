//! AMASS archives (npz) and their relatives: pose parameters of SMPL (72 values per frame), SMPL-H (156) or SMPL-X (165),
//! in one member or with the root and the body apart.

use super::{LoadedMotion, NamedArrays, read_archive};
use crate::error::{MotionError, excerpt};
use crate::proportions::{DEFAULT_HEIGHT_M, canonical_skeleton};
use crate::retarget::check_finite;
use crate::sample::{check_fps, ground};
use glam::{Quat, Vec3};
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::{Motion, Pose};
use radarllm_files::npy::NpyArray;

/// Members that are read. The pose is in one of the first, or in one of the second and one of the third.
const POSES: [&str; 1] = ["poses"];
const ROOTS: [&str; 2] = ["root_orient", "global_orient"];
const BODIES: [&str; 2] = ["pose_body", "body_pose"];
const TRANSLATIONS: [&str; 2] = ["trans", "transl"];
const RATES: [&str; 3] = ["mocap_framerate", "mocap_frame_rate", "fps"];
const OTHERS: [&str; 2] = ["betas", "gender"];

/// Number of values of the body in a frame; hands, jaw and eyes follow.
const BODY_VALUES: usize = 3 * N_JOINTS;

/// The members of an archive.
struct Members<'a> {
    file: &'a str,
    arrays: NamedArrays,
    skipped: Vec<String>,
}

impl Members<'_> {
    fn error(&self, member: &str, expected: String, found: String) -> MotionError {
        MotionError::Member {
            file: self.file.into(),
            member: member.into(),
            expected,
            found,
        }
    }

    fn get(&self, name: &str) -> Option<&NpyArray<'static>> {
        self.arrays.iter().find(|(n, _)| n == name).map(|(_, a)| a)
    }

    /// The first of these members that exists.
    fn first(&self, names: &[&'static str]) -> Option<&'static str> {
        names.iter().copied().find(|name| self.get(name).is_some())
    }

    /// The names of all members, for messages.
    fn list(&self) -> String {
        let read = self.arrays.iter().map(|(name, _)| name.as_str());
        let skipped = self.skipped.iter();
        let names: Vec<&str> = read
            .chain(skipped.map(|text| text.strip_suffix(" (not needed)").unwrap_or(text)))
            .collect();
        format!("the members {}", excerpt_of_list(&names))
    }

    /// The shape and the values of a member, or of the first of `names` in the message if there is none of them.
    fn numbers(&self, names: &[&'static str]) -> Result<(Vec<usize>, Vec<f64>), MotionError> {
        let name = self.first(names).unwrap_or(names[0]);
        let Some(array) = self.get(name) else {
            let is_pickled = |text: &String| text.starts_with(&format!("{name} (pickled"));
            let found = match self.skipped.iter().any(is_pickled) {
                true => "pickled objects, which are never read".into(),
                false => self.list(),
            };
            let expected = format!("a numeric array named {}", names.join(" or "));
            return Err(self.error(name, expected, found));
        };
        let values = array.numbers().ok_or_else(|| {
            let found = format!("type {}", array.header.descr());
            self.error(name, "real numbers".into(), found)
        })?;
        match values.iter().position(|v| v.is_nan() || v.abs() >= 1e4) {
            Some(i) => Err(MotionError::NotFinite {
                file: self.file.into(),
                place: format!("{name}, element {i}"),
                value: values[i],
            }),
            None => Ok((array.shape(), values)),
        }
    }

    /// The joint rotations of all frames.
    fn rotations(&self) -> Result<Rotations, MotionError> {
        if let (None, Some(root), Some(body)) =
            (self.first(&POSES), self.first(&ROOTS), self.first(&BODIES))
        {
            let (of_root, of_body) = (
                self.axis_angles(root, 1)?,
                self.axis_angles(body, N_JOINTS - 1)?,
            );
            if of_root.n_values != 3 {
                let found = format!("{} values a frame", of_root.n_values);
                return Err(self.error(root, "the rotation of the root alone".into(), found));
            }
            if of_root.n_frames != of_body.n_frames {
                let expected = format!("{} frames as in {root}", of_root.n_frames);
                return Err(self.error(body, expected, of_body.n_frames.to_string()));
            }
            return Ok(of_root.and(of_body));
        }
        if self.first(&POSES).is_none() {
            let is_pickled = |text: &String| text.starts_with("poses (pickled");
            let found = match self.skipped.iter().any(is_pickled) {
                true => "pickled objects, which are never read".into(),
                false => self.list(),
            };
            let expected = format!(
                "axis-angle rotations: {}, or {} with {}",
                POSES[0],
                ROOTS.join(" or "),
                BODIES.join(" or ")
            );
            return Err(self.error(POSES[0], expected, found));
        }
        self.axis_angles(POSES[0], N_JOINTS)
    }

    /// Axis-angle rotations of shape (frames, 3 joints) or (frames, joints, 3), at least `n_joints` of them.
    fn axis_angles(&self, name: &'static str, n_joints: usize) -> Result<Rotations, MotionError> {
        let (shape, values) = self.numbers(&[name])?;
        let n_values = match shape[..] {
            [_, width] if width % 3 == 0 => width,
            [_, joints, 3] => joints.saturating_mul(3),
            _ => 0,
        };
        let n_frames = shape.first().copied().unwrap_or(0);
        if n_frames == 0 || n_values < 3 * n_joints || n_frames > super::bvh::MAX_FRAMES {
            let expected = format!(
                "axis-angle rotations of {n_joints} or more joints, of shape (frames, {}) or (frames, {n_joints}, 3), \
                 in up to {} frames",
                3 * n_joints,
                super::bvh::MAX_FRAMES
            );
            return Err(self.error(name, expected, format!("{shape:?}")));
        }
        Ok(Rotations {
            n_frames,
            n_values,
            values,
        })
    }
}

/// Names for a message, as many of them as a line takes.
fn excerpt_of_list(names: &[&str]) -> String {
    /// Maximum number of names.
    const MAX_NAMES: usize = 40;
    let listed = names.iter().take(MAX_NAMES).map(|name| excerpt(name));
    let listed: Vec<String> = listed.collect();
    match names.len().saturating_sub(MAX_NAMES) {
        0 => listed.join(", "),
        n => format!("{} and {n} more", listed.join(", ")),
    }
}

/// Axis-angle rotations of joints, rad, with the root first.
struct Rotations {
    n_frames: usize,
    /// Number of values of a frame, a multiple of 3.
    n_values: usize,
    values: Vec<f64>,
}

impl Rotations {
    /// The rotations of both in each frame.
    fn and(self, other: Self) -> Self {
        let frames = self.values.chunks_exact(self.n_values);
        let rows = frames.zip(other.values.chunks_exact(other.n_values));
        Self {
            n_frames: self.n_frames,
            n_values: self.n_values + other.n_values,
            values: rows.flat_map(|(a, b)| [a, b].concat()).collect(),
        }
    }
}

/// Reads an archive of SMPL, SMPL-H or SMPL-X motions: as AMASS writes them (`poses`), or with the root and the body
/// apart (`root_orient` and `pose_body`, `global_orient` and `body_pose`).
pub(crate) fn load_amass(file: &str, bytes: &[u8]) -> Result<LoadedMotion, MotionError> {
    let wanted: Vec<&str> = [&POSES[..], &ROOTS, &BODIES, &TRANSLATIONS, &RATES, &OTHERS].concat();
    let (arrays, skipped) = read_archive(file, bytes, &wanted)?;
    let members = Members {
        file,
        arrays,
        skipped,
    };
    let Rotations {
        n_frames,
        n_values,
        values: pose_values,
    } = members.rotations()?;
    let (trans_shape, trans_values) = members.numbers(&TRANSLATIONS)?;
    if trans_shape != [n_frames, 3] {
        return Err(members.error(
            members.first(&TRANSLATIONS).unwrap_or(TRANSLATIONS[0]),
            format!("shape [{n_frames}, 3]"),
            format!("{:?}", trans_shape),
        ));
    }
    let rate = members.numbers(&RATES)?.1;
    let rate = rate.first().copied().unwrap_or(f64::NAN);
    let fps = check_fps(rate).map_err(|_| {
        members.error(
            members.first(&RATES).unwrap_or(RATES[0]),
            "0.1 to 10000 frames a second".into(),
            rate.to_string(),
        )
    })?;

    let mut warnings = Vec::new();
    let gender = members
        .get("gender")
        .and_then(|array| array.text())
        .unwrap_or_else(|| "unknown".into());
    let n_betas = members.get("betas").map_or(0, |b| b.len());
    if n_betas > 0 {
        members.numbers(&["betas"])?;
    }
    warnings.push(format!(
        "bone lengths are those of an average body of {DEFAULT_HEIGHT_M} m: {n_betas} shape coefficients ({gender}) mean something only to the SMPL body model"
    ));
    let mut skipped = members.skipped;
    if n_values > BODY_VALUES {
        skipped.push(format!(
            "pose values {BODY_VALUES} to {} of each frame (hands and face)",
            n_values - 1
        ));
    }

    let mut motion_poses = Vec::with_capacity(n_frames);
    for t in 0..n_frames {
        let row = &pose_values[t * n_values..t * n_values + BODY_VALUES];
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
        n_values / 3,
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
