//! `eval-recordings`: roles, strict counts and the log of evaluations on judged recordings.

use std::{fmt::Write, fs, path::Path};

use radarllm_dataset::{ClipRecord, Columns, Dataset, Split, read_points};

use crate::command::{json, radarllm, refused};

const CONFIG: &str = r#"
radar_height_m = 1.0
[roles]
tuning = ["walk/tune_*"]
[[activity]]
name = "walk"
actions = ["walk"]
"#;

/// Points of a simulated walk as a CSV recording: what was recorded by a radar is not known to be simulated.
fn recording(folder: &Path, path: &str) {
    recording_of("builtin:walk?direction=backward", folder, path);
}

fn recording_of(motion: &str, folder: &Path, path: &str) {
    let points = folder.join("points.parquet");
    if !points.exists() {
        let out = radarllm(&["simulate", motion, "--out", points.to_str().unwrap()]);
        assert!(out.status.success());
    }
    let mut csv = String::from("frame,x,y,z,velocity,intensity\n");
    for frame in read_points(&points).unwrap().frames {
        for p in frame.points {
            let (v, i) = (p.velocity_mps, p.intensity_db);
            writeln!(csv, "{},{},{},{},{v},{i}", frame.frame, p.x_m, p.y_m, p.z_m).unwrap();
        }
    }
    let path = folder.join("recordings").join(path);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, csv).unwrap();
}

#[test]
fn roles_separate_recordings_and_looks_at_judged_ones_are_logged() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    recording(folder, "walk/tune_1.csv");
    recording(folder, "walk/other_1.csv");
    recording(folder, "walk/other_2.csv");
    recording(folder, "bow/none.csv");
    let (config, looks) = (folder.join("config.toml"), folder.join("looks.csv"));
    fs::write(&config, CONFIG).unwrap();
    let recordings = folder.join("recordings");
    let mut args = vec!["eval-recordings", config.to_str().unwrap(), "--recordings"];
    args.extend([
        recordings.to_str().unwrap(),
        "--frame-rate",
        "10",
        "--looks",
        looks.to_str().unwrap(),
        "--json",
    ]);

    let report = json(&args);
    assert_eq!(
        (&report["role"], &report["recordings"]),
        (&"tuning".into(), &1.into())
    );
    let row = &report["rows"][0];
    assert_eq!(
        (&row["right"], &row["stated"]),
        (&true.into(), &"walk".into()),
        "{row}"
    );
    // Whether stated or withheld, the sentence of the model is judged.
    let segment = &row["segments"][0];
    let sentence = [&segment["guess"], &segment["caption"]];
    let sentence = sentence.iter().find_map(|text| text.as_str()).unwrap();
    assert_eq!(radarllm::inference::actions(sentence), ["walk"]);
    assert_eq!(segment["right"], true);
    assert!(!looks.exists(), "tuning is not logged");

    // Judged recordings need a reason, and leave a line each time.
    args.extend(["--role", "judged"]);
    assert!(refused(&args).contains("--purpose"));
    args.extend(["--purpose", "test, \"quoted\""]);
    for lines in [2, 3] {
        assert_eq!(json(&args)["recordings"], 2);
        let log = fs::read_to_string(&looks).unwrap();
        assert_eq!(log.lines().count(), lines);
        let last = log.lines().last().unwrap();
        assert!(
            last.contains(",2,2,0,") && last.ends_with(",\"test, \"\"quoted\"\"\""),
            "{last}"
        );
    }
}

#[test]
fn configurations_that_cannot_be_evaluated_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("config.toml");
    let refuse = |text: &str| {
        fs::write(&config, text).unwrap();
        let folder = dir.path().to_str().unwrap();
        refused(&[
            "eval-recordings",
            config.to_str().unwrap(),
            "--recordings",
            folder,
        ])
    };
    let error = refuse(&CONFIG.replace("[\"walk\"]", "[\"wlak\"]"));
    assert!(error.contains("no action `wlak`"), "{error}");
    let error = refuse(&CONFIG.replace("tuning =", "tunning ="));
    assert!(error.contains("tunning"), "{error}");
    let error = refuse(CONFIG);
    assert!(
        error.contains("no recordings of an activity with the role `tuning`"),
        "{error}"
    );
}

#[test]
fn recordings_for_tuning_become_a_data_set() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    let squats = "builtin:squat?repetitions=4";
    recording_of(squats, folder, "squat/tune_1.csv");
    recording_of(squats, folder, "squat/other_1.csv");
    let text = CONFIG.replace("walk", "squat");
    let config = folder.join("config.toml");
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let (recordings, labelled, own) = (path("recordings"), path("labelled"), path("own"));
    let args = |out: &str, more: &[&str]| -> Vec<String> {
        let first = ["dataset", "recordings", config.to_str().unwrap()];
        let rest = [
            "--recordings",
            &recordings,
            "--frame-rate",
            "10",
            "--out",
            out,
        ];
        let all = first.iter().chain(&rest).chain(more);
        all.map(ToString::to_string).collect()
    };
    let refuse = |out: &str, more: &[&str]| {
        let args = args(out, more);
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        refused(&args)
    };
    let build = |out: &str, more: &[&str]| {
        let args = args(out, &[more, &["--json"]].concat());
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        json(&args)
    };

    fs::write(&config, &text).unwrap();
    let error = refuse(&labelled, &[]);
    assert!(error.contains("activity `squat`: no `says`"), "{error}");
    assert!(refuse(&own, &["--by-model", "--min-confidence", "1.5"]).contains("--min-confidence"));
    assert!(refuse(&own, &["--min-confidence", "0.5"]).contains("--by-model"));
    assert!(!Path::new(&labelled).exists() && !Path::new(&own).exists());

    fs::write(&config, format!("{text}says = \"a person squats\"\n")).unwrap();
    let report = build(&labelled, &[]);
    assert_eq!(report["recordings"], 1, "judged recordings are not read");
    let data = Dataset::open(labelled.as_ref()).unwrap();
    let clips: Vec<ClipRecord> = Split::ALL
        .iter()
        .flat_map(|split| data.iter_split(*split, Columns::All))
        .map(Result::unwrap)
        .collect();
    assert_eq!(report["clips"], clips.len());
    assert!(!clips.is_empty());
    for clip in &clips {
        assert_eq!(
            (clip.group.as_str(), clip.action.as_str()),
            ("squat/tune_1.csv", "squat")
        );
        assert_eq!(
            (&clip.source[..], &clip.captions),
            ("recordings", &vec!["a person squats".into()])
        );
    }
    // Another content needs --force, the same one is kept.
    assert_eq!(build(&labelled, &[]), report);
    let by_model = ["--by-model", "--min-confidence", "0"];
    assert!(refuse(&labelled, &by_model).contains("--force"));

    let report = build(&own, &by_model);
    let sentences = report["sentences"].as_str().unwrap();
    assert!(sentences.contains("may be wrong"), "{sentences}");
    assert!(report["clips"].as_u64().unwrap() > 0);
}
