//! A visualizer's JSON: two copies of a file joined, and what io does with the result.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::recordings::{join_parts, read_visualizer_json};

fuzz_target!(|bytes: &[u8]| {
    let Ok(part) = read_visualizer_json(&String::from_utf8_lossy(bytes)) else {
        return;
    };
    let points: usize = part.frames.iter().map(|f| f.frame.points.len()).sum();
    assert!(part.frames.len() + points <= bytes.len());
    let mut recording = join_parts(vec![(2, part.clone()), (1, part)]).expect("the same recording");
    recording.lower(2.0);
    for point in recording.frames.iter().flat_map(|f| &f.frame.points) {
        assert!(point.range_m.is_finite() && point.intensity_db.is_finite());
    }
});
