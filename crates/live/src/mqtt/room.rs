//! The live messages as payloads for a broker: only the latest values, and the transitions of falls that wait.

use std::collections::{BTreeMap, VecDeque};
use std::time::{Duration, Instant};

use radarllm_base::civil::{DAY_MS, Date, day, utc_text};
use radarllm_monitor::messages::{
    About, At, Body, Fall, FallState, Health, Hello, Message, Now, Presence, PresenceState,
    SourceState,
};
use serde::Deserialize;
use serde_json::json;

use super::discovery::LABELS;

/// Most characters of a state of Home Assistant.
pub(super) const MAX_CHARACTERS: usize = 255;
/// How long a sentence is the newest one of somebody who says nothing new.
const NOW_TIME: Duration = Duration::from_secs(15);
/// Most people whose sentences are kept.
const MAX_PEOPLE: usize = 32;
/// Most falls whose state is kept, and most transitions that wait.
pub(super) const MAX_FALLS: usize = 32;

/// The latest values of a room. Its size is bounded.
#[derive(Debug)]
pub(super) struct Room {
    about: About,
    /// All values of the activity.
    labels: Vec<String>,
    allow_synthetic: bool,
    /// Whether the first `hello` was taken.
    has_begun: bool,
    source: Option<SourceState>,
    presence: Option<Presence>,
    now: Vec<Heard>,
    falls: BTreeMap<u64, FallState>,
    transitions: VecDeque<Transition>,
    n_dropped: u64,
}

/// A sentence and when it arrived.
#[derive(Debug)]
struct Heard {
    at: Instant,
    now: At<Now>,
}

/// A transition of a fall that waits.
#[derive(Clone, Debug)]
struct Transition {
    since: Instant,
    payload: String,
}

/// The type of a message. The points of a frame are not read.
#[derive(Deserialize)]
struct Kind<'a> {
    #[serde(borrow, rename = "type")]
    kind: std::borrow::Cow<'a, str>,
}

impl Room {
    pub(super) fn new(about: About, actions: &[String], allow_synthetic: bool) -> Self {
        let mut labels: Vec<String> = LABELS.map(String::from).into();
        for action in actions {
            let fits = !action.is_empty() && action.chars().count() <= MAX_CHARACTERS;
            if fits && !labels.contains(action) {
                labels.push(action.clone());
            }
        }
        Self {
            about,
            labels,
            allow_synthetic,
            has_begun: false,
            source: None,
            presence: None,
            now: Vec::new(),
            falls: BTreeMap::new(),
            transitions: VecDeque::new(),
            n_dropped: 0,
        }
    }

    pub(super) fn about(&self) -> &About {
        &self.about
    }

    /// All values of the activity.
    pub(super) fn labels(&self) -> &[String] {
        &self.labels
    }

    /// Takes a message of the bus. What is no message changes nothing.
    pub(super) fn take(&mut self, json: &str, now: Instant) {
        let Ok(Kind { kind }) = serde_json::from_str(json) else {
            return;
        };
        if kind == "frame" {
            // A frame: the radar is heard, whatever else is known.
            self.source.get_or_insert(SourceState::Ok);
            return;
        }
        let Ok(Message { at, .. }) = serde_json::from_str::<Message>(json) else {
            return;
        };
        let At { utc, t_s, what } = at;
        match what {
            Body::Hello(hello) => self.begin(*hello, now),
            Body::Now(what) => self.set_now(At { utc, t_s, what }, now),
            Body::Presence(presence) => self.presence = Some(presence),
            Body::Fall(what) => self.set_fall(At { utc, t_s, what }, now),
            Body::Health(Health { source, .. }) => self.source = Some(source),
            Body::Frame(_) | Body::Activity(_) | Body::Lag(_) => {}
        }
    }

    /// The state of everything. Falls of the first one are known before this program published, so that they are no news.
    fn begin(&mut self, hello: Hello, now: Instant) {
        self.source = hello
            .health
            .map(|health| health.what.source)
            .or(self.source);
        self.presence = hello.presence.map(|presence| presence.what);
        // Sentences that are missing were forgotten or are over.
        let people: Vec<Option<u32>> = hello.now.iter().map(|one| one.what.person).collect();
        self.now
            .retain(|heard| people.contains(&heard.now.what.person));
        for one in hello.now {
            let is_known = self.now.iter().any(|heard| heard.now == one);
            if !is_known {
                self.set_now(one, now);
            }
        }
        let open: Vec<u64> = hello.falls.iter().map(|fall| fall.what.id).collect();
        self.falls
            .retain(|id, state| open.contains(id) || is_over(*state));
        for fall in hello.falls {
            if self.has_begun {
                self.set_fall(fall, now);
            } else if self.is_allowed(fall.what.synthetic) {
                self.falls.insert(fall.what.id, fall.what.state);
            }
        }
        self.has_begun = true;
    }

