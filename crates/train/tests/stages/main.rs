//! Stages `motion` and `tokenizer` end to end on synthetic clips.

#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    unreachable_pub,
    reason = "a test"
)]

mod evidence;
mod pose;
mod synthetic;

use std::fs;
use std::path::{Path, PathBuf};

use radarllm_base::PointFrame;
use radarllm_inference::checkpoint::{Checkpoint, MODEL_FILE, NamedTensors};
use radarllm_inference::tokenizer::config::{AnchorMode, GroupingConfig};
use radarllm_inference::tokenizer::points::{PointDecoder, PointsConfig, tokenizer_hash};
use radarllm_inference::tokenizer::{RadarTokenizer, TokenizerConfig};
use radarllm_nn::motion_vqvae::{MotionTeacher, MotionVqVaeConfig};
use radarllm_nn::tokenizer::codebook::CodebookConfig;
use radarllm_train::adamw::AdamWConfig;
use radarllm_train::chamfer::ChamferSide;
use radarllm_train::data::AugmentConfig;
use radarllm_train::harness::{Ending, LoopConfig, StopToken, TrainError};
use radarllm_train::motion::{self, MotionTrainConfig};
use radarllm_train::points::{self, PointsTrainConfig};
use radarllm_train::recipe::{Preset, Recipe};
use radarllm_train::tokenizer::{
    self, CodeGradient, CodebookUpdate, GuidanceOn, Lookup, Reconstruct, TokenizerLossConfig,
    TokenizerTrainConfig,
};

fn scratch(name: &str) -> PathBuf {
    let dir = std::env::temp_dir().join(format!("radarllm-stage-{}-{name}", std::process::id()));
    let _ = fs::remove_dir_all(&dir);
    dir
}

fn steps(n: u64) -> LoopConfig {
    LoopConfig {
        max_steps: n,
        epochs: 0,
        learning_rate: 3e-3,
        warmup_steps: 5,
        log_every: 1,
        validate_every: 1_000_000,
        checkpoint_every_s: 0.0,
        keep_last: 9,
        adamw: AdamWConfig {
            weight_decay: 0.0,
            ..AdamWConfig::default()
        },
        ..LoopConfig::default()
    }
}

fn tiny_codebook() -> CodebookConfig {
    CodebookConfig {
        init_after: 2,
        init_inputs_per_code: 1,
        ..CodebookConfig::default()
    }
}

fn tiny_motion(n_steps: u64) -> MotionTrainConfig {
    MotionTrainConfig {
        batch_size: 2,
        crop_frames: 16,
        mirror: false,
        model: MotionVqVaeConfig {
            width: 32,
            depth: 1,
            codebook_size: 16,
            ..MotionVqVaeConfig::small()
        },
        codebook: tiny_codebook(),
        run: steps(n_steps),
        ..MotionTrainConfig::default()
    }
}

fn tiny_tokenizer(n_steps: u64) -> TokenizerTrainConfig {
    TokenizerTrainConfig {
        batch_size: 2,
        model: TokenizerConfig {
            grouping: GroupingConfig {
                counts: [2, 2, 4],
                step_m: [0.4, 0.4, 0.5],
                ..Default::default()
            },
            width: 32,
            layers: 1,
            heads: 2,
            code_dim: 24,
            codebook_size: 16,
            ..TokenizerConfig::small()
        },
        codebook: tiny_codebook(),
        run: steps(n_steps),
        ..TokenizerTrainConfig::default()
    }
}

/// Values of one field of the log's training lines.
fn logged(dir: &Path, field: &str) -> Vec<f64> {
    let text = fs::read_to_string(dir.join("log.jsonl")).unwrap();
    let lines = text
        .lines()
        .map(|l| serde_json::from_str::<serde_json::Value>(l).unwrap());
    lines
        .filter(|v| v.get("validation").is_none())
        .filter_map(|v| v[field].as_f64())
        .collect()
}

