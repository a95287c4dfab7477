//! Phrases of time.

use radarllm_base::civil::{self, DAY_MS, Date, HOUR_MS, MINUTE_MS, WEEKDAYS};
use serde::{Deserialize, Serialize};

use super::words::at;
use crate::error::StoreError;
use crate::store::limits::check_time;

/// The present time, and the local time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    /// The present time, milliseconds since 1970 in UTC.
    pub now_ms: i64,
    /// Offset of the local time, seconds east of UTC, at most a day. It holds for the whole question: across a change to
    /// summer time, days before the change are an hour off.
    pub offset_s: i32,
}

/// A range of time.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct When {
    /// The range in words, for a sentence: "today", "since 07:30 today"; empty for the whole memory.
    pub phrase: String,
    /// Its beginning, milliseconds since 1970 in UTC; `None` for the whole memory.
    pub from_ms: Option<i64>,
    /// Its end, milliseconds since 1970 in UTC, not after the present time.
    pub to_ms: i64,
}

/// A phrase that was found.
pub(super) struct Found {
    pub when: When,
    /// Number of its words.
    pub n_words: usize,
}

/// Parts of a day: name, first hour, last hour. A night ends on the next day.
const PARTS: [(&str, i64, i64); 4] = [
    ("morning", 4, 12),
    ("afternoon", 12, 18),
    ("evening", 18, 24),
    ("night", 20, 32),
];

/// Most units of a duration such as "the last 3 hours".
const MAX_UNITS: i64 = 10_000;

const NUMBERS: [&str; 12] = [
    "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven",
    "twelve",
];

impl Clock {
    pub(super) fn check(&self) -> Result<(), StoreError> {
        check_time("now_ms", self.now_ms)?;
        match self.offset_s {
            -86_400..=86_400 => Ok(()),
            _ => Err(StoreError::invalid(
                "offset_s",
                "at most a day",
                self.offset_s,
            )),
        }
    }

    /// Local time, ms since the local 1970-01-01.
    fn local_ms(&self, utc_ms: i64) -> i64 {
        utc_ms.saturating_add(i64::from(self.offset_s) * 1_000)
    }

    fn utc_ms(&self, local_ms: i64) -> i64 {
        local_ms.saturating_sub(i64::from(self.offset_s) * 1_000)
    }

    fn today(&self) -> i64 {
        self.local_ms(self.now_ms).div_euclid(DAY_MS)
    }

    /// A time of day: `07:12`.
    pub(super) fn time_of_day(&self, utc_ms: i64) -> String {
        let minutes = self.local_ms(utc_ms).rem_euclid(DAY_MS) / MINUTE_MS;
        format!("{:02}:{:02}", minutes / 60, minutes % 60)
    }

    /// A time as seen from the present: "07:12 today", "23:40 on Monday, 2026-11-16".
    pub(super) fn moment(&self, utc_ms: i64) -> String {
        let day = self.local_ms(utc_ms).div_euclid(DAY_MS);
        format!("{} {}", self.time_of_day(utc_ms), self.day_phrase(day))
    }

    fn day_phrase(&self, day: i64) -> String {
        match self.today().saturating_sub(day) {
            0 => "today".into(),
            1 => "yesterday".into(),
            _ => format!(
                "on {}, {}",
                WEEKDAYS[civil::weekday(day)],
                civil::date_text(day)
            ),
        }
    }

    /// The whole memory.
    pub(super) fn always(&self) -> When {
        When {
            phrase: String::new(),
            from_ms: None,
            to_ms: self.now_ms,
        }
    }

    fn span(&self, phrase: String, from_local_ms: i64, to_local_ms: i64) -> When {
        When {
            phrase,
            from_ms: Some(self.utc_ms(from_local_ms)),
            to_ms: self.utc_ms(to_local_ms).min(self.now_ms),
        }
    }

    fn since(&self, phrase: String, from_local_ms: i64) -> When {
        self.span(phrase, from_local_ms, i64::MAX)
    }

    /// A day, or a part of it.
    fn day(&self, day: i64, part: Option<(&str, i64, i64)>) -> When {
        let midnight = day.saturating_mul(DAY_MS);
        let phrase = self.day_phrase(day);
        match part {
            None => self.span(phrase, midnight, midnight + DAY_MS),
            Some((name, first_hour, last_hour)) => {
                let phrase = match (name, self.today().saturating_sub(day)) {
                    ("night", 1) => "last night".to_string(),
                    (_, 0) => format!("this {name}"),
                    _ => format!("{phrase}, in the {name}"),
                };
                let phrase = format!("{phrase} ({first_hour:02}:00 to {:02}:00)", last_hour % 24);
                let from = midnight + first_hour * HOUR_MS;
                self.span(phrase, from, midnight + last_hour * HOUR_MS)
            }
        }
    }
}

