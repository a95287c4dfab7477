//! Questions to the memory, in English.
//!
//! A grammar, no model: *when, last, first, how often, how long, did* × verbs of actions × times such as *today*,
//! *last night* and *since 07:30*; and whether, when and how long somebody was there (`presence`). Verbs are read with the lexicon of `radarllm-facts`, which also labels captions. What
//! the grammar does not know is refused, not guessed: then the words are searched in the captions, and the answer says
//! so.
//!
//! Reading order: this file, [`what`] (questions to their meaning), [`when`] (phrases of time), `verbs`, `words`,
//! `sentence` (answers), `presence`.

mod presence;
mod sentence;
#[cfg(test)]
mod tests;
mod verbs;
pub mod what;
pub mod when;
mod words;

use radarllm_monitor::rows::{ActivityRow, EventKind, EventRow};
use serde::{Deserialize, Serialize};

use crate::error::StoreError;
use crate::store::timeline::Order;
use crate::store::{ActivityQuery, EventQuery, Timeline};

pub use what::{Kind, Understood, What};
pub use when::{Clock, When};

/// Longest question, bytes.
pub const MAX_QUESTION_BYTES: usize = 1_000;
/// Most rows and most events of an answer.
pub const MAX_ROWS: usize = 50;
/// The action of which alarms speak as well.
const FALL: &str = "fall";

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
#[derive(Default)]
struct Found {
    count: u64,
    first_ms: Option<i64>,
    last_ms: Option<i64>,
    /// Times, oldest first; some of them if there are many.
    times_ms: Vec<i64>,
    total_ms: i64,
    longest_ms: i64,
    synthetic: bool,
    is_about_falls: bool,
    n_alarms: u64,
    oldest_ms: Option<i64>,
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
    match what::understand(question, &clock) {
        Ok(understood) => {
            let found = find(timeline, &understood)?;
            Ok(Answer {
                answer: sentence::answer(&understood, &found, &clock),
                understood: Some(understood),
                searched: None,
                count: found.count,
                first_ms: found.first_ms,
                last_ms: found.last_ms,
                total_ms: found.total_ms,
                synthetic: found.synthetic,
                rows: found.rows,
                events: found.events,
            })
        }
        Err(not_understood) => search(timeline, not_understood, &clock),
    }
}

/// Looks up what was understood.
fn find(timeline: &Timeline, understood: &Understood) -> Result<Found, StoreError> {
    let Understood { what, when, .. } = understood;
    let query = ActivityQuery {
        from_ms: when.from_ms,
        to_ms: Some(when.to_ms),
        actions: what.actions.clone(),
        ..ActivityQuery::default()
    };
    let tally = timeline.tally(&query)?;
    let order = match what.kind {
        Kind::First | Kind::When => Order::OldestFirst,
        Kind::Last | Kind::HowOften | Kind::HowLong | Kind::Did => Order::NewestFirst,
    };
    let rows = timeline.some_activities(&query, order, MAX_ROWS)?;
    let mut found = Found {
        count: tally.count,
        first_ms: tally.first_ms,
        last_ms: tally.last_ms,
        times_ms: rows.iter().map(|row| row.activity.start_ms).collect(),
        total_ms: tally.total_ms,
        longest_ms: tally.longest_ms,
        synthetic: tally.synthetic,
        is_about_falls: what.actions.iter().any(|a| a == FALL),
        oldest_ms: timeline.oldest_ms()?,
        rows,
        ..Found::default()
    };
    if found.is_about_falls {
        add_alarms(timeline, when, what.kind, &mut found)?;
    }
    found.times_ms.sort_unstable();
    Ok(found)
}

/// Adds confirmed alarms, which know of falls that no sentence states. An alarm and a sentence of one fall count once.
fn add_alarms(
    timeline: &Timeline,
    when: &When,
    kind: Kind,
    found: &mut Found,
) -> Result<(), StoreError> {
    let alarms = timeline.alarms(when.from_ms, when.to_ms)?;
    found.n_alarms = alarms.count;
    found.synthetic |= alarms.synthetic;
    let query = EventQuery {
        from_ms: when.from_ms,
        to_ms: Some(when.to_ms),
        kinds: vec![EventKind::Confirmed],
        person: None,
    };
    found.events = timeline.events(&query, None, MAX_ROWS)?.rows;
    // How long somebody fell is known from sentences only.
    if kind != Kind::HowLong {
        found.count += alarms.n_alone;
        let earlier = [found.first_ms, alarms.first_alone_ms];
        found.first_ms = earlier.into_iter().flatten().min();
        found.last_ms = found.last_ms.max(alarms.last_alone_ms);
        found.times_ms.extend(alarms.times_alone_ms);
    }
    Ok(())
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
