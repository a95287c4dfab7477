//! Radar pictures instead of codes: where points are in range, velocity and azimuth, over time.
//!
//! mmExpert (MobiHoc 2025) gives such pictures to a vision transformer. Here, the pictures of 0.4 s are
//! one vector, and the encoder of the language model is the transformer. The pictures are made of points, because data sets
//! hold points; those of mmExpert are made of samples.

use radarllm_base::PointFrame;
use radarllm_dataset::record::ClipRecord;
use radarllm_inference::tokenizer::{Encoded, FRAMES_PER_CODE, MAX_FRAMES};

use crate::lm::{LmClip, Motions};

/// Bins and extent of an axis.
struct Axis {
    bins: usize,
    low: f32,
    high: f32,
}

/// Range, m.
const RANGE: Axis = Axis {
    bins: 32,
    low: 0.0,
    high: 8.0,
};
/// Radial velocity, m/s.
const VELOCITY: Axis = Axis {
    bins: 32,
    low: -4.0,
    high: 4.0,
};
/// Azimuth, rad.
const AZIMUTH: Axis = Axis {
    bins: 24,
    low: -std::f32::consts::FRAC_PI_3,
    high: std::f32::consts::FRAC_PI_3,
};

/// Width of the vector of 0.4 s: the three pictures of each frame, and the logarithm of the number of points.
pub const PICTURE_DIM: usize = FRAMES_PER_CODE * (RANGE.bins + VELOCITY.bins + AZIMUTH.bins) + 1;

impl Axis {
    /// The bin of a value; values beyond the extent are in the outermost bins.
    fn bin(&self, value: f32) -> usize {
        let share = (value - self.low) / (self.high - self.low);
        ((share * self.bins as f32).max(0.0) as usize).min(self.bins - 1)
    }
}

/// Pictures of a clip as the features of codes that are all 0.
pub fn pictures(frames: &[PointFrame]) -> Encoded {
    let frames = &frames[..frames.len().min(MAX_FRAMES)];
    let mut features = Vec::new();
    for step in frames.chunks(FRAMES_PER_CODE) {
        let mut vector = Vec::with_capacity(PICTURE_DIM);
        for index in 0..FRAMES_PER_CODE {
            let points = step.get(index).map_or(&[][..], |f| f.points.as_slice());
            for (axis, value) in [
                (
                    RANGE,
                    (|p| p.range_m) as fn(&radarllm_base::RadarPoint) -> f32,
                ),
                (VELOCITY, |p| p.velocity_mps),
                (AZIMUTH, |p| p.x_m.atan2(p.y_m)),
            ] {
                let mut bins = vec![0.0_f32; axis.bins];
                for point in points {
                    bins[axis.bin(value(point))] += 1.0;
                }
                vector.extend(bins.iter().map(|n| n.ln_1p()));
            }
        }
        let n: usize = step.iter().map(|f| f.points.len()).sum();
        vector.push((n as f32).ln_1p());
        features.extend(vector);
    }
    Encoded {
        codes: vec![0; features.len() / PICTURE_DIM],
        features,
        ..Encoded::default()
    }
}

/// Pictures of clips, the variants of a motion together; with `flip` also of their mirror images.
pub(crate) fn picture_clips(clips: &[ClipRecord], flip: bool) -> Vec<LmClip> {
    let mut motions = Motions::default();
    for clip in clips.iter().filter(|clip| !clip.frames.is_empty()) {
        let encoded = pictures(&clip.frames);
        let seconds = (encoded.codes.len() * FRAMES_PER_CODE) as f32 / 10.0;
        let mirrored = flip.then(|| {
            let mut frames = clip.frames.clone();
            frames.iter_mut().for_each(PointFrame::mirror);
            pictures(&frames)
        });
        motions.add(clip, seconds, encoded, mirrored);
    }
    motions.into_clips()
}

#[cfg(test)]
mod tests {
    use radarllm_base::RadarPoint;

    use super::*;

    #[test]
    fn points_are_counted_where_they_are() {
        let point = |x_m: f32, y_m: f32, velocity_mps: f32| RadarPoint {
            x_m,
            y_m,
            z_m: 0.0,
            range_m: x_m.hypot(y_m),
            velocity_mps,
            intensity_db: 0.0,
        };
        let frame = |points: Vec<RadarPoint>, frame: u32| PointFrame {
            frame,
            time_s: f64::from(frame) * 0.1,
            points,
            board: None,
        };
        // Two points at 2 m straight ahead, one of which recedes at 99 m/s, beyond the picture; then an empty frame, and the
        // beginning of a second step.
        let points = vec![point(0.01, 2.01, 0.01), point(0.01, 2.01, 99.0)];
        let mut frames: Vec<PointFrame> = (0..5).map(|i| frame(Vec::new(), i)).collect();
        frames[0].points = points;
        let seen = pictures(&frames);
        assert_eq!(
            (seen.codes.len(), seen.features.len()),
            (2, 2 * PICTURE_DIM)
        );
        let filled: Vec<(usize, f32)> = seen
            .features
            .iter()
            .copied()
            .enumerate()
            .filter(|(_, v)| *v > 0.0)
            .collect();
        let two = 2.0_f32.ln_1p();
        let one = 1.0_f32.ln_1p();
        assert_eq!(
            filled,
            [
                (8, two),
                (32 + 16, one),
                (32 + 31, one),
                (64 + 12, two),
                (PICTURE_DIM - 1, two)
            ]
        );
    }
}
