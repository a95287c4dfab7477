//! The times of a table: written as dates, or as numbers whose unit their size and their steps show.

use radarllm_base::{
    RecordedFrame,
    civil::{self, DAY_MS, Date},
    stats::median_upper,
};

use crate::recordings::{Place, RecordingError};

/// Steps between frames that a radar can have, s.
const FRAME_STEPS_S: std::ops::RangeInclusive<f64> = 0.001..=1.0;
/// Seconds since 1970 in 2001 and in 2096: the times of day that a number in these units can mean.
const UNIX_S: std::ops::Range<f64> = 1e9..4e9;
/// Units of a clock, with their names. The first one that fits is taken: frames that are 1 s apart are more likely than
/// frames that are 1 ms apart.
const UNITS: [(&str, f64); 4] = [
    ("seconds", 1.0),
    ("milliseconds", 1e-3),
    ("microseconds", 1e-6),
    ("nanoseconds", 1e-9),
];
const DAY_S: f64 = DAY_MS as f64 / 1e3;

/// A time in a cell.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum CellTime {
    /// A number in the unit of the column.
    Number(f64),
    /// A date with time, in s since 1970, as if the zone were UTC where none is stated.
    Date(f64),
    /// A time of day without date, in s since midnight.
    OfDay(f64),
}

impl CellTime {
    pub(super) fn value(self) -> f64 {
        match self {
            Self::Number(v) | Self::Date(v) | Self::OfDay(v) => v,
        }
    }

    pub(super) fn is_like(self, other: Self) -> bool {
        std::mem::discriminant(&self) == std::mem::discriminant(&other)
    }
}

/// Reads digits of a text from front to back.
struct Digits<'a>(&'a [u8]);

impl Digits<'_> {
    /// A number of exactly `n` digits up to `max`.
    fn number(&mut self, n: usize, max: i64) -> Option<i64> {
        let (digits, rest) = self.0.split_at_checked(n)?;
        if !digits.iter().all(u8::is_ascii_digit) {
            return None;
        }
        self.0 = rest;
        let value = digits
            .iter()
            .fold(0, |v, digit| 10 * v + i64::from(digit - b'0'));
        (value <= max).then_some(value)
    }

    /// One of these characters.
    fn any(&mut self, of: &[u8]) -> Option<u8> {
        let (first, rest) = self.0.split_first()?;
        of.contains(first).then(|| {
            self.0 = rest;
            *first
        })
    }
}

/// Parses a date with time as ISO 8601 and Python write it, or a time of day. Years have four digits.
pub(super) fn parse_date(text: &str) -> Option<CellTime> {
    let mut d = Digits(text.as_bytes());
    let day_s = date(&mut d);
    if day_s.is_none() {
        d = Digits(text.as_bytes());
    }
    let is_basic = day_s.is_some_and(|(_, is_basic)| is_basic);
    let hour = d.number(2, 24)?;
    let colon = |d: &mut Digits| match is_basic {
        true => d.any(b":").map_or(Some(b':'), Some),
        false => d.any(b":"),
    };
    colon(&mut d)?;
    let minute = d.number(2, 59)?;
    let mut second = 0.0;
    if !d.0.is_empty() && !matches!(d.0.first(), Some(b'Z' | b'z' | b'+' | b'-' | b' ')) {
        colon(&mut d)?;
        second = d.number(2, 60)? as f64;
        if d.any(b".,").is_some() {
            let n = d.0.iter().take_while(|b| b.is_ascii_digit()).count();
            let (digits, rest) = d.0.split_at_checked(n)?;
            d.0 = rest;
            let fraction = std::str::from_utf8(digits).ok()?;
            second += format!("0.{fraction}").parse::<f64>().ok()?;
        }
    }
    let mut offset_s = 0.0;
    d.any(b" ");
    if let Some(sign) = d.any(b"+-") {
        let hours = d.number(2, 23)?;
        d.any(b":");
        let minutes = match d.0.is_empty() {
            true => 0,
            false => d.number(2, 59)?,
        };
        offset_s = (3600 * hours + 60 * minutes) as f64;
        if sign == b'-' {
            offset_s = -offset_s;
        }
    } else if d.0.eq_ignore_ascii_case(b"UTC") || d.0.eq_ignore_ascii_case(b"Z") {
        d.0 = b"";
    }
    if !d.0.is_empty() {
        return None;
    }
    let of_day_s = (3600 * hour + 60 * minute) as f64 + second;
    Some(match day_s {
        Some((day_s, _)) => CellTime::Date(day_s + of_day_s - offset_s),
        None => CellTime::OfDay(of_day_s),
    })
}

