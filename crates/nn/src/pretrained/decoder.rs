//! A decoder-only network (GPT-2 or Qwen2) as the radar-language model, with prompt and answer in one row.
//!
//! Training pads rows at the end. Decoding pads prompts at the front, so that every row continues in the
//! same column. Positions count tokens, so padding does not change the result.

use burn::module::{Module, Param};
use burn::tensor::{Device, IndexingUpdateOp, Int, Tensor, TensorData};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;

use super::gpt2::Gpt2;
use super::layers::{Embedding, Linear, LoraConfig, Past};
use super::qwen2::Qwen2;
use crate::lm::pass::{ForwardPass, TrainingPass};
use crate::lm::rows::{HIDDEN, Rows, Steps, ids_1d};
use crate::lm::t5::{features_tensor, new_bypass, push_features};
use crate::precision::{Product, ProductPrecision};
use radarllm_engine::Source;
use radarllm_inference::lm::config::{LmConfig, NetworkConfig};
use radarllm_inference::lm::{InputError, LmError};

/// A decoder of one of the supported architectures.
#[derive(Module, Debug)]
pub enum DecoderOnlyNet {
    /// GPT-2.
    Gpt2(Gpt2),
    /// Qwen2.
    Qwen2(Qwen2),
}

/// The network with the optional continuous bypass for radar features.
#[derive(Module, Debug)]
pub struct RadarDecoder {
    /// The decoder.
    pub decoder: DecoderOnlyNet,
    /// `[code_dim, width]`: adds the projected radar feature to the code's embedding.
    pub bypass: Option<Param<Tensor<2>>>,
}

/// Keys and values kept between decoding steps.
#[derive(Clone, Debug)]
pub struct DecoderPast {
    past: Past,
    /// Number of tokens read, per row.
    n_tokens: Vec<usize>,
    /// Number of padding columns before them, per row.
    padding: Vec<usize>,
    /// Number of cached columns.
    n_columns: usize,
}

impl DecoderPast {
    /// Keeps the given rows of the batch, in this order; rows may repeat.
    pub fn select(mut self, rows: &[usize]) -> Self {
        self.past.select(rows);
        self.n_tokens = rows.iter().map(|row| self.n_tokens[*row]).collect();
        self.padding = rows.iter().map(|row| self.padding[*row]).collect();
        self
    }
}

impl DecoderOnlyNet {
    /// A network drawn from `seed`.
    ///
    /// # Errors
    /// If the configuration is impossible, or is that of a T5.
    pub fn new(config: &NetworkConfig, seed: u64, device: &Device) -> Result<Self, LmError> {
        match config {
            NetworkConfig::Gpt2(c) => Ok(Self::Gpt2(Gpt2::new(c.clone(), seed, device)?)),
            NetworkConfig::Qwen2(c) => Ok(Self::Qwen2(Qwen2::new(c.clone(), seed, device)?)),
            NetworkConfig::T5(_) => Err(LmError::Config {
                field: "network",
                problem: "t5 is no decoder alone".into(),
            }),
        }
    }

    /// The architecture as it was read or drawn. Rows added since then are not counted.
    pub fn config(&self) -> NetworkConfig {
        match self {
            Self::Gpt2(net) => NetworkConfig::Gpt2(net.config().clone()),
            Self::Qwen2(net) => NetworkConfig::Qwen2(net.config().clone()),
        }
    }

    fn embed(&self, ids: Tensor<1, Int>) -> Tensor<2> {
        match self {
            Self::Gpt2(net) => net.wte.forward(ids),
            Self::Qwen2(net) => net.embed_tokens.forward(ids),
        }
    }

    fn states(
        &self,
        x: Tensor<2>,
        steps: &Steps,
        past: Option<&mut Past>,
        drop: &mut ForwardPass,
    ) -> Tensor<2> {
        match self {
            Self::Gpt2(net) => net.states(x, steps, past, drop),
            Self::Qwen2(net) => net.states(x, steps, past, drop),
        }
    }

