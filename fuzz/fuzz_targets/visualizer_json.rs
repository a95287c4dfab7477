//! A visualizer's JSON: two copies of a file joined, what io does with the result, and its halves as two runs.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_formats::recordings::{join_parts, join_run, read_visualizer_json};

fuzz_target!(|bytes: &[u8]| {
    let Ok(part) = read_visualizer_json(&String::from_utf8_lossy(bytes)) else {
        return;
    };
    let points: usize = part.frames.iter().map(|f| f.frame.points.len()).sum();
    assert!(part.frames.len() + points <= bytes.len());
    let mut first = part.clone();
    let mut second = part.clone();
    second.frames = first.frames.split_off(part.frames.len() / 2);
    for run in [None, Some(1), Some(2)] {
        let halves = vec![(1, second.clone()), (2, first.clone())];
        let n_frames = join_run(halves, run).map_or(0, |r| r.frames.len());
        assert!(n_frames <= part.frames.len());
    }
    let mut recording = join_parts(vec![(2, part.clone()), (1, part)]).expect("the same recording");
    recording.lower(2.0);
    for point in recording.frames.iter().flat_map(|f| &f.frame.points) {
        assert!(point.range_m.is_finite() && point.intensity_db.is_finite());
    }
});
