//! Tests of complete stages on toy clips.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use burn::module::Module;
use radarllm_facts::{facts, swap_sides};
use radarllm_inference::checkpoint::{Checkpoint, HostTensor, MODEL_FILE, NamedTensors};
use radarllm_inference::lm::Source;
use radarllm_inference::lm::questions::{NOT_STATED, Question, YES, holds, question_of};
use radarllm_inference::lm::templates::{EVALUATION_PROMPT, Task, all_text};
use radarllm_inference::lm::vocab::EOS;
use radarllm_inference::lm::{Backbone, FeedForward, GenerateOptions, LmPreset, Vocab};
use radarllm_inference::tokenizer::{Encoded, context::CONTEXT_LEN};
use radarllm_nn::lm::RadarLm;
use radarllm_nn::lm::TrainingPass;
use radarllm_nn::lm::{RadarT5, SourceBatch};
use radarllm_nn::params::collect_params;
use radarllm_nn::precision::ProductPrecision;
use radarllm_nn::pretrained::{LoraConfig, ModelInput, Pretrained};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::clip::LmClip;
use super::config::LmTrainConfig;
use super::examples::{ExampleMaker, Item, LmStageKind, samples_of_writing};
use super::loss::cross_entropy;
use super::stage::LmStage;
use super::{LmOutcome, instruct, pretrain, pretrain_further};
use crate::adamw::{AdamW, AdamWConfig, GradientSum, ParamRule};
use crate::harness::{Ending, LoopConfig, Stage, StepInfo, cpu_device};
use crate::recipe::{Preset, Recipe};

const N_CODES: usize = 16;
const CODE_DIM: usize = 8;

/// Clips with random codes. Each caption can only be learned, not inferred.
fn toy_clips(n: usize, n_codes: usize, code_dim: usize) -> Vec<LmClip> {
    const WHO: [&str; 2] = ["a person", "someone"];
    const WHAT: [&str; 8] = [
        "walks forward slowly",
        "turns to the left and stops",
        "turns to the right",
        "jumps twice",
        "sits down, then stands up",
        "waves with the left hand",
        "waves with the right hand above the head",
        "runs in a circle clockwise",
    ];
    let rng = &mut ChaCha8Rng::seed_from_u64(7);
    let mut codes = |len: usize| {
        let codes: Vec<u32> = (0..len)
            .map(|_| rng.random_range(0..n_codes as u32))
            .collect();
        let features = (0..len * code_dim)
            .map(|_| rng.random::<f32>() - 0.5)
            .collect();
        Encoded {
            codes,
            features,
            ..Encoded::default()
        }
    };
    (0..n)
        .map(|i| LmClip {
            id: format!("toy-{i}"),
            action: "toy".into(),
            captions: vec![
                format!("{} {} {}", WHO[i / 8 % 2], WHAT[i % 8], "")
                    .trim()
                    .to_string(),
            ],
            variants: vec![codes(6 + i % 5)],
            flipped: Vec::new(),
            seconds: 2.4 + 0.4 * (i % 5) as f32,
        })
        .collect()
}

fn scratch(name: &str) -> PathBuf {
    let dir = std::env::temp_dir().join(format!("radarllm-lm-{}-{name}", std::process::id()));
    let _ = std::fs::remove_dir_all(&dir);
    dir
}

const FIRST_STEP: StepInfo = StepInfo {
    step: 0,
    epoch: 0,
    progress: 0.0,
    seed: 1,
};

/// Settings of a run without optional features.
fn bare_loop(steps: u64) -> LoopConfig {
    LoopConfig {
        epochs: 0,
        max_steps: steps,
        warmup_steps: 10,
        log_every: 1000,
        validate_every: u64::MAX,
        checkpoint_every_s: 0.0,
        ..LoopConfig::default()
    }
}

/// Whether the target ends with the end token.
fn ends(target: &[u32]) -> bool {
    target.last() == Some(&EOS)
}

/// Settings without augmentation, so that the loss can reach its minimum.
fn exact_config(run: LoopConfig) -> LmTrainConfig {
    LmTrainConfig {
        dropout: Some(0.0),
        batch: 8,
        samples_per_clip: 1,
        label_smoothing: 0.0,
        replace_code: 0.0,
        drop_code: 0.0,
        feature_noise: 0.0,
        average_decay: 0.0,
        run,
        ..LmTrainConfig::small()
    }
}

fn captions(lm: &RadarLm, clips: &[LmClip], beam: usize) -> Vec<String> {
    let sources: Vec<_> = clips
        .iter()
        .map(|c| lm.describe_prompt(&c.variants[0]).unwrap())
        .collect();
    let options = GenerateOptions {
        beam,
        ..Default::default()
    };
    let generated = lm.generate(&sources, &options).unwrap();
    generated.iter().map(|g| lm.vocab.text(&g.ids)).collect()
}

#[test]
fn eight_clips_are_learned_word_for_word_and_tuning_keeps_them() {
    let clips = toy_clips(8, N_CODES, CODE_DIM);
    let expected: Vec<&str> = clips.iter().map(|c| c.captions[0].as_str()).collect();
    let mut config = exact_config(LoopConfig {
        learning_rate: 3e-3,
        ..bare_loop(150)
    });
    config.sampling.radar_prediction = 0.2;
    config.sampling.text_to_radar = 0.2;
    let dir = scratch("overfit");
    let outcome = pretrain(&config, N_CODES, &clips, &[], &dir.join("a"), false).unwrap();
    assert_eq!(outcome.steps, 150);
    let lm = RadarLm::load(&outcome.checkpoint, &cpu_device()).unwrap();
    for beam in [1, 4] {
        assert_eq!(captions(&lm, &clips, beam), expected, "beam {beam}");
    }
    // Further training begins with these weights and these words.
    let mut hardly = config.clone();
    hardly.run.learning_rate = 1e-9;
    hardly.run.max_steps = 2;
    let same = RadarLm::load(&outcome.checkpoint, &cpu_device()).unwrap();
    let further = pretrain_further(&hardly, same, &clips, &[], &dir.join("further"), false);
    let further = RadarLm::load(&further.unwrap().checkpoint, &cpu_device()).unwrap();
    assert_eq!(captions(&further, &clips, 1), expected);
    assert_eq!(further.vocab.layout(), lm.vocab.layout());
    // The confidence is a probability, and is high if every caption has been memorised.
    let source = lm.describe_prompt(&clips[0].variants[0]).unwrap();
    let sure = lm
        .generate(&[source], &GenerateOptions::default())
        .unwrap()
        .remove(0);
    assert!(
        sure.confidence > 0.8 && sure.confidence <= 1.0,
        "{}",
        sure.confidence
    );
    let mut config = config.for_instruction();
    config.run.max_steps = 60;
    let outcome = instruct(&config, lm, &clips, &[], &dir.join("b"), false).unwrap();
    let lm = RadarLm::load(&outcome.checkpoint, &cpu_device()).unwrap();
    assert_eq!(captions(&lm, &clips, 1), expected, "after tuning");
    std::fs::remove_dir_all(dir).unwrap();
}

