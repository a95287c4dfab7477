//! Loaders against closed forms, against each other, against hostile bytes and real recordings.

use super::source::SourceMotion;
use super::{LoadedMotion, bvh, load_asf_amc, load_motion, load_motion_file, names};
use crate::proportions::canonical_skeleton;
use glam::{Quat, Vec3};
use proptest::prelude::*;
use radarllm_base::frames::world_from_rest_facing_radar;
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::{Joint, Motion, Pose};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// A T-pose person in centimetres: name, parent, offset (y up, facing z, left at +x).
const PERSON: [(&str, i32, [f32; 3]); 18] = [
    ("Hips", -1, [0.0, 95.0, 0.0]),
    ("LeftUpLeg", 0, [9.0, -5.0, 0.0]),
    ("LeftLeg", 1, [0.0, -42.0, 0.0]),
    ("LeftFoot", 2, [0.0, -40.0, 0.0]),
    ("LeftToeBase", 3, [0.0, -5.0, 13.0]),
    ("RightUpLeg", 0, [-9.0, -5.0, 0.0]),
    ("RightLeg", 5, [0.0, -42.0, 0.0]),
    ("RightFoot", 6, [0.0, -40.0, 0.0]),
    ("RightToeBase", 7, [0.0, -5.0, 13.0]),
    ("Spine", 0, [0.0, 12.0, 0.0]),
    ("Spine1", 9, [0.0, 25.0, 0.0]),
    ("Head", 10, [0.0, 25.0, 2.0]),
    ("LeftArm", 10, [17.0, 12.0, 0.0]),
    ("LeftForeArm", 12, [27.0, 0.0, 0.0]),
    ("LeftHand", 13, [25.0, 0.0, 0.0]),
    ("RightArm", 10, [-17.0, 12.0, 0.0]),
    ("RightForeArm", 15, [-27.0, 0.0, 0.0]),
    ("RightHand", 16, [-25.0, 0.0, 0.0]),
];

/// Angles in degrees of the moving joints of [`PERSON`] in frame `t`: (joint, axis, angle).
fn bends(t: usize) -> [(usize, usize, f32); 4] {
    let s = (t as f32 * 0.4).sin();
    [
        (2, 0, 50.0 + 30.0 * s),
        (13, 1, -70.0 + 20.0 * s),
        (12, 2, -30.0 * s),
        (0, 1, 40.0 + 5.0 * t as f32),
    ]
}

/// The person as BVH. `z_up` writes the same motion with z up and y backwards.
fn person_bvh(n_frames: usize, z_up: bool) -> String {
    // y-up to z-up: (x, y, z) -> (x, -z, y).
    let turn = |v: [f32; 3]| if z_up { [v[0], -v[2], v[1]] } else { v };
    let mut text = String::from("HIERARCHY\n");
    let mut depth = 0;
    let mut open: Vec<i32> = Vec::new();
    for (i, (name, parent, offset)) in PERSON.iter().enumerate() {
        while open.last().is_some_and(|last| last != parent) {
            text.push_str("}\n");
            open.pop();
        }
        let [x, y, z] = turn(*offset);
        let kind = if *parent < 0 { "ROOT" } else { "JOINT" };
        let channels = if *parent < 0 {
            "6 Xposition Yposition Zposition"
        } else {
            "3"
        };
        writeln!(text, "{kind} {name}\n{{\nOFFSET {x} {y} {z}\nCHANNELS {channels} Zrotation Xrotation Yrotation").unwrap();
        let is_leaf = !PERSON.iter().any(|(_, p, _)| *p == i as i32);
        if is_leaf {
            text.push_str("End Site\n{\nOFFSET 0 0 1\n}\n");
        }
        open.push(i as i32);
        depth = depth.max(open.len());
    }
    text.push_str(&"}\n".repeat(open.len()));
    writeln!(text, "MOTION\nFrames: {n_frames}\nFrame Time: 0.0333333").unwrap();
    for t in 0..n_frames {
        let [x, y, z] = turn([30.0 + t as f32, 95.0, 7.0]);
        write!(text, "{x} {y} {z}").unwrap();
        for joint in 0..PERSON.len() {
            let mut angles = [0.0; 3];
            for (j, axis, angle) in bends(t) {
                if j == joint {
                    angles[axis] = angle;
                }
            }
            if z_up {
                angles = [angles[0], -angles[2], angles[1]];
            }
            // One angle per joint at a time, so the order does not matter.
            write!(text, " {} {} {}", angles[2], angles[0], angles[1]).unwrap();
        }
        text.push('\n');
    }
    text
}

/// The same person and motion as ASF and AMC, in CMU units.
fn person_asf_amc(n_frames: usize) -> (String, String) {
    let unit = 100.0 * 0.0254 / 0.45;
    let mut asf = String::from(
        ":version 1.10\n:name test\n:units\n mass 1.0\n length 0.45\n angle deg\n:root\n order TX TY TZ RX RY RZ\n axis XYZ\n position 0 0 0\n orientation 0 0 0\n:bonedata\n",
    );
    let mut hierarchy = String::from(":hierarchy\n begin\n");
    // A bone runs from its joint to the child's; joints with several children get helper bones.
    let asf_name = |i: usize| {
        if i == 0 {
            "root".to_owned()
        } else {
            PERSON[i].0.to_owned()
        }
    };
    for (i, (_, parent, offset)) in PERSON.iter().enumerate().skip(1) {
        let v = Vec3::from_array(*offset) / unit;
        let d = v.normalize();
        // Helper from the parent's joint to this joint, then the joint as a bone of no length.
        writeln!(
            asf,
            " begin\n id {i}\n name to{i}\n direction {} {} {}\n length {}\n axis 0 0 0 XYZ\n end",
            d.x,
            d.y,
            d.z,
            v.length()
        )
        .unwrap();
        writeln!(
            asf,
            " begin\n id {}\n name {}\n direction 0 1 0\n length 0\n axis 20 30 40 XYZ\n dof rx ry rz\n limits (0 1)\n end",
            i + 100,
            asf_name(i)
        )
        .unwrap();
        writeln!(
            hierarchy,
            " {} to{i}\n to{i} {}",
            asf_name(*parent as usize),
            asf_name(i)
        )
        .unwrap();
    }
    asf.push_str(&hierarchy);
    asf.push_str(" end\n");

    let axis = Quat::from_rotation_z(40_f32.to_radians())
        * Quat::from_rotation_y(30_f32.to_radians())
        * Quat::from_rotation_x(20_f32.to_radians());
    let mut amc = String::from("#!OML:ASF\n:FULLY-SPECIFIED\n:DEGREES\n");
    for t in 0..n_frames {
        writeln!(amc, "{}", t + 1).unwrap();
        for i in 0..PERSON.len() {
            let mut local = Quat::IDENTITY;
            for (j, a, angle) in bends(t) {
                if j == i {
                    local = super::source::rotation_about(a as u8, angle.to_radians());
                }
            }
            // Undo the bone's axis frame: M = C^-1 L C, written as fixed axes X, Y, Z.
            let m = if i == 0 {
                local
            } else {
                axis.conjugate() * local * axis
            };
            let (z, y, x) = m.to_euler(glam::EulerRot::ZYX);
            let [x, y, z] = [x, y, z].map(f32::to_degrees);
            if i == 0 {
                let p = Vec3::new(30.0 + t as f32, 95.0, 7.0) / unit;
                writeln!(amc, "root {} {} {} {x} {y} {z}", p.x, p.y, p.z).unwrap();
            } else {
                writeln!(amc, "{} {x} {y} {z}", asf_name(i)).unwrap();
            }
        }
    }
    (asf, amc)
}

