//! Clips made of sines, for tests of the training code. They look like nothing in particular.

use radarllm_base::{PointFrame, RadarPoint};
use radarllm_dataset::record::{ClipRecord, MOTION_FEATURE_DIM, Split};

/// `n` clips of `n_frames` radar frames with `n_points` points, and motion features to match.
pub fn clips(n: usize, n_frames: usize, n_points: usize) -> Vec<ClipRecord> {
    (0..n).map(|i| clip(i, n_frames, n_points)).collect()
}

fn clip(seed: usize, n_frames: usize, n_points: usize) -> ClipRecord {
    let phase = seed as f32 * 1.7;
    let rate = 0.5 + 0.3 * (seed % 5) as f32;
    let frame = |f: usize| {
        let t = f as f32 * 0.1;
        let swing = (rate * t * 6.0 + phase).sin();
        let points = (0..n_points).map(|i| {
            let u = i as f32 / n_points.max(1) as f32;
            let x = 0.3 * (u * 37.0).sin() + 0.3 * swing * u;
            let y = 3.0 + 0.2 * (u * 23.0).cos();
            let z = 1.7 * u - 1.0;
            RadarPoint {
                x_m: x,
                y_m: y,
                z_m: z,
                range_m: (x * x + y * y + z * z).sqrt(),
                velocity_mps: swing * u,
                intensity_db: 30.0 - 10.0 * u,
            }
        });
        PointFrame {
            frame: f as u32,
            time_s: f64::from(t),
            points: points.collect(),
            board: None,
        }
    };
    let feature = |f: usize, d: usize| {
        let t = f as f32 * 0.05;
        (rate * t * 6.0 + phase + d as f32 * 0.2).sin() * 0.3
    };
    let motion_features = (0..2 * n_frames)
        .flat_map(|f| (0..MOTION_FEATURE_DIM).map(move |d| feature(f, d)))
        .collect();
    ClipRecord {
        id: format!("m{seed}#0"),
        motion_id: format!("m{seed}"),
        group: format!("m{seed}"),
        split: Split::Train,
        action: "swing".into(),
        captions: vec!["a person swings".into()],
        source: "test".into(),
        radar: "awr1843boost".into(),
        radar_height_m: 1.0,
        seed: seed as u64,
        frames: (0..n_frames).map(frame).collect(),
        motion_fps: 20.0,
        joints: Vec::new(),
        motion_features,
        rotations6d: Vec::new(),
        body_height_m: 0.0,
    }
}
