//! What is measured of one person, as rows: every time is decided once.
//!
//! Windows overlap, and each of them measures all of its time anew, but does not know yet what follows its last seconds. A
//! time is decided by the last window that begins before it and ends four seconds or more after it, so that a person is in one
//! posture at a time and a row has the beginning and the end that were measured, not those of windows. Between two
//! postures lies a change: who walks after sitting has got up.

use std::collections::VecDeque;

use crate::activities::{MAX_ROW_S, Row, Samples, WindowCaption, WindowReading};
use crate::clock::MAX_GAP_S;
use crate::falls::FALL;
use crate::options::is_over;

/// Time before the end of a window, s, that the next windows decide: a fall is known three seconds after it, and whether
/// somebody has sat down or only bent, too.
const SETTLING_S: f64 = 4.0;
/// Time between two measurements of an action, s, from which on they are two rows.
const APART_S: f64 = 2.0;
/// Decided time of a state, s, from which on its row is reported while it goes on.
const GOES_ON_S: f64 = 2.0;
/// What is left of a shorter state, s, where another window decides, belongs to the next one.
const MIN_REST_S: f64 = 0.5;
/// Longest time between two postures, s, of which the change is a row, and how long it lasts before and after.
const MAX_CHANGE_S: f64 = 5.0;
const CHANGE_S: f64 = 1.0;
/// Time for which decided states are remembered, s: longer than what a window is told of the time before it.
const MEMORY_S: f64 = 60.0;
/// Time for which somebody stands or walks at the end of a window who is up, s, and the probability of standing then.
const UP_S: f64 = 3.0;
const SURE: f64 = 0.8;
/// Rounding of times, s.
const ROUNDING_S: f64 = 1e-6;

/// A state of a person with its beginning and end, as a window measures it.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredSpan {
    /// Beginning, s.
    pub start_s: f64,
    /// End, s.
    pub end_s: f64,
    /// The action; `None` if the person is there and no more is known.
    pub action: Option<String>,
    /// The sentence of this state.
    pub caption: WindowCaption,
}

/// The states of one person, in order of time and without overlap.
#[derive(Clone, Debug, Default)]
pub(crate) struct Timeline {
    states: VecDeque<State>,
    /// Time until which everything is decided, s.
    decided_s: Option<f64>,
}

#[derive(Clone, Debug)]
struct State {
    action: Option<String>,
    start_s: f64,
    end_s: f64,
    /// Number of the row, if it was reported, and whether it has ended.
    row: Option<u64>,
    is_ended: bool,
    n_windows: u32,
    n_points: u32,
    captions: Samples,
}

impl Timeline {
    /// The next window of the person. Returns rows that have begun, grown or ended; `next_row` numbers them.
    pub(crate) fn push(
        &mut self,
        reading: &WindowReading,
        next_row: &mut impl FnMut() -> u64,
    ) -> Vec<Row> {
        if self.states.is_empty() && reading.spans.is_empty() {
            return Vec::new();
        }
        let cut_s = self
            .decided_s
            .map_or(reading.start_s, |s| s.max(reading.start_s));
        if reading.spans.is_empty() {
            // Nothing was measured: what the window before measured of the same time stays, and ends with the overlap.
            self.decided_s = Some(cut_s);
            return self.report(reading.person, cut_s, false, next_row);
        }
        let mut from_s = self.cut(cut_s);
        for span in &reading.spans {
            let start_s = span.start_s.max(from_s);
            if start_s < span.end_s {
                self.append(span, start_s, reading.n_points);
                from_s = span.end_s;
            }
        }
        let decided_s = cut_s.max(reading.end_s - SETTLING_S);
        self.decided_s = Some(decided_s);
        let rows = self.report(reading.person, decided_s, false, next_row);
        while let [first, _, ..] = self.states.make_contiguous()
            && first.is_ended
            && is_over(first.end_s, decided_s, MEMORY_S)
        {
            self.states.pop_front();
        }
        rows
    }