fn load_text(name: &str, text: &str) -> LoadedMotion {
    load_motion(Path::new(name), text.as_bytes()).unwrap_or_else(|e| panic!("{e}"))
}

/// World positions by a second, independent forward kinematics of [`PERSON`], m, z up.
fn expected_joints(t: usize) -> Vec<Vec3> {
    let mut positions: Vec<Vec3> = Vec::new();
    let mut rotations: Vec<glam::Mat3> = Vec::new();
    for (i, (_, parent, offset)) in PERSON.iter().enumerate() {
        let mut local = glam::Mat3::IDENTITY;
        for (j, axis, angle) in bends(t) {
            if j == i {
                let (s, c) = angle.to_radians().sin_cos();
                let rows = match axis {
                    0 => [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]],
                    1 => [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]],
                    _ => [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]],
                };
                local = glam::Mat3::from_cols_array_2d(&rows).transpose();
            }
        }
        if *parent < 0 {
            positions.push(Vec3::new(30.0 + t as f32, 95.0, 7.0));
            rotations.push(local);
        } else {
            let p = *parent as usize;
            positions.push(positions[p] + rotations[p] * Vec3::from_array(*offset));
            rotations.push(rotations[p] * local);
        }
    }
    positions
        .into_iter()
        .map(|p| Vec3::new(p.x, -p.z, p.y) * 0.01)
        .collect()
}

/// SMPL-X joints and the entries of [`PERSON`] they come from.
const CHECKED: [(Joint, usize); 17] = [
    (Joint::LeftHip, 1),
    (Joint::LeftKnee, 2),
    (Joint::LeftAnkle, 3),
    (Joint::LeftFoot, 4),
    (Joint::RightHip, 5),
    (Joint::RightKnee, 6),
    (Joint::RightAnkle, 7),
    (Joint::RightFoot, 8),
    (Joint::Spine1, 9),
    (Joint::Spine3, 10),
    (Joint::Head, 11),
    (Joint::LeftShoulder, 12),
    (Joint::LeftElbow, 13),
    (Joint::LeftWrist, 14),
    (Joint::RightShoulder, 15),
    (Joint::RightElbow, 16),
    (Joint::RightWrist, 17),
];

fn worst_joint_error_m(motion: &Motion, without: Option<Joint>) -> f32 {
    let mut worst = 0.0_f32;
    for (t, pose) in motion.poses.iter().enumerate() {
        let (seen, _) = motion.skeleton.forward(pose);
        let wanted = expected_joints(t);
        for (joint, i) in CHECKED.into_iter().filter(|(j, _)| Some(*j) != without) {
            let error = (seen[joint as usize] - seen[0]) - (wanted[i] - wanted[0]);
            worst = worst.max(error.length());
        }
    }
    worst
}

#[test]
fn bvh_joints_land_where_forward_kinematics_says() {
    let loaded = load_text("person.bvh", &person_bvh(12, false));
    assert_eq!(
        (loaded.format, loaded.frames, loaded.fps),
        ("bvh", 12, 30.0)
    );
    assert_eq!((loaded.n_source_joints, loaded.metres_per_unit), (18, 0.01));
    assert_eq!(loaded.unit, "centimetre");
    // Head joint 157 cm, toes 3 cm over the file's zero: 154 cm between them are 88.5 % of the height.
    assert!(
        (loaded.height_m - 1.54 / 0.885).abs() < 0.01,
        "{}",
        loaded.height_m
    );
    // Every bone is rigid here: only f32 rounding of sums over chains remains.
    let worst = worst_joint_error_m(&loaded.motion, None);
    assert!(worst < 1e-3, "{worst}");
    // End sites, and what is filled in, are named.
    assert_eq!(
        loaded
            .skipped
            .iter()
            .filter(|s| s.starts_with("end site"))
            .count(),
        5
    );
    assert!(loaded.warnings.iter().any(|w| w.contains("left_collar")));
    // The toes are the lowest part; their soles lie on the floor.
    let (p, _) = loaded.motion.skeleton.forward(&loaded.motion.poses[0]);
    assert!(p.iter().map(|p| p.z).fold(f32::MAX, f32::min) > 0.0);
}

#[test]
fn vertical_axis_is_found() {
    let y_up = load_text("person.bvh", &person_bvh(12, false));
    let z_up = load_text("person.bvh", &person_bvh(12, true));
    for (a, b) in y_up
        .motion
        .joints_in_world()
        .iter()
        .zip(z_up.motion.joints_in_world())
    {
        for (p, q) in a.iter().zip(b) {
            // The same numbers through other axes.
            assert!(p.distance(q) < 1e-3, "{p} {q}");
        }
    }
}

