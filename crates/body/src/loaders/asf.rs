//! Acclaim skeletons and motions (ASF with AMC), as published in the CMU database.
//!
//! An ASF bone starts at the end of its parent and owns the rotation at its start. Each bone
//! therefore becomes a joint of the same name. Its channels rotate about the axes of the bone's
//! `axis` frame C. The local rotation is C M C^-1, where M is the product of the fixed-axis
//! rotations in the order of `dof`.

use super::bvh::{MAX_DEPTH, MAX_FRAMES, MAX_JOINTS};
use super::source::{Channel, SourceJoint, SourceMotion, rotation_about};
use super::text::{Words, number, wrong};
use crate::error::{MotionError, excerpt};
use glam::{Quat, Vec3};
use std::collections::HashMap;

/// A parsed ASF file.
pub(crate) struct Asf {
    joints: Vec<SourceJoint>,
    n_columns: usize,
    /// Metres per file unit, from `length`: CMU writes 0.45 for units of 1/0.45 inch.
    pub metres_per_unit: f64,
    /// The `length` factor.
    pub length_factor: f64,
    degrees: bool,
    skipped: Vec<String>,
}

struct Bone {
    vector: Vec3,
    axis: Quat,
    dof: Vec<Channel>,
}

/// CMU records at 120 frames per second; AMC has no field for the frame rate.
const AMC_FPS: f64 = 120.0;

/// Reads an ASF skeleton.
pub(crate) fn parse_asf(file: &str, bytes: &[u8]) -> Result<Asf, MotionError> {
    let mut words = Words::new(file, bytes);
    let mut section = String::new();
    let mut length_factor = 1.0;
    let mut degrees = true;
    let mut root = Bone {
        vector: Vec3::ZERO,
        axis: Quat::IDENTITY,
        dof: Vec::new(),
    };
    let mut root_offset = Vec3::ZERO;
    let mut bones: Vec<(String, Bone)> = Vec::new();
    let mut bone_lines: Option<HashMap<String, Vec<String>>> = None;
    let mut parent_of: HashMap<String, String> = HashMap::new();
    let mut skipped = Vec::new();

    while let Some(raw) = words.next_line() {
        let line_no = words.line - 1;
        let line = String::from_utf8_lossy(raw);
        let line = line.split('#').next().unwrap_or("").trim();
        let mut parts = line.split_whitespace().map(str::to_owned);
        let Some(first) = parts.next() else { continue };
        let rest: Vec<String> = parts.collect();
        if let Some(name) = first.strip_prefix(':') {
            section = name.to_ascii_lowercase();
            continue;
        }
        let numbers = |from: &[String], count: usize| -> Result<Vec<f64>, MotionError> {
            if from.len() < count {
                return Err(wrong(
                    file,
                    line_no,
                    format!("{count} numbers"),
                    Some(from.join(" ").as_bytes()),
                ));
            }
            from[..count]
                .iter()
                .map(|w| number(file, line_no, "number", Some(w.as_bytes())))
                .collect()
        };
        match (section.as_str(), first.to_ascii_lowercase().as_str()) {
            ("units", "length") => {
                length_factor = numbers(&rest, 1)?[0];
                if !(1e-4..=1e4).contains(&length_factor) {
                    return Err(wrong(
                        file,
                        line_no,
                        "length factor of 1e-4 to 1e4".into(),
                        Some(rest[0].as_bytes()),
                    ));
                }
            }
            ("units", "angle") => {
                degrees = rest.first().is_none_or(|a| a.eq_ignore_ascii_case("deg"))
            }
            ("root", "order") => {
                for name in &rest {
                    root.dof.push(dof_channel(name).ok_or_else(|| {
                        wrong(
                            file,
                            line_no,
                            "TX TY TZ RX RY RZ".into(),
                            Some(name.as_bytes()),
                        )
                    })?);
                }
                if root.dof.len() > 6 {
                    return Err(wrong(
                        file,
                        line_no,
                        "at most 6 channels".into(),
                        Some(b"more"),
                    ));
                }
            }
            ("root", "position") => root_offset = vec3(&numbers(&rest, 3)?),
            ("root", "orientation") => root.axis = fixed_axes(&numbers(&rest, 3)?, "XYZ", degrees),
            ("bonedata", "begin") => bone_lines = Some(HashMap::new()),
            ("bonedata", "end") => {
                let Some(lines) = bone_lines.take() else {
                    return Err(wrong(
                        file,
                        line_no,
                        "begin before end".into(),
                        Some(b"end"),
                    ));
                };
                let get = |key: &str| lines.get(key).map(Vec::as_slice).unwrap_or_default();
                let Some(name) = get("name").first().cloned() else {
                    return Err(wrong(file, line_no, "a bone with a name".into(), None));
                };
                let direction = vec3(&numbers(get("direction"), 3)?).normalize_or_zero();
                let length = numbers(get("length"), 1)?[0] as f32;
                let axis = if get("axis").is_empty() {
                    Quat::IDENTITY
                } else {
                    let order = get("axis").get(3).map_or("XYZ", String::as_str);
                    fixed_axes(&numbers(get("axis"), 3)?, order, degrees)
                };
                let mut dof = Vec::new();
                for entry in get("dof") {
                    match dof_channel(entry) {
                        Some(channel) => dof.push(channel),
                        // `l` is a stretch along the bone; the column is read but moves no joint.
                        None => {
                            return Err(wrong(
                                file,
                                line_no,
                                "dof among rx ry rz tx ty tz".into(),
                                Some(entry.as_bytes()),
                            ));
                        }
                    }
                }
                if bones.len() >= MAX_JOINTS
                    || dof.len() > 6
                    || bones.iter().any(|(n, _)| *n == name)
                {
                    return Err(wrong(
                        file,
                        line_no,
                        format!("at most {MAX_JOINTS} bones of distinct names with at most 6 dof"),
                        Some(name.as_bytes()),
                    ));
                }
                bones.push((
                    name,
                    Bone {
                        vector: direction * length,
                        axis,
                        dof,
                    },
                ));
            }
            ("bonedata", key) => {
                if let Some(lines) = bone_lines.as_mut() {
                    lines.insert(key.to_owned(), rest);
                }
            }
            ("hierarchy", "begin" | "end") => {}
            ("hierarchy", _) => {
                for child in rest {
                    parent_of.insert(child, first.clone());
                }
            }
            _ => {}
        }
    }
    if root.dof.is_empty() {
        return Err(wrong(file, words.line, "`order` of the root".into(), None));
    }
    let (joints, n_columns) = order_bones(
        file,
        words.line,
        root,
        root_offset,
        bones,
        &parent_of,
        &mut skipped,
    )?;
    Ok(Asf {
        joints,
        n_columns,
        metres_per_unit: 0.0254 / length_factor,
        length_factor,
        degrees,
        skipped,
    })
}

