//! What people do: labels and rows of a timeline, from sentences of overlapping windows.
//!
//! A window is 6 s long, and one begins every 2 s. Its sentence is divided into clauses ("first A and then B"), and each
//! clause states an action. Of 163 actions in 32 simulated streams, such windows state 162, and two that were not
//! there; windows of 6 s that do not overlap state 149, those of 9.6 s four in five.
//!
//! A **row** is an action in a run of windows; one window between that does not state it, or states nothing, is bridged.
//! As all windows of the run contain the action, it is from the start of the last window to the end of the first one. If
//! these do not overlap, the action goes on, and the row is from the start of the first window to the end of the last
//! one. The row has the sentence of the middle window. What is measured has times of its own, and rows by those
//! ([`measured`](crate::measured)).
//!
//! A short row is reported once, when its run has ended, because its start moves until then. A row that goes on is
//! reported as soon as it is known to go on, and again whenever it grows; then its start stays and its end only moves
//! ahead.
//!
//! The **label** of a person is the action of the last clause. It is published when two successive windows agree, and at
//! once if it is measured. While they do not, the former label stays for 4 s if the newest sentence still states it;
//! otherwise the label is `unsure`.

use std::collections::BTreeMap;

use radarllm_facts::parse;

use crate::clock::MAX_GAP_S;
use crate::measured::{MeasuredSpan, Timeline};
use crate::options::{OptionError, has_passed, is_over, within};
use crate::rows::Activity;

/// Longest row, s: half of the longest activity of the memory.
pub const MAX_ROW_S: f64 = 43_200.0;
/// Windows that may be missing within a run.
const BRIDGED: u32 = 1;
/// Most actions of a window that are looked at. A sentence states one to three.
pub const MAX_ACTIONS: usize = 8;
/// Time after the end of the last window after which a person's rows end, s, when windows of others go on.
const LOST_S: f64 = 30.0;
/// Most sentences that are remembered of a run. Of longer runs every second one is kept, then every fourth, and so on.
const MAX_SAMPLES: usize = 64;

/// Options of labels and rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActivityOptions {
    /// Fewest windows that must state an action for a row, unless it is certain.
    pub min_windows: u32,
    /// Time for which a label stays while windows do not agree, s.
    pub label_hold_s: f64,
}

impl Default for ActivityOptions {
    fn default() -> Self {
        Self {
            min_windows: 1,
            label_hold_s: 4.0,
        }
    }
}

impl ActivityOptions {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that is out of range.
    pub fn validate(&self) -> Result<(), OptionError> {
        within(
            "min_windows",
            f64::from(self.min_windows),
            [1.0, 100.0],
            "1 to 100",
        )?;
        within(
            "label_hold_s",
            self.label_hold_s,
            [0.0, 3_600.0],
            "0 to 3600 s",
        )
    }
}

/// What the model says about a person in a window.
#[derive(Clone, Debug, PartialEq)]
pub struct WindowReading {
    /// Number of the track.
    pub person: u32,
    /// Start of the window, s.
    pub start_s: f64,
    /// End of the window, s.
    pub end_s: f64,
    /// The sentence; `None` if the model abstained.
    pub caption: Option<WindowCaption>,
    /// Actions of the clauses of the sentence, in order of time.
    pub actions: Vec<String>,
    /// Those of the actions that something else than the sentence shows as well: for their rows one window is enough.
    pub certain: Vec<String>,
    /// What was measured, in order of time: its rows begin and end then.
    pub spans: Vec<MeasuredSpan>,
    /// Number of the person's points.
    pub n_points: u32,
}

/// A sentence about a window.
#[derive(Clone, Debug, PartialEq)]
pub struct WindowCaption {
    /// The sentence.
    pub text: String,
    /// Its confidence, 0 to 1.
    pub confidence: Option<f64>,
    /// Where the person was, m.
    pub place_m: Option<[f64; 2]>,
}

