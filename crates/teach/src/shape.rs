//! Features by which taught activities are compared: the shape of the movement, as independent as possible of the person
//! and the place.
//!
//! Places are relative to the window's median, so that the distance from the radar does not matter. Six groups of
//! features:
//!
//! - where the points lie: square roots of the shares of points in cells of lateral place and height, of lateral place
//!   and velocity, and of height and velocity;
//! - which parts move together: correlations of ten series (`N_SERIES`), at once and half a second apart. Correlations
//!   have no scale: large and small people, wide and narrow movements have the same;
//! - how far they move: logarithms of spreads and of steps, distances of the outer deciles from the median, extents;
//! - how fast the movement repeats: square roots of the shares of power in eight bands;
//! - how high the points are above the floor: their deciles, which tell lying from standing;
//! - the course of a single event: number, range, spread, height and velocity of the points in each third of the window, and
//!   when most of them come. In a window of something that goes on, the thirds are alike or depend on where it was cut.
//!
//! The series are the number of points of a step of 0.1 s, and of the points of three steps: median, 5 % and 95 %
//! quantile of lateral place and of height, median of range, mean velocity, 95 % quantile of range.
//!
//! [`mirrored`] turns the features of a movement into those of the same movement to the other side.

use radarllm_base::stats::quantile_linear;
use radarllm_base::{Clip, PointFrame, RadarPoint, series::interpolated};

use crate::windows::{Division, N_TRANSFORM, STEP_S, Window, power_spectrum, steps, windows_with};

/// Edges of the cells of lateral place, m from the median.
const LATERAL_M: [f32; 8] = [-0.75, -0.5, -0.3, -0.12, 0.12, 0.3, 0.5, 0.75];
/// Edges of the cells of height, m from the median.
const HEIGHT_M: [f32; 4] = [-0.45, -0.15, 0.15, 0.45];
/// Edges of the cells of velocity, m/s.
const VELOCITY_MPS: [f32; 2] = [-0.5, 0.5];
const N_LATERAL: usize = LATERAL_M.len() + 1;
const N_HEIGHT: usize = HEIGHT_M.len() + 1;
const N_VELOCITY: usize = VELOCITY_MPS.len() + 1;
const N_CELLS: usize = (N_LATERAL + N_VELOCITY) * N_HEIGHT + N_LATERAL * N_VELOCITY;
/// Number of series.
const N_SERIES: usize = 10;
const N_PAIRS: usize = N_SERIES * (N_SERIES - 1) / 2;
/// Steps between the two values of a delayed correlation.
const DELAY: usize = 5;
/// Series whose mean is a feature: the extents relative to the window's medians.
const EXTENTS: [usize; 5] = [2, 3, 5, 6, 9];
const N_AMPLITUDES: usize = N_SERIES + 3 * (N_SERIES - 1) + EXTENTS.len() + 1;
const N_BANDS: usize = 8;
/// Ends of the bands, Hz; their edges are spaced geometrically.
const BANDS_HZ: [f64; 2] = [0.15, 3.2];
/// Number of deciles of height.
const N_DECILES: usize = 9;
/// Parts of the course.
const N_PARTS: usize = 3;
/// Features of a part, and of all parts together.
const N_OF_PART: usize = 10;
const N_OVERALL: usize = 10;
/// Features of the course, which are the last ones.
pub(crate) const N_COURSE: usize = N_PARTS * N_OF_PART + N_OVERALL;
/// Number of features of a window.
pub const N_FEATURES: usize =
    N_CELLS + 2 * N_PAIRS + N_AMPLITUDES + N_SERIES * N_BANDS + N_DECILES + N_COURSE;
/// Series of the movement to the other side, with their signs.
const OTHER_SIDE: [(usize, f64); N_SERIES] = [
    (0, 1.0),
    (1, -1.0),
    (3, -1.0),
    (2, -1.0),
    (4, 1.0),
    (5, 1.0),
    (6, 1.0),
    (7, 1.0),
    (8, 1.0),
    (9, 1.0),
];

/// The windows of a clip with their [`N_FEATURES`] features, in order.
pub fn windows(clip: &Clip) -> Vec<Window> {
    divided(clip, Division::default())
}

/// The same for another division into windows.
pub fn divided(clip: &Clip, division: Division) -> Vec<Window> {
    let height_m = clip.radar_height_m;
    windows_with(clip, division, |frames, start_s, length_s| {
        features(frames, start_s, length_s, height_m)
    })
}

