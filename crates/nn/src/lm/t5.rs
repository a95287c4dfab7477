//! The T5 encoder-decoder with an optional input for radar features.
//!
//! Activations are `[batch * length, d_model]`, so that every product is one plain matrix product;
//! only attention uses four axes. T5 adds a learned bias per head and relative position to the
//! scores, which are not scaled by the head width, and normalises by the root mean square alone.
//! Source: Raffel et al. 2020. The results agree with the reference code (tests/goldens/make_t5.py).

use burn::module::{Module, Param};
use burn::tensor::activation::{gelu_approximate, relu, softmax};
use burn::tensor::{Device, IndexingUpdateOp, Int, Tensor, TensorData};
use radarllm_base::random::normal_polar;
use radarllm_engine::Source;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::pass::{ForwardPass, TrainingPass};
use super::rows::{HIDDEN, Rows, ids_1d};
use crate::precision::{Product, ProductPrecision};
use radarllm_inference::lm::config::{FeedForward, LmConfig, T5Config};
use radarllm_inference::lm::position::bucket_table;

/// The network with the optional continuous bypass for radar features.
#[derive(Module, Debug)]
pub struct RadarT5 {
    /// The encoder-decoder.
    pub t5: T5,
    /// `[code_dim, d_model]`: adds the projected radar feature to the code's embedding.
    pub bypass: Option<Param<Tensor<2>>>,
}

/// A T5 encoder-decoder. Matrices are `[in, out]`, embeddings `[row, d_model]`.
#[derive(Module, Debug)]
pub struct T5 {
    /// Embedding rows shared by encoder and decoder, `[vocab_size, d_model]`.
    pub shared: Param<Tensor<2>>,
    /// Encoder stack.
    pub encoder: T5EncoderStack,
    /// Decoder stack.
    pub decoder: T5DecoderStack,
    /// Output rows `[vocab_size, d_model]`; none if they are tied to `shared`.
    pub head: Option<Param<Tensor<2>>>,
    #[module(skip)]
    config: T5Config,
}

/// Encoder stack.
#[derive(Module, Debug)]
pub struct T5EncoderStack {
    /// `[relative_buckets, n_heads]`.
    pub position_bias: Param<Tensor<2>>,
    /// Blocks in order.
    pub blocks: Vec<EncoderBlock>,
    /// Gain of the final norm.
    pub norm: Param<Tensor<1>>,
}

/// Decoder stack.
#[derive(Module, Debug)]
pub struct T5DecoderStack {
    /// `[relative_buckets, n_heads]`.
    pub position_bias: Param<Tensor<2>>,
    /// Blocks in order.
    pub blocks: Vec<DecoderBlock>,
    /// Gain of the final norm.
    pub norm: Param<Tensor<1>>,
}

/// One encoder block.
#[derive(Module, Debug)]
pub struct EncoderBlock {
    /// Norm before self-attention.
    pub attention_norm: Param<Tensor<1>>,
    /// Self-attention.
    pub attention: Attention,
    /// Norm before the feed-forward.
    pub feed_norm: Param<Tensor<1>>,
    /// Feed-forward.
    pub feed: Feed,
}

/// One decoder block.
#[derive(Module, Debug)]
pub struct DecoderBlock {
    /// Norm before self-attention.
    pub attention_norm: Param<Tensor<1>>,
    /// Causal self-attention.
    pub attention: Attention,
    /// Norm before cross-attention.
    pub cross_norm: Param<Tensor<1>>,
    /// Attention to the encoder's output.
    pub cross: Attention,
    /// Norm before the feed-forward.
    pub feed_norm: Param<Tensor<1>>,
    /// Feed-forward.
    pub feed: Feed,
}

/// Projections of one attention, without biases.
#[derive(Module, Debug)]
pub struct Attention {
    /// Query, `[d_model, inner]`.
    pub q: Param<Tensor<2>>,
    /// Key, `[d_model, inner]`.
    pub k: Param<Tensor<2>>,
    /// Value, `[d_model, inner]`.
    pub v: Param<Tensor<2>>,
    /// Output, `[inner, d_model]`.
    pub o: Param<Tensor<2>>,
}

