//! Checkpoints of a model: pieces `tokenizer/FILE`, `lm/FILE` and `evidence/FILE` become folders with right checksums. A
//! model that can be loaded describes a short recording.
#![no_main]

use libfuzzer_sys::fuzz_target;
use radarllm_base::{Clip, Clutter, PointFrame, RadarPoint};
use radarllm_fuzz::pieces;
use radarllm_inference::checkpoint::{Checkpoint, CheckpointFiles, read_floats};
use radarllm_inference::evidence::Evidence;
use radarllm_inference::tokenizer::RadarTokenizer;
use radarllm_inference::tokenizer::points::PointDecoder;
use radarllm_inference::{Captioner, DescribeOptions, Precision, PreparedClip};

const PARTS: [&str; 4] = ["tokenizer", "lm", "evidence", "points"];

fuzz_target!(|bytes: &[u8]| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let pieces = pieces(bytes);
    for part in PARTS {
        let mut files = CheckpointFiles::default();
        for (name, piece) in &pieces {
            match name.split_once('/') {
                Some((of, name)) if of == part && is_plain(name) => {
                    files.bytes(name, piece.to_vec())
                }
                _ => {}
            }
        }
        files
            .write(&folder.path().join(part))
            .expect("a temporary folder");
    }
    let [tokenizer, lm, evidence, points] = PARTS.map(|part| folder.path().join(part));
    let recording = recording();
    let clip = PreparedClip::of(&recording).expect("a recording");
    if let Ok(tokenizer) = RadarTokenizer::load(&tokenizer) {
        let _ = tokenizer.encode(&clip.frames, 1.0);
    }
    let precision = match bytes.len() % 2 {
        0 => Precision::F32,
        _ => Precision::Int8,
    };
    if let Ok(captioner) = Captioner::load(folder.path(), precision) {
        let options = DescribeOptions {
            beam: Some(1),
            ..DescribeOptions::default()
        };
        let _ = captioner.describe(&clip, &options);
    }
    if let Ok(checkpoint) = Checkpoint::open(&evidence) {
        let _ = Evidence::of(&checkpoint);
    }
    if let (Ok(points), Ok(tokenizer)) = (Checkpoint::open(&points), Checkpoint::open(&tokenizer)) {
        let _ = PointDecoder::of(&points, &tokenizer);
    }
    let _ = read_floats(&lm.join("model.safetensors"));
});

fn is_plain(name: &str) -> bool {
    !name.is_empty()
        && name
            .bytes()
            .all(|b| b.is_ascii_alphanumeric() || b"._-".contains(&b))
        && !name.starts_with('.')
}

/// A body that walks away for three seconds.
fn recording() -> Clip {
    let frame = |i: u32| {
        let time_s = f64::from(i) / 20.0;
        let point = |k: u32| RadarPoint {
            x_m: 0.3 * (k as f32 * 1.9).sin(),
            y_m: 2.0 + time_s as f32,
            z_m: 0.7 * (k as f32 * 0.7).sin(),
            range_m: 2.0 + time_s as f32,
            velocity_mps: 1.0,
            intensity_db: 30.0,
        };
        PointFrame {
            frame: i,
            time_s,
            points: (0..12).map(point).collect(),
            board: None,
        }
    };
    let Ok(provenance) = "recorded:csv:walk.csv".parse();
    Clip {
        frames: (0..60).map(frame).collect(),
        frame_rate_hz: 20.0,
        radar_height_m: 1.0,
        is_height_assumed: false,
        radar: "awr1843boost".into(),
        provenance,
        clutter: Clutter::Unchecked,
    }
}
