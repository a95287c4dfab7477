//! Tables of Kinect joints: one row per frame, columns `SpineBase_X` .. `ThumbRight_Z`, m.
//!
//! The layout is that of the MARS data set: X is lateral, Y points away from the sensor, Z is up,
//! and the sensor is at the origin. A person who faces the sensor has the left hand at positive X.

use super::LoadedMotion;
use crate::error::{MotionError, excerpt};
use crate::retarget::motion_from_positions;
use glam::Vec3;
use radarllm_base::Joint;
use radarllm_base::skeleton::N_JOINTS;

/// Frame rate of such tables, which do not state it; MARS pairs them with radar frames at 10 per
/// second.
pub const KINECT_TABLE_FPS: f64 = 10.0;

/// Name of the first column of such a table.
pub(crate) const FIRST_COLUMN: &[u8] = b"SpineBase_X";

/// Position of each SMPL-X joint: two Kinect joints and the fraction of the way from first to
/// second.
fn place(joint: Joint) -> (&'static str, &'static str, f32) {
    let at = |name| (name, name, 0.0);
    match joint {
        Joint::Pelvis => at("SpineBase"),
        Joint::LeftHip => at("HipLeft"),
        Joint::RightHip => at("HipRight"),
        Joint::LeftKnee => at("KneeLeft"),
        Joint::RightKnee => at("KneeRight"),
        Joint::LeftAnkle => at("AnkleLeft"),
        Joint::RightAnkle => at("AnkleRight"),
        Joint::LeftFoot => at("FootLeft"),
        Joint::RightFoot => at("FootRight"),
        // The three Kinect joints between pelvis and neck differ from those of SMPL-X: interpolate.
        Joint::Spine1 => ("SpineBase", "SpineMid", 0.4),
        Joint::Spine2 => ("SpineBase", "SpineMid", 0.8),
        Joint::Spine3 => ("SpineMid", "SpineShoulder", 0.2),
        Joint::Neck => ("SpineShoulder", "Neck", 0.5),
        Joint::Head => ("Neck", "Head", 0.7),
        Joint::LeftCollar => ("SpineShoulder", "ShoulderLeft", 0.4),
        Joint::RightCollar => ("SpineShoulder", "ShoulderRight", 0.4),
        Joint::LeftShoulder => at("ShoulderLeft"),
        Joint::RightShoulder => at("ShoulderRight"),
        Joint::LeftElbow => at("ElbowLeft"),
        Joint::RightElbow => at("ElbowRight"),
        Joint::LeftWrist => at("WristLeft"),
        Joint::RightWrist => at("WristRight"),
    }
}

/// The 22 joints of every row, in the axes of the table, m.
///
/// # Errors
/// [`MotionError::Text`] for a missing column, a short row or a value that is not a number.
pub fn kinect_joints(file: &str, bytes: &[u8]) -> Result<Vec<[Vec3; N_JOINTS]>, MotionError> {
    let wrong = |line: usize, expected: String, found: &str| MotionError::Text {
        file: file.into(),
        line,
        expected,
        found: excerpt(found),
    };
    let text = std::str::from_utf8(bytes)
        .map_err(|e| wrong(1, "text".into(), &format!("byte {}", e.valid_up_to())))?;
    let mut lines = text.lines().enumerate();
    let (_, header) = lines.next().unwrap_or_default();
    let header = header.trim_start_matches('\u{feff}');
    let names: Vec<&str> = header.split(',').map(str::trim).collect();
    let column = |joint: &str, axis: &str| -> Result<usize, MotionError> {
        let name = format!("{joint}_{axis}");
        names
            .iter()
            .position(|n| **n == name)
            .ok_or_else(|| wrong(1, format!("a column `{name}`"), header))
    };
    let mut columns = Vec::with_capacity(N_JOINTS);
    for joint in Joint::ALL {
        let (from, to, share) = place(joint);
        let mut axes = [(0, 0); 3];
        for (pair, axis) in axes.iter_mut().zip(["X", "Y", "Z"]) {
            *pair = (column(from, axis)?, column(to, axis)?);
        }
        columns.push((axes, share));
    }
    let mut frames = Vec::new();
    for (i, row) in lines {
        let line = i + 1;
        if row.trim().is_empty() {
            continue;
        }
        let cells: Vec<&str> = row.split(',').collect();
        if cells.len() != names.len() {
            return Err(wrong(line, format!("{} cells", names.len()), row));
        }
        let value = |column: usize| -> Result<f32, MotionError> {
            cells[column]
                .trim()
                .parse::<f32>()
                .ok()
                .filter(|v| v.is_finite())
                .ok_or_else(|| wrong(line, format!("{}, a number", names[column]), cells[column]))
        };
        let mut joints = [Vec3::ZERO; N_JOINTS];
        for (joint, (axes, share)) in joints.iter_mut().zip(&columns) {
            for (axis, (from, to)) in axes.iter().enumerate() {
                let (from, to) = (value(*from)?, value(*to)?);
                joint[axis] = from + share * (to - from);
            }
        }
        frames.push(joints);
    }
    Ok(frames)
}