/// Feed-forward matrices.
#[derive(Module, Debug)]
pub struct Feed {
    /// `[d_model, d_ff]`, through the activation.
    pub wi: Param<Tensor<2>>,
    /// `[d_model, d_ff]`, the linear factor of the gated form.
    pub gate: Option<Param<Tensor<2>>>,
    /// `[d_ff, d_model]`.
    pub wo: Param<Tensor<2>>,
}

/// Encoder inputs of one batch on the device, padded at the end.
#[derive(Clone, Debug)]
pub struct SourceBatch {
    /// Sequences.
    pub batch: usize,
    /// Padded length.
    pub length: usize,
    ids: Tensor<1, Int>,
    /// `[batch, 1, 1, length]`, 0 for tokens, a large negative number for padding; none without padding.
    hidden: Option<Tensor<4>>,
    /// Rows of the flattened batch and their features, each of unit mean square.
    features: Option<(Tensor<1, Int>, Tensor<2>)>,
}

impl SourceBatch {
    /// Pads `sources` to the longest and moves them to the device.
    ///
    /// Padding uses id 0 and is masked in attention. Features are scaled to unit mean square
    /// here, so that the bypass does not depend on the radar tokenizer's scale. `sources` must not
    /// be empty, and ids must be below the vocabulary size (checked by [`super::RadarLm`]).
    pub fn new(sources: &[&Source], code_dim: usize, device: &Device) -> Self {
        let batch = sources.len();
        let length = sources
            .iter()
            .map(|s| s.ids.len())
            .max()
            .unwrap_or(0)
            .max(1);
        let mut ids = vec![0_i32; batch * length];
        let mut hidden = vec![HIDDEN; batch * length];
        let (mut rows, mut features) = (Vec::new(), Vec::new());
        for (b, source) in sources.iter().enumerate() {
            let start = b * length;
            for (slot, id) in ids[start..].iter_mut().zip(&source.ids) {
                *slot = *id as i32;
            }
            hidden[start..start + source.ids.len()].fill(0.0);
            push_features(source, code_dim, start, &mut rows, &mut features);
        }
        let features = features_tensor(rows, features, code_dim, device);
        let hidden = hidden
            .iter()
            .any(|h| *h != 0.0)
            .then(|| Tensor::from_data(TensorData::new(hidden, [batch, 1, 1, length]), device));
        Self {
            batch,
            length,
            ids: ids_1d(ids, device),
            hidden,
            features,
        }
    }
}

/// Appends a source's features, each scaled to unit mean square, and their rows in a flattened batch
/// where the source's first id is row `start`.
pub(crate) fn push_features(
    source: &Source,
    code_dim: usize,
    start: usize,
    rows: &mut Vec<i32>,
    features: &mut Vec<f32>,
) {
    let found = source.features.chunks_exact(code_dim);
    for (position, feature) in source.feature_positions.iter().zip(found) {
        rows.push((start + *position as usize) as i32);
        let power = feature.iter().map(|v| v * v).sum::<f32>() / code_dim as f32;
        let scale = (power + 1e-6).sqrt().recip();
        features.extend(feature.iter().map(|v| v * scale));
    }
}

/// The features gathered by [`push_features`], on a device; none without features.
pub(crate) fn features_tensor(
    rows: Vec<i32>,
    features: Vec<f32>,
    code_dim: usize,
    device: &Device,
) -> Option<(Tensor<1, Int>, Tensor<2>)> {
    let shape = [rows.len(), code_dim];
    (!rows.is_empty()).then(|| {
        let features = Tensor::from_data(TensorData::new(features, shape), device);
        (ids_1d(rows, device), features)
    })
}

impl SourceBatch {
    /// Sequences of vectors, which may be on the autodiff graph: every position has the id `id`, and its vector, scaled to
    /// unit mean square, is the feature that the bypass adds.
    ///
    /// # Shapes
    /// - `lengths`: length of each sequence; at least one sequence
    /// - `vectors`: `[sum of lengths, code_dim]`, sequence by sequence
    pub fn of_vectors(id: u32, lengths: &[usize], vectors: Tensor<2>) -> Self {
        let device = vectors.device();
        let ids = |n: &usize| Source {
            ids: vec![id; *n],
            ..Source::default()
        };
        let sources: Vec<Source> = lengths.iter().map(ids).collect();
        let mut batch = Self::new(&sources.iter().collect::<Vec<_>>(), 1, &device);
        let rows = lengths
            .iter()
            .enumerate()
            .flat_map(|(i, n)| (0..*n).map(move |at| (i, at)))
            .map(|(i, at)| (i * batch.length + at) as i32);
        let power = vectors.clone().square().mean_dim(1) + 1e-6;
        batch.features = Some((ids_1d(rows.collect(), &device), vectors / power.sqrt()));
        batch
    }

