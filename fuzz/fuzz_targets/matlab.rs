//! MATLAB v5 files.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::recordings::{read_mat_array, read_matlab_points};

fuzz_target!(|bytes: &[u8]| {
    for name in ["x", "marsData"] {
        if let Ok(array) = read_mat_array(bytes, name) {
            // No more than what a zlib stream of this length can hold.
            assert!(array.values.len() <= 1032 * bytes.len());
            assert_eq!(array.values.len(), array.shape.iter().product::<usize>());
        }
    }
    if let Ok(recording) = read_matlab_points(bytes) {
        for point in recording.frames.iter().flat_map(|f| &f.points) {
            assert!(point.range_m.is_finite() && point.intensity_db.is_finite());
        }
    }
});
