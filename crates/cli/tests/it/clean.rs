//! Recordings cleaned, calibrated and divided among people, through the command line.

use std::{fs, path::Path};

use radarllm_base::{RadarConfig, RadarPoint};
use radarllm_dataset::read_points;
use radarllm_formats::radar_to_toml;

use crate::command::{json, json_lines, radarllm, refused};

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A folder with a small radar in it: 32 loops, 128 samples, 8.6 cm a bin.
struct Room {
    folder: tempfile::TempDir,
}

impl Room {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let radar = RadarConfig {
            name: "small".into(),
            n_samples: 128,
            n_loops: 32,
            slope_hz_per_s: 30e12,
            sample_rate_hz: 2.2e6,
            ..RadarConfig::awr1843boost()
        };
        fs::write(
            folder.path().join("small.toml"),
            radar_to_toml(&radar).unwrap(),
        )
        .unwrap();
        Self { folder }
    }

    fn at(&self, name: &str) -> String {
        text(&self.folder.path().join(name)).to_owned()
    }

    /// Raw samples of a scene.
    fn record(&self, name: &str, scene: &str) -> String {
        let (toml, npy) = (self.at("scene.toml"), self.at(name));
        fs::write(&toml, scene).unwrap();
        let radar = self.at("small.toml");
        json(&[
            "simulate", &toml, "--radar", &radar, "--emit", "adc", "--out", &npy, "--force",
            "--json",
        ]);
        npy
    }

    fn process(
        &self,
        capture: &str,
        options: &[&str],
    ) -> (serde_json::Value, Vec<Vec<RadarPoint>>) {
        let (radar, out) = (self.at("small.toml"), self.at("out.parquet"));
        let args = [
            "process", capture, "--radar", &radar, "--out", &out, "--force", "--json",
        ];
        let report = json(&[&args, options].concat());
        let frames = read_points(Path::new(&out)).unwrap().frames;
        (report, frames.into_iter().map(|f| f.points).collect())
    }
}

fn point(place_m: [f64; 3], speed_mps: f64, rcs_m2: f64) -> String {
    format!(
        "[[target]]\nkind = \"point\"\nposition_m = {place_m:?}\nvelocity_mps = [0.0, {speed_mps:?}, 0.0]\nrcs_m2 = \
         {rcs_m2:?}\n"
    )
}

#[test]
fn the_empty_room_is_taken_off_raw_samples_and_everything_can_be_looked_at() {
    let room = Room::new();
    let lamp = point([0.5, 2.5, 0.0], 0.0, 10.0);
    let walker = point([-0.4, 3.6, 0.0], 1.0, 1.0);
    let empty = room.record("empty.npy", &format!("duration_s = 0.4\n{lamp}"));
    let taken = room.record("taken.npy", &format!("duration_s = 0.3\n{lamp}{walker}"));
    let (_, moving) = room.process(&taken, &[]);
    let pictures = room.at("pictures");
    let (report, cleaned) = room.process(
        &taken,
        &["--background", &empty, "--all-pictures", &pictures],
    );
    let notes = report["notes"].to_string();
    assert!(notes.contains("background: mean of 4 frames"), "{notes}");
    for (cleaned, moving) in cleaned.iter().zip(&moving) {
        let is_lamp = |p: &&RadarPoint| (p.range_m - 2.55).abs() < 0.25 && p.velocity_mps == 0.0;
        assert_eq!(cleaned.iter().filter(is_lamp).count(), 0, "{cleaned:?}");
        let (a, b) = (cleaned[0], moving[0]);
        assert_eq!((a.range_m, a.velocity_mps), (b.range_m, b.velocity_mps));
        assert!((a.x_m - b.x_m).abs() < 0.02 && (a.range_m - 3.62).abs() < 0.25);
    }
    // Against itself nothing is left but noise: the room is empty.
    let (_, none) = room.process(&empty, &["--background", &empty]);
    assert!(none.iter().all(|points| points.len() < 5), "{none:?}");
    let mut names: Vec<String> = fs::read_dir(&pictures)
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(
        names,
        [
            // Not adc-statistics.svg: simulated samples are square-root watts, no counts.
            "channel-profiles.svg",
            "micro-doppler.svg",
            "point-cloud.svg",
            "points-over-time.svg",
            "range-azimuth.svg",
            "range-doppler.svg",
            "range-profile.svg",
        ]
    );
    for name in names {
        let svg = fs::read_to_string(Path::new(&pictures).join(name)).unwrap();
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"));
    }
    // Offset and leakage are options of the same samples.
    let (_, all_off) = room.process(
        &taken,
        &[
            "--background",
            &empty,
            "--remove-offset",
            "--remove-leakage",
            "0.3",
        ],
    );
    assert_eq!(all_off[0][0].range_m, cleaned[0][0].range_m);
}

