//! MARS takes: radar points and Kinect joints of the same moments.

use std::{fs, path::Path};

use glam::Vec3;
use radarllm_base::{PointFrame, RadarPoint, skeleton::N_JOINTS};
use radarllm_body::loaders::kinect::kinect_joints;
use radarllm_formats::read_mars_points;

use super::{Driver, RealismError, Take, read_text};

/// Radar frames per second; the tables have no usable clock.
const FRAMES_PER_S: f64 = 10.0;
/// Frame numbers jump by a thousand between movements and by up to six inside them (frames without
/// points, or lost).
const LARGEST_GAP: u64 = 10;
/// Movements of a subject, in the order of the tables.
pub const MOVEMENTS: [&str; 10] = [
    "left upper limb extension",
    "right upper limb extension",
    "both upper limbs extension",
    "left front lunge",
    "right front lunge",
    "squat",
    "left side lunge",
    "right side lunge",
    "left limb extension",
    "right limb extension",
];
/// Parts of a subject that can hold both tables.
const PARTS: [&str; 3] = ["train", "validate", "test"];

/// A take in the making.
struct Run {
    frames: Vec<PointFrame>,
    joints: Vec<[Vec3; N_JOINTS]>,
}

/// All takes under a folder that holds `subjectN/timesplit/{radar,kinect}_data_PART.csv`, by subject
/// and part. Parts without one of the tables are left out.
///
/// # Errors
/// Unreadable or malformed tables, tables of different length, or no table at all.
pub fn read_takes(folder: &Path) -> Result<Vec<Take>, RealismError> {
    let mut takes = Vec::new();
    let mut subjects: Vec<_> = fs::read_dir(folder)
        .map_err(|e| RealismError::io(folder, &e))?
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.starts_with("subject"))
        .collect();
    subjects.sort();
    for subject in subjects {
        for part in PARTS {
            let table = |kind: &str| {
                folder
                    .join(&subject)
                    .join("timesplit")
                    .join(format!("{kind}_data_{part}.csv"))
            };
            let (radar, kinect) = (table("radar"), table("kinect"));
            if radar.is_file() && kinect.is_file() {
                takes.extend(part_takes(&subject, part, &radar, &kinect)?);
            }
        }
    }
    if takes.is_empty() {
        return Err(RealismError::File {
            file: folder.display().to_string(),
            problem: "no subjectN/timesplit with radar_data_PART.csv and kinect_data_PART.csv"
                .into(),
        });
    }
    Ok(takes)
}

fn part_takes(
    subject: &str,
    part: &str,
    radar: &Path,
    kinect: &Path,
) -> Result<Vec<Take>, RealismError> {
    let name = radar.display().to_string();
    let wrong = |problem: String| RealismError::File {
        file: name.clone(),
        problem,
    };
    let frames = read_mars_points(&read_text(radar)?).map_err(|e| wrong(e.to_string()))?;
    let table = read_text(kinect)?;
    let joints = kinect_joints(&kinect.display().to_string(), table.as_bytes())?;
    if frames.len() != joints.len() {
        return Err(wrong(format!(
            "{} radar frames, but {} rows of joints in {}",
            frames.len(),
            joints.len(),
            kinect.display()
        )));
    }
    let mut runs: Vec<Run> = Vec::new();
    let mut last = None;
    for (frame, joints) in frames.into_iter().zip(joints) {
        let gap = last.map(|l: u64| frame.number.checked_sub(l));
        let start_new = !matches!(gap, Some(Some(1..=LARGEST_GAP)));
        if start_new {
            runs.push(Run {
                frames: Vec::new(),
                joints: Vec::new(),
            });
        }
        let run = runs.last_mut().ok_or_else(|| wrong("no frame".into()))?;
        let steps = if start_new {
            0
        } else {
            gap.flatten().unwrap_or(1)
        };
        push(run, steps, frame.points, joints);
        last = Some(frame.number);
    }
    if runs.len() != MOVEMENTS.len() {
        return Err(wrong(format!(
            "{} runs of frame numbers, {} movements expected",
            runs.len(),
            MOVEMENTS.len()
        )));
    }
    let take = |(class, run): (usize, Run)| Take {
        subject: subject.into(),
        part: part.into(),
        class,
        frames: run.frames,
        driver: Driver::Joints(run.joints),
    };
    Ok(runs.into_iter().enumerate().map(take).collect())
}

/// Appends a frame `steps` frame periods after the last; joints in between on straight lines.
fn push(take: &mut Run, steps: u64, points: Vec<RadarPoint>, joints: [Vec3; N_JOINTS]) {
    if let Some(&before) = take.joints.last() {
        for step in 1..steps {
            let share = step as f32 / steps as f32;
            take.joints
                .push(std::array::from_fn(|j| before[j].lerp(joints[j], share)));
        }
    }
    take.joints.push(joints);
    let frame = (take.joints.len() - 1) as u32;
    take.frames.push(PointFrame {
        frame,
        time_s: f64::from(frame) / FRAMES_PER_S,
        points,
        board: None,
    });
}
