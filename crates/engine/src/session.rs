//! Buffers of one caller for the T5: the encoder, and the decoder step by step.
//!
//! Sequences are not padded to a common length. The rows of the encoder are all tokens of all sources, one source after
//! the other. The height of a product is therefore the total number of tokens, and no work is spent on padding.
//!
//! The decoder never moves keys and values in its cache. A table gives, for every row and every earlier step, the row
//! that holds the keys and values of this step. When sentences end or beams are reordered, only this table changes.
//! Otherwise every step of a beam search would copy all keys and values of all blocks. All beams of a source share the
//! keys and values of its cross-attention.
//!
//! # Results do not depend on the batch
//!
//! The numbers of a row are identical to the bit for all neighbouring rows and all numbers of threads: products sum in
//! one fixed order ([`Matrix::product`]), attention is computed for one query at a time, and threads receive whole rows
//! or whole heads. Tests compare the sentences of a batch with the same sentences decoded alone.
//!
//! # Memory
//!
//! Buffers grow in [`Session::start`] and are kept, so that a step does not allocate. Buffers with different purposes
//! are separate fields, so that a step can borrow some for reading while threads write to others.

use crate::matrix::{Matrix, Quantised, Then, grow, padded};
use crate::network::{Block, Engine};
use crate::pool::{Pool, SharedBuffer};
use crate::rows::{
    Columns, History, attend_columns, attend_history, gated_gelu, log_softmax, rms_norm,
};
use crate::{EngineError, Precision};

/// Maximum length of the encoder input, in tokens.
pub const MAX_SOURCE: usize = 2048;
/// Maximum number of decoding steps.
pub const MAX_STEPS: usize = 512;

/// An input of the encoder.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Source {
    /// Token ids.
    pub ids: Vec<u32>,
    /// Positions in `ids` that carry a radar feature, in increasing order.
    pub feature_positions: Vec<u32>,
    /// `[feature_positions.len(), code_dim]`.
    pub features: Vec<f32>,
}

/// Position of a source's rows in the shared buffers.
#[derive(Clone, Copy, Default)]
struct Span {
    /// Index of the first row among all tokens.
    start: usize,
    /// Number of tokens.
    len: usize,
    /// Index of the first position among the positions of all sources, each source padded to 16. Keys are stored with
    /// consecutive positions adjacent, and a vector of scores must not reach into the next source.
    column: usize,
}

/// Buffers and threads for running an [`Engine`]. The buffers grow with use and are kept.
pub struct Session<'e> {
    engine: &'e Engine,
    pool: Pool,
    quantised: Quantised,
    spans: Vec<Span>,
    /// For each row in decoding: the index of its source.
    sources: Vec<usize>,
    /// `[rows][MAX_STEPS]`: for each step, the row that holds it for this row's sentence. Rows have a fixed length, so
    /// that one can be replaced without moving the others.
    table: Vec<u32>,
    /// The table before reordering. New rows are copied from it, because several new rows may continue the same old
    /// row.
    old_table: Vec<u32>,
    old_sources: Vec<usize>,
    step: usize,
    /// Numbers of rows and steps that the caches have room for.
    room: (usize, usize),
    /// Residual stream, `[rows, d_model]`.
    x: Vec<f32>,
    /// Output of a norm, `[rows, d_model]`.
    normed: Vec<f32>,
    /// Queries, keys and values side by side, or the inner layer of the feed-forward network, `[rows, widest]`.
    wide: Vec<f32>,
    /// Output of the gate, `[rows, d_ff]`, or of attention, `[rows, inner]`.
    mixed: Vec<f32>,
    /// One row of scores per thread.
    scores: Vec<f32>,
    logits: Vec<f32>,
    /// One entry per decoder block.
    caches: Vec<Cache>,
}

#[derive(Default)]
struct Cache {
    /// Keys of the decoder's self-attention, `[step, row, inner]`. A step appends without moving earlier ones.
    keys: Vec<f32>,
    values: Vec<f32>,
    /// Keys of the encoder's output, `[inner, positions]` for each source. They are transposed once, so that the scores
    /// of a query for sixteen positions are one vector.
    cross_keys: Vec<f32>,
    /// Values of the encoder's output, `[token, inner]`.
    cross_values: Vec<f32>,
}

