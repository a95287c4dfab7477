//! Tables of points as other programs write them. Every table here says the same: 20 frames at 10 frames/s with two
//! points each, unless the test says otherwise.

use radarllm_base::{RecordedFrame, Timeline};
use radarllm_formats::{
    DetectError, RecordingFormat, detect,
    recordings::{Axes, Place},
    tables::{PointsTable, read_points_csv, read_points_npy},
};

use crate::make::npy;

const N_FRAMES: usize = 20;

/// The points of a frame: x, y, z, velocity, SNR.
fn points(frame: usize) -> [[f64; 5]; 2] {
    let n = frame as f64;
    [
        [0.25 + n / 64.0, 3.0, -0.75, 0.125, 15.0],
        [-0.5, 2.0 + n / 32.0, 0.25, -0.5, 21.5],
    ]
}

/// Rows of all points: `row` gets the frame, from 0, and the five values.
fn rows(header: &str, row: impl Fn(usize, [f64; 5]) -> String) -> String {
    let mut text = header.to_owned();
    for frame in 0..N_FRAMES {
        for point in points(frame) {
            text += "\n";
            text += &row(frame, point);
        }
    }
    text + "\n"
}

/// A table with this time column; `time` writes the times.
fn with_times(name: &str, time: impl Fn(usize) -> String) -> String {
    rows(
        &format!("{name},x,y,z,velocity,snr"),
        |frame, [x, y, z, v, snr]| format!("{},{x},{y},{z},{v},{snr}", time(frame)),
    )
}

fn read(text: &str) -> PointsTable {
    read_points_csv(text, Axes::RightForwardUp, None).unwrap()
}

fn error(text: &str) -> String {
    let error = read_points_csv(text, Axes::RightForwardUp, None).unwrap_err();
    error.to_string()
}

/// Checks all values against the points that were written.
fn assert_whole(frames: &[RecordedFrame], tolerance: f32) {
    assert_eq!(frames.len(), N_FRAMES);
    for (n, frame) in frames.iter().enumerate() {
        assert_eq!(frame.points.len(), 2, "frame {n}");
        for (p, [x, y, z, v, snr]) in frame.points.iter().zip(points(n)) {
            let range_m = (x * x + y * y + z * z).sqrt();
            let found = [
                p.x_m,
                p.y_m,
                p.z_m,
                p.velocity_mps,
                p.intensity_db,
                p.range_m,
            ];
            let expected = [x, y, z, v, snr, range_m].map(|v| v as f32);
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() <= tolerance, "{p:?}");
            }
        }
    }
}

fn assert_ten_hertz(frames: Vec<RecordedFrame>) {
    let line = Timeline::new(frames, None).unwrap();
    assert!((line.frame_rate_hz - 10.0).abs() < 1e-3, "{line:?}");
    for (n, frame) in line.frames.iter().enumerate() {
        assert!((frame.time_s - 0.1 * n as f64).abs() < 1e-5);
    }
}

/// RFC 4180 as R, Excel and `csv.QUOTE_ALL` write it.
#[test]
fn quoted_cells_are_cells() {
    let text = rows(
        "\"frame\",\"a \"\"note\"\"\",\"x\",\"y\",\"z\",\"velocity\",\"snr\"",
        |frame, [x, y, z, v, snr]| {
            format!(
                "\"{frame}\",\"one, \"\"two\"\"\r\nthree\",\"{x}\",{y},\"{z}\",\"{v}\",\"{snr}\""
            )
        },
    );
    for text in [text.clone(), text.replace('\n', "\r\n")] {
        let table = read(&text);
        assert_whole(&table.frames, 0.0);
        assert_eq!(table.notes, [""; 0]);
        let found = detect("any.txt", text.as_bytes()).unwrap().format;
        assert_eq!(found, RecordingFormat::Csv);
    }
    // The row with the mistake is the third one and begins in line 4.
    let wrong = text
        .replacen("\"15\"", "\"fast\"", 2)
        .replacen("\"fast\"", "\"15\"", 1);
    let error = read_points_csv(&wrong, Axes::RightForwardUp, None).unwrap_err();
    assert_eq!(error.at, Place::Line(6));
    assert_eq!(error.expected, "a number for `snr`");
}

