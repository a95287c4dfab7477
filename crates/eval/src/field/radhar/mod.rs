//! What does supervision give on RadHAR's recordings, and how much of it is a leak?
//!
//! RadHAR (Singh et al., mmNets 2019) reports classifiers of overlapping windows. Here the recordings for tuning are
//! divided by recording, by session and, as a demonstration of the leak, by window ([`mod@folds`]), and classifiers of voxels
//! ([`voxels`], [`pca`], [`svm`], [`mlp`]) and of the project's own window features are trained and tested on the same folds.
//! Judged recordings are not read.

pub mod folds;
pub mod mlp;
pub mod pca;
mod report;
pub mod sparse;
pub mod svm;
pub mod voxels;

use std::time::Instant;

use radarllm_base::{Clip, RadarPoint, seed::derive_seed};
use radarllm_teach::windows::Division;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{EvalError, classifier::LogisticRegression, features, forest::Forest};
use folds::{Fold, Origin, Protocol, folds, shuffled};
use mlp::{Mlp, MlpConfig};
use pca::Pca;
pub use report::markdown;
use sparse::{Gram, SparseRows};
use svm::{Svm, rbf};
use voxels::Voxels;

/// Frame rate of the recordings, frames/s.
const RATE_HZ: f64 = 30.0;

/// The configuration file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RadharConfig {
    /// Configuration of the recordings, with activities and roles; relative to the folder of this file.
    pub recordings: String,
    /// Seed of folds, components and networks.
    pub seed: u64,
    /// Number of folds by recording and by window.
    pub folds: usize,
    /// Rules that divide windows.
    pub protocols: Vec<Protocol>,
    /// Kinds of voxels.
    pub voxels: Vec<Voxels>,
    /// Principal components.
    pub components: usize,
    /// Support vector machine.
    pub svm: SvmConfig,
    /// Multilayer perceptron.
    #[serde(default)]
    pub mlp: MlpConfig,
    /// Trees of the forest.
    pub trees: usize,
    /// Rows that are not run, with the reason.
    #[serde(default)]
    pub not_run: Vec<NotRun>,
}

/// Constants of the support vector machine.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SvmConfig {
    /// C of the soft margin.
    pub penalty: f64,
    /// Gamma of the kernel, for counts of points.
    pub gamma: f64,
}

/// A classifier that is not run.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct NotRun {
    /// Name of the row.
    pub name: String,
    /// Why it is not run.
    pub reason: String,
    /// What its authors report.
    pub reported: Option<String>,
}

impl RadharConfig {
    /// Reads a configuration (TOML).
    ///
    /// # Errors
    /// TOML errors with their place, and values out of their range.
    pub fn from_toml(text: &str) -> Result<Self, EvalError> {
        let config: Self = toml::from_str(text).map_err(|e| EvalError::Config(e.to_string()))?;
        let checks = [
            ("folds", (2..=100).contains(&config.folds), "2 to 100"),
            (
                "components",
                (1..=1000).contains(&config.components),
                "1 to 1000",
            ),
            ("trees", (1..=10_000).contains(&config.trees), "1 to 10000"),
            ("svm.penalty", config.svm.penalty > 0.0, "positive"),
            ("svm.gamma", config.svm.gamma > 0.0, "positive"),
            (
                "mlp.hidden",
                (1..=4096).contains(&config.mlp.hidden),
                "1 to 4096",
            ),
            ("mlp.batch", config.mlp.batch > 0, "positive"),
            ("protocols", !config.protocols.is_empty(), "at least one"),
        ];
        match checks.iter().find(|(_, is_right, _)| !is_right) {
            Some((name, _, expected)) => {
                Err(EvalError::Config(format!("{name}: expected {expected}")))
            }
            None => Ok(config),
        }
    }
}

/// A recording of known activity.
#[derive(Clone, Debug)]
pub struct RadharRecording {
    /// Path below the folder of recordings, with `/` between names.
    pub name: String,
    /// Index of the activity.
    pub activity: usize,
    /// The points of each frame as recorded, in order.
    pub frames: Vec<Vec<RadarPoint>>,
    /// The recording as it is prepared for the model, of which the window features are computed.
    pub clip: Clip,
}