impl Engine {
    /// Creates buffers for running this engine on `threads` threads, including the caller's. The other threads sleep
    /// while nothing is decoded.
    pub fn session(&self, threads: usize) -> Session<'_> {
        let caches = self.decoder.blocks.iter().map(|_| Cache::default());
        Session {
            engine: self,
            pool: Pool::new(threads.clamp(1, 256)),
            quantised: Quantised::default(),
            spans: Vec::new(),
            sources: Vec::new(),
            table: Vec::new(),
            old_table: Vec::new(),
            old_sources: Vec::new(),
            step: 0,
            room: (0, 0),
            x: Vec::new(),
            normed: Vec::new(),
            wide: Vec::new(),
            mixed: Vec::new(),
            scores: Vec::new(),
            logits: Vec::new(),
            caches: caches.collect(),
        }
    }

    /// Checks that an input fits the network. Errors contain `index`.
    pub(crate) fn check(&self, index: usize, source: &Source) -> Result<(), EngineError> {
        let fail = |problem: String| Err(EngineError::Input { index, problem });
        let (n, vocab) = (source.ids.len(), self.shape.vocab_size);
        if n == 0 || n > MAX_SOURCE {
            return fail(format!("{n} tokens, expected 1..={MAX_SOURCE}"));
        }
        if let Some(id) = source.ids.iter().find(|id| **id as usize >= vocab) {
            return fail(format!("id {id} is beyond the vocabulary of {vocab}"));
        }
        // Without the bypass, features are not used.
        let Some(code_dim) = self.shape.bypass else {
            return Ok(());
        };
        if source.feature_positions.iter().any(|p| *p as usize >= n) {
            return fail("a feature's position is beyond the tokens".into());
        }
        // At most n positions are meaningful. The check also keeps the product below in range.
        if source.feature_positions.len() > n
            || source.features.len() != source.feature_positions.len() * code_dim
        {
            let (found, positions) = (source.features.len(), source.feature_positions.len());
            return fail(format!(
                "{found} feature values for {positions} positions of width {code_dim}, {n} tokens"
            ));
        }
        if source.features.iter().any(|v| !v.is_finite()) {
            return fail("a feature is not finite".into());
        }
        Ok(())
    }
}

