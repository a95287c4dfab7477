//! The engine as its callers see it, on networks drawn at random.

#![allow(clippy::unwrap_used, unreachable_pub, reason = "a test")]

mod support;

use std::sync::atomic::{AtomicBool, Ordering};

use radarllm_engine::search::Watch;
use radarllm_engine::{
    Engine, EngineError, HostTensor, NamedTensors, Precision, SearchOptions, Shape, SimdLevel,
    Source,
};
use support::{sources, weights};

fn small() -> Shape {
    Shape {
        vocab_size: 90,
        d_model: 40,
        d_kv: 12,
        n_heads: 3,
        d_ff: 70,
        n_encoder_layers: 2,
        n_decoder_layers: 2,
        gated: true,
        tied: false,
        scaled: false,
        relative_buckets: 16,
        relative_max_distance: 32,
        norm_eps: 1e-6,
        bypass: Some(5),
    }
}

fn engine(precision: Precision) -> Engine {
    Engine::new(small(), precision, weights(&small(), 1)).unwrap()
}

fn options(allowed: &[bool], beam: usize) -> SearchOptions<'_> {
    SearchOptions {
        max_new_tokens: if cfg!(miri) { 3 } else { 12 },
        beam,
        length_penalty: 1.0,
        batch: 64,
        start: 0,
        end: 1,
        allowed,
    }
}

/// Inputs of different lengths; every other carries a feature.
fn mixed() -> Vec<Source> {
    // Miri is some thousand times slower.
    let lengths: &[usize] = if cfg!(miri) {
        &[1, 17]
    } else {
        &[1, 5, 17, 30, 64, 3]
    };
    let mut all = sources(90, lengths, 2);
    for (i, source) in all.iter_mut().enumerate().step_by(2) {
        source.feature_positions = vec![0];
        source.features = (0..5).map(|j| (i + j) as f32 - 3.0).collect();
    }
    all
}

/// Bit by bit: a sentence depends on its source alone.
#[test]
fn neither_neighbours_nor_threads_change_a_sentence() {
    let allowed = vec![true; 90];
    for precision in [Precision::F32, Precision::Int8] {
        let engine = engine(precision);
        for beam in [1, 3] {
            let options = options(&allowed, beam);
            let together = engine.session(1).generate(&mixed(), &options).unwrap();
            assert!(cfg!(miri) || together.iter().any(|g| g.ids.len() > 3));
            let threads = engine.session(3).generate(&mixed(), &options).unwrap();
            assert_eq!(together, threads);
            // The same session again and again: nothing is left over from earlier inputs.
            let mut session = engine.session(1);
            for (source, expected) in mixed().into_iter().zip(&together) {
                assert_eq!(session.generate(&[source], &options).unwrap()[0], *expected);
            }
        }
    }
}

#[test]
fn every_level_gives_the_same_sentences() {
    let allowed = vec![true; 90];
    for precision in [Precision::F32, Precision::Int8] {
        let expected = engine(precision)
            .session(1)
            .generate(&mixed(), &options(&allowed, 2))
            .unwrap();
        for level in SimdLevel::available() {
            let engine =
                Engine::with_level(small(), precision, weights(&small(), 1), level).unwrap();
            let found = engine
                .session(1)
                .generate(&mixed(), &options(&allowed, 2))
                .unwrap();
            for (e, f) in expected.iter().zip(&found) {
                assert_eq!(e.ids, f.ids, "{level:?} {precision:?}");
                assert!(
                    (e.log_prob - f.log_prob).abs() < 1e-3,
                    "{level:?} {precision:?}"
                );
            }
        }
    }
}

#[test]
fn tokens_are_reported_as_they_come_and_decoding_can_be_cancelled() {
    let engine = engine(Precision::F32);
    let allowed = vec![true; 90];
    for beam in [1, 3] {
        let options = options(&allowed, beam);
        let mut reported = vec![Vec::new(); mixed().len()];
        let cancel = AtomicBool::new(false);
        let mut watch = Watch {
            on_token: &mut |source, id| reported[source].push(id),
            cancel: &cancel,
        };
        let generated = engine
            .session(1)
            .generate_watched(&mixed(), &options, &mut watch)
            .unwrap();
        for (reported, generated) in reported.iter().zip(&generated) {
            assert_eq!(*reported, generated.ids);
        }
    }
    // Stopped from within, after the first token.
    let cancel = AtomicBool::new(false);
    let mut n_reported = 0;
    let mut watch = Watch {
        on_token: &mut |_, _| {
            n_reported += 1;
            cancel.store(true, Ordering::Relaxed);
        },
        cancel: &cancel,
    };
    let one = &sources(90, &[8], 2);
    let stopped = engine
        .session(1)
        .generate_watched(one, &options(&allowed, 1), &mut watch);
    assert_eq!(stopped, Err(EngineError::Cancelled));
    assert_eq!(n_reported, 1);
}

#[test]
fn only_allowed_ids_come_out() {
    let engine = engine(Precision::F32);
    let allowed: Vec<bool> = (0..50).map(|i| i == 1 || i % 7 == 3).collect();
    for beam in [1, 4] {
        for sentence in engine
            .session(1)
            .generate(&mixed(), &options(&allowed, beam))
            .unwrap()
        {
            assert!(
                sentence
                    .ids
                    .iter()
                    .all(|id| allowed[*id as usize] && *id != 1)
            );
            assert!(sentence.confidence > 0.0 && sentence.confidence <= 1.0);
        }
    }
}