/// Actions of the clauses of a sentence by its words, in order of time: for models without a namer of their own.
///
/// ```
/// use radarllm_monitor::activities::actions_of;
///
/// assert_eq!(actions_of("a person walks forward, then sits down"), ["walk", "sit_down"]);
/// ```
pub fn actions_of(caption: &str) -> Vec<String> {
    let clauses = parse(caption);
    let first = clauses.iter().filter_map(|clause| clause.actions.first());
    first.map(|action| action.name.to_string()).collect()
}

/// What somebody does now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Label {
    /// Nobody is tracked.
    Nobody,
    /// Somebody is tracked, but too little is seen for a sentence.
    Unseen,
    /// The windows do not agree.
    Unsure,
    /// An action, for example `walk`.
    Action(String),
}

impl Label {
    /// The name of the action, or `nobody`, `unseen`, `unsure`.
    pub fn name(&self) -> &str {
        match self {
            Self::Nobody => "nobody",
            Self::Unseen => "unseen",
            Self::Unsure => "unsure",
            Self::Action(action) => action,
        }
    }
}

/// A row of the timeline, as far as it is known.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Number of the row, from 1. A row that is reported again has the same number.
    pub row: u64,
    /// Number of the track.
    pub person: u32,
    /// The action.
    pub action: String,
    /// Start, s.
    pub start_s: f64,
    /// End, s.
    pub end_s: f64,
    /// The sentence of the middle window.
    pub caption: WindowCaption,
    /// Number of windows that state the action.
    pub n_windows: u32,
    /// Number of points in these windows; those in two windows count twice.
    pub n_points: u32,
    /// Whether the row may still grow.
    pub is_open: bool,
}

impl Row {
    /// The row as the memory keeps it. `utc_ms` gives the time of day of a time of the stream, for example
    /// [`StreamClock::utc_ms`](crate::clock::StreamClock::utc_ms).
    pub fn activity(&self, utc_ms: impl Fn(f64) -> i64) -> Activity {
        let start_ms = utc_ms(self.start_s);
        Activity {
            start_ms,
            end_ms: utc_ms(self.end_s).max(start_ms),
            person: self.person,
            action: self.action.clone(),
            caption: self.caption.text.clone(),
            confidence: self.caption.confidence,
            windows: self.n_windows,
            points: self.n_points,
            place_m: self.caption.place_m,
        }
    }
}

/// Labels and rows of all people.
#[derive(Clone, Debug)]
pub struct Activities {
    options: ActivityOptions,
    people: BTreeMap<u32, Person>,
    n_rows: u64,
}

/// What is remembered of a person.
#[derive(Clone, Debug, Default)]
struct Person {
    runs: Vec<Run>,
    /// Start and end of the last window.
    window_s: Option<[f64; 2]>,
    n_points: u32,
    /// Whether the model abstained in the last window.
    is_unseen: bool,
    /// Action of the last clause of the last window.
    last: Option<String>,
    /// The published action, and the end of the last window that confirmed it.
    published: Option<(String, f64)>,
    /// The actions that the label may name: those of the last sentence, and of a measured one the last.
    stated: Vec<String>,
    measured: Timeline,
}

/// An action in windows of which at most [`BRIDGED`] in succession do not state it.
#[derive(Clone, Debug)]
struct Run {
    action: String,
    /// Number of the row, if it was reported.
    row: Option<u64>,
    first_s: [f64; 2],
    last_s: [f64; 2],
    n_windows: u32,
    n_points: u32,
    n_missing: u32,
    is_certain: bool,
    captions: Samples,
}

/// Evenly spaced sentences of a run, at most [`MAX_SAMPLES`].
#[derive(Clone, Debug, Default)]
pub(crate) struct Samples {
    kept: Vec<(u32, WindowCaption)>,
    /// Every 2^n-th sentence is kept.
    doublings: u32,
}

