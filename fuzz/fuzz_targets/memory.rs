//! The file of taught activities, and a recording that is compared with it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_base::{Clip, Clutter, PointFrame, RadarPoint};
use radarllm_fuzz::temporary;
use radarllm_teach::{Memory, Recogniser};

fuzz_target!(|bytes: &[u8]| {
    let file = temporary(bytes);
    let Ok(memory) = Memory::load(file.path()) else {
        return;
    };
    let _ = memory.overview();
    if let Some(recogniser) = Recogniser::new(&memory) {
        let _ = recogniser.recognise(&recording());
    }
    memory.save(file.path()).expect("a temporary file");
    assert!(Memory::load(file.path()).is_ok_and(|again| again == memory));
});

/// Somebody whose height goes up and down.
fn recording() -> Clip {
    let frame = |i: u32| {
        let time_s = i as f32 / 10.0;
        let point = RadarPoint {
            y_m: 2.0,
            z_m: 0.3 * (3.1 * time_s).sin(),
            range_m: 2.0,
            velocity_mps: 0.3,
            ..RadarPoint::default()
        };
        PointFrame {
            frame: i,
            time_s: time_s.into(),
            points: vec![point; 5],
            board: None,
        }
    };
    let Ok(provenance) = "recorded:csv:room.csv".parse();
    Clip {
        frames: (0..60).map(frame).collect(),
        frame_rate_hz: 10.0,
        radar_height_m: 1.0,
        is_height_assumed: false,
        radar: "iwr6843isk".into(),
        provenance,
        clutter: Clutter::Settled,
    }
}
