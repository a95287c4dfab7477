//! What the points of a window show, as numbers: where in the person the motion is, what approaches and recedes, how fast
//! what repeats, and how the window goes on.

use radarllm_base::PointFrame;
use radarllm_base::series::interpolated;

use crate::tokenizer::context::{self, power, without_trend};
use crate::tokenizer::layout::{Body, N_LAYOUT, Placed, quantile, values as layout_values};

/// Shares of the points, sorted by height, between which are the legs, and all above.
const PARTS: [[f32; 2]; 2] = [[0.0, 0.35], [0.35, 1.0]];
/// Shares of the points of a part that are slower than the slow, the middle and the fast ones that are looked at.
const SPEEDS: [f32; 3] = [0.3, 0.6, 0.85];
/// Of the points of a part that approach or recede at one of these speeds: mean, lower and upper quartile of the offset
/// across the line of sight, mean offset along it, and their share.
const N_OF_CELL: usize = 5;
/// Values of what approaches and recedes.
const N_CELLS: usize = PARTS.len() * SPEEDS.len() * 2 * N_OF_CELL;

/// Series of a frame's points: logarithm of their number, mean height, range and velocity, height of the highest ones, and
/// speed of the fast ones.
const N_SERIES: usize = 6;
/// Of the first series, the parts of the window are stated relative to its mean.
const N_RELATIVE: usize = 4;
/// Highest points and fast points: this share is below or slower.
const HIGHEST: f32 = 0.95;
const FASTEST: f32 = 0.9;
/// Lowest and highest rate of a series, Hz, the bands between them, whose edges have equal ratios, and the rates of a band.
const RATES_HZ: [f32; 2] = [0.25, 4.6];
const N_BANDS: usize = 12;
const N_RATES: usize = 4;
/// Smallest standard deviation of a series whose logarithm is told apart.
const MIN_DEVIATION: f32 = 1e-3;
/// Parts of the window.
const N_PARTS: usize = 5;
/// Values of the series.
const N_OF_SERIES: usize = N_BANDS + 1 + N_PARTS;

/// Shares of all points with a lower velocity, and with a lower height, that are stated.
const VELOCITIES: [f32; 9] = [0.01, 0.05, 0.15, 0.3, 0.5, 0.7, 0.85, 0.95, 0.99];
const HEIGHTS: [f32; 7] = [0.03, 0.1, 0.25, 0.5, 0.75, 0.9, 0.97];
/// Quarters of the points by height, and shares of the points of each that are slower.
const N_QUARTERS: usize = 4;
const QUARTER_SPEEDS: [f32; 3] = [0.5, 0.8, 0.95];
/// Values of all points: the above, the logarithm of their mean number in a frame, and the share of frames without.
const N_WHOLE: usize = VELOCITIES.len() + HEIGHTS.len() + N_QUARTERS * QUARTER_SPEEDS.len() + 2;

/// Number of values of a window.
pub const N_VALUES: usize = N_LAYOUT + N_CELLS + N_SERIES * N_OF_SERIES + N_WHOLE;

/// What the points of a window show, and what those of its mirror image show.
#[derive(Clone, Debug, PartialEq)]
pub struct WindowValues {
    seen: Vec<f32>,
    mirrored: Vec<f32>,
}

impl WindowValues {
    /// Values of frames at ten per second of a radar at a height above the floor, m; `None` without points.
    pub fn of(frames: &[PointFrame], radar_height_m: f32) -> Option<Self> {
        let mut mirrored = frames.to_vec();
        mirrored.iter_mut().for_each(PointFrame::mirror);
        let unsided = unsided(frames, radar_height_m);
        let with = |mut sided: Vec<f32>| {
            sided.extend(&unsided);
            sided
        };
        Some(Self {
            seen: with(sided(frames)?),
            mirrored: with(sided(&mirrored)?),
        })
    }

    /// As seen, `[N_VALUES]`.
    pub fn seen(&self) -> &[f32] {
        &self.seen
    }

    /// Of the mirror image, `[N_VALUES]`.
    pub fn mirrored(&self) -> &[f32] {
        &self.mirrored
    }
}

/// The values that differ between a window and its mirror image; `None` without points.
fn sided(frames: &[PointFrame]) -> Option<Vec<f32>> {
    let body = Body::of(frames)?;
    let mut all = Vec::with_capacity(N_VALUES);
    all.extend(layout_values(frames.len(), Some(&body)));
    let points = &body.points;
    for [from, to] in PARTS {
        let part = &points[index(from, points.len())..index(to, points.len())];
        let speeds = part.iter().map(|p| p.point.velocity_mps.abs());
        let edges = SPEEDS.map(|share| quantile(speeds.clone(), share));
        for (i, slowest_mps) in edges.iter().enumerate() {
            let fastest_mps = edges.get(i + 1).copied().unwrap_or(f32::INFINITY);
            for sign in [-1.0, 1.0] {
                let is_in = |p: &&Placed| {
                    let speed_mps = sign * p.point.velocity_mps;
                    speed_mps > *slowest_mps && speed_mps <= fastest_mps
                };
                let cell: Vec<&Placed> = part.iter().filter(is_in).collect();
                all.extend(of_cell(&cell, part.len()));
            }
        }
    }
    Some(all)
}

