//! The windows in which a recording is described.
//!
//! All windows of a recording are [`consensus::windows`]. Of a long recording, the networks read coarse windows first, one
//! every 8 s, and the others only where these differ: an hour in which nothing changes is not described in 2,700 windows.

use radarllm_base::{Clip, PointFrame};

use super::captioner::{Abstained, DescribeOptions, Description, NO_PERSON, Segment, actions};
use super::consensus::{self, Sentences, WindowReadings};
use super::ensemble::{EncodedWindow, Sentence};
use super::person_gate::{median_points, points_stay_together};
use crate::prepare::FRAME_RATE_HZ;
use crate::tokenizer::{FRAMES_PER_CODE, MAX_FRAMES};

/// First frame of a window, and the frame after its last one.
pub(super) type Span = (usize, usize);

/// Recordings of more frames are long: two minutes.
const LONG_FRAMES: usize = 1200;
/// Distance of the coarse windows of long recordings, frames: that of every second window of their length.
const COARSE_FRAMES: usize = 2 * consensus::WINDOWS[1].1;
/// Coarse windows that are described before the windows between them.
const COARSE_WINDOWS: usize = 64;
/// Sentences of coarse windows with less confidence do not settle what is between them.
const MIN_SETTLED: f32 = 0.5;

/// What the networks made of one window.
pub(super) struct WindowCaption {
    pub span: Span,
    /// What the members of the ensemble read; empty once it is not needed any more.
    pub radar: EncodedWindow,
    pub sentence: Sentence,
    /// The clauses of the sentence that state something, as sentences.
    pub clauses: Vec<String>,
    /// Codes by the first member.
    codes: Vec<u32>,
}

impl WindowCaption {
    pub(super) fn new(span: Span, radar: EncodedWindow, sentence: Sentence) -> Self {
        let clauses = radarllm_facts::parse(&sentence.text);
        let stating = clauses.iter().filter(|c| !c.text.is_empty());
        Self {
            span,
            clauses: stating.map(|c| c.sentence()).collect(),
            codes: radar
                .members
                .first()
                .map_or(Vec::new(), |radar| radar.codes.clone()),
            radar,
            sentence,
        }
    }
}

/// The captions of a recording so far.
#[derive(Default)]
pub(super) struct Captions {
    /// In order of their windows.
    pub all: Vec<WindowCaption>,
    /// The readings of the first of them.
    pub readings: Vec<WindowReadings>,
    pub sentences: Sentences,
}

impl Captions {
    /// Adds captions, which may lie between others that have no readings yet.
    pub(super) fn add(&mut self, captions: Vec<WindowCaption>) {
        self.all.extend(captions);
        self.all[self.readings.len()..].sort_by_key(|caption| caption.span);
    }
}

/// The windows of a prepared clip that may show a person.
pub(super) struct Windows<'a> {
    clip: &'a Clip,
    spans: Vec<Span>,
    /// First frames of the windows that show nobody.
    empty: Vec<usize>,
    abstained: Option<Abstained>,
}

impl<'a> Windows<'a> {
    /// Cuts a prepared clip: a clip of at most [`MAX_FRAMES`] is one window, a longer one has overlapping windows.
    pub(super) fn of(clip: &'a Clip, options: &DescribeOptions) -> Self {
        let (found, min) = (clip.frames.len(), options.min_frames.max(1));
        let mut windows = Self {
            clip,
            spans: Vec::new(),
            empty: Vec::new(),
            abstained: None,
        };
        if found < min {
            windows.abstained = Some(Abstained::TooFewFrames { found, min });
            return windows;
        }
        let min = options.min_median_points;
        let mut best = 0;
        let all: Vec<Span> = match windows.is_whole() {
            true => vec![(0, found)],
            false => consensus::windows(found),
        };
        for (start, end) in all {
            let frames = &clip.frames[start..end];
            let median = median_points(frames);
            best = best.max(median);
            if median >= min || points_stay_together(frames) {
                windows.spans.push((start, end));
            } else {
                windows.empty.push(start);
            }
        }
        if windows.spans.is_empty() {
            windows.abstained = Some(Abstained::TooFewPoints { median: best, min });
        }
        windows
    }

    /// Whether the clip is described as a whole, so that the sentence of its window is its caption.
    pub(super) fn is_whole(&self) -> bool {
        self.clip.frames.len() <= MAX_FRAMES
    }