impl<'e> Session<'e> {
    /// The engine.
    pub fn engine(&self) -> &'e Engine {
        self.engine
    }

    /// Number of rows in decoding.
    pub fn n_rows(&self) -> usize {
        self.sources.len()
    }

    /// Runs the encoder over `sources` and prepares `beams` rows for each, with the rows of one source side by side,
    /// for at most `steps` steps.
    ///
    /// # Errors
    /// If a source does not fit the network, or `beams * sources.len()` or `steps` are out of range.
    pub fn start(
        &mut self,
        sources: &[&Source],
        beams: usize,
        steps: usize,
    ) -> Result<(), EngineError> {
        const MAX_ROWS: usize = 1 << 16;
        let rows = sources.len().saturating_mul(beams);
        for (field, value, max) in [("rows", rows, MAX_ROWS), ("steps", steps, MAX_STEPS)] {
            if value == 0 || value > max {
                let problem = format!("must be in 1..={max}, found {value}");
                return Err(EngineError::Option { field, problem });
            }
        }
        // All sources are checked before any buffer grows.
        self.spans.clear();
        let (mut start, mut column) = (0, 0);
        for (index, source) in sources.iter().enumerate() {
            self.engine.check(index, source)?;
            let len = source.ids.len();
            self.spans.push(Span { start, len, column });
            start += len;
            column += padded(len);
        }
        self.reserve(start, column, rows, steps);
        self.embed_sources(sources);
        self.encode(start);
        self.cross_caches(start);
        self.sources.extend((0..rows).map(|row| row / beams));
        self.step = 0;
        Ok(())
    }

    /// Grows the buffers, so that steps do not allocate.
    fn reserve(&mut self, tokens: usize, columns: usize, rows: usize, steps: usize) {
        let w = self.engine.shape.widths();
        // The encoder's tokens and the decoder's rows use the same buffers, one after the other.
        let all = tokens.max(rows);
        let feed = if self.engine.shape.gated {
            2 * w.d_ff
        } else {
            w.d_ff
        };
        let feature = padded(self.engine.shape.bypass.unwrap_or(0));
        grow(&mut self.x, all * w.d_model, 0.0);
        grow(&mut self.normed, all * w.d_model.max(feature), 0.0);
        grow(
            &mut self.wide,
            all * feed.max(3 * w.inner).max(w.d_model),
            0.0,
        );
        grow(&mut self.mixed, all * w.d_ff.max(w.inner), 0.0);
        // The maximum row length, rather than that of this input: 8 KiB per thread.
        let longest = padded(MAX_SOURCE.max(MAX_STEPS));
        grow(&mut self.scores, self.pool.threads() * longest, 0.0);
        grow(
            &mut self.logits,
            rows * padded(self.engine.shape.vocab_size),
            0.0,
        );
        if self.engine.precision() == Precision::Int8 {
            let k = w.d_model.max(w.inner).max(w.d_ff);
            self.quantised.reserve(all, k);
        }
        grow(&mut self.table, rows * MAX_STEPS, 0);
        grow(&mut self.old_table, rows * MAX_STEPS, 0);
        for sources in [&mut self.sources, &mut self.old_sources] {
            sources.clear();
            sources.reserve(rows);
        }
        self.room = (rows, steps);
        for cache in &mut self.caches {
            grow(&mut cache.keys, steps * rows * w.inner, 0.0);
            grow(&mut cache.values, steps * rows * w.inner, 0.0);
            grow(&mut cache.cross_keys, columns * w.inner, 0.0);
            grow(&mut cache.cross_values, tokens * w.inner, 0.0);
        }
    }

    /// Embeds all tokens and adds the projected radar features. The features are scaled to unit mean square, so that
    /// the bypass does not depend on the scale of the radar tokenizer.
    fn embed_sources(&mut self, sources: &[&Source]) {
        let engine = self.engine;
        let d = engine.shape.widths().d_model;
        for (span, source) in self.spans.iter().zip(sources) {
            for (i, id) in source.ids.iter().enumerate() {
                embed(
                    engine,
                    *id,
                    &mut self.x[(span.start + i) * d..(span.start + i + 1) * d],
                );
            }
        }
        let (Some(bypass), Some(code_dim)) = (&engine.bypass, engine.shape.bypass) else {
            return;
        };
        let width = padded(code_dim);
        for (span, source) in self.spans.iter().zip(sources) {
            let n = source.feature_positions.len();
            let scaled = &mut self.normed[..n * width];
            for (feature, scaled) in source
                .features
                .chunks_exact(code_dim)
                .zip(scaled.chunks_exact_mut(width))
            {
                let power = feature.iter().map(|v| v * v).sum::<f32>() / code_dim as f32;
                let scale = (power + 1e-6).sqrt().recip();
                scaled.fill(0.0);
                for (to, from) in scaled.iter_mut().zip(feature) {
                    *to = from * scale;
                }
            }
            let projected = &mut self.wide[..n * d];
            bypass.product(
                engine.level,
                &mut self.pool,
                &mut self.quantised,
                &self.normed[..n * width],
                engine.shape.d_model,
                Then::Store,
                projected,
                d,
            );
            for (position, row) in source
                .feature_positions
                .iter()
                .zip(projected.chunks_exact(d))
            {
                let at = (span.start + *position as usize) * d;
                for (x, p) in self.x[at..at + d].iter_mut().zip(row) {
                    *x += p;
                }
            }
        }
    }

    /// Runs the encoder in place. Its output, after the final norm, is in `normed`.
    fn encode(&mut self, tokens: usize) {
        let engine = self.engine;
        let (s, w) = (&engine.shape, engine.shape.widths());
        for block in &engine.encoder.blocks {
            self.norm(&block.norm, tokens);
            self.product(
                &block.qkv,
                Route::NormedToWide,
                tokens,
                w.d_model,
                Then::Store,
            );
            // Keys are transposed, with consecutive positions adjacent, as the scores require. The decoder's buffer for
            // them is unused until the encoder has finished.
            let scratch = &mut self.caches[0].cross_keys;
            transpose_keys(
                &self.spans,
                &self.wide,
                3 * w.inner,
                w.inner,
                w.inner,
                scratch,
            );
            let (spans, wide, keys) = (&self.spans, &self.wide, &self.caches[0].cross_keys);
            let mixed = SharedBuffer::new(&mut self.mixed);
            let n_items = self.spans.len() * s.n_heads;
            let work: usize = spans.iter().map(|s| s.len * s.len * w.inner).sum();
            // An item is one head of one source, so that its keys stay in the cache for all queries of the source. Its
            // outputs are `inner` values apart, so that no contiguous range of the output belongs to one item.
            let no_out = &mut [];
            self.pool.split_buffers(
                n_items,
                work,
                &mut self.scores,
                no_out,
                &|items, scores, _| {
                    for item in items {
                        let (span, head) = (spans[item / s.n_heads], item % s.n_heads);
                        let at = head * w.d_kv;
                        let n_padded = padded(span.len);
                        let key = span.column * w.inner + at * n_padded;
                        let value = span.start * 3 * w.inner + 2 * w.inner + at;
                        let columns = Columns {
                            keys: &keys[key..key + w.d_kv * n_padded],
                            values: &wide[value..],
                            stride: 3 * w.inner,
                            n: span.len,
                        };
                        for i in 0..span.len {
                            let row = span.start + i;
                            let query = &wide[row * 3 * w.inner + at..][..w.d_kv];
                            let bias = engine.encoder.bias(head, i);
                            // SAFETY: a piece is one head of one row. Sources share no rows and every item occurs once,
                            // so that no other thread takes this piece. This thread drops it before it takes the next
                            // one.
                            let out = unsafe { mixed.piece(row * w.inner + at, w.d_kv) };
                            attend_columns(engine.level, query, columns, Some(bias), scores, out);
                        }
                    }
                },
            );
            self.product(&block.o, Route::MixedToResidual, tokens, w.inner, Then::Add);
            self.feed_forward(block, tokens);
        }
        self.norm(&engine.encoder.norm, tokens);
    }

    /// Computes the cross-attention keys and values from the encoder's output, once for all steps.
    fn cross_caches(&mut self, tokens: usize) {
        let engine = self.engine;
        let w = engine.shape.widths();
        for (i, block) in engine.decoder.blocks.iter().enumerate() {
            let Some(cross) = &block.cross else { continue };
            self.product(
                &cross.kv,
                Route::NormedToWide,
                tokens,
                w.d_model,
                Then::Store,
            );
            let cache = &mut self.caches[i];
            let wide = &self.wide;
            transpose_keys(
                &self.spans,
                wide,
                2 * w.inner,
                0,
                w.inner,
                &mut cache.cross_keys,
            );
            let values = cache.cross_values.chunks_exact_mut(w.inner);
            for (to, from) in values.zip(wide[..tokens * 2 * w.inner].chunks_exact(2 * w.inner)) {
                to.copy_from_slice(&from[w.inner..]);
            }
        }
    }

    /// Runs one decoding step. The input is the last token of every row. The output is `[n_rows(), stride]`, the
    /// log-probabilities of the next token among those of the first `mask.len()` ids whose mask is 0. The stride is
    /// `mask.len()`, which must be a multiple of 16.
    ///
    /// Does not allocate.
    ///
    /// # Panics
    /// If called for more steps than [`Self::start`] reserved, with a number of ids that differs from the number of
    /// rows, with an id beyond the vocabulary, or with a mask longer than the vocabulary (rounded up to 16).
    pub fn log_probs(&mut self, last: &[u32], mask: &[f32]) -> &[f32] {
        let n = mask.len();
        self.step(last);
        self.output_rows(n);
        let rows = self.n_rows();
        let level = self.engine.level;
        let logits = &mut self.logits[..rows * n];
        self.pool
            .split_buffers(rows, rows * n * 16, &mut [], logits, &|_, _, logits| {
                for row in logits.chunks_exact_mut(n) {
                    log_softmax(level, row, mask);
                }
            });
        &self.logits[..rows * n]
    }

    /// Runs one decoding step and returns the logits `[n_rows(), n]` of the first `n` ids, rounded up to 16.
    ///
    /// # Panics
    /// Those of [`Self::log_probs`].
    pub fn logits(&mut self, last: &[u32], n: usize) -> &[f32] {
        let n = padded(n);
        self.step(last);
        self.output_rows(n);
        &self.logits[..self.n_rows() * n]
    }

    /// Computes the `logits` of the first `n` ids from `normed`.
    fn output_rows(&mut self, n: usize) {
        let engine = self.engine;
        let w = engine.shape.widths();
        let rows = self.n_rows();
        assert!(n.is_multiple_of(16) && n <= padded(engine.shape.vocab_size));
        let x = &mut self.normed[..rows * w.d_model];
        if engine.shape.scaled {
            // The rows of tied embeddings have unit variance. Without the factor the logits would be far too large.
            let factor = (engine.shape.d_model as f64).powf(-0.5) as f32;
            x.iter_mut().for_each(|x| *x *= factor);
        }
        let (pool, scratch) = (&mut self.pool, &mut self.quantised);
        let out = &mut self.logits[..rows * n];
        engine
            .head
            .product(engine.level, pool, scratch, x, n, Then::Store, out, n);
    }

    /// Runs the decoder for one token per row. Its output, after the final norm, is in `normed`.
    fn step(&mut self, last: &[u32]) {
        let engine = self.engine;
        let (s, w) = (&engine.shape, engine.shape.widths());
        let (rows, step) = (self.n_rows(), self.step);
        assert!(last.len() == rows && step < self.room.1 && rows <= self.room.0);
        for (id, x) in last.iter().zip(self.x.chunks_exact_mut(w.d_model)) {
            embed(engine, *id, x);
        }
        // Keys and values of this step are written at the rows' own indices. `keep` may later assign them to other
        // rows.
        for row in 0..rows {
            self.table[row * MAX_STEPS + step] = row as u32;
        }
        // The stride of the caches is the number of rows reserved at the start. `rows` shrinks when sentences end.
        let one_step = self.room.0 * w.inner;
        for (i, block) in engine.decoder.blocks.iter().enumerate() {
            self.norm(&block.norm, rows);
            self.product(
                &block.qkv,
                Route::NormedToWide,
                rows,
                w.d_model,
                Then::Store,
            );
            let cache = &mut self.caches[i];
            for (row, qkv) in self.wide[..rows * 3 * w.inner]
                .chunks_exact(3 * w.inner)
                .enumerate()
            {
                let at = step * one_step + row * w.inner;
                cache.keys[at..at + w.inner].copy_from_slice(&qkv[w.inner..2 * w.inner]);
                cache.values[at..at + w.inner].copy_from_slice(&qkv[2 * w.inner..]);
            }
            let (cache, wide, table) = (&self.caches[i], &self.wide, &self.table);
            // An item is one head of one row, which corresponds to `d_kv` consecutive values of the output.
            let (n_items, out) = (rows * s.n_heads, &mut self.mixed[..rows * w.inner]);
            let work = rows * (step + 1) * w.inner * 2;
            self.pool.split_buffers(
                n_items,
                work,
                &mut self.scores,
                out,
                &|items, scores, out| {
                    for (item, out) in items.zip(out.chunks_exact_mut(w.d_kv)) {
                        let (row, head) = (item / s.n_heads, item % s.n_heads);
                        let at = head * w.d_kv;
                        let history = History {
                            keys: &cache.keys,
                            values: &cache.values,
                            step: one_step,
                            row: w.inner,
                            rows: &table[row * MAX_STEPS..row * MAX_STEPS + step + 1],
                            head: at,
                        };
                        let query = &wide[row * 3 * w.inner + at..][..w.d_kv];
                        let bias = engine.decoder.bias(head, step);
                        attend_history(engine.level, query, history, bias, scores, out);
                    }
                },
            );
            self.product(&block.o, Route::MixedToResidual, rows, w.inner, Then::Add);
            if let Some(cross) = &block.cross {
                self.norm(&cross.norm, rows);
                self.product(&cross.q, Route::NormedToWide, rows, w.d_model, Then::Store);
                self.attend_sources(i);
                self.product(&cross.o, Route::MixedToResidual, rows, w.inner, Then::Add);
            }
            self.feed_forward(block, rows);
        }
        self.norm(&engine.decoder.norm, rows);
        self.step += 1;
    }

    /// Cross-attention of every row to its source.
    fn attend_sources(&mut self, block: usize) {
        let engine = self.engine;
        let (s, w) = (&engine.shape, engine.shape.widths());
        let (cache, wide) = (&self.caches[block], &self.wide);
        let (spans, sources) = (&self.spans, &self.sources);
        let (n_items, out) = (
            sources.len() * s.n_heads,
            &mut self.mixed[..sources.len() * w.inner],
        );
        let work: usize = sources.iter().map(|i| spans[*i].len * w.inner * 2).sum();
        self.pool.split_buffers(
            n_items,
            work,
            &mut self.scores,
            out,
            &|items, scores, out| {
                for (item, out) in items.zip(out.chunks_exact_mut(w.d_kv)) {
                    let (row, head) = (item / s.n_heads, item % s.n_heads);
                    let span = spans[sources[row]];
                    let at = head * w.d_kv;
                    let n_padded = padded(span.len);
                    let key = span.column * w.inner + at * n_padded;
                    let columns = Columns {
                        keys: &cache.cross_keys[key..key + w.d_kv * n_padded],
                        values: &cache.cross_values[span.start * w.inner + at..],
                        stride: w.inner,
                        n: span.len,
                    };
                    let query = &wide[row * w.inner + at..][..w.d_kv];
                    attend_columns(engine.level, query, columns, None, scores, out);
                }
            },
        );
    }

    /// Continues with the given rows, in this order. Rows may repeat, and there may be fewer than before.
    ///
    /// Copies only rows of the table, at most 2 KiB each. Keys and values are not moved.
    ///
    /// Does not allocate.
    ///
    /// # Panics
    /// If there are more rows than [`Self::start`] reserved, or one is out of range.
    pub fn keep(&mut self, rows: &[usize]) {
        assert!(rows.len() <= self.room.0);
        std::mem::swap(&mut self.table, &mut self.old_table);
        std::mem::swap(&mut self.sources, &mut self.old_sources);
        self.sources.clear();
        for (to, from) in rows.iter().enumerate() {
            self.sources.push(self.old_sources[*from]);
            let old = &self.old_table[from * MAX_STEPS..from * MAX_STEPS + self.step];
            self.table[to * MAX_STEPS..to * MAX_STEPS + self.step].copy_from_slice(old);
        }
    }

    fn norm(&mut self, gain: &[f32], rows: usize) {
        let shape = &self.engine.shape;
        let n = rows * gain.len();
        let (x, out) = (&self.x[..n], &mut self.normed[..n]);
        rms_norm(
            self.engine.level,
            x,
            gain,
            shape.d_model,
            shape.norm_eps,
            out,
        );
    }

    fn product(&mut self, matrix: &Matrix, route: Route, rows: usize, k: usize, then: Then) {
        let (x, out) = match route {
            Route::NormedToWide => (&self.normed, &mut self.wide),
            Route::MixedToResidual => (&self.mixed, &mut self.x),
            Route::WideToResidual => (&self.wide, &mut self.x),
        };
        let n = matrix.width();
        let (pool, scratch) = (&mut self.pool, &mut self.quantised);
        let x = &x[..rows * k];
        matrix.product(
            self.engine.level,
            pool,
            scratch,
            x,
            n,
            then,
            &mut out[..rows * n],
            n,
        );
    }

    fn feed_forward(&mut self, block: &Block, rows: usize) {
        let engine = self.engine;
        let w = engine.shape.widths();
        self.norm(&block.feed_norm, rows);
        if engine.shape.gated {
            self.product(&block.wi, Route::NormedToWide, rows, w.d_model, Then::Store);
            let (wide, out) = (&self.wide, &mut self.mixed[..rows * w.d_ff]);
            self.pool
                .split_buffers(rows, rows * w.d_ff * 16, &mut [], out, &|rows, _, out| {
                    let x = &wide[rows.start * 2 * w.d_ff..rows.end * 2 * w.d_ff];
                    gated_gelu(engine.level, x, w.d_ff, out);
                });
        } else {
            self.product(&block.wi, Route::NormedToWide, rows, w.d_model, Then::Relu);
        }
        let route = if engine.shape.gated {
            Route::MixedToResidual
        } else {
            Route::WideToResidual
        };
        self.product(&block.wo, route, rows, w.d_ff, Then::Add);
    }
}

