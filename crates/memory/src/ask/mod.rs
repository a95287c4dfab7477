//! Questions to the memory, in English.
//!
//! A grammar, no model: *when, last, first, how often, how long, did* × verbs of actions × times such as *today*,
//! *last night* and *since 07:30*; whether, when and how long somebody was there (`presence`); and what is so at present
//! (`situation`). Verbs are read with the lexicon of `radarllm-facts`, which also labels captions. What the grammar does
//! not know is refused, not guessed: then the words are searched in the captions, and the answer says so. Nothing is denied
//! of a time in which nobody watched (`known`).
//!
//! Reading order: this file, [`what`] (questions to their meaning), [`when`] (phrases of time), `verbs`, `words`, `known`,
//! `sentence` (answers), `presence`, `situation`.

mod known;
mod presence;
mod sentence;
mod situation;
#[cfg(test)]
mod tests;
mod verbs;
pub mod what;
pub mod when;
mod words;

use std::collections::BTreeMap;

use radarllm_base::civil::DAY_MS;
use radarllm_monitor::rows::{ActivityRow, EventKind, EventRow};
use serde::{Deserialize, Serialize};

use crate::error::StoreError;
use crate::store::falls::{FALL, Fall};
use crate::store::lanes::Stretch;
use crate::store::timeline::Order;
use crate::store::{ActivityQuery, EventQuery, Timeline};
use known::{Coverage, Kept};

pub use what::{Kind, Understood, What};
pub use when::{Clock, When};

/// Longest question, bytes.
pub const MAX_QUESTION_BYTES: usize = 1_000;
/// Most rows and most events of an answer.
pub const MAX_ROWS: usize = 50;
/// The action of whoever rises after a fall.
const STAND_UP: &str = "stand_up";
/// Actions of whoever lies, also after a fall.
const LIE: [&str; 2] = ["lie_still", "lie_down"];
/// Longest time between a sentence about getting up and the end of a fall by it, ms.
const RISE_MS: i64 = 30_000;

/// The answer to a question.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// The answer in sentences.
    pub answer: String,
    /// The meaning of the question, if it was understood.
    pub understood: Option<Understood>,
    /// What was searched for instead, if it was not understood.
    pub searched: Option<Searched>,
    /// How many times it happened, or how many sentences were found.
    pub count: u64,
    /// The first time, milliseconds since 1970 in UTC.
    pub first_ms: Option<i64>,
    /// The last time.
    pub last_ms: Option<i64>,
    /// Duration in all within the range of time, ms. Two people at once count twice.
    pub total_ms: i64,
    /// Whether a simulated radar is among the origins.
    pub synthetic: bool,
    /// Times of the range that was asked about of which something is known.
    #[serde(default)]
    pub known: Vec<Stretch>,
    /// Activities behind the answer, at most [`MAX_ROWS`]: the first ones for *first* and *when*, else the last ones.
    pub rows: Vec<ActivityRow>,
    /// For questions about falls: confirmed alarms, newest first, at most [`MAX_ROWS`].
    pub events: Vec<EventRow>,
}

/// A search for words in captions.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Searched {
    /// The words, all of which a sentence must have.
    pub words: Vec<String>,
    /// When.
    pub when: When,
}

/// What the memory has about a question.
struct Found {
    count: u64,
    first_ms: Option<i64>,
    last_ms: Option<i64>,
    /// Times, oldest first; some of them if there are many.
    times_ms: Vec<i64>,
    total_ms: i64,
    longest_ms: i64,
    synthetic: bool,
    /// What is known of the time that was asked about.
    coverage: Coverage,
    /// Falls and suspicions of that time, if the question is about them.
    falls: Vec<Fall>,
    is_about_falls: bool,
    /// Falls before that time that have not ended, if it lasts until now.
    open_before: Vec<Fall>,
    /// When somebody lay on the floor after a confirmed fall, if the question is about lying.
    floor: Vec<Stretch>,
    /// Whether only the times on the floor count: the question names the floor, or no sentence tells that somebody lay.
    is_floor: bool,
    rows: Vec<ActivityRow>,
    events: Vec<EventRow>,
}

/// Answers a question.
///
/// # Errors
/// [`StoreError::Invalid`] for a question longer than [`MAX_QUESTION_BYTES`] and for a clock that is out of range, or a
/// database that cannot be read. A question that is not understood is no error.
pub fn ask(timeline: &Timeline, question: &str, clock: Clock) -> Result<Answer, StoreError> {
    if question.len() > MAX_QUESTION_BYTES {
        let found = format!("{} bytes", question.len());
        return Err(StoreError::invalid("question", "at most 1000 bytes", found));
    }
    clock.check()?;
    let _snapshot = timeline.snapshot()?;
    if let Some(answer) = presence::answer(timeline, question, &clock)? {
        return Ok(answer);
    }
    if let Some(answer) = situation::answer(timeline, question, &clock)? {
        return Ok(answer);
    }
    match what::understand(question, &clock) {
        Ok(understood) => answer_understood(timeline, understood, &clock),
        Err(not_understood) => search(timeline, not_understood, &clock),
    }
}

