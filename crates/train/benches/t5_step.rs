//! Time of a training step of the T5-small shape: 16 sequences of 96 in and 40 out, dropout 0.1, AdamW.
//!
//! `cargo bench -p radarllm-train --bench t5_step [-- steps [device [f32|bf16|f16]]]`, with `--features gpu` for
//! GPUs; studies/pytorch_step.py does the same in PyTorch.

#![allow(clippy::print_stdout, reason = "a bench")]

use std::error::Error;
use std::time::Instant;

use burn::module::Module;
use radarllm_inference::lm::Source;
use radarllm_inference::lm::config::{LmPreset, NetworkConfig};
use radarllm_nn::device::Processor;
use radarllm_nn::lm::TrainingPass;
use radarllm_nn::lm::{RadarT5, SourceBatch};
use radarllm_nn::precision::ProductPrecision;
use radarllm_train::adamw::{AdamW, AdamWConfig, GradientSum, ParamRule};
use radarllm_train::lm::loss::cross_entropy;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const VOCAB: usize = 32_128;
const BATCH: usize = 16;
const SOURCE: usize = 96;
const TARGET: usize = 40;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
    let n_steps: u64 = args.next().map_or(Ok(8), |a| a.parse())?;
    let processor: Processor = args.next().map_or(Ok(Processor::Cpu), |a| a.parse())?;
    let precision = match args.next().as_deref() {
        None | Some("f32") => ProductPrecision::F32,
        Some("bf16") => ProductPrecision::Bf16,
        Some("f16") => ProductPrecision::F16,
        Some(other) => return Err(format!("`{other}` is no precision").into()),
    };
    // As training starts with it in f16.
    let factor = if precision == ProductPrecision::F16 {
        65_536.0
    } else {
        1.0
    };
    let config = LmPreset::T5Small.config(512, 512);
    let NetworkConfig::T5(mut t5) = config.network.clone() else {
        return Err("the preset is a T5".into());
    };
    t5.vocab_size = VOCAB;
    let device = processor.device()?.autodiff();
    let mut net = RadarT5::new(&t5, &config, 1, &device).train();
    let mut optimizer = AdamW::default();
    // The same made-up ids in both programs.
    let id = |row: usize, at: usize| ((row * 7919 + at * 104_729) % (VOCAB - 2) + 2) as u32;
    let sources: Vec<Source> = (0..BATCH)
        .map(|row| Source {
            ids: (0..SOURCE).map(|at| id(row, at)).collect(),
            ..Source::default()
        })
        .collect();
    let sources: Vec<&Source> = sources.iter().collect();
    let batch = SourceBatch::new(&sources, config.code_dim, &device);
    let targets: Vec<u32> = (0..BATCH * TARGET)
        .map(|i| id(i / TARGET + BATCH, i % TARGET))
        .collect();
    let mut shifted = targets.clone();
    for row in shifted.chunks_exact_mut(TARGET) {
        row.rotate_right(1);
        row[0] = 0;
    }
    let weights = vec![1.0; targets.len()];
    let mut totals = Vec::new();
    for step in 0..n_steps {
        let started = Instant::now();
        let training = &mut TrainingPass::new(step, precision);
        let states = net.forward(&batch, &shifted, TARGET, Some(training));
        let logits = net.t5.logits(states, VOCAB, precision);
        let loss = cross_entropy(logits, &targets, &weights, 0.0);
        let value = loss.clone().into_scalar::<f32>();
        let forward = started.elapsed().as_secs_f64();
        let mut sum = GradientSum::scaled(factor);
        sum.add(&net, (loss * factor).backward());
        let backward = started.elapsed().as_secs_f64() - forward;
        let norm = sum.norm();
        let rule = |_: &str, shape: &[usize]| ParamRule::by_shape(shape);
        net = optimizer.step(&AdamWConfig::default(), 1e-3, &rule, net, sum, norm);
        let total = started.elapsed().as_secs_f64();
        println!(
            "step {step}: loss {value:.4}, {total:.3} s = forward {forward:.3} + backward {backward:.3} + update {:.3}",
            total - forward - backward
        );
        totals.push(total);
    }
    totals.sort_by(f64::total_cmp);
    println!(
        "median {:.3} s, best {:.3} s",
        totals[totals.len() / 2],
        totals[0]
    );
    Ok(())
}
