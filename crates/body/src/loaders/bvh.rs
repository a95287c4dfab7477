//! Biovision hierarchies (BVH).
//!
//! Any hierarchy, channel order and number of channels per joint is accepted. Position channels
//! replace the OFFSET of their joint. All programs interpret them this way on the root. On inner
//! joints, adding them would double the bones of files that write all six channels for every joint.

use super::source::{Channel, SourceJoint, SourceMotion};
use super::text::Words;
use crate::error::{MotionError, excerpt};
use glam::{Quat, Vec3};

/// Maximum nesting depth and number of joints; full rigs with faces and fingers have about 250
/// joints.
pub(crate) const MAX_DEPTH: usize = 256;
pub(crate) const MAX_JOINTS: usize = 4096;
/// Maximum number of frames: 2.3 hours at 120 fps.
pub(crate) const MAX_FRAMES: usize = 1_000_000;

/// Parses a BVH file. Returns the motion, the unused content and warnings.
pub(crate) fn parse_bvh(
    file: &str,
    bytes: &[u8],
) -> Result<(SourceMotion, Vec<String>, Vec<String>), MotionError> {
    let mut words = Words::new(file, bytes);
    let mut skipped = Vec::new();
    let mut warnings = Vec::new();
    words.expect("HIERARCHY")?;
    let (joints, n_columns) = parse_hierarchy(&mut words, &mut skipped)?;
    let roots: Vec<&str> = joints
        .iter()
        .filter(|j| j.parent.is_none())
        .map(|j| j.name.as_str())
        .collect();
    if roots.len() > 1 {
        warnings.push(format!(
            "{} roots ({}); their joints are placed independently",
            roots.len(),
            roots.join(", ")
        ));
    }
    if n_columns == 0 {
        return Err(words.wrong(
            "at least one channel in the hierarchy".into(),
            Some(b"none"),
        ));
    }

    words.expect("Frames:")?;
    let declared = words.count("number of frames")?;
    if declared == 0 || declared > MAX_FRAMES {
        return Err(words.wrong(
            format!("1 to {MAX_FRAMES} frames"),
            Some(declared.to_string().as_bytes()),
        ));
    }
    words.expect("Frame")?;
    words.expect("Time:")?;
    let frame_time_s = words.number("frame time in seconds")?;
    let fps = fps_from_frame_time(frame_time_s).ok_or_else(|| {
        words.wrong(
            "frame time of 0.0001 to 10 s".into(),
            Some(frame_time_s.to_string().as_bytes()),
        )
    })?;

    // A value takes at least two bytes, so the reservation never exceeds the size of the file.
    let wanted = declared.saturating_mul(n_columns);
    let mut values = Vec::with_capacity(wanted.min(words.remaining() / 2 + 1));
    while values.len() < wanted {
        if words.peek().is_none() {
            let expected = format!("{declared} frames of {n_columns} numbers");
            let found = format!("{} numbers", values.len());
            return Err(words.wrong(expected, Some(found.as_bytes())));
        }
        values.push(words.number("motion value")? as f32);
    }
    let mut n_extra = 0_usize;
    while words.next().is_some() {
        n_extra += 1;
    }
    if n_extra > 0 {
        skipped.push(format!(
            "{n_extra} numbers after the declared {declared} frames"
        ));
    }
    Ok((
        SourceMotion {
            joints,
            fps,
            n_columns,
            n_frames: declared,
            values,
        },
        skipped,
        warnings,
    ))
}