/// T5-small, the paper's: one update of a batch that holds every pretraining task.
#[test]
fn the_paper_preset_trains_a_language_model_of_its_size() {
    let recipe = Recipe::of(Preset::Paper);
    let mut config = recipe.pretrain;
    config.batch = 6;
    let clips = toy_clips(6, 512, 512);
    let captions = clips.iter().flat_map(|c| &c.captions).map(String::as_str);
    let shape = config.lm_config(512, 512).unwrap();
    assert!(!shape.bypass);
    let vocab = Vocab::learn(
        captions,
        all_text(),
        shape.max_text_vocab,
        shape.n_sentinels,
        512,
    );
    let lm = RadarLm::new(shape, vocab.unwrap(), 1, &cpu_device()).unwrap();
    let t5 = lm.config.t5().unwrap().clone();
    assert_eq!(
        (t5.n_encoder_layers, t5.n_decoder_layers, t5.n_heads),
        (6, 6, 8)
    );
    assert_eq!(
        (t5.d_model, t5.d_ff, t5.feed_forward),
        (512, 2048, FeedForward::Relu)
    );
    // T5-small has 60.5 M weights, 16.4 M of which are 32,128 rows of its vocabulary.
    let n_rows = t5.vocab_size;
    let n: usize = collect_params(&lm.net)
        .values()
        .map(|t| t.values.len())
        .sum();
    assert_eq!(n - n_rows * 512, 60_506_624 - 32_128 * 512);
    let (mut stage, net) = LmStage::new(&config, lm, LmStageKind::Pretrain, &clips, &[]).unwrap();
    let task = |task, clip| Item {
        clip,
        task,
        variant: 0,
        flipped: false,
        caption: 0,
        prompt: 0,
    };
    let batch: Vec<usize> = (0..6)
        .map(|i| task(Task::PRETRAINING[i % 3], i).pack())
        .collect();
    let before = stage.loss(&net, &batch, FIRST_STEP).unwrap().total;
    let before_value = before.clone().into_scalar::<f32>();
    let mut sum = GradientSum::default();
    sum.add(&net, before.backward());
    let norm = sum.norm();
    let rule = |_: &str, shape: &[usize]| ParamRule::by_shape(shape);
    let run = &config.run;
    let net = AdamW::default().step(&run.adamw, run.learning_rate, &rule, net, sum, norm);
    // The same batch with the same dropout is more probable after the update.
    let after = stage
        .loss(&net, &batch, FIRST_STEP)
        .unwrap()
        .total
        .into_scalar::<f32>();
    assert!(
        after < before_value && after.is_finite(),
        "{before_value} -> {after}"
    );
}

#[test]
fn a_model_records_the_tasks_that_it_learned() {
    let clips = toy_clips(4, N_CODES, CODE_DIM);
    let dir = scratch("learned");
    let learned = |config: &LmTrainConfig, start: Option<RadarLm>, name: &str| {
        let out = dir.join(name);
        let outcome = match start {
            None => pretrain(config, N_CODES, &clips, &[], &out, false),
            Some(lm) => instruct(config, lm, &clips, &[], &out, false),
        };
        RadarLm::load(&outcome.unwrap().checkpoint, &cpu_device()).unwrap()
    };
    let mut config = exact_config(bare_loop(1));
    config.sampling.text_to_radar = 0.0;
    config.lambda.radar_prediction = 0.0;
    let lm = learned(&config, None, "pretrained");
    let only = |task| BTreeSet::from([task]);
    let record = lm.learned.clone().unwrap();
    assert_eq!(record.pretrained, only(Task::RadarToText));
    assert!(record.tuned.is_empty() && !record.knows(Task::TextToRadar));
    let mut config = exact_config(bare_loop(1));
    config.sampling.continuation = 0.0;
    let record = learned(&config, Some(lm), "tuned").learned.unwrap();
    assert_eq!(record.pretrained, only(Task::RadarToText));
    let tuned = [
        Task::RadarToText,
        Task::TextToRadar,
        Task::TextToLength,
        Task::RadarToLength,
        Task::Question,
    ];
    assert_eq!(record.tuned, BTreeSet::from(tuned));
    assert!(record.knows(Task::TextToRadar) && !record.knows(Task::Continuation));
    std::fs::remove_dir_all(dir).unwrap();
}

#[test]
fn questions_have_the_answers_of_the_captions() {
    let mut clips = toy_clips(3, N_CODES, CODE_DIM);
    let captions = [
        "a person slowly walks backward, then waves three times with the left hand",
        "a person jumps",
        "a person sits down",
    ];
    for (clip, caption) in clips.iter_mut().zip(captions) {
        clip.captions = vec![caption.into()];
        clip.flipped = clip.variants.clone();
    }
    let vocab = vocab(&clips);
    let mut maker = ExampleMaker::new(&vocab, CODE_DIM, &clips, LmStageKind::Instruct).unwrap();
    maker.read_answers(&vocab).unwrap();
    let config = exact_config(bare_loop(1));
    let n_text = vocab.layout().n_text;
    let words = |ids: &[u32]| {
        let text: Vec<u32> = ids.iter().copied().filter(|id| *id < n_text).collect();
        vocab.text(&text)
    };
    let rng = &mut ChaCha8Rng::seed_from_u64(5);
    let mut claims = [0; 2];
    for (prompt, template) in Task::Question.prompts().iter().enumerate() {
        let asked = question_of(template).unwrap();
        for (clip, caption) in captions.iter().enumerate() {
            for flipped in [false, true] {
                let item = Item {
                    clip,
                    task: Task::Question,
                    variant: 0,
                    flipped,
                    caption: 0,
                    prompt,
                };
                let example = maker.example(&vocab, &config, &item, rng).unwrap();
                let answer = words(&example.target);
                let caption = match flipped {
                    true => swap_sides(caption),
                    false => (*caption).to_string(),
                };
                if asked == Question::Claim {
                    let claim = facts(&words(&example.source.ids));
                    let is_true = holds(&claim, &[facts(&caption)]);
                    assert_eq!(is_true, Some(answer == YES), "{claim}: {answer}");
                    claims[usize::from(answer == YES)] += 1;
                } else {
                    let expected = asked.answer([caption.as_str()]);
                    assert_eq!(
                        answer,
                        expected.as_deref().unwrap_or(NOT_STATED),
                        "{template}"
                    );
                }
            }
        }
    }
    assert!(claims.iter().all(|n| *n > 10), "{claims:?}");
    let drawn = maker.draw_epoch(&config, 1);
    assert_eq!(drawn, maker.draw_epoch(&config, 1));
}

