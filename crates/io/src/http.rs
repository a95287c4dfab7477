//! A small HTTP/1.1 client: one JSON document is sent, one is received.
//!
//! Only `http://` is spoken, for servers on this machine or in a trusted network; TLS is left to a proxy. The answer is
//! bounded in size and in time, redirects are not followed, and connections are not kept.

use std::{
    fmt::Write as _,
    io::{Read, Write},
    net::{TcpStream, ToSocketAddrs},
    time::{Duration, Instant},
};

use crate::{Error, ErrorKind, Result};

/// Maximum length of the head of an answer, bytes.
const MAX_HEAD_BYTES: usize = 64 << 10;
/// Maximum length of the text of a refusal that becomes part of an error, characters.
const MAX_SHOWN_CHARS: usize = 300;
/// Time in which a connection must stand.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);

/// Limits of an exchange.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Maximum length of the body of the answer, bytes.
    pub max_bytes: usize,
    /// Time in which the whole answer must be there.
    pub timeout: Duration,
}

/// An address of a server: `http://HOST[:PORT][/PATH]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HttpUrl {
    /// Name or address, an IPv6 address without its brackets.
    host: String,
    port: u16,
    /// Begins with `/`.
    path: String,
}

impl HttpUrl {
    /// Parses an address.
    ///
    /// # Errors
    /// Another scheme, a user name, an invalid port, or characters that an address cannot contain.
    pub fn parse(url: &str) -> Result<Self> {
        let fail = |problem: &str| Err(Error::input(format!("{url}: {problem}")));
        if url.bytes().any(|b| !b.is_ascii_graphic()) {
            return fail("an address consists of visible ASCII characters");
        }
        if url.starts_with("https://") {
            return Err(Error::input(format!("{url}: https is not spoken here"))
                .of_kind(ErrorKind::Unsupported)
                .with_hint(
                    "start a local proxy that speaks https to the server, and give its http:// address",
                ));
        }
        let Some(rest) = url.strip_prefix("http://") else {
            return fail("expected http://HOST:PORT/PATH");
        };
        let rest = rest.split('#').next().unwrap_or_default();
        let (authority, path) = match rest.find(['/', '?']) {
            Some(at) => rest.split_at(at),
            None => (rest, "/"),
        };
        // Errors and reports show the address.
        if authority.contains('@') {
            return Err(Error::input("an address with a user name or a password")
                .with_hint("leave it out; a token has its own place"));
        }
        let (host, port) = match authority.strip_prefix('[') {
            Some(rest) => match rest.split_once(']') {
                Some((host, port)) => (host, port.strip_prefix(':').unwrap_or(port)),
                None => return fail("a bracket is not closed"),
            },
            None => authority.split_once(':').unwrap_or((authority, "")),
        };
        let port = match port {
            "" => 80,
            text => match text.parse() {
                Ok(port) => port,
                Err(_) => return fail("the port is not a number from 0 to 65535"),
            },
        };
        if host.is_empty() {
            return fail("no host");
        }
        Ok(Self {
            host: host.into(),
            port,
            path: match path.starts_with('/') {
                true => path.into(),
                false => format!("/{path}"),
            },
        })
    }

    /// The same server, with `tail` appended to the path.
    #[must_use]
    pub fn join(&self, tail: &str) -> Self {
        Self {
            path: format!("{}/{tail}", self.path.trim_end_matches('/')),
            ..self.clone()
        }
    }

    /// Host and port, as they are written in an address.
    fn authority(&self) -> String {
        match self.host.contains(':') {
            true => format!("[{}]:{}", self.host, self.port),
            false => format!("{}:{}", self.host, self.port),
        }
    }
}

impl std::fmt::Display for HttpUrl {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "http://{}{}", self.authority(), self.path)
    }
}

