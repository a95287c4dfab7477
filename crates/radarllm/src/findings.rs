//! What is found in a clip, or in the parts of a long recording, and how it is put together to a description.

use radarllm_base::StaticClutter;
use radarllm_inference::{Description, Segment};
use radarllm_measure::{Activity, Posture, State};

use crate::{
    Part, measured,
    taught::{insert, insert_taught_segments},
};

/// Times that are nearer to each other touch, s.
const TOUCH_S: f64 = 1e-6;
/// What is left of something shorter than this where a part ends or begins, s, is nothing of its own: the two parts differ in
/// where it begins or ends.
const MIN_REST_S: f64 = 1.0;

/// What is found before it is put together.
#[derive(Default)]
pub(crate) struct Findings {
    /// What is measured where the board tracks people; nothing else is said then.
    pub states: Option<Vec<State>>,
    /// The sentences of the networks.
    pub said: Option<Description>,
    /// What is measured in points, to be stated in the place of these sentences.
    pub in_points: Vec<Segment>,
    /// Taught activities.
    pub taught: Vec<Segment>,
}

/// A long recording, described.
#[derive(Debug, Default)]
pub struct LongDescription {
    /// The description, without radar tokens.
    pub description: Description,
    /// Number of frames as the model reads them.
    pub frames: usize,
    /// Length of the recording as the model reads it, s.
    pub seconds: f64,
    /// The static clutter that was removed.
    pub removed_static: Option<StaticClutter>,
    /// Times without frames, s; see [`crate::gaps`].
    pub gaps: Vec<[f64; 2]>,
}

impl Findings {
    /// Puts together what is said of a clip of a length in s.
    pub(crate) fn description(self, seconds: f64) -> Description {
        let mut description = match (self.states, self.said) {
            (Some(states), _) => measured::description(seconds, &states),
            (None, said) => said.unwrap_or_default(),
        };
        description.seconds = seconds as f32;
        insert(&mut description, self.in_points);
        insert_taught_segments(&mut description, self.taught);
        description
    }

    fn segments(&mut self) -> impl Iterator<Item = &mut Vec<Segment>> {
        let said = self.said.as_mut().map(|said| &mut said.segments);
        [&mut self.in_points, &mut self.taught]
            .into_iter()
            .chain(said)
    }

    /// The postures of the tracks at a time, where they are measured.
    pub(crate) fn postures_at(&self, t_s: f64) -> Vec<(u32, Posture)> {
        let states = self.states.iter().flatten();
        let at = states.filter(|state| (state.start_s..state.end_s).contains(&t_s));
        at.filter_map(|state| match state.activity {
            Activity::Stays(posture) => Some((state.track, posture)),
            _ => None,
        })
        .collect()
    }

    /// Moves all times.
    pub(crate) fn shift(&mut self, by_s: f64) {
        self.states
            .iter_mut()
            .for_each(|states| shift(states, by_s));
        self.segments().for_each(|segments| shift(segments, by_s));
    }

    /// Keeps what is within a time.
    pub(crate) fn clip(&mut self, span_s: [f64; 2]) {
        self.states
            .iter_mut()
            .for_each(|states| clip(states, span_s));
        self.segments().for_each(|segments| clip(segments, span_s));
    }

    /// Adds what was found in the next part. What goes on from one part to the next one is one thing.
    pub(crate) fn join(&mut self, next: Self) {
        if let Some(mut states) = next.states {
            let before = self.states.get_or_insert_default();
            join_rests(before, &mut states);
            join_states(before, states);
        }
        match (&mut self.said, next.said) {
            (Some(before), Some(mut said)) => {
                join_rests(&mut before.segments, &mut said.segments);
                join_segments(&mut before.segments, said.segments);
                before.windows += said.windows;
                // Nobody is seen in the whole only if nobody is seen in any part.
                before.abstained = before.abstained.filter(|_| said.abstained.is_some());
            }
            (said, next) => *said = said.take().or(next),
        }
        join_segments(&mut self.in_points, next.in_points);
        join_segments(&mut self.taught, next.taught);
    }
}

