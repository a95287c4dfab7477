//! Captions of the training clips that are nearest by dynamic time warping.

use radarllm_dataset::ClipRecord;
use radarllm_metrics::dtw::{lower_bound, warping};
use rayon::prelude::*;

use super::medoid;
use crate::{
    EvalError,
    descriptor::{STEP_DIM, steps},
};

/// Radar frames of a step: 0.4 s.
const FRAMES_PER_STEP: usize = 4;
/// Share of the longer clip by which steps may be shifted.
const BAND: f64 = 0.2;

/// For each clip, the first caption of the nearest training clip, or of the `k` nearest ones the medoid of their first
/// captions. Clips are series of [`steps`], standardised by the training clips; distances are root mean squares over the
/// steps of the path. Ties go to the id that comes first.
///
/// # Errors
/// No training clip with frames, or a clip without frames.
pub fn warped_captions(
    train: &[ClipRecord],
    clips: &[ClipRecord],
    k: usize,
) -> Result<Vec<String>, EvalError> {
    let mut known: Vec<&ClipRecord> = train.iter().filter(|c| !c.frames.is_empty()).collect();
    known.sort_by(|a, b| a.id.cmp(&b.id));
    if known.is_empty() {
        return Err(EvalError::Empty("no training clip has frames".into()));
    }
    let raw = |clip: &ClipRecord| steps(&clip.frames, clip.radar_height_m, FRAMES_PER_STEP);
    let all: Vec<Vec<[f32; STEP_DIM]>> = known.par_iter().map(|clip| raw(clip)).collect();
    let scale = Scale::of(all.iter().flatten());
    let all: Vec<Vec<f64>> = all.iter().map(|series| scale.apply(series)).collect();
    clips
        .par_iter()
        .map(|clip| {
            let own = scale.apply(&raw(clip));
            if own.is_empty() {
                return Err(EvalError::Empty(format!("clip {}: no frames", clip.id)));
            }
            let nearest = nearest(&own, &all, k.max(1));
            let captions: Vec<&str> = nearest
                .iter()
                .filter_map(|(_, index)| known[*index].captions.first())
                .map(String::as_str)
                .collect();
            Ok(medoid(&captions).unwrap_or_default().to_string())
        })
        .collect()
}

/// Distances and indices of the `k` nearest series, nearest first.
fn nearest(own: &[f64], all: &[Vec<f64>], k: usize) -> Vec<(f64, usize)> {
    let mut found: Vec<(f64, usize)> = Vec::with_capacity(k + 1);
    for (index, other) in all.iter().enumerate() {
        let longer = own.len().max(other.len()) / STEP_DIM;
        // A window of 1 allows the diagonals alone.
        let window = 1 + (BAND * longer as f64).ceil() as usize;
        let worst = match found.len() < k {
            true => f64::INFINITY,
            false => found[k - 1].0,
        };
        if lower_bound(own, other, STEP_DIM, window).is_none_or(|bound| bound >= worst) {
            continue;
        }
        let Some(warping) = warping(own, other, STEP_DIM, window) else {
            continue;
        };
        let distance = warping.normalised();
        if distance < worst {
            let at = found.partition_point(|(d, _)| *d <= distance);
            found.insert(at, (distance, index));
            found.truncate(k);
        }
    }
    found
}

/// Mean and inverse deviation of every number.
struct Scale([(f64, f64); STEP_DIM]);

impl Scale {
    fn of<'a>(rows: impl Iterator<Item = &'a [f32; STEP_DIM]> + Clone) -> Self {
        let n = rows.clone().count().max(1) as f64;
        Self(std::array::from_fn(|i| {
            let values = || rows.clone().map(|row| f64::from(row[i]));
            let mean = values().sum::<f64>() / n;
            let variance = values().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
            // A constant number says nothing.
            (
                mean,
                if variance > 1e-12 {
                    1.0 / variance.sqrt()
                } else {
                    0.0
                },
            )
        }))
    }

    fn apply(&self, series: &[[f32; STEP_DIM]]) -> Vec<f64> {
        let of_row = |row: &[f32; STEP_DIM]| -> [f64; STEP_DIM] {
            std::array::from_fn(|i| (f64::from(row[i]) - self.0[i].0) * self.0[i].1)
        };
        series.iter().flat_map(of_row).collect()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use radarllm_base::{PointFrame, RadarPoint};
    use radarllm_dataset::Split;

    use super::*;

    /// A clip of one point whose place along y and height over time are given.
    pub(in super::super) fn clip(
        id: &str,
        caption: &str,
        n_frames: usize,
        at: impl Fn(f32) -> [f32; 3],
    ) -> ClipRecord {
        let frame = |f: usize| {
            let t = f as f32 / n_frames as f32;
            let [x_m, y_m, z_m] = at(t);
            let dt = 1.0 / n_frames as f32;
            let speed = (at(t + dt)[1] - y_m) / 0.1;
            PointFrame {
                frame: f as u32,
                time_s: f as f64 * 0.1,
                points: vec![RadarPoint {
                    x_m,
                    y_m,
                    z_m,
                    range_m: y_m,
                    velocity_mps: speed,
                    intensity_db: 20.0,
                }],
                board: None,
            }
        };
        ClipRecord {
            id: id.into(),
            motion_id: id.into(),
            group: id.into(),
            split: Split::Train,
            action: caption.into(),
            captions: vec![caption.into()],
            source: "test".into(),
            radar: "awr1843boost".into(),
            radar_height_m: 1.0,
            seed: 1,
            frames: (0..n_frames).map(frame).collect(),
            motion_fps: 20.0,
            joints: Vec::new(),
            motion_features: Vec::new(),
            rotations6d: Vec::new(),
            body_height_m: 0.0,
        }
    }

    #[test]
    fn the_same_motion_at_another_pace_is_nearest() {
        let towards = |t: f32| [0.0, 4.0 - 2.0 * t, 0.0];
        let away = |t: f32| [0.0, 2.0 + 2.0 * t, 0.0];
        let down = |t: f32| [0.0, 3.0, 0.4 - 0.8 * t];
        let train = [
            clip("a", "a person comes", 40, towards),
            clip("b", "a person leaves", 40, away),
            clip("c", "a person sits down", 40, down),
            clip("d", "a person leaves quickly", 44, away),
        ];
        let clips = [
            clip("x", "", 48, towards),
            clip("y", "", 36, down),
            clip("z", "", 50, away),
        ];
        let found = warped_captions(&train, &clips, 1).unwrap();
        assert_eq!(found[..2], ["a person comes", "a person sits down"]);
        assert!(found[2].starts_with("a person leaves"));
        // Of all four, the most ordinary sentence, whatever is nearest.
        let medoids = warped_captions(&train, &clips, 4).unwrap();
        assert!(medoids.iter().all(|m| m == &medoids[0]));
        assert!(warped_captions(&[], &clips, 1).is_err());
    }
}
