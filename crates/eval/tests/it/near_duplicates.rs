//! The guard against leaks between splits: distances of copies and of independent motions.
//!
//! `cargo test --release -p radarllm-eval --test it near_duplicates -- --nocapture` prints the distributions that
//! `LEAK_DISTANCE` was chosen from.

use glam::{Quat, Vec3};
use radarllm_base::{Motion, seed::derive_seed};
use radarllm_body::sample::{crop, mirror, resample};
use radarllm_dataset::Split;
use radarllm_eval::near_duplicates::{
    LEAK_DISTANCE, MotionClip, MotionSketch, NearestMotion, nearest_motions,
};
use radarllm_synth::corpus::{
    Corpus,
    procedural::{ProceduralConfig, ProceduralCorpus},
};

const TRAIN: usize = 1000;
const TEST: usize = 100;

fn joints(motion: &Motion) -> Vec<[[f32; 3]; 22]> {
    resample(motion, 20.0)
        .unwrap()
        .joints_in_world()
        .iter()
        .map(|pose| pose.map(|p| p.to_array()))
        .collect()
}

fn sketch(id: &str, joints: &[[[f32; 3]; 22]]) -> Option<MotionSketch> {
    MotionSketch::of(MotionClip {
        id,
        fps: 20.0,
        joints,
    })
}

/// Somewhere else, facing elsewhere, of another size.
fn placed(joints: &[[[f32; 3]; 22]], seed: u64) -> Vec<[[f32; 3]; 22]> {
    let turn = Quat::from_rotation_z((seed % 628) as f32 * 0.01);
    let (scale, shift) = (0.9 + (seed % 21) as f32 * 0.01, Vec3::new(0.4, 3.0, -1.0));
    joints
        .iter()
        .map(|pose| pose.map(|p| (turn * (scale * Vec3::from(p)) + shift).to_array()))
        .collect()
}

/// Every coordinate off by up to `most_m`, evenly.
fn noisy(joints: &[[[f32; 3]; 22]], max_m: f32, seed: u64) -> Vec<[[f32; 3]; 22]> {
    let mut n = 0;
    let mut draw = || {
        n += 1;
        (derive_seed(seed, &n.to_string()) >> 40) as f32 / (1_u64 << 23) as f32 - 1.0
    };
    joints
        .iter()
        .map(|pose| pose.map(|p| p.map(|v| v + max_m * draw())))
        .collect()
}

fn quantiles(found: &[Option<NearestMotion>]) -> (usize, String, Vec<f64>) {
    let mut distances: Vec<f64> = found.iter().flatten().map(|n| n.distance).collect();
    distances.sort_by(f64::total_cmp);
    let at = |q: f64| distances[((distances.len() - 1) as f64 * q).round() as usize];
    let text = format!(
        "least {:.4}, 1 % {:.4}, 10 % {:.4}, median {:.4}, 90 % {:.4}, most {:.4}",
        at(0.0),
        at(0.01),
        at(0.1),
        at(0.5),
        at(0.9),
        at(1.0)
    );
    (distances.len(), text, distances)
}

#[test]
fn planted_copies_are_leaks_and_independent_motions_are_not() {
    let config = ProceduralConfig {
        train: TRAIN,
        test: TEST,
        ..Default::default()
    };
    let corpus = ProceduralCorpus::new(&config, 7).unwrap();
    let motions = |split: Split| -> Vec<(String, Motion)> {
        let items = corpus.items().iter().enumerate();
        items
            .filter(|(_, item)| item.split == split)
            .map(|(i, item)| (item.motion_id.clone(), corpus.motion(i).unwrap()))
            .collect()
    };
    let train = motions(Split::Train);
    let sketches: Vec<MotionSketch> = train
        .iter()
        .enumerate()
        .filter_map(|(i, (id, motion))| sketch(id, &placed(&joints(motion), i as u64)))
        .collect();
    let test = motions(Split::Test);
    let honest: Vec<MotionSketch> = test
        .iter()
        .enumerate()
        .filter_map(|(i, (id, motion))| sketch(id, &placed(&joints(motion), 3 * i as u64)))
        .collect();
    let started = std::time::Instant::now();
    let found = nearest_motions(&sketches, &honest);
    let (n, text, distances) = quantiles(&found);
    println!(
        "independent: {n} of {TEST} judged against {} clips in {:.1} s: {text}",
        sketches.len(),
        started.elapsed().as_secs_f64()
    );
    let below = distances.iter().filter(|d| **d < LEAK_DISTANCE).count();

    // Every twentieth training motion, changed, as if it were held out.
    let length = |motion: &Motion| motion.duration_s();
    let faster = |motion: &Motion| Motion {
        fps: motion.fps * 1.03,
        ..motion.clone()
    };
    type Change = dyn Fn(&Motion, u64) -> Vec<[[f32; 3]; 22]>;
    // Share that must be found; the rest are cuts with too little motion left, and noise near the threshold.
    let changes: [(&str, f64, Box<Change>); 9] = [
        ("the same", 1.0, Box::new(|m, _| joints(m))),
        (
            "placed elsewhere",
            1.0,
            Box::new(|m, seed| placed(&joints(m), seed)),
        ),
        (
            "mirrored",
            1.0,
            Box::new(|m, seed| placed(&joints(&mirror(m)), seed)),
        ),
        (
            "the last 70 %",
            0.9,
            Box::new(move |m, seed| placed(&joints(&crop(m, 0.3 * length(m), 1e9)), seed)),
        ),
        (
            "the middle 60 %, mirrored",
            0.9,
            Box::new(move |m, _| joints(&mirror(&crop(m, 0.2 * length(m), 0.8 * length(m))))),
        ),
        (
            "at 12.5 Hz and back",
            1.0,
            Box::new(|m, _| joints(&resample(m, 12.5).unwrap())),
        ),
        (
            "3 % faster",
            0.8,
            Box::new(move |m, seed| placed(&joints(&faster(m)), seed)),
        ),
        (
            "joints off by up to 4 mm",
            0.8,
            Box::new(|m, seed| noisy(&placed(&joints(m), seed), 0.004, seed)),
        ),
        // Not found, and documented as such.
        (
            "joints off by up to 2 cm",
            0.0,
            Box::new(|m, seed| noisy(&placed(&joints(m), seed), 0.02, seed)),
        ),
    ];
    let mut missed = Vec::new();
    for (what, min, change) in &changes {
        let planted: Vec<MotionSketch> = train
            .iter()
            .step_by(20)
            .enumerate()
            .filter_map(|(i, (id, motion))| sketch(id, &change(motion, 11 * i as u64)))
            .collect();
        let found = nearest_motions(&sketches, &planted);
        let (n, text, distances) = quantiles(&found);
        let leaks = distances.iter().filter(|d| **d < LEAK_DISTANCE).count();
        println!("{what}: {leaks} of {n} judged are leaks: {text}");
        if (leaks as f64) < min * n as f64 {
            missed.push(format!("{what}: {leaks} of {n}"));
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
    assert_eq!(below, 0, "independent motions are no leaks");
}
