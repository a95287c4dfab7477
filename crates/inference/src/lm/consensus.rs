//! The sentences of overlapping windows, combined to segments.
//!
//! A recording that is longer than one window is described in windows of [`WINDOW_FRAMES`] every [`HOP_FRAMES`]. Each
//! hop is thus described by up to three windows, and these vote: a window votes for the clause of its sentence that
//! covers the hop, with its confidence as weight. Hops of equal content are joined to segments. A segment of one hop
//! between two equal ones is treated as an error and merged with them, unless its action may be that short.

use radarllm_facts::{Clause, parse};

use super::captioner::Segment;

/// Length of a window, frames: 6 s.
pub const WINDOW_FRAMES: usize = 60;
/// Distance of two windows, frames: 2 s.
pub const HOP_FRAMES: usize = 20;

/// Actions that may take less than two hops.
const SHORT: [&str; 9] = [
    "fall", "sit_down", "stand_up", "lie_down", "pick_up", "bow", "jump", "turn", "throw",
];

/// The sentence of a window.
#[derive(Clone, Debug)]
pub(crate) struct WindowSentence {
    /// First frame.
    pub start: usize,
    /// Frame after the last one.
    pub end: usize,
    /// The sentence.
    pub text: String,
    /// exp(mean token log-probability).
    pub confidence: f32,
}

/// First and last frame (exclusive) of every window of a recording. All windows have [`WINDOW_FRAMES`]; the last one ends
/// with the recording.
pub(crate) fn windows(n_frames: usize) -> impl Iterator<Item = (usize, usize)> {
    let last = n_frames.saturating_sub(WINDOW_FRAMES);
    (0..last)
        .step_by(HOP_FRAMES)
        .chain([last])
        .map(move |start| (start, (start + WINDOW_FRAMES).min(n_frames)))
}

/// A clause that won the vote of a hop.
struct Elected {
    clause: Clause,
    /// Sum of the confidences of the windows that agree, divided by the number of windows.
    confidence: f32,
}

/// A run of hops with one content.
struct Run {
    first_hop: usize,
    n_hops: usize,
    clause: Clause,
    /// Sum over hops.
    confidence: f32,
    /// Confidence of the hop from which the clause was taken.
    best: f32,
}

/// Combines the sentences of windows to segments. `time_s` gives the time at which a frame begins; frame `n_frames` is
/// the end of the recording. Hops that no window describes have no segment.
pub(crate) fn segments(
    windows: &[WindowSentence],
    n_frames: usize,
    time_s: impl Fn(usize) -> f64,
) -> Vec<Segment> {
    // A window whose sentence is empty has no vote.
    let stated = |w: &WindowSentence| {
        let clauses = parse(&w.text);
        clauses.into_iter().filter(|c| !c.text.is_empty()).collect()
    };
    let clauses: Vec<Vec<Clause>> = windows.iter().map(stated).collect();
    let n_hops = n_frames.div_ceil(HOP_FRAMES);
    let mut runs: Vec<Run> = Vec::new();
    for hop in 0..n_hops {
        let Some(elected) = elect(hop, n_frames, windows, &clauses) else {
            continue;
        };
        match runs.last_mut() {
            Some(run)
                if run.first_hop + run.n_hops == hop && same(&run.clause, &elected.clause) =>
            {
                run.add(elected);
            }
            _ => runs.push(Run {
                first_hop: hop,
                n_hops: 1,
                confidence: elected.confidence,
                best: elected.confidence,
                clause: elected.clause,
            }),
        }
    }
    merge_interruptions(&mut runs);
    let segment = |run: Run| Segment {
        start_s: time_s(run.first_hop * HOP_FRAMES),
        end_s: time_s(((run.first_hop + run.n_hops) * HOP_FRAMES).min(n_frames)),
        caption: match run.n_hops > WINDOW_FRAMES / HOP_FRAMES {
            // What a window counted is not the count of a longer time.
            true => run.clause.without_count().sentence(),
            false => run.clause.sentence(),
        },
        actions: run.clause.actions.iter().map(|a| a.name).collect(),
        confidence: run.confidence / run.n_hops as f32,
        taught: None,
    };
    runs.into_iter().map(segment).collect()
}

/// The clause with the most votes for a hop.
fn elect(
    hop: usize,
    n_frames: usize,
    windows: &[WindowSentence],
    clauses: &[Vec<Clause>],
) -> Option<Elected> {
    let start = hop * HOP_FRAMES;
    let middle = (start + (start + HOP_FRAMES).min(n_frames)) / 2;
    let votes: Vec<(&Clause, f32)> = windows
        .iter()
        .zip(clauses)
        .filter(|(w, clauses)| (w.start..w.end).contains(&middle) && !clauses.is_empty())
        .map(|(w, clauses)| {
            let position = (middle - w.start) * clauses.len() / (w.end - w.start);
            (&clauses[position.min(clauses.len() - 1)], w.confidence)
        })
        .collect();
    let support = |clause: &Clause| -> f32 {
        let agreeing = votes.iter().filter(|(other, _)| same(clause, other));
        agreeing.map(|(_, confidence)| confidence).sum()
    };
    // Of clauses with equal content, the most confident one.
    let best = votes.iter().max_by(|a, b| {
        let by_support = support(a.0).total_cmp(&support(b.0));
        by_support.then(a.1.total_cmp(&b.1))
    })?;
    Some(Elected {
        clause: best.0.clone(),
        confidence: support(best.0) / votes.len() as f32,
    })
}

