//! How good are a model's captions of a data set's split?
//!
//! [`evaluate_captions`] describes every motion of a split once and scores the captions against the references, beside
//! three baselines on the same clips. [`report`] writes tables and Markdown, [`examples`] chooses clips to look at. The
//! other questions about captions of simulated clips are beside it.

pub mod ablation;
pub mod action;
pub mod baselines;
pub mod comparison;
pub mod descriptor;
pub mod embedding_scores;
pub mod examples;
pub mod facts;
pub mod floors;
pub mod instructions;
pub mod interventions;
pub mod report;
pub mod robustness;
pub mod round_trip;
mod slices;

use std::{collections::BTreeSet, time::Instant};

use radarllm_base::{Clip, Clutter, PointFrame, Provenance};
use radarllm_dataset::{ClipRecord, Columns, Dataset, RECORDINGS, Split};
use radarllm_inference::{
    Captioner, Description, FRAME_RATE_HZ,
    lm::RadarCut,
    tokenizer::usage::{CodeUsage, code_usage},
};
use radarllm_metrics::{
    Candidate, Reference, ScoreOptions, Scores, bootstrap::units_of_ids, rouge::rouge_l, score,
    tokens,
};
use serde::{Deserialize, Deserializer, Serialize, de::Error as _};

use crate::{
    ActionClassifier, Estimate, EvalError, ModelInfo,
    baselines::{NearestNeighbour, majority_caption, shuffled_assignment},
    captioner::caption_clips,
    descriptor::descriptor,
};

/// References counted of each clip.
pub const MAX_REFERENCES: usize = 3;

/// What is evaluated, and how.
#[derive(Clone, Debug)]
pub struct EvaluationOptions {
    /// Split to describe.
    pub split: Split,
    /// As [`DescribeOptions::beam`](radarllm_inference::DescribeOptions::beam).
    pub beam: Option<usize>,
    /// Seed of the bootstrap and of the shuffled baseline.
    pub seed: u64,
}

impl Default for EvaluationOptions {
    fn default() -> Self {
        Self {
            split: Split::Test,
            beam: None,
            seed: 1,
        }
    }
}

/// The model or a baseline on the split.
#[derive(Clone, Debug, Serialize)]
pub struct System {
    /// `model`, `tokens_only`, `without_tokens`, `permuted_tokens`, `shuffled`, `majority` or `nearest`.
    pub name: &'static str,
    /// What it is, in words.
    pub what: &'static str,
    /// Caption metrics.
    pub scores: Scores,
    /// Facts of the captions beside those of the references.
    pub facts: facts::FactCounts,
    /// Share of captions in which the action classifier recognises the clip's action, 0..=1.
    pub action_accuracy: Estimate,
    /// Share of captions with exactly the actions of one of the references, in order, 0..=1.
    pub same_actions: Estimate,
}

/// The model on a part of the split.
#[derive(Clone, Debug, Serialize)]
pub struct Slice {
    /// Which part.
    pub name: String,
    /// Clips in it.
    pub clips: usize,
    /// Share of captions in which the action classifier recognises the clip's action, 0..=1.
    pub action_accuracy: Estimate,
    /// Share of captions with exactly the actions of one of the references, in order, 0..=1.
    pub same_actions: Estimate,
    /// Mean ROUGE-L of the captions, 0..=1.
    pub rouge_l: Estimate,
}

/// Clips of one action whose captions are classified as another.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Confusion {
    /// Action of the clips.
    pub action: String,
    /// Action of the captions; `None` if the classifier knows no word of them.
    pub named: Option<String>,
    /// Number of clips.
    pub clips: usize,
}

