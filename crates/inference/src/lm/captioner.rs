//! The captioner: generates sentences from radar points.

use std::collections::BTreeSet;
use std::ops::{ControlFlow, RangeInclusive};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use radarllm_base::PointFrame;
use radarllm_engine::{Precision, Watch, search};
use radarllm_facts::{Facts, facts};
use serde::Serialize;

use super::card::Learned;
use super::consensus::WindowReadings;
use super::ensemble::{EncodedWindow, Ensemble, Member, Sentence, open_members};
use super::person_gate::{median_points, points_stay_together};
use super::questions::{NOT_STATED, YES, holds, holds_so_often};
use super::templates::Task;
use super::vocab::Vocab;
use super::windows::{Captions, Plan, Span, WindowCaption, Windows, time_s};
use super::{
    Allowed, GenerateOptions, Generated, InputError, Instruction, LmError, Source, Unlearned,
};
use crate::backend::{Backend, LoadBackend, load_engine};
use crate::evidence::Evidence;
use crate::prepare::{FRAME_RATE_HZ, PreparedClip};
use crate::tokenizer::{Encoded, FRAMES_PER_CODE, MAX_FRAMES};

/// The sentences of this many windows before and after a window are readings of it.
const N_NEAR: usize = 7;
/// The same for guesses about a long recording, whose windows lie further apart.
const N_NEAR_GUESSES: usize = 3;
/// Windows that begin more than this number of frames before or after a window are not near it.
const NEAR_FRAMES: usize = 600;

/// Windows that the networks read at once. More of them would only take more memory.
const BATCH_WINDOWS: usize = 16;

/// Sentences that each model of an ensemble draws for a window, to vote for what is stated.
pub const N_DRAWS: usize = 16;

/// The answer to a question of which the model says that it is not stated by such motions.
pub const NO_ANSWER: &str = "the radar tokens do not say";

/// The caption of a clip that shows no person.
pub const NO_PERSON: &str = "no person seen";

/// A radar tokenizer and a language model, or several pairs that describe together, loaded and ready for inference.
pub struct Captioner {
    ensemble: Ensemble,
}

/// Options for the description of a clip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DescribeOptions {
    /// Number of beams of a search for the most probable sentence; 1 is greedy. `None` is a vote of [`N_DRAWS`] sentences
    /// drawn from each model.
    pub beam: Option<usize>,
    /// Minimum number of points in the median frame of a window with a person. A window with fewer points shows no
    /// person, unless its few points are close together.
    pub min_median_points: usize,
    /// Clips with fewer frames are too short to describe.
    pub min_frames: usize,
    /// Whether the sentences are guesses about a board that the model did not learn. A long recording is then described in no
    /// more windows than show when somebody is there, by the first member of an ensemble alone.
    pub only_guesses: bool,
    /// Whether the sentences of the model are wanted where they are guesses, about boards that it did not learn. Without them the
    /// networks are not asked there: what is stated does not depend on guesses.
    pub guesses: bool,
    /// Whether sentences are weighed with what the points say by themselves ([`Captioner::with_evidence`]). Of boards that
    /// the networks did not learn, they say less than the language model.
    pub weighed: bool,
}

impl Default for DescribeOptions {
    fn default() -> Self {
        Self {
            beam: None,
            min_median_points: 8,
            min_frames: 8,
            only_guesses: false,
            guesses: true,
            weighed: true,
        }
    }
}

impl DescribeOptions {
    fn generate(&self) -> GenerateOptions {
        GenerateOptions {
            beam: self.beam.unwrap_or(1),
            allowed: Allowed::Text,
            ..Default::default()
        }
    }
}

/// Reasons why there is no caption.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Abstained {
    /// The recording is too short.
    TooFewFrames {
        /// Number of frames found.
        found: usize,
        /// Number of frames required.
        min: usize,
    },
    /// No window has enough points.
    TooFewPoints {
        /// Median number of points per frame in the best window.
        median: usize,
        /// Median required.
        min: usize,
    },
    /// The board tracks people, and tracked nobody.
    NobodyTracked,
}

