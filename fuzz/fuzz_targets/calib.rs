//! A calibration file: a Python literal that is parsed, never evaluated.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::recordings::read_mmbody_calibration;

fuzz_target!(|bytes: &[u8]| {
    let _ = read_mmbody_calibration(&String::from_utf8_lossy(bytes));
});