#[test]
fn asf_amc_and_bvh_of_one_motion_agree() {
    let (asf, amc) = person_asf_amc(12);
    let loaded = load_asf_amc(asf.as_bytes(), amc.as_bytes()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(
        (loaded.format, loaded.frames, loaded.fps),
        ("asf-amc", 12, 120.0)
    );
    assert!((loaded.metres_per_unit - 0.056_444).abs() < 1e-6);
    // Angles are printed with seven digits; rigid bones otherwise. The first joint of the spine is
    // the helper bone here, which starts on the pelvis and is moved up half its length.
    let worst = worst_joint_error_m(&loaded.motion, Some(Joint::Spine1));
    assert!(worst < 2e-3, "{worst}");
}

#[test]
fn inner_position_channels_replace_the_offset() {
    // The knee is written 10 cm below its OFFSET by a position channel on every frame.
    let text = person_bvh(3, false);
    let plain = load_text("a.bvh", &text);
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let knee = lines.iter().position(|l| l == "JOINT LeftLeg").unwrap();
    lines[knee + 3] = "CHANNELS 4 Yposition Zrotation Xrotation Yrotation".into();
    let start = lines
        .iter()
        .position(|l| l.starts_with("Frame Time"))
        .unwrap()
        + 1;
    for line in &mut lines[start..] {
        let mut words: Vec<&str> = line.split(' ').collect();
        // Root 6 columns, left hip 3, then the knee.
        words.insert(9, "-52");
        *line = words.join(" ");
    }
    let moved = load_text("a.bvh", &lines.join("\n"));
    let length = |m: &LoadedMotion| m.motion.skeleton.offsets[Joint::LeftKnee as usize].length();
    // 42 cm by the offset, 52 cm by the channel; added, they would make 94 cm.
    assert!((length(&plain) - 0.42).abs() < 1e-4 && (length(&moved) - 0.52).abs() < 1e-4);
}

#[test]
fn identity_is_the_t_pose_facing_forward() {
    let mut text = person_bvh(1, false);
    let at = text.find("Frame Time").unwrap();
    text.truncate(at);
    text.push_str("Frame Time: 0.01\n");
    text.push_str(&"0 ".repeat(3 + 18 * 3));
    let loaded = load_text("rest.bvh", &text);
    let pose = &loaded.motion.poses[0];
    assert!(pose.rotations[0].angle_between(world_from_rest_facing_radar()) < 1e-3);
    for joint in Joint::ALL.into_iter().skip(1) {
        let angle = pose.rotations[joint as usize].angle_between(Quat::IDENTITY);
        // The rig's straight limbs differ from the canonical slopes by at most 15 degrees.
        assert!(angle < 0.27, "{} {angle}", joint.name());
    }
}

#[test]
fn broken_bvh_files_name_the_line() {
    let good = person_bvh(3, false);
    for (bad, hint) in [
        (String::new(), "HIERARCHY"),
        (good.replace("Frames: 3", "Frames: 4"), "4 frames"),
        (good.replace("Frames: 3", "Frames: 99999999999"), "frames"),
        (good.replace("Frames: 3", "Frames: 0"), "frames"),
        (
            good.replace("Frame Time: 0.0333333", "Frame Time: 0"),
            "frame time",
        ),
        (
            good.replace("Frame Time: 0.0333333", "Frame Time: nan"),
            "usable",
        ),
        (good.replace("OFFSET 9 -5 0", "OFFSET 9 inf 0"), "usable"),
        (good.replace("OFFSET 9 -5 0", "OFFSET 9 1e30 0"), "usable"),
        (
            good.replace("OFFSET 9 -5 0", "OFFSET 9 x 0"),
            "expected offset",
        ),
        (
            "HIERARCHY ROOT a\n{ ".to_owned() + &"JOINT b\n{ ".repeat(5000),
            "nested",
        ),
        (good[..good.len() / 3].to_owned(), "end of the file"),
    ] {
        let error = load_motion(Path::new("bad.bvh"), bad.as_bytes())
            .unwrap_err()
            .to_string();
        assert!(
            error.contains(hint) && error.contains("bad.bvh"),
            "{error} should mention {hint}"
        );
    }
    let pickle = load_motion(Path::new("x.pkl"), b"\x80\x04abc")
        .unwrap_err()
        .to_string();
    assert!(pickle.contains("never executed"), "{pickle}");
}

/// An npy file of little-endian f64.
fn npy(shape: &[usize], values: &[f64]) -> Vec<u8> {
    npy_bytes(
        "<f8",
        shape,
        &values
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect::<Vec<u8>>(),
    )
}

fn npy_bytes(descr: &str, shape: &[usize], data: &[u8]) -> Vec<u8> {
    let dims: String = shape.iter().map(|d| format!("{d},")).collect();
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({dims}), }}");
    while (header.len() + 11) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend((header.len() as u16).to_le_bytes());
    out.extend(header.as_bytes());
    out.extend(data);
    out
}

