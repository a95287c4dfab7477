//! Stage `evidence`: trains the networks that read the points of a window as numbers ([`radarllm_inference::evidence`]).
//!
//! Both learn from the captions of clips: which actions they state, and which side if they state one in all. Every clip is
//! learned with its mirror image.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use burn::tensor::{Tensor, TensorData};
use radarllm_dataset::record::ClipRecord;
use radarllm_facts::{Direction, Side, parse, swap_sides};
use radarllm_inference::evidence::{
    Content, EVIDENCE_KIND, EvidenceFile, N_SIDES, N_VALUES, SEVERAL, SIDES, SidedAction,
    WindowValues, content_of, only_side,
};
use radarllm_inference::tokenizer::MAX_FRAMES;
use radarllm_nn::evidence::EvidenceNet;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

use crate::adamw::AdamWConfig;
use crate::data::plan_batches;
use crate::harness::{
    self, LoopConfig, Outcome, Stage, StepInfo, StepLoss, TrainError, Validation,
};
use crate::lm::loss::cross_entropy;
use crate::loop_config::{check_count, check_weight};
use crate::recipe::copy_of;

/// Logit of both sides for an action that is made with one.
const NEVER: f32 = -1e4;
/// Clips of a content, or of an action with a side, from which on it is learned.
const MIN_CLIPS: usize = 20;
/// Share of the clips of an action that are made with both sides, from which on it can be.
const MIN_BOTH: f32 = 0.03;
/// Most sentences that are kept of a content.
const MAX_SENTENCES: usize = 16;

/// Settings of the stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EvidenceTrainConfig {
    /// Clips per batch; each enters with its mirror image.
    pub batch_size: usize,
    /// Widths of the two hidden layers of each network.
    pub hidden: [usize; 2],
    /// Standard deviation of the noise on standardised values in training.
    pub noise: f64,
    /// Share of the values that are replaced by their mean in training.
    pub dropped: f64,
    /// Settings of the training loop.
    #[serde(rename = "loop")]
    pub run: LoopConfig,
}

impl Default for EvidenceTrainConfig {
    fn default() -> Self {
        Self {
            batch_size: 64,
            hidden: [384, 96],
            noise: 0.1,
            dropped: 0.3,
            run: LoopConfig {
                learning_rate: 2e-3,
                epochs: 15,
                adamw: AdamWConfig {
                    weight_decay: 0.05,
                    ..AdamWConfig::default()
                },
                ..LoopConfig::default()
            },
        }
    }
}

impl EvidenceTrainConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that cannot be used.
    pub fn validate(&self) -> Result<(), TrainError> {
        self.run.validate()?;
        check_count("batch_size", self.batch_size, 4096)?;
        for width in self.hidden {
            check_count("hidden", width, 4096)?;
        }
        check_weight("noise", self.noise)?;
        match (0.0..1.0).contains(&self.dropped) {
            true => Ok(()),
            false => {
                let problem = format!("must be at least 0 and below 1, found {}", self.dropped);
                Err(TrainError::config("dropped", problem))
            }
        }
    }
}

/// Trains the networks with clips and as many disturbed copies of each ([`radarllm_base::disturb`]), and writes
/// checkpoints to `out_dir`.
///
/// # Errors
/// See [`TrainError`]. Also what [`check_captions`] refuses.
pub fn train(
    config: &EvidenceTrainConfig,
    train: &[ClipRecord],
    disturbed_copies: usize,
    val: &[ClipRecord],
    out_dir: &Path,
    resume: bool,
) -> Result<Outcome<EvidenceNet>, TrainError> {
    config.validate()?;
    check_captions(train, disturbed_copies)?;
    let clips = stating(train, disturbed_copies);
    let (mean, deviation) = moments(&clips);
    let mut file = EvidenceFile {
        kind: EVIDENCE_KIND.into(),
        contents: contents(train),
        sided: sided(&clips),
        hidden: config.hidden,
        mean,
        deviation,
        training: serde_json::Value::Null,
    };
    if file.sided.is_empty() {
        return Err(TrainError::NoData(
            "the clips that state a side of an action have no points",
        ));
    }
    let known = |clips: Vec<Stating>| -> Vec<Sample> {
        clips.iter().filter_map(|clip| clip.sample(&file)).collect()
    };
    let (train, val) = (known(clips), known(stating(val, 0)));
    file.training = serde_json::json!({
        "batch_size": config.batch_size,
        "noise": config.noise,
        "dropped": config.dropped,
        "train_clips": train.len(),
    });
    let shape = file.shape();
    let mut stage = EvidenceStage {
        config: config.clone(),
        file,
        train,
        val,
    };
    let model = harness::seeded_network(&config.run, "evidence/init", |device| {
        EvidenceNet::new(&shape, device)
    })?;
    harness::run(&mut stage, model, &config.run, out_dir, resume)
}

