//! A points table, CSV.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::{recordings::Axes, tables::read_points_csv};

fuzz_target!(|bytes: &[u8]| {
    let text = String::from_utf8_lossy(bytes);
    for columns in [
        None,
        Some("frame,t,x,y,z,v,snr"),
        Some("t,range,azimuth,elevation,v,-,-"),
    ] {
        let _ = read_points_csv(&text, Axes::RightForwardUp, columns);
    }
});
