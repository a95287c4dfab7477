use std::collections::HashMap;
use std::sync::Arc;

use parquet::data_type::{DoubleType, FloatType, Int64Type};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use radarllm_base::{BoardReport, BoardTrack, PointFrame, RadarPoint};
use radarllm_dataset::table::{Column, Table, Values};
use radarllm_dataset::{
    DatasetError, Overwrite, PointsFile, PointsMeta, points_from_tables, points_to_table,
    read_points, write_points, write_points_with,
};

use crate::support::{Draw, frames, read_both};

fn meta() -> PointsMeta {
    PointsMeta {
        radar: "awr1843boost".into(),
        source: "simulated:builtin:walk".into(),
        seed: Some(u64::MAX),
        version: "0.1.0".into(),
        radar_height_m: Some(1.05),
        frame_rate_hz: 10.0,
        has_speeds: true,
    }
}

#[test]
fn round_trip_keeps_everything_even_empty_and_lost_frames() {
    let dir = tempfile::tempdir().unwrap();
    for seed in 0..30 {
        let path = dir.path().join(format!("{seed}.parquet"));
        let mut draw = Draw::new(seed);
        let n = draw.below(12);
        let mut frames = frames(&mut draw, n);
        for frame in &mut frames {
            // Only what has points carries its time exactly; empties lie on the nominal grid.
            frame.time_s = 2.5 + f64::from(frame.frame) / 10.0;
        }
        frames.retain(|_| draw.below(5) > 0);
        if let Some(last) = frames.last_mut() {
            last.points.clear();
        }
        write_points(&path, &meta(), &frames, Overwrite::Refuse).unwrap();
        let found = read_both(&path).unwrap();
        // The same as a table.
        let table = points_to_table(&meta(), &frames).unwrap();
        assert_eq!(from_tables([table]).unwrap(), found);
        assert_eq!(found.meta, meta());
        assert_eq!(found.frames.len(), frames.len());
        for (a, b) in found.frames.iter().zip(&frames) {
            assert_eq!((a.frame, &a.points), (b.frame, &b.points));
            // The grid's origin is computed by a subtraction: a few ulps of 4 s.
            assert!(
                (a.time_s - b.time_s).abs() < 1e-14,
                "{} {}",
                a.time_s,
                b.time_s
            );
        }
    }
}

/// Speeds of zero are measured, unless the file says that they are not known; the end of a recording may tell it.
#[test]
fn unknown_speeds_are_stated() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("points.parquet");
    let known = |has_speeds: bool, at_the_end: bool| {
        let meta = PointsMeta {
            has_speeds,
            ..meta()
        };
        write_points_with(&path, &meta, Overwrite::Replace, |writer| {
            for frame in frames(&mut Draw::new(1), 3) {
                writer.write(&frame)?;
            }
            if at_the_end {
                writer.without_speeds();
            }
            Ok::<(), DatasetError>(())
        })
        .unwrap();
        read_points(&path).unwrap().meta.has_speeds
    };
    assert!(known(true, false));
    assert!(!known(false, false));
    assert!(!known(true, true));
}

#[test]
fn writing_refuses_nan_disorder_and_overwriting() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("p.parquet");
    let point = RadarPoint {
        y_m: 3.0,
        range_m: 3.0,
        ..Default::default()
    };
    let frame = |frame, v| PointFrame {
        frame,
        time_s: f64::from(frame),
        points: vec![
            point,
            RadarPoint {
                velocity_mps: v,
                ..point
            },
        ],
        board: None,
    };
    let error = write_points(
        &path,
        &meta(),
        &[frame(0, 0.0), frame(1, f32::NAN)],
        Overwrite::Refuse,
    )
    .unwrap_err();
    assert!(
        error.to_string().contains("`velocity_mps`, row 3"),
        "{error}"
    );
    assert!(
        write_points(
            &path,
            &meta(),
            &[frame(1, 0.0), frame(1, 0.0)],
            Overwrite::Refuse
        )
        .is_err()
    );
    assert!(
        !path.exists() && std::fs::read_dir(dir.path()).unwrap().count() == 0,
        "nothing may be left behind"
    );

    write_points(&path, &meta(), &[frame(0, 1.0)], Overwrite::Refuse).unwrap();
    let error = write_points(&path, &meta(), &[], Overwrite::Refuse).unwrap_err();
    assert!(matches!(error, DatasetError::Exists { .. }));
    write_points(&path, &meta(), &[], Overwrite::Replace).unwrap();
    assert_eq!(read_both(&path).unwrap().frames, []);
}

