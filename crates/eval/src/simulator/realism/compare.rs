//! The table: distributions, Chamfer distance, and a classifier trained on simulated points.

use radarllm_base::stats::{median_upper, quantile_nearest};
use radarllm_base::{PointFrame, RadarPoint};
use serde::Serialize;

use super::{RealismConfig, Take};
use crate::{
    classifier::LogisticRegression,
    points::{chamfer, kolmogorov_smirnov, wasserstein_1},
};

/// One quantity's distribution over all points (or frames, for the count).
#[derive(Clone, Debug, Serialize)]
pub struct DistributionRow {
    /// What is compared.
    pub quantity: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// 5th, 50th and 95th percentile of the recording.
    pub recorded: [f64; 3],
    /// The same of the simulation.
    pub simulated: [f64; 3],
    /// Wasserstein-1 distance, in the unit.
    pub wasserstein_1: f64,
    /// Kolmogorov-Smirnov distance, 0..1.
    pub kolmogorov_smirnov: f64,
    /// Kolmogorov-Smirnov distance between the recordings of the first and the other subjects: what
    /// two recordings differ by.
    pub between_subjects: Option<f64>,
}

/// Accuracy of a classifier on recorded windows of subjects that it was not trained on.
#[derive(Clone, Debug, Serialize)]
pub struct ClassifierResult {
    /// Recorded windows tested.
    pub n_test: usize,
    /// Classes.
    pub n_classes: usize,
    /// Trained on simulations of the other subjects' joints.
    pub simulated_to_recorded: f64,
    /// Trained on the other subjects' recordings.
    pub recorded_to_recorded: f64,
    /// Trained and tested on simulations: what the features can tell without any gap.
    pub simulated_to_simulated: f64,
    /// `[true class][predicted class]` of simulated-to-recorded.
    pub confusion: Vec<Vec<usize>>,
}

/// How like the recording the simulation is.
#[derive(Clone, Debug, Serialize)]
pub struct RealismReport {
    /// Frames compared.
    pub frames: usize,
    /// Recorded and simulated points.
    pub points: [usize; 2],
    /// Recorded frames (all have points) whose simulation has none.
    pub empty_simulated: usize,
    /// Distributions.
    pub distributions: Vec<DistributionRow>,
    /// Mean Chamfer distance of a simulated frame to the recorded frame of the same moment, m.
    pub chamfer_m: f64,
    /// The same between a recorded frame and the next recorded frame.
    pub chamfer_next_m: f64,
    /// The same between a recorded frame and a recorded frame of another movement of the same
    /// subject: what knowing nothing about the moment gives. `None` with a single take.
    pub chamfer_other_m: Option<f64>,
    /// The classifier; `None` with fewer than two subjects or classes.
    pub classifier: Option<ClassifierResult>,
}

/// Name, unit, step, value. Values are rounded to the step first: firmware reports bins, and bins that
/// differ by a thousandth would count as different everywhere.
type Quantity = (&'static str, &'static str, f64, fn(&RadarPoint) -> f32);

/// Quantities of a point. Intensities are compared after their medians are taken off: recordings
/// have no absolute reference.
const QUANTITIES: [Quantity; 6] = [
    ("range", "m", 0.05, |p| p.range_m),
    ("x", "m", 0.05, |p| p.x_m),
    ("height z", "m", 0.05, |p| p.z_m),
    ("velocity", "m/s", 0.05, |p| p.velocity_mps),
    ("speed", "m/s", 0.05, |p| p.velocity_mps.abs()),
    ("intensity less median", "dB", 0.5, |p| p.intensity_db),
];

