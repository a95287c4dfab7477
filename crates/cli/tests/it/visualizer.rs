//! Folders and files of TI's visualizers, and chirp files beside recordings.

use std::{
    fs,
    path::{Path, PathBuf},
};

use radarllm_dataset::read_points;

use crate::{
    command::{json, json_lines, refused},
    recordings::packet,
};

/// Chirp file of a wall-mounted people counter, shortened: 55 ms a frame, 2 m high, tilted by 15 degrees.
const WALL_CFG: &str = "sensorStop\nflushCfg\ndfeDataOutputMode 1\nchannelCfg 15 7 0\nadcCfg 2 1\n\
    adcbufCfg -1 0 1 1 1\nprofileCfg 0 60.75 30.00 25.00 59.10 657930 0 54.71 1 96 2950.00 2 1 36\n\
    chirpCfg 0 0 0 0 0 0 0 1\nchirpCfg 1 1 0 0 0 0 0 2\nchirpCfg 2 2 0 0 0 0 0 4\nframeCfg 0 2 96 0 55.00 1 0\n\
    sensorPosition 2 0 15\nsensorStart\n";

/// A file of `n` frames of people tracking: twelve points of somebody who walks away, 1 m above the floor.
fn replay(first: u32, n: u32, cfg: &str) -> String {
    let lines: Vec<String> = cfg.lines().map(|l| format!("\"{l}\\n\"")).collect();
    let frames: Vec<String> = (first..first + n)
        .map(|i| {
            let y_m = 2.0 + 0.055 * f64::from(i);
            let row = |k: u32| {
                let x_m = 0.05 * f64::from(k);
                format!("[{x_m}, {y_m}, {}, 1.0, 100.0, 2.0, 255.0]", 0.5 + 0.1 * f64::from(k))
            };
            let rows: Vec<String> = (0..12).map(row).collect();
            format!(
                "{{\"frameData\": {{\"error\": 0, \"frameNum\": {i}, \"pointCloud\": [{}]}}, \"timestamp\": {}}}",
                rows.join(", "),
                1_700_000_000_000.5 + 55.0 * f64::from(i)
            )
        })
        .collect();
    format!(
        "{{\"cfg\": [{}], \"demo\": \"3D People Tracking\", \"device\": \"xWR6843\", \"data\": [{}]}}",
        lines.join(", "),
        frames.join(", ")
    )
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A folder with a recording of 120 frames in two files, the second numbered 10.
fn recorded(folder: &Path) -> PathBuf {
    let inside = folder.join("binData/03_19_2025_16_53_08");
    fs::create_dir_all(&inside).unwrap();
    fs::write(inside.join("replay_9.json"), replay(0, 60, WALL_CFG)).unwrap();
    fs::write(inside.join("replay_10.json"), replay(60, 60, WALL_CFG)).unwrap();
    inside
}

/// Without a track in the whole recording, the demo says that the board tracks people; a room whose points move may have lost
/// its tracks (the test below).
#[test]
fn an_empty_room_before_a_demo_that_tracks_people_is_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let mut empty: serde_json::Value = serde_json::from_str(&replay(0, 60, WALL_CFG)).unwrap();
    for frame in empty["data"].as_array_mut().unwrap() {
        frame["frameData"]["pointCloud"] = serde_json::json!([]);
    }
    fs::write(folder.path().join("replay_1.json"), empty.to_string()).unwrap();
    let described = json_lines(&["describe", text(folder.path()), "--json"]);
    assert_eq!(described[0]["caption"], "no person seen", "{described}");
    assert_eq!(
        described[0]["reason"], "the board tracks nobody",
        "{described}"
    );
}

#[test]
fn a_visualizer_folder_is_one_recording() {
    let folder = tempfile::tempdir().unwrap();
    recorded(folder.path());
    let out = folder.path().join("points.parquet");
    let report = json(&[
        "process",
        text(folder.path()),
        "--out",
        text(&out),
        "--json",
    ]);
    assert_eq!(report["frames"], 120, "{report}");
    let file = read_points(&out).unwrap();
    // By the frame number times the frame period of the chirp file in the recording, not by the PC's time stamps.
    assert!((file.meta.frame_rate_hz - 1.0 / 0.055).abs() < 1e-3);
    assert_eq!(file.meta.radar_height_m, Some(2.0));
    assert!(file.meta.source.starts_with("recorded:visualizer-json:"));
    // The visualizer measured z from the floor; points files measure it from the radar.
    let z: Vec<f32> = file.frames[0].points.iter().map(|p| p.z_m).collect();
    assert!(z.iter().all(|z| (-1.51..-0.39).contains(z)), "{z:?}");
    let described = json_lines(&["describe", text(folder.path()), "--json"]);
    assert_eq!(described[0]["provenance"], "recorded", "{described}");
    assert_ne!(described[0]["caption"], "no person seen", "{described}");
    // The levelled points cannot be turned once more.
    let error = refused(&["describe", text(folder.path()), "--tilt-deg", "15"]);
    assert!(
        error.contains("--tilt-deg") && error.contains("level"),
        "{error}"
    );
}

