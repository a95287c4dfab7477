//! Recordings of TI's visualizers, in JSON and in binary.

use radarllm_formats::{
    SensorPosition,
    recordings::{
        PiecesError, VisualizerBinaryError, VisualizerPart, join_parts, join_run,
        read_visualizer_binary, read_visualizer_binary_run, read_visualizer_json,
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
            "1 points are zero in every number (the visualizer did not parse them) and are dropped",
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

    // Demos without a view in three dimensions leave points in the sensor's axes; all others level them.
    let text = replay(1, 3);
    let join = |text: String| join_parts(vec![(1, part(&text))]).unwrap();
    let sensor = join(text.replace(TRACKING, "Intruder Detection"));
    assert!(!sensor.z_above_floor && sensor.sensor_position == Some(position));
    for demo in [
        OUT_OF_BOX,
        "Long Range People Detection",
        "3D People Tracking 6844",
    ] {
        let shown = join(text.replace(TRACKING, demo));
        assert!(shown.z_above_floor, "{demo}");
        assert!(!shown.warnings.iter().any(|w| w.contains("not known")));
    }
    // Without a height and a tilt in the chirp file, the visualizer raises and turns nothing; without a height it turns.
    let with = |line: &str| join(text.replace("sensorPosition 2 0 15", line)).z_above_floor;
    assert!(with("sensorPosition 0 0 15") && with("sensorPosition 0 10 0"));
    assert!(!with("sensorPosition 0 0 0") && !with(""));
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

/// What the visualizer stores for people tracking on the xWRL6844: two clouds a frame, turned and raised.
#[test]
fn points_of_slow_motion_are_read_and_lowered_with_the_others() {
    let position = SensorPosition::from_ti_cfg(WALL_CFG).unwrap().unwrap();
    let shown = |p| {
        let [x, y, z] = position.mounting().level(p);
        [x, y, z + 2.0]
    };
    let row = |[x, y, z]: [f64; 3], motion: u8| {
        let [x, y, z] = shown([x, y, z]);
        format!("[{x}, {y}, {z}, 0.1, 100, {motion}, 255]")
    };
    let (major, minor) = ([0.5, 3.0, 0.25], [-0.5, 2.0, -0.5]);
    let entry = replay_frame(1, &row(major, 0)).replace(
        "\"numDetectedPoints\"",
        &format!(
            "\"pointCloudMinor\": [{}, [0, 0, 2, 0, 0, 0, 255]], \"numDetectedPoints\"",
            row(minor, 1)
        ),
    );
    let text = replay_of("3D People Tracking 6844", "xWRL6844", &[entry]);
    let mut recording = join_parts(vec![(1, part(&text))]).unwrap();
    assert_eq!(
        recording.notes,
        [
            "1 points are zero in every number (the visualizer did not parse them) and are dropped",
            "1 points are of slow motion (`pointCloudMinor`) and kept with the others"
        ]
    );
    assert!(recording.warnings.is_empty(), "{:?}", recording.warnings);
    recording.lower(2.0);
    let points = &recording.frames[0].frame.points;
    assert_eq!(points.len(), 2);
    for (p, sensor) in points.iter().zip([major, minor]) {
        let [x, y, z] = position.mounting().level(sensor);
        for (a, b) in [(p.x_m, x), (p.y_m, y), (p.z_m, z)] {
            assert!((f64::from(a) - b).abs() < 1e-6, "{p:?}");
        }
        // A ratio of 100.
        assert_eq!(p.intensity_db, 20.0);
    }
}

#[test]
fn demos_that_are_not_known_are_named_with_what_is_assumed() {
    let join = |demo: &str, rows: &str| {
        let entries = [replay_frame(1, rows), replay_frame(2, "")];
        join_parts(vec![(1, part(&replay_of(demo, "xWR6843", &entries)))]).unwrap()
    };
    let db = |recording: &radarllm_formats::recordings::VisualizerRecording| {
        recording.frames[0].frame.points[0].intensity_db
    };
    // No noise: compressed points, whose SNR is a ratio.
    let ratio = join("People of Tomorrow", "[1, 2, 3, 0.5, 100, 0, 255]");
    assert_eq!(
        ratio.warnings,
        [
            "the demo `People of Tomorrow` is not known: its points are taken as turned and raised by the visualizer \
          (sensorPosition: 2 m high), and the SNR as a ratio, because no noise is stored beside it"
        ]
    );
    assert!(ratio.z_above_floor);
    assert_eq!(db(&ratio), 20.0);
    let decibels = join("People of Tomorrow", "[1, 2, 3, 0.5, 30, 5, 255]");
    assert!(decibels.warnings[0].ends_with("the SNR as dB, because noise is stored beside it"));
    assert_eq!(db(&decibels), 30.0);
    let high = join("People of Tomorrow", "[1, 2, 3, 0.5, 1000, 5, 255]");
    assert!(high.warnings[0].ends_with("a ratio, because its median would be too high for dB"));
    assert_eq!(db(&high), 30.0);
    // The unit is decided for the whole recording.
    let text = |rows: &str, n| replay_of("New", "xWR6843", &[replay_frame(n, rows)]);
    let parts = vec![
        (1, part(&text("[1, 2, 3, 0.5, 20, 0, 255]", 1))),
        (2, part(&text("[1, 2, 3, 0.5, 20, 4, 255]", 2))),
    ];
    let joined = join_parts(parts).unwrap();
    assert!(
        joined
            .frames
            .iter()
            .all(|f| f.frame.points[0].intensity_db == 20.0)
    );
    // Neither a demo nor a chirp file.
    let text = text("[1, 2, 3, 0.5, 100, 0, 255]", 1);
    let nothing = text
        .replace("\"demo\"", "\"d\"")
        .replace("\"cfg\"", "\"c\"");
    let joined = join_parts(vec![(1, part(&nothing))]).unwrap();
    assert!(!joined.z_above_floor);
    assert!(
        joined.warnings[0].starts_with(
            "the files name no demo: its points are taken as in the axes of the sensor"
        ),
        "{:?}",
        joined.warnings
    );
    // A name from a file must not reach a terminal unchanged.
    let hostile = join(&format!("\\u001b[31m{}", "x".repeat(500)), "");
    assert!(hostile.warnings[0].len() < 300 && !hostile.warnings[0].contains('\u{1b}'));
    // Demos with side information have dB, and without it a ratio.
    let by_noise = |noise| {
        let rows = format!("[1, 2, 3, 0.5, 40, {noise}, 255]");
        let joined = join("Small Obstacle Detection", &rows);
        assert!(joined.warnings.is_empty());
        db(&joined)
    };
    assert_eq!(by_noise(7), 40.0);
    assert!((by_noise(0) - 16.020_6).abs() < 1e-4);
}

#[test]
fn what_cannot_be_used_is_never_nothing_seen() {
    let join = |entries: &[String]| {
        join_parts(vec![(1, part(&replay_of(OUT_OF_BOX, "xWR6843", entries)))]).unwrap()
    };
    let zero = "[0, 0, 0, 0, 0, 0, 255], [NaN, 1, 1, 0, 9, 1, 255], [9e9, 1, 1, 0, 9, 1, 255]";
    let warnings = join(&[replay_frame(1, zero)]).warnings;
    assert!(
        warnings[0].starts_with("none of the 3 points in the files can be used"),
        "{warnings:?}"
    );
    assert!(join(&[replay_frame(1, "")]).warnings.is_empty());
    let other =
        replay_frame(1, "").replace("\"numDetected", "\"pointCloudFar\": [[1]], \"numDetected");
    assert_eq!(
        join(&[other]).warnings,
        ["`pointCloudFar` are not read: they are not known"]
    );
    // More dB than any radar reports.
    let warnings = join(&[replay_frame(1, "[1, 2, 3, 0.5, 170, 5, 255]")]).warnings;
    assert!(warnings[0].contains("a median of 170 dB"), "{warnings:?}");
}

/// A file whose stamps are shifted by `shift_s` against those of the other files.
fn run_file(first: u32, n: u32, shift_s: f64) -> VisualizerPart {
    let mut part = part(&replay(first, n));
    for frame in &mut part.frames {
        frame.frame.stamp_s = frame.frame.stamp_s.map(|s| s + shift_s);
    }
    part
}

#[test]
fn files_of_several_runs_are_told_apart_by_their_clock() {
    // A run of 12 frames, then one of 8 into the same folder, then one of 4.
    let files = || {
        vec![
            (3, run_file(9, 4, 0.0)),
            (2, run_file(5, 4, 500.0)),
            (1, run_file(1, 4, 2000.0)),
        ]
    };
    let error = join_parts(files()).unwrap_err();
    let PiecesError::SeveralRuns { runs, .. } = &error else {
        panic!("{error}");
    };
    let described: Vec<_> = runs
        .iter()
        .map(|run| (run.first_piece.as_str(), run.n_frames, run.frame_numbers))
        .collect();
    assert_eq!(
        described,
        [
            ("replay_3.json", 4, Some((9, 12))),
            ("replay_2.json", 4, Some((5, 8))),
            ("replay_1.json", 4, Some((1, 4))),
        ]
    );
    let text = error.to_string();
    for part in [
        // 1500 s, and 55 ms from one frame to the next.
        "the time stamps fall back by 1499.9 s from replay_1.json to replay_2.json",
        "run 1: replay_3.json, 4 frames numbered 9 to 12, 2023-11-14T22:13:20.496Z to 2023-11-14T22:13:20.661Z",
        "run 3: replay_1.json",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    for (run, first, stamp_s) in [(1, 9, 0.495), (2, 5, 500.275), (3, 1, 2000.055)] {
        let recording = join_run(files(), Some(run)).unwrap();
        let frame = &recording.frames[0].frame;
        assert_eq!((recording.frames.len(), frame.number), (4, first));
        let stamp = frame.stamp_s.unwrap() - 1_700_000_000.000_5;
        assert!((stamp - stamp_s).abs() < 1e-6, "{stamp}");
        assert!(
            recording.notes[0].starts_with(&format!("run {run} of 3: replay_")),
            "{:?}",
            recording.notes
        );
    }
    for none in [0, 4] {
        let error = join_run(files(), Some(none)).unwrap_err();
        assert!(matches!(error, PiecesError::NoSuchRun { .. }), "{error}");
    }
}

#[test]
fn runs_may_have_other_chirp_files_and_no_clock() {
    // The newer run has another chirp file: the files of each agree among themselves.
    let mut newer = run_file(1, 4, 90.0);
    newer.cfg = newer.cfg.map(|cfg| cfg.replace("55.00", "100.00"));
    let files = || vec![(1, newer.clone()), (2, run_file(5, 4, 0.0))];
    let error = join_parts(files()).unwrap_err();
    assert!(matches!(error, PiecesError::SeveralRuns { .. }), "{error}");
    let cfg = join_run(files(), Some(2)).unwrap().cfg.unwrap();
    assert!(cfg.contains("100.00"));
    // Without stamps, the frame numbers of a piece must not be smaller than those before it.
    let silent = |first, n| {
        let mut part = run_file(first, n, 0.0);
        part.frames.iter_mut().for_each(|f| f.frame.stamp_s = None);
        part
    };
    let error = join_parts(vec![(1, silent(101, 4)), (2, silent(5, 4))]).unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains(
            "the frame numbers fall back from 104 to 5 from replay_1.json to replay_2.json"
        ) && text.contains("run 1: replay_2.json, 4 frames numbered 5 to 8; run 2: replay_1.json"),
        "{text}"
    );
    assert_eq!(
        join_parts(vec![(1, silent(1, 4)), (2, silent(5, 4))])
            .unwrap()
            .frames
            .len(),
        8
    );
    // A file without frames, a small step of the clock and a board that was restarted are no new run.
    let empty = VisualizerPart {
        frames: Vec::new(),
        ..run_file(1, 1, 0.0)
    };
    let files = vec![
        (1, run_file(101, 15, 0.0)),
        (2, empty),
        (3, run_file(116, 15, -0.5)),
        (4, run_file(1, 4, 300.0)),
    ];
    let joined = join_parts(files).unwrap();
    assert_eq!(joined.frames.len(), 34);
    assert!(joined.warnings.is_empty(), "{:?}", joined.warnings);
    // Files that hold all frames before them, of two runs.
    let files = || {
        vec![
            (1, run_file(1, 3, 700.0)),
            (2, run_file(1, 6, 0.0)),
            (3, run_file(1, 9, 0.0)),
        ]
    };
    let PiecesError::SeveralRuns { runs, .. } = join_parts(files()).unwrap_err() else {
        panic!("one run");
    };
    assert_eq!((runs[0].n_frames, runs[1].n_frames), (9, 3));
    assert_eq!(join_run(files(), Some(1)).unwrap().frames.len(), 9);
}

#[test]
fn a_clock_that_falls_back_within_a_file_is_named() {
    let mut file = run_file(1, 8, 0.0);
    for frame in &mut file.frames[5..] {
        frame.frame.stamp_s = frame.frame.stamp_s.map(|s| s - 60.0);
    }
    let joined = join_parts(vec![(1, file)]).unwrap();
    assert_eq!(joined.frames.len(), 8);
    assert_eq!(
        joined.warnings,
        [
            "the clock of the time stamps falls back 1 times within the files, first by 59.9 s after frame 5: the frames \
          are used in the order of the files"
        ]
    );
}

/// The last frame of a file is saved before the display turns and raises it.
#[test]
fn last_frames_that_were_not_raised_are_raised() {
    // Near the radar raising counts most; at 4.5 m turning lowers by more than half as much.
    for range_m in [1.0, 3.0, 4.5] {
        last_frames_are_raised(range_m);
    }
}

fn last_frames_are_raised(range_m: f64) {
    let position = SensorPosition::from_ti_cfg(WALL_CFG).unwrap().unwrap();
    let row = |[x, y, z]: [f64; 3]| format!("[{x}, {y}, {z}, 0.1, 50, 0, 255]");
    // A person's points in the sensor's axes, and as the display has them.
    let raw = [[0.1, 0.0, 0.4], [0.0, 0.1, 0.1], [0.2, 0.0, -0.3]];
    let raw = raw.map(|[x, y, z]| [x, y + range_m, z]);
    let shown = raw.map(|p| {
        let [x, y, z] = position.mounting().level(p);
        [x, y, z + 2.0]
    });
    let file_of = |first: u32, last_is_raw: bool, is_seen_before: bool| {
        let entries: Vec<String> = (0..5)
            .map(|i| {
                let points = if i == 4 && last_is_raw { raw } else { shown };
                let points = match i == 4 || is_seen_before {
                    true => points.map(row).join(","),
                    false => String::new(),
                };
                replay_frame(first + i, &points)
            })
            .collect();
        part(&replay_of(TRACKING, "xWR6843", &entries))
    };
    let file = |first: u32, last_is_raw: bool| file_of(first, last_is_raw, true);
    // In the last one, nobody is seen before the last frame: it is as in most of the others.
    let joined = join_parts(vec![
        (1, file(1, true)),
        (2, file(6, false)),
        (3, file(11, true)),
        (4, file_of(16, true, false)),
    ])
    .unwrap();
    assert!(
        joined.notes[0].starts_with("3 files were saved before"),
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

/// Packets with these frame numbers, whose cycle counter is at `start` in frame 0 and counts 200 MHz at 20 frames/s.
fn clocked(numbers: std::ops::Range<u32>, start: u32) -> Vec<u8> {
    /// Place of the cycle counter in the header of the SDK.
    const CYCLES_AT: usize = 24;
    let point = one_point(Dialect::Sdk3);
    numbers
        .flat_map(|n| {
            let mut bytes = packet(Dialect::Sdk3, n, &point);
            // Frames are processed within a few milliseconds of each other.
            let jitter = n % 7 * 200_000;
            let cycles = start
                .wrapping_add(n.wrapping_mul(10_000_000))
                .wrapping_add(jitter);
            bytes[CYCLES_AT..CYCLES_AT + 4].copy_from_slice(&cycles.to_le_bytes());
            bytes
        })
        .collect()
}

#[test]
fn pieces_of_several_runs_are_told_apart_by_the_clock_of_the_board() {
    // Frame numbers go on from piece to piece: only the cycle counter shows that a later run overwrote piece 1.
    let pieces = || {
        vec![
            (1, clocked(1..101, 3_000_000_000)),
            (2, clocked(101..201, 77)),
            (3, clocked(201..301, 77)),
        ]
    };
    for dialect in [None, Some(Dialect::Sdk3)] {
        let error = read_visualizer_binary(pieces(), dialect)
            .unwrap_err()
            .to_string();
        assert_eq!(
            error,
            "the pieces are of 2 runs (the board's clock does not go on from frame 100 to frame 101 from \
             pHistBytes_1.bin to pHistBytes_2.bin): run 1: pHistBytes_2.bin to pHistBytes_3.bin, 200 frames numbered 101 \
             to 300; run 2: pHistBytes_1.bin, 100 frames numbered 1 to 100"
        );
        let older = read_visualizer_binary_run(pieces(), dialect, Some(1)).unwrap();
        let numbers: Vec<u32> = older.frames.iter().map(|f| f.number).collect();
        assert_eq!(numbers, (101..301).collect::<Vec<u32>>());
        assert_eq!(
            (older.report.packets, older.report.trailing_bytes),
            (200, 0)
        );
        assert!(older.notes[0].starts_with("run 1 of 2: pHistBytes_2.bin to"));
        let newer = read_visualizer_binary_run(pieces(), dialect, Some(2)).unwrap();
        assert_eq!((newer.frames.len(), newer.report.packets), (100, 100));
        let error = read_visualizer_binary_run(pieces(), dialect, Some(3)).unwrap_err();
        assert!(matches!(
            error,
            VisualizerBinaryError::Pieces(PiecesError::NoSuchRun { .. })
        ));
    }
    // One run: the counter wraps, frames are lost at the boundary, a packet is cut by it, pieces are missing.
    let mut whole = clocked(1..101, 4_200_000_000);
    let mut rest = clocked(103..201, 4_200_000_000);
    let cut = rest.len() / 98 / 2;
    whole.extend(rest.drain(..cut));
    let far = clocked(801..901, 4_200_000_000);
    let one = vec![(1, whole), (2, rest), (9, far)];
    let read = read_visualizer_binary(one.clone(), None).unwrap();
    assert_eq!(read.frames.len(), 298);
    assert_eq!(
        read.notes,
        ["missing pieces of the recording: pHistBytes_3.bin to pHistBytes_8.bin"]
    );
    assert_eq!(
        read_visualizer_binary_run(one, None, Some(1)).unwrap(),
        read
    );
}

#[test]
fn pieces_of_several_runs_are_told_apart_by_their_numbers() {
    let point = one_point(Dialect::Sdk3);
    let packets = |numbers: std::ops::Range<u32>| -> Vec<u8> {
        numbers
            .flat_map(|n| packet(Dialect::Sdk3, n, &point))
            .collect()
    };
    let pieces = vec![(1, packets(200..230)), (2, packets(31..61))];
    let error = read_visualizer_binary(pieces.clone(), None)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("the frame numbers fall back from 229 to 31 from pHistBytes_1.bin"),
        "{error}"
    );
    let older = read_visualizer_binary_run(pieces, None, Some(1)).unwrap();
    assert_eq!(older.frames[0].number, 31);
    // A counter that is not steady proves nothing, and neither does one that is always 0.
    let mut first = packets(1..31);
    let second = packets(31..61);
    let len = first.len() / 30;
    for (i, packet) in first.chunks_exact_mut(len).enumerate() {
        let cycles = (i as u32).wrapping_mul(2_654_435_761);
        packet[24..28].copy_from_slice(&cycles.to_le_bytes());
    }
    let read = read_visualizer_binary(vec![(1, first), (2, second)], None).unwrap();
    assert_eq!(read.frames.len(), 60);
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
