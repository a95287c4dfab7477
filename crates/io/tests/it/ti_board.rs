//! Boards of TI: the frames of the file, answers of the command line, unplugging, silence.

use std::{
    fs,
    path::Path,
    sync::atomic::AtomicBool,
    thread,
    time::{Duration, Instant},
};

use radarllm_base::PointFrame;
use radarllm_formats::{Mounting, uart::Dialect};
use radarllm_io::{
    CaptureFormat, CaptureOptions, PointOptions,
    live::{LiveEvent, LiveSource as _, LiveTimeouts, TiBoard, TiBoardOptions},
    open_radar, open_radar_text, read_recording,
};

use crate::{
    events::{PATIENCE, event, frame, frames_until_lost, lost},
    fake_board::{Behaviour, FakeBoard, Pty},
    make_uart,
};

const CFG: &str = "% a board on the wall\nsensorStop\nflushCfg\n\nchannelCfg 15 7 0\nadcCfg 2 1\n\
    profileCfg 0 60.25 350 6 58 0 0 60 1 224 4500 0 0 30 % one profile\nchirpCfg 0 0 0 0 0 0 0 1\n\
    chirpCfg 1 1 0 0 0 0 0 4\nchirpCfg 2 2 0 0 0 0 0 2\nframeCfg 0 2 16 0 100 1 0\nsensorPosition 1.8 0 15\nsensorStart\n";
const N_COMMANDS: usize = 11;

/// Times that let a test wait for one event without waiting for the others.
fn patient() -> LiveTimeouts {
    LiveTimeouts {
        answer: PATIENCE,
        send_again: PATIENCE,
        lost: PATIENCE,
        reopen_first: Duration::from_millis(5),
        reopen_max: Duration::from_millis(40),
    }
}

fn capture() -> CaptureOptions {
    CaptureOptions {
        radar: Some(open_radar_text(Path::new("wall.cfg"), CFG).unwrap()),
        ..CaptureOptions::default()
    }
}

fn board_on(fake: &FakeBoard, timeouts: LiveTimeouts) -> radarllm_io::Result<TiBoard> {
    TiBoard::open(TiBoardOptions {
        data: fake.data.clone(),
        cli: Some(fake.cli.clone()),
        capture: capture(),
        timeouts,
    })
}

/// A board of which only the data port is used.
fn open_data_port(pty: &Pty, capture: CaptureOptions) -> TiBoard {
    let options = TiBoardOptions {
        data: pty.path.clone(),
        cli: None,
        capture,
        timeouts: patient(),
    };
    TiBoard::open(options).unwrap()
}

fn file_frames(bytes: &[u8], options: &CaptureOptions) -> Vec<PointFrame> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("uart.dat");
    fs::write(&path, bytes).unwrap();
    let options = CaptureOptions {
        format: Some(CaptureFormat::from_name("uart").unwrap()),
        ..options.clone()
    };
    read_recording(&[path], &options).unwrap().clip.frames
}

/// 41 packets with everything that happens on a cable: foreign bytes, truncated packets, damaged headers, lost frames.
fn rough_stream(dialect: Dialect) -> Vec<u8> {
    let mut bytes = b"leftovers of an earlier run".to_vec();
    for n in 0..40 {
        let number = if n < 20 { 100 + n } else { 107 + n };
        let mut packet = make_uart::packet(dialect, number, &make_uart::one_point(dialect));
        match n {
            11 => packet.truncate(dialect.header_len() + 5),
            15 => bytes.extend([0xFF; 77]),
            18 => packet.truncate(20),
            // The length of the packet: more than any has.
            23 => packet[12..24].fill(0xEE),
            30 => bytes.extend(&radarllm_formats::uart::MAGIC[..5]),
            _ => {}
        }
        bytes.extend(packet);
    }
    // Ends the packet before, so that nothing waits for more bytes.
    bytes.extend(make_uart::packet(dialect, 147, &[]));
    bytes
}