fn features(frames: &[PointFrame], start_s: f64, length_s: f64, radar_height_m: f32) -> Vec<f32> {
    let steps = steps(frames, start_s, length_s);
    let points: Vec<&RadarPoint> = steps.iter().flatten().copied().collect();
    let middle = |value: fn(&RadarPoint) -> f32| {
        let values = points.iter().map(|p| f64::from(value(p))).collect();
        quantile(&sorted(values), 0.5) as f32
    };
    let middle = [middle(|p| p.x_m), middle(|p| p.z_m), middle(|p| p.range_m)];
    let series = series(&steps, middle);
    let mut out = cells(&points, middle);
    out.extend(correlations(&series));
    out.extend(amplitudes(&series));
    out.extend(rhythm(&series));
    let heights = points.iter().map(|p| f64::from(p.z_m + radar_height_m));
    let heights = sorted(heights.collect());
    out.extend((1..=N_DECILES).map(|i| quantile(&heights, i as f64 / 10.0)));
    out.extend(course(&steps, &points));
    out.into_iter().map(|v| v as f32).collect()
}

fn cells(points: &[&RadarPoint], [lateral_m, height_m, _]: [f32; 3]) -> Vec<f64> {
    let mut counts = vec![0.0; N_CELLS];
    for point in points {
        let place = |value: f32, edges: &[f32]| edges.partition_point(|edge| *edge <= value);
        let x = place(point.x_m - lateral_m, &LATERAL_M);
        let z = place(point.z_m - height_m, &HEIGHT_M);
        let v = place(point.velocity_mps, &VELOCITY_MPS);
        counts[x * N_HEIGHT + z] += 1.0;
        counts[N_LATERAL * N_HEIGHT + x * N_VELOCITY + v] += 1.0;
        counts[N_LATERAL * (N_HEIGHT + N_VELOCITY) + z * N_VELOCITY + v] += 1.0;
    }
    let n = points.len() as f64;
    counts.iter().map(|c| (c / n).sqrt()).collect()
}

/// The series `[N_SERIES][steps]`.
fn series(steps: &[Vec<&RadarPoint>], middle: [f32; 3]) -> Vec<Vec<f64>> {
    let mut series = vec![vec![f64::NAN; steps.len()]; N_SERIES];
    for i in 0..steps.len() {
        series[0][i] = steps[i].len() as f64;
        let around = &steps[i.saturating_sub(1)..(i + 2).min(steps.len())];
        let points: Vec<&RadarPoint> = around.iter().flatten().copied().collect();
        if points.is_empty() {
            continue;
        }
        let values = |value: fn(&RadarPoint) -> f32, middle: f32| {
            let values = points.iter().map(|p| f64::from(value(p) - middle));
            sorted(values.collect())
        };
        let x = values(|p| p.x_m, middle[0]);
        let z = values(|p| p.z_m, middle[1]);
        let range = values(|p| p.range_m, middle[2]);
        let velocity = points.iter().map(|p| f64::from(p.velocity_mps));
        let of_points = [
            quantile(&x, 0.5),
            quantile(&x, 0.05),
            quantile(&x, 0.95),
            quantile(&z, 0.5),
            quantile(&z, 0.05),
            quantile(&z, 0.95),
            quantile(&range, 0.5),
            velocity.sum::<f64>() / points.len() as f64,
            quantile(&range, 0.95),
        ];
        for (series, value) in series[1..].iter_mut().zip(of_points) {
            series[i] = value;
        }
    }
    series.iter().map(|s| interpolated(s)).collect()
}

/// Correlations of all pairs of series, then half the difference between those with the first and with the second series
/// delayed.
fn correlations(series: &[Vec<f64>]) -> Vec<f64> {
    let standard: Vec<Vec<f64>> = series
        .iter()
        .map(|s| {
            let smooth = smoothed(s);
            let (mean, deviation) = mean_and_deviation(&smooth);
            let scale = (deviation + 1e-6).max(1e-2);
            smooth.iter().map(|v| (v - mean) / scale).collect()
        })
        .collect();
    let product = |a: usize, b: usize, delay: usize| {
        let later = standard[a].iter().skip(delay);
        let n = standard[a].len().saturating_sub(delay).max(1);
        later.zip(&standard[b]).map(|(a, b)| a * b).sum::<f64>() / n as f64
    };
    let at_once = pairs().map(|(a, b)| product(a, b, 0));
    let delayed = pairs().map(|(a, b)| 0.5 * (product(a, b, DELAY) - product(b, a, DELAY)));
    at_once.chain(delayed).collect()
}