fn npz(members: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, data) in members {
        writer
            .start_file(
                format!("{name}.npy"),
                zip::write::SimpleFileOptions::default(),
            )
            .unwrap();
        writer.write_all(data).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

/// A motion with bent limbs on the canonical skeleton.
fn sample_motion() -> Motion {
    let poses = (0..6)
        .map(|t| {
            let a = 0.15 * t as f32;
            let mut rotations = [Quat::IDENTITY; N_JOINTS];
            rotations[0] = Quat::from_rotation_z(0.3 + a) * world_from_rest_facing_radar();
            rotations[Joint::LeftHip as usize] = Quat::from_rotation_x(-0.6 - a);
            rotations[Joint::LeftKnee as usize] = Quat::from_rotation_x(0.9 + a);
            rotations[Joint::LeftShoulder as usize] = Quat::from_rotation_z(-1.0 + a);
            rotations[Joint::LeftElbow as usize] = Quat::from_rotation_y(-1.2 + a);
            rotations[Joint::Spine2 as usize] = Quat::from_rotation_y(0.2 + a);
            Pose {
                root_in_world: Vec3::new(0.1 * t as f32, -0.2, 0.93),
                rotations,
            }
        })
        .collect();
    Motion {
        fps: 20.0,
        skeleton: canonical_skeleton(1.72),
        poses,
    }
}

fn amass_members(motion: &Motion) -> Vec<(&'static str, Vec<u8>)> {
    let n = motion.len();
    let mut poses = Vec::new();
    let mut trans = Vec::new();
    for pose in &motion.poses {
        for q in pose.rotations {
            poses.extend((q.to_scaled_axis()).to_array().map(f64::from));
        }
        poses.extend([0.01; 90]);
        trans.extend(pose.root_in_world.to_array().map(f64::from));
    }
    let text: Vec<u8> = "male"
        .chars()
        .flat_map(|c| (c as u32).to_le_bytes())
        .collect();
    vec![
        ("poses", npy(&[n, 156], &poses)),
        ("trans", npy(&[n, 3], &trans)),
        ("betas", npy(&[16], &[0.1; 16])),
        ("gender", npy_bytes("<U4", &[], &text)),
        ("mocap_framerate", npy(&[], &[120.0])),
        ("dmpls", npy(&[n, 8], &vec![0.0; n * 8])),
        ("labels", npy_bytes("|O", &[1], b"\x80\x04K\x01.")),
    ]
}

#[test]
fn amass_rotations_arrive_unchanged() {
    let motion = sample_motion();
    let loaded = load_motion(Path::new("a.npz"), &npz(&amass_members(&motion))).unwrap();
    assert_eq!(
        (loaded.format, loaded.frames, loaded.fps),
        ("amass-npz", 6, 120.0)
    );
    assert_eq!(loaded.n_source_joints, 52);
    for (a, b) in loaded.motion.poses.iter().zip(&motion.poses) {
        for (p, q) in a.rotations.iter().zip(&b.rotations) {
            // f32 rounding through sine and cosine; angle_between itself resolves 1e-3.
            assert!(p.angle_between(*q) < 2e-3);
        }
        // Only the floor moves.
        assert!((a.root_in_world - b.root_in_world).truncate().length() < 1e-6);
    }
    assert!(
        loaded
            .skipped
            .iter()
            .any(|s| s.starts_with("labels (pickled")),
        "{:?}",
        loaded.skipped
    );
    assert!(loaded.skipped.iter().any(|s| s.starts_with("dmpls")));
    assert!(loaded.warnings.iter().any(|w| w.contains("male")));
}

/// The same rotations in every form in which people store them.
#[test]
fn archives_with_the_root_and_the_body_apart_give_the_same_motion() {
    let motion = sample_motion();
    let n = motion.len();
    let axis_angles = |joints: std::ops::Range<usize>| -> Vec<f64> {
        let of_frame = |pose: &Pose| -> Vec<f64> {
            let rotations = &pose.rotations[joints.clone()];
            let axes = rotations.iter().map(|q| q.to_scaled_axis().to_array());
            axes.flatten().map(f64::from).collect()
        };
        motion.poses.iter().flat_map(of_frame).collect()
    };
    // Values of hands after those of the body in each frame.
    let with_hands = |body: &[f64], n_body: usize, n_hands: usize| -> Vec<f64> {
        let rows = body.chunks_exact(n_body);
        rows.flat_map(|row| [row, &vec![0.2; n_hands]].concat())
            .collect()
    };
    let (root, body, both) = (axis_angles(0..1), axis_angles(1..22), axis_angles(0..22));
    let trans = || {
        let values: Vec<f64> = (motion.poses.iter())
            .flat_map(|p| p.root_in_world.to_array().map(f64::from))
            .collect();
        npy(&[n, 3], &values)
    };
    let rate = || npy(&[], &[30.0]);
    let hands = npy(&[n, 90], &vec![0.1; 90 * n]);
    /// Number of joints in the file, and its members.
    type Form = (usize, Vec<(&'static str, Vec<u8>)>);
    let forms: Vec<Form> = vec![
        (
            22,
            vec![
                ("root_orient", npy(&[n, 3], &root)),
                ("pose_body", npy(&[n, 63], &body)),
                ("pose_hand", hands),
                ("trans", trans()),
                ("fps", rate()),
            ],
        ),
        (
            24,
            vec![
                ("global_orient", npy(&[n, 1, 3], &root)),
                ("body_pose", npy(&[n, 69], &with_hands(&body, 63, 6))),
                ("transl", trans()),
                ("mocap_frame_rate", rate()),
            ],
        ),
        (
            22,
            vec![
                ("root_orient", npy(&[n, 3], &root)),
                ("pose_body", npy(&[n, 21, 3], &body)),
                ("trans", trans()),
                ("fps", rate()),
            ],
        ),
        (
            52,
            vec![
                ("poses", npy(&[n, 52, 3], &with_hands(&both, 66, 90))),
                ("trans", trans()),
                ("fps", rate()),
            ],
        ),
        (
            22,
            vec![
                ("poses", npy(&[n, 22, 3], &both)),
                ("trans", trans()),
                ("fps", rate()),
            ],
        ),
    ];
    for (n_joints, members) in forms {
        let loaded = load_motion(Path::new("a.npz"), &npz(&members)).unwrap();
        assert_eq!((loaded.n_source_joints, loaded.fps), (n_joints, 30.0));
        assert_eq!(loaded.frames, n);
        for (a, b) in loaded.motion.poses.iter().zip(&motion.poses) {
            for (p, q) in a.rotations.iter().zip(&b.rotations) {
                assert!(p.angle_between(*q) < 2e-3);
            }
            assert!((a.root_in_world - b.root_in_world).truncate().length() < 1e-6);
        }
    }
}

#[test]
fn archives_without_a_pose_list_what_they_have() {
    let error = |members: &[(&str, Vec<u8>)]| {
        load_motion(Path::new("a.npz"), &npz(members))
            .unwrap_err()
            .to_string()
    };
    let rows = |shape: &[usize]| npy(shape, &vec![0.1; shape.iter().product()]);
    let text = error(&[
        ("trans", rows(&[6, 3])),
        ("joints", rows(&[6, 22, 3])),
        ("contacts", rows(&[6, 22])),
        ("labels", npy_bytes("|O", &[1], b"\x80\x04K\x01.")),
        ("pose_body", rows(&[6, 63])),
    ]);
    for part in [
        "poses, or root_orient or global_orient with pose_body or body_pose",
        "`joints`",
        "`contacts`",
        "`labels (pickled objects",
        "`pose_body`",
        "`trans`",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    // Members of other shapes are named with the shape that is expected.
    for (root, body, part) in [
        (&[6, 3][..], &[6, 21, 3, 3][..], "pose_body"),
        (&[6, 3], &[6, 60], "or (frames, 21, 3)"),
        (&[5, 3], &[6, 63], "5 frames as in root_orient"),
        (&[6, 6], &[6, 63], "the rotation of the root alone"),
        (&[0, 3], &[0, 63], "root_orient"),
        (&[3], &[63], "root_orient"),
    ] {
        let text = error(&[
            ("root_orient", rows(root)),
            ("pose_body", rows(body)),
            ("trans", rows(&[6, 3])),
            ("fps", npy(&[], &[30.0])),
        ]);
        assert!(text.contains(part), "{part}: {text}");
    }
    let text = error(&[
        ("poses", rows(&[6, 22, 3])),
        ("translation", rows(&[6, 3])),
        ("fps", npy(&[], &[30.0])),
    ]);
    assert!(
        text.contains("trans or transl") && text.contains("`translation`"),
        "{text}"
    );
}

#[test]
fn bad_amass_archives_are_refused_by_member() {
    let motion = sample_motion();
    let replace = |name: &str, data: Vec<u8>| {
        let mut members = amass_members(&motion);
        members.iter_mut().find(|(n, _)| *n == name).unwrap().1 = data;
        load_motion(Path::new("a.npz"), &npz(&members))
            .unwrap_err()
            .to_string()
    };
    let error = replace("poses", npy_bytes("|O", &[1], b"\x80\x04K\x01."));
    assert!(
        error.contains("poses") && error.contains("never read"),
        "{error}"
    );
    // A shape that promises more than the member holds.
    let error = replace("poses", npy_bytes("<f8", &[1 << 40, 156], &[0; 64]));
    assert!(
        error.contains("poses") && error.contains("bytes"),
        "{error}"
    );
    let error = replace("trans", npy(&[5, 3], &[0.0; 15]));
    assert!(
        error.contains("trans") && error.contains("[6, 3]"),
        "{error}"
    );
    let error = replace("trans", npy(&[6, 3], &[f64::NAN; 18]));
    assert!(error.contains("trans") && error.contains("NaN"), "{error}");
    let error = replace("mocap_framerate", npy(&[], &[0.0]));
    assert!(error.contains("mocap_framerate"), "{error}");
}

#[test]
fn humanml3d_joints_come_back_through_inverse_kinematics() {
    let motion = sample_motion();
    let joints = motion.joints_in_world();
    let values: Vec<f64> = joints
        .iter()
        .flatten()
        .flat_map(|p| [f64::from(p.x), f64::from(p.z), f64::from(-p.y)])
        .collect();
    let f64_file = npy(&[6, 22, 3], &values);
    let f32_file = npy_bytes(
        "<f4",
        &[6, 22, 3],
        &values
            .iter()
            .flat_map(|v| (*v as f32).to_le_bytes())
            .collect::<Vec<u8>>(),
    );
    for bytes in [f64_file, f32_file] {
        let loaded = load_motion(Path::new("000001.npy"), &bytes).unwrap();
        assert_eq!(
            (loaded.format, loaded.frames, loaded.fps),
            ("humanml3d-npy", 6, 20.0)
        );
        for (a, b) in loaded.motion.joints_in_world().iter().zip(&joints) {
            for (p, q) in a.iter().zip(b) {
                // The trunk twist of the source sits in one spine joint and is spread here; the
                // bones themselves point exactly. A floor shift of a few millimetres is removed.
                assert!(((*p - a[0]) - (*q - b[0])).length() < 5e-3);
            }
        }
        assert!((loaded.height_m - 1.72).abs() < 0.02, "{}", loaded.height_m);
    }
    let error = load_motion(Path::new("x.npy"), &npy(&[2, 21, 3], &[0.0; 126]))
        .unwrap_err()
        .to_string();
    assert!(error.contains("22, 3"), "{error}");
}

#[test]
fn humanml3d_vectors_give_the_joints_of_their_motion() {
    let mut motion = crate::sample::resample(&sample_motion(), 20.0).unwrap();
    crate::sample::canonicalize(&mut motion);
    let features = crate::features::humanml3d_features(&motion);
    let values: Vec<f64> = features.iter().map(|v| f64::from(*v)).collect();
    let loaded = load_motion(Path::new("v.npy"), &npy(&[5, 263], &values)).unwrap();
    assert_eq!(loaded.frames, 5);
    for (a, b) in loaded
        .motion
        .joints_in_world()
        .iter()
        .zip(motion.joints_in_world())
    {
        // Distances between joints do not depend on the heading, which the features drop.
        for j in 1..N_JOINTS {
            let (seen, wanted) = ((a[j] - a[0]).length(), (b[j] - b[0]).length());
            assert!((seen - wanted).abs() < 5e-3, "{j} {seen} {wanted}");
        }
    }
}

fn is_finite(motion: &Motion) -> bool {
    motion.fps.is_finite()
        && motion.skeleton.offsets.iter().all(|v| v.is_finite())
        && motion
            .poses
            .iter()
            .all(|p| p.root_in_world.is_finite() && p.rotations.iter().all(|q| q.is_finite()))
}

/// Applies byte changes and a cut to a valid file.
fn mutate(
    bytes: &[u8],
    changes: &[(prop::sample::Index, u8)],
    keep: prop::sample::Index,
    cut: bool,
) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for (at, value) in changes {
        let i = at.index(out.len());
        out[i] = *value;
    }
    if cut {
        out.truncate(keep.index(out.len() + 1));
    }
    out
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_files_never_panic_and_never_give_non_finite_motion(
        // Printable bytes hit text parsers harder than random ones: digits, signs, braces.
        changes in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![any::<u8>(), prop::sample::select(b"0129-+.eE{}naif \n".to_vec())]), 0..6),
        keep in any::<prop::sample::Index>(),
        cut in any::<bool>(),
        which in 0_usize..5,
    ) {
        let (asf, amc) = person_asf_amc(2);
        let motion = sample_motion();
        let result = match which {
            0 => load_motion(Path::new("a.bvh"), &mutate(person_bvh(4, false).as_bytes(), &changes, keep, cut)),
            1 => load_asf_amc(&mutate(asf.as_bytes(), &changes, keep, cut), amc.as_bytes()),
            2 => load_asf_amc(asf.as_bytes(), &mutate(amc.as_bytes(), &changes, keep, cut)),
            3 => load_motion(Path::new("a.npz"), &mutate(&npz(&amass_members(&motion)), &changes, keep, cut)),
            _ => {
                let values: Vec<f64> = motion.joints_in_world().iter().flatten().flat_map(|p| p.to_array().map(f64::from)).collect();
                load_motion(Path::new("a.npy"), &mutate(&npy(&[6, 22, 3], &values), &changes, keep, cut))
            }
        };
        if let Ok(loaded) = result {
            prop_assert!(is_finite(&loaded.motion));
            prop_assert!(loaded.height_m.is_finite() && !loaded.motion.is_empty());
        }
    }

    #[test]
    fn random_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..200), which in 0_usize..5) {
        let name = ["a.bvh", "a.npz", "a.npy", "a", "a.asf"][which];
        let head: &[u8] = [&b"HIERARCHY\n"[..], b"PK\x03\x04", b"\x93NUMPY\x01\x00", b"", b":version"][which];
        let file = [head, &bytes].concat();
        prop_assert!(load_motion(Path::new(name), &file).is_err());
    }
}