    fn set_now(&mut self, one: At<Now>, now: Instant) {
        if !self.is_allowed(one.what.synthetic) {
            return;
        }
        let person = one.what.person;
        // A sentence about nobody ends those about people, and the reverse.
        self.now.retain(|heard| {
            let other = heard.now.what.person;
            other.is_some() == person.is_some() && other != person
        });
        if self.now.len() >= MAX_PEOPLE {
            self.now.remove(0);
        }
        self.now.push(Heard { at: now, now: one });
    }

    fn set_fall(&mut self, fall: At<Fall>, now: Instant) {
        let Fall { id, state, .. } = fall.what;
        if !self.is_allowed(fall.what.synthetic) || self.falls.get(&id) == Some(&state) {
            return;
        }
        self.falls.insert(id, state);
        while self.falls.len() > MAX_FALLS {
            let over = self.falls.iter().find(|(_, state)| is_over(**state));
            let oldest = over.or_else(|| self.falls.iter().next()).map(|(id, _)| *id);
            let Some(oldest) = oldest else { break };
            self.falls.remove(&oldest);
        }
        if self.transitions.len() >= MAX_FALLS {
            self.transitions.pop_front();
            self.n_dropped += 1;
        }
        self.transitions.push_back(Transition {
            since: now,
            payload: fall_payload(&fall),
        });
    }

    /// Whether a message may be published. One that may not is counted.
    fn is_allowed(&mut self, synthetic: bool) -> bool {
        let is_allowed = self.allow_synthetic || !synthetic;
        self.n_dropped += u64::from(!is_allowed);
        is_allowed
    }

    /// The oldest transition of a fall that waits.
    pub(super) fn transition(&self) -> Option<&str> {
        self.transitions.front().map(|waiting| &waiting.payload[..])
    }

    /// All transitions of falls that wait, the oldest first.
    pub(super) fn transitions(&self) -> impl Iterator<Item = &str> {
        self.transitions.iter().map(|waiting| &waiting.payload[..])
    }

    /// The broker has the oldest transition.
    pub(super) fn transition_is_sent(&mut self) {
        self.transitions.pop_front();
    }

    /// Drops transitions that have waited for longer.
    pub(super) fn drop_old_transitions(&mut self, max_age: Duration, now: Instant) {
        let before = self.transitions.len();
        self.transitions
            .retain(|waiting| now.saturating_duration_since(waiting.since) <= max_age);
        self.n_dropped += (before - self.transitions.len()) as u64;
    }

    /// Transitions of falls and messages of simulated radars that were not sent.
    pub(super) fn n_dropped(&self) -> u64 {
        self.n_dropped
    }

