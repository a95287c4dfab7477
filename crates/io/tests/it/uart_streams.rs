//! Streams of boards that see nobody, of older SDKs, of demos that are not known: as recordings and live.

use std::{
    fs,
    path::Path,
    sync::atomic::AtomicBool,
    time::{Duration, Instant},
};

use radarllm_formats::uart::{Dialect, MAGIC};
use radarllm_io::{
    CaptureFormat, CaptureOptions, PointOptions, Recording,
    live::{LiveEvent, LiveSource as _, LiveTimeouts, TiBoard, TiBoardOptions},
    open_radar_text, read_recording,
};

use crate::{
    events::PATIENCE,
    fake_board::Pty,
    make_uart::{floats, one_point, packet, packet_of, words},
};

/// Loops of 3 (350 + 58) us, 16 of them, 60.25 GHz: see [`doppler_step_mps`].
const CFG: &str = "sensorStop\nflushCfg\nchannelCfg 15 7 0\nadcCfg 2 1\nprofileCfg 0 60.25 350 6 58 0 0 60 1 224 4500 0 0 30\n\
    chirpCfg 0 0 0 0 0 0 0 1\nchirpCfg 1 1 0 0 0 0 0 4\nchirpCfg 2 2 0 0 0 0 0 2\nframeCfg 0 2 16 0 100 1 0\nsensorStart\n";

/// Wavelength over twice the duration of the loops of a frame, m/s. The wavelength is that of the middle of the samples:
/// 60 MHz/us, 6 us after the start of the ramp and half of 224 samples at 4.5 MHz.
fn doppler_step_mps() -> f32 {
    let carrier_hz = 60.25e9 + 60e12 * (6e-6 + 0.5 * 224.0 / 4.5e6);
    let loops_s = 16.0 * 3.0 * (350e-6 + 58e-6);
    (299_792_458.0 / carrier_hz / (2.0 * loops_s)) as f32
}

fn radar() -> CaptureOptions {
    CaptureOptions {
        radar: Some(open_radar_text(Path::new("wall.cfg"), CFG).unwrap()),
        ..CaptureOptions::default()
    }
}

fn at_10_hz() -> CaptureOptions {
    CaptureOptions {
        points: PointOptions {
            frame_rate_hz: Some(10.0),
            ..PointOptions::default()
        },
        ..CaptureOptions::default()
    }
}

fn read(bytes: &[u8], options: &CaptureOptions) -> radarllm_io::Result<Recording> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("uart.dat");
    fs::write(&path, bytes).unwrap();
    let options = CaptureOptions {
        format: Some(CaptureFormat::from_name("uart").unwrap()),
        ..options.clone()
    };
    read_recording(&[path], &options)
}

fn stream(dialect: Dialect, contents: impl IntoIterator<Item = Vec<(u32, Vec<u8>)>>) -> Vec<u8> {
    let packets = contents.into_iter().zip(0..);
    packets
        .flat_map(|(tlvs, number)| packet(dialect, number, &tlvs))
        .collect()
}

#[test]
fn an_empty_room_is_read_as_frames_without_points() {
    for dialect in [
        Dialect::Sdk3,
        Dialect::Overhead3d,
        Dialect::PeopleCounting3d,
    ] {
        let empty = stream(dialect, vec![Vec::new(); 40]);
        let recording = read(&empty, &at_10_hz()).unwrap();
        assert_eq!(recording.clip.frames.len(), 40);
        assert!(recording.clip.frames.iter().all(|f| f.points.is_empty()));
        let is_assumed = |text: &String| text.contains("is assumed");
        let expected = dialect != Dialect::PeopleCounting3d;
        assert_eq!(recording.warnings.iter().any(is_assumed), expected);

        let content = [vec![Vec::new(); 40], vec![one_point(dialect); 20]].concat();
        let recording = read(&stream(dialect, content), &at_10_hz()).unwrap();
        let n_points: Vec<usize> = recording
            .clip
            .frames
            .iter()
            .map(|f| f.points.len())
            .collect();
        assert_eq!(n_points, [[0; 40].as_slice(), &[1; 20]].concat());
        assert!(!recording.warnings.iter().any(is_assumed));
    }
}

