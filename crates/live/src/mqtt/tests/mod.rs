mod broker;
mod mosquitto;

use std::net::TcpListener;
use std::time::Instant;

use radarllm_monitor::messages::{
    About, Body, Fall, FallState, Frame, Health, Now, Presence, PresenceState, SourceState, Stamp,
};
use serde_json::Value;

use super::*;
use crate::bus::tests::about;
use broker::{Broker, DEADLINE, Message, State, publication};

const DISCOVERY: &str = "homeassistant/device/radarllm_lounge/config";
const AVAILABILITY: &str = "radarllm/lounge/availability";
const SOURCE: &str = "radarllm/lounge/source/availability";
const STATE: &str = "radarllm/lounge/state";
const CAPTION: &str = "radarllm/lounge/caption";
const FALL: &str = "radarllm/lounge/fall";
const STATUS: &str = "homeassistant/status";
const STAMP: Stamp = Stamp {
    utc_ms: 1_795_455_492_345,
    t_s: 12.5,
};

fn recorded() -> About {
    let mut about = about();
    about.origin.synthetic = false;
    about.origin.source = "/dev/ttyUSB1".into();
    about
}

fn options(broker: &Broker) -> Options {
    Options {
        actions: vec!["walk".into()],
        retry: [Duration::from_millis(5), Duration::from_millis(50)],
        ..Options::new(broker.address.to_string().parse().unwrap())
    }
}

fn bus() -> Arc<Bus> {
    Arc::new(Bus::new(recorded()))
}

fn publish(bus: &Bus, body: Body) {
    bus.publish(STAMP, body);
}

fn presence(people: u32) -> Body {
    Body::Presence(Presence {
        state: match people {
            0 => PresenceState::Absent,
            _ => PresenceState::Present,
        },
        people,
        why: None,
    })
}

fn now(caption: &str, label: &str) -> Body {
    Body::Now(Now {
        person: Some(1),
        caption: Some(caption.into()),
        label: label.into(),
        confidence: Some(0.6),
        window_s: 6.0,
        reason: None,
        provisional: true,
        synthetic: false,
    })
}

fn fall(id: u64, state: FallState) -> Body {
    Body::Fall(Fall {
        id,
        state,
        person: Some(1),
        dwell_s: 20.0,
        acknowledged: false,
        synthetic: false,
    })
}

fn health(source: SourceState) -> Body {
    Body::Health(Health {
        source,
        degraded: None,
        frames_used: 1,
        frames_lost: 0,
        frames_dropped: 0,
        problems: Vec::new(),
    })
}

fn last<'a>(state: &'a State, topic: &str) -> Option<&'a Message> {
    state.messages.iter().rev().find(|m| m.topic == topic)
}

/// Waits until the last message on a topic is one.
fn wait_for(broker: &Broker, topic: &str, payload: &str) {
    broker.wait(&format!("{payload} on {topic}"), |state| {
        last(state, topic)
            .filter(|m| m.payload == payload)
            .map(drop)
    });
}

/// Waits until the last message on a topic has a member.
fn wait_for_member(broker: &Broker, topic: &str, member: &str, expected: Value) -> Value {
    broker.wait(&format!("{member} {expected} on {topic}"), |state| {
        let value: Value = serde_json::from_str(&last(state, topic)?.payload).unwrap();
        (value[member] == expected).then_some(value)
    })
}

