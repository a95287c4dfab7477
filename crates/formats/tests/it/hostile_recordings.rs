//! Every reader of recordings against truncations, damage and noise: an error or frames, never a panic.

use proptest::prelude::*;
use radarllm_base::{RecordedFrame, Timeline};
use radarllm_formats::{
    detect,
    recordings::{
        Axes, join_parts, join_run, read_bag, read_mars_features, read_mars_points, read_mat_array,
        read_matlab_points, read_mmbody_calibration, read_mmbody_frame, read_mmfi_frame,
        read_radhar_points, read_visualizer_binary, read_visualizer_binary_run,
        read_visualizer_json,
    },
    tables::{read_points_csv, read_points_npy},
};

use crate::make::{CALIBRATION, CSV, MARS, RADHAR, TABLES, mars_mat, npy, seeds};

/// Everything that reads bytes, on the same bytes. Points can only come from bytes that are there.
fn read_all(bytes: &[u8]) {
    let axes = Axes::RightForwardUp;
    let text = String::from_utf8_lossy(bytes);
    let sane = |frames: Vec<RecordedFrame>| {
        let points: Vec<_> = frames.iter().flat_map(|f| &f.points).collect();
        assert!(points.len() <= bytes.len());
        assert!(
            points
                .iter()
                .all(|p| p.range_m.is_finite() && p.intensity_db.is_finite())
        );
        let _ = Timeline::new(frames.clone(), None);
        if let Ok(line) = Timeline::new(frames, Some(10.0)) {
            let _ = line.resample(30.0, true);
            let _ = line.accumulate(3, true);
        }
    };
    for columns in [
        None,
        Some("frame,t,x,y,z,v,snr"),
        Some("-,t,range,azimuth,elevation,v,-"),
    ] {
        let _ = read_points_csv(&text, axes, columns).map(|table| sane(table.frames));
        let _ = read_points_npy(bytes, axes, columns).map(|table| sane(table.frames));
    }
    let _ = read_mars_points(&text).map(sane);
    let _ = read_radhar_points(&text).map(sane);
    let _ = read_mmbody_calibration(&text);
    let _ = read_mars_features(bytes).map(sane);
    let _ = read_mmbody_frame(bytes).map(|points| assert!(points.len() <= 128));
    let _ = read_mmfi_frame(bytes, axes);
    let _ = read_bag(bytes, None, axes).map(|bag| sane(bag.frames));
    let _ = read_matlab_points(bytes).map(|r| sane(r.frames));
    for name in ["x", "frameRate"] {
        let _ = read_mat_array(bytes, name).map(|a| assert!(a.values.len() <= bytes.len()));
    }
    if let Ok(part) = read_visualizer_json(&text) {
        let again = part.clone();
        let mut halves = (part.clone(), part.clone());
        halves.1.frames = halves.0.frames.split_off(part.frames.len() / 2);
        for run in [None, Some(1), Some(2)] {
            let halves = vec![(1, halves.1.clone()), (2, halves.0.clone())];
            let n_frames = join_run(halves, run).map_or(0, |r| r.frames.len());
            assert!(n_frames <= part.frames.len());
        }
        let mut recording = join_parts(vec![(2, part), (1, again)]).unwrap();
        recording.lower(2.0);
        sane(recording.frames.into_iter().map(|f| f.frame).collect());
    }
    let (first, second) = bytes.split_at(bytes.len() / 3);
    let _ = read_visualizer_binary(vec![(7, second), (2, first)], None);
    let _ = read_visualizer_binary_run(vec![(2, second), (7, first)], None, Some(1));
    for name in [
        "x.bin",
        "x.npy",
        "frame_1.npy",
        "frame001.bin",
        "x.csv",
        "replay_1.json",
        "x.mat",
        "",
    ] {
        let _ = detect(name, bytes);
    }
}