#[test]
fn times_are_taken_in_the_unit_of_their_steps() {
    for (start, step, unit) in [
        (0, 100, "milliseconds"),
        (5_000, 100_000, "microseconds"),
        (0, 100_000_000, "nanoseconds"),
        (1_734_343_200_000, 100, "milliseconds"),
        (1_734_343_200_000_000, 100_000, "microseconds"),
        (1_734_343_200_000_000_000_i64, 100_000_000, "nanoseconds"),
    ] {
        for name in ["timestamp", "Time", "t"] {
            let text = with_times(name, |n| (start + step * n as i64).to_string());
            let table = read(&text);
            assert_whole(&table.frames, 0.0);
            assert!(
                table.notes[0].starts_with(&format!("the times in `{name}` are {unit}")),
                "{:?}",
                table.notes
            );
            assert_ten_hertz(table.frames);
        }
    }
    for start in [0.0, 1_734_343_200.0] {
        let text = with_times("timestamp", |n| (start + n as f64 / 10.0).to_string());
        let table = read(&text);
        assert_eq!(table.notes, [""; 0]);
        assert_ten_hertz(table.frames);
    }
    // A name that states the unit is believed, and doubted aloud where no radar has such steps.
    let text = with_times("t_s", |n| (100 * n).to_string());
    let table = read(&text);
    assert_eq!(table.frames[1].stamp_s, Some(100.0));
    assert!(table.warnings[0].contains("median step of the times in `t_s` is 100 s"));
}

#[test]
fn times_in_no_plausible_unit_are_an_error_for_those_who_need_them() {
    let text = rows("frame,t,x,y,z,velocity,snr", |n, [x, y, z, v, snr]| {
        format!(
            "{n},{},{x},{y},{z},{v},{snr}",
            1_734_343_200_000_i64 + 5000 * n as i64
        )
    });
    let table = read(&text);
    assert_whole(&table.frames, 0.0);
    assert!(table.frames.iter().all(|f| f.stamp_s.is_none()));
    let error = table.clock_error.unwrap().to_string();
    assert!(
        error.contains("a median step of 5000; their size is that of milliseconds"),
        "{error}"
    );
}

#[test]
fn dates_and_times_of_day_are_clocks() {
    let tenth = |n: usize| format!("{:02}.{:06}", n / 10, n % 10 * 100_000);
    for (before, after) in [
        ("2024-12-16 10:00:", ""),
        ("2024-12-16T10:00:", "Z"),
        ("2024-12-16T10:00:", "+01:00"),
        ("2024/12/16 10:00:", ""),
        ("10:00:", ""),
    ] {
        let text = with_times("timestamp", |n| format!("{before}{}{after}", tenth(n)));
        let table = read(&text);
        assert_whole(&table.frames, 0.0);
        assert_ten_hertz(table.frames);
    }
    // Nineteen tenths of a second around midnight.
    let text = with_times("time", |n| match n {
        0..10 => format!("23:59:59.{n}"),
        _ => format!("00:00:00.{}", n - 10),
    });
    let table = read(&text);
    assert_eq!(table.warnings, [""; 0]);
    assert_ten_hertz(table.frames);
    let mixed = with_times("time", |n| match n {
        0..10 => format!("2024-12-16 10:00:00.{n}"),
        _ => n.to_string(),
    });
    assert!(error(&mixed).contains("line 22: expected a date with time, as in the first row"));
    let other = with_times("time", |_| "yesterday".into());
    assert!(error(&other).contains("line 2: expected a number or a date with time for `time`"));
}

