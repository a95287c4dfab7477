use radarllm_monitor::messages::{Fall, FallState, Frame, Now};
use radarllm_monitor::rows::{Activity, ActivityRow, Origin};

use super::*;

const NOW_MS: i64 = 1_795_455_492_000;

pub(crate) fn about() -> About {
    About {
        name: "lounge".into(),
        origin: origin(),
        radar_height_m: 1.2,
        frame_period_s: 0.1,
        zones: Vec::new(),
    }
}

fn origin() -> Origin {
    Origin {
        source: "sim:".into(),
        radar: "awr1843boost".into(),
        model: "default".into(),
        decoder: "greedy".into(),
        version: "0.1.0".into(),
        synthetic: true,
    }
}

fn stamp(n: i64) -> Stamp {
    Stamp {
        utc_ms: NOW_MS + 100 * n,
        t_s: 0.1 * n as f64,
    }
}

fn now(person: Option<u32>) -> Body {
    Body::Now(Now {
        person,
        caption: person.map(|_| "a person walks".into()),
        label: "walk".into(),
        confidence: Some(0.6),
        window_s: 6.0,
        reason: None,
        provisional: true,
        synthetic: true,
    })
}

fn row(id: i64, start_ms: i64) -> Body {
    let activity = Activity {
        start_ms,
        end_ms: start_ms + 4_000,
        person: 1,
        action: "walk".into(),
        caption: "a person walks".into(),
        confidence: None,
        windows: 1,
        points: 10,
        place_m: None,
    };
    Body::Activity(Box::new(ActivityRow {
        id,
        activity,
        origin: origin(),
    }))
}

fn next(reader: &Reader) -> Message {
    let published = reader.recv_timeout(Duration::from_secs(5)).unwrap();
    serde_json::from_str(&published.json).unwrap()
}

fn hello(bus: &Bus) -> Hello {
    match next(&bus.subscribe()).at.what {
        Body::Hello(hello) => *hello,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_slow_reader_loses_frames_and_hears_of_it_and_others_lose_nothing() {
    let bus = Bus::new(about());
    let (slow, quick) = (bus.subscribe(), bus.subscribe());
    next(&quick);
    for n in 0..200 {
        bus.publish(stamp(n), Body::Frame(Frame::default()));
        if n % 10 == 0 {
            bus.publish(stamp(n), now(Some(1)));
            assert!(matches!(next(&quick).at.what, Body::Frame(_)));
            assert!(matches!(next(&quick).at.what, Body::Now(_)));
        } else {
            assert!(matches!(next(&quick).at.what, Body::Frame(_)));
        }
    }
    let lag = next(&slow);
    assert!(
        matches!(lag.at.what, Body::Lag(l) if l.dropped == 221 - 64),
        "{lag:?}"
    );
    let mut rest = Vec::new();
    while let Ok(message) = slow.recv_timeout(Duration::ZERO) {
        rest.push(serde_json::from_str::<Message>(&message.json).unwrap());
    }
    let of = |wanted: fn(&Body) -> bool| rest.iter().filter(|m| wanted(&m.at.what)).count();
    assert_eq!(of(|b| matches!(b, Body::Hello(_))), 1);
    assert_eq!(of(|b| matches!(b, Body::Now(_))), 20);
    assert_eq!(of(|b| matches!(b, Body::Frame(_))), 43);
    assert!(rest.windows(2).all(|pair| pair[0].seq < pair[1].seq));
    assert_eq!(bus.counts().frames_dropped, 157);
}

#[test]
fn a_reader_that_loses_what_must_not_be_lost_is_closed() {
    let bus = Bus::new(about());
    let reader = bus.subscribe();
    for n in 0..64 {
        bus.publish(stamp(n), now(Some(1)));
    }
    assert_eq!(
        reader.recv_timeout(Duration::ZERO).unwrap_err(),
        Silence::Closed
    );
    let counts = bus.counts();
    assert_eq!((counts.readers, counts.readers_closed), (0, 1));
}

#[test]
fn a_publisher_waits_for_the_reader_of_a_replay() {
    const N: u64 = 1_000;
    let bus = Bus::new(about());
    let reader = bus.subscribe_awaited();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for n in 0..N {
                bus.publish(stamp(n as i64), now(Some(1)));
            }
            bus.close();
        });
        let mut n = 0;
        while let Ok(message) = reader.recv_timeout(Duration::from_secs(20)) {
            assert_eq!(message.seq, n);
            n += 1;
            if n % 100 == 0 {
                std::thread::sleep(Duration::from_millis(2));
            }
        }
        // With `hello`.
        assert_eq!(n, N + 1);
    });
    assert_eq!(bus.counts().readers_closed, 0);
}

