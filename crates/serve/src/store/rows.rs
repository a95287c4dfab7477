//! What the memory keeps: activities, events and where they come from.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::StoreError;

/// Largest time that is kept, milliseconds since 1970 in UTC: the end of the year 9999.
pub const MAX_TIME_MS: i64 = 253_402_300_799_999;
/// Longest activity, ms. The caller begins a new row after it. Because of this limit, a query by time reads one day of
/// rows before its range and not all of them.
pub const MAX_ACTIVITY_MS: i64 = 86_400_000;
/// Longest caption, bytes.
pub const MAX_CAPTION_BYTES: usize = 2_000;
/// Longest name of an action, bytes.
pub const MAX_ACTION_BYTES: usize = 250;
/// Longest text of an origin, bytes: that of a path.
pub const MAX_ORIGIN_BYTES: usize = 4_096;
/// Longest data of an event, bytes of JSON.
pub const MAX_DATA_BYTES: usize = 4_096;
/// Largest distance of a place from the radar along either axis, m.
pub const MAX_PLACE_M: f64 = 1_000.0;

/// Where a row comes from: its provenance.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Origin {
    /// The stream of the radar, for example a serial port or a recording.
    pub source: String,
    /// The radar.
    pub radar: String,
    /// The model that wrote the caption.
    pub model: String,
    /// How the model's words were chosen, for example `vote`.
    pub decoder: String,
    /// Version of the program.
    pub version: String,
    /// Whether the radar was simulated.
    pub synthetic: bool,
}

/// What a person did in one stretch of time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Activity {
    /// Beginning, milliseconds since 1970 in UTC.
    pub start_ms: i64,
    /// End, milliseconds since 1970 in UTC; at most [`MAX_ACTIVITY_MS`] later.
    pub end_ms: i64,
    /// Number of the track. It names nobody: a person who leaves and comes back has a new one.
    pub person: u32,
    /// Name of the action, for example `sit_down`.
    pub action: String,
    /// The sentence.
    pub caption: String,
    /// Confidence of the sentence, 0 to 1.
    pub confidence: Option<f64>,
    /// Number of windows that state the action.
    pub windows: u32,
    /// Number of points in them.
    pub points: u32,
    /// Where the person was: right of the radar and away from it, m.
    pub place_m: Option<[f64; 2]>,
}

/// What changes when an activity lasts longer. The beginning, the person and the action stay.
#[derive(Clone, Debug, PartialEq)]
pub struct Growth {
    /// The new end, milliseconds since 1970 in UTC; not before the end so far.
    pub end_ms: i64,
    /// The sentence.
    pub caption: String,
    /// Confidence of the sentence, 0 to 1.
    pub confidence: Option<f64>,
    /// Number of windows that state the action.
    pub windows: u32,
    /// Number of points in them.
    pub points: u32,
    /// Where the person was: right of the radar and away from it, m.
    pub place_m: Option<[f64; 2]>,
}

/// An activity in the memory.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ActivityRow {
    /// Number of the row. Numbers rise and are not used again.
    pub id: i64,
    /// The activity.
    #[serde(flatten)]
    pub activity: Activity,
    /// Its provenance.
    pub origin: Origin,
}

/// Something that happened at one moment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// Time, milliseconds since 1970 in UTC.
    pub at_ms: i64,
    /// What happened.
    pub kind: EventKind,
    /// Number of the track, if the event concerns one person.
    pub person: Option<u32>,
    /// Details, at most [`MAX_DATA_BYTES`] as JSON text.
    pub data: Option<serde_json::Value>,
}

/// An event in the memory.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EventRow {
    /// Number of the row. Numbers rise and are not used again.
    pub id: i64,
    /// The event.
    #[serde(flatten)]
    pub event: Event,
    /// Its provenance.
    pub origin: Origin,
}

/// Kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// Somebody is there.
    Present,
    /// Nobody is there any more.
    Absent,
    /// Somebody may have fallen.
    Suspected,
    /// Somebody fell and has not risen for the dwell time.
    Confirmed,
    /// Whoever was suspected to have fallen rose within the dwell time.
    Dismissed,
    /// Whoever fell has risen.
    Recovered,
    /// The radar is silent.
    SourceLost,
    /// The radar is heard again.
    SourceBack,
    /// The clock of the computer jumped.
    ClockStep,
}

impl EventKind {
    /// All kinds.
    pub const ALL: [Self; 9] = [
        Self::Present,
        Self::Absent,
        Self::Suspected,
        Self::Confirmed,
        Self::Dismissed,
        Self::Recovered,
        Self::SourceLost,
        Self::SourceBack,
        Self::ClockStep,
    ];

    /// The name in the database and in JSON, for example `source_lost`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Present => "present",
            Self::Absent => "absent",
            Self::Suspected => "suspected",
            Self::Confirmed => "confirmed",
            Self::Dismissed => "dismissed",
            Self::Recovered => "recovered",
            Self::SourceLost => "source_lost",
            Self::SourceBack => "source_back",
            Self::ClockStep => "clock_step",
        }
    }

    pub(crate) fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// A place in a list that is sorted by time: the row after which the next page begins. Its text form is