/// Empty cells as pandas (nothing, NaN), R (NA), SQL (NULL) and Python (None) write them, in every column of a point.
#[test]
fn points_with_an_empty_cell_are_left_out_and_counted() {
    for nothing in ["", "NaN", "nan", "NA", "null", "None", "inf"] {
        for column in 1..6 {
            let text = rows("frame,x,y,z,velocity,snr", |n, p| {
                let mut cells: Vec<String> = p.iter().map(ToString::to_string).collect();
                if n == 3 && p[3] < 0.0 {
                    cells[column - 1] = nothing.into();
                }
                format!("{n},{}", cells.join(","))
            });
            let table = read(&text);
            let sizes: Vec<usize> = table.frames.iter().map(|f| f.points.len()).collect();
            assert_eq!((table.frames.len(), sizes[2], sizes[3]), (N_FRAMES, 2, 1));
            assert_eq!(
                table.warnings,
                ["1 points were left out, because one of their cells is empty or not a number"]
            );
        }
    }
    // A frame without points is a frame, and a row without a frame is none.
    let table = read("frame,x,y,z,v,snr\n1,1,2,0,0,9\n2,,,,,\n,1,2,0,0,9\n3,1,2,0,0,9\n");
    let sizes: Vec<usize> = table.frames.iter().map(|f| f.points.len()).collect();
    assert_eq!(sizes, [1, 0, 1]);
    assert_eq!(
        table.warnings,
        ["1 rows were left out, because they state no frame and no time"]
    );
}

#[test]
fn frame_numbers_that_restart_follow_on() {
    let text = rows("frame,x,y,z,velocity,snr", |n, [x, y, z, v, snr]| {
        format!(
            "{},{x},{y},{z},{v},{snr}",
            if n < 8 { 90 + n } else { n - 7 }
        )
    });
    let table = read(&text);
    assert_whole(&table.frames, 0.0);
    assert_eq!(table.number_restarts, 1);
    let line = Timeline::new(table.frames, Some(10.0)).unwrap();
    assert_eq!((line.restarts, line.frames[19].frame), (1, 19));
    // Two runs in one file, with the header of each.
    let one = "frame,x,y,z,v,snr\n1,1,2,0,0,9\n2,1,2,0,0,9\n";
    let table = read(&[one, one].concat());
    assert_eq!((table.frames.len(), table.number_restarts), (4, 1));
    assert!(table.notes[0].contains("the header stands 2 times"));
}

#[test]
fn a_clock_that_runs_backwards_follows_on_with_a_warning() {
    let text = with_times("t_s", |n| {
        (if n < 12 {
            500.0 + n as f64 / 10.0
        } else {
            n as f64 / 10.0 - 1.2
        })
        .to_string()
    });
    let table = read(&text);
    assert_eq!(
        table.warnings,
        [
            "the clock in `t_s` went back 1 times, first by 501.100 s at frame 12: the frames follow on"
        ]
    );
    assert_whole(&table.frames, 0.0);
    assert_ten_hertz(table.frames);
}

#[test]
fn a_table_without_snr_has_zero_decibels() {
    let text = rows(
        "frame,X [m],Y [m],Z [m],Doppler [m/s]",
        |n, [x, y, z, v, _]| format!("{n},{x},{y},{z},{v}"),
    );
    let table = read(&text);
    assert!(
        table
            .frames
            .iter()
            .flat_map(|f| &f.points)
            .all(|p| p.intensity_db == 0.0)
    );
    assert_eq!(table.frames[5].points[0].x_m, 0.25 + 5.0 / 64.0);
    assert_eq!(
        table.notes,
        ["no column has an intensity: 40 points have 0 dB"]
    );
}