#[test]
fn captions_are_written_anew_from_their_facts() {
    let clips = toy_clips(8, N_CODES, CODE_DIM);
    let config = LmTrainConfig {
        rewrite_captions: 1.0,
        ..exact_config(bare_loop(1))
    };
    let written: Vec<String> = clips
        .iter()
        .flat_map(|c| samples_of_writing(c.captions.iter().map(String::as_str), 8))
        .collect();
    let texts = clips.iter().flat_map(|c| &c.captions).chain(&written);
    let vocab = Vocab::learn(texts.map(String::as_str), all_text(), 900, 4, N_CODES).unwrap();
    let mut maker = ExampleMaker::new(&vocab, CODE_DIM, &clips, LmStageKind::Pretrain).unwrap();
    maker.read_facts();
    let rng = &mut ChaCha8Rng::seed_from_u64(4);
    let mut different = BTreeSet::new();
    for (clip, record) in clips.iter().enumerate() {
        let item = Item {
            clip,
            task: Task::RadarToText,
            variant: 0,
            flipped: false,
            caption: 0,
            prompt: 0,
        };
        let known = radarllm_facts::facts(&record.captions[0]);
        let known: Vec<&str> = known.actions().map(|a| a.name).collect();
        for _ in 0..6 {
            let target = maker.example(&vocab, &config, &item, rng).unwrap().target;
            assert!(ends(&target));
            let text = vocab.text(&target);
            // The sentence may leave actions out, but states no other ones and in no other order.
            let stated = radarllm_facts::facts(&text);
            let mut rest = known.iter();
            for action in stated.actions() {
                assert!(
                    rest.any(|name| *name == action.name),
                    "{text:?} of {:?}",
                    record.captions[0]
                );
            }
            assert!(stated.actions().next().is_some(), "{text}");
            different.insert(text);
        }
        let own = LmTrainConfig {
            rewrite_captions: 0.0,
            ..config.clone()
        };
        let target = maker.example(&vocab, &own, &item, rng).unwrap().target;
        assert_eq!(vocab.text(&target), record.captions[0]);
    }
    assert!(different.len() > 16, "{different:?}");
}

/// Matrix products of these sizes, single and batched, are divided among the threads.
#[test]
fn any_number_of_threads_learns_the_same_bits() {
    let learned = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads);
        pool.build().unwrap().install(|| {
            let config = LmPreset::Small.config(N_CODES, CODE_DIM);
            let mut t5 = config.t5().unwrap().clone();
            t5.vocab_size = 500;
            let device = cpu_device().autodiff();
            let mut net = RadarT5::new(&t5, &config, 3, &device).train();
            let (batch, source, target) = (24, 50, 20);
            let id = |i: usize| (i * 7919 % 498 + 2) as u32;
            let sources: Vec<Source> = (0..batch)
                .map(|row| Source {
                    ids: (0..source).map(|at| id(row * source + at)).collect(),
                    ..Source::default()
                })
                .collect();
            let sources: Vec<&Source> = sources.iter().collect();
            let sources = SourceBatch::new(&sources, CODE_DIM, &device);
            let targets: Vec<u32> = (0..batch * target).map(id).collect();
            let weights = vec![1.0; targets.len()];
            let mut optimizer = AdamW::default();
            for step in 0..3 {
                let training = &mut TrainingPass::new(step, ProductPrecision::F32);
                let states = net.forward(&sources, &targets, target, Some(training));
                let loss = cross_entropy(
                    net.t5.logits(states, 500, ProductPrecision::F32),
                    &targets,
                    &weights,
                    0.1,
                );
                let mut sum = GradientSum::default();
                sum.add(&net, loss.backward());
                let norm = sum.norm();
                let rule = |_: &str, shape: &[usize]| ParamRule::by_shape(shape);
                net = optimizer.step(&AdamWConfig::default(), 1e-2, &rule, net, sum, norm);
            }
            collect_params(&net)
                .into_iter()
                .map(|(name, tensor)| (name, tensor.values.iter().map(|v| v.to_bits()).collect()))
                .collect::<BTreeMap<String, Vec<u32>>>()
        })
    };
    let alone = learned(1);
    for n_threads in [2, 3] {
        let together = learned(n_threads);
        for (name, bits) in &alone {
            assert_eq!(bits, &together[name], "{name}, {n_threads} threads");
        }
    }
}

#[test]
fn a_resumed_run_continues_bit_for_bit() {
    resumes_bit_for_bit(ProductPrecision::F32);
}

#[test]
fn a_resumed_run_in_half_precision_continues_bit_for_bit() {
    resumes_bit_for_bit(ProductPrecision::F16);
}

fn resumes_bit_for_bit(precision: ProductPrecision) {
    let clips = toy_clips(8, N_CODES, CODE_DIM);
    let dir = scratch(&format!("resume-{precision:?}"));
    let config = |steps, save| LmTrainConfig {
        precision,
        batch: 4,
        average_decay: 0.9,
        quick_score_clips: 2,
        run: LoopConfig {
            // The cosine must not depend on where the run is interrupted.
            final_lr_factor: 1.0,
            checkpoint_every_steps: save,
            ..bare_loop(steps)
        },
        ..LmTrainConfig::small()
    };
    pretrain(
        &config(6, 0),
        N_CODES,
        &clips,
        &clips[..2],
        &dir.join("whole"),
        false,
    )
    .unwrap();
    pretrain(
        &config(3, 3),
        N_CODES,
        &clips,
        &clips[..2],
        &dir.join("cut"),
        false,
    )
    .unwrap();
    pretrain(
        &config(6, 3),
        N_CODES,
        &clips,
        &clips[..2],
        &dir.join("cut"),
        true,
    )
    .unwrap();
    let weights = |name: &str, file: &str| {
        Checkpoint::open(&dir.join(name).join("final"))
            .unwrap()
            .tensors(file)
            .unwrap()
    };
    for file in [MODEL_FILE, "average.safetensors"] {
        assert!(
            weights("whole", file) == weights("cut", file),
            "{file} differs"
        );
    }
    std::fs::remove_dir_all(dir).unwrap();
}

/// Trains briefly on `clips`; returns the weights and the validation loss, nats per token.
fn trained(config: &LmTrainConfig, clips: &[LmClip], dir: &Path) -> (NamedTensors, f64) {
    let outcome = pretrain(config, N_CODES, clips, clips, dir, false).unwrap();
    let weights = Checkpoint::open(&dir.join("final")).unwrap();
    (
        weights.tensors(MODEL_FILE).unwrap(),
        outcome.best_score.unwrap(),
    )
}

#[test]
fn two_processors_learn_what_two_batches_an_update_teach() {
    let clips = toy_clips(16, N_CODES, CODE_DIM);
    let dir = scratch("processors");
    let learned = |name: &str, processors: &str, accumulate| {
        let config = LmTrainConfig {
            batch: 4,
            run: LoopConfig {
                processors: processors.parse().unwrap(),
                accumulate,
                ..bare_loop(5)
            },
            ..LmTrainConfig::small()
        };
        trained(&config, &clips, &dir.join(name)).0
    };
    let together = learned("accumulated", "cpu", 2);
    assert!(learned("two", "cpu,cpu", 1) == together);
    assert!(learned("one", "cpu", 1) != together);
    std::fs::remove_dir_all(dir).unwrap();
}