    /// Ends all rows: nothing is measured of the person any more.
    pub(crate) fn end(&mut self, person: u32, next_row: &mut impl FnMut() -> u64) -> Vec<Row> {
        let rows = self.report(person, f64::INFINITY, true, next_row);
        *self = Self::default();
        rows
    }

    /// The action at a time; the last one at its end, if the time is later by less than a gap.
    pub(crate) fn action_at(&self, t_s: f64) -> Option<&str> {
        let last = self.states.back();
        let last = last.filter(|last| !is_over(last.end_s, t_s, MAX_GAP_S));
        let state = self.states.iter().find(|state| state.end_s > t_s).or(last);
        state?.action.as_deref()
    }

    /// Removes what is not decided at a time. Returns from when on the next window states what follows.
    fn cut(&mut self, cut_s: f64) -> f64 {
        while self.states.back().is_some_and(|s| s.start_s >= cut_s) {
            self.states.pop_back();
        }
        let Some(last) = self.states.back_mut() else {
            return cut_s;
        };
        if last.end_s > cut_s {
            last.end_s = cut_s;
            if last.row.is_none() && cut_s - last.start_s < MIN_REST_S {
                let start_s = last.start_s;
                self.states.pop_back();
                return start_s;
            }
        }
        cut_s
    }

    /// Adds a state of a window from a time on.
    fn append(&mut self, span: &MeasuredSpan, start_s: f64, n_points: u32) {
        if let Some(last) = self.states.back_mut()
            && !last.is_ended
            && is_same(last.action.as_deref(), span.action.as_deref())
            && !is_over(last.end_s, start_s, APART_S)
            && !is_over(last.start_s, span.end_s, MAX_ROW_S)
        {
            last.extend(span, n_points);
            return;
        }
        let mut state = State {
            action: span.action.clone(),
            start_s,
            end_s: start_s,
            row: None,
            is_ended: false,
            n_windows: 0,
            n_points: 0,
            captions: Samples::default(),
        };
        state.extend(span, n_points);
        self.states.push_back(state);
    }

    /// Rows of what is decided at a time. All of them end if `is_end`.
    fn report(
        &mut self,
        person: u32,
        decided_s: f64,
        is_end: bool,
        next_row: &mut impl FnMut() -> u64,
    ) -> Vec<Row> {
        let mut rows = Vec::new();
        // The last state with a row.
        let mut before: Option<usize> = None;
        for at in 0..self.states.len() {
            let is_last = at + 1 == self.states.len();
            let state = &self.states[at];
            if state.start_s >= decided_s {
                break;
            }
            let has_ended = is_end
                || (!is_last && state.end_s <= decided_s)
                || is_over(state.end_s, decided_s, APART_S);
            let until_s = decided_s.min(state.end_s);
            let min_s = if has_ended { MIN_REST_S } else { GOES_ON_S };
            let is_row = state.action.is_some()
                && (state.row.is_some() || until_s - state.start_s >= min_s - ROUNDING_S);
            if is_row && !state.is_ended {
                if state.row.is_none()
                    && let Some(before) = before
                {
                    let change = self.states[before].change_to(state, person, next_row);
                    rows.extend(change);
                }
                rows.extend(self.states[at].report(person, until_s, !has_ended, next_row));
            }
            before = if is_row { Some(at) } else { before };
            self.states[at].is_ended |= has_ended;
        }
        rows
    }
}

impl State {
    fn extend(&mut self, span: &MeasuredSpan, n_points: u32) {
        if self.row.is_none() {
            self.action.clone_from(&span.action);
        }
        self.captions.push(self.n_windows, &span.caption);
        self.end_s = span.end_s;
        self.n_windows += 1;
        self.n_points = self.n_points.saturating_add(n_points);
    }