    /// Rows of ids without features, with padding at any position.
    fn from_rows(rows: &Rows, device: &Device) -> Self {
        let [batch, length] = rows.shape;
        Self {
            batch,
            length,
            ids: rows.tensor(device),
            hidden: rows.bias(false, device),
            features: None,
        }
    }
}

/// The output of the encoder, in the form that the decoder needs.
#[derive(Clone, Debug)]
pub struct EncoderOutput {
    /// `[batch * length, d_model]`.
    pub states: Tensor<2>,
    /// Sequences.
    pub batch: usize,
    /// Padded length.
    pub length: usize,
    hidden: Option<Tensor<4>>,
}

/// Keys and values kept between decoding steps.
#[derive(Clone, Debug)]
pub struct DecoderCache {
    /// Per block: own keys and values `[batch, heads, steps, d_kv]`.
    own: Vec<Option<(Tensor<4>, Tensor<4>)>>,
    /// Per block: the encoder's keys and values `[batch, heads, length, d_kv]`.
    cross: Vec<(Tensor<4>, Tensor<4>)>,
    hidden: Option<Tensor<4>>,
    /// `[1, heads, max_steps, max_steps]`.
    bias: Tensor<4>,
    step: usize,
}

impl DecoderCache {
    /// Keeps the given rows of the batch, in this order; rows may repeat.
    pub fn select(self, rows: &[usize]) -> Self {
        let device = self.bias.device();
        let rows = ids_1d(rows.iter().map(|r| *r as i32).collect(), &device);
        let pick = |t: Tensor<4>| t.select(0, rows.clone());
        let own = self
            .own
            .into_iter()
            .map(|kv| kv.map(|(k, v)| (pick(k), pick(v))))
            .collect();
        let cross = self
            .cross
            .into_iter()
            .map(|(k, v)| (pick(k), pick(v)))
            .collect();
        let hidden = self.hidden.map(pick);
        Self {
            own,
            cross,
            hidden,
            bias: self.bias,
            step: self.step,
        }
    }

    /// Reorders only the decoder's own keys and values, for beams of the same source.
    pub fn reorder(mut self, rows: &[usize]) -> Self {
        let device = self.bias.device();
        let rows = ids_1d(rows.iter().map(|r| *r as i32).collect(), &device);
        for (k, v) in self.own.iter_mut().flatten() {
            *k = k.clone().select(0, rows.clone());
            *v = v.clone().select(0, rows.clone());
        }
        self
    }
}

/// A parameter with normally distributed values.
fn normal<const D: usize>(
    rng: &mut ChaCha8Rng,
    shape: [usize; D],
    std: f64,
    device: &Device,
) -> Param<Tensor<D>> {
    let values = normal_values(rng, shape.iter().product(), std);
    Param::from_tensor(Tensor::from_data(TensorData::new(values, shape), device))
}

/// Normally distributed values of the given standard deviation (Box-Muller).
pub(crate) fn normal_values(rng: &mut ChaCha8Rng, len: usize, std: f64) -> Vec<f32> {
    let mut values = Vec::with_capacity(len + 1);
    while values.len() < len {
        let (radius, angle) = normal_polar(1.0 - rng.random::<f64>(), rng.random::<f64>());
        let radius = radius * std;
        values.push((radius * angle.cos()) as f32);
        values.push((radius * angle.sin()) as f32);
    }
    values.truncate(len);
    values
}

fn ones(len: usize, device: &Device) -> Param<Tensor<1>> {
    Param::from_tensor(Tensor::ones([len], device))
}

impl Attention {
    fn new(rng: &mut ChaCha8Rng, c: &T5Config, device: &Device) -> Self {
        let (d, inner) = (c.d_model, c.inner());
        let std = (d as f64).powf(-0.5);
        Self {
            q: normal(rng, [d, inner], ((d * c.d_kv) as f64).powf(-0.5), device),
            k: normal(rng, [d, inner], std, device),
            v: normal(rng, [d, inner], std, device),
            o: normal(rng, [inner, d], (inner as f64).powf(-0.5), device),
        }
    }
}

