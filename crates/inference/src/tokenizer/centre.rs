//! Tracks the position of the person on the floor plane.
//!
//! Only radar points are used, never a known position, so that training and live use compute the same centre.

use radarllm_base::{PointFrame, RadarPoint};

use super::config::{CentreSmoothing, GroupingConfig};

/// Number of frames without a point in the gate after which all points are used again.
const LOST_AFTER_FRAMES: usize = 5;
/// Position of the grid when a clip has no point at all, m.
const NOWHERE_M: [f32; 2] = [0.0, 3.0];

/// Centre of the person in every frame: x and y in the radar frame, m.
///
/// For each frame, this is the amplitude-weighted median of the points within the gate around the last centre (of all
/// points if the person was lost), followed by the moving average of the configuration. Frames without points keep the
/// last centre. Frames before the first point have the first centre.
pub fn track_centre(frames: &[PointFrame], config: &GroupingConfig) -> Vec<[f32; 2]> {
    let mut medians: Vec<Option<[f32; 2]>> = Vec::with_capacity(frames.len());
    let mut last: Option<[f32; 2]> = None;
    let mut n_missed = 0;
    for frame in frames {
        let points = &frame.points[..frame.points.len().min(config.max_points)];
        let in_gate = |p: &&RadarPoint| match last {
            Some([x, y]) if n_missed < LOST_AFTER_FRAMES => {
                (p.x_m - x).hypot(p.y_m - y) <= config.gate_m
            }
            _ => true,
        };
        let near: Vec<&RadarPoint> = points.iter().filter(in_gate).collect();
        let median = weighted_median(&near, |p| p.x_m).zip(weighted_median(&near, |p| p.y_m));
        match median {
            Some((x, y)) => {
                n_missed = 0;
                // The gate follows the causal average, so that a single outlier cannot displace it far.
                last = Some(match last {
                    Some(old) => mix(old, [x, y], config.centre_rate),
                    None => [x, y],
                });
                medians.push(Some([x, y]));
            }
            None => {
                n_missed += 1;
                medians.push(None);
            }
        }
    }
    let forward = moving_average(medians.iter(), config.centre_rate);
    match config.centre_smoothing {
        CentreSmoothing::Causal => forward,
        CentreSmoothing::Symmetric => {
            let mut backward = moving_average(medians.iter().rev(), config.centre_rate);
            backward.reverse();
            forward
                .into_iter()
                .zip(backward)
                .map(|(a, b)| mix(a, b, 0.5))
                .collect()
        }
    }
}

fn mix(a: [f32; 2], b: [f32; 2], weight: f32) -> [f32; 2] {
    [a[0] + weight * (b[0] - a[0]), a[1] + weight * (b[1] - a[1])]
}

fn moving_average<'a>(
    medians: impl Iterator<Item = &'a Option<[f32; 2]>> + Clone,
    rate: f32,
) -> Vec<[f32; 2]> {
    let mut centre = medians
        .clone()
        .flatten()
        .next()
        .copied()
        .unwrap_or(NOWHERE_M);
    medians
        .map(|median| {
            if let Some(m) = median {
                centre = mix(centre, *m, rate);
            }
            centre
        })
        .collect()
}

/// Median of a coordinate, weighted by amplitude; `None` without points.
fn weighted_median(points: &[&RadarPoint], coordinate: impl Fn(&RadarPoint) -> f32) -> Option<f32> {
    let strongest = points
        .iter()
        .map(|p| p.intensity_db)
        .fold(f32::NEG_INFINITY, f32::max);
    let mut values: Vec<(f32, f32)> = points
        .iter()
        .map(|p| {
            (
                coordinate(p),
                10f32.powf((p.intensity_db - strongest) / 20.0),
            )
        })
        .collect();
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|v| v.1).sum::<f32>();
    let mut sum = 0.0;
    for (value, weight) in &values {
        sum += weight;
        if sum >= half {
            return Some(*value);
        }
    }
    values.last().map(|v| v.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(points: &[[f32; 2]]) -> PointFrame {
        let points = points.iter().map(|p| RadarPoint {
            x_m: p[0],
            y_m: p[1],
            ..Default::default()
        });
        PointFrame {
            points: points.collect(),
            ..Default::default()
        }
    }

    #[test]
    fn symmetric_centre_of_uniform_motion_has_no_lag() {
        let frames: Vec<_> = (0..60).map(|i| frame(&[[0.1 * i as f32, 3.0]])).collect();
        let symmetric = track_centre(&frames, &GroupingConfig::default());
        // Far from the ends both lags, 0.1 (1 - 0.3) / 0.3 m, are complete and cancel.
        assert!((symmetric[30][0] - 3.0).abs() < 1e-3, "{:?}", symmetric[30]);
        let config = GroupingConfig {
            centre_smoothing: CentreSmoothing::Causal,
            ..Default::default()
        };
        let causal = track_centre(&frames, &config);
        assert!(
            (causal[30][0] - (3.0 - 0.1 * 0.7 / 0.3)).abs() < 1e-3,
            "{:?}",
            causal[30]
        );
    }

    #[test]
    fn ghosts_outside_the_gate_do_not_move_the_centre() {
        let mut frames: Vec<_> = (0..20)
            .map(|_| frame(&[[0.0, 3.0], [0.1, 3.1], [-0.1, 2.9]]))
            .collect();
        let clean = track_centre(&frames, &GroupingConfig::default());
        for f in &mut frames[1..] {
            f.points.extend(frame(&[[3.0, 6.0]; 5]).points);
        }
        assert_eq!(track_centre(&frames, &GroupingConfig::default()), clean);
    }

    #[test]
    fn empty_frames_and_empty_clips_have_a_centre() {
        let frames = vec![frame(&[]), frame(&[[1.0, 2.0]]), frame(&[])];
        assert_eq!(
            track_centre(&frames, &GroupingConfig::default()),
            vec![[1.0, 2.0]; 3]
        );
        assert_eq!(
            track_centre(&[frame(&[])], &GroupingConfig::default()),
            vec![NOWHERE_M]
        );
    }
}
