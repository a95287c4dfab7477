//! Chirp files without a cube beside recordings, named by options and sent to boards.

use std::{
    fs,
    os::fd::AsRawFd as _,
    path::{Path, PathBuf},
    time::Duration,
};

use radarllm_formats::{ChirpDialect, RecordingFormat, uart::Dialect};
use radarllm_io::{
    CaptureFormat, CaptureOptions, IqChoice, LayoutOptions, PointOptions, RadarSource, Recording,
    Result, SampleRecording, TiFirmware,
    live::{LiveSource as _, TiBoard, TiBoardOptions},
    open_radar, open_radar_text,
    opened::Opened,
    read_recording,
};

use crate::{
    events::frame,
    fake_board::{Behaviour, FakeBoard},
    make_uart,
};

/// Two sub-frames, 40 ms together.
const ADVANCED: &str = "dfeDataOutputMode 3
channelCfg 15 1 0
adcCfg 2 1
profileCfg 0 60.5 20 8 44 0 0 70 1 128 4000 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 1
advFrameCfg 2 0 0 1 0
subFrameCfg 0 0 0 1 64 15 0 1 1 15
subFrameCfg 1 0 1 1 64 25 0 1 1 25
sensorPosition 1.7 0 15
sensorStart
";

/// 8 frames/s, mounted at 1.2 m.
const LOW_POWER: &str = "sensorStop 0
channelCfg 7 3 0
chirpComnCfg 16 0 0 160 4 32 0
chirpTimingCfg 7 20 0 75 58
frameCfg 2 0 250 48 125 0
sensorPosition 0 0 1.2 0 0
sensorStart 0 0 0 0
";

/// Eight values of `frameCfg`: 16 frames/s.
const MCU_PLUS: &str = "dfeDataOutputMode 1
channelCfg 15 15 0
adcCfg 2 0
profileCfg 0 76.5 6 5 24 0 0 12 0 400 25000 0 0 164
chirpCfg 0 5 0 0 0 0 0 15
frameCfg 0 5 64 0 400 62.5 1 0
sensorStart
";

/// A recording of 20 packets in a folder, with a chirp file beside it.
fn beside(cfg: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("uart.dat");
    let points = make_uart::one_point(Dialect::Sdk3);
    let packets = (0..20).map(|n| make_uart::packet(Dialect::Sdk3, n, &points));
    fs::write(&path, packets.collect::<Vec<_>>().concat()).unwrap();
    fs::write(folder.path().join("board.cfg"), cfg).unwrap();
    (folder, path)
}

fn read(path: &Path, frame_rate_hz: Option<f64>) -> Result<Recording> {
    let options = CaptureOptions {
        format: Some(CaptureFormat::Format(RecordingFormat::Uart)),
        points: PointOptions {
            frame_rate_hz,
            ..PointOptions::default()
        },
        ..CaptureOptions::default()
    };
    read_recording(&[path.into()], &options)
}

#[test]
fn points_take_rate_and_mounting_of_any_dialect_and_note_the_reason() {
    for (cfg, rate_hz, height_m, radar, reason) in [
        (ADVANCED, 25.0, Some(1.7), "iwr6843isk", "advanced frames"),
        (LOW_POWER, 8.0, Some(1.2), "iwrl6432", "low-power SDK"),
        (MCU_PLUS, 16.0, None, "xwr2944", "MCU+ SDK"),
    ] {
        let (folder, path) = beside(cfg);
        let found = read(&path, None).unwrap();
        assert_eq!(
            (found.clip.frame_rate_hz, found.clip.frames.len()),
            (rate_hz, 20)
        );
        assert_eq!(found.clip.radar, radar);
        if let Some(height_m) = height_m {
            assert_eq!(found.clip.radar_height_m, height_m);
        }
        assert_eq!(found.warnings, [] as [&str; 0]);
        let notes = found.notes.join("\n");
        assert!(notes.contains("board.cfg, beside the recording"), "{notes}");
        assert!(
            notes.contains("no cube: line ") && notes.contains(reason),
            "{notes}"
        );
        // Named by an option, it gives the same.
        let options = CaptureOptions {
            format: Some(CaptureFormat::Format(RecordingFormat::Uart)),
            radar: Some(open_radar(folder.path().join("board.cfg").to_str().unwrap()).unwrap()),
            ..CaptureOptions::default()
        };
        let named = read_recording(std::slice::from_ref(&path), &options).unwrap();
        assert_eq!(named.clip.frames, found.clip.frames);
        assert_eq!(named.clip.radar_height_m, found.clip.radar_height_m);
        // The frame rate of an option comes first.
        assert_eq!(read(&path, Some(5.0)).unwrap().clip.frame_rate_hz, 5.0);
    }
}