impl Feed {
    fn new(rng: &mut ChaCha8Rng, c: &T5Config, device: &Device) -> Self {
        let std = (c.d_model as f64).powf(-0.5);
        Self {
            wi: normal(rng, [c.d_model, c.d_ff], std, device),
            gate: (c.feed_forward == FeedForward::GatedGelu)
                .then(|| normal(rng, [c.d_model, c.d_ff], std, device)),
            wo: normal(rng, [c.d_ff, c.d_model], (c.d_ff as f64).powf(-0.5), device),
        }
    }

    fn forward(&self, x: Tensor<2>, drop: &mut ForwardPass) -> Tensor<2> {
        let inner = match &self.gate {
            None => relu(x.product(self.wi.val(), drop.precision)),
            Some(gate) => {
                gelu_approximate(x.clone().product(self.wi.val(), drop.precision))
                    * x.product(gate.val(), drop.precision)
            }
        };
        drop.apply(inner).product(self.wo.val(), drop.precision)
    }
}

/// `x * gain / rms(x)` over the last axis. No mean is subtracted and no offset is added.
fn rms_norm(x: Tensor<2>, gain: &Param<Tensor<1>>, eps: f64) -> Tensor<2> {
    let inverse = x
        .clone()
        .square()
        .mean_dim(1)
        .add_scalar(eps)
        .sqrt()
        .recip();
    x * inverse * gain.val().unsqueeze::<2>()
}

impl T5 {
    /// A network with the reference initialisation, drawn from `seed`.
    pub fn new(config: &T5Config, seed: u64, device: &Device) -> Self {
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        let c = config;
        let std = (c.d_model as f64).powf(-0.5);
        let shared = normal(rng, [c.vocab_size, c.d_model], 1.0, device);
        let encoder = T5EncoderStack {
            position_bias: normal(rng, [c.relative_buckets, c.n_heads], std, device),
            blocks: (0..c.n_encoder_layers)
                .map(|_| EncoderBlock {
                    attention_norm: ones(c.d_model, device),
                    attention: Attention::new(rng, c, device),
                    feed_norm: ones(c.d_model, device),
                    feed: Feed::new(rng, c, device),
                })
                .collect(),
            norm: ones(c.d_model, device),
        };
        let decoder = T5DecoderStack {
            position_bias: normal(rng, [c.relative_buckets, c.n_heads], std, device),
            blocks: (0..c.n_decoder_layers)
                .map(|_| DecoderBlock {
                    attention_norm: ones(c.d_model, device),
                    attention: Attention::new(rng, c, device),
                    cross_norm: ones(c.d_model, device),
                    cross: Attention::new(rng, c, device),
                    feed_norm: ones(c.d_model, device),
                    feed: Feed::new(rng, c, device),
                })
                .collect(),
            norm: ones(c.d_model, device),
        };
        // Output rows of unit variance, as in the reference initialisation, start with overconfident logits; with this
        // scale they start like the tied form.
        let head = (!c.tie_embeddings).then(|| normal(rng, [c.vocab_size, c.d_model], std, device));
        Self {
            shared,
            encoder,
            decoder,
            head,
            config: config.clone(),
        }
    }

    /// The architecture.
    pub fn config(&self) -> &T5Config {
        &self.config
    }

    /// Sets the dropout probability in training.
    pub fn set_dropout(&mut self, p: f64) {
        self.config.dropout = p;
    }

    /// Embeds flattened ids: `[rows]` to `[rows, d_model]`.
    fn embed(&self, ids: Tensor<1, Int>) -> Tensor<2> {
        self.shared.val().select(0, ids)
    }

    /// `[1, heads, n_queries, n_keys]`.
    fn position_bias(
        &self,
        weight: &Param<Tensor<2>>,
        n_queries: usize,
        n_keys: usize,
        bidirectional: bool,
    ) -> Tensor<4> {
        let c = &self.config;
        let table = bucket_table(
            0,
            n_queries,
            n_keys,
            bidirectional,
            c.relative_buckets,
            c.relative_max_distance,
        );
        let weight = weight.val();
        let ids = ids_1d(table, &weight.device());
        weight
            .select(0, ids)
            .swap_dims(0, 1)
            .reshape([1, c.n_heads, n_queries, n_keys])
    }