/// The date at the beginning with the character after it: its start in s since 1970, and whether it has no separators.
fn date(d: &mut Digits) -> Option<(f64, bool)> {
    let year = d.number(4, 9999)?;
    let separator = d.any(b"-/");
    let month = d.number(2, 12)?;
    if let Some(separator) = separator {
        d.any(&[separator])?;
    }
    let day = d.number(2, 31)?;
    d.any(b"Tt _")?;
    let days = civil::day(Date { year, month, day })?;
    Some((days as f64 * DAY_S, separator.is_none()))
}

/// The median of the steps between the distinct times of frames; `None` if the times do not grow.
pub(super) fn median_step(times: impl Iterator<Item = f64>) -> Option<f64> {
    let mut last = None;
    let mut steps = Vec::new();
    for time in times {
        if let Some(before) = last
            && time > before
        {
            steps.push(time - before);
        }
        last = Some(time);
    }
    median_upper(steps)
}

/// The unit of a clock.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct ClockUnit {
    pub(super) name: &'static str,
    /// Seconds in one of it.
    pub(super) factor: f64,
    /// The median step between frames, in this unit; `None` if the times do not grow.
    pub(super) step: Option<f64>,
}

/// The unit of a clock whose name states none; `None` where the times have no steps and no size that could tell.
///
/// # Errors
/// The median step and what it would be, if it is no step of frames in any unit, or if it contradicts the size.
pub(super) fn unit_of(
    place: Place,
    name: &str,
    times: impl Iterator<Item = f64> + Clone,
) -> Result<Option<ClockUnit>, RecordingError> {
    let unit = |(name, factor), step| Ok(Some(ClockUnit { name, factor, step }));
    let first = times.clone().next();
    let by_size = UNITS
        .into_iter()
        .find(|(_, factor)| first.is_some_and(|first| UNIX_S.contains(&(first * factor))));
    let Some(step) = median_step(times) else {
        return by_size.map_or(Ok(None), |found| unit(found, None));
    };
    let is_step = |factor: f64| {
        // A step of 1 ms in a sum of seconds is 0.99999 ms.
        let step_s = step * factor;
        FRAME_STEPS_S.contains(&(step_s * (1.0 + 1e-6))) || FRAME_STEPS_S.contains(&step_s)
    };
    if let Some(found) = by_size
        && is_step(found.1)
    {
        return unit(found, Some(step));
    }
    let by_step = UNITS.into_iter().find(|(_, factor)| is_step(*factor));
    match (by_step, by_size) {
        // What the size says would be hours between two frames: the size is that of a counter.
        (Some(found), Some((_, other))) if step * other > 3600.0 => unit(found, Some(step)),
        (Some(found), None) => unit(found, Some(step)),
        (by_step, by_size) => {
            let says = |found: Option<(&str, f64)>, what: &str| {
                found.map(|(unit, _)| format!("; their {what} that of {unit}"))
            };
            let detail = [says(by_size, "size is"), says(by_step, "step is")];
            let detail: String = detail.into_iter().flatten().collect();
            Err(RecordingError {
                at: place,
                expected: format!(
                    "times in `{name}` of frames that are 1 ms to 1 s apart, in s, ms, \u{b5}s or ns"
                ),
                found: format!(
                    "a median step of {step}{detail}; a name such as `t_ms` states the unit"
                ),
            })
        }
    }
}