/// Sends a JSON document by POST and returns the body of the answer. `token` is sent as a bearer token.
///
/// # Errors
/// A server that cannot be reached, does not speak HTTP, answers with another status than 2xx, too much or too late; a
/// token with characters that a header cannot contain.
pub fn post_json(
    url: &HttpUrl,
    token: Option<&str>,
    body: &[u8],
    limits: Limits,
) -> Result<Vec<u8>> {
    let mut head = format!(
        "POST {} HTTP/1.1\r\nHost: {}\r\nContent-Type: application/json\r\nAccept: application/json\r\nContent-Length: {}\r\nConnection: close\r\n",
        url.path,
        url.authority(),
        body.len()
    );
    if let Some(token) = token {
        if token.is_empty() || token.bytes().any(|b| !b.is_ascii_graphic()) {
            return Err(Error::input(
                "the token has characters that a header cannot contain",
            ));
        }
        let _ = write!(head, "Authorization: Bearer {token}\r\n");
    }
    head.push_str("\r\n");
    let deadline = Instant::now() + limits.timeout;
    let io =
        |what: &str, e: std::io::Error| Error::input(format!("{url}: {what}: {e}")).caused_by(e);
    let mut stream = connect(url)?;
    stream
        .set_write_timeout(Some(limits.timeout.max(Duration::from_millis(1))))
        .map_err(|e| io("cannot set a limit of time", e))?;
    // A server may refuse before it has read everything, and its answer says why.
    let sent = stream
        .write_all(head.as_bytes())
        .and_then(|()| stream.write_all(body));
    let mut reader = Bounded {
        stream,
        deadline,
        left: limits.max_bytes.saturating_add(MAX_HEAD_BYTES),
    };
    let mut bytes = Vec::new();
    match (read_answer(&mut reader, &mut bytes), sent) {
        (_, Err(e)) if bytes.is_empty() => return Err(io("cannot send", e)),
        (Err(e), _) => return Err(io("cannot receive the answer", e)),
        (Ok(()), _) => {}
    }
    let answer = parse(&bytes, limits.max_bytes)
        .map_err(|problem| Error::input(format!("{url}: {problem}")))?;
    if !(200..300).contains(&answer.status) {
        let shown: String = String::from_utf8_lossy(&answer.body)
            .chars()
            .map(|c| if c.is_control() { ' ' } else { c })
            .take(MAX_SHOWN_CHARS)
            .collect();
        return Err(Error::input(format!(
            "{url}: the server answered with status {}: {}",
            answer.status,
            shown.trim()
        )));
    }
    Ok(answer.body)
}

/// Connects to the first address of the host that answers.
fn connect(url: &HttpUrl) -> Result<TcpStream> {
    let fail = |e: std::io::Error| Error::input(format!("{url}: cannot connect: {e}")).caused_by(e);
    let addresses = (url.host.as_str(), url.port)
        .to_socket_addrs()
        .map_err(fail)?;
    let mut last = std::io::Error::from(std::io::ErrorKind::AddrNotAvailable);
    for address in addresses {
        match TcpStream::connect_timeout(&address, CONNECT_TIMEOUT) {
            Ok(stream) => return Ok(stream),
            Err(e) => last = e,
        }
    }
    Err(fail(last))
}

/// A stream that is read until a point in time and up to a number of bytes.
struct Bounded {
    stream: TcpStream,
    deadline: Instant,
    left: usize,
}

impl Read for Bounded {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let left = self.deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(std::io::ErrorKind::TimedOut.into());
        }
        self.stream.set_read_timeout(Some(left))?;
        let n = self.stream.read(buffer)?;
        self.left = self.left.checked_sub(n).ok_or_else(|| {
            std::io::Error::new(std::io::ErrorKind::FileTooLarge, "more than is accepted")
        })?;
        Ok(n)
    }
}