/// Checks by their captions alone that enough clips, with as many disturbed copies of each, state an action, and a side of
/// one. A recipe of several stages calls it before the first of them.
///
/// # Errors
/// [`TrainError::TooFewClips`].
pub fn check_captions(clips: &[ClipRecord], disturbed_copies: usize) -> Result<(), TrainError> {
    let mut contents: BTreeMap<String, usize> = BTreeMap::new();
    let mut sided: BTreeMap<&str, usize> = BTreeMap::new();
    for clip in clips {
        let Some((content, _)) = stated(&clip.captions) else {
            continue;
        };
        *contents.entry(content).or_default() += 1;
        if let Some((action, _)) = stated_side(&clip.captions) {
            *sided.entry(action).or_default() += 1 + disturbed_copies;
        }
    }
    let several = contents.iter().filter(|(name, _)| name.contains(' '));
    let n_several = several.map(|(_, n)| *n).filter(|n| *n < MIN_CLIPS).sum();
    let n_action = contents.into_values().chain([n_several]).max();
    for (what, found) in [
        ("no action", n_action),
        ("no side of an action", sided.into_values().max()),
    ] {
        let found = found.unwrap_or(0);
        if found < MIN_CLIPS {
            return Err(TrainError::TooFewClips {
                what,
                found,
                needed: MIN_CLIPS,
            });
        }
    }
    Ok(())
}

