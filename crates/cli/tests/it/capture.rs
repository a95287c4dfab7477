//! Recorded bytes to points: raw words, packets, arrays of other tools, live packets.

use std::{
    fs,
    io::{BufRead, BufReader},
    net::UdpSocket,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use num_complex::{Complex32, Complex64};
use radarllm_base::{RadarConfig, RadarCube, RadarPoint};
use radarllm_dataset::read_points;
use radarllm_files::npy::NpyStream;
use radarllm_formats::{
    adc::{CubeShape, SampleLayout},
    radar_to_toml,
};

use crate::{
    command::{json, radarllm, refused},
    made::{self, I_FIRST, PcapStyle, Q_FIRST, two},
};

/// A small radar: 32 loops, 3 transmitters, 4 receivers, 64 samples, 17 cm a bin.
fn small_radar(folder: &Path) -> (RadarConfig, String) {
    let radar = RadarConfig {
        name: "small".into(),
        n_samples: 64,
        n_loops: 32,
        slope_hz_per_s: 15e12,
        sample_rate_hz: 1.1e6,
        ..RadarConfig::awr1843boost()
    };
    let path = folder.join("small.toml");
    fs::write(&path, radar_to_toml(&radar).unwrap()).unwrap();
    (radar, text(&path))
}

fn text(path: &Path) -> String {
    path.to_str().unwrap().to_string()
}

/// Three simulated frames of somebody who comes and goes, as npy and as cubes in counts.
struct Recording {
    folder: tempfile::TempDir,
    radar: String,
    npy: String,
    cubes: Vec<RadarCube>,
}

fn recording() -> Recording {
    let folder = tempfile::tempdir().unwrap();
    let (radar, radar_file) = small_radar(folder.path());
    let scene = folder.path().join("scene.toml");
    fs::write(
        &scene,
        "duration_s = 0.3\n[[target]]\nkind = \"point\"\nposition_m = [0.5, 2.0, 0.0]\n\
         velocity_mps = [0.0, 1.0, 0.0]\nrcs_m2 = 1.0\n[[target]]\nkind = \"point\"\n\
         position_m = [-0.5, 3.0, 0.0]\nvelocity_mps = [0.0, -1.0, 0.0]\nrcs_m2 = 1.0\n[noise]\nsnr_db = 20.0\n",
    )
    .unwrap();
    let npy = text(&folder.path().join("raw.npy"));
    json(&[
        "simulate",
        &text(&scene),
        "--radar",
        &radar_file,
        "--emit",
        "adc",
        "--out",
        &npy,
        "--json",
    ]);
    let mut samples = Vec::new();
    NpyStream::open(fs::File::open(&npy).unwrap())
        .unwrap()
        .read(usize::MAX / 16, |re, im| {
            samples.push(Complex32::new(re as f32, im as f32));
        })
        .unwrap();
    let peak = samples
        .iter()
        .fold(0.0_f32, |m, v| m.max(v.re.abs()).max(v.im.abs()));
    let shape = CubeShape::of(&radar);
    let cubes = samples
        .chunks(shape.n_values().unwrap())
        .map(|frame| {
            let mut cube = shape.zeros().unwrap();
            for (count, value) in cube.data.iter_mut().zip(frame) {
                let value = value * (8000.0 / peak);
                *count = Complex32::new(value.re.round(), value.im.round());
            }
            cube
        })
        .collect();
    Recording {
        folder,
        radar: radar_file,
        npy,
        cubes,
    }
}

impl Recording {
    fn stream(&self, layout: SampleLayout) -> Vec<u8> {
        let words = self.cubes.iter().flat_map(|c| made::words(c, layout));
        made::bytes(&words.collect::<Vec<i16>>())
    }

    fn write(&self, name: &str, bytes: &[u8]) -> String {
        let path = self.folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        text(&path)
    }

    /// Processes captures; the report and the points.
    fn process(
        &self,
        captures: &[&str],
        flags: &[&str],
    ) -> (serde_json::Value, Vec<Vec<RadarPoint>>) {
        let out = text(&self.folder.path().join("points.parquet"));
        let mut args = vec!["process"];
        args.extend(captures);
        args.extend(["--radar", &self.radar, "--out", &out, "--force", "--json"]);
        args.extend(flags);
        let report = json(&args);
        let frames = read_points(Path::new(&out)).unwrap().frames;
        (report, frames.into_iter().map(|f| f.points).collect())
    }
}

/// Ranges and velocities of the strongest points agree to less than a tenth of a bin.
fn same_points(a: &[Vec<RadarPoint>], b: &[Vec<RadarPoint>]) {
    assert_eq!(a.len(), b.len());
    for (a, b) in a.iter().zip(b) {
        assert!(a.len() > 1 && b.len() > 1);
        for (a, b) in a.iter().zip(b).take(2) {
            assert!((a.range_m - b.range_m).abs() < 0.01, "{a:?}, {b:?}");
            assert!(
                (a.velocity_mps - b.velocity_mps).abs() < 0.02,
                "{a:?}, {b:?}"
            );
            assert!((a.x_m - b.x_m).abs() < 0.02, "{a:?}, {b:?}");
        }
    }
}

#[test]
fn raw_words_give_the_points_of_the_array_they_were_made_of() {
    let r = recording();
    let (report, expected) = r.process(&[&r.npy], &[]);
    assert_eq!(
        (&report["format"], &report["frames"]),
        (&"npy".into(), &3.into())
    );
    let bin = r.write("adc_data.bin", &r.stream(two(I_FIRST)));
    let lanes = ["--lanes", "2"];
    for iq in ["i-first", "auto"] {
        let (report, found) = r.process(&[&bin], &[&lanes[..], &["--iq", iq]].concat());
        same_points(&found, &expected);
        let notes = report["notes"].to_string();
        assert!(
            notes.contains("read with I first; the samples say I first"),
            "{notes}"
        );
        assert_eq!(
            (&report["format"], &report["trailing_bytes"]),
            (&"adc".into(), &0.into())
        );
    }
    let picture = text(&r.folder.path().join("adc.svg"));
    let image = text(&r.folder.path().join("micro-doppler.png"));
    r.process(
        &[&bin],
        &[
            &lanes[..],
            &["--iq", "i-first", "--adc-statistics", &picture],
            &["--micro-doppler", &image],
        ]
        .concat(),
    );
    let svg = fs::read_to_string(&picture).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("Value of I or Q (counts)"));
    let png = fs::read(&image).unwrap();
    let axis = b"tEXty-axis\0Velocity (m/s) from -";
    assert!(png.starts_with(b"\x89PNG") && png.windows(axis.len()).any(|w| w == axis));
    let swapped = r.write("swapped.bin", &r.stream(two(Q_FIRST)));
    let (report, found) = r.process(&[&swapped], &[&lanes[..], &["--iq", "auto"]].concat());
    same_points(&found, &expected);
    assert!(
        report["notes"]
            .to_string()
            .contains("read with Q first; the samples say Q first")
    );
    let (report, _) = r.process(&[&swapped], &[&lanes[..], &["--iq", "i-first"]].concat());
    assert!(
        report["notes"]
            .to_string()
            .contains("I/Q order looks swapped")
    );

    // Split in mid-chirp, with a log of the recorder beside it and an unfinished frame behind.
    let mut stream = r.stream(two(I_FIRST));
    stream.extend([7; 1001]);
    let (a, b) = stream.split_at(12_345);
    let parts = [r.write("x_Raw_0.bin", a), r.write("x_Raw_1.bin", b)];
    r.write(
        "x_Raw_LogFile.csv",
        b"Raw Data :\nNumber of received packets - 9\nNumber of zero filled packets - 1\n",
    );
    let (report, found) = r.process(
        &[&parts[0], &parts[1]],
        &[&lanes[..], &["--iq", "i-first"]].concat(),
    );
    same_points(&found, &expected);
    assert_eq!(report["trailing_bytes"], 1001);
    let notes = report["notes"].to_string();
    assert!(
        notes.contains("1 of 10 packets were lost")
            && notes.contains("3 frames and 1001 bytes more"),
        "{notes}"
    );
}

