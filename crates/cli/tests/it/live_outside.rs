//! `live` as other programs see it: systemd, Prometheus and, where it is installed, the MQTT broker mosquitto.

use std::{
    collections::BTreeMap,
    io::{BufRead, BufReader, ErrorKind, Read, Write},
    net::{TcpListener, TcpStream},
    path::Path,
    process::{Child, Command, Stdio},
    sync::{Arc, Mutex},
    thread,
    time::{Duration, Instant},
};

use serde_json::Value;

use crate::command::refused;

/// How long a test waits for what must happen.
const DEADLINE: Duration = Duration::from_secs(180);
const CONFIG: &str = "homeassistant/device/radarllm_lounge/config";
const STATUS: &str = "homeassistant/status";
const AVAILABILITY: &str = "radarllm/lounge/availability";
const SOURCE: &str = "radarllm/lounge/source/availability";
const STATE: &str = "radarllm/lounge/state";
const CAPTION: &str = "radarllm/lounge/caption";
const FALL: &str = "radarllm/lounge/fall";

/// A program and the lines that it prints. It is killed when this is dropped.
pub struct Program {
    pub child: Child,
    lines: Arc<Mutex<Vec<String>>>,
}

impl Program {
    /// Starts a program and listens to its standard error, or to its standard output. `None` if it is not installed.
    pub fn start(command: &mut Command, listen_to_stderr: bool) -> Option<Self> {
        command.stdin(Stdio::null());
        match listen_to_stderr {
            true => command.stdout(Stdio::null()).stderr(Stdio::piped()),
            false => command.stdout(Stdio::piped()).stderr(Stdio::null()),
        };
        let mut child = match command.spawn() {
            Ok(child) => child,
            Err(error) if error.kind() == ErrorKind::NotFound => return None,
            Err(error) => panic!("{command:?}: {error}"),
        };
        let output: Box<dyn Read + Send> = match listen_to_stderr {
            true => Box::new(child.stderr.take().unwrap()),
            false => Box::new(child.stdout.take().unwrap()),
        };
        let lines = Arc::<Mutex<Vec<String>>>::default();
        let heard = Arc::clone(&lines);
        thread::spawn(move || {
            for line in BufReader::new(output).split(b'\n').map_while(Result::ok) {
                let line = String::from_utf8_lossy(&line).into_owned();
                heard.lock().unwrap().push(line);
            }
        });
        Some(Self { child, lines })
    }

    pub fn lines(&self) -> Vec<String> {
        self.lines.lock().unwrap().clone()
    }