/// Folder of recorded data; tests that need it say so and return when it is not there.
fn shared(path: &str) -> Option<PathBuf> {
    let root = std::env::var_os("RADARLLM_SHARED")
        .map(PathBuf::from)
        .unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared"));
    let full = root.join("data").join(path);
    if full.exists() {
        return Some(full);
    }
    println!("skipped: no recorded data at {}", full.display());
    None
}

/// Largest and mean distance between retargeted and source joints seen from the pelvis, m, and the
/// largest angle between elbow-to-wrist and knee-to-ankle directions, degrees.
fn residuals(source: &SourceMotion, loaded: &LoadedMotion) -> (f32, f32, f32) {
    let mut pose = source.blank();
    let all = vec![true; source.joints.len()];
    source.forward(0, &all, &mut pose);
    let lengths: Vec<f32> = source
        .joints
        .iter()
        .zip(&pose.positions)
        .map(|(j, p)| {
            j.parent
                .map_or(0.0, |parent| p.distance(pose.positions[parent]))
        })
        .collect();
    let map = names::map_joints(source, &lengths);
    let start = source.n_frames - loaded.frames;
    let scale = loaded.metres_per_unit as f32;
    let (mut worst, mut sum, mut count, mut worst_deg) = (0.0_f32, 0.0_f64, 0_usize, 0.0_f32);
    for (t, result) in loaded.motion.poses.iter().enumerate().step_by(5) {
        source.forward(start + t, &all, &mut pose);
        // All recordings here have y up.
        let at = |s: usize| {
            let p = pose.positions[s] * scale;
            Vec3::new(p.x, -p.z, p.y)
        };
        let (seen, _) = loaded.motion.skeleton.forward(result);
        let wanted: Vec<Option<Vec3>> = map.iter().map(|s| s.map(at)).collect();
        for joint in Joint::ALL {
            // Trunk joints that lie on their parent are moved on purpose.
            let moved = matches!(
                joint,
                Joint::Spine1
                    | Joint::Spine2
                    | Joint::Spine3
                    | Joint::Neck
                    | Joint::LeftCollar
                    | Joint::RightCollar
            );
            if let (Some(w), Some(w0), false) = (wanted[joint as usize], wanted[0], moved) {
                let error = ((seen[joint as usize] - seen[0]) - (w - w0)).length();
                worst = worst.max(error);
                sum += f64::from(error);
                count += 1;
            }
        }
        for (a, b) in [
            (Joint::LeftElbow, Joint::LeftWrist),
            (Joint::RightElbow, Joint::RightWrist),
            (Joint::LeftKnee, Joint::LeftAnkle),
            (Joint::RightKnee, Joint::RightAnkle),
        ] {
            if let (Some(from), Some(to)) = (wanted[a as usize], wanted[b as usize]) {
                let angle = (seen[b as usize] - seen[a as usize]).angle_between(to - from);
                worst_deg = worst_deg.max(angle.to_degrees());
            }
        }
    }
    (worst, (sum / count.max(1) as f64) as f32, worst_deg)
}