/// Waits until the publisher says that something is so.
fn wait_until(publisher: &Publisher, check: impl Fn(Counts) -> bool) {
    let end = Instant::now() + DEADLINE;
    while !check(publisher.counts()) {
        assert!(Instant::now() < end, "{:?}", publisher.counts());
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn everything_is_published_and_kept_but_falls() {
    let (broker, bus) = (Broker::start(), bus());
    let mut options = options(&broker);
    options.user = Some("radar".into());
    options.password = Some(Password::new("secret\n"));
    let publisher = Publisher::start(options, Arc::clone(&bus)).unwrap();
    wait_for_member(&broker, CAPTION, "caption", Value::Null);
    wait_for(&broker, SOURCE, "offline");
    let connect = broker.state().connects[0].clone();
    // Another radar of the same name must not end this connection.
    let own = connect.client_id.strip_prefix("radarllm_lounge_").unwrap();
    assert_eq!(own.len(), 16);
    assert_eq!(connect.user.as_deref(), Some("radar"));
    assert_eq!(connect.password.as_deref(), Some("secret"));
    assert_eq!(connect.keep_alive_s, 10);

    publish(&bus, Body::Frame(Frame::default()));
    wait_for(&broker, SOURCE, "online");
    publish(&bus, presence(1));
    publish(&bus, now("a person walks", "walk"));
    publish(&bus, fall(7, FallState::Confirmed));
    let found = wait_for_member(&broker, STATE, "fallen", "ON".into());
    let expected = serde_json::json!({
        "occupancy": "ON", "people": 1, "activity": "walk", "fallen": "ON"
    });
    assert_eq!(found, expected);
    let found = wait_for_member(&broker, CAPTION, "caption", "a person walks".into());
    assert_eq!(
        (&found["synthetic"], &found["source"]),
        (&false.into(), &"/dev/ttyUSB1".into())
    );
    let found = wait_for_member(&broker, FALL, "event_type", "confirmed".into());
    assert_eq!((&found["id"], &found["dwell_s"]), (&7.into(), &20.0.into()));
    publish(&bus, now("a person juggles", "juggle"));
    wait_for_member(&broker, STATE, "activity", "other".into());
    publish(&bus, health(SourceState::Lost));
    wait_for(&broker, SOURCE, "offline");

    let state = broker.state();
    let topics: Vec<&str> = state.messages.iter().map(|m| &m.topic[..]).collect();
    assert_eq!(
        topics[..5],
        [DISCOVERY, AVAILABILITY, SOURCE, STATE, CAPTION]
    );
    for message in &state.messages {
        assert_eq!(
            (message.qos, message.retain),
            (1, message.topic != FALL),
            "{message:?}"
        );
    }
    assert!(!state.retained.contains_key(FALL));
    let description: Value = serde_json::from_str(&state.retained[DISCOVERY]).unwrap();
    assert_eq!(description["dev"]["name"], "Lounge radar");
    assert_eq!(description["cmps"]["activity"]["ops"][4], "walk");
    drop(state);
    let counts = publisher.counts();
    assert!(
        counts.connected && counts.reconnects == 0 && counts.dropped == 0,
        "{counts:?}"
    );
    assert_eq!(publisher.problem(), None);
}

#[test]
fn stopping_says_offline_and_the_will_is_not_needed() {
    let (broker, bus) = (Broker::start(), bus());
    let publisher = Publisher::start(options(&broker), Arc::clone(&bus)).unwrap();
    wait_for_member(&broker, CAPTION, "caption", Value::Null);
    let began = Instant::now();
    assert!(publisher.stop());
    assert!(began.elapsed() < STOP_TIME);
    broker.wait("a farewell", |state| (state.n_farewells == 1).then_some(()));
    let state = broker.state();
    assert_eq!(state.retained[AVAILABILITY], "offline");
    assert!(state.messages.iter().all(|m| !m.is_will));
}

#[test]
fn a_closed_bus_says_offline_too() {
    let (broker, bus) = (Broker::start(), bus());
    let publisher = Publisher::start(options(&broker), Arc::clone(&bus)).unwrap();
    wait_for_member(&broker, CAPTION, "caption", Value::Null);
    bus.close();
    wait_for(&broker, AVAILABILITY, "offline");
    assert!(publisher.stop());
}

#[test]
fn a_broken_connection_leaves_the_will_and_everything_comes_again() {
    let (broker, bus) = (Broker::start(), bus());
    let publisher = Publisher::start(options(&broker), Arc::clone(&bus)).unwrap();
    publish(&bus, presence(2));
    wait_for_member(&broker, STATE, "people", 2.into());
    broker.state().messages.clear();
    broker.kill_connections();
    let will = broker.wait("the will", |s| {
        s.messages.iter().find(|m| m.is_will).cloned()
    });
    assert_eq!(
        (&will.topic[..], &will.payload[..]),
        (AVAILABILITY, "offline")
    );
    assert!(will.retain && will.qos == 1);
    broker.wait("everything again", |state| {
        let after = state.messages.iter().rev().take_while(|m| !m.is_will);
        let found: Vec<&str> = after.map(|m| &m.topic[..]).collect();
        let all = [DISCOVERY, AVAILABILITY, SOURCE, STATE, CAPTION];
        all.iter().all(|topic| found.contains(topic)).then_some(())
    });
    wait_for(&broker, AVAILABILITY, "online");
    wait_until(&publisher, |counts| {
        counts.connected && counts.reconnects >= 1
    });
}

#[test]
fn while_the_broker_is_away_only_the_latest_values_and_young_falls_are_kept() {
    let (broker, bus) = (Broker::start(), bus());
    let (address, options) = (broker.address, options(&broker));
    let publisher = Publisher::start(options, Arc::clone(&bus)).unwrap();
    wait_for_member(&broker, CAPTION, "caption", Value::Null);
    drop(broker);
    wait_until(&publisher, |counts| !counts.connected);
    for people in 1..=5 {
        publish(&bus, presence(people));
        publish(&bus, now(&format!("sentence {people}"), "walk"));
    }
    publish(&bus, fall(1, FallState::Suspected));
    publish(&bus, fall(1, FallState::Confirmed));
    assert!(publisher.problem().is_some());

    let broker = Broker::start_at(address);
    wait_for_member(&broker, CAPTION, "caption", "sentence 5".into());
    wait_for_member(&broker, FALL, "event_type", "confirmed".into());
    let state = broker.state();
    for topic in [DISCOVERY, AVAILABILITY, SOURCE, STATE, CAPTION] {
        assert!(state.retained.contains_key(topic), "{topic}");
        let n = state.messages.iter().filter(|m| m.topic == topic).count();
        assert_eq!(n, 1, "{topic}");
    }
    let falls = state.messages.iter().filter(|m| m.topic == FALL);
    assert_eq!(falls.count(), 2);
    assert_eq!(publisher.counts().dropped, 0);
}

#[test]
fn old_falls_are_not_sent_after_a_broken_connection() {
    let (broker, bus) = (Broker::start(), bus());
    let address = broker.address;
    let mut options = options(&broker);
    // Whatever waited for a connection is too old.
    options.max_fall_age = Duration::ZERO;
    let publisher = Publisher::start(options, Arc::clone(&bus)).unwrap();
    wait_for_member(&broker, CAPTION, "caption", Value::Null);
    drop(broker);
    wait_until(&publisher, |counts| !counts.connected);
    publish(&bus, fall(1, FallState::Suspected));
    publish(&bus, fall(1, FallState::Confirmed));

    let broker = Broker::start_at(address);
    wait_for_member(&broker, STATE, "fallen", "ON".into());
    publish(&bus, fall(2, FallState::Suspected));
    wait_for_member(&broker, FALL, "id", 2.into());
    let falls = broker
        .state()
        .messages
        .iter()
        .filter(|m| m.topic == FALL)
        .count();
    assert_eq!(falls, 1);
    wait_until(&publisher, |counts| counts.dropped == 2);
}

#[test]
fn home_assistant_coming_online_gets_everything_again() {
    let (broker, bus) = (Broker::start(), bus());
    let publisher = Publisher::start(options(&broker), Arc::clone(&bus)).unwrap();
    wait_for_member(&broker, CAPTION, "caption", Value::Null);
    publish(&bus, fall(1, FallState::Confirmed));
    wait_for_member(&broker, FALL, "id", 1.into());
    wait_for_member(&broker, STATE, "fallen", "ON".into());
    broker.wait("subscription", |s| s.is_subscribed(STATUS).then_some(()));
    broker.state().messages.clear();
    // What is not `online`, on another topic or retained changes nothing.
    broker.send(&publication(STATUS, b"offline", false));
    broker.send(&publication(STATUS, b"online", true));
    broker.send(&publication("homeassistant/else", b"online", false));
    broker.send(&publication(STATUS, b"online", false));
    broker.wait("everything", |state| {
        (state.messages.len() >= 5).then_some(())
    });
    let state = broker.state();
    let topics: Vec<&str> = state.messages.iter().map(|m| &m.topic[..]).collect();
    assert_eq!(topics, [DISCOVERY, AVAILABILITY, SOURCE, STATE, CAPTION]);
    drop(state);
    assert_eq!(publisher.counts().reconnects, 0);
}

#[test]
fn sentences_come_at_most_once_a_second_and_the_last_one_comes() {
    let (broker, bus) = (Broker::start(), bus());
    let _publisher = Publisher::start(options(&broker), Arc::clone(&bus)).unwrap();
    wait_for_member(&broker, CAPTION, "caption", Value::Null);
    publish(&bus, presence(1));
    let began = Instant::now();
    for i in 0..50 {
        publish(&bus, now(&format!("sentence {i}"), "walk"));
    }
    wait_for_member(&broker, CAPTION, "caption", "sentence 49".into());
    let state = broker.state();
    let n = state.messages.iter().filter(|m| m.topic == CAPTION).count();
    // One at the beginning, one a second, and one at the end of the last second.
    let max = 2 + began.elapsed().as_secs() as usize;
    assert!(n <= max, "{n} of {max}");
}

#[test]
fn hostile_messages_on_the_status_topic_are_survived() {
    let (broker, bus) = (Broker::start(), bus());
    let publisher = Publisher::start(options(&broker), Arc::clone(&bus)).unwrap();
    broker.wait("subscription", |s| s.is_subscribed(STATUS).then_some(()));
    let mut random = 12_345_u32;
    let mut bytes = |n: usize| -> Vec<u8> {
        let next = |_| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (random >> 24) as u8
        };
        (0..n).map(next).collect()
    };
    for n in [0, 1, 2, 100, 1_000, 60_000] {
        broker.send(&publication(STATUS, &bytes(n), false));
    }
    broker.state().messages.clear();
    // The connection is still the first one.
    broker.send(&publication(STATUS, b"online", false));
    broker.wait("everything", |state| last(state, DISCOVERY).map(drop));
    assert_eq!(publisher.counts().reconnects, 0);

    // A megabyte is not read. As it may be retained, the topic is left alone from then on.
    let n_connects = broker.state().connects.len();
    broker
        .state()
        .retained
        .insert(STATUS.into(), "x".repeat(1 << 20));
    broker.send(&publication(STATUS, &vec![b'x'; 1 << 20], false));
    broker.wait("a new connection", |s| {
        (s.connects.len() > n_connects).then_some(())
    });
    wait_until(&publisher, |counts| {
        counts.connected && counts.status_ignored
    });
    publish(&bus, presence(3));
    wait_for_member(&broker, STATE, "people", 3.into());
    assert_eq!(broker.state().connects.len(), n_connects + 1);
    assert!(!broker.state().is_subscribed(STATUS));

    // Bytes that are no packets, in many connections.
    for i in 0..50 {
        let n_connects = broker.wait("a connection", |s| {
            (s.connects.len() > n_connects + i).then_some(s.connects.len())
        });
        broker.send(&bytes(300));
        broker.kill_connections();
        broker.wait("the next one", |s| {
            (s.connects.len() > n_connects).then_some(())
        });
    }
    publish(&bus, presence(4));
    wait_for_member(&broker, STATE, "people", 4.into());
}

#[test]
fn brokers_that_refuse_or_talk_nonsense_are_asked_again() {
    let (broker, bus) = (Broker::start(), bus());
    for greeting in [
        // Wrong password; no such code; a publication; a length of five bytes; a megabyte.
        vec![0x20, 2, 0, 5],
        vec![0x20, 2, 0, 77],
        publication(STATUS, b"online", false),
        vec![0x20, 255, 255, 255, 255, 255],
        publication(STATUS, &vec![b'x'; 1 << 20], false),
        vec![0x20, 0],
    ] {
        broker.state().greeting = Some(greeting);
        let n = broker.state().connects.len();
        let publisher = Publisher::start(options(&broker), Arc::clone(&bus)).unwrap();
        broker.wait("two attempts", |s| {
            (s.connects.len() >= n + 2).then_some(())
        });
        broker.state().greeting = None;
        wait_until(&publisher, |counts| counts.connected);
        assert!(publisher.stop());
    }
}

#[test]
fn a_broker_that_acknowledges_nothing_does_not_delay_the_end() {
    let (broker, bus) = (Broker::start(), bus());
    broker.state().is_mute = true;
    let publisher = Publisher::start(options(&broker), Arc::clone(&bus)).unwrap();
    broker.wait("the description", |state| last(state, DISCOVERY).map(drop));
    publish(&bus, fall(1, FallState::Suspected));
    let began = Instant::now();
    assert!(!publisher.stop());
    assert!(began.elapsed() < STOP_TIME);
    // It was sent all the same, after the fall.
    wait_for(&broker, AVAILABILITY, "offline");
}

#[test]
fn without_a_broker_it_starts_and_stops() {
    // A port at which nobody listens.
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    drop(listener);
    let options = Options::new(address.to_string().parse().unwrap());
    let publisher = Publisher::start(options, bus()).unwrap();
    let end = Instant::now() + DEADLINE;
    while publisher.problem().is_none() {
        assert!(Instant::now() < end);
        std::thread::sleep(Duration::from_millis(1));
    }
    let began = Instant::now();
    assert!(!publisher.counts().connected);
    assert!(!publisher.stop());
    assert!(began.elapsed() < STOP_TIME);
}

#[test]
fn simulated_radars_wrong_names_and_too_many_actions_are_refused() {
    let broker = Broker::start();
    let start = |options, about| Publisher::start(options, Arc::new(Bus::new(about)));
    let error = start(options(&broker), about()).unwrap_err();
    assert!(matches!(error, MqttError::Synthetic { .. }), "{error}");
    for name in ["", "Lounge", "a/b", "#", &"a".repeat(33)] {
        let mut about = recorded();
        about.name = name.into();
        let error = start(options(&broker), about).unwrap_err();
        assert!(matches!(error, MqttError::Name { .. }), "{error}");
    }
    let mut long = options(&broker);
    long.actions = (0..10_000).map(|i| format!("action_{i}")).collect();
    let error = start(long, recorded()).unwrap_err();
    assert!(matches!(error, MqttError::TooLong { .. }), "{error}");
    assert!(broker.state().connects.is_empty());

    let mut allowed = options(&broker);
    allowed.allow_synthetic = true;
    let _publisher = start(allowed, about()).unwrap();
    let found = wait_for_member(&broker, CAPTION, "synthetic", true.into());
    assert_eq!(found["source"], "sim:");
    let description = broker.state().retained[DISCOVERY].clone();
    assert!(description.contains("Lounge radar (simulated)"));
}
