//! Nothing is allocated between tokens, nor between clips of the radar tokenizer.
//!
//! A test program of its own: it counts what the global allocator hands out.

#![allow(unreachable_pub, reason = "a test")]

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use radarllm_engine::tokenizer::Tokenizer;
use radarllm_engine::{Engine, Precision, SearchOptions, Shape};
use support::{sources, tokenizer_shape, tokenizer_weights, tube_clip, weights};

thread_local! {
    /// Allocations of this thread; the test harness's own threads do not count.
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: passes everything on to the system's allocator; counting allocates nothing.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// As many allocations for 40 tokens as for one: none belongs to a token.
#[test]
#[cfg_attr(
    miri,
    ignore = "hundreds of tokens take too long; other tests run the same code"
)]
fn tokens_allocate_nothing() {
    let shape = Shape {
        vocab_size: 200,
        d_model: 32,
        d_kv: 16,
        n_heads: 2,
        d_ff: 64,
        n_encoder_layers: 1,
        n_decoder_layers: 2,
        gated: true,
        tied: true,
        scaled: true,
        relative_buckets: 16,
        relative_max_distance: 32,
        norm_eps: 1e-6,
        bypass: None,
    };
    // Without the end, every sentence has all tokens.
    let mut allowed = vec![true; 200];
    allowed[1] = false;
    for precision in [Precision::F32, Precision::Int8] {
        let engine = Engine::new(shape.clone(), precision, weights(&shape, 1)).unwrap();
        let mut session = engine.session(1);
        for (beam, ends) in [(1, false), (1, true), (4, false), (4, true)] {
            allowed[1] = ends;
            let mut generate = |steps: usize| {
                let sources = sources(200, &[5, 20, 9], 3);
                let options = SearchOptions {
                    max_new_tokens: steps,
                    beam,
                    length_penalty: 1.0,
                    batch: 64,
                    start: 0,
                    end: 1,
                    allowed: &allowed,
                };
                let before = COUNT.get();
                let said = session.generate(&sources, &options).unwrap();
                let lengths: Vec<usize> = said.iter().map(|g| g.ids.len()).collect();
                (COUNT.get() - before, lengths)
            };
            generate(40); // Buffers grow.
            let (few, _) = generate(1);
            let (many, lengths) = generate(40);
            assert!(ends || lengths == [40; 3], "{lengths:?}");
            assert!(few > 0, "the counter counts");
            assert_eq!(many, few, "{precision:?}, {beam} beams");
        }
    }
}

/// Once its buffers have grown, a session encodes clip after clip without asking for memory.
#[test]
#[cfg_attr(
    miri,
    ignore = "long clips take too long; other tests run the same code"
)]
fn clips_allocate_nothing() {
    let shape = tokenizer_shape();
    let tokenizer = Tokenizer::new(shape, tokenizer_weights(&shape, 1)).unwrap();
    let mut session = tokenizer.session(1);
    let long = tube_clip(&shape, shape.max_steps, 2);
    let short = tube_clip(&shape, 3, 3);
    let clips = [long.view(), short.view(), long.view()];
    let mut out = Vec::new();
    let before = COUNT.get();
    session.encode(&clips, &mut out).unwrap();
    assert!(COUNT.get() > before, "the counter counts");
    let first = out.clone();
    let before = COUNT.get();
    session.encode(&clips, &mut out).unwrap();
    assert_eq!(COUNT.get(), before);
    assert_eq!(out, first);
    assert_eq!(out[0], out[2]);
}