/// Compares simulated with recorded frames, take by take.
///
/// # Panics
/// Never on `simulated` from [`super::replay()`], which has one frame for each recorded frame.
pub fn compare(
    config: &RealismConfig,
    takes: &[Take],
    simulated: &[Vec<PointFrame>],
) -> RealismReport {
    let cropped = |frames: &[PointFrame]| -> Vec<PointFrame> {
        frames
            .iter()
            .map(|f| {
                let mut frame = f.clone();
                config.crop(&mut frame);
                frame
            })
            .collect()
    };
    let recorded: Vec<Vec<PointFrame>> = takes.iter().map(|t| cropped(&t.frames)).collect();
    let simulated: Vec<Vec<PointFrame>> = simulated.iter().map(|f| cropped(f)).collect();

    let of_first = |i: usize| takes[i].subject == takes[0].subject;
    let select = |frames: &[Vec<PointFrame>], keep: &dyn Fn(usize) -> bool| -> Vec<PointFrame> {
        frames
            .iter()
            .enumerate()
            .filter(|(i, _)| keep(*i))
            .flat_map(|(_, f)| f.iter().cloned())
            .collect()
    };
    let all_recorded = select(&recorded, &|_| true);
    let all_simulated = select(&simulated, &|_| true);
    let first = select(&recorded, &of_first);
    let others = select(&recorded, &|i| !of_first(i));

    let n_points = |frames: &[PointFrame]| frames.iter().map(|f| f.points.len()).sum();
    RealismReport {
        frames: all_recorded.len(),
        points: [n_points(&all_recorded), n_points(&all_simulated)],
        empty_simulated: all_simulated.iter().filter(|f| f.points.is_empty()).count(),
        distributions: distributions([&all_recorded, &all_simulated, &first, &others]),
        chamfer_m: mean_chamfer(all_recorded.iter().zip(&all_simulated)),
        chamfer_next_m: mean_chamfer(recorded.iter().flat_map(|f| f.iter().zip(f.iter().skip(1)))),
        chamfer_other_m: (recorded.len() > 1).then(|| {
            mean_chamfer(recorded.iter().enumerate().flat_map(|(i, frames)| {
                // A few movements on: mostly of the same subject and part.
                let step = (recorded.len() / 8 + 1).min(recorded.len() - 1);
                let other = &recorded[(i + step) % recorded.len()];
                frames.iter().zip(other)
            }))
        }),
        classifier: transfer(
            config,
            &labelled(takes, &recorded),
            &labelled(takes, &simulated),
        ),
    }
}

/// Rows of all quantities: recorded, simulated, and two parts of the recording.
pub(super) fn distributions(
    [recorded, simulated, first, others]: [&[PointFrame]; 4],
) -> Vec<DistributionRow> {
    let mut rows: Vec<DistributionRow> = QUANTITIES
        .iter()
        .filter_map(|&(quantity, unit, step, value)| {
            let sample = |frames: &[PointFrame]| -> Vec<f64> {
                let mut values: Vec<f64> = frames
                    .iter()
                    .flat_map(|f| f.points.iter().map(|p| f64::from(value(p))))
                    .collect();
                if unit == "dB" {
                    let median = percentiles(&values).map_or(0.0, |p| p[1]);
                    values.iter_mut().for_each(|v| *v -= median);
                }
                values.iter().map(|v| (v / step).round() * step).collect()
            };
            row(
                (quantity, unit),
                [recorded, simulated, first, others].map(sample),
            )
        })
        .collect();
    let counts = |frames: &[PointFrame]| -> Vec<f64> {
        frames.iter().map(|f| f.points.len() as f64).collect()
    };
    rows.extend(row(
        ("points a frame", ""),
        [recorded, simulated, first, others].map(counts),
    ));
    rows
}

fn row(
    (quantity, unit): (&'static str, &'static str),
    [recorded, simulated, first, others]: [Vec<f64>; 4],
) -> Option<DistributionRow> {
    Some(DistributionRow {
        quantity,
        unit,
        recorded: percentiles(&recorded)?,
        simulated: percentiles(&simulated)?,
        wasserstein_1: wasserstein_1(&recorded, &simulated)?,
        kolmogorov_smirnov: kolmogorov_smirnov(&recorded, &simulated)?,
        between_subjects: kolmogorov_smirnov(&first, &others),
    })
}

/// 5th, 50th and 95th; `None` without values.
fn percentiles(values: &[f64]) -> Option<[f64; 3]> {
    let at = |q: f64| quantile_nearest(values.iter().copied(), q);
    Some([at(0.05)?, at(0.5)?, at(0.95)?])
}

fn places(frame: &PointFrame) -> Vec<[f32; 3]> {
    frame.points.iter().map(|p| [p.x_m, p.y_m, p.z_m]).collect()
}

/// Mean over the pairs in which both have points; NaN without any.
fn mean_chamfer<'a>(pairs: impl Iterator<Item = (&'a PointFrame, &'a PointFrame)>) -> f64 {
    let distances: Vec<f64> = pairs
        .filter_map(|(a, b)| chamfer(&places(a), &places(b)))
        .collect();
    distances.iter().sum::<f64>() / distances.len() as f64
}

/// Side of the grid over x and z, cells.
const GRID: usize = 6;
/// Half width of the grid around the person, m.
const GRID_HALF_M: f32 = 1.0;

/// Borders of the speed classes, m/s.
const SPEEDS_MPS: [f32; 4] = [0.2, 0.9, 1.5, 2.5];

