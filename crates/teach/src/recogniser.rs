//! What fits the examples, and what does not.
//!
//! Windows are compared as running means of [`N_MEAN`] windows, because the mean of an activity over ten seconds varies
//! less than a single window. The distance of a mean to an activity is the Mahalanobis distance to its nearest example.
//! The covariance is that of windows within activities, of the movements as they are and to the other side (which side
//! moves differs within an activity like the person does), pooled over all activities and shrunk towards a multiple of the
//! identity, because a few recordings do not determine all its numbers (regularised discriminant analysis, Friedman,
//! JASA 1989).
//!
//! An activity is recognised only if the distance is not much larger than that of examples to the others of their own
//! activity, and the less so, the nearer a second activity is: the distance is multiplied by its ratio to the distance of
//! the second activity. Without this limit a memory of two activities would recognise one of them in everything. The limit
//! is common to all activities, because three examples do not determine one for each.
//!
//! Examples of a few seconds show single events, like a fall or a squat. They are compared otherwise: with windows of their
//! own length instead of running means, also by the course of the event, and up to the distance at which examples that are
//! held out are recognised.
//!
//! The constants for long examples were chosen on half A of RadHAR and subjects 1 and 2 of MARS (docs/results/teaching.md),
//! by teaching all activities but one and counting what was recognised in its recordings and in those of the others, and by
//! teaching with one person and counting what was recognised in the recordings of the other.

use radarllm_base::Clip;

use crate::{
    memory::{Memory, Taught, Warning},
    shape::{N_COURSE, N_FEATURES, divided, mirrored},
    windows::{Division, Window},
};

/// Windows of a running mean.
pub const N_MEAN: usize = 15;
/// Weight of the identity in the pooled covariance.
const SHRINKAGE: f64 = 0.02;
/// Standardised features are limited to this many standard deviations.
const LIMIT: f64 = 6.0;
/// An activity is recognised up to this multiple of the largest distance of its examples to their nearest ones, in the
/// mean of all activities.
const MARGIN: f64 = 5.6;

/// Weight of the features of the course for short examples. Long ones are compared without them.
const COURSE_WEIGHT: f64 = 2.0;
/// Shortest window of a single event, s.
const MIN_EVENT_S: f64 = 0.5;
/// Windows of a single event begin at this share of their length after each other.
const EVENT_HOP: f64 = 1.0 / 6.0;

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
    /// Of activities that go on, then of single events.
    comparisons: Vec<Comparison>,
}

/// Compares recordings with examples that are all long or all short.
struct Comparison {
    mean: Vec<f64>,
    scale: Vec<f64>,
    /// Lower triangle of the Cholesky factor of the shrunk covariance, `[features][features]`.
    factor: Vec<f64>,
    division: Division,
    /// Whether the examples are single events.
    is_short: bool,
    activities: Vec<Known>,
    /// Largest distance at which an activity is recognised.
    limit: f64,
}

struct Known {
    name: String,
    says: String,
    /// Means of the windows of each example, whitened.
    examples: Vec<Vec<f64>>,
}

/// An activity and how far a mean of windows is from it.
struct Nearest<'a> {
    known: &'a Known,
    /// Distance, times its ratio to the distance of the second activity.
    distance: f64,
}

impl Recogniser {
    /// Prepares a memory; `None` if it is empty.
    pub fn new(memory: &Memory) -> Option<Self> {
        let of_length = |is_short| Comparison::new(&memory.of_length(is_short));
        let comparisons: Vec<Comparison> =
            [false, true].into_iter().filter_map(of_length).collect();
        (!comparisons.is_empty()).then_some(Self { comparisons })
    }

