//! Who is let in, and what hostile requests get.

use std::io::Write;
use std::time::Instant;

use radarllm_monitor::messages::{Body, Fall, FallState, Stamp};

use super::client::{connect, read_reply, send};
use super::*;

#[test]
fn the_page_is_served_with_headers_that_keep_others_out() {
    let fixture = fixture(loopback());
    for (target, kind) in [
        ("/", "text/html; charset=utf-8"),
        ("/live.js", "text/javascript; charset=utf-8"),
        ("/live.css", "text/css; charset=utf-8"),
        ("/api/state", "application/json"),
        ("/nothing", "application/json"),
    ] {
        let reply = fixture.get(target);
        assert_eq!(reply.header("content-type"), Some(kind), "{target}");
        let policy = reply.header("content-security-policy").unwrap();
        assert!(policy.starts_with(
            "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'"
        ));
        assert!(policy.contains("frame-ancestors 'none'"));
        assert_eq!(reply.header("x-content-type-options"), Some("nosniff"));
        assert_eq!(reply.header("cache-control"), Some("no-store"));
    }
    assert_eq!(fixture.get("/nothing").status, 404);
    assert_eq!(fixture.ask("POST", "/api/state", "").status, 405);
    assert_eq!(fixture.ask("HEAD", "/", "").status, 200);
}

#[test]
fn foreign_names_are_misdirected() {
    let mut options = loopback();
    options.allow_hosts = vec!["Radar.local".into(), "[fd00::1]".into()];
    let fixture = fixture(options);
    let port = fixture.server.address().port();
    let status = |host: &str| {
        let request = format!("GET /api/state HTTP/1.1\r\n{host}Connection: close\r\n\r\n");
        fixture.send(&request).status
    };
    for ours in [
        format!("Host: 127.0.0.1:{port}\r\n"),
        format!("Host: LOCALHOST:{port}\r\n"),
        format!("Host: [::1]:{port}\r\n"),
        "Host: radar.local\r\n".into(),
        "Host: RADAR.LOCAL:443\r\n".into(),
        "Host: [fd00::1]:8741\r\n".into(),
    ] {
        assert_eq!(status(&ours), 200, "{ours}");
    }
    for foreign in [
        format!("Host: evil.example:{port}\r\n"),
        format!("Host: localhost.evil.example:{port}\r\n"),
        format!("Host: evil.radar.local:{port}\r\n"),
        format!("Host: 192.168.1.2:{port}\r\n"),
        format!("Host: 0.0.0.0:{port}\r\n"),
        format!("Host: 127.0.0.1:{}\r\n", port.wrapping_add(1)),
        "Host: 127.0.0.1\r\n".into(),
        "Host: \r\n".into(),
        "Host: \u{e9}\r\n".into(),
    ] {
        assert_eq!(status(&foreign), 421, "{foreign}");
    }
    assert_eq!(status(""), 400);
    let twice = format!("Host: 127.0.0.1:{port}\r\nHost: 127.0.0.1:{port}\r\n");
    assert_eq!(status(&twice), 400);
    let absolute = format!(
        "GET http://evil.example/api/state HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n"
    );
    assert_eq!(fixture.send(&absolute).status, 421);
}

#[test]
fn a_server_for_others_is_reached_under_every_address_but_not_under_every_name() {
    let mut options = Options::new(([0, 0, 0, 0], 0).into());
    options.token = Some(Token::new(TOKEN).unwrap());
    let fixture = fixture(options);
    let port = fixture.server.address().port();
    let ask = |host: &str| {
        let request = format!(
            "GET /api/state HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {TOKEN}\r\nConnection: close\r\n\r\n"
        );
        fixture.send(&request)
    };
    for ours in [
        format!("127.0.0.1:{port}"),
        format!("192.168.1.2:{port}"),
        "192.168.1.2".into(),
        format!("[fd00::1]:{port}"),
        format!("localhost:{port}"),
    ] {
        assert_eq!(ask(&ours).status, 200, "{ours}");
    }
    for foreign in [
        format!("evil.example:{port}"),
        format!("0.0.0.0:{port}"),
        format!("192.168.1.2.evil.example:{port}"),
    ] {
        let answer = ask(&foreign);
        assert_eq!(answer.status, 421, "{foreign}");
        assert!(answer.body.contains("--allow-host"), "{}", answer.body);
    }
}