/// A model on one split of a data set, beside its baselines.
#[derive(Clone, Debug, Serialize)]
pub struct CaptionReport {
    /// Name of the data set.
    pub data: String,
    /// Name of the split.
    pub split: String,
    /// Name of the model.
    pub model: String,
    /// What decoded the sentences.
    pub decoder: &'static str,
    /// Protocol of the caption metrics.
    pub protocol: &'static str,
    /// References counted of each clip.
    pub max_references: usize,
    /// Clips described: one of each motion.
    pub clips: usize,
    /// Clips without a caption, because they have too few points or frames.
    pub abstained: usize,
    /// Training clips, from which baselines and action classifier are made.
    pub train_clips: usize,
    /// Beams of the search for a sentence; none for a vote.
    pub beam: Option<usize>,
    /// Seed of bootstrap and shuffling.
    pub seed: u64,
    /// The model, then the baselines.
    pub systems: Vec<System>,
    /// Share of this split's reference captions that are classified as their action: the highest action accuracy that
    /// captions like the references can reach.
    pub action_accuracy_on_references: f64,
    /// By action.
    pub by_action: Vec<Slice>,
    /// By length of the clip.
    pub by_length: Vec<Slice>,
    /// By number of actions in the clip, where the label shows it (built-in motions).
    pub by_n_actions: Vec<Slice>,
    /// Facts of the captions by kind.
    pub facts: Vec<facts::FactsOfKind>,
    /// By what no training caption states.
    pub by_novelty: Vec<facts::NoveltySlice>,
    /// Most frequent first.
    pub confusions: Vec<Confusion>,
    /// Use of the radar tokens in all clips, those of the first member of an ensemble.
    pub codes: CodeUsage,
    /// Parameters of the model.
    pub parameters: usize,
    /// Size of the model's files, bytes.
    pub model_bytes: u64,
    /// Time from points to captions of all clips, s.
    pub seconds: f64,
    /// Captions per second of that time.
    pub captions_per_s: f64,
    /// Radar frames per second of that time.
    pub radar_frames_per_s: f64,
    /// Tokens of the captions with their end marks per second of that time.
    pub tokens_per_s: f64,
    /// Peak memory of the process, MB; `None` until the caller has measured it.
    pub peak_memory_mb: Option<f64>,
}

/// One clip of the split with its caption.
#[derive(Clone, Debug)]
pub struct CaptionedClip {
    /// Name of the clip.
    pub id: String,
    /// Action label.
    pub action: String,
    /// Reference captions.
    pub references: Vec<String>,
    /// Source of the motion.
    pub source: String,
    /// The points.
    pub clip: Clip,
    /// Caption of the model.
    pub description: Description,
    /// First caption of the nearest training clip.
    pub nearest: String,
    /// ROUGE-L of the caption, 0..=1.
    pub rouge_l: f64,
    /// Action that the caption is classified as; `None` if the classifier knows no word of it.
    pub classified_as: Option<String>,
}

/// A caption as scripts read it, one JSON object a line.
#[derive(Clone, Debug, Serialize)]
pub struct CaptionLine<'a> {
    id: &'a str,
    action: &'a str,
    text: &'a str,
    confidence: f32,
    nearest: &'a str,
    references: &'a [String],
}

impl CaptionedClip {
    /// Whether the caption is classified as the clip's action.
    pub fn is_action_correct(&self) -> bool {
        self.classified_as.as_deref() == Some(self.action.as_str())
    }

    /// The line of this clip.
    pub fn line(&self) -> CaptionLine<'_> {
        CaptionLine {
            id: &self.id,
            action: &self.action,
            text: &self.description.caption,
            confidence: self.description.confidence,
            nearest: &self.nearest,
            references: &self.references,
        }
    }
}

/// Describes one clip of every motion of a split, and scores the captions.
///
/// # Errors
/// A data set that cannot be read or lacks clips in the split or in `train`; a clip that the model refuses.
pub fn evaluate_captions(
    captioner: &Captioner,
    model: &ModelInfo,
    data: &Dataset,
    options: &EvaluationOptions,
) -> Result<(CaptionReport, Vec<CaptionedClip>), EvalError> {
    evaluate_captions_with(captioner, &[], model, data, options, &|_, _, _| Ok(()))
}

/// Adds scores of the same captions that need more than the captions, such as those of a sentence encoder.
pub type AddScores<'a> =
    &'a dyn Fn(&mut Scores, &[Candidate], &[Reference]) -> Result<(), EvalError>;