    /// `[batch * length, inner]` to `[batch, heads, length, d_kv]`.
    fn heads(&self, x: Tensor<2>, batch: usize, length: usize) -> Tensor<4> {
        x.reshape([batch, length, self.config.n_heads, self.config.d_kv])
            .swap_dims(1, 2)
    }

    /// Attention of queries `[batch * n, inner]` over given keys and values.
    fn attend(
        &self,
        weights: &Attention,
        q: Tensor<4>,
        k: Tensor<4>,
        v: Tensor<4>,
        bias: Option<Tensor<4>>,
        drop: &mut ForwardPass,
    ) -> Tensor<2> {
        let [batch, _, n, _] = q.dims();
        let mut scores = q.product(k.swap_dims(2, 3), drop.precision);
        if let Some(bias) = bias {
            scores = scores + bias;
        }
        let weight = drop.apply(softmax(scores, 3));
        let mixed = weight
            .product(v, drop.precision)
            .swap_dims(1, 2)
            .reshape([batch * n, self.config.inner()]);
        mixed.product(weights.o.val(), drop.precision)
    }

    /// Runs the encoder over embedded tokens `[batch * length, d_model]`.
    fn encode_embedded(
        &self,
        x: Tensor<2>,
        batch: usize,
        length: usize,
        hidden: Option<Tensor<4>>,
        drop: &mut ForwardPass,
    ) -> EncoderOutput {
        let eps = self.config.norm_eps;
        let mut bias = self.position_bias(&self.encoder.position_bias, length, length, true);
        if let Some(hidden) = &hidden {
            bias = bias + hidden.clone();
        }
        let mut x = drop.apply(x);
        for block in &self.encoder.blocks {
            let y = rms_norm(x.clone(), &block.attention_norm, eps);
            let a = &block.attention;
            let q = self.heads(y.clone().product(a.q.val(), drop.precision), batch, length);
            let k = self.heads(y.clone().product(a.k.val(), drop.precision), batch, length);
            let v = self.heads(y.product(a.v.val(), drop.precision), batch, length);
            let y = self.attend(a, q, k, v, Some(bias.clone()), drop);
            x = x + drop.apply(y);
            let y = block
                .feed
                .forward(rms_norm(x.clone(), &block.feed_norm, eps), drop);
            x = x + drop.apply(y);
        }
        let states = drop.apply(rms_norm(x, &self.encoder.norm, eps));
        EncoderOutput {
            states,
            batch,
            length,
            hidden,
        }
    }

    /// Runs the decoder over whole target prefixes with teacher forcing.
    ///
    /// `ids` are `[batch * length]`, starting with the start token; the result is
    /// `[batch * length, d_model]`, ready for [`Self::logits`].
    fn decode_all(
        &self,
        encoded: &EncoderOutput,
        ids: Tensor<1, Int>,
        length: usize,
        drop: &mut ForwardPass,
    ) -> Tensor<2> {
        let eps = self.config.norm_eps;
        let batch = encoded.batch;
        let bias = self.position_bias(&self.decoder.position_bias, length, length, false);
        let mut future = vec![0.0_f32; length * length];
        for query in 0..length {
            future[query * length + query + 1..(query + 1) * length].fill(HIDDEN);
        }
        let future = Tensor::<4>::from_data(
            TensorData::new(future, [1, 1, length, length]),
            &bias.device(),
        );
        let bias = bias + future;
        let mut x = drop.apply(self.embed(ids));
        for block in &self.decoder.blocks {
            let y = rms_norm(x.clone(), &block.attention_norm, eps);
            let a = &block.attention;
            let q = self.heads(y.clone().product(a.q.val(), drop.precision), batch, length);
            let k = self.heads(y.clone().product(a.k.val(), drop.precision), batch, length);
            let v = self.heads(y.product(a.v.val(), drop.precision), batch, length);
            let y = self.attend(a, q, k, v, Some(bias.clone()), drop);
            x = x + drop.apply(y);
            let y = rms_norm(x.clone(), &block.cross_norm, eps);
            let a = &block.cross;
            let q = self.heads(y.product(a.q.val(), drop.precision), batch, length);
            let (k, v) = self.cross_keys(a, encoded, drop.precision);
            let y = self.attend(a, q, k, v, encoded.hidden.clone(), drop);
            x = x + drop.apply(y);
            let y = block
                .feed
                .forward(rms_norm(x.clone(), &block.feed_norm, eps), drop);
            x = x + drop.apply(y);
        }
        drop.apply(rms_norm(x, &self.decoder.norm, eps))
    }