/// Something with a beginning and an end.
trait Span {
    fn span_s(&self) -> [f64; 2];

    fn set_span_s(&mut self, span_s: [f64; 2]);

    /// Whether it begins where another one of the same person ends.
    fn follows(&self, before: &Self) -> bool;

    /// Whether it is too short for something that was not cut off.
    fn is_rest(&self) -> bool {
        let [start_s, end_s] = self.span_s();
        end_s - start_s < MIN_REST_S
    }
}

impl Span for Segment {
    fn span_s(&self) -> [f64; 2] {
        [self.start_s, self.end_s]
    }

    fn set_span_s(&mut self, [start_s, end_s]: [f64; 2]) {
        (self.start_s, self.end_s) = (start_s, end_s);
    }

    fn follows(&self, before: &Self) -> bool {
        (before.end_s - self.start_s).abs() < TOUCH_S
    }
}

impl Span for State {
    fn span_s(&self) -> [f64; 2] {
        [self.start_s, self.end_s]
    }

    fn set_span_s(&mut self, [start_s, end_s]: [f64; 2]) {
        (self.start_s, self.end_s) = (start_s, end_s);
    }

    fn follows(&self, before: &Self) -> bool {
        before.track == self.track && (before.end_s - self.start_s).abs() < TOUCH_S
    }

    fn is_rest(&self) -> bool {
        self.activity != Activity::Falls && self.end_s - self.start_s < MIN_REST_S
    }
}

fn shift<S: Span>(spans: &mut [S], by_s: f64) {
    for span in spans {
        span.set_span_s(span.span_s().map(|t_s| t_s + by_s));
    }
}

fn clip<S: Span>(spans: &mut Vec<S>, [start_s, end_s]: [f64; 2]) {
    for span in &mut *spans {
        let [from_s, to_s] = span.span_s();
        span.set_span_s([from_s.max(start_s), to_s.min(end_s)]);
    }
    spans.retain(|span| {
        let [from_s, to_s] = span.span_s();
        from_s < to_s
    });
}

/// Gives what is left of something before or after the end of a part to what is on the other side of it.
fn join_rests<S: Span>(before: &mut Vec<S>, after: &mut Vec<S>) {
    let mut at = 0;
    while at < before.len() {
        let Some(next) = after.iter().position(|next| next.follows(&before[at])) else {
            at += 1;
            continue;
        };
        let ([start_s, _], [_, end_s]) = (before[at].span_s(), after[next].span_s());
        if before[at].is_rest() {
            before.remove(at);
            after[next].set_span_s([start_s, end_s]);
            continue;
        }
        if after[next].is_rest() {
            after.remove(next);
            before[at].set_span_s([start_s, end_s]);
        }
        at += 1;
    }
}

/// Adds the states of the next part.
fn join_states(all: &mut Vec<State>, next: Vec<State>) {
    for state in next {
        let goes_on = |s: &&mut State| s.activity == state.activity && state.follows(s);
        match all.iter_mut().rev().find(goes_on) {
            Some(last) => {
                let [first_s, second_s] = [&*last, &state].map(|s| (s.end_s - s.start_s) as f32);
                let weight = second_s / (first_s + second_s);
                last.probability += weight * (state.probability - last.probability);
                last.end_s = state.end_s;
                last.places_m[1] = state.places_m[1];
                last.turns += state.turns;
                let [nearest_m, farthest_m] = state.between_m;
                last.between_m = [
                    last.between_m[0].min(nearest_m),
                    last.between_m[1].max(farthest_m),
                ];
            }
            None => all.push(state),
        }
    }
}

/// Adds the segments of the next part.
fn join_segments(all: &mut Vec<Segment>, next: Vec<Segment>) {
    for segment in next {
        match all.last_mut() {
            Some(last) if goes_on(last, &segment) => {
                let [first_s, second_s] = [&*last, &segment].map(|s| s.end_s - s.start_s);
                let weight = (second_s / (first_s + second_s)) as f32;
                last.confidence += weight * (segment.confidence - last.confidence);
                last.end_s = segment.end_s;
                last.side_confidence = None;
                if second_s > first_s {
                    last.caption = segment.caption;
                    last.guess = segment.guess;
                }
            }
            _ => all.push(segment),
        }
    }
}

