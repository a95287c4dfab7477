//! TI chirp files of every dialect: the reader and every rule of lint, whose spans must lie in the file.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::{TiCfg, lint_ti_cfg_named};

fuzz_target!(|bytes: &[u8]| {
    let text = String::from_utf8_lossy(bytes);
    // The first line also serves as the name of the file.
    let name = text.lines().next().unwrap_or_default();
    let reading = TiCfg::read_named(name, &text);
    assert_eq!(reading.cfg.is_some(), reading.errors.is_empty());
    if let Some(points) = &reading.points {
        assert!((1e-5..=86_400.0).contains(&points.frame_period_s));
        let figures = [points.range_resolution_m, points.max_velocity_mps];
        assert!(figures.iter().flatten().all(|v| *v > 0.0));
    }
    let radars = reading.cfg.iter().map(|cfg| &cfg.radar);
    for radar in radars.chain(&reading.equivalent) {
        assert_eq!(radar.problems(), []);
    }
    let n_lines = text.lines().count();
    for finding in lint_ti_cfg_named(name, &text, None) {
        if let Some(span) = &finding.span {
            assert!((1..=n_lines.max(1)).contains(&span.line), "{finding:?}");
        }
    }
});
