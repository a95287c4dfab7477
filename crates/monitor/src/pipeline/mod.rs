//! The pipeline of a running radar: one frame in, messages and records out.
//!
//! | step | by |
//! |---|---|
//! | time of the frame | [`StreamClock`] |
//! | leakage of the transmitters is removed | [`radarllm_base::points::LEAKAGE_M`] |
//! | points of the empty room are removed, if it is learnt first | [`empty`] |
//! | static points of the room are removed | [`surroundings`] |
//! | people are tracked; presence, falls | [`Watch`] |
//! | every 2 s, the last 6 s of each person are described; one person has all points | [`windows`], [`Describe`] |
//! | falls and rising are believed if the heights permit them | [`heights`] |
//! | labels and rows of the timeline | [`Activities`] |
//!
//! The pipeline has neither threads nor files and does not read the clock of the computer, so that a recording gives the
//! same rows at any speed. A sentence is computed between two frames: it takes some ten milliseconds, for which frames
//! wait in the queue before the pipeline. When they wait too long, the caller leaves windows out ([`Pipeline::push_frame`]);
//! when this happens often, there are fewer windows ([`pace`]).

pub mod empty;
pub mod heights;
pub mod pace;
pub mod surroundings;
#[cfg(test)]
mod tests;
pub mod windows;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use radarllm_base::{Clip, Clutter, PointFrame, Provenance};
use radarllm_tracking::LiveTrack;

use crate::activities::{Activities, ActivityOptions, Label, Row, WindowCaption, WindowReading};
use crate::clock::{StreamClock, Tick};
use crate::counters::Counters;
use crate::falls::{EarlierFall, FALL, FallEvent, FallState, SuspectBy};
use crate::measured::{self, MeasuredSpan};
use crate::messages::{self, Body, Frame, Health, Now, PresenceState, SourceState, Stamp};
use crate::options::{OptionError, has_passed, is_over, within};
use crate::people::UNTRACKED;
use crate::presence::{Presence, PresenceUpdate};
use crate::rows::{Activity, Event, EventKind};
use crate::statures::upper_height_m;
use crate::watch::{Watch, WatchOptions};
use crate::zones::Zones;

use empty::EmptyRoom;
use heights::Heights;
use pace::Pace;
use surroundings::Surroundings;
use windows::{Window, WindowOptions, Windows};

/// Time after which another number of people is published, s: the tracker has some people twice for a moment.
const PEOPLE_S: f64 = 2.0;
/// Time for which somebody was not measured at the end of a window of whom nothing is said then, s.
const UNSEEN_S: f64 = 2.0;
/// Time between two messages about the health, s.
const HEALTH_S: f64 = 5.0;

/// Writes a sentence about the points of a person.
pub trait Describe: Send {
    /// Describes a window of one person, without static clutter.
    fn describe(&mut self, clip: &Clip, context: WindowContext) -> Described;

    /// Whether falls before this radar are measured in windows, so that heights that mean nothing need not suspect them.
    fn measures_falls(&self, _stream: &StreamInfo) -> bool {
        false
    }
}

/// What is known of a window beside its points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WindowContext {
    /// All points that the radar reported meanwhile, static ones as well, if they may be this person's alone.
    pub reported: Option<Clip>,
    /// The frames of the person before the window, at most [`WindowOptions::earlier_s`].
    pub earlier: Vec<PointFrame>,
    /// The action that was measured of the person at the beginning of the window.
    pub before: Option<String>,
}

/// What was written about a window.
#[derive(Clone, Debug, PartialEq)]
pub enum Described {
    /// A sentence.
    Sentence {
        /// The sentence.
        caption: String,
        /// Actions of its clauses, in order of time.
        actions: Vec<String>,
        /// Its confidence, 0 to 1; `None` if it says only what the points show of any motion.
        confidence: Option<f64>,
        /// What was measured, in order of time; its actions are not read by a model.
        measured: Vec<MeasuredSpan>,
    },
    /// The model abstained.
    Abstained {
        /// Why.
        reason: String,
    },
    /// The model could not be used.
    Failed {
        /// Why.
        error: String,
    },
}