    /// Whether the radar is heard.
    pub(super) fn source(&self) -> &'static str {
        match self.source {
            Some(SourceState::Ok) => "online",
            Some(SourceState::Lost) | None => "offline",
        }
    }

    /// Occupancy, number of people, activity and whether somebody lies after a fall. Before anything is known, nobody is
    /// there, as in presence itself.
    pub(super) fn state(&self, now: Instant) -> String {
        let on = |is_on| if is_on { "ON" } else { "OFF" };
        let people = self.presence.as_ref().map_or(0, |presence| presence.people);
        let fallen = self.falls.values().any(|s| *s == FallState::Confirmed);
        json!({
            "occupancy": on(self.is_occupied()),
            "people": people,
            "activity": self.activity(now),
            "fallen": on(fallen),
        })
        .to_string()
    }

    fn is_occupied(&self) -> bool {
        let state = self.presence.as_ref().map(|presence| presence.state);
        matches!(state, Some(PresenceState::Present | PresenceState::Held))
    }

    fn activity(&self, now: Instant) -> &str {
        if !self.is_occupied() {
            return LABELS[0];
        }
        let is_held = |presence: &Presence| presence.state == PresenceState::Held;
        match self.chosen(now).map(|one| &one.what.label[..]) {
            // Who is held says nothing new for as long as nobody is tracked.
            None if self.presence.as_ref().is_some_and(is_held) => "unseen",
            None => "unsure",
            // Somebody is held who is not tracked.
            Some("nobody") => "unseen",
            Some(label) => match self.labels.iter().find(|known| *known == label) {
                Some(known) => known,
                None => "other",
            },
        }
    }

    /// The newest sentence of the person whose activity is published: of those who do something that is known the one
    /// with the smallest number, who has been there longest.
    fn chosen(&self, now: Instant) -> Option<&At<Now>> {
        let is_new = |heard: &&Heard| now.saturating_duration_since(heard.at) <= NOW_TIME;
        let rank = |one: &At<Now>| match &one.what.label[..] {
            "unsure" | "other" => 1,
            "unseen" => 2,
            "nobody" => 3,
            _ => 0,
        };
        let new = self.now.iter().filter(is_new).map(|heard| &heard.now);
        new.min_by_key(|one| (rank(one), one.what.person))
    }

    /// The newest sentence of the person whose activity is published, with its provenance. Without one the members about
    /// it are null, so that no old sentence stays with the broker, and none of a room in which nobody is.
    pub(super) fn caption(&self, now: Instant) -> String {
        let origin = &self.about.origin;
        let chosen = self.chosen(now).filter(|_| self.is_occupied());
        let what = chosen.map(|one| &one.what);
        let to_ms = chosen.and_then(|one| utc_ms(&one.utc));
        let from_ms = to_ms.zip(what).map(|(to_ms, now)| {
            // A window is a few seconds; the conversion saturates.
            to_ms.saturating_sub((now.window_s * 1e3) as i64)
        });
        json!({
            "caption": what.and_then(|now| now.caption.as_deref()).map(shortened),
            "confidence": what.and_then(|now| now.confidence),
            "person": what.and_then(|now| now.person),
            "reason": what.and_then(|now| now.reason.as_deref()).map(shortened),
            "synthetic": what.map_or(origin.synthetic, |now| now.synthetic || origin.synthetic),
            "source": shortened(&origin.source),
            "radar": shortened(&origin.radar),
            "model": shortened(&origin.model),
            "from": from_ms.map(utc_text),
            "to": chosen.map(|one| &one.utc),
        })
        .to_string()
    }
}

/// Whether nobody lies any more.
fn is_over(state: FallState) -> bool {
    matches!(state, FallState::Dismissed | FallState::Recovered)
}

fn fall_payload(fall: &At<Fall>) -> String {
    let Fall {
        id,
        state,
        person,
        dwell_s,
        acknowledged,
        synthetic,
    } = &fall.what;
    json!({
        "event_type": state,
        "id": id,
        "person": person,
        "dwell_s": dwell_s,
        "acknowledged": acknowledged,
        "utc": fall.utc,
        "synthetic": synthetic,
    })
    .to_string()
}

/// A text of at most [`MAX_CHARACTERS`]; of a longer one the beginning and an ellipsis.
fn shortened(text: &str) -> String {
    match text.char_indices().nth(MAX_CHARACTERS) {
        None => text.into(),
        Some(_) => text.chars().take(MAX_CHARACTERS - 1).chain(['…']).collect(),
    }
}

/// Milliseconds since 1970 of a time as the messages have it.
fn utc_ms(text: &str) -> Option<i64> {
    let (date, time) = text.strip_suffix('Z')?.split_once('T')?;
    let number = |text: &str| text.parse::<i64>().ok();
    let mut date = date.splitn(3, '-').map(number);
    let date = Date {
        year: date.next()??,
        month: date.next()??,
        day: date.next()??,
    };
    let mut time = time.split([':', '.']).map(number);
    let [hour, minute, s, ms] = [time.next()??, time.next()??, time.next()??, time.next()??];
    let is_time = (0..24).contains(&hour) && (0..60).contains(&minute) && (0..60).contains(&s);
    let of_day = ((hour * 60 + minute) * 60 + s) * 1_000 + ms;
    (is_time && (0..1_000).contains(&ms)).then_some(day(date)? * DAY_MS + of_day)
}

#[cfg(test)]
mod tests {
    use radarllm_monitor::messages::{Frame, Stamp};
    use serde_json::Value;

    use super::*;
    use crate::bus::Bus;
    use crate::bus::tests::about;

    const STAMP: Stamp = Stamp {
        utc_ms: 1_795_455_492_345,
        t_s: 12.5,
    };

    /// A bus and a room that listens to it.
    struct Listener {
        bus: Bus,
        reader: crate::bus::Reader,
        room: Room,
        now: Instant,
    }

    fn listener(allow_synthetic: bool) -> Listener {
        let bus = Bus::new(about());
        let actions = ["walk", "sit_down", "walk", "other", ""].map(String::from);
        Listener {
            reader: bus.subscribe(),
            room: Room::new(about(), &actions, allow_synthetic),
            bus,
            now: Instant::now(),
        }
    }

    impl Listener {
        fn publish(&mut self, body: Body) {
            self.bus.publish(STAMP, body);
            self.listen();
        }

