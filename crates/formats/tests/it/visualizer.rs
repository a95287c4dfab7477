//! Recordings of TI's visualizers, in JSON and in binary.

use radarllm_formats::{
    SensorPosition,
    recordings::{
        PiecesError, VisualizerBinaryError, VisualizerPart, join_parts, read_visualizer_binary,
        read_visualizer_json,
    },
    uart::{Dialect, UartError, recorded_frames},
};

use crate::make::{WALL_CFG, one_point, packet, replay, replay_frame, replay_of, stream};

const TRACKING: &str = "3D People Tracking";
const OUT_OF_BOX: &str = "x843 Out of Box Demo";

fn part(text: &str) -> VisualizerPart {
    read_visualizer_json(text).unwrap()
}

/// A file with one frame of these rows.
fn rows(demo: &str, device: &str, rows: &str) -> VisualizerPart {
    part(&replay_of(demo, device, &[replay_frame(3, rows)]))
}

#[test]
fn a_file_is_read_whole() {
    let part = part(&replay(41, 3));
    assert_eq!(part.cfg.as_deref(), Some(WALL_CFG));
    assert_eq!(part.demo.as_deref(), Some(TRACKING));
    assert_eq!(part.device.as_deref(), Some("xWR6843"));
    let numbers: Vec<u64> = part.frames.iter().map(|f| f.frame.number).collect();
    assert_eq!(numbers, [41, 42, 43]);
    let first = &part.frames[0];
    let stamp_s = first.frame.stamp_s.unwrap();
    assert!(
        (stamp_s - (1_700_000_000.000_5 + 41.0 * 0.055)).abs() < 1e-6,
        "{stamp_s}"
    );
    let p = first.frame.points[0];
    assert_eq!(
        [p.x_m, p.y_m, p.z_m, p.velocity_mps],
        [0.5, 3.0, 1.25, -0.5]
    );
    // A ratio of 100.
    assert_eq!(p.intensity_db, 20.0);
    assert_eq!(first.tracks[0].velocity_mps, [0.0, -0.5, 0.0]);
    assert_eq!(
        (first.heights[0].top_m, first.heights[0].bottom_m),
        (1.75, 0.25)
    );
    assert_eq!(part.counts, Default::default());
}

#[test]
fn what_is_absent_is_normal() {
    let entries = [
        "{\"frameData\": {\"error\": 0, \"frameNum\": 1}, \"timestamp\": 1.0}",
        "{\"frameData\": {\"frameNum\": 2, \"pointCloud\": null}}",
        "{\"frameData\": {\"error\": 3, \"frameNum\": 3.0, \"pointCloud\": [], \"more\": {\"a\": [1]}}, \"timestamp\": null}",
        "{\"frameData\": {}, \"timestamp\": 2}",
        "{\"timestamp\": 2}",
        "{}",
        "{\"frameData\": null}",
    ]
    .map(String::from);
    let part = part(&format!("{{\"data\": [{}]}}", entries.join(",")));
    assert_eq!(
        (part.cfg.as_ref(), part.demo.as_ref(), part.device.as_ref()),
        (None, None, None)
    );
    let frames: Vec<_> = part
        .frames
        .iter()
        .map(|f| (f.frame.number, f.frame.stamp_s))
        .collect();
    assert_eq!(frames, [(1, Some(0.001)), (2, None), (3, None)]);
    assert!(part.frames.iter().all(|f| f.frame.points.is_empty()));
    let recording = join_parts(vec![(1, part)]).unwrap();
    assert_eq!(
        recording.notes,
        [
            "1 frames are marked with an error and kept",
            "4 frames have no number (packets that the visualizer could not parse) and are dropped"
        ]
    );
    assert!(!recording.z_above_floor && recording.sensor_position.is_none());
    for empty in ["[]", "\"\"", "null", "[\"\", \" \\n\"]"] {
        let text = format!("{{\"cfg\": {empty}, \"demo\": \"\", \"data\": []}}");
        let part = read_visualizer_json(&text).unwrap();
        assert_eq!((part.cfg, part.demo), (None, None), "{empty}");
    }
    // A byte order mark, and a text instead of lines.
    let part = read_visualizer_json("\u{feff}{\"cfg\": \"a\\nb\", \"data\": []}").unwrap();
    assert_eq!(part.cfg.as_deref(), Some("a\nb"));
}