#[test]
fn seeds_are_read_by_their_reader() {
    let axes = Axes::RightForwardUp;
    let s = seeds();
    assert_eq!(read_points_csv(CSV, axes, None).unwrap().frames.len(), 2);
    assert_eq!(read_mars_points(MARS).unwrap().len(), 1);
    assert_eq!(read_radhar_points(RADHAR).unwrap().len(), 1);
    assert_eq!(read_mmbody_calibration(CALIBRATION).unwrap().len(), 1);
    assert_eq!(
        read_points_npy(&s[4], axes, None).unwrap().frames,
        read_points_csv(CSV, axes, None)
            .unwrap()
            .frames
            .into_iter()
            .map(|f| RecordedFrame {
                stamp_s: f.stamp_s.map(|t| f64::from(t as f32)),
                ..f
            })
            .collect::<Vec<_>>()
    );
    assert_eq!(read_points_npy(&s[5], axes, None).unwrap().frames.len(), 2);
    let features = read_mars_features(&s[6]).unwrap();
    assert_eq!((features.len(), features[0].points.len()), (1, 64));
    assert_eq!(read_mmbody_frame(&s[7]).unwrap().len(), 2);
    assert_eq!(read_mmfi_frame(&s[8], axes).unwrap().len(), 2);
    assert_eq!(
        read_bag(s[9].as_slice(), None, axes).unwrap().frames.len(),
        2
    );
    let part = read_visualizer_json(std::str::from_utf8(&s[10]).unwrap()).unwrap();
    assert_eq!(part.frames.len(), 3);
    assert_eq!(read_matlab_points(&s[11]).unwrap().frames.len(), 2);
    let frames = read_matlab_points(&s[12]).unwrap().frames;
    assert_eq!(frames[0].points.len(), 64);
}

#[test]
fn truncations_at_every_byte() {
    let tables = TABLES.map(|(_, table)| table.as_bytes().to_vec());
    for seed in seeds().into_iter().chain(tables) {
        for end in 0..seed.len() {
            read_all(&seed[..end]);
        }
    }
}

#[test]
fn arrays_that_lie_about_their_size_are_refused() {
    for shape in [
        "(1000000000000, 7)",
        "(9000000000000000, 7)",
        "(1, 7)",
        "(-1, 7)",
        "(7,)",
        "()",
    ] {
        let bytes = npy("'<f4'", shape, &[0.0; 3]);
        assert!(
            read_points_npy(&bytes, Axes::RightForwardUp, None).is_err(),
            "{shape}"
        );
        assert!(read_mmbody_frame(&bytes).is_err(), "{shape}");
        assert!(read_mars_features(&bytes).is_err(), "{shape}");
    }
}

#[test]
fn the_strongest_points_of_mmbody_stay() {
    let values: Vec<f32> = (0..200)
        .flat_map(|i| [0.5, 2.0, 0.0, 0.1, (i * 37 % 200) as f32, 0.0])
        .collect();
    let points = read_mmbody_frame(&npy("'<f4'", "(200, 6)", &values)).unwrap();
    let kept: Vec<f32> = points.iter().map(|p| p.intensity_db).collect();
    let strongest: Vec<f32> = (72..200).rev().map(|v| v as f32).collect();
    assert_eq!(kept, strongest);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn damage_anywhere(which in 0_usize..13, changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12)) {
        let mut bytes = seeds().swap_remove(which);
        for (at, value) in changes {
            let n = bytes.len();
            bytes[at.index(n)] = value;
        }
        read_all(&bytes);
    }

    #[test]
    fn damaged_tables(which in 0..TABLES.len(), changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        let mut bytes = TABLES[which].1.as_bytes().to_vec();
        for (at, value) in changes {
            let n = bytes.len();
            bytes[at.index(n)] = value;
        }
        read_all(&bytes);
    }

    #[test]
    fn noise(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        read_all(&bytes);
        read_all(&[b"#ROSBAG V2.0\n".as_slice(), &bytes].concat());
        read_all(&[b"\x93NUMPY\x01\x00".as_slice(), &bytes].concat());
        read_all(&[&mars_mat(0, false)[..128], &bytes].concat());
    }
}
