//! What fits the examples, and what does not.
//!
//! Windows are compared as running means of [`N_MEAN`] windows, because the mean of an activity over ten seconds varies
//! less than a single window. The distance of a mean to an activity is the Mahalanobis distance with the covariance of
//! windows within activities, pooled over all of them and shrunk towards a multiple of the identity, because a few
//! recordings do not determine 126 x 126 numbers (regularised discriminant analysis, Friedman, JASA 1989).
//!
//! An activity is recognised only if the distance is not much larger than that of examples to their own activities,
//! each compared with the others. Without this limit a memory of two activities would recognise one of them in
//! everything. The limit is common to all activities, because three examples do not determine one for each.
//!
//! The constants were chosen on half A of RadHAR (docs/results/recorded.md), by teaching four of its five activities and
//! counting what was recognised in the fifth.

use radarllm_base::Clip;

use crate::{
    features::{N_FEATURES, Window, windows},
    memory::{Memory, Warning},
};

/// Windows of a running mean.
pub const N_MEAN: usize = 15;
/// Weight of the identity in the pooled covariance.
const SHRINKAGE: f64 = 0.9;
/// Standardised features are limited to this many standard deviations.
const LIMIT: f64 = 6.0;
/// An activity is recognised up to this multiple of the largest distance of its examples, in the mean of all
/// activities.
const MARGIN: f64 = 1.4;

/// A part of a recording in which a taught activity is recognised.
#[derive(Clone, Debug, PartialEq)]
pub struct Recognised {
    /// Start on the clock of the recording's frames, s.
    pub start_s: f64,
    /// End, s.
    pub end_s: f64,
    /// Name of the activity.
    pub name: String,
    /// Its sentence.
    pub says: String,
    /// How well it fits, 0..=1: 1 at no distance, 0 at the limit.
    pub fit: f32,
}

/// Compares recordings with the examples of a memory.
pub struct Recogniser {
    mean: Vec<f64>,
    scale: Vec<f64>,
    /// Lower triangle of the Cholesky factor of the shrunk covariance, `[N_FEATURES][N_FEATURES]`.
    factor: Vec<f64>,
    activities: Vec<Known>,
    /// Largest distance at which an activity is recognised.
    limit: f64,
}

struct Known {
    name: String,
    says: String,
    mean: Vec<f64>,
}

impl Recogniser {
    /// Prepares a memory; `None` if it is empty.
    pub fn new(memory: &Memory) -> Option<Self> {
        let taught = memory.activities();
        let all: Vec<&Vec<f32>> = taught
            .iter()
            .flat_map(|a| &a.examples)
            .flat_map(|e| &e.windows)
            .collect();
        if all.is_empty() {
            return None;
        }
        let (mean, scale) = standardisation(&all);
        let standardised = |w: &[f32]| standardise(w, &mean, &scale);
        // Mean of each example: [activity][example].
        let examples: Vec<Vec<Vec<f64>>> = taught
            .iter()
            .map(|a| {
                let of = |e: &crate::Example| mean_of(e.windows.iter().map(|w| standardised(w)));
                a.examples.iter().map(of).collect()
            })
            .collect();
        let means: Vec<Vec<f64>> = examples
            .iter()
            .map(|e| mean_of(e.iter().cloned()))
            .collect();
        let mut covariance = vec![0.0; N_FEATURES * N_FEATURES];
        for (activity, mean) in taught.iter().zip(&means) {
            for window in activity.examples.iter().flat_map(|e| &e.windows) {
                let centred: Vec<f64> = standardised(window)
                    .iter()
                    .zip(mean)
                    .map(|(v, m)| v - m)
                    .collect();
                add_outer_product(&mut covariance, &centred);
            }
        }
        covariance.iter_mut().for_each(|v| *v /= all.len() as f64);
        let factor = cholesky(&shrunk(covariance));
        let mut recogniser = Self {
            mean: mean.clone(),
            scale: scale.clone(),
            factor,
            activities: Vec::new(),
            limit: 0.0,
        };
        let spreads: Vec<f64> = examples
            .iter()
            .filter_map(|means| recogniser.spread(means))
            .collect();
        // Single examples have no spread of their own: that of their windows stands for it.
        let of_windows = || {
            let distance = |w: &&Vec<f32>| {
                let window = standardised(w);
                let distances = means.iter().map(|mean| recogniser.distance(&window, mean));
                distances.fold(f64::INFINITY, f64::min)
            };
            all.iter().map(distance).sum::<f64>() / all.len() as f64
        };
        recogniser.limit = MARGIN
            * match spreads.is_empty() {
                true => of_windows(),
                false => spreads.iter().sum::<f64>() / spreads.len() as f64,
            };
        let known = taught.iter().zip(means).map(|(taught, mean)| Known {
            name: taught.name.clone(),
            says: taught.says.clone(),
            mean,
        });
        recogniser.activities = known.collect();
        Some(recogniser)
    }