#[test]
fn points_of_samples_are_placed_joined_and_chosen_as_recorded_points_are() {
    let r = recording();
    let (_, plain) = r.process(&[&r.npy], &[]);
    // A sensor that looks 15 degrees down: what it sees straight ahead lies lower.
    let (_, tilted) = r.process(&[&r.npy], &["--tilt-deg", "15"]);
    let (sin, cos) = 15_f32.to_radians().sin_cos();
    for (a, b) in plain.iter().flatten().zip(tilted.iter().flatten()) {
        assert!((b.y_m - (a.y_m * cos + a.z_m * sin)).abs() < 1e-4);
        assert!((b.z_m - (a.z_m * cos - a.y_m * sin)).abs() < 1e-4);
        assert_eq!((a.range_m, a.velocity_mps), (b.range_m, b.velocity_mps));
    }
    let (_, fast) = r.process(&[&r.npy], &["--min-speed", "0.5"]);
    let is_fast = |p: &&RadarPoint| p.velocity_mps.abs() >= 0.5;
    assert_eq!(
        fast.concat(),
        plain
            .concat()
            .iter()
            .filter(is_fast)
            .copied()
            .collect::<Vec<_>>()
    );
    // Every frame with the one before.
    let (_, merged) = r.process(&[&r.npy], &["--accumulate", "2"]);
    for i in 0..3 {
        let before = if i == 0 { 0 } else { plain[i - 1].len() };
        assert_eq!(merged[i].len(), before + plain[i].len());
    }
    // 10 to 5 frames/s: none lost.
    let (report, slow) = r.process(&[&r.npy], &["--resample", "5"]);
    assert_eq!(
        (&report["frame_rate_hz"], &report["frames"]),
        (&5.0.into(), &2.into())
    );
    assert_eq!(slow.concat().len(), plain.concat().len());
    // The chain of a data set's configuration.
    let toml = r.write(
        "data.toml",
        b"name = \"x\"\n[processing]\nmax_points = 3\nmax_range_m = 2.5\n",
    );
    let (_, chosen) = r.process(&[&r.npy], &["--processing", &toml]);
    assert!(chosen.iter().all(|f| f.len() == 3));
    assert!(chosen.iter().flatten().all(|p| p.range_m < 2.5));
    let out = text(&r.folder.path().join("never.parquet"));
    let args = ["process", &r.npy, "--radar", &r.radar, "--out", &out];
    for (name, content, expected) in [
        ("empty.toml", "seed = 1", "missing field `processing`"),
        ("wrong.toml", "[processing]\nmax_point = 3", "max_point"),
        ("range.toml", "[processing]\nmax_points = 0", "max_points"),
    ] {
        let toml = r.write(name, content.as_bytes());
        let error = refused(&[&args[..], &["--processing", &toml]].concat());
        assert!(error.contains(expected), "{error}");
    }
    for (option, value) in [
        ("--orientation", "forward-left-up"),
        ("--frame-rate", "20"),
        ("--dialect", "sdk3"),
        ("--topic", "/points"),
        ("--seconds", "3"),
    ] {
        let error = refused(&[&args[..], &[option, value]].concat());
        assert!(
            error.contains(option) && error.contains("for recorded points"),
            "{error}"
        );
    }
    assert!(!Path::new(&out).exists());
}