fn trained_teacher(dir: &Path) -> MotionTeacher {
    let clips = synthetic::clips(2, 8, 4);
    let outcome = motion::train(&tiny_motion(30), &clips, &clips, dir, false).unwrap();
    motion::load_teacher(&outcome.checkpoint).unwrap()
}

#[test]
fn motion_overfits_a_tiny_batch() {
    let dir = scratch("motion-overfit");
    let clips = synthetic::clips(2, 8, 1);
    let outcome = motion::train(&tiny_motion(250), &clips, &clips, &dir, false).unwrap();
    let loss = logged(&dir, "reconstruction");
    let (first, last) = (loss[0], loss[loss.len() - 1]);
    assert!(last < first / 10.0, "{first} -> {last}");
    let teacher = MotionTeacher::load(&outcome.checkpoint).unwrap();
    assert_eq!(
        teacher.features(&clips[0].motion_features).unwrap().len(),
        2 * 32
    );
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn tokenizer_overfits_a_tiny_batch_and_encodes() {
    let dir = scratch("tokenizer-overfit");
    let teacher = trained_teacher(&dir.join("motion"));
    let clips = synthetic::clips(2, 8, 12);
    let mut config = tiny_tokenizer(300);
    config.augment = AugmentConfig::none();
    // Everything visible is the task that can be overfitted to any depth.
    config.loss = TokenizerLossConfig {
        mask_ratio: 0.0,
        reconstruct: Reconstruct::All,
        chamfer: ChamferSide::Symmetric,
        targets_per_tube: 24,
        tubes_per_clip: 1000,
        motion_codes_weight: 0.5,
        ..Default::default()
    };
    config.model.reconstruction_points = 12;
    let out = dir.join("tokenizer");
    let outcome = tokenizer::train(&config, &clips, &clips, Some(&teacher), &out, false).unwrap();
    for (part, factor) in [
        ("reconstruction", 10.0),
        ("guidance", 10.0),
        ("motion_code", 10.0),
    ] {
        let loss = logged(&out, part);
        let (first, last) = (loss[0], loss[loss.len() - 1]);
        assert!(last < first / factor, "{part}: {first} -> {last}");
    }
    let trained = RadarTokenizer::load(&outcome.checkpoint).unwrap();
    let encoded = trained.encode(&clips[0].frames, 1.0).unwrap();
    assert_eq!(encoded.codes.len(), 2);
    assert!(encoded.codes.iter().all(|c| *c < 16));
    assert!(encoded.n_points_used > 0);
    fs::remove_dir_all(dir).unwrap();
}

/// The paper's tokenizer at its own size, guided by a teacher of its width: one update.
#[test]
fn the_paper_preset_trains_a_tokenizer_of_its_size() {
    let dir = scratch("paper");
    let clips = synthetic::clips(1, 48, 128);
    let recipe = Recipe::of(Preset::Paper);
    let mut motion = recipe.motion;
    motion.run = steps(6);
    motion.batch_size = 1;
    motion.codebook = tiny_codebook();
    motion.model.codebook_size = 8;
    let outcome = motion::train(&motion, &clips, &[], &dir.join("motion"), false).unwrap();
    let teacher = motion::load_teacher(&outcome.checkpoint).unwrap();
    let mut config = recipe.tokenizer;
    config.batch_size = 1;
    config.run = steps(1);
    let out = dir.join("tokenizer");
    let error = tokenizer::train(&config, &clips, &[], Some(&teacher), &out, false).err();
    // One update of one clip gives too few features for a codebook of 512, which is said after it.
    assert!(
        matches!(error, Some(TrainError::Codebook { .. })),
        "{error:?}"
    );
    for part in ["reconstruction", "guidance"] {
        let loss = logged(&out, part);
        assert!(
            loss.len() == 1 && loss[0] > 0.0 && loss[0].is_finite(),
            "{part}: {loss:?}"
        );
    }
    let trained = RadarTokenizer::load(&out.join("final")).unwrap();
    let model = trained.config();
    assert_eq!((model.n_anchors(), model.width, model.layers), (81, 256, 4));
    assert_eq!(
        (model.codebook_size, model.code_dim, model.guidance_dim),
        (512, 512, 512)
    );
    let n = trained.n_params();
    assert!((3_000_000..13_000_000).contains(&n), "{n}");
    fs::remove_dir_all(dir).unwrap();
}

/// The codes of two clips give their points back, and only to the tokenizer that made them.
#[test]
fn points_are_decoded_from_the_codes_of_their_tokenizer() {
    let dir = scratch("points");
    let clips = synthetic::clips(2, 16, 12);
    let out = dir.join("tokenizer");
    let tokenizer = tokenizer::train(&tiny_tokenizer(40), &clips, &clips, None, &out, false);
    let checkpoint = Checkpoint::open(&tokenizer.unwrap().checkpoint).unwrap();
    let tokenizer = RadarTokenizer::from_checkpoint(&checkpoint).unwrap();
    let hash = tokenizer_hash(&checkpoint).unwrap();
    let config = PointsTrainConfig {
        model: PointsConfig {
            points: 16,
            width: 16,
            hidden: 64,
            ..PointsConfig::default()
        },
        run: steps(300),
        ..PointsTrainConfig::default()
    };
    let out = dir.join("points");
    let outcome = points::train(&config, &tokenizer, &hash, &clips, &clips, &out, false).unwrap();
    let chamfer = logged(&out, "chamfer");
    let (first, last) = (chamfer[0], chamfer[chamfer.len() - 1]);
    assert!(last < first / 5.0, "{first} -> {last}");

    let decoder = PointDecoder::load(&outcome.checkpoint, &checkpoint).unwrap();
    let codes = tokenizer.encode(&clips[0].frames, 1.0).unwrap().codes;
    let clip = decoder.decode(&codes, 1.0, "a test").unwrap();
    assert_eq!(clip.frames.len(), 16);
    assert!(clip.provenance.is_simulated() && clip.provenance.input() == "a test");
    let middle = |frames: &[PointFrame]| {
        let points = || frames.iter().flat_map(|f| &f.points);
        let n = points().count() as f32;
        [
            points().map(|p| p.x_m).sum::<f32>() / n,
            points().map(|p| p.y_m).sum::<f32>() / n,
            points().map(|p| p.z_m).sum::<f32>() / n,
        ]
    };
    let (found, expected) = (middle(&clip.frames), middle(&clips[0].frames));
    for (a, b) in found.iter().zip(expected) {
        // The points of a frame are up to 1 m from their middle.
        assert!((a - b).abs() < 0.2, "{found:?}, {expected:?}");
    }
    let n: usize = clip.frames.iter().map(|f| f.points.len()).sum();
    assert!(
        (8 * 16..=16 * 16).contains(&n),
        "{n} points for 12 in each of 16 frames"
    );
    let beyond = decoder
        .decode(&[16], 1.0, "a test")
        .unwrap_err()
        .to_string();
    assert!(beyond.contains("code 16"), "{beyond}");

    let other = dir.join("other");
    let config = tiny_tokenizer(10);
    let other = tokenizer::train(&config, &clips, &clips, None, &other, false).unwrap();
    let other = Checkpoint::open(&other.checkpoint).unwrap();
    let error = PointDecoder::load(&outcome.checkpoint, &other)
        .err()
        .unwrap();
    assert!(error.to_string().contains("tokenizer_blake3"), "{error}");
    assert!(PointDecoder::load(checkpoint.dir(), &checkpoint).is_err());
    fs::remove_dir_all(dir).unwrap();
}

fn all_tensors(dir: &Path) -> Vec<NamedTensors> {
    let checkpoint = Checkpoint::open(dir).unwrap();
    let files = [
        MODEL_FILE,
        "optimizer.safetensors",
        "stage_state.safetensors",
    ];
    files
        .iter()
        .map(|f| checkpoint.tensors(f).unwrap())
        .collect()
}

/// Copies a resume checkpoint into a new run, as if the first had been killed right after it.
fn killed_after(run: &Path, step: &str, to: &Path) {
    fs::create_dir_all(to.join(step)).unwrap();
    for entry in fs::read_dir(run.join(step)).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), to.join(step).join(entry.file_name())).unwrap();
    }
    // Killed while the next checkpoint was being staged.
    fs::create_dir_all(to.join("step-00000099.tmp")).unwrap();
    fs::write(
        to.join("step-00000099.tmp").join(MODEL_FILE),
        b"half a file",
    )
    .unwrap();
}

