use std::{collections::HashMap, sync::Arc};

use arrow_array::{ArrayRef, Float32Array, Float64Array, Int64Array, RecordBatch};
use arrow_schema::{Field, Schema};
use parquet::arrow::ArrowWriter;
use radarllm_base::{BoardReport, BoardTrack, PointFrame, RadarPoint};
use radarllm_dataset::{
    DatasetError, Overwrite, PointsMeta, points_from_batches, points_to_batch, read_points,
    write_points, write_points_with,
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
        // The same as Arrow batches, in two pieces.
        let batch = points_to_batch(&meta(), &frames).unwrap();
        let half = batch.num_rows() / 2;
        let pieces = [
            batch.slice(0, half),
            batch.slice(half, batch.num_rows() - half),
        ];
        let metadata = metadata_of(&batch);
        let name = std::path::Path::new("table");
        let batches = points_from_batches(name, &metadata, pieces.map(Ok)).unwrap();
        assert_eq!(batches, found);
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

/// A file as pandas writes it: 64-bit columns, nullable, no metadata of ours.
fn foreign(path: &std::path::Path, frame: Vec<i64>, t_s: Vec<f64>, x_m: Vec<Option<f64>>) {
    let n = frame.len();
    let mut columns: Vec<(&str, ArrayRef, bool)> = vec![
        ("t_s", Arc::new(Float64Array::from(t_s)), true),
        ("frame", Arc::new(Int64Array::from(frame)), true),
        ("x_m", Arc::new(Float64Array::from(x_m)), true),
    ];
    for name in ["y_m", "z_m", "range_m", "velocity_mps", "intensity_db"] {
        columns.push((name, Arc::new(Float32Array::from(vec![1.0; n])), true));
    }
    let batch = RecordBatch::try_from_iter_with_nullable(columns).unwrap();
    let file = std::fs::File::create(path).unwrap();
    let mut writer = ArrowWriter::try_new(file, batch.schema(), None).unwrap();
    writer.write(&batch).unwrap();
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
            "`x_m`, row 2: is null",
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
    let x: ArrayRef = Arc::new(Float32Array::from(vec![1.0]));
    let batch = RecordBatch::try_from_iter([("x_m", x)]).unwrap();
    let mut writer =
        ArrowWriter::try_new(std::fs::File::create(&path).unwrap(), batch.schema(), None).unwrap();
    writer.write(&batch).unwrap();
    writer.close().unwrap();
    let error = read_both(&path).unwrap_err();
    assert!(
        matches!(&error, DatasetError::Column { column, .. } if column == "frame"),
        "{error}"
    );
}

/// The metadata of a batch's schema.
fn metadata_of(batch: &RecordBatch) -> HashMap<String, String> {
    let schema = batch.schema();
    let metadata = schema.metadata().iter();
    metadata
        .map(|(k, v)| (k.to_string(), v.to_string()))
        .collect()
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
    let batch = points_to_batch(&of_board, &frames).unwrap();
    let metadata = metadata_of(&batch);
    let (half, n) = (batch.num_rows() / 2, batch.num_rows());
    let pieces = [batch.slice(0, half), batch.slice(half, n - half)];
    let name = std::path::Path::new("table");
    assert_eq!(
        points_from_batches(name, &metadata, pieces.map(Ok)).unwrap(),
        found
    );
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
        points_to_batch(&meta, &frames).unwrap().num_columns()
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
    let error = points_to_batch(&of_board, &frames).unwrap_err().to_string();
    assert!(
        error.contains("`board_tracks`, row 2: frame 1: vz_mps is inf"),
        "{error}"
    );

    let batch = points_to_batch(&of_board, &tracked()).unwrap();
    let read = |batch: RecordBatch| {
        let metadata = metadata_of(&batch);
        points_from_batches(std::path::Path::new("table"), &metadata, [Ok(batch)])
    };
    let with = |name: &str, column: ArrayRef| {
        let schema = batch.schema();
        let mut fields: Vec<_> = schema.fields().iter().map(|f| f.as_ref().clone()).collect();
        let mut columns = batch.columns().to_vec();
        let i = schema.index_of(name).unwrap();
        fields[i] = Field::new(name, column.data_type().clone(), true);
        columns[i] = column;
        let schema = Schema::new(fields).with_metadata(schema.metadata().clone());
        RecordBatch::try_new(Arc::new(schema), columns).unwrap()
    };
    // Another type, a point of which one value is missing, and a row without anything.
    let error = read(with(
        "board_tracks",
        Arc::new(Float64Array::from(vec![1.0; batch.num_rows()])),
    ));
    assert!(error.unwrap_err().to_string().contains("`board_tracks`"));
    let mut values = vec![Some(1.0_f32); batch.num_rows()];
    values[0] = None;
    let error = read(with("z_m", Arc::new(Float32Array::from(values))))
        .unwrap_err()
        .to_string();
    assert!(error.contains("`z_m`, row 0: is null"), "{error}");
    // The same report in two rows of a frame.
    let row = batch.slice(2, 1);
    let metadata = metadata_of(&batch);
    let name = std::path::Path::new("table");
    let error = points_from_batches(name, &metadata, [Ok(row.clone()), Ok(row)]).unwrap_err();
    let error = error.to_string();
    assert!(error.contains("frame 1 has one already"), "{error}");
}