impl std::fmt::Display for Abstained {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::TooFewFrames { found, min } => {
                write!(f, "{found} frames, at least {min} are needed")
            }
            Self::NobodyTracked => f.write_str("the board tracks nobody"),
            Self::TooFewPoints { median, min } => {
                write!(
                    f,
                    "{median} points in the median frame, at least {min} are needed, or fewer that stay together"
                )
            }
        }
    }
}

/// Result of the description of a clip.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Description {
    /// The sentence; exactly [`NO_PERSON`] when [`Self::abstained`] is set.
    pub caption: String,
    /// Mean of the confidences of the segments, weighted by their durations, 0..=1; 0 when abstained.
    pub confidence: f32,
    /// Radar tokens of all windows, one per 0.4 s.
    pub tokens: Vec<u32>,
    /// Length of the prepared clip, s.
    pub seconds: f32,
    /// Number of windows that were described.
    pub windows: usize,
    /// The sentences with their times, in order. Times without a person have no segment.
    pub segments: Vec<Segment>,
    /// Activities in order of their probability, where the caption was chosen among named activities.
    pub choices: Vec<Chosen>,
    /// Reason why there is no caption; `None` if there is one.
    pub abstained: Option<Abstained>,
}

/// An activity and its probability among the named ones.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Chosen {
    /// The activity as it was named.
    pub activity: String,
    /// Probability among the named activities, 0..=1.
    pub probability: f32,
}

/// The answer to an instruction about a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// Task that was asked for.
    pub task: Task,
    /// Answers in order of time.
    pub parts: Vec<AnswerPart>,
}

/// The answer about a window of a clip.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AnswerPart {
    /// Start on the clock of the recording's frames, s.
    pub start_s: f64,
    /// End, s.
    pub end_s: f64,
    /// The answer in words, [`NO_PERSON`] if the window shows none; empty if the answer is in radar codes.
    pub text: String,
    /// Radar codes of a continuation, one per 0.4 s.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub codes: Vec<u32>,
    /// exp(mean token log-probability), 0..=1.
    pub confidence: f32,
}

/// A part of a recording that one sentence describes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Segment {
    /// Start on the clock of the recording's frames, s.
    pub start_s: f64,
    /// End, s.
    pub end_s: f64,
    /// The sentence.
    pub caption: String,
    /// Names of the actions that the sentence states, in order; see [`radarllm_facts::parse()`].
    pub actions: Vec<&'static str>,
    /// How certain the model is, 0..=1. For one window: the share of the drawn sentences that state these actions, or
    /// exp(mean token log-probability) of a sentence that was searched for. For more: the probability of these actions
    /// among the readings of the windows, averaged over windows.
    pub confidence: f32,
    /// Probability of the stated sides among the sides of the drawn sentences that state these actions, 0..=1. `None` if
    /// the sentence states no side, is about more than one window or was not drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub side_confidence: Option<f32>,
    /// Name of the taught activity that was recognised; `None` for a sentence of the model.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub taught: Option<String>,
    /// The sentence of the model, where it was too uncertain to be the caption.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guess: Option<String>,
}

impl Captioner {
    /// Loads the model in a folder, with all members of an ensemble, for the inference engine; see [`open_members`].
    ///
    /// With [`Precision::Int8`] the weights of the language model are quantized to bytes. This is faster for large
    /// models and occasionally changes a word. The radar tokenizer is always computed in f32.
    ///
    /// # Errors
    /// If either is missing or damaged, or they do not belong together; [`LmError::NotT5`] if a language model has another
    /// architecture.
    pub fn load(dir: &Path, precision: Precision) -> Result<Self, LmError> {
        Self::from_members(open_members(dir)?, precision, load_engine)
    }

    /// Loads the networks of every member on a backend, which [`load_engine`] or `radarllm-nn` creates. The members
    /// describe together.
    ///
    /// # Errors
    /// Those of [`Self::load`]; [`LmError::Config`] without a member.
    pub fn from_members(
        members: impl IntoIterator<Item = Member>,
        precision: Precision,
        load: LoadBackend,
    ) -> Result<Self, LmError> {
        let mut backends = members.into_iter().map(|member| load(member, precision));
        let none = || LmError::Config {
            field: "members",
            problem: "none".into(),
        };
        let first = Self::new(backends.next().ok_or_else(none)??);
        backends.try_fold(first, |all, backend| Ok(all.join(Self::new(backend?))))
    }