        fn listen(&mut self) {
            while let Ok(published) = self.reader.recv_timeout(Duration::ZERO) {
                self.room.take(&published.json, self.now);
            }
        }

        fn present(&mut self, state: PresenceState, people: u32) {
            self.publish(Body::Presence(Presence {
                state,
                people,
                why: None,
            }));
        }

        fn now(&mut self, person: Option<u32>, label: &str) {
            self.publish(Body::Now(now(person, label)));
        }

        fn fall(&mut self, id: u64, state: FallState) {
            self.publish(Body::Fall(Fall {
                id,
                state,
                person: Some(1),
                dwell_s: 20.0,
                acknowledged: false,
                synthetic: true,
            }));
        }

        fn activity(&self) -> String {
            let state: Value = serde_json::from_str(&self.room.state(self.now)).unwrap();
            state["activity"].as_str().unwrap().into()
        }

        fn caption(&self) -> Value {
            serde_json::from_str(&self.room.caption(self.now)).unwrap()
        }
    }

    fn now(person: Option<u32>, label: &str) -> Now {
        Now {
            person,
            caption: person.map(|person| format!("person {person} does {label}")),
            label: label.into(),
            confidence: Some(0.5),
            window_s: 6.0,
            reason: None,
            provisional: true,
            synthetic: true,
        }
    }

    fn value(json: &str) -> Value {
        serde_json::from_str(json).unwrap()
    }

    #[test]
    fn states_and_sentences_have_the_documented_members() {
        let mut room = listener(true);
        assert_eq!(
            value(&room.room.state(room.now)),
            json!({"occupancy": "OFF", "people": 0, "activity": "nobody", "fallen": "OFF"})
        );
        room.present(PresenceState::Present, 1);
        room.now(Some(1), "walk");
        room.fall(7, FallState::Confirmed);
        assert_eq!(
            value(&room.room.state(room.now)),
            json!({"occupancy": "ON", "people": 1, "activity": "walk", "fallen": "ON"})
        );
        assert_eq!(
            room.caption(),
            json!({
                "caption": "person 1 does walk", "confidence": 0.5, "person": 1, "reason": null,
                "synthetic": true, "source": "sim:", "radar": "awr1843boost", "model": "default",
                "from": "2026-11-23T17:38:06.345Z", "to": "2026-11-23T17:38:12.345Z",
            })
        );
        assert_eq!(
            value(room.room.transition().unwrap()),
            json!({
                "event_type": "confirmed", "id": 7, "person": 1, "dwell_s": 20.0,
                "acknowledged": false, "utc": "2026-11-23T17:38:12.345Z", "synthetic": true,
            })
        );
        room.fall(7, FallState::Recovered);
        assert_eq!(value(&room.room.state(room.now))["fallen"], "OFF");
    }

    #[test]
    fn activities_are_options_and_agree_with_presence() {
        let mut room = listener(true);
        assert_eq!(
            room.room.labels(),
            ["nobody", "unseen", "unsure", "other", "walk", "sit_down"]
        );
        room.now(Some(1), "walk");
        assert_eq!(room.activity(), "nobody");
        assert_eq!(room.caption()["caption"], Value::Null);
        room.present(PresenceState::Present, 2);
        assert_eq!(room.activity(), "walk");
        room.now(Some(1), "juggle");
        assert_eq!(room.activity(), "other");
        // Whoever does something that is known comes first, then whoever has been there longest.
        room.now(Some(1), "unseen");
        room.now(Some(3), "walk");
        room.now(Some(2), "sit_down");
        assert_eq!(room.activity(), "sit_down");
        assert_eq!(room.caption()["person"], 2);
        room.now(None, "nobody");
        room.present(PresenceState::Held, 1);
        assert_eq!(room.activity(), "unseen");
        room.now(Some(4), "walk");
        room.now += NOW_TIME;
        assert_eq!(room.activity(), "walk");
        room.now += Duration::from_millis(1);
        assert_eq!(room.activity(), "unseen");
        room.present(PresenceState::Present, 1);
        assert_eq!(room.activity(), "unsure");
        assert_eq!(room.caption()["caption"], Value::Null);
        assert_eq!(room.caption()["radar"], "awr1843boost");
    }