#[test]
fn snr_is_a_ratio_or_in_decibels_as_the_demo_sends_it() {
    let row = "[1, 2, 0, 0.5, 30, 5, 255]";
    let db = |demo, device| rows(demo, device, row).frames[0].frame.points[0].intensity_db;
    assert_eq!(db(OUT_OF_BOX, "xWR6843"), 30.0);
    assert_eq!(db(TRACKING, "xWRL6432"), 30.0);
    assert!((db(TRACKING, "xWR6843") - 14.771_213).abs() < 1e-5);
    // Zero has no decibels.
    let part = rows(TRACKING, "xWR1843", "[1, 2, 0, 0.5, 0, 5, 255]");
    assert_eq!(part.frames[0].frame.points[0].intensity_db, 0.0);
    assert_eq!(part.counts.points_without_snr, 1);
    // The demo may be named after the frames.
    let text = format!(
        "{{\"data\": [{}], \"demo\": \"{TRACKING}\"}}",
        replay_frame(1, row)
    );
    let part = read_visualizer_json(&text).unwrap();
    assert!(part.frames[0].frame.points[0].intensity_db < 15.0);
}

/// The same packet read from the port and from what a visualizer makes of it.
#[test]
fn points_are_those_of_the_uart_stream() {
    let payload = one_point(Dialect::PeopleCounting3d).swap_remove(0).1;
    let bytes: Vec<u8> = (1..4)
        .flat_map(|i| packet(Dialect::Sdk3, i, &[(1020, payload.clone())]))
        .collect();
    let binary = read_visualizer_binary(vec![(1, bytes)], None).unwrap();
    let from_uart = recorded_frames(binary.frames)[0].points[0];
    // Range 2 m, azimuth 30 and elevation 10 degrees, 0.5 m/s, SNR 0.1 x 1000.
    let (azimuth, elevation) = (30_f64.to_radians(), 10_f64.to_radians());
    let flat = 2.0 * elevation.cos();
    let row = format!(
        "[{}, {}, {}, 0.5, 100.0, 0.0, 255.0]",
        flat * azimuth.sin(),
        flat * azimuth.cos(),
        2.0 * elevation.sin()
    );
    let part = rows(TRACKING, "xWR6843", &row);
    let from_json = part.frames[0].frame.points[0];
    for (a, b) in [
        (from_uart.x_m, from_json.x_m),
        (from_uart.y_m, from_json.y_m),
        (from_uart.z_m, from_json.z_m),
        (from_uart.range_m, from_json.range_m),
        (from_uart.velocity_mps, from_json.velocity_mps),
        (from_uart.intensity_db, from_json.intensity_db),
    ] {
        assert!((a - b).abs() < 1e-5, "{from_uart:?} {from_json:?}");
    }
}

#[test]
fn what_is_not_finite_or_out_of_range_is_dropped_and_counted() {
    let text = replay_of(
        OUT_OF_BOX,
        "xWR6843",
        &[
            replay_frame(1, "[0, 0, 2.0, 0, 0, 0, 255], [1, 2, 0, 0, 30, 1, 255]"),
            replay_frame(2, "[1, 2, NaN, 0, 30, 1, 255], [1, -Infinity, 0, 0, Infinity, 1, 255]"),
            replay_frame(3, "[1, 2, 0, 1e9, 30, 1, 255], [1, 2, 0, 0, 1e4, 1, 255], [1, 2, 0, 0, 30, NaN, null]")
                .replace("\"error\": 0", "\"error\": 0, \"trackData\": [[NaN, 1, 2, 3, 4, 5, 6, 7, 8, 9]], \
                    \"heightData\": [[1.5, 1, 2]], \"text\": \"NaN \\\\\\\" Infinity\""),
        ],
    );
    let part = part(&text);
    let n: Vec<usize> = part.frames.iter().map(|f| f.frame.points.len()).collect();
    assert_eq!(n, [1, 0, 1]);
    let c = &part.counts;
    assert_eq!(
        (
            c.points_empty,
            c.points_not_finite,
            c.points_out_of_range,
            c.tracks_dropped
        ),
        (1, 2, 2, 2)
    );
    let notes = join_parts(vec![(1, part)]).unwrap().notes;
    assert_eq!(
        notes,
        [
            "2 tracks or heights are not finite or out of range and dropped",
            "points dropped: 2 not finite, 2 out of range; the first in row 0 of `pointCloud` of frame 1"
        ]
    );
}