fn pairs() -> impl Iterator<Item = (usize, usize)> {
    (0..N_SERIES).flat_map(|a| (a + 1..N_SERIES).map(move |b| (a, b)))
}

fn amplitudes(series: &[Vec<f64>]) -> Vec<f64> {
    let spreads = series.iter().map(|s| (mean_and_deviation(s).1 + 0.02).ln());
    let places = &series[1..];
    let steps = places.iter().map(|s| {
        let sum: f64 = s.windows(2).map(|w| (w[1] - w[0]).abs()).sum();
        (sum / s.len().saturating_sub(1).max(1) as f64 + 0.01).ln()
    });
    let deciles = places.iter().flat_map(|s| {
        let s = sorted(s.clone());
        [0.1, 0.9].map(|q| quantile(&s, q) - quantile(&s, 0.5))
    });
    let extents = EXTENTS.iter().map(|s| mean_and_deviation(&series[*s]).0);
    let n_points = (mean_and_deviation(&series[0]).0 + 0.1).ln();
    spreads
        .chain(steps)
        .chain(deciles)
        .chain(extents)
        .chain([n_points])
        .collect()
}

fn rhythm(series: &[Vec<f64>]) -> Vec<f64> {
    let ratio = BANDS_HZ[1] / BANDS_HZ[0];
    let edge = |i: usize| BANDS_HZ[0] * ratio.powf(i as f64 / N_BANDS as f64);
    let hz = |bin: usize| bin as f64 / (N_TRANSFORM as f64 * STEP_S);
    let of_series = |s: &Vec<f64>| {
        let power = power_spectrum(s, mean_and_deviation(s).0);
        let bands: [f64; N_BANDS] = std::array::from_fn(|band| {
            let bins = power.iter().enumerate();
            bins.filter(|(bin, _)| hz(*bin) > edge(band) && hz(*bin) <= edge(band + 1))
                .map(|(_, p)| p)
                .sum()
        });
        let total: f64 = bands.iter().sum::<f64>() + 1e-9;
        bands.map(|b| (b / total).sqrt())
    };
    series.iter().flat_map(of_series).collect()
}

/// The [`N_COURSE`] features of the course: those of each third, then spread and extent of all points, and the largest number
/// of points, for how long there are at least half as many, and how many there are at the end and at the beginning.
fn course(steps: &[Vec<&RadarPoint>], all: &[&RadarPoint]) -> Vec<f64> {
    let of = |points: &[&RadarPoint], value: fn(&RadarPoint) -> f32| -> Vec<f64> {
        sorted(points.iter().map(|p| f64::from(value(p))).collect())
    };
    let deviation = |values: &[f64]| mean_and_deviation(values).1;
    let range_m = quantile(&of(all, |p| p.range_m), 0.5);
    let height_m = quantile(&of(all, |p| p.z_m), 0.5);
    let mut out = Vec::with_capacity(N_COURSE);
    let n = steps.len();
    for part in 0..N_PARTS {
        // One step of the neighbours belongs to a part as well.
        let first = (part * n / N_PARTS).saturating_sub(1);
        let last = ((part + 1) * n / N_PARTS + 1).min(n);
        let own: Vec<&RadarPoint> = steps[first..last].iter().flatten().copied().collect();
        out.push((own.len() as f64 / (last - first) as f64 + 0.3).ln());
        let points = if own.len() > 2 { &own[..] } else { all };
        let range = of(points, |p| p.range_m);
        let height = of(points, |p| p.z_m);
        let velocity = of(points, |p| p.velocity_mps);
        let speed: f64 = velocity.iter().map(|v| v.abs()).sum();
        out.extend([
            quantile(&range, 0.5) - range_m,
            deviation(&range),
            deviation(&of(points, |p| p.x_m)),
            deviation(&height),
            quantile(&height, 0.1) - height_m,
            quantile(&height, 0.5) - height_m,
            quantile(&height, 0.9) - height_m,
            mean_and_deviation(&velocity).0,
            speed / points.len().max(1) as f64,
        ]);
    }
    for values in [
        of(all, |p| p.range_m),
        of(all, |p| p.x_m),
        of(all, |p| p.z_m),
    ] {
        out.push(deviation(&values));
        out.push(quantile(&values, 0.95) - quantile(&values, 0.05));
    }
    // Numbers of points over half a second.
    let smooth: Vec<f64> = (0..n)
        .map(|i| {
            let around = &steps[i.saturating_sub(2)..(i + 3).min(n)];
            around.iter().map(|step| step.len() as f64).sum::<f64>() / 5.0
        })
        .collect();
    let largest = smooth.iter().copied().fold(0.0, f64::max);
    let share = smooth.iter().filter(|n| **n > 0.5 * largest).count() as f64 / n as f64;
    let of_end = |values: &[f64]| mean_and_deviation(values).0 + 0.3;
    let n_end = n.min(5);
    out.extend([
        (largest + 0.3).ln(),
        share,
        (of_end(&smooth[n - n_end..]) / (largest + 0.3)).ln(),
        (of_end(&smooth[..n_end]) / (largest + 0.3)).ln(),
    ]);
    out
}