    /// Creates a captioner on any backend.
    pub fn new(backend: Box<dyn Backend>) -> Self {
        Self {
            ensemble: Ensemble::new(backend),
        }
    }

    /// An ensemble of the members of both captioners: the sentences are those that all members together find most
    /// probable. The radar tokens are those of the first member.
    #[must_use]
    pub fn join(mut self, other: Self) -> Self {
        self.ensemble.join(other.ensemble);
        self
    }

    /// The same captioner with its sentences weighed by what the points say by themselves.
    #[must_use]
    pub fn with_evidence(mut self, evidence: Evidence) -> Self {
        self.ensemble = self.ensemble.with_evidence(evidence);
        self
    }

    /// Number of weights of all networks.
    pub fn n_params(&self) -> usize {
        self.ensemble.n_params()
    }

    /// Ids of words.
    pub fn vocab(&self) -> &Vocab {
        self.ensemble.first().vocab()
    }

    /// Describes a clip of any length.
    ///
    /// A clip of at most 96 frames is described as a whole. A longer one is described in overlapping windows, whose sentences vote
    /// for what is stated about each 2 s; its caption summarises the segments. A clip of more than two minutes is described in
    /// few windows where all of them say the same.
    ///
    /// # Errors
    /// What the networks refuse.
    pub fn describe(
        &self,
        clip: &PreparedClip,
        options: &DescribeOptions,
    ) -> Result<Description, LmError> {
        let windows = Windows::of(clip, options);
        search::unwatched(|watch| self.described(&windows, options, watch))
    }

    /// Describes the windows of a clip, and combines their captions.
    fn described(
        &self,
        windows: &Windows,
        options: &DescribeOptions,
        watch: &mut Watch,
    ) -> Result<Description, LmError> {
        if windows.is_whole() {
            let results = self.caption_windows(windows, windows.spans(), options, watch)?;
            return Ok(windows.describe(results, &[]));
        }
        let n_near = match windows.is_guessed(options) {
            true => N_NEAR_GUESSES,
            false => N_NEAR,
        };
        let mut captions = Captions::default();
        let mut plan = Plan::new(windows, options);
        while let Some(spans) = plan.next(&captions.all) {
            for spans in spans.chunks(BATCH_WINDOWS) {
                captions.add(self.caption_windows(windows, spans, options, watch)?);
            }
            self.read(&mut captions, n_near, plan.complete_before())?;
        }
        self.read(&mut captions, n_near, usize::MAX)?;
        Ok(windows.describe(captions.all, &captions.readings))
    }

    /// Adds the readings of the windows that begin long enough before `complete_before` that all windows near them are
    /// described: its sentence, and the clauses of all sentences of the `n_near` windows on either side, with the probabilities
    /// that the model gives them. What the networks read of these windows is not needed any more.
    fn read(
        &self,
        captions: &mut Captions,
        n_near: usize,
        complete_before: usize,
    ) -> Result<(), LmError> {
        let Captions {
            all,
            readings,
            sentences,
        } = captions;
        let is_ready = |w: &WindowCaption| w.span.0.saturating_add(NEAR_FRAMES) < complete_before;
        let n_ready = all.partition_point(is_ready);
        for i in readings.len()..n_ready {
            let near = i.saturating_sub(n_near)..(i + n_near + 1).min(all.len());
            let is_near = |w: &&WindowCaption| w.span.0.abs_diff(all[i].span.0) <= NEAR_FRAMES;
            let clauses = all[near].iter().filter(is_near).flat_map(|w| &w.clauses);
            let own = &all[i].sentence.text;
            let texts: BTreeSet<&String> = clauses.chain([own]).collect();
            let texts: Vec<&String> = texts.into_iter().collect();
            let probabilities = self.ensemble.probabilities(&all[i].radar, &texts)?;
            let of_window = texts.iter().zip(probabilities);
            readings.push(WindowReadings {
                start: all[i].span.0,
                end: all[i].span.1,
                readings: of_window
                    .map(|(text, p)| sentences.reading(text, p))
                    .collect(),
            });
            all[i].radar = EncodedWindow::default();
        }
        Ok(())
    }