/// The values of points of a part that has a number of points; zeros without points.
fn of_cell(cell: &[&Placed], n_of_part: usize) -> [f32; N_OF_CELL] {
    let n = cell.len().max(1) as f32;
    let across = |share| quantile(cell.iter().map(|p| p.across_m), share);
    [
        cell.iter().map(|p| p.across_m).sum::<f32>() / n,
        across(0.25),
        across(0.75),
        cell.iter().map(|p| p.along_m).sum::<f32>() / n,
        cell.len() as f32 / n_of_part.max(1) as f32,
    ]
}

/// The values that a window and its mirror image share.
fn unsided(frames: &[PointFrame], radar_height_m: f32) -> Vec<f32> {
    let mut all = Vec::with_capacity(N_SERIES * N_OF_SERIES + N_WHOLE);
    for (i, series) in series(frames, radar_height_m).iter().enumerate() {
        all.extend(rates(series));
        let mean = match i < N_RELATIVE {
            true => mean(series),
            false => 0.0,
        };
        let n = series.len();
        let part = |k: usize| &series[k * n / N_PARTS..(k + 1) * n / N_PARTS];
        all.extend((0..N_PARTS).map(|k| match part(k) {
            [] => 0.0,
            part => self::mean(part) - mean,
        }));
    }
    let mut points: Vec<_> = frames.iter().flat_map(|f| &f.points).collect();
    points.sort_by(|a, b| a.z_m.total_cmp(&b.z_m));
    let velocities = points.iter().map(|p| p.velocity_mps);
    all.extend(VELOCITIES.map(|share| quantile(velocities.clone(), share)));
    let heights = points.iter().map(|p| p.z_m + radar_height_m);
    all.extend(HEIGHTS.map(|share| quantile(heights.clone(), share)));
    for quarter in 0..N_QUARTERS {
        let at = |k: usize| k * points.len() / N_QUARTERS;
        let speeds = points[at(quarter)..at(quarter + 1)]
            .iter()
            .map(|p| p.velocity_mps.abs());
        all.extend(QUARTER_SPEEDS.map(|share| quantile(speeds.clone(), share)));
    }
    let n = frames.len().max(1) as f32;
    let n_empty = frames.iter().filter(|f| f.points.is_empty()).count();
    all.push((points.len() as f32 / n).ln_1p());
    all.push(n_empty as f32 / n);
    all
}

/// The series of frames. Frames without points have heights, ranges and velocities between those of their neighbours, and no
/// speed.
fn series(frames: &[PointFrame], radar_height_m: f32) -> [Vec<f32>; N_SERIES] {
    let of = |value: &dyn Fn(&PointFrame) -> f32| -> Vec<f32> {
        let values = frames.iter().map(|f| match f.points.is_empty() {
            true => f64::NAN,
            false => f64::from(value(f)),
        });
        let filled = interpolated(&values.collect::<Vec<_>>());
        filled.into_iter().map(|v| v as f32).collect()
    };
    let velocity = |f: &PointFrame| {
        f.points.iter().map(|p| p.velocity_mps).sum::<f32>() / f.points.len() as f32
    };
    let highest =
        |f: &PointFrame| radar_height_m + quantile(f.points.iter().map(|p| p.z_m), HIGHEST);
    let fastest = |f: &PointFrame| quantile(f.points.iter().map(|p| p.velocity_mps.abs()), FASTEST);
    // The context's mean velocity is 0 where there are no points.
    let [counts, heights, ranges, _] = context::series(frames);
    [
        counts,
        heights,
        ranges,
        of(&velocity),
        of(&highest),
        frames.iter().map(fastest).collect(),
    ]
}

/// The shares of a series' power in bands of rates, and the logarithm of its standard deviation.
fn rates(series: &[f32]) -> [f32; N_BANDS + 1] {
    let residuals = without_trend(series);
    let n = residuals.len().max(1) as f32;
    let variance = residuals.iter().map(|v| v * v).sum::<f32>() / n;
    let taper = |i: usize| 1.0 - (std::f32::consts::TAU * (i as f32 + 0.5) / n).cos();
    let tapered: Vec<f32> = residuals
        .iter()
        .enumerate()
        .map(|(i, v)| v * taper(i))
        .collect();
    let [lowest, highest] = RATES_HZ;
    let rate_hz = |k: usize| {
        let share = (k as f32 + 0.5) / (N_BANDS * N_RATES) as f32;
        lowest * (highest / lowest).powf(share)
    };
    // Wider bands contain more rates.
    let power_of = |k: usize| power(&tapered, rate_hz(k)) * rate_hz(k);
    let bands: [f32; N_BANDS] =
        std::array::from_fn(|band| (band * N_RATES..(band + 1) * N_RATES).map(power_of).sum());
    let total: f32 = bands.iter().sum::<f32>().max(1e-9);
    let mut all = [0.0; N_BANDS + 1];
    for (out, band) in all.iter_mut().zip(bands) {
        *out = band / total;
    }
    all[N_BANDS] = (variance.sqrt() + MIN_DEVIATION).ln();
    all
}