    /// Whether the clip is described in more windows only where they are needed.
    pub(super) fn is_long(&self) -> bool {
        self.clip.frames.len() > LONG_FRAMES
    }

    /// Whether its sentences are guesses about a long recording, which need no exact probabilities.
    pub(super) fn is_guessed(&self, options: &DescribeOptions) -> bool {
        options.only_guesses && self.is_long()
    }

    /// The windows, in order.
    pub(super) fn spans(&self) -> &[Span] {
        &self.spans
    }

    /// Frames of windows, with the height of the radar.
    pub(super) fn frames_of(&self, spans: &[Span]) -> Vec<(&'a [PointFrame], f32)> {
        let window =
            |&(start, end): &Span| (&self.clip.frames[start..end], self.clip.radar_height_m);
        spans.iter().map(window).collect()
    }

    /// Combines the captions of windows. A clip that is described as a whole needs no readings.
    pub(super) fn describe(
        &self,
        results: Vec<WindowCaption>,
        readings: &[WindowReadings],
    ) -> Description {
        let n_frames = self.clip.frames.len();
        let mut description = Description {
            caption: NO_PERSON.into(),
            confidence: 0.0,
            tokens: Vec::new(),
            seconds: n_frames as f32 / FRAME_RATE_HZ,
            windows: results.len(),
            segments: Vec::new(),
            choices: Vec::new(),
            abstained: self.abstained,
        };
        if self.abstained.is_some() {
            return description;
        }
        description.tokens = tokens(&results);
        if let [only] = &results[..]
            && self.is_whole()
        {
            let Sentence {
                text,
                confidence,
                side_confidence,
            } = &only.sentence;
            description.caption.clone_from(text);
            description.confidence = *confidence;
            description.segments.push(Segment {
                start_s: time_s(self.clip, 0),
                end_s: time_s(self.clip, n_frames),
                caption: text.clone(),
                actions: actions(text),
                confidence: *confidence,
                side_confidence: *side_confidence,
                taught: None,
                guess: None,
            });
            return description;
        }
        let segments = consensus::segments(readings, n_frames, |i| time_s(self.clip, i));
        description.set_segments(segments);
        description
    }
}

/// Time at which a frame begins; the frame after the last one begins when that ends.
pub(super) fn time_s(clip: &Clip, frame: usize) -> f64 {
    match clip.frames.get(frame) {
        Some(frame) => frame.time_s,
        None => clip.frames.last().map_or(0.0, |f| f.time_s) + 1.0 / clip.frame_rate_hz,
    }
}

/// Codes of the windows, one per 0.4 s: where windows overlap, those of the later one.
fn tokens(results: &[WindowCaption]) -> Vec<u32> {
    let mut tokens = Vec::new();
    for (i, result) in results.iter().enumerate() {
        let (start, end) = result.span;
        let own = match results.get(i + 1) {
            Some(next) => (next.span.0.min(end) - start).div_ceil(FRAMES_PER_CODE),
            None => result.codes.len(),
        };
        tokens.extend(result.codes.iter().take(own));
    }
    tokens
}

/// The times of a prepared clip in which its windows may show a person, s, in order and apart; why there are none otherwise. No
/// network reads the clip.
///
/// # Errors
/// A clip that is too short, or that has too few points in every window.
pub fn times_with_person(
    clip: &Clip,
    options: &DescribeOptions,
) -> Result<Vec<[f64; 2]>, Abstained> {
    let windows = Windows::of(clip, options);
    if let Some(why) = windows.abstained {
        return Err(why);
    }
    let mut times: Vec<[f64; 2]> = Vec::new();
    for (start, end) in windows.spans {
        let [start_s, end_s] = [start, end].map(|frame| time_s(clip, frame));
        match times.last_mut() {
            Some(last) if start_s <= last[1] => last[1] = last[1].max(end_s),
            _ => times.push([start_s, end_s]),
        }
    }
    Ok(times)
}

/// The order in which windows are described: all at once, or in steps along a long recording, first the coarse windows and then
/// those between them that are needed.
pub(super) struct Plan<'a, 'b> {
    windows: &'b Windows<'a>,
    only_guesses: bool,
    /// Starts of the coarse windows, whether they show somebody or not; empty if the recording is not long.
    coarse: Vec<usize>,
    /// Coarse windows that were described, and among them those before which all is described.
    described: usize,
    complete: usize,
    is_first: bool,
}

