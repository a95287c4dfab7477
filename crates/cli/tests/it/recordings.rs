//! Recorded points through the command line: every format, its provenance, and what is refused.

use std::{fs, path::Path};

use radarllm_dataset::read_points;

use crate::command::{json, json_lines, radarllm, refused};

const CSV: &str =
    "frame,x,y,z,velocity,intensity\n0,0.5,2,0,0.25,10\n0,0.5,3,0,0.25,20\n2,0.5,2,0,0.25,20\n";
const RADHAR: &str = "header: \n  seq: 1\n  stamp: \n    secs: 10\n    nsecs: 0\n  frame_id: \"r\"\npoint_id: 0\n\
                      x: 2.0\ny: -0.5\nz: 0.25\nrange: 1.2\nvelocity: 0.6\nintensity: 30.5\n---\n";

fn npy(shape: &str, values: &[f32]) -> Vec<u8> {
    let text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

/// A packet of the out-of-box demo with one point and its side info.
pub fn packet(number: u32) -> Vec<u8> {
    let mut bytes = vec![2, 1, 4, 3, 6, 5, 8, 7];
    let words = [0x0306_0000, 96, 0xA6843, number, 0, 1, 2, 0, 1, 16];
    bytes.extend(words.iter().flat_map(|w: &u32| w.to_le_bytes()));
    bytes.extend(
        [0.5_f32, 2.0, 0.25, -0.5]
            .iter()
            .flat_map(|v| v.to_le_bytes()),
    );
    bytes.extend([7_u32, 4].iter().flat_map(|w| w.to_le_bytes()));
    bytes.extend([123, 0, 45, 0]);
    bytes.resize(96, 0);
    bytes
}

/// Input, options, format, frames, rate in Hz, points of the first frame.
type Case = (
    &'static str,
    &'static [&'static str],
    &'static str,
    u64,
    f64,
    usize,
);

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn every_format_becomes_a_points_file_that_says_recorded() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("points.csv"), CSV).unwrap();
    fs::write(
        at("radhar.txt"),
        [RADHAR, &RADHAR.replace("nsecs: 0", "nsecs: 100000000")].concat(),
    )
    .unwrap();
    let mars = "Frame #,# Obj,X,Y,Z,Doppler,Intensity,Abs Time\n7,1,0.5,2,-1,0.356,10,1\n9,1,0,1,0,0,10,1\n";
    fs::write(at("mars.csv"), mars).unwrap();
    fs::write(at("features.npy"), npy("(2, 8, 8, 5)", &[0.5; 640])).unwrap();
    fs::write(
        at("table.npy"),
        npy("(1, 7)", &[0.0, 0.0, 0.5, 2.0, 0.0, 0.25, 20.0]),
    )
    .unwrap();
    fs::write(at("uart.dat"), [packet(8), packet(9), packet(11)].concat()).unwrap();
    fs::create_dir_all(at("rain/sequence_0/radar")).unwrap();
    fs::write(
        at("rain/sequence_0/radar/frame_3.npy"),
        npy("(2, 6)", &[0.5; 12]),
    )
    .unwrap();
    fs::write(
        at("rain/sequence_0/radar/frame_4.npy"),
        npy("(1, 6)", &[0.5; 6]),
    )
    .unwrap();
    fs::create_dir(at("mmwave")).unwrap();
    let row: Vec<u8> = [2.0_f64, -0.5, 1.0, 0.25, 20.0]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    fs::write(at("mmwave/frame001.bin"), &row).unwrap();
    fs::write(at("mmwave/frame002.bin"), []).unwrap();
    let cases: [Case; 8] = [
        ("points.csv", &["--frame-rate", "20"], "csv", 2, 20.0, 2),
        ("radhar.txt", &[], "radhar", 2, 10.0, 1),
        ("mars.csv", &[], "mars", 2, 10.0, 1),
        ("features.npy", &[], "mars", 2, 10.0, 64),
        (
            "table.npy",
            &["--frame-rate", "10"],
            "npy-points",
            1,
            10.0,
            1,
        ),
        ("uart.dat", &["--radar", "awr1843boost"], "uart", 3, 10.0, 1),
        (
            "rain/sequence_0",
            &["--frame-rate", "10"],
            "mmbody(rain)",
            2,
            10.0,
            2,
        ),
        (
            "mmwave",
            &["--orientation", "forward-left-up"],
            "mmfi",
            2,
            10.0,
            1,
        ),
    ];
    for (name, options, format, frames, rate_hz, points) in cases {
        let (input, out) = (at(name), at("out.parquet"));
        let args = [
            &[
                "process",
                text(&input),
                "--out",
                text(&out),
                "--force",
                "--json",
            ],
            options,
        ]
        .concat();
        let report = json(&args);
        assert_eq!(report["frames"], frames, "{name}");
        let file = read_points(&out).unwrap();
        assert_eq!(
            file.meta.source,
            format!("recorded:{format}:{}", input.display())
        );
        assert!((file.meta.frame_rate_hz - rate_hz).abs() < 1e-6, "{name}");
        assert_eq!(file.frames[0].points.len(), points, "{name}");
        // The same file through the shared function of `describe` and `view`.
        let rows = json_lines(&[&["describe", text(&input), "--json"], options].concat());
        assert_eq!(rows[0]["synthetic"], false, "{name}");
        let page = at("page.html");
        let page_args = [
            &["view", text(&input), "--out", text(&page), "--force"],
            options,
        ]
        .concat();
        assert!(radarllm(&page_args).status.success(), "{name}");
        assert!(
            fs::read_to_string(&page)
                .unwrap()
                .contains("recorded radar"),
            "{name}"
        );
    }
}