#[test]
fn what_is_not_said_about_raw_words_is_asked_for() {
    let r = recording();
    let bin = r.write("adc_data.bin", &r.stream(two(I_FIRST)));
    let out = text(&r.folder.path().join("never.parquet"));
    let args = ["process", &bin, "--radar", &r.radar, "--out", &out];
    assert!(refused(&args).contains("--lanes 4 for xWR12xx"));
    let error = refused(&[&args[..], &["--lanes", "2"]].concat());
    assert!(
        error.contains("--iq is needed") && error.contains("the samples say I first"),
        "{error}"
    );
    let short = r.write("short.bin", &[0; 1000]);
    let args = [
        "process", &short, "--radar", &r.radar, "--out", &out, "--lanes", "2", "--iq", "auto",
    ];
    assert!(
        refused(&args).contains("1000 bytes, and a frame of 32 loops"),
        "{}",
        refused(&args)
    );
    let text_file = r.write("notes.dat", b"hello");
    for (extra, cause) in [
        (&[][..], "not clear"),
        (&["--format", "npy"], "does not begin like an npy file"),
        (&["--format", "dca1000"], "does not begin like packets"),
        (&["--format", "mmbody"], "notes.dat"),
    ] {
        let args = ["process", &text_file, "--radar", &r.radar, "--out", &out];
        let error = refused(&[&args[..], extra].concat());
        assert!(error.contains(cause), "{error}");
    }
    assert!(!Path::new(&out).exists());
}