#[test]
fn mistakes_are_named_with_frame_and_key() {
    let good = replay(1, 2);
    let point = "[0.5, 3.0, 1.25, -0.5, 100.0, 2.0, 255.0]";
    for (old, new, parts) in [
        (
            point,
            "[0.5, 3.0, 1.25]",
            &["length 3", "7 numbers in row 0 of `pointCloud` of frame 0"][..],
        ),
        (
            point,
            "[1, 2, 3, 4, 5, 6, 7, 8]",
            &["length 8", "7 numbers in row 0 of `pointCloud`"],
        ),
        (point, "[]", &["length 0", "row 0 of `pointCloud`"]),
        (
            point,
            "[0.5, \"far\", 1.25, -0.5, 100.0, 2.0, 255.0]",
            &[
                "string \"far\"",
                "a number in row 0 of `pointCloud` of frame 0",
            ],
        ),
        (
            point,
            "[0.5, [1], 1.25, -0.5, 100.0, 2.0, 255.0]",
            &["sequence", "row 0 of `pointCloud`"],
        ),
        (
            point,
            "[0.5, {}, 1.25, -0.5, 100.0, 2.0, 255.0]",
            &["map", "row 0 of `pointCloud`"],
        ),
        (
            point,
            "[0.5, true, 1.25, -0.5, 100.0, 2.0, 255.0]",
            &["boolean", "row 0 of `pointCloud`"],
        ),
        (point, "7", &["integer `7`", "row 0 of `pointCloud`"]),
        (
            "[[0.5, 3.0, 1.25, -0.5, 100.0, 2.0, 255.0]]",
            "\"none\"",
            &["string", "`pointCloud` of frame 0 as an array of rows"],
        ),
        (
            "[0, 1.75, 0.25]",
            "[0, 1.75]",
            &["length 2", "3 numbers in row 0 of `heightData` of frame 0"],
        ),
        (
            "[0, 0.5, 3, 1, 0, -0.5, 0, 0, 0, 0, 3.0, 0.9, 1]",
            "[0, 0.5]",
            &["at least 10 numbers in row 0 of `trackData` of frame 0"],
        ),
        (
            "\"frameNum\": 2",
            "\"frameNum\": -2",
            &[
                "`-2.0`",
                "a whole number from 0 to",
                "`frameNum` of frame 1",
            ],
        ),
        (
            "\"frameNum\": 2",
            "\"frameNum\": 2.5",
            &["`2.5`", "`frameNum` of frame 1"],
        ),
        (
            "\"frameNum\": 2",
            "\"frameNum\": \"2\"",
            &["string", "`frameNum` of frame 1"],
        ),
        (
            "\"frameNum\": 2",
            "\"frameNum\": 1e300",
            &["`frameNum` of frame 1"],
        ),
        ("\"frameNum\": 2", "\"frameNum\": 1e999", &["out of range"]),
        (
            "\"error\": 0",
            "\"error\": \"no\"",
            &["string", "`error` of frame 0"],
        ),
        (
            "\"timestamp\": ",
            "\"timestamp\": \"noon\", \"x\": ",
            &["string", "`timestamp` of frame 0"],
        ),
        (
            "\"timestamp\": ",
            "\"timestamp\": -1, \"x\": ",
            &["`-1.0`", "`timestamp` of frame 0"],
        ),
        (
            "\"timestamp\": ",
            "\"timestamp\": 1e20, \"x\": ",
            &["`timestamp` of frame 0"],
        ),
        (
            "\"frameData\": ",
            "\"frameData\": 5, \"x\": ",
            &["integer `5`", "`frameData` of frame 0 as an object"],
        ),
        (
            "\"demo\": \"3D People Tracking\"",
            "\"demo\": 3",
            &["integer `3`", "`demo`"],
        ),
        (
            "\"cfg\": ",
            "\"cfg\": 7, \"x\": ",
            &["integer `7`", "`cfg` as a text or an array of lines"],
        ),
        ("\"cfg\": ", "\"cfg\": [7], \"x\": ", &["integer `7`"]),
        (
            "\"data\": ",
            "\"data\": {}, \"x\": ",
            &["map", "`data` as an array of frames"],
        ),
        ("\"data\": ", "\"frames\": ", &["with `data`"]),
        ("-0.5, 100.0", "-NaN, 100.0", &["line 5"]),
    ] {
        let text = good.replace(old, new);
        assert_ne!(text, good, "{old}");
        let error = read_visualizer_json(&text).unwrap_err().to_string();
        for part in parts {
            assert!(error.contains(part), "{new}: {error}");
        }
        assert!(error.len() < 200 && !error.contains('\n'), "{error}");
    }
    for (text, part) in [
        ("", "EOF"),
        ("[]", "an object with `data`"),
        ("[[[[[", "an object with `data`"),
        ("{\"data\": []} x", "line 1"),
        ("{\"data\": [", "EOF"),
        ("\u{1b}[31m", "line 1"),
    ] {
        let error = read_visualizer_json(text).unwrap_err().to_string();
        assert!(error.contains(part) && !error.contains('\u{1b}'), "{error}");
    }
    assert!(read_visualizer_json(&"[".repeat(1 << 20)).is_err());
    assert!(read_visualizer_json(&format!("{{\"x\": {}", "[".repeat(1 << 20))).is_err());
    let many = format!(
        "{{\"data\": [{}]}}",
        vec!["{\"frameData\":{\"frameNum\":1}}"; 200_002].join(",")
    );
    let error = read_visualizer_json(&many).unwrap_err().to_string();
    assert!(error.contains("at most 200000"), "{error}");
}

