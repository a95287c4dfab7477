//! Features of a window of points, by which a forest compares boards with the simulator: level, spread and spectrum of ten
//! time series.
//!
//! The series are sampled at [`STEP_S`]: number of points, their mean, lowest and highest height, mean range and mean
//! forward distance relative to the window's medians, mean velocity, mean speed, and the numbers of points that move away
//! and towards the radar faster than [`FAST_MPS`]. Steps without points are interpolated. Every series gives its
//! mean, standard deviation, 10 % and 90 % quantiles, and the share of its power in the five bands of [`BANDS_HZ`].

use radarllm_base::stats::{median_upper, quantile_linear};
use radarllm_base::{Clip, PointFrame, RadarPoint, series::interpolated};
use radarllm_teach::windows::{
    Division, N_TRANSFORM, STEP_S, Window, power_spectrum, steps, windows_with,
};

/// Points with a larger radial speed count as fast, m/s.
pub const FAST_MPS: f32 = 0.7;
/// Edges of the spectral bands, Hz: slow sway, slow exercise, walking rhythm, fast exercise, jitter.
pub const BANDS_HZ: [[f64; 2]; 5] = [[0.2, 0.45], [0.45, 0.8], [0.8, 1.4], [1.4, 2.5], [2.5, 5.0]];
const N_SERIES: usize = 10;
const N_PER_SERIES: usize = 4 + BANDS_HZ.len();
/// Number of features of a window.
pub const N_FEATURES: usize = N_SERIES * N_PER_SERIES;

/// The windows of a clip with their [`N_FEATURES`] features, in order.
pub fn windows(clip: &Clip) -> Vec<Window> {
    windows_of(clip, Division::default())
}

/// The same for windows of another length or distance.
pub fn windows_of(clip: &Clip, division: Division) -> Vec<Window> {
    let height_m = clip.radar_height_m;
    windows_with(clip, division, |frames, start_s, length_s| {
        features(frames, start_s, length_s, height_m)
    })
}

fn features(frames: &[PointFrame], start_s: f64, length_s: f64, radar_height_m: f32) -> Vec<f32> {
    let series = series(frames, start_s, length_s, radar_height_m);
    series
        .iter()
        .flat_map(|s| of_series(s))
        .map(|v| v as f32)
        .collect()
}

/// The series `[N_SERIES][steps]`; NaN where a step has no points.
fn series(
    frames: &[PointFrame],
    start_s: f64,
    length_s: f64,
    radar_height_m: f32,
) -> Vec<Vec<f64>> {
    let points = || frames.iter().flat_map(|f| &f.points);
    let range_m = median_upper(points().map(|p| f64::from(p.range_m))).unwrap_or_default();
    let forward_m = median_upper(points().map(|p| f64::from(p.y_m))).unwrap_or_default();
    let steps = steps(frames, start_s, length_s);
    let mut series = vec![vec![f64::NAN; steps.len()]; N_SERIES];
    for (i, step) in steps.iter().enumerate() {
        series[0][i] = step.len() as f64;
        let fast = |sign: f32| {
            step.iter()
                .filter(|p| sign * p.velocity_mps > FAST_MPS)
                .count()
        };
        series[8][i] = fast(1.0) as f64;
        series[9][i] = fast(-1.0) as f64;
        if step.is_empty() {
            continue;
        }
        let n = step.len() as f64;
        let mean = |value: &dyn Fn(&RadarPoint) -> f32| {
            step.iter().map(|p| f64::from(value(p))).sum::<f64>() / n
        };
        let heights = step.iter().map(|p| f64::from(p.z_m + radar_height_m));
        series[1][i] = mean(&|p| p.z_m) + f64::from(radar_height_m);
        series[2][i] = heights.clone().fold(f64::INFINITY, f64::min);
        series[3][i] = heights.fold(f64::NEG_INFINITY, f64::max);
        series[4][i] = mean(&|p| p.range_m) - range_m;
        series[5][i] = mean(&|p| p.y_m) - forward_m;
        series[6][i] = mean(&|p| p.velocity_mps);
        series[7][i] = mean(&|p| p.velocity_mps.abs());
    }
    series
}