/// Rounding grows with every update: over six seeds the losses of half precision were within 0.05 % of those of single
/// precision after 10 updates and within 0.55 % after 40, with either sign, and which seed is how far away depends on the
/// processor's kernels. So most of the check is early, where the tolerance can be narrow.
#[test]
fn half_precision_learns_nearly_what_single_does() {
    let clips = toy_clips(8, N_CODES, CODE_DIM);
    let dir = scratch("precision");
    for backbone in [Backbone::T5, Backbone::Gpt2] {
        for (updates, tolerance) in [(10, 0.002), (40, 0.01)] {
            let learned = |precision: ProductPrecision| {
                let config = LmTrainConfig {
                    precision,
                    run: LoopConfig {
                        learning_rate: 3e-3,
                        ..bare_loop(updates)
                    },
                    ..decoder_config(backbone, LoopConfig::default())
                };
                let name = format!("{backbone:?}-{precision:?}-{updates}");
                trained(&config, &clips, &dir.join(name))
            };
            let (weights, nats) = learned(ProductPrecision::F32);
            for precision in [ProductPrecision::Bf16, ProductPrecision::F16] {
                let (half_weights, half_nats) = learned(precision);
                let run = format!("{backbone:?} {precision:?}, {updates} updates");
                println!("{run}: {half_nats} nats for {nats}");
                assert!(half_weights != weights, "{run}");
                assert!(
                    (half_nats / nats - 1.0).abs() < tolerance,
                    "{run}: {half_nats} nats for {nats}"
                );
            }
        }
    }
    std::fs::remove_dir_all(dir).unwrap();
}

#[test]
fn a_run_that_gets_no_better_ends() {
    let clips = toy_clips(8, N_CODES, CODE_DIM);
    let dir = scratch("patience");
    let config = LmTrainConfig {
        batch: 4,
        run: LoopConfig {
            // Too small to change any weight, so the first validation remains the best.
            learning_rate: 1e-30,
            validate_every: 2,
            patience: 3,
            ..bare_loop(100)
        },
        ..LmTrainConfig::small()
    };
    let outcome = pretrain(&config, N_CODES, &clips, &clips, &dir, false).unwrap();
    assert_eq!(outcome.ending, Ending::NoBetter);
    // Validations after 2, 4, 6 and 8 updates.
    assert_eq!(outcome.steps, 8);
    std::fs::remove_dir_all(dir).unwrap();
}

/// Settings of a tiny decoder-only model.
fn decoder_config(backbone: Backbone, run: LoopConfig) -> LmTrainConfig {
    LmTrainConfig {
        backbone,
        preset: LmPreset::Tiny,
        ..exact_config(run)
    }
}

#[test]
fn a_tiny_gpt2_learns_eight_clips_word_for_word_and_tuning_keeps_them() {
    let clips = toy_clips(8, N_CODES, CODE_DIM);
    let expected: Vec<&str> = clips.iter().map(|c| c.captions[0].as_str()).collect();
    let mut config = decoder_config(
        Backbone::Gpt2,
        LoopConfig {
            learning_rate: 3e-3,
            ..bare_loop(150)
        },
    );
    config.sampling.radar_prediction = 0.2;
    config.sampling.text_to_radar = 0.2;
    let dir = scratch("gpt2");
    // Training and validation use the same clips: the test checks that they are learned.
    let outcome = pretrain(&config, N_CODES, &clips, &clips, &dir.join("a"), false).unwrap();
    let nats = outcome.best_score.unwrap();
    assert!(nats < 0.05, "{nats} nats a token");
    let lm = RadarLm::load(&outcome.checkpoint, &cpu_device()).unwrap();
    for beam in [1, 4] {
        assert_eq!(captions(&lm, &clips, beam), expected, "beam {beam}");
    }
    let mut config = config.for_instruction();
    config.run.max_steps = 60;
    let outcome = instruct(&config, lm, &clips, &[], &dir.join("b"), false).unwrap();
    let lm = RadarLm::load(&outcome.checkpoint, &cpu_device()).unwrap();
    assert_eq!(captions(&lm, &clips, 1), expected, "after tuning");
    std::fs::remove_dir_all(dir).unwrap();
}

/// Writes a decoder trained from scratch for one step, which serves as a third-party checkpoint. Its tokenizer gets the
/// end token that a pretrained one has.
fn pretrained_folder(backbone: Backbone, dir: &Path) -> PathBuf {
    let clips = toy_clips(8, N_CODES, CODE_DIM);
    let mut config = decoder_config(backbone, bare_loop(1));
    config.bypass = Some(false);
    let outcome = pretrain(&config, N_CODES, &clips, &[], &dir.join("scratch"), false).unwrap();
    let folder = outcome.checkpoint;
    let read = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(folder.join(name)).unwrap()).unwrap()
    };
    let mut config = read("config.json");
    // The last row of the text vocabulary. The rows of sentinels and codes after it are special, too.
    let n_text = config["radarllm"]["vocab"]["n_text"].as_u64().unwrap();
    config.as_object_mut().unwrap().remove("radarllm");
    config["eos_token_id"] = n_text.into();
    let mut tokenizer = read("tokenizer.json");
    tokenizer["added_tokens"] = serde_json::json!([{
        "id": n_text, "content": "<|endoftext|>", "single_word": false, "lstrip": false,
        "rstrip": false, "normalized": false, "special": true,
    }]);
    std::fs::write(folder.join("config.json"), config.to_string()).unwrap();
    std::fs::write(folder.join("tokenizer.json"), tokenizer.to_string()).unwrap();
    folder
}

/// Weights by path, as in training.
fn trained_weights(outcome: &LmOutcome) -> NamedTensors {
    collect_params(
        &RadarLm::load(&outcome.checkpoint, &cpu_device())
            .unwrap()
            .net,
    )
}

#[test]
fn adapters_new_rows_and_bypass_change_and_nothing_else_by_a_bit() {
    let clips = toy_clips(8, N_CODES, CODE_DIM);
    for (backbone, adapted) in [
        (Backbone::Gpt2, "attn.c_attn.lora"),
        (Backbone::Qwen2, "self_attn.q_proj.lora"),
    ] {
        let dir = scratch(&format!("lora-{}", backbone.name()));
        let mut config = decoder_config(backbone, bare_loop(2));
        config.hf_folder = Some(pretrained_folder(backbone, &dir));
        config.lora = Some(LoraConfig::default());
        config.bypass = Some(true);
        let start = RadarLm::from_hf_folder(
            config.hf_folder.as_ref().unwrap(),
            config.lora,
            N_CODES,
            CODE_DIM,
            true,
            config.run.seed,
            &cpu_device(),
        )
        .unwrap();
        let before = collect_params(&start.net);
        let outcome = pretrain(&config, N_CODES, &clips, &[], &dir.join("lora"), false).unwrap();
        let after = trained_weights(&outcome);
        assert_eq!(
            before.keys().collect::<Vec<_>>(),
            after.keys().collect::<Vec<_>>()
        );
        let mut changed = std::collections::BTreeSet::new();
        for (path, before) in &before {
            let is_trained = path.contains(".lora.")
                || path.ends_with("wte.added")
                || path.ends_with("embed_tokens.added")
                || path.ends_with("bypass");
            // Compared as bits, so that even a change of the sign of a zero is detected.
            let bits = |t: &HostTensor| t.values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(before) != bits(&after[path]), is_trained, "{path}");
            if is_trained {
                changed.insert(path.as_str());
            }
        }
        assert!(
            changed.iter().any(|path| path.contains(adapted)),
            "{changed:?}"
        );
        assert!(changed.iter().any(|path| path.ends_with(".added")));
        // The base model is stored outside: no file of the checkpoint contains its tensors.
        let checkpoint = Checkpoint::open(&outcome.checkpoint).unwrap();
        assert!(!checkpoint.has(MODEL_FILE));
        assert!(checkpoint.has("adapter_model.safetensors") && checkpoint.has("radar.safetensors"));
        // Instruction tuning continues with the same adapters.
        let lm = RadarLm::load(&outcome.checkpoint, &cpu_device()).unwrap();
        let outcome = instruct(&config, lm, &clips, &[], &dir.join("b"), false).unwrap();
        let tuned = trained_weights(&outcome);
        for (path, before) in &before {
            let is_same = tuned[path] == *before;
            assert_eq!(is_same, !changed.contains(path.as_str()), "{path}");
        }
        std::fs::remove_dir_all(dir).unwrap();
    }
}

