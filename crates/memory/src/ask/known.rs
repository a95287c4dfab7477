//! What is known of the time that a question asks about, and of the present. A time in which nobody watched, or in which
//! the radar was silent, is no time in which nothing happened.

use radarllm_base::civil::DAY_MS;

use super::sentence::{duration, list};
use super::when::{Clock, When};
use crate::error::StoreError;
use crate::store::Timeline;
use crate::store::falls::Fall;
use crate::store::lanes::Stretch;
use crate::store::runs::{Run, Watched};

/// Longest range of which presence is looked at, ms: the last part of a longer one.
const MAX_RANGE_MS: i64 = 32 * 86_400_000;
/// Time that may be unknown without being mentioned, ms, if it is also less than a hundredth of the range.
const MAX_UNKNOWN_MS: i64 = 60_000;
/// Most stretches that a sentence names one by one.
const MAX_STRETCHES: usize = 3;

/// What a question is answered from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kept {
    /// Events of presence.
    Presence,
    /// Events of falls.
    Falls,
    /// Activities, which are deleted earlier than events.
    Activities,
}

/// What is known of a range of time.
pub(super) struct Coverage {
    pub(super) range_ms: [i64; 2],
    pub(super) watched: Watched,
    /// Times of which something is known, in order.
    pub(super) known: Vec<Stretch>,
    first_run_ms: Option<i64>,
    newest_run: Option<Run>,
    /// Whether the question names a time.
    has_phrase: bool,
}

impl Coverage {
    /// Looks up what is known of a time.
    pub(super) fn of(
        timeline: &Timeline,
        when: &When,
        kept: Kept,
        clock: &Clock,
    ) -> Result<Self, StoreError> {
        let first_run_ms = timeline.first_run_ms()?;
        let from_ms = when.from_ms.or(first_run_ms).unwrap_or(0);
        let range_ms = [from_ms.max(0).min(when.to_ms), when.to_ms];
        let first_ms = match kept {
            Kept::Presence => range_ms[0].max(when.to_ms.saturating_sub(MAX_RANGE_MS)),
            Kept::Falls | Kept::Activities => range_ms[0],
        };
        let watched = timeline.watched([first_ms, when.to_ms], Some(clock.now_ms))?;
        let known = watched.known.iter().map(|known| Stretch {
            start_ms: match kept {
                Kept::Presence | Kept::Falls => known.stretch.start_ms,
                Kept::Activities => known.stretch.start_ms.max(known.activities_ms),
            },
            end_ms: known.stretch.end_ms,
        });
        Ok(Self {
            range_ms,
            known: known.filter(|s| s.start_ms < s.end_ms).collect(),
            watched,
            first_run_ms,
            newest_run: timeline.newest_run()?,
            has_phrase: !when.phrase.is_empty(),
        })
    }

    /// Time that may be unknown without being mentioned, ms.
    fn tolerance_ms(&self) -> i64 {
        let [from_ms, to_ms] = self.range_ms;
        (to_ms.saturating_sub(from_ms) / 100).min(MAX_UNKNOWN_MS)
    }

    /// Whether a fall of a time that has not ended is still open: `live` takes falls of a day over from an earlier run.
    pub(super) fn goes_on(&self, at_ms: i64, clock: &Clock) -> bool {
        let alive = self.newest_run.filter(|run| run.is_alive(clock.now_ms));
        alive.is_some_and(|run| run.start_ms.saturating_sub(DAY_MS) <= at_ms)
    }

    /// Until when something is known of the range.
    pub(super) fn end_ms(&self) -> Option<i64> {
        self.known.last().map(|stretch| stretch.end_ms)
    }

    /// Whether nothing is known of the range.
    pub(super) fn is_nothing(&self) -> bool {
        self.known.is_empty()
    }

    /// Whether all of the range is known.
    pub(super) fn is_whole(&self) -> bool {
        let known_ms: i64 = self.known.iter().map(|s| s.end_ms - s.start_ms).sum();
        let [from_ms, to_ms] = self.range_ms;
        !self.is_nothing() && to_ms.saturating_sub(from_ms) - known_ms <= self.tolerance_ms()
    }

