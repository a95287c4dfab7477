//! Buffers of one caller for the tokenizer: from tubes to cells, from cells to their context, from context to codes.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use super::{Attention, Norm, Products, STEPS_PER_CODE, TUBE_DIM, Tokenizer, TubeClip};
use crate::EngineError;
use crate::matrix::{Quantised, grow, padded};
use crate::pool::Pool;
use crate::rows::{Columns, argmax, attend_columns, average, layer_norm, tube_maximum};

/// Number of rows that pass through a chain of products together. They stay in the second-level cache, and no buffer
/// grows with both the length of the clip and the width of the widest layer.
const CHUNK: usize = 96;

/// The codes and features of a clip.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Codes {
    /// One code per two steps. The last code may cover a single step.
    pub codes: Vec<u32>,
    /// Features before vector quantization, `[code, code_dim]`.
    pub features: Vec<f32>,
}

/// Buffers and threads for running a [`Tokenizer`]. The buffers grow with use and are kept.
pub struct TokenizerSession<'t> {
    tokenizer: &'t Tokenizer,
    pool: Pool,
    /// One scratch buffer per thread.
    scratch: Vec<Mutex<Scratch>>,
}

/// Buffers of one thread. All rows are padded.
struct Scratch {
    tools: Products,
    /// Embeddings of the cells, `[step, anchor, C]`.
    x: Vec<f32>,
    /// Whether each cell has points.
    filled: Vec<bool>,
    /// Queries, keys and values of all cells.
    qkv: Vec<f32>,
    /// Output of attention for all cells; after the last layer, the context of the cells.
    mixed: Vec<f32>,
    /// Buffers for one chunk of rows.
    a: Vec<f32>,
    b: Vec<f32>,
    /// Keys of one head, transposed, with consecutive positions adjacent.
    keys: Vec<f32>,
    scores: Vec<f32>,
    /// For each step: input features, their embedding, the output of the pooling over anchors, the embedding of the
    /// step.
    inputs: Vec<f32>,
    embedded: Vec<f32>,
    pooled: Vec<f32>,
    cells: Vec<f32>,
    steps: Vec<f32>,
    /// Values of each code.
    merged: Vec<f32>,
    features: Vec<f32>,
    distances: Vec<f32>,
}

/// Axis along which cells attend to one another.
#[derive(Clone, Copy)]
enum Axis {
    Anchors,
    Steps,
}

impl Tokenizer {
    /// Creates buffers for running this tokenizer on `threads` threads, including the caller's. Each thread processes
    /// whole clips.
    pub fn session(&self, threads: usize) -> TokenizerSession<'_> {
        let pool = Pool::new(threads.clamp(1, 256));
        let scratch = (0..pool.threads())
            .map(|_| Mutex::new(Scratch::new(self)))
            .collect();
        TokenizerSession {
            tokenizer: self,
            pool,
            scratch,
        }
    }

    /// Checks that a clip fits the network. Errors contain `index`.
    fn check(&self, index: usize, clip: &TubeClip) -> Result<(), EngineError> {
        let s = &self.shape;
        let fail = |problem: String| Err(EngineError::Input { index, problem });
        let n_steps = clip.steps.len();
        if n_steps == 0 || n_steps > s.max_steps {
            return fail(format!("{n_steps} steps, expected 1..={}", s.max_steps));
        }
        let n = clip.anchors.len();
        if n != s.n_anchors && n != n_steps * s.n_anchors {
            let (per_step, steps) = (s.n_anchors, n_steps);
            return fail(format!(
                "{n} anchors, expected {per_step}, or so many in each of {steps} steps"
            ));
        }
        let expected = n_steps * s.profile.unwrap_or(0);
        if s.profile.is_some() && clip.profiles.len() != expected {
            let found = clip.profiles.len();
            return fail(format!("{found} profile values, expected {expected}"));
        }
        for (i, tube) in clip.tubes.iter().enumerate() {
            let place = (tube.step as usize) < n_steps && (tube.anchor as usize) < s.n_anchors;
            if !place || tube.start >= tube.end || tube.end as usize > clip.neighbours.len() {
                return fail(format!("tube {i} is beyond the clip, or empty"));
            }
        }
        Ok(())
    }
}