    /// Names of the activities, in alphabetical order.
    pub fn names(&self) -> Vec<&str> {
        let known = self.comparisons.iter().flat_map(|one| &one.activities);
        let mut names: Vec<&str> = known.map(|known| known.name.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        names
    }

    /// Parts of a clip in which taught activities are recognised, in order of time. An event interrupts what goes on.
    pub fn recognise(&self, clip: &Clip) -> Vec<Recognised> {
        let mut parts: Vec<Recognised> = Vec::new();
        for comparison in &self.comparisons {
            let found = comparison.recognise(clip);
            for part in &found {
                parts = parts.into_iter().flat_map(|p| beside(p, part)).collect();
            }
            parts.extend(found);
        }
        parts.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
        parts
    }
}

impl Comparison {
    /// Prepares examples. The covariance of a few short examples contains each of them, so that their distances to each
    /// other are far smaller than those of any other recording. Their limit is that of examples that were held out: the
    /// distance of each to its own activity as the others teach it.
    fn new(memory: &Memory) -> Option<Self> {
        let mut comparison = Self::of_examples(memory)?;
        if comparison.is_short {
            comparison.limit = comparison.limit.max(Self::held_out_distance(memory));
        }
        Some(comparison)
    }

    /// Distance of an example to its own activity, as the other examples teach it: the largest one of each activity, in the
    /// mean of the activities that have two examples or more. Examples that resemble another activity more do not count.
    fn held_out_distance(memory: &Memory) -> f64 {
        let mut largest: Vec<f64> = Vec::new();
        for taught in memory.activities().iter().filter(|a| a.examples.len() > 1) {
            let distance_of = |i: usize| {
                let others = Self::of_examples(&memory.without_example(&taught.name, i))?;
                let mean = others.mean_of(&taught.examples[i].windows);
                let nearest = others.nearest(&mean)?;
                (nearest.known.name == taught.name).then_some(nearest.distance)
            };
            let distances = (0..taught.examples.len()).filter_map(distance_of);
            largest.extend(distances.reduce(f64::max));
        }
        largest.iter().sum::<f64>() / largest.len().max(1) as f64
    }

    /// The comparison with the limit that follows from the distances of the examples to each other.
    fn of_examples(memory: &Memory) -> Option<Self> {
        let taught = memory.activities();
        let all: Vec<&Vec<f32>> = taught
            .iter()
            .flat_map(|a| &a.examples)
            .flat_map(|e| &e.windows)
            .collect();
        if all.is_empty() {
            return None;
        }
        let mut seconds: Vec<f64> = taught
            .iter()
            .flat_map(|a| &a.examples)
            .map(|e| e.seconds)
            .collect();
        let is_short = taught.iter().all(Taught::is_short);
        let mut division = Division::default();
        if is_short {
            let middle = seconds.len() / 2;
            let (_, median_s, _) = seconds.select_nth_unstable_by(middle, f64::total_cmp);
            division.length_s = median_s.clamp(MIN_EVENT_S, division.length_s);
            division.hop_s = (EVENT_HOP * division.length_s).min(division.hop_s);
        }
        let n_features = if is_short {
            N_FEATURES
        } else {
            N_FEATURES - N_COURSE
        };
        let (mean, scale) = standardisation(&all, n_features);
        let standardised = |w: &[f32]| standardise(w, &mean, &scale);
        let other_side = |w: &Vec<f32>| standardise(&mirrored(w), &mean, &scale);
        let mut covariance = vec![0.0; n_features * n_features];
        for activity in taught {
            let windows = || activity.examples.iter().map(|e| e.windows.iter());
            add_scatter(
                &mut covariance,
                windows().map(|w| w.map(|w| standardised(w)).collect()),
            );
            if !is_short {
                add_scatter(
                    &mut covariance,
                    windows().map(|w| w.map(other_side).collect()),
                );
            }
        }
        let n = all.len() * if is_short { 1 } else { 2 };
        covariance.iter_mut().for_each(|v| *v /= n as f64);
        let mut comparison = Self {
            factor: cholesky(&shrunk(covariance, n_features), n_features),
            mean,
            scale,
            division,
            is_short,
            activities: Vec::new(),
            limit: 0.0,
        };
        let known = taught.iter().map(|a| Known {
            name: a.name.clone(),
            says: a.says.clone(),
            examples: a
                .examples
                .iter()
                .map(|e| comparison.mean_of(&e.windows))
                .collect(),
        });
        comparison.activities = known.collect();
        let spreads: Vec<f64> = comparison
            .activities
            .iter()
            .filter_map(Known::spread)
            .collect();
        // Single examples have no spread of their own: that of their windows stands for it.
        let of_windows = || {
            let distance = |w: &&Vec<f32>| {
                comparison
                    .nearest(&comparison.mean_of(&[(*w).clone()]))
                    .map_or(0.0, |n| n.distance)
            };
            all.iter().map(distance).sum::<f64>() / all.len() as f64
        };
        comparison.limit = MARGIN
            * match spreads.is_empty() {
                true => of_windows(),
                false => spreads.iter().sum::<f64>() / spreads.len() as f64,
            };
        Some(comparison)
    }