/// The one point of every frame is turned by the tilt of the file.
#[test]
fn the_tilt_of_an_advanced_file_levels_the_points() {
    let level = |cfg: &str| {
        let (_folder, path) = beside(cfg);
        read(&path, None).unwrap().clip.frames[0].points[0]
    };
    let (tilted, flat) = (
        level(ADVANCED),
        level(&ADVANCED.replace("1.7 0 15", "1.7 0 0")),
    );
    let (sin, cos) = 15_f32.to_radians().sin_cos();
    assert!((tilted.y_m - (flat.y_m * cos + flat.z_m * sin)).abs() < 1e-5);
    assert!((tilted.z_m - (flat.z_m * cos - flat.y_m * sin)).abs() < 1e-5);
}

#[test]
fn an_unreadable_file_beside_is_refused_only_where_it_is_needed() {
    for cfg in [
        "sensorStart\n",
        "profileCfg nonsense\n",
        &ADVANCED.replace("subFrameCfg 1", "%"),
        &LOW_POWER.replace(" 125 0", " 0 0"),
        &LOW_POWER.replace("1.2 0 0", "1.2 0 nan"),
    ] {
        let (_folder, path) = beside(cfg);
        let error = read(&path, None).unwrap_err();
        assert!(error.to_string().contains("board.cfg"), "{error}");
        let found = read(&path, Some(10.0)).unwrap();
        assert_eq!(
            (found.clip.frame_rate_hz, found.clip.radar.as_str()),
            (10.0, "unknown")
        );
        let [warning] = &found.warnings[..] else {
            panic!("{:?}", found.warnings);
        };
        assert!(
            warning.contains("board.cfg") && warning.contains("is not used"),
            "{warning}"
        );
    }
    // What is no text.
    let (folder, path) = beside("");
    fs::write(folder.path().join("board.cfg"), [0xff, 0xfe, 0]).unwrap();
    assert!(read(&path, None).is_err());
    assert!(read(&path, Some(10.0)).is_ok());
}

/// A mistake that leaves the frame period alone is a warning: the board may have been given another file.
#[test]
fn a_mistake_elsewhere_in_the_file_is_a_warning() {
    let cfg = "channelCfg 15 1 0\nadcCfg 2 1\nprofileCfg 0 60.5 20 8 44 0 0 70 1 128 4000 0 0 30\n\
        chirpCfg 0 0 0 0 0 0 0 4a\nframeCfg 0 0 64 0 50 1 0\n";
    let (_folder, path) = beside(cfg);
    let found = read(&path, None).unwrap();
    assert_eq!(found.clip.frame_rate_hz, 20.0);
    assert!(
        found.warnings.iter().any(|w| w.contains("`4a`")),
        "{:?}",
        found.warnings
    );
}

#[test]
fn raw_samples_are_refused_for_the_true_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("adc_data.bin");
    fs::write(&path, vec![0; 1 << 16]).unwrap();
    for (cfg, reason) in [
        (ADVANCED, "advanced frames"),
        (LOW_POWER, "this is a chirp file of the low-power SDK"),
        (MCU_PLUS, "this is a chirp file of the MCU+ SDK"),
    ] {
        let radar = open_radar_text(Path::new("board.cfg"), cfg).unwrap();
        let error = radar.sample_config().unwrap_err().to_string();
        assert!(
            error.contains("board.cfg: line ") && error.contains(reason),
            "{error}"
        );
        let options = CaptureOptions {
            radar: Some(radar.clone()),
            layout: LayoutOptions {
                iq: Some(IqChoice::IFirst),
                ..LayoutOptions::default()
            },
            ..CaptureOptions::default()
        };
        let opened = Opened::open(std::slice::from_ref(&path), &options).unwrap();
        let Err(error) = SampleRecording::open(opened, &options) else {
            panic!("{reason}");
        };
        assert!(error.to_string().contains(reason), "{error}");
        // Simulation needs a radar, too, which the xWRL6432 has.
        assert_eq!(radar.config().is_ok(), cfg == LOW_POWER);
        assert!(TiFirmware::out_of_box(&radar).is_err());
    }
    let radar = open_radar_text(Path::new("board.cfg"), LOW_POWER).unwrap();
    assert_eq!(radar.points.dialect, Some(ChirpDialect::LowPower));
    assert!(matches!(&radar.source, RadarSource::TiCfg(text) if text == LOW_POWER));
    let config = radar.into_config().unwrap();
    assert_eq!(
        (config.n_loops, config.n_samples, config.frame_rate_hz()),
        (48, 80, 8.0)
    );
}