impl TokenizerSession<'_> {
    /// Encodes every clip; the outputs are in the order of the clips. The content of `out` is replaced, and its buffers
    /// are reused: nothing is allocated if earlier clips left enough room.
    ///
    /// # Errors
    /// If a clip does not fit the network, or the network's output is not finite.
    pub fn encode(&mut self, clips: &[TubeClip], out: &mut Vec<Codes>) -> Result<(), EngineError> {
        let tokenizer = self.tokenizer;
        for (index, clip) in clips.iter().enumerate() {
            tokenizer.check(index, clip)?;
        }
        out.resize_with(clips.len(), Codes::default);
        let next = AtomicUsize::new(0);
        let results = Mutex::new((out, None::<usize>));
        let scratch = &self.scratch;
        let body = |thread: usize| {
            // A scratch buffer is valid at the start of every clip, because each part of it is written before it is
            // read.
            let mut scratch = scratch[thread]
                .lock()
                .unwrap_or_else(PoisonError::into_inner);
            loop {
                let index = next.fetch_add(1, Ordering::Relaxed);
                let Some(clip) = clips.get(index) else { break };
                scratch.embed(tokenizer, clip);
                scratch.context(tokenizer, clip.steps.len());
                scratch.pool(tokenizer, clip);
                let n_codes = clip.steps.len().div_ceil(STEPS_PER_CODE);
                let mut results = results.lock().unwrap_or_else(PoisonError::into_inner);
                let (out, broken) = &mut *results;
                if !scratch.codes(tokenizer, n_codes, &mut out[index]) {
                    *broken = Some(broken.map_or(index, |other: usize| other.min(index)));
                }
            }
        };
        match clips.len() {
            0 => {}
            1 => body(0), // A single clip needs no other thread.
            _ => self.pool.run(&body),
        }
        let (_, broken) = results.into_inner().unwrap_or_else(PoisonError::into_inner);
        match broken {
            Some(index) => Err(EngineError::Output { index }),
            None => Ok(()),
        }
    }
}

impl Scratch {
    fn new(tokenizer: &Tokenizer) -> Self {
        Self {
            tools: Products {
                level: tokenizer.level,
                alone: Pool::new(1),
                quantised: Quantised::default(),
            },
            x: Vec::new(),
            filled: Vec::new(),
            qkv: Vec::new(),
            mixed: Vec::new(),
            a: Vec::new(),
            b: Vec::new(),
            keys: Vec::new(),
            scores: Vec::new(),
            inputs: Vec::new(),
            embedded: Vec::new(),
            pooled: Vec::new(),
            cells: Vec::new(),
            steps: Vec::new(),
            merged: Vec::new(),
            features: Vec::new(),
            distances: Vec::new(),
        }
    }