/// Sorts parents before children and converts bones to joints.
fn order_bones(
    file: &str,
    line: usize,
    root: Bone,
    root_offset: Vec3,
    bones: Vec<(String, Bone)>,
    parent_of: &HashMap<String, String>,
    skipped: &mut Vec<String>,
) -> Result<(Vec<SourceJoint>, usize), MotionError> {
    let mut joints = Vec::new();
    let mut vectors = Vec::new();
    let mut depth = Vec::new();
    let mut index_of: HashMap<String, usize> = HashMap::new();
    let mut n_columns = 0;
    let mut push = |name: String,
                    parent: Option<usize>,
                    offset: Vec3,
                    bone: &Bone,
                    joints: &mut Vec<SourceJoint>| {
        let mut channels: Vec<(Channel, usize)> = bone
            .dof
            .iter()
            .enumerate()
            .map(|(i, c)| (*c, n_columns + i))
            .collect();
        n_columns += bone.dof.len();
        // Fixed axes: the last named rotation is the leftmost factor.
        channels.reverse();
        joints.push(SourceJoint {
            name,
            parent,
            offset,
            channels,
            axis: bone.axis,
        });
    };
    push("root".into(), None, root_offset, &root, &mut joints);
    vectors.push(Vec3::ZERO);
    depth.push(0_usize);
    index_of.insert("root".into(), 0);
    let mut waiting = bones;
    loop {
        let before = waiting.len();
        let mut still = Vec::new();
        for (name, bone) in waiting {
            match parent_of.get(&name).and_then(|p| index_of.get(p)).copied() {
                Some(parent) if depth[parent] < MAX_DEPTH => {
                    push(
                        name.clone(),
                        Some(parent),
                        vectors[parent],
                        &bone,
                        &mut joints,
                    );
                    index_of.insert(name, joints.len() - 1);
                    depth.push(depth[parent] + 1);
                    vectors.push(bone.vector);
                }
                _ => still.push((name, bone)),
            }
        }
        if still.is_empty() || still.len() == before {
            for (name, _) in &still {
                skipped.push(format!("bone {} (not below the root)", excerpt(name)));
            }
            break;
        }
        waiting = still;
    }
    if joints.len() == 1 {
        return Err(wrong(
            file,
            line,
            "a hierarchy of bones below the root".into(),
            None,
        ));
    }
    Ok((joints, n_columns))
}

