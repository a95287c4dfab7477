//! Batches and augmentation of radar clips.

use radarllm_base::{PointFrame, RadarPoint};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

/// Random augmentation of a training clip. The value 0 disables each kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AugmentConfig {
    /// Probability of mirroring the clip (x to -x). Left and right must then be exchanged in the captions.
    pub flip: f64,
    /// Maximum rotation of the whole clip about the radar, rad.
    pub yaw_rad: f32,
    /// Maximum shift of the whole clip along x and y, m.
    pub shift_m: f32,
    /// Maximum share of a clip's points that is dropped.
    pub dropout: f32,
    /// Probability of dropping all points of a frame.
    pub frame_dropout: f32,
    /// Standard deviation of the gain of a clip and of the intensity of each point, dB.
    pub intensity_db: f32,
    /// Standard deviation of each point's radial velocity, m/s.
    pub velocity_mps: f32,
    /// Standard deviation of each point's position, m.
    pub position_m: f32,
    /// Probability that the clip is disturbed, at its own pace: [`radarllm_base::disturb`].
    #[serde(skip_serializing_if = "is_zero")]
    pub disturb: f64,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl Default for AugmentConfig {
    fn default() -> Self {
        Self {
            flip: 0.5,
            yaw_rad: 0.15,
            shift_m: 0.3,
            dropout: 0.3,
            frame_dropout: 0.02,
            intensity_db: 1.0,
            velocity_mps: 0.05,
            position_m: 0.01,
            disturb: 0.0,
        }
    }
}

impl AugmentConfig {
    /// No augmentation.
    pub fn none() -> Self {
        Self {
            flip: 0.0,
            yaw_rad: 0.0,
            shift_m: 0.0,
            dropout: 0.0,
            frame_dropout: 0.0,
            intensity_db: 0.0,
            velocity_mps: 0.0,
            position_m: 0.0,
            disturb: 0.0,
        }
    }

    /// Checks that every field is finite and in range.
    ///
    /// # Errors
    /// Names the first field that is not.
    pub fn validate(&self) -> Result<(), String> {
        for (field, value, max) in [
            ("flip", self.flip as f32, 1.0),
            ("disturb", self.disturb as f32, 1.0),
            ("yaw_rad", self.yaw_rad, 4.0),
            ("shift_m", self.shift_m, 10.0),
            ("dropout", self.dropout, 1.0),
            ("frame_dropout", self.frame_dropout, 1.0),
            ("intensity_db", self.intensity_db, 100.0),
            ("velocity_mps", self.velocity_mps, 100.0),
            ("position_m", self.position_m, 10.0),
        ] {
            if !(0.0..=max).contains(&value) {
                return Err(format!(
                    "augment.{field}: must be in 0..={max}, found {value}"
                ));
            }
        }
        Ok(())
    }
}

/// Applies all random augmentation except the flip, which also changes the labels (see [`PointFrame::mirror`]).
pub fn augment_points(frames: &mut [PointFrame], config: &AugmentConfig, rng: &mut ChaCha8Rng) {
    let symmetric = |rng: &mut ChaCha8Rng, max: f32| {
        if max > 0.0 {
            rng.random_range(-max..=max)
        } else {
            0.0
        }
    };
    let (sin, cos) = symmetric(rng, config.yaw_rad).sin_cos();
    let shift = [
        symmetric(rng, config.shift_m),
        symmetric(rng, config.shift_m),
    ];
    let gain_db = config.intensity_db * normal(rng);
    let keep = 1.0
        - if config.dropout > 0.0 {
            rng.random_range(0.0..=config.dropout)
        } else {
            0.0
        };
    for frame in frames {
        if config.frame_dropout > 0.0 && rng.random::<f32>() < config.frame_dropout {
            frame.points.clear();
        }
        if keep < 1.0 {
            frame.points.retain(|_| rng.random::<f32>() < keep);
        }
        for p in &mut frame.points {
            let (x, y) = (
                cos * p.x_m - sin * p.y_m + shift[0],
                sin * p.x_m + cos * p.y_m + shift[1],
            );
            *p = RadarPoint {
                x_m: x + config.position_m * normal(rng),
                y_m: y + config.position_m * normal(rng),
                z_m: p.z_m + config.position_m * normal(rng),
                range_m: 0.0,
                velocity_mps: p.velocity_mps + config.velocity_mps * normal(rng),
                intensity_db: p.intensity_db + gain_db + config.intensity_db * normal(rng),
            };
            p.range_m = (p.x_m * p.x_m + p.y_m * p.y_m + p.z_m * p.z_m).sqrt();
        }
    }
}