#[test]
fn doppler_bins_become_velocities_by_the_chirp_file() {
    let bytes = stream(Dialect::Sdk2, vec![one_point(Dialect::Sdk2); 20]);
    let recording = read(&bytes, &radar()).unwrap();
    for point in recording.clip.frames.iter().flat_map(|f| &f.points) {
        assert!(
            (point.velocity_mps - 5.0 * doppler_step_mps()).abs() < 1e-5,
            "{point:?}"
        );
        assert!((point.intensity_db - 20.0).abs() < 1e-4);
    }
    assert!(!recording.warnings.iter().any(|w| w.contains("Doppler")));

    let recording = read(&bytes, &at_10_hz()).unwrap();
    assert!(
        recording
            .clip
            .frames
            .iter()
            .all(|f| f.points[0].velocity_mps == 0.0)
    );
    let warned = |w: &String| w.contains("Doppler bins instead of speeds");
    assert_eq!(recording.warnings.iter().filter(|w| warned(w)).count(), 1);
    let is_noted = |n: &String| n.contains("no point has a speed: static points are not removed");
    assert!(recording.notes.iter().any(is_noted));
}

/// An empty room of static echoes: every speed is measured, and zero.
#[test]
fn speeds_of_zero_are_measured_where_the_demo_sends_speeds() {
    let echoes = [
        floats(&[0.5, 2.0, 0.1, 0.0]),
        floats(&[-1.0, 4.0, 0.3, 0.0]),
    ]
    .concat();
    let bytes = stream(Dialect::Sdk3, vec![vec![(1, echoes)]; 40]);
    let mut recording = read(&bytes, &at_10_hz()).unwrap();
    let clip = &mut recording.clip;
    assert_eq!((clip.n_points(), clip.has_speeds()), (80, true));
    assert!(
        !recording
            .notes
            .iter()
            .any(|n| n.contains("no point has a speed"))
    );
    let removed = clip.remove_static_clutter().unwrap();
    assert_eq!((removed.n_static, clip.n_points()), (80, 0));
    // Where the speeds are not known, nothing is known to be static.
    let bins = stream(Dialect::Sdk2, vec![one_point(Dialect::Sdk2); 40]);
    let mut clip = read(&bins, &at_10_hz()).unwrap().clip;
    assert!(!clip.has_speeds());
    assert_eq!(clip.remove_static_clutter(), None);
}

#[test]
fn objects_in_unknown_blocks_are_an_error_and_no_empty_room() {
    let bytes: Vec<u8> = (0..60)
        .flat_map(|n| {
            packet_of(
                Dialect::Sdk3,
                n,
                [8, 0],
                &[(4242, vec![1; 96]), (1040, vec![0; 136])],
            )
        })
        .collect();
    let error = read(&bytes, &at_10_hz()).err().unwrap();
    let text = error.to_string();
    for part in [
        "uart.dat: no point could be read from 60 packets",
        "480 objects",
        "4242 (60 times)",
        "1040 (vital signs, 60 times)",
    ] {
        assert!(text.contains(part), "{text}");
    }
    // With tracks there is somebody, whom the board states.
    let target = [words(&[3]), floats(&[0.5; 27])].concat();
    let bytes: Vec<u8> = (0..60)
        .flat_map(|n| {
            let tlvs = [(4242, vec![1; 96]), (1010, target.clone())];
            packet_of(Dialect::Sdk3, n, [8, 0], &tlvs)
        })
        .collect();
    let recording = read(&bytes, &at_10_hz()).unwrap();
    assert!(recording.clip.frames.iter().all(|f| f.board.is_some()));
    assert!(
        recording
            .warnings
            .iter()
            .any(|w| w.contains("4242 (60 times)"))
    );
}

#[test]
fn a_stated_dialect_that_does_not_fit_is_refused_or_warned_of_first() {
    let mut options = at_10_hz();
    options.points.dialect = Some(Dialect::PeopleCounting2d);
    let points = floats(&[2.0, 0.5, -0.25, -0.75, 200.0].repeat(8));
    let target = [words(&[1]), floats(&[0.5; 9])].concat();
    let bytes = stream(
        Dialect::Overhead3d,
        vec![vec![(6, points), (7, target.clone())]; 60],
    );
    let error = read(&bytes, &options).err().unwrap().to_string();
    assert!(error.contains("60 TLVs of wrong length"), "{error}");

    // Some payloads can be read as the stated dialect.
    let flat = floats(&[2.0, 0.1, 0.1, 99.0]);
    let tlvs = vec![(6, flat), (7, target.clone()), (7, target)];
    let bytes = stream(Dialect::PeopleCounting2d, vec![tlvs; 60]);
    let recording = read(&bytes, &options).unwrap();
    let first = &recording.warnings[0];
    assert!(
        first.starts_with("the dialect is probably another one: 120 blocks"),
        "{first}"
    );
}