/// The session of a recording: the underscores before its file name. What they mean is not documented; that they count
/// sessions is a guess.
pub fn session_of(name: &str) -> &str {
    let file = name.rsplit('/').next().unwrap_or(name);
    &file[..file.len() - file.trim_start_matches('_').len()]
}

/// Mean and standard deviation over folds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Standard deviation with n - 1 degrees of freedom; 0 for a single fold.
    pub deviation: f64,
}

impl Spread {
    fn of(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n.max(1.0);
        let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        Self {
            mean,
            deviation: (squares / (n - 1.0).max(1.0)).sqrt(),
        }
    }
}

/// A classifier under one protocol.
#[derive(Clone, Debug, Serialize)]
pub struct ProtocolResult {
    /// The protocol.
    pub protocol: Protocol,
    /// Number of folds.
    pub folds: usize,
    /// Proportion of windows that are classified right.
    pub windows: Spread,
    /// Proportion of recordings of which more windows are classified right than as any other activity.
    pub recordings: Spread,
    /// The same recordings, summed over folds.
    pub recordings_right: usize,
    /// Recordings tested, summed over folds.
    pub recordings_tested: usize,
    /// Windows tested, summed over folds.
    pub windows_tested: usize,
}

/// A row of the report.
#[derive(Clone, Debug, Serialize)]
pub struct RadharRow {
    /// Input and classifier.
    pub name: String,
    /// Results by protocol.
    pub results: Vec<ProtocolResult>,
    /// Share of the variance that the components have, mean over folds of the first protocol.
    pub explained: Option<f64>,
    /// Pairs of classes whose support vector machine did not converge, over all folds.
    pub unfinished: usize,
    /// Time for training and testing, s.
    pub seconds: f64,
}

/// Everything measured.
#[derive(Clone, Debug, Serialize)]
pub struct RadharReport {
    /// Names of the activities.
    pub activities: Vec<String>,
    /// Recordings of each activity.
    pub recordings: Vec<usize>,
    /// Windows of 60 frames.
    pub windows: usize,
    /// Sessions (prefixes of file names, in quotes) with the recordings of each activity.
    pub sessions: Vec<(String, Vec<usize>)>,
    /// The classifiers.
    pub rows: Vec<RadharRow>,
    /// The classifiers that are not run.
    pub not_run: Vec<NotRun>,
}

/// A classifier of voxels.
#[derive(Clone, Copy, PartialEq)]
enum VoxelClassifier {
    /// On the values themselves.
    Svm,
    /// On principal components, with the configured gamma.
    PcaSvm,
    /// On principal components, with the inverse of their total variance as gamma.
    PcaSvmScaled,
    PcaMlp,
    /// As `PcaSvmScaled`, with shuffled labels of the training windows.
    Shuffled,
}

/// A classifier of window features.
#[derive(Clone, Copy)]
enum FeatureClassifier {
    Forest,
    Logistic,
}

/// Windows with their recordings.
struct Windows<'a> {
    /// Index of the recording of each window.
    recordings: Vec<usize>,
    origins: &'a [Origin],
    n_classes: usize,
}