#[test]
fn resumed_runs_equal_uninterrupted_ones_bit_for_bit() {
    let dir = scratch("resume");
    let teacher = trained_teacher(&dir.join("teacher"));
    let clips = synthetic::clips(5, 12, 10);
    let mut config = tiny_tokenizer(10);
    // Step 4 lies inside an epoch of three batches; accumulation straddles it too.
    config.run.checkpoint_every_steps = 4;
    config.run.epochs = 0;
    let whole = dir.join("whole");
    tokenizer::train(&config, &clips, &clips, Some(&teacher), &whole, false).unwrap();
    let again = dir.join("again");
    killed_after(&whole, "step-00000004", &again);
    tokenizer::train(&config, &clips, &clips, Some(&teacher), &again, true).unwrap();
    assert!(!again.join("step-00000099.tmp").exists());
    assert_eq!(
        all_tensors(&whole.join("step-00000010")),
        all_tensors(&again.join("step-00000010"))
    );

    let mut config = tiny_motion(9);
    config.run.checkpoint_every_steps = 5;
    config.run.accumulate = 2;
    let (whole, again) = (dir.join("motion-whole"), dir.join("motion-again"));
    motion::train(&config, &clips, &clips, &whole, false).unwrap();
    killed_after(&whole, "step-00000005", &again);
    motion::train(&config, &clips, &clips, &again, true).unwrap();
    assert_eq!(
        all_tensors(&whole.join("step-00000009")),
        all_tensors(&again.join("step-00000009"))
    );

    // A run is neither overwritten nor resumed with other settings, nor resumed from nothing.
    let err = motion::train(&config, &clips, &clips, &whole, false).unwrap_err();
    assert!(matches!(err, TrainError::OutputExists { .. }), "{err}");
    let other = MotionTrainConfig {
        commit_weight: 0.5,
        ..config.clone()
    };
    let err = motion::train(&other, &clips, &clips, &whole, true).unwrap_err();
    assert!(matches!(err, TrainError::ResumeMismatch { .. }), "{err}");
    let hint = err.hint().unwrap().to_string();
    assert!(hint.contains(&whole.display().to_string()), "{hint}");
    for part in ["`training.commit_weight` is 0.02", "and 0.5"] {
        assert!(err.to_string().contains(part), "{part}: {err}");
    }
    let err = motion::train(&config, &clips, &clips, &dir.join("none"), true).unwrap_err();
    assert!(matches!(err, TrainError::NothingToResume { .. }), "{err}");
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn a_run_is_resumed_with_what_it_learned_from() {
    let dir = scratch("inputs");
    let clips = synthetic::clips(2, 8, 4);
    let mut config = tiny_motion(30);
    let train = |config: &MotionTrainConfig, resume| {
        motion::train(config, &clips, &clips, &dir, resume).map(|outcome| outcome.steps)
    };
    config.run.inputs.insert("data".into(), "0a".into());
    assert_eq!(train(&config, false).unwrap(), 30);
    assert_eq!(train(&config, true).unwrap(), 30);
    config.run.inputs.insert("data".into(), "0b".into());
    let err = train(&config, true).unwrap_err();
    assert!(matches!(err, TrainError::ResumeMismatch { .. }), "{err}");
    assert!(
        err.to_string()
            .contains("`data` had the hash 0a, and has 0b"),
        "{err}"
    );
    fs::remove_dir_all(dir).unwrap();
}

/// A process that ended between the two renames of a checkpoint left it under its other name.
#[test]
fn a_checkpoint_that_was_being_replaced_is_resumed() {
    let dir = scratch("replaced");
    let clips = synthetic::clips(2, 8, 4);
    let config = tiny_motion(30);
    motion::train(&config, &clips, &clips, &dir, false).unwrap();
    let last = dir.join("step-00000030");
    let weights = all_tensors(&last);
    fs::rename(&last, dir.join("step-00000030.old")).unwrap();
    let outcome = motion::train(&config, &clips, &clips, &dir, true).unwrap();
    assert_eq!(outcome.steps, 30);
    assert_eq!(all_tensors(&last), weights);
    assert!(!dir.join("step-00000030.old").exists());
    fs::remove_dir_all(dir).unwrap();
}

/// Stopped while it runs, at whatever update that is, before or after the codebook exists.
#[test]
fn stopped_runs_resume_to_the_weights_of_uninterrupted_ones() {
    resumes("stop", tiny_tokenizer(60));
    // With a second network, which writes captions from codes of unit length.
    let mut config = tiny_tokenizer(60);
    config.model.code_dim = 8;
    config.loss.lookup = Lookup::Cosine;
    config.loss.code_gradient = CodeGradient::Rotate;
    config.loss.spread_weight = 0.2;
    config.loss.captions_weight = 1.0;
    resumes("stop-captions", config);
}

fn resumes(name: &str, mut config: TokenizerTrainConfig) {
    let dir = scratch(name);
    let clips = synthetic::clips(5, 12, 10);
    config.codebook.init_after = 4;
    config.run.checkpoint_every_steps = 1000;
    // Validations of their own beside the epochs' must not change where the run goes.
    config.run.validate_every = 7;
    let train = |config: &TokenizerTrainConfig, out: &Path, resume: bool| {
        tokenizer::train(config, &clips, &clips, None, out, resume).unwrap()
    };
    let whole = dir.join("whole");
    assert_eq!(train(&config, &whole, false).ending, Ending::Done);
    for after in [1, 20] {
        let out = dir.join(format!("stopped-{after}"));
        let log = out.join("log.jsonl");
        let mut stopped = config.clone();
        stopped.run.stop = StopToken::default();
        let stop = stopped.run.stop.clone();
        let outcome = std::thread::scope(|scope| {
            scope.spawn(|| {
                let lines = || fs::read_to_string(&log).map_or(0, |text| text.lines().count());
                while lines() < after {
                    std::thread::sleep(std::time::Duration::from_millis(1));
                }
                stop.stop();
            });
            train(&stopped, &out, false)
        });
        assert_eq!(outcome.ending, Ending::Stopped, "after {after}");
        assert!(outcome.steps >= 1 && outcome.steps < 60);
        assert!(!out.join("final").exists());
        assert_eq!(train(&config, &out, true).ending, Ending::Done);
        for tensors in ["step-00000060", "final", "best"] {
            let of = |run: &Path| Checkpoint::open(&run.join(tensors)).unwrap();
            let weights = |run: &Path| of(run).tensors(MODEL_FILE).unwrap();
            assert!(weights(&whole) == weights(&out), "{tensors} after {after}");
        }
        let last = |run: &Path| all_tensors(&run.join("step-00000060"));
        assert_eq!(last(&whole), last(&out));
    }
    // Stopped before its first update, a run leaves nothing to resume from.
    let mut never = config.clone();
    never.run.stop = StopToken::default();
    never.run.stop.stop();
    let out = dir.join("never");
    let outcome = train(&never, &out, false);
    assert_eq!((outcome.ending, outcome.steps), (Ending::Stopped, 0));
    let err = tokenizer::train(&config, &clips, &clips, None, &out, true).unwrap_err();
    assert!(matches!(err, TrainError::NothingToResume { .. }), "{err}");
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn sparse_clips_and_every_ablation_train_without_nan() {
    let dir = scratch("ablations");
    let mut clips = synthetic::clips(4, 9, 20);
    clips[0].frames.iter_mut().for_each(|f| f.points.clear());
    clips[1]
        .frames
        .iter_mut()
        .for_each(|f| f.points.truncate(1));
    clips[2].frames = vec![PointFrame::default()];
    clips[3].motion_features.clear();
    let base = tiny_tokenizer(6);
    let loss = |edit: &dyn Fn(&mut TokenizerLossConfig)| {
        let mut c = base.clone();
        edit(&mut c.loss);
        c
    };
    let model = |edit: &dyn Fn(&mut TokenizerConfig)| {
        let mut c = base.clone();
        edit(&mut c.model);
        c
    };
    let cases = [
        ("default", base.clone()),
        (
            "reconstruct everything",
            loss(&|l| l.reconstruct = Reconstruct::All),
        ),
        (
            "no masking",
            loss(&|l| (l.mask_ratio, l.reconstruct) = (0.0, Reconstruct::All)),
        ),
        (
            "no reconstruction",
            loss(&|l| l.reconstruct = Reconstruct::Nothing),
        ),
        ("no guidance", loss(&|l| l.guidance_weight = 0.0)),
        (
            "motion codes in place of features",
            loss(&|l| (l.guidance_weight, l.motion_codes_weight) = (0.0, 0.5)),
        ),
        (
            "loss as printed",
            loss(&|l| {
                l.masked_clips = 1.0;
                l.chamfer = ChamferSide::TargetToPrediction;
                l.guidance_on = GuidanceOn::Features;
                l.codebook_update = CodebookUpdate::Gradient;
                l.commit_weight = 1.0;
            }),
        ),
        ("no quantization", model(&|m| m.quantize = false)),
        (
            "farthest-point anchors",
            model(&|m| m.grouping.anchors = AnchorMode::FarthestPoint),
        ),
        ("another codebook", model(&|m| m.codebook_size = 8)),
    ];
    let teacher = trained_teacher(&dir.join("teacher"));
    for (i, (name, config)) in cases.iter().enumerate() {
        let out = dir.join(format!("case-{i}"));
        let outcome = tokenizer::train(config, &clips, &clips, Some(&teacher), &out, false)
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(outcome.steps, 6, "{name}");
        let trained = RadarTokenizer::load(&outcome.checkpoint).unwrap();
        for clip in &clips {
            let encoded = trained.encode(&clip.frames, clip.radar_height_m).unwrap();
            assert_eq!(encoded.codes.len(), clip.frames.len().div_ceil(4), "{name}");
        }
    }
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn broken_batches_stop_with_their_ids() {
    let dir = scratch("nan");
    let clips = synthetic::clips(2, 8, 1);
    let mut config = tiny_motion(50);
    // A rate that throws any network out of range within a few steps.
    config.run.learning_rate = 1e30;
    config.run.warmup_steps = 0;
    config.run.adamw.clip_norm = 0.0;
    let err = motion::train(&config, &clips, &clips, &dir, false).unwrap_err();
    let TrainError::NotFinite { ids, .. } = &err else {
        panic!("{err}")
    };
    assert_eq!(ids.len(), 2);
    assert!(!dir.join("final").exists());
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn unusable_data_and_settings_are_refused() {
    let dir = scratch("refused");
    let mut clips = synthetic::clips(1, 8, 1);
    assert!(matches!(
        tokenizer::train(&tiny_tokenizer(1), &[], &[], None, &dir, false),
        Err(TrainError::NoData(_))
    ));
    clips[0].motion_features[5] = f32::NAN;
    assert!(matches!(
        motion::train(&tiny_motion(1), &clips, &[], &dir, false),
        Err(TrainError::Clip { .. })
    ));
    let mut config = tiny_tokenizer(1);
    config.loss.mask_ratio = 2.0;
    assert!(matches!(
        tokenizer::train(&config, &clips, &[], None, &dir, false),
        Err(TrainError::Config { .. })
    ));
    TokenizerTrainConfig::paper().validate().unwrap();
}