#[test]
fn a_resumed_run_of_adapters_continues_bit_for_bit() {
    let clips = toy_clips(8, N_CODES, CODE_DIM);
    let dir = scratch("lora-resume");
    let folder = pretrained_folder(Backbone::Gpt2, &dir);
    let run = |name: &str, steps, save, resume| {
        let config = LmTrainConfig {
            backbone: Backbone::Gpt2,
            hf_folder: Some(folder.clone()),
            lora: Some(LoraConfig::default()),
            batch: 4,
            average_decay: 0.9,
            quick_score_clips: 2,
            run: LoopConfig {
                final_lr_factor: 1.0,
                checkpoint_every_steps: save,
                ..bare_loop(steps)
            },
            ..LmTrainConfig::small()
        };
        pretrain(
            &config,
            N_CODES,
            &clips,
            &clips[..2],
            &dir.join(name),
            resume,
        )
        .unwrap()
    };
    run("whole", 6, 0, false);
    run("cut", 3, 3, false);
    run("cut", 6, 3, true);
    for file in ["adapter_model.safetensors", "radar.safetensors"] {
        let weights = |name: &str, at: &str| {
            let dir = dir.join(name).join(at);
            Checkpoint::open(&dir).unwrap().tensors(file).unwrap()
        };
        // The last weights, and their average, which inference uses.
        for at in ["step-00000006", "final"] {
            assert!(
                weights("whole", at) == weights("cut", at),
                "{file} of {at} differs"
            );
        }
        assert!(
            weights("cut", "final") != weights("cut", "step-00000006"),
            "an average"
        );
    }
    std::fs::remove_dir_all(dir).unwrap();
}

/// The loss of a batch of a decoder-only model is the mean over target tokens of the loss of each, computed from its
/// own sequence alone: neither prompt nor padding contributes.
#[test]
fn prompts_and_padding_cost_a_decoder_alone_nothing() {
    let clips = toy_clips(8, N_CODES, CODE_DIM);
    for backbone in [Backbone::Gpt2, Backbone::Qwen2] {
        let mut config = decoder_config(backbone, bare_loop(1));
        config.sampling.radar_prediction = 0.0;
        config.sampling.text_to_radar = 0.0;
        config.dropout = Some(0.0);
        config.bypass = Some(false);
        let shape = config.lm_config(N_CODES, CODE_DIM).unwrap();
        let lm = RadarLm::new(shape, vocab(&clips), 5, &cpu_device()).unwrap();
        // The network alone, loaded from its own files, for the logits of unpadded rows.
        let dir = scratch(&format!("plain-{}", backbone.name()));
        lm.save(&dir).unwrap();
        let plain = Pretrained::open(&dir, &cpu_device()).unwrap();
        std::fs::remove_dir_all(dir).unwrap();
        let texts = vocab(&clips);
        let (mut stage, net) =
            LmStage::new(&config, lm, LmStageKind::Pretrain, &clips, &[]).unwrap();
        let items: Vec<usize> = stage.plan_epoch(1).into_iter().flatten().collect();
        let loss = stage.loss(&net, &items, FIRST_STEP).unwrap().total;
        let found = f64::from(loss.into_scalar::<f32>());
        let (mut sum, mut n, mut prompts) = (0.0, 0.0, BTreeSet::new());
        for item in &items {
            let clip = &clips[Item::unpack(*item).clip];
            let prompt = texts
                .prompt("describe {radar}", Some(&clip.variants[0]), None)
                .unwrap();
            let mut target = texts.text_ids(&clip.captions[0]).unwrap();
            target.push(EOS);
            prompts.insert(prompt.ids.len());
            let input = ModelInput {
                input_ids: vec![[prompt.ids.as_slice(), &target].concat()],
                ..ModelInput::default()
            };
            let (logits, shape) = plain.logits(&input, &cpu_device()).unwrap();
            for (i, token) in target.iter().enumerate() {
                let row = prompt.ids.len() - 1 + i;
                let row = &logits[row * shape[2]..(row + 1) * shape[2]];
                let total: f64 = row.iter().map(|l| f64::from(*l).exp()).sum();
                sum += total.ln() - f64::from(row[*token as usize]);
                n += 1.0;
            }
        }
        assert!(
            prompts.len() > 1,
            "rows of several lengths, so that some are padded"
        );
        // f32 rounding of losses near 7.
        assert!((found - sum / n).abs() < 1e-4, "{found} {}", sum / n);
    }
}

#[test]
fn backbones_that_cannot_be_are_refused() {
    let clips = toy_clips(2, N_CODES, CODE_DIM);
    let dir = scratch("refused");
    let refuse = |change: &dyn Fn(&mut LmTrainConfig), expected: &str| {
        let mut config = decoder_config(Backbone::Gpt2, bare_loop(1));
        change(&mut config);
        let problem = pretrain(&config, N_CODES, &clips, &[], &dir.join("x"), false);
        let problem = problem.unwrap_err().to_string();
        assert!(problem.contains(expected), "{problem}");
        assert!(!dir.join("x").exists(), "nothing is written");
    };
    refuse(&|c| c.preset = LmPreset::T5Small, "tiny, small and medium");
    refuse(&|c| c.lora = Some(LoraConfig::default()), "set `from`");
    refuse(
        &|c| c.hf_folder = Some("/no/such/folder".into()),
        "/no/such/folder",
    );
    let none = LoraConfig {
        rank: 0,
        ..LoraConfig::default()
    };
    refuse(&|c| c.lora = Some(none), "lora.rank");
    let of_t5 = |c: &mut LmTrainConfig| {
        c.backbone = Backbone::T5;
        c.lora = Some(LoraConfig::default());
    };
    refuse(&of_t5, "T5 is trained whole");
    let folder = pretrained_folder(Backbone::Qwen2, &dir);
    refuse(&|c| c.hf_folder = Some(folder.clone()), "holds a `qwen2`");
    std::fs::remove_dir_all(dir).unwrap();
}

