//! Speed of a T5-small: 64 tokens in, exactly 40 out, greedy; or of the radar tokenizer.
//!
//! `cargo run --release -p radarllm-engine --example bench_engine [-- FOLDER [THREADS]]`, or with `tokenizer`
//! in place of FOLDER of the radar tokenizer alone: the default model's and one of the paper's sizes, on the
//! engine and as trained (burn) in the same process, and their ratio.
//!
//! Times are those on the CPU where the system tells them and there is one thread.
//!
//! FOLDER holds `config.json` and `model.safetensors` of a T5 as `studies/ctranslate2.py` writes
//! them, so that both programs run the same weights; without it they are drawn at random.

#[path = "../tests/support/mod.rs"]
mod support;

use std::path::Path;
use std::time::Instant;

use radarllm_base::{PointFrame, RadarPoint};
use radarllm_engine::tokenizer::Codes;
use radarllm_engine::{Engine, NamedTensors, Precision, SearchOptions, Shape};
use radarllm_inference::lm::{LmConfig, LmPreset, NetworkConfig};
use radarllm_inference::tokenizer::encode::TokenizerFile;
use radarllm_inference::tokenizer::grouping::{Grouped, group};
use radarllm_inference::tokenizer::{MAX_FRAMES, TokenizerConfig};
use radarllm_nn::lm::hf;
use radarllm_nn::tokenizer::network::TokenizerNet;
use radarllm_nn::tokenizer::{ReferenceTokenizer, pack};

const SOURCE: usize = 64;
const NEW: usize = 40;
const RUNS: usize = 9;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next();
    let threads = arguments.next().map_or(Ok(1), |text| text.parse())?;
    if folder.as_deref() == Some("tokenizer") {
        return tokenizers();
    }
    let (shape, weights): (Shape, NamedTensors) = match &folder {
        None => (
            support::t5_small(),
            support::weights(&support::t5_small(), 1),
        ),
        Some(folder) => {
            let (t5, tensors) = hf::read_folder(Path::new(folder))?;
            let named = |(name, tensor)| (format!("t5.{name}"), tensor);
            let lm = LmPreset::T5Small.config(1, 1);
            let network = NetworkConfig::T5(t5);
            let shape = LmConfig { network, ..lm }.engine_shape();
            (
                shape.ok_or("not a T5")?,
                tensors.into_iter().map(named).collect(),
            )
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

/// Clips of 96 frames with 40 points each around somebody who walks to and fro.
fn clips(n: usize) -> Vec<Vec<PointFrame>> {
    let mut random = support::Random(5);
    let mut frame = |clip: usize, f: usize| {
        let x_m = (0.05 * f as f32 + clip as f32).sin();
        let mut point = || {
            let (x_m, y_m) = (x_m + random.value(0.3), 3.0 + random.value(0.3));
            RadarPoint {
                x_m,
                y_m,
                z_m: random.value(0.5),
                range_m: x_m.hypot(y_m),
                velocity_mps: random.value(1.0),
                intensity_db: 20.0 + random.value(5.0),
            }
        };
        PointFrame {
            frame: f as u32,
            time_s: f as f64 * 0.1,
            points: (0..40).map(|_| point()).collect(),
        }
    };
    (0..n)
        .map(|clip| (0..MAX_FRAMES).map(|f| frame(clip, f)).collect())
        .collect()
}

fn tokenizers() -> Result<(), Box<dyn std::error::Error>> {
    let config =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/default/tokenizer/config.json");
    let file: TokenizerFile = serde_json::from_str(&std::fs::read_to_string(config)?)?;
    for (name, config, n_clips) in [
        ("default model", file.model, 16),
        ("paper's sizes", TokenizerConfig::paper(), 2),
    ] {
        // Speed does not depend on the weights' values: drawn at random.
        let net = TokenizerNet::new(&config, &radarllm_nn::Device::flex());
        let clips = clips(n_clips);
        let start = Instant::now();
        let grouped: Vec<Grouped> = clips
            .iter()
            .map(|frames| group(frames, 1.0, &config.grouping))
            .collect::<Result<_, _>>()?;
        let grouping_ms = 1e3 * start.elapsed().as_secs_f64() / n_clips as f64;
        let members: Vec<&Grouped> = grouped.iter().collect();
        let inputs: Vec<_> = members.iter().map(|clip| clip.tubes()).collect();
        let engine = pack(config.clone(), &net)?;
        let mut session = engine.engine().session(1);
        let mut out: Vec<Codes> = Vec::new();
        let reference = ReferenceTokenizer::new(config, &net);
        // In turns, so that what else the machine does disturbs both alike.
        let (mut on_engine_s, mut as_trained_s) = (Vec::new(), Vec::new());
        for _ in 0..RUNS {
            let start = Instant::now();
            session.encode(&inputs, &mut out)?;
            on_engine_s.push(start.elapsed().as_secs_f64() / n_clips as f64);
            let start = Instant::now();
            reference.encode_grouped(&members)?;
            as_trained_s.push(start.elapsed().as_secs_f64() / n_clips as f64);
        }
        on_engine_s.sort_by(f64::total_cmp);
        as_trained_s.sort_by(f64::total_cmp);
        let (engine_ms, burn_ms) = (1e3 * on_engine_s[RUNS / 2], 1e3 * as_trained_s[RUNS / 2]);
        println!(
            "tokenizer, {name}, a clip of 9.6 s: engine, one thread {engine_ms:.2} ms, as trained on all cores \
             {burn_ms:.2} ms, ratio {:.2}; grouping before either {grouping_ms:.2} ms",
            engine_ms / burn_ms
        );
    }
    Ok(())
}