impl Activities {
    /// Nobody has done anything yet.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn new(options: ActivityOptions) -> Result<Self, OptionError> {
        options.validate()?;
        Ok(Self {
            options,
            people: BTreeMap::new(),
            n_rows: 0,
        })
    }

    /// The reading of the next window of a person. Returns rows that have begun, grown or ended. A window that is not
    /// later than the person's last one is left out.
    pub fn push(&mut self, reading: &WindowReading) -> Vec<Row> {
        let [start_s, end_s] = [reading.start_s, reading.end_s];
        let is_span = start_s.is_finite() && end_s.is_finite() && start_s < end_s;
        let known = self.people.get(&reading.person);
        let last_s = known.and_then(|person| person.window_s);
        if !is_span || last_s.is_some_and(|last_s| start_s <= last_s[0]) {
            return Vec::new();
        }
        let mut rows = self.end_lost(end_s);
        if last_s.is_some_and(|last_s| is_over(last_s[1], start_s, MAX_GAP_S)) {
            rows.extend(self.end_person(reading.person));
        }
        let person = self.people.entry(reading.person).or_default();
        person.relabel(reading);
        let mut ended = person.extend_runs(reading);
        let (options, n_rows) = (&self.options, &mut self.n_rows);
        rows.extend(
            ended
                .iter_mut()
                .filter_map(|run| run.report(reading.person, false, options, n_rows)),
        );
        let grown = person
            .runs
            .iter_mut()
            .filter(|run| run.n_missing == 0 && run.goes_on());
        rows.extend(grown.filter_map(|run| run.report(reading.person, true, options, n_rows)));
        rows.extend((person.measured).push(reading, &mut || next_row(n_rows)));
        rows
    }

    /// The action that was measured of a person at a time; at the end of the last one, if the time is later by less than a gap.
    pub fn measured_at(&self, person: u32, t_s: f64) -> Option<&str> {
        self.people.get(&person)?.measured.action_at(t_s)
    }

    /// Somebody has another number from now on, as after a track was lost: what the person does goes on. Rows of a former
    /// person of this number end.
    pub fn rename(&mut self, person: u32, number: u32) -> Vec<Row> {
        if person == number || !self.people.contains_key(&person) {
            return Vec::new();
        }
        let rows = self.end_person(number);
        if let Some(known) = self.people.remove(&person) {
            self.people.insert(number, known);
        }
        rows
    }

    /// Ends the rows of a person who is not tracked any more.
    pub fn end_person(&mut self, person: u32) -> Vec<Row> {
        let Some(mut gone) = self.people.remove(&person) else {
            return Vec::new();
        };
        let (options, n_rows) = (&self.options, &mut self.n_rows);
        let runs = gone.runs.iter_mut();
        let mut rows: Vec<Row> = runs
            .filter_map(|run| run.report(person, false, options, n_rows))
            .collect();
        rows.extend((gone.measured).end(person, &mut || next_row(n_rows)));
        rows
    }

    /// Ends all rows, as before a gap of the stream and at its end.
    pub fn end_all(&mut self) -> Vec<Row> {
        let people: Vec<u32> = self.people.keys().copied().collect();
        people
            .into_iter()
            .flat_map(|p| self.end_person(p))
            .collect()
    }

    /// What a person does at `t_s`.
    pub fn label(&self, person: u32, t_s: f64) -> Label {
        let Some(person) = self.people.get(&person) else {
            return Label::Unsure;
        };
        if person.is_unseen {
            return Label::Unseen;
        }
        match &person.published {
            Some((action, at_s))
                if person.stated.contains(action)
                    && !has_passed(*at_s, t_s, self.options.label_hold_s) =>
            {
                Label::Action(action.clone())
            }
            _ => Label::Unsure,
        }
    }

    /// What is done in the room at `t_s`, where these people are tracked: the label of whoever had the most points in
    /// the last window.
    pub fn label_of_room(&self, tracked: &[u32], t_s: f64) -> Label {
        let n_points = |person: &&u32| self.people.get(person).map_or(0, |p| p.n_points);
        // Of equals, the one with the smallest number, who has been there longest.
        let best = tracked
            .iter()
            .min_by_key(|person| (u32::MAX - n_points(person), **person));
        best.map_or(Label::Nobody, |person| self.label(*person, t_s))
    }

    /// Ends rows of people who have had no window for long.
    fn end_lost(&mut self, now_s: f64) -> Vec<Row> {
        let is_lost = |p: &Person| {
            p.window_s
                .is_some_and(|[_, end_s]| is_over(end_s, now_s, LOST_S))
        };
        let people = self.people.iter().filter(|(_, p)| is_lost(p));
        let people: Vec<u32> = people.map(|(number, _)| *number).collect();
        people
            .into_iter()
            .flat_map(|p| self.end_person(p))
            .collect()
    }
}