    /// Embeds tubes, anchors and steps as cells.
    fn embed(&mut self, t: &Tokenizer, clip: &TubeClip) {
        let (n_steps, n_anchors) = (clip.steps.len(), t.shape.n_anchors);
        let (cells, c) = (n_steps * n_anchors, t.empty.len());
        grow(&mut self.x, cells * c, 0.0);
        let widest = t.layers.iter().map(|l| l.widen.width()).max().unwrap_or(0);
        grow(&mut self.a, CHUNK * c.max(widest), 0.0);
        grow(&mut self.b, CHUNK * c.max(widest), 0.0);
        grow(&mut self.filled, cells, false);
        self.filled[..cells].fill(false);
        for x in self.x[..cells * c].chunks_exact_mut(c) {
            x.copy_from_slice(&t.empty);
        }
        for tubes in clip.tubes.chunks(CHUNK) {
            let (a, b) = (
                &mut self.a[..tubes.len() * c],
                &mut self.b[..tubes.len() * c],
            );
            for (tube, out) in tubes.iter().zip(a.chunks_exact_mut(c)) {
                let points = &clip.neighbours[tube.start as usize..tube.end as usize];
                tube_maximum(t.level, points, &t.point_weight, &t.point_bias, out);
            }
            t.tube_mlp.to(&mut self.tools, a, b);
            if let Some(linear) = &t.tube_statistics {
                let statistics = &mut a[..tubes.len() * padded(TUBE_DIM)];
                spread(tubes.iter().map(|tube| &tube.statistics[..]), statistics);
                linear.add_to(&mut self.tools, statistics, b);
            }
            for (tube, b) in tubes.iter().zip(b.chunks_exact(c)) {
                let cell = tube.step as usize * n_anchors + tube.anchor as usize;
                self.filled[cell] = true;
                self.x[cell * c..(cell + 1) * c].copy_from_slice(b);
            }
        }
        let mut first = 0;
        for anchors in clip.anchors.chunks(CHUNK) {
            let n = anchors.len();
            let (a, b) = (&mut self.a[..n * c], &mut self.b[..n * c]);
            let places = &mut b[..n * padded(anchors[0].len())];
            spread(anchors.iter().map(|place| &place[..]), places);
            t.anchor_in.to(&mut self.tools, places, a);
            relu(a);
            t.anchor_out.to(&mut self.tools, a, b);
            for (i, b) in b.chunks_exact(c).enumerate() {
                // The anchors of a template apply to every step, sampled anchors only to their own step.
                let stride = clip.anchors.len();
                for cell in (first + i..cells).step_by(stride) {
                    let x = &mut self.x[cell * c..(cell + 1) * c];
                    x.iter_mut().zip(b).for_each(|(x, b)| *x += b);
                }
            }
            first += n;
        }
        let width = padded(clip.steps[0].len());
        grow(&mut self.inputs, n_steps * width, 0.0);
        grow(&mut self.embedded, n_steps * c, 0.0);
        let (inputs, embedded) = (
            &mut self.inputs[..n_steps * width],
            &mut self.embedded[..n_steps * c],
        );
        spread(clip.steps.iter().map(|step| &step[..]), inputs);
        t.step_in.to(&mut self.tools, inputs, embedded);
        for ((step, time), x) in embedded
            .chunks_exact_mut(c)
            .zip(t.time.chunks_exact(c))
            .zip(self.x.chunks_exact_mut(n_anchors * c))
        {
            step.iter_mut().zip(time).for_each(|(s, t)| *s += t);
            for x in x.chunks_exact_mut(c) {
                x.iter_mut().zip(&*step).for_each(|(x, s)| *x += s);
            }
        }
    }

    /// Runs all layers and the final norm. The resulting context is in `mixed`.
    fn context(&mut self, t: &Tokenizer, n_steps: usize) {
        let (c, inner) = (t.empty.len(), t.shape.inner());
        let cells = n_steps * t.shape.n_anchors;
        grow(&mut self.qkv, cells * 3 * inner, 0.0);
        grow(&mut self.mixed, cells * inner.max(c), 0.0);
        let longest = padded(n_steps.max(t.shape.n_anchors));
        grow(&mut self.keys, padded(t.shape.head()) * longest, 0.0);
        grow(&mut self.scores, longest, 0.0);
        for layer in &t.layers {
            self.attention(t, &layer.space, Axis::Anchors, n_steps);
            self.attention(t, &layer.time, Axis::Steps, n_steps);
            for x in self.x[..cells * c].chunks_mut(CHUNK * c) {
                let rows = x.len() / c;
                let inside = &mut self.b[..rows * layer.widen.width()];
                norm(t, &layer.norm, x, &mut self.a[..rows * c]);
                layer.widen.to(&mut self.tools, &self.a[..rows * c], inside);
                relu(inside);
                layer.narrow.add_to(&mut self.tools, inside, x);
            }
        }
        norm(
            t,
            &t.norm,
            &self.x[..cells * c],
            &mut self.mixed[..cells * c],
        );
    }