#[test]
fn nobody_waits_for_a_reader_that_has_gone_or_is_left_behind() {
    for is_dropped in [true, false] {
        let bus = Bus::new(about());
        let reader = bus.subscribe_awaited();
        std::thread::scope(|scope| {
            let publisher = scope.spawn(|| {
                for n in 0..200 {
                    bus.publish(stamp(n), now(Some(1)));
                }
            });
            next(&reader);
            match is_dropped {
                true => drop(reader),
                false => bus.stop_waiting(),
            }
            publisher.join().unwrap();
        });
    }
}

#[test]
fn late_comers_learn_the_state() {
    let bus = Bus::new(about());
    bus.publish(stamp(0), row(1, NOW_MS - 4_000_000));
    bus.publish(stamp(1), row(2, NOW_MS - 60_000));
    bus.publish(stamp(2), now(Some(1)));
    bus.publish(stamp(3), now(Some(2)));
    for (id, state) in [
        (7, FallState::Suspected),
        (7, FallState::Confirmed),
        (8, FallState::Suspected),
        (8, FallState::Dismissed),
    ] {
        let fall = Fall {
            id,
            state,
            person: Some(1),
            dwell_s: 1.0,
            acknowledged: false,
            synthetic: true,
        };
        bus.publish(stamp(4), Body::Fall(fall));
    }
    let first = hello(&bus);
    assert_eq!(first.rows.iter().map(|r| r.id).collect::<Vec<_>>(), [2]);
    assert_eq!(first.now.len(), 2);
    assert_eq!(first.falls.len(), 1);
    assert_eq!(first.falls[0].what.state, FallState::Confirmed);

    bus.publish(stamp(5), now(None));
    assert_eq!(hello(&bus).now.len(), 1, "nobody is there");
    // A sentence that is not renewed is not the newest one for ever.
    bus.publish(stamp(400), Body::Frame(Frame::default()));
    assert!(hello(&bus).now.is_empty());
}

#[test]
fn what_is_forgotten_is_told_to_nobody_and_to_all() {
    let bus = Bus::new(about());
    let reader = bus.subscribe();
    bus.publish(stamp(0), row(1, NOW_MS - 60_000));
    bus.publish(stamp(1), row(2, NOW_MS - 10_000));
    bus.forget(NOW_MS - 100_000, NOW_MS - 50_000);
    let rows = |message: Message| match message.at.what {
        Body::Hello(hello) => hello.rows.iter().map(|r| r.id).collect::<Vec<_>>(),
        other => panic!("{other:?}"),
    };
    assert!(rows(next(&reader)).is_empty());
    next(&reader);
    next(&reader);
    assert_eq!(rows(next(&reader)), [2]);
}

#[test]
fn readers_end_with_the_bus_and_leave_it_when_dropped() {
    let bus = Bus::new(about());
    let reader = bus.subscribe();
    drop(bus.subscribe());
    assert_eq!(bus.counts().readers, 1);
    bus.close();
    next(&reader);
    let end = reader.recv_timeout(Duration::from_secs(5));
    assert_eq!(end.unwrap_err(), Silence::Closed);
    let late = bus.subscribe().recv_timeout(Duration::ZERO);
    assert_eq!(late.unwrap_err(), Silence::Closed);
}

#[test]
fn a_reader_wakes_when_something_is_published() {
    let bus = Bus::new(about());
    let reader = bus.subscribe();
    next(&reader);
    std::thread::scope(|scope| {
        let waiting = scope.spawn(|| next(&reader).seq);
        bus.publish(stamp(0), now(None));
        assert_eq!(waiting.join().unwrap(), 1);
    });
    let nothing = reader.recv_timeout(Duration::from_millis(5));
    assert_eq!(nothing.unwrap_err(), Silence::Timeout);
}