    /// Describes many clips in one batch, which is faster than one by one. Clips are independent of one another.
    ///
    /// # Errors
    /// Those of [`Self::describe`].
    pub fn describe_batch(
        &self,
        clips: &[&PreparedClip],
        options: &DescribeOptions,
    ) -> Result<Vec<Description>, LmError> {
        let all: Vec<Windows> = clips.iter().map(|c| Windows::of(c, options)).collect();
        let whole = || all.iter().filter(|windows| windows.is_whole());
        let usable: Vec<_> = whole()
            .flat_map(|windows| windows.frames_of(windows.spans()))
            .collect();
        search::unwatched(|watch| {
            let mut results = Vec::with_capacity(usable.len());
            for batch in usable.chunks(BATCH_WINDOWS) {
                results.extend(self.caption_frames(batch, Effort::full(), options, watch)?);
            }
            let mut results = results.into_iter();
            let mut describe = |windows: &Windows| match windows.is_whole() {
                true => {
                    let spans = windows.spans().iter().zip(results.by_ref());
                    let own = spans.map(|(span, (radar, sentence))| {
                        WindowCaption::new(*span, radar, sentence)
                    });
                    Ok(windows.describe(own.collect(), &[]))
                }
                false => self.described(windows, options, watch),
            };
            all.iter().map(&mut describe).collect()
        })
    }

    /// Returns the radar tokens of all windows of a clip, one per 0.4 s. Windows without a person have tokens too.
    ///
    /// # Errors
    /// Those of [`Self::describe`].
    pub fn tokenize(&self, clip: &PreparedClip) -> Result<Vec<u32>, LmError> {
        let windows: Vec<_> = equal_windows(&clip.frames)
            .map(|window| (window, clip.radar_height_m))
            .collect();
        let encoded = self.ensemble.first().encode(&windows)?;
        Ok(encoded.into_iter().flat_map(|e| e.codes).collect())
    }

    /// Describes a clip, and calls `on_text` with each piece of the caption as soon as it is decoded. The caption is
    /// the concatenation of the pieces. A clip without a person gives one piece, [`NO_PERSON`]. A recording of more than
    /// one window gives one piece, because later windows change the sentences about earlier ones. Only the greedy
    /// search of a single model gives the caption of a window in pieces.
    ///
    /// Returns `None` if `on_text` breaks.
    ///
    /// # Errors
    /// Those of [`Self::describe`].
    pub fn describe_streaming(
        &self,
        clip: &PreparedClip,
        options: &DescribeOptions,
        mut on_text: impl FnMut(&str) -> ControlFlow<()>,
    ) -> Result<Option<Description>, LmError> {
        let windows = Windows::of(clip, options);
        let mut sent = String::new();
        let cancel = AtomicBool::new(false);
        let mut send = |upto: &str, sent: &mut String| {
            // Only text that is final is reported: the next token may change the last word.
            if let Some(piece) = upto.strip_prefix(sent.as_str())
                && !piece.is_empty()
                && !cancel.load(Ordering::Relaxed)
            {
                if on_text(piece).is_break() {
                    cancel.store(true, Ordering::Relaxed);
                }
                sent.push_str(piece);
            }
        };
        let mut ids = Vec::new();
        let described = {
            let mut watch = Watch {
                on_token: &mut |_, id| {
                    if windows.is_whole() {
                        ids.push(id);
                        let text = self.vocab().text(&ids);
                        send(without_last_word(&text), &mut sent);
                    }
                },
                cancel: &cancel,
            };
            self.described(&windows, options, &mut watch)
        };
        let description = match described {
            Err(e) if e.is_cancelled() => return Ok(None),
            described => described?,
        };
        send(&description.caption, &mut sent);
        Ok((!cancel.load(Ordering::Relaxed)).then_some(description))
    }

    /// What the language model was trained to do, if its files say so; of an ensemble, the first member.
    pub fn learned(&self) -> Option<&Learned> {
        self.ensemble.first().learned()
    }

    /// Checks that the model was trained on a task; with `tuned`, in the words of all templates.
    ///
    /// # Errors
    /// [`LmError::NotLearned`].
    pub fn require(&self, task: Task, tuned: bool) -> Result<(), LmError> {
        let why = match self.learned() {
            None => Unlearned::NoRecord,
            Some(learned) if !learned.knows(task) => Unlearned::Never,
            Some(learned) if tuned && !learned.tuned.contains(&task) => Unlearned::NotTuned,
            Some(_) => return Ok(()),
        };
        Err(LmError::NotLearned { task, tuned, why })
    }