    /// Parts of a clip in which the activities are recognised, in order of time.
    fn recognise(&self, clip: &Clip) -> Vec<Recognised> {
        let windows = divided(clip, self.division);
        match self.is_short {
            true => self.events(&windows),
            false => self.activities(&windows),
        }
    }

    /// Parts in which running means of windows are recognised.
    fn activities(&self, windows: &[Window]) -> Vec<Recognised> {
        let features: Vec<Option<Vec<f64>>> = windows
            .iter()
            .map(|w| {
                w.features
                    .as_ref()
                    .map(|f| standardise(f, &self.mean, &self.scale))
            })
            .collect();
        let mut parts = Vec::new();
        for i in 0..windows.len() {
            let first = i.saturating_sub(N_MEAN / 2);
            let last = (i + N_MEAN / 2).min(windows.len() - 1);
            let around: Vec<&Vec<f64>> = features[first..=last].iter().flatten().collect();
            if around.is_empty() {
                continue;
            }
            let mean = self.whitened(&mean_of(around.into_iter().cloned()));
            let (start_s, end_s) = share_of_time(windows, i);
            if let Some(part) = self.recognised(&mean, start_s, end_s) {
                append(&mut parts, part);
            }
        }
        parts
    }

    /// Single windows that are recognised: of those that overlap, the one that fits best.
    fn events(&self, windows: &[Window]) -> Vec<Recognised> {
        let of = |window: &Window| {
            let features = window.features.clone()?;
            self.recognised(&self.mean_of(&[features]), window.start_s, window.end_s)
        };
        let mut found: Vec<Recognised> = windows.iter().filter_map(of).collect();
        found.sort_by(|a, b| b.fit.total_cmp(&a.fit));
        let mut apart: Vec<Recognised> = Vec::new();
        for part in found {
            let overlaps =
                |other: &Recognised| part.start_s < other.end_s && other.start_s < part.end_s;
            if !apart.iter().any(overlaps) {
                apart.push(part);
            }
        }
        apart.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
        let mut parts = Vec::new();
        for part in apart {
            append(&mut parts, part);
        }
        parts
    }

    /// The activity nearest to a whitened mean, if it is near enough.
    fn recognised(&self, mean: &[f64], start_s: f64, end_s: f64) -> Option<Recognised> {
        let Nearest { known, distance } = self.nearest(mean)?;
        (distance <= self.limit).then(|| Recognised {
            start_s,
            end_s,
            name: known.name.clone(),
            says: known.says.clone(),
            fit: (1.0 - distance / self.limit.max(f64::MIN_POSITIVE)) as f32,
        })
    }

    /// The nearest activity of a whitened mean of windows.
    fn nearest(&self, mean: &[f64]) -> Option<Nearest<'_>> {
        let of = |known| (known, Known::distance(known, mean));
        let mut distances: Vec<(&Known, f64)> = self.activities.iter().map(of).collect();
        distances.sort_by(|a, b| a.1.total_cmp(&b.1));
        let (known, distance) = *distances.first()?;
        let second = distances.get(1).map_or(distance, |d| d.1);
        let ratio = distance / second.max(f64::MIN_POSITIVE);
        Some(Nearest {
            known,
            distance: distance * ratio.min(1.0),
        })
    }

