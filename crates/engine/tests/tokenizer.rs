//! The radar tokenizer as its callers see it, on networks drawn at random.

#![allow(clippy::unwrap_used, unreachable_pub, reason = "a test")]

mod support;

use radarllm_engine::tokenizer::{Codes, Tokenizer, TokenizerShape};
use radarllm_engine::{EngineError, SimdLevel};
use support::{OwnedClip, tokenizer_shape, tokenizer_weights, tube_clip};

fn tokenizer() -> Tokenizer {
    let shape = tokenizer_shape();
    Tokenizer::new(shape, tokenizer_weights(&shape, 1)).unwrap()
}

fn clips(shape: &TokenizerShape) -> Vec<OwnedClip> {
    // Miri is some thousand times slower.
    let steps: &[usize] = if cfg!(miri) {
        &[1, 3]
    } else {
        &[1, 2, 3, 12, 7, 5]
    };
    let clip = |(i, n): (usize, &usize)| tube_clip(shape, *n, i as u64);
    steps.iter().enumerate().map(clip).collect()
}

fn encode(tokenizer: &Tokenizer, threads: usize, clips: &[OwnedClip]) -> Vec<Codes> {
    let views: Vec<_> = clips.iter().map(OwnedClip::view).collect();
    let mut out = Vec::new();
    tokenizer.session(threads).encode(&views, &mut out).unwrap();
    out
}

/// Bit by bit: a clip's codes depend on the clip alone.
#[test]
fn neighbours_and_threads_change_nothing() {
    let tokenizer = tokenizer();
    let clips = clips(tokenizer.shape());
    let together = encode(&tokenizer, 1, &clips);
    for threads in [2, 3, 5] {
        assert_eq!(encode(&tokenizer, threads, &clips), together);
    }
    for (clip, codes) in clips.iter().zip(&together) {
        assert_eq!(encode(&tokenizer, 1, std::slice::from_ref(clip))[0], *codes);
        assert_eq!(codes.codes.len(), clip.steps.len().div_ceil(2));
        assert_eq!(codes.features.len(), codes.codes.len() * 11);
    }
}

#[test]
fn vector_levels_agree() {
    let shape = tokenizer_shape();
    let clips = clips(&shape);
    let with = |level| {
        let weights = tokenizer_weights(&shape, 1);
        let tokenizer = Tokenizer::with_level(shape, weights, level).unwrap();
        encode(&tokenizer, 1, &clips)
    };
    let portable = with(SimdLevel::PORTABLE);
    for level in SimdLevel::available() {
        for (a, b) in with(level).iter().zip(&portable) {
            assert_eq!(a.codes, b.codes, "{level:?}");
            for (a, b) in a.features.iter().zip(&b.features) {
                // Values of order 1 after some ten products of at most 80 terms.
                assert!((a - b).abs() < 2e-5, "{level:?}: {a} {b}");
            }
        }
    }
}

/// The code is the nearest by definition, for every feature.
#[test]
fn codes_are_the_nearest() {
    let tokenizer = tokenizer();
    let weights = tokenizer_weights(tokenizer.shape(), 1);
    let codebook = &weights["codebook"].values;
    for codes in encode(&tokenizer, 1, &clips(tokenizer.shape())) {
        for (feature, code) in codes.features.chunks_exact(11).zip(&codes.codes) {
            let square = |c: &[f32]| -> f32 {
                let differences = c.iter().zip(feature).map(|(a, b)| a - b);
                differences.map(|d| d * d).sum()
            };
            let nearest = codebook
                .chunks_exact(11)
                .map(square)
                .fold(f32::MAX, f32::min);
            let own = square(&codebook[*code as usize * 11..][..11]);
            // The engine's formula rounds otherwise: squares of order 10.
            assert!(own <= nearest + 1e-5, "{own} {nearest}");
        }
    }
}

#[test]
fn clips_that_do_not_fit_are_errors() {
    let tokenizer = tokenizer();
    let shape = *tokenizer.shape();
    let good = tube_clip(&shape, 4, 1);
    let refused = |change: &dyn Fn(&mut OwnedClip)| {
        let mut bad = good.clone();
        change(&mut bad);
        let clips = [good.view(), bad.view()];
        let said = tokenizer.session(2).encode(&clips, &mut Vec::new());
        match said.unwrap_err() {
            EngineError::Input { index: 1, problem } => problem,
            EngineError::Output { index: 1 } => "output".into(),
            other => panic!("{other}"),
        }
    };
    for change in [
        &(|c: &mut OwnedClip| c.steps.clear()) as &dyn Fn(&mut OwnedClip),
        &|c| c.steps.resize(13, [0.0; 6]),
        &|c| c.anchors.truncate(6),
        &|c| c.profiles.truncate(71),
        &|c| c.tubes[0].step = 4,
        &|c| c.tubes[0].anchor = 7,
        &|c| c.tubes[0].end = c.tubes[0].start,
        &|c| c.tubes[0].end = u32::MAX,
    ] {
        assert_ne!(refused(change), "output");
    }
    // A value that is not a number reaches the features and is found there.
    for step in 0..4 {
        let output = refused(&|c: &mut OwnedClip| c.steps[step][0] = f32::NAN);
        assert_eq!(output, "output");
    }
}

#[test]
#[cfg_attr(miri, ignore = "packs many networks and runs none")]
fn weights_that_do_not_fit_are_errors() {
    let shape = tokenizer_shape();
    let weights = tokenizer_weights(&shape, 1);
    let new = |shape, weights| Tokenizer::new(shape, weights).map(|_| ());
    assert!(new(shape, weights.clone()).is_ok());
    for name in weights.keys() {
        let mut less = weights.clone();
        less.remove(name);
        let error = new(shape, less).unwrap_err();
        assert!(
            matches!(&error, EngineError::MissingWeight { name: n, .. } if n == name),
            "{name}: {error}"
        );
    }
    for change in [
        &(|s: &mut TokenizerShape| s.n_heads = 3) as &dyn Fn(&mut TokenizerShape),
        &|s| s.width = 0,
        &|s| s.n_codes = usize::MAX,
        &|s| s.per_anchor = 6,
        &|s| s.n_layers = 1,
        &|s| s.profile = None,
    ] {
        let mut other = shape;
        change(&mut other);
        assert!(new(other, weights.clone()).is_err(), "{other:?}");
    }
}