#[test]
fn packets_give_the_same_points_and_their_losses_are_reported() {
    let r = recording();
    let (_, expected) = r.process(&[&r.npy], &[]);
    let flags = ["--lanes", "2", "--iq", "i-first"];
    let mut sent = made::datagrams(&r.stream(two(I_FIRST)), 1456);
    sent.swap(5, 6);
    let n = sent.len();
    let whole = r.write("adc_Raw_0.bin", &made::records(&sent));
    let (report, found) = r.process(&[&whole], &flags);
    same_points(&found, &expected);
    assert_eq!(report["format"], "dca1000 records");
    let transfer = &report["transfer"];
    assert_eq!(
        (
            &transfer["packets"],
            &transfer["lost"],
            &transfer["out_of_order"]
        ),
        (&n.into(), &0.into(), &1.into())
    );

    sent.remove(20);
    let ethernet: Vec<Vec<u8>> = sent
        .iter()
        .map(|d| made::ethernet(0, &made::ipv4(4098, d)))
        .collect();
    let style = PcapStyle {
        is_big_endian: false,
        is_nanoseconds: false,
        link: 1,
    };
    for (name, file) in [
        ("a.pcap", made::pcap(&style, &ethernet)),
        ("a.pcapng", made::pcapng(false, 1, &ethernet)),
    ] {
        let (report, found) = r.process(&[&r.write(name, &file)], &flags);
        assert_eq!(report["format"], "dca1000 pcap");
        assert_eq!(
            (&report["transfer"]["lost"], &report["damaged_frames"]),
            (&1.into(), &1.into()),
            "{report}"
        );
        // The lost packet lies in frame 0 (98,304 bytes): the others are as they were.
        same_points(&found[1..], &expected[1..]);
    }
}

#[test]
fn live_packets_become_points() {
    let r = recording();
    let (_, expected) = r.process(&[&r.npy], &[]);
    let out = text(&r.folder.path().join("live.parquet"));
    let mut child = Command::new(env!("CARGO_BIN_EXE_radarllm"))
        .args([
            "process",
            "udp:127.0.0.1:0",
            "--radar",
            &r.radar,
            "--out",
            &out,
        ])
        .args(["--lanes", "2", "--iq", "i-first", "--frames", "2"])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let address = loop {
        let line = lines.next().expect("it says where it listens").unwrap();
        if let Some(address) = line.strip_prefix("listening at ") {
            break address.to_string();
        }
    };
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    for datagram in made::datagrams(&r.stream(two(I_FIRST)), 1456) {
        socket.send_to(&datagram, &address).unwrap();
        // Slower than the receiver, so that a busy machine loses nothing.
        std::thread::sleep(std::time::Duration::from_micros(200));
    }
    let rest: Vec<String> = lines.map(Result::unwrap).collect();
    assert!(child.wait().unwrap().success(), "{rest:?}");
    let points = read_points(Path::new(&out)).unwrap().frames;
    let points: Vec<Vec<RadarPoint>> = points.into_iter().map(|f| f.points).collect();
    same_points(&points, &expected[..2]);
}

#[test]
fn arrays_of_other_tools_are_read_by_their_axes() {
    let r = recording();
    let (_, expected) = r.process(&[&r.npy], &[]);
    let shape = CubeShape::of(&small_radar(r.folder.path()).0);
    // [frame, sample, chirp, rx] of unsigned words in complex128.
    let unsigned = |v: f32| f64::from(v as i16 as u16);
    let mut values = Vec::new();
    for cube in &r.cubes {
        for s in 0..shape.n_samples {
            for chirp in 0..shape.n_loops * shape.n_tx {
                for rx in 0..shape.n_rx {
                    let v = cube.chirp(chirp / shape.n_tx, chirp % shape.n_tx, rx)[s];
                    values.push(Complex64::new(unsigned(v.re), unsigned(v.im)));
                }
            }
        }
    }
    let path = text(&r.folder.path().join("other.npy"));
    let lengths = [3, 64, 96, 4];
    write_npy(
        &path,
        "<c16",
        &lengths,
        values
            .iter()
            .flat_map(|v| [v.re.to_le_bytes(), v.im.to_le_bytes()].concat()),
    );
    let (report, found) = r.process(&[&path], &["--axes", "frame,sample,chirp,rx"]);
    same_points(&found, &expected);
    assert!(
        report["notes"]
            .to_string()
            .contains("unsigned 16-bit words")
    );
    let out = text(&r.folder.path().join("never.parquet"));
    let error = refused(&["process", &path, "--radar", &r.radar, "--out", &out]);
    assert!(
        error.contains("[frame *, loop 32, tx 3, rx 4, sample 64]"),
        "{error}"
    );
    let error = refused(&[
        "process",
        &path,
        "--radar",
        &r.radar,
        "--out",
        &out,
        "--axes",
        "frame,time",
    ]);
    assert!(error.contains("axis `time`"), "{error}");
    fs::write(&path, &fs::read(&path).unwrap()[..300_000]).unwrap();
    let error = refused(&[
        "process",
        &path,
        "--radar",
        &r.radar,
        "--out",
        &out,
        "--axes",
        "frame,sample,chirp,rx",
    ]);
    assert!(error.contains("frame 0, number"), "{error}");
}