/// The number of the next row.
fn next_row(n_rows: &mut u64) -> u64 {
    *n_rows += 1;
    *n_rows
}

impl WindowReading {
    /// Whether an action was measured, with its times.
    pub(crate) fn is_measured(&self, action: &str) -> bool {
        let mut spans = self.spans.iter();
        spans.any(|span| span.action.as_deref() == Some(action))
    }

    /// The action at the end of the window, and whether it was measured.
    fn last_action(&self) -> Option<(&str, bool)> {
        let stated = self.actions.last().filter(|_| self.caption.is_some())?;
        match self.spans.last() {
            // The person is still there, and no more is known.
            Some(last) if last.action.is_none() && self.is_measured(stated) => None,
            Some(last) => Some((stated, last.action.as_ref() == Some(stated))),
            None => Some((stated, false)),
        }
    }
}

impl Person {
    fn relabel(&mut self, reading: &WindowReading) {
        self.window_s = Some([reading.start_s, reading.end_s]);
        self.n_points = reading.n_points;
        self.is_unseen = reading.caption.is_none();
        let last = reading.last_action();
        if let Some((action, is_measured)) = last {
            let is_former = self.published.as_ref().is_some_and(|(a, _)| a == action);
            if is_measured || is_former || self.last.as_deref() == Some(action) {
                self.published = Some((action.into(), reading.end_s));
            }
        }
        self.stated = match reading.spans.is_empty() {
            true => reading.actions.clone(),
            false => last.iter().map(|(action, _)| (*action).into()).collect(),
        };
        self.last = last.map(|(action, _)| action.into());
    }

    /// Adds a window to the runs. Returns the runs that have ended.
    fn extend_runs(&mut self, reading: &WindowReading) -> Vec<Run> {
        let mut actions: &[String] = match reading.caption {
            Some(_) => &reading.actions,
            None => &[],
        };
        actions = &actions[..actions.len().min(MAX_ACTIONS)];
        for run in &mut self.runs {
            run.n_missing += 1;
        }
        let mut ended = Vec::new();
        for (i, action) in actions.iter().enumerate() {
            let is_other = actions[..i].contains(action) || reading.is_measured(action);
            let (Some(caption), false) = (&reading.caption, is_other) else {
                continue;
            };
            let found = self.runs.iter().position(|run| &run.action == action);
            match found {
                Some(at) if !self.runs[at].ends_before(reading) => {
                    self.runs[at].extend(reading, caption);
                }
                _ => {
                    ended.extend(found.map(|at| self.runs.remove(at)));
                    self.runs.push(Run::new(action, reading, caption));
                }
            }
        }
        ended.extend(self.runs.extract_if(.., |run| run.n_missing > BRIDGED));
        ended
    }
}

impl Run {
    fn new(action: &str, reading: &WindowReading, caption: &WindowCaption) -> Self {
        let window_s = [reading.start_s, reading.end_s];
        let mut run = Self {
            action: action.to_string(),
            row: None,
            first_s: window_s,
            last_s: window_s,
            n_windows: 0,
            n_points: 0,
            n_missing: 0,
            is_certain: false,
            captions: Samples::default(),
        };
        run.extend(reading, caption);
        run
    }

    fn extend(&mut self, reading: &WindowReading, caption: &WindowCaption) {
        self.captions.push(self.n_windows, caption);
        self.last_s = [reading.start_s, reading.end_s.max(self.last_s[1])];
        self.n_windows += 1;
        self.n_points = self.n_points.saturating_add(reading.n_points);
        self.n_missing = 0;
        self.is_certain |= reading.certain.contains(&self.action);
    }

