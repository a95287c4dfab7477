//! Checks a data set, and whether its validation and test motions are nearly the same as training motions.
//!
//! A score on test clips says nothing about unseen motions if the same motions are in the training split. Ids and
//! groups, which [`radarllm_dataset::validate()`] checks, do not show that two files hold the same motion.

use std::path::Path;

use radarllm_base::stats::quantile_nearest;
use radarllm_dataset::{
    ClipRecord, DatasetError, Problem, Split, manifest::MANIFEST_NAME, validate_with,
};
use serde::Serialize;

use crate::near_duplicates::{LEAK_DISTANCE, MotionClip, MotionSketch, nearest_motions};

/// What [`validate_with_held_out`] found.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Validation {
    /// Everything that is wrong; empty for a valid data set.
    pub problems: Vec<Problem>,
    /// Distances of validation and test motions to training motions.
    pub held_out: HeldOut,
}

/// Distances of held-out motions to the nearest training motion, see [`crate::near_duplicates`].
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct HeldOut {
    /// Validation and test clips that were compared.
    pub judged: usize,
    /// Validation and test clips that cannot be compared: without joints, shorter than a second, nearly still, or
    /// without training motions to compare with.
    pub not_judged: usize,
    /// Smaller distances are problems, rad.
    pub leak_distance: f64,
    /// Minimum, 5 % quantile and median of the distances, rad; `None` if no clip was compared.
    pub distances: Option<[f64; 3]>,
}

/// Validates a data set directory as [`radarllm_dataset::validate()`] does, and adds a problem for every held-out motion
/// that is nearly the same as a training motion.
///
/// Sketches of all motions are kept in memory: 15 kB for ten seconds.
///
/// # Errors
/// Only if the manifest cannot be read at all.
pub fn validate_with_held_out(dir: &Path) -> Result<Validation, DatasetError> {
    let mut motions = Motions::default();
    let mut problems = validate_with(dir, |record, file| motions.add(record, file))?;
    let held_out = motions.compare(&mut problems);
    // Problems of the whole data set come last.
    problems.sort_by_key(|problem| problem.file == MANIFEST_NAME);
    Ok(Validation { problems, held_out })
}

/// Motions of the splits.
#[derive(Default)]
struct Motions {
    train: Vec<MotionSketch>,
    /// Validation and test, with their files.
    held_out: Vec<(String, MotionSketch)>,
    n_held_out: usize,
}

impl Motions {
    fn add(&mut self, record: &ClipRecord, file: &str) {
        let sketch = MotionSketch::of(MotionClip {
            id: &record.id,
            fps: f64::from(record.motion_fps),
            joints: &record.joints,
        });
        self.n_held_out += usize::from(record.split != Split::Train);
        match (record.split, sketch) {
            (Split::Train, Some(sketch)) => self.train.push(sketch),
            (_, Some(sketch)) => self.held_out.push((file.into(), sketch)),
            (_, None) => {}
        }
    }

    fn compare(&self, problems: &mut Vec<Problem>) -> HeldOut {
        let sketches: Vec<MotionSketch> = self.held_out.iter().map(|(_, s)| s.clone()).collect();
        let found = nearest_motions(&self.train, &sketches);
        let mut distances = Vec::new();
        for ((file, _), nearest) in self.held_out.iter().zip(found) {
            let Some(n) = nearest else { continue };
            distances.push(n.distance);
            if n.distance < LEAK_DISTANCE {
                let mirrored = if n.mirrored { " mirrored," } else { "" };
                problems.push(Problem {
                    file: file.clone(),
                    id: Some(n.id),
                    problem: format!(
                        "nearly the same motion as training clip `{}`:{mirrored} distance {:.4} rad over {:.1} s from {:.1} s \
                         of it, less than {LEAK_DISTANCE}",
                        n.train_id, n.distance, n.overlap_s, n.shift_s
                    ),
                });
            }
        }
        let at = |q: f64| quantile_nearest(distances.iter().copied(), q);
        HeldOut {
            judged: distances.len(),
            not_judged: self.n_held_out - distances.len(),
            leak_distance: LEAK_DISTANCE,
            distances: match [at(0.0), at(0.05), at(0.5)] {
                [Some(min), Some(low), Some(median)] => Some([min, low, median]),
                _ => None,
            },
        }
    }
}