impl Windows<'_> {
    fn label(&self, window: usize) -> usize {
        self.origins[self.recordings[window]].activity
    }

    fn labels(&self, windows: &[usize]) -> Vec<usize> {
        windows.iter().map(|window| self.label(*window)).collect()
    }

    /// Proportions of windows and recordings of a fold that are right, and the counts of recordings.
    fn score(&self, fold: &Fold, predicted: &[Option<usize>]) -> [f64; 4] {
        let mut votes = vec![vec![0_usize; self.n_classes]; self.origins.len()];
        let mut is_tested = vec![false; self.origins.len()];
        let mut n_right = 0;
        for (window, predicted) in fold.test.iter().zip(predicted) {
            let recording = self.recordings[*window];
            is_tested[recording] = true;
            if let Some(class) = predicted {
                votes[recording][*class] += 1;
                n_right += usize::from(*class == self.label(*window));
            }
        }
        let tested = (0..self.origins.len()).filter(|recording| is_tested[*recording]);
        let tested: Vec<usize> = tested.collect();
        // A tie is no answer.
        let is_right = |recording: &&usize| {
            let own = self.origins[**recording].activity;
            let votes = votes[**recording].iter().enumerate();
            let (own_votes, others): (Vec<_>, Vec<_>) = votes.partition(|(class, _)| *class == own);
            let max = |votes: &[(usize, &usize)]| votes.iter().map(|(_, n)| **n).max();
            max(&own_votes).unwrap_or_default() > max(&others).unwrap_or_default()
        };
        let n_recordings = tested.iter().filter(is_right).count();
        [
            n_right as f64 / fold.test.len().max(1) as f64,
            n_recordings as f64 / tested.len().max(1) as f64,
            n_recordings as f64,
            tested.len() as f64,
        ]
    }

    fn result(&self, protocol: Protocol, folds: &[Fold], scores: &[[f64; 4]]) -> ProtocolResult {
        let column = |k: usize| -> Vec<f64> { scores.iter().map(|score| score[k]).collect() };
        ProtocolResult {
            protocol,
            folds: folds.len(),
            windows: Spread::of(&column(0)),
            recordings: Spread::of(&column(1)),
            recordings_right: column(2).iter().sum::<f64>() as usize,
            recordings_tested: column(3).iter().sum::<f64>() as usize,
            windows_tested: folds.iter().map(|fold| fold.test.len()).sum(),
        }
    }
}

/// Trains and tests all classifiers. `progress` has a line for each finished row.
///
/// # Errors
/// Recordings without a window, or of an activity that is not in the list; folds in which nothing can be trained.
pub fn evaluate(
    config: &RadharConfig,
    activities: &[String],
    recordings: &[RadharRecording],
    progress: &(dyn Fn(&str) + Sync),
) -> Result<RadharReport, EvalError> {
    if recordings.iter().any(|r| r.activity >= activities.len()) {
        return Err(EvalError::Config("a recording of no activity".into()));
    }
    let origins: Vec<Origin> = recordings
        .iter()
        .map(|recording| Origin {
            activity: recording.activity,
            session: session_of(&recording.name).into(),
        })
        .collect();
    let mut rows = Vec::new();
    let mut n_windows = 0;
    for (i, voxels) in config.voxels.iter().enumerate() {
        let (windows, gram) = voxel_windows(*voxels, recordings, &origins, activities.len())?;
        n_windows = windows.recordings.len();
        let mut of_voxels = voxel_rows(config, *voxels, &windows, &gram, i == 0, progress)?;
        rows.append(&mut of_voxels);
    }
    let own = Division {
        length_s: voxels::WINDOW_FRAMES as f64 / RATE_HZ,
        hop_s: voxels::STRIDE_FRAMES as f64 / RATE_HZ,
    };
    for division in [own, Division::default()] {
        let of_clip = |recording: &RadharRecording| -> Vec<Option<Vec<f32>>> {
            let windows = features::windows_of(&recording.clip, division);
            windows.into_iter().map(|window| window.features).collect()
        };
        let by_recording: Vec<_> = recordings.par_iter().map(of_clip).collect();
        let of = |(i, windows): (usize, &Vec<_>)| vec![i; windows.len()];
        let windows = Windows {
            recordings: by_recording.iter().enumerate().flat_map(of).collect(),
            origins: &origins,
            n_classes: activities.len(),
        };
        let values: Vec<Option<Vec<f32>>> = by_recording.into_iter().flatten().collect();
        for classifier in [FeatureClassifier::Forest, FeatureClassifier::Logistic] {
            let row = feature_row(config, classifier, division, &windows, &values)?;
            progress(&report::line(&row));
            rows.push(row);
        }
    }
    let of_activity = |session: Option<&str>| -> Vec<usize> {
        let n = |activity| {
            let own = origins.iter().filter(|o| o.activity == activity);
            own.filter(|o| session.is_none_or(|session| o.session == session))
                .count()
        };
        (0..activities.len()).map(n).collect()
    };
    let mut sessions: Vec<&str> = origins.iter().map(|o| o.session.as_str()).collect();
    sessions.sort_unstable();
    sessions.dedup();
    Ok(RadharReport {
        activities: activities.to_vec(),
        recordings: of_activity(None),
        windows: n_windows,
        sessions: sessions
            .into_iter()
            .map(|session| (format!("\"{session}\""), of_activity(Some(session))))
            .collect(),
        rows,
        not_run: config.not_run.clone(),
    })
}