/// Whether two clauses have the same actions. Clauses without a known action are the same only if their words are.
fn same(a: &Clause, b: &Clause) -> bool {
    if a.actions.is_empty() || b.actions.is_empty() {
        return a.text == b.text;
    }
    let names = |clause: &Clause| {
        let mut names: Vec<&str> = clause.actions.iter().map(|a| a.name).collect();
        names.sort_unstable();
        names
    };
    names(a) == names(b)
}

impl Run {
    fn add(&mut self, elected: Elected) {
        self.n_hops += 1;
        self.confidence += elected.confidence;
        if elected.confidence > self.best {
            self.best = elected.confidence;
            self.clause = elected.clause;
        }
    }
}

/// Joins two runs of equal content that a single hop interrupts.
fn merge_interruptions(runs: &mut Vec<Run>) {
    let mut i = 1;
    while i + 1 < runs.len() {
        let (before, at, after) = (&runs[i - 1], &runs[i], &runs[i + 1]);
        let is_short = at.clause.actions.iter().any(|a| SHORT.contains(&a.name));
        let adjoining = before.first_hop + before.n_hops == at.first_hop
            && at.first_hop + at.n_hops == after.first_hop;
        if at.n_hops > 1 || is_short || !adjoining || !same(&before.clause, &after.clause) {
            i += 1;
            continue;
        }
        let after = runs.remove(i + 1);
        // The interrupting hop contributes time, but no confidence.
        let interruption = runs.remove(i);
        let before = &mut runs[i - 1];
        before.n_hops += interruption.n_hops + after.n_hops;
        before.confidence += after.confidence;
        if after.best > before.best {
            before.best = after.best;
            before.clause = after.clause;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn windows_of(sentences: &[&str]) -> Vec<WindowSentence> {
        let sentence = |(i, text): (usize, &&str)| WindowSentence {
            start: i * HOP_FRAMES,
            end: i * HOP_FRAMES + WINDOW_FRAMES,
            text: (*text).into(),
            confidence: 0.6,
        };
        sentences.iter().enumerate().map(sentence).collect()
    }

    fn segments_of(sentences: &[&str]) -> Vec<(f64, f64, String)> {
        let windows = windows_of(sentences);
        let n_frames = windows.last().unwrap().end;
        segments(&windows, n_frames, |frame| frame as f64 / 10.0)
            .into_iter()
            .map(|s| (s.start_s, s.end_s, s.caption))
            .collect()
    }

    #[test]
    fn windows_cover_every_frame() {
        for n in [61, 97, 100, 119, 120, 121, 601] {
            let all: Vec<_> = windows(n).collect();
            assert_eq!(all[0].0, 0, "{n}");
            assert_eq!(all.last().unwrap().1, n, "{n}");
            assert!(
                all.iter().all(|(start, end)| end - start == WINDOW_FRAMES),
                "{n}"
            );
            assert!(
                all.windows(2)
                    .all(|w| w[1].0 > w[0].0 && w[1].0 - w[0].0 <= HOP_FRAMES),
                "{n}"
            );
        }
    }

    #[test]
    fn agreement_is_one_segment() {
        let walk = "a person walks forward";
        assert_eq!(segments_of(&[walk; 5]), [(0.0, 14.0, walk.to_string())]);
    }

    #[test]
    fn counts_of_windows_are_not_those_of_the_recording() {
        let claps = "a person claps three times";
        assert_eq!(segments_of(&[claps]), [(0.0, 6.0, claps.to_string())]);
        assert_eq!(
            segments_of(&[claps; 5]),
            [(0.0, 14.0, "a person claps".to_string())]
        );
    }

    #[test]
    fn one_window_that_disagrees_is_outvoted() {
        let all = segments_of(&[
            "a person walks",
            "a person walks",
            "a person bows",
            "a person walks",
            "a person walks",
        ]);
        assert_eq!(all, [(0.0, 14.0, "a person walks".to_string())]);
    }

    #[test]
    fn clauses_vote_for_their_part_of_the_window() {
        // Someone walks for 6 s and sits down: windows across the change have two clauses.
        let all = segments_of(&[
            "a person walks",
            "a person walks, then sits down",
            "a person walks, then sits down",
            "a person sits down",
        ]);
        let texts: Vec<&str> = all.iter().map(|s| s.2.as_str()).collect();
        assert_eq!(texts, ["a person walks", "a person sits down"]);
        assert_eq!((all[0].0, all[1].1), (0.0, 12.0));
        assert_eq!(all[0].1, all[1].0);
    }

    #[test]
    fn a_fall_between_is_kept() {
        let all = segments_of(&[
            "a person walks",
            "a person walks, then walks, then falls forward",
            "a person walks, then falls forward, then walks",
            "a person falls forward, then walks, then walks",
            "a person walks",
        ]);
        let texts: Vec<&str> = all.iter().map(|s| s.2.as_str()).collect();
        assert_eq!(
            texts,
            ["a person walks", "a person falls forward", "a person walks"]
        );
    }

    #[test]
    fn empty_sentences_state_nothing() {
        assert_eq!(segments_of(&["", ""]), []);
        let all = segments_of(&["", "a person walks", ""]);
        assert_eq!(all, [(2.0, 8.0, "a person walks".to_string())]);
    }

    #[test]
    fn disagreement_lowers_confidence() {
        let windows = windows_of(&["a person walks", "a person bows", "a person walks"]);
        let all = segments(&windows, 100, |frame| frame as f64 / 10.0);
        assert!(all.iter().all(|s| s.confidence <= 0.6 + 1e-6));
        assert!(all.iter().any(|s| s.confidence < 0.5));
    }
}
