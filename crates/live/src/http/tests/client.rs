//! A client of a few lines.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::time::Duration;

use serde_json::Value;

use radarllm_monitor::messages::Message;

/// Longest wait of a test for anything.
const WAIT: Duration = Duration::from_secs(20);

/// An answer.
#[derive(Debug)]
pub struct Reply {
    pub status: u16,
    pub head: String,
    pub body: String,
}

impl Reply {
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap_or_else(|e| panic!("{e}: {}", self.body))
    }

    /// The value of a header.
    pub fn header(&self, name: &str) -> Option<&str> {
        self.head.lines().find_map(|line| {
            let (key, value) = line.split_once(':')?;
            key.eq_ignore_ascii_case(name).then(|| value.trim())
        })
    }
}

pub fn connect(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(WAIT)).unwrap();
    stream.set_write_timeout(Some(WAIT)).unwrap();
    stream
}

/// Sends a request and reads until the server closes. A reply that ends in a reset is taken as far as it came, and one
/// without a byte has the status 0.
pub fn send(address: SocketAddr, request: &[u8]) -> Reply {
    let mut stream = connect(address);
    // The server may refuse and close before it has everything.
    let _ = stream.write_all(request);
    read_reply(stream)
}

pub fn read_reply(mut stream: TcpStream) -> Reply {
    let mut bytes = Vec::new();
    let mut chunk = [0; 4096];
    while let Ok(n @ 1..) = stream.read(&mut chunk) {
        bytes.extend(&chunk[..n]);
    }
    let text = String::from_utf8(bytes).unwrap();
    let (head, body) = text.split_once("\r\n\r\n").unwrap_or((&text, ""));
    let status = head.split(' ').nth(1).and_then(|s| s.parse().ok());
    Reply {
        status: status.unwrap_or(0),
        head: head.into(),
        body: body.into(),
    }
}

/// A listener to the live messages.
pub struct Listener {
    lines: BufReader<TcpStream>,
    pub status: u16,
}

impl Listener {
    pub fn new(address: SocketAddr) -> Self {
        let mut stream = connect(address);
        let request = format!("GET /api/live HTTP/1.1\r\nHost: {address}\r\n\r\n");
        stream.write_all(request.as_bytes()).unwrap();
        let mut lines = BufReader::new(stream);
        let mut first = String::new();
        lines.read_line(&mut first).unwrap();
        let status = first.split(' ').nth(1).and_then(|s| s.parse().ok());
        Self {
            lines,
            status: status.unwrap_or(0),
        }
    }

    /// The next message, or `None` at the end. Comments, lengths of chunks and other lines are skipped.
    pub fn next(&mut self) -> Option<Message> {
        let mut line = String::new();
        while self.lines.read_line(&mut line).ok()? > 0 {
            if let Some(json) = line.strip_prefix("data:") {
                return Some(serde_json::from_str(json.trim()).unwrap());
            }
            line.clear();
        }
        None
    }

    pub fn leave(self) {
        let _ = self.lines.get_ref().shutdown(Shutdown::Both);
    }
}