    /// Dropout probability of the network itself.
    fn dropout(&self) -> f64 {
        match self {
            Self::Gpt2(net) => net.config().resid_pdrop,
            Self::Qwen2(net) => net.config().attention_dropout,
        }
    }

    /// Sets the dropout probability in training.
    pub fn set_dropout(&mut self, p: f64) {
        match self {
            Self::Gpt2(net) => net.set_dropout(p),
            Self::Qwen2(net) => net.set_dropout(p),
        }
    }

    /// Logits of the first `n_rows` vocabulary entries, `[rows, n_rows]`.
    pub fn logits(
        &self,
        states: Tensor<2>,
        n_rows: usize,
        precision: ProductPrecision,
    ) -> Tensor<2> {
        match self {
            Self::Gpt2(net) => net.head().products(states, n_rows, precision),
            Self::Qwen2(net) => net.head().products(states, n_rows, precision),
        }
    }

    /// The embedding and, if they are not tied, the output rows.
    fn vocabularies(&mut self) -> impl Iterator<Item = &mut Embedding> {
        let (embedding, head) = match self {
            Self::Gpt2(net) => (&mut net.wte, &mut net.lm_head),
            Self::Qwen2(net) => (&mut net.embed_tokens, &mut net.lm_head),
        };
        std::iter::once(embedding).chain(head)
    }

    /// Appends `n` rows to embedding and output, drawn from `seed`, with the magnitude of the existing rows.
    pub fn extend(&mut self, n: usize, seed: u64) {
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        self.vocabularies().for_each(|rows| rows.extend(n, rng));
    }

    fn adapted(&mut self) -> Vec<&mut Linear> {
        match self {
            Self::Gpt2(net) => net.adapted().collect(),
            Self::Qwen2(net) => net.adapted().collect(),
        }
    }

    /// Adds adapters to c_attn (GPT-2) or to queries and values (Qwen2). New adapters do not change the output.
    pub fn adapt(&mut self, config: LoraConfig, seed: u64) {
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        for linear in self.adapted() {
            linear.adapt(config, rng);
        }
    }

    /// Merges the adapters into the weights; the function does not change.
    pub fn merge(&mut self) {
        self.adapted().into_iter().for_each(Linear::merge);
    }
}

impl RadarDecoder {
    /// Adds the bypass of a new network, if the configuration has one. Its magnitude is that of newly drawn embedding
    /// rows (standard deviation 0.02 in both papers).
    pub fn new(decoder: DecoderOnlyNet, config: &LmConfig, seed: u64, device: &Device) -> Self {
        let std = 0.02 * (config.code_dim as f64).powf(-0.5);
        Self {
            decoder,
            bypass: new_bypass(config, std, seed, device),
        }
    }

    /// Embedded ids; `first` is the position of each source's first id in its row.
    fn embed(
        &self,
        rows: &Rows,
        sources: &[&Source],
        first: impl Fn(usize) -> usize,
        code_dim: usize,
        precision: ProductPrecision,
    ) -> Tensor<2> {
        let device = &self.device();
        let x = self.decoder.embed(rows.tensor(device));
        let Some(bypass) = &self.bypass else {
            return x;
        };
        let (mut places, mut features) = (Vec::new(), Vec::new());
        for (i, source) in sources.iter().enumerate() {
            let start = i * rows.shape[1] + first(i);
            push_features(source, code_dim, start, &mut places, &mut features);
        }
        match features_tensor(places, features, code_dim, device) {
            Some((places, features)) => {
                let projected = features.product(bypass.val(), precision);
                x.select_assign(0, places, projected, IndexingUpdateOp::Add)
            }
            None => x,
        }
    }