/// As [`evaluate_captions`], with the model whose ways from the radar are cut as further systems, and with further scores of
/// every system.
///
/// # Errors
/// As [`evaluate_captions`], and those of `add`.
pub fn evaluate_captions_with(
    captioner: &Captioner,
    cut: &[(RadarCut, &Captioner)],
    model: &ModelInfo,
    data: &Dataset,
    options: &EvaluationOptions,
    add: AddScores,
) -> Result<(CaptionReport, Vec<CaptionedClip>), EvalError> {
    let EvaluationOptions { split, beam, seed } = *options;
    // The model was trained on the frames of a data set one by one, whatever their rate.
    let frame_rate_hz = f64::from(FRAME_RATE_HZ);
    let mut records = read(data, split)?;
    let train = read(data, Split::Train)?;
    if records.is_empty() || train.is_empty() {
        return Err(EvalError::Empty(format!(
            "{}: no clips in split `{split}` or `train`",
            data.dir().display()
        )));
    }
    let classifier = ActionClassifier::fit(&captions_with_actions(&train))
        .ok_or_else(|| EvalError::Empty("the training captions hold no words".into()))?;
    let nearest = nearest_captions(
        &train,
        records
            .iter()
            .map(|r| (r.frames.as_slice(), r.radar_height_m)),
    )?;
    let train_captions: Vec<&str> = train
        .iter()
        .flat_map(|c| &c.captions)
        .map(String::as_str)
        .collect();
    let majority = majority_caption(&train_captions).unwrap_or_default();

    let clips: Vec<Clip> = records
        .iter_mut()
        .map(|r| take_clip(r, frame_rate_hz))
        .collect();
    let started = Instant::now();
    let described = caption_clips(captioner, &clips.iter().collect::<Vec<_>>(), beam)?;
    let seconds = started.elapsed().as_secs_f64();
    let cut = cut
        .iter()
        .map(|(cut, captioner)| {
            let described = caption_clips(captioner, &clips.iter().collect::<Vec<_>>(), beam)?;
            let texts: Vec<String> = described.into_iter().map(|d| d.caption).collect();
            Ok((*cut, texts))
        })
        .collect::<Result<Vec<_>, EvalError>>()?;
    let n_frames: usize = clips.iter().map(|c| c.frames.len()).sum();
    let mut n_tokens = 0;
    for description in &described {
        n_tokens += captioner.vocab().text_ids(&description.caption)?.len() + 1;
    }
    let captioned: Vec<CaptionedClip> = records
        .into_iter()
        .zip(clips)
        .zip(described)
        .zip(nearest)
        .map(|(((record, clip), description), nearest)| CaptionedClip {
            rouge_l: best_rouge_l(&description.caption, &record.captions),
            classified_as: classifier.classify(&description.caption).map(Into::into),
            id: record.id,
            action: record.action,
            references: record.captions,
            source: record.source,
            clip,
            description,
            nearest,
        })
        .collect();

    let texts: Vec<&str> = captioned
        .iter()
        .map(|c| c.description.caption.as_str())
        .collect();
    let order = shuffled_assignment(captioned.len(), seed)
        .ok_or_else(|| EvalError::Empty("a single clip cannot be shuffled".into()))?;
    let shuffled: Vec<&str> = order.iter().map(|&i| texts[i]).collect();
    let nearest: Vec<&str> = captioned.iter().map(|c| c.nearest.as_str()).collect();
    let items: Vec<Item> = captioned
        .iter()
        .map(|c| Item {
            id: &c.id,
            action: &c.action,
            references: &c.references,
        })
        .collect();
    let scorer = Scorer::new(&items, &classifier, seed, add);
    let mut systems = vec![scorer.system("model", "the model on its own radar", &texts)?];
    for (cut, texts) in &cut {
        let (name, what) = of_cut(*cut);
        let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
        systems.push(scorer.system(name, what, &texts)?);
    }
    systems.extend([
        scorer.system(
            "shuffled",
            "baseline: the model on another clip's radar",
            &shuffled,
        )?,
        scorer.system(
            "majority",
            "baseline: the most frequent training caption",
            &vec![majority; captioned.len()],
        )?,
        scorer.system(
            "nearest",
            "baseline: a caption of the nearest training clip",
            &nearest,
        )?,
    ]);
    let references: Vec<(&str, &str)> = captioned
        .iter()
        .flat_map(|c| c.references.iter().map(|r| (r.as_str(), c.action.as_str())))
        .collect();
    let report = CaptionReport {
        data: data.manifest().name.clone(),
        split: split.to_string(),
        model: model.name.clone(),
        decoder: model.decoder,
        protocol: "plain",
        max_references: MAX_REFERENCES,
        clips: captioned.len(),
        abstained: captioned
            .iter()
            .filter(|c| c.description.abstained.is_some())
            .count(),
        train_clips: train.len(),
        beam,
        seed,
        systems,
        action_accuracy_on_references: classifier.accuracy(&references).unwrap_or(f64::NAN),
        by_action: slices::by_action(&captioned, seed)?,
        by_length: slices::by_length(&captioned, seed)?,
        by_n_actions: slices::by_n_actions(&captioned, seed)?,
        facts: facts::by_kind(&captioned),
        by_novelty: facts::by_novelty(&captioned, &train_captions, seed)?,
        confusions: slices::confusions(&captioned),
        codes: code_usage(
            &captioned
                .iter()
                .flat_map(|c| c.description.tokens.iter().copied())
                .collect::<Vec<_>>(),
            captioner.vocab().layout().n_codes as usize,
        ),
        parameters: captioner.n_params(),
        model_bytes: model.bytes,
        seconds,
        captions_per_s: captioned.len() as f64 / seconds,
        radar_frames_per_s: n_frames as f64 / seconds,
        tokens_per_s: n_tokens as f64 / seconds,
        peak_memory_mb: None,
    };
    Ok((report, captioned))
}

