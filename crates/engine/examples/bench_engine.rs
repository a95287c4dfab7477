//! Speed of a T5-small: 64 tokens in, exactly 40 out, greedy.
//!
//! `cargo run --release -p radarllm-engine --example bench_engine [-- FOLDER [THREADS]]`
//!
//! Times are those on the CPU where the system tells them and there is one thread.
//!
//! FOLDER holds `config.json` and `model.safetensors` of a T5 as `docs/results/ctranslate2.py` writes
//! them, so that both programs run the same weights; without it they are drawn at random.

#[path = "../tests/support/mod.rs"]
mod support;

use std::path::Path;
use std::time::Instant;

use radarllm_engine::{Engine, NamedTensors, Precision, SearchOptions, Shape};
use radarllm_model::lm::{LmConfig, LmPreset, hf};

const SOURCE: usize = 64;
const NEW: usize = 40;
const RUNS: usize = 9;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next();
    let threads = arguments.next().map_or(Ok(1), |text| text.parse())?;
    let (shape, weights): (Shape, NamedTensors) = match &folder {
        None => (
            support::t5_small(),
            support::weights(&support::t5_small(), 1),
        ),
        Some(folder) => {
            let (t5, tensors) = hf::read_folder(Path::new(folder))?;
            let named = |(name, tensor)| (format!("t5.{name}"), tensor);
            let lm = LmPreset::T5Small.config(1, 1);
            let shape = LmConfig { t5, ..lm }.engine_shape();
            (shape, tensors.into_iter().map(named).collect())
        }
    };
    // The end is never produced, so that every sentence has 40 tokens.
    let allowed: Vec<bool> = (0..shape.vocab_size).map(|id| id != 1).collect();
    for precision in [Precision::F32, Precision::Int8] {
        let engine = Engine::new(shape.clone(), precision, weights.clone())?;
        let mut session = engine.session(threads);
        for batch in [1, 16] {
            let sources: Vec<_> = (0..batch)
                .map(|row| radarllm_engine::Source {
                    // The inputs of ctranslate2.py.
                    ids: (0..SOURCE)
                        .map(|i| 3 + ((row * SOURCE + i) * 7919 % 32_000) as u32)
                        .collect(),
                    ..Default::default()
                })
                .collect();
            let options = SearchOptions {
                max_new_tokens: NEW,
                beam: 1,
                length_penalty: 1.0,
                batch,
                start: 0,
                end: 1,
                allowed: &allowed,
            };
            let mut said = session.generate(&sources, &options)?;
            let mut times_s: Vec<f64> = Vec::new();
            for _ in 0..RUNS {
                let (start, cpu) = (Instant::now(), cpu_s());
                said = session.generate(&sources, &options)?;
                let wall = start.elapsed().as_secs_f64();
                // On a shared machine only the time on the CPU says something; one thread's alone.
                let on_cpu = cpu_s().zip(cpu).map(|(end, start)| end - start);
                times_s.push(on_cpu.filter(|_| threads == 1).unwrap_or(wall));
            }
            times_s.sort_by(f64::total_cmp);
            let (least, median) = (times_s[0], times_s[RUNS / 2]);
            println!(
                "engine {precision:?} {:?} threads {threads} batch {batch:2}: median {:7.1} ms, least {:7.1} ms, \
                 {:6.0} tokens/s; first {:?}",
                engine.level(),
                1e3 * median,
                1e3 * least,
                (batch * NEW) as f64 / median,
                &said[0].ids[..6],
            );
        }
    }
    Ok(())
}

/// First field of the scheduler's statistics (Linux): seconds this thread ran.
fn cpu_s() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(text.split_whitespace().next()?.parse::<f64>().ok()? * 1e-9)
}