/// Reads until the answer is complete or the server closes the connection.
fn read_answer(stream: &mut impl Read, bytes: &mut Vec<u8>) -> std::io::Result<()> {
    let mut buffer = [0; 16 << 10];
    loop {
        let n = match stream.read(&mut buffer) {
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
            // Servers that refuse early close before they have read everything.
            Err(e) if e.kind() == std::io::ErrorKind::ConnectionReset && !bytes.is_empty() => 0,
            other => other?,
        };
        bytes.extend_from_slice(&buffer[..n]);
        if n == 0 || parse(bytes, usize::MAX).is_ok_and(|answer| answer.is_delimited) {
            return Ok(());
        }
    }
}

/// An answer.
struct Answer {
    status: u16,
    body: Vec<u8>,
    /// Whether the body says where it ends, and is there as a whole.
    is_delimited: bool,
}

/// Splits an answer into status and body.
fn parse(bytes: &[u8], max_bytes: usize) -> std::result::Result<Answer, String> {
    let searched = &bytes[..bytes.len().min(MAX_HEAD_BYTES)];
    let Some(end) = searched.windows(4).position(|w| w == b"\r\n\r\n") else {
        return Err("the answer has no complete HTTP head".into());
    };
    let head = String::from_utf8_lossy(&bytes[..end]);
    let mut lines = head.split("\r\n");
    let status = lines
        .next()
        .and_then(|line| line.strip_prefix("HTTP/1."))
        .and_then(|rest| rest.split(' ').nth(1))
        .and_then(|status| status.parse().ok())
        .ok_or("the answer is not one of HTTP/1")?;
    let (mut length, mut is_chunked) = (None, false);
    for (name, value) in lines.filter_map(|line| line.split_once(':')) {
        let value = value.trim();
        match name.to_ascii_lowercase().as_str() {
            "content-length" => {
                let found: usize = value
                    .parse()
                    .map_err(|_| "Content-Length is not a number")?;
                length = Some(found);
            }
            "transfer-encoding" if value.eq_ignore_ascii_case("chunked") => is_chunked = true,
            "transfer-encoding" => return Err(format!("unknown Transfer-Encoding `{value}`")),
            _ => {}
        }
    }
    let rest = &bytes[end + 4..];
    let (body, is_delimited) = match (is_chunked, length) {
        (true, _) => (unchunked(rest)?, true),
        (false, Some(length)) => match rest.get(..length) {
            Some(body) => (body.to_vec(), true),
            None => return Err(format!("{} of {length} bytes arrived", rest.len())),
        },
        (false, None) => (rest.to_vec(), false),
    };
    match body.len() > max_bytes {
        true => Err(format!("more than the {max_bytes} bytes that are read")),
        false => Ok(Answer {
            status,
            body,
            is_delimited,
        }),
    }
}

/// The body of a chunked answer.
fn unchunked(mut rest: &[u8]) -> std::result::Result<Vec<u8>, String> {
    const CUT: &str = "the answer ends within a chunk";
    let mut body = Vec::new();
    loop {
        let end = rest.windows(2).position(|w| w == b"\r\n").ok_or(CUT)?;
        let size = String::from_utf8_lossy(&rest[..end]);
        let size = size.split(';').next().unwrap_or_default().trim();
        let size =
            usize::from_str_radix(size, 16).map_err(|_| "the length of a chunk is not a number")?;
        rest = &rest[end + 2..];
        if size == 0 {
            return Ok(body);
        }
        let chunk = rest.get(..size).ok_or(CUT)?;
        body.extend_from_slice(chunk);
        rest = rest[size..].strip_prefix(b"\r\n").ok_or(CUT)?;
    }
}

#[cfg(test)]
mod tests {
    use std::{net::TcpListener, thread};

    use super::*;

    const LIMITS: Limits = Limits {
        max_bytes: 1000,
        timeout: Duration::from_secs(5),
    };

