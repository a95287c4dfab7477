//! A small MQTT 3.1.1 broker for tests: wills, retained messages, subscriptions without wildcards, and connections that
//! end when a test says so.

use std::collections::BTreeMap;
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long a test waits for what must happen.
pub(super) const DEADLINE: Duration = Duration::from_secs(20);

/// A message that a client or its will published.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Message {
    pub topic: String,
    pub payload: String,
    pub qos: u8,
    pub retain: bool,
    pub is_will: bool,
}

/// What a client said when it connected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Connect {
    pub client_id: String,
    pub user: Option<String>,
    pub password: Option<String>,
    pub keep_alive_s: u16,
    will: Option<Message>,
}

#[derive(Debug, Default)]
pub(super) struct State {
    pub messages: Vec<Message>,
    pub connects: Vec<Connect>,
    pub retained: BTreeMap<String, String>,
    /// Number of connections that ended with DISCONNECT.
    pub n_farewells: usize,
    /// Publications are read and not acknowledged.
    pub is_mute: bool,
    /// What is sent instead of CONNACK.
    pub greeting: Option<Vec<u8>>,
    clients: Vec<(TcpStream, Vec<String>)>,
    is_stopped: bool,
}

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

/// A broker. It ends when this is dropped.
#[derive(Debug)]
pub(super) struct Broker {
    pub address: SocketAddr,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Broker {
    pub(super) fn start() -> Self {
        Self::start_at(SocketAddr::from(([127, 0, 0, 1], 0)))
    }

    /// A broker at an address where another one was before.
    pub(super) fn start_at(address: SocketAddr) -> Self {
        let listener = TcpListener::bind(address).unwrap();
        let address = listener.local_addr().unwrap();
        let shared = Arc::new(Shared::default());
        let sharing = Arc::clone(&shared);
        let thread = std::thread::spawn(move || {
            for stream in listener.incoming() {
                let (stream, shared) = (stream.unwrap(), Arc::clone(&sharing));
                if shared.lock().is_stopped {
                    return;
                }
                std::thread::spawn(move || shared.serve(stream));
            }
        });
        Self {
            address,
            shared,
            thread: Some(thread),
        }
    }

    pub(super) fn state(&self) -> MutexGuard<'_, State> {
        self.shared.lock()
    }

    /// Waits until something is so, and returns it.
    pub(super) fn wait<T>(&self, what: &str, mut check: impl FnMut(&State) -> Option<T>) -> T {
        let end = Instant::now() + DEADLINE;
        let mut state = self.shared.lock();
        loop {
            if let Some(found) = check(&state) {
                return found;
            }
            let left = end.saturating_duration_since(Instant::now());
            assert!(!left.is_zero(), "never came: {what}: {:#?}", state.messages);
            state = self.shared.changed.wait_timeout(state, left).unwrap().0;
        }
    }

    /// Sends bytes to all clients.
    pub(super) fn send(&self, bytes: &[u8]) {
        for (client, _) in &self.shared.lock().clients {
            // A client that refuses them closes the connection.
            let _ = (&*client).write_all(bytes);
        }
    }

    /// Ends all connections without a word.
    pub(super) fn kill_connections(&self) {
        for (client, _) in &self.shared.lock().clients {
            let _ = client.shutdown(Shutdown::Both);
        }
    }
}

impl Drop for Broker {
    fn drop(&mut self) {
        self.shared.lock().is_stopped = true;
        self.kill_connections();
        // One connection ends the wait for the next one.
        let _ = TcpStream::connect(self.address);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap()
    }

