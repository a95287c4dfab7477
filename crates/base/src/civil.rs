//! Days, dates and times of day.
//!
//! Days are counted from 1970-01-01. Local time is UTC and an offset that the caller gives; nothing here knows time
//! zones or reads a clock.

/// Milliseconds of a day.
pub const DAY_MS: i64 = 86_400_000;
/// Milliseconds of an hour.
pub const HOUR_MS: i64 = 3_600_000;
/// Milliseconds of a minute.
pub const MINUTE_MS: i64 = 60_000;

/// Names of the days of the week, from Monday.
pub const WEEKDAYS: [&str; 7] = [
    "Monday",
    "Tuesday",
    "Wednesday",
    "Thursday",
    "Friday",
    "Saturday",
    "Sunday",
];

/// A date of the Gregorian calendar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Date {
    /// Year.
    pub year: i64,
    /// Month, from 1.
    pub month: i64,
    /// Day of the month, from 1.
    pub day: i64,
}

/// The date of a day (Hinnant, "chrono-Compatible Low-Level Date Algorithms", `civil_from_days`).
pub fn date(days_since_1970: i64) -> Date {
    let days = days_since_1970 + 719_468;
    let (era, day_of_era) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let month = match shifted_month < 10 {
        true => shifted_month + 3,
        false => shifted_month - 9,
    };
    Date {
        year: year_of_era + era * 400 + i64::from(month <= 2),
        month,
        day: day_of_year - (153 * shifted_month + 2) / 5 + 1,
    }
}

/// The day of a date from 1970 to 9999, or `None` if there is no such date (same source, `days_from_civil`).
pub fn day(wanted: Date) -> Option<i64> {
    let Date { year, month, day } = wanted;
    if !(1970..=9999).contains(&year) || !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    let shifted_year = year - i64::from(month <= 2);
    let (era, year_of_era) = (shifted_year.div_euclid(400), shifted_year.rem_euclid(400));
    let shifted_month = (month + 9) % 12;
    let day_of_year = (153 * shifted_month + 2) / 5 + day - 1;
    let day_of_era = year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year;
    let days = era * 146_097 + day_of_era - 719_468;
    (date(days) == wanted).then_some(days)
}

/// Index into [`WEEKDAYS`]. 1970-01-01 was a Thursday.
pub fn weekday(days_since_1970: i64) -> usize {
    // In 0..7.
    (days_since_1970 + 3).rem_euclid(7) as usize
}

/// The beginning of a date from 1970 to 9999 in UTC, milliseconds since 1970; `None` for what is no date such as
/// `2026-11-20`.
pub fn midnight_ms(date: &str) -> Option<i64> {
    let is_number = |part: &&str| part.bytes().all(|b| b.is_ascii_digit());
    let mut parts = date.splitn(3, '-').filter(is_number);
    let mut part = |n_digits| parts.next().filter(|p| p.len() == n_digits)?.parse().ok();
    let (year, month) = (part(4)?, part(2)?);
    let day_of_month = part(2)?;
    let wanted = Date {
        year,
        month,
        day: day_of_month,
    };
    Some(day(wanted)? * DAY_MS)
}

/// A time in UTC such as `2026-11-20T14:30:05Z`, milliseconds since 1970; `None` for what is no such time.
pub fn utc_ms(time: &str) -> Option<i64> {
    let (date, time) = time.strip_suffix('Z')?.split_once('T')?;
    let mut parts = time.split(':');
    let mut part = |limit: i64| {
        let digits = parts
            .next()
            .filter(|p| p.len() == 2 && p.bytes().all(|b| b.is_ascii_digit()))?;
        digits.parse().ok().filter(|value| *value < limit)
    };
    let (hours, minutes, seconds): (i64, i64, i64) = (part(24)?, part(60)?, part(60)?);
    if parts.next().is_some() {
        return None;
    }
    Some(midnight_ms(date)? + hours * HOUR_MS + minutes * MINUTE_MS + seconds * 1_000)
}

/// A date as `2026-11-20`.
pub fn date_text(days_since_1970: i64) -> String {
    let Date { year, month, day } = date(days_since_1970);
    format!("{year:04}-{month:02}-{day:02}")
}

