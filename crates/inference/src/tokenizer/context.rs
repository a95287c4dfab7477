//! What a window shows as a whole, as tokens: the tempo of its motion, properties of its board, and where in the person
//! the motion is.
//!
//! A code covers 0.4 s, so rates are spread over many codes, and the language model would have to learn a spectrum. The
//! context states them: the main rate of four time series of the points. It also states what differs between boards, so
//! that the model need not infer it: the step of the velocities, how many points a frame has, and how many frames have
//! none. All of it is measured on the points, because most recordings come without the configuration of their board.

use std::f32::consts::PI;

use radarllm_base::{PointFrame, RadarPoint, series::interpolated};

use super::layout::{N_LAYOUT, N_LAYOUT_TOKENS, layout};

/// Radar frame period, s.
const FRAME_PERIOD_S: f32 = 0.1;

/// Series whose main rate is stated, in the order of their tokens: number of points, mean height, mean range and mean
/// velocity of the points of a frame.
const N_SERIES: usize = 4;
/// Edges between the rates, Hz: a rate below the first edge is rate 0.
const RATE_EDGES_HZ: [f32; 7] = [0.4, 0.55, 0.8, 1.1, 1.5, 2.1, 3.0];
const N_RATES: usize = RATE_EDGES_HZ.len() + 1;
/// Lowest and highest rate that is searched, and the distance of two of them, Hz.
const RATES_HZ: [f32; 3] = [0.25, 4.5, 0.05];
/// A window must hold this many periods of a rate.
const MIN_PERIODS: f32 = 1.5;
/// Shares of a series' power about its main rate, from which on the rate is stated as unclear and as clear.
const SHARES: [f32; 2] = [0.45, 0.7];
/// Series with a smaller standard deviation have no rate: logarithm of the number of points, m, m, m/s.
const MIN_DEVIATION: [f32; N_SERIES] = [0.1, 0.02, 0.02, 0.03];
/// Tokens of a series: no rate, or a rate that is unclear or clear.
const N_TEMPO: usize = 1 + SHARES.len() * N_RATES;

/// Edges between the steps of velocities, m/s. Velocities without a step have a token of their own.
const VELOCITY_STEP_EDGES_MPS: [f32; 6] = [0.05, 0.08, 0.12, 0.18, 0.27, 0.4];
const N_VELOCITY_STEPS: usize = VELOCITY_STEP_EDGES_MPS.len() + 2;
/// Edges between median numbers of points in a frame.
const DENSITY_EDGES: [f32; 8] = [0.5, 1.5, 2.5, 4.5, 8.5, 16.5, 32.5, 64.5];
const N_DENSITIES: usize = DENSITY_EDGES.len() + 1;
/// Edges between shares of frames without points.
const EMPTY_EDGES: [f32; 4] = [0.01, 0.1, 0.3, 0.6];
const N_EMPTY: usize = EMPTY_EDGES.len() + 1;

/// Number of tokens of a context.
pub const CONTEXT_LEN: usize = N_SERIES + 3 + N_LAYOUT;
/// Number of different tokens of tempo and board.
const N_WHOLE: usize = N_SERIES * N_TEMPO + N_VELOCITY_STEPS + N_DENSITIES + N_EMPTY;
/// Number of different context tokens.
pub const N_CONTEXT: usize = N_WHOLE + N_LAYOUT_TOKENS;