    /// Answers one request with these bytes; returns the address and the request.
    fn server(answer: &'static [u8]) -> (HttpUrl, thread::JoinHandle<String>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/v1", listener.local_addr().unwrap());
        let request = thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let (mut bytes, mut buffer) = (Vec::new(), [0; 1000]);
            while !bytes.ends_with(b"{}") {
                let n = stream.read(&mut buffer).unwrap();
                bytes.extend_from_slice(&buffer[..n]);
            }
            stream.write_all(answer).unwrap();
            String::from_utf8(bytes).unwrap()
        });
        (HttpUrl::parse(&url).unwrap(), request)
    }

    #[test]
    fn addresses_are_parsed_or_refused_with_a_hint() {
        let shown = |url: &str| HttpUrl::parse(url).map(|u| u.join("chat").to_string());
        for (url, expected) in [
            ("http://localhost", "http://localhost:80/chat"),
            ("http://localhost:8000/v1/", "http://localhost:8000/v1/chat"),
            ("http://[::1]:8000/v1#x", "http://[::1]:8000/v1/chat"),
        ] {
            assert_eq!(shown(url).unwrap(), expected);
        }
        let https = shown("https://example.org/v1").unwrap_err();
        assert!(https.hint.unwrap().to_string().contains("proxy"));
        for url in [
            "localhost:80",
            "http://",
            "http://h:x",
            "http://h:70000",
            "http://[::1",
            "http://h/\r\nX: y",
        ] {
            assert!(shown(url).is_err(), "{url}");
        }
        let secret = shown("http://me:secret@h/").unwrap_err();
        assert!(!secret.to_string().contains("secret"));
    }

    #[test]
    fn bodies_with_a_length_in_chunks_and_until_the_end_arrive() {
        for answer in [
            &b"HTTP/1.1 200 OK\r\ncontent-length: 5\r\n\r\nhello and more"[..],
            b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n3;x=y\r\nhel\r\n2\r\nlo\r\n0\r\n\r\n",
            b"HTTP/1.0 201 Created\r\n\r\nhello",
        ] {
            let (url, request) = server(answer);
            assert_eq!(post_json(&url, Some("t0k"), b"{}", LIMITS).unwrap(), b"hello");
            let request = request.join().unwrap();
            assert!(request.starts_with("POST /v1 HTTP/1.1\r\n"), "{request}");
            assert!(request.contains("Authorization: Bearer t0k\r\n"), "{request}");
        }
    }

    #[test]
    fn damaged_and_refusing_answers_are_errors_that_say_why() {
        for (answer, expected) in [
            (
                &b"HTTP/1.1 401 Unauthorized\r\n\r\nno \x1b key"[..],
                "status 401: no   key",
            ),
            (
                b"HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\nhello",
                "5 of 9 bytes",
            ),
            (
                b"HTTP/1.1 200 OK\r\nContent-Length: -1\r\n\r\n",
                "not a number",
            ),
            (
                b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nffffffffffffffff\r\nx",
                "within a chunk",
            ),
            (
                b"HTTP/1.1 200 OK\r\nTransfer-Encoding: gzip\r\n\r\n",
                "gzip",
            ),
            (b"SSH-2.0-x\r\n\r\n", "not one of HTTP/1"),
            (b"", "no complete HTTP head"),
        ] {
            let (url, request) = server(answer);
            let error = post_json(&url, None, b"{}", LIMITS).unwrap_err();
            assert!(error.to_string().contains(expected), "{error}");
            request.join().unwrap();
        }
        let big: &'static [u8] =
            Vec::leak([&b"HTTP/1.1 200 OK\r\n\r\n"[..], &[b'x'; 1001]].concat());
        let (url, _request) = server(big);
        assert!(post_json(&url, None, b"{}", LIMITS).is_err());
        assert!(post_json(&url, Some("a\r\nb"), b"{}", LIMITS).is_err());
    }

    #[test]
    fn a_silent_server_is_given_up() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = HttpUrl::parse(&format!("http://{}", listener.local_addr().unwrap())).unwrap();
        let limits = Limits {
            timeout: Duration::from_millis(200),
            ..LIMITS
        };
        assert!(post_json(&url, None, b"{}", limits).is_err());
    }
}
