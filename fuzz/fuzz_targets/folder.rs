//! Names of files in folders, one a line, and heights in chirp files.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::{
    RecordingFormat, SensorPosition, choose_cfg, detect::detect_folder, find_builtin,
    visualizer_folder,
};

fuzz_target!(|bytes: &[u8]| {
    let text = String::from_utf8_lossy(bytes);
    let names: Vec<&str> = text.lines().collect();
    let _ = detect_folder(names.iter().copied());
    let _ = choose_cfg(names.iter().copied(), names.iter().rev().copied());
    for format in [None, Some(RecordingFormat::VisualizerBinary)] {
        if let Ok(Some(found)) = visualizer_folder(&names, format) {
            assert!(!found.files.is_empty());
            assert!(
                found
                    .files
                    .iter()
                    .all(|(_, name)| names.contains(&name.as_str()))
            );
        }
    }
    for name in names {
        let _ = find_builtin(name);
    }
    if let Ok(Some(position)) = SensorPosition::from_ti_cfg(&text) {
        assert!(
            position
                .mounting()
                .level([1.0, 2.0, 3.0])
                .iter()
                .all(|v| v.is_finite())
        );
    }
});