#[test]
fn tenths_of_decibels_are_seen_in_the_values() {
    let tenths = |header: &str, noise: f64| {
        rows(header, |n, [x, y, z, v, snr]| {
            format!("{n},0,{x},{y},{z},{v},{},{noise}", 10.0 * snr)
        })
    };
    for (header, noise) in [
        ("frame,DetObj#,x,y,z,v,snr,noise", 700.0),
        ("frame,object,x,y,z,v,snr,noise", 700.0),
        ("frame,object,x,y,z,v,SNR,Noise", 450.0),
        ("frame,DetObj#,x,y,z,v,snr,other", 0.0),
    ] {
        let table = read(&tenths(header, noise));
        assert_whole(&table.frames, 1e-6);
        assert_eq!(table.warnings, [""; 0]);
        assert!(table.notes[0].contains("tenths of dB"), "{:?}", table.notes);
    }
    // Nothing but the size speaks: a warning, and the values as they are.
    for header in [
        "frame,object,x,y,z,v,snr,other",
        "frame,object,x,y,z,v,snr_db,noise",
        "frame,object,x,y,z,v,intensity,other",
    ] {
        let table = read(&tenths(header, 700.0));
        assert_eq!(table.frames[0].points[0].intensity_db, 150.0);
        assert!(
            table.warnings[0].contains("dB, which no radar's SNR is"),
            "{:?}",
            table.warnings
        );
    }
    // dB are dB, also beside a noise column, and whoever divided TI's numbers by ten has fractions.
    for header in [
        "frame,object,x,y,z,v,snr,noise",
        "frame,DetObj#,x,y,z,v,snr,noise",
    ] {
        let text = rows(header, |n, [x, y, z, v, snr]| {
            format!("{n},0,{x},{y},{z},{v},{snr},70")
        });
        let table = read(&text);
        assert_whole(&table.frames, 0.0);
        assert_eq!(table.notes, [""; 0]);
    }
    let table = read(&tenths("frame,object,x,y,z,v,snr (0.1 dB),other", 0.0));
    assert_whole(&table.frames, 1e-6);
}

#[test]
fn ranges_and_angles_are_points() {
    let table = |header: &str, factor: f64| {
        rows(header, |n, [x, y, z, v, snr]| {
            let range = (x * x + y * y + z * z).sqrt();
            let (azimuth, elevation) = (x.atan2(y) * factor, (z / range).asin() * factor);
            format!("{n},{range},{azimuth},{elevation},{v},{snr}")
        })
    };
    let degrees = 180.0 / std::f64::consts::PI;
    for (header, factor, note) in [
        (
            "frame,range_m,azimuth_rad,elevation_rad,doppler,snr",
            1.0,
            None,
        ),
        (
            "frame,range (m),azimuth (deg),elevation (deg),v,snr",
            degrees,
            None,
        ),
        (
            "frame,range,azimuth [\u{b0}],elevation [\u{b0}],v,snr",
            degrees,
            None,
        ),
        (
            "frame,range,azimuth,elevation,v,snr",
            1.0,
            Some("taken for radians"),
        ),
        (
            "frame,range,azimuth,elevation,v,snr",
            degrees,
            Some("taken for degrees"),
        ),
    ] {
        let table = read(&table(header, factor));
        assert_whole(&table.frames, 1e-6);
        let notes = table.notes.concat();
        assert_eq!(
            note.map(|n| notes.contains(n)),
            note.map(|_| true),
            "{notes}"
        );
    }
    // In the axes of ROS the azimuth grows to the left.
    let text = "frame,range,azimuth_rad,elevation_rad,v,snr\n0,2,0.5235987755982988,0,0,9\n";
    let ros = read_points_csv(text, Axes::ForwardLeftUp, None).unwrap();
    let p = ros.frames[0].points[0];
    assert!(
        (p.x_m + 1.0).abs() < 1e-6 && (p.y_m - 3.0_f32.sqrt()).abs() < 1e-6,
        "{p:?}"
    );
    let unclear = error("frame,range,azimuth,elevation,v\n0,2,3.0,0,0\n");
    assert!(
        unclear.contains("beyond 6.3, which are degrees"),
        "{unclear}"
    );
    let both = read("frame,range,x,y,z,v,snr\n0,9,1,2,0,0,9\n");
    assert_eq!(both.frames[0].points[0].x_m, 1.0);
}