#[test]
fn bandai_namco_clips_keep_their_joint_positions() {
    let Some(folder) = shared("bandai-namco/samples") else {
        return;
    };
    let mut skeleton: Option<radarllm_base::Skeleton> = None;
    let mut n = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "bvh") {
            continue;
        }
        let bytes = std::fs::read(&path).unwrap();
        let loaded = load_motion_file(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(
            (loaded.unit.as_str(), loaded.fps, loaded.n_source_joints),
            ("centimetre", 30.0, 22)
        );
        let (source, ..) = bvh::parse_bvh("x", &bytes).unwrap();
        let (worst_m, mean_m, worst_deg) = residuals(&source, &loaded);
        // Every bone of this rig is rigid: rounding only.
        println!("{path:?}: worst {worst_m} m, mean {mean_m} m, {worst_deg} deg");
        assert!(
            worst_m < 0.01 && mean_m < 0.003 && worst_deg < 1.0,
            "{path:?} {worst_m} {mean_m} {worst_deg}"
        );
        // Standing clips: the data's own figures are 1.33 to 1.40 m for the head and 2.5 to 5.4 cm
        // for the lowest joint; dashing and old people stoop.
        let heights: Vec<[Vec3; N_JOINTS]> = loaded.motion.joints_in_world();
        let top = heights
            .iter()
            .map(|p| p[Joint::Head as usize].z)
            .fold(0.0, f32::max);
        let low = heights
            .iter()
            .flat_map(|p| p.iter().map(|p| p.z))
            .fold(f32::MAX, f32::min);
        assert!(
            (1.2..1.45).contains(&top) && (-0.02..0.06).contains(&low),
            "{path:?} {top} {low}"
        );
        // One rig, one calibration, whatever the clip shows: all clips measure the same person, whose
        // offsets the publishers made equal within 0.4 mm.
        match &skeleton {
            None => skeleton = Some(loaded.motion.skeleton.clone()),
            Some(first) => {
                for (a, b) in first.offsets.iter().zip(&loaded.motion.skeleton.offsets) {
                    assert!(a.distance(*b) < 2e-3, "{path:?} {a} {b}");
                }
            }
        }
        n += 1;
    }
    assert_eq!(n, 6);
}

