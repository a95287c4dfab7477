//! MATLAB v7.3 files, which are HDF5, made by the writer of the same crate. The files of MARS were compared with its tables:
//! docs/guides/recordings.md.

use hdf5_pure::FileBuilder;
use radarllm_formats::{
    detect::{RecordingFormat, detect},
    recordings::{read_mat_array, read_matlab_points},
};

/// A v7.3 file with variables (name, shape as in MATLAB, values with the first index fastest), compressed or not.
fn mat73(variables: &[(&str, &[u64], &[f64])], is_compressed: bool) -> Vec<u8> {
    let mut header = b"MATLAB 7.3 MAT-file, made by a test".to_vec();
    header.resize(124, b' ');
    header.extend([0, 2, b'I', b'M']);
    let mut file = FileBuilder::new();
    file.with_userblock(512).with_userblock_content(&header);
    for (name, shape, values) in variables {
        // HDF5 lists dimensions from the slowest.
        let shape: Vec<u64> = shape.iter().rev().copied().collect();
        let data = file.create_dataset(name);
        data.with_f64_data(values).with_shape(&shape);
        if is_compressed {
            data.with_chunks(&shape).with_shuffle().with_deflate(6);
        }
    }
    file.finish().unwrap()
}

/// `marsData` of two frames: the third row of each has x = 0.25 times the frame, y = 2, z = 1, 0.5 m/s, 20 dB.
fn recorder(is_compressed: bool) -> Vec<u8> {
    let mut values = vec![0.0; 2 * 320];
    for frame in 0..2 {
        let point = [0.25 * frame as f64, 2.0, 1.0, 0.5, 20.0];
        for (k, value) in point.into_iter().enumerate() {
            values[frame + 2 * (2 + 64 * k)] = value;
        }
    }
    let variables: [(&str, &[u64], &[f64]); 2] = [
        ("frameRate", &[1, 1], &[10.0]),
        ("marsData", &[2, 64, 5], &values),
    ];
    mat73(&variables, is_compressed)
}

#[test]
fn arrays_of_both_versions_are_the_same() {
    for is_compressed in [false, true] {
        let bytes = recorder(is_compressed);
        let detected = detect("x.mat", &bytes).unwrap();
        assert_eq!(detected.format, RecordingFormat::Mat);
        let frames = read_matlab_points(&bytes).unwrap().frames;
        assert_eq!(frames.len(), 2);
        for (i, frame) in frames.iter().enumerate() {
            let [p] = frame.points.as_slice() else {
                panic!("{} points", frame.points.len());
            };
            assert_eq!(
                [p.x_m, p.y_m, p.z_m, p.velocity_mps, p.intensity_db],
                [0.25 * i as f32, 2.0, 1.0, 0.5, 20.0]
            );
        }
        let rate = read_mat_array(&bytes, "frameRate").unwrap();
        assert_eq!((rate.shape, rate.values), (vec![1, 1], vec![10.0]));
        let error = read_mat_array(&bytes, "other").unwrap_err();
        assert!(error.expected.contains("a variable `other`"), "{error}");
        assert!(error.found.contains("frameRate"), "{error}");
    }
}

#[test]
fn points_of_mars_are_frames_of_equal_numbers() {
    // Columns: frame, points, x, y, z, velocity, peak, time.
    let rows = [
        [7.0, 2.0, 0.1, 2.0, 0.3, -0.5, 100.0, 1.0],
        [7.0, 2.0, 0.2, 2.5, 0.4, 0.5, 0.0, 1.0],
        [9.0, 1.0, 0.3, 3.0, 0.5, 0.0, 1000.0, 1.2],
    ];
    let columns = |rows: &[[f64; 8]]| -> Vec<f64> {
        (0..8)
            .flat_map(|k| rows.iter().map(move |r| r[k]))
            .collect()
    };
    let read = |rows: &[[f64; 8]]| {
        let values = columns(rows);
        read_matlab_points(&mat73(
            &[("radar_data_cropped", &[rows.len() as u64, 8], &values)],
            true,
        ))
    };
    let frames = read(&rows).unwrap().frames;
    let described: Vec<_> = frames.iter().map(|f| (f.number, f.points.len())).collect();
    assert_eq!(described, [(7, 2), (9, 1)]);
    let p = frames[0].points[0];
    assert_eq!([p.x_m, p.y_m, p.z_m, p.velocity_mps], [0.1, 2.0, 0.3, -0.5]);
    // 20 log10 of the peak; a peak of 0 counts as 1.
    let db: Vec<f32> = frames
        .iter()
        .flat_map(|f| &f.points)
        .map(|p| p.intensity_db)
        .collect();
    assert_eq!(db, [40.0, 0.0, 60.0]);
    for (column, bad, part) in [
        (0, 7.5, "a frame number"),
        (0, -1.0, "a frame number"),
        (0, f64::NAN, "a frame number"),
        (3, 1e9, "y, m"),
        (5, f64::NAN, "velocity"),
    ] {
        let mut rows = rows;
        rows[1][column] = bad;
        let error = read(&rows).unwrap_err().to_string();
        assert!(
            error.starts_with("row 1") && error.contains(part),
            "{error}"
        );
    }
    let wrong = mat73(&[("radar_data_cropped", &[2, 7], &[0.0; 14])], false);
    let error = read_matlab_points(&wrong).unwrap_err().to_string();
    assert!(
        error.contains("(points, 8)") && error.contains("[2, 7]"),
        "{error}"
    );
}

#[test]
fn damaged_files_are_errors_or_numbers() {
    let whole = recorder(true);
    for end in 0..whole.len() {
        let _ = read_matlab_points(&whole[..end]);
    }
    assert!(read_matlab_points(&whole[..600]).is_err());
    for at in 0..whole.len() {
        for value in [0, 0x7f, 0xff, whole[at] ^ 1] {
            let mut bytes = whole.clone();
            bytes[at] = value;
            if let Ok(recording) = read_matlab_points(&bytes) {
                let points = recording.frames.iter().flat_map(|f| &f.points);
                assert!(points.into_iter().all(|p| p.range_m.is_finite()));
            }
        }
    }
}