    fn cross_keys(
        &self,
        a: &Attention,
        encoded: &EncoderOutput,
        precision: ProductPrecision,
    ) -> (Tensor<4>, Tensor<4>) {
        let heads = |w: &Param<Tensor<2>>| {
            self.heads(
                encoded.states.clone().product(w.val(), precision),
                encoded.batch,
                encoded.length,
            )
        };
        (heads(&a.k), heads(&a.v))
    }

    /// Logits of the first `n_rows` vocabulary entries, `[rows, n_rows]`.
    pub fn logits(
        &self,
        states: Tensor<2>,
        n_rows: usize,
        precision: ProductPrecision,
    ) -> Tensor<2> {
        let head = self.head.as_ref().unwrap_or(&self.shared).val();
        let states = if self.config.scales_outputs() {
            // Tied rows have unit variance; without the factor the logits would be far too large.
            states.mul_scalar((self.config.d_model as f64).powf(-0.5))
        } else {
            states
        };
        let head = if n_rows < self.config.vocab_size {
            head.narrow(0, 0, n_rows)
        } else {
            head
        };
        states.product(head.swap_dims(0, 1), precision)
    }

    /// Logits `[batch * target length, vocab_size]` under teacher forcing, for rows without radar features.
    /// Target rows start with the start token.
    pub fn teacher_forced(&self, source: &Rows, target: &Rows, device: &Device) -> Tensor<2> {
        let drop = &mut ForwardPass::inference();
        let batch = SourceBatch::from_rows(source, device);
        let x = self.embed(batch.ids);
        let encoded = self.encode_embedded(x, batch.batch, batch.length, batch.hidden, drop);
        let states = self.decode_all(&encoded, target.tensor(device), target.shape[1], drop);
        self.logits(states, self.config.vocab_size, ProductPrecision::F32)
    }

    /// Prepares step-by-step decoding with a maximum of `max_steps` tokens.
    pub fn start_cache(&self, encoded: &EncoderOutput, max_steps: usize) -> DecoderCache {
        let cross: Vec<_> = self
            .decoder
            .blocks
            .iter()
            .map(|block| self.cross_keys(&block.cross, encoded, ProductPrecision::F32))
            .collect();
        let bias = self.position_bias(&self.decoder.position_bias, max_steps, max_steps, false);
        let own = vec![None; cross.len()];
        DecoderCache {
            own,
            cross,
            hidden: encoded.hidden.clone(),
            bias,
            step: 0,
        }
    }

    /// One decoding step. The input is the last token of every row; the output is `[batch, d_model]`.
    ///
    /// The result equals that of `decode_all` at this position. Must not be called more often than
    /// the `max_steps` of [`Self::start_cache`].
    pub fn step(&self, cache: &mut DecoderCache, ids: &[u32]) -> Tensor<2> {
        let (eps, batch, t) = (self.config.norm_eps, ids.len(), cache.step);
        let drop = &mut ForwardPass::inference();
        let bias = cache.bias.clone().narrow(2, t, 1).narrow(3, 0, t + 1);
        let ids = ids_1d(ids.iter().map(|id| *id as i32).collect(), &bias.device());
        let mut x = self.embed(ids);
        for (i, block) in self.decoder.blocks.iter().enumerate() {
            let y = rms_norm(x.clone(), &block.attention_norm, eps);
            let a = &block.attention;
            let q = self.heads(y.clone().product(a.q.val(), drop.precision), batch, 1);
            let mut k = self.heads(y.clone().product(a.k.val(), drop.precision), batch, 1);
            let mut v = self.heads(y.product(a.v.val(), drop.precision), batch, 1);
            if let Some((old_k, old_v)) = cache.own[i].take() {
                k = Tensor::cat(vec![old_k, k], 2);
                v = Tensor::cat(vec![old_v, v], 2);
            }
            cache.own[i] = Some((k.clone(), v.clone()));
            x = x + self.attend(a, q, k, v, Some(bias.clone()), drop);
            let y = rms_norm(x.clone(), &block.cross_norm, eps);
            let a = &block.cross;
            let q = self.heads(y.product(a.q.val(), drop.precision), batch, 1);
            let (k, v) = cache.cross[i].clone();
            x = x + self.attend(a, q, k, v, cache.hidden.clone(), drop);
            x = x.clone() + block.feed.forward(rms_norm(x, &block.feed_norm, eps), drop);
        }
        cache.step += 1;
        rms_norm(x, &self.decoder.norm, eps)
    }
}

