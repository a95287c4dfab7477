//! Vector quantization: nearest code, and a codebook updated by exponential moving averages (van den Oord et al.,
//! Neural Discrete Representation Learning, appendix A) with resets of unused codes.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

use radarllm_inference::checkpoint::{HostTensor, NamedTensors};
pub use radarllm_inference::tokenizer::nearest::nearest_codes;
pub use radarllm_inference::tokenizer::usage::{CodeUsage, code_usage};

/// Settings of the codebook updates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CodebookConfig {
    /// Decay of the moving averages.
    pub decay: f64,
    /// Codes whose usage is below this share of the mean usage are reset to a random input.
    pub reset_below: f64,
    /// Updates between resets.
    pub reset_every: u64,
    /// Number of updates before the codebook is initialised; nothing is quantized before.
    pub init_after: u64,
    /// Number of inputs gathered for the initialisation, in units of the number of codes.
    pub init_inputs_per_code: usize,
    /// Number of k-means iterations of the initialisation.
    pub init_rounds: usize,
}

impl Default for CodebookConfig {
    fn default() -> Self {
        Self {
            decay: 0.99,
            reset_below: 0.05,
            reset_every: 20,
            init_after: 50,
            init_inputs_per_code: 4,
            init_rounds: 5,
        }
    }
}

/// A codebook that is updated by moving averages of its inputs.
#[derive(Clone, Debug, PartialEq)]
pub struct EmaCodebook {
    dim: usize,
    n_codes: usize,
    /// `[n_codes][dim]`.
    codes: Vec<f32>,
    /// Moving average of the inputs per code and update.
    usage: Vec<f32>,
    /// Moving average of the sum of inputs per code.
    sums: Vec<f32>,
    /// Inputs gathered for the initialisation.
    waiting: Vec<f32>,
    /// Updates since the initialisation, or since the start before it.
    n_updates: u64,
    initialised: bool,
    /// Whether codes have unit length, as their inputs do.
    unit_length: bool,
}

/// Scales every row of `dim` values to length 1. A row of zeros stays as it is.
fn normalise_rows(rows: &mut [f32], dim: usize) {
    for row in rows.chunks_exact_mut(dim.max(1)) {
        let length = row.iter().map(|v| v * v).sum::<f32>().sqrt();
        if length > 0.0 {
            row.iter_mut().for_each(|v| *v /= length);
        }
    }
}

impl EmaCodebook {
    /// A codebook of `n_codes` codes that waits for its first inputs.
    pub fn new(n_codes: usize, dim: usize) -> Self {
        Self {
            dim,
            n_codes,
            codes: vec![0.0; n_codes * dim],
            usage: vec![0.0; n_codes],
            sums: vec![0.0; n_codes * dim],
            waiting: Vec::new(),
            n_updates: 0,
            initialised: false,
            unit_length: false,
        }
    }

    /// A codebook for inputs of unit length, whose codes have unit length too (spherical k-means). The code nearest to such
    /// an input is that of the largest cosine, and it is also the code nearest to any positive multiple of the input.
    pub fn of_unit_length(n_codes: usize, dim: usize) -> Self {
        Self {
            unit_length: true,
            ..Self::new(n_codes, dim)
        }
    }

    /// `[n_codes][dim]`.
    pub fn codes(&self) -> &[f32] {
        &self.codes
    }

    /// False until enough inputs have been gathered; until then, the codes are meaningless.
    pub fn is_initialised(&self) -> bool {
        self.initialised
    }

    /// Takes the inputs of one training step (`[n][dim]`, with their codes if initialised).
    pub fn update(&mut self, inputs: &[f32], codes: &[u32], config: &CodebookConfig, seed: u64) {
        self.n_updates += 1;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        if !self.initialised {
            if self.n_updates > config.init_after {
                self.waiting.extend_from_slice(inputs);
            }
            if self.waiting.len() >= config.init_inputs_per_code.max(1) * self.n_codes * self.dim {
                let inputs_per_update = inputs.len() / self.dim;
                self.initialise(config.init_rounds, inputs_per_update, &mut rng);
            }
            return;
        }
        // Recently initialised codebooks forget faster. Features change quickly at that stage, and averages over a
        // hundred updates would lag behind them (measured: 4 codes in use after 200 updates without this).
        let age = self.n_updates as f64;
        let keep = config.decay.min((1.0 + age) / (10.0 + age)) as f32;
        self.usage.iter_mut().for_each(|u| *u *= keep);
        self.sums.iter_mut().for_each(|s| *s *= keep);
        for (x, &code) in inputs.chunks_exact(self.dim).zip(codes) {
            let k = code as usize;
            self.usage[k] += 1.0 - keep;
            let sum = &mut self.sums[k * self.dim..][..self.dim];
            sum.iter_mut()
                .zip(x)
                .for_each(|(s, v)| *s += (1.0 - keep) * v);
        }
        let mean_usage = self.usage.iter().sum::<f32>() / self.n_codes as f32;
        let n_inputs = inputs.len() / self.dim;
        let resets = config.reset_every > 0 && self.n_updates.is_multiple_of(config.reset_every);
        for k in 0..self.n_codes {
            let span = k * self.dim..(k + 1) * self.dim;
            if resets && n_inputs > 0 && self.usage[k] < config.reset_below as f32 * mean_usage {
                let row = rng.random_range(0..n_inputs);
                let input = &inputs[row * self.dim..][..self.dim];
                self.codes[span.clone()].copy_from_slice(input);
                self.usage[k] = mean_usage;
                for (s, v) in self.sums[span].iter_mut().zip(input) {
                    *s = mean_usage * v;
                }
            } else if self.usage[k] > 1e-6 {
                let usage = self.usage[k];
                for (c, s) in self.codes[span.clone()].iter_mut().zip(&self.sums[span]) {
                    *c = s / usage;
                }
            }
        }
        self.normalise();
    }