/// Answers a question that was understood.
fn answer_understood(
    timeline: &Timeline,
    understood: Understood,
    clock: &Clock,
) -> Result<Answer, StoreError> {
    let found = find(timeline, &understood, clock)?;
    Ok(Answer {
        answer: sentence::answer(&understood, &found, clock),
        understood: Some(understood),
        searched: None,
        count: found.count,
        first_ms: found.first_ms,
        last_ms: found.last_ms,
        total_ms: found.total_ms,
        synthetic: found.synthetic,
        known: found.coverage.known,
        rows: found.rows,
        events: found.events,
    })
}

/// Looks up what was understood.
fn find(timeline: &Timeline, understood: &Understood, clock: &Clock) -> Result<Found, StoreError> {
    let Understood { what, when, .. } = understood;
    let is_about = |action: &str| what.actions.iter().any(|a| a == action);
    let is_about_falls = is_about(FALL);
    let query = |actions: &[String]| ActivityQuery {
        from_ms: when.from_ms,
        to_ms: Some(when.to_ms),
        actions: actions.to_vec(),
        ..ActivityQuery::default()
    };
    let tally = timeline.tally(&query(&what.actions))?;
    let order = match what.kind {
        Kind::First | Kind::When => Order::OldestFirst,
        Kind::Last | Kind::HowOften | Kind::HowLong | Kind::Did => Order::NewestFirst,
    };
    let rows = timeline.some_activities(&query(&what.actions), order, MAX_ROWS)?;
    let kept = match is_about_falls {
        true => Kept::Falls,
        false => Kept::Activities,
    };
    let mut found = Found {
        count: tally.count,
        first_ms: tally.first_ms,
        last_ms: tally.last_ms,
        times_ms: beginnings(&rows),
        total_ms: tally.total_ms,
        longest_ms: tally.longest_ms,
        synthetic: tally.synthetic,
        coverage: Coverage::of(timeline, when, kept, clock)?,
        falls: Vec::new(),
        is_about_falls,
        open_before: Vec::new(),
        floor: Vec::new(),
        is_floor: false,
        rows,
        events: Vec::new(),
    };
    let is_about_lying = LIE.iter().any(|lie| is_about(lie));
    if is_about_falls || is_about(STAND_UP) || is_about_lying {
        let falls = timeline.falls([when.from_ms.unwrap_or(0), when.to_ms])?;
        found.synthetic |= falls.iter().any(|fall| fall.synthetic);
        if is_about_lying {
            let floor = falls.iter();
            let floor = floor.filter_map(|fall| on_the_floor(fall, when, &found.coverage));
            found.floor = floor.collect();
            let is_named = understood.ignored.iter().any(|w| words::is_floor(w));
            if !found.floor.is_empty() && (is_named || found.count == 0) {
                found.count_floor();
            }
        }
        if is_about(STAND_UP) {
            add_risings(timeline, &falls, when, &mut found)?;
        }
        if is_about_falls {
            let others: Vec<String> = what
                .actions
                .iter()
                .filter(|a| *a != FALL)
                .cloned()
                .collect();
            let tally = match others.is_empty() {
                true => Default::default(),
                false => timeline.tally(&query(&others))?,
            };
            found.count = tally.count;
            (found.first_ms, found.last_ms) = (tally.first_ms, tally.last_ms);
            found.times_ms = (found.rows.iter())
                .filter(|row| row.activity.action != FALL)
                .map(|row| row.activity.start_ms)
                .collect();
            add_falls(timeline, falls, when, clock, &mut found)?;
        }
    }
    found.times_ms.sort_unstable();
    Ok(found)
}

/// When activities began; one that began while the same person was at another one of them is a part of that.
fn beginnings(rows: &[ActivityRow]) -> Vec<i64> {
    let mut all: Vec<_> = rows.iter().map(|row| &row.activity).collect();
    all.sort_by_key(|a| (a.start_ms, a.end_ms));
    let mut ends: BTreeMap<u32, i64> = BTreeMap::new();
    all.retain(|activity| {
        let end_ms = ends.entry(activity.person).or_insert(i64::MIN);
        let is_apart = activity.start_ms >= *end_ms;
        *end_ms = (*end_ms).max(activity.end_ms);
        is_apart
    });
    all.into_iter().map(|activity| activity.start_ms).collect()
}