    /// States `[target tokens, width]` from which [`DecoderOnlyNet::logits`] predicts each target token. Every
    /// target follows its source, one after the other. `training` is passed in training only.
    ///
    /// # Errors
    /// If a row is longer than the network's positions.
    pub fn target_states(
        &self,
        examples: &[(&Source, &[u32])],
        code_dim: usize,
        training: Option<&mut TrainingPass>,
    ) -> Result<Tensor<2>, LmError> {
        let device = &self.device();
        let rows: Vec<Vec<u32>> = examples
            .iter()
            .map(|(source, target)| {
                // The last target token predicts nothing.
                let target = &target[..target.len().saturating_sub(1)];
                [source.ids.as_slice(), target].concat()
            })
            .collect();
        let rows = Rows::padded(&rows, false);
        let length = rows.shape[1];
        let longest = self.longest();
        if length > longest {
            let (found, positions) = (length, longest);
            return Err(InputError::Example { found, positions }.into());
        }
        let sources: Vec<&Source> = examples.iter().map(|(source, _)| *source).collect();
        let drop = &mut ForwardPass::new(self.decoder.dropout(), training);
        let x = self.embed(&rows, &sources, |_| 0, code_dim, drop.precision);
        let states = self
            .decoder
            .states(x, &rows.steps(true, device), None, drop);
        let places = examples
            .iter()
            .enumerate()
            .flat_map(|(i, (source, target))| {
                // The prompt's last token predicts the first target token.
                let first = i * length + source.ids.len() - 1;
                (first..first + target.len()).map(|place| place as i32)
            });
        Ok(states.select(0, ids_1d(places.collect(), device)))
    }

    /// Maximum number of positions of the network.
    pub fn longest(&self) -> usize {
        match &self.decoder {
            DecoderOnlyNet::Gpt2(net) => net.config().n_positions,
            DecoderOnlyNet::Qwen2(net) => net.config().max_position_embeddings,
        }
    }

    /// Reads every source except its last token, which is the input of the first [`Self::step`].
    pub fn read(&self, sources: &[&Source], code_dim: usize, device: &Device) -> DecoderPast {
        let rows: Vec<Vec<u32>> = sources
            .iter()
            .map(|source| source.ids[..source.ids.len().saturating_sub(1)].to_vec())
            .collect();
        let n_tokens: Vec<usize> = rows.iter().map(Vec::len).collect();
        let rows = Rows::padded(&rows, true);
        let n_columns = rows.shape[1];
        let padding: Vec<usize> = n_tokens.iter().map(|n| n_columns - n).collect();
        let mut past = Past::default();
        if n_columns > 0 {
            let drop = &mut ForwardPass::inference();
            let x = self.embed(&rows, sources, |i| padding[i], code_dim, drop.precision);
            // Only keys and values are needed.
            self.decoder
                .states(x, &rows.steps(true, device), Some(&mut past), drop);
        }
        DecoderPast {
            past,
            n_tokens,
            padding,
            n_columns,
        }
    }

    /// One decoding step. The input is the next token of every row; the output is `[batch, width]`.
    pub fn step(&self, past: &mut DecoderPast, ids: &[u32]) -> Tensor<2> {
        let device = self.device();
        let n_keys = past.n_columns + 1;
        let is_padded = past.padding.iter().any(|n| *n > 0);
        let bias = is_padded.then(|| {
            let mut values = vec![0.0_f32; ids.len() * n_keys];
            for (row, n) in values.chunks_exact_mut(n_keys).zip(&past.padding) {
                row[..*n].fill(HIDDEN);
            }
            let data = TensorData::new(values, [ids.len(), 1, 1, n_keys]);
            Tensor::from_data(data, &device)
        });
        let steps = Steps {
            shape: [ids.len(), 1],
            positions: past.n_tokens.clone(),
            bias,
        };
        let ids = ids_1d(ids.iter().map(|id| *id as i32).collect(), &device);
        let x = self.decoder.embed(ids);
        past.n_tokens.iter_mut().for_each(|n| *n += 1);
        past.n_columns += 1;
        let drop = &mut ForwardPass::inference();
        self.decoder.states(x, &steps, Some(&mut past.past), drop)
    }

    /// The device that stores its weights.
    pub fn device(&self) -> Device {
        match &self.decoder {
            DecoderOnlyNet::Gpt2(net) => net.wte.weight.val().device(),
            DecoderOnlyNet::Qwen2(net) => net.embed_tokens.weight.val().device(),
        }
    }
}