/// All windows of voxels, and their scalar products.
fn voxel_windows<'a>(
    voxels: Voxels,
    recordings: &[RadharRecording],
    origins: &'a [Origin],
    n_classes: usize,
) -> Result<(Windows<'a>, Gram), EvalError> {
    let mut rows = SparseRows::new(voxels::WINDOW_FRAMES * voxels.n_values());
    let mut of = Vec::new();
    for (i, recording) in recordings.iter().enumerate() {
        let own = voxels::windows(&recording.frames, voxels);
        of.extend(vec![i; own.n_rows()]);
        rows.append(&own);
    }
    if of.is_empty() {
        return Err(EvalError::Empty(format!(
            "no recording has {} frames",
            voxels::WINDOW_FRAMES
        )));
    }
    let windows = Windows {
        recordings: of,
        origins,
        n_classes,
    };
    Ok((windows, rows.gram()))
}

/// The rows of one kind of voxels, which share the components of each fold.
fn voxel_rows(
    config: &RadharConfig,
    voxels: Voxels,
    windows: &Windows<'_>,
    gram: &Gram,
    with_chance: bool,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<Vec<RadharRow>, EvalError> {
    let name = |classifier| {
        let SvmConfig { penalty, gamma } = config.svm;
        let components = format!("PCA {}", config.components);
        match classifier {
            VoxelClassifier::Svm => format!("SVM, C {penalty}, gamma {gamma:e}"),
            VoxelClassifier::PcaSvm => format!("{components}, SVM, C {penalty}, gamma {gamma:e}"),
            VoxelClassifier::PcaSvmScaled => {
                format!("{components}, SVM, C {penalty}, gamma scaled to the data")
            }
            VoxelClassifier::PcaMlp => format!(
                "{components}, MLP {}-{}-{}",
                config.components, config.mlp.hidden, windows.n_classes
            ),
            VoxelClassifier::Shuffled => {
                format!("{components}, SVM, gamma scaled to the data, shuffled labels (chance)")
            }
        }
    };
    let mut classifiers = vec![
        VoxelClassifier::Svm,
        VoxelClassifier::PcaSvm,
        VoxelClassifier::PcaSvmScaled,
        VoxelClassifier::PcaMlp,
    ];
    if with_chance {
        classifiers.push(VoxelClassifier::Shuffled);
    }
    let mut rows: Vec<RadharRow> = classifiers
        .iter()
        .map(|classifier| RadharRow {
            name: format!("{}: {}", voxels.name(), name(*classifier)),
            results: Vec::new(),
            explained: None,
            unfinished: 0,
            seconds: 0.0,
        })
        .collect();
    for protocol in &config.protocols {
        let folds = folds_of(config, *protocol, windows)?;
        let mut scores = vec![Vec::new(); rows.len()];
        let mut explained = Vec::new();
        for (i, fold) in folds.iter().enumerate() {
            let seed = derive_seed(config.seed, &format!("{}-{i}", protocol.name()));
            let start = Instant::now();
            let pca = Pca::fit(gram, &fold.train, config.components, seed)
                .ok_or_else(|| EvalError::Empty("the training windows are all equal".into()))?;
            explained.push(pca.explained());
            let of = |part: &[usize]| -> Vec<Vec<f64>> {
                part.par_iter().map(|row| pca.scores(gram, *row)).collect()
            };
            let components = Components::new(of(&fold.train), of(&fold.test), &pca);
            let pca_s = start.elapsed().as_secs_f64();
            for ((classifier, row), scores) in classifiers.iter().zip(&mut rows).zip(&mut scores) {
                let start = Instant::now();
                let outcome =
                    classified(config, *classifier, windows, gram, fold, &components, seed)
                        .ok_or_else(|| EvalError::Empty("a fold has nothing to train on".into()))?;
                row.unfinished += outcome.n_unfinished;
                row.seconds += start.elapsed().as_secs_f64();
                if *classifier != VoxelClassifier::Svm {
                    row.seconds += pca_s;
                }
                let predicted: Vec<Option<usize>> =
                    outcome.predicted.into_iter().map(Some).collect();
                scores.push(windows.score(fold, &predicted));
            }
        }
        for ((classifier, row), scores) in classifiers.iter().zip(&mut rows).zip(&scores) {
            row.results.push(windows.result(*protocol, &folds, scores));
            if *classifier != VoxelClassifier::Svm && row.explained.is_none() {
                row.explained = Some(Spread::of(&explained).mean);
            }
        }
        progress(&format!(
            "{}, {}: {} folds done",
            voxels.name(),
            protocol.name(),
            folds.len()
        ));
    }
    rows.iter().for_each(|row| progress(&report::line(row)));
    Ok(rows)
}

fn folds_of(
    config: &RadharConfig,
    protocol: Protocol,
    windows: &Windows<'_>,
) -> Result<Vec<Fold>, EvalError> {
    let all = folds(
        protocol,
        windows.origins,
        &windows.recordings,
        config.folds,
        config.seed,
    );
    match all.is_empty() {
        true => {
            let problem = "the recordings cannot be divided";
            Err(EvalError::Empty(format!("{}: {problem}", protocol.name())))
        }
        false => Ok(all),
    }
}

/// Scores of the windows of a fold along the principal components of its training windows, and what kernels need of them.
struct Components {
    train: Vec<Vec<f64>>,
    test: Vec<Vec<f64>>,
    /// Squared distances of training and test windows to each training window: `[window][training window]`.
    train_squared: Vec<Vec<f64>>,
    test_squared: Vec<Vec<f64>>,
    /// Sum of the variances of the components.
    variance: f64,
}

impl Components {
    fn new(train: Vec<Vec<f64>>, test: Vec<Vec<f64>>, pca: &Pca) -> Self {
        let squared = |rows: &[Vec<f64>]| -> Vec<Vec<f64>> {
            let row = |a: &Vec<f64>| train.iter().map(|b| squared_distance(a, b)).collect();
            rows.par_iter().map(row).collect()
        };
        Self {
            train_squared: squared(&train),
            test_squared: squared(&test),
            variance: pca.variances().iter().sum(),
            train,
            test,
        }
    }
}

/// Squared distance, in eight sums, so that the compiler can use vectors.
fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (mut a, mut b) = (a.chunks_exact(8), b.chunks_exact(8));
    for (a, b) in a.by_ref().zip(b.by_ref()) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += (a - b) * (a - b);
        }
    }
    let rest = a.remainder().iter().zip(b.remainder());
    sums.iter().sum::<f64>() + rest.map(|(a, b)| (a - b) * (a - b)).sum::<f64>()
}

