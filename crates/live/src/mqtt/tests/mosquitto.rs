//! The same against mosquitto, where it is installed.

use std::collections::BTreeMap;
use std::io;
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};

use tokio::runtime::Runtime;
use tokio::time::timeout;

use super::*;
use crate::mqtt::link::{Link, LinkEvent, Will};

/// A running mosquitto. It is killed when this is dropped.
struct Mosquitto(Child);

impl Mosquitto {
    /// `None` if it is not installed.
    fn start(port: u16) -> Option<Self> {
        let mut command = Command::new("mosquitto");
        command.args(["-p", &port.to_string()]);
        let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        let mosquitto = match child {
            Ok(child) => Self(child),
            Err(error) if error.kind() == io::ErrorKind::NotFound => return None,
            Err(error) => panic!("{error}"),
        };
        let end = Instant::now() + DEADLINE;
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            assert!(Instant::now() < end, "mosquitto does not listen");
            std::thread::sleep(Duration::from_millis(10));
        }
        Some(mosquitto)
    }
}

impl Drop for Mosquitto {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Subscribes to `radarllm/#` until something is so.
fn listen(
    runtime: &Runtime,
    options: &Options,
    check: impl Fn(&BTreeMap<String, (String, bool)>) -> bool,
) {
    let mut found = BTreeMap::new();
    let listening = async {
        let will = Will {
            topic: "listener/will",
            payload: "",
        };
        let mut link = Link::open(options, "listener", &will);
        while !check(&found) {
            match link.next().await {
                LinkEvent::Connected => assert!(link.subscribe("radarllm/#")),
                LinkEvent::Acknowledged => {}
                LinkEvent::Message {
                    topic,
                    payload,
                    retained,
                } => {
                    found.insert(topic, (String::from_utf8(payload).unwrap(), retained));
                }
                LinkEvent::Lost { reason, .. } => panic!("{reason}"),
            }
        }
        link.close().await;
    };
    let in_time = runtime.block_on(async { timeout(DEADLINE, listening).await });
    assert!(in_time.is_ok(), "{found:#?}");
}

#[test]
fn mosquitto_keeps_everything_and_gets_it_again_after_a_restart() {
    let port = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let Some(mosquitto) = Mosquitto::start(port) else {
        eprintln!("skipped: mosquitto is not on PATH");
        return;
    };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    let options = Options {
        retry: [Duration::from_millis(5), Duration::from_millis(50)],
        ..Options::new(format!("127.0.0.1:{port}").parse().unwrap())
    };
    let bus = bus();
    let publisher = Publisher::start(options.clone(), Arc::clone(&bus)).unwrap();
    publish(&bus, presence(2));
    let is = |found: &BTreeMap<String, (String, bool)>, topic, text: &str| {
        found
            .get(topic)
            .is_some_and(|(payload, _)| payload.contains(text))
    };
    listen(&runtime, &options, |found| {
        is(found, AVAILABILITY, "online")
            && is(found, STATE, "\"people\":2")
            && is(found, CAPTION, "awr1843boost")
    });
    drop(mosquitto);
    wait_until(&publisher, |counts| !counts.connected);
    publish(&bus, presence(3));
    let _mosquitto = Mosquitto::start(port).unwrap();
    listen(&runtime, &options, |found| is(found, STATE, "\"people\":3"));
    assert!(publisher.stop());
    listen(&runtime, &options, |found| {
        is(found, AVAILABILITY, "offline") && found[AVAILABILITY].1 && !found.contains_key(FALL)
    });
}