    pub fn signal(&self, signal: i32) {
        let pid = i32::try_from(self.child.id()).unwrap();
        // SAFETY: kill takes no memory; the process is a child that was not waited for.
        assert_eq!(unsafe { libc::kill(pid, signal) }, 0);
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub fn wait_for<T>(what: &str, mut check: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + DEADLINE;
    loop {
        if let Some(found) = check() {
            return found;
        }
        assert!(Instant::now() < end, "never came: {what}");
        thread::sleep(Duration::from_millis(20));
    }
}

/// `radarllm live sim:`.
fn live(more: &[&str], environment: &[(&str, &str)]) -> Program {
    let mut command = Command::new(env!("CARGO_BIN_EXE_radarllm"));
    let args = ["live", "sim:", "--name", "lounge", "--http", "127.0.0.1:0"];
    command.args(args).args(more).env_remove("STATE_DIRECTORY");
    command.envs(environment.iter().copied());
    Program::start(&mut command, true).unwrap()
}

/// Asks the server of `live`; the body of its answer.
pub fn get(live: &Program, target: &str) -> String {
    let answer = get_all(live, target);
    answer.split_once("\r\n\r\n").unwrap().1.to_string()
}

/// Asks the server of `live`; its answer with the head.
pub fn get_all(live: &Program, target: &str) -> String {
    let host = wait_for("the address of the page", || {
        let lines = live.lines();
        let line = lines.iter().find_map(|l| l.strip_prefix("http://"))?;
        Some(line.trim_end_matches('/').to_string())
    });
    let mut stream = TcpStream::connect(&host).unwrap();
    let request = format!("GET {target} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

fn free_port() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.local_addr().unwrap().port()
}

/// A running mosquitto, which Debian installs where users have no path. `None`, with a line, if it is not installed.
fn mosquitto(port: u16, config: Option<&Path>) -> Option<Program> {
    let port_text = port.to_string();
    for name in ["mosquitto", "/usr/sbin/mosquitto"] {
        let mut command = Command::new(name);
        match config {
            Some(path) => command.arg("-c").arg(path),
            None => command.args(["-p", &port_text]),
        };
        if let Some(mosquitto) = Program::start(&mut command, true) {
            wait_for("mosquitto listens", || {
                TcpStream::connect(("127.0.0.1", port)).ok()
            });
            return Some(mosquitto);
        }
    }
    eprintln!("skipped: mosquitto is not installed");
    None
}

/// What a subscriber of mosquitto has heard.
struct Subscriber(Program);

impl Subscriber {
    /// `None`, with a line, if mosquitto's clients are not installed.
    fn new(port: u16, login: &[&str]) -> Option<Self> {
        let mut command = Command::new("mosquitto_sub");
        let port = port.to_string();
        // Whether it is retained, the topic, the payload in hexadecimal digits.
        command.args(["-p", &port, "-t", "#", "-F", "%r %t %x"]);
        let program = Program::start(command.args(login), false);
        if program.is_none() {
            eprintln!("skipped: mosquitto_sub is not installed");
        }
        program.map(Self)
    }

    /// All messages: whether it was retained, topic, payload.
    fn messages(&self) -> Vec<(bool, String, String)> {
        let message = |line: &String| {
            let mut parts = line.splitn(3, ' ');
            let retained = parts.next().unwrap() == "1";
            let (topic, hex) = (parts.next().unwrap(), parts.next().unwrap());
            let digits = |i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap();
            let bytes: Vec<u8> = (0..hex.len() / 2).map(|i| digits(2 * i)).collect();
            let payload = String::from_utf8_lossy(&bytes).into_owned();
            (retained, topic.to_string(), payload)
        };
        self.0.lines().iter().map(message).collect()
    }

    /// The last payload of every topic.
    fn last(&self) -> BTreeMap<String, String> {
        let messages = self.messages().into_iter();
        messages.map(|(_, topic, text)| (topic, text)).collect()
    }

    fn count(&self, topic: &str) -> usize {
        self.messages().iter().filter(|m| m.1 == topic).count()
    }

    fn wait_for(&self, topic: &str, check: impl Fn(&str) -> bool) -> String {
        wait_for(topic, || {
            self.last().get(topic).filter(|text| check(text)).cloned()
        })
    }
}

/// A stranger's message. The payload goes by standard input, as it may be long.
fn tell(port: u16, topic: &str, payload: &[u8], more: &[&str]) {
    let mut child = Command::new("mosquitto_pub")
        .args(["-p", &port.to_string(), "-t", topic, "-q", "1"])
        .arg(if payload.is_empty() { "-n" } else { "-s" })
        .args(more)
        .stdin(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(payload).unwrap();
    assert!(child.wait().unwrap().success());
}

#[test]
fn mosquitto_has_all_topics_after_strangers_a_restart_and_a_kill() {
    let port = free_port();
    let Some(broker) = mosquitto(port, None) else {
        return;
    };
    let Some(heard) = Subscriber::new(port, &[]) else {
        return;
    };
    let url = format!("mqtt://127.0.0.1:{port}");
    let live = live(
        &[
            "--mqtt",
            &url,
            "--mqtt-simulated",
            "--sim-fall-every",
            "1",
            "--fall-dwell",
            "2",
        ],
        &[],
    );
    let config = heard.wait_for(CONFIG, |_| true);
    let config: Value = serde_json::from_str(&config).unwrap();
    assert_eq!(config["cmps"].as_object().unwrap().len(), 6);
    heard.wait_for(AVAILABILITY, |text| text == "online");
    heard.wait_for(SOURCE, |text| text == "online");
    heard.wait_for(STATE, |text| {
        let state: Value = serde_json::from_str(text).unwrap();
        let mut options = config["cmps"]["activity"]["ops"].as_array().unwrap().iter();
        assert!(options.any(|option| *option == state["activity"]), "{text}");
        state["occupancy"] == "ON" && state["people"] == 1
    });
    heard.wait_for(CAPTION, |text| {
        let caption: Value = serde_json::from_str(text).unwrap();
        assert_eq!(caption["synthetic"], true);
        caption["caption"].is_string()
    });
    heard.wait_for(FALL, |text| text.contains("\"suspected\""));
    heard.wait_for(FALL, |text| text.contains("\"confirmed\""));
    heard.wait_for(STATE, |text| text.contains("\"fallen\":\"ON\""));
    assert!(get(&live, "/metrics").contains("radarllm_broker_connected 1\n"));

    // Whoever comes later gets everything but the transitions of falls.
    let late = Subscriber::new(port, &[]).unwrap();
    wait_for("retained messages", || {
        let retained = |m: &(bool, String, String)| m.0.then(|| m.1.clone());
        let topics: Vec<String> = late.messages().iter().filter_map(retained).collect();
        assert!(topics.iter().all(|topic| topic != FALL), "{topics:?}");
        let all = [CONFIG, AVAILABILITY, SOURCE, STATE, CAPTION];
        all.iter()
            .all(|t| topics.iter().any(|f| f == t))
            .then_some(())
    });
    drop(late);

    // Home Assistant comes online; strangers write there what it never does, and on the topics of the radar.
    let n_config = heard.count(CONFIG);
    for nonsense in [&b""[..], b"offline", b"\xff\xfe\0", &[b'x'; 4_000]] {
        tell(port, STATUS, nonsense, &[]);
    }
    tell(port, STATE, b"{\"people\": 99}", &[]);
    tell(port, FALL, b"{\"event_type\": \"confirmed\"}", &[]);
    tell(port, STATUS, b"online", &[]);
    wait_for("everything again", || {
        (heard.count(CONFIG) > n_config).then_some(())
    });
    // A packet that is too long ends the connection, and the radar comes back.
    let n_online = || {
        let online = |m: &&(bool, String, String)| m.1 == AVAILABILITY && m.2 == "online";
        heard.messages().iter().filter(online).count()
    };
    let n = n_online();
    tell(port, STATUS, &vec![b'x'; 100_000], &["-r"]);
    wait_for("the radar is online again", || {
        (n_online() > n).then_some(())
    });
    heard.wait_for(AVAILABILITY, |text| text == "online");
    assert!(get(&live, "/healthz").contains("\"ok\":true"));

    // A broker without a memory is started anew.
    drop((heard, broker));
    wait_for("a warning", || {
        let lines = live.lines();
        lines
            .iter()
            .any(|l| l.starts_with("warning: the broker"))
            .then_some(())
    });
    let broker = mosquitto(port, None).unwrap();
    let heard = Subscriber::new(port, &[]).unwrap();
    for topic in [CONFIG, SOURCE, STATE, CAPTION] {
        heard.wait_for(topic, |_| true);
    }
    heard.wait_for(AVAILABILITY, |text| text == "online");

    live.signal(libc::SIGKILL);
    let killed = Instant::now();
    heard.wait_for(AVAILABILITY, |text| text == "offline");
    assert!(killed.elapsed() < Duration::from_secs(15));
    drop(broker);
}

#[test]
fn a_broker_wants_the_right_password_and_gets_it_from_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_string()
    };
    // mosquitto reads its files as the user that started it only with this line.
    let (port, users) = (free_port(), folder.path().join("users"));
    let made = Command::new("mosquitto_passwd")
        .args(["-b", "-c"])
        .arg(&users)
        .args(["radar", "right horse"])
        .status();
    if made.is_err() {
        eprintln!("skipped: mosquitto_passwd is not installed");
        return;
    }
    let user = std::env::var("USER").unwrap_or_else(|_| "root".into());
    let config = file(
        "mosquitto.conf",
        &format!(
            "listener {port} 127.0.0.1\nallow_anonymous false\npassword_file {}\nuser {user}\n",
            users.display()
        ),
    );
    let Some(_broker) = mosquitto(port, Some(Path::new(&config))) else {
        return;
    };
    let login = ["-u", "radar", "-P", "right horse"];
    let Some(heard) = Subscriber::new(port, &login) else {
        return;
    };
    let url = format!("mqtt://127.0.0.1:{port}");
    let run = |password: &str| {
        let more = ["--mqtt", &url, "--mqtt-simulated", "--mqtt-user", "radar"];
        let password = ["--mqtt-password-file", password];
        live(&[&more[..], &password].concat(), &[])
    };
    let wrong = run(&file("wrong", "wrong battery\n"));
    let warning = wait_for("a warning", || {
        let lines = wrong.lines();
        lines
            .into_iter()
            .find(|l| l.starts_with("warning: the broker"))
    });
    assert!(!warning.contains("battery"), "{warning}");
    // The radar goes on without the broker, and says so.
    assert!(get(&wrong, "/metrics").contains("radarllm_broker_connected 0\n"));
    let health: Value = serde_json::from_str(&get(&wrong, "/healthz")).unwrap();
    assert_eq!(health["broker"]["connected"], false, "{health}");
    assert!(health["broker"]["problem"].is_string(), "{health}");
    let bundle = get(&wrong, "/api/bug-bundle");
    assert!(!bundle.contains("battery"), "{bundle}");
    assert_eq!(heard.count(AVAILABILITY), 0);
    drop(wrong);
    let _right = run(&file("right", "right horse\n"));
    heard.wait_for(AVAILABILITY, |text| text == "online");
    heard.wait_for(CONFIG, |_| true);
}

#[test]
fn metrics_are_clean_under_promtool() {
    let live = live(&["--mqtt", "mqtt://127.0.0.1:1", "--mqtt-simulated"], &[]);
    wait_for("a sentence is counted", || {
        let metrics = get(&live, "/metrics");
        let none = "radarllm_caption_seconds_count 0\n";
        (metrics.contains("radarllm_caption_seconds_count") && !metrics.contains(none))
            .then_some(())
    });
    let command = Command::new("promtool")
        .args(["check", "metrics"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn();
    let mut promtool = match command {
        Ok(promtool) => promtool,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            eprintln!("skipped: promtool is not installed");
            return;
        }
        Err(error) => panic!("{error}"),
    };
    let mut stdin = promtool.stdin.take().unwrap();
    stdin.write_all(get(&live, "/metrics").as_bytes()).unwrap();
    drop(stdin);
    let out = promtool.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&[out.stdout, out.stderr].concat()).into_owned();
    assert!(out.status.success() && said.is_empty(), "{said}");
}

#[cfg(target_os = "linux")]
#[test]
fn systemd_hears_that_the_service_is_ready_alive_and_stopping() {
    use std::os::linux::net::SocketAddrExt;
    use std::os::unix::net::{SocketAddr, UnixDatagram};

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("notify");
    let name = format!("radarllm-test-{}", std::process::id());
    let abstract_address = SocketAddr::from_abstract_name(&name).unwrap();
    for (socket, address) in [
        (
            UnixDatagram::bind(&path).unwrap(),
            path.to_str().unwrap().to_string(),
        ),
        (
            UnixDatagram::bind_addr(&abstract_address).unwrap(),
            format!("@{name}"),
        ),
    ] {
        socket.set_read_timeout(Some(DEADLINE)).unwrap();
        let hear = || {
            let mut bytes = [0; 64];
            let n = socket.recv(&mut bytes).unwrap();
            String::from_utf8(bytes[..n].to_vec()).unwrap()
        };
        let environment = [
            ("NOTIFY_SOCKET", &address[..]),
            ("WATCHDOG_USEC", "1000000"),
        ];
        let mut live = live(&[], &environment);
        assert_eq!(hear(), "READY=1");
        // Ready means that the page answers.
        let began = Instant::now();
        assert!(get(&live, "/healthz").contains("\"ok\":"));
        for _ in 0..4 {
            assert_eq!(hear(), "WATCHDOG=1");
        }
        // Every half of what is wanted.
        assert!(began.elapsed() >= Duration::from_millis(1_400));
        let stopped = Instant::now();
        live.signal(libc::SIGTERM);
        while hear() != "STOPPING=1" {}
        let status = live.child.wait().unwrap();
        assert_eq!(status.code(), Some(0));
        assert!(stopped.elapsed() < Duration::from_secs(5));
    }
}

#[test]
fn what_is_forgotten_is_not_in_the_file_any_more() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("live.db");
    let path = database.to_str().unwrap();
    let run = |args: &[&str]| {
        let output = crate::command::radarllm(args);
        assert!(output.status.success(), "{args:?}: {output:?}");
        String::from_utf8(output.stdout).unwrap()
    };
    let input = "builtin:squat?repetitions=6";
    let replay = ["live", input, "--speed", "max", "--no-http", "--db", path];
    run(&replay);
    let bytes = || -> Vec<u8> {
        let files = std::fs::read_dir(folder.path()).unwrap();
        let files = files.map(|file| std::fs::read(file.unwrap().path()).unwrap());
        files.flatten().collect()
    };
    let contains = |text: &str| {
        bytes()
            .windows(text.len())
            .any(|window| window == text.as_bytes())
    };
    assert!(contains("a person squats"));
    // What is of today stays when everything before today is forgotten.
    run(&["live", "forget", "--before", "1970-01-02", "--db", path]);
    assert!(contains("a person squats"));
    let forgot = run(&["live", "forget", "--before", "now", "--db", path, "--json"]);
    let forgot: Value = serde_json::from_str(&forgot).unwrap();
    assert!(forgot["activities"].as_u64().unwrap() >= 1, "{forgot}");
    for text in ["a person", "squat"] {
        assert!(!contains(text), "{text}");
    }
    let again = run(&["live", "forget", "--before", "now", "--db", path]);
    assert_eq!(again, "forgot 0 activities and 0 events\n");

    for (before, expected) in [
        ("yesterday", "no date"),
        ("2026-02-29", "no date"),
        ("", "no date"),
    ] {
        let error = refused(&["live", "forget", "--before", before, "--db", path]);
        assert!(error.contains(expected), "{error}");
    }
    let missing = folder.path().join("none.db");
    let error = refused(&[
        "live",
        "forget",
        "--before",
        "now",
        "--db",
        missing.to_str().unwrap(),
    ]);
    assert!(error.contains("none.db") && !missing.exists(), "{error}");
    // A running radar has the only pen.
    let live = live(&["--db", path], &[]);
    get(&live, "/healthz");
    let error = refused(&["live", "forget", "--before", "now", "--db", path]);
    assert!(error.contains("stop `live` first"), "{error}");
}