struct Outcome {
    /// The class of each test window.
    predicted: Vec<usize>,
    n_unfinished: usize,
}

fn classified(
    config: &RadharConfig,
    classifier: VoxelClassifier,
    windows: &Windows<'_>,
    gram: &Gram,
    fold: &Fold,
    components: &Components,
    seed: u64,
) -> Option<Outcome> {
    let mut labels = windows.labels(&fold.train);
    let n_classes = windows.n_classes;
    let Components {
        train,
        test,
        variance,
        ..
    } = components;
    let of_components = |gamma: f64, labels: &[usize]| {
        svm_outcome(config, labels, n_classes, test.len(), &|a, b| {
            let squared = match a {
                Row::Train(a) => components.train_squared[a][b],
                Row::Test(a) => components.test_squared[a][b],
            };
            rbf(squared, gamma)
        })
    };
    match classifier {
        VoxelClassifier::Svm => svm_outcome(config, &labels, n_classes, test.len(), &|a, b| {
            let a = match a {
                Row::Train(a) => fold.train[a],
                Row::Test(a) => fold.test[a],
            };
            rbf(gram.squared_distance(a, fold.train[b]), config.svm.gamma)
        }),
        VoxelClassifier::PcaSvm => of_components(config.svm.gamma, &labels),
        VoxelClassifier::PcaSvmScaled => of_components(1.0 / variance, &labels),
        VoxelClassifier::Shuffled => {
            let order = shuffled(labels.len(), derive_seed(seed, "labels"));
            labels = order.into_iter().map(|i| labels[i]).collect();
            of_components(1.0 / variance, &labels)
        }
        VoxelClassifier::PcaMlp => {
            // One factor for all components, so that those of small variance stay small.
            let n_components = train.first().map_or(1, Vec::len);
            let factor = (n_components as f64 / variance).sqrt();
            let scaled = |rows: &[Vec<f64>]| -> Vec<Vec<f64>> {
                let row = |row: &Vec<f64>| row.iter().map(|v| v * factor).collect();
                rows.iter().map(row).collect()
            };
            let model = Mlp::train(&scaled(train), &labels, n_classes, &config.mlp, seed)?;
            let test = scaled(test);
            Some(Outcome {
                predicted: test.iter().map(|row| model.predict(row)).collect(),
                n_unfinished: 0,
            })
        }
    }
}

