//! Exports of mmWave Studio.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::adc::{StudioCapture, StudioSetup};

fuzz_target!(|input: &[u8]| {
    let text = String::from_utf8_lossy(input);
    if let Ok(capture) = StudioCapture::parse(&text, None) {
        capture
            .radar
            .validate()
            .expect("only radars that can exist");
    }
    let _ = StudioSetup::parse(&text);
});
