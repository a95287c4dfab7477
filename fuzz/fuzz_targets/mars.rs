//! MARS tables and feature maps.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::recordings::{read_mars_features, read_mars_points};

fuzz_target!(|bytes: &[u8]| {
    let _ = read_mars_points(&String::from_utf8_lossy(bytes));
    let _ = read_mars_features(bytes);
});
