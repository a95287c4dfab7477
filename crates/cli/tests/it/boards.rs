//! `eval boards`, `site` and `describe` on tracks of a board, in tables that these tests make.

use std::{fmt::Write, fs, path::Path};

use crate::command::{json, json_lines, radarllm, refused};

/// A table at 10 frames/s: distance, height above the radar and upward speed of the track at each second.
fn table(path: &Path, seconds: u32, at: impl Fn(f64) -> Option<[f64; 3]>) {
    let mut text = String::from("Frame_count,tid,posy,posz,vely,velz,pointy0,pointz0,snr0\n");
    for i in 0..seconds * 10 {
        match at(f64::from(i) / 10.0) {
            Some([y, z, up]) => writeln!(text, "{i},0,{y},{z},0,{up},{y},{z},12").unwrap(),
            None => writeln!(text, "{i},,,,,,,,").unwrap(),
        }
    }
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, text).unwrap();
}

/// Walks to and fro between 1 and 4 m; the radar looks 10 degrees farther down than stated.
fn walks(t: f64) -> Option<[f64; 3]> {
    let phase = (0.8 * t).rem_euclid(6.0);
    let y = if phase < 3.0 {
        1.0 + phase
    } else {
        7.0 - phase
    };
    Some(tilted([y, 0.2]))
}

fn tilted([y, z]: [f64; 2]) -> [f64; 3] {
    let (sin, cos) = 10.0_f64.to_radians().sin_cos();
    [y * cos + z * sin, z * cos - y * sin, 0.0]
}

const CONFIG: &str = r#"
[[board]]
name = "a board"
site = "board/walking"
[[board.activities]]
config = "activities.toml"
recordings = "board"
reading = { frame_rate_hz = 10.0 }
[[board.presence]]
name = "night"
recording = "night.csv"
truth = "nobody"
reading = { frame_rate_hz = 10.0 }
"#;

const ACTIVITIES: &str = r#"
radar_height_m = 1.0
[roles]
tuning = ["*"]
[[activity]]
name = "sitting"
actions = ["sit_still"]
[[activity]]
name = "standing"
actions = ["stand_still"]
[[activity]]
name = "falling"
actions = ["fall"]
judged = "event"
[[activity]]
name = "walking"
actions = ["walk", "pace"]
"#;

#[test]
fn a_board_that_tracks_is_described_by_what_is_measured() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path();
    table(&data.join("board/walking/a.csv"), 60, walks);
    table(&data.join("board/standing/a.csv"), 20, |_| {
        Some(tilted([3.5, 0.2]))
    });
    table(&data.join("board/sitting/a.csv"), 20, |_| {
        Some(tilted([3.5, -0.3]))
    });
    table(&data.join("board/sitting/near.csv"), 20, |_| {
        Some(tilted([1.2, -0.3]))
    });
    table(&data.join("board/falling/a.csv"), 20, |t| {
        let down = ((t - 8.0) / 0.8).clamp(0.0, 1.0);
        let [y, z, _] = tilted([2.5, 0.2 - 1.4 * down]);
        let up = if down > 0.0 && down < 1.0 { -1.7 } else { 0.0 };
        Some([y, z, up])
    });
    // Leakage alone: a point before the radar in some frames, and no track.
    let mut night = String::from("Frame_count,tid,posy,posz,pointy0,pointz0,snr0\n");
    for i in 0..600 {
        match i % 7 {
            0 => writeln!(night, "{i},,,,0.1,0,5").unwrap(),
            _ => writeln!(night, "{i},,,,,,").unwrap(),
        }
    }
    fs::write(data.join("night.csv"), night).unwrap();
    let (config, activities) = (data.join("boards.toml"), data.join("activities.toml"));
    fs::write(&config, CONFIG).unwrap();
    fs::write(&activities, ACTIVITIES).unwrap();
    let [config, data] = [&config, data].map(|p| p.to_str().unwrap());
    let report = json(&["eval", "boards", config, "--data", data, "--json"]);
    let board = &report["boards"][0];
    for row in board["rows"].as_array().unwrap() {
        assert_eq!(row["right"], true, "{row}");
    }
    assert_eq!(board["rows"].as_array().unwrap().len(), 5);
    assert_eq!(board["presence"][0]["stated_s"], 0.0);
    let page = radarllm(&["eval", "boards", config, "--data", data]);
    let page = String::from_utf8(page.stdout).unwrap();
    assert!(page.contains("nothing was learned from: 100.0 %"), "{page}");
    let error = refused(&["eval", "boards", config, "--data", data, "--board", "none"]);
    assert!(
        error.contains("no board whose name contains `none`"),
        "{error}"
    );
}

#[test]
fn a_site_is_learned_once_and_belongs_to_its_radar() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_string();
    let (walk, sit, site) = (path("walk.csv"), path("sit.csv"), path("site.toml"));
    table(Path::new(&walk), 60, walks);
    table(Path::new(&sit), 20, |_| Some(tilted([3.5, -0.3])));
    let learned = json(&[
        "site",
        &walk,
        "--frame-rate",
        "10",
        "--out",
        &site,
        "--json",
    ]);
    let value = |key: &str| learned[key].as_f64().unwrap();
    assert!((value("tilt_deg") - 10.0).abs() < 1.0, "{learned}");
    assert!((value("standing_m") - 0.2).abs() < 0.05, "{learned}");
    let said = json_lines(&[
        "describe",
        &sit,
        "--frame-rate",
        "10",
        "--site",
        &site,
        "--json",
    ]);
    assert_eq!(said[0]["segments"][0]["actions"][0], "sit_still", "{said}");
    let people = json_lines(&[
        "describe",
        &sit,
        "--frame-rate",
        "10",
        "--people",
        "auto",
        "--json",
    ]);
    assert_eq!(people[0]["person"]["id"], 1, "{people}");
    assert!(
        people[0]["caption"].as_str().unwrap().contains(" m away"),
        "{people}"
    );
    let alone = radarllm(&["describe", &sit, "--frame-rate", "10"]);
    let warning = String::from_utf8(alone.stderr).unwrap();
    assert!(
        warning.contains("walked for 0 s; 10 s are needed to learn the site"),
        "{warning}"
    );
    let error = refused(&["site", &sit, "--frame-rate", "10"]);
    assert!(
        error.contains("cannot be learned: somebody walked for 0 s; 10 s are needed"),
        "{error}"
    );
    let text = fs::read_to_string(&site).unwrap();
    // Learned of a radar that hung higher.
    fs::write(&site, format!("{text}stated_height_m = 2.0\n")).unwrap();
    let describe = ["describe", &sit, "--frame-rate", "10", "--site", &site];
    let error = refused(&[&describe[..], &["--radar-height-m", "1.5"]].concat());
    assert!(
        error.contains("a radar 2 m above the floor, and this is a recording of one at 1.5 m"),
        "{error}"
    );
    fs::write(&site, text.replace("unknown", "another board")).unwrap();
    let error = refused(&["describe", &sit, "--frame-rate", "10", "--site", &site]);
    assert!(
        error
            .contains("learned of the radar `another board`, and this is a recording of `unknown`"),
        "{error}"
    );
}
