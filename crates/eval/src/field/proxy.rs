//! What a data set teaches about recordings, without training a network.
//!
//! A forest on simple features of windows needs a minute where a network needs hours. Simulated clips that cannot teach
//! it to recognise recordings do not teach a network either, so a generator of clips is judged by it first.

use radarllm_base::{
    Clip, Clutter, Provenance,
    disturb::{Pace, disturb},
    seed::derive_seed,
};
use radarllm_dataset::{ClipRecord, Columns, Dataset, Split};
use radarllm_inference::{Description, Segment, actions, prepare::RATE_TOLERANCE};

use crate::{EvalError, features::windows, forest::Forest};

/// Trees of the forest.
const N_TREES: usize = 300;
/// Most frames of a clip: those of the model.
const MAX_FRAMES: usize = 96;

/// A forest that names the action of a recording.
pub struct Proxy {
    forest: Forest,
    /// A sentence for each class.
    captions: Vec<String>,
    /// Number of windows that it was trained on.
    n_windows: usize,
}

impl Proxy {
    /// Trains a forest on the training clips of data sets, each clip with `copies` disturbed copies.
    ///
    /// # Errors
    /// A data set that cannot be read, or data sets of different frame rates; those of [`Self::train`].
    pub fn of_data_sets(data: &[Dataset], copies: usize, seed: u64) -> Result<Self, EvalError> {
        let rate_hz = data.first().map_or(10.0, |d| d.manifest().frame_rate_hz);
        let mut clips = Vec::new();
        for data in data {
            let own_hz = data.manifest().frame_rate_hz;
            if (own_hz / rate_hz - 1.0).abs() > RATE_TOLERANCE {
                return Err(EvalError::Config(format!(
                    "{}: {own_hz} frames/s, the first data set has {rate_hz}",
                    data.dir().display()
                )));
            }
            for clip in data.iter_split(Split::Train, Columns::Points) {
                clips.push(clip?);
            }
        }
        Self::train(&clips, rate_hz, copies, seed)
    }

    /// Name in reports.
    pub fn name(&self) -> String {
        format!("forest on {} simulated windows", self.n_windows)
    }

    /// Trains a forest on clips of single actions at `frame_rate_hz`, each with `copies` disturbed copies.
    ///
    /// # Errors
    /// No clip with a single action and enough points.
    pub fn train(
        clips: &[ClipRecord],
        frame_rate_hz: f64,
        copies: usize,
        seed: u64,
    ) -> Result<Self, EvalError> {
        let mut names: Vec<&str> = Vec::new();
        let mut captions: Vec<String> = Vec::new();
        let (mut rows, mut labels) = (Vec::new(), Vec::new());
        for record in clips {
            // The sentence stands for the class, so it must state one action.
            let stated = |caption: &&String| actions(caption).len() == 1;
            let Some(caption) = record.captions.iter().find(stated) else {
                continue;
            };
            if record.action.contains(' ') {
                continue;
            }
            let class = names
                .iter()
                .position(|n| *n == record.action)
                .unwrap_or_else(|| {
                    names.push(&record.action);
                    captions.push(caption.clone());
                    names.len() - 1
                });
            for copy in 0..=copies {
                let clip = clip(record, frame_rate_hz, copy, seed);
                for features in windows(&clip).into_iter().filter_map(|w| w.features) {
                    rows.push(features);
                    labels.push(class);
                }
            }
        }
        let forest = Forest::fit(&rows, &labels, names.len(), N_TREES, seed).ok_or_else(|| {
            EvalError::Empty("no clip of a single action with enough points".into())
        })?;
        Ok(Self {
            forest,
            captions,
            n_windows: rows.len(),
        })
    }

    /// Describes a prepared clip by one sentence: that of the class with the highest mean probability over its windows.
    pub fn describe(&self, clip: &Clip) -> Description {
        let mut description = Description {
            caption: radarllm_inference::lm::captioner::NO_PERSON.into(),
            confidence: 0.0,
            tokens: Vec::new(),
            seconds: clip.duration_s() as f32,
            windows: 0,
            segments: Vec::new(),
            choices: Vec::new(),
            abstained: None,
        };
        let rows: Vec<Vec<f32>> = windows(clip)
            .into_iter()
            .filter_map(|w| w.features)
            .collect();
        let mut sum = vec![0.0; self.captions.len()];
        for row in &rows {
            let p = self.forest.probabilities(row);
            sum.iter_mut()
                .zip(p)
                .for_each(|(s, p)| *s += p / rows.len() as f32);
        }
        let best = (0..sum.len()).max_by(|a, b| sum[*a].total_cmp(&sum[*b]));
        if let (Some(best), Some(first)) = (best, clip.frames.first())
            && !rows.is_empty()
        {
            description.windows = rows.len();
            description.set_segments(vec![Segment {
                start_s: first.time_s,
                end_s: first.time_s + clip.duration_s(),
                caption: self.captions[best].clone(),
                actions: actions(&self.captions[best]),
                confidence: sum[best],
                side_confidence: None,
                taught: None,
                guess: None,
            }]);
        }
        description
    }
}

/// A clip of a data set; copy 0 as it is, others disturbed.
fn clip(record: &ClipRecord, frame_rate_hz: f64, copy: usize, seed: u64) -> Clip {
    let pace = Pace::UpTo {
        max_frames: MAX_FRAMES,
    };
    let frames = match copy {
        0 => record.frames.clone(),
        _ => {
            let seed = derive_seed(seed ^ record.seed, &format!("proxy/{copy}"));
            disturb(&record.frames, frame_rate_hz, pace, seed)
        }
    };
    Clip {
        frames,
        frame_rate_hz,
        radar_height_m: record.radar_height_m,
        is_height_assumed: false,
        radar: record.radar.clone(),
        provenance: Provenance::simulated(&record.id, record.seed),
        clutter: Clutter::Settled,
    }
}
