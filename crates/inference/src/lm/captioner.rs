//! The captioner: generates sentences from radar points.

use std::borrow::Cow;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use radarllm_base::{Clip, PointFrame};
use radarllm_engine::{Precision, Source, Watch, search};
use serde::Serialize;

use super::card::LmFiles;
use super::engine_lm::EngineLm;
use super::person_gate::{median_points, points_stay_together};
use super::templates::EVALUATION_PROMPT;
use super::vocab::Vocab;
use super::{Allowed, GenerateOptions, Generated, LmError};
use crate::backend::{Backend, EngineBackend};
use crate::checkpoint::Checkpoint;
use crate::prepare::{FRAME_RATE_HZ, prepared};
use crate::tokenizer::{Encoded, FRAMES_PER_CODE, MAX_FRAMES, RadarTokenizer};

/// The caption of a clip that shows no person.
pub const NO_PERSON: &str = "no person seen";

/// A radar tokenizer and a language model, loaded and ready for inference.
pub struct Captioner {
    backend: Box<dyn Backend>,
}

/// Options for the description of a clip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DescribeOptions {
    /// Number of beams of the search; 1 is greedy.
    pub beam: usize,
    /// Minimum number of points in the median frame of a window with a person. A window with fewer points shows no
    /// person, unless its few points are close together.
    pub min_median_points: usize,
    /// Clips with fewer frames are too short to describe.
    pub min_frames: usize,
}

impl Default for DescribeOptions {
    fn default() -> Self {
        Self {
            beam: 1,
            min_median_points: 8,
            min_frames: 8,
        }
    }
}

