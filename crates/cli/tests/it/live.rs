//! `live` and `ask`.

use std::{
    io::{BufRead, BufReader},
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use serde_json::Value;

use crate::command::{json, radarllm, refused};

/// Messages of a replay as fast as possible.
fn replay(input: &str, more: &[&str]) -> Vec<Value> {
    let args = [
        "live",
        input,
        "--speed",
        "max",
        "--http",
        "127.0.0.1:0",
        "--json",
    ];
    let out = radarllm(&[&args, more].concat());
    let stderr = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{stderr}");
    assert!(stderr.contains("http://127.0.0.1:"), "{stderr}");
    let lines = String::from_utf8(out.stdout).unwrap();
    lines
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

fn of_type<'a>(messages: &'a [Value], kind: &str) -> Vec<&'a Value> {
    messages.iter().filter(|m| m["type"] == kind).collect()
}

#[test]
fn a_recording_is_told_while_it_runs_and_remembered() {
    let dir = tempfile::tempdir().unwrap();
    let database = dir.path().join("live.db");
    let database = database.to_str().unwrap();
    let input = "builtin:squat?repetitions=6";
    let messages = replay(input, &["--db", database]);
    assert!(of_type(&messages, "frame").is_empty());
    let now = of_type(&messages, "now");
    let squats = |m: &&Value| {
        let caption = m["caption"].as_str().unwrap_or_default();
        caption.contains("squat") && m["synthetic"] == true
    };
    assert!(now.iter().any(squats), "{now:?}");
    let rows = of_type(&messages, "activity");
    assert!(rows.iter().any(|row| row["action"] == "squat"), "{rows:?}");
    // With --quiet nothing is printed that others could keep.
    let quiet = ["live", input, "--speed", "max", "--no-http", "--quiet"];
    let quiet = radarllm(&quiet);
    assert!(
        quiet.status.success() && quiet.stdout.is_empty(),
        "{quiet:?}"
    );
    let again = replay(input, &[]);
    let captions = |messages: &[Value]| -> Vec<String> {
        let now = of_type(messages, "now");
        now.iter().map(|m| m["caption"].to_string()).collect()
    };
    assert_eq!(captions(&messages), captions(&again));
    let answer = json(&[
        "ask",
        "how often did she squat today?",
        "--db",
        database,
        "--json",
    ]);
    assert_eq!(
        answer["answer"].as_str().unwrap().find("Someone squatted"),
        Some(0)
    );
}

#[test]
fn secrets_that_every_user_may_read_are_warned_of() {
    use std::os::unix::fs::PermissionsExt;

    let dir = tempfile::tempdir().unwrap();
    let secret = dir.path().join("secret");
    std::fs::write(&secret, "0123456789abcdef").unwrap();
    for (mode, warned) in [(0o600, false), (0o640, false), (0o644, true)] {
        std::fs::set_permissions(&secret, std::fs::Permissions::from_mode(mode)).unwrap();
        let ran = radarllm(&[
            "live",
            "builtin:squat",
            "--speed",
            "max",
            "--quiet",
            "--http",
            "127.0.0.1:0",
            "--token-file",
            secret.to_str().unwrap(),
        ]);
        assert!(ran.status.success(), "{ran:?}");
        let printed = String::from_utf8(ran.stderr).unwrap();
        let warning = format!("may read the secret (mode {mode:04o})");
        assert_eq!(printed.contains(&warning), warned, "{mode:o}: {printed}");
    }
}

#[test]
fn what_cannot_run_is_refused() {
    let live = |more: &[&str]| refused(&[&["live", "sim:"], more].concat());
    assert!(live(&["--http", "0.0.0.0:0"]).contains("token"));
    assert!(live(&["--name", "Living room"]).contains("a to z"));
    let broker = live(&["--http", "127.0.0.1:0", "--mqtt", "mqtt://127.0.0.1:1"]);
    assert!(broker.contains("--mqtt-simulated"), "{broker}");
    // What would be ignored.
    for option in [
        &["--speed", "10"][..],
        &["--loop"],
        &["--start", "2026-11-20T08:00:00Z"],
        &["--cli-port", "/dev/ttyUSB0"],
        &["--dca", "192.168.33.180"],
        &["--no-http", "--token-file", "token"],
        // And what is out of range.
        &["--window", "20"],
        &["--stride", "0"],
        &["--learn-empty", "400"],
        &["--occupancy-on=-1"],
        &["--fall-dwell", "0"],
        &["--fall-height", "2"],
    ] {
        let name = option[option.len().saturating_sub(2)];
        let name = name.split('=').next().unwrap();
        let refusal = live(option);
        assert!(refusal.contains(name), "{option:?}: {refusal}");
    }
    let input = "builtin:squat?repetitions=6";
    for option in [["--sim-seed", "2"], ["--sim-fall-every", "60"]] {
        assert!(refused(&["live", input, option[0], option[1]]).contains(option[0]));
    }
    assert!(refused(&["live", input, "--speed", "fast"]).contains("--speed"));
    assert!(refused(&["live", "no-such-recording.dat"]).contains("no-such-recording.dat"));
    let asked = refused(&["ask", "when did she last get up?", "--db", "no-such.db"]);
    assert!(asked.contains("no-such.db"), "{asked}");
}

#[test]
fn a_signal_ends_it_within_five_seconds_with_everything_written() {
    let dir = tempfile::tempdir().unwrap();
    for signal in [libc::SIGTERM, libc::SIGINT] {
        let database = dir.path().join(format!("{signal}.db"));
        let database = database.to_str().unwrap();
        let input = "builtin:squat?repetitions=6";
        let mut live = Command::new(env!("CARGO_BIN_EXE_radarllm"))
            .args(["live", input, "--speed", "5", "--loop", "--json"])
            .args(["--http", "127.0.0.1:0", "--db", database])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(live.stdout.take().unwrap()).lines();
        let is_row = |line: &str| line.contains("\"type\":\"activity\"");
        assert!(lines.any(|line| is_row(&line.unwrap())));
        let began = Instant::now();
        // SAFETY: the process was started above and is not waited for before.
        assert_eq!(unsafe { libc::kill(live.id() as libc::pid_t, signal) }, 0);
        // What is printed until the end makes room for the messages.
        assert!(lines.all(|line| line.is_ok()));
        let status = live.wait().unwrap();
        assert_eq!(status.code(), Some(0), "signal {signal}");
        assert!(
            began.elapsed() < Duration::from_secs(5),
            "{:?}",
            began.elapsed()
        );
        let answer = json(&[
            "ask",
            "how often did she squat?",
            "--db",
            database,
            "--json",
        ]);
        assert!(answer["count"].as_u64().unwrap() > 0, "{answer}");
    }
}
