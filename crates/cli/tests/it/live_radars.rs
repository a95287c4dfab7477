//! `live` with boards on pseudo-terminals, a capture card on the loopback network, and recordings.

use std::{
    fs,
    net::UdpSocket,
    path::Path,
    process::Command,
    time::{Duration, Instant},
};

use radarllm_base::Clip;
use radarllm_formats::{adc::CubeShape, radar_to_toml};
use serde_json::Value;

use crate::{
    broker::Broker,
    command::{json, json_lines, radarllm, refused},
    fake_board::{Behaviour, FakeBoard},
    live_outside::{Program, get, get_all, wait_for},
    made, make_uart,
};

/// A board at a height of 1.8 m that sends ten frames a second.
const CFG: &str = "sensorStop\nflushCfg\nchannelCfg 15 7 0\nadcCfg 2 1\n\
    profileCfg 0 60.25 350 6 58 0 0 60 1 224 4500 0 0 30\nchirpCfg 0 0 0 0 0 0 0 1\n\
    chirpCfg 1 1 0 0 0 0 0 4\nchirpCfg 2 2 0 0 0 0 0 2\nframeCfg 0 2 16 0 100 1 0\nsensorPosition 1.8 0 0\nsensorStart\n";
const N_COMMANDS: usize = 11;

/// Points of somebody who walks to and fro, 1.7 m high, 2.5 m away: packet n.
fn somebody(n: u32) -> Vec<(u32, Vec<u8>)> {
    let x_m = 0.5 * (n as f32 / 10.0).sin();
    let points = (0..12u8).flat_map(|i| [x_m, 2.5, 0.15 * f32::from(i) - 1.75, 0.5]);
    let quality = [200u8, 0, 50, 0].repeat(12);
    vec![
        (1, make_uart::floats(&points.collect::<Vec<f32>>())),
        (7, quality),
    ]
}

fn board(answer: fn(&str, usize) -> String) -> FakeBoard {
    FakeBoard::new(Behaviour {
        answer,
        n_packets: 2_000,
        content: somebody,
        pause: Duration::from_millis(50),
        ..Behaviour::default()
    })
}

