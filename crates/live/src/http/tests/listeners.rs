//! Listeners to the live messages.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use radarllm_monitor::messages::{Body, Frame, Health, Now, SourceState, Stamp};

use super::client::Listener;
use super::*;

/// A frame message of 55 kB, so that the buffers of the operating system fill up soon.
fn large_frame() -> Frame {
    Frame {
        points: "A".repeat(55_000),
        ..Frame::default()
    }
}

fn now() -> Now {
    Now {
        person: Some(1),
        caption: Some("a person sits down".into()),
        label: "sit_down".into(),
        confidence: Some(0.7),
        window_s: 6.0,
        reason: None,
        provisional: true,
        synthetic: true,
    }
}

fn health() -> Health {
    Health {
        source: SourceState::Ok,
        degraded: None,
        frames_used: 1,
        frames_lost: 0,
        frames_dropped: 0,
        problems: Vec::new(),
    }
}

fn wait_for(what: &str, is_so: impl Fn() -> bool) {
    let until = Instant::now() + Duration::from_secs(20);
    while !is_so() {
        assert!(Instant::now() < until, "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn every_listener_begins_with_hello() {
    let fixture = fixture(loopback());
    fixture.bus.publish(Stamp::default(), Body::Now(now()));
    let mut listener = Listener::new(fixture.server.address());
    assert_eq!(listener.status, 200);
    let Body::Hello(hello) = listener.next().unwrap().at.what else {
        panic!("no hello");
    };
    assert_eq!(hello.about.name, "lounge");
    assert!(hello.about.origin.synthetic);
    assert_eq!(hello.now[0].what, now());
    let state = fixture.get("/api/state").json();
    assert_eq!(state["type"], "hello");
    assert_eq!(state["now"][0]["caption"], "a person sits down");
    let text = fixture.get("/metrics").body;
    assert!(text.contains("radarllm_listeners 1\n"), "{text}");
}

#[test]
fn a_stalled_listener_loses_frames_alone_and_the_33rd_is_refused() {
    let fixture = fixture(loopback());
    let address = fixture.server.address();
    let mut listeners: Vec<Listener> = (0..MAX_LISTENERS).map(|_| Listener::new(address)).collect();
    assert!(listeners.iter().all(|listener| listener.status == 200));
    assert_eq!(Listener::new(address).status, 503);

    // The first listener takes nothing; the others read on threads of their own and count what they have.
    let stalled = listeners.remove(0);
    let bus = &fixture.bus;
    let read: Vec<AtomicUsize> = listeners.iter().map(|_| AtomicUsize::new(0)).collect();
    std::thread::scope(|scope| {
        let reading: Vec<_> = listeners
            .iter_mut()
            .zip(&read)
            .map(|(listener, read)| {
                scope.spawn(move || {
                    let (mut n_frames, mut n_now, mut n_lags) = (0, 0, 0);
                    loop {
                        match listener.next().unwrap().at.what {
                            Body::Frame(_) => n_frames += 1,
                            Body::Now(_) => n_now += 1,
                            Body::Lag(_) => n_lags += 1,
                            Body::Health(_) => return (n_frames, n_now, n_lags),
                            _ => {}
                        }
                        read.store(n_frames + n_now, Ordering::Relaxed);
                    }
                })
            })
            .collect();
        // A message is published when those who read have most of the former ones, until the stalled one has lost some.
        let (mut n_frames, mut n_now) = (0, 0);
        while bus.counts().frames_dropped == 0 {
            wait_for("the others read", || {
                let have =
                    |read: &AtomicUsize| read.load(Ordering::Relaxed) + 16 > n_frames + n_now;
                read.iter().all(have)
            });
            bus.publish(Stamp::default(), Body::Frame(large_frame()));
            n_frames += 1;
            if n_frames % 10 == 0 {
                bus.publish(Stamp::default(), Body::Now(now()));
                n_now += 1;
            }
        }
        bus.publish(Stamp::default(), Body::Health(health()));
        for (i, reader) in reading.into_iter().enumerate() {
            let counts = reader.join().unwrap();
            assert_eq!(counts, (n_frames, n_now, 0), "listener {i}");
        }
    });
    assert!(bus.counts().frames_dropped > 0);
    drop(stalled);
    for listener in listeners {
        listener.leave();
    }
    // A listener that left is noticed when something is sent to it.
    wait_for("places are free again", || {
        bus.publish(Stamp::default(), Body::Frame(Frame::default()));
        bus.counts().readers == 0
    });
    assert_eq!(Listener::new(address).status, 200);
}

#[test]
fn a_listener_that_takes_nothing_loses_its_place() {
    let mut options = loopback();
    options.patience = Duration::from_millis(300);
    let fixture = fixture(options);
    let stalled = Listener::new(fixture.server.address());
    assert_eq!(stalled.status, 200);
    wait_for("the listener is closed", || {
        fixture
            .bus
            .publish(Stamp::default(), Body::Frame(large_frame()));
        fixture.bus.counts().readers == 0
    });
}

#[test]
fn streams_end_when_the_server_stops() {
    let fixture = fixture(loopback());
    let mut listener = Listener::new(fixture.server.address());
    assert!(listener.next().is_some());
    let began = Instant::now();
    drop(fixture);
    assert!(listener.next().is_none());
    assert!(began.elapsed() < Duration::from_secs(5));
}
