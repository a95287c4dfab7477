//! Stage `evidence` end to end on made-up clips of fists beside a body.

use std::fs;

use radarllm_base::random::SplitMix64;
use radarllm_base::{PointFrame, RadarPoint};
use radarllm_dataset::record::ClipRecord;
use radarllm_inference::checkpoint::Checkpoint;
use radarllm_inference::evidence::{Evidence, WindowValues};
use radarllm_train::evidence::{self, EvidenceTrainConfig};
use radarllm_train::harness::TrainError;

use crate::{scratch, steps, synthetic};

/// A body at 3 m that keeps still, and a fist that goes to and fro `hand_m` to the right of it; without a hand, the body
/// walks to the radar and back.
fn frames(hand_m: Option<f32>, seed: u64) -> Vec<PointFrame> {
    let mut rng = SplitMix64::new(seed);
    let rate_hz = 0.7 + 0.6 * rng.uniform_f32();
    let frame = |i: u32| {
        let phase = std::f32::consts::TAU * rate_hz * 0.1 * i as f32;
        let body_mps = if hand_m.is_some() {
            0.0
        } else {
            (phase / 4.0).cos()
        };
        let mut point = |x_m: f32, z_m: f32, velocity_mps: f32| RadarPoint {
            x_m: x_m + 0.1 * (rng.uniform_f32() - 0.5),
            y_m: 3.0,
            z_m,
            range_m: 3.0,
            velocity_mps: velocity_mps + 0.1 * (rng.uniform_f32() - 0.5),
            intensity_db: 20.0,
        };
        let mut points: Vec<RadarPoint> = (0..16)
            .map(|k| point(0.2 * (k as f32 * 2.4).sin(), 0.1 * k as f32 - 0.9, body_mps))
            .collect();
        points.extend(
            hand_m
                .into_iter()
                .flat_map(|x_m| [0.3, 0.4, 0.5].map(|z_m| (x_m, z_m)))
                .map(|(x_m, z_m)| point(x_m, z_m, 1.5 * phase.cos())),
        );
        PointFrame {
            frame: i,
            time_s: 0.1 * f64::from(i),
            points,
            board: None,
        }
    };
    (0..40).map(frame).collect()
}

fn clips(seeds: std::ops::Range<u64>) -> Vec<ClipRecord> {
    let blank = synthetic::clips(1, 4, 4).remove(0);
    let of = |seed: u64| {
        let (hand_m, caption) = match seed % 3 {
            0 => (Some(-0.35), "a person punches with the left fist"),
            1 => (Some(0.35), "a person punches with the right fist"),
            _ => (None, "a person walks back and forth"),
        };
        ClipRecord {
            id: format!("clip-{seed}#0"),
            motion_id: format!("clip-{seed}"),
            captions: vec![caption.into()],
            frames: frames(hand_m, seed),
            seed,
            ..blank.clone()
        }
    };
    seeds.map(of).collect()
}

#[test]
fn actions_and_sides_of_other_clips_are_told() {
    let dir = scratch("evidence");
    let config = EvidenceTrainConfig {
        hidden: [32, 16],
        run: steps(150),
        ..EvidenceTrainConfig::default()
    };
    let train = clips(0..90);
    let outcome = evidence::train(&config, &train, 0, &clips(100..112), &dir, false).unwrap();
    let networks = Evidence::of(&Checkpoint::open(&outcome.checkpoint).unwrap()).unwrap();
    let names: Vec<&str> = networks
        .file()
        .contents
        .iter()
        .map(|c| c.name.as_str())
        .collect();
    assert_eq!(names.len(), 2, "{names:?}");
    // Each content has its sentences, with the mirror image of each.
    for content in &networks.file().contents {
        assert!(!content.sentences.is_empty());
        let states = |text: &String| networks.file().index_of(text).is_some();
        assert!(content.sentences.iter().all(states));
    }
    assert!(!networks.file().sided[0].has_both);
    for clip in clips(200..230) {
        let values = WindowValues::of(&clip.frames, clip.radar_height_m).unwrap();
        let truth = networks.file().index_of(&clip.captions[0]).unwrap();
        let contents = networks.contents(&values);
        assert!(contents[truth] > 0.9, "{}: {contents:?}", clip.captions[0]);
        if truth == networks.file().index_of("a person punches").unwrap() {
            let sides = networks.sides(&values, "punch").unwrap();
            let is_left = clip.captions[0].contains("left");
            let right = if is_left { sides[0] } else { sides[1] };
            assert!(
                right > 0.9 && sides[2] == 0.0,
                "{}: {sides:?}",
                clip.captions[0]
            );
        }
    }
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn clips_that_state_nothing_are_refused() {
    let dir = scratch("evidence-nothing");
    let mut silent = clips(0..30);
    silent
        .iter_mut()
        .for_each(|clip| clip.captions = vec!["a person ponders".into()]);
    let config = EvidenceTrainConfig {
        run: steps(1),
        ..EvidenceTrainConfig::default()
    };
    let error = evidence::train(&config, &silent, 0, &[], &dir, false).err();
    let refused = matches!(error, Some(TrainError::TooFewClips { found: 0, .. }));
    assert!(refused, "{error:?}");
    assert!(!dir.exists());
}

/// Known from the captions, before any stage of a recipe trains.
#[test]
fn too_few_clips_are_refused_with_their_number() {
    let refused = |clips: &[ClipRecord]| {
        let error = evidence::check_captions(clips, 0).unwrap_err();
        assert!(error.hint().unwrap().to_string().contains("[evidence]"));
        error.to_string()
    };
    // 18 punches and 9 walks.
    let error = refused(&clips(0..27));
    for part in [
        "[evidence]",
        "no action",
        "20 training clips",
        "number is 18",
    ] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let mut walks = clips(0..90);
    walks.retain(|clip| clip.captions[0].contains("walks"));
    let error = refused(&walks);
    for part in ["no side of an action", "number is 0"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    evidence::check_captions(&clips(0..30), 0).unwrap();
}

#[test]
fn settings_out_of_range_are_named_with_their_values() {
    let refused = |edit: fn(&mut EvidenceTrainConfig)| {
        let mut config = EvidenceTrainConfig::default();
        config.validate().unwrap();
        edit(&mut config);
        config.validate().unwrap_err().to_string()
    };
    for (error, expected) in [
        (
            refused(|c| c.batch_size = 0),
            "batch_size: must be in 1..=4096, found 0",
        ),
        (
            refused(|c| c.hidden = [384, 5000]),
            "hidden: must be in 1..=4096, found 5000",
        ),
        (
            refused(|c| c.noise = -1.0),
            "noise: must be finite and not negative, found -1",
        ),
        (
            refused(|c| c.dropped = 1.0),
            "dropped: must be at least 0 and below 1, found 1",
        ),
    ] {
        assert_eq!(error, expected);
    }
}