fn vocab(clips: &[LmClip]) -> Vocab {
    let captions = clips.iter().flat_map(|c| &c.captions).map(String::as_str);
    Vocab::learn(captions, all_text(), 2000, 32, N_CODES).unwrap()
}

#[test]
fn items_pack_into_numbers_and_back() {
    for task in Task::INSTRUCTION.into_iter().chain(Task::PRETRAINING) {
        for (clip, variant, flipped, caption, prompt) in [
            (0, 0, false, 0, 0),
            (1_000_000, 255, true, 255, 511),
            (7, 3, true, 2, 160),
        ] {
            let item = Item {
                clip,
                task,
                variant,
                flipped,
                caption,
                prompt,
            };
            assert_eq!(Item::unpack(item.pack()), item);
        }
    }
}

#[test]
fn every_example_ends_and_radar_prediction_restores_the_codes() {
    let clips = toy_clips(16, N_CODES, CODE_DIM);
    let vocab = vocab(&clips);
    let layout = vocab.layout();
    let config = exact_config(bare_loop(1));
    let rng = &mut ChaCha8Rng::seed_from_u64(3);
    for kind in [LmStageKind::Pretrain, LmStageKind::Instruct] {
        let maker = ExampleMaker::new(&vocab, CODE_DIM, &clips, kind).unwrap();
        let mut tasks = std::collections::BTreeSet::new();
        for seed in 0..20 {
            let items = maker.draw_epoch(&config, seed);
            assert_eq!(items.len(), clips.len(), "same number every epoch");
            for item in &items {
                tasks.insert(item.task);
                let example = maker.example(&vocab, &config, item, rng).unwrap();
                assert!(ends(&example.target) && ends(&example.source.ids));
                let n = example.source.feature_positions.len();
                assert_eq!(example.source.features.len(), n * CODE_DIM);
                let is_code = |p: &u32| layout.code_of(example.source.ids[*p as usize]).is_some();
                assert!(example.source.feature_positions.iter().all(is_code));
                if item.task == Task::RadarPrediction {
                    // Replacing each sentinel by its span must restore the codes of the clip.
                    let mut restored = Vec::new();
                    for id in &example.source.ids {
                        if let Some(code) = layout.code_of(*id) {
                            restored.push(code);
                        } else if let Some(at) = example.target.iter().position(|t| t == id) {
                            let span = example.target[at + 1..].iter();
                            restored.extend(span.map_while(|t| layout.code_of(*t)));
                        }
                    }
                    assert_eq!(restored, clips[item.clip].variants[0].codes);
                }
            }
            let batches = maker.batches(items.clone(), 5, seed);
            let mut all: Vec<usize> = batches.iter().flatten().map(|i| i.pack()).collect();
            let mut drawn: Vec<usize> = items.iter().map(|i| i.pack()).collect();
            all.sort_unstable();
            drawn.sort_unstable();
            assert_eq!(all, drawn, "batches hold every item once");
        }
        let expected = if kind == LmStageKind::Pretrain { 3 } else { 5 };
        assert_eq!(tasks.len(), expected);
    }
}

/// Replacing each sentinel by its span restores the sentence, and sentences are drawn as often as their weight says.
#[test]
fn text_prediction_restores_sentences() {
    let clips = toy_clips(16, N_CODES, CODE_DIM);
    let vocab = vocab(&clips);
    let layout = vocab.layout();
    let sentences = [
        "a person walks forward slowly and then sits down on a chair",
        "waves",
        "someone turns",
    ];
    let mut config = exact_config(bare_loop(1));
    config.sampling.text_prediction = 3.0;
    let mut maker = ExampleMaker::new(&vocab, CODE_DIM, &clips, LmStageKind::Pretrain).unwrap();
    maker
        .add_sentences(&vocab, &sentences.map(String::from))
        .unwrap();
    let rng = &mut ChaCha8Rng::seed_from_u64(3);
    let fill = vocab.text_ids("fill").unwrap();
    let (mut shares, mut n_all, mut drawn) = (Vec::new(), 0, [0; 3]);
    for item in (0..40).flat_map(|seed| maker.draw_epoch(&config, seed)) {
        n_all += 1;
        if item.task != Task::TextPrediction {
            continue;
        }
        drawn[item.clip] += 1;
        let example = maker.example(&vocab, &config, &item, rng).unwrap();
        assert!(ends(&example.target) && ends(&example.source.ids));
        assert!(example.source.feature_positions.is_empty());
        let source = &example.source.ids[..example.source.ids.len() - 1];
        let (prompt, source) = source.split_at(fill.len());
        assert_eq!(prompt, fill);
        let is_sentinel = |id: &u32| (0..layout.n_sentinels).any(|k| layout.sentinel(k) == *id);
        let (mut restored, mut n_masked) = (Vec::new(), 0);
        for id in source {
            if is_sentinel(id) {
                let at = example.target.iter().position(|t| t == id).unwrap();
                let end = |t: &&u32| !is_sentinel(t) && **t != layout.end;
                let span: Vec<u32> = example.target[at + 1..]
                    .iter()
                    .take_while(end)
                    .copied()
                    .collect();
                n_masked += span.len();
                restored.extend(span);
            } else {
                restored.push(*id);
            }
        }
        assert_eq!(restored, vocab.text_ids(sentences[item.clip]).unwrap());
        if item.clip == 0 {
            shares.push(n_masked as f64 / restored.len() as f64);
        }
    }
    let n_text: usize = drawn.iter().sum();
    // Three of six parts of the sampling weights.
    let share = n_text as f64 / f64::from(n_all);
    assert!((0.4..0.6).contains(&share), "{share}");
    assert!(drawn.iter().all(|n| *n > n_text / 5), "{drawn:?}");
    let (min, max) = shares
        .iter()
        .fold((1.0_f64, 0.0_f64), |(a, b), s| (a.min(*s), b.max(*s)));
    assert!(min < 0.3 && max > 0.7, "{min} to {max}");
}

/// Sentences add words to the vocabulary and a task to the record of what was learned.
#[test]
fn a_model_learns_from_sentences_without_motions() {
    let clips = toy_clips(4, N_CODES, CODE_DIM);
    let dir = scratch("with-sentences");
    std::fs::create_dir_all(&dir).unwrap();
    let file = dir.join("sentences.txt");
    std::fs::write(&file, "a juggler juggles\nsomebody yawns and stretches\n").unwrap();
    let mut config = exact_config(bare_loop(4));
    config.sentences = vec![file];
    let learned = |config: &LmTrainConfig, name: &str| {
        let outcome = pretrain(config, N_CODES, &clips, &[], &dir.join(name), false).unwrap();
        RadarLm::load(&outcome.checkpoint, &cpu_device()).unwrap()
    };
    let with = learned(&config, "with");
    assert_eq!(with.vocab.text_ids("juggles").unwrap().len(), 1);
    let pretrained = with.learned.unwrap().pretrained;
    assert!(pretrained.contains(&Task::TextPrediction), "{pretrained:?}");
    config.sentences.clear();
    let without = learned(&config, "without");
    assert!(without.vocab.text_ids("juggles").unwrap().len() > 1);
    let pretrained = without.learned.unwrap().pretrained;
    assert!(
        !pretrained.contains(&Task::TextPrediction),
        "{pretrained:?}"
    );
    std::fs::remove_dir_all(dir).unwrap();
}