impl<'a, 'b> Plan<'a, 'b> {
    pub(super) fn new(windows: &'b Windows<'a>, options: &DescribeOptions) -> Self {
        let n_frames = windows.clip.frames.len();
        let last = n_frames.saturating_sub(MAX_FRAMES);
        let coarse = match windows.is_long() {
            true => (0..last).step_by(COARSE_FRAMES).chain([last]).collect(),
            false => Vec::new(),
        };
        Self {
            windows,
            only_guesses: options.only_guesses,
            coarse,
            described: 0,
            complete: 0,
            is_first: true,
        }
    }

    /// The next windows to be described, given the captions so far in order; `None` if all are.
    pub(super) fn next(&mut self, captions: &[WindowCaption]) -> Option<Vec<Span>> {
        if self.coarse.is_empty() {
            return std::mem::take(&mut self.is_first).then(|| self.windows.spans.clone());
        }
        if self.complete + 1 < self.described {
            let pairs: Vec<&[usize]> = self.coarse[self.complete..self.described]
                .windows(2)
                .collect();
            let settled: Vec<bool> = (pairs.iter())
                .map(|pair| self.is_settled(pair[0], pair[1], captions))
                .collect();
            let mut spans: Vec<Span> = Vec::new();
            for (i, pair) in pairs.iter().enumerate() {
                // Beside a change, more windows show when it happens.
                let near = match self.only_guesses {
                    true => i..i + 1,
                    false => i.saturating_sub(1)..(i + 2).min(pairs.len()),
                };
                if !settled[near].iter().all(|is_settled| *is_settled) {
                    spans.extend(self.others(pair[0], pair[1]));
                }
            }
            self.complete = self.described - 1;
            if self.described == self.coarse.len() {
                spans.extend(self.others(self.coarse[self.complete], usize::MAX));
            }
            return Some(spans);
        }
        let from = self.described;
        self.described = (from + COARSE_WINDOWS).min(self.coarse.len());
        let starts = &self.coarse[from..self.described];
        (!starts.is_empty()).then(|| {
            let is_usable = |span: &Span| self.windows.spans.binary_search(span).is_ok();
            let spans = starts.iter().map(|start| coarse_span(*start));
            spans.filter(is_usable).collect()
        })
    }

    /// All windows that begin before this frame are described, as far as they are needed.
    pub(super) fn complete_before(&self) -> usize {
        self.coarse.get(self.complete).copied().unwrap_or(0)
    }

    /// Whether a coarse window and the next one settle what is between them.
    fn is_settled(&self, first: usize, second: usize, captions: &[WindowCaption]) -> bool {
        let caption = |start: usize| {
            let span = coarse_span(start);
            let at = captions.binary_search_by_key(&span, |caption| caption.span);
            at.ok().map(|at| &captions[at].sentence)
        };
        let empty = &self.windows.empty;
        let from = empty.partition_point(|start| *start < first);
        let shows_nobody = empty.get(from).is_some_and(|start| *start <= second);
        match (caption(first), caption(second)) {
            (Some(a), Some(b)) => !shows_nobody && (self.only_guesses || agree(a, b)),
            _ => false,
        }
    }

    /// The windows that begin from one frame until before another one, without the coarse window at the first.
    fn others(&self, first: usize, second: usize) -> Vec<Span> {
        let spans = &self.windows.spans;
        let from = spans.partition_point(|(start, _)| *start < first);
        let to = spans.partition_point(|(start, _)| *start < second);
        let others = spans[from..to]
            .iter()
            .filter(|span| **span != coarse_span(first));
        others.copied().collect()
    }
}

fn coarse_span(start: usize) -> Span {
    (start, start + MAX_FRAMES)
}

/// Whether two sentences state the same actions with confidence.
fn agree(a: &Sentence, b: &Sentence) -> bool {
    let is_sure = |s: &Sentence| s.confidence >= MIN_SETTLED;
    is_sure(a) && is_sure(b) && actions(&a.text) == actions(&b.text)
}

#[cfg(test)]
mod tests {
    use radarllm_base::{Clutter, RadarPoint};

    use super::*;

