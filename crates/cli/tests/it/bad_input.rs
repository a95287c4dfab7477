//! Hostile and broken files: a clear error with the file's name, exit code 1, nothing half-written.

use std::{fs, path::Path};

use crate::command::{json, radarllm, refused};

const TINY_BVH: &str = "HIERARCHY\nROOT Hips\n{\n  OFFSET 0 0 0\n  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n  JOINT Spine\n  {\n    OFFSET 0 20 0\n    CHANNELS 3 Zrotation Xrotation Yrotation\n    End Site\n    {\n      OFFSET 0 40 0\n    }\n  }\n}\nMOTION\nFrames: 2\nFrame Time: 0.0333\n";

/// npy header that claims `shape` of f32 and carries only a few bytes.
fn lying_npy(shape: &str) -> Vec<u8> {
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}");
    while (header.len() + 11) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend([0_u8; 16]);
    bytes
}

fn no_leftovers(folder: &Path, inputs: usize) {
    let names: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    assert_eq!(
        names.len(),
        inputs,
        "only the inputs may lie here: {names:?}"
    );
}

/// A limit of the size of files ends writing as a full disk does.
#[cfg(target_os = "linux")]
#[test]
fn samples_that_cannot_be_written_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("raw.npy");
    // Without the trap, the limit ends the process.
    let script = "trap '' XFSZ; ulimit -f 8; exec \"$0\" \"$@\"";
    let output = std::process::Command::new("sh")
        .args(["-c", script, env!("CARGO_BIN_EXE_radarllm")])
        .args(["simulate", "builtin:walk", "--radar", "iwrl6432"])
        .args(["--emit", "adc", "--out"])
        .arg(&out)
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    let expected = format!("{}: File too large", out.display());
    assert!(stderr.contains(&expected), "{stderr}");
    no_leftovers(folder.path(), 0);
}

#[test]
fn broken_motions_are_refused_by_name() {
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("empty.bvh", Vec::new()),
        ("truncated.bvh", TINY_BVH.as_bytes()[..120].to_vec()),
        (
            "nan.bvh",
            format!("{TINY_BVH}nan 0 0 0 0 0 0 0 0\n0 0 0 0 0 0 0 0 0\n").into_bytes(),
        ),
        (
            "short.bvh",
            format!("{TINY_BVH}0 90 0 0 0 0 0 0 0\n").into_bytes(),
        ),
        (
            "huge.bvh",
            TINY_BVH
                .replace("Frames: 2", "Frames: 99999999999999")
                .into_bytes(),
        ),
        ("latin1.bvh", vec![0xff, 0xfe, 0x00, 0x81, 0x48]),
        (
            "deep.bvh",
            "ROOT a\n{\nOFFSET 0 0 0\nCHANNELS 0\n"
                .repeat(100_000)
                .into_bytes(),
        ),
        ("garbage.npz", b"PK\x03\x04 this is not a zip".to_vec()),
        ("lying.npy", lying_npy("(1000000000000, 22, 3)")),
        ("overflow.npy", lying_npy("(18446744073709551615, 22, 3)")),
        ("wrong_shape.npy", lying_npy("(4,)")),
        (
            "pickle.npy",
            lying_npy("(1,)")
                .iter()
                .map(|b| if *b == b'f' { b'O' } else { *b })
                .collect(),
        ),
        ("unknown.xyz", b"hello".to_vec()),
    ];
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in &cases {
        fs::write(folder.path().join(name), bytes).unwrap();
    }
    for (name, _) in &cases {
        let path = folder.path().join(name);
        let path = path.to_str().unwrap();
        for args in [
            vec!["motion", "info", path, "--json"],
            vec!["simulate", path, "--out", &format!("{path}.parquet")],
        ] {
            let stderr = refused(&args);
            assert!(stderr.contains(name), "the error names the file: {stderr}");
        }
    }
    no_leftovers(folder.path(), cases.len());
}