#[test]
fn cmu_asf_amc_keeps_its_joint_positions_and_faces_forward() {
    let Some(path) = shared("fairmotion-tests/11_01.amc") else {
        return;
    };
    let loaded = load_motion_file(&path).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(
        (loaded.frames, loaded.fps, loaded.n_source_joints),
        (597, 120.0, 31)
    );
    assert!((1.5..1.9).contains(&loaded.height_m), "{}", loaded.height_m);
    let asf = super::asf::parse_asf(
        "11.asf",
        &std::fs::read(path.with_file_name("11.asf")).unwrap(),
    )
    .unwrap();
    let (source, ..) =
        super::asf::parse_amc("11_01.amc", &std::fs::read(&path).unwrap(), asf).unwrap();
    let (worst_m, mean_m, worst_deg) = residuals(&source, &loaded);
    println!("worst {worst_m} m, mean {mean_m} m, {worst_deg} deg");
    // Bones with fixed helper bones in between are rigid too: rounding, and the shift of joints
    // that coincide (lower back on the pelvis), which bends a few centimetres away.
    assert!(
        worst_m < 0.04 && mean_m < 0.02 && worst_deg < 1.0,
        "{worst_m} {mean_m} {worst_deg}"
    );
    // This person walks forward: travel and chest agree in direction on average.
    let mut agreement = 0.0;
    let mut travelled = 0.0;
    for pair in loaded.motion.poses.windows(2) {
        let step = pair[1].root_in_world - pair[0].root_in_world;
        let (_, q) = loaded.motion.skeleton.forward(&pair[0]);
        agreement += step.dot(q[Joint::Spine3 as usize] * Vec3::Z);
        travelled += step.length();
    }
    assert!(agreement > 0.8 * travelled, "{agreement} of {travelled}");
}

#[test]
fn formats_that_are_not_read_say_what_to_convert_them_to() {
    for (name, bytes, parts) in [
        ("a.c3d", &[2, 0x50, 0, 0][..], ["C3D", "save it as BVH"]),
        ("walk", &[2, 0x50, 0, 0], ["C3D", "markers"]),
        ("a.fbx", b"Kaydara FBX Binary  \0", ["FBX", "Blender"]),
        ("a.glb", b"glTF\x02\0\0\0", ["glTF", "BVH"]),
        ("a.vmd", b"Vocaloid Motion Data 0002", ["VMD", "BVH"]),
    ] {
        let error = load_motion(Path::new(name), bytes).unwrap_err().to_string();
        for part in parts {
            assert!(error.contains(part), "{part}: {error}");
        }
    }
}

#[test]
fn skeletons_that_are_not_recognised_are_refused_with_their_names() {
    if let Some(path) = shared("fairmotion-tests/sinusoidal.bvh") {
        let error = load_motion_file(&path).unwrap_err().to_string();
        assert!(error.contains("no person recognised"), "{error}");
    }
    let renamed = |n_known: usize| {
        let mut text = person_bvh(3, false);
        for (i, (name, ..)) in PERSON.iter().enumerate().skip(n_known) {
            for kind in ["ROOT", "JOINT"] {
                text = text.replace(&format!("{kind} {name}\n"), &format!("{kind} Knochen{i}\n"));
            }
        }
        load_motion(Path::new("a.bvh"), text.as_bytes())
            .unwrap_err()
            .to_string()
    };
    let error = renamed(0);
    for part in [
        "by the names of its 18 joints: none of them is known",
        "The joints are `Knochen0`, `Knochen1`",
    ] {
        assert!(error.contains(part), "{part}: {error}");
    }
    // Both legs, without a head and arms.
    let error = renamed(9);
    assert!(error.contains("known are only left_hip"), "{error}");
}

/// The person with the names of VRM moves as with those of MotionBuilder.
#[test]
fn names_of_vrm_give_the_same_motion() {
    let mut text = person_bvh(6, false);
    for (name, vrm) in [
        ("Hips", "C_Hips"),
        ("LeftUpLeg", "L_UpperLeg"),
        ("LeftLeg", "L_LowerLeg"),
        ("LeftFoot", "L_Foot"),
        ("LeftToeBase", "L_ToeBase"),
        ("RightUpLeg", "R_UpperLeg"),
        ("RightLeg", "R_LowerLeg"),
        ("RightFoot", "R_Foot"),
        ("RightToeBase", "R_ToeBase"),
        ("Spine", "C_Spine"),
        ("Spine1", "C_Chest"),
        ("Head", "C_Head"),
        ("LeftArm", "L_UpperArm"),
        ("LeftForeArm", "L_LowerArm"),
        ("LeftHand", "L_Hand"),
        ("RightArm", "R_UpperArm"),
        ("RightForeArm", "R_LowerArm"),
        ("RightHand", "R_Hand"),
    ] {
        for kind in ["ROOT", "JOINT"] {
            let (old, new) = (format!("{kind} {name}\n"), format!("{kind} J_Bip_{vrm}\n"));
            text = text.replace(&old, &new);
        }
    }
    let (vrm, plain) = (
        load_text("a.bvh", &text),
        load_text("a.bvh", &person_bvh(6, false)),
    );
    assert_eq!(vrm.motion, plain.motion);
}