#[test]
fn foreign_pages_are_refused() {
    let fixture = fixture(loopback());
    let address = fixture.server.address();
    for (lines, status) in [
        (format!("Origin: http://{address}\r\n"), 200),
        (format!("Origin: https://{address}\r\n"), 200),
        ("Sec-Fetch-Site: same-origin\r\n".into(), 200),
        ("Sec-Fetch-Site: none\r\n".into(), 200),
        ("Origin: http://evil.example\r\n".into(), 403),
        ("Origin: null\r\n".into(), 403),
        ("Origin: \r\n".into(), 403),
        (format!("Origin: http://{address}.evil.example\r\n"), 403),
        (format!("Origin: ftp://{address}\r\n"), 403),
        (format!("Origin: http://{address}\r\nOrigin: null\r\n"), 403),
        ("Sec-Fetch-Site: cross-site\r\n".into(), 403),
        ("Sec-Fetch-Site: same-site\r\n".into(), 403),
    ] {
        assert_eq!(
            fixture.ask("GET", "/api/state", &lines).status,
            status,
            "{lines}"
        );
    }
    // A link on another page may lead here.
    let link = fixture.ask("GET", "/", "Sec-Fetch-Site: cross-site\r\n");
    assert_eq!(link.status, 200);
}

#[test]
fn a_token_is_asked_for_everywhere_and_becomes_a_cookie() {
    let mut options = loopback();
    options.token = Some(Token::new(TOKEN).unwrap());
    options.allow_frames = vec!["http://home.local:8123".into()];
    let fixture = fixture(options);
    for target in [
        "/",
        "/live.js",
        "/live.css",
        "/api/live",
        "/api/state",
        "/api/history",
        "/api/ask?q=x",
        "/api/activity/1/points",
        "/api/bug-bundle",
        "/metrics",
        "/healthz",
        "/nothing",
        "/api/state?token=0123456789abcdef",
        "/?token=",
        "/?token=0123456789abcdee",
    ] {
        let reply = fixture.get(target);
        assert_eq!(reply.status, 401, "{target}");
        assert_eq!(reply.header("www-authenticate"), Some("Bearer"));
        assert_eq!(reply.header("set-cookie"), None);
        assert!(!reply.body.contains(TOKEN));
    }
    let opened = fixture.get(&format!("/?token={TOKEN}"));
    assert_eq!(opened.status, 200);
    let cookie = opened.header("set-cookie").unwrap();
    assert!(
        cookie.contains("; HttpOnly; SameSite=Strict; Path=/;"),
        "{cookie}"
    );
    let policy = opened.header("content-security-policy").unwrap();
    assert!(policy.ends_with("frame-ancestors http://home.local:8123"));
    let pair = cookie.split(';').next().unwrap();
    for (lines, status) in [
        (format!("Cookie: {pair}\r\n"), 200),
        (format!("Cookie: a=b; {pair}; c=d\r\n"), 200),
        (format!("Authorization: Bearer {TOKEN}\r\n"), 200),
        (format!("authorization: bearer {TOKEN}\r\n"), 200),
        ("Cookie: radarllm_token=wrong\r\n".into(), 401),
        (format!("Cookie: other={TOKEN}\r\n"), 401),
        (format!("Authorization: Basic {TOKEN}\r\n"), 401),
        (format!("Authorization: Bearer{TOKEN}\r\n"), 401),
        ("Authorization: Bearer \u{e9}\r\n".into(), 401),
    ] {
        assert_eq!(
            fixture.ask("GET", "/api/state", &lines).status,
            status,
            "{lines}"
        );
    }
}

#[test]
fn falls_are_acknowledged_by_those_who_may_ask() {
    let mut options = loopback();
    options.token = Some(Token::new(TOKEN).unwrap());
    let fixture = fixture(options);
    let fall = |id, state| {
        let fall = Fall {
            id,
            state,
            person: Some(1),
            dwell_s: 3.0,
            acknowledged: false,
            synthetic: true,
        };
        fixture.bus.publish(Stamp::default(), Body::Fall(fall));
    };
    fall(7, FallState::Suspected);
    fall(8, FallState::Confirmed);
    fall(9, FallState::Confirmed);
    fall(9, FallState::Recovered);
    let bearer = format!("Authorization: Bearer {TOKEN}\r\n");
    let status = |method, id: &str, lines: &str| {
        let target = format!("/api/falls/{id}/acknowledge");
        fixture.ask(method, &target, lines).status
    };
    assert_eq!(status("POST", "7", ""), 401);
    let foreign = format!("{bearer}Origin: http://evil.example\r\n");
    assert_eq!(status("POST", "7", &foreign), 403);
    let foreign = format!("{bearer}Sec-Fetch-Site: cross-site\r\n");
    assert_eq!(status("POST", "7", &foreign), 403);
    // A link or a picture can only get.
    assert_eq!(status("GET", "7", &bearer), 405);
    for unknown in ["9", "10", "-7", "x", "18446744073709551616", "7%00"] {
        assert_eq!(status("POST", unknown, &bearer), 404, "{unknown}");
    }
    assert_eq!(fixture.acknowledged.try_iter().count(), 0);
    assert_eq!(status("POST", "7", &bearer), 202);
    assert_eq!(status("POST", "8", &bearer), 202);
    let acknowledged: Vec<u64> = fixture.acknowledged.try_iter().collect();
    assert_eq!(acknowledged, [7, 8]);
    // Too many wait: the pipeline is gone.
    drop(fixture.acknowledged);
    let target = "/api/falls/7/acknowledge";
    let request = format!(
        "POST {target} HTTP/1.1\r\nHost: {}\r\n{bearer}Connection: close\r\n\r\n",
        fixture.server.address()
    );
    let address = fixture.server.address();
    assert_eq!(send(address, request.as_bytes()).status, 503);
}