/// The context of frames at ten per second: tokens below [`N_CONTEXT`], each kind at its own place. Which frame of
/// reference heights have does not matter.
pub fn context(frames: &[PointFrame]) -> [u32; CONTEXT_LEN] {
    let mut tokens = [0; CONTEXT_LEN];
    for (i, values) in series(frames).iter().enumerate() {
        let tempo = tempo(values, MIN_DEVIATION[i]);
        tokens[i] = i * N_TEMPO + tempo;
    }
    let board = N_SERIES * N_TEMPO;
    let points = || frames.iter().flat_map(|f| &f.points);
    let velocities: Vec<f32> = points().map(|p| p.velocity_mps).collect();
    let step = match velocity_step_mps(&velocities) {
        Some(step_mps) => bin(step_mps, &VELOCITY_STEP_EDGES_MPS),
        None => N_VELOCITY_STEPS - 1,
    };
    tokens[N_SERIES] = board + step;
    let mut counts: Vec<usize> = frames.iter().map(|f| f.points.len()).collect();
    counts.sort_unstable();
    let median = counts.get(counts.len() / 2).copied().unwrap_or(0);
    let density = bin(median as f32, &DENSITY_EDGES);
    tokens[N_SERIES + 1] = board + N_VELOCITY_STEPS + density;
    let n_empty = counts.partition_point(|n| *n == 0);
    let empty = bin(n_empty as f32 / counts.len().max(1) as f32, &EMPTY_EDGES);
    tokens[N_SERIES + 2] = board + N_VELOCITY_STEPS + N_DENSITIES + empty;
    for (token, own) in tokens[N_SERIES + 3..].iter_mut().zip(layout(frames)) {
        *token = N_WHOLE + own;
    }
    tokens.map(|token| token as u32)
}

/// Index of the bin of a value: the number of edges that it is not below.
pub(super) fn bin(value: f32, edges: &[f32]) -> usize {
    edges.partition_point(|edge| *edge <= value)
}

/// The time series. Frames without points have velocity 0 and the height and range between those of their neighbours.
pub(crate) fn series(frames: &[PointFrame]) -> [Vec<f32>; N_SERIES] {
    // NaN without points.
    let means = |of: fn(&RadarPoint) -> f32| {
        let mean =
            move |f: &PointFrame| f.points.iter().map(of).sum::<f32>() / f.points.len() as f32;
        frames.iter().map(mean)
    };
    let filled = |of| {
        let values: Vec<f64> = means(of).map(f64::from).collect();
        interpolated(&values)
            .into_iter()
            .map(|v| v as f32)
            .collect()
    };
    let velocities = means(|p| p.velocity_mps).map(|v| if v.is_nan() { 0.0 } else { v });
    [
        frames
            .iter()
            .map(|f| (f.points.len() as f32).ln_1p())
            .collect(),
        filled(|p| p.z_m),
        filled(|p| p.range_m),
        velocities.collect(),
    ]
}

/// Token of the main rate of a series: 0 without one.
fn tempo(values: &[f32], min_deviation: f32) -> usize {
    let Some((rate_hz, share)) = main_rate_hz(values, min_deviation) else {
        return 0;
    };
    match bin(share, &SHARES) {
        0 => 0,
        clear => 1 + (clear - 1) * N_RATES + bin(rate_hz, &RATE_EDGES_HZ),
    }
}

/// The strongest rate of a series, Hz, and the share of the power about it. `None` if the series hardly changes or is too
/// short.
fn main_rate_hz(values: &[f32], min_deviation: f32) -> Option<(f32, f32)> {
    let residuals = without_trend(values);
    let n = residuals.len() as f32;
    let variance = residuals.iter().map(|v| v * v).sum::<f32>() / n.max(1.0);
    if variance.sqrt() < min_deviation {
        return None;
    }
    let seconds = n * FRAME_PERIOD_S;
    let [lowest, highest, step] = RATES_HZ;
    let tapered: Vec<f32> = residuals
        .iter()
        .enumerate()
        .map(|(i, v)| v * (1.0 - (2.0 * PI * (i as f32 + 0.5) / n).cos()))
        .collect();
    let n_rates = ((highest - lowest) / step).round() as usize + 1;
    let rate_hz = |k: usize| lowest + k as f32 * step;
    let powers: Vec<f32> = (0..n_rates).map(|k| power(&tapered, rate_hz(k))).collect();
    let total: f32 = powers.iter().sum();
    let can_be = (0..n_rates).filter(|k| rate_hz(*k) * seconds >= MIN_PERIODS);
    let best = can_be.max_by(|a, b| powers[*a].total_cmp(&powers[*b]))?;
    // The main lobe of the taper.
    let half_hz = 2.0 / seconds;
    let near = (0..n_rates).filter(|k| (rate_hz(*k) - rate_hz(best)).abs() <= half_hz);
    let about: f32 = near.map(|k| powers[k]).sum();
    (total > 0.0).then(|| (rate_hz(best), about / total))
}

