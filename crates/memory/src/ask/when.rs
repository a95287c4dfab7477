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
struct Found {
    when: When,
    /// The day, and the part of it, if the phrase names one.
    day: Option<Day>,
    /// Number of its words.
    n_words: usize,
}

/// A day, as the number of days since 1970, and a part of it.
type Day = (i64, Option<Part>);
/// Part of a day: name, first hour, last hour.
type Part = (&'static str, i64, i64);

/// Times of a day, in minutes.
#[derive(Clone, Copy)]
enum Hours {
    /// About a time, so many minutes before and after it.
    About(i64, i64),
    /// From one time to another one, which may be on the next day.
    Between(i64, i64),
    Before(i64),
    After(i64),
}

/// Which phrases of time are known, for a refusal.
pub(super) const KNOWN_TIMES: &str = "Known times are \u{201c}today\u{201d}, \u{201c}yesterday morning\u{201d}, \
     \u{201c}last night\u{201d}, \u{201c}on Monday\u{201d}, \u{201c}on 28 November\u{201d}, \u{201c}two days ago\u{201d}, \
     \u{201c}in the last 3 hours\u{201d}, \u{201c}this week\u{201d}, \u{201c}this month\u{201d}, \u{201c}since 22:00\u{201d}, \
     \u{201c}between 14:00 and 15:00\u{201d}, \u{201c}before 6 am\u{201d} and \u{201c}at 3 am yesterday\u{201d}.";

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

    /// A range as seen from the present: "from 22:00 yesterday to 01:10 today".
    pub(super) fn between(&self, from_ms: i64, to_ms: i64) -> String {
        let day = |ms: i64| self.local_ms(ms).div_euclid(DAY_MS);
        let from = match day(from_ms) == day(to_ms) {
            true => self.time_of_day(from_ms),
            false => self.moment(from_ms),
        };
        format!("from {from} to {}", self.moment(to_ms))
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

    /// The last 24 hours.
    pub(super) fn last_day_and_night(&self) -> When {
        let from_ms = self.local_ms(self.now_ms).saturating_sub(DAY_MS);
        self.since("in the last 24 hours".into(), from_ms)
    }

    fn since_moment(&self, from_local_ms: i64) -> When {
        let phrase = format!("since {}", self.moment(self.utc_ms(from_local_ms)));
        self.since(phrase, from_local_ms)
    }

    /// The day of the last time at so many minutes of a day: one that is still to come today was meant for yesterday.
    fn last_day(&self, minutes: i64) -> i64 {
        let today = self.today();
        let at_ms = today.saturating_mul(DAY_MS) + minutes * MINUTE_MS;
        match at_ms <= self.local_ms(self.now_ms) {
            true => today,
            false => today - 1,
        }
    }

    /// Times of a day; `None` if the named part of the day does not have them.
    fn hours(&self, hours: Hours, day: Option<Day>) -> Option<When> {
        let part = day.and_then(|(_, part)| part);
        let (first, last) = part.map_or((0, 24 * 60), |(_, from, to)| (60 * from, 60 * to));
        // Of a night, the early hours are on the next day.
        let place = |minutes: i64| {
            let mut places = [minutes, minutes + 24 * 60].into_iter();
            places.find(|minutes| (first..=last).contains(minutes))
        };
        let (from, to) = match hours {
            Hours::About(at, half) => {
                let at = place(at)?;
                (at - half, at + half)
            }
            Hours::Between(from, to) => {
                let start = place(from)?;
                let length = (to - from).rem_euclid(24 * 60);
                (start, start + if length == 0 { 24 * 60 } else { length })
            }
            Hours::Before(to) => (first, place(to)?),
            Hours::After(from) => (place(from)?, last),
        };
        let local_ms = |day: i64, minutes: i64| day.saturating_mul(DAY_MS) + minutes * MINUTE_MS;
        let day = match (day, hours) {
            (Some((day, _)), _) => day,
            (None, Hours::After(from)) => {
                return Some(self.since_moment(local_ms(self.last_day(from), from)));
            }
            (None, Hours::Before(_)) => self.today(),
            (None, Hours::About(at, _)) => self.last_day(at),
            (None, Hours::Between(from, _)) => self.last_day(from),
        };
        let (from_ms, to_ms) = (local_ms(day, from), local_ms(day, to));
        let [from_utc, to_utc] = [from_ms, to_ms].map(|ms| self.utc_ms(ms));
        let phrase = match hours {
            Hours::About(_, half) => format!(
                "around {} ({} to {})",
                self.moment(from_utc + half * MINUTE_MS),
                self.time_of_day(from_utc),
                self.time_of_day(to_utc)
            ),
            _ => self.between(from_utc, to_utc),
        };
        Some(self.span(phrase, from_ms, to_ms))
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

/// Takes the phrases of time from words: a time, a day, or both, such as "at 14:10 yesterday".
pub(super) fn take(words: &mut Vec<String>, clock: &Clock) -> When {
    let mut rest = words.clone();
    if let Some(hours) = take_hours(&mut rest) {
        let found = find(&rest, clock);
        let day = found.as_ref().map(|(_, found)| found.day);
        // The hours of a week are not known.
        let when = match day {
            Some(None) => None,
            Some(day) => clock.hours(hours, day),
            None => clock.hours(hours, None),
        };
        if let Some(when) = when {
            if let Some((start, found)) = found {
                rest.drain(start..start + found.n_words);
            }
            *words = rest;
            return when;
        }
    }
    match find(words, clock) {
        Some((start, found)) => {
            words.drain(start..start + found.n_words);
            found.when
        }
        None => clock.always(),
    }
}

/// The first phrase of time among words, and its place.
fn find(words: &[String], clock: &Clock) -> Option<(usize, Found)> {
    (0..words.len()).find_map(|i| Some((i, phrase(words, i, clock)?)))
}

/// Takes times of a day: "at 3 am", "between 14:00 and 15:00", "before 6", "after midnight".
fn take_hours(words: &mut Vec<String>) -> Option<Hours> {
    let (start, n_words, hours) = (0..words.len()).find_map(|i| {
        let (n_words, hours) = hours_at(words, i)?;
        Some((i, n_words, hours))
    })?;
    words.drain(start..start + n_words);
    Some(hours)
}

/// The times of a day that begin at a place, and the number of their words.
fn hours_at(words: &[String], start: usize) -> Option<(usize, Hours)> {
    let word = words.get(start)?.as_str();
    let skip = usize::from(is_one_of(words, start + 1, &["about", "around"]));
    let first = start + 1 + skip;
    let (minutes, n_words) = time_of_day(words, first)?;
    let n_first = first + n_words - start;
    match word {
        "at" | "around" | "about" => {
            let is_exact = words[first].contains(':');
            let half_min = if is_exact { 15 } else { 30 };
            Some((n_first, Hours::About(minutes, half_min)))
        }
        "before" | "until" | "till" if minutes > 0 => Some((n_first, Hours::Before(minutes))),
        "after" => Some((n_first, Hours::After(minutes))),
        "between" | "from" => {
            let and = ["and", "to", "until", "till"];
            if !is_one_of(words, start + n_first, &and) {
                return None;
            }
            let second = start + n_first + 1;
            let (to, n_second) = time_of_day(words, second)?;
            // "Between 2 and 3 pm".
            let has_half = |from: usize, n: usize| {
                let mut words = words[from..from + n].iter();
                words.any(|w| w.ends_with("am") || w.ends_with("pm"))
            };
            let noon = 12 * 60;
            let is_pm = has_half(second, n_second) && to >= noon && !has_half(first, n_words);
            let from = match is_pm && minutes < noon && minutes + noon < to {
                true => minutes + noon,
                false => minutes,
            };
            Some((n_first + 1 + n_second, Hours::Between(from, to)))
        }
        _ => None,
    }
}

/// The phrase of time that begins at a place.
fn phrase(words: &[String], start: usize, clock: &Clock) -> Option<Found> {
    since(words, start, clock)
        .or_else(|| rolling(words, start, clock))
        .or_else(|| week(words, start, clock))
        .or_else(|| month(words, start, clock))
        .or_else(|| two_days(words, start, clock))
        .or_else(|| {
            // "On Monday", "on the 28th of November", "during last night".
            let skip = usize::from(is_one_of(words, start, &["on", "in", "during"]));
            let skip = skip + usize::from(skip > 0 && at(words, start + skip, &["the"]));
            let (day, part, n_words) = day_and_part(words, start + skip, clock)
                .map(|(day, part, n_words)| (day, part, n_words + skip))
                .or_else(|| part_alone(words, start, clock))?;
            Some(Found {
                when: clock.day(day, part),
                day: Some((day, part)),
                n_words,
            })
        })
}

/// "Yesterday or today".
fn two_days(words: &[String], start: usize, clock: &Clock) -> Option<Found> {
    let is_conjunction = is_one_of(words, start + 1, &["or", "and"]);
    let is_found = is_conjunction
        && (at(words, start, &["yesterday"]) && at(words, start + 2, &["today"])
            || at(words, start, &["today"]) && at(words, start + 2, &["yesterday"]));
    is_found.then(|| Found {
        when: clock.since("yesterday or today".into(), (clock.today() - 1) * DAY_MS),
        day: None,
        n_words: 3,
    })
}

/// "At night", "during the night", "in the morning": the last one that has begun.
fn part_alone(words: &[String], start: usize, clock: &Clock) -> Option<(i64, Option<Part>, usize)> {
    let before: [&[&str]; 6] = [
        &["at"],
        &["in", "the"],
        &["during", "the"],
        &["over", "the"],
        &["through", "the"],
        &["overnight"],
    ];
    let n_before = before.into_iter().find(|before| at(words, start, before))?;
    let is_overnight = at(words, start, &["overnight"]);
    let name = match is_overnight {
        true => "night",
        false => words.get(start + n_before.len())?,
    };
    let part = PARTS.into_iter().find(|(part, ..)| *part == name)?;
    let today = clock.today();
    let begins_ms = today.saturating_mul(DAY_MS) + part.1 * HOUR_MS;
    let day = match begins_ms <= clock.local_ms(clock.now_ms) {
        true => today,
        false => today - 1,
    };
    let n_words = n_before.len() + usize::from(!is_overnight);
    Some((day, Some(part), n_words))
}

/// "This month", "last month".
fn month(words: &[String], start: usize, clock: &Clock) -> Option<Found> {
    let this = civil::date(clock.today());
    let n_ago = match () {
        () if at(words, start, &["this", "month"]) => 0,
        () if at(words, start, &["last", "month"]) => 1,
        () => return None,
    };
    let first = |n_months: i64| {
        let months = this.year * 12 + this.month - 1 + n_months;
        civil::day(Date {
            year: months.div_euclid(12),
            month: months.rem_euclid(12) + 1,
            day: 1,
        })
    };
    let (from_day, to_day) = (first(-n_ago)?, first(1 - n_ago)?);
    let name = if n_ago == 0 {
        "this month"
    } else {
        "last month"
    };
    let phrase = format!("{name} (from {})", civil::date_text(from_day));
    Some(Found {
        when: clock.span(phrase, from_day * DAY_MS, to_day * DAY_MS),
        day: None,
        n_words: 2,
    })
}

/// "Since 07:30", "since midnight", "since Monday", "since yesterday morning".
fn since(words: &[String], start: usize, clock: &Clock) -> Option<Found> {
    if !at(words, start, &["since"]) {
        return None;
    }
    if let Some((minutes, n_words)) = time_of_day(words, start + 1) {
        // "Since noon yesterday".
        let named = day_and_part(words, start + 1 + n_words, clock);
        let named = named.filter(|(_, part, _)| part.is_none());
        let (day, n_day) = match named {
            Some((day, _, n_day)) => (day, n_day),
            None => (clock.last_day(minutes), 0),
        };
        let from = day.saturating_mul(DAY_MS) + minutes * MINUTE_MS;
        return Some(Found {
            when: clock.since_moment(from),
            day: None,
            n_words: 1 + n_words + n_day,
        });
    }
    let (day, part, n_words) = day_and_part(words, start + 1, clock)?;
    let from = day * DAY_MS + part.map_or(0, |(_, first_hour, _)| first_hour * HOUR_MS);
    Some(Found {
        when: clock.since_moment(from),
        day: None,
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
        day: None,
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
        day: None,
        n_words: 2,
    })
}

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
    let mut i = start + usize::from(is_last);
    let word = words.get(i)?.as_str();
    let other = match is_last {
        true => None,
        false => days_ago(words, i, clock).or_else(|| date_in_words(words, i, clock)),
    };
    let day = match (word, other) {
        (_, Some((day, n_words))) => {
            i += n_words - 1;
            day
        }
        ("today", _) if !is_last => today,
        ("yesterday", _) if !is_last => today - 1,
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

/// "Two days ago", "a week ago", "the day before yesterday", and the number of words.
fn days_ago(words: &[String], start: usize, clock: &Clock) -> Option<(i64, usize)> {
    let today = clock.today();
    let skip = usize::from(at(words, start, &["the"]));
    if at(words, start + skip, &["day", "before", "yesterday"]) {
        return Some((today - 2, 3 + skip));
    }
    let n = match words.get(start)?.as_str() {
        "a" | "an" => 1,
        word => number(word)?,
    };
    let n_days = match words.get(start + 1)?.as_str() {
        "day" | "days" => n,
        "week" | "weeks" => 7 * n,
        _ => return None,
    };
    at(words, start + 2, &["ago"]).then_some((today - n_days, 3))
}

/// "28 November", "the 28th of November 2026", "November 28", and the number of words. Without a year, the last such day.
fn date_in_words(words: &[String], start: usize, clock: &Clock) -> Option<(i64, usize)> {
    const MONTHS: [&str; 12] = [
        "january",
        "february",
        "march",
        "april",
        "may",
        "june",
        "july",
        "august",
        "september",
        "october",
        "november",
        "december",
    ];
    let month_at = |i: usize| {
        let word = words.get(i)?;
        let index = MONTHS.iter().position(|month| month == word)?;
        Some(index as i64 + 1)
    };
    let day_at = |i: usize| {
        let word = words.get(i)?;
        let suffixes = ["st", "nd", "rd", "th"];
        let bare = suffixes.iter().find_map(|suffix| word.strip_suffix(suffix));
        digits(bare.unwrap_or(word)).filter(|day| (1..=31).contains(day))
    };
    let (month, day, n_words) = match month_at(start) {
        Some(month) => (month, day_at(start + 1)?, 2),
        None => {
            let day = day_at(start)?;
            let n_of = usize::from(at(words, start + 1, &["of"]));
            (month_at(start + 1 + n_of)?, day, 2 + n_of)
        }
    };
    let year = words.get(start + n_words).filter(|word| word.len() == 4);
    if let Some(year) = year.and_then(|word| digits(word)) {
        return Some((civil::day(Date { year, month, day })?, n_words + 1));
    }
    let today = clock.today();
    let this_year = civil::date(today).year;
    let in_year = |year| civil::day(Date { year, month, day });
    let this = in_year(this_year)?;
    match this <= today {
        true => Some((this, n_words)),
        false => Some((in_year(this_year - 1)?, n_words)),
    }
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