    fn normalise(&mut self) {
        if self.unit_length {
            normalise_rows(&mut self.codes, self.dim);
        }
    }

    /// k-means from a random sample of the gathered inputs.
    fn initialise(&mut self, rounds: usize, inputs_per_update: usize, rng: &mut ChaCha8Rng) {
        let inputs = std::mem::take(&mut self.waiting);
        let n = inputs.len() / self.dim;
        let mut order: Vec<usize> = (0..n).collect();
        for i in 0..n.min(self.n_codes) {
            let j = rng.random_range(i..n);
            order.swap(i, j);
        }
        for k in 0..self.n_codes {
            let row = order[k % n];
            let input = &inputs[row * self.dim..][..self.dim];
            self.codes[k * self.dim..][..self.dim].copy_from_slice(input);
        }
        let mut counts = vec![0.0f32; self.n_codes];
        for _ in 0..rounds.max(1) {
            let assigned = nearest_codes(&inputs, &self.codes, self.dim);
            counts.fill(0.0);
            self.sums.fill(0.0);
            for (x, &k) in inputs.chunks_exact(self.dim).zip(&assigned) {
                counts[k as usize] += 1.0;
                let sum = &mut self.sums[k as usize * self.dim..][..self.dim];
                sum.iter_mut().zip(x).for_each(|(s, v)| *s += v);
            }
            for (k, &count) in counts.iter().enumerate() {
                let span = k * self.dim..(k + 1) * self.dim;
                if count > 0.0 {
                    for (c, s) in self.codes[span.clone()].iter_mut().zip(&self.sums[span]) {
                        *c = s / count;
                    }
                }
            }
            self.normalise();
        }
        // Every code starts with the usage to which the moving average would converge.
        let share = inputs_per_update.max(1) as f32 / n as f32;
        for (k, count) in counts.iter().enumerate() {
            self.usage[k] = count.max(0.5) * share;
            for i in k * self.dim..(k + 1) * self.dim {
                self.sums[i] = self.codes[i] * self.usage[k];
            }
        }
        self.initialised = true;
        self.n_updates = 0;
    }

    /// The complete state for resuming.
    pub fn state(&self) -> NamedTensors {
        let rows = |values: &[f32]| HostTensor {
            shape: vec![values.len() / self.dim, self.dim],
            values: values.to_vec(),
        };
        // Two 24-bit halves: f32 holds each exactly.
        let counter = [
            (self.n_updates & 0xff_ffff) as f32,
            (self.n_updates >> 24) as f32,
        ];
        let flags = vec![
            f32::from(u8::from(self.initialised)),
            counter[0],
            counter[1],
        ];
        NamedTensors::from([
            ("codebook.codes".into(), rows(&self.codes)),
            ("codebook.sums".into(), rows(&self.sums)),
            (
                "codebook.usage".into(),
                HostTensor::vector(self.usage.clone()),
            ),
            ("codebook.waiting".into(), rows(&self.waiting)),
            ("codebook.flags".into(), HostTensor::vector(flags)),
        ])
    }

    /// The reverse of [`Self::state`].
    ///
    /// # Errors
    /// The name of the array that is missing or has the wrong size.
    pub fn load_state(&mut self, mut state: NamedTensors) -> Result<(), String> {
        let mut take = |name: &str, n: Option<usize>| match state.remove(name) {
            Some(t) if n.is_none_or(|n| n == t.values.len()) => Ok(t.values),
            _ => Err(name.to_string()),
        };
        let size = self.n_codes * self.dim;
        self.codes = take("codebook.codes", Some(size))?;
        self.sums = take("codebook.sums", Some(size))?;
        self.usage = take("codebook.usage", Some(self.n_codes))?;
        self.waiting = take("codebook.waiting", None)?;
        let flags = take("codebook.flags", Some(3))?;
        self.initialised = flags[0] == 1.0;
        self.n_updates = flags[1] as u64 + ((flags[2] as u64) << 24);
        if !self.waiting.len().is_multiple_of(self.dim) {
            Err("codebook.waiting".into())
        } else {
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(n: usize, dim: usize, seed: u64) -> Vec<f32> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..n * dim).map(|_| rng.random_range(-1.0..1.0)).collect()
    }

