//! MARS-like recordings in MATLAB v5 files.

use radarllm_formats::{
    recordings::{read_mat_array, read_matlab_points},
    uart::MAGIC,
};

use crate::{
    make::{mars_mat, mat, mat_element, words},
    ti_files::shared,
};

#[test]
fn arrays_are_undone_from_column_order_and_empty_rows_left_out() {
    for is_compressed in [false, true] {
        let bytes = mars_mat(3, is_compressed);
        let recording = read_matlab_points(&bytes).unwrap();
        assert!(recording.notes.is_empty());
        let frames = recording.frames;
        assert_eq!(frames.len(), 3);
        for (i, frame) in frames.iter().enumerate() {
            assert_eq!((frame.number, frame.stamp_s), (i as u64, None));
            let [p] = frame.points.as_slice() else {
                panic!("{} points", frame.points.len());
            };
            let x_m = 0.25 * i as f32;
            assert_eq!(
                [p.x_m, p.y_m, p.z_m, p.velocity_mps, p.intensity_db],
                [x_m, 2.0, 1.0, 0.5, 20.0]
            );
            assert!((p.range_m - (x_m * x_m + 5.0).sqrt()).abs() < 1e-6);
        }
        // Other variables may stand before it.
        let rate = read_mat_array(&bytes, "frameRate").unwrap();
        assert_eq!((rate.shape, rate.values), (vec![1, 1], vec![10.0]));
    }
}

#[test]
fn wrong_shapes_are_named() {
    let error = |shape: &[u32], values: &[f32]| {
        read_matlab_points(&mat(&[("marsData", shape, values)], true)).unwrap_err()
    };
    let shape = error(&[2, 5], &[0.0; 10]);
    assert!(shape.expected.contains("(frames, 64, 5)"), "{shape}");
    assert!(shape.found.contains("[2, 5]"), "{shape}");
    // Numbers of a shape that are not there, and one whose product overflows.
    for shape in [[3, 64, 5], [u32::MAX, u32::MAX, u32::MAX], [0, 64, 5]] {
        let error = error(&shape, &[0.0; 320]);
        assert!(error.expected.contains("values of an array"), "{error}");
    }
    assert_eq!(
        read_matlab_points(&mat(&[("marsData", &[0, 64, 5], &[])], true)),
        Ok(Default::default())
    );
    let other = read_matlab_points(&mat(&[("points", &[1, 64, 5], &[0.0; 320])], true));
    assert!(other.unwrap_err().to_string().contains("`points`"));
}

/// The rows behind a torn one are read at the wrong place, however likely they look.
#[test]
fn a_torn_packet_ends_the_points_of_its_frame() {
    for bad in [f32::NAN, f32::INFINITY, 1e9, -1e-30, f32::from_bits(1)] {
        // Two frames with points in rows 0 to 4; in frame 1 the x of row 2 is damaged.
        let mut values = vec![0.0; 2 * 320];
        for frame in 0..2 {
            for row in 0..5 {
                for k in 0..5 {
                    values[frame + 2 * (row + 64 * k)] = 1.5;
                }
            }
        }
        values[1 + 2 * 2] = bad;
        let file = mat(&[("marsData", &[2, 64, 5], &values)], true);
        let recording = read_matlab_points(&file).unwrap();
        let n: Vec<usize> = recording.frames.iter().map(|f| f.points.len()).collect();
        assert_eq!(n, [5, 2], "{bad}");
        assert_eq!(
            (recording.points_dropped, recording.frames_damaged),
            (3, 1),
            "{bad}"
        );
        assert_eq!(
            recording.notes,
            ["torn packets in 1 frames, the first in frame 1: 3 rows after the tear are dropped"]
        );
    }
}

/// A small file that inflates to a large one: nothing is inflated but the head, unless it is the variable asked for,
/// and then no more than it states.
#[test]
fn compressed_variables_are_inflated_no_further_than_needed() {
    use std::io::Write;
    let compress = |bytes: &[u8]| {
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    };
    let head = [
        mat_element(6, &words(&[7, 0])),
        mat_element(5, &words(&[1, 64, 5])),
        mat_element(1, b"marsData"),
    ]
    .concat();
    let header = &mars_mat(0, false)[..128];
    let zeros = vec![0; 4 << 20];
    for stated in [0, 100, 1 << 20, u32::MAX] {
        let variable = [
            words(&[14, stated]),
            head.clone(),
            words(&[7, stated]),
            zeros.clone(),
        ];
        let data = compress(&variable.concat());
        let file = [header.to_vec(), words(&[15, data.len() as u32]), data].concat();
        assert!(read_matlab_points(&file).is_err(), "{stated}");
        assert!(read_mat_array(&file, "x").is_err(), "{stated}");
    }
    // What is no zlib stream at all.
    let file = [header.to_vec(), words(&[15, 8]), MAGIC.to_vec()].concat();
    let error = read_matlab_points(&file).unwrap_err();
    assert!(error.expected.contains("zlib"), "{error}");
}

/// The figures of the data's description: 200 frames, 38 to 64 points a frame, most of them slow,
/// people at 1.1 to 1.5 m.
#[test]
fn recordings_of_others_are_read() {
    let Some(folder) = shared()
        .map(|s| s.join("data/ansenchen"))
        .filter(|f| f.is_dir())
    else {
        println!("skipped: ansenchen is not in the shared data (RADARLLM_SHARED)");
        return;
    };
    let (mut n_files, mut n_damaged) = (0, 0);
    for label in std::fs::read_dir(folder).unwrap() {
        let label = label.unwrap().path();
        if !label.is_dir() {
            continue;
        }
        for file in std::fs::read_dir(label).unwrap() {
            let path = file.unwrap().path();
            let name = path.display();
            let bytes = std::fs::read(&path).unwrap();
            let recording = read_matlab_points(&bytes).unwrap_or_else(|e| panic!("{name}: {e}"));
            let frames = recording.frames;
            n_damaged += recording.frames_damaged;
            assert_eq!(frames.len(), 200, "{name}");
            let points: Vec<_> = frames.iter().flat_map(|f| &f.points).collect();
            let mean = points.len() as f64 / 200.0;
            assert!(
                (38.0..=64.0).contains(&mean),
                "{name}: {mean} points a frame"
            );
            let speeds = points.iter().map(|p| p.velocity_mps.abs());
            let fastest = speeds.fold(0.0, f32::max);
            assert!((0.1..1.5).contains(&fastest), "{name}: {fastest} m/s");
            assert!(
                points.iter().all(|p| p.y_m >= 0.0 && p.range_m < 20.0),
                "{name}"
            );
            let n_slow = points.iter().filter(|p| p.velocity_mps.abs() < 0.3).count();
            assert!(
                2 * n_slow > points.len(),
                "{name}: {n_slow} of {}",
                points.len()
            );
            assert!(
                points
                    .iter()
                    .all(|p| (0.0..100.0).contains(&p.intensity_db)),
                "{name}"
            );
            n_files += 1;
        }
    }
    // Four frames are torn: one of body_tilt, one of right_side_lunge, two of wave.
    assert_eq!((n_files, n_damaged), (15, 4));
}