/// Features of the same movement to the other side.
pub fn mirrored(features: &[f32]) -> Vec<f32> {
    let (cells, rest) = features.split_at(N_CELLS);
    let (correlations, rest) = rest.split_at(2 * N_PAIRS);
    let (amplitudes, rhythm) = rest.split_at(N_AMPLITUDES);
    let mut out = Vec::with_capacity(features.len());
    for x in (0..N_LATERAL).rev() {
        out.extend(&cells[x * N_HEIGHT..][..N_HEIGHT]);
    }
    for x in (0..N_LATERAL).rev() {
        out.extend(&cells[N_LATERAL * N_HEIGHT + x * N_VELOCITY..][..N_VELOCITY]);
    }
    out.extend(&cells[N_LATERAL * (N_HEIGHT + N_VELOCITY)..]);
    let (at_once, delayed) = correlations.split_at(N_PAIRS);
    for (values, swapped_sign) in [(at_once, 1.0), (delayed, -1.0)] {
        out.extend(pairs().map(|(a, b)| {
            let ((a, sign_a), (b, sign_b)) = (OTHER_SIDE[a], OTHER_SIDE[b]);
            let sign = (sign_a * sign_b) as f32;
            match a < b {
                true => sign * values[index_of_pair(a, b)],
                false => sign * swapped_sign * values[index_of_pair(b, a)],
            }
        }));
    }
    let (spreads, rest) = amplitudes.split_at(N_SERIES);
    let (steps, rest) = rest.split_at(N_SERIES - 1);
    let (deciles, rest) = rest.split_at(2 * (N_SERIES - 1));
    let (extents, n_points) = rest.split_at(EXTENTS.len());
    out.extend(OTHER_SIDE.iter().map(|(other, _)| spreads[*other]));
    let places = &OTHER_SIDE[1..];
    out.extend(places.iter().map(|(other, _)| steps[other - 1]));
    out.extend(places.iter().flat_map(|(other, sign)| {
        let [low, high] = [0, 1].map(|i| deciles[2 * (other - 1) + i]);
        if *sign < 0.0 {
            [-high, -low]
        } else {
            [low, high]
        }
    }));
    // The first two extents are those to the sides.
    out.extend([-extents[1], -extents[0]]);
    out.extend(&extents[2..]);
    out.extend(n_points);
    for (other, _) in OTHER_SIDE {
        out.extend(&rhythm[other * N_BANDS..][..N_BANDS]);
    }
    out.extend(&rhythm[N_SERIES * N_BANDS..]);
    out
}

fn index_of_pair(a: usize, b: usize) -> usize {
    a * (2 * N_SERIES - a - 1) / 2 + b - a - 1
}

/// Mean of each value and its neighbours; the ends are repeated.
fn smoothed(values: &[f64]) -> Vec<f64> {
    let last = values.len() - 1;
    let at = |i: usize| (values[i.saturating_sub(1)] + values[i] + values[(i + 1).min(last)]) / 3.0;
    (0..values.len()).map(at).collect()
}

fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (mean, (squares / n).sqrt())
}

/// 0 without values.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    quantile_linear(sorted, share).unwrap_or_default()
}

fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values
}

#[cfg(test)]
mod tests {
    use radarllm_base::{Clutter, Provenance, seed::derive_seed};

    use super::*;