    /// The row until a time; `None` without an action.
    fn report(
        &mut self,
        person: u32,
        until_s: f64,
        is_open: bool,
        next_row: &mut impl FnMut() -> u64,
    ) -> Option<Row> {
        let action = self.action.clone()?;
        let caption = self.captions.middle(self.n_windows)?.clone();
        Some(Row {
            row: *self.row.get_or_insert_with(next_row),
            person,
            action,
            start_s: self.start_s,
            end_s: until_s,
            caption,
            n_windows: self.n_windows,
            n_points: self.n_points,
            is_open,
        })
    }

    /// The row of the change to the next state, if there is one.
    fn change_to(
        &self,
        next: &Self,
        person: u32,
        next_row: &mut impl FnMut() -> u64,
    ) -> Option<Row> {
        let action = change(self.action.as_deref()?, next.action.as_deref()?)?;
        if next.start_s - self.end_s > MAX_CHANGE_S {
            return None;
        }
        let ([_, from], [to, _]) = (self.captions.ends()?, next.captions.ends()?);
        Some(Row {
            row: next_row(),
            person,
            action: action.into(),
            start_s: (self.end_s - CHANGE_S).max(self.start_s),
            end_s: (next.start_s + CHANGE_S).min(next.end_s),
            caption: WindowCaption {
                text: sentence([from, to]),
                confidence: from.confidence.zip(to.confidence).map(|(a, b)| a.min(b)),
                place_m: to.place_m,
            },
            n_windows: 1,
            n_points: 0,
            is_open: false,
        })
    }
}

/// Whether a person is up at the end of a window, and stands then; `None` if it is not clear.
pub(crate) fn is_up(spans: &[MeasuredSpan]) -> Option<bool> {
    let last = spans.last()?;
    let stands = match last.action.as_deref()? {
        "stand_still" => true,
        "walk" | "pace" => false,
        _ => return None,
    };
    let is_sure = !stands || last.caption.confidence.is_some_and(|p| p >= SURE);
    (is_sure && last.end_s - last.start_s >= UP_S - ROUNDING_S).then_some(stands)
}

/// Says of somebody who fell and is not up that the person is there, where the track has it that the person sits, stands or
/// walks: it is not clear. Returns whether something was changed.
pub(crate) fn doubt_after_fall(spans: &mut [MeasuredSpan]) -> bool {
    let fall = spans
        .iter()
        .rposition(|span| span.action.as_deref() == Some(FALL));
    let after = &mut spans[fall.map_or(0, |at| at + 1)..];
    let mut is_changed = false;
    for span in after {
        let is_other = ["sit_still", "stand_still", "walk", "pace"];
        if !span
            .action
            .as_deref()
            .is_some_and(|action| is_other.contains(&action))
        {
            continue;
        }
        let distance_m = span.caption.place_m.map(|[x_m, y_m]| x_m.hypot(y_m));
        let at = distance_m.map_or(String::new(), |m| format!(", {m:.1} m away"));
        span.caption.text = format!("a person is there{at}");
        span.action = None;
        is_changed = true;
    }
    is_changed
}

/// The sentence of states with these sentences, in order of time.
pub(crate) fn sentence<'a>(captions: impl IntoIterator<Item = &'a WindowCaption>) -> String {
    let mut text = String::new();
    for WindowCaption { text: own, .. } in captions {
        match text.is_empty() {
            true => text.push_str(own),
            false if text.ends_with(own) => {}
            false => {
                text.push_str(", then ");
                text.push_str(own.strip_prefix("a person ").unwrap_or(own));
            }
        }
    }
    text
}

/// Whether two states are one where they touch: whether somebody who walks goes to and fro depends on how much of it is seen.
fn is_same(a: Option<&str>, b: Option<&str>) -> bool {
    let walks = |action: Option<&str>| matches!(action, Some("walk" | "pace"));
    a == b || (walks(a) && walks(b))
}

