//! RadHAR text.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::recordings::read_radhar_points;

fuzz_target!(|bytes: &[u8]| {
    let _ = read_radhar_points(&String::from_utf8_lossy(bytes));
});