/// Whether a segment states what the one before it states: the same actions, or of two guesses the same that is seen.
fn goes_on(last: &Segment, next: &Segment) -> bool {
    let states_same = match last.actions.is_empty() {
        true => last.caption == next.caption,
        false => true,
    };
    next.follows(last)
        && last.actions == next.actions
        && last.taught == next.taught
        && last.guess.is_some() == next.guess.is_some()
        && states_same
}

impl LongDescription {
    /// Counts a part.
    pub(crate) fn add(&mut self, part: &Part) {
        let [start_s, end_s] = part.span_s;
        let clip = &part.prepared.clip;
        let own = |t_s: f64| (start_s..end_s).contains(&(t_s + part.offset_s));
        let n_frames = clip.frames.iter().filter(|f| own(f.time_s)).count();
        self.frames += n_frames;
        self.seconds += n_frames as f64 / clip.frame_rate_hz;
        let gaps = crate::gaps(clip)
            .into_iter()
            .filter(|[from_s, _]| own(*from_s));
        self.gaps
            .extend(gaps.map(|times| times.map(|t_s| t_s + part.offset_s)));
        if let Some(removed) = part.prepared.removed_static {
            let sum = self.removed_static.get_or_insert(StaticClutter {
                n_static: 0,
                n_points: 0,
            });
            sum.n_static += removed.n_static;
            sum.n_points += removed.n_points;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(start_s: f64, end_s: f64, action: &'static str) -> Segment {
        Segment {
            start_s,
            end_s,
            caption: format!("a person does {action}"),
            actions: vec![action],
            confidence: 0.5,
            side_confidence: None,
            taught: None,
            guess: None,
        }
    }

    fn said(segments: &[(f64, f64, &'static str)]) -> Findings {
        let segments = segments
            .iter()
            .map(|(a, b, action)| segment(*a, *b, action));
        Findings {
            said: Some(Description {
                segments: segments.collect(),
                ..Description::default()
            }),
            ..Findings::default()
        }
    }

    #[test]
    fn what_goes_on_is_one_segment_and_what_is_cut_off_is_none() {
        let cases: [(&[_], &[_], &[_]); 4] = [
            // The same on both sides.
            (
                &[(0.0, 600.0, "squat")],
                &[(600.0, 700.0, "squat"), (700.0, 720.0, "walk")],
                &[(0.0, 700.0, "squat"), (700.0, 720.0, "walk")],
            ),
            // The part before sees a change a little earlier, or the part after a little later.
            (
                &[(0.0, 599.9, "squat"), (599.9, 600.0, "walk")],
                &[(600.0, 700.0, "walk")],
                &[(0.0, 599.9, "squat"), (599.9, 700.0, "walk")],
            ),
            (
                &[(0.0, 599.9, "squat"), (599.9, 600.0, "jump")],
                &[(600.0, 700.0, "squat")],
                &[(0.0, 700.0, "squat")],
            ),
            (
                &[(0.0, 600.0, "squat")],
                &[(600.0, 600.2, "jump"), (600.2, 700.0, "walk")],
                &[(0.0, 600.2, "squat"), (600.2, 700.0, "walk")],
            ),
        ];
        for (before, after, expected) in cases {
            let mut all = said(before);
            all.join(said(after));
            let found = all.description(720.0).segments;
            let found: Vec<_> = found
                .iter()
                .map(|s| (s.start_s, s.end_s, s.actions[0]))
                .collect();
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn what_is_outside_of_a_part_belongs_to_another_one() {
        let mut part = said(&[
            (0.0, 20.0, "walk"),
            (20.0, 40.0, "squat"),
            (40.0, 50.0, "jump"),
        ]);
        part.shift(100.0);
        part.clip([130.0, 140.0]);
        let found = part.description(10.0).segments;
        let [only] = &found[..] else {
            panic!("{found:?}")
        };
        assert_eq!(
            (only.start_s, only.end_s, only.actions[0]),
            (130.0, 140.0, "squat")
        );
    }
}