/// Joins the rows of a frame where every row has a time of its own, as a recorder writes them that asks the clock for each
/// point: short steps within frames and long ones between them. Returns the length of the longest short step, in the unit of
/// the times. `unit_s` is that unit in s where it is known.
///
/// A radar that reports one point a frame has steps of one length, and pauses of any length.
pub(super) fn join_rows(frames: &mut Vec<RecordedFrame>, unit_s: Option<f64>) -> Option<f64> {
    /// Fewer rows show nothing.
    const MIN_ROWS: usize = 20;
    /// Share of the rows that have a time of their own.
    const ALONE: f64 = 0.8;
    /// How many times longer steps between frames are: where the unit is known, and short steps are shorter than any frame
    /// period (s), or wherever it may be otherwise.
    const RATIO: f64 = 10.0;
    const WITHIN_S: f64 = 0.005;
    const CLEAR_RATIO: f64 = 100.0;
    /// Number and share of long steps, and how much nine tenths of them may differ.
    const MIN_LONG: usize = 3;
    const LONG: f64 = 0.01;
    const SPREAD: f64 = 3.0;

    let n_alone = frames.iter().filter(|f| f.points.len() <= 1).count();
    if frames.len() < MIN_ROWS || (n_alone as f64) < ALONE * frames.len() as f64 {
        return None;
    }
    let times: Option<Vec<f64>> = frames.iter().map(|f| f.stamp_s).collect();
    let times = times?;
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.retain(|step| *step > 0.0);
    steps.sort_by(f64::total_cmp);
    let ratio = |at: &usize| steps[at + 1] / steps[*at];
    let last_short =
        (0..steps.len().saturating_sub(1)).max_by(|a, b| ratio(a).total_cmp(&ratio(b)))?;
    let (short, long) = steps.split_at(last_short + 1);
    let of = |steps: &[f64], share: f64| steps[((steps.len() - 1) as f64 * share) as usize];
    let is_short = unit_s.is_some_and(|unit_s| of(short, 0.5) * unit_s < WITHIN_S);
    let min_ratio = if is_short { RATIO } else { CLEAR_RATIO };
    let are_frames = ratio(&last_short) >= min_ratio
        && short.len() >= long.len()
        && long.len() >= MIN_LONG.max((LONG * steps.len() as f64) as usize)
        && of(long, 0.9) <= SPREAD * of(long, 0.1);
    if !are_frames {
        return None;
    }
    let longest = short[last_short];
    let mut before = f64::NEG_INFINITY;
    let mut joined: Vec<RecordedFrame> = Vec::new();
    for (mut row, time) in std::mem::take(frames).into_iter().zip(times) {
        match joined.last_mut() {
            Some(frame) if (0.0..=longest).contains(&(time - before)) => {
                frame.points.append(&mut row.points);
            }
            _ => {
                row.number = joined.len() as u64;
                joined.push(row);
            }
        }
        before = time;
    }
    *frames = joined;
    Some(longest)
}

/// The seconds in the unit of times that are Unix times, which their size shows.
pub(super) fn unix_unit_s(first: f64) -> Option<f64> {
    let mut units = UNITS.into_iter().map(|(_, factor)| factor);
    units.find(|factor| UNIX_S.contains(&(first * factor)))
}

/// Frames a second of a clock that is too coarse to tell frames apart, from the numbers of the frames; `None` if it is not.
pub(super) fn coarse_rate_hz(frames: &[RecordedFrame]) -> Option<f64> {
    let mut n_same = 0;
    for pair in frames.windows(2) {
        n_same += usize::from(pair[0].stamp_s? == pair[1].stamp_s?);
    }
    let (first, last) = (frames.first()?, frames.last()?);
    let seconds = last.stamp_s? - first.stamp_s?;
    let n_periods = last.number.checked_sub(first.number)? as f64;
    (2 * n_same > frames.len() && seconds > 0.0).then(|| n_periods / seconds)
}

