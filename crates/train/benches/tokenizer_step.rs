//! Time of a tokenizer training step: 40-frame clips of 100 points, one thread.
//!
//! `cargo bench -p radarllm-train --bench tokenizer_step [-- batch_size [steps]]`

#![allow(clippy::print_stdout, unreachable_pub, reason = "a bench")]

#[path = "../tests/stages/synthetic.rs"]
mod synthetic;

use radarllm_train::harness::{LoopConfig, TrainError};
use radarllm_train::tokenizer::{self, TokenizerTrainConfig};

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> Result<(), TrainError> {
    let mut arguments = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse::<usize>().ok());
    let batch_size = arguments.next().unwrap_or(16);
    let n_steps = arguments.next().unwrap_or(20) as u64;
    let clips = synthetic::clips(64, 40, 100);
    let mut config = TokenizerTrainConfig {
        batch_size,
        ..Default::default()
    };
    config.codebook.init_after = 0;
    config.run = LoopConfig {
        max_steps: n_steps,
        log_every: 5,
        validate_every: 1_000_000,
        ..LoopConfig::default()
    };
    let out = std::env::temp_dir().join(format!("radarllm-step-{}", std::process::id()));
    let started = std::time::Instant::now();
    let result = tokenizer::train(&config, &clips, &clips[..4], None, &out, false);
    let seconds = started.elapsed().as_secs_f64();
    println!(
        "{:.4} s per clip",
        seconds / (n_steps as f64 * batch_size as f64)
    );
    let _ = std::fs::remove_dir_all(&out);
    // Too few steps to fill the codebook is no matter here.
    match result {
        Err(TrainError::Codebook { .. }) | Ok(_) => Ok(()),
        Err(e) => Err(e),
    }
}