#[test]
fn files_of_several_recordings_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let inside = recorded(folder.path());
    let other = WALL_CFG.replace("55.00", "50.00");
    fs::write(inside.join("replay_11.json"), replay(120, 5, &other)).unwrap();
    let error = refused(&["describe", text(folder.path())]);
    assert!(
        error.contains("replay_11.json") || error.contains("replay_9.json"),
        "{error}"
    );
    fs::remove_file(inside.join("replay_11.json")).unwrap();
    let second = folder.path().join("binData/03_20_2025_10_00_00");
    fs::create_dir_all(&second).unwrap();
    fs::write(second.join("replay_1.json"), replay(0, 5, WALL_CFG)).unwrap();
    let error = refused(&["describe", text(folder.path())]);
    assert!(
        error.contains("03_19_2025") && error.contains("03_20_2025"),
        "{error}"
    );
    // One of the folders is a recording.
    json_lines(&["describe", text(&inside), "--json"]);
}

/// A later, shorter run overwrote the first piece of an earlier one.
#[test]
fn pieces_of_several_runs_need_a_choice() {
    let folder = tempfile::tempdir().unwrap();
    let later = replay(0, 60, WALL_CFG).replace("\"timestamp\": 17", "\"timestamp\": 18");
    fs::write(folder.path().join("replay_1.json"), later).unwrap();
    fs::write(
        folder.path().join("replay_2.json"),
        replay(60, 80, WALL_CFG),
    )
    .unwrap();
    let error = refused(&["describe", text(folder.path())]);
    for part in ["run 1: replay_2.json", "run 2: replay_1.json", "--run N"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let out = folder.path().join("points.parquet");
    let args = [
        "process",
        text(folder.path()),
        "--out",
        text(&out),
        "--json",
    ];
    let report = json(&[&args[..], &["--run", "1"]].concat());
    assert_eq!(report["frames"], 80, "{report}");
    json_lines(&["describe", text(folder.path()), "--run", "2", "--json"]);
}

#[test]
fn damaged_files_of_a_visualizer_are_named_with_their_place() {
    let folder = tempfile::tempdir().unwrap();
    let inside = recorded(folder.path());
    let path = inside.join("replay_10.json");
    let whole = fs::read_to_string(&path).unwrap();
    for (damaged, word) in [
        (whole[..whole.len() / 2].to_string(), "line"),
        (whole.replacen("\"data\"", "\"dota\"", 1), "data"),
        (
            whole.replacen("\"pointCloud\": [[", "\"pointCloud\": [[\"a\", ", 1),
            "pointCloud",
        ),
        ("[]".to_string(), "object"),
    ] {
        fs::write(&path, &damaged).unwrap();
        let out = folder.path().join("out.parquet");
        let error = refused(&["process", text(folder.path()), "--out", text(&out)]);
        assert!(
            error.contains("replay_10.json") && error.contains(word),
            "{word}: {error}"
        );
        assert!(!out.exists());
    }
}

#[test]
fn a_single_chirp_file_beside_a_recording_is_used_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let uart = folder.path().join("session/uart.dat");
    fs::create_dir_all(uart.parent().unwrap()).unwrap();
    fs::write(&uart, [packet(8), packet(9), packet(11)].concat()).unwrap();
    let out = folder.path().join("out.parquet");
    let process = |more: &[&str]| {
        let args = ["process", text(&uart), "--out", text(&out), "--force"];
        [&args, more].concat().join("\n")
    };
    let run = |more: &[&str]| {
        let args = process(more);
        json(&[&args.split('\n').collect::<Vec<_>>()[..], &["--json"]].concat())
    };
    let refuse = |more: &[&str]| refused(&process(more).split('\n').collect::<Vec<_>>());
    // Nothing gives the frame rate.
    assert!(refuse(&[]).contains("--frame-rate"));
    fs::write(folder.path().join("wall.cfg"), WALL_CFG).unwrap();
    let report = run(&[]);
    let notes = report["notes"].to_string();
    assert!(
        notes.contains("wall.cfg") && notes.contains("tilt 15.0"),
        "{notes}"
    );
    assert!((report["frame_rate_hz"].as_f64().unwrap() - 1.0 / 0.055).abs() < 1e-3);
    // The one named is used instead, and angles that are given win.
    let report = run(&["--radar", "awr1843", "--tilt-deg", "3"]);
    assert!(
        !report["notes"].to_string().contains("wall.cfg"),
        "{report}"
    );
    // Two are not chosen from, a damaged one is named.
    fs::write(folder.path().join("desk.cfg"), WALL_CFG).unwrap();
    let error = refuse(&[]);
    assert!(error.contains("--frame-rate"), "{error}");
    fs::remove_file(folder.path().join("desk.cfg")).unwrap();
    fs::write(folder.path().join("wall.cfg"), "profileCfg nonsense\n").unwrap();
    let error = refuse(&[]);
    assert!(
        error.contains("wall.cfg") && error.contains("--radar"),
        "{error}"
    );
}

#[test]
fn completions_and_the_manual_name_every_verb() {
    let page = crate::command::radarllm(&["man"]);
    assert!(page.status.success());
    let page = String::from_utf8(page.stdout).unwrap();
    let script = crate::command::radarllm(&["completions", "bash"]);
    let script = String::from_utf8(script.stdout).unwrap();
    for verb in [
        "describe",
        "process",
        "simulate",
        "eval interventions",
        "doctor",
    ] {
        let heading = format!("RADARLLM {}", verb.to_uppercase());
        assert!(page.contains(&heading), "{heading}");
        assert!(verb.split(' ').all(|word| script.contains(word)), "{verb}");
    }
}