    #[test]
    fn the_radar_is_heard_by_frames_or_by_its_health() {
        let mut room = listener(true);
        assert_eq!(room.room.source(), "offline");
        room.publish(Body::Frame(Frame::default()));
        assert_eq!(room.room.source(), "online");
        let health = |source| {
            Body::Health(Health {
                source,
                degraded: None,
                frames_used: 0,
                frames_lost: 0,
                frames_dropped: 0,
                problems: Vec::new(),
            })
        };
        room.publish(health(SourceState::Lost));
        room.publish(Body::Frame(Frame::default()));
        assert_eq!(room.room.source(), "offline");
        room.publish(health(SourceState::Ok));
        assert_eq!(room.room.source(), "online");
    }

    #[test]
    fn long_sentences_are_shortened_and_whole_characters_stay() {
        let mut room = listener(true);
        let long = Now {
            caption: Some("ü".repeat(400)),
            reason: Some("r".repeat(255)),
            ..now(Some(1), &"x".repeat(400))
        };
        room.publish(Body::Now(long));
        room.present(PresenceState::Present, 1);
        let caption = room.caption()["caption"].as_str().unwrap().to_string();
        assert_eq!(caption.chars().count(), MAX_CHARACTERS);
        assert!(caption.ends_with("ü…"));
        assert_eq!(room.caption()["reason"], "r".repeat(255));
        assert_eq!(room.activity(), "other");
    }

    #[test]
    fn transitions_are_sent_once_and_old_and_surplus_ones_never() {
        let mut room = listener(true);
        room.fall(1, FallState::Suspected);
        room.fall(1, FallState::Suspected);
        room.fall(1, FallState::Confirmed);
        assert_eq!(room.room.transitions().count(), 2);
        room.room.transition_is_sent();
        room.now += Duration::from_secs(30);
        room.fall(2, FallState::Suspected);
        room.now += Duration::from_secs(31);
        room.room
            .drop_old_transitions(Duration::from_secs(60), room.now);
        let left: Vec<Value> = room.room.transitions().map(value).collect();
        assert_eq!((left.len(), &left[0]["id"]), (1, &json!(2)));
        assert_eq!(room.room.n_dropped(), 1);
        for id in 10..1_010 {
            room.fall(id, FallState::Confirmed);
        }
        assert!(room.room.transitions().count() == MAX_FALLS && room.room.falls.len() == MAX_FALLS);
        // 1,000 and the one that waited, of which 32 wait.
        assert_eq!(room.room.n_dropped(), 1 + 1_001 - 32);
    }

    #[test]
    fn falls_before_the_first_hello_are_a_state_and_no_news() {
        let mut room = listener(true);
        room.bus.publish(
            STAMP,
            Body::Fall(Fall {
                id: 3,
                state: FallState::Confirmed,
                person: None,
                dwell_s: 25.0,
                acknowledged: false,
                synthetic: true,
            }),
        );
        room.reader = room.bus.subscribe();
        room.listen();
        assert_eq!(value(&room.room.state(room.now))["fallen"], "ON");
        assert_eq!(room.room.transition(), None);
        // A listener that was too slow gets a new `hello`, with what it missed.
        room.bus.publish(
            STAMP,
            Body::Fall(Fall {
                id: 4,
                state: FallState::Suspected,
                person: None,
                dwell_s: 0.0,
                acknowledged: false,
                synthetic: true,
            }),
        );
        room.reader = room.bus.subscribe();
        room.listen();
        assert_eq!(room.room.transitions().count(), 1);
        assert_eq!(value(room.room.transition().unwrap())["id"], 4);
    }

    #[test]
    fn what_is_forgotten_is_not_published_again() {
        let mut room = listener(true);
        room.present(PresenceState::Present, 1);
        room.now(Some(1), "walk");
        assert_eq!(room.caption()["person"], 1);
        room.bus.forget(STAMP.utc_ms, STAMP.utc_ms + 1);
        room.listen();
        assert_eq!(room.caption()["caption"], Value::Null);
    }

    #[test]
    fn simulated_messages_are_left_out_unless_allowed() {
        let mut room = listener(false);
        room.now(Some(1), "walk");
        room.fall(1, FallState::Confirmed);
        assert_eq!(room.caption()["caption"], Value::Null);
        assert_eq!(room.room.transition(), None);
        assert_eq!(value(&room.room.state(room.now))["fallen"], "OFF");
        assert_eq!(room.room.n_dropped(), 2);
    }

    #[test]
    fn times_are_read_as_they_are_written() {
        for ms in [0, STAMP.utc_ms, 253_402_300_799_999] {
            assert_eq!(utc_ms(&utc_text(ms)), Some(ms));
        }
        for text in [
            "",
            "Z",
            "2026-11-23T17:38:12Z",
            "2026-02-30T00:00:00.000Z",
            "2026-11-23T24:00:00.000Z",
        ] {
            assert_eq!(utc_ms(text), None, "{text}");
        }
    }
}