fn index(share: f32, n: usize) -> usize {
    ((share * n as f32) as usize).min(n)
}

fn mean(values: &[f32]) -> f32 {
    values.iter().sum::<f32>() / values.len().max(1) as f32
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use radarllm_base::RadarPoint;
    use radarllm_base::random::SplitMix64;

    /// The index of a value of a cell.
    pub(in crate::evidence) fn of_cell_index(part: usize, speed: usize, recedes: usize) -> usize {
        N_LAYOUT + ((part * SPEEDS.len() + speed) * 2 + recedes) * N_OF_CELL
    }

    /// A body of 0.4 m at 3 m, and a hand beside it that approaches and recedes at a rate.
    pub(crate) fn punches(hand_m: f32, rate_hz: f32) -> Vec<PointFrame> {
        let mut rng = SplitMix64::new(5);
        let frame = |i: u32| {
            let mut points: Vec<RadarPoint> = (0..24)
                .map(|_| RadarPoint {
                    x_m: 0.4 * (rng.uniform_f32() - 0.5),
                    y_m: 3.0,
                    z_m: rng.uniform_f32() - 0.7,
                    range_m: 3.0,
                    velocity_mps: 0.1 * (rng.uniform_f32() - 0.5),
                    ..RadarPoint::default()
                })
                .collect();
            let phase = std::f32::consts::TAU * rate_hz * 0.1 * i as f32;
            points.extend((0..6).map(|_| RadarPoint {
                x_m: hand_m,
                y_m: 2.7,
                z_m: 0.4,
                range_m: 2.7,
                velocity_mps: -1.5 * phase.cos(),
                ..RadarPoint::default()
            }));
            PointFrame {
                frame: i,
                points,
                ..PointFrame::default()
            }
        };
        (0..80).map(frame).collect()
    }

    #[test]
    fn a_fist_shows_in_the_points_that_approach_and_recede_fast() {
        let values = WindowValues::of(&punches(0.3, 1.0), 1.0).unwrap();
        for recedes in [0, 1] {
            let cell = &values.seen()[of_cell_index(1, 2, recedes)..][..N_OF_CELL];
            let [across, low, high, along, share] = *cell else {
                panic!()
            };
            assert!((across - 0.3).abs() < 0.05 && low <= across + 1e-6 && across <= high + 1e-6);
            assert!((along + 0.3).abs() < 0.05, "{along}");
            assert!(share > 0.05);
        }
        // The legs keep still: what moves least in them is on both sides.
        assert!(values.seen()[of_cell_index(0, 2, 0)].abs() < 0.1);
        let mirrored = WindowValues::of(&punches(-0.3, 1.0), 1.0).unwrap();
        let of = |values: &[f32]| values[of_cell_index(1, 2, 0)];
        // The middle of the body is one of its points, so that its mirror image may be the next one.
        assert!((of(values.mirrored()) + of(values.seen())).abs() < 0.05);
        assert!((of(mirrored.seen()) - of(values.mirrored())).abs() < 0.05);
    }

    #[test]
    fn the_rate_of_a_motion_is_in_its_band() {
        for rate_hz in [0.5f32, 1.0, 2.0, 3.0] {
            let values = WindowValues::of(&punches(0.3, rate_hz), 1.0).unwrap();
            let velocity = N_LAYOUT + N_CELLS + 3 * N_OF_SERIES;
            let bands = &values.seen()[velocity..][..N_BANDS];
            assert!((bands.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            let share = (rate_hz / RATES_HZ[0]).ln() / (RATES_HZ[1] / RATES_HZ[0]).ln();
            let expected = (share * N_BANDS as f32) as usize;
            let near = &bands[expected.saturating_sub(1)..(expected + 2).min(N_BANDS)];
            assert!(near.iter().sum::<f32>() > 0.8, "{rate_hz} Hz: {bands:?}");
        }
    }

    #[test]
    fn all_values_are_finite_and_as_many_as_stated() {
        let gap = |n: usize| {
            let mut frames = punches(0.2, 1.0);
            frames.truncate(n);
            frames.iter_mut().step_by(2).for_each(|f| f.points.clear());
            frames
        };
        for frames in [punches(0.3, 1.0), gap(80), gap(3), gap(2)] {
            let values = WindowValues::of(&frames, 1.0).unwrap();
            assert_eq!(values.seen().len(), N_VALUES);
            assert_eq!(values.mirrored().len(), N_VALUES);
            assert!(values.seen().iter().all(|v| v.is_finite()));
        }
        assert_eq!(WindowValues::of(&[PointFrame::default()], 1.0), None);
        assert_eq!(WindowValues::of(&[], 1.0), None);
    }
}