#[test]
fn every_truncation_is_an_error() {
    let text = replay(1, 2);
    for end in 0..text.len() {
        assert!(read_visualizer_json(&text[..end]).is_err(), "{end}");
    }
}

#[test]
fn files_follow_by_number_and_gaps_are_named() {
    let parts = vec![
        (10, part(&replay(901, 3))),
        (2, part(&replay(104, 3))),
        (1, part(&replay(101, 3))),
    ];
    let recording = join_parts(parts).unwrap();
    let numbers: Vec<u64> = recording.frames.iter().map(|f| f.frame.number).collect();
    assert_eq!(numbers, [101, 102, 103, 104, 105, 106, 901, 902, 903]);
    assert_eq!(
        recording.notes,
        ["missing pieces of the recording: replay_3.json to replay_9.json"]
    );
    assert_eq!(join_parts(Vec::new()).unwrap_err(), PiecesError::Empty);
    let twice = vec![(1, part(&replay(1, 1))), (1, part(&replay(2, 1)))];
    assert_eq!(join_parts(twice).unwrap_err(), PiecesError::SameNumber(1));
}

#[test]
fn files_of_several_recordings_are_refused() {
    let good = replay(101, 3);
    for (old, new, key) in [
        ("sensorPosition 2", "sensorPosition 3", "`cfg`"),
        (TRACKING, OUT_OF_BOX, "`demo`"),
        ("xWR6843", "xWR1843", "`device`"),
    ] {
        let parts = vec![
            (12, part(&good.replace(old, new))),
            (3, part(&good)),
            (5, part(&good)),
        ];
        let error = join_parts(parts).unwrap_err().to_string();
        let expected = format!("{key} of replay_3.json and of replay_12.json differ");
        assert!(error.contains(&expected), "{error}");
    }
    // A file that does not say is no other recording.
    let silent = format!("{{\"data\": [{}]}}", replay_frame(104, ""));
    let recording = join_parts(vec![(1, part(&good)), (2, part(&silent))]).unwrap();
    assert_eq!(recording.frames.len(), 4);
    assert_eq!(recording.demo.as_deref(), Some(TRACKING));
}