/// Results on stdout, everything else on stderr: a script that reads the first line gets the result.
#[test]
fn notes_on_points_go_to_stderr() {
    let dir = tempfile::tempdir().unwrap();
    let (input, out) = (dir.path().join("uart.dat"), dir.path().join("p.parquet"));
    fs::write(&input, [packet(8), packet(9), packet(11)].concat()).unwrap();
    let run = |verb: &[&str]| {
        let output = radarllm(&[verb, &["--radar", "awr1843boost"]].concat());
        let [stdout, stderr] =
            [&output.stdout, &output.stderr].map(|b| String::from_utf8_lossy(b).into_owned());
        assert!(output.status.success(), "{stderr}");
        // Both verbs note which dialect the packets have.
        assert!(stderr.contains("dialect"), "{verb:?}: {stderr}");
        assert!(!stdout.contains("dialect"), "{verb:?}: {stdout}");
        stdout
    };
    let stdout = run(&["process", text(&input), "--out", text(&out)]);
    let result = format!("{}: 3 frames at 10.00 Hz", out.display());
    assert!(stdout.starts_with(&result), "{stdout}");
    assert_eq!(stdout.lines().count(), 1, "{stdout}");
    run(&["describe", text(&input), "--verbose"]);
    let page = dir.path().join("p.html");
    run(&["view", text(&input), "--out", text(&page)]);
}

#[test]
fn options_of_place_and_time_do_what_they_say() {
    let dir = tempfile::tempdir().unwrap();
    let (input, out) = (dir.path().join("uart.dat"), dir.path().join("p.parquet"));
    fs::write(&input, [packet(8), packet(9), packet(11)].concat()).unwrap();
    let run = |options: &[&str]| {
        let args = [
            "process",
            text(&input),
            "--out",
            text(&out),
            "--force",
            "--frame-rate",
            "10",
            "--json",
        ];
        let report = json(&[&args, options].concat());
        (report, read_points(&out).unwrap())
    };
    let (report, plain) = run(&[]);
    let numbers: Vec<u32> = plain.frames.iter().map(|f| f.frame).collect();
    assert_eq!(numbers, [0, 1, 3], "the lost frame is absent");
    assert_eq!(report["warnings"][0], "1 frames were lost");
    let p = plain.frames[0].points[0];
    assert_eq!(
        [p.x_m, p.y_m, p.z_m, p.velocity_mps],
        [0.5, 2.0, 0.25, -0.5]
    );
    assert!((p.intensity_db - 12.3).abs() < 1e-4);
    assert!(
        report["notes"].to_string().contains("1 lost frames"),
        "{report}"
    );
    let (_, resampled) = run(&["--resample", "5", "--motion-compensate"]);
    let sizes: Vec<usize> = resampled.frames.iter().map(|f| f.points.len()).collect();
    assert_eq!(sizes, [1, 1, 1]);
    let (_, merged) = run(&["--accumulate", "2"]);
    assert_eq!(
        merged
            .frames
            .iter()
            .map(|f| f.points.len())
            .collect::<Vec<_>>(),
        [1, 2, 1]
    );
    let (_, slow) = run(&["--min-speed", "0.6"]);
    assert!(slow.frames.iter().all(|f| f.points.is_empty()));
    // The boresight 90 degrees below the horizon: what is ahead of the radar lies under it.
    let (_, down) = run(&["--tilt-deg", "90"]);
    let p = down.frames[0].points[0];
    assert!(
        (p.y_m - 0.25).abs() < 1e-6 && (p.z_m + 2.0).abs() < 1e-6,
        "{p:?}"
    );
    let (_, turned) = run(&["--yaw-deg", "-90"]);
    let p = turned.frames[0].points[0];
    assert!(
        (p.x_m + 2.0).abs() < 1e-6 && (p.y_m - 0.5).abs() < 1e-6,
        "{p:?}"
    );
}