    /// The times of which something is known: "from 22:00 yesterday to 01:10 today".
    pub(super) fn phrase(&self, clock: &Clock) -> String {
        let mut joined: Vec<Stretch> = Vec::new();
        for stretch in &self.known {
            match joined.last_mut() {
                Some(last) if stretch.start_ms - last.end_ms <= self.tolerance_ms() => {
                    last.end_ms = stretch.end_ms;
                }
                _ => joined.push(*stretch),
            }
        }
        match &joined[..] {
            [first, .., last] if joined.len() > MAX_STRETCHES => format!(
                "{} in {} stretches {}",
                duration(joined.iter().map(|s| s.end_ms - s.start_ms).sum()),
                joined.len(),
                clock.between(first.start_ms, last.end_ms)
            ),
            _ => list(
                joined.iter().map(|s| clock.between(s.start_ms, s.end_ms)),
                "and",
            ),
        }
    }

    /// What follows a denial: nothing, or of which part of the time it holds.
    pub(super) fn as_far(&self, clock: &Clock) -> String {
        match self.is_whole() {
            true => String::new(),
            false => format!(", as far as is known: {}", self.phrase(clock)),
        }
    }

    /// The sentence that follows a count: `None` if all of the time is known.
    pub(super) fn only(&self, clock: &Clock) -> Option<String> {
        let is_partly_known = !self.is_nothing() && !self.is_whole();
        is_partly_known.then(|| format!("Known of that time: {}.", self.phrase(clock)))
    }

    /// The sentence about a time of which nothing is known.
    pub(super) fn nothing(&self, clock: &Clock) -> String {
        let [from_ms, to_ms] = self.range_ms;
        let why = match (self.first_run_ms, self.newest_run) {
            (None, _) | (_, None) => "the memory is empty".to_string(),
            (Some(first_ms), _) if to_ms <= first_ms => {
                format!("the memory begins at {}", clock.moment(first_ms))
            }
            (_, Some(run)) if from_ms >= run.end_ms && !run.is_alive(clock.now_ms) => {
                format!("{} at {}", last_sign(&run), clock.moment(run.end_ms))
            }
            _ if !self.watched.known.is_empty() => "what was kept of it was deleted".into(),
            _ if !self.watched.silence.is_empty() => "the radar was silent".into(),
            _ => "`live` did not run, or replayed a recording that has no frames of it".into(),
        };
        match self.has_phrase {
            true => format!("Nothing is known of that time: {why}."),
            false => format!("Nothing is known: {why}."),
        }
    }
}

fn last_sign(run: &Run) -> &'static str {
    match run.is_over {
        true => "`live` ended",
        false => "the last sign of life of `live` was",
    }
}

/// What is known of the present.
pub(super) struct Now {
    source: Source,
    /// Whether somebody is there, or was when something was known last.
    pub(super) is_present: bool,
    /// Whether anything is known of the last weeks: the radar may have been silent ever since.
    has_known: bool,
    /// Until when something is known: the present time while a radar is watched.
    pub(super) known_ms: i64,
    /// The beginning of the newest run.
    start_ms: i64,
    /// Since when somebody has been there, or nobody, as far as that is known.
    since_ms: Option<i64>,
    /// When somebody was there last, if nobody is.
    last_ms: Option<i64>,
    /// Falls that have not ended.
    falls: Vec<Fall>,
    synthetic: bool,
}

enum Source {
    Watched,
    Silent { since_ms: i64 },
    Ended(Run),
}

impl Now {
    /// Looks up what is known of the present; `None` if nothing was ever watched.
    pub(super) fn of(timeline: &Timeline, clock: &Clock) -> Result<Option<Self>, StoreError> {
        let Some(run) = timeline.newest_run()? else {
            return Ok(None);
        };
        let is_alive = run.is_alive(clock.now_ms);
        let end_ms = match is_alive {
            true => run.end_ms.max(clock.now_ms),
            false => run.end_ms,
        };
        let range_ms = [end_ms.saturating_sub(MAX_RANGE_MS).max(0), end_ms];
        let watched = timeline.watched(range_ms, Some(clock.now_ms))?;
        let newest = watched.known.last();
        let has_known = newest.is_some();
        let known_ms = newest.map_or(run.start_ms, |known| known.stretch.end_ms);
        let silent_ms = watched
            .silence
            .last()
            .filter(|silence| silence.end_ms >= end_ms && silence.start_ms >= known_ms)
            .map(|silence| silence.start_ms);
        let is_present = newest.is_some_and(|known| known.is_present_at_end);
        let last = newest.and_then(|known| known.presence.last());
        let since_ms = match is_present {
            true => last.map(|presence| presence.start_ms),
            false => last.map(|presence| presence.end_ms),
        };
        let falls_ms = [
            end_ms.saturating_sub(DAY_MS).max(0),
            end_ms.saturating_add(1),
        ];
        let mut open = timeline.falls(falls_ms)?;
        open.retain(|fall| fall.is_open());
        Ok(Some(Self {
            source: match (is_alive, silent_ms) {
                (false, _) => Source::Ended(run),
                (true, Some(since_ms)) => Source::Silent { since_ms },
                (true, None) => Source::Watched,
            },
            is_present,
            has_known,
            known_ms,
            start_ms: run.start_ms,
            since_ms,
            last_ms: watched.presence().last().map(|presence| presence.end_ms),
            synthetic: watched.synthetic || open.iter().any(|fall| fall.synthetic),
            falls: open,
        }))
    }