impl Found {
    /// Lets the times on the floor count, and nothing else.
    fn count_floor(&mut self) {
        let lengths = || self.floor.iter().map(|s| s.end_ms - s.start_ms);
        (self.total_ms, self.longest_ms) = (lengths().sum(), lengths().max().unwrap_or_default());
        self.times_ms = self.floor.iter().map(|s| s.start_ms).collect();
        self.count = self.floor.len() as u64;
        self.first_ms = self.times_ms.first().copied();
        self.last_ms = self.times_ms.last().copied();
        self.is_floor = true;
    }

    fn add(&mut self, at_ms: i64) {
        self.count += 1;
        self.first_ms = Some(self.first_ms.map_or(at_ms, |ms| ms.min(at_ms)));
        self.last_ms = self.last_ms.max(Some(at_ms));
        self.times_ms.push(at_ms);
    }

    /// Whether a fall counts: its alarm was confirmed, or a sentence tells it and no alarm about it was dismissed or is
    /// still open.
    fn counts(&self, fall: &Fall, clock: &Clock) -> bool {
        let is_open = fall.is_suspicion() && self.coverage.goes_on(fall.at_ms, clock);
        fall.confirmed_ms.is_some() || (fall.is_reported && !fall.is_dismissed() && !is_open)
    }
}

/// Adds falls. An alarm and a sentence of one fall count once.
fn add_falls(
    timeline: &Timeline,
    mut falls: Vec<Fall>,
    when: &When,
    clock: &Clock,
    found: &mut Found,
) -> Result<(), StoreError> {
    // Others have ended in this time and happened before it.
    let from_ms = when.from_ms.unwrap_or(0);
    falls.retain(|fall| fall.is_of([from_ms, when.to_ms]));
    let query = EventQuery {
        from_ms: when.from_ms,
        to_ms: Some(when.to_ms),
        kinds: vec![EventKind::Confirmed],
        person: None,
    };
    found.events = timeline.events(&query, None, MAX_ROWS)?.rows;
    for fall in &falls {
        if found.counts(fall, clock) {
            found.add(fall.at_ms);
        }
    }
    if found.count == 0 {
        // Sentences about what was no fall.
        found.rows.clear();
    }
    if when.to_ms >= clock.now_ms {
        let day_before_ms = when.to_ms.saturating_sub(DAY_MS).max(0);
        let mut open = timeline.falls([day_before_ms, when.to_ms])?;
        open.retain(|fall| fall.is_open() && !fall.is_of([from_ms, when.to_ms]));
        found.open_before = open;
    }
    found.falls = falls;
    Ok(())
}

/// Adds the times at which somebody rose after a fall, if no sentence tells it.
fn add_risings(
    timeline: &Timeline,
    falls: &[Fall],
    when: &When,
    found: &mut Found,
) -> Result<(), StoreError> {
    let from_ms = when.from_ms.unwrap_or(0);
    let risen = falls.iter().filter_map(Fall::risen_ms);
    for risen_ms in risen.filter(|ms| (from_ms..when.to_ms).contains(ms)) {
        let reported = ActivityQuery {
            from_ms: Some(risen_ms.saturating_sub(RISE_MS)),
            to_ms: Some(risen_ms.saturating_add(RISE_MS)),
            actions: vec![STAND_UP.into()],
            ..ActivityQuery::default()
        };
        if timeline.tally(&reported)?.count == 0 {
            found.add(risen_ms);
        }
    }
    Ok(())
}

/// When somebody lay on the floor after a confirmed fall, within a range of time: until the person rose, a user ended the
/// fall, or nothing is known any more.
fn on_the_floor(fall: &Fall, when: &When, coverage: &Coverage) -> Option<Stretch> {
    fall.confirmed_ms?;
    let known_ms = coverage.end_ms()?;
    let stretch = Stretch {
        start_ms: fall.at_ms.max(when.from_ms.unwrap_or(0)),
        end_ms: fall.end.map_or(known_ms, |end| end.at_ms).min(when.to_ms),
    };
    (stretch.start_ms < stretch.end_ms).then_some(stretch)
}

/// Searches for the words of a question that was not understood.
fn search(
    timeline: &Timeline,
    question: what::NotUnderstood,
    clock: &Clock,
) -> Result<Answer, StoreError> {
    let what::NotUnderstood { why, when, words } = question;
    let mut answer = Answer::default();
    if !words.is_empty() {
        let query = ActivityQuery {
            from_ms: when.from_ms,
            to_ms: Some(when.to_ms),
            text: Some(words.join(" ")),
            ..ActivityQuery::default()
        };
        let tally = timeline.tally(&query)?;
        answer.count = tally.count;
        answer.first_ms = tally.first_ms;
        answer.last_ms = tally.last_ms;
        answer.total_ms = tally.total_ms;
        answer.synthetic = tally.synthetic;
        answer.rows = timeline.some_activities(&query, Order::NewestFirst, MAX_ROWS)?;
        answer.searched = Some(Searched { words, when });
    }
    answer.answer = sentence::searched(why, &answer, clock);
    Ok(answer)
}