/// A file as pandas writes it: 64-bit columns, nullable, no metadata of ours, and a column of another type beside them.
fn foreign(path: &std::path::Path, frame: Vec<i64>, t_s: Vec<f64>, x_m: Vec<Option<f64>>) {
    let schema = "message table {
        optional double t_s; optional int64 frame; optional double x_m; optional int96 taken; optional float y_m;
        optional float z_m; optional float range_m; optional float velocity_mps; optional float intensity_db; }";
    let schema = Arc::new(parse_message_type(schema).unwrap());
    let file = std::fs::File::create(path).unwrap();
    let mut writer = SerializedFileWriter::new(file, schema, Arc::default()).unwrap();
    let mut group = writer.next_row_group().unwrap();
    let n = frame.len();
    let all = vec![1_i16; n];
    let mut column = 0;
    while let Some(mut writer) = group.next_column().unwrap() {
        match column {
            0 => writer
                .typed::<DoubleType>()
                .write_batch(&t_s, Some(&all), None),
            1 => writer
                .typed::<Int64Type>()
                .write_batch(&frame, Some(&all), None),
            2 => {
                let levels: Vec<i16> = x_m.iter().map(|x| i16::from(x.is_some())).collect();
                let values: Vec<f64> = x_m.iter().flatten().copied().collect();
                writer
                    .typed::<DoubleType>()
                    .write_batch(&values, Some(&levels), None)
            }
            3 => writer.typed::<parquet::data_type::Int96Type>().write_batch(
                &[],
                Some(&vec![0; n]),
                None,
            ),
            _ => writer
                .typed::<FloatType>()
                .write_batch(&vec![1.0; n], Some(&all), None),
        }
        .unwrap();
        writer.close().unwrap();
        column += 1;
    }
    group.close().unwrap();
    writer.close().unwrap();
}

#[test]
fn files_from_elsewhere_are_read_or_refused_with_column_and_row() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("p.parquet");
    foreign(
        &path,
        vec![0, 0, 2],
        vec![0.0, 0.0, 0.2],
        vec![Some(0.5); 3],
    );
    let found = read_both(&path).unwrap();
    let sizes: Vec<_> = found
        .frames
        .iter()
        .map(|f| (f.frame, f.points.len()))
        .collect();
    assert_eq!(sizes, [(0, 2), (1, 0), (2, 1)]);
    assert!((found.frames[1].time_s - 0.1).abs() < 1e-12);
    assert!(
        (found.meta.frame_rate_hz - 10.0).abs() < 1e-9,
        "rate from the times"
    );
    assert_eq!(
        (found.meta.radar.as_str(), found.meta.seed),
        ("unknown", None)
    );

    type Case = (Vec<i64>, Vec<f64>, Vec<Option<f64>>, &'static str);
    let ok = || vec![Some(1.0); 3];
    let cases: [Case; 7] = [
        (vec![0, 2, 1], vec![0.0, 0.2, 0.3], ok(), "`frame`, row 2"),
        (vec![0, -1, 1], vec![0.0, 0.1, 0.2], ok(), "`frame`, row 1"),
        (
            vec![0, 1, i64::MAX],
            vec![0.0, 0.1, 0.2],
            ok(),
            "`frame`, row 2",
        ),
        (vec![0, 1, 1], vec![0.0, 0.1, 0.2], ok(), "`t_s`, row 2"),
        (
            vec![0, 1, 2],
            vec![0.0, 0.1, 0.2],
            vec![Some(1.0), None, Some(1.0)],
            "`x_m`, row 1: is null",
        ),
        (
            vec![0, 1, 2],
            vec![0.0, 0.1, 0.2],
            vec![Some(1.0), Some(f64::INFINITY), None],
            "`x_m`, row 1: is inf",
        ),
        (
            vec![0, 1, 2],
            vec![0.0, 0.1, 0.2],
            vec![Some(1.0), Some(1e300), Some(1.0)],
            "`x_m`, row 1",
        ),
    ];
    for (frame, t_s, x_m, expected) in cases {
        foreign(&path, frame, t_s, x_m);
        let error = read_both(&path).unwrap_err().to_string();
        assert!(error.contains(expected), "{error} should name {expected}");
    }
}