#[test]
fn a_corner_reflector_calibrates_mismatched_channels() {
    let room = Room::new();
    let faults = "[impairments]\nchannel_phase_deg = 20.0\nchannel_gain_db = 1.0\n";
    let (sin, cos) = 10_f64.to_radians().sin_cos();
    let corner = point([3.0 * sin, 3.0 * cos, 0.0], 0.0, 30.0);
    let walker = point([-0.9, 2.4, 0.2], 1.0, 1.0);
    let reflector = room.record("corner.npy", &format!("duration_s = 0.3\n{faults}{corner}"));
    let taken = room.record("taken.npy", &format!("duration_s = 0.1\n{faults}{walker}"));
    let ideal = room.record("ideal.npy", &format!("duration_s = 0.1\n{walker}"));
    let (radar, out) = (room.at("small.toml"), room.at("cal.toml"));
    let args = [
        "radar",
        "calibrate",
        &reflector,
        "--radar",
        &radar,
        "--range-m",
        "2.9",
        "--azimuth-deg",
        "10",
        "--out",
        &out,
        "--json",
    ];
    let report = json(&args);
    assert!(
        (report["range_m"].as_f64().unwrap() - 3.0).abs() < 0.01,
        "{report}"
    );
    assert!(report["snr_db"].as_f64().unwrap() > 40.0, "{report}");
    assert!(refused(&args).contains("exists already"));
    let (_, truth) = room.process(&ideal, &[]);
    let (_, plain) = room.process(&taken, &[]);
    let (_, corrected) = room.process(&taken, &["--calibration", &out]);
    let apart = |points: &[Vec<RadarPoint>]| {
        let (p, t) = (points[0][0], truth[0][0]);
        assert_eq!((p.range_m, p.velocity_mps), (t.range_m, t.velocity_mps));
        (
            ((p.x_m - t.x_m).powi(2) + (p.z_m - t.z_m).powi(2)).sqrt() / t.range_m,
            p,
        )
    };
    // Over 40 dB of signal over noise are 0.007 rad a channel, 0.003 of z/R; twice that for both frames' noise.
    assert!(apart(&corrected).0 < 0.007, "{:?}", apart(&corrected));
    // 20 degrees a channel are 0.35 rad / 2 between the rows: 0.05 of z/R.
    assert!(apart(&plain).0 > 0.02, "{:?}", apart(&plain));

    let never = room.at("never.toml");
    let far = [
        "radar",
        "calibrate",
        &reflector,
        "--radar",
        &radar,
        "--range-m",
        "5",
        "--out",
        &never,
    ];
    // Sidelobes of the reflector two metres away.
    let error = refused(&far);
    assert!(
        error.contains("no peak") || error.contains("stands alone"),
        "{error}"
    );
    let moving = [
        "radar",
        "calibrate",
        &taken,
        "--radar",
        &radar,
        "--range-m",
        "2.6",
        "--out",
        &never,
    ];
    assert!(
        refused(&moving).contains("moves at"),
        "{}",
        refused(&moving)
    );
    // Two frames of 32 loops, 3 slots, 4 receivers and 128 samples at the end of the scale.
    let clipped = room.at("clipped.bin");
    let word = i16::MAX.to_le_bytes();
    fs::write(&clipped, word.repeat(2 * 32 * 3 * 4 * 128 * 2)).unwrap();
    let saturated = [
        "radar",
        "calibrate",
        &clipped,
        "--radar",
        &radar,
        "--iq",
        "i-first",
        "--lanes",
        "2",
        "--range-m",
        "2.6",
        "--out",
        &never,
    ];
    let error = refused(&saturated);
    assert!(error.contains("ADC saturated in 100.0 %"), "{error}");
    assert!(!Path::new(&never).exists());
    // A calibration of another radar, and of this one with a line lost.
    let file = fs::read_to_string(&out).unwrap();
    for (from, to, expected) in [
        (
            "radar = \"small\"",
            "radar = \"large\"",
            "made with radar `large`",
        ),
        ("slot = 2", "slot = 1", "expected slot 2"),
        ("snr_db", "snr", "unknown field"),
    ] {
        fs::write(&never, file.replacen(from, to, 1)).unwrap();
        let p = room.at("p.parquet");
        let error = refused(&[
            "process",
            &taken,
            "--radar",
            &radar,
            "--calibration",
            &never,
            "--out",
            &p,
        ]);
        assert!(error.contains(expected), "{error}");
    }
}