fn live(args: &[&str]) -> Program {
    let mut command = Command::new(env!("CARGO_BIN_EXE_radarllm"));
    command.args(["live", "--http", "127.0.0.1:0"]).args(args);
    Program::start(command.env_remove("STATE_DIRECTORY"), true).unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn a_line_that_the_board_refuses_ends_live_with_its_number_and_words() {
    let folder = tempfile::tempdir().unwrap();
    let cfg = folder.path().join("wall.cfg");
    fs::write(&cfg, CFG).unwrap();
    let board = board(|command, _| match command {
        "adcCfg 2 1" => "Error: Invalid usage of the CLI command\r\nmmwDemo:/>".into(),
        _ => format!("{command}\r\nDone\n\rmmwDemo:/>"),
    });
    let (data, cli) = (text(&board.data), text(&board.cli));
    let error = refused(&[
        "live",
        data,
        "--cli-port",
        cli,
        "--radar",
        text(&cfg),
        "--no-http",
    ]);
    let expected =
        "line 4 of the chirp file, `adcCfg 2 1`: Error: Invalid usage of the CLI command";
    assert!(error.contains(expected), "{error}");
}

/// Unplugged and plugged in again: whoever listens knows that nothing is known, and nobody stays in the room.
#[test]
fn an_unplugged_board_makes_presence_unavailable_until_it_is_back() {
    let folder = tempfile::tempdir().unwrap();
    let (data, cli) = (folder.path().join("data"), folder.path().join("cli"));
    let cfg = folder.path().join("wall.cfg");
    fs::write(&cfg, CFG).unwrap();
    let done: fn(&str, usize) -> String = |command, _| format!("{command}\r\nDone\n\rmmwDemo:/>");
    let broker = Broker::start();
    let first = board(done);
    first.plug_into(folder.path());
    let url = format!("mqtt://{}", broker.address);
    let live = live(&[
        text(&data),
        "--cli-port",
        text(&cli),
        "--radar",
        text(&cfg),
        "--name",
        "lounge",
        "--mqtt",
        &url,
    ]);
    let hears = |what: &str, source: &str, occupancy: &str| {
        broker.wait(what, |state| {
            let last = |topic: &str| state.retained.get(topic).cloned().unwrap_or_default();
            let is_so = last("radarllm/lounge/source/availability") == source
                && last("radarllm/lounge/state").contains(occupancy);
            is_so.then_some(())
        });
    };
    hears("somebody is there", "online", "\"occupancy\":\"ON\"");
    assert!(get_all(&live, "/healthz").starts_with("HTTP/1.1 200"));
    assert_eq!(first.commands().len(), N_COMMANDS);

    // The names disappear first, because the system gives the numbers of its pseudo-terminals to other tests.
    for port in [&data, &cli] {
        fs::remove_file(port).unwrap();
    }
    drop(first);
    hears("nothing is known", "offline", "\"occupancy\":\"OFF\"");
    wait_for("a problem on /healthz", || {
        let answer = get_all(&live, "/healthz");
        let is_reported = answer.starts_with("HTTP/1.1 503") && answer.contains("no frame arrived");
        is_reported.then_some(())
    });
    let state: Value = serde_json::from_str(&get(&live, "/api/state")).unwrap();
    assert_eq!(state["health"]["source"], "lost", "{state}");
    assert_eq!(state["presence"]["state"], "absent", "{state}");

    // The first time, it refuses a line; this is counted, and tried again.
    let second = board(|command, n| match (command, n) {
        ("flushCfg", 0) => "Error -1\r\nmmwDemo:/>".into(),
        _ => format!("{command}\r\nDone\n\rmmwDemo:/>"),
    });
    second.plug_into(folder.path());
    hears("somebody is there again", "online", "\"occupancy\":\"ON\"");
    let commands = second.commands();
    assert_eq!(commands.len(), 2 + N_COMMANDS, "{commands:?}");
    assert!(get_all(&live, "/healthz").starts_with("HTTP/1.1 200"));
    let metrics = get(&live, "/metrics");
    for expected in [
        "radarllm_reconnects_total 1\n",
        "radarllm_refused_lines_total 1\n",
    ] {
        assert!(metrics.contains(expected), "{expected}: {metrics}");
    }
    // Unplugged while it is not silent: the end comes in time.
    drop(second);
    let stopped = Instant::now();
    live.signal(libc::SIGTERM);
    broker.wait("offline", |state| {
        let availability = state.retained.get("radarllm/lounge/availability");
        availability.filter(|text| *text == "offline").map(drop)
    });
    assert!(stopped.elapsed() < Duration::from_secs(5));
}

/// Packets of another sender than the card are counted where users look, and a small buffer is told with its cure.
#[test]
fn foreign_datagrams_are_counted_and_a_small_buffer_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let radar = radarllm_base::RadarConfig {
        name: "small".into(),
        n_samples: 32,
        n_loops: 8,
        slope_hz_per_s: 15e12,
        sample_rate_hz: 1.1e6,
        ..radarllm_base::RadarConfig::awr1843boost()
    };
    let file = folder.path().join("small.toml");
    fs::write(&file, radar_to_toml(&radar).unwrap()).unwrap();
    let shape = CubeShape::of(&radar);
    let words = (0..8).flat_map(|i| {
        let cube = made::echo(shape, 12.0, 20.0, i);
        made::words(&cube, made::two(made::I_FIRST))
    });
    let packets = made::datagrams(&made::bytes(&words.collect::<Vec<i16>>()), 1456);
    let port = {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.local_addr().unwrap().port()
    };
    let input = format!("udp:127.0.0.1:{port}");
    let live = live(&[
        &input,
        "--radar",
        text(&file),
        "--iq",
        "i-first",
        "--lanes",
        "2",
    ]);
    // The page answers when the socket is open.
    get(&live, "/healthz");
    for (sender, n) in [("127.0.0.1", 4), ("127.0.0.2", 5), ("127.0.0.1", 4)] {
        let socket = UdpSocket::bind((sender, 0)).unwrap();
        for packet in &packets[..n] {
            socket.send_to(packet, ("127.0.0.1", port)).unwrap();
        }
    }
    wait_for("foreign datagrams", || {
        let metrics = get(&live, "/metrics");
        metrics
            .contains("radarllm_foreign_datagrams_total 5\n")
            .then_some(())
    });
    let largest = fs::read_to_string("/proc/sys/net/core/rmem_max").unwrap();
    // Linux grants twice what is asked for.
    if largest.trim().parse::<u64>().unwrap() < (4 << 20) {
        let is_reported = |line: &String| line.contains("sysctl -w net.core.rmem_max=8388608");
        assert!(live.lines().iter().any(is_reported), "{:?}", live.lines());
    }
}

