//! TI chirp files: the reader and every rule of lint, whose spans must lie in the file.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::{lint_ti_cfg, radar_from_ti_cfg};

fuzz_target!(|bytes: &[u8]| {
    let text = String::from_utf8_lossy(bytes);
    let _ = radar_from_ti_cfg(&text);
    let n_lines = text.lines().count();
    for finding in lint_ti_cfg(&text, None) {
        if let Some(span) = &finding.span {
            assert!((1..=n_lines.max(1)).contains(&span.line), "{finding:?}");
        }
    }
});
