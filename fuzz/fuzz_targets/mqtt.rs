//! Bytes of a broker, on a connection of this computer. Packets are parsed by rumqttc, whose panics end no more than the
//! connection; what is done with them is ours.
#![no_main]

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener};
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use libfuzzer_sys::fuzz_target;
use radarllm_fuzz::{about, only_our_panics};
use radarllm_live::bus::Bus;
use radarllm_live::mqtt::{Options, Publisher};

const PATIENCE: Duration = Duration::from_secs(5);

static LISTENER: LazyLock<TcpListener> =
    LazyLock::new(|| TcpListener::bind("127.0.0.1:0").expect("a listener"));

fuzz_target!(init: only_our_panics(), |bytes: &[u8]| {
    let address = LISTENER.local_addr().expect("an address");
    let mut options = Options::new(format!("mqtt://{address}").parse().expect("an address"));
    options.actions = vec!["walk".into(), "sit_down".into()];
    // One connection only.
    options.retry = [Duration::from_secs(3_600); 2];
    let publisher = Publisher::start(options, Arc::new(Bus::new(about()))).expect("a publisher");
    let (mut broker, _) = LISTENER.accept().expect("a connection");
    broker.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    // The client may close the connection before it has read everything.
    let _ = broker.write_all(bytes);
    let _ = broker.shutdown(Shutdown::Write);
    let mut sent = Vec::new();
    if let Err(e) = broker.read_to_end(&mut sent) {
        let late = matches!(e.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut);
        assert!(!late, "no end of the connection");
    }
    drop(broker);
    let _ = publisher.counts();
    let _ = publisher.problem();
    publisher.stop();
});