#[test]
fn boards_are_started_with_files_of_any_dialect() {
    for (cfg, rate_hz) in [(ADVANCED, 25.0), (LOW_POWER, 8.0), (MCU_PLUS, 16.0)] {
        let fake = FakeBoard::new(Behaviour::default());
        let mut board = TiBoard::open(TiBoardOptions {
            data: fake.data.clone(),
            cli: Some(fake.cli.clone()),
            capture: CaptureOptions {
                radar: Some(open_radar_text(Path::new("board.cfg"), cfg).unwrap()),
                ..CaptureOptions::default()
            },
            ..TiBoardOptions::default()
        })
        .unwrap();
        assert_eq!(board.about().frame_period_s, 1.0 / rate_hz);
        assert!(
            board.notes().iter().any(|n| n.contains("no cube")),
            "{:?}",
            board.notes()
        );
        assert!(!frame(&mut board).points.is_empty());
        let sent = fake.commands();
        let expected: Vec<&str> = cfg.lines().collect();
        assert_eq!(sent, expected);
    }
}

/// Baud rates of received and sent bytes of a port.
fn rates(port: &Path) -> (u32, u32) {
    let port = fs::File::open(port).unwrap();
    // SAFETY: termios2 is plain data for which all zeros is a valid value; the call fills it.
    let mut settings: libc::termios2 = unsafe { std::mem::zeroed() };
    // SAFETY: the descriptor is open and `settings` outlives the call.
    let result = unsafe { libc::ioctl(port.as_raw_fd(), libc::TCGETS2, &raw mut settings) };
    assert_eq!(result, 0);
    (settings.c_ispeed, settings.c_ospeed)
}

#[test]
fn low_power_boards_have_one_port_whose_rate_the_file_changes() {
    let open = |cfg: &str, data: &Path, cli: &Path| {
        TiBoard::open(TiBoardOptions {
            data: data.into(),
            cli: Some(cli.into()),
            capture: CaptureOptions {
                radar: Some(open_radar_text(Path::new("board.cfg"), cfg).unwrap()),
                ..CaptureOptions::default()
            },
            ..TiBoardOptions::default()
        })
    };
    let behaviour = || Behaviour {
        pause: Duration::from_millis(20),
        ..Behaviour::default()
    };
    for (command, rate) in [
        ("", 115_200),
        ("baudRate 1250000\n", 1_250_000),
        ("baudRate 921600\n", 921_600),
    ] {
        let cfg = LOW_POWER.replace("sensorStart 0", &format!("{command}sensorStart 0"));
        let fake = FakeBoard::with_one_port(behaviour());
        let mut board = open(&cfg, &fake.data, &fake.cli).unwrap();
        // The first packets may have arrived with the answer to the start.
        let numbers: Vec<u32> = (0..10).map(|_| frame(&mut board).frame).collect();
        assert!(numbers.windows(2).all(|w| w[1] == w[0] + 1), "{numbers:?}");
        assert_eq!(rates(&fake.data), (rate, rate));
        let n_commands = 7 + usize::from(!command.is_empty());
        assert_eq!(fake.commands().len(), n_commands);
        assert!((board.about().frame_period_s - 0.125).abs() < 1e-9);
    }
    // A rate that the system does not have is named with its line.
    let cfg = LOW_POWER.replace("sensorStart 0", "baudRate 12345\nsensorStart 0");
    let fake = FakeBoard::with_one_port(behaviour());
    let error = open(&cfg, &fake.data, &fake.cli).err().unwrap().to_string();
    assert!(
        error.contains("line 7 of the chirp file, `baudRate 12345`: no baud rate 12345"),
        "{error}"
    );
    // Other boards have two ports.
    let fake = FakeBoard::with_one_port(behaviour());
    let error = open(ADVANCED, &fake.data, &fake.cli)
        .err()
        .unwrap()
        .to_string();
    assert!(
        error.contains("both the data port and the CLI port"),
        "{error}"
    );
    assert!(fake.commands().is_empty());
}