    /// Points of a person whose parts move in their own ways, at places from a hash.
    fn clip(place: impl Fn(&RadarPoint) -> RadarPoint) -> Clip {
        let uniform = |name: String| (derive_seed(1, &name) % 10_007) as f32 / 10_007.0;
        let frame = |i: u32| {
            let time_s = f64::from(i) / 10.0;
            let swing = (2.0 * time_s as f32).sin();
            let point = |k: u32| {
                let [x, y, z, v] = [0, 1, 2, 3].map(|c| uniform(format!("{i} {k} {c}")) - 0.5);
                let arm = if k < 3 {
                    0.6 + 0.3 * swing
                } else {
                    0.1 * swing
                };
                let (x_m, y_m, z_m) = (arm + 0.4 * x, 2.0 + 0.2 * y, z + 0.1 * swing);
                place(&RadarPoint {
                    x_m,
                    y_m,
                    z_m,
                    range_m: (x_m * x_m + y_m * y_m + z_m * z_m).sqrt(),
                    velocity_mps: 2.0 * v * swing,
                    ..RadarPoint::default()
                })
            };
            PointFrame {
                frame: i,
                time_s,
                points: (0..3 + i % 8).map(point).collect(),
                board: None,
            }
        };
        Clip {
            frames: (0..70).map(frame).collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "test".into(),
            provenance: Provenance::recorded("csv", "test.csv"),
            clutter: Clutter::Settled,
        }
    }

    fn features_of(place: impl Fn(&RadarPoint) -> RadarPoint) -> Vec<f32> {
        windows(&clip(place))[0].features.clone().unwrap()
    }

    fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
        assert_eq!((a.len(), b.len()), (N_FEATURES, N_FEATURES));
        let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
        differences.fold(0.0, f32::max)
    }

    #[test]
    fn mirrored_features_are_those_of_the_mirrored_movement() {
        let here = features_of(|p| *p);
        let other_side = features_of(|p| RadarPoint { x_m: -p.x_m, ..*p });
        assert!(largest_difference(&here, &other_side) > 0.3);
        assert!(largest_difference(&mirrored(&here), &other_side) < 1e-4);
        assert_eq!(mirrored(&mirrored(&here)), here);
    }

    #[test]
    fn only_the_height_above_the_floor_depends_on_the_place() {
        let here = features_of(|p| *p);
        let elsewhere = features_of(|p| RadarPoint {
            x_m: p.x_m + 0.5,
            z_m: p.z_m - 0.25,
            range_m: p.range_m + 1.0,
            ..*p
        });
        let parts = |features: &[f32]| {
            let (shape, rest) = features.split_at(N_FEATURES - N_COURSE - N_DECILES);
            let (heights, course) = rest.split_at(N_DECILES);
            ([shape, course].concat(), heights.to_vec())
        };
        let (shape, heights) = parts(&here);
        let (other_shape, other_heights) = parts(&elsewhere);
        let same = |(a, b): (&f32, &f32)| (a - b).abs() < 0.05;
        assert!(shape.iter().zip(&other_shape).all(same));
        let lower = |(a, b): (&f32, &f32)| (a - b - 0.25).abs() < 1e-4;
        assert!(heights.iter().zip(&other_heights).all(lower));
    }

    #[test]
    fn parts_that_move_apart_correlate_negatively() {
        // The outermost points to the left and to the right: a lunge to the side moves both, a clap moves them apart.
        let pair = |moves: fn(f32, f32) -> f32| {
            let mut clip = clip(|p| *p);
            for frame in &mut clip.frames {
                let swing = (2.0 * frame.time_s as f32).sin();
                let side = |x_m: f32| RadarPoint {
                    x_m: moves(x_m, swing),
                    y_m: 2.0,
                    range_m: 2.0,
                    ..RadarPoint::default()
                };
                frame.points = [-0.5, 0.0, 0.5].map(side).to_vec();
            }
            let features = windows(&clip)[0].features.clone().unwrap();
            features[N_CELLS + index_of_pair(2, 3)]
        };
        assert!(pair(|x, swing| x + 0.2 * swing) > 0.95);
        assert!(pair(|x, swing| x * (1.0 + 0.4 * swing)) < -0.95);
    }

    #[test]
    fn short_and_sparse_windows_have_finite_features() {
        for (n_frames, keep) in [(1, 5), (2, 5), (4, 5), (70, 1)] {
            let mut short = clip(|p| *p);
            short.frames.truncate(n_frames);
            let points = short.frames[0].points[0];
            for (i, frame) in short.frames.iter_mut().enumerate() {
                frame.points = vec![points; if i == 0 { 5 } else { keep % 5 }];
            }
            for window in windows(&short) {
                let features = window.features.unwrap();
                assert_eq!(features.len(), N_FEATURES);
                assert!(
                    features
                        .iter()
                        .chain(&mirrored(&features))
                        .all(|v| v.is_finite())
                );
            }
        }
    }
}
