//! The recorder's log.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::adc::RecordLog;

fuzz_target!(|input: &[u8]| {
    if let Ok(log) = RecordLog::parse(&String::from_utf8_lossy(input)) {
        let _ = log.problems();
    }
});
