//! What reports share: shares with intervals, and which files a model consists of.

use std::{fs, path::Path};

use radarllm_metrics::{bootstrap::mean_interval, rouge::rouge_l, tokens};
use serde::Serialize;

use crate::{
    default_model,
    error::{CliError, CliResult},
};

/// Resamples of an interval, as for the other metrics.
pub const RESAMPLES: usize = 1000;

/// A mean with its 95 % bootstrap interval.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Share {
    /// Mean.
    pub value: f64,
    /// 2.5 % of the resamples lie below.
    pub low: f64,
    /// 2.5 % of the resamples lie above.
    pub high: f64,
}

impl Share {
    /// Mean of `values`, resampling whole `units`; `None` without values.
    pub fn of(values: &[f64], units: &[usize], seed: u64) -> Option<Self> {
        let [low, high] = mean_interval(values, units, RESAMPLES, seed)?;
        Some(Self {
            value: values.iter().sum::<f64>() / values.len() as f64,
            low,
            high,
        })
    }
}

/// ROUGE-L of one sentence, 0..1, best of the first `most` references: what `score` averages.
pub fn rouge_l_of(candidate: &str, references: &[String], most: usize) -> f64 {
    let references: Vec<Vec<String>> = references
        .iter()
        .take(most)
        .map(|text| tokens::rouge_score(text))
        .collect();
    rouge_l(&tokens::rouge_score(candidate), &references)
}

/// The files that a model is loaded from.
pub struct ModelFiles {
    /// Size of all of them, bytes.
    pub bytes: u64,
    /// FNV-1a over names and contents: tells models apart, protects nothing.
    pub fingerprint: u64,
}

impl ModelFiles {
    /// Files of `tokenizer/` and `lm/` of a model folder, or of the embedded default.
    pub fn of(model: Option<&Path>) -> CliResult<Self> {
        let mut files = Self {
            bytes: 0,
            fingerprint: 0xcbf2_9ce4_8422_2325,
        };
        for part in ["lm", "tokenizer"] {
            match model {
                None => {
                    for (name, bytes) in default_model::files(part) {
                        files.add(&name, bytes);
                    }
                }
                Some(model) => {
                    let folder = model.join(part);
                    let io = |e| CliError::io(&folder, e);
                    let mut paths = fs::read_dir(&folder)
                        .map_err(io)?
                        .map(|entry| entry.map(|e| e.path()))
                        .collect::<Result<Vec<_>, _>>()
                        .map_err(io)?;
                    paths.retain(|path| path.is_file());
                    paths.sort();
                    for path in paths {
                        let bytes = fs::read(&path).map_err(|e| CliError::io(&path, e))?;
                        let name = path.file_name().unwrap_or_default().to_string_lossy();
                        files.add(&format!("{part}/{name}"), &bytes);
                    }
                }
            }
        }
        Ok(files)
    }

    fn add(&mut self, name: &str, bytes: &[u8]) {
        self.bytes += bytes.len() as u64;
        self.fingerprint = fnv_1a(self.fingerprint, name.as_bytes());
        self.fingerprint = fnv_1a(self.fingerprint, bytes);
    }
}

/// Goes on with a 64-bit FNV-1a hash.
pub fn fnv_1a(hash: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(hash, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}