#[test]
fn missing_columns_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("p.parquet");
    let schema = Arc::new(parse_message_type("message m { required float x_m; }").unwrap());
    let file = std::fs::File::create(&path).unwrap();
    let writer = SerializedFileWriter::new(file, schema, Arc::default()).unwrap();
    writer.close().unwrap();
    let error = read_both(&path).unwrap_err();
    assert!(
        matches!(&error, DatasetError::Column { column, .. } if column == "frame"),
        "{error}"
    );
}

/// Points from the pieces of a table, with the metadata of the first one.
fn from_tables<const N: usize>(pieces: [Table; N]) -> Result<PointsFile, DatasetError> {
    let metadata: HashMap<String, String> = pieces[0].metadata.iter().cloned().collect();
    points_from_tables(
        std::path::Path::new("table"),
        &metadata,
        pieces.map(Ok::<Table, DatasetError>),
    )
}

/// Frames with reports of a board: tracks in space and in a plane, nobody, no report, and frames without points.
fn tracked() -> Vec<PointFrame> {
    let track = |id: u32, height_m: Option<f32>| BoardTrack {
        id,
        place_m: [-0.5, 2.0 + (id % 10) as f32],
        height_m,
        velocity_mps: [0.1, -0.2, 0.3],
    };
    let report = |tracks: Vec<BoardTrack>, is_present: Option<bool>| {
        Some(BoardReport { tracks, is_present })
    };
    let frame = |frame: u32, n: usize, board: Option<BoardReport>| PointFrame {
        frame,
        time_s: 0.25 + f64::from(frame) / 10.0,
        points: vec![
            RadarPoint {
                y_m: 3.0,
                range_m: 3.0,
                ..Default::default()
            };
            n
        ],
        board,
    };
    vec![
        frame(0, 2, None),
        frame(
            1,
            3,
            report(vec![track(u32::MAX, Some(0.4)), track(7, None)], Some(true)),
        ),
        frame(2, 0, report(vec![track(7, Some(-1.1))], None)),
        frame(3, 0, report(Vec::new(), Some(false))),
        frame(4, 0, None),
        frame(6, 1, report(Vec::new(), None)),
        frame(7, 0, report(vec![track(1, None)], None)),
    ]
}