#[test]
fn broken_points_models_and_configurations_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    fs::write(path("points.parquet"), b"PAR1 nothing PAR1").unwrap();
    fs::write(path("data.toml"), "seeed = 1").unwrap();
    fs::write(path("latin1.toml"), [0xff, 0xfe]).unwrap();
    fs::write(path("radar.toml"), "name = \"x\"\nstart_hz = -1").unwrap();
    fs::write(path("radar.cfg"), "profileCfg 0 77").unwrap();
    fs::create_dir(path("model")).unwrap();
    fs::write(path("model/config.json"), b"{").unwrap();

    assert!(refused(&["describe", &path("points.parquet")]).contains("points.parquet"));
    assert!(refused(&["describe", &path("absent.parquet")]).contains("absent.parquet"));
    assert!(
        refused(&[
            "dataset",
            "build",
            &path("data.toml"),
            "--out",
            &path("out")
        ])
        .contains("seeed")
    );
    refused(&[
        "dataset",
        "build",
        &path("latin1.toml"),
        "--out",
        &path("out"),
    ]);
    refused(&["dataset", "info", &path("absent")]);
    refused(&["radar", "show", &path("radar.toml")]);
    refused(&["radar", "show", &path("radar.cfg")]);
    refused(&["radar", "show", "no-such-radar"]);
    refused(&["describe", "builtin:walk", "--model", &path("model")]);
    refused(&["describe", "builtin:moonwalk"]);
    refused(&["describe", "builtin:walk?speed=nan"]);
    refused(&["describe", "builtin:walk?sped=1"]);
    refused(&["simulate", "builtin:walk"]);
    no_leftovers(folder.path(), 6);
}

#[test]
fn points_and_samples_are_written_under_their_own_extension_only() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    for (emit, name, extension) in [
        ("points", "walk.npz", ".parquet"),
        ("points", "walk", ".parquet"),
        ("adc", "walk.parquet", ".npy"),
    ] {
        let motion = "builtin:clap?duration_s=1";
        let stderr = refused(&["simulate", motion, "--emit", emit, "--out", &path(name)]);
        assert!(
            stderr.contains(name) && stderr.contains(extension),
            "{stderr}"
        );
    }
    no_leftovers(folder.path(), 0);
}

#[test]
fn nothing_is_overwritten_without_force() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("kept.parquet");
    fs::write(&path, b"precious").unwrap();
    let stderr = refused(&[
        "simulate",
        "builtin:clap?duration_s=1",
        "--out",
        path.to_str().unwrap(),
    ]);
    assert!(stderr.contains("--force"), "{stderr}");
    assert_eq!(fs::read(&path).unwrap(), b"precious");
}