#[test]
fn a_model_that_is_told_the_context_reads_the_same_prompt_in_training_and_use() {
    let mut clips = toy_clips(4, N_CODES, CODE_DIM);
    for clip in &mut clips {
        clip.variants[0].context =
            Some(std::array::from_fn(|i| [3, 20, 40, 60, 70, 80, 88][i % 7]));
    }
    let config = exact_config(bare_loop(1));
    let rng = &mut ChaCha8Rng::seed_from_u64(3);
    for vocab in [vocab(&clips), vocab(&clips).with_context()] {
        let maker = ExampleMaker::new(&vocab, CODE_DIM, &clips, LmStageKind::Pretrain).unwrap();
        let items = (0..20).flat_map(|seed| maker.draw_epoch(&config, seed));
        let mut n = 0;
        for item in items.filter(|item| item.task == Task::RadarToText) {
            let learned = maker.example(&vocab, &config, &item, rng).unwrap();
            let radar = &clips[item.clip].variants[0];
            let used = vocab.prompt(EVALUATION_PROMPT, Some(radar), None).unwrap();
            assert_eq!(learned.source, used);
            n += 1;
        }
        assert!(n > 0);
    }
    let dropping = LmTrainConfig {
        drop_code: 0.5,
        ..config
    };
    let vocab = vocab(&clips).with_context();
    let maker = ExampleMaker::new(&vocab, CODE_DIM, &clips, LmStageKind::Pretrain).unwrap();
    let first = vocab.layout().context(0);
    let (mut n_kept, mut n_all) = (0, 0);
    for item in (0..20).flat_map(|seed| maker.draw_epoch(&dropping, seed)) {
        let example = maker.example(&vocab, &dropping, &item, rng).unwrap();
        n_kept += example.source.ids.iter().filter(|id| **id >= first).count();
        n_all += match item.task {
            Task::TextToRadar => 0,
            _ => CONTEXT_LEN,
        };
    }
    let share = n_kept as f64 / n_all as f64;
    assert!((0.4..0.6).contains(&share), "{share}");
}

/// Padding to the longest sequence of the batch must not change the loss of a sequence.
#[test]
fn loss_of_a_batch_is_the_mean_over_its_tokens() {
    let clips = toy_clips(8, N_CODES, CODE_DIM);
    let mut config = exact_config(bare_loop(1));
    config.sampling.radar_prediction = 0.0;
    config.sampling.text_to_radar = 0.0;
    let shape = config.lm_config(N_CODES, CODE_DIM).unwrap();
    let lm = RadarLm::new(shape, vocab(&clips), 5, &cpu_device()).unwrap();
    let (mut stage, net) = LmStage::new(&config, lm, LmStageKind::Pretrain, &clips, &[]).unwrap();
    let items: Vec<usize> = stage.plan_epoch(1).into_iter().flatten().collect();
    let mut cost = |batch: &[usize]| {
        let loss = stage.loss(&net, batch, FIRST_STEP).unwrap().total;
        f64::from(loss.into_scalar::<f32>())
    };
    let together = cost(&items);
    let vocab = vocab(&clips);
    let (mut sum, mut n) = (0.0, 0.0);
    for item in &items {
        let clip = &clips[Item::unpack(*item).clip];
        let tokens = vocab.text_ids(&clip.captions[0]).unwrap().len() as f64 + 1.0;
        sum += cost(&[*item]) * tokens;
        n += tokens;
    }
    // f32 rounding of losses near 7.
    assert!((together - sum / n).abs() < 1e-4, "{together} {}", sum / n);
}

/// After training with the contrastive loss, clips and captions are matched. Without it, the loss is that of the tokens
/// only.
#[test]
fn clips_find_their_captions() {
    let clips = toy_clips(8, N_CODES, CODE_DIM);
    let mut config = exact_config(LoopConfig {
        learning_rate: 3e-3,
        ..bare_loop(80)
    });
    config.sampling.radar_prediction = 0.0;
    config.sampling.text_to_radar = 0.0;
    config.contrastive_weight = 0.5;
    let losses = |config: &LmTrainConfig, lm: RadarLm| {
        let (mut stage, net) =
            LmStage::new(config, lm, LmStageKind::Pretrain, &clips, &[]).unwrap();
        let items: Vec<usize> = stage.plan_epoch(1).into_iter().flatten().collect();
        let loss = stage.loss(&net, &items, FIRST_STEP).unwrap();
        let contrast = loss.parts.iter().find(|p| p.0 == "contrast").map(|p| p.1);
        (f64::from(loss.total.into_scalar::<f32>()), contrast)
    };
    let fresh = || {
        let shape = config.lm_config(N_CODES, CODE_DIM).unwrap();
        RadarLm::new(shape, vocab(&clips), 5, &cpu_device()).unwrap()
    };
    let (total, contrast) = losses(&config, fresh());
    let contrast = contrast.unwrap();
    let without = LmTrainConfig {
        contrastive_weight: 0.0,
        ..config.clone()
    };
    let (tokens, none) = losses(&without, fresh());
    assert_eq!(none, None);
    // f32 rounding of losses near 7.
    assert!(
        (total - tokens - 0.5 * contrast).abs() < 1e-4,
        "{total} {tokens} {contrast}"
    );
    // The contrastive loss of random guessing is ln 8.
    assert!(contrast > 1.0, "{contrast}");

    let dir = scratch("contrast");
    let outcome = pretrain(&config, N_CODES, &clips, &[], &dir, false).unwrap();
    let lm = RadarLm::load(&outcome.checkpoint, &cpu_device()).unwrap();
    let learned = losses(&config, lm).1.unwrap();
    assert!(learned < 0.2, "{contrast} -> {learned}");
    config.backbone = Backbone::Gpt2;
    let error = config.validate().unwrap_err().to_string();
    assert!(error.contains("contrastive_weight"), "{error}");
    std::fs::remove_dir_all(dir).unwrap();
}

#[test]
fn a_new_t5_may_have_output_rows_of_its_own() {
    let clips = toy_clips(4, N_CODES, CODE_DIM);
    let mut config = exact_config(bare_loop(2));
    let rows = |config: &LmTrainConfig| {
        let dir = scratch("tied");
        let outcome = pretrain(config, N_CODES, &clips, &[], &dir, false).unwrap();
        let lm = RadarLm::load(&outcome.checkpoint, &cpu_device()).unwrap();
        std::fs::remove_dir_all(dir).unwrap();
        collect_params(&lm.net)
            .keys()
            .filter(|name| name.ends_with("head") || name.ends_with("shared"))
            .count()
    };
    assert_eq!(rows(&config), 1);
    config.tie_embeddings = Some(false);
    assert_eq!(rows(&config), 2);
    config.backbone = Backbone::Gpt2;
    let error = config.validate().unwrap_err().to_string();
    assert!(error.contains("tie_embeddings"), "{error}");
}