/// The bypass of a new network, if the configuration has one: `[code_dim, width]`.
pub(crate) fn new_bypass(
    config: &LmConfig,
    std: f64,
    seed: u64,
    device: &Device,
) -> Option<Param<Tensor<2>>> {
    config.bypass.then(|| {
        let rng = &mut ChaCha8Rng::seed_from_u64(seed ^ 0x6279_7061_7373);
        normal(rng, [config.code_dim, config.network.width()], std, device)
    })
}

impl RadarT5 {
    /// The device that stores its weights.
    pub fn device(&self) -> Device {
        self.t5.shared.val().device()
    }

    /// A network drawn from `seed`; `t5` is the network of `config`.
    pub fn new(t5: &T5Config, config: &LmConfig, seed: u64, device: &Device) -> Self {
        let t5 = T5::new(t5, seed, device);
        Self {
            t5,
            bypass: Self::new_bypass(config, seed, device),
        }
    }

    /// The bypass of a new network, if the configuration has one.
    pub(crate) fn new_bypass(
        config: &LmConfig,
        seed: u64,
        device: &Device,
    ) -> Option<Param<Tensor<2>>> {
        // Unit variance, like the embedding rows it is added to.
        let std = (config.code_dim as f64).powf(-0.5);
        new_bypass(config, std, seed, device)
    }

    /// Runs the encoder. `training` is passed in training only.
    pub fn encode(
        &self,
        source: &SourceBatch,
        training: Option<&mut TrainingPass>,
    ) -> EncoderOutput {
        let drop = &mut ForwardPass::new(self.t5.config.dropout, training);
        let mut x = self.t5.embed(source.ids.clone());
        if let (Some(bypass), Some((rows, features))) = (&self.bypass, &source.features) {
            let projected = features.clone().product(bypass.val(), drop.precision);
            x = x.select_assign(0, rows.clone(), projected, IndexingUpdateOp::Add);
        }
        self.t5
            .encode_embedded(x, source.batch, source.length, source.hidden.clone(), drop)
    }

    /// Decoder states under teacher forcing.
    ///
    /// `decoder_ids` is `[batch][length]` flattened, each row starting with the start token (0) and
    /// padded at the end. States at padded positions are meaningless. Returns
    /// `[batch * length, d_model]` for [`T5::logits`].
    pub fn forward(
        &self,
        source: &SourceBatch,
        decoder_ids: &[u32],
        length: usize,
        training: Option<&mut TrainingPass>,
    ) -> Tensor<2> {
        let mut training = training;
        let encoded = self.encode(source, training.as_deref_mut());
        self.decode(&encoded, decoder_ids, length, training)
    }

    /// The second half of [`Self::forward`]: decoder states for a given encoder output.
    pub fn decode(
        &self,
        encoded: &EncoderOutput,
        decoder_ids: &[u32],
        length: usize,
        training: Option<&mut TrainingPass>,
    ) -> Tensor<2> {
        let drop = &mut ForwardPass::new(self.t5.config.dropout, training);
        let device = encoded.states.device();
        let ids = ids_1d(decoder_ids.iter().map(|id| *id as i32).collect(), &device);
        self.t5.decode_all(encoded, ids, length, drop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Taken from the first release's code, because training runs start from them.
    #[test]
    fn first_weights_never_change() {
        let values = normal_values(&mut ChaCha8Rng::seed_from_u64(3), 3, 0.7);
        assert_eq!(
            values.iter().map(|v| v.to_bits()).collect::<Vec<_>>(),
            [1062885156, 1056226631, 1057546200]
        );
    }
}