/// Mean, standard deviation, quantiles and shares of power of one series; zeros if fewer than three steps have a value.
fn of_series(series: &[f64]) -> [f64; N_PER_SERIES] {
    let mut out = [0.0; N_PER_SERIES];
    if series.iter().filter(|v| v.is_finite()).count() < 3 {
        return out;
    }
    let values = interpolated(series);
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    let mut sorted = values.clone();
    sorted.sort_by(f64::total_cmp);
    out[0] = mean;
    out[1] = variance.sqrt();
    out[2] = quantile_linear(&sorted, 0.1).unwrap_or_default();
    out[3] = quantile_linear(&sorted, 0.9).unwrap_or_default();
    let power = power_spectrum(&values, mean);
    let hz = |bin: usize| bin as f64 / (N_TRANSFORM as f64 * STEP_S);
    let above = |low: f64, high: f64| {
        let bins = power.iter().enumerate();
        bins.filter(|(bin, _)| hz(*bin) > low && hz(*bin) <= high)
            .map(|(_, p)| p)
            .sum::<f64>()
    };
    let total = above(BANDS_HZ[0][0], f64::INFINITY) + 1e-9;
    for (out, [low, high]) in out[4..].iter_mut().zip(BANDS_HZ) {
        *out = above(low, high) / total;
    }
    out
}

#[cfg(test)]
mod tests {
    use radarllm_base::{Clutter, Provenance};
    use radarllm_teach::windows::MIN_POINTS;

    use super::*;

    /// Points that go up and down at a rate, five per frame.
    fn clip(seconds: f64, rate_hz: f64) -> Clip {
        let frame = |i: usize| {
            let time_s = i as f64 / 10.0;
            let z_m = 0.3 * (std::f64::consts::TAU * rate_hz * time_s).sin() as f32;
            let point = RadarPoint {
                y_m: 2.0,
                z_m,
                range_m: 2.0,
                ..RadarPoint::default()
            };
            PointFrame {
                frame: i as u32,
                time_s,
                points: vec![point; 5],
                board: None,
            }
        };
        Clip {
            frames: (0..(seconds * 10.0) as usize).map(frame).collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "test".into(),
            provenance: Provenance::recorded("csv", "test.csv"),
            clutter: Clutter::Settled,
        }
    }

    #[test]
    fn windows_lie_in_the_recording() {
        for (seconds, n) in [(4.0, 1), (6.7, 1), (7.6, 1), (7.7, 2), (20.0, 14)] {
            let all = windows(&clip(seconds, 1.0));
            assert_eq!(all.len(), n, "{seconds}");
            assert!(all.iter().all(|w| w.end_s <= seconds + 1e-6));
            assert!(
                all.iter()
                    .all(|w| w.features.as_ref().is_some_and(|f| f.len() == N_FEATURES))
            );
        }
        assert!(windows(&clip(0.0, 1.0)).is_empty());
    }

    #[test]
    fn a_rhythm_is_found_in_its_band() {
        for (rate_hz, band) in [(0.3, 0), (0.6, 1), (1.0, 2), (2.0, 3), (3.5, 4)] {
            let all = windows(&clip(6.7, rate_hz));
            let features = all[0].features.as_ref().unwrap();
            // The second series is the mean height.
            let height = &features[N_PER_SERIES..2 * N_PER_SERIES];
            assert!((height[0] - 1.0).abs() < 0.05, "{height:?}");
            assert!((height[1] - 0.21).abs() < 0.02, "{height:?}");
            assert!(height[4 + band] > 0.7, "{rate_hz} Hz: {height:?}");
            // A constant series has no power.
            assert!(features[4..9].iter().all(|v| *v == 0.0));
        }
    }

    #[test]
    fn empty_windows_have_no_features() {
        let mut few = clip(6.7, 1.0);
        few.frames.iter_mut().for_each(|f| f.points.clear());
        assert_eq!(windows(&few)[0].features, None);
        few.frames[3].points = vec![RadarPoint::default(); MIN_POINTS];
        let all = windows(&few);
        assert!(
            all[0]
                .features
                .as_ref()
                .unwrap()
                .iter()
                .all(|v| v.is_finite())
        );
    }
}
