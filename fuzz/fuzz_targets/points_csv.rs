//! A points table, CSV.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::{recordings::Axes, tables::read_points_csv};

fuzz_target!(|bytes: &[u8]| {
    let _ = read_points_csv(&String::from_utf8_lossy(bytes), Axes::RightForwardUp);
});