/// Where the approaching, the slow and the receding points of a window lie, seen from the front,
/// relative to the median x: square roots of shares; then mean and deviation of the counts; then
/// shares by speed.
fn features(window: &[PointFrame]) -> Vec<f64> {
    let xs = window.iter().flat_map(|f| f.points.iter().map(|p| p.x_m));
    let middle_x = median_upper(xs).unwrap_or_default();
    let cell = |v: f32| {
        let share = (v + GRID_HALF_M) / (2.0 * GRID_HALF_M);
        ((share * GRID as f32).floor().max(0.0) as usize).min(GRID - 1)
    };
    let mut counts = vec![0.0; 3 * GRID * GRID];
    for p in window.iter().flat_map(|f| &f.points) {
        let moving = if p.velocity_mps < -0.1 {
            0
        } else if p.velocity_mps > 0.1 {
            2
        } else {
            1
        };
        counts[(moving * GRID + cell(p.x_m - middle_x)) * GRID + cell(p.z_m)] += 1.0;
    }
    let total = counts.iter().sum::<f64>().max(1.0);
    let mut out: Vec<f64> = counts.iter().map(|c| (c / total).sqrt()).collect();
    let n = window.len() as f64;
    let per_frame: Vec<f64> = window.iter().map(|f| f.points.len() as f64).collect();
    let mean = per_frame.iter().sum::<f64>() / n;
    let variance = per_frame.iter().map(|c| (c - mean).powi(2)).sum::<f64>() / n;
    out.extend([mean.ln_1p(), variance.sqrt() / mean.max(1.0)]);
    let mut speeds = [0.0; SPEEDS_MPS.len() + 1];
    for p in window.iter().flat_map(|f| &f.points) {
        let bin = SPEEDS_MPS
            .iter()
            .filter(|s| p.velocity_mps.abs() > **s)
            .count();
        speeds[bin] += 1.0;
    }
    out.extend(speeds.map(|n| f64::sqrt(n / total)));
    out
}

/// A labelled piece of recording or simulation; pieces of one group are never trained and tested
/// together.
pub(super) struct Clip {
    pub group: usize,
    pub class: usize,
    pub frames: Vec<PointFrame>,
}

/// Takes with their subject as group.
fn labelled(takes: &[Take], frames: &[Vec<PointFrame>]) -> Vec<Clip> {
    let mut subjects: Vec<&str> = takes.iter().map(|t| t.subject.as_str()).collect();
    subjects.sort_unstable();
    subjects.dedup();
    takes
        .iter()
        .zip(frames)
        .map(|(take, frames)| Clip {
            group: subjects
                .iter()
                .position(|s| *s == take.subject)
                .unwrap_or_default(),
            class: take.class,
            frames: frames.clone(),
        })
        .collect()
}

/// Every group in turn is tested by classifiers that never saw it; `None` with one group or class.
pub(super) fn transfer(
    config: &RealismConfig,
    recorded: &[Clip],
    simulated: &[Clip],
) -> Option<ClassifierResult> {
    let n_classes = recorded.iter().map(|c| c.class).max()? + 1;
    let n_groups = recorded.iter().map(|c| c.group).max()? + 1;
    if n_groups < 2 || n_classes < 2 {
        return None;
    }
    let windows = |clips: &[Clip], keep: &dyn Fn(usize) -> bool| {
        let mut rows = Vec::new();
        let mut labels = Vec::new();
        for clip in clips.iter().filter(|c| keep(c.group)) {
            for window in clip
                .frames
                .windows(config.window_frames)
                .step_by(config.window_stride)
            {
                rows.push(features(window));
                labels.push(clip.class);
            }
        }
        (rows, labels)
    };
    let mut confusion = vec![vec![0; n_classes]; n_classes];
    let (mut n_test, mut n_test_simulated, mut right) = (0, 0, [0; 3]);
    for group in 0..n_groups {
        let (test, truth) = windows(recorded, &|g| g == group);
        let (test_sim, truth_sim) = windows(simulated, &|g| g == group);
        let (sim_rows, sim_labels) = windows(simulated, &|g| g != group);
        let (rec_rows, rec_labels) = windows(recorded, &|g| g != group);
        let from_sim = LogisticRegression::train(&sim_rows, &sim_labels, n_classes)?;
        let from_rec = LogisticRegression::train(&rec_rows, &rec_labels, n_classes)?;
        for (row, &label) in test.iter().zip(&truth) {
            let guess = from_sim.predict(row);
            confusion[label][guess] += 1;
            right[0] += usize::from(guess == label);
            right[1] += usize::from(from_rec.predict(row) == label);
        }
        for (row, &label) in test_sim.iter().zip(&truth_sim) {
            right[2] += usize::from(from_sim.predict(row) == label);
        }
        n_test += truth.len();
        n_test_simulated += truth_sim.len();
    }
    let share = |n: usize, of: usize| n as f64 / of.max(1) as f64;
    Some(ClassifierResult {
        n_test,
        n_classes,
        simulated_to_recorded: share(right[0], n_test),
        recorded_to_recorded: share(right[1], n_test),
        simulated_to_simulated: share(right[2], n_test_simulated),
        confusion,
    })
}