/// An error of the model, for listeners.
fn model_problem(error: &str) -> String {
    format!("the model failed: {error}")
}

/// The radar of a stream.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamInfo {
    /// Time between two frames, s.
    pub frame_period_s: f64,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f64,
    /// Whether no source states this height.
    pub is_height_assumed: bool,
    /// Name of the radar.
    pub radar: String,
    /// Provenance of the points.
    pub provenance: Provenance,
    /// Whether the points may contain static clutter.
    pub clutter: Clutter,
}

/// Options of the pipeline.
#[derive(Clone, Debug, PartialEq)]
pub struct PipelineOptions {
    /// Options of tracker, presence and falls, and the zones of the room.
    pub watch: WatchOptions,
    /// Options of labels and rows.
    pub activities: ActivityOptions,
    /// Options of the windows.
    pub windows: WindowOptions,
    /// Time in which the empty room is learnt, s; 0 to learn nothing.
    pub learn_empty_s: f64,
}

impl Default for PipelineOptions {
    /// All that lasts for less than 4 s is in two windows at least, so that a row needs two.
    fn default() -> Self {
        Self {
            watch: WatchOptions::default(),
            activities: ActivityOptions {
                min_windows: 2,
                ..ActivityOptions::default()
            },
            windows: WindowOptions::default(),
            learn_empty_s: 0.0,
        }
    }
}

/// When a frame arrived.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arrival {
    /// By the clock of the computer, milliseconds since 1970 in UTC.
    At(i64),
    /// In a replay whose first frame was at this time, milliseconds since 1970 in UTC.
    Replayed(i64),
}

/// What the pipeline returns.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// A message for listeners.
    Message(Stamp, Body),
    /// A row of the timeline, which is new or has grown.
    Row {
        /// When it was known.
        stamp: Stamp,
        /// Number of the row, from 1.
        row: u64,
        /// The row.
        activity: Activity,
    },
    /// Something that happened at one moment.
    Event(Event),
}

/// Removes the points of ascending indices.
fn remove_points(frame: &mut PointFrame, indices: &[u32]) {
    let mut at = 0_u32;
    frame.points.retain(|_| {
        let is_removed = indices.binary_search(&at).is_ok();
        at += 1;
        !is_removed
    });
}

/// What the newest message about what is done says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Newest {
    /// What somebody does.
    Somebody,
    /// That nobody is there.
    Nobody,
    /// That the radar is silent.
    Silence,
}

/// The state of a running radar.
pub struct Pipeline {
    stream: StreamInfo,
    clock: StreamClock,
    empty: EmptyRoom,
    surroundings: Surroundings,
    watch: Watch,
    activities: Activities,
    windows: Windows,
    pace: Pace,
    zones: Zones,
    describe: Box<dyn Describe>,
    counters: Arc<Counters>,
    source: SourceState,
    newest: Newest,
    /// Whether the last window showed somebody who is not tracked.
    is_untracked_present: bool,
    is_occupied: bool,
    /// Number of people in the newest message, and since when there has been another number, s.
    n_people: usize,
    n_people_other_s: Option<f64>,
    health_at_s: f64,
    stamp: Stamp,
    /// Rows that were announced and may still grow, with the times of day at which they begin.
    open_rows: BTreeMap<u64, i64>,
}