    /// Whether the row would be too long with a window, which begins another one.
    fn ends_before(&self, reading: &WindowReading) -> bool {
        is_over(self.first_s[0], reading.end_s, MAX_ROW_S)
    }

    /// Whether the first and the last window do not overlap.
    fn goes_on(&self) -> bool {
        has_passed(self.first_s[1], self.last_s[0], 0.0)
    }

    fn span_s(&self) -> [f64; 2] {
        match self.goes_on() {
            true => [self.first_s[0], self.last_s[1]],
            false => [self.last_s[0], self.first_s[1]],
        }
    }

    fn report(
        &mut self,
        person: u32,
        is_open: bool,
        options: &ActivityOptions,
        n_rows: &mut u64,
    ) -> Option<Row> {
        if self.n_windows < options.min_windows && !self.is_certain {
            return None;
        }
        let caption = self.captions.middle(self.n_windows)?.clone();
        let row = *self.row.get_or_insert_with(|| next_row(n_rows));
        let [start_s, end_s] = self.span_s();
        Some(Row {
            row,
            person,
            action: self.action.clone(),
            start_s,
            end_s,
            caption,
            n_windows: self.n_windows,
            n_points: self.n_points,
            is_open,
        })
    }
}

impl Samples {
    pub(crate) fn push(&mut self, number: u32, caption: &WindowCaption) {
        if !number.is_multiple_of(self.stride()) {
            return;
        }
        self.kept.push((number, caption.clone()));
        if self.kept.len() > MAX_SAMPLES {
            self.doublings += 1;
            let stride = self.stride();
            self.kept
                .retain(|(number, _)| number.is_multiple_of(stride));
        }
    }

    fn stride(&self) -> u32 {
        1 << self.doublings.min(31)
    }

    /// The first sentence, and the last one that is kept.
    pub(crate) fn ends(&self) -> Option<[&WindowCaption; 2]> {
        let ends = self.kept.first().zip(self.kept.last());
        ends.map(|((_, first), (_, last))| [first, last])
    }