/// A time in UTC as `2026-11-23T17:38:12.345Z`.
pub fn utc_text(ms: i64) -> String {
    let date = date_text(ms.div_euclid(DAY_MS));
    let ms_of_day = ms.rem_euclid(DAY_MS);
    let (s, ms) = (ms_of_day / 1_000, ms_of_day % 1_000);
    let (hour, minute, second) = (s / 3_600, s / 60 % 60, s % 60);
    format!("{date}T{hour:02}:{minute:02}:{second:02}.{ms:03}Z")
}

/// A time in UTC as `20261120T143005Z`, for file names.
pub fn compact_utc(ms: i64) -> String {
    let Date { year, month, day } = date(ms.div_euclid(DAY_MS));
    let s = ms.rem_euclid(DAY_MS) / 1_000;
    let (hour, minute, second) = (s / 3_600, s / 60 % 60, s % 60);
    format!("{year:04}{month:02}{day:02}T{hour:02}{minute:02}{second:02}Z")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_become_dates_and_dates_days() {
        for (days, text) in [
            (0, "1970-01-01"),
            (59, "1970-03-01"),
            (11_016, "2000-02-29"),
            (20_780, "2026-11-23"),
            (2_932_896, "9999-12-31"),
        ] {
            assert_eq!(date_text(days), text);
        }
        for days in (0..2_932_897).step_by(37).chain(0..3_000) {
            assert_eq!(day(date(days)), Some(days));
        }
    }

    #[test]
    fn dates_that_do_not_exist_have_no_day() {
        for (year, month, d) in [
            (2026, 2, 29),
            (2100, 2, 29),
            (2026, 4, 31),
            (2026, 13, 1),
            (2026, 0, 1),
            (2026, 1, 0),
            (1969, 12, 31),
            (10_000, 1, 1),
        ] {
            let wanted = Date {
                year,
                month,
                day: d,
            };
            assert_eq!(day(wanted), None, "{wanted:?}");
        }
    }

    #[test]
    fn times_in_utc_are_read_and_others_are_not() {
        assert_eq!(
            utc_ms("2026-11-23T17:38:12Z"),
            Some(20_780 * DAY_MS + 63_492_000)
        );
        assert_eq!(utc_ms("1970-01-01T00:00:00Z"), Some(0));
        for none in [
            "2026-11-23",
            "2026-11-23T17:38:12",
            "2026-11-23 17:38:12Z",
            "2026-11-23T17:38Z",
            "2026-11-23T24:00:00Z",
            "2026-11-23T17:60:00Z",
            "2026-11-23T7:38:12Z",
            "2026-11-23T+7:38:12Z",
            "2026-11-23T17:38:12:00Z",
            "2026-02-29T00:00:00Z",
        ] {
            assert_eq!(utc_ms(none), None, "{none}");
        }
    }

    #[test]
    fn dates_begin_at_midnight_and_what_is_none_has_no_beginning() {
        assert_eq!(midnight_ms("1970-01-02"), Some(DAY_MS));
        assert_eq!(midnight_ms("2026-11-23"), Some(20_780 * DAY_MS));
        for none in [
            "",
            "today",
            "2026-02-29",
            "2026-11",
            "2026-11-2",
            "26-11-23",
            "2026-11-23T00:00",
            "+026-11-23",
            "2026--1-23",
            "2026-11-23-",
        ] {
            assert_eq!(midnight_ms(none), None, "{none}");
        }
    }

    #[test]
    fn moments_are_written_in_utc() {
        let ms = 20_780 * DAY_MS + 63_492_345;
        assert_eq!(utc_text(ms), "2026-11-23T17:38:12.345Z");
        assert_eq!(utc_text(0), "1970-01-01T00:00:00.000Z");
    }

    #[test]
    fn days_of_the_week_and_stamps() {
        // 2026-11-23 is a Monday.
        assert_eq!(WEEKDAYS[weekday(20_780)], "Monday");
        assert_eq!(WEEKDAYS[weekday(0)], "Thursday");
        assert_eq!(
            compact_utc(20_780 * DAY_MS + 63_492_987),
            "20261123T173812Z"
        );
        assert!(!compact_utc(i64::MIN).is_empty() && !compact_utc(i64::MAX).is_empty());
    }
}