    fn attention(&mut self, t: &Tokenizer, attention: &Attention, axis: Axis, n_steps: usize) {
        let (c, inner) = (t.empty.len(), t.shape.inner());
        let (n_anchors, d) = (t.shape.n_anchors, padded(t.shape.head()));
        let cells = n_steps * n_anchors;
        let x = self.x[..cells * c].chunks(CHUNK * c);
        for (x, qkv) in x.zip(self.qkv.chunks_mut(CHUNK * 3 * inner)) {
            let rows = x.len() / c;
            norm(t, &attention.norm, x, &mut self.a[..rows * c]);
            let qkv = &mut qkv[..rows * 3 * inner];
            attention.qkv.to(&mut self.tools, &self.a[..rows * c], qkv);
        }
        // Groups of cells that attend to one another: index of the first cell, number of cells, stride.
        let (n_groups, first, n, stride) = match axis {
            Axis::Anchors => (n_steps, n_anchors, n_anchors, 1),
            Axis::Steps => (n_anchors, 1, n_steps, n_anchors),
        };
        let n_padded = padded(n);
        let qkv = &self.qkv[..cells * 3 * inner];
        for group in 0..n_groups {
            let cell = |i: usize| group * first + i * stride;
            for head in 0..t.shape.n_heads {
                let at = head * d;
                let keys = &mut self.keys[..d * n_padded];
                for i in 0..n {
                    let key = &qkv[cell(i) * 3 * inner + inner + at..][..d];
                    for (j, key) in key.iter().enumerate() {
                        keys[j * n_padded + i] = *key;
                    }
                }
                // Scores of the padding are never used, but they must be initialized.
                for row in keys.chunks_exact_mut(n_padded) {
                    row[n..].fill(0.0);
                }
                let columns = Columns {
                    keys,
                    values: &qkv[cell(0) * 3 * inner + 2 * inner + at..],
                    stride: stride * 3 * inner,
                    n,
                };
                for i in 0..n {
                    let query = &qkv[cell(i) * 3 * inner + at..][..d];
                    let out = &mut self.mixed[cell(i) * inner + at..][..d];
                    attend_columns(t.level, query, columns, None, &mut self.scores, out);
                }
            }
        }
        let mixed = self.mixed[..cells * inner].chunks(CHUNK * inner);
        for (x, mixed) in self.x[..cells * c].chunks_mut(CHUNK * c).zip(mixed) {
            attention.out.add_to(&mut self.tools, mixed, x);
        }
    }