/// Values minus the straight line that fits them best.
pub(crate) fn without_trend(values: &[f32]) -> Vec<f32> {
    let n = values.len() as f32;
    let mean = values.iter().sum::<f32>() / n.max(1.0);
    let time = |i: usize| i as f32 - (n - 1.0) / 2.0;
    let (mut covariance, mut variance) = (0.0f32, 0.0f32);
    for (i, v) in values.iter().enumerate() {
        covariance += time(i) * (v - mean);
        variance += time(i) * time(i);
    }
    let slope = covariance / variance.max(1.0);
    let residual = |(i, v): (usize, &f32)| v - mean - slope * time(i);
    values.iter().enumerate().map(residual).collect()
}

/// Power of a series at one rate.
pub(crate) fn power(values: &[f32], rate_hz: f32) -> f32 {
    let (sin, cos) = (2.0 * PI * rate_hz * FRAME_PERIOD_S).sin_cos();
    let (mut re, mut im, mut phase) = (0.0f32, 0.0f32, (1.0f32, 0.0f32));
    for v in values {
        re += v * phase.0;
        im += v * phase.1;
        phase = (phase.0 * cos - phase.1 * sin, phase.0 * sin + phase.1 * cos);
    }
    re * re + im * im
}

/// The step of which nearly all velocities are multiples, m/s; `None` if there is none, or too few velocities.
fn velocity_step_mps(velocities: &[f32]) -> Option<f32> {
    /// Fewest velocities other than zero.
    const MIN: usize = 8;
    /// Smallest step of a radar, m/s. Velocities that are closer are the same.
    const SMALLEST_MPS: f32 = 0.02;
    /// Largest distance from a multiple, in steps.
    const TOLERANCE: f32 = 0.12;
    /// Share of the velocities that must be multiples: points of other origin may be among them.
    const SHARE: f32 = 0.9;
    let mut speeds: Vec<f32> = velocities.iter().map(|v| v.abs()).collect();
    speeds.retain(|v| *v >= SMALLEST_MPS);
    if speeds.len() < MIN {
        return None;
    }
    speeds.sort_by(f32::total_cmp);
    let is_multiple = |v: f32, step: f32| ((v / step).round() - v / step).abs() <= TOLERANCE;
    // The step is the lowest speed or the smallest difference of two levels that occur.
    let mut candidates = vec![speeds[0]];
    let gaps = speeds.windows(2).map(|pair| pair[1] - pair[0]);
    candidates.extend(gaps.filter(|gap| *gap >= SMALLEST_MPS));
    candidates.sort_by(|a, b| b.total_cmp(a));
    candidates.dedup_by(|a, b| (*a - *b).abs() < 0.02 * *b);
    candidates.into_iter().find(|step| {
        let n = speeds.iter().filter(|v| is_multiple(**v, *step)).count();
        n as f32 >= SHARE * speeds.len() as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn still(z_m: f32, range_m: f32, velocity_mps: f32) -> RadarPoint {
        RadarPoint {
            z_m,
            range_m,
            velocity_mps,
            ..RadarPoint::default()
        }
    }

    fn frame(points: Vec<RadarPoint>) -> PointFrame {
        PointFrame {
            points,
            ..PointFrame::default()
        }
    }

    /// Frames of one point whose height swings at a rate.
    fn swings(n_frames: usize, rate_hz: f32) -> Vec<PointFrame> {
        let phase = |i: usize| 2.0 * PI * rate_hz * i as f32 * FRAME_PERIOD_S;
        (0..n_frames)
            .map(|i| frame(vec![still(1.0 + 0.2 * phase(i).sin(), 2.0, 0.0)]))
            .collect()
    }

    /// Rate of a token of the heights, if it states one.
    fn height_rate(token: u32) -> Option<usize> {
        let tempo = token as usize - N_TEMPO;
        tempo.checked_sub(1).map(|t| t % N_RATES)
    }

    #[test]
    fn the_rate_of_a_swing_is_stated_for_windows_of_any_length() {
        for n_frames in [40, 60, 96] {
            for (rate_hz, rate) in [
                (0.47, 1),
                (0.65, 2),
                (0.95, 3),
                (1.8, 5),
                (2.5, 6),
                (4.0, 7),
            ] {
                let tokens = context(&swings(n_frames, rate_hz));
                assert_eq!(
                    height_rate(tokens[1]),
                    Some(rate),
                    "{rate_hz} Hz, {n_frames}"
                );
                // Neither the number of points nor range or velocity change.
                assert_eq!(tokens[0], 0);
                assert_eq!(tokens[2] as usize, 2 * N_TEMPO);
            }
        }
    }

    #[test]
    fn a_slow_drift_has_no_rate() {
        let drift = |i: usize| frame(vec![still(0.5 + 0.01 * i as f32, 2.0, 0.1)]);
        let tokens = context(&(0..96).map(drift).collect::<Vec<_>>());
        assert_eq!(height_rate(tokens[1]), None);
    }

    #[test]
    fn noise_is_hardly_ever_clear() {
        let mut rng = radarllm_base::random::SplitMix64::new(5);
        let mut n_clear = 0;
        for _ in 0..200 {
            let frames: Vec<PointFrame> = (0..96)
                .map(|_| frame(vec![still(rng.uniform_f32(), 2.0, 0.0)]))
                .collect();
            n_clear += usize::from(height_rate(context(&frames)[1]).is_some());
        }
        assert!(n_clear <= 6, "{n_clear} of 200");
    }

    #[test]
    fn the_step_of_velocities_is_found_among_other_points() {
        let mut rng = radarllm_base::random::SplitMix64::new(9);
        for step in [0.06, 0.13, 0.32] {
            let mut velocities: Vec<f32> = (0..60)
                .map(|_| step * ((rng.uniform_f32() * 13.0).floor() - 6.0))
                .collect();
            velocities.extend([0.577, -1.213]);
            let found = velocity_step_mps(&velocities).unwrap();
            assert!((found / step - 1.0).abs() < 0.05, "{found} for {step}");
        }
        let continuous: Vec<f32> = (0..100).map(|_| rng.uniform_f32() * 2.0).collect();
        assert!(velocity_step_mps(&continuous).is_none_or(|step| step < 0.03));
        assert_eq!(velocity_step_mps(&[0.5; 4]), None);
    }

    #[test]
    fn every_token_is_within_its_kind() {
        let mut all = vec![
            swings(60, 1.0),
            swings(8, 1.0),
            vec![frame(vec![]); 30],
            vec![frame(vec![])],
        ];
        all.push(vec![frame(vec![still(1.0, 2.0, 0.4); 200]); 96]);
        for frames in all {
            let tokens = context(&frames);
            let (whole, layout) = tokens.split_at(N_SERIES + 3);
            let kind = |token: &u32| match *token as usize {
                t if t < N_SERIES * N_TEMPO => t / N_TEMPO,
                t if t < N_SERIES * N_TEMPO + N_VELOCITY_STEPS => N_SERIES,
                t if t < N_WHOLE - N_EMPTY => N_SERIES + 1,
                t if t < N_WHOLE => N_SERIES + 2,
                _ => usize::MAX,
            };
            let kinds: Vec<usize> = whole.iter().map(kind).collect();
            assert_eq!(kinds, (0..N_SERIES + 3).collect::<Vec<_>>());
            let is_layout = |t: &u32| (N_WHOLE..N_CONTEXT).contains(&(*t as usize));
            assert!(layout.len() == N_LAYOUT && layout.iter().all(is_layout));
        }
    }
}