#[test]
fn servers_that_anybody_could_ask_do_not_start() {
    let start = |options: Options| {
        let about = about();
        let sources = Sources {
            bus: Arc::new(Bus::new(about)),
            metrics: Arc::default(),
            liveness: Arc::new(Liveness::new(Duration::from_millis(100))),
            database: None,
            forget: None,
            broker: None,
            acknowledge: None,
            clock: Arc::new(|| Clock {
                now_ms: NOW_MS,
                offset_s: 0,
            }),
        };
        Server::start(options, sources).map(drop)
    };
    for address in ["0.0.0.0:0", "[::]:0", "192.0.2.1:0"] {
        let refused = start(Options::new(address.parse().unwrap()));
        assert!(
            matches!(refused, Err(HttpError::NoToken { .. })),
            "{address}"
        );
    }
    for name in ["", "a b", "radar.local:80", "evil;", "[::x]"] {
        let mut options = loopback();
        options.allow_hosts = vec![name.into()];
        assert!(
            matches!(start(options), Err(HttpError::Name { .. })),
            "{name}"
        );
    }
    for origin in [
        "",
        "*",
        "homeassistant.local",
        "http://a; script-src *",
        "http://a:x",
    ] {
        let mut options = loopback();
        options.allow_frames = vec![origin.into()];
        assert!(
            matches!(start(options), Err(HttpError::Name { .. })),
            "{origin}"
        );
    }
    let taken = fixture(loopback());
    let mut options = loopback();
    options.address = taken.server.address();
    assert!(matches!(start(options), Err(HttpError::Listen { .. })));
}

#[test]
fn large_requests_are_refused_by_name() {
    let mut options = loopback();
    options.patience = Duration::from_secs(1);
    let fixture = fixture(options);
    let body = |n: usize| format!("Content-Length: {n}\r\n");
    let host = fixture.server.address();
    let fits = "x".repeat(MAX_BODY_BYTES);
    let request = format!(
        "GET /api/state HTTP/1.1\r\nHost: {host}\r\n{}Connection: close\r\n\r\n{fits}",
        body(MAX_BODY_BYTES)
    );
    assert_eq!(fixture.send(&request).status, 200);
    for length in [MAX_BODY_BYTES + 1, 1 << 40] {
        assert_eq!(fixture.ask("GET", "/api/state", &body(length)).status, 413);
    }
    let chunk = format!("4000\r\n{}\r\n", "x".repeat(0x4000));
    let chunked = format!(
        "GET /api/state HTTP/1.1\r\nHost: {host}\r\nTransfer-Encoding: chunked\r\n\r\n{chunk}1\r\ny\r\n0\r\n\r\n"
    );
    assert_eq!(fixture.send(&chunked).status, 413);
    let long = format!("X-Long: {}\r\n", "x".repeat(40_000));
    assert_eq!(fixture.ask("GET", "/", &long).status, 431);
    let many = "X-Many: x\r\n".repeat(200);
    assert_eq!(fixture.ask("GET", "/", &many).status, 431);
    let target = format!("/api/ask?q={}", "x".repeat(60_000));
    assert!([414, 431].contains(&fixture.get(&target).status));
}

#[test]
fn what_is_no_http_gets_an_error_and_the_server_goes_on() {
    let fixture = fixture(loopback());
    for bytes in [
        &b"\r\n\r\n\r\n"[..],
        b"\0\0\0\0\0\0\0\0",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
        b"GET\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost 127.0.0.1\r\n\r\n",
        b"GET / HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
        b"GET /%ff%00?%zz HTTP/1.1\r\n\r\n",
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    ] {
        let mut stream = connect(fixture.server.address());
        stream.write_all(bytes).unwrap();
        stream.shutdown(std::net::Shutdown::Write).unwrap();
        let status = read_reply(stream).status;
        assert!([0, 400, 505].contains(&status), "{status} for {bytes:?}");
    }
    assert_eq!(fixture.get("/api/state").status, 200);
}