/// Name and description of the model with a way from the radar cut.
fn of_cut(cut: RadarCut) -> (&'static str, &'static str) {
    match cut {
        RadarCut::AllButTokens => (
            "tokens_only",
            "the model with its radar tokens alone: no features, no context",
        ),
        RadarCut::Tokens => (
            "without_tokens",
            "the model without its radar tokens: all have their mean embedding",
        ),
        RadarCut::TokenMeaning => (
            "permuted_tokens",
            "the model with radar tokens of another meaning: embeddings permuted",
        ),
    }
}

/// A clip as scores see it.
pub(crate) struct Item<'a> {
    id: &'a str,
    action: &'a str,
    references: &'a [String],
}

impl<'a> Item<'a> {
    fn of_record(record: &'a ClipRecord) -> Self {
        Self {
            id: &record.id,
            action: &record.action,
            references: &record.captions,
        }
    }
}

/// Scores captions of the same clips by different systems.
struct Scorer<'a> {
    clips: &'a [Item<'a>],
    classifier: &'a ActionClassifier,
    references: Vec<Reference>,
    units: Vec<usize>,
    seed: u64,
    add: AddScores<'a>,
}

/// Scores of the captions of a system.
struct Measures {
    scores: Scores,
    facts: facts::FactCounts,
    action_accuracy: Estimate,
    same_actions: Estimate,
}

impl<'a> Scorer<'a> {
    fn new(
        clips: &'a [Item<'a>],
        classifier: &'a ActionClassifier,
        seed: u64,
        add: AddScores<'a>,
    ) -> Self {
        let references = clips.iter().map(|c| Reference {
            id: c.id.into(),
            texts: c.references.to_vec(),
        });
        Self {
            clips,
            classifier,
            references: references.collect(),
            units: units_of_ids(clips.iter().map(|c| c.id)),
            seed,
            add,
        }
    }

    fn system(
        &self,
        name: &'static str,
        what: &'static str,
        texts: &[&str],
    ) -> Result<System, EvalError> {
        let measures = self.measures(texts)?;
        Ok(System {
            name,
            what,
            scores: measures.scores,
            facts: measures.facts,
            action_accuracy: measures.action_accuracy,
            same_actions: measures.same_actions,
        })
    }

    fn measures(&self, texts: &[&str]) -> Result<Measures, EvalError> {
        let pairs = || self.clips.iter().zip(texts);
        let candidates: Vec<Candidate> = pairs()
            .map(|(c, text)| Candidate {
                id: c.id.into(),
                text: (*text).into(),
            })
            .collect();
        let correct: Vec<f64> = pairs()
            .map(|(c, text)| self.classifier.classify(text) == Some(c.action))
            .map(|correct| f64::from(u8::from(correct)))
            .collect();
        let same: Vec<f64> = pairs()
            .map(|(c, text)| facts::same_actions(text, c.references))
            .collect();
        let options = ScoreOptions {
            seed: self.seed,
            max_references: MAX_REFERENCES,
            ..ScoreOptions::default()
        };
        let mut scores = score(&candidates, &self.references, &options)?;
        (self.add)(&mut scores, &candidates, &self.references)?;
        Ok(Measures {
            scores,
            facts: facts::FactCounts::of(pairs().map(|(c, text)| (*text, counted(c.references)))),
            action_accuracy: mean(&correct, &self.units, self.seed)?,
            same_actions: mean(&same, &self.units, self.seed)?,
        })
    }
}

/// Captions of clips by a model, with `beam` as in [`DescribeOptions::beam`](radarllm_inference::DescribeOptions::beam).
///
/// # Errors
/// A clip that the model refuses.
pub fn captions_of(
    captioner: &Captioner,
    records: &[ClipRecord],
    beam: Option<usize>,
) -> Result<Vec<String>, EvalError> {
    let frame_rate_hz = f64::from(FRAME_RATE_HZ);
    let clip = |record: &ClipRecord| take_clip(&mut record.clone(), frame_rate_hz);
    let clips: Vec<Clip> = records.iter().map(clip).collect();
    let described = caption_clips(captioner, &clips.iter().collect::<Vec<_>>(), beam)?;
    Ok(described.into_iter().map(|d| d.caption).collect())
}