    fn change<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        let result = change(&mut self.lock());
        self.changed.notify_all();
        result
    }

    fn serve(&self, stream: TcpStream) {
        // An error is the end of the connection.
        let (mut will, mut is_farewell) = (None, false);
        let _ = self.converse(&stream, &mut will, &mut is_farewell);
        let _ = stream.shutdown(Shutdown::Both);
        let peer = stream.peer_addr().ok();
        self.change(|state| {
            state.clients.retain(|(c, _)| c.peer_addr().ok() != peer);
            state.n_farewells += usize::from(is_farewell);
            if let (Some(will), false) = (will, is_farewell) {
                state.publish(will);
            }
        });
    }

    fn converse(
        &self,
        mut stream: &TcpStream,
        will: &mut Option<Message>,
        is_farewell: &mut bool,
    ) -> io::Result<()> {
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(DEADLINE))?;
        let (1, body) = read_packet(stream)?.kind_and_body() else {
            return Ok(());
        };
        let connect = read_connect(&body);
        *will = connect.will.clone();
        let client = stream.try_clone()?;
        self.change(|state| {
            let greeting = state.greeting.clone();
            stream.write_all(&greeting.unwrap_or_else(|| vec![0x20, 2, 0, 0]))?;
            state.clients.push((client, Vec::new()));
            state.connects.push(connect);
            io::Result::Ok(())
        })?;
        loop {
            let packet = read_packet(stream)?;
            match packet.kind_and_body() {
                (3, body) => {
                    let (topic, rest) = split_text(&body);
                    let qos = packet.first >> 1 & 3;
                    let (id, payload) = rest.split_at(if qos > 0 { 2 } else { 0 });
                    let message = Message {
                        topic,
                        payload: String::from_utf8(payload.to_vec()).unwrap(),
                        qos,
                        retain: packet.first & 1 == 1,
                        is_will: false,
                    };
                    self.change(|state| {
                        state.publish(message);
                        match qos > 0 && !state.is_mute {
                            true => stream.write_all(&[&[0x40, 2], id].concat()),
                            false => Ok(()),
                        }
                    })?;
                }
                (8, body) => {
                    let (topic, _) = split_text(&body[2..]);
                    self.change(|state| {
                        stream.write_all(&[0x90, 3, body[0], body[1], 1])?;
                        if let Some(payload) = state.retained.get(&topic) {
                            stream.write_all(&publication(&topic, payload.as_bytes(), true))?;
                        }
                        let peer = stream.peer_addr().ok();
                        let mut clients = state.clients.iter_mut();
                        let own = clients.find(|(c, _)| c.peer_addr().ok() == peer);
                        if let Some((_, topics)) = own {
                            topics.push(topic);
                        }
                        io::Result::Ok(())
                    })?;
                }
                (12, _) => stream.write_all(&[0xd0, 0])?,
                (14, _) => {
                    *is_farewell = true;
                    return Ok(());
                }
                _ => {}
            }
        }
    }
}

impl State {
    fn publish(&mut self, message: Message) {
        if message.retain {
            self.retained
                .insert(message.topic.clone(), message.payload.clone());
        }
        self.messages.push(message);
    }

    /// Whether a client subscribed to a topic.
    pub(super) fn is_subscribed(&self, topic: &str) -> bool {
        let mut topics = self.clients.iter().flat_map(|(_, topics)| topics);
        topics.any(|t| t == topic)
    }
}

/// The bytes of a publication with QoS 0.
pub(super) fn publication(topic: &str, payload: &[u8], retain: bool) -> Vec<u8> {
    let mut bytes = vec![0x30 | u8::from(retain)];
    let mut n = 2 + topic.len() + payload.len();
    while n >= 128 {
        bytes.push((n % 128) as u8 | 128);
        n /= 128;
    }
    bytes.push(n as u8);
    bytes.extend((topic.len() as u16).to_be_bytes());
    bytes.extend(topic.bytes());
    bytes.extend(payload);
    bytes
}

struct Packet {
    first: u8,
    body: Vec<u8>,
}

impl Packet {
    fn kind_and_body(&self) -> (u8, Vec<u8>) {
        (self.first >> 4, self.body.clone())
    }
}

fn read_packet(mut stream: &TcpStream) -> io::Result<Packet> {
    let mut byte = [0];
    stream.read_exact(&mut byte)?;
    let first = byte[0];
    let mut n = 0;
    for shift in [0, 7, 14, 21] {
        stream.read_exact(&mut byte)?;
        n |= usize::from(byte[0] & 127) << shift;
        if byte[0] < 128 {
            break;
        }
    }
    let mut body = vec![0; n];
    stream.read_exact(&mut body)?;
    Ok(Packet { first, body })
}

fn read_connect(body: &[u8]) -> Connect {
    assert_eq!(&body[..7], b"\0\x04MQTT\x04");
    let flags = body[7];
    let keep_alive_s = u16::from_be_bytes([body[8], body[9]]);
    let (client_id, mut rest) = split_text(&body[10..]);
    let mut text = |is_there: bool| {
        is_there.then(|| {
            let (text, after) = split_text(rest);
            rest = after;
            text
        })
    };
    let (topic, payload) = (text(flags & 4 != 0), text(flags & 4 != 0));
    Connect {
        client_id,
        user: text(flags & 128 != 0),
        password: text(flags & 64 != 0),
        keep_alive_s,
        will: topic.zip(payload).map(|(topic, payload)| Message {
            topic,
            payload,
            qos: flags >> 3 & 3,
            retain: flags & 32 != 0,
            is_will: true,
        }),
    }
}

fn split_text(bytes: &[u8]) -> (String, &[u8]) {
    let n = usize::from(u16::from_be_bytes([bytes[0], bytes[1]]));
    let (text, rest) = bytes[2..].split_at(n);
    (String::from_utf8(text.to_vec()).unwrap(), rest)
}