#[test]
fn slow_requests_end() {
    let mut options = loopback();
    options.patience = Duration::from_millis(300);
    let fixture = fixture(options);
    let address = fixture.server.address();
    let began = Instant::now();
    let mut half_head = connect(address);
    half_head.write_all(b"GET / HTTP/1.1\r\nHost: ").unwrap();
    let silent = connect(address);
    let mut half_body = connect(address);
    let head =
        format!("DELETE /api/history HTTP/1.1\r\nHost: {address}\r\nContent-Length: 9\r\n\r\n");
    half_body.write_all(head.as_bytes()).unwrap();
    assert!([0, 408].contains(&read_reply(half_head).status));
    assert_eq!(read_reply(silent).status, 0);
    let mut reply = String::new();
    std::io::Read::read_to_string(&mut half_body, &mut reply).unwrap_or_default();
    assert!(reply.starts_with("HTTP/1.1 408"), "{reply}");
    assert!(began.elapsed() < Duration::from_secs(15));
    assert_eq!(fixture.get("/").status, 200);
}

#[test]
fn too_many_connections_are_refused_and_room_comes_back() {
    let fixture = fixture(loopback());
    let address = fixture.server.address();
    // Connections that stay open after an answer.
    let request = format!("GET /healthz HTTP/1.1\r\nHost: {address}\r\n\r\n");
    let held: Vec<_> = (0..MAX_CONNECTIONS)
        .map(|_| {
            let mut stream = connect(address);
            stream.write_all(request.as_bytes()).unwrap();
            let mut first = [0; 12];
            std::io::Read::read_exact(&mut stream, &mut first).unwrap();
            assert_eq!(&first, b"HTTP/1.1 200");
            stream
        })
        .collect();
    assert_eq!(fixture.get("/").status, 503);
    drop(held);
    let until = Instant::now() + Duration::from_secs(15);
    while fixture.get("/").status != 200 {
        assert!(Instant::now() < until);
    }
}

/// Strangers who hold connections open, silent ones and ones that ask without the token, keep nobody out.
#[test]
fn strangers_keep_nobody_out() {
    const STRANGERS: usize = 130;
    let mut options = loopback();
    options.token = Some(Token::new(TOKEN).unwrap());
    let fixture = fixture(options);
    let address = fixture.server.address();
    let silent: Vec<_> = (0..STRANGERS).map(|_| connect(address)).collect();
    let ask = format!("GET /api/state HTTP/1.1\r\nHost: {address}\r\n\r\n");
    let askers: Vec<_> = (0..STRANGERS)
        .map(|_| {
            let mut stream = connect(address);
            stream.write_all(ask.as_bytes()).unwrap();
            stream
        })
        .collect();
    for _ in 0..20 {
        let began = Instant::now();
        let owner = format!(
            "GET /api/state HTTP/1.1\r\nHost: {address}\r\nAuthorization: Bearer {TOKEN}\r\nConnection: close\r\n\r\n"
        );
        assert_eq!(send(address, owner.as_bytes()).status, 200);
        assert!(began.elapsed() < Duration::from_secs(1));
    }
    assert!(fixture.metrics.connections_refused.get() >= (STRANGERS - MAX_STRANGERS) as u64);
    // Whoever asked without the token was told so, or had to leave; either way the connection is closed.
    for asker in askers {
        assert!([0, 401].contains(&read_reply(asker).status));
    }
    drop(silent);
}

#[test]
fn health_has_reasons() {
    let fixture = fixture(loopback());
    let well = fixture.get("/healthz");
    assert_eq!((well.status, &well.json()["ok"]), (200, &true.into()));
    std::thread::sleep(Duration::from_millis(2_400));
    let ill = fixture.get("/healthz");
    assert_eq!(ill.status, 503);
    assert_eq!(
        ill.json()["problems"][0],
        "no frame arrived from the radar for 2 s"
    );
    assert!(
        fixture
            .get("/metrics")
            .body
            .contains("radarllm_problems 1\n")
    );
    fixture.liveness.frame_arrived();
    assert_eq!(fixture.get("/healthz").status, 200);
}

#[test]
fn a_model_that_fails_is_in_the_health_and_no_reason_to_start_anew() {
    let fixture = fixture(loopback());
    let counters = &fixture.metrics.monitor;
    counters.model_failed("the model failed: no weights".into());
    let health = fixture.get("/healthz");
    assert_eq!(health.status, 200);
    assert_eq!(
        health.json()["model"],
        serde_json::json!({ "errors": 1, "problem": "the model failed: no weights" })
    );
    let metrics = fixture.get("/metrics").body;
    assert!(
        metrics.contains("radarllm_model_errors_total 1\n"),
        "{metrics}"
    );
    counters.described(Duration::ZERO);
    let model = fixture.get("/healthz").json()["model"].clone();
    assert_eq!(model, serde_json::json!({ "errors": 1, "problem": null }));
}