    /// The sentence nearest to the middle of `n` windows; of two, the former.
    pub(crate) fn middle(&self, n: u32) -> Option<&WindowCaption> {
        let middle = n.saturating_sub(1) / 2;
        let nearest = self.kept.iter().min_by_key(|(i, _)| i.abs_diff(middle))?;
        Some(&nearest.1)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn reading(number: u32, actions: &[&str]) -> WindowReading {
        let start_s = 2.0 * f64::from(number);
        WindowReading {
            person: 1,
            start_s,
            end_s: start_s + 6.0,
            caption: Some(WindowCaption {
                text: format!("window {number}"),
                confidence: Some(0.6),
                place_m: Some([0.0, 2.0]),
            }),
            actions: actions.iter().map(|a| (*a).to_string()).collect(),
            certain: Vec::new(),
            spans: Vec::new(),
            n_points: 100,
        }
    }

    fn abstained(number: u32) -> WindowReading {
        WindowReading {
            caption: None,
            ..reading(number, &[])
        }
    }

    fn activities() -> Activities {
        Activities::new(ActivityOptions::default()).unwrap()
    }

    /// Rows of windows, one window for each letter string; each letter is an action. The end ends all rows.
    fn rows(windows: &[&str]) -> Vec<Row> {
        let mut activities = activities();
        let mut rows = Vec::new();
        for (i, letters) in windows.iter().enumerate() {
            let actions: Vec<String> = letters.chars().map(String::from).collect();
            let actions: Vec<&str> = actions.iter().map(String::as_str).collect();
            rows.extend(activities.push(&reading(i as u32, &actions)));
        }
        rows.extend(activities.end_all());
        rows
    }

    fn spans(windows: &[&str]) -> Vec<(String, f64, f64, u32)> {
        let ended = rows(windows).into_iter().filter(|row| !row.is_open);
        let mut spans: Vec<_> = ended
            .map(|row| (row.action, row.start_s, row.end_s, row.n_windows))
            .collect();
        spans.sort_by(|a, b| a.1.total_cmp(&b.1));
        spans
    }

    fn span(action: &str, start_s: f64, end_s: f64, n_windows: u32) -> (String, f64, f64, u32) {
        (action.to_string(), start_s, end_s, n_windows)
    }

    #[test]
    fn a_short_action_is_where_its_windows_overlap() {
        assert_eq!(spans(&["", "f", "", ""]), [span("f", 2.0, 8.0, 1)]);
        assert_eq!(spans(&["", "f", "f", "", ""]), [span("f", 4.0, 8.0, 2)]);
        assert_eq!(spans(&["", "f", "f", "f", ""]), [span("f", 6.0, 8.0, 3)]);
        // The first and the last window touch: the action goes on.
        assert_eq!(spans(&["w", "w", "w", "w"]), [span("w", 0.0, 12.0, 4)]);
        let found = spans(&["w", "ws", "ws", "ws", "s"]);
        assert_eq!(found, [span("w", 0.0, 12.0, 4), span("s", 2.0, 14.0, 4)]);
        assert!(spans(&["", "", ""]).is_empty());
    }

    #[test]
    fn a_gap_of_one_window_is_bridged_and_two_end_a_row() {
        assert_eq!(spans(&["w", "", "w", "w", "w"]), [span("w", 0.0, 14.0, 4)]);
        let found = spans(&["w", "", "", "w"]);
        assert_eq!(found, [span("w", 0.0, 6.0, 1), span("w", 6.0, 12.0, 1)]);
        // Twice in one sentence is once.
        assert_eq!(spans(&["wsw"]).len(), 2);
        // Abstention is a gap.
        let mut activities = activities();
        activities.push(&reading(0, &["w"]));
        assert!(activities.push(&abstained(1)).is_empty());
        assert_eq!(activities.push(&abstained(2)).len(), 1);
    }

    #[test]
    fn a_row_that_goes_on_is_reported_when_it_grows_with_one_start() {
        let found = rows(&["w", "w", "w", "w", "w", "s", "s"]);
        let summary: Vec<(u64, &str, f64, f64, bool)> = found
            .iter()
            .map(|r| (r.row, &r.action[..], r.start_s, r.end_s, r.is_open))
            .collect();
        assert_eq!(
            summary,
            [
                (1, "w", 0.0, 12.0, true),
                (1, "w", 0.0, 14.0, true),
                (1, "w", 0.0, 14.0, false),
                (2, "s", 12.0, 16.0, false),
            ]
        );
        // The sentence of the middle window, and all points.
        assert_eq!(found[2].caption.text, "window 2");
        assert_eq!((found[2].n_windows, found[2].n_points), (5, 500));
        assert_eq!(found[0].caption.text, "window 1");
    }

    #[test]
    fn rows_have_the_time_of_day_in_the_memory() {
        let found = rows(&["w", "w", "w", "w", "w"]);
        let utc_ms = |t_s: f64| 1_000_000 + (t_s * 1e3) as i64;
        let activity = found[0].activity(utc_ms);
        assert_eq!((activity.start_ms, activity.end_ms), (1_000_000, 1_012_000));
        assert_eq!((activity.windows, activity.points), (4, 400));
    }

    #[test]
    fn fewer_windows_than_asked_for_are_no_row() {
        let options = ActivityOptions {
            min_windows: 2,
            ..ActivityOptions::default()
        };
        let mut activities = Activities::new(options).unwrap();
        for (i, action) in ["a", "b", "b", "c"].iter().enumerate() {
            assert!(activities.push(&reading(i as u32, &[action])).is_empty());
        }
        let found = activities.end_all();
        assert_eq!(found.len(), 1);
        assert_eq!((&found[0].action[..], found[0].row), ("b", 1));
        // Unless something else shows it.
        let mut activities = Activities::new(options).unwrap();
        activities.push(&WindowReading {
            certain: vec!["a".into()],
            ..reading(0, &["a", "b"])
        });
        let found = activities.end_all();
        assert_eq!((found.len(), &found[0].action[..]), (1, "a"));
        let options = ActivityOptions {
            min_windows: 0,
            ..options
        };
        assert_eq!(Activities::new(options).unwrap_err().field, "min_windows");
    }

    #[test]
    fn another_number_is_the_same_person() {
        let mut activities = activities();
        activities.push(&reading(0, &["w"]));
        assert!(activities.rename(1, 1).is_empty() && activities.rename(5, 1).is_empty());
        assert!(activities.rename(1, 2).is_empty());
        let second = WindowReading {
            person: 2,
            ..reading(1, &["w"])
        };
        assert!(activities.push(&second).is_empty());
        assert_eq!(activities.label(2, second.end_s).name(), "w");
        let found = activities.end_all();
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].person, found[0].n_windows), (2, 2));
    }

    #[test]
    fn gaps_of_the_stream_end_rows() {
        let mut activities = activities();
        activities.push(&reading(0, &["w"]));
        // The next window begins 2 s after the end of the last one, then more than 2 s.
        let found = activities.push(&reading(4, &["w"]));
        assert_eq!((found.len(), found[0].row, found[0].is_open), (1, 1, true));
        let mut next = reading(8, &["w"]);
        next.start_s += 0.1;
        let found = activities.push(&next);
        assert_eq!((found.len(), found[0].row, found[0].is_open), (1, 1, false));
        assert_eq!((found[0].start_s, found[0].end_s), (0.0, 14.0));
        // Other people's windows end the rows of whoever has none.
        let mut other = reading(24, &["s"]);
        other.person = 2;
        let found = activities.push(&other);
        assert_eq!((found.len(), found[0].person, found[0].row), (1, 1, 2));
        assert_eq!(activities.end_person(2).len(), 1);
        assert!(activities.end_person(2).is_empty() && activities.end_all().is_empty());
    }

    #[test]
    fn windows_out_of_order_or_at_no_time_are_left_out() {
        let mut activities = activities();
        activities.push(&reading(5, &["w"]));
        let mut wrong = vec![reading(5, &["s"]), reading(4, &["s"])];
        for (start_s, end_s) in [
            (f64::NAN, 30.0),
            (30.0, f64::INFINITY),
            (30.0, 30.0),
            (40.0, 30.0),
        ] {
            wrong.push(WindowReading {
                start_s,
                end_s,
                ..reading(9, &["s"])
            });
        }
        for reading in &wrong {
            assert!(activities.push(reading).is_empty());
        }
        assert_eq!(activities.end_all().len(), 1);
    }

    #[test]
    fn a_label_is_published_when_two_windows_agree() {
        let mut activities = activities();
        // Each window ends at 6 s + 2 s n; the label at that moment.
        for (i, (action, expected)) in [
            ("walk", "unsure"),
            ("walk", "walk"),
            ("wave", "unsure"),
            ("walk", "walk"), // the former one again
            ("turn", "unsure"),
            ("turn", "turn"),
            ("walk", "unsure"),
            ("walk", "walk"),
        ]
        .iter()
        .enumerate()
        {
            let reading = reading(i as u32, &["bow", action]);
            activities.push(&reading);
            let label = activities.label(1, reading.end_s);
            assert_eq!(label.name(), *expected, "window {i}");
        }
        // The former label stays for 4 s while the sentence still states it.
        for (i, expected) in [(8, "walk"), (9, "unsure")] {
            let reading = reading(i, &["walk", ["bow", "wave"][i as usize - 8]]);
            activities.push(&reading);
            let label = activities.label(1, reading.end_s);
            assert_eq!(label.name(), expected, "window {i}");
        }
        // Without windows, the label is unsure after 4 s.
        for i in [10, 11] {
            activities.push(&reading(i, &["walk"]));
        }
        let end_s = 22.0 + 6.0;
        assert_eq!(activities.label(1, end_s + 3.9).name(), "walk");
        assert_eq!(activities.label(1, end_s + 4.0), Label::Unsure);
        activities.push(&abstained(12));
        assert_eq!(activities.label(1, 30.0), Label::Unseen);
        // Two sentences that state nothing agree in nothing.
        activities.push(&reading(13, &[]));
        activities.push(&reading(14, &[]));
        assert_eq!(activities.label(1, 34.0), Label::Unsure);
    }

    #[test]
    fn the_room_has_the_label_of_the_person_with_most_points() {
        let mut activities = activities();
        for i in 0..2 {
            activities.push(&reading(i, &["walk"]));
            let other = WindowReading {
                person: 2,
                n_points: 101,
                ..reading(i, &["sit_down"])
            };
            activities.push(&other);
        }
        assert_eq!(activities.label_of_room(&[], 8.0), Label::Nobody);
        assert_eq!(activities.label_of_room(&[1], 8.0).name(), "walk");
        assert_eq!(activities.label_of_room(&[1, 2], 8.0).name(), "sit_down");
        assert_eq!(activities.label_of_room(&[7], 8.0), Label::Unsure);
        assert_eq!(activities.label_of_room(&[7, 1], 8.0).name(), "walk");
    }

    #[test]
    fn the_middle_of_a_long_run_is_near_its_middle() {
        let mut samples = Samples::default();
        for i in 0..100_000u32 {
            let mut caption = reading(i, &[]).caption.unwrap();
            caption.text = i.to_string();
            samples.push(i, &caption);
            let found: u32 = samples.middle(i + 1).unwrap().text.parse().unwrap();
            // Exact while all are kept, else within half a distance of two.
            let max = if i < 64 { 0 } else { samples.stride() / 2 };
            assert!(found.abs_diff(i / 2) <= max, "{found} of {i}");
            assert!(samples.kept.len() <= MAX_SAMPLES);
        }
    }

    #[test]
    fn a_day_of_one_action_is_two_rows_and_little_memory() {
        let mut activities = activities();
        let mut numbers = std::collections::BTreeSet::new();
        let mut longest_s: f64 = 0.0;
        for i in 0..43_200 {
            for row in activities.push(&reading(i, &["lie_still"])) {
                numbers.insert(row.row);
                longest_s = longest_s.max(row.end_s - row.start_s);
            }
            let person = &activities.people[&1];
            assert!(person.runs.len() == 1 && person.runs[0].captions.kept.len() <= MAX_SAMPLES);
        }
        numbers.extend(activities.end_all().into_iter().map(|row| row.row));
        assert_eq!(numbers.len(), 3, "12 h, 12 h and the last windows");
        assert_eq!(longest_s, MAX_ROW_S);
        // People who come and go without a word.
        for i in 0..43_200u32 {
            let reading = WindowReading {
                person: i,
                ..reading(43_200 + i, &["walk"])
            };
            activities.push(&reading);
            assert!(activities.people.len() <= 20);
        }
    }

    proptest! {
        #[test]
        fn a_row_that_is_reported_again_only_grows(
            windows in prop::collection::vec((1u32..3, prop::collection::vec(0usize..4, 0..4), 1u32..4), 0..80),
        ) {
            let mut activities = activities();
            let mut known: BTreeMap<u64, Row> = BTreeMap::new();
            let mut reported = Vec::new();
            let mut number = 0;
            for (person, actions, step) in windows {
                number += step;
                let names: Vec<&str> = actions.iter().map(|i| ["walk", "sit_down", "fall", "wave"][*i]).collect();
                reported.extend(activities.push(&WindowReading { person, ..reading(number, &names) }));
            }
            reported.extend(activities.end_all());
            for row in reported {
                prop_assert!(row.start_s < row.end_s);
                if let Some(before) = known.get(&row.row) {
                    prop_assert!(before.is_open);
                    prop_assert_eq!((before.person, &before.action), (row.person, &row.action));
                    prop_assert_eq!(before.start_s, row.start_s);
                    prop_assert!(before.end_s <= row.end_s && before.n_windows <= row.n_windows);
                }
                known.insert(row.row, row);
            }
            prop_assert!(known.values().all(|row| !row.is_open));
        }
    }
}