#[test]
fn frames_of_the_run_before_are_dropped() {
    let entries = [5000, 5001, 1, 2, 3].map(|n| replay_frame(n, ""));
    let first = part(&replay_of(TRACKING, "xWR6843", &entries));
    let recording = join_parts(vec![(1, first), (2, part(&replay(4, 2)))]).unwrap();
    let numbers: Vec<u64> = recording.frames.iter().map(|f| f.frame.number).collect();
    assert_eq!(numbers, [1, 2, 3, 4, 5]);
    assert!(recording.notes[0].starts_with("2 frames at the start (numbers 5000 to 5001)"));
}

#[test]
fn files_that_repeat_those_before_them_are_used_once() {
    let parts = vec![
        (1, part(&replay(1, 100))),
        (2, part(&replay(1, 200))),
        (3, part(&replay(1, 300))),
    ];
    let recording = join_parts(parts).unwrap();
    assert_eq!(recording.frames.len(), 300);
    assert_eq!(
        recording.notes,
        ["2 files start with all frames of those before them: every frame is used once"]
    );
}

#[test]
fn height_and_tilt_are_those_of_the_chirp_file() {
    let mut recording = join_parts(vec![(1, part(&replay(1, 3)))]).unwrap();
    let position = recording.sensor_position.unwrap();
    assert_eq!(
        Some(position),
        SensorPosition::from_ti_cfg(WALL_CFG).unwrap()
    );
    assert!(recording.z_above_floor);
    recording.lower(position.height_m);
    let p = recording.frames[0].frame.points[0];
    assert_eq!(p.z_m, -0.75);
    assert!((p.range_m - (0.25_f32 + 9.0 + 0.5625).sqrt()).abs() < 1e-6);
    assert!(!recording.z_above_floor);
    // Once only.
    recording.lower(position.height_m);
    assert_eq!(recording.frames[0].frame.points[0].z_m, -0.75);

    // The out-of-box demo leaves points in the sensor's axes.
    let text = replay(1, 3);
    let join = |text: String| join_parts(vec![(1, part(&text))]).unwrap();
    let sensor = join(text.replace(TRACKING, OUT_OF_BOX));
    assert!(!sensor.z_above_floor && sensor.sensor_position == Some(position));
    // Without a height in the chirp file the visualizer raises nothing.
    assert!(!join(text.replace("sensorPosition 2 0 15", "sensorPosition 0 0 15")).z_above_floor);
    assert!(!join(text.replace("sensorPosition 2 0 15", "")).z_above_floor);
    // Without the chirp file it is not known by how much.
    let unknown = join(text.replace("\"cfg\": ", "\"other\": "));
    assert!(unknown.z_above_floor && unknown.sensor_position.is_none());
    assert!(
        unknown.notes[0].contains("which is not stored"),
        "{:?}",
        unknown.notes
    );
    // A line that cannot be read is named.
    let broken = join(text.replace("sensorPosition 2 0 15", "sensorPosition two"));
    assert!(
        broken.notes[0].starts_with("`cfg`: line 12"),
        "{:?}",
        broken.notes
    );
}