impl Pipeline {
    /// A pipeline that has seen nothing yet.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn new(
        stream: StreamInfo,
        options: &PipelineOptions,
        describe: Box<dyn Describe>,
        counters: Arc<Counters>,
    ) -> Result<Self, OptionError> {
        within(
            "radar_height_m",
            stream.radar_height_m,
            [-100.0, 100.0],
            "-100 to 100 m",
        )?;
        let mut watch = Watch::new(&options.watch, stream.radar_height_m)?;
        if describe.measures_falls(&stream) {
            watch.suspect_by(match stream.is_height_assumed {
                true => SuspectBy::Measuring,
                false => SuspectBy::HeightsOfPoints,
            });
        }
        Ok(Self {
            clock: StreamClock::new(stream.frame_period_s)?,
            empty: EmptyRoom::new(options.learn_empty_s)?,
            surroundings: Surroundings::new(stream.clutter),
            watch,
            activities: Activities::new(options.activities)?,
            windows: Windows::new(options.windows)?,
            pace: Pace::new(options.windows.stride_s),
            zones: options.watch.zones.clone(),
            describe,
            counters,
            source: SourceState::Ok,
            newest: Newest::Somebody,
            is_untracked_present: false,
            is_occupied: false,
            n_people: 0,
            n_people_other_s: None,
            health_at_s: f64::NEG_INFINITY,
            stamp: Stamp {
                utc_ms: 0,
                t_s: 0.0,
            },
            open_rows: BTreeMap::new(),
            stream,
        })
    }

    /// The next frame of the radar. Where `may_describe` is false, its windows are left out and counted.
    pub fn push_frame(
        &mut self,
        frame: PointFrame,
        arrival: Arrival,
        may_describe: bool,
    ) -> Vec<Output> {
        let number = u64::from(frame.frame);
        let before = self.clock.clone();
        let tick = match arrival {
            Arrival::At(now_ms) => self.clock.frame(number, now_ms),
            Arrival::Replayed(start_ms) => self.clock.replayed(number, start_ms),
        };
        self.stamp = Stamp {
            utc_ms: tick.utc_ms,
            t_s: tick.t_s,
        };
        let mut out = self.gaps(&tick, &before);
        let mut frame = PointFrame {
            time_s: tick.t_s,
            ..frame
        };
        frame.points.retain(|p| !p.is_leakage());
        if self.stream.clutter == Clutter::Unchecked {
            // Also what the empty room showed: it tells that the room is seen.
            self.windows.report(frame.clone());
        }
        self.empty.clean(&mut frame);
        if self.counters.room_learnt.get().is_none()
            && let Some(summary) = self.empty.summary()
        {
            // It was empty just now.
            let _ = self.counters.room_learnt.set(summary);
        }
        if self.surroundings.clean(&mut frame) {
            self.windows.remove(|p| self.surroundings.is_static(p));
        }
        let seen = self.watch.push(&frame);
        self.presence_changed(&seen.presence, &mut out);
        out.extend(seen.falls.iter().flat_map(|event| self.fall(event)));
        for event in &seen.falls {
            let is_up = [FallState::Dismissed, FallState::Recovered].contains(&event.state);
            if is_up && seen.people.iter().any(|one| one.person == event.person) {
                // The newest sentence was of somebody who lies.
                let reason = Some("has just got up".into());
                let now = self.now(Some(event.person), None, reason, Label::Unsure.name());
                out.push(self.message(Body::Now(now)));
            }
        }
        out.push(self.frame_message(&frame, &seen.tracks));
        let is_occupied = seen.presence.presence.is_occupied();
        remove_points(&mut frame, &seen.low_points);
        let changes = self.windows.push(&frame, &seen.people, is_occupied);
        for person in changes.ended {
            let rows = self.activities.end_person(person);
            out.extend(self.rows(&rows));
        }
        if let Some([person, number]) = changes.renamed {
            let rows = self.activities.rename(person, number);
            out.extend(self.rows(&rows));
        }
        if !seen.people.is_empty() && std::mem::take(&mut self.is_untracked_present) {
            let rows = match &seen.people[..] {
                [one] if changes.renamed.is_none() => self.activities.rename(UNTRACKED, one.person),
                _ => self.activities.end_person(UNTRACKED),
            };
            out.extend(self.rows(&rows));
        }
        if self.pace.judge(tick.t_s) {
            self.windows.set_stride(self.pace.stride_s(), tick.t_s);
        }
        if self.windows.is_due(tick.t_s) {
            self.describe_people(may_describe, &mut out);
        }
        if let Some(somebody) = seen.people.first() {
            if std::mem::replace(&mut self.newest, Newest::Somebody) != Newest::Somebody {
                let reason = Some("no window has ended yet".into());
                let now = self.now(Some(somebody.person), None, reason, Label::Unsure.name());
                out.push(self.message(Body::Now(now)));
            }
        } else if !self.windows.is_lingering()
            && !self.is_untracked_present
            && self.watch.open_falls().is_empty()
            && std::mem::replace(&mut self.newest, Newest::Nobody) != Newest::Nobody
        {
            let now = self.now(None, None, None, Label::Nobody.name());
            out.push(self.message(Body::Now(now)));
        }
        if tick.t_s - self.health_at_s >= HEALTH_S || self.source != SourceState::Ok {
            self.source = SourceState::Ok;
            out.push(self.health());
        }
        out
    }

    /// The radar is silent. Rows end: what happens meanwhile is unknown.
    pub fn source_lost(&mut self, now_ms: i64, reason: &str) -> Vec<Output> {
        self.stamp.utc_ms = self.stamp.utc_ms.max(now_ms);
        self.source = SourceState::Lost;
        let mut out = self.end_windows(&self.clock.clone());
        let update = self.watch.reset_presence();
        self.presence_changed(&update, &mut out);
        if std::mem::replace(&mut self.newest, Newest::Silence) != Newest::Silence {
            // The newest sentence is old from now on.
            let now = self.now(None, None, Some(reason.into()), Label::Unseen.name());
            out.push(self.message(Body::Now(now)));
        }
        let data = serde_json::json!({ "reason": reason });
        out.push(self.event(EventKind::SourceLost, None, Some(data)));
        out.push(self.health());
        out
    }

    /// The radar is connected again. Frames follow.
    pub fn source_back(&mut self, now_ms: i64) -> Vec<Output> {
        self.stamp.utc_ms = self.stamp.utc_ms.max(now_ms);
        vec![self.event(EventKind::SourceBack, None, None)]
    }

    /// The end of the stream: describes what is left, and ends all rows.
    pub fn finish(&mut self) -> Vec<Output> {
        let mut out = Vec::new();
        if self.windows.is_partly_new() {
            self.describe_people(true, &mut out);
        }
        out.extend(self.end_windows(&self.clock.clone()));
        out.push(self.health());
        out
    }

    /// Ends a fall on a user's word: one that is suspected is dismissed, one that is confirmed has recovered. Returns
    /// nothing if there is no such fall.
    pub fn acknowledge(&mut self, fall: u64) -> Vec<Output> {
        let open = self
            .watch
            .open_falls()
            .iter()
            .find(|open| open.fall == fall);
        let Some(open) = open.cloned().filter(|_| self.watch.acknowledge(fall)) else {
            return Vec::new();
        };
        let at_s = self.stamp.t_s;
        let event = FallEvent {
            fall,
            person: open.person,
            state: open.ended(),
            at_s,
            dwell_s: at_s - open.since_s,
            place_m: open.place_m,
        };
        self.fall_by(&event, true).into()
    }

    /// Takes falls over that an earlier run of the program knew and that have not ended: nobody has risen because a program
    /// was started anew. To be called before the first frame, at a time of the computer, milliseconds since 1970 in UTC.
    pub fn restore(&mut self, falls: &[EarlierFall], now_ms: i64) -> Vec<Output> {
        self.stamp.utc_ms = self.stamp.utc_ms.max(now_ms);
        let update = self.watch.restore(falls);
        let mut out = Vec::new();
        self.presence_changed(&update, &mut out);
        // That they were suspected or confirmed is in the memory already.
        out.extend(falls.iter().map(|earlier| {
            self.message(Body::Fall(messages::Fall {
                id: earlier.fall,
                state: match earlier.is_confirmed {
                    true => messages::FallState::Confirmed,
                    false => messages::FallState::Suspected,
                },
                person: Some(earlier.person),
                dwell_s: earlier.age_s,
                acknowledged: false,
                synthetic: self.is_synthetic(),
            }))
        }));
        out
    }

    /// What ends before a frame, by the clock of the frames before it.
    fn gaps(&mut self, tick: &Tick, before: &StreamClock) -> Vec<Output> {
        let mut out = Vec::new();
        if let Some(step_ms) = tick.step_ms {
            let data = serde_json::json!({ "step_ms": step_ms });
            out.push(self.event(EventKind::ClockStep, None, Some(data)));
        }
        if tick.is_after_gap {
            out.extend(self.end_windows(before));
        }
        out
    }

    fn end_windows(&mut self, clock: &StreamClock) -> Vec<Output> {
        self.windows.clear();
        self.is_untracked_present = false;
        let rows = self.activities.end_all();
        self.rows_by(&rows, clock)
    }

    fn describe_people(&mut self, may_describe: bool, out: &mut Vec<Output>) {
        let windows = self.windows.take();
        let is_alone = windows.len() == 1;
        for window in windows {
            let is_untracked = window.person == UNTRACKED;
            if !self.zones.counts(window.place_m) || (is_untracked && self.is_low(&window)) {
                if is_untracked {
                    self.nobody_untracked(out);
                }
                continue;
            }
            self.pace.count(may_describe);
            if !may_describe {
                self.counters.windows_overwritten.add(1);
                continue;
            }
            self.describe_person(window, is_alone, out);
        }
    }

    /// Nobody is there who is not tracked.
    fn nobody_untracked(&mut self, out: &mut Vec<Output>) {
        self.is_untracked_present = false;
        let rows = self.activities.end_person(UNTRACKED);
        out.extend(self.rows(&rows));
    }

    /// Whether a zone ignores the points of a window because of their height.
    fn is_low(&self, window: &Window) -> bool {
        let points = window.frames.iter().flat_map(|frame| &frame.points);
        let heights = points.map(|p| f64::from(p.z_m) + self.stream.radar_height_m);
        let height_m = upper_height_m(heights.filter(|h| h.is_finite()));
        height_m.is_some_and(|height_m| self.zones.is_low(window.place_m, height_m))
    }

    fn describe_person(&mut self, window: Window, is_alone: bool, out: &mut Vec<Output>) {
        let (start_s, end_s, n_points) = (window.start_s(), window.end_s(), window.n_points());
        let clip = Clip {
            frames: window.frames,
            frame_rate_hz: 1.0 / self.stream.frame_period_s,
            radar_height_m: self.stream.radar_height_m as f32,
            is_height_assumed: self.stream.is_height_assumed,
            radar: self.stream.radar.clone(),
            provenance: self.stream.provenance.clone(),
            clutter: Clutter::Settled,
        };
        let began = Instant::now();
        let reported = self.windows.reported().filter(|_| is_alone);
        let context = WindowContext {
            reported: reported.map(|frames| clip.with_frames(frames)),
            earlier: window.earlier,
            before: (self.activities.measured_at(window.person, start_s)).map(String::from),
        };
        let described = self.describe.describe(&clip, context);
        match &described {
            Described::Failed { error } => self.counters.model_failed(model_problem(error)),
            _ => self.counters.described(began.elapsed()),
        }
        if window.person == UNTRACKED {
            if matches!(described, Described::Failed { .. }) {
                // Whether somebody is there stays as it was.
                return;
            }
            // The model abstains from points that do not stay together: then nobody is there.
            let is_there = matches!(described, Described::Sentence { .. });
            if !is_there {
                self.nobody_untracked(out);
                return;
            }
            self.is_untracked_present = true;
            self.newest = Newest::Somebody;
            let update = self.watch.notice(end_s, window.place_m);
            self.presence_changed(&update, out);
        }
        let (mut caption, mut actions, mut spans) = (None, Vec::new(), Vec::new());
        let mut reason = match described {
            Described::Sentence {
                caption: text,
                actions: stated,
                confidence,
                measured,
            } => {
                caption = Some(WindowCaption {
                    text,
                    confidence: confidence.map(|confidence| confidence.clamp(0.0, 1.0)),
                    place_m: Some(window.place_m),
                });
                spans = measured;
                for span in &mut spans {
                    span.caption.place_m = Some(window.place_m);
                }
                actions = stated;
                let falls = self.follow_measured(window.person, window.place_m, &spans);
                out.extend(falls.iter().flat_map(|event| self.fall(event)));
                if self.has_fallen(window.person)
                    && measured::doubt_after_fall(&mut spans)
                    && let Some(caption) = &mut caption
                {
                    caption.text = measured::sentence(spans.iter().map(|span| &span.caption));
                    actions = spans
                        .iter()
                        .filter_map(|span| span.action.clone())
                        .collect();
                }
                None
            }
            Described::Abstained { reason } => {
                self.counters.abstained.add(1);
                Some(reason)
            }
            Described::Failed { error } => Some(model_problem(&error)),
        };
        if let Some(last) = spans.last()
            && is_over(last.end_s, end_s, UNSEEN_S)
        {
            // What was done before is in the rows.
            caption = None;
            reason = Some(format!("not seen for {:.0} s", end_s - last.end_s));
        }
        let heights = Heights::of(&clip.frames, self.stream.radar_height_m);
        let is_measured = |action: &String| {
            let mut spans = spans.iter();
            spans.any(|span| span.action.as_ref() == Some(action))
        };
        actions.retain(|action| is_measured(action) || heights.permit(action));
        // Where the stride is longer, what happens may be in one window only.
        let is_degraded = self.pace.is_degraded();
        let is_shown =
            |action: &&String| is_degraded || heights.show(action) || is_measured(action);
        let reading = WindowReading {
            person: window.person,
            start_s,
            end_s,
            caption,
            certain: actions.iter().filter(is_shown).cloned().collect(),
            actions,
            spans,
            n_points,
        };
        let rows = self.activities.push(&reading);
        out.extend(self.rows(&rows));
        let last = (reading.actions.last()).filter(|action| !reading.is_measured(action));
        let fall = last.and_then(|action| self.watch.label(reading.person, action));
        out.extend(fall.iter().flat_map(|event| self.fall(event)));
        let label = self.activities.label(reading.person, reading.end_s);
        let now = self.now(Some(reading.person), Some(&reading), reason, label.name());
        out.push(self.message(Body::Now(now)));
    }

    /// Falls of a person that begin or end because of what was measured in a window.
    fn follow_measured(
        &mut self,
        person: u32,
        place_m: [f64; 2],
        spans: &[MeasuredSpan],
    ) -> Vec<FallEvent> {
        let falls = spans
            .iter()
            .any(|span| span.action.as_deref() == Some(FALL));
        let began = falls.then(|| self.watch.measured_fall(person, place_m));
        let up = measured::is_up(spans).map(|stands| self.watch.measured_up(person, stands));
        [began, up].into_iter().flatten().flatten().collect()
    }

    /// Whether a person fell and has not risen.
    fn has_fallen(&self, person: u32) -> bool {
        let mut open = self.watch.open_falls().iter();
        open.any(|fall| fall.tracked_as() == Some(person))
    }

    fn now(
        &self,
        person: Option<u32>,
        reading: Option<&WindowReading>,
        reason: Option<String>,
        label: &str,
    ) -> Now {
        let caption = reading.and_then(|r| r.caption.as_ref());
        Now {
            person,
            caption: caption.map(|c| c.text.clone()),
            label: label.into(),
            confidence: caption.and_then(|c| c.confidence),
            window_s: reading.map_or(0.0, |r| r.end_s - r.start_s),
            reason,
            provisional: true,
            synthetic: self.is_synthetic(),
        }
    }

    fn rows(&mut self, rows: &[Row]) -> Vec<Output> {
        self.rows_by(rows, &self.clock.clone())
    }

    /// Rows with the times of day of a clock. One that was announced before keeps its beginning, also if the time of day was
    /// moved meanwhile.
    fn rows_by(&mut self, rows: &[Row], clock: &StreamClock) -> Vec<Output> {
        let now_ms = self.stamp.utc_ms;
        let rows = rows.iter().map(|row| {
            let mut activity = row.activity(|t_s| clock.utc_ms(t_s).unwrap_or(now_ms));
            let open = &mut self.open_rows;
            activity.start_ms = *open.entry(row.row).or_insert(activity.start_ms);
            activity.end_ms = activity.end_ms.max(activity.start_ms);
            if !row.is_open {
                open.remove(&row.row);
            }
            Output::Row {
                stamp: self.stamp,
                row: row.row,
                activity,
            }
        });
        rows.collect()
    }

    fn presence_changed(&mut self, update: &PresenceUpdate, out: &mut Vec<Output>) {
        let n_people = match update.presence.is_occupied() {
            true => update.n_tracked + update.n_held,
            false => 0,
        };
        let t_s = self.stamp.t_s;
        if n_people == self.n_people {
            self.n_people_other_s = None;
        }
        let is_settled =
            |other_s: &mut Option<f64>| has_passed(*other_s.get_or_insert(t_s), t_s, PEOPLE_S);
        let is_other = n_people != self.n_people && is_settled(&mut self.n_people_other_s);
        if !update.has_changed && !is_other {
            return;
        }
        (self.n_people, self.n_people_other_s) = (n_people, None);
        let is_occupied = update.presence.is_occupied();
        let was_occupied = std::mem::replace(&mut self.is_occupied, is_occupied);
        let (state, why) = match update.presence {
            Presence::Absent => (PresenceState::Absent, None),
            Presence::Present => (
                PresenceState::Present,
                Some(format!("people who are tracked: {}", update.n_tracked)),
            ),
            Presence::Held if update.n_fallen > 0 => (
                PresenceState::Held,
                Some("somebody fell and has not risen".into()),
            ),
            Presence::Held => (
                PresenceState::Held,
                Some("somebody was seen shortly before and has not left through a door".into()),
            ),
        };
        let presence = messages::Presence {
            state,
            people: u32::try_from(n_people).unwrap_or(u32::MAX),
            why,
        };
        out.push(self.message(Body::Presence(presence)));
        if is_occupied != was_occupied {
            let kind = match is_occupied {
                true => EventKind::Present,
                false => EventKind::Absent,
            };
            out.push(self.event(kind, None, None));
        }
    }

    fn fall(&self, event: &FallEvent) -> [Output; 2] {
        self.fall_by(event, false)
    }

    /// The message and the event of a change of a fall, which a user may have made.
    fn fall_by(&self, event: &FallEvent, acknowledged: bool) -> [Output; 2] {
        let state = match event.state {
            FallState::Suspected => messages::FallState::Suspected,
            FallState::Confirmed => messages::FallState::Confirmed,
            FallState::Dismissed => messages::FallState::Dismissed,
            FallState::Recovered => messages::FallState::Recovered,
        };
        let message = messages::Fall {
            id: event.fall,
            state,
            person: Some(event.person),
            dwell_s: event.dwell_s,
            acknowledged,
            synthetic: self.is_synthetic(),
        };
        let mut data = serde_json::json!({
            "fall": event.fall,
            "dwell_s": event.dwell_s,
            "place_m": event.place_m,
        });
        if acknowledged {
            data["acknowledged"] = true.into();
        }
        [
            self.message(Body::Fall(message)),
            self.event(event.state.event_kind(), Some(event.person), Some(data)),
        ]
    }

    fn frame_message(&self, frame: &PointFrame, tracks: &[LiveTrack]) -> Output {
        let person = |track: &LiveTrack| messages::Person {
            id: track.id,
            x_m: track.place_m[0],
            y_m: track.place_m[1],
            vx_mps: track.velocity_mps[0],
            vy_mps: track.velocity_mps[1],
            height_m: self.watch.height_m(track.id),
        };
        let people = tracks.iter().map(person).collect();
        self.message(Body::Frame(Frame::new(&frame.points, people)))
    }

    fn health(&mut self) -> Output {
        self.health_at_s = self.stamp.t_s;
        let problems = [
            self.empty.problem(self.stamp.t_s),
            self.counters.model_problem.get(),
        ];
        self.message(Body::Health(Health {
            source: self.source,
            degraded: self.pace.is_degraded().then(|| "captions".into()),
            frames_used: self.counters.frames_used.get(),
            frames_lost: self.counters.frames_lost.get(),
            frames_dropped: self.counters.frames_dropped.get(),
            problems: problems.into_iter().flatten().collect(),
        }))
    }

    fn event(
        &self,
        kind: EventKind,
        person: Option<u32>,
        data: Option<serde_json::Value>,
    ) -> Output {
        Output::Event(Event {
            at_ms: self.stamp.utc_ms,
            kind,
            person,
            data,
        })
    }

    fn message(&self, body: Body) -> Output {
        Output::Message(self.stamp, body)
    }

    fn is_synthetic(&self) -> bool {
        self.stream.provenance.is_simulated()
    }
}