    /// Attention pooling over the anchors that have points (over all anchors if none has), then joining of pairs of
    /// steps. The resulting features are in `features`.
    fn pool(&mut self, t: &Tokenizer, clip: &TubeClip) {
        let (n_steps, n_anchors) = (clip.steps.len(), t.shape.n_anchors);
        let (cells, c) = (n_steps * n_anchors, t.empty.len());
        let queries = t.pool_scores.width();
        let pooled_width = t.shape.pool_queries * c;
        let n_codes = n_steps.div_ceil(STEPS_PER_CODE);
        let width = t.pool_out.width();
        let per_anchor = t
            .per_anchor
            .as_ref()
            .map_or(0, |[narrow, _]| narrow.width());
        grow(&mut self.cells, cells * queries.max(per_anchor), 0.0);
        grow(&mut self.pooled, n_steps * pooled_width.max(width), 0.0);
        grow(&mut self.steps, n_codes * STEPS_PER_CODE * width, 0.0);
        let context = &self.mixed[..cells * c];
        let tools = &mut self.tools;
        let scores = &mut self.cells[..cells * queries];
        t.pool_scores.to(tools, context, scores);
        for (step, pooled) in (0..n_steps).zip(self.pooled.chunks_exact_mut(pooled_width)) {
            let own = step * n_anchors..(step + 1) * n_anchors;
            let filled = &self.filled[own.clone()];
            let none = filled.iter().all(|f| !f);
            let values = &context[own.start * c..own.end * c];
            for (query, pooled) in pooled.chunks_exact_mut(c).enumerate() {
                let row = &mut self.scores[..padded(n_anchors)];
                for ((to, cell), filled) in row.iter_mut().zip(own.clone()).zip(filled) {
                    *to = match *filled || none {
                        true => scores[cell * queries + query],
                        false => f32::NEG_INFINITY,
                    };
                }
                average(t.level, row, n_anchors, values, c, pooled);
            }
        }
        let steps = &mut self.steps[..n_codes * STEPS_PER_CODE * width];
        // If the number of steps is odd, the last one is paired with a step of zeros.
        steps[n_steps * width..].fill(0.0);
        let steps = &mut steps[..n_steps * width];
        t.pool_out
            .to(tools, &self.pooled[..n_steps * pooled_width], steps);
        if let Some([narrow, join]) = &t.per_anchor {
            let cells = &mut self.cells[..cells * per_anchor];
            narrow.to(tools, context, cells);
            relu(cells);
            join.add_to(tools, cells, steps);
        }
        if let (Some([widen, join]), Some(values)) = (&t.pool_profile, t.shape.profile) {
            let inputs = n_steps * padded(values);
            grow(&mut self.embedded, inputs, 0.0);
            let profiles = &mut self.embedded[..inputs];
            spread(clip.profiles.chunks_exact(values), profiles);
            let inside = &mut self.pooled[..n_steps * width];
            widen.to(tools, profiles, inside);
            relu(inside);
            join.add_to(tools, inside, steps);
        }
        let inputs = &self.inputs[..n_steps * padded(clip.steps[0].len())];
        t.pool_step.add_to(tools, inputs, steps);
        relu(steps);
        grow(&mut self.merged, n_codes * t.merge.width(), 0.0);
        grow(&mut self.features, n_codes * t.code_out.width(), 0.0);
        let merged = &mut self.merged[..n_codes * t.merge.width()];
        let pairs = &self.steps[..n_codes * STEPS_PER_CODE * width];
        t.merge.to(tools, pairs, merged);
        relu(merged);
        let features = &mut self.features[..n_codes * t.code_out.width()];
        t.code_out.to(tools, merged, features);
    }

    /// Finds the nearest code of each feature, the first one in a tie. Returns false if a feature is not finite.
    fn codes(&mut self, t: &Tokenizer, n_codes: usize, out: &mut Codes) -> bool {
        let (dim, width) = (t.shape.code_dim, t.code_out.width());
        out.codes.clear();
        out.features.clear();
        let features = &self.features[..n_codes * width];
        for feature in features.chunks_exact(width) {
            out.features.extend_from_slice(&feature[..dim]);
        }
        if !out.features.iter().all(|v| v.is_finite()) {
            return false;
        }
        let n = t.code_offsets.len();
        grow(&mut self.distances, n_codes * n, 0.0);
        let distances = &mut self.distances[..n_codes * n];
        for row in distances.chunks_exact_mut(n) {
            row.copy_from_slice(&t.code_offsets);
        }
        let tools = &mut self.tools;
        t.codes.product(
            t.level,
            &mut tools.alone,
            &mut tools.quantised,
            features,
            n,
            crate::matrix::Then::Add,
            distances,
            n,
        );
        for row in distances.chunks_exact(n) {
            let Some((code, _)) = argmax(t.level, row) else {
                return false;
            };
            out.codes.push(code as u32);
        }
        true
    }
}

fn norm(t: &Tokenizer, norm: &Norm, x: &[f32], out: &mut [f32]) {
    let (width, eps) = (t.shape.width, super::NORM_EPS);
    layer_norm(t.level, x, &norm.gain, &norm.offset, width, eps, out);
}

fn relu(x: &mut [f32]) {
    // NaN is preserved, so that a broken network is detected.
    for x in x {
        *x = if *x < 0.0 { 0.0 } else { *x };
    }
}

/// Copies rows into padded rows.
fn spread<'a>(rows: impl ExactSizeIterator<Item = &'a [f32]>, out: &mut [f32]) {
    let width = out.len() / rows.len();
    for (row, out) in rows.zip(out.chunks_exact_mut(width)) {
        let (values, padding) = out.split_at_mut(row.len());
        values.copy_from_slice(row);
        padding.fill(0.0);
    }
}