#[test]
fn what_cannot_be_told_or_read_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let out = at("out.parquet");
    fs::write(at("points.csv"), CSV).unwrap();
    fs::write(at("mri.cpl"), [0x80, 4, 0x95]).unwrap();
    fs::write(at("capture.bin"), [7; 64]).unwrap();
    fs::write(at("adc_data.bin"), [7; 64]).unwrap();
    fs::write(at("short.csv"), "frame,x,y\n").unwrap();
    fs::write(at("numbers.csv"), "1,0.5,2,0,0.1,15\n").unwrap();
    fs::write(at("words.csv"), "nr,right,ahead\n1,2,3\n").unwrap();
    fs::write(at("old.bag"), "#ROSBAG V1.2\n").unwrap();
    fs::write(at("cut.bag"), "#ROSBAG V2.0\n\u{1}").unwrap();
    fs::create_dir(at("mmwave")).unwrap();
    fs::write(at("mmwave/frame001.bin"), [0; 80]).unwrap();
    fs::create_dir(at("empty")).unwrap();
    fs::write(at("uart.dat"), packet(1)).unwrap();
    for (name, options, expected) in [
        ("points.csv", &[][..], "--frame-rate"),
        ("points.csv", &["--frame-rate", "0"], "frame rate of 0"),
        (
            "points.csv",
            &["--frame-rate", "10", "--topic", "/x"],
            "--topic has no meaning",
        ),
        (
            "points.csv",
            &["--frame-rate", "10", "--orientation", "up"],
            "right-forward-up",
        ),
        ("points.csv", &["--format", "xyz"], "npy-points"),
        ("points.csv", &["--format", "bag"], "#ROSBAG"),
        ("mri.cpl", &[], "pickle"),
        ("capture.bin", &[], "dca1000"),
        ("adc_data.bin", &[], "--radar"),
        ("short.csv", &["--frame-rate", "10"], "velocity"),
        ("short.csv", &[], "--columns names them"),
        ("numbers.csv", &[], "--columns names them"),
        ("words.csv", &[], "without the columns x, y, z, velocity"),
        (
            "numbers.csv",
            &["--columns", "frame,x,y,z,v,rate", "--frame-rate", "10"],
            "found `rate`",
        ),
        (
            "uart.dat",
            &["--format", "uart", "--columns", "x,y,z"],
            "--columns has no meaning",
        ),
        ("old.bag", &[], "rosbag fix"),
        ("cut.bag", &[], "byte 13"),
        ("mmwave", &[], "--orientation"),
        ("empty", &[], "frame_N.npy"),
        (
            "uart.dat",
            &["--frame-rate", "10", "--dialect", "sdk9"],
            "area-scanner",
        ),
        ("absent", &[], "absent"),
    ] {
        let input = at(name);
        let stderr = refused(&[&["process", text(&input), "--out", text(&out)], options].concat());
        assert!(stderr.contains(expected), "{name} {options:?}: {stderr}");
        assert!(!out.exists(), "{name}");
    }
}