/// Parses an AMC motion of the skeleton `asf`. Returns the motion, the unused content and warnings.
pub(crate) fn parse_amc(
    file: &str,
    bytes: &[u8],
    asf: Asf,
) -> Result<(SourceMotion, Vec<String>, Vec<String>), MotionError> {
    let mut words = Words::new(file, bytes);
    let mut degrees = asf.degrees;
    let mut skipped = asf.skipped;
    let index_of: HashMap<&str, usize> = asf
        .joints
        .iter()
        .enumerate()
        .map(|(i, j)| (j.name.as_str(), i))
        .collect();
    let mut values: Vec<f32> = Vec::new();
    let mut seen = vec![true; asf.joints.len()];
    let mut n_frames = 0_usize;
    let needs_values = |j: usize| !asf.joints[j].channels.is_empty();
    let check_complete = |seen: &[bool], frame: usize, line: usize| -> Result<(), MotionError> {
        match (0..seen.len()).find(|&j| !seen[j] && needs_values(j)) {
            Some(j) => Err(wrong(
                file,
                line,
                format!("values of bone {} in frame {frame}", asf.joints[j].name),
                Some(b"none"),
            )),
            None => Ok(()),
        }
    };
    while let Some(line) = words.next_line() {
        let line_no = words.line - 1;
        if line.is_empty() || line[0] == b'#' {
            continue;
        }
        if line[0] == b':' {
            if line.eq_ignore_ascii_case(b":RADIANS") {
                degrees = false;
            } else if line.eq_ignore_ascii_case(b":DEGREES") {
                degrees = true;
            }
            continue;
        }
        let mut parts = line
            .split(u8::is_ascii_whitespace)
            .filter(|w| !w.is_empty());
        let Some(first) = parts.next() else { continue };
        if first.iter().all(u8::is_ascii_digit) {
            check_complete(&seen, n_frames, line_no)?;
            n_frames += 1;
            if n_frames > MAX_FRAMES {
                return Err(wrong(
                    file,
                    line_no,
                    format!("at most {MAX_FRAMES} frames"),
                    Some(first),
                ));
            }
            seen.fill(false);
            values.resize(n_frames * asf.n_columns, 0.0);
            continue;
        }
        if n_frames == 0 {
            return Err(wrong(file, line_no, "frame number".into(), Some(first)));
        }
        let name = String::from_utf8_lossy(first);
        let Some(&joint) = index_of.get(name.as_ref()) else {
            let note = format!("bone {} (not in the skeleton)", excerpt(&name));
            if n_frames == 1 && skipped.len() < MAX_JOINTS {
                skipped.push(note);
            }
            continue;
        };
        let row = (n_frames - 1) * asf.n_columns;
        // Channels are stored in reverse order; the file lists them first to last.
        for &(channel, column) in asf.joints[joint].channels.iter().rev() {
            let mut value =
                number(file, line_no, &format!("value of {name}"), parts.next())? as f32;
            if matches!(channel, Channel::Rotation(_)) && !degrees {
                value = value.to_degrees();
            }
            values[row + column] = value;
        }
        if let Some(extra) = parts.next() {
            return Err(wrong(
                file,
                line_no,
                format!("{} values for {name}", asf.joints[joint].channels.len()),
                Some(extra),
            ));
        }
        seen[joint] = true;
    }
    check_complete(&seen, n_frames, words.line)?;
    if n_frames == 0 {
        return Err(wrong(file, words.line, "at least one frame".into(), None));
    }
    let warnings = vec![format!(
        "AMC files carry no frame rate: {AMC_FPS} fps, that of the CMU database, is assumed"
    )];
    let motion = SourceMotion {
        joints: asf.joints,
        fps: AMC_FPS,
        n_columns: asf.n_columns,
        n_frames,
        values,
    };
    Ok((motion, skipped, warnings))
}

fn dof_channel(name: &str) -> Option<Channel> {
    match name.to_ascii_lowercase().as_str() {
        "tx" => Some(Channel::Position(0)),
        "ty" => Some(Channel::Position(1)),
        "tz" => Some(Channel::Position(2)),
        "rx" => Some(Channel::Rotation(0)),
        "ry" => Some(Channel::Rotation(1)),
        "rz" => Some(Channel::Rotation(2)),
        _ => None,
    }
}

/// Rotation by angles about fixed axes in the order of `order` ("XYZ": x is applied first, and the
/// last axis is the leftmost factor).
fn fixed_axes(angles: &[f64], order: &str, degrees: bool) -> Quat {
    let mut q = Quat::IDENTITY;
    for (angle, letter) in angles.iter().zip(order.chars()) {
        let axis = match letter.to_ascii_uppercase() {
            'X' => 0,
            'Y' => 1,
            _ => 2,
        };
        let rad = if degrees { angle.to_radians() } else { *angle };
        q = rotation_about(axis, rad as f32) * q;
    }
    q.normalize()
}

fn vec3(v: &[f64]) -> Vec3 {
    Vec3::new(v[0] as f32, v[1] as f32, v[2] as f32)
}
