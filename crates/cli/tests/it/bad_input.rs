//! Hostile and broken files: a clear error with the file's name, exit code 1, nothing half-written.

use std::{fs, path::Path};

use crate::command::refused;

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