    /// Whether a radar is watched and heard at present.
    pub(super) fn is_watched(&self) -> bool {
        matches!(self.source, Source::Watched)
    }

    /// Whether a fall has not ended.
    pub(super) fn has_fall(&self) -> bool {
        !self.falls.is_empty()
    }

    /// Whether a simulated radar is among the origins.
    pub(super) fn is_synthetic(&self) -> bool {
        self.synthetic
    }

    /// The sentence about the radar itself.
    pub(super) fn radar(&self, clock: &Clock) -> String {
        match &self.source {
            Source::Watched => {
                let start = clock.moment(self.start_ms);
                format!("The radar works: `live` runs since {start}, and frames arrive.")
            }
            Source::Silent { since_ms } => {
                format!("The radar is silent since {}.", clock.moment(*since_ms))
            }
            Source::Ended(run) => {
                let end = clock.moment(run.end_ms);
                format!("The radar is not watched: {} at {end}.", last_sign(run))
            }
        }
    }

    /// Sentences about whether somebody is there.
    pub(super) fn sentences(&self, clock: &Clock) -> Vec<String> {
        let moment = |ms: i64| clock.moment(ms);
        let since = |ms: i64| format!("{} ({})", moment(ms), duration(self.known_ms - ms));
        let mut sentences = Vec::new();
        match (&self.source, self.is_present) {
            (Source::Watched, true) => {
                let since_ms = self.since_ms.unwrap_or(self.known_ms);
                sentences.push(format!("Somebody is there, since {}.", since(since_ms)));
            }
            (Source::Watched, false) => match (self.since_ms, self.last_ms) {
                (Some(since_ms), _) => {
                    sentences.push(format!("Nobody is there, since {}.", since(since_ms)));
                }
                (None, Some(last_ms)) => sentences.push(format!(
                    "Nobody is there. Somebody was last there at {}.",
                    moment(last_ms)
                )),
                (None, None) => sentences.push("Nobody is there, and nobody was seen.".into()),
            },
            (Source::Silent { since_ms }, is_present) => {
                sentences.push(format!(
                    "Whether somebody is there is not known: the radar is silent since {}.",
                    moment(*since_ms)
                ));
                sentences.extend(self.until(is_present, clock));
            }
            (Source::Ended(run), is_present) => {
                sentences.extend(self.until(is_present, clock));
                if self.known_ms < run.end_ms || !self.has_known {
                    let known = moment(self.known_ms);
                    sentences.push(format!("The radar was silent since {known}."));
                }
                sentences.push(match run.is_over {
                    true => "Nothing is known of the time since: `live` does not run.".into(),
                    false => format!(
                        "Nothing is known of the time since: {} at {}.",
                        last_sign(run),
                        moment(run.end_ms)
                    ),
                });
            }
        }
        sentences.extend(self.falls(clock));
        sentences
    }

    /// Whether somebody was there when something was known last.
    fn until(&self, is_present: bool, clock: &Clock) -> Option<String> {
        let known = clock.moment(self.known_ms);
        self.has_known.then(|| match is_present {
            true => format!("Somebody was there until {known}."),
            false => format!("Nobody was there at {known}."),
        })
    }

    /// Sentences about falls that have not ended.
    pub(super) fn falls(&self, clock: &Clock) -> Vec<String> {
        let has_ended = matches!(self.source, Source::Ended(_));
        let falls = self.falls.iter();
        falls
            .map(|fall| open_fall(fall, has_ended, clock))
            .collect()
    }
}

/// The sentence about a fall that has not ended.
pub(super) fn open_fall(fall: &Fall, has_run_ended: bool, clock: &Clock) -> String {
    let at = clock.moment(fall.at_ms);
    match (fall.confirmed_ms.is_some(), has_run_ended) {
        (true, _) => format!("Whoever fell at {at} was not seen to get up."),
        (false, false) => format!("A fall is suspected since {at}, and not confirmed."),
        (false, true) => format!(
            "A fall was suspected at {at}, and neither confirmed nor dismissed before `live` ended."
        ),
    }
}