#[test]
#[cfg_attr(
    miri,
    ignore = "long inputs that are refused before they reach unsafe code"
)]
fn inputs_and_options_that_do_not_fit_are_errors() {
    let engine = engine(Precision::F32);
    let allowed = vec![true; 90];
    let good = mixed().remove(0);
    let refuse = |change: &dyn Fn(&mut Source)| {
        let mut bad = good.clone();
        change(&mut bad);
        let result = engine
            .session(1)
            .generate(&[good.clone(), bad], &options(&allowed, 1));
        let error = result.unwrap_err();
        assert!(
            matches!(error, EngineError::Input { index: 1, .. }),
            "{error}"
        );
    };
    refuse(&|s| s.ids.clear());
    refuse(&|s| s.ids[0] = 90);
    refuse(&|s| s.ids = vec![3; 2049]);
    refuse(&|s| s.features.truncate(4));
    refuse(&|s| s.features[0] = f32::NAN);
    refuse(&|s| s.feature_positions[0] = 1);
    refuse(&|s| {
        s.feature_positions = vec![0; 1000];
        s.features = vec![0.0; 5000];
    });
    let long = vec![true; 91];
    for bad in [
        SearchOptions {
            beam: 0,
            ..options(&allowed, 1)
        },
        SearchOptions {
            beam: 65,
            ..options(&allowed, 1)
        },
        SearchOptions {
            max_new_tokens: 0,
            ..options(&allowed, 1)
        },
        SearchOptions {
            max_new_tokens: 513,
            ..options(&allowed, 1)
        },
        SearchOptions {
            start: 90,
            ..options(&allowed, 1)
        },
        SearchOptions {
            end: u32::MAX,
            ..options(&allowed, 1)
        },
        options(&long, 1),
        options(&[], 1),
    ] {
        let error = engine
            .session(1)
            .generate(std::slice::from_ref(&good), &bad)
            .unwrap_err();
        assert!(matches!(error, EngineError::Option { .. }), "{error}");
    }
    assert!(
        engine
            .session(1)
            .generate(&[], &options(&allowed, 1))
            .unwrap()
            .is_empty()
    );
}

/// Weights whose sums overflow are nonsense, but no panic.
#[test]
#[cfg_attr(
    miri,
    ignore = "arithmetic alone, no unsafe code that other tests do not run"
)]
fn numbers_that_overflow_end_the_sentence() {
    let allowed = vec![true; 90];
    for precision in [Precision::F32, Precision::Int8] {
        let mut all = weights(&small(), 1);
        for tensor in all.values_mut() {
            tensor
                .values
                .iter_mut()
                .for_each(|v| *v = v.signum() * 1e38);
        }
        let engine = Engine::new(small(), precision, all).unwrap();
        for beam in [1, 3] {
            let generated = engine
                .session(1)
                .generate(&mixed(), &options(&allowed, beam))
                .unwrap();
            assert_eq!(generated.len(), mixed().len());
        }
    }
}

#[test]
#[cfg_attr(miri, ignore = "packs many networks and runs none")]
fn weights_that_do_not_fit_are_named() {
    let refuse = |change: &dyn Fn(&mut NamedTensors), wanted: &str| {
        let mut all = weights(&small(), 1);
        change(&mut all);
        let error = Engine::new(small(), Precision::F32, all)
            .err()
            .unwrap()
            .to_string();
        assert_eq!(error, wanted);
    };
    let wo = "t5.decoder.blocks.1.feed.wo";
    refuse(
        &|w| {
            w.remove(wo);
        },
        "engine: weight `t5.decoder.blocks.1.feed.wo` of shape [70, 40] is missing",
    );
    refuse(
        &|w| w.get_mut(wo).unwrap().shape = vec![40, 70],
        "engine: weight `t5.decoder.blocks.1.feed.wo`: shape [40, 70] with 2800 values, expected [70, 40]",
    );
    refuse(
        &|w| w.get_mut(wo).unwrap().values.truncate(9),
        "engine: weight `t5.decoder.blocks.1.feed.wo`: shape [70, 40] with 9 values, expected [70, 40]",
    );
    refuse(
        &|w| w.get_mut(wo).unwrap().values[7] = f32::INFINITY,
        "engine: weight `t5.decoder.blocks.1.feed.wo`: value 7 is not finite",
    );
    refuse(
        &|w| {
            w.insert("other".into(), HostTensor::vector(vec![0.0]));
        },
        "engine: weight `other` is not part of this network",
    );
    for change in [
        &(|s: &mut Shape| s.d_ff = 1 << 40) as &dyn Fn(&mut Shape),
        &|s| s.n_heads = 0,
        &|s| s.d_kv = 1 << 16,
        &|s| s.relative_buckets = 1,
        &|s| s.relative_max_distance = 3,
        &|s| s.norm_eps = f32::NAN,
        &|s| s.vocab_size = usize::MAX,
        &|s| s.bypass = Some(0),
    ] {
        let mut shape = small();
        change(&mut shape);
        let error = Engine::new(shape, Precision::F32, NamedTensors::new())
            .err()
            .unwrap();
        assert!(matches!(error, EngineError::Shape { .. }), "{error}");
    }
}