/// A clip and what its captions state.
struct Stating {
    id: String,
    /// A caption with the content of most of them.
    caption: String,
    /// The action and its side, if all captions that state a side state this one.
    side: Option<(&'static str, Side)>,
    values: WindowValues,
}

/// A clip as the networks read it.
struct Sample {
    id: String,
    /// Standardised values as seen, and of the mirror image.
    values: [Vec<f32>; 2],
    content: Option<usize>,
    side: Option<SideSample>,
}

#[derive(Clone, Copy)]
struct SideSample {
    action: usize,
    side: usize,
    has_both: bool,
}

impl Stating {
    /// `None` if the networks learn nothing of it.
    fn sample(&self, file: &EvidenceFile) -> Option<Sample> {
        let content = file.index_of(&self.caption);
        let side = self.side.and_then(|(name, side)| {
            let action = file.sided.iter().position(|a| a.name == name)?;
            let has_both = file.sided[action].has_both;
            Some(SideSample {
                action,
                side: SIDES.iter().position(|s| *s == side)?,
                has_both,
            })
            .filter(|_| has_both || side != Side::Both)
        });
        (content.is_some() || side.is_some()).then(|| Sample {
            id: self.id.clone(),
            values: [self.values.seen(), self.values.mirrored()].map(|v| file.standardised(v)),
            content,
            side,
        })
    }
}

/// The content that most captions state, and the first of these captions.
fn stated(captions: &[String]) -> Option<(String, &String)> {
    let mut found: BTreeMap<String, (usize, &String)> = BTreeMap::new();
    for caption in captions {
        if let Some(content) = content_of(caption) {
            found.entry(content).or_insert((0, caption)).0 += 1;
        }
    }
    let best = found.into_iter().max_by_key(|(_, (n, _))| *n);
    best.map(|(content, (_, caption))| (content, caption))
}

/// The action and its side, if all captions that state a side state this one.
fn stated_side(captions: &[String]) -> Option<(&'static str, Side)> {
    let sides: BTreeSet<_> = captions.iter().filter_map(|c| only_side(c)).collect();
    sides.first().copied().filter(|_| sides.len() == 1)
}

/// The clips whose captions state something, and disturbed copies of them.
fn stating(clips: &[ClipRecord], disturbed_copies: usize) -> Vec<Stating> {
    let of = |clip: &ClipRecord, copy: usize| {
        let (_, caption) = stated(&clip.captions)?;
        let frames = copy_of(clip, copy);
        let frames = &frames[..frames.len().min(MAX_FRAMES)];
        Some(Stating {
            id: clip.id.clone(),
            caption: caption.clone(),
            side: stated_side(&clip.captions),
            values: WindowValues::of(frames, clip.radar_height_m)?,
        })
    };
    let copies = |clip| (0..=disturbed_copies).filter_map(move |copy| of(clip, copy));
    clips.iter().flat_map(copies).collect()
}

/// What enough clips state, by name, with the shortest captions for each side and direction.
fn contents(clips: &[ClipRecord]) -> Vec<Content> {
    type Variant = Vec<(Option<Side>, Option<Direction>)>;
    let mut all: BTreeMap<String, (usize, BTreeMap<Variant, &str>)> = BTreeMap::new();
    for clip in clips {
        let Some((content, _)) = stated(&clip.captions) else {
            continue;
        };
        let (n, variants) = all.entry(content.clone()).or_default();
        *n += 1;
        for caption in &clip.captions {
            if content_of(caption).as_ref() != Some(&content) {
                continue;
            }
            let clauses = parse(caption);
            let actions = clauses.iter().flat_map(|c| &c.actions);
            let variant = actions.map(|a| (a.side, a.direction)).collect();
            let shortest = variants.entry(variant).or_insert(caption);
            if (caption.len(), caption.as_str()) < (shortest.len(), *shortest) {
                *shortest = caption;
            }
        }
    }
    let is_rare = |(_, (n, _)): &(&String, &(usize, _))| *n < MIN_CLIPS;
    let several = all.iter().filter(|(name, _)| name.contains(' '));
    let n_several: usize = several.filter(is_rare).map(|(_, (n, _))| n).sum();
    let enough = all.into_iter().filter(|(_, (n, _))| *n >= MIN_CLIPS);
    let mut contents: Vec<Content> = enough
        .map(|(name, (_, variants))| {
            // Shorter ones first, and each with its mirror image, so that neither side is favoured.
            let mut sentences: BTreeSet<(usize, String)> = BTreeSet::new();
            for text in variants.into_values() {
                sentences.insert((text.len(), text.into()));
                let mirrored = swap_sides(text);
                sentences.insert((mirrored.len(), mirrored));
            }
            let sentences = sentences.into_iter().map(|(_, text)| text);
            Content {
                name,
                sentences: sentences.take(MAX_SENTENCES).collect(),
            }
        })
        .collect();
    if n_several >= MIN_CLIPS {
        contents.push(Content {
            name: SEVERAL.into(),
            sentences: Vec::new(),
        });
    }
    contents
}

/// The actions of which enough clips state a side, by name.
fn sided(clips: &[Stating]) -> Vec<SidedAction> {
    let mut counts: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
    for (action, side) in clips.iter().filter_map(|clip| clip.side) {
        let (all, both) = counts.entry(action).or_default();
        *all += 1;
        *both += usize::from(side == Side::Both);
    }
    let enough = counts.into_iter().filter(|(_, (all, _))| *all >= MIN_CLIPS);
    enough
        .map(|(name, (all, both))| SidedAction {
            name: name.into(),
            has_both: both as f32 >= MIN_BOTH * all as f32,
        })
        .collect()
}

/// Mean and standard deviation of each value over clips and their mirror images.
fn moments(clips: &[Stating]) -> (Vec<f32>, Vec<f32>) {
    let rows = || {
        clips
            .iter()
            .flat_map(|c| [c.values.seen(), c.values.mirrored()])
    };
    let n = (2 * clips.len()).max(1) as f64;
    let mean_of = |of: &dyn Fn(usize, f32) -> f64| -> Vec<f64> {
        let mut sums = vec![0.0; N_VALUES];
        for row in rows() {
            for (i, (sum, value)) in sums.iter_mut().zip(row).enumerate() {
                *sum += of(i, *value);
            }
        }
        sums.into_iter().map(|sum| sum / n).collect()
    };
    let mean = mean_of(&|_, value| f64::from(value));
    let variance = mean_of(&|i, value| (f64::from(value) - mean[i]).powi(2));
    let deviation = variance.iter().map(|v| v.sqrt().max(1e-6) as f32);
    (
        mean.iter().map(|m| *m as f32).collect(),
        deviation.collect(),
    )
}

struct EvidenceStage {
    config: EvidenceTrainConfig,
    file: EvidenceFile,
    train: Vec<Sample>,
    val: Vec<Sample>,
}

/// Losses of a batch, and the shares of right answers.
struct Losses {
    total: Tensor<1>,
    actions: Answers,
    sides: Answers,
}

/// Loss and right answers of one network.
#[derive(Clone, Copy, Default)]
struct Answers {
    /// Sum over the samples.
    loss: f64,
    right: f64,
    n: f64,
}

impl Answers {
    fn of(logits: Tensor<2>, targets: &[u32]) -> (Tensor<1>, Self) {
        let chosen: Vec<i64> = logits.clone().argmax(1).into_data().iter::<i64>().collect();
        let is_right = |(c, t): &(&i64, &u32)| **c == i64::from(**t);
        let n = targets.len() as f64;
        // Smoothed labels would raise the logit of both sides without limit where it never counts.
        let loss = cross_entropy(logits, targets, &vec![1.0; targets.len()], 0.0);
        let answers = Self {
            loss: f64::from(loss.clone().into_scalar::<f32>()) * n,
            right: chosen.iter().zip(targets).filter(is_right).count() as f64,
            n,
        };
        (loss, answers)
    }