/// The first phrase of time among words, and its place.
pub(super) fn find(words: &[String], clock: &Clock) -> Option<(usize, Found)> {
    (0..words.len()).find_map(|i| Some((i, phrase(words, i, clock)?)))
}

/// The phrase of time that begins at a place.
fn phrase(words: &[String], start: usize, clock: &Clock) -> Option<Found> {
    since(words, start, clock)
        .or_else(|| rolling(words, start, clock))
        .or_else(|| week(words, start, clock))
        .or_else(|| {
            // "On Monday", "during last night".
            let skip = usize::from(is_one_of(words, start, &["on", "in", "during"]));
            let (day, part, n_words) = day_and_part(words, start + skip, clock)?;
            Some(Found {
                when: clock.day(day, part),
                n_words: n_words + skip,
            })
        })
}

/// "Since 07:30", "since midnight", "since Monday", "since yesterday morning".
fn since(words: &[String], start: usize, clock: &Clock) -> Option<Found> {
    if !at(words, start, &["since"]) {
        return None;
    }
    if let Some((minutes, n_words)) = time_of_day(words, start + 1) {
        let today = clock.today() * DAY_MS + minutes * MINUTE_MS;
        // A time that is still to come today was meant for yesterday.
        let from = match today <= clock.local_ms(clock.now_ms) {
            true => today,
            false => today - DAY_MS,
        };
        let phrase = format!("since {}", clock.moment(clock.utc_ms(from)));
        return Some(Found {
            when: clock.since(phrase, from),
            n_words: 1 + n_words,
        });
    }
    let (day, part, n_words) = day_and_part(words, start + 1, clock)?;
    let from = day * DAY_MS + part.map_or(0, |(_, first_hour, _)| first_hour * HOUR_MS);
    let phrase = format!("since {}", clock.moment(clock.utc_ms(from)));
    Some(Found {
        when: clock.since(phrase, from),
        n_words: 1 + n_words,
    })
}

/// "In the last 3 hours", "the past week", "in the last hour".
fn rolling(words: &[String], start: usize, clock: &Clock) -> Option<Found> {
    let mut i = start;
    i += usize::from(is_one_of(
        words,
        i,
        &["in", "during", "within", "over", "for"],
    ));
    i += usize::from(at(words, i, &["the"]));
    let has_the = i > start;
    if !is_one_of(words, i, &["last", "past"]) {
        return None;
    }
    i += 1;
    let n = words.get(i).and_then(|w| number(w));
    i += usize::from(n.is_some());
    let (unit, unit_ms) = match words.get(i)?.as_str() {
        "minute" | "minutes" | "min" | "mins" => ("minute", MINUTE_MS),
        "hour" | "hours" => ("hour", HOUR_MS),
        "day" | "days" => ("day", DAY_MS),
        // "Last week" is a week of the calendar, "the last week" the last seven days.
        "week" | "weeks" if has_the || n.is_some() => ("week", 7 * DAY_MS),
        _ => return None,
    };
    let phrase = match n {
        None | Some(1) => format!("in the last {unit}"),
        Some(n) => format!("in the last {n} {unit}s"),
    };
    let from = clock.local_ms(clock.now_ms) - n.unwrap_or(1) * unit_ms;
    Some(Found {
        when: clock.since(phrase, from),
        n_words: i + 1 - start,
    })
}

/// "This week", "last week": from Monday to Sunday.
fn week(words: &[String], start: usize, clock: &Clock) -> Option<Found> {
    let today = clock.today();
    // In 0..7.
    let monday = today - civil::weekday(today) as i64;
    let (phrase, from_day) = match () {
        () if at(words, start, &["this", "week"]) => ("this week", monday),
        () if at(words, start, &["last", "week"]) => ("last week", monday - 7),
        () => return None,
    };
    let phrase = format!("{phrase} (from Monday, {})", civil::date_text(from_day));
    Some(Found {
        when: clock.span(phrase, from_day * DAY_MS, (from_day + 7) * DAY_MS),
        n_words: 2,
    })
}