/// x, y and radial velocity of somebody over time.
type Walk = fn(f64) -> (f64, f64, f64);

/// A table of points: a lamp that some firmware reports, and people as sheets of five points that walk.
fn table(n_frames: usize, people: &[Walk]) -> String {
    let mut csv = String::from("frame,t_s,x,y,z,velocity,intensity\n");
    for frame in 0..n_frames {
        let t = 0.1 * frame as f64;
        csv += &format!("{frame},{t},1.6,4.1,0.0,0.0,30\n{frame},{t},1.65,4.1,0.1,0.0,28\n");
        for person in people {
            let (x, y, v) = person(t);
            for i in 0..5 {
                let (z, v) = (0.2 * f64::from(i) - 0.4, v + 0.1 * f64::from(i % 2));
                csv += &format!("{frame},{t},{x},{y},{z},{v},{}\n", 20 - i);
            }
        }
    }
    csv
}

#[test]
fn people_get_points_and_sentences_of_their_own() {
    let room = Room::new();
    let (empty, taken) = (room.at("empty.csv"), room.at("taken.csv"));
    fs::write(&empty, table(20, &[])).unwrap();
    fs::write(
        &taken,
        table(
            50,
            &[
                |t| (-1.0, 2.0 + 0.5 * t, 0.45),
                |t| (1.0, 4.0 - 0.4 * t, -0.4),
            ],
        ),
    )
    .unwrap();
    let out = room.at("p.parquet");
    let args = [
        "process",
        &taken,
        "--out",
        &out,
        "--background",
        &empty,
        "--people",
        "auto",
        "--drop-ghosts",
        "--all-pictures",
        &room.at("pictures"),
        "--json",
    ];
    let report = json(&args);
    let people = report["people"].as_array().unwrap();
    assert_eq!(people.len(), 2, "{report}");
    assert!(
        report["notes"]
            .to_string()
            .contains("100 of 600 points removed"),
        "{report}"
    );
    assert!(Path::new(&room.at("pictures/tracks.svg")).is_file());
    let all = read_points(Path::new(&out)).unwrap();
    assert!(all.frames.iter().all(|f| f.points.len() == 10));
    for person in people {
        let file = read_points(Path::new(person["out"].as_str().unwrap())).unwrap();
        assert_eq!(file.frames.len(), 50);
        let side = file.frames[0].points[0].x_m;
        let own = |f: &radarllm_base::PointFrame| {
            f.points.len() == 5 && f.points.iter().all(|p| p.x_m == side)
        };
        assert!(file.frames.iter().all(own));
        assert!(
            file.meta.source.starts_with("recorded:csv:") && file.meta.source.contains("(person ")
        );
    }
    assert!(refused(&args).contains("exists already"));

    let rows = json_lines(&["describe", &taken, "--people", "auto", "--json"]);
    let rows = rows.as_array().unwrap();
    assert_eq!(rows.len(), 2, "{rows:?}");
    for (i, row) in rows.iter().enumerate() {
        assert_eq!(row["person"]["id"], i + 1);
        assert_eq!(row["person"]["start_s"], 0.0);
        assert!((row["person"]["end_s"].as_f64().unwrap() - 4.9).abs() < 1e-6);
    }
    let one = json_lines(&["describe", &taken, "--people", "1", "--json"]);
    assert_eq!(one.as_array().unwrap().len(), 1);
    // A lamp is nobody.
    let nobody = json_lines(&["describe", &empty, "--people", "auto", "--json"]);
    assert_eq!(nobody[0]["caption"], "no person seen", "{nobody}");
    assert!(nobody[0].get("person").is_none());
    assert!(refused(&["describe", &empty, "--people", "0"]).contains("1 to 100, or auto"));
}