    /// Largest distance of an example to the mean of the others; `None` for fewer than two examples.
    fn spread(&self, means: &[Vec<f64>]) -> Option<f64> {
        let left_out = |i: usize| {
            let others = means.iter().enumerate().filter(|(j, _)| *j != i);
            let rest = mean_of(others.map(|(_, m)| m.clone()));
            self.distance(&means[i], &rest)
        };
        (means.len() > 1).then(|| (0..means.len()).map(left_out).fold(0.0, f64::max))
    }

    /// Parts of a prepared clip in which taught activities are recognised, in order of time.
    pub fn recognise(&self, clip: &Clip) -> Vec<Recognised> {
        let windows = windows(clip);
        let features: Vec<Option<Vec<f64>>> = windows
            .iter()
            .map(|w| {
                w.features
                    .as_ref()
                    .map(|f| standardise(f, &self.mean, &self.scale))
            })
            .collect();
        let mut parts: Vec<Recognised> = Vec::new();
        for i in 0..windows.len() {
            let first = i.saturating_sub(N_MEAN / 2);
            let last = (i + N_MEAN / 2).min(windows.len() - 1);
            let around: Vec<&Vec<f64>> = features[first..=last].iter().flatten().collect();
            if around.is_empty() {
                continue;
            }
            let mean = mean_of(around.into_iter().cloned());
            let Some((known, distance)) = self.nearest(&mean) else {
                continue;
            };
            if distance > self.limit {
                continue;
            }
            let fit = (1.0 - distance / self.limit.max(f64::MIN_POSITIVE)) as f32;
            let (start_s, end_s) = share_of_time(&windows, i);
            match parts.last_mut() {
                Some(part) if part.name == known.name && (start_s - part.end_s).abs() < 1e-6 => {
                    part.end_s = end_s;
                    part.fit = part.fit.max(fit);
                }
                _ => parts.push(Recognised {
                    start_s,
                    end_s,
                    name: known.name.clone(),
                    says: known.says.clone(),
                    fit,
                }),
            }
        }
        parts
    }

