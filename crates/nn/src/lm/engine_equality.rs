//! Tests that the network in burn and the engine give the same sentences and scores with the same search.

use std::path::Path;

use burn::tensor::Device;
use radarllm_engine::{Precision, Source};
use radarllm_inference::lm::generate::{Allowed, GenerateOptions, Generated, decode_all};
use radarllm_inference::lm::vocab::{EOS, PAD, Vocab};
use radarllm_inference::lm::{EngineLm, LmPreset, NetworkConfig, templates};
use radarllm_inference::tokenizer::{Encoded, context::context};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::{RadarLm, SourceBatch, hf};
use crate::precision::ProductPrecision;

/// Decodes on a session of the engine with `threads` threads.
fn on_engine(
    engine: &EngineLm,
    threads: usize,
    sources: &[Source],
    options: &GenerateOptions,
) -> Vec<Generated> {
    let mut session = engine.engine().session(threads);
    decode_all(&mut session, engine.vocab(), sources, options).unwrap()
}

/// The model that is included in the repository.
fn default_model() -> RadarLm {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("../model-default/weights/lm");
    RadarLm::load(&dir, &Device::flex()).unwrap()
}

/// Prompts of 1 to 24 codes with features like the tokenizer's, and prompts of random words.
fn prompts(lm: &RadarLm, n: usize, seed: u64) -> Vec<Source> {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let (n_codes, dim) = (lm.config.n_codes as u32, lm.config.code_dim);
    (0..n)
        .map(|i| {
            let len = rng.random_range(1..=24);
            let mut code = rng.random_range(0..n_codes);
            let codes: Vec<u32> = (0..len)
                .map(|_| {
                    // Real codes are often repeated.
                    if rng.random::<f32>() < 0.6 {
                        code = rng.random_range(0..n_codes);
                    }
                    code
                })
                .collect();
            let features = (0..len * dim)
                .map(|_| 2.0 * rng.random::<f32>() - 1.0)
                .collect();
            if i % 4 == 3 {
                let n_text = lm.vocab.layout().n_text;
                let mut ids: Vec<u32> = (0..len).map(|_| rng.random_range(3..n_text)).collect();
                ids.push(EOS);
                return Source {
                    ids,
                    ..Source::default()
                };
            }
            let radar = Encoded {
                codes,
                features,
                context: Some(context(&[])),
                ..Encoded::default()
            };
            lm.describe_prompt(&radar).unwrap()
        })
        .collect()
}

/// Compares sentences, scores and confidences; scores are sums of up to 40 terms in f32.
fn assert_same(expected: &[Generated], found: &[Generated]) {
    assert_eq!(expected.len(), found.len());
    for (i, (e, f)) in expected.iter().zip(found).enumerate() {
        assert_eq!(e.ids, f.ids, "input {i}");
        assert!((e.log_prob - f.log_prob).abs() < 2e-4, "{i}: {e:?} {f:?}");
        assert!(
            (e.confidence - f.confidence).abs() < 1e-5,
            "{i}: {e:?} {f:?}"
        );
    }
}

#[test]
fn the_default_model_says_the_same_greedily_and_with_beams() {
    let lm = default_model();
    let engine = lm.pack(Precision::F32).unwrap();
    // The model never learned to produce radar tokens: their probabilities are equal within rounding. Networks drawn at
    // random compare them below.
    for (beam, n) in [(1, 400), (4, 100), (8, 20)] {
        let sources = prompts(&lm, n, beam as u64);
        let options = GenerateOptions {
            beam,
            ..Default::default()
        };
        let expected = lm.generate(&sources, &options).unwrap();
        assert!(
            expected.iter().any(|e| e.ids.len() > 5),
            "sentences, not silence"
        );
        assert_same(&expected, &on_engine(&engine, 1, &sources, &options));
    }
}

