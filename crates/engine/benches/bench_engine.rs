//! Speed of a T5-small: 64 tokens in, exactly 40 out, greedy.
//!
//! `cargo bench -p radarllm-engine --bench bench_engine [-- FOLDER [THREADS]]`. `bench_tokenizer` of crate `nn` has the radar
//! tokenizer.
//!
//! Times are those on the CPU where the system reports them and there is one thread.
//!
//! FOLDER (an absolute path) holds the `model.safetensors` of a T5-small as `studies/ctranslate2.py` writes it, so that both
//! programs run the same weights; without it they are drawn at random.

#![allow(
    clippy::disallowed_methods,
    clippy::print_stdout,
    unreachable_pub,
    reason = "a bench"
)]

#[path = "../tests/support/mod.rs"]
mod support;

use std::path::Path;
use std::time::Instant;

use radarllm_engine::{Engine, HostTensor, NamedTensors, Precision, SearchOptions};
use safetensors::SafeTensors;

const SOURCE: usize = 64;
const NEW: usize = 40;
const RUNS: usize = 9;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // Cargo adds `--bench`.
    let mut arguments = std::env::args().skip(1).filter(|a| a != "--bench");
    let folder = arguments.next();
    let threads = arguments.next().map_or(Ok(1), |text| text.parse())?;
    let shape = support::t5_small();
    let mut weights = support::weights(&shape, 1);
    if let Some(folder) = &folder {
        read(Path::new(folder), &mut weights)?;
    }
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
            let (min, median) = (times_s[0], times_s[RUNS / 2]);
            println!(
                "engine {precision:?} {:?} threads {threads} batch {batch:2}: median {:7.1} ms, min {:7.1} ms, \
                 {:6.0} tokens/s; first {:?}",
                engine.level(),
                1e3 * median,
                1e3 * min,
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

/// Puts the weights of a folder in place of these.
fn read(folder: &Path, weights: &mut NamedTensors) -> Result<(), Box<dyn std::error::Error>> {
    let bytes = std::fs::read(folder.join("model.safetensors"))?;
    let file = SafeTensors::deserialize(&bytes)?;
    for (name, tensor) in weights {
        let (theirs, transposed) = theirs(name).ok_or_else(|| format!("unknown name {name}"))?;
        let view = file.tensor(&theirs)?;
        let values = view
            .data()
            .as_chunks::<4>()
            .0
            .iter()
            .map(|four| f32::from_le_bytes(*four))
            .collect();
        let read = HostTensor {
            shape: view.shape().to_vec(),
            values,
        };
        let read = if transposed { read.transposed() } else { read };
        if read.shape != tensor.shape || read.values.len() != tensor.values.len() {
            return Err(format!("{theirs}: {:?}, expected a T5-small in f32", read.shape).into());
        }
        *tensor = read;
    }
    Ok(())
}

/// Hugging Face's name of a parameter, and whether its rows are our columns.
fn theirs(ours: &str) -> Option<(String, bool)> {
    let parts: Vec<&str> = ours.split('.').collect();
    let name = match parts[..] {
        ["t5", "shared"] => "shared".to_string(),
        ["t5", stack, "position_bias"] => {
            format!("{stack}.block.0.layer.0.SelfAttention.relative_attention_bias")
        }
        ["t5", stack, "norm"] => format!("{stack}.final_layer_norm"),
        ["t5", stack, "blocks", i, module, ..] => {
            let (layer, theirs) = match module.strip_suffix("_norm").unwrap_or(module) {
                "attention" => (0, "SelfAttention"),
                "cross" => (1, "EncDecAttention"),
                _ if stack == "encoder" => (1, "DenseReluDense"),
                _ => (2, "DenseReluDense"),
            };
            match parts.get(5) {
                Some(part) => format!("{stack}.block.{i}.layer.{layer}.{theirs}.{part}"),
                None => format!("{stack}.block.{i}.layer.{layer}.layer_norm"),
            }
        }
        _ => return None,
    };
    Some((format!("{name}.weight"), parts.len() == 6))
}