    #[test]
    fn codes_settle_on_separate_clusters_and_dead_codes_come_back() {
        let config = CodebookConfig {
            init_after: 0,
            ..Default::default()
        };
        let mut book = EmaCodebook::new(4, 2);
        let centres = [[0.0, 0.0], [8.0, 0.0], [0.0, 8.0], [8.0, 8.0]];
        let noise = cloud(64 * 300, 2, 3);
        for (step, noise) in noise.chunks_exact(128).enumerate() {
            let inputs: Vec<f32> = noise
                .chunks_exact(2)
                .enumerate()
                .flat_map(|(i, n)| {
                    [
                        centres[i % 4][0] + 0.1 * n[0],
                        centres[i % 4][1] + 0.1 * n[1],
                    ]
                })
                .collect();
            let codes = if book.is_initialised() {
                nearest_codes(&inputs, book.codes(), 2)
            } else {
                vec![]
            };
            book.update(&inputs, &codes, &config, step as u64);
        }
        for c in centres {
            let near = book
                .codes()
                .chunks_exact(2)
                .any(|k| (k[0] - c[0]).hypot(k[1] - c[1]) < 0.1);
            assert!(near, "{c:?} in {:?}", book.codes());
        }
    }

    /// Inputs on the unit circle: codes stay on it, and the nearest code is that of the nearest angle for inputs of any length.
    #[test]
    fn codes_of_unit_length_are_looked_up_by_their_angle() {
        let config = CodebookConfig {
            init_after: 0,
            ..Default::default()
        };
        let mut book = EmaCodebook::of_unit_length(6, 2);
        let angles = cloud(64 * 40, 1, 7);
        for (step, angles) in angles.chunks_exact(64).enumerate() {
            let inputs: Vec<f32> = (angles.iter().map(|a| a * std::f32::consts::PI))
                .flat_map(|a| [a.cos(), a.sin()])
                .collect();
            let codes = match book.is_initialised() {
                true => nearest_codes(&inputs, book.codes(), 2),
                false => vec![],
            };
            book.update(&inputs, &codes, &config, step as u64);
        }
        for code in book.codes().chunks_exact(2) {
            assert!((code[0].hypot(code[1]) - 1.0).abs() < 1e-5, "{code:?}");
        }
        let input = [0.6, -0.8];
        let codes = [0.01, 1.0, 300.0]
            .map(|scale| nearest_codes(&input.map(|v| v * scale), book.codes(), 2)[0]);
        assert!(codes.iter().all(|code| *code == codes[0]), "{codes:?}");
    }

    /// Early in training, features move away from the values with which the codebook was initialised.
    #[test]
    fn young_codebooks_follow_their_inputs() {
        let config = CodebookConfig {
            init_after: 0,
            ..Default::default()
        };
        let mut book = EmaCodebook::new(64, 2);
        let noise = cloud(64 * 80, 2, 5);
        let mut last = Vec::new();
        for (step, noise) in noise.chunks_exact(128).enumerate() {
            // A cloud that grows from 0.01 to 1 while the codebook is young.
            let size = 0.01 + (step as f32 / 40.0).min(1.0);
            let inputs: Vec<f32> = noise.iter().map(|v| v * size).collect();
            last = match book.is_initialised() {
                true => nearest_codes(&inputs, book.codes(), 2),
                false => vec![],
            };
            book.update(&inputs, &last, &config, step as u64);
        }
        // 64 uniform inputs over 64 codes: a good codebook has an expected perplexity near 40.
        let perplexity = code_usage(&last, 64).perplexity;
        assert!(perplexity > 20.0, "{perplexity}");
    }

    #[test]
    fn state_round_trips() {
        let config = CodebookConfig {
            init_after: 0,
            init_inputs_per_code: 2,
            ..Default::default()
        };
        let mut book = EmaCodebook::new(8, 3);
        for step in 0..5 {
            let x = cloud(7, 3, step);
            let codes = if book.is_initialised() {
                nearest_codes(&x, book.codes(), 3)
            } else {
                vec![]
            };
            book.update(&x, &codes, &config, step);
            let mut other = EmaCodebook::new(8, 3);
            other.load_state(book.state()).unwrap();
            assert_eq!(book, other);
        }
        assert!(book.is_initialised());
    }

    #[test]
    fn perplexity_of_uniform_and_single_codes() {
        let uniform: Vec<u32> = (0..64).map(|i| i % 16).collect();
        let u = code_usage(&uniform, 32);
        assert!((u.perplexity - 16.0).abs() < 1e-9 && (u.used - 0.5).abs() < 1e-12);
        assert!((code_usage(&[3; 9], 32).perplexity - 1.0).abs() < 1e-12);
        assert_eq!(code_usage(&[], 32).perplexity, 1.0);
    }
}
