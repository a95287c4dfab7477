//! Radars and channel calibrations in TOML.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::{Calibration, lint_radar_toml, radar_from_toml};

fuzz_target!(|bytes: &[u8]| {
    let text = String::from_utf8_lossy(bytes);
    let _ = lint_radar_toml(&text, None);
    if let Ok(radar) = radar_from_toml(&text) {
        let _ = Calibration::from_toml(&text).map(|c| c.gains(&radar));
    }
    if let Ok(calibration) = Calibration::from_toml(&text) {
        let again = calibration.to_toml().expect("what was read can be written");
        assert!(Calibration::from_toml(&again).is_ok_and(|c| c == calibration));
    }
});