#[test]
fn pieces_of_any_size_give_the_frames_of_the_file() {
    for (i, dialect) in Dialect::ALL.into_iter().enumerate() {
        let bytes = rough_stream(dialect);
        let mut options = capture();
        options.points = PointOptions {
            accumulate: 1 + i % 3,
            motion_compensate: i % 2 == 0,
            mounting: match i {
                0 => Mounting {
                    tilt_rad: 0.2,
                    yaw_rad: -0.1,
                    roll_rad: 0.3,
                },
                _ => Mounting::default(),
            },
            ..PointOptions::default()
        };
        let expected = file_frames(&bytes, &options);
        assert!(expected.len() > 30 && expected.iter().any(|f| !f.points.is_empty()));

        let mut pty = Pty::new();
        let mut board = open_data_port(&pty, options);
        let sent = bytes.clone();
        let writer = thread::spawn(move || {
            let mut state = 7_u32 + i as u32;
            let mut rest = &sent[..];
            while !rest.is_empty() {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let n = (1 + (state >> 24) as usize % 200).min(rest.len());
                assert!(pty.write(&rest[..n], &AtomicBool::new(false)));
                rest = &rest[n..];
            }
            pty
        });
        let found: Vec<PointFrame> = expected.iter().map(|_| frame(&mut board)).collect();
        assert_eq!(found, expected, "{}", dialect.name());
        let counts = board.counts();
        assert_eq!(counts.frames, expected.len() as u64);
        assert_eq!(counts.lost_frames, 7 + 3);
        assert_eq!(counts.resynchronisations, 5);
        assert_eq!(board.notes().len(), 2, "mounting and dialect");
        // Unplugged.
        drop(writer.join().unwrap());
        assert!(lost(&mut board).contains("/dev/pts/"));
    }
}

/// Every hundredth byte or so is wrong: lengths, types, numbers, points.
#[test]
fn damaged_packets_move_no_other_frame() {
    let dialect = Dialect::Sdk3;
    let n_packets = 400;
    let mut state = 3_u32;
    let mut random = move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 16) as usize
    };
    let mut bytes = make_uart::stream(dialect, n_packets);
    let mut at = random() % 200;
    while at < bytes.len() {
        bytes[at] ^= 1 << (random() % 8);
        at += 1 + random() % 200;
    }
    let mut pty = Pty::new();
    let mut options = capture();
    options.points.dialect = Some(dialect);
    let mut board = open_data_port(&pty, options);
    let writer = thread::spawn(move || {
        assert!(pty.write(&bytes, &AtomicBool::new(false)));
        pty
    });
    let end = Instant::now() + PATIENCE;
    let mut numbers: Vec<u32> = Vec::new();
    loop {
        assert!(Instant::now() < end);
        let is_written = writer.is_finished();
        match board.next(Duration::from_millis(50)).unwrap() {
            Some(LiveEvent::Frame(frame)) => numbers.push(frame.frame),
            Some(other) => panic!("{other:?}"),
            None if is_written => break,
            None => {}
        }
    }
    assert!(numbers.windows(2).all(|w| w[0] < w[1]), "{numbers:?}");
    assert!(numbers.len() > 150, "{}", numbers.len());
    assert!(numbers.iter().all(|n| *n < n_packets + 50), "{numbers:?}");
    let counts = board.counts();
    assert_eq!(counts.frames, numbers.len() as u64);
    assert!(counts.resynchronisations > 20, "{counts:?}");
    drop(writer.join().unwrap());
}

#[test]
fn short_streams_are_read_when_they_end() {
    let mut pty = Pty::new();
    let bytes = make_uart::stream(Dialect::Sdk3, 3);
    assert!(pty.write(&bytes, &AtomicBool::new(false)));
    // Without a chirp file, a frame waits for its sub-frames.
    let options = CaptureOptions {
        radar: Some(open_radar("awr1843boost").unwrap()),
        ..CaptureOptions::default()
    };
    let mut board = TiBoard::open(TiBoardOptions {
        data: pty.path.clone(),
        cli: None,
        capture: options.clone(),
        timeouts: LiveTimeouts {
            lost: Duration::from_millis(300),
            ..patient()
        },
    })
    .unwrap();
    assert!(board.next(Duration::ZERO).unwrap().is_none());
    let (frames, reason) = frames_until_lost(&mut board);
    assert_eq!(frames, file_frames(&bytes, &options));
    assert!(reason.contains("sent nothing for 0.3 s"), "{reason}");
    let about = board.about();
    assert_eq!(about.radar, "awr1843boost");
    assert_eq!(
        about.provenance.to_string(),
        format!("recorded:uart:{}", pty.path.display())
    );
    assert!((about.frame_period_s - 0.1).abs() < 1e-9);
}

#[test]
fn the_chirp_file_is_sent_line_by_line() {
    let fake = FakeBoard::new(Behaviour::default());
    let mut board = board_on(&fake, patient()).unwrap();
    for n in 0..20 {
        assert_eq!(frame(&mut board).frame, n);
    }
    let commands = fake.commands();
    assert_eq!(commands.len(), N_COMMANDS);
    assert_eq!(commands[0], "sensorStop");
    assert_eq!(
        commands[4],
        "profileCfg 0 60.25 350 6 58 0 0 60 1 224 4500 0 0 30"
    );
    assert_eq!(board.about().radar_height_m, 1.8);
}