    /// Follows an instruction about a clip. A clip longer than [`MAX_FRAMES`] has one answer for each of its windows,
    /// which have about equal lengths. Of an ensemble, the first member answers, except for descriptions and for questions
    /// that the sentence of all members answers better.
    ///
    /// # Errors
    /// Those of [`Self::describe`]; [`LmError::NotLearned`] if the model was not tuned for the task.
    pub fn answer(
        &self,
        clip: &PreparedClip,
        instruction: &Instruction,
        options: &DescribeOptions,
    ) -> Result<Answer, LmError> {
        let task = instruction.task();
        self.require(task, !instruction.is_of_pretraining())?;
        let model = self.ensemble.first();
        let has_person = |window: &[PointFrame]| {
            window.len() >= options.min_frames.max(1)
                && (median_points(window) >= options.min_median_points
                    || points_stay_together(window))
        };
        let windows: Vec<&[PointFrame]> = equal_windows(&clip.frames).collect();
        let seen: Vec<(&[PointFrame], f32)> = windows
            .iter()
            .filter(|window| has_person(window))
            .map(|window| (*window, clip.radar_height_m))
            .collect();
        let is_of_all_members = match instruction.question() {
            Some(question) => question.is_of_all_members(),
            // In the user's own words, a request reaches the first member.
            None => task == Task::RadarToText && instruction.prompt() == instruction.nearest(),
        };
        let answers = match (task, instruction.claim()) {
            (_, Some(claim)) => self.checked(&seen, claim, instruction.counts(), options)?,
            (Task::RadarToLength, _) => lengths(&model.encode(&seen)?),
            _ if !self.ensemble.is_single() && is_of_all_members => {
                self.stated_or_generated(&seen, instruction, options)?
            }
            _ => self.generated_answers(&seen, instruction, options)?,
        };
        let mut answers = answers.into_iter();
        let (mut parts, mut start) = (Vec::with_capacity(windows.len()), 0);
        for window in windows {
            let end = start + window.len();
            let answer = match has_person(window) {
                true => answers.next().unwrap_or_default(),
                false => OwnAnswer {
                    text: NO_PERSON.into(),
                    ..OwnAnswer::default()
                },
            };
            parts.push(AnswerPart {
                start_s: time_s(clip, start),
                end_s: time_s(clip, end),
                text: answer.text,
                codes: answer.codes,
                confidence: answer.confidence,
            });
            start = end;
        }
        Ok(Answer { task, parts })
    }

    /// The sentences that all members together say about windows.
    fn said(
        &self,
        windows: &[(&[PointFrame], f32)],
        options: &DescribeOptions,
    ) -> Result<Vec<Sentence>, LmError> {
        let described = search::unwatched(|watch| {
            self.caption_frames(windows, Effort::full(), options, watch)
        })?;
        Ok(described
            .into_iter()
            .map(|(_, sentence)| sentence)
            .collect())
    }

    /// The sentences of all members about windows, or what they answer to a question; where a sentence has no answer, what
    /// the first member generates.
    fn stated_or_generated(
        &self,
        windows: &[(&[PointFrame], f32)],
        instruction: &Instruction,
        options: &DescribeOptions,
    ) -> Result<Vec<OwnAnswer>, LmError> {
        let stated = |sentence: Sentence| {
            let text = match instruction.question() {
                Some(question) => question.answer([sentence.text.as_str()])?,
                None => sentence.text,
            };
            Some(OwnAnswer {
                text,
                confidence: sentence.confidence * sentence.side_confidence.unwrap_or(1.0),
                ..OwnAnswer::default()
            })
        };
        let sentences = self.said(windows, options)?.into_iter();
        let stated: Vec<Option<OwnAnswer>> = sentences.map(stated).collect();
        let open = windows.iter().zip(&stated).filter(|(_, s)| s.is_none());
        let open: Vec<_> = open.map(|(window, _)| *window).collect();
        let mut generated = self
            .generated_answers(&open, instruction, options)?
            .into_iter();
        let answers = stated.into_iter();
        Ok(answers
            .map(|answer| answer.or_else(|| generated.next()).unwrap_or_default())
            .collect())
    }