/// `TIME_MS-ID`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cursor {
    /// Time of the row, milliseconds since 1970 in UTC.
    pub at_ms: i64,
    /// Number of the row.
    pub id: i64,
}

impl fmt::Display for Cursor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}-{}", self.at_ms, self.id)
    }
}

impl FromStr for Cursor {
    type Err = StoreError;

    fn from_str(text: &str) -> Result<Self, StoreError> {
        let parsed = text
            .split_once('-')
            .and_then(|(at_ms, id)| Some((at_ms.parse().ok()?, id.parse().ok()?)));
        match parsed {
            Some((at_ms @ 0..=MAX_TIME_MS, id @ 0..)) => Ok(Self { at_ms, id }),
            _ => Err(StoreError::invalid("before", "TIME_MS-ID", text)),
        }
    }
}

impl Activity {
    pub(crate) fn check(&self) -> Result<(), StoreError> {
        check_time("start_ms", self.start_ms)?;
        check_end(self.start_ms, self.end_ms)?;
        if self.action.is_empty() {
            return Err(StoreError::invalid("action", "a name", &self.action));
        }
        check_text("action", &self.action, MAX_ACTION_BYTES)?;
        check_what_grows(&self.caption, self.confidence, self.place_m)
    }
}

impl Growth {
    /// Checks all but the end, which depends on the row.
    pub(crate) fn check(&self) -> Result<(), StoreError> {
        check_what_grows(&self.caption, self.confidence, self.place_m)
    }
}

impl Origin {
    pub(crate) fn check(&self) -> Result<(), StoreError> {
        check_text("source", &self.source, MAX_ORIGIN_BYTES)?;
        check_text("radar", &self.radar, MAX_ORIGIN_BYTES)?;
        check_text("model", &self.model, MAX_ORIGIN_BYTES)?;
        check_text("decoder", &self.decoder, MAX_ORIGIN_BYTES)?;
        check_text("version", &self.version, MAX_ORIGIN_BYTES)
    }
}

fn check_what_grows(
    caption: &str,
    confidence: Option<f64>,
    place_m: Option<[f64; 2]>,
) -> Result<(), StoreError> {
    check_text("caption", caption, MAX_CAPTION_BYTES)?;
    if let Some(confidence) = confidence.filter(|c| !(0.0..=1.0).contains(c)) {
        return Err(StoreError::invalid("confidence", "0 to 1", confidence));
    }
    let is_far = |m: &f64| !(-MAX_PLACE_M..=MAX_PLACE_M).contains(m);
    match place_m.iter().flatten().find(|m| is_far(m)) {
        Some(m) => Err(StoreError::invalid("place_m", "-1000 to 1000", m)),
        None => Ok(()),
    }
}

pub(crate) fn check_end(start_ms: i64, end_ms: i64) -> Result<(), StoreError> {
    check_time("end_ms", end_ms)?;
    match end_ms.checked_sub(start_ms) {
        Some(0..=MAX_ACTIVITY_MS) => Ok(()),
        _ => Err(StoreError::invalid(
            "end_ms",
            "a time from the start to one day later",
            end_ms,
        )),
    }
}

pub(crate) fn check_time(field: &'static str, ms: i64) -> Result<(), StoreError> {
    match ms {
        0..=MAX_TIME_MS => Ok(()),
        _ => Err(StoreError::invalid(
            field,
            "milliseconds since 1970, up to the year 9999",
            ms,
        )),
    }
}

fn check_text(field: &'static str, text: &str, most_bytes: usize) -> Result<(), StoreError> {
    if text.len() > most_bytes {
        return Err(StoreError::invalid(
            field,
            "a shorter text",
            format!("{} bytes", text.len()),
        ));
    }
    if text.contains(char::is_control) {
        return Err(StoreError::invalid(
            field,
            "a text without control characters",
            text,
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_have_one_name_in_the_database_and_in_json() {
        for kind in EventKind::ALL {
            assert_eq!(EventKind::from_name(kind.name()), Some(kind));
            let json = serde_json::to_string(&kind).unwrap();
            assert_eq!(json, format!("\"{}\"", kind.name()));
        }
        assert_eq!(EventKind::from_name("fell"), None);
    }

    #[test]
    fn cursors_have_a_text_form() {
        let cursor = Cursor {
            at_ms: 1_763_900_000_123,
            id: 42,
        };
        assert_eq!(cursor.to_string(), "1763900000123-42");
        assert_eq!("1763900000123-42".parse::<Cursor>().unwrap(), cursor);
        for text in [
            "",
            "-",
            "1",
            "1-",
            "-1-2",
            "1--2",
            "x-1",
            "99999999999999999999-1",
            "1-2-3",
        ] {
            assert!(text.parse::<Cursor>().is_err(), "{text}");
        }
    }
}