#[test]
fn a_refused_line_is_named_with_the_words_of_the_board() {
    let fake = FakeBoard::new(Behaviour {
        answer: |command, _| match command {
            "channelCfg 15 7 0" => format!(
                "{command}\r\nError: Invalid usage of the CLI command\r\nError -1\r\nmmwDemo:/>"
            ),
            _ => format!("{command}\r\nDone\n\rmmwDemo:/>"),
        },
        ..Behaviour::default()
    });
    let error = board_on(&fake, patient()).err().unwrap();
    let expected = format!(
        "{}: line 5 of the chirp file, `channelCfg 15 7 0`: Error: Invalid usage of the CLI command; Error -1",
        fake.cli.display()
    );
    assert_eq!(error.to_string(), expected);
    assert!(error.hint.is_some());
    assert_eq!(fake.commands().len(), 3);

    // A board that does not answer, and one that says something else.
    let impatient = LiveTimeouts {
        answer: Duration::from_millis(200),
        ..patient()
    };
    for (answer, words) in [
        (
            (|_, _| String::new()) as fn(&str, usize) -> String,
            "no answer in 0.2 s",
        ),
        (
            |_, _| "Booting\r\n".into(),
            "no `Done` in 0.2 s, but `Booting`",
        ),
    ] {
        let fake = FakeBoard::new(Behaviour {
            answer,
            ..Behaviour::default()
        });
        let error = board_on(&fake, impatient).err().unwrap();
        let text = format!("line 2 of the chirp file, `sensorStop`: {words}");
        assert!(error.to_string().contains(&text), "{error}");
    }
}

#[test]
fn a_board_that_is_unplugged_ten_times_comes_back_ten_times() {
    let folder = tempfile::tempdir().unwrap();
    let mut fake = FakeBoard::new(Behaviour::default());
    fake.plug_into(folder.path());
    let mut board = TiBoard::open(TiBoardOptions {
        data: folder.path().join("data"),
        cli: Some(folder.path().join("cli")),
        capture: capture(),
        timeouts: patient(),
    })
    .unwrap();
    let mut numbers: Vec<u32> = (0..20).map(|_| frame(&mut board).frame).collect();
    for round in 0..10 {
        // The names disappear first, because the system gives the numbers of its pseudo-terminals to other tests.
        for name in ["data", "cli"] {
            fs::remove_file(folder.path().join(name)).unwrap();
        }
        drop(fake);
        lost(&mut board);
        // Nothing to open: the source goes on trying.
        assert!(board.next(Duration::from_millis(30)).unwrap().is_none());
        let refuses = round == 4;
        fake = FakeBoard::new(Behaviour {
            answer: match refuses {
                true => |command, n| match (command, n) {
                    ("sensorStop", 0) => "Error -1\r\nmmwDemo:/>".into(),
                    _ => format!("{command}\r\nDone\n\rmmwDemo:/>"),
                },
                false => Behaviour::default().answer,
            },
            ..Behaviour::default()
        });
        fake.plug_into(folder.path());
        assert_eq!(event(&mut board), LiveEvent::Back);
        numbers.extend((0..20).map(|_| frame(&mut board).frame));
        let n_refused = usize::from(refuses);
        assert_eq!(fake.commands().len(), N_COMMANDS + n_refused);
        let counts = board.counts();
        assert_eq!(counts.reconnects, round + 1);
        assert_eq!(counts.refused_lines, u64::from(round >= 4));
    }
    assert!(numbers.windows(2).all(|w| w[0] < w[1]), "{numbers:?}");
    assert_eq!(board.counts().frames, 220);
    // Within a connection nothing is lost.
    assert!(numbers.chunks(20).all(|c| c[19] == c[0] + 19));
    assert_eq!(board.counts().lost_frames, 0);
}