fn parse_hierarchy(
    words: &mut Words,
    skipped: &mut Vec<String>,
) -> Result<(Vec<SourceJoint>, usize), MotionError> {
    let mut joints: Vec<SourceJoint> = Vec::new();
    let mut open: Vec<usize> = Vec::new();
    let mut n_columns = 0;
    let mut n_ends = 0_usize;
    loop {
        let word = words.next();
        let keyword = word.map(<[u8]>::to_ascii_uppercase);
        match keyword.as_deref() {
            Some(b"ROOT") | Some(b"JOINT") => {
                if (keyword.as_deref() == Some(b"ROOT")) != open.is_empty() {
                    return Err(words.wrong("ROOT outside and JOINT inside of braces".into(), word));
                }
                if joints.len() >= MAX_JOINTS || open.len() >= MAX_DEPTH {
                    return Err(words.wrong(
                        format!("at most {MAX_JOINTS} joints, nested at most {MAX_DEPTH} deep"),
                        word,
                    ));
                }
                let name = parse_name_and_brace(words)?;
                joints.push(SourceJoint {
                    name,
                    parent: open.last().copied(),
                    offset: Vec3::ZERO,
                    channels: Vec::new(),
                    axis: Quat::IDENTITY,
                });
                open.push(joints.len() - 1);
            }
            Some(b"OFFSET") => {
                let Some(&joint) = open.last() else {
                    return Err(words.wrong("OFFSET inside of a joint".into(), word));
                };
                joints[joint].offset = parse_vector(words)?;
            }
            Some(b"CHANNELS") => {
                let Some(&joint) = open.last() else {
                    return Err(words.wrong("CHANNELS inside of a joint".into(), word));
                };
                let count = words.count("number of channels")?;
                // Six channels are usual, nine with scales; a joint never needs more.
                if count > 16 || !joints[joint].channels.is_empty() {
                    return Err(
                        words.wrong("one CHANNELS line with at most 16 channels".into(), word)
                    );
                }
                for _ in 0..count {
                    let name = words.next();
                    match name
                        .map(<[u8]>::to_ascii_lowercase)
                        .as_deref()
                        .and_then(channel_of)
                    {
                        Some(channel) => joints[joint].channels.push((channel, n_columns)),
                        None => {
                            let Some(name) = name.filter(|n| n[0].is_ascii_alphabetic()) else {
                                return Err(
                                    words.wrong("channel name such as Xrotation".into(), name)
                                );
                            };
                            skipped.push(format!(
                                "channel {} of {}",
                                excerpt(&String::from_utf8_lossy(name)),
                                joints[joint].name
                            ));
                        }
                    }
                    n_columns += 1;
                }
            }
            Some(b"END") => {
                // The line is `End Site` or `End site`, sometimes with a name.
                words.rest_of_line();
                let Some(&joint) = open.last() else {
                    return Err(words.wrong("End Site inside of a joint".into(), word));
                };
                words.expect("{")?;
                words.expect("OFFSET")?;
                parse_vector(words)?;
                words.expect("}")?;
                n_ends += 1;
                if n_ends > MAX_JOINTS {
                    return Err(words.wrong(format!("at most {MAX_JOINTS} end sites"), word));
                }
                skipped.push(format!("end site of {}", joints[joint].name));
            }
            Some(b"}") => {
                if open.pop().is_none() {
                    return Err(words.wrong("a joint to close".into(), word));
                }
            }
            Some(b"MOTION") if open.is_empty() && !joints.is_empty() => {
                return Ok((joints, n_columns));
            }
            _ => {
                return Err(words.wrong(
                    "ROOT, JOINT, OFFSET, CHANNELS, End Site, } or MOTION".into(),
                    word,
                ));
            }
        }
    }
}

/// Reads the rest of a `JOINT name` line and the opening brace after it.
fn parse_name_and_brace(words: &mut Words) -> Result<String, MotionError> {
    let line = words.rest_of_line();
    let (name, brace_seen) = match line.strip_suffix('{') {
        Some(name) => (name.trim(), true),
        None => (line.as_str(), false),
    };
    if name.is_empty() {
        return Err(words.wrong("joint name".into(), Some(b"nothing")));
    }
    let name = name.chars().filter(|c| !c.is_control()).take(80).collect();
    if !brace_seen {
        words.expect("{")?;
    }
    Ok(name)
}

fn parse_vector(words: &mut Words) -> Result<Vec3, MotionError> {
    let mut v = Vec3::ZERO;
    for axis in 0..3 {
        v[axis] = words.number("offset")? as f32;
    }
    Ok(v)
}

fn channel_of(name: &[u8]) -> Option<Channel> {
    let axis = match name.first()? {
        b'x' => 0,
        b'y' => 1,
        b'z' => 2,
        _ => return None,
    };
    match &name[1..] {
        b"position" | b"translation" => Some(Channel::Position(axis)),
        b"rotation" => Some(Channel::Rotation(axis)),
        _ => None,
    }
}

/// Restores the thorax of the CMU database's conversion to BVH for MotionBuilder, which lost the bone: `Neck` and both
/// shoulders lie in `Spine1`, and the trunk is 11 to 12 cm too short. In the database's own skeletons the thorax is as
/// long as the bone below it within 4 %, and points in its direction. Returns a warning if there was something to restore.
pub(crate) fn restore_thorax(source: &mut SourceMotion) -> Option<String> {
    let joints = &mut source.joints;
    let named = |name: &str, parent: Option<usize>| {
        let mut all = joints.iter();
        all.position(|j| j.name.eq_ignore_ascii_case(name) && j.parent == parent)
    };
    let back = joints
        .iter()
        .position(|j| j.name.eq_ignore_ascii_case("LowerBack"))?;
    let spine = named("Spine", Some(back))?;
    let thorax = named("Spine1", Some(spine))?;
    let above = ["Neck", "LeftShoulder", "RightShoulder"].map(|name| named(name, Some(thorax)));
    let [Some(neck), Some(left), Some(right)] = above else {
        return None;
    };
    let (above, bone) = ([neck, left, right], joints[thorax].offset);
    if bone == Vec3::ZERO || above.iter().any(|j| joints[*j].offset != Vec3::ZERO) {
        return None;
    }
    for joint in above {
        joints[joint].offset = bone;
    }
    Some("the thorax bone is missing: restored with the length of the bone below it".into())
}

/// Frames per second, rounded to a whole number if it is within 0.05 %. Files print few digits
/// (`0.0333333`), and 29.97 fps differs from 30 by 0.1 %.
fn fps_from_frame_time(frame_time_s: f64) -> Option<f64> {
    if !(1e-4..=10.0).contains(&frame_time_s) {
        return None;
    }
    let fps = 1.0 / frame_time_s;
    Some(if (fps - fps.round()).abs() < 5e-4 * fps {
        fps.round()
    } else {
        fps
    })
}