    /// What the first member generates for an instruction about windows.
    fn generated_answers(
        &self,
        windows: &[(&[PointFrame], f32)],
        instruction: &Instruction,
        options: &DescribeOptions,
    ) -> Result<Vec<OwnAnswer>, LmError> {
        let model = self.ensemble.first();
        let vocab = model.vocab();
        let encoded = model.encode(windows)?;
        let prompts = encoded
            .iter()
            .map(|radar| vocab.prompt(instruction.prompt(), Some(radar), None));
        let prompts = prompts.collect::<Result<Vec<Source>, _>>()?;
        let generating = GenerateOptions {
            allowed: match instruction.task() {
                Task::Continuation => Allowed::Radar,
                _ => Allowed::Text,
            },
            ..options.generate()
        };
        let generated = search::unwatched(|watch| model.generate(&prompts, &generating, watch))?;
        let asks = instruction.question().is_some();
        let answer = |generated: Generated| {
            let text = vocab.text(&generated.ids);
            OwnAnswer {
                text: match asks && text == NOT_STATED {
                    true => NO_ANSWER.into(),
                    false => text,
                },
                codes: codes_of(vocab, &generated.ids),
                confidence: generated.confidence,
            }
        };
        Ok(generated.into_iter().map(answer).collect())
    }

    /// Whether a claim holds of windows, and as often as it is asked for, by the sentences that the model says about them.
    fn checked(
        &self,
        windows: &[(&[PointFrame], f32)],
        claim: &Facts,
        counts: Option<&RangeInclusive<u16>>,
        options: &DescribeOptions,
    ) -> Result<Vec<OwnAnswer>, LmError> {
        let is_so = |motion: Facts| match counts {
            Some(counts) => holds_so_often(claim, &motion, counts),
            None => holds(claim, &[motion]),
        };
        let answer = |sentence: Sentence| OwnAnswer {
            text: match is_so(facts(&sentence.text)) {
                Some(true) => YES.into(),
                Some(false) => NOT_STATED.into(),
                None => NO_ANSWER.into(),
            },
            confidence: sentence.confidence,
            ..OwnAnswer::default()
        };
        Ok(self
            .said(windows, options)?
            .into_iter()
            .map(answer)
            .collect())
    }

    /// Generates the radar codes of sentences: what a radar would see if they were true, one code per 0.4 s. The codes
    /// belong to the tokenizer of the first member of an ensemble. A sentence for which the model ends at once has none.
    ///
    /// # Errors
    /// [`LmError::NotLearned`] if the model was not trained to do so; [`InputError::Sentence`] if a sentence has no word.
    pub fn codes_of_sentences(
        &self,
        sentences: &[&str],
        beam: usize,
    ) -> Result<Vec<Vec<u32>>, LmError> {
        self.require(Task::TextToRadar, false)?;
        let vocab = self.vocab();
        let mut prompts = Vec::with_capacity(sentences.len());
        for (index, sentence) in sentences.iter().enumerate() {
            if !sentence.chars().any(char::is_alphanumeric) {
                let problem = "it has no words".into();
                return Err(InputError::Sentence { index, problem }.into());
            }
            let template = Task::TextToRadar.prompts()[0];
            prompts.push(vocab.prompt(template, None, Some(sentence))?);
        }
        let options = GenerateOptions {
            // The codes of the longest window, and the end token.
            max_new_tokens: MAX_FRAMES / FRAMES_PER_CODE + 1,
            beam,
            allowed: Allowed::Radar,
            ..Default::default()
        };
        let model = self.ensemble.first();
        let generated = search::unwatched(|watch| model.generate(&prompts, &options, watch))?;
        let of = |generated: Generated| {
            let mut codes = codes_of(vocab, &generated.ids);
            codes.truncate(MAX_FRAMES / FRAMES_PER_CODE);
            codes
        };
        Ok(generated.into_iter().map(of).collect())
    }