#[test]
fn a_damaged_database_is_set_aside_and_this_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let database = folder.path().join("live.db");
    fs::write(
        &database,
        [b"SQLite format 3\0".as_slice(), &[0xA5; 9_000]].concat(),
    )
    .unwrap();
    let input = "builtin:squat?repetitions=6";
    let output = radarllm(&[
        "live",
        input,
        "--speed",
        "max",
        "--no-http",
        "--db",
        text(&database),
    ]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{stderr}");
    assert!(
        stderr.contains("warning: the database was damaged"),
        "{stderr}"
    );
    let names = fs::read_dir(folder.path()).unwrap();
    let names: Vec<String> = names
        .map(|file| file.unwrap().file_name().into_string().unwrap())
        .collect();
    let aside = |name: &&String| name.starts_with("live.db.damaged-");
    assert_eq!(names.iter().filter(aside).count(), 1, "{names:?}");
    let answer = json(&[
        "ask",
        "how often did she squat?",
        "--db",
        text(&database),
        "--json",
    ]);
    assert!(answer["count"].as_u64().unwrap() > 0, "{answer}");
}

/// A stream in which somebody does several things.
fn recording(path: &Path) -> Clip {
    let request = "builtin:walk+then+squat+then+wave?squat.repetitions=3&wave.side=left";
    let output = radarllm(&["simulate", request, "--seed", "6", "--out", text(path)]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{stderr}");
    let recording = radarllm::open(path).points().unwrap();
    recording.clip
}

/// Messages of a replay: those of the type `activity` without what depends on the time of day, and those of the type `now`.
fn replayed(path: &Path, speed: &str) -> (Vec<String>, Vec<Value>) {
    let output = radarllm(&["live", text(path), "--speed", speed, "--no-http", "--json"]);
    assert!(output.status.success(), "{output:?}");
    let (mut rows, mut now) = (Vec::new(), Vec::new());
    for line in String::from_utf8(output.stdout).unwrap().lines() {
        let message: Value = serde_json::from_str(line).unwrap();
        match message["type"].as_str() {
            Some("activity") => {
                let time = |key: &str| message[key].as_i64().unwrap();
                let length_ms = time("end_ms") - time("start_ms");
                let rest = [
                    "person",
                    "action",
                    "caption",
                    "confidence",
                    "windows",
                    "points",
                    "place_m",
                ];
                let rest: Vec<String> = rest.iter().map(|key| message[key].to_string()).collect();
                rows.push(format!("{length_ms} {}", rest.join(" ")));
            }
            Some("now") => now.push(message),
            _ => {}
        }
    }
    (rows, now)
}

/// As fast as possible and as fast as it was recorded; each sentence is that of `describe` on the window's points.
#[test]
fn a_replay_says_what_describe_says_of_each_window_at_any_speed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stream.parquet");
    let clip = recording(&path);
    let (rows, now) = replayed(&path, "max");
    let began = Instant::now();
    let (rows_in_time, now_in_time) = replayed(&path, "1");
    assert!(began.elapsed().as_secs_f64() > clip.duration_s() - 1.0);
    assert!(rows.len() >= 3, "{rows:?}");
    assert_eq!(rows, rows_in_time);
    let reported = |now: &[Value]| -> Vec<String> {
        let keys = ["t_s", "person", "caption", "label", "confidence", "reason"];
        let text = |m: &Value| keys.map(|key| m[key].to_string()).join(" ");
        now.iter().map(text).collect()
    };
    assert_eq!(reported(&now), reported(&now_in_time));

    let window = folder.path().join("window.parquet");
    let (mut n_compared, mut captions) = (0, Vec::new());
    for message in &now {
        let (Some(caption), Some(end_s)) = (message["caption"].as_str(), message["t_s"].as_f64())
        else {
            continue;
        };
        let start_s = end_s - message["window_s"].as_f64().unwrap();
        let is_inside = |t_s: f64| (start_s - 1e-3..=end_s + 1e-3).contains(&t_s);
        let frames = clip.frames.iter().filter(|f| is_inside(f.time_s));
        let cut = Clip {
            frames: frames.cloned().collect(),
            ..clip.clone()
        };
        radarllm_dataset::write_clip(&window, &cut, radarllm_dataset::Overwrite::Replace).unwrap();
        let described = json_lines(&["describe", text(&window), "--json"]);
        let described = &described[0];
        assert_eq!(described["caption"], caption, "{start_s} s to {end_s} s");
        let difference =
            described["confidence"].as_f64().unwrap() - message["confidence"].as_f64().unwrap();
        assert!(difference.abs() < 1e-3, "{difference}");
        n_compared += 1;
        captions.push(caption.to_string());
    }
    captions.dedup();
    assert!(n_compared >= 5 && captions.len() >= 2, "{captions:?}");
}