#[test]
fn bad_clips_are_named() {
    let clips = toy_clips(2, N_CODES, CODE_DIM);
    let vocab = vocab(&clips);
    let refuse = |change: &dyn Fn(&mut LmClip)| {
        let mut bad = clips.clone();
        change(&mut bad[1]);
        ExampleMaker::new(&vocab, CODE_DIM, &bad, LmStageKind::Pretrain)
            .err()
            .unwrap()
            .to_string()
    };
    assert!(refuse(&|c| c.captions.clear()).contains("toy-1"));
    assert!(refuse(&|c| c.variants[0].features[0] = f32::NAN).contains("toy-1"));
    assert!(refuse(&|c| c.variants[0].features.truncate(3)).contains("toy-1"));
    assert!(refuse(&|c| c.variants[0].codes[0] = 16).contains("codebook"));
}

/// Processor time of this process, s. Wall-clock time would include other processes on a shared machine.
/// NaN if there is no `/proc`.
fn cpu_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = text
        .rsplit(')')
        .next()
        .unwrap_or_default()
        .split_whitespace()
        .collect();
    let ticks = |i: usize| {
        fields
            .get(i)
            .and_then(|f| f.parse().ok())
            .unwrap_or(f64::NAN)
    };
    // utime and stime, in the kernel's fixed unit of 1/100 s.
    (ticks(11) + ticks(12)) / 100.0
}

/// Prints the training and decoding speed of the small preset, in processor time; run with `--ignored --nocapture`.
#[test]
#[ignore = "a measurement, not a check"]
fn speed_of_the_small_preset() {
    let clips = toy_clips(256, 512, 128);
    let mut config = LmTrainConfig::small();
    config.sampling.radar_prediction = 0.0;
    config.sampling.text_to_radar = 0.0;
    let shape = config.lm_config(512, 128).unwrap();
    let fill: Vec<String> = (0..1500).map(|i| format!("w{i}")).collect();
    let texts = clips
        .iter()
        .flat_map(|c| &c.captions)
        .chain(&fill)
        .map(String::as_str);
    let vocab = Vocab::learn(texts, all_text(), 2000, 32, 512).unwrap();
    println!("{} embedding rows", vocab.layout().size());
    let lm = RadarLm::new(shape, vocab, 5, &cpu_device()).unwrap();
    println!("{} parameters", lm.net.num_params());
    let dir = scratch("speed");
    for average in [0.0, 0.999] {
        config.average_decay = average;
        config.run = LoopConfig {
            log_every: 20,
            ..bare_loop(60)
        };
        let lm = RadarLm::new(lm.config.clone(), vocab_of(&lm), 5, &cpu_device()).unwrap();
        let (mut stage, net) =
            LmStage::new(&config, lm, LmStageKind::Pretrain, &clips, &[]).unwrap();
        let started = cpu_seconds();
        let out = dir.join(format!("{average}"));
        crate::harness::run(&mut stage, net, &config.run, &out, false).unwrap();
        let rate = 60.0 * config.batch as f64 / (cpu_seconds() - started);
        println!("average {average}: {rate:.0} examples/s with checkpoints");
    }
    let sources: Vec<_> = clips
        .iter()
        .map(|c| lm.describe_prompt(&c.variants[0]).unwrap())
        .collect();
    for beam in [1, 4] {
        let started = cpu_seconds();
        let options = GenerateOptions {
            beam,
            max_new_tokens: 16,
            ..Default::default()
        };
        let n: usize = lm
            .generate(&sources, &options)
            .unwrap()
            .iter()
            .map(|g| g.ids.len() + 1)
            .sum();
        let s = cpu_seconds() - started;
        println!(
            "beam {beam}: {:.0} captions/s of {:.1} tokens",
            256.0 / s,
            n as f64 / 256.0
        );
    }
    let _ = std::fs::remove_dir_all(dir);
}

fn vocab_of(lm: &RadarLm) -> Vocab {
    let json = lm.vocab.tokenizer_json().unwrap();
    Vocab::from_parts(json.as_bytes(), lm.vocab.layout().clone(), None).unwrap()
}

/// Clips of `n_actions` kinds: noisy features around a mean of the kind, codes that follow the feature, two captions
/// each. They imitate the output of a trained tokenizer on a small scale.
fn noisy_clips(n: usize, seed: u64) -> Vec<LmClip> {
    const ACTIONS: [&str; 12] = [
        "walks forward",
        "walks backward",
        "runs in place",
        "jumps twice",
        "sits down",
        "stands up from a chair",
        "waves with the left hand",
        "waves with the right hand",
        "kicks with the left leg",
        "kicks with the right leg",
        "punches forward several times",
        "picks something up from the floor",
    ];
    let dim = 16;
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let means = {
        let rng = &mut ChaCha8Rng::seed_from_u64(99);
        (0..12 * dim)
            .map(|_| rng.random::<f32>() - 0.5)
            .collect::<Vec<_>>()
    };
    (0..n)
        .map(|i| {
            let kind = rng.random_range(0..12);
            let len = rng.random_range(6..20);
            let features: Vec<f32> = (0..len * dim)
                .map(|k| means[kind * dim + k % dim] + 0.6 * (rng.random::<f32>() - 0.5))
                .collect();
            // Four codes per kind; a tenth of the codes are wrong.
            let codes = (0..len)
                .map(|_| match rng.random_range(0..10) {
                    0 => rng.random_range(0..48),
                    _ => kind as u32 * 4 + rng.random_range(0..4),
                })
                .collect();
            LmClip {
                id: format!("noisy-{i}"),
                action: ACTIONS[kind].into(),
                captions: vec![
                    format!("a person {}", ACTIONS[kind]),
                    format!("someone {}", ACTIONS[kind]),
                ],
                variants: vec![Encoded {
                    codes,
                    features,
                    ..Encoded::default()
                }],
                flipped: Vec::new(),
                seconds: len as f32 * 0.4,
            }
        })
        .collect()
}

/// Tests that the default settings, unchanged, generalise to validation clips; `--ignored`, takes a minute.
#[test]
#[ignore = "takes about a minute of one core"]
fn default_settings_generalise_on_noisy_codes() {
    let (clips, val) = (noisy_clips(300, 1), noisy_clips(60, 2));
    let mut config = LmTrainConfig::small();
    config.run.epochs = 40;
    let dir = scratch("noisy");
    let outcome = pretrain(&config, 48, &clips, &val, &dir, false).unwrap();
    let lm = RadarLm::load(&outcome.checkpoint, &cpu_device()).unwrap();
    let said = captions(&lm, &val, 1);
    let right = said
        .iter()
        .zip(&val)
        .filter(|(s, c)| c.captions.contains(s))
        .count();
    println!("{right} of {} unseen clips described exactly", val.len());
    // Two captions are equally likely, so only the kind can be learned. A few clips may be too noisy.
    assert!(right * 10 >= val.len() * 9, "{right} of {}", val.len());
    std::fs::remove_dir_all(dir).unwrap();
}