    /// Whitened mean of windows.
    fn mean_of(&self, windows: &[Vec<f32>]) -> Vec<f64> {
        let standardised = windows
            .iter()
            .map(|w| standardise(w, &self.mean, &self.scale));
        self.whitened(&mean_of(standardised))
    }

    /// Standardised features such that distances are Mahalanobis distances: L^-1 x by forward substitution.
    fn whitened(&self, x: &[f64]) -> Vec<f64> {
        let n = self.mean.len();
        let mut solved = vec![0.0; n];
        for i in 0..n {
            let row = &self.factor[i * n..][..=i];
            let known: f64 = row[..i].iter().zip(&solved).map(|(l, x)| l * x).sum();
            solved[i] = (x[i] - known) / row[i];
        }
        solved
    }
}

impl Known {
    /// Distance to the nearest example.
    fn distance(&self, mean: &[f64]) -> f64 {
        let all = self.examples.iter().map(|e| distance(e, mean));
        all.fold(f64::INFINITY, f64::min)
    }

    /// Largest distance of an example to the nearest other one; `None` for fewer than two examples.
    fn spread(&self) -> Option<f64> {
        let of = |i: usize| {
            let others = self.examples.iter().enumerate().filter(|(j, _)| *j != i);
            let all = others.map(|(_, e)| distance(e, &self.examples[i]));
            all.fold(f64::INFINITY, f64::min)
        };
        let n = self.examples.len();
        (n > 1).then(|| (0..n).map(of).fold(0.0, f64::max))
    }
}

impl Memory {
    /// Examples that resemble another activity more than their own, each compared with a memory that lacks it, and
    /// activities that have no other one of their kind to be told apart from.
    pub fn doubts(&self) -> Vec<Warning> {
        let mut found = Vec::new();
        for is_short in [false, true] {
            if let [only] = self.of_length(is_short).activities() {
                found.push(Warning::OnlyActivity {
                    name: only.name.clone(),
                    what_happens: match is_short {
                        true => "nearly everything as short is taken for it",
                        false => "little but its examples is recognised",
                    },
                });
            }
        }
        for taught in self.activities() {
            for (i, example) in taught.examples.iter().enumerate() {
                if taught.examples.len() < 2 {
                    continue;
                }
                let without = self
                    .of_length(taught.is_short())
                    .without_example(&taught.name, i);
                let Some(comparison) = Comparison::of_examples(&without) else {
                    continue;
                };
                let mean = comparison.mean_of(&example.windows);
                if let Some(nearest) = comparison.nearest(&mean)
                    && nearest.known.name != taught.name
                {
                    found.push(Warning::Contradiction {
                        recording: example.source.clone(),
                        name: taught.name.clone(),
                        other: nearest.known.name.clone(),
                    });
                }
            }
        }
        found
    }
}

/// Appends a part, or prolongs the last one if it is of the same activity and ends where this one begins.
fn append(parts: &mut Vec<Recognised>, part: Recognised) {
    match parts.last_mut() {
        Some(last) if last.name == part.name && (part.start_s - last.end_s).abs() < 1e-6 => {
            last.end_s = part.end_s;
            last.fit = last.fit.max(part.fit);
        }
        _ => parts.push(part),
    }
}