/// The buffers that a product reads and writes.
#[derive(Clone, Copy)]
enum Route {
    NormedToWide,
    MixedToResidual,
    WideToResidual,
}

fn embed(engine: &Engine, id: u32, x: &mut [f32]) {
    let d = engine.shape.d_model;
    let id = id as usize;
    x[..d].copy_from_slice(&engine.embedding[id * d..(id + 1) * d]);
    x[d..].fill(0.0);
}

/// Transposes keys to `[inner, positions]` for each source, with the positions padded to 16. The keys are the `inner`
/// values from `first` on of every row; rows are `stride` values apart.
fn transpose_keys(
    spans: &[Span],
    rows: &[f32],
    stride: usize,
    first: usize,
    inner: usize,
    out: &mut [f32],
) {
    for span in spans {
        let n_padded = padded(span.len);
        let out = &mut out[span.column * inner..(span.column + n_padded) * inner];
        for (d, out) in out.chunks_exact_mut(n_padded).enumerate() {
            for (i, out) in out[..span.len].iter_mut().enumerate() {
                *out = rows[(span.start + i) * stride + first + d];
            }
            // Scores of the padding are overwritten before the softmax, but they must not contain a NaN from an earlier
            // use.
            out[span.len..].fill(0.0);
        }
    }
}
