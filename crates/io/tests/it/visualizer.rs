//! Folders of TI's visualizers with pieces of several runs.

use std::{fs, path::Path};

use radarllm_io::{CaptureOptions, PointOptions, Recording, Result, open_radar, read_recording};

use crate::make_uart::{one_point, packet};

const CFG: &str = "sensorStop\nchannelCfg 15 7 0\nadcCfg 2 1\nprofileCfg 0 60.75 30 25 59.1 0 0 54.71 1 96 2950 2 1 36\n\
    chirpCfg 0 0 0 0 0 0 0 1\nchirpCfg 1 1 0 0 0 0 0 2\nchirpCfg 2 2 0 0 0 0 0 4\nframeCfg 0 2 96 0 100 1 0\n\
    sensorPosition 2 0 15\nsensorStart\n";

/// A file of `n` frames from number `first` on, whose first one was stored `at_ms` after a moment in 2023.
fn replay(first: u32, n: u32, at_ms: u32, demo: &str) -> String {
    let lines: Vec<String> = CFG.lines().map(|l| format!("\"{l}\\n\"")).collect();
    let frames: Vec<String> = (0..n)
        .map(|i| {
            format!(
                "{{\"frameData\": {{\"error\": 0, \"frameNum\": {}, \"pointCloud\": [[0.5, 3, 1.25, 0.5, 100, 0, 255]]}}, \
                 \"timestamp\": {}}}",
                first + i,
                1_700_000_000_000.0 + f64::from(at_ms) + 100.0 * f64::from(i)
            )
        })
        .collect();
    format!(
        "{{\"cfg\": [{}], \"demo\": \"{demo}\", \"device\": \"xWR6843\", \"data\": [{}]}}",
        lines.join(", "),
        frames.join(", ")
    )
}

fn read(path: &Path, run: Option<usize>) -> Result<Recording> {
    let options = CaptureOptions {
        points: PointOptions {
            run,
            ..PointOptions::default()
        },
        ..CaptureOptions::default()
    };
    read_recording(&[path.into()], &options)
}

#[test]
fn runs_of_a_folder_are_named_and_each_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: String| fs::write(folder.path().join(name), text).unwrap();
    // The newer run overwrote the first file of the older one; its frame numbers go on as if it were one recording.
    write(
        "replay_1.json",
        replay(1, 20, 180_000, "3D People Tracking"),
    );
    write("replay_2.json", replay(21, 30, 2_000, "3D People Tracking"));
    let error = read(folder.path(), None).unwrap_err();
    let text = error.to_string();
    for part in [
        "the pieces are of 2 runs",
        "fall back by 179.9 s from replay_1.json to replay_2.json",
        "run 1: replay_2.json, 30 frames numbered 21 to 50, 2023-11-14T22:13:22.000Z to 2023-11-14T22:13:24.900Z",
        "run 2: replay_1.json, 20 frames numbered 1 to 20, 2023-11-14T22:16:20.000Z",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let hint = error
        .hint
        .as_ref()
        .map(ToString::to_string)
        .unwrap_or_default();
    assert!(
        hint.contains("run") && hint.contains("reads one of them"),
        "{hint}"
    );
    for (run, n_frames) in [(1, 30), (2, 20)] {
        let recording = read(folder.path(), Some(run)).unwrap();
        assert_eq!(recording.clip.frames.len(), n_frames);
        // The height of the sensor is subtracted from z.
        assert_eq!(recording.clip.frames[0].points[0].z_m, -0.75);
    }
    let error = read(folder.path(), Some(3)).unwrap_err().to_string();
    assert!(
        error.contains("no run 3: the pieces are of 2 runs"),
        "{error}"
    );
    // A frame rate that is named does not hide the clock.
    let options = CaptureOptions {
        points: PointOptions {
            frame_rate_hz: Some(10.0),
            ..PointOptions::default()
        },
        ..CaptureOptions::default()
    };
    assert!(read_recording(&[folder.path().into()], &options).is_err());
}

#[test]
fn runs_of_binary_pieces_need_a_choice_too() {
    let folder = tempfile::tempdir().unwrap();
    let dialect = radarllm_formats::uart::Dialect::Sdk3;
    let packets = |numbers: std::ops::Range<u32>| -> Vec<u8> {
        let point = one_point(dialect);
        numbers.flat_map(|n| packet(dialect, n, &point)).collect()
    };
    for (piece, numbers) in [(1, 500..520), (2, 21..51)] {
        let name = format!("pHistBytes_{piece}.bin");
        fs::write(folder.path().join(name), packets(numbers)).unwrap();
    }
    fs::write(folder.path().join("board.cfg"), CFG).unwrap();
    let error = read(folder.path(), None).unwrap_err();
    assert!(
        error.to_string().contains("the pieces are of 2 runs"),
        "{error}"
    );
    assert!(error.hint.is_some());
    let recording = read(folder.path(), Some(1)).unwrap();
    assert_eq!(recording.clip.frames.len(), 30);
    // Other formats have no runs.
    let table = folder.path().join("points.csv");
    fs::write(
        &table,
        "frame,t_s,x,y,z,velocity,intensity\n0,0,1,2,0,0,20\n1,0.1,1,2,0,0,20\n",
    )
    .unwrap();
    let error = read(&table, Some(1)).unwrap_err().to_string();
    assert!(error.contains("has no meaning for format csv"), "{error}");
    let cfg = folder.path().join("board.cfg");
    let samples = CaptureOptions {
        radar: Some(open_radar(cfg.to_str().unwrap()).unwrap()),
        format: Some(radarllm_io::CaptureFormat::from_name("adc").unwrap()),
        points: PointOptions {
            run: Some(1),
            ..PointOptions::default()
        },
        ..CaptureOptions::default()
    };
    let adc = folder.path().join("adc_data.bin");
    fs::write(&adc, [0; 64]).unwrap();
    let error = read_recording(&[adc], &samples).unwrap_err().to_string();
    assert!(error.contains("is for recorded points"), "{error}");
}

#[test]
fn what_is_assumed_of_a_demo_is_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("replay_1.json");
    fs::write(&path, replay(1, 20, 0, "A Demo of 2030")).unwrap();
    let recording = read(&path, None).unwrap();
    let warned = recording
        .warnings
        .iter()
        .any(|w| w.contains("`A Demo of 2030` is not known") && w.contains("a ratio"));
    assert!(warned, "{:?}", recording.warnings);
    assert_eq!(recording.clip.frames[0].points[0].z_m, -0.75);
    assert_eq!(recording.clip.frames[0].points[0].intensity_db, 20.0);
}