/// Continues clocks that run backwards: the frames follow on, one median step later. Times of day that pass midnight go
/// on. Returns how often the clock went back, with the first of these steps in s and the index of its frame.
pub(super) fn continue_clock(
    frames: &mut [RecordedFrame],
    is_of_day: bool,
) -> Option<(usize, f64, usize)> {
    let step_s = median_step(frames.iter().filter_map(|f| f.stamp_s)).unwrap_or(0.0);
    let mut offset_s = 0.0;
    let mut last: Option<f64> = None;
    let mut found: Option<(usize, f64, usize)> = None;
    for (i, frame) in frames.iter_mut().enumerate() {
        let Some(raw_s) = frame.stamp_s else {
            continue;
        };
        if let Some(before_s) = last
            && raw_s < before_s
        {
            if is_of_day && before_s - raw_s > 0.5 * DAY_S {
                offset_s += DAY_S;
            } else {
                offset_s += before_s - raw_s + step_s;
                let n = found.map_or(1, |(n, ..)| n + 1);
                let (_, back_s, at) = found.unwrap_or((0, before_s - raw_s, i));
                found = Some((n, back_s, at));
            }
        }
        last = Some(raw_s);
        frame.stamp_s = Some(raw_s + offset_s);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_seconds_since_1970() {
        // `date -u -d ... +%s` says these.
        for (text, expected) in [
            ("1970-01-01T00:00:00Z", 0.0),
            ("2024-02-29 12:00:00", 1_709_208_000.0),
            ("2024-12-16 10:00:00.100000", 1_734_343_200.1),
            ("2024-12-16T10:00:00,25", 1_734_343_200.25),
            ("2024/12/16 10:00:00", 1_734_343_200.0),
            ("2024-12-16T10:00:00+02:00", 1_734_336_000.0),
            ("2024-12-16T10:00:00.5-0530", 1_734_363_000.5),
            ("20241216T100000.5Z", 1_734_343_200.5),
            ("2024-12-16 10:00:00 UTC", 1_734_343_200.0),
            ("2024-12-16T10:00", 1_734_343_200.0),
            ("2000-03-01 00:00:00", 951_868_800.0),
        ] {
            assert_eq!(parse_date(text), Some(CellTime::Date(expected)), "{text}");
        }
        assert_eq!(parse_date("23:59:59.5"), Some(CellTime::OfDay(86_399.5)));
        for text in [
            "",
            "2024",
            "2024-12-16",
            "2024-13-16 10:00:00",
            "2023-02-29 10:00:00",
            "2024-12-16 10:61:00",
            "2024-12/16 10:00:00",
            "2024-12-16 10:00:00 later",
            "1:2:3",
            "12",
            "12.5",
            "2024-12-16 10:00:00.+",
            "\u{fc}\u{fc}\u{fc}",
        ] {
            assert_eq!(parse_date(text), None, "{text}");
        }
    }

    #[test]
    fn the_unit_follows_from_steps_and_size() {
        let of = |start: f64, step: f64| {
            let times = (0..20).map(move |n| start + f64::from(n / 2) * step);
            unit_of(Place::Line(1), "t", times).map(|u| u.map(|u| u.name))
        };
        for (start, step, unit) in [
            (0.0, 0.1, "seconds"),
            (100.0, 100.0, "milliseconds"),
            (0.0, 50_000.0, "microseconds"),
            (0.0, 1e8, "nanoseconds"),
            (1.7e9, 0.05, "seconds"),
            (1.7e12, 50.0, "milliseconds"),
            (1.7e15, 50_000.0, "microseconds"),
            (1.7e18, 5e7, "nanoseconds"),
            // The boundary between two units: once a second, unless the size says another.
            (0.0, 1.0, "seconds"),
            (1.7e12, 1.0, "milliseconds"),
            (1.7e12, 1000.0, "milliseconds"),
            // A counter of half an hour in microseconds.
            (1.8e9, 100_000.0, "microseconds"),
        ] {
            assert_eq!(of(start, step), Ok(Some(unit)), "{start} {step}");
        }
        let error = of(1.7e12, 5000.0).unwrap_err().to_string();
        assert!(
            error
                .contains("their size is that of milliseconds; their step is that of microseconds"),
            "{error}"
        );
        let error = of(0.0, 1e-5).unwrap_err().to_string();
        assert!(error.contains("a median step of"), "{error}");
        assert_eq!(of(5.0, 0.0), Ok(None));
        assert_eq!(of(1.7e12, 0.0), Ok(Some("milliseconds")));
    }
}