/// The change between two measured states: who walks or stands after sitting or lying has got up, and who sits or lies
/// afterwards has sat or lain down, unless by a fall.
fn change(before: &str, now: &str) -> Option<&'static str> {
    let is_up = |action: &str| ["walk", "pace", "stand_still"].contains(&action);
    match (before, now) {
        ("sit_still" | "lie_still", now) if is_up(now) => Some("stand_up"),
        (before, "sit_still") if is_up(before) => Some("sit_down"),
        (before, "lie_still") if is_up(before) => Some("lie_down"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use std::collections::BTreeMap;

    fn span(action: &str, start_s: f64, end_s: f64) -> MeasuredSpan {
        MeasuredSpan {
            start_s,
            end_s,
            action: (action != "there").then(|| action.into()),
            caption: WindowCaption {
                text: format!("a person: {action}"),
                confidence: Some(0.9),
                place_m: Some([0.0, 2.0]),
            },
        }
    }

    /// The window that begins 2 s after the one before and lasts 6 s.
    fn window(number: u32, spans: Vec<MeasuredSpan>) -> WindowReading {
        let start_s = 2.0 * f64::from(number);
        WindowReading {
            person: 1,
            start_s,
            end_s: start_s + 6.0,
            caption: None,
            actions: Vec::new(),
            certain: Vec::new(),
            spans,
            n_points: 100,
        }
    }

    /// Rows in the order in which they are reported. Each window measures what is given of its time.
    fn rows(windows: &[Vec<MeasuredSpan>]) -> Vec<Row> {
        let (mut timeline, mut n_rows) = (Timeline::default(), 0);
        let mut next = || {
            n_rows += 1;
            n_rows
        };
        let mut rows = Vec::new();
        for (number, spans) in (0..).zip(windows) {
            rows.extend(timeline.push(&window(number, spans.clone()), &mut next));
        }
        rows.extend(timeline.end(1, &mut next));
        rows
    }

    fn ended(rows: &[Row]) -> Vec<(&str, f64, f64)> {
        let mut ended: Vec<(&str, f64, f64)> = (rows.iter())
            .filter(|row| !row.is_open)
            .map(|row| (&row.action[..], row.start_s, row.end_s))
            .collect();
        ended.sort_by(|a, b| a.1.total_cmp(&b.1));
        ended
    }

    /// What windows measure of a day whose states are known.
    fn windows_of(day: &[MeasuredSpan], n: u32) -> Vec<Vec<MeasuredSpan>> {
        let of = |number: u32| {
            let [from_s, to_s] = [2.0 * f64::from(number), 2.0 * f64::from(number) + 6.0];
            let part = |span: &MeasuredSpan| MeasuredSpan {
                start_s: span.start_s.max(from_s),
                end_s: span.end_s.min(to_s),
                ..span.clone()
            };
            let parts = day.iter().map(part).filter(|s| s.start_s < s.end_s);
            parts.collect()
        };
        (0..n).map(of).collect()
    }

    #[test]
    fn rows_begin_and_end_with_what_is_measured_and_changes_lie_between() {
        let day = [
            span("walk", 0.0, 5.0),
            span("sit_still", 5.0, 17.0),
            span("walk", 17.0, 20.0),
            span("lie_still", 20.0, 29.0),
            span("there", 29.0, 31.0),
            span("walk", 31.0, 40.0),
            span("fall", 40.0, 42.0),
            span("lie_still", 42.0, 50.0),
        ];
        let found = rows(&windows_of(&day, 23));
        assert_eq!(
            ended(&found),
            [
                ("walk", 0.0, 5.0),
                ("sit_down", 4.0, 6.0),
                ("sit_still", 5.0, 17.0),
                ("stand_up", 16.0, 18.0),
                ("walk", 17.0, 20.0),
                ("lie_down", 19.0, 21.0),
                ("lie_still", 20.0, 29.0),
                // When somebody got up is known within the two seconds in which it is not known what the person did.
                ("stand_up", 28.0, 32.0),
                ("walk", 31.0, 40.0),
                // A fall is no lying down.
                ("fall", 40.0, 42.0),
                ("lie_still", 42.0, 50.0),
            ]
        );
        let sits = found.iter().rfind(|row| row.action == "sit_down").unwrap();
        assert_eq!(
            sits.caption.text,
            "a person: walk, then a person: sit_still"
        );
        // Somebody who was not measured for long may have got up at any time.
        let apart = [span("sit_still", 0.0, 6.0), span("walk", 12.0, 20.0)];
        let found = rows(&windows_of(&apart, 8));
        assert_eq!(
            ended(&found),
            [("sit_still", 0.0, 6.0), ("walk", 12.0, 20.0)]
        );
    }

    #[test]
    fn the_last_seconds_of_a_window_are_decided_by_the_next_one() {
        // At 6 s the person seems to walk already; the next windows have it that the person stood until 6.5 s, and a later
        // one until 6 s.
        let windows = [
            vec![span("stand_still", 0.0, 5.0), span("walk", 5.0, 6.0)],
            vec![span("stand_still", 2.0, 6.5), span("walk", 6.5, 8.0)],
            vec![span("stand_still", 4.0, 6.5), span("walk", 6.5, 10.0)],
            // What was decided stays.
            vec![span("walk", 6.0, 12.0)],
            vec![span("stand_still", 8.0, 14.0)],
        ];
        let found = rows(&windows);
        assert_eq!(
            ended(&found),
            [
                ("stand_still", 0.0, 6.0),
                ("walk", 6.0, 8.0),
                ("stand_still", 8.0, 14.0)
            ]
        );
        // Reported while it goes on, as far as it is decided.
        let open: Vec<(u64, f64, f64)> = (found.iter())
            .filter(|row| row.is_open)
            .map(|row| (row.row, row.start_s, row.end_s))
            .collect();
        assert_eq!(open[..3], [(1, 0.0, 2.0), (1, 0.0, 4.0), (1, 0.0, 6.0)]);
        // To and fro or not is one walk.
        let walks = [
            vec![span("walk", 0.0, 6.0)],
            vec![span("pace", 2.0, 8.0)],
            vec![span("walk", 4.0, 10.0)],
        ];
        assert_eq!(ended(&rows(&walks)), [("walk", 0.0, 10.0)]);
    }

    #[test]
    fn windows_without_a_measurement_are_bridged_for_two_seconds() {
        let sits = |number: u32| {
            let start_s = 2.0 * f64::from(number);
            vec![span("sit_still", start_s, start_s + 6.0)]
        };
        let found = rows(&[sits(0), sits(1), Vec::new(), sits(3), sits(4)]);
        assert_eq!(ended(&found), [("sit_still", 0.0, 14.0)]);
        let none = Vec::new;
        let found = rows(&[sits(0), sits(1), none(), none(), none(), none(), sits(6)]);
        assert_eq!(
            ended(&found),
            [("sit_still", 0.0, 8.0), ("sit_still", 12.0, 18.0)]
        );
    }

    #[test]
    fn a_posture_is_known_for_a_minute_and_an_hour_takes_little_memory() {
        let (mut timeline, mut n_rows) = (Timeline::default(), 0);
        let mut next = || {
            n_rows += 1;
            n_rows
        };
        for number in 0..1_800u32 {
            let reading = window(number, Vec::new());
            let action = ["walk", "sit_still"][(number / 4 % 2) as usize];
            let spans = vec![span(action, reading.start_s, reading.end_s)];
            timeline.push(&WindowReading { spans, ..reading }, &mut next);
            assert!(timeline.states.len() < 20, "{}", timeline.states.len());
        }
        let end_s = 3_604.0;
        assert!(timeline.action_at(end_s - 40.0).is_some());
        assert_eq!(timeline.action_at(end_s + MAX_GAP_S), Some("sit_still"));
        assert_eq!(timeline.action_at(end_s + MAX_GAP_S + 0.1), None);
    }

    #[test]
    fn who_fell_and_is_not_up_is_there() {
        let said = |mut spans: Vec<MeasuredSpan>| {
            let is_changed = doubt_after_fall(&mut spans);
            let actions = spans.iter().filter_map(|s| s.action.clone());
            (
                is_changed,
                actions.collect::<Vec<_>>(),
                sentence(spans.iter().map(|s| &s.caption)),
            )
        };
        let sits = span("sit_still", 2.0, 6.0);
        let (is_changed, actions, text) = said(vec![span("fall", 0.0, 2.0), sits.clone()]);
        assert!(is_changed);
        assert_eq!(actions, ["fall"]);
        assert_eq!(text, "a person: fall, then is there, 2.0 m away");
        let lies = span("lie_still", 2.0, 6.0);
        assert!(!said(vec![span("fall", 0.0, 2.0), lies]).0);
        // Before the fall, the person was up.
        let (is_changed, actions, _) = said(vec![span("walk", 0.0, 3.0), span("fall", 3.0, 5.0)]);
        assert!(!is_changed);
        assert_eq!(actions, ["walk", "fall"]);
        let (_, actions, text) = said(vec![span("fall", 0.0, 2.0), span("walk", 2.0, 4.0)]);
        assert_eq!(actions, ["fall"]);
        assert_eq!(text, "a person: fall, then is there, 2.0 m away");
        // Long enough, it is clear.
        let end = |span: MeasuredSpan| is_up(&[span]);
        assert_eq!(end(span("walk", 2.0, 5.0)), Some(false));
        assert_eq!(end(span("stand_still", 2.0, 5.0)), Some(true));
        assert_eq!(end(span("walk", 2.0, 4.0)), None);
        assert_eq!(end(sits), None);
        let mut doubtful = span("stand_still", 2.0, 6.0);
        doubtful.caption.confidence = Some(0.7);
        assert_eq!(end(doubtful), None);
    }

    proptest! {
        #[test]
        fn a_person_does_one_thing_at_a_time_and_rows_only_grow(
            windows in prop::collection::vec(prop::collection::vec((0usize..5, 0.0..6.0f64, 0.1..6.0f64), 0..4), 0..60),
        ) {
            const ACTIONS: [&str; 5] = ["walk", "sit_still", "lie_still", "fall", "there"];
            let measured: Vec<Vec<MeasuredSpan>> = (0..).zip(&windows).map(|(number, spans)| {
                let start_s = 2.0 * f64::from(number);
                let mut from_s: f64 = 0.0;
                let mut all = Vec::new();
                for (action, at_s, length_s) in spans {
                    let (begins_s, ends_s) = (from_s.max(*at_s), (from_s.max(*at_s) + length_s).min(6.0));
                    if begins_s < ends_s {
                        all.push(span(ACTIONS[*action], start_s + begins_s, start_s + ends_s));
                        from_s = ends_s;
                    }
                }
                all
            }).collect();
            let mut known: BTreeMap<u64, Row> = BTreeMap::new();
            for row in rows(&measured) {
                prop_assert!(row.start_s < row.end_s);
                if let Some(before) = known.get(&row.row) {
                    prop_assert!(before.is_open);
                    prop_assert_eq!(&before.action, &row.action);
                    prop_assert_eq!(before.start_s, row.start_s);
                    prop_assert!(before.end_s <= row.end_s && before.n_windows <= row.n_windows);
                }
                known.insert(row.row, row);
            }
            prop_assert!(known.values().all(|row| !row.is_open));
            let changes = ["stand_up", "sit_down", "lie_down"];
            let states: Vec<&Row> = known.values().filter(|row| !changes.contains(&&row.action[..])).collect();
            for (i, one) in states.iter().enumerate() {
                for other in &states[i + 1..] {
                    prop_assert!(one.end_s <= other.start_s || other.end_s <= one.start_s, "{one:?} {other:?}");
                }
            }
        }
    }
}
