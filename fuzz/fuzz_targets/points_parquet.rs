//! Points files in Parquet, as a whole and frame by frame.
#![no_main]

use std::fs::File;

use libfuzzer_sys::fuzz_target;
use radarllm_dataset::{PointsReader, read_points_from};
use radarllm_fuzz::{only_our_panics, temporary};

/// A file may state many lost and empty frames; more of them are the same again.
const MAX_FRAMES: usize = 100_000;

fuzz_target!(init: only_our_panics(), |bytes: &[u8]| {
    let file = temporary(bytes);
    let path = file.path();
    let open = || File::open(path).expect("a temporary file");
    let _ = read_points_from(open(), path);
    if let Ok(Some(mut reader)) = PointsReader::open(open(), path) {
        for _ in 0..MAX_FRAMES {
            if !matches!(reader.next_frame(), Ok(Some(_))) {
                break;
            }
        }
    }
});
