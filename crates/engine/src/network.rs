//! The packed weights of the T5, shared by all sessions.

use crate::EngineError;
use crate::matrix::{Matrix, padded};
use crate::position::relative_bucket;
use crate::session::{MAX_SOURCE, MAX_STEPS};
use crate::weights::{NamedTensors, Shape, Taker};
use radarllm_simd::SimdLevel;

/// Number format of matrix products.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// f32, as in training.
    F32,
    /// Int8: weights are bytes with one scale per column, activations are bytes with one scale per row. Norms,
    /// attention and softmax remain in f32.
    Int8,
}

/// A T5 encoder-decoder with packed weights.
pub struct Engine {
    pub(crate) shape: Shape,
    pub(crate) level: SimdLevel,
    precision: Precision,
    /// `[vocab_size, d_model]`, not padded.
    pub(crate) embedding: Vec<f32>,
    pub(crate) encoder: Stack,
    pub(crate) decoder: Stack,
    /// `[d_model, vocab_size]`.
    pub(crate) head: Matrix,
    /// `[code_dim, d_model]`, always f32.
    pub(crate) bypass: Option<Matrix>,
}

pub(crate) struct Stack {
    pub blocks: Vec<Block>,
    pub norm: Vec<f32>,
    /// For each head: the bias of key - query = `-first`, `-first + 1`, ...
    bias: Vec<Vec<f32>>,
    first: usize,
}

pub(crate) struct Block {
    pub norm: Vec<f32>,
    /// Query, key and value projections side by side, `[d_model, 3 inner]`.
    pub qkv: Matrix,
    pub o: Matrix,
    /// Cross-attention to the encoder's output; `None` in the encoder.
    pub cross: Option<Cross>,
    pub feed_norm: Vec<f32>,
    /// `[d_model, d_ff]`, with the gate's weights beside it if the network is gated.
    pub wi: Matrix,
    pub wo: Matrix,
}

pub(crate) struct Cross {
    pub norm: Vec<f32>,
    pub q: Matrix,
    /// Key and value projections side by side, `[d_model, 2 inner]`.
    pub kv: Matrix,
    pub o: Matrix,
}

impl Stack {
    /// Bias of `head` for a query at `position` and the keys 0, 1, ...
    pub(crate) fn bias(&self, head: usize, position: usize) -> &[f32] {
        &self.bias[head][self.first - position..]
    }
}

/// Widths after padding to whole vectors.
#[derive(Clone, Copy)]
pub(crate) struct Widths {
    pub d_model: usize,
    pub d_kv: usize,
    pub inner: usize,
    pub d_ff: usize,
}

impl Shape {
    pub(crate) fn widths(&self) -> Widths {
        let d_kv = padded(self.d_kv);
        Widths {
            d_model: padded(self.d_model),
            d_kv,
            inner: self.n_heads * d_kv,
            d_ff: padded(self.d_ff),
        }
    }
}

struct Loader<'a> {
    shape: &'a Shape,
    precision: Precision,
    weights: Taker,
}