type Part = (&'static str, i64, i64);

/// A day and a part of it: "yesterday", "last night", "this morning", "Monday evening", "2026-11-20".
fn day_and_part(
    words: &[String],
    start: usize,
    clock: &Clock,
) -> Option<(i64, Option<Part>, usize)> {
    let today = clock.today();
    let part_at = |i: usize| {
        let word = words.get(i)?;
        PARTS.into_iter().find(|(name, ..)| name == word)
    };
    match (words.get(start)?.as_str(), part_at(start + 1)) {
        ("this", Some(part)) => return Some((today, Some(part), 2)),
        // The night from yesterday to today, also before its end.
        ("last", Some(part @ ("night", ..))) => return Some((today - 1, Some(part), 2)),
        ("last", Some(_)) => return None,
        ("tonight", _) => return Some((today, Some(PARTS[2]), 1)),
        _ => {}
    }
    let is_last = at(words, start, &["last"]);
    let i = start + usize::from(is_last);
    let word = words.get(i)?.as_str();
    let day = match word {
        "today" if !is_last => today,
        "yesterday" if !is_last => today - 1,
        _ => match WEEKDAYS.iter().position(|d| d.eq_ignore_ascii_case(word)) {
            Some(weekday) => {
                // In 0..7 each; the day is today or before, "last Monday" is before today.
                let days_ago = (civil::weekday(today) as i64 - weekday as i64).rem_euclid(7);
                match is_last && days_ago == 0 {
                    true => today - 7,
                    false => today - days_ago,
                }
            }
            None if is_last => return None,
            None => iso_date(word)?,
        },
    };
    // "Monday morning", "Monday in the morning", "Monday at night".
    let part = [&[][..], &["in", "the"], &["at"]]
        .into_iter()
        .filter(|before| at(words, i + 1, before))
        .find_map(|before| Some((part_at(i + 1 + before.len())?, before.len() + 1)));
    let (part, n_part) = part.map_or((None, 0), |(part, n)| (Some(part), n));
    Some((day, part, i + 1 - start + n_part))
}

/// `2026-11-20` to a day.
fn iso_date(word: &str) -> Option<i64> {
    let mut numbers = word.split('-');
    let mut next = |n_digits: usize| {
        let text = numbers.next().filter(|t| t.len() == n_digits)?;
        digits(text)
    };
    let date = Date {
        year: next(4)?,
        month: next(2)?,
        day: next(2)?,
    };
    match numbers.next() {
        None => civil::day(date),
        Some(_) => None,
    }
}

/// A time of day in minutes, and the number of its words: "07:30", "7", "7 pm", "7:30pm", "midnight", "7 o'clock".
fn time_of_day(words: &[String], start: usize) -> Option<(i64, usize)> {
    let word = words.get(start)?.as_str();
    match word {
        "midnight" => return Some((0, 1)),
        "noon" | "midday" => return Some((12 * 60, 1)),
        _ => {}
    }
    let (clock, half) = match word.strip_suffix("am").or(word.strip_suffix("pm")) {
        Some(clock) => (clock, Some(&word[clock.len()..])),
        None => (word, None),
    };
    let (half, n_words) = match (half, words.get(start + 1).map(String::as_str)) {
        (None, Some(next @ ("am" | "pm"))) => (Some(next), 2),
        (None, Some("o'clock")) => (None, 2),
        (half, _) => (half, 1),
    };
    let (hour, minute) = clock.split_once(':').unwrap_or((clock, "00"));
    if hour.len() > 2 || minute.len() != 2 {
        return None;
    }
    let (hour, minute) = (digits(hour)?, digits(minute)?);
    let hour = match (half, hour) {
        (None, 0..=23) => hour,
        (Some("am"), 1..=12) => hour % 12,
        (Some(_), 1..=12) => hour % 12 + 12,
        _ => return None,
    };
    (minute < 60).then_some((hour * 60 + minute, n_words))
}

fn number(word: &str) -> Option<i64> {
    let named = NUMBERS.iter().position(|n| *n == word);
    let n = match named {
        Some(index) => index as i64 + 1,
        None => digits(word)?,
    };
    (1..=MAX_UNITS).contains(&n).then_some(n)
}

/// A number of decimal digits only, without a sign.
fn digits(text: &str) -> Option<i64> {
    match text.bytes().all(|b| b.is_ascii_digit()) {
        true => text.parse().ok(),
        false => None,
    }
}

fn is_one_of(words: &[String], index: usize, wanted: &[&str]) -> bool {
    words
        .get(index)
        .is_some_and(|w| wanted.contains(&w.as_str()))
}
