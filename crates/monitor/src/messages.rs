//! Messages of a running radar to its listeners, as JSON.
//!
//! Every message is an object with the members `v` (the version of this format), `type`, `seq`, `utc`, `t_s` and those of
//! its type. [`Body`] lists the types. Readers must ignore members that they do not know.

use base64::prelude::{BASE64_STANDARD, Engine};
use radarllm_base::RadarPoint;
use serde::{Deserialize, Serialize};

use crate::points::frame_bytes;
use crate::rows::{ActivityRow, Origin};
use radarllm_base::civil::utc_text;

/// Version of the format. It changes when a member changes its meaning or disappears.
pub const VERSION: u32 = 1;
/// Most points of a frame message; the others are left out and counted.
pub const MAX_FRAME_POINTS: usize = 4_096;

/// A moment, in the time of the computer and in that of the stream.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Stamp {
    /// Milliseconds since 1970 in UTC.
    pub utc_ms: i64,
    /// Time of the stream, s: frame number times frame period.
    pub t_s: f64,
}

/// A message.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Message {
    /// [`VERSION`].
    pub v: u32,
    /// Number of the message. Numbers rise by one from message to message; `hello` and `lag` carry the number of the
    /// message before them.
    pub seq: u64,
    /// When, and what.
    #[serde(flatten)]
    pub at: At<Body>,
}

/// Something and its moment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct At<T> {
    /// Time in UTC, for example `2026-11-23T17:38:12.345Z`.
    pub utc: String,
    /// Time of the stream, s.
    pub t_s: f64,
    /// What.
    #[serde(flatten)]
    pub what: T,
}

/// Content of a message, named by its member `type`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Body {
    /// The state of everything. It comes first, and again after something was forgotten; it replaces all messages
    /// before.
    Hello(Box<Hello>),
    /// The points and people of one frame. The only message that may be lost.
    Frame(Frame),
    /// The newest sentence of a person, which the next one may correct.
    Now(Now),
    /// A row of the timeline, and the same row again when it grows.
    Activity(Box<ActivityRow>),
    /// Whether somebody is there.
    Presence(Presence),
    /// A fall.
    Fall(Fall),
    /// How the radar and the program are.
    Health(Health),
    /// This listener was too slow.
    Lag(Lag),
}

impl Body {
    /// Names of all types, as in the member `type`.
    pub const TYPES: [&str; 8] = [
        "hello", "frame", "now", "activity", "presence", "fall", "health", "lag",
    ];

    /// Index into [`TYPES`](Self::TYPES).
    pub fn index(&self) -> usize {
        match self {
            Self::Hello(_) => 0,
            Self::Frame(_) => 1,
            Self::Now(_) => 2,
            Self::Activity(_) => 3,
            Self::Presence(_) => 4,
            Self::Fall(_) => 5,
            Self::Health(_) => 6,
            Self::Lag(_) => 7,
        }
    }
}

/// What does not change while the program runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// Name of this radar, for example `lounge`.
    pub name: String,
    /// Provenance of all that follows.
    #[serde(flatten)]
    pub origin: Origin,
    /// Height of the radar above the floor, m.
    pub radar_height_m: f64,
    /// Time between two frames, s.
    pub frame_period_s: f64,
    /// Zones of the room.
    pub zones: Vec<Zone>,
}

/// Part of a room.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Zone {
    /// Name, for example `bed`.
    pub name: String,
    /// Kind: `room`, `ignore`, `door` or `bed`.
    pub kind: String,
    /// Corners: right of the radar and away from it, m.
    pub polygon_m: Vec<[f64; 2]>,
    /// Height above the floor below which an ignored zone ignores, m; absent if it has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub below_m: Option<f64>,
}

/// The state of everything.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// What does not change.
    #[serde(flatten)]
    pub about: About,
    /// The newest sentence of each person.
    pub now: Vec<At<Now>>,
    /// Whether somebody is there, if it is known.
    pub presence: Option<At<Presence>>,
    /// Falls that are suspected, and confirmed ones after which nobody rose.
    pub falls: Vec<At<Fall>>,
    /// How the radar and the program are, if it is known.
    pub health: Option<At<Health>>,
    /// Activities of the last hour, the oldest first.
    pub rows: Vec<ActivityRow>,
}

/// The points and people of one frame.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct Frame {
    /// Base64 of five little-endian `i16` a point: x, y and z in millimetres in the axes of the radar, radial velocity in
    /// centimetres per second, intensity in tenths of a decibel.
    pub points: String,
    /// Number of points that are missing, because they are too far or too many.
    pub left_out: usize,
    /// People.
    pub people: Vec<Person>,
}

impl Frame {
    /// The message for the points and people of a frame.
    pub fn new(points: &[RadarPoint], people: Vec<Person>) -> Self {
        let (bytes, left_out) = frame_bytes(points, MAX_FRAME_POINTS);
        Self {
            points: BASE64_STANDARD.encode(bytes),
            left_out,
            people,
        }
    }
}

/// A person in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Person {
    /// Number of the track. It names nobody.
    pub id: u32,
    /// Place to the right of the radar, m.
    pub x_m: f64,
    /// Place away from the radar, m.
    pub y_m: f64,
    /// Velocity to the right, m/s.
    pub vx_mps: f64,
    /// Velocity away from the radar, m/s.
    pub vy_mps: f64,
    /// Height of the highest points above the floor, m, if there are enough points.
    pub height_m: Option<f64>,
}