impl Loader<'_> {
    fn gain(&mut self, name: &str) -> Result<Vec<f32>, EngineError> {
        let mut gain = self.weights.take(name, &[self.shape.d_model])?;
        gain.resize(padded(self.shape.d_model), 0.0);
        Ok(gain)
    }

    /// `[d_model, inner]` matrices side by side, with each head padded.
    fn heads(&mut self, prefix: &str, names: &[&str]) -> Result<Matrix, EngineError> {
        let (s, w) = (self.shape, self.shape.widths());
        let inner = s.inner();
        let parts = names
            .iter()
            .map(|name| {
                self.weights
                    .take(&format!("{prefix}.{name}"), &[s.d_model, inner])
            })
            .collect::<Result<Vec<_>, _>>()?;
        let columns = names.len() * w.inner;
        Ok(Matrix::pack(
            s.d_model,
            columns,
            self.precision,
            |row, column| {
                let (part, column) = (column / w.inner, column % w.inner);
                let (head, at) = (column / w.d_kv, column % w.d_kv);
                if at < s.d_kv {
                    parts[part][row * inner + head * s.d_kv + at]
                } else {
                    0.0
                }
            },
        ))
    }

    /// `[inner, d_model]`, with each head padded.
    fn mixer(&mut self, name: &str) -> Result<Matrix, EngineError> {
        let (s, w) = (self.shape, self.shape.widths());
        let o = self.weights.take(name, &[s.inner(), s.d_model])?;
        Ok(Matrix::pack(
            w.inner,
            s.d_model,
            self.precision,
            |row, column| {
                let (head, at) = (row / w.d_kv, row % w.d_kv);
                if at < s.d_kv {
                    o[(head * s.d_kv + at) * s.d_model + column]
                } else {
                    0.0
                }
            },
        ))
    }

    fn block(&mut self, prefix: &str, is_decoder: bool) -> Result<Block, EngineError> {
        let (s, w) = (self.shape, self.shape.widths());
        let cross = if is_decoder {
            Some(Cross {
                norm: self.gain(&format!("{prefix}.cross_norm"))?,
                q: self.heads(&format!("{prefix}.cross"), &["q"])?,
                kv: self.heads(&format!("{prefix}.cross"), &["k", "v"])?,
                o: self.mixer(&format!("{prefix}.cross.o"))?,
            })
        } else {
            None
        };
        let wi = {
            let mut names = vec!["wi"];
            if s.gated {
                names.push("gate");
            }
            let parts = names
                .iter()
                .map(|n| {
                    self.weights
                        .take(&format!("{prefix}.feed.{n}"), &[s.d_model, s.d_ff])
                })
                .collect::<Result<Vec<_>, _>>()?;
            let columns = parts.len() * w.d_ff;
            Matrix::pack(s.d_model, columns, self.precision, |row, column| {
                let (part, at) = (column / w.d_ff, column % w.d_ff);
                if at < s.d_ff {
                    parts[part][row * s.d_ff + at]
                } else {
                    0.0
                }
            })
        };
        let wo = self
            .weights
            .take(&format!("{prefix}.feed.wo"), &[s.d_ff, s.d_model])?;
        Ok(Block {
            norm: self.gain(&format!("{prefix}.attention_norm"))?,
            qkv: self.heads(&format!("{prefix}.attention"), &["q", "k", "v"])?,
            o: self.mixer(&format!("{prefix}.attention.o"))?,
            cross,
            feed_norm: self.gain(&format!("{prefix}.feed_norm"))?,
            wi,
            wo: Matrix::pack(s.d_ff, s.d_model, self.precision, |row, column| {
                wo[row * s.d_model + column]
            }),
        })
    }

    fn stack(&mut self, name: &str, is_decoder: bool) -> Result<Stack, EngineError> {
        let s = self.shape;
        // Relative positions from -first to the last one.
        let (first, last, n_layers) = if is_decoder {
            (MAX_STEPS - 1, 0, s.n_decoder_layers)
        } else {
            (MAX_SOURCE - 1, MAX_SOURCE - 1, s.n_encoder_layers)
        };
        let weights = self.weights.take(
            &format!("t5.{name}.position_bias"),
            &[s.relative_buckets, s.n_heads],
        )?;
        let buckets: Vec<usize> = (-(first as i64)..=last as i64)
            .map(|relative| {
                let (buckets, far) = (s.relative_buckets, s.relative_max_distance);
                relative_bucket(relative, !is_decoder, buckets, far)
            })
            .collect();
        let bias = (0..s.n_heads)
            .map(|head| {
                buckets
                    .iter()
                    .map(|b| weights[b * s.n_heads + head])
                    .collect()
            })
            .collect();
        Ok(Stack {
            blocks: (0..n_layers)
                .map(|i| self.block(&format!("t5.{name}.blocks.{i}"), is_decoder))
                .collect::<Result<_, _>>()?,
            norm: self.gain(&format!("t5.{name}.norm"))?,
            bias,
            first,
        })
    }
}

impl Engine {
    /// Packs the weights of a language model's checkpoint for the best instruction set of this machine.
    ///
    /// Names are those of the checkpoint's `model.safetensors`: `t5.shared`, `t5.encoder.blocks.0.attention.q` (`[in,
    /// out]`), ..., `bypass`.
    ///
    /// # Errors
    /// If the shape is invalid, or a weight is missing, unknown, not finite or of another shape.
    pub fn new(
        shape: Shape,
        precision: Precision,
        weights: NamedTensors,
    ) -> Result<Self, EngineError> {
        Self::with_level(shape, precision, weights, SimdLevel::detect())
    }

    /// Like [`Self::new`], with the given instruction set.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_level(
        shape: Shape,
        precision: Precision,
        weights: NamedTensors,
        level: SimdLevel,
    ) -> Result<Self, EngineError> {
        shape.validate()?;
        let mut loader = Loader {
            shape: &shape,
            precision,
            weights: Taker(weights),
        };
        let (d, rows) = (shape.d_model, shape.vocab_size);
        let embedding = loader.weights.take("t5.shared", &[rows, d])?;
        let untied = if shape.tied {
            None
        } else {
            Some(loader.weights.take("t5.head", &[rows, d])?)
        };
        let output = untied.as_ref().unwrap_or(&embedding);
        let head = Matrix::pack(d, rows, precision, |k, n| output[n * d + k]);
        drop(untied);
        let bypass = match shape.bypass {
            None => None,
            Some(code_dim) => {
                let w = loader.weights.take("bypass", &[code_dim, d])?;
                let value = |k: usize, n: usize| w[k * d + n];
                Some(Matrix::pack(code_dim, d, Precision::F32, value))
            }
        };
        let encoder = loader.stack("encoder", false)?;
        let decoder = loader.stack("decoder", true)?;
        loader.weights.finish()?;
        Ok(Self {
            level,
            precision,
            embedding,
            encoder,
            decoder,
            head,
            bypass,
            shape,
        })
    }

    /// Shape of the network.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Number format of matrix products.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// Instruction set in use.
    pub fn level(&self) -> SimdLevel {
        self.level
    }

    /// Size of the packed weights and the embedding in bytes.
    pub fn bytes(&self) -> usize {
        let blocks = self.encoder.blocks.iter().chain(&self.decoder.blocks);
        let block = |b: &Block| {
            let cross = b.cross.as_ref();
            [&b.qkv, &b.o, &b.wi, &b.wo]
                .into_iter()
                .chain(cross.into_iter().flat_map(|c| [&c.q, &c.kv, &c.o]))
                .map(Matrix::bytes)
                .sum::<usize>()
        };
        blocks.map(block).sum::<usize>() + self.head.bytes() + 4 * self.embedding.len()
    }
}