#[test]
fn a_silent_board_gets_the_chirp_file_again_and_is_lost_if_that_does_not_help() {
    // It sends 20 packets after each `sensorStart`, so the silence ends with the second file.
    let fake = FakeBoard::new(Behaviour::default());
    let mut board = board_on(
        &fake,
        LiveTimeouts {
            send_again: Duration::from_millis(100),
            ..patient()
        },
    )
    .unwrap();
    let numbers: Vec<u32> = (0..40).map(|_| frame(&mut board).frame).collect();
    assert!(numbers.windows(2).all(|w| w[0] < w[1]), "{numbers:?}");
    assert!(fake.commands().len() >= 2 * N_COMMANDS);
    assert_eq!(board.counts().reconnects, 0);

    // It starts only with the second file: lost, and back.
    let fake = FakeBoard::new(Behaviour {
        answer: |command, n| match (command, n) {
            ("sensorStart", 0 | 1) => "Ignored\r\nDone\r\n".into(),
            _ => "Done\r\n".into(),
        },
        n_packets: 0,
        ..Behaviour::default()
    });
    let mut board = board_on(
        &fake,
        LiveTimeouts {
            send_again: Duration::from_millis(50),
            lost: Duration::from_millis(150),
            ..patient()
        },
    )
    .unwrap();
    assert!(lost(&mut board).contains("sent nothing for 0.15 s"));
    // Sent when opened, when silent, and after it was opened again; the loss is told once.
    let end = Instant::now() + PATIENCE;
    while fake.commands().len() < 4 * N_COMMANDS && Instant::now() < end {
        assert_eq!(board.next(Duration::from_millis(20)).unwrap(), None);
    }
    assert!(fake.commands().len() >= 4 * N_COMMANDS);
    assert_eq!(board.counts().reconnects, 0);
}

#[test]
fn a_busy_caller_is_no_silence() {
    let mut pty = Pty::new();
    let mut board = TiBoard::open(TiBoardOptions {
        data: pty.path.clone(),
        cli: None,
        capture: capture(),
        timeouts: LiveTimeouts {
            lost: Duration::from_millis(1200),
            ..patient()
        },
    })
    .unwrap();
    // Half a packet, a caller that is busy for longer than the board may be silent, and the rest.
    let bytes = make_uart::stream(Dialect::Sdk3, 12);
    assert!(pty.write(&bytes[..500], &AtomicBool::new(false)));
    assert_eq!(board.next(Duration::from_millis(20)).unwrap(), None);
    assert!(pty.write(&bytes[500..510], &AtomicBool::new(false)));
    thread::sleep(Duration::from_millis(1500));
    assert_eq!(board.next(Duration::from_millis(20)).unwrap(), None);
    assert!(pty.write(&bytes[510..], &AtomicBool::new(false)));
    let numbers: Vec<u32> = (0..12).map(|_| frame(&mut board).frame).collect();
    assert_eq!(numbers, (0..12).collect::<Vec<u32>>());
}

#[test]
fn bytes_without_a_packet_hint_at_the_baud_rate() {
    let mut pty = Pty::new();
    assert!(pty.write(&[0x55; 3000], &AtomicBool::new(false)));
    let mut board = TiBoard::open(TiBoardOptions {
        data: pty.path.clone(),
        cli: None,
        capture: capture(),
        timeouts: LiveTimeouts {
            lost: Duration::from_millis(200),
            ..patient()
        },
    })
    .unwrap();
    let reason = lost(&mut board);
    assert!(reason.contains("3000 bytes and no packet"), "{reason}");
    assert!(reason.contains("921600"), "{reason}");
}

#[test]
fn ports_and_options_that_cannot_work_are_refused() {
    let pty = Pty::new();
    let open = |cli: Option<&Path>, capture: CaptureOptions| {
        let refused = TiBoard::open(TiBoardOptions {
            data: pty.path.clone(),
            cli: cli.map(Path::to_path_buf),
            capture,
            timeouts: patient(),
        });
        refused.err().unwrap().to_string()
    };
    let no_radar = CaptureOptions::default();
    assert!(open(None, no_radar).contains("no clock"));
    let built_in = CaptureOptions {
        radar: Some(open_radar("awr1843boost").unwrap()),
        ..CaptureOptions::default()
    };
    assert!(open(Some(Path::new("/dev/null")), built_in).contains("no chirp file"));
    assert!(open(Some(&pty.path), capture()).contains("both"));
    let seconds = CaptureOptions {
        points: PointOptions {
            seconds: Some(3.0),
            ..PointOptions::default()
        },
        ..capture()
    };
    assert!(open(None, seconds).contains("`seconds`"));
    let missing = TiBoard::open(TiBoardOptions {
        data: "/dev/no-such-port".into(),
        capture: capture(),
        ..TiBoardOptions::default()
    });
    let error = missing.err().unwrap();
    assert_eq!(error.kind, radarllm_io::ErrorKind::NotFound);
}
