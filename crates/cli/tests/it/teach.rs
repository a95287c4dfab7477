//! `teach`, `forget` and what `describe` makes of them.

use std::{fs, path::Path};

use crate::command::{json, json_lines, radarllm, refused};

/// A CSV recording of 12 s: points whose height goes up and down at a rate, in Hz.
fn recording(folder: &Path, name: &str, rate_hz: f64) -> String {
    let mut csv = String::from("frame,x,y,z,velocity,intensity\n");
    for frame in 0..120 {
        let phase = std::f64::consts::TAU * rate_hz * f64::from(frame) / 10.0;
        for k in 0..12 {
            let z_m = 0.3 * phase.sin() + 0.02 * f64::from(k);
            csv += &format!(
                "{frame},{},2.0,{z_m},{:.3},20\n",
                0.05 * f64::from(k),
                0.3 * phase.cos() + 0.1
            );
        }
    }
    let path = folder.join(name);
    fs::write(&path, csv).unwrap();
    path.to_str().unwrap().into()
}

#[test]
fn what_is_taught_is_recognised_listed_and_forgotten() {
    let dir = tempfile::tempdir().unwrap();
    let memory = dir.path().join("memory.json");
    let memory = memory.to_str().unwrap();
    let run = |args: &[&str]| {
        let out = radarllm(&[args, &["--memory", memory]].concat());
        assert!(
            out.status.success(),
            "{}",
            String::from_utf8_lossy(&out.stderr)
        );
        String::from_utf8_lossy(&out.stdout).into_owned()
    };
    for (name, says, rates) in [
        ("rocking", "a person rocks in the chair", [0.48, 0.5, 0.52]),
        ("shaking", "a person shakes the head", [1.9, 2.0, 2.1]),
    ] {
        let files = rates.map(|rate| recording(dir.path(), &format!("{name}_{rate}.csv"), rate));
        let recognised = run(&[
            "teach",
            name,
            "--says",
            says,
            &files[0],
            &files[1],
            &files[2],
            "--frame-rate",
            "10",
        ]);
        assert!(
            recognised.contains(&format!("{name}: 3 examples")),
            "{recognised}"
        );
    }
    let listed = run(&["teach", "--list"]);
    assert!(
        listed.contains("shaking: \"a person shakes the head\""),
        "{listed}"
    );

    let new = recording(dir.path(), "new.csv", 0.51);
    let describe = |input: &str| {
        json_lines(&[
            "describe",
            input,
            "--frame-rate",
            "10",
            "--memory",
            memory,
            "--json",
        ])[0]
            .clone()
    };
    let row = describe(&new);
    assert_eq!(row["caption"], "a person rocks in the chair");
    assert_eq!(row["segments"][0]["taught"], "rocking");
    // What fits neither keeps the model's own sentence.
    let other = recording(dir.path(), "other.csv", 1.1);
    let row = describe(&other);
    assert!(row["segments"][0]["taught"].is_null(), "{row}");

    assert!(run(&["forget", "rocking"]).contains("3 examples forgotten"));
    let row = describe(&new);
    assert!(
        row["segments"]
            .as_array()
            .unwrap()
            .iter()
            .all(|s| s["taught"].is_null()),
        "{row}"
    );
}

#[test]
fn what_cannot_be_taught_leaves_the_file_as_it_was() {
    let dir = tempfile::tempdir().unwrap();
    let memory = dir.path().join("memory.json");
    let path = memory.to_str().unwrap();
    let good = recording(dir.path(), "good.csv", 0.5);
    let empty = dir.path().join("empty.csv");
    fs::write(
        &empty,
        "frame,x,y,z,velocity,intensity\n0,0,2,0,0.5,20\n99,0,2,0,0.5,20\n",
    )
    .unwrap();
    fn teach<'a>(path: &'a str, args: &[&'a str]) -> Vec<&'a str> {
        let command = ["teach", "rocking", "--memory", path, "--frame-rate", "10"];
        [&command, args].concat()
    }
    let out = radarllm(&teach(path, &["--says", "a person rocks", &good]));
    assert!(out.status.success());
    let before = fs::read(&memory).unwrap();
    for (args, expected) in [
        (vec![empty.to_str().unwrap()], "too few"),
        (vec![good.as_str()], "already"),
        (vec!["nothing.csv"], "nothing.csv"),
        (vec![], "no recordings"),
    ] {
        let error = refused(&teach(path, &args));
        assert!(error.contains(expected), "{error}");
        assert_eq!(fs::read(&memory).unwrap(), before);
    }
    let error = refused(&[
        "teach",
        "new",
        "--memory",
        path,
        &good,
        "--frame-rate",
        "10",
    ]);
    assert!(error.contains("--says"), "{error}");
    let error = refused(&["forget", "walking", "--memory", path]);
    assert!(
        error.contains("`walking`") && error.contains("rocking"),
        "{error}"
    );
    fs::write(&memory, "{").unwrap();
    let error = refused(&["describe", &good, "--frame-rate", "10", "--memory", path]);
    assert!(error.contains("memory.json"), "{error}");
}

/// Each run reads the memory, adds its activity and writes it; none of them loses what another one added.
#[test]
fn six_who_teach_at_once_lose_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let memory = dir.path().join("memory.json");
    let memory = memory.to_str().unwrap();
    let names = ["one", "two", "three", "four", "five", "six"];
    let files: Vec<String> = (1..=6)
        .map(|n| recording(dir.path(), &format!("{n}.csv"), 0.4 * f64::from(n)))
        .collect();
    std::thread::scope(|scope| {
        for (name, file) in names.iter().zip(&files) {
            scope.spawn(move || {
                let out = radarllm(&[
                    "teach",
                    name,
                    "--says",
                    "a person does something",
                    file,
                    "--frame-rate",
                    "10",
                    "--memory",
                    memory,
                ]);
                assert!(out.status.success());
            });
        }
    });
    let listed = json(&["teach", "--list", "--memory", memory, "--json"]).to_string();
    for name in names {
        assert!(
            listed.contains(&format!("\"{name}\"")),
            "{name} in {listed}"
        );
    }
    let forget = |name: &str| {
        assert!(
            radarllm(&["forget", name, "--memory", memory])
                .status
                .success()
        )
    };
    std::thread::scope(|scope| {
        for name in &names[..5] {
            scope.spawn(move || forget(name));
        }
    });
    let listed = json(&["teach", "--list", "--memory", memory, "--json"]).to_string();
    assert!(
        listed.contains("\"six\"") && !listed.contains("\"five\""),
        "{listed}"
    );
}