#[test]
fn what_stands_still_is_nobody_where_it_is_most_of_a_recording() {
    let room = Room::new();
    let taken = room.at("taken.csv");
    // Somebody who passes a shelf that firmware reports with velocity zero.
    let mut csv = String::from("frame,t_s,x,y,z,velocity,intensity\n");
    for frame in 0..50 {
        let t = 0.1 * f64::from(frame);
        for i in 0..15 {
            let (x, y, v) = match i {
                0..5 => (0.0, 2.0 + 0.4 * t, 0.4),
                _ => (0.05 * f64::from(i), 3.0, 0.0),
            };
            csv += &format!("{frame},{t},{x},{y},0.0,{v},25\n");
        }
    }
    fs::write(&taken, csv).unwrap();
    let out = room.at("p.parquet");
    // People, most points of the first in a frame, and whether it is said.
    let found = |options: &[&str]| {
        let args = [
            "process", &taken, "--out", &out, "--people", "auto", "--force", "--json",
        ];
        let report = json(&[&args[..], options].concat());
        let people = report["people"].as_array().unwrap();
        let file = read_points(Path::new(people[0]["out"].as_str().unwrap())).unwrap();
        let max = file.frames.iter().map(|f| f.points.len()).max().unwrap();
        let is_said = report["notes"]
            .to_string()
            .contains("excluded from tracking");
        (people.len(), max, is_said)
    };
    assert_eq!(found(&[]), (1, 5, true));
    // Kept, the shelf is a part of whoever passes.
    let (_, max, is_said) = found(&["--min-speed", "0"]);
    assert!(max == 15 && !is_said, "{max}");
    // A page says what `describe` says.
    let row = &json_lines(&["describe", &taken, "--json"])[0];
    let page = room.at("page.html");
    let viewed = radarllm(&["view", &taken, "--out", &page]);
    let noted = String::from_utf8_lossy(&viewed.stderr);
    assert!(noted.contains("500 of 750 points are static"), "{noted}");
    let said = String::from_utf8_lossy(&viewed.stdout);
    assert_eq!(
        said.trim_end(),
        format!("{page}: {}", row["caption"].as_str().unwrap())
    );
    // So does a figure; other extensions are refused before anything is computed.
    let figure = room.at("figure.SVG");
    assert!(
        radarllm(&["view", &taken, "--out", &figure])
            .status
            .success()
    );
    let svg = fs::read_to_string(&figure).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains(row["caption"].as_str().unwrap()));
    let reported = refused(&["view", &taken, "--out", &room.at("figure.png")]);
    assert!(reported.contains("figure.png: unknown file type") && reported.contains(".svg"));
}

#[test]
fn options_of_the_other_kind_are_refused() {
    let room = Room::new();
    let csv = room.at("taken.csv");
    fs::write(&csv, table(5, &[])).unwrap();
    let raw = room.record(
        "raw.npy",
        &format!("duration_s = 0.1\n{}", point([0.0, 2.0, 0.0], 1.0, 1.0)),
    );
    let (radar, out) = (room.at("small.toml"), room.at("p.parquet"));
    for (options, expected) in [
        (
            &["--calibration", "c.toml"][..],
            "--calibration needs raw samples",
        ),
        (&["--remove-offset"], "--remove-offset needs raw samples"),
        (
            &["--remove-leakage", "0.1"],
            "--remove-leakage needs raw samples",
        ),
        (
            &["--processing", "p.toml"],
            "--processing needs raw samples",
        ),
        (&["--frames", "3"], "--frames needs raw samples"),
        (
            &["--background", &raw],
            "raw samples, but the capture holds points",
        ),
        (&["--background", &csv, "--background-share", "2"], "share"),
        (&["--background-share", "0.5"], "--background"),
        (&["--channel-profiles", "c.svg"], "made from raw samples"),
        (&["--adc-statistics", "c.svg"], "made from raw samples"),
        (&["--tracks", "c.svg"], "nobody was tracked"),
        (&["--tracks", "c.png"], "end the name in .svg"),
        (
            &["--point-cloud", "c.pdf"],
            "end the name in .svg, or in .png",
        ),
    ] {
        let error = refused(&[&["process", &csv, "--out", &out], options].concat());
        assert!(error.contains(expected), "{options:?}: {error}");
    }
    for (options, expected) in [
        (&["--background", &csv][..], "taken.csv"),
        (
            &["--background", &raw, "--background-cell", "0.5"],
            "has no meaning for raw samples",
        ),
        (&["--background", "absent.npy"], "absent.npy"),
        (&["--adc-statistics", "a.svg"], "below one count"),
        (&["--remove-leakage=-1"], "leakage_m"),
        (&["--remove-leakage", "100"], "leakage_m"),
    ] {
        let args = ["process", &raw, "--radar", &radar, "--out", &out];
        let error = refused(&[&args, options].concat());
        assert!(error.contains(expected), "{options:?}: {error}");
    }
    assert!(!Path::new(&out).exists());
}