    fn add(&mut self, other: Self) {
        self.loss += other.loss;
        self.right += other.right;
        self.n += other.n;
    }

    /// Not a number without samples.
    fn mean_loss(self) -> f64 {
        self.loss / self.n
    }

    fn accuracy(self) -> f64 {
        self.right / self.n.max(1.0)
    }
}

impl EvidenceStage {
    /// Losses of samples and their mirror images with their values changed by `disturb`.
    fn losses(
        &self,
        model: &EvidenceNet,
        samples: &[&Sample],
        mut disturb: impl FnMut(f32) -> f32,
    ) -> Losses {
        let shape = self.file.shape();
        let (mut values, mut contents) = (Vec::new(), Vec::new());
        let (mut inputs, mut sides, mut never) = (Vec::new(), Vec::new(), Vec::new());
        for sample in samples {
            for (i, seen) in sample.values.iter().enumerate() {
                let row: Vec<f32> = seen.iter().map(|v| disturb(*v)).collect();
                if let Some(known) = sample.side {
                    inputs.extend(&row);
                    let action = |a: usize| f32::from(u8::from(a == known.action));
                    inputs.extend((0..shape.sided).map(action));
                    // In the mirror image, left and right are exchanged.
                    sides.push(match (i, known.side) {
                        (1, side @ 0..2) => 1 - side as u32,
                        (_, side) => side as u32,
                    });
                    never.extend([0.0, 0.0, if known.has_both { 0.0 } else { NEVER }]);
                }
                if let Some(content) = sample.content {
                    values.extend(row);
                    contents.push(content as u32);
                }
            }
        }
        let mut losses = Losses {
            total: Tensor::zeros([1], &model.device()),
            actions: Answers::default(),
            sides: Answers::default(),
        };
        if !contents.is_empty() {
            let (loss, answers) = Answers::of(model.actions(values, &shape), &contents);
            losses.total = losses.total + loss;
            losses.actions = answers;
        }
        if !sides.is_empty() {
            let never = TensorData::new(never, [sides.len(), N_SIDES]);
            let never = Tensor::from_data(never, &model.device());
            let (loss, answers) = Answers::of(model.sides(inputs, &shape) + never, &sides);
            losses.total = losses.total + loss;
            losses.sides = answers;
        }
        losses
    }
}

impl Stage for EvidenceStage {
    type Model = EvidenceNet;

    fn name(&self) -> &'static str {
        "evidence"
    }

    fn plan_epoch(&self, epoch_seed: u64) -> Vec<Vec<usize>> {
        let lengths = vec![1; self.train.len()];
        plan_batches(&lengths, self.config.batch_size, epoch_seed)
    }

    fn ids(&self, batch: &[usize]) -> Vec<String> {
        batch.iter().map(|i| self.train[*i].id.clone()).collect()
    }

    fn loss(
        &mut self,
        model: &EvidenceNet,
        batch: &[usize],
        info: StepInfo,
    ) -> Result<StepLoss, TrainError> {
        let mut rng = ChaCha8Rng::seed_from_u64(info.seed);
        // Of about the distribution of normal noise, and cheaper: the sum of three uniform numbers.
        let scale = 2.0 * self.config.noise as f32;
        let dropped = self.config.dropped as f32;
        let disturb = |value: f32| match rng.random::<f32>() < dropped {
            true => 0.0,
            false => value + scale * (0..3).map(|_| rng.random::<f32>() - 0.5).sum::<f32>(),
        };
        let samples: Vec<&Sample> = batch.iter().map(|i| &self.train[*i]).collect();
        let losses = self.losses(model, &samples, disturb);
        Ok(StepLoss {
            total: losses.total,
            parts: vec![
                ("actions", losses.actions.accuracy()),
                ("sides", losses.sides.accuracy()),
            ],
        })
    }

    fn validate(&mut self, model: &EvidenceNet) -> Result<Validation, TrainError> {
        let (mut actions, mut sides) = (Answers::default(), Answers::default());
        let samples: Vec<&Sample> = self.val.iter().collect();
        for chunk in samples.chunks(self.config.batch_size) {
            let losses = self.losses(model, chunk, |value| value);
            actions.add(losses.actions);
            sides.add(losses.sides);
        }
        // Without validation clips the score is not a number, which is never the best one.
        Ok(Validation {
            score: actions.mean_loss() + sides.mean_loss(),
            values: vec![
                ("actions_loss", actions.mean_loss()),
                ("actions", actions.accuracy()),
                ("sides_loss", sides.mean_loss()),
                ("sides", sides.accuracy()),
            ],
        })
    }

    fn config(&self) -> serde_json::Value {
        serde_json::to_value(&self.file).unwrap_or_default()
    }
}
