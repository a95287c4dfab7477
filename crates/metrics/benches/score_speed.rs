//! Time and memory of `score` on files of JSON lines, for tests/goldens/timing.py.
//!
//!     cargo bench -p radarllm-metrics --bench score_speed -- $PWD/c.jsonl $PWD/r.jsonl plain

#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "a bench")]

use std::{error::Error, fs::File, io::BufRead, io::BufReader, time::Instant};

use radarllm_metrics::{Candidate, Protocol, Reference, ScoreOptions, score};
use serde::de::DeserializeOwned;

fn read<T: DeserializeOwned>(path: &str) -> Result<Vec<T>, Box<dyn Error>> {
    let lines = BufReader::new(File::open(path)?).lines();
    lines
        .map(|line| Ok(serde_json::from_str(&line?)?))
        .collect()
}

/// Peak resident memory in MB, where Linux tells it.
fn peak_memory_mb() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1024.0)
}

fn main() -> Result<(), Box<dyn Error>> {
    // Cargo adds `--bench`.
    let args: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| a != "--bench")
        .collect();
    let [candidates, references, protocol] = &args[..] else {
        return Err("expected: candidates.jsonl references.jsonl protocol".into());
    };
    let start = Instant::now();
    let candidates: Vec<Candidate> = read(candidates)?;
    let references: Vec<Reference> = read(references)?;
    let read_s = start.elapsed().as_secs_f64();
    let options = ScoreOptions {
        protocol: Protocol::from_name(protocol).ok_or("unknown protocol")?,
        ..ScoreOptions::default()
    };
    let start = Instant::now();
    let scores = score(&candidates, &references, &options)?;
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{protocol}: {} captions, read {read_s:.1} s, scored {seconds:.1} s ({:.0} captions/s), peak {:.0} MB, BLEU-4 {:.6}, METEOR {:.6}",
        scores.items,
        scores.items as f64 / seconds,
        peak_memory_mb().unwrap_or(f64::NAN),
        scores.bleu_4,
        scores.meteor.unwrap_or(f64::NAN)
    );
    Ok(())
}