#[test]
fn pieces_of_a_visualizer_are_checked_alike() {
    let folder = tempfile::tempdir().unwrap();
    let bytes: Vec<u8> = (0..60)
        .flat_map(|n| packet_of(Dialect::Sdk3, n, [8, 0], &[(4242, vec![1; 96])]))
        .collect();
    fs::write(folder.path().join("pHistBytes_1.bin"), &bytes[..3000]).unwrap();
    fs::write(folder.path().join("pHistBytes_2.bin"), &bytes[3000..]).unwrap();
    let read = || read_recording(&[folder.path().into()], &at_10_hz());
    let error = read().err().unwrap().to_string();
    assert!(error.contains("4242 (60 times)"), "{error}");
    let bytes = stream(Dialect::Sdk3, vec![Vec::new(); 60]);
    fs::write(folder.path().join("pHistBytes_1.bin"), &bytes[..3000]).unwrap();
    fs::write(folder.path().join("pHistBytes_2.bin"), &bytes[3000..]).unwrap();
    let recording = read().unwrap();
    assert_eq!(recording.clip.frames.len(), 60);
    assert!(recording.warnings.iter().any(|w| w.contains("is assumed")));
}

fn live(pty: &Pty, capture: CaptureOptions) -> TiBoard {
    TiBoard::open(TiBoardOptions {
        data: pty.path.clone(),
        cli: None,
        capture,
        timeouts: LiveTimeouts {
            lost: PATIENCE,
            ..LiveTimeouts::default()
        },
    })
    .unwrap()
}

/// Writes bytes packet by packet and returns the numbers of points of the frames that came.
fn frames_of(pty: &mut Pty, board: &mut TiBoard, packets: &[Vec<u8>]) -> Vec<usize> {
    let mut n_points = Vec::new();
    for packet in packets {
        assert!(pty.write(packet, &AtomicBool::new(false)));
        let end = Instant::now() + PATIENCE;
        while let Some(event) = board.next(Duration::from_millis(1)).unwrap() {
            match event {
                LiveEvent::Frame(frame) => n_points.push(frame.points.len()),
                other => panic!("{other:?}"),
            }
            assert!(Instant::now() < end);
        }
    }
    n_points
}

#[test]
fn live_waits_in_an_empty_room_and_sees_who_enters() {
    for dialect in [
        Dialect::Sdk3,
        Dialect::PeopleCounting2dCompact,
        Dialect::Sdk2,
    ] {
        let mut pty = Pty::new();
        let mut board = live(&pty, radar());
        let empty: Vec<Vec<u8>> = (0..100).map(|n| packet(dialect, n, &[])).collect();
        let n_points = frames_of(&mut pty, &mut board, &empty);
        assert!(n_points.len() >= 95, "{}", n_points.len());
        assert!(n_points.iter().all(|n| *n == 0));
        assert_eq!(board.problem(), None);
        let seen: Vec<Vec<u8>> = (100..140)
            .map(|n| packet(dialect, n, &one_point(dialect)))
            .collect();
        let n_points = frames_of(&mut pty, &mut board, &seen);
        assert!(
            n_points.iter().filter(|n| **n == 1).count() >= 35,
            "{n_points:?}"
        );
        assert_eq!((board.problem(), board.counts().lost_frames), (None, 0));
    }
}

#[test]
fn nothing_that_a_board_sends_ends_live() {
    let mut pty = Pty::new();
    let mut board = live(&pty, radar());
    // Packets of a demo that no dialect explains.
    let strange: Vec<Vec<u8>> = (0..300)
        .map(|n| {
            let mut bytes = MAGIC.to_vec();
            bytes.extend(words(&[0x0306_0000, 600, 0xA6843, n, 0, 3, 2, 2, 2]));
            bytes.resize(600, 0xAB);
            bytes
        })
        .collect();
    assert_eq!(
        frames_of(&mut pty, &mut board, &strange),
        Vec::<usize>::new()
    );
    let problem = board.problem().unwrap();
    assert!(problem.contains("is not clear"), "{problem}");
    // Somebody installs another one.
    let known: Vec<Vec<u8>> = (0..200)
        .map(|n| packet(Dialect::Sdk3, n, &one_point(Dialect::Sdk3)))
        .collect();
    let n_points = frames_of(&mut pty, &mut board, &known);
    assert!(n_points.iter().filter(|n| **n == 1).count() > 100);
    assert_eq!(board.problem(), None);
}

#[test]
fn live_names_blocks_that_it_does_not_know() {
    let mut pty = Pty::new();
    let mut board = live(&pty, radar());
    let unknown: Vec<Vec<u8>> = (0..100)
        .map(|n| packet_of(Dialect::Sdk3, n, [8, 0], &[(4242, vec![1; 96])]))
        .collect();
    frames_of(&mut pty, &mut board, &unknown);
    let problem = board.problem().unwrap();
    assert!(problem.contains("4242"), "{problem}");
    assert!(problem.contains("objects"), "{problem}");
}