/// What is left of a part beside another one.
fn beside(part: Recognised, other: &Recognised) -> Vec<Recognised> {
    if other.end_s <= part.start_s || part.end_s <= other.start_s {
        return vec![part];
    }
    let rest = [(part.start_s, other.start_s), (other.end_s, part.end_s)];
    rest.into_iter()
        .filter(|(start_s, end_s)| start_s < end_s)
        .map(|(start_s, end_s)| Recognised {
            start_s,
            end_s,
            ..part.clone()
        })
        .collect()
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

/// Mean and standard deviation of the first features; constant features have the deviation 1.
fn standardisation(windows: &[&Vec<f32>], n_features: usize) -> (Vec<f64>, Vec<f64>) {
    let n = windows.len() as f64;
    let mean: Vec<f64> = (0..n_features)
        .map(|k| windows.iter().map(|w| f64::from(w[k])).sum::<f64>() / n)
        .collect();
    let scale = (0..n_features)
        .map(|k| {
            let squares = windows.iter().map(|w| (f64::from(w[k]) - mean[k]).powi(2));
            let deviation = (squares.sum::<f64>() / n).sqrt();
            if deviation > 1e-9 { deviation } else { 1.0 }
        })
        .collect();
    (mean, scale)
}

/// The standardised features of a window, of which there are as many as means.
fn standardise(window: &[f32], mean: &[f64], scale: &[f64]) -> Vec<f64> {
    let values = window.iter().zip(mean).zip(scale);
    let mut standardised: Vec<f64> = values
        .map(|((v, m), s)| ((f64::from(*v) - m) / s).clamp(-LIMIT, LIMIT))
        .collect();
    for value in standardised.iter_mut().skip(N_FEATURES - N_COURSE) {
        *value *= COURSE_WEIGHT;
    }
    standardised
}

/// Mean of rows of one length; empty without rows.
fn mean_of(rows: impl Iterator<Item = Vec<f64>>) -> Vec<f64> {
    let mut sum: Vec<f64> = Vec::new();
    let mut n = 0.0;
    for row in rows {
        sum.resize(row.len(), 0.0);
        sum.iter_mut().zip(row).for_each(|(s, v)| *s += v);
        n += 1.0;
    }
    sum.iter_mut().for_each(|s| *s /= f64::max(n, 1.0));
    sum
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a - b).powi(2));
    squares.sum::<f64>().sqrt()
}

/// Adds the products of the windows of an activity's examples without the activity's mean, in which every example
/// counts alike. Only the lower triangle is filled.
fn add_scatter(matrix: &mut [f64], examples: impl Iterator<Item = Vec<Vec<f64>>>) {
    let examples: Vec<Vec<Vec<f64>>> = examples.collect();
    let mean = mean_of(examples.iter().map(|e| mean_of(e.iter().cloned())));
    for window in examples.iter().flatten() {
        let centred: Vec<f64> = window.iter().zip(&mean).map(|(v, m)| v - m).collect();
        for (i, a) in centred.iter().enumerate() {
            let row = &mut matrix[i * centred.len()..][..=i];
            row.iter_mut()
                .zip(&centred)
                .for_each(|(out, b)| *out += a * b);
        }
    }
}

/// The lower triangle of a covariance of `n` features, shrunk towards its mean variance times the identity. It is positive
/// definite.
fn shrunk(mut covariance: Vec<f64>, n: usize) -> Vec<f64> {
    let trace: f64 = (0..n).map(|i| covariance[i * n + i]).sum();
    // A single window has no variance.
    let variance = (trace / n as f64).max(1e-3);
    covariance.iter_mut().for_each(|v| *v *= 1.0 - SHRINKAGE);
    for i in 0..n {
        covariance[i * n + i] += SHRINKAGE * variance;
    }
    covariance
}

/// Lower triangle L of a positive definite `n` x `n` matrix L L^T.
fn cholesky(matrix: &[f64], n: usize) -> Vec<f64> {
    let mut lower = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let known: f64 = (0..j).map(|k| lower[i * n + k] * lower[j * n + k]).sum();
            let rest = matrix[i * n + j] - known;
            lower[i * n + j] = match i == j {
                true => rest.max(1e-12).sqrt(),
                false => rest / lower[j * n + j],
            };
        }
    }
    lower
}

#[cfg(test)]
mod tests {
    use radarllm_base::{Clutter, PointFrame, RadarPoint, seed::derive_seed};

    use super::*;