/// Approximate standard normal number: eight uniform numbers minus four, scaled (Irwin-Hall). Its light tails are
/// desirable here.
fn normal(rng: &mut ChaCha8Rng) -> f32 {
    let bits: u64 = rng.random();
    let more: u64 = rng.random();
    let parts = |b: u64| (0..4).map(move |i| ((b >> (16 * i)) & 0xffff) as f32 / 65_536.0);
    // The sum of eight uniform numbers has variance 8 / 12. It is scaled to variance 1.
    (parts(bits).chain(parts(more)).sum::<f32>() - 4.0) * (12.0f32 / 8.0).sqrt()
}

/// Plans shuffled batches of clips of similar length. The result depends on `lengths`, `batch_size` and `seed` only.
///
/// Items are shuffled, sorted by length within groups of sixteen batches, and divided into batches. The batches are
/// then shuffled. Every epoch has `ceil(n / batch_size)` batches.
pub fn plan_batches(lengths: &[usize], batch_size: usize, seed: u64) -> Vec<Vec<usize>> {
    let batch_size = batch_size.max(1);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut items: Vec<usize> = (0..lengths.len()).collect();
    shuffle(&mut items, &mut rng);
    for group in items.chunks_mut(16 * batch_size) {
        group.sort_by_key(|i| lengths[*i]);
    }
    let mut batches: Vec<Vec<usize>> = items.chunks(batch_size).map(<[usize]>::to_vec).collect();
    shuffle(&mut batches, &mut rng);
    batches
}

/// Fisher-Yates shuffle.
pub fn shuffle<T>(items: &mut [T], rng: &mut ChaCha8Rng) {
    for i in (1..items.len()).rev() {
        items.swap(i, rng.random_range(0..=i));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clip() -> Vec<PointFrame> {
        let point = |i: usize| RadarPoint {
            x_m: i as f32 * 0.1 - 0.5,
            y_m: 3.0,
            z_m: 0.2,
            range_m: 3.0,
            velocity_mps: 0.5,
            intensity_db: 10.0,
        };
        (0..10)
            .map(|f| PointFrame {
                frame: f,
                time_s: 0.0,
                points: (0..10).map(point).collect(),
                board: None,
            })
            .collect()
    }

    #[test]
    fn flipping_twice_is_the_identity() {
        let mut flipped = clip();
        flipped.iter_mut().for_each(PointFrame::mirror);
        assert_eq!(flipped[0].points[0].x_m, 0.5);
        flipped.iter_mut().for_each(PointFrame::mirror);
        assert_eq!(flipped, clip());
    }

    #[test]
    fn no_augmentation_changes_only_the_recomputed_range() {
        let mut same = clip();
        augment_points(
            &mut same,
            &AugmentConfig::none(),
            &mut ChaCha8Rng::seed_from_u64(1),
        );
        for (a, b) in same
            .iter()
            .zip(clip())
            .flat_map(|(a, b)| a.points.clone().into_iter().zip(b.points))
        {
            assert_eq!(
                (a.x_m, a.y_m, a.z_m, a.velocity_mps, a.intensity_db),
                (b.x_m, b.y_m, b.z_m, b.velocity_mps, b.intensity_db)
            );
        }
    }

    #[test]
    fn augmentation_is_a_function_of_its_seed_and_keeps_shape() {
        let draw = |seed| {
            let mut c = clip();
            let config = AugmentConfig {
                position_m: 0.0,
                dropout: 0.0,
                frame_dropout: 0.0,
                ..Default::default()
            };
            augment_points(&mut c, &config, &mut ChaCha8Rng::seed_from_u64(seed));
            c
        };
        assert_eq!(draw(1), draw(1));
        assert_ne!(draw(1), draw(2));
        // A rotation and a shift preserve the distances between points.
        let (a, b) = (draw(1), clip());
        let distance = |f: &PointFrame| {
            (f.points[0].x_m - f.points[9].x_m).hypot(f.points[0].y_m - f.points[9].y_m)
        };
        assert!((distance(&a[0]) - distance(&b[0])).abs() < 1e-5);
    }

    #[test]
    fn normal_has_unit_variance() {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let n = 20_000;
        let draws: Vec<f32> = (0..n).map(|_| normal(&mut rng)).collect();
        let mean = draws.iter().sum::<f32>() / n as f32;
        let variance = draws.iter().map(|d| d * d).sum::<f32>() / n as f32;
        // Tolerance of five standard errors: 5 / sqrt(n) and 5 sqrt(2 / n).
        assert!(
            mean.abs() < 0.036 && (variance - 1.0).abs() < 0.05,
            "{mean} {variance}"
        );
    }

    #[test]
    fn batches_cover_every_item_once() {
        let lengths: Vec<usize> = (0..103).map(|i| i * 7 % 50).collect();
        let batches = plan_batches(&lengths, 8, 3);
        let mut all: Vec<usize> = batches.concat();
        all.sort_unstable();
        assert_eq!(all, (0..103).collect::<Vec<_>>());
        assert_eq!(batches.len(), 13);
        assert_eq!(batches, plan_batches(&lengths, 8, 3));
        assert_ne!(batches, plan_batches(&lengths, 8, 4));
    }
}