impl DescribeOptions {
    fn generate(&self) -> GenerateOptions {
        GenerateOptions {
            beam: self.beam,
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
}

impl std::fmt::Display for Abstained {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::TooFewFrames { found, min } => {
                write!(f, "{found} frames, at least {min} are needed")
            }
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
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// The sentence; exactly [`NO_PERSON`] when [`Self::abstained`] is set.
    pub caption: String,
    /// exp(mean token log-probability) over all windows, 0..=1; 0 when abstained.
    pub confidence: f32,
    /// Radar tokens of all windows, one per 0.4 s.
    pub tokens: Vec<u32>,
    /// Length of the prepared clip, s.
    pub seconds: f32,
    /// Number of windows that were described.
    pub windows: usize,
    /// The sentences with their times, in order. Times without a person have no segment.
    pub segments: Vec<Segment>,
    /// Reason why there is no caption; `None` if there is one.
    pub abstained: Option<Abstained>,
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
    /// exp(mean token log-probability) of the sentence, 0..=1.
    pub confidence: f32,
}

impl Captioner {
    /// Loads `dir/tokenizer` and `dir/lm` for the inference engine.
    ///
    /// With [`Precision::Int8`] the weights of the language model are quantized to bytes. This is faster for large
    /// models and occasionally changes a word. The radar tokenizer is always computed in f32.
    ///
    /// # Errors
    /// If either is missing or damaged, or they do not belong together.
    pub fn load(dir: &Path, precision: Precision) -> Result<Self, LmError> {
        let open = |part: &str| Checkpoint::open(&dir.join(part));
        Self::from_checkpoints(&open("tokenizer")?, open("lm")?, precision)
    }

    /// Packs the networks of two checkpoints for the inference engine.
    ///
    /// # Errors
    /// Those of [`Self::load`]; [`LmError::NotT5`] if the language model has another architecture.
    pub fn from_checkpoints(
        tokenizer: &Checkpoint,
        lm: Checkpoint,
        precision: Precision,
    ) -> Result<Self, LmError> {
        let lm = LmFiles::of(lm)?;
        let tokenizer = RadarTokenizer::from_checkpoint(tokenizer)?;
        let backend = EngineBackend::new(tokenizer, EngineLm::from_files(lm, precision)?)?;
        Ok(Self::new(Box::new(backend)))
    }

    /// Creates a captioner on any backend.
    pub fn new(backend: Box<dyn Backend>) -> Self {
        Self { backend }
    }

    /// Number of weights of both networks.
    pub fn n_params(&self) -> usize {
        self.backend.n_params()
    }

    /// Ids of words.
    pub fn vocab(&self) -> &Vocab {
        self.backend.vocab()
    }

    /// Describes a clip of any length.
    ///
    /// The clip is prepared as in [`crate::prepare_for_model`], and copied only if a change is necessary. Long clips
    /// are cut into equal windows of at most 96 frames. Captions of successive windows are joined with ", then " where
    /// they differ.
    ///
    /// # Errors
    /// [`LmError::Clip`] for values that are not finite and impossible frame rates.
    pub fn describe(&self, clip: &Clip, options: &DescribeOptions) -> Result<Description, LmError> {
        search::unwatched(|watch| self.describe_watched(clip, options, watch))
    }

    fn describe_watched(
        &self,
        clip: &Clip,
        options: &DescribeOptions,
        watch: &mut Watch,
    ) -> Result<Description, LmError> {
        let clip = prepared(clip)?;
        let mut windows = Windows::of(&clip, options);
        let results = self.caption_windows(&windows.usable, options, watch)?;
        for (result, (frames, _)) in results.iter().zip(&windows.usable) {
            windows.description.add(frames, result);
        }
        Ok(windows.description.finish())
    }

    /// Describes many clips in one batch, which is faster than one by one. Clips are independent of one another.
    ///
    /// # Errors
    /// Those of [`Self::describe`].
    pub fn describe_batch(
        &self,
        clips: &[&Clip],
        options: &DescribeOptions,
    ) -> Result<Vec<Description>, LmError> {
        let clips = clips.iter().map(|clip| prepared(clip));
        let clips = clips.collect::<Result<Vec<Cow<Clip>>, _>>()?;
        let mut all: Vec<Windows> = clips.iter().map(|c| Windows::of(c, options)).collect();
        let (mut owners, mut windows) = (Vec::new(), Vec::new());
        for (owner, of_clip) in all.iter().enumerate() {
            owners.extend(std::iter::repeat_n(owner, of_clip.usable.len()));
            windows.extend(&of_clip.usable);
        }
        let results = search::unwatched(|watch| self.caption_windows(&windows, options, watch))?;
        for ((owner, (frames, _)), result) in owners.into_iter().zip(windows).zip(&results) {
            all[owner].description.add(frames, result);
        }
        Ok(all.into_iter().map(|w| w.description.finish()).collect())
    }

    /// Returns the radar tokens of all windows of a clip, one per 0.4 s. The clip is prepared as in [`Self::describe`],
    /// but windows without a person have tokens too.
    ///
    /// # Errors
    /// Those of [`Self::describe`].
    pub fn tokenize(&self, clip: &Clip) -> Result<Vec<u32>, LmError> {
        let clip = prepared(clip)?;
        let windows: Vec<_> = equal_windows(&clip.frames)
            .map(|window| (window, clip.radar_height_m))
            .collect();
        let encoded = self.backend.encode(&windows)?;
        Ok(encoded.into_iter().flat_map(|e| e.codes).collect())
    }

    /// Describes a clip, and calls `on_text` with each piece of the caption as soon as it is decoded. The caption is
    /// the concatenation of the pieces. A clip without a person gives one piece, [`NO_PERSON`]. With more than one
    /// beam, the caption of a window is one piece.
    ///
    /// Returns `None` if `on_text` breaks.
    ///
    /// # Errors
    /// Those of [`Self::describe`].
    pub fn describe_streaming(
        &self,
        clip: &Clip,
        options: &DescribeOptions,
        mut on_text: impl FnMut(&str) -> ControlFlow<()>,
    ) -> Result<Option<Description>, LmError> {
        let clip = prepared(clip)?;
        let Windows {
            usable,
            mut description,
        } = Windows::of(&clip, options);
        if description.0.abstained.is_some() {
            let description = description.finish();
            let ended = on_text(&description.caption).is_break();
            return Ok((!ended).then_some(description));
        }
        let mut sent = String::new();
        let cancel = AtomicBool::new(false);
        let mut send = |upto: &str, sent: &mut String| {
            // Only text that is final is reported: the next window may remove the full stop.
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
        for window in usable {
            let mut ids = Vec::new();
            let results = {
                let mut watch = Watch {
                    on_token: &mut |_, id| {
                        // Later windows contribute only where they differ from the previous one, which is known at
                        // their end.
                        if description.0.windows == 0 {
                            ids.push(id);
                            let text = self.vocab().text(&ids);
                            send(without_last_word(&text), &mut sent);
                        }
                    },
                    cancel: &cancel,
                };
                self.caption_windows(&[window], options, &mut watch)
            };
            let results = match results {
                Err(e) if e.is_cancelled() => return Ok(None),
                results => results?,
            };
            for result in &results {
                description.add(window.0, result);
            }
            send(description.0.caption.trim_end_matches('.'), &mut sent);
            if cancel.load(Ordering::Relaxed) {
                return Ok(None);
            }
        }
        let description = description.finish();
        send(&description.caption, &mut sent);
        Ok((!cancel.load(Ordering::Relaxed)).then_some(description))
    }

    /// Describes each window.
    fn caption_windows(
        &self,
        windows: &[(&[PointFrame], f32)],
        options: &DescribeOptions,
        watch: &mut Watch,
    ) -> Result<Vec<WindowCaption>, LmError> {
        let vocab = self.backend.vocab();
        let encoded = self.backend.encode(windows)?;
        let prompts = encoded
            .iter()
            .map(|radar| vocab.prompt(EVALUATION_PROMPT, Some(radar), None))
            .collect::<Result<Vec<Source>, _>>()?;
        let generated = self
            .backend
            .generate(&prompts, &options.generate(), watch)?;
        Ok(encoded
            .into_iter()
            .zip(generated)
            .map(|(radar, generated)| {
                let text = vocab.text(&generated.ids);
                WindowCaption {
                    radar,
                    generated,
                    text,
                }
            })
            .collect())
    }
}

/// Returns the text of unfinished tokens without its last word, which may still grow, and without the part that a later
/// window may remove.
fn without_last_word(text: &str) -> &str {
    text.rsplit_once(' ').map_or("", |(before, _)| before)
}

/// The windows of a clip that may show a person, each with the height of its radar, and the current description.
struct Windows<'a> {
    usable: Vec<(&'a [PointFrame], f32)>,
    description: Growing,
}

impl<'a> Windows<'a> {
    /// Cuts a prepared clip.
    fn of(clip: &'a Clip, options: &DescribeOptions) -> Self {
        let (usable, abstained) = usable_windows(&clip.frames, options);
        let usable = usable.into_iter().map(|w| (w, clip.radar_height_m));
        Self {
            usable: usable.collect(),
            description: Growing::new(clip.frames.len(), abstained),
        }
    }
}

/// What the networks made of one window.
struct WindowCaption {
    radar: Encoded,
    generated: Generated,
    text: String,
}

/// A description that is extended window by window.
struct Growing(Description, Sums);

/// Of the windows so far: the last text, the sum of log-probabilities, the tokens that it counts.
#[derive(Default)]
struct Sums {
    last_text: String,
    log_prob: f32,
    n_tokens: usize,
}

impl Growing {
    fn new(n_frames: usize, abstained: Option<Abstained>) -> Self {
        let description = Description {
            caption: match abstained {
                Some(_) => NO_PERSON.into(),
                None => String::new(),
            },
            confidence: 0.0,
            tokens: Vec::new(),
            seconds: n_frames as f32 / FRAME_RATE_HZ,
            windows: 0,
            segments: Vec::new(),
            abstained,
        };
        Self(description, Sums::default())
    }

    /// Adds the next window.
    fn add(&mut self, frames: &[PointFrame], result: &WindowCaption) {
        let Self(description, sums) = self;
        let (generated, text) = (&result.generated, result.text.as_str());
        description.tokens.extend(&result.radar.codes);
        description.windows += 1;
        let n_tokens = generated.ids.len() + 1;
        sums.log_prob += generated.log_prob;
        sums.n_tokens += n_tokens;
        description.confidence = probability(sums.log_prob, sums.n_tokens);
        description.add_segment(frames, text, probability(generated.log_prob, n_tokens));
        if text == sums.last_text || text.is_empty() {
            return;
        }
        if !description.caption.is_empty() {
            // "walks., then turns." would read badly.
            let len = description.caption.trim_end_matches('.').len();
            description.caption.truncate(len);
            description.caption.push_str(", then ");
        }
        description.caption.push_str(text);
        sums.last_text = text.into();
    }

    fn finish(self) -> Description {
        self.0
    }
}

impl Description {
    /// Adds the sentence of a window; a sentence that is repeated without a gap extends the segment before.
    fn add_segment(&mut self, frames: &[PointFrame], text: &str, confidence: f32) {
        let (Some(first), Some(last)) = (frames.first(), frames.last()) else {
            return;
        };
        if text.is_empty() {
            return;
        }
        let frame_s = 1.0 / f64::from(FRAME_RATE_HZ);
        let (start_s, end_s) = (first.time_s, last.time_s + frame_s);
        if let Some(before) = self.segments.last_mut()
            && before.caption == text
            && start_s - before.end_s < 0.5 * frame_s
        {
            let (length_s, more_s) = (before.end_s - before.start_s, end_s - start_s);
            let weight = (more_s / (length_s + more_s)) as f32;
            before.confidence += weight * (confidence - before.confidence);
            before.end_s = end_s;
            return;
        }
        let clauses = radarllm_facts::parse(text);
        self.segments.push(Segment {
            start_s,
            end_s,
            caption: text.into(),
            actions: clauses
                .iter()
                .flat_map(|c| &c.actions)
                .map(|a| a.name)
                .collect(),
            confidence,
        });
    }
}

/// exp(mean log-probability of a token).
fn probability(log_prob: f32, n_tokens: usize) -> f32 {
    (log_prob / n_tokens as f32).exp().clamp(0.0, 1.0)
}

/// Returns the windows that may show a person, or the reason why there are none.
fn usable_windows<'a>(
    frames: &'a [PointFrame],
    options: &DescribeOptions,
) -> (Vec<&'a [PointFrame]>, Option<Abstained>) {
    let (found, min) = (frames.len(), options.min_frames.max(1));
    if found < min {
        return (Vec::new(), Some(Abstained::TooFewFrames { found, min }));
    }
    let min = options.min_median_points;
    let mut best = 0;
    let mut kept = Vec::new();
    for window in equal_windows(frames) {
        let median = median_points(window);
        best = best.max(median);
        if median >= min || points_stay_together(window) {
            kept.push(window);
        }
    }
    let abstained = kept
        .is_empty()
        .then_some(Abstained::TooFewPoints { median: best, min });
    (kept, abstained)
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