/// A window of a fold.
#[derive(Clone, Copy)]
enum Row {
    Train(usize),
    Test(usize),
}

/// Trains a support vector machine on the kernel of windows with training windows, and classifies the test windows.
fn svm_outcome(
    config: &RadharConfig,
    labels: &[usize],
    n_classes: usize,
    n_test: usize,
    kernel: &(dyn Fn(Row, usize) -> f64 + Sync),
) -> Option<Outcome> {
    let n = labels.len();
    let row = |a: Row| -> Vec<f32> { (0..n).map(|b| kernel(a, b) as f32).collect() };
    let matrix: Vec<Vec<f32>> = (0..n).into_par_iter().map(|a| row(Row::Train(a))).collect();
    let svm = Svm::train(&matrix.concat(), labels, n_classes, config.svm.penalty)?;
    let tested = (0..n_test).into_par_iter();
    Some(Outcome {
        predicted: tested.map(|a| svm.predict(&row(Row::Test(a)))).collect(),
        n_unfinished: svm.n_unfinished(),
    })
}

/// A classifier of window features. Windows without features are not trained on, and are wrong where they are tested.
fn feature_row(
    config: &RadharConfig,
    classifier: FeatureClassifier,
    division: Division,
    windows: &Windows<'_>,
    values: &[Option<Vec<f32>>],
) -> Result<RadharRow, EvalError> {
    let start = Instant::now();
    let mut results = Vec::new();
    for protocol in &config.protocols {
        let folds = folds_of(config, *protocol, windows)?;
        let mut scores = Vec::new();
        for (i, fold) in folds.iter().enumerate() {
            let train: Vec<usize> = (fold.train.iter().copied())
                .filter(|window| values[*window].is_some())
                .collect();
            let labels = windows.labels(&train);
            let seed = derive_seed(config.seed, &format!("{}-{i}", protocol.name()));
            let (n_classes, n_trees) = (windows.n_classes, config.trees);
            let predict = feature_classifier(
                classifier, values, &train, &labels, n_classes, n_trees, seed,
            )
            .ok_or_else(|| EvalError::Empty("no training window has enough points".into()))?;
            let of_window = |window: &usize| values[*window].as_ref().map(|row| predict(row));
            let predicted: Vec<Option<usize>> = fold.test.iter().map(of_window).collect();
            scores.push(windows.score(fold, &predicted));
        }
        results.push(windows.result(*protocol, &folds, &scores));
    }
    let classifier = match classifier {
        FeatureClassifier::Forest => format!("forest of {} trees", config.trees),
        FeatureClassifier::Logistic => "logistic regression".into(),
    };
    Ok(RadharRow {
        name: format!("window features of {} s: {classifier}", division.length_s),
        results,
        explained: None,
        unfinished: 0,
        seconds: start.elapsed().as_secs_f64(),
    })
}

