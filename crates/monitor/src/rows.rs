//! Rows of the timeline: activities, events and where they come from. Plain data; what of it can be kept is decided by
//! whoever keeps it.

use serde::{Deserialize, Serialize};

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
    /// End, milliseconds since 1970 in UTC; at most a day later.
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

/// An activity with the number that the memory gave it.
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
    /// Details, at most 4,096 bytes as JSON text.
    pub data: Option<serde_json::Value>,
}

/// An event with the number that the memory gave it.
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

    /// The kind of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
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
}
