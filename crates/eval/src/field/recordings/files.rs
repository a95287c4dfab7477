//! The recordings of a folder, with their activities and roles.

use std::{collections::BTreeMap, fs, io, path::Path};

use radarllm_base::{Clip, PointFrame};
use radarllm_dataset::{Columns, Dataset, Split};
use radarllm_inference::{PrepareOptions, PreparedClip, prepare_for_model};

use super::{LabelledRecording, RecordingsConfig, Role};
use crate::{EvalError, captions::take_clip};

/// Folders are read to this depth.
const MAX_DEPTH: usize = 4;

/// Activity and path of every recording of a role, by path. Paths are relative to the folder, with `/` between names.
///
/// # Errors
/// A folder that cannot be read.
pub fn labelled_files(
    config: &RecordingsConfig,
    role: Role,
    folder: &Path,
) -> io::Result<Vec<(String, String)>> {
    let mut names = Vec::new();
    list(folder, "", MAX_DEPTH, &mut names)?;
    names.sort();
    let of_role = names
        .into_iter()
        .filter(|name| config.role_of(name) == role);
    let labelled = of_role.filter_map(|name| {
        let activity = config.activity_of(&name)?;
        Some((activity.name.clone(), name))
    });
    Ok(labelled.collect())
}

fn list(folder: &Path, prefix: &str, depth: usize, names: &mut Vec<String>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        let path = entry.path();
        if path.is_file() {
            names.push(name);
        } else if path.is_dir() && depth > 1 {
            list(&path, &format!("{name}/"), depth - 1, names)?;
        }
    }
    Ok(())
}

/// The clips of a role in a data set, with their activities, by split and motion. Their names are `SPLIT/MOTION`; one
/// variant of every motion is taken.
///
/// # Errors
/// A data set that cannot be read.
pub fn labelled_clips(
    config: &RecordingsConfig,
    role: Role,
    data: &Dataset,
) -> Result<Vec<LabelledRecording>, EvalError> {
    let rate_hz = data.manifest().frame_rate_hz;
    let mut labelled: BTreeMap<String, LabelledRecording> = BTreeMap::new();
    for split in Split::ALL {
        for record in data.iter_split(split, Columns::Points) {
            let mut record = record?;
            let name = format!("{}/{}", split.name(), record.motion_id);
            if config.role_of(&name) != role || labelled.contains_key(&name) {
                continue;
            }
            let Some(activity) = config.activity_of(&name) else {
                continue;
            };
            let clip = LabelledRecording {
                name: name.clone(),
                activity: activity.name.clone(),
                clip: prepare_for_model(
                    take_clip(&mut record, rate_hz),
                    &PrepareOptions::default(),
                )?
                .clip,
            };
            labelled.insert(name, clip);
        }
    }
    Ok(labelled.into_values().collect())
}

/// The recordings that follow each other in one: it is cut where no frame came for longer than `gap_s`, and each part begins
/// at 0 s.
pub fn runs(clip: Clip, gap_s: Option<f64>) -> Vec<Clip> {
    let Some(gap_s) = gap_s else {
        return vec![clip];
    };
    let is_gap = |a: &PointFrame, b: &PointFrame| b.time_s - a.time_s <= gap_s;
    let run = |frames: &[PointFrame]| {
        let start = &frames[0];
        let shifted = |frame: &PointFrame| PointFrame {
            frame: frame.frame - start.frame,
            time_s: frame.time_s - start.time_s,
            ..frame.clone()
        };
        clip.with_frames(frames.iter().map(shifted).collect())
    };
    clip.frames.chunk_by(is_gap).map(run).collect()
}

/// Cuts a prepared recording into parts of equal length, as the configuration says.
pub fn parts(
    config: &RecordingsConfig,
    activity: &str,
    name: &str,
    clip: PreparedClip<'static>,
) -> Vec<LabelledRecording> {
    let Some(part_s) = config.part_s else {
        return vec![LabelledRecording {
            name: name.into(),
            activity: activity.into(),
            clip,
        }];
    };
    let n_frames = ((part_s * clip.frame_rate_hz).round() as usize).max(1);
    let part = |i: usize| {
        let start_s = (i * n_frames) as f64 / clip.frame_rate_hz;
        LabelledRecording {
            name: format!("{name} from {start_s:.0} s"),
            activity: activity.into(),
            clip: clip.part(i * n_frames, n_frames),
        }
    };
    (0..clip.frames.len() / n_frames).map(part).collect()
}