type Predict = Box<dyn Fn(&[f32]) -> usize>;

fn feature_classifier(
    classifier: FeatureClassifier,
    values: &[Option<Vec<f32>>],
    train: &[usize],
    labels: &[usize],
    n_classes: usize,
    n_trees: usize,
    seed: u64,
) -> Option<Predict> {
    let rows = train.iter().filter_map(|window| values[*window].as_ref());
    Some(match classifier {
        FeatureClassifier::Forest => {
            let rows: Vec<Vec<f32>> = rows.cloned().collect();
            let forest = Forest::fit(&rows, labels, n_classes, n_trees, seed)?;
            Box::new(move |row| {
                let p = forest.probabilities(row);
                let classes = 0..p.len();
                classes
                    .max_by(|a, b| p[*a].total_cmp(&p[*b]))
                    .unwrap_or_default()
            })
        }
        FeatureClassifier::Logistic => {
            let wide = |row: &[f32]| -> Vec<f64> { row.iter().map(|v| f64::from(*v)).collect() };
            let rows: Vec<Vec<f64>> = rows.map(|row| wide(row)).collect();
            let model = LogisticRegression::train(&rows, labels, n_classes)?;
            Box::new(move |row| model.predict(&wide(row)))
        }
    })
}

#[cfg(test)]
mod tests {
    use radarllm_base::{Clutter, PointFrame, Provenance, random::SplitMix64};

    use super::*;

    const CONFIG: &str = "recordings = \"r.toml\"\nseed = 1\nfolds = 3\n\
        protocols = [\"recording\", \"session\", \"window\"]\nvoxels = [\"frame\", \"box-velocity\"]\n\
        components = 20\ntrees = 30\nsvm = { penalty = 1e3, gamma = 1e-4 }\n";

    /// A recording of 102 frames, five windows, whose points move at a rate and a height that depend on the activity.
    fn recording(activity: usize, number: usize) -> RadharRecording {
        let mut rng = SplitMix64::new((activity * 100 + number) as u64);
        let frames: Vec<Vec<RadarPoint>> = (0..102)
            .map(|i| {
                let phase = i as f32 / 30.0 * std::f32::consts::TAU * (0.5 + 1.5 * activity as f32);
                let point = |k: usize| RadarPoint {
                    x_m: 0.2 * (rng.uniform_f32() - 0.5),
                    y_m: 2.0 + 0.2 * rng.uniform_f32(),
                    z_m: 0.5 * activity as f32 - 0.4 + 0.05 * k as f32 + 0.1 * phase.sin(),
                    range_m: 2.2,
                    velocity_mps: phase.cos(),
                    ..RadarPoint::default()
                };
                let mut points: Vec<RadarPoint> = (0..8).map(point).collect();
                // Corners of the room, so that the scale is that of the room.
                for [x_m, y_m, z_m] in [[-2.0, 0.2, -1.0], [2.0, 4.0, 1.4]] {
                    points.push(RadarPoint {
                        x_m,
                        y_m,
                        z_m,
                        ..RadarPoint::default()
                    });
                }
                points
            })
            .collect();
        let clip_frames = frames.iter().step_by(3).enumerate();
        let clip = Clip {
            frames: clip_frames
                .map(|(i, points)| PointFrame {
                    frame: i as u32,
                    time_s: i as f64 / 10.0,
                    points: points.clone(),
                    board: None,
                })
                .collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "iwr1443".into(),
            provenance: Provenance::recorded("radhar", "r.txt"),
            clutter: Clutter::Settled,
        };
        let session = if number.is_multiple_of(2) { "" } else { "__" };
        RadharRecording {
            name: format!("a{activity}/{session}20_{number}.txt"),
            activity,
            frames,
            clip,
        }
    }