/// Features of a recorded walk against the published mean and deviation of HumanML3D.
#[test]
fn features_of_a_walk_lie_within_the_published_distribution() {
    let (Some(walk), Some(mean)) = (
        shared("fairmotion-tests/11_01.amc"),
        shared("humanml3d/Mean.npy"),
    ) else {
        return;
    };
    let column = |path: &Path| {
        let array = radarllm_files::npy::NpyArray::new(std::fs::read(path).unwrap());
        array.unwrap().numbers().unwrap()
    };
    let (mean, std) = (column(&mean), column(&mean.with_file_name("Std.npy")));
    let features = crate::features::humanml3d_features(&load_motion_file(&walk).unwrap().motion);
    let mut inside = 0_usize;
    let mut total = 0_usize;
    for row in features.chunks_exact(263) {
        // Rotations (67..193) follow another inverse kinematics in the original.
        for c in (0..67).chain(193..259) {
            inside += usize::from((f64::from(row[c]) - mean[c]).abs() < 4.0 * std[c]);
            total += 1;
        }
    }
    // A wrong axis, sign or unit puts whole columns outside; people differ in size by a few per
    // cent, which some narrow columns (collars, hips) notice.
    println!("{inside} of {total} within four deviations");
    assert!(inside as f64 > 0.93 * total as f64, "{inside} of {total}");
}

/// Any further recordings: a folder of unpacked BVH and AMC files named by `RADARLLM_MOTIONS`.
#[test]
fn unpacked_recordings_load_and_keep_their_joint_positions() {
    let Some(root) = std::env::var_os("RADARLLM_MOTIONS").map(PathBuf::from) else {
        println!("skipped: RADARLLM_MOTIONS names no folder");
        return;
    };
    let mut folders = vec![root];
    let (mut n, mut worst_all, mut bad) = (0, 0.0_f32, Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let is_bvh = path.extension().is_some_and(|e| e == "bvh");
            if !is_bvh && path.extension().is_none_or(|e| e != "amc") {
                continue;
            }
            let loaded = load_motion_file(&path).unwrap_or_else(|e| panic!("{e}"));
            assert!(
                is_finite(&loaded.motion) && (1.2..2.1).contains(&loaded.height_m),
                "{path:?}"
            );
            n += 1;
            if is_bvh {
                let (source, ..) = bvh::parse_bvh("x", &std::fs::read(&path).unwrap()).unwrap();
                let (worst_m, mean_m, worst_deg) = residuals(&source, &loaded);
                worst_all = worst_all.max(worst_m);
                // CMU-like rigs bend lower back and lower neck in joints that SMPL-X lacks: people
                // who roll on the floor move the head by up to 16 cm so, walkers by 2 cm.
                if worst_m > 0.2 || mean_m > 0.03 || worst_deg > 3.0 {
                    bad.push(format!("{path:?} {worst_m} {mean_m} {worst_deg}"));
                }
            }
        }
    }
    println!("{n} files, worst joint {worst_all} m");
    assert!(
        bad.is_empty(),
        "{} of {n}: {:#?}",
        bad.len(),
        bad.iter().take(20).collect::<Vec<_>>()
    );
}

/// The trunk of the CMU database's conversion for MotionBuilder, in its names, with the offset of the joints above `Spine1`.
fn motionbuilder_trunk(above: &str) -> String {
    let joint = |name: &str, offset: &str, inner: &str| {
        format!(
            "JOINT {name}\n{{\nOFFSET {offset}\nCHANNELS 3 Zrotation Yrotation Xrotation\n{inner}}}\n"
        )
    };
    let end = "End Site\n{\nOFFSET 0 1 0\n}\n";
    let top: String = ["Neck", "LeftShoulder", "RightShoulder"]
        .map(|name| joint(name, above, end))
        .concat();
    let spine = joint("Spine", "0 2 0", &joint("Spine1", "0.1 2.1 0", &top));
    format!(
        "HIERARCHY\nROOT Hips\n{{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Yrotation Xrotation\n{}}}\n\
         MOTION\nFrames: 1\nFrame Time: 0.1\n{}\n",
        joint("LowerBack", "0 0 0", &spine),
        "0 ".repeat(21)
    )
}

#[test]
fn a_missing_thorax_is_restored() {
    let offsets = |above: &str| {
        let text = motionbuilder_trunk(above);
        let (mut source, ..) = bvh::parse_bvh("trunk.bvh", text.as_bytes()).unwrap();
        let warning = bvh::restore_thorax(&mut source);
        let offsets: Vec<Vec3> = source.joints[4..].iter().map(|j| j.offset).collect();
        (offsets, warning.is_some())
    };
    assert_eq!(offsets("0 0 0"), (vec![Vec3::new(0.1, 2.1, 0.0); 3], true));
    // A trunk that is complete stays as it is.
    assert_eq!(
        offsets("0 0.5 0"),
        (vec![Vec3::new(0.0, 0.5, 0.0); 3], false)
    );
}

#[test]
fn the_skeleton_of_an_amc_is_found_by_name_and_never_guessed() {
    let (asf, amc) = person_asf_amc(4);
    let load = |skeletons: &[&str], motion: &str| {
        let folder = tempfile::tempdir().unwrap();
        for name in skeletons {
            std::fs::write(folder.path().join(name), &asf).unwrap();
        }
        let path = folder.path().join(motion);
        std::fs::write(&path, &amc).unwrap();
        load_motion_file(&path).map_err(|e| e.to_string())
    };
    // The name, the subject, the only one, the one that begins alike.
    assert!(load(&["01_02.asf", "other.asf"], "01_02.amc").is_ok());
    assert!(load(&["01.asf", "other.asf"], "01_02.amc").is_ok());
    assert!(load(&["skeleton.ASF"], "walk.amc").is_ok());
    assert!(load(&["HDM_bd.asf", "HDM_mm.asf"], "HDM_bd_cartwheel_01.amc").is_ok());
    for skeletons in [&[][..], &["a.asf", "b.asf"], &["HDM_bd.asf", "HDM_bk.asf"]] {
        let error = load(skeletons, "HDM_b_01.amc").unwrap_err();
        assert!(error.contains("HDM_b_01.asf"), "{error}");
    }
}
