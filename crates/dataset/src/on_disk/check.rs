//! The conditions that every stored clip satisfies.

use radarllm_base::skeleton::N_JOINTS;

use crate::{ClipRecord, DatasetError, MOTION_FEATURE_DIM};

/// Maximum length of an id, name or label, bytes.
const MAX_NAME_BYTES: usize = 512;
/// Maximum length of a caption, bytes.
const MAX_CAPTION_BYTES: usize = 8192;

/// Checks one clip: names present and printable, at least one caption and none empty, frames in
/// strictly increasing order, every number finite, motion features in whole vectors.
///
/// # Errors
/// [`DatasetError::Record`] with the first violation.
pub fn check_record(record: &ClipRecord) -> Result<(), DatasetError> {
    match find_problem(record) {
        None => Ok(()),
        Some(problem) => Err(DatasetError::Record {
            id: record.id.clone(),
            problem,
        }),
    }
}

fn find_problem(record: &ClipRecord) -> Option<String> {
    for (field, text) in [
        ("id", &record.id),
        ("motion_id", &record.motion_id),
        ("group", &record.group),
        ("action", &record.action),
        ("source", &record.source),
        ("radar", &record.radar),
    ] {
        if text.is_empty() || text.len() > MAX_NAME_BYTES || text.chars().any(char::is_control) {
            return Some(format!(
                "{field} must be 1..={MAX_NAME_BYTES} printable bytes, found {text:?}"
            ));
        }
    }
    if record.captions.is_empty() {
        return Some("no caption".into());
    }
    for (i, caption) in record.captions.iter().enumerate() {
        if caption.trim().is_empty() {
            return Some(format!("caption {i} is empty"));
        }
        if caption.len() > MAX_CAPTION_BYTES {
            return Some(format!(
                "caption {i} has {} bytes, more than {MAX_CAPTION_BYTES}",
                caption.len()
            ));
        }
    }
    if !record.radar_height_m.is_finite() {
        return Some(format!("radar_height_m is {}", record.radar_height_m));
    }
    if !(record.motion_fps.is_finite() && record.motion_fps > 0.0) {
        return Some(format!("motion_fps is {}", record.motion_fps));
    }
    let mut previous: Option<(u32, f64)> = None;
    for frame in &record.frames {
        if !frame.time_s.is_finite() {
            return Some(format!("frame {}: time is {}", frame.frame, frame.time_s));
        }
        if let Some((number, time_s)) = previous
            && (frame.frame <= number || frame.time_s < time_s)
        {
            return Some(format!(
                "frame {} at {} s follows frame {number} at {time_s} s",
                frame.frame, frame.time_s
            ));
        }
        previous = Some((frame.frame, frame.time_s));
        for (i, p) in frame.points.iter().enumerate() {
            if !is_finite(&[
                p.x_m,
                p.y_m,
                p.z_m,
                p.range_m,
                p.velocity_mps,
                p.intensity_db,
            ]) {
                return Some(format!(
                    "frame {}, point {i}: not finite: {p:?}",
                    frame.frame
                ));
            }
        }
    }
    if let Some(i) = record
        .joints
        .iter()
        .position(|pose| !is_finite(pose.as_flattened()))
    {
        return Some(format!("joints of motion frame {i} are not finite"));
    }
    let n_poses = record.rotations6d.len();
    if n_poses > 0 && n_poses != record.joints.len() {
        return Some(format!(
            "rotations6d has {n_poses} motion frames, joints has {}",
            record.joints.len()
        ));
    }
    let is_turned = |pose: &[[f32; 6]; N_JOINTS]| !is_finite(pose.as_flattened());
    if let Some(i) = record.rotations6d.iter().position(is_turned) {
        return Some(format!("rotations of motion frame {i} are not finite"));
    }
    if !(record.body_height_m.is_finite() && record.body_height_m >= 0.0) {
        return Some(format!("body_height_m is {}", record.body_height_m));
    }
    if !record
        .motion_features
        .len()
        .is_multiple_of(MOTION_FEATURE_DIM)
    {
        return Some(format!(
            "motion_features has {} values, not a multiple of {MOTION_FEATURE_DIM}",
            record.motion_features.len()
        ));
    }
    if let Some(i) = record.motion_features.iter().position(|v| !v.is_finite()) {
        return Some(format!(
            "motion feature {} of frame {} is not finite",
            i % MOTION_FEATURE_DIM,
            i / MOTION_FEATURE_DIM
        ));
    }
    None
}

fn is_finite(values: &[f32]) -> bool {
    values.iter().all(|v| v.is_finite())
}