fn write_npy(path: &str, kind: &str, shape: &[usize], bytes: impl Iterator<Item = u8>) {
    let lengths: Vec<String> = shape.iter().map(usize::to_string).collect();
    let head = format!(
        "{{'descr': '{kind}', 'fortran_order': False, 'shape': ({}), }}",
        lengths.join(", ")
    );
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    let length = (head.len() + 11).next_multiple_of(64) - 10;
    file.extend((length as u16).to_le_bytes());
    file.extend(format!("{head:<width$}\n", width = length - 1).bytes());
    file.extend(bytes);
    fs::write(path, file).unwrap();
}

/// OpenRadar's tutorial: movers in range bin 60 at Doppler -10 and +7 (the one at 0 goes with the clutter).
#[test]
fn a_recorded_array_shows_its_documented_movers() {
    let shared = std::env::var_os("RADARLLM_SHARED").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared"),
        PathBuf::from,
    );
    let capture = shared.join("data/openradar/doppler_example_1.npy");
    if !capture.is_file() {
        println!("skipped: no shared data");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let mut radar = RadarConfig {
        name: "openradar".into(),
        start_hz: 77.4201e9,
        slope_hz_per_s: 60e12,
        idle_s: 30e-6,
        adc_start_s: 6e-6,
        ramp_end_s: 62e-6,
        n_samples: 128,
        sample_rate_hz: 2.5e6,
        ..RadarConfig::awr1843boost()
    };
    radar.tx.truncate(2);
    let radar_file = folder.path().join("openradar.toml");
    fs::write(&radar_file, radar_to_toml(&radar).unwrap()).unwrap();
    let out = text(&folder.path().join("points.parquet"));
    let args = [
        "process",
        &text(&capture),
        "--radar",
        &text(&radar_file),
        "--out",
        &out,
        "--json",
    ];
    let report = json(&[&args[..], &["--axes", "chirp,virtual,sample"]].concat());
    assert_eq!(report["frames"], 1);
    let notes = report["notes"].to_string();
    assert!(
        notes.contains("unsigned 16-bit words") && !notes.contains("swapped"),
        "{notes}"
    );
    let points = read_points(Path::new(&out))
        .unwrap()
        .frames
        .remove(0)
        .points;
    let (bin_m, bin_mps) = (radar.range_resolution_m(), radar.velocity_resolution_mps());
    for doppler in [-10.0, 7.0] {
        let near = |p: &&RadarPoint| {
            (f64::from(p.range_m) / bin_m - 60.0).abs() < 1.2
                && (f64::from(p.velocity_mps) / bin_mps - doppler).abs() < 1.2
        };
        assert!(points.iter().any(|p| near(&p)), "{doppler}");
    }
}

#[test]
fn exports_of_mmwave_studio_are_radars_and_say_how_samples_lie() {
    let r = recording();
    let export = fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../formats/tests/data/awr1843.mmwave.json"),
    )
    .unwrap();
    let file = r.write("profile.mmwave.json", export.as_bytes());
    let radar = json(&["radar", "show", &file, "--json"]);
    assert_eq!(
        (&radar["n_tx"], &radar["n_loops"]),
        (&3.into(), &128.into())
    );
    assert!((radar["range_resolution_m"].as_f64().unwrap() - 0.042_93).abs() < 1e-5);
    assert_eq!(radarllm(&["radar", "lint", &file]).status.code(), Some(0));
    // The setup beside it says which board.
    let setup = r#"{"mmWaveDevice": "iwr1443", "configUsed": "C:\\x\\profile.mmwave.json"}"#;
    let setup = r.write("profile.setup.json", setup.as_bytes());
    assert_eq!(
        json(&["radar", "show", &setup, "--json"])["name"],
        "iwr1443boost"
    );
    // One frame of noise-free silence but for a corner: the order is the export's, nobody asks for --iq.
    let shape = CubeShape {
        n_loops: 128,
        n_tx: 3,
        n_rx: 4,
        n_samples: 256,
    };
    let cube = made::echo(shape, 30.0, 10.0, 1);
    let bin = r.write(
        "studio_Raw_0.bin",
        &made::bytes(&made::words(&cube, two(I_FIRST))),
    );
    let out = text(&r.folder.path().join("studio.parquet"));
    let report = json(&["process", &bin, "--radar", &file, "--out", &out, "--json"]);
    assert!(
        report["notes"].to_string().contains("read with I first"),
        "{report}"
    );
}
