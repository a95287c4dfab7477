//! Time of the radar tokenizer on a clip of 9.6 s: the default model's and one of the paper's sizes, on the engine and as
//! trained (burn) in the same process, and their ratio.
//!
//! `cargo bench -p radarllm-nn --bench bench_tokenizer`

#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "a bench")]

use std::path::Path;
use std::time::Instant;

use radarllm_base::random::step;
use radarllm_base::{PointFrame, RadarPoint};
use radarllm_engine::tokenizer::Codes;
use radarllm_inference::tokenizer::encode::TokenizerFile;
use radarllm_inference::tokenizer::grouping::{Grouped, group};
use radarllm_inference::tokenizer::{MAX_FRAMES, TokenizerConfig};
use radarllm_nn::Device;
use radarllm_nn::tokenizer::network::TokenizerNet;
use radarllm_nn::tokenizer::{ReferenceTokenizer, pack};

const RUNS: usize = 9;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let config = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../model-default/weights/tokenizer/config.json");
    let file: TokenizerFile = serde_json::from_str(&std::fs::read_to_string(config)?)?;
    for (name, config, n_clips) in [
        ("default model", file.model, 16),
        ("paper's sizes", TokenizerConfig::paper(), 2),
    ] {
        // Speed does not depend on the weights' values: drawn at random.
        let net = TokenizerNet::new(&config, &Device::flex());
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

struct Random(u64);

impl Random {
    /// Uniform with this standard deviation.
    fn value(&mut self, std: f32) -> f32 {
        ((step(&mut self.0) >> 40) as f32 / (1 << 23) as f32 - 1.0) * std * 3f32.sqrt()
    }
}

/// Clips of 96 frames with 40 points each around somebody who walks to and fro.
fn clips(n: usize) -> Vec<Vec<PointFrame>> {
    let mut random = Random(5);
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
            board: None,
        }
    };
    (0..n)
        .map(|clip| (0..MAX_FRAMES).map(|f| frame(clip, f)).collect())
        .collect()
}