#[test]
fn scenes_that_cannot_be_are_refused_with_file_and_place() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    fs::write(path("nan.obj"), "v 0 0 0\nv 0 0 nan\nv 1 0 0\nf 1 2 3\n").unwrap();
    fs::write(path("index.obj"), "v 0 0 0\nv 0 0 1\n\nf 1 2 3\n").unwrap();
    fs::write(path("huge.obj"), "v 0 0 0\nf 1 1 18446744073709551615\n").unwrap();
    fs::write(path("empty.obj"), "# nothing\n").unwrap();
    // A scan in millimetres.
    fs::write(path("mm.obj"), "v 0 0 0\nv 0 0 1700\nv 300 0 0\nf 1 2 3\n").unwrap();
    let mesh =
        |file: &str| format!("kind = \"mesh\"\nposition_m = [0.0, 3.0, 0.0]\nfile = \"{file}\"");
    let cases = [
        (mesh("nan.obj"), "nan.obj: line 2"),
        (mesh("index.obj"), "index.obj: line 4"),
        (mesh("huge.obj"), "huge.obj: line 2"),
        (mesh("empty.obj"), "empty.obj: no face"),
        (mesh("mm.obj"), "mm.obj: line 2"),
        (mesh("absent.obj"), "absent.obj"),
        (mesh("."), "directory"),
        // Inside the antenna.
        (
            "kind = \"sphere\"\nposition_m = [0.0, 0.1, 0.0]\nradius_m = 0.09".into(),
            "less than 0.05 m",
        ),
        (
            "kind = \"point\"\nposition_m = [0.0, 0.01, 0.0]\nrcs_m2 = 1.0".into(),
            "less than 0.05 m",
        ),
        (
            "kind = \"point\"\nposition_m = [0.0, 3.0, 0.0]\nrcs_m2 = -1.0".into(),
            "rcs_m2",
        ),
        (
            "kind = \"point\"\nposition_m = [0.0, nan, 0.0]\nrcs_m2 = 1.0".into(),
            "position_m",
        ),
        (
            "kind = \"point\"\nposition_m = [0.0, 3.0, 0.0]\nvelocity_mps = [1e9, 0.0, 0.0]\nrcs_m2 = 1.0"
                .into(),
            "velocity_mps",
        ),
        (
            "kind = \"sphere\"\nposition_m = [0.0, 3.0, 0.0]\nradius_m = nan".into(),
            "radius_m",
        ),
        (
            "kind = \"sphere\"\nposition_m = [0.0, 3.0, 0.0]\nradiusm = 1.0".into(),
            "line 6",
        ),
    ];
    for (target, word) in &cases {
        fs::write(
            path("scene.toml"),
            format!("duration_s = 0.1\nmax_bounces = 1\n[[target]]\n{target}\n"),
        )
        .unwrap();
        for (emit, out) in [("points", "out.parquet"), ("adc", "out.npy")] {
            let stderr = refused(&[
                "simulate",
                &path("scene.toml"),
                "--emit",
                emit,
                "--out",
                &path(out),
            ]);
            assert!(
                stderr.contains("scene.toml") && stderr.contains(word),
                "{target}: {stderr}"
            );
        }
    }
    for (text, word) in [
        ("duration_s = 0.1\nmax_bounces = 9\n", "max_bounces"),
        ("duration_s = 1e9\n", "duration_s"),
    ] {
        fs::write(path("scene.toml"), text).unwrap();
        let stderr = refused(&[
            "simulate",
            &path("scene.toml"),
            "--out",
            &path("out.parquet"),
        ]);
        assert!(
            stderr.contains("scene.toml") && stderr.contains(word),
            "{stderr}"
        );
    }
    // Five meshes and the scene.
    no_leftovers(folder.path(), 6);
}

#[test]
fn radars_that_cannot_be_are_refused_and_odd_ones_are_said_to_be() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    fs::write(path("scene.toml"), "duration_s = 0.1\n").unwrap();
    for (fields, word) in [
        ("tx = []", "tx"),
        ("adc_start_s = 20e-6", "ADC window"),
        ("n_samples = 0", "n_samples"),
        ("n_loops = 99999999", "n_loops"),
        ("frame_period_s = 0.001", "frame_period_s"),
        ("start_hz = nan", "start_hz"),
    ] {
        fs::write(
            path("radar.toml"),
            format!("base = \"awr1843boost\"\n{fields}\n"),
        )
        .unwrap();
        let stderr = refused(&[
            "simulate",
            &path("scene.toml"),
            "--radar",
            &path("radar.toml"),
            "--out",
            &path("out.parquet"),
        ]);
        assert!(stderr.contains(word), "{fields}: {stderr}");
        let lint = format!("`radarllm radar lint {}`", path("radar.toml"));
        assert!(stderr.contains(&lint), "{stderr}");
    }
    // A ramp beyond the part's band, and people faster than the ambiguity: simulated, and said.
    for (fields, word) in [
        ("start_hz = 78e9", "outside 76 to 81 GHz"),
        ("idle_s = 60e-6", "fold to the other sign"),
    ] {
        fs::write(
            path("radar.toml"),
            format!("base = \"awr1843boost\"\n{fields}\n"),
        )
        .unwrap();
        let done = radarllm(&[
            "simulate",
            &path("scene.toml"),
            "--radar",
            &path("radar.toml"),
            "--out",
            &path("out.parquet"),
            "--force",
        ]);
        let stderr = String::from_utf8_lossy(&done.stderr);
        assert!(
            done.status.success() && stderr.contains(word),
            "{fields}: {stderr}"
        );
    }
}