/// Reads a table as a motion at [`KINECT_TABLE_FPS`].
pub(crate) fn load_kinect(file: &str, bytes: &[u8]) -> Result<LoadedMotion, MotionError> {
    let frames = kinect_joints(file, bytes)?;
    let motion = motion_from_positions(file, &frames, KINECT_TABLE_FPS)?;
    Ok(LoadedMotion::new(
        motion,
        "kinect-csv",
        25,
        ("metre".into(), 1.0),
        vec!["hands, hand tips and thumbs".into()],
        vec![
            format!("the table has no rate: {KINECT_TABLE_FPS} frames/s assumed"),
            "roll of bones is inferred from joint positions".into(),
        ],
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loaders::load_motion;
    use std::path::Path;

    /// A standing person 2 m away who faces the sensor; the values are constructed from average
    /// proportions.
    fn table() -> String {
        let joints: [(&str, [f32; 3]); 25] = [
            ("SpineBase", [0.0, 2.0, -0.05]),
            ("SpineMid", [0.0, 2.0, 0.25]),
            ("Neck", [0.0, 2.0, 0.53]),
            ("Head", [0.0, 2.0, 0.7]),
            ("ShoulderLeft", [0.18, 2.0, 0.42]),
            ("ElbowLeft", [0.2, 2.0, 0.14]),
            ("WristLeft", [0.22, 1.98, -0.1]),
            ("HandLeft", [0.22, 1.97, -0.18]),
            ("ShoulderRight", [-0.18, 2.0, 0.42]),
            ("ElbowRight", [-0.2, 2.0, 0.14]),
            ("WristRight", [-0.22, 1.98, -0.1]),
            ("HandRight", [-0.22, 1.97, -0.18]),
            ("HipLeft", [0.09, 2.0, -0.08]),
            ("KneeLeft", [0.1, 1.99, -0.5]),
            ("AnkleLeft", [0.1, 2.0, -0.92]),
            ("FootLeft", [0.11, 1.88, -0.98]),
            ("HipRight", [-0.09, 2.0, -0.08]),
            ("KneeRight", [-0.1, 1.99, -0.5]),
            ("AnkleRight", [-0.1, 2.0, -0.92]),
            ("FootRight", [-0.11, 1.88, -0.98]),
            ("SpineShoulder", [0.0, 2.0, 0.46]),
            ("HandTipLeft", [0.22, 1.96, -0.24]),
            ("ThumbLeft", [0.2, 1.95, -0.15]),
            ("HandTipRight", [-0.22, 1.96, -0.24]),
            ("ThumbRight", [-0.2, 1.95, -0.15]),
        ];
        let mut names = Vec::new();
        let mut row = Vec::new();
        for (axis, letter) in ["X", "Y", "Z"].iter().enumerate() {
            for (name, position) in &joints {
                names.push(format!("{name}_{letter}"));
                row.push(position[axis].to_string());
            }
        }
        let row = row.join(",");
        format!("{}\n{row}\n{row}\n", names.join(","))
    }

    #[test]
    fn a_standing_person_keeps_place_size_and_sides() {
        let loaded = load_motion(Path::new("kinect.csv"), table().as_bytes()).unwrap();
        assert_eq!((loaded.format, loaded.frames), ("kinect-csv", 2));
        // A leg of 0.84 m from hip to ankle corresponds to a person of about 1.75 m.
        assert!((loaded.height_m - 1.75).abs() < 0.15, "{}", loaded.height_m);
        let root = loaded.motion.poses[0].root_in_world;
        assert!((root.x).abs() < 1e-3 && (root.y - 2.0).abs() < 1e-3);
        // The motion is grounded: the pelvis is one leg length above the floor.
        assert!((0.8..1.1).contains(&root.z), "{}", root.z);
        let joints = kinect_joints("t", table().as_bytes()).unwrap();
        assert!(joints[0][Joint::LeftWrist as usize].x > 0.2);
    }

    #[test]
    fn damage_is_named_with_its_line() {
        let good = table();
        let text = |text: String| match kinect_joints("t", text.as_bytes()).unwrap_err() {
            MotionError::Text { line, .. } => line,
            other => panic!("{other}"),
        };
        assert_eq!(text(good.replace("Neck_Z", "Neck_W")), 1);
        assert_eq!(text(good.replacen("0.53", "nan", 1)), 2);
        assert_eq!(text(format!("{good}1,2,3\n")), 4);
    }
}