    /// A recording with somebody in it, but for some frames.
    fn clip(n_frames: usize, empty: std::ops::Range<usize>) -> Clip {
        let point = RadarPoint {
            y_m: 2.0,
            range_m: 2.0,
            velocity_mps: 0.5,
            ..RadarPoint::default()
        };
        let frame = |i: usize| PointFrame {
            frame: i as u32,
            time_s: i as f64 / 10.0,
            points: if empty.contains(&i) {
                Vec::new()
            } else {
                vec![point; 10]
            },
            board: None,
        };
        Clip {
            frames: (0..n_frames).map(frame).collect(),
            frame_rate_hz: 10.0,
            radar_height_m: 1.0,
            is_height_assumed: false,
            radar: "test".into(),
            provenance: "recorded:csv:x".parse().unwrap(),
            clutter: Clutter::Settled,
        }
    }

    /// The windows that are described of a recording, given the sentence of each.
    fn described(
        clip: &Clip,
        only_guesses: bool,
        says: impl Fn(Span) -> (&'static str, f32),
    ) -> Vec<Span> {
        let options = DescribeOptions {
            only_guesses,
            ..DescribeOptions::default()
        };
        let windows = Windows::of(clip, &options);
        let mut plan = Plan::new(&windows, &options);
        let mut captions = Captions::default();
        while let Some(spans) = plan.next(&captions.all) {
            let caption = |span: Span| {
                let (text, confidence) = says(span);
                let sentence = Sentence {
                    text: text.into(),
                    confidence,
                    side_confidence: None,
                };
                WindowCaption::new(span, EncodedWindow::default(), sentence)
            };
            captions.add(spans.into_iter().map(caption).collect());
            // What is complete is not described later.
            let complete = plan.complete_before();
            let before = captions.all.partition_point(|c| c.span.0 < complete);
            let spans: Vec<Span> = captions.all[..before].iter().map(|c| c.span).collect();
            assert!(spans.is_sorted());
        }
        let spans: Vec<Span> = captions.all.iter().map(|c| c.span).collect();
        let mut once = spans.clone();
        once.dedup();
        assert_eq!(once, spans, "a window is described once");
        spans
    }

    const SITS: (&str, f32) = ("a person sits", 0.9);

    fn covers(spans: &[Span], frames: std::ops::Range<usize>) -> bool {
        frames
            .into_iter()
            .all(|f| spans.iter().any(|(a, b)| (*a..*b).contains(&f)))
    }

    #[test]
    fn what_stays_the_same_is_described_in_few_windows() {
        for n_frames in [1201, 6000, 6001, 12_345] {
            let clip = clip(n_frames, 0..0);
            let spans = described(&clip, false, |_| SITS);
            assert!(covers(&spans, 0..n_frames));
            let n_coarse = (n_frames - MAX_FRAMES).div_ceil(COARSE_FRAMES) + 1;
            assert!(
                (n_coarse..n_coarse + 4).contains(&spans.len()),
                "{n_frames}: {}",
                spans.len()
            );
        }
    }

    #[test]
    fn a_recording_that_is_not_long_is_described_in_all_windows() {
        let clip = clip(1200, 0..0);
        assert_eq!(described(&clip, false, |_| SITS), consensus::windows(1200));
    }

    #[test]
    fn changes_are_described_in_all_windows() {
        let clip = clip(12_000, 0..0);
        let change = |(start, end): Span| match (start + end) / 2 < 5_000 {
            true => SITS,
            false => ("a person walks forward", 0.9),
        };
        let spans = described(&clip, false, change);
        let all = consensus::windows(12_000);
        let near = |(start, _): &&Span| (4_880..4_960).contains(start);
        assert!(all.iter().filter(near).all(|span| spans.contains(span)));
        assert!(spans.len() < all.len() / 4);
        // A guess about an unknown board does not ask for more.
        assert!(described(&clip, true, change).len() < spans.len());
        // Nor does what is uncertain settle anything.
        let unsure = |_| ("a person sits", 0.3);
        assert_eq!(described(&clip, false, unsure), all);
    }

    #[test]
    fn who_comes_and_goes_is_described_in_all_windows() {
        let clip = clip(12_000, 6_000..7_000);
        for only_guesses in [false, true] {
            let spans = described(&clip, only_guesses, |_| SITS);
            let options = DescribeOptions::default();
            let windows = Windows::of(&clip, &options);
            let near = |(start, _): &&Span| (5_920..6_960).contains(start);
            let usable: Vec<&Span> = windows.spans().iter().filter(near).collect();
            assert!(!usable.is_empty());
            assert!(usable.iter().all(|span| spans.contains(span)));
            assert!(!covers(&spans, 6_400..6_401));
        }
    }
}