/// Behind the radar, at its side, faster than the ambiguity, grazing, without area: frames without NaN.
#[test]
fn odd_targets_make_frames_without_nan() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    // A sliver, a triangle without area, a doubled one, an edge of three facets.
    fs::write(
        path("odd.obj"),
        "v 0 0 0\nv 0.1 0 0\nv 0 0 0.1\nv 0 -0.1 0.05\nv 0.05 0 1e-9\n\
         f 1 2 3\nf 1 2 3\nf 1 1 2\nf 1 2 5\nf 1 2 4\nf 2 1 4\n",
    )
    .unwrap();
    let target = |kind: &str, place: &str, velocity: &str| {
        format!("[[target]]\n{kind}\nposition_m = {place}\nvelocity_mps = {velocity}\n")
    };
    let point = "kind = \"point\"\nrcs_m2 = 1.0";
    let plate = "kind = \"plate\"\nsize_m = [0.4, 0.4]\nnormal = [1.0, 0.0, 0.0]";
    let text = [
        "duration_s = 0.2\n".to_string(),
        target(point, "[0.0, -2.0, 0.0]", "[0.0, 1.0, 0.0]"),
        target(point, "[2.0, 0.0, 0.0]", "[1.0, 0.0, 0.0]"),
        target(point, "[0.0, 4.0, 0.0]", "[0.0, 30.0, 0.0]"),
        target(point, "[0.0, 900.0, 0.0]", "[0.0, -4.0, 0.0]"),
        target(plate, "[0.0, 2.0, 0.0]", "[0.0, 1.0, 0.0]"),
        target(plate, "[0.3, 0.0, 0.0]", "[0.0, 0.0, 1.0]"),
        target(
            "kind = \"mesh\"\nfile = \"odd.obj\"",
            "[0.0, 2.5, 0.0]",
            "[0.0, 1.0, 0.0]",
        ),
    ]
    .concat();
    fs::write(path("scene.toml"), text).unwrap();
    let run = |emit: &str, out: &str| {
        let done = radarllm(&[
            "simulate",
            &path("scene.toml"),
            "--emit",
            emit,
            "--out",
            &path(out),
        ]);
        let stderr = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(done.status.success(), "{stderr}");
    };
    run("points", "points.parquet");
    run("adc", "raw.npy");
    let points = radarllm_dataset::read_points(&folder.path().join("points.parquet")).unwrap();
    for p in points.frames.iter().flat_map(|f| &f.points) {
        let values = [
            p.x_m,
            p.y_m,
            p.z_m,
            p.range_m,
            p.velocity_mps,
            p.intensity_db,
        ];
        assert!(values.iter().all(|v| v.is_finite()), "{p:?}");
        // v_max = 4.386 m/s: faster ones are folded.
        assert!(p.velocity_mps.abs() < 4.4, "{p:?}");
    }
    let bytes = fs::read(path("raw.npy")).unwrap();
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    assert!(
        bytes[start..]
            .chunks_exact(4)
            .all(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]).is_finite())
    );
}

/// The hint of an unknown key refers to `motion list`.
#[test]
fn motion_list_has_all_keys_that_a_motion_accepts() {
    let stderr = refused(&["motion", "info", "builtin:walk?sped=1"]);
    assert!(stderr.contains("`radarllm motion list`"), "{stderr}");
    let (_, keys) = stderr.split_once("it has: ").unwrap();
    let keys: Vec<&str> = keys.lines().next().unwrap().split(", ").collect();
    assert!(keys.contains(&"speed") && keys.contains(&"height_m"));
    let rows = json(&["motion", "list", "--json"]);
    let rows = rows.as_array().unwrap();
    let walk = rows.iter().find(|row| row["name"] == "walk").unwrap();
    let listed: Vec<&String> = walk["keys"].as_object().unwrap().keys().collect();
    assert_eq!(listed, keys);
    let text = String::from_utf8(radarllm(&["motion", "list"]).stdout).unwrap();
    for key in keys {
        let has_line = |line: &str| line.starts_with(&format!("    {key} "));
        assert!(text.lines().any(has_line), "{key} in {text}");
    }
}