/// Penalties, limits and batch sizes change the generated sentences; both implementations must change alike.
#[test]
fn options_mean_the_same() {
    let lm = default_model();
    let engine = lm.pack(Precision::F32).unwrap();
    let sources = prompts(&lm, 12, 77);
    for (beam, length_penalty, max_new_tokens, batch) in [
        (1, 1.0, 3, 5),
        (2, 0.0, 40, 64),
        (4, 2.0, 12, 7),
        (5, -1.0, 20, 1),
        (4, 1.0, 1, 64),
        (64, 1.0, 4, 64),
    ] {
        let options = GenerateOptions {
            beam,
            length_penalty,
            max_new_tokens,
            batch,
            allowed: Allowed::Text,
        };
        let expected = lm.generate(&sources, &options).unwrap();
        assert_same(&expected, &on_engine(&engine, 2, &sources, &options));
    }
}

/// A network of each kind with odd widths, drawn at random, so that no size is a multiple of a SIMD vector.
#[test]
fn both_kinds_of_t5_with_odd_widths_say_the_same() {
    let texts = ["a person walks to the left", "someone jumps"];
    for preset in [LmPreset::T5Small, LmPreset::FlanT5Small, LmPreset::Small] {
        let vocab = Vocab::learn(texts.into_iter(), templates::all_text(), 600, 4, 16).unwrap();
        let mut config = preset.config(16, 9);
        let NetworkConfig::T5(t5) = &mut config.network else {
            panic!("not a T5");
        };
        t5.d_model = 36;
        t5.d_kv = 10;
        t5.n_heads = 3;
        t5.d_ff = 50;
        t5.n_encoder_layers = 2;
        t5.n_decoder_layers = 3;
        let lm = RadarLm::new(config, vocab, 5, &Device::flex()).unwrap();
        let engine = lm.pack(Precision::F32).unwrap();
        let sources = prompts(&lm, 20, 9);
        for (beam, allowed) in [
            (1, Allowed::Text),
            (3, Allowed::Text),
            (1, Allowed::Radar),
            (3, Allowed::Radar),
        ] {
            let options = GenerateOptions {
                beam,
                allowed,
                ..Default::default()
            };
            let expected = lm.generate(&sources, &options).unwrap();
            assert_same(&expected, &on_engine(&engine, 1, &sources, &options));
        }
    }
}

/// Maximum difference of logits on the default model, with its own output as the teacher-forced target.
#[test]
fn logits_of_the_default_model_agree() {
    let lm = default_model();
    let engine = lm.pack(Precision::F32).unwrap();
    let mut session = engine.engine().session(1);
    let net = lm.net.t5().unwrap();
    let vocab = lm.config.network.vocab_size();
    let mut max = 0.0_f32;
    for source in prompts(&lm, 30, 11) {
        let said = lm.generate(std::slice::from_ref(&source), &GenerateOptions::default());
        let mut ids = vec![PAD];
        ids.extend(&said.unwrap()[0].ids);
        let batch = SourceBatch::new(&[&source], lm.config.code_dim, &lm.net.device());
        let states = net.forward(&batch, &ids, ids.len(), None);
        let expected = hf::read(net.t5.logits(states, vocab, ProductPrecision::F32));
        session.start(&[&source], 1, ids.len()).unwrap();
        for (id, expected) in ids.iter().zip(expected.chunks_exact(vocab)) {
            let found = session.logits(&[*id], vocab);
            max = expected
                .iter()
                .zip(found)
                .map(|(e, f)| (e - f).abs())
                .fold(max, f32::max);
        }
    }
    println!("largest difference of logits: {max:.1e}");
    assert!(max < 1e-4, "{max}");
}

/// int8 is an approximation: its accuracy is measured here and bounded from below.
#[test]
fn bytes_mostly_say_the_same() {
    let lm = default_model();
    let sources: Vec<Source> = prompts(&lm, 400, 21);
    let options = GenerateOptions::default();
    let expected = lm.generate(&sources, &options).unwrap();
    let engine = lm.pack(Precision::Int8).unwrap();
    let found = on_engine(&engine, 1, &sources, &options);
    let same = expected
        .iter()
        .zip(&found)
        .filter(|(e, f)| e.ids == f.ids)
        .count();
    let share = same as f64 / sources.len() as f64;
    println!(
        "int8: {same} of {} sentences are those of f32",
        sources.len()
    );
    assert!(share > 0.7 && share < 1.0, "{share}");
}