    #[test]
    fn made_activities_are_told_apart_in_all_protocols_and_shuffled_labels_are_not() {
        let config = RadharConfig::from_toml(CONFIG).unwrap();
        let recordings: Vec<RadharRecording> = (0..2)
            .flat_map(|activity| (0..6).map(move |number| recording(activity, number)))
            .collect();
        let names = ["slow".to_owned(), "fast".to_owned()];
        let report = evaluate(&config, &names, &recordings, &|_| ()).unwrap();
        assert_eq!((report.windows, &report.recordings[..]), (60, &[6, 6][..]));
        assert_eq!(report.sessions.len(), 2);
        // Five rows of the first kind of voxels, four of the second, and four of features.
        assert_eq!(report.rows.len(), 13);
        for row in &report.rows {
            let folds: Vec<usize> = row.results.iter().map(|r| r.folds).collect();
            assert_eq!(folds, [3, 2, 3], "{}", row.name);
            assert_eq!(row.unfinished, 0);
            assert_eq!(row.results[0].recordings_tested, 12);
        }
        let features = report.rows.iter().filter(|r| r.name.contains("features"));
        for row in features {
            assert!(row.results[0].windows.mean > 0.95, "{row:?}");
        }
        // Heights that differ by half a metre are seven cells apart.
        for row in [&report.rows[2], &report.rows[7]] {
            assert!(row.name.contains("scaled to the data"), "{}", row.name);
            assert!(row.results[0].windows.mean > 0.95, "{row:?}");
        }
        let chance = report
            .rows
            .iter()
            .find(|r| r.name.contains("chance"))
            .unwrap();
        let mean = chance.results[0].windows.mean;
        // Sixty windows of which half are right by chance: within three deviations of 6.5 %.
        assert!((0.3..=0.7).contains(&mean), "{mean}");
        let page = markdown(&report, "c.toml");
        assert!(
            page.contains("by session") && page.contains("PCA 20"),
            "{page}"
        );
    }

    #[test]
    fn windows_without_features_are_wrong_and_ties_are_no_answer() {
        let origins = [0, 1].map(|activity| Origin {
            activity,
            session: String::new(),
        });
        let windows = Windows {
            recordings: vec![0, 0, 0, 1, 1],
            origins: &origins,
            n_classes: 2,
        };
        let fold = Fold {
            train: Vec::new(),
            test: (0..5).collect(),
        };
        let predicted = [Some(0), None, Some(0), Some(1), Some(0)];
        assert_eq!(windows.score(&fold, &predicted), [0.6, 0.5, 1.0, 2.0]);
        assert_eq!(windows.score(&fold, &[None; 5]), [0.0, 0.0, 0.0, 2.0]);
        let spread = Spread::of(&[0.5, 0.7]);
        assert!(
            (spread.mean - 0.6).abs() < 1e-12 && (spread.deviation - 0.02_f64.sqrt()).abs() < 1e-12
        );
    }

    #[test]
    fn the_session_is_the_underscores_before_the_name() {
        assert_eq!(session_of("walk/___20_walk_1.txt"), "___");
        assert_eq!(session_of("jump/_jump_20_4.txt"), "_");
        assert_eq!(session_of("boxing/20_boxing_1.txt"), "");
    }

    #[test]
    fn wrong_values_are_refused_by_name() {
        let problem = |from: &str, to: &str| {
            RadharConfig::from_toml(&CONFIG.replace(from, to))
                .unwrap_err()
                .to_string()
        };
        assert!(problem("folds = 3", "folds = 1").contains("folds: expected 2 to 100"));
        assert!(problem("gamma = 1e-4", "gamma = 0").contains("svm.gamma"));
        assert!(problem("\"frame\"", "\"cube\"").contains("cube"));
    }
}