#[test]
fn what_the_board_states_is_kept() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("tracked.parquet");
    let mut of_board = meta();
    of_board.source = "recorded:uart:room.dat".into();
    let frames = tracked();
    write_points(&path, &of_board, &frames, Overwrite::Refuse).unwrap();
    let found = read_both(&path).unwrap();
    assert_eq!(found.frames.len(), frames.len());
    for (a, b) in found.frames.iter().zip(&frames) {
        assert_eq!(
            (a.frame, &a.points, &a.board),
            (b.frame, &b.points, &b.board)
        );
        assert!((a.time_s - b.time_s).abs() < 1e-12);
    }
    // In two pieces.
    let whole = points_to_table(&of_board, &frames).unwrap();
    let first = Table {
        metadata: whole.metadata.clone(),
        ..points_to_table(&of_board, &frames[..2]).unwrap()
    };
    let rest = points_to_table(&of_board, &frames[2..]).unwrap();
    assert_eq!(first.n_rows() + rest.n_rows(), whole.n_rows());
    assert_eq!(from_tables([first, rest]).unwrap(), found);
    assert_eq!(from_tables([whole]).unwrap(), found);
    // Frames one by one; a source whose boards state nothing has no columns for it, and loses nothing without a word.
    let write = |meta: &PointsMeta, name: &str| {
        write_points_with(&dir.path().join(name), meta, Overwrite::Refuse, |writer| {
            frames.iter().try_for_each(|frame| writer.write(frame))
        })
    };
    write(&of_board, "one-by-one.parquet").unwrap();
    let [a, b] = ["tracked.parquet", "one-by-one.parquet"]
        .map(|f| std::fs::read(dir.path().join(f)).unwrap());
    assert!(a == b);
    let error: DatasetError = write(&meta(), "simulated.parquet").unwrap_err();
    assert!(error.to_string().contains("frame 1"), "{error}");
}

#[test]
fn a_recording_without_reports_has_the_columns_of_points_alone() {
    let frames: Vec<PointFrame> = tracked()
        .into_iter()
        .map(|frame| PointFrame {
            board: None,
            ..frame
        })
        .collect();
    let columns = |source: &str| {
        let meta = PointsMeta {
            source: source.into(),
            ..meta()
        };
        points_to_table(&meta, &frames).unwrap().columns.len()
    };
    assert_eq!(columns("simulated:builtin:walk"), 8);
    assert_eq!(columns("recorded:radhar:walk.txt"), 8);
    assert_eq!(columns("recorded:uart:room.dat"), 10);
}

#[test]
fn damaged_reports_of_a_board_are_refused() {
    let mut of_board = meta();
    of_board.source = "recorded:uart:room.dat".into();
    let mut frames = tracked();
    if let Some(board) = &mut frames[1].board {
        board.tracks[1].velocity_mps[2] = f32::INFINITY;
    }
    let error = points_to_table(&of_board, &frames).unwrap_err().to_string();
    assert!(
        error.contains("`board_tracks`, row 2: frame 1: vz_mps is inf"),
        "{error}"
    );

    let table = points_to_table(&of_board, &tracked()).unwrap();
    let n = table.n_rows();
    let read = |column: Column| {
        let mut changed = table.clone();
        let at = changed.columns.iter().position(|c| c.name == column.name);
        changed.columns[at.unwrap()] = column;
        from_tables([changed]).unwrap_err().to_string()
    };
    // Without the columns of the board, rows that only report are frames without points.
    let mut points = table.clone();
    points
        .columns
        .retain(|column| !column.name.starts_with("board_"));
    let n_points = |frames: &[PointFrame]| -> Vec<usize> {
        frames.iter().map(|frame| frame.points.len()).collect()
    };
    let read_points = from_tables([points]).unwrap().frames;
    assert_eq!(n_points(&read_points), n_points(&tracked()));
    assert!(n_points(&read_points).contains(&0));
    // Another type, and a point of which one value is missing.
    let error = read(Column::new("board_tracks", Values::F64(vec![1.0; n])));
    assert!(
        error.contains("`board_tracks`") && error.contains("64-bit float"),
        "{error}"
    );
    let mut validity = vec![true; n];
    validity[0] = false;
    let values = Values::F32(vec![1.0; n]);
    let error = read(Column::nullable("z_m", values, validity));
    assert!(error.contains("`z_m`, row 0: is null"), "{error}");
    // The same report in two rows of a frame.
    let one = PointFrame {
        points: Vec::new(),
        ..tracked().swap_remove(1)
    };
    let row = points_to_table(&of_board, &[one]).unwrap();
    assert_eq!(row.n_rows(), 1);
    let error = from_tables([row.clone(), row]).unwrap_err();
    let error = error.to_string();
    assert!(error.contains("frame 1 has one already"), "{error}");
}
