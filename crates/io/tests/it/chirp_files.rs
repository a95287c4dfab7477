//! Chirp files without a cube beside recordings, named by options and sent to boards.

use std::{fs, path::Path, path::PathBuf};

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