    /// Two seconds and a half of somebody who goes up and down, or to and fro, with scattered points.
    fn short(goes_up: bool, seed: u32) -> Clip {
        let mut state = (derive_seed(seed.into(), "points") >> 32) as u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        let mut frame = |i: u32| {
            let wave = (i as f32 * 0.5 + 0.3 * (seed % 3) as f32).sin();
            let [x, z] = if goes_up { [0.0, wave] } else { [wave, 0.0] };
            let point = |_| RadarPoint {
                x_m: 0.4 * x + 0.2 * noise(),
                y_m: 2.0 + 0.4 * noise(),
                z_m: 0.4 * z + 0.2 * noise(),
                range_m: 2.0 + 0.4 * noise(),
                velocity_mps: noise(),
                intensity_db: 10.0,
            };
            PointFrame {
                frame: i,
                time_s: f64::from(i) / 10.0,
                points: (0..6).map(point).collect(),
                board: None,
            }
        };
        Clip {
            frames: (0..24).map(&mut frame).collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "iwr6843isk".into(),
            provenance: "recorded:csv:room.csv".parse().unwrap(),
            clutter: Clutter::Settled,
        }
    }

    #[test]
    fn a_few_short_examples_are_recognised_again() {
        let mut memory = Memory::default();
        for seed in 0..3 {
            memory
                .teach("up", "a person squats", &short(true, seed))
                .unwrap();
            memory
                .teach("across", "a person waves", &short(false, seed))
                .unwrap();
        }
        let recogniser = Recogniser::new(&memory).unwrap();
        let by_examples = Comparison::of_examples(&memory).unwrap();
        assert!(recogniser.comparisons[0].limit > by_examples.limit);
        let mut n_right = 0;
        for seed in 10..20 {
            for (goes_up, name) in [(true, "up"), (false, "across")] {
                let found = recogniser.recognise(&short(goes_up, seed));
                assert!(found.iter().all(|part| part.name == name), "{found:?}");
                n_right += found.len();
                assert!(by_examples.recognise(&short(goes_up, seed)).is_empty());
            }
        }
        assert!(n_right >= 10, "{n_right} of 20");
    }

    /// Somebody who rocks for a long time, with an event of two seconds and a half in it.
    #[test]
    fn events_are_recognised_within_what_goes_on() {
        let rocking = |rate_hz: f32, seconds: u32| {
            let frame = |i: u32| {
                let z_m = 0.3 * (std::f32::consts::TAU * rate_hz * i as f32 / 10.0).sin();
                let point = RadarPoint {
                    y_m: 2.0,
                    z_m,
                    range_m: 2.0,
                    ..RadarPoint::default()
                };
                PointFrame {
                    points: vec![point; 5],
                    ..PointFrame::default()
                }
            };
            (0..10 * seconds).map(frame).collect::<Vec<PointFrame>>()
        };
        let mut memory = Memory::default();
        for (seed, rate_hz) in [(0, 0.48), (1, 0.5), (2, 0.52)] {
            for (name, rate_hz) in [("rocking", rate_hz), ("shaking", 4.0 * rate_hz)] {
                let long = joined(rocking(rate_hz, 12));
                memory.teach(name, "a person rocks", &long).unwrap();
            }
            for (name, goes_up) in [("up", true), ("across", false)] {
                let short = short(goes_up, seed);
                memory.teach(name, "a person squats", &short).unwrap();
            }
        }
        let recogniser = Recogniser::new(&memory).unwrap();
        assert_eq!(recogniser.comparisons.len(), 2);
        let mut frames = rocking(0.51, 40);
        frames.extend(short(true, 1).frames);
        frames.extend(rocking(0.51, 40));
        let found = recogniser.recognise(&joined(frames));
        let names: Vec<&str> = found.iter().map(|part| part.name.as_str()).collect();
        assert_eq!(names, ["rocking", "up", "rocking"], "{found:?}");
        assert!((found[1].start_s - 40.0).abs() < 0.6, "{found:?}");
        assert!(
            found
                .windows(2)
                .all(|pair| pair[0].end_s <= pair[1].start_s)
        );
    }

    /// Frames as one recording at 10 frames/s.
    fn joined(mut frames: Vec<PointFrame>) -> Clip {
        for (i, frame) in frames.iter_mut().enumerate() {
            frame.frame = i as u32;
            frame.time_s = i as f64 / 10.0;
        }
        short(true, 0).with_frames(frames)
    }
}