    /// The nearest activity.
    fn nearest(&self, mean: &[f64]) -> Option<(&Known, f64)> {
        let distances = self
            .activities
            .iter()
            .map(|a| (a, self.distance(mean, &a.mean)));
        distances.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Mahalanobis distance.
    fn distance(&self, a: &[f64], b: &[f64]) -> f64 {
        // |L^-1 (a - b)| by forward substitution.
        let mut solved = vec![0.0; N_FEATURES];
        for i in 0..N_FEATURES {
            let row = &self.factor[i * N_FEATURES..][..=i];
            let known: f64 = row[..i].iter().zip(&solved).map(|(l, x)| l * x).sum();
            solved[i] = (a[i] - b[i] - known) / row[i];
        }
        solved.iter().map(|x| x * x).sum::<f64>().sqrt()
    }
}

impl Memory {
    /// Examples that resemble another activity more than their own, each compared with a memory that lacks it.
    pub fn contradictions(&self) -> Vec<Warning> {
        let mut found = Vec::new();
        for taught in self.activities() {
            for (i, example) in taught.examples.iter().enumerate() {
                if taught.examples.len() < 2 {
                    continue;
                }
                let without = self.without_example(&taught.name, i);
                let Some(recogniser) = Recogniser::new(&without) else {
                    continue;
                };
                let windows = example.windows.iter();
                let mean =
                    mean_of(windows.map(|w| standardise(w, &recogniser.mean, &recogniser.scale)));
                if let Some((nearest, _)) = recogniser.nearest(&mean)
                    && nearest.name != taught.name
                {
                    found.push(Warning::Contradiction {
                        recording: example.source.clone(),
                        name: taught.name.clone(),
                        other: nearest.name.clone(),
                    });
                }
            }
        }
        found
    }
}

/// The part of the time that belongs to a window: around its middle, up to the middles of its neighbours; the first and
/// the last window also have the ends of the recording.
fn share_of_time(windows: &[Window], i: usize) -> (f64, f64) {
    let middle = |w: &Window| 0.5 * (w.start_s + w.end_s);
    let between = |a: usize, b: usize| 0.5 * (middle(&windows[a]) + middle(&windows[b]));
    let start_s = match i {
        0 => windows[0].start_s,
        _ => between(i - 1, i),
    };
    let end_s = match i + 1 == windows.len() {
        true => windows[i].end_s,
        false => between(i, i + 1),
    };
    (start_s, end_s)
}

/// Mean and standard deviation of every feature; constant features have the deviation 1.
fn standardisation(windows: &[&Vec<f32>]) -> (Vec<f64>, Vec<f64>) {
    let n = windows.len() as f64;
    let mean: Vec<f64> = (0..N_FEATURES)
        .map(|k| windows.iter().map(|w| f64::from(w[k])).sum::<f64>() / n)
        .collect();
    let scale = (0..N_FEATURES)
        .map(|k| {
            let squares = windows.iter().map(|w| (f64::from(w[k]) - mean[k]).powi(2));
            let deviation = (squares.sum::<f64>() / n).sqrt();
            if deviation > 1e-9 { deviation } else { 1.0 }
        })
        .collect();
    (mean, scale)
}

fn standardise(window: &[f32], mean: &[f64], scale: &[f64]) -> Vec<f64> {
    let values = window.iter().zip(mean).zip(scale);
    values
        .map(|((v, m), s)| ((f64::from(*v) - m) / s).clamp(-LIMIT, LIMIT))
        .collect()
}

fn mean_of(rows: impl Iterator<Item = Vec<f64>>) -> Vec<f64> {
    let mut sum = vec![0.0; N_FEATURES];
    let mut n = 0.0;
    for row in rows {
        sum.iter_mut().zip(row).for_each(|(s, v)| *s += v);
        n += 1.0;
    }
    sum.iter_mut().for_each(|s| *s /= f64::max(n, 1.0));
    sum
}

fn add_outer_product(matrix: &mut [f64], row: &[f64]) {
    for (i, a) in row.iter().enumerate() {
        for (out, b) in matrix[i * N_FEATURES..][..N_FEATURES].iter_mut().zip(row) {
            *out += a * b;
        }
    }
}

/// The covariance, shrunk towards its mean variance times the identity. It is positive definite.
fn shrunk(mut covariance: Vec<f64>) -> Vec<f64> {
    let trace: f64 = (0..N_FEATURES)
        .map(|i| covariance[i * N_FEATURES + i])
        .sum();
    // A single window has no variance.
    let variance = (trace / N_FEATURES as f64).max(1e-3);
    covariance.iter_mut().for_each(|v| *v *= 1.0 - SHRINKAGE);
    for i in 0..N_FEATURES {
        covariance[i * N_FEATURES + i] += SHRINKAGE * variance;
    }
    covariance
}

/// Lower triangle L of a positive definite matrix L L^T.
fn cholesky(matrix: &[f64]) -> Vec<f64> {
    let mut lower = vec![0.0; N_FEATURES * N_FEATURES];
    for i in 0..N_FEATURES {
        for j in 0..=i {
            let known: f64 = (0..j)
                .map(|k| lower[i * N_FEATURES + k] * lower[j * N_FEATURES + k])
                .sum();
            let rest = matrix[i * N_FEATURES + j] - known;
            lower[i * N_FEATURES + j] = match i == j {
                true => rest.max(1e-12).sqrt(),
                false => rest / lower[j * N_FEATURES + j],
            };
        }
    }
    lower
}