/// The newest sentence of a person.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Now {
    /// Number of the track, or nothing if nobody is there.
    pub person: Option<u32>,
    /// The sentence, or nothing if the model abstained.
    pub caption: Option<String>,
    /// Action of the last clause, or `nobody`, `unseen`, `unsure` or `other`.
    pub label: String,
    /// Confidence of the sentence, 0 to 1.
    pub confidence: Option<f64>,
    /// Length of the window that the sentence describes, s.
    pub window_s: f64,
    /// Why there is no sentence.
    pub reason: Option<String>,
    /// Always true: the timeline has what remains.
    pub provisional: bool,
    /// Whether the radar is simulated.
    pub synthetic: bool,
}

/// Whether somebody is there.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Presence {
    /// The state.
    pub state: PresenceState,
    /// Number of people.
    pub people: u32,
    /// Why, in words: for example `person 2 moves in the zone sofa`.
    pub why: Option<String>,
}

/// States of presence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PresenceState {
    /// Nobody is there.
    Absent,
    /// Somebody is seen.
    Present,
    /// Somebody was seen shortly before and has not left.
    Held,
}

/// A fall.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fall {
    /// Number of the fall.
    pub id: u64,
    /// Its state.
    pub state: FallState,
    /// Number of the track.
    pub person: Option<u32>,
    /// Time since the person went down, s.
    pub dwell_s: f64,
    /// Whether a viewer ended it. Members of falls that nobody acknowledged do not have it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub acknowledged: bool,
    /// Whether the radar is simulated.
    pub synthetic: bool,
}

/// States of a fall.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FallState {
    /// Somebody may have fallen.
    Suspected,
    /// Nobody rose within the dwell time.
    Confirmed,
    /// Somebody rose within the dwell time.
    Dismissed,
    /// Somebody rose later.
    Recovered,
}

/// How the radar and the program are.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Health {
    /// Whether the radar is heard.
    pub source: SourceState,
    /// What is done less often than it should, for example `captions`.
    pub degraded: Option<String>,
    /// Frames that were used.
    pub frames_used: u64,
    /// Frames that the radar sent and that did not arrive.
    pub frames_lost: u64,
    /// Frames that arrived and were dropped.
    pub frames_dropped: u64,
    /// Further problems in words.
    pub problems: Vec<String>,
}

/// States of the source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SourceState {
    /// Frames arrive.
    Ok,
    /// The radar is silent.
    Lost,
}

/// A listener was too slow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lag {
    /// Number of `frame` messages that it did not get since the last `lag`.
    pub dropped: u64,
}

impl<T> At<T> {
    /// Something at a moment.
    pub fn new(stamp: Stamp, what: T) -> Self {
        Self {
            utc: utc_text(stamp.utc_ms),
            t_s: stamp.t_s,
            what,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAMP: Stamp = Stamp {
        utc_ms: 1_795_455_492_345,
        t_s: 12.5,
    };

    #[test]
    fn messages_are_flat_objects_and_come_back() {
        let body = Body::Fall(Fall {
            id: 7,
            state: FallState::Confirmed,
            person: Some(1),
            dwell_s: 20.0,
            acknowledged: false,
            synthetic: true,
        });
        let message = Message {
            v: VERSION,
            seq: 3,
            at: At::new(STAMP, body),
        };
        let json = serde_json::to_string(&message).unwrap();
        assert_eq!(
            json,
            r#"{"v":1,"seq":3,"utc":"2026-11-23T17:38:12.345Z","t_s":12.5,"type":"fall","id":7,"state":"confirmed","person":1,"dwell_s":20.0,"synthetic":true}"#
        );
        assert_eq!(serde_json::from_str::<Message>(&json).unwrap(), message);
    }

    #[test]
    fn a_point_takes_ten_bytes_and_what_does_not_fit_is_counted() {
        let point = RadarPoint {
            x_m: -1.0,
            y_m: 2.0,
            z_m: 0.5,
            velocity_mps: -1.25,
            intensity_db: 30.0,
            ..RadarPoint::default()
        };
        let far = RadarPoint {
            x_m: 40.0,
            ..RadarPoint::default()
        };
        let frame = Frame::new(&[point, far], Vec::new());
        let bytes = BASE64_STANDARD.decode(&frame.points).unwrap();
        let numbers: Vec<i16> = bytes
            .chunks_exact(2)
            .map(|b| i16::from_le_bytes([b[0], b[1]]))
            .collect();
        assert_eq!(numbers, [-1000, 2000, 500, -125, 300]);
        assert_eq!(frame.left_out, 1);
        let many = Frame::new(&vec![point; MAX_FRAME_POINTS + 2], Vec::new());
        assert_eq!(many.left_out, 2);
    }

    #[test]
    fn types_are_named_as_in_json() {
        let lag = Body::Lag(Lag { dropped: 2 });
        assert_eq!(Body::TYPES[lag.index()], "lag");
        let json = serde_json::to_value(&lag).unwrap();
        assert_eq!(json, serde_json::json!({"type": "lag", "dropped": 2}));
    }
}