#[test]
fn columns_can_be_named_by_the_caller() {
    let text = rows("", |n, [x, y, z, v, snr]| {
        format!(
            "{n},{x},{y},{z},{v},{snr},{}",
            1_734_343_200_000_i64 + 100 * n as i64
        )
    });
    let text = text.trim_start();
    let unnamed = detect("1.csv", text.as_bytes()).unwrap_err();
    assert!(
        unnamed
            .to_string()
            .starts_with("a table without a header: its first row has 7 cells, `0`, `0.25`"),
        "{unnamed}"
    );
    let by = |text: &str, columns: &str| read_points_csv(text, Axes::RightForwardUp, Some(columns));
    for columns in [
        "frame,x,y,z,v,snr,timestamp",
        "-, x, y ,z,velocity,snr,t_ms",
        "frame,x,y,z,v,snr,_",
    ] {
        let table = by(text, columns).unwrap();
        assert_whole(&table.frames, 0.0);
        if columns.contains('t') {
            assert_ten_hertz(table.frames);
        }
    }
    // A header of other words is left out, and so are its repetitions.
    let header = "nr,right,ahead,up,rate,strength,clock\n";
    let table = by(&[header, text].concat(), "frame,x,y,z,v,snr,t_ms").unwrap();
    assert_whole(&table.frames, 0.0);
    assert!(
        table.notes[0].contains("first row holds no numbers"),
        "{:?}",
        table.notes
    );
    // A first row with words beside its points is a row.
    let words = "a,b,c,1,2,3,0.5,7\nd,e,f,1,2,3,0.5,8\n";
    let table = by(words, "-,-,-,x,y,z,v,frame").unwrap();
    assert_eq!(table.frames.len(), 2);
    for (columns, expected) in [
        ("frame,x,y,z,v,strength,-", "names of columns such as frame"),
        ("frame,x,-,z,v,snr,-", "columns y"),
        ("frame,x,y,z,v,snr", "expected 6 cells"),
        ("frame,x,y,z,v,snr,x_mm", "one column for x"),
    ] {
        let error = by(text, columns).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let values: Vec<f32> = (0..3)
        .flat_map(|n| [n as f32, 0.5, 2.0, 0.0, 0.25])
        .collect();
    let array = npy("'<f4'", "(3, 5)", &values);
    let table = read_points_npy(&array, Axes::RightForwardUp, Some("frame,x,y,z,v")).unwrap();
    assert_eq!(table.frames[2].points[0].y_m, 2.0);
    assert!(read_points_npy(&array, Axes::RightForwardUp, None).is_err());
}

/// Boards without an antenna above another one measure no heights, and some recorders write no velocities.
#[test]
fn tables_without_heights_or_velocities_are_read_with_a_warning() {
    let flat = read(&rows("frame,x,y,v,snr", |n, [x, y, _, v, snr]| {
        format!("{n},{x},{y},{v},{snr}")
    }));
    assert_eq!(
        flat.warnings,
        ["no column has a height: all points are at the height of the radar"]
    );
    let still = read(&rows("frame,x,y,z,snr", |n, [x, y, z, _, snr]| {
        format!("{n},{x},{y},{z},{snr}")
    }));
    assert_eq!(still.warnings, ["no column has a velocity"]);
    let spherical = read(&rows("frame,range,azimuth_deg,v", |n, [x, y, _, v, _]| {
        let azimuth_deg = x.atan2(y).to_degrees();
        format!("{n},{},{azimuth_deg},{v}", x.hypot(y))
    }));
    assert_eq!(flat.frames.len(), N_FRAMES);
    for n in 0..N_FRAMES {
        let read = [&flat, &still, &spherical].map(|table| &table.frames[n].points);
        for (i, [x, y, z, v, snr]) in points(n).into_iter().enumerate() {
            let [flat, still, spherical] = read.map(|points| points[i]);
            assert_eq!(
                [
                    flat.x_m,
                    flat.y_m,
                    flat.z_m,
                    flat.velocity_mps,
                    flat.intensity_db
                ],
                [x, y, 0.0, v, snr].map(|v| v as f32)
            );
            assert!((flat.range_m - x.hypot(y) as f32).abs() < 1e-6);
            assert_eq!([still.z_m, still.velocity_mps], [z as f32, 0.0]);
            let difference_m = (spherical.x_m - flat.x_m).hypot(spherical.y_m - flat.y_m);
            assert!(difference_m < 1e-5 && spherical.z_m == 0.0);
        }
    }
    // A cell that is empty is not one that is missing.
    let gap = read("frame,x,y,z,v\n0,1,2,,0.5\n0,1,2,0.5,\n0,1,2,0.5,0.5\n");
    assert_eq!(gap.frames[0].points.len(), 1);
}

/// A recorder that asks the clock for every point writes frames of many times.
#[test]
fn rows_with_a_time_each_are_joined_to_frames() {
    let with = |name: &str, frame_step: f64, row_step: f64, start: f64| {
        let mut text = format!("{name},x,y,z,velocity,snr\n");
        for frame in 0..N_FRAMES {
            for (row, [x, y, z, v, snr]) in points(frame).into_iter().enumerate() {
                let time = start + frame as f64 * frame_step + row as f64 * row_step;
                text += &format!("{time},{x},{y},{z},{v},{snr}\n");
            }
        }
        read(&text)
    };
    for table in [
        // Unix times in s, whose steps within frames no radar has; and numbers in which the steps are clear in any unit.
        with("timestamp", 0.1, 0.0015, 1_734_343_200.0),
        with("t_s", 0.1, 0.002, 0.0),
        with("t", 100.0, 0.25, 0.0),
    ] {
        assert_whole(&table.frames, 1e-6);
        assert!(
            table.notes.iter().any(|n| n.contains("40 rows of at most")),
            "{:?}",
            table.notes
        );
        let timeline = Timeline::new(table.frames, None).unwrap();
        assert!((timeline.frame_rate_hz - 10.0).abs() < 0.01);
    }
    let mut text = "timestamp,x,y,z,velocity,snr\n".to_owned();
    for frame in 0..N_FRAMES {
        for (row, [x, y, z, v, snr]) in points(frame).into_iter().enumerate() {
            let us = 100_000 * frame + 25 * row;
            let (seconds, us) = (us / 1_000_000, us % 1_000_000);
            text += &format!("2024-12-16 10:00:{seconds:02}.{us:06},{x},{y},{z},{v},{snr}\n");
        }
    }
    assert_whole(&read(&text).frames, 0.0);

    // One point a frame, at steps of a frame, with pauses.
    let mut text = "t_s,x,y,z,velocity,snr\n".to_owned();
    for n in 0..60 {
        let pause_s = f64::from(n / 20) * 2.0;
        text += &format!("{},0.5,2,0,0.5,10\n", 0.05 * f64::from(n) + pause_s);
    }
    assert_eq!(read(&text).frames.len(), 60);
}

/// Stamps of whole seconds cannot tell frames apart that have numbers.
#[test]
fn a_clock_too_coarse_for_the_frames_is_an_error_that_states_their_rate() {
    let text = rows(
        "frame,timestamp,x,y,z,velocity,snr",
        |n, [x, y, z, v, snr]| format!("{n},{},{x},{y},{z},{v},{snr}", n / 10),
    );
    let table = read(&text);
    assert!(table.frames.iter().all(|f| f.stamp_s.is_none()));
    let error = table.clock_error.unwrap().to_string();
    assert!(
        error.contains("one for several frames: their numbers grow by 19.00 in a unit of time"),
        "{error}"
    );
}

/// Comments before the header, and rows of zeros that fill up frames.
#[test]
fn comments_and_padding_are_left_out() {
    let text = with_times("t_s", |n| (0.1 * n as f64).to_string());
    let commented = format!("# radar IWR6843, lab 3\n#\n# x is to the right\n{text}");
    assert_eq!(read(&commented).frames, read(&text).frames);
    let detected = detect("log.csv", commented.as_bytes()).unwrap();
    assert_eq!(detected.format, RecordingFormat::Csv);
    let of_numpy = format!("# {text}");
    assert_eq!(read(&of_numpy).frames, read(&text).frames);
    let padded = format!("{text}2.0,0,0,0,0,0\n2.0,1,2,0,0.5,10\n2.0,0,0,0,0,0\n");
    let table = read(&padded);
    assert_eq!(table.frames.len(), N_FRAMES + 1);
    assert_eq!(table.frames[N_FRAMES].points.len(), 1);
    assert!(table.warnings[0].starts_with("2 rows with a point at the place of the radar"));
}

#[test]
fn unknown_headers_are_named_with_what_they_lack() {
    let of = |name: &str, text: &str| detect(name, text.as_bytes()).unwrap_err();
    let error = of("log.csv", "nr,right,ahead,up,rate\n1,2,3,4,5\n");
    assert_eq!(
        error.to_string(),
        "a table without the columns x, y, z, velocity, frame or t_s; it has 5: `nr`, `right`, `ahead`, `up`, `rate`"
    );
    assert!(matches!(
        of("log.tsv", "a\tb\n1\t2\n"),
        DetectError::UnknownTable {
            has_header: true,
            ..
        }
    ));
    // Cells of others reach no terminal as they are.
    let escape = of("log.csv", "\u{1b}[31m,b\n1,2\n").to_string();
    assert!(!escape.contains('\u{1b}'), "{escape}");
    let error = error_of_known("frame,x,y,name\n1,2,3,a\n");
    assert!(
        error.contains("columns z, velocity") && error.contains("found `frame`, `x`, `y`, `name`"),
        "{error}"
    );
}

fn error_of_known(text: &str) -> String {
    assert_eq!(
        detect("a.csv", text.as_bytes()).unwrap().format,
        RecordingFormat::Csv
    );
    error(text)
}

#[test]
fn decimal_commas_stand_between_semicolons() {
    let comma = |v: f64| v.to_string().replace('.', ",");
    let text = rows("frame;x;y;z;velocity;snr", |n, p| {
        format!("{n};{}", p.map(comma).join(";"))
    });
    for text in [text.clone(), ["sep=;\r\n", &text].concat()] {
        let table = read(&text);
        assert_whole(&table.frames, 0.0);
        assert!(table.notes[0].contains("decimal mark"));
        assert_eq!(
            detect("a.csv", text.as_bytes()).unwrap().format,
            RecordingFormat::Csv
        );
    }
    let points = text.replace(',', ".");
    assert_eq!(read(&points).notes, [""; 0]);
    let mixed = text.replacen("0,25", "0.25", 1);
    assert!(
        error(&mixed).contains("a decimal `.` as in the rows before"),
        "{}",
        error(&mixed)
    );
    let thousands = text.replacen("0,25", "1,000,25", 1);
    assert!(error(&thousands).contains("line 2: expected a number for `x`"));
}

/// A recorder that is stopped leaves half a row.
#[test]
fn a_last_row_that_is_cut_short_is_left_out() {
    let text = with_times("t_s", |n| (n as f64 / 10.0).to_string());
    let cut = text.rfind(",-0.5").unwrap();
    let table = read(&text[..cut]);
    assert_eq!(table.frames[19].points.len(), 1);
    assert_eq!(
        table.warnings,
        ["the last row is cut short and was left out"]
    );
    // In the middle it is damage.
    let damaged = text.replacen(",15\n", "\n", 1);
    assert!(error(&damaged).contains("line 2: expected 6 cells"));
    for end in 0..text.len() {
        let _ = read_points_csv(&text[..end], Axes::RightForwardUp, None);
    }
}

/// Of two columns for one quantity the usual name is used, and a note says so.
#[test]
fn of_several_names_the_usual_one_is_used() {
    let table =
        read("frame,timestamp,t_ms,x,y,z,speed,velocity,snr\n1,late,100,1,2,0,0.5,-0.5,9\n");
    assert_eq!(table.frames[0].stamp_s, Some(0.1));
    assert_eq!(table.frames[0].points[0].velocity_mps, -0.5);
    assert_eq!(
        table.notes,
        [
            "column `timestamp` is not used, because there is `t_ms`",
            "column `speed` is not used, because there is `velocity`"
        ]
    );
}