/// The first clip of every motion.
pub fn one_of_each_motion(mut clips: Vec<ClipRecord>) -> Vec<ClipRecord> {
    let mut seen = BTreeSet::new();
    clips.retain(|c| seen.insert(c.motion_id.clone()));
    clips
}

fn mean(values: &[f64], units: &[usize], seed: u64) -> Result<Estimate, EvalError> {
    Estimate::of_mean(values, units, seed)
        .ok_or_else(|| EvalError::Empty("no captions to score".into()))
}

/// The references that count.
fn counted(references: &[String]) -> &[String] {
    &references[..references.len().min(MAX_REFERENCES)]
}

/// ROUGE-L of one caption, 0..=1, the best of the counted references: what the corpus value averages.
fn best_rouge_l(candidate: &str, references: &[String]) -> f64 {
    let references: Vec<Vec<String>> = counted(references)
        .iter()
        .map(|text| tokens::rouge_score(text))
        .collect();
    rouge_l(&tokens::rouge_score(candidate), &references)
}

/// Reads the name of a split in a configuration.
pub(crate) fn split_of<'de, D: Deserializer<'de>>(from: D) -> Result<Split, D::Error> {
    let name = String::deserialize(from)?;
    Split::from_name(&name).ok_or_else(|| {
        D::Error::custom(format!(
            "unknown split `{name}`: expected train, val or test"
        ))
    })
}

/// The split of configurations that name none.
pub(crate) fn test_split() -> Split {
    Split::Test
}

/// A split without what evaluation does not need; one variant of each motion, but for training.
pub(crate) fn read(data: &Dataset, split: Split) -> Result<Vec<ClipRecord>, EvalError> {
    let clips: Vec<ClipRecord> = data
        .iter_split(split, Columns::Points)
        .collect::<Result<_, _>>()?;
    Ok(match split {
        Split::Train => clips,
        _ => one_of_each_motion(clips),
    })
}

/// Moves the points out of a data set's clip. Clips of data sets are simulated.
pub(crate) fn take_clip(record: &mut ClipRecord, frame_rate_hz: f64) -> Clip {
    Clip {
        frames: std::mem::take(&mut record.frames),
        frame_rate_hz,
        radar_height_m: record.radar_height_m,
        is_height_assumed: false,
        radar: record.radar.clone(),
        provenance: match record.source == RECORDINGS {
            true => Provenance::recorded("dataset", &record.id),
            false => Provenance::simulated(&record.id, record.seed),
        },
        clutter: Clutter::Settled,
    }
}

fn captions_with_actions(clips: &[ClipRecord]) -> Vec<(&str, &str)> {
    clips
        .iter()
        .flat_map(|c| {
            c.captions
                .iter()
                .map(|caption| (caption.as_str(), c.action.as_str()))
        })
        .collect()
}

/// The first caption of the training clip with the nearest descriptor, for each clip: its frames and the height of its
/// radar.
///
/// # Errors
/// No training clips, or points that are not finite.
pub fn nearest_captions<'a>(
    train: &[ClipRecord],
    clips: impl Iterator<Item = (&'a [PointFrame], f32)>,
) -> Result<Vec<String>, EvalError> {
    let of_training = |c: &ClipRecord| descriptor(&c.frames, c.radar_height_m);
    let train_vectors: Vec<Vec<f32>> = train.iter().map(of_training).collect();
    let neighbours = NearestNeighbour::fit(&train_vectors)?;
    clips
        .map(|(frames, height_m)| {
            let nearest = neighbours.nearest(&descriptor(frames, height_m))?;
            Ok(train[nearest].captions[0].clone())
        })
        .collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A clip with a caption, its action and how the caption is classified.
    pub(crate) fn captioned(id: &str, action: &str, classified_as: Option<&str>) -> CaptionedClip {
        CaptionedClip {
            id: id.into(),
            action: action.into(),
            references: vec!["a person moves".into()],
            source: "procedural".into(),
            clip: Clip {
                frames: Vec::new(),
                frame_rate_hz: 10.0,
                radar_height_m: 1.0,
                is_height_assumed: false,
                radar: "awr1843boost".into(),
                provenance: Provenance::simulated(id, 1),
                clutter: Clutter::Settled,
            },
            description: Description {
                caption: "a person moves".into(),
                confidence: 0.5,
                tokens: Vec::new(),
                seconds: 0.0,
                windows: 1,
                segments: Vec::new(),
                choices: Vec::new(),
                abstained: None,
            },
            nearest: "a person stands".into(),
            rouge_l: 1.0,
            classified_as: classified_as.map(Into::into),
        }
    }
}