    /// Log-probability of each text, averaged over the members of an ensemble, for each window of a clip that may show a person, in the windows of
    /// [`Self::describe`]: `[windows][texts]`.
    ///
    /// # Errors
    /// Those of [`Self::describe`], and texts with words that the model does not know.
    pub fn score_texts(
        &self,
        clip: &PreparedClip,
        texts: &[String],
        options: &DescribeOptions,
    ) -> Result<Vec<Vec<f32>>, LmError> {
        let windows = Windows::of(clip, options);
        let mut all = Vec::with_capacity(windows.spans().len());
        for spans in windows.spans().chunks(BATCH_WINDOWS) {
            for radar in self.ensemble.encode(&windows.frames_of(spans))? {
                all.push(self.ensemble.mean_log_probs(&radar, texts)?);
            }
        }
        Ok(all)
    }

    /// Describes windows of a clip.
    fn caption_windows(
        &self,
        windows: &Windows,
        spans: &[Span],
        options: &DescribeOptions,
        watch: &mut Watch,
    ) -> Result<Vec<WindowCaption>, LmError> {
        let effort = match windows.is_guessed(options) {
            true => Effort {
                n_draws: N_DRAWS / 2,
                n_members: 1,
            },
            false => Effort::full(),
        };
        let captions = self.caption_frames(&windows.frames_of(spans), effort, options, watch)?;
        let captions = spans.iter().zip(captions);
        Ok(captions
            .map(|(span, (radar, sentence))| WindowCaption::new(*span, radar, sentence))
            .collect())
    }

    /// The codes of each window by each member, and its sentence.
    fn caption_frames(
        &self,
        windows: &[(&[PointFrame], f32)],
        effort: Effort,
        options: &DescribeOptions,
        watch: &mut Watch,
    ) -> Result<Vec<(EncodedWindow, Sentence)>, LmError> {
        let encoded = self
            .ensemble
            .encode_by(windows, effort.n_members, options.weighed)?;
        let (ensemble, generating) = (&self.ensemble, options.generate());
        let sentences = match options.beam {
            Some(_) => ensemble.sentences(&encoded, &generating, watch)?,
            None => ensemble.voted(&encoded, effort.n_draws, &generating, watch.cancel)?,
        };
        Ok(encoded.into_iter().zip(sentences).collect())
    }
}

/// How much is computed for the sentence of a window.
#[derive(Clone, Copy)]
struct Effort {
    n_draws: usize,
    n_members: usize,
}

impl Effort {
    fn full() -> Self {
        Self {
            n_draws: N_DRAWS,
            n_members: usize::MAX,
        }
    }
}

/// The answer about a window.
#[derive(Default)]
struct OwnAnswer {
    text: String,
    codes: Vec<u32>,
    confidence: f32,
}

/// Lengths of windows: every radar token stands for as many frames.
fn lengths(encoded: &[Encoded]) -> Vec<OwnAnswer> {
    let length_s = |radar: &Encoded| (radar.codes.len() * FRAMES_PER_CODE) as f32 / FRAME_RATE_HZ;
    let answer = |radar: &Encoded| OwnAnswer {
        text: format!("{:.1} seconds", length_s(radar)),
        confidence: 1.0,
        ..OwnAnswer::default()
    };
    encoded.iter().map(answer).collect()
}

/// The radar codes among token ids.
fn codes_of(vocab: &Vocab, ids: &[u32]) -> Vec<u32> {
    let layout = vocab.layout();
    ids.iter().filter_map(|id| layout.code_of(*id)).collect()
}

/// Returns the text of unfinished tokens without its last word, which may still grow.
fn without_last_word(text: &str) -> &str {
    text.rsplit_once(' ').map_or("", |(before, _)| before)
}

impl Description {
    /// Sets the segments, which must be in order of time; caption and confidence follow from them.
    pub fn set_segments(&mut self, segments: Vec<Segment>) {
        let length_s = |s: &Segment| (s.end_s - s.start_s) as f32;
        let total_s: f32 = segments.iter().map(length_s).sum();
        let weighted = segments.iter().map(|s| s.confidence * length_s(s));
        // The sum of nothing is -0.
        self.confidence = (weighted.sum::<f32>() + 0.0) / total_s.max(f32::MIN_POSITIVE);
        if !segments.is_empty() {
            self.caption = summary(&segments);
            self.abstained = None;
        }
        self.segments = segments;
    }
}