/// The last frame of a file is saved before the display turns and raises it.
#[test]
fn last_frames_that_were_not_raised_are_raised() {
    let position = SensorPosition::from_ti_cfg(WALL_CFG).unwrap().unwrap();
    let row = |[x, y, z]: [f64; 3]| format!("[{x}, {y}, {z}, 0.1, 50, 0, 255]");
    // A person's points in the sensor's axes, and as the display has them.
    let raw = [[0.1, 3.0, 0.4], [0.0, 3.1, 0.1], [0.2, 3.0, -0.3]];
    let shown = raw.map(|p| {
        let [x, y, z] = position.mounting().level(p);
        [x, y, z + 2.0]
    });
    let file = |first: u32, last_is_raw: bool| {
        let entries: Vec<String> = (0..5)
            .map(|i| {
                let points = if i == 4 && last_is_raw { raw } else { shown };
                replay_frame(first + i, &points.map(row).join(","))
            })
            .collect();
        part(&replay_of(TRACKING, "xWR6843", &entries))
    };
    let joined = join_parts(vec![
        (1, file(1, true)),
        (2, file(6, false)),
        (3, file(11, true)),
    ])
    .unwrap();
    assert!(
        joined.notes[0].starts_with("2 files were saved before"),
        "{:?}",
        joined.notes
    );
    for frame in &joined.frames {
        for (p, [x, y, z]) in frame.frame.points.iter().zip(shown) {
            for (a, b) in [(p.x_m, x), (p.y_m, y), (p.z_m, z)] {
                assert!((f64::from(a) - b).abs() < 1e-5, "{p:?}");
            }
        }
    }
    let joined = join_parts(vec![(1, file(1, false))]).unwrap();
    assert!(joined.notes.is_empty());
}

#[test]
fn pieces_of_a_stream_are_joined_by_number() {
    let whole = stream(Dialect::Sdk3, 30);
    // Pieces that end within packets, listed in the order of text: 1, 10, 11, ..., 2, ...
    let mut pieces: Vec<(u64, Vec<u8>)> = whole
        .chunks(101)
        .enumerate()
        .map(|(i, c)| (i as u64 + 1, c.to_vec()))
        .collect();
    pieces.sort_by_key(|(n, _)| n.to_string());
    let read = read_visualizer_binary(pieces.clone(), None).unwrap();
    assert_eq!(read.report.packets, 30);
    assert_eq!(read.report.short_packets, 0);
    assert!(read.notes.is_empty() && read.guess.is_some());
    let direct = read_visualizer_binary(vec![(1, whole)], Some(Dialect::Sdk3)).unwrap();
    assert_eq!(read.frames, direct.frames);
    assert!(direct.guess.is_none());

    pieces.retain(|(n, _)| *n != 5);
    let read = read_visualizer_binary(pieces, None).unwrap();
    assert_eq!(
        read.notes,
        ["missing pieces of the recording: pHistBytes_5.bin"]
    );
    assert!(read.report.packets < 30);
}

#[test]
fn left_over_and_short_packets_of_a_stream_are_counted() {
    let point = one_point(Dialect::Sdk3);
    let packets = |numbers: std::ops::Range<u32>| -> Vec<u8> {
        numbers
            .flat_map(|n| packet(Dialect::Sdk3, n, &point))
            .collect()
    };
    let mut first = packets(700..702);
    first.extend(packets(1..5));
    // A packet that the next one cuts short.
    let mut second = packets(5..6);
    second.truncate(second.len() - 20);
    second.extend(packets(6..9));
    let read = read_visualizer_binary(vec![(2, second), (1, first)], None).unwrap();
    let numbers: Vec<u32> = read.frames.iter().map(|f| f.number).collect();
    assert_eq!(numbers, [1, 2, 3, 4, 5, 6, 7, 8]);
    assert_eq!(
        (
            read.report.packets,
            read.report.short_packets,
            read.report.restarts
        ),
        (9, 1, 1)
    );
    assert_eq!(recorded_frames(read.frames).len(), 7);
    assert!(
        read.notes[0].starts_with("2 frames at the start (numbers 700 to 701)"),
        "{:?}",
        read.notes
    );

    assert_eq!(
        read_visualizer_binary(Vec::<(u64, Vec<u8>)>::new(), None).unwrap_err(),
        VisualizerBinaryError::Pieces(PiecesError::Empty)
    );
    assert_eq!(
        read_visualizer_binary(vec![(1, b"nothing")], None).unwrap_err(),
        VisualizerBinaryError::Uart(UartError::NoPacket(7))
    );
}