/// Names of the actions that a sentence states, in order.
pub fn actions(text: &str) -> Vec<&'static str> {
    let clauses = radarllm_facts::parse(text);
    clauses
        .iter()
        .flat_map(|c| &c.actions)
        .map(|a| a.name)
        .collect()
}

/// Number of segments that a summary names.
const N_SUMMARY: usize = 4;
/// Name of the action of somebody who falls.
const FALL: &str = "fall";

/// One sentence about several segments: the longest ones, in order of time, falls before all others.
fn summary(segments: &[Segment]) -> String {
    let by_length =
        |a: &&Segment, b: &&Segment| (b.end_s - b.start_s).total_cmp(&(a.end_s - a.start_s));
    let states_a_fall = |s: &&Segment| s.actions.contains(&FALL);
    let (mut kept, mut others): (Vec<&Segment>, Vec<&Segment>) =
        segments.iter().partition(states_a_fall);
    kept.sort_by(by_length);
    others.sort_by(by_length);
    // Something else remains beside many falls.
    kept.truncate(N_SUMMARY - usize::from(!others.is_empty()));
    others.truncate(N_SUMMARY - kept.len());
    kept.extend(others);
    kept.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    kept.dedup_by(|a, b| a.caption == b.caption);
    let mut text = String::new();
    for segment in kept {
        let caption = segment.caption.as_str();
        if text.is_empty() {
            text.push_str(caption);
        } else {
            text.push_str(", then ");
            text.push_str(caption.strip_prefix("a person ").unwrap_or(caption));
        }
    }
    text
}

/// Cuts frames into the smallest number of windows of at most [`MAX_FRAMES`]. All windows have about equal lengths, and
/// all except the last contain whole codes. A short final window would contain too little data for a description.
fn equal_windows(frames: &[PointFrame]) -> impl Iterator<Item = &[PointFrame]> {
    let n_windows = frames.len().div_ceil(MAX_FRAMES).max(1);
    let n_codes = frames.len().div_ceil(FRAMES_PER_CODE);
    let length = n_codes.div_ceil(n_windows).max(1) * FRAMES_PER_CODE;
    frames.chunks(length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_summary_of_many_segments_names_falls_before_longer_ones() {
        let segment = |start_s: f64, end_s: f64, caption: &str| Segment {
            start_s,
            end_s,
            caption: caption.into(),
            actions: actions(caption),
            confidence: 0.5,
            side_confidence: None,
            taught: None,
            guess: None,
        };
        let walks = |i: u32| {
            segment(
                f64::from(i) * 10.0,
                f64::from(i) * 10.0 + 9.0,
                &format!("a person walks {i} m away"),
            )
        };
        let mut segments: Vec<Segment> = (0..6).map(walks).collect();
        segments.insert(3, segment(29.0, 30.0, "a person falls 1.0 m away"));
        let text = summary(&segments);
        assert!(text.contains("falls 1.0 m away"), "{text}");
        assert_eq!(text.matches(", then ").count(), 3, "{text}");
        for i in 0..5 {
            let start_s = 100.0 + f64::from(i);
            segments.push(segment(
                start_s,
                start_s + 1.0,
                &format!("a person falls 2.{i} m away"),
            ));
        }
        let text = summary(&segments);
        assert_eq!(text.matches("falls").count(), 3, "{text}");
        assert!(text.contains("walks"), "{text}");
    }

    #[test]
    fn windows_are_equal_whole_and_complete() {
        for n in [1, 8, 95, 96, 97, 100, 192, 193, 1000] {
            let frames: Vec<PointFrame> = (0..n)
                .map(|i| PointFrame {
                    frame: i,
                    ..Default::default()
                })
                .collect();
            let windows: Vec<_> = equal_windows(&frames).collect();
            assert_eq!(windows.concat(), frames, "{n}");
            assert!(windows.iter().all(|w| w.len() <= MAX_FRAMES), "{n}");
            assert_eq!(windows.len(), (n as usize).div_ceil(MAX_FRAMES), "{n}");
            let shortest = windows.iter().map(|w| w.len()).min().unwrap();
            assert!(
                windows.len() == 1 || shortest >= MAX_FRAMES / 3,
                "{n}: {shortest}"
            );
        }
    }
}
