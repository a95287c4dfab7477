//! The radar tokenizer at inference: input tubes of points, output codes and features.
//!
//! The network, the names of its weights and its inputs are those of `radarllm-nn`, which trains it.
//! `radarllm-inference` groups the points. All computation is in f32. Clips are independent of one another: each is
//! processed by one thread, without padding.

mod session;

use crate::EngineError;
use crate::Precision;
use crate::matrix::{Matrix, Quantised, Then, padded};
use crate::pool::Pool;
use crate::weights::{MAX_WIDTH, NamedTensors, Taker};
use radarllm_simd::SimdLevel;

pub use session::{Codes, TokenizerSession};

/// Number of values per neighbour: displacement from the anchor in units of the radius (3), frame offset, range, radial
/// velocity, intensity relative to the clip's median.
pub const NEIGHBOUR_DIM: usize = 7;
/// Number of values per step: centre x, y, its velocity x, y, logarithm of the point count, mean velocity.
pub const STEP_DIM: usize = 6;
/// Number of values per tube: logarithm of the number of points in the radius, mean radial velocity.
pub const TUBE_DIM: usize = 2;
/// Number of coordinates of an anchor.
const ANCHOR_DIM: usize = 3;
/// Number of steps that are joined into one code.
const STEPS_PER_CODE: usize = 2;
/// Epsilon that layer norm adds to the variance: burn's default, which is used in training.
const NORM_EPS: f32 = 1e-5;

/// Shape of the tokenizer network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TokenizerShape {
    /// Number of anchors A.
    pub n_anchors: usize,
    /// Number of steps of the longest clip.
    pub max_steps: usize,
    /// Number of channels C.
    pub width: usize,
    /// Number of factorised transformer layers.
    pub n_layers: usize,
    /// Number of attention heads; `width` is a multiple of it.
    pub n_heads: usize,
    /// Inner width of the feed-forward network.
    pub d_ff: usize,
    /// Number of queries of the attention pooling over anchors.
    pub pool_queries: usize,
    /// Number of channels of each anchor that are concatenated for the code; 0 for none.
    pub per_anchor: usize,
    /// Number of values of each step's Doppler profile; `None` without profiles.
    pub profile: Option<usize>,
    /// Whether tubes have statistics in addition to the maximum over their points.
    pub tube_statistics: bool,
    /// Width D of a code.
    pub code_dim: usize,
    /// Number K of codes in the codebook.
    pub n_codes: usize,
}

impl TokenizerShape {
    /// Checks that the shape is valid.
    ///
    /// # Errors
    /// [`EngineError::Shape`] names the first field out of range.
    pub fn validate(&self) -> Result<(), EngineError> {
        for (field, value, min, max) in [
            ("n_anchors", self.n_anchors, 1, 4096),
            ("max_steps", self.max_steps, 1, 4096),
            ("width", self.width, 1, MAX_WIDTH / 4),
            ("n_layers", self.n_layers, 1, 128),
            ("n_heads", self.n_heads, 1, 1024),
            ("d_ff", self.d_ff, 1, MAX_WIDTH),
            ("pool_queries", self.pool_queries, 1, 1024),
            ("per_anchor", self.per_anchor, 0, 4096),
            ("profile", self.profile.unwrap_or(1), 1, MAX_WIDTH),
            ("code_dim", self.code_dim, 1, MAX_WIDTH),
            ("n_codes", self.n_codes, 1, 1 << 22),
        ] {
            if value < min || value > max {
                let problem = format!("must be in {min}..={max}, found {value}");
                return Err(EngineError::Shape { field, problem });
            }
        }
        if !self.width.is_multiple_of(self.n_heads) {
            let problem = format!("{} is not a multiple of {} heads", self.width, self.n_heads);
            let field = "width";
            return Err(EngineError::Shape { field, problem });
        }
        Ok(())
    }

    fn head(&self) -> usize {
        self.width / self.n_heads
    }

    /// Width of all heads, each of them padded.
    fn inner(&self) -> usize {
        self.n_heads * padded(self.head())
    }
}

/// The tube of one anchor at one step.
#[derive(Clone, Debug, PartialEq)]
pub struct Tube {
    /// Index of the step.
    pub step: u32,
    /// Index of the anchor.
    pub anchor: u32,
    /// Index of the first neighbour in [`TubeClip::neighbours`].
    pub start: u32,
    /// Index after the last neighbour.
    pub end: u32,
    /// Statistics of the tube; see [`TUBE_DIM`].
    pub statistics: [f32; TUBE_DIM],
}

/// A clip as tubes, the input of the tokenizer.
#[derive(Clone, Copy, Debug)]
pub struct TubeClip<'a> {
    /// Tubes that contain points.
    pub tubes: &'a [Tube],
    /// Neighbours of all tubes.
    pub neighbours: &'a [[f32; NEIGHBOUR_DIM]],
    /// Values of each step. Their number is the length of the clip.
    pub steps: &'a [[f32; STEP_DIM]],
    /// `[step, profile]`; empty without profiles.
    pub profiles: &'a [f32],
    /// Anchor positions: `[anchor]`, or `[step, anchor]`.
    pub anchors: &'a [[f32; ANCHOR_DIM]],
}

/// A linear layer: a matrix and a bias.
struct Linear {
    weight: Matrix,
    /// Bias, padded.
    bias: Vec<f32>,
}

/// Resources of a thread for matrix products.
struct Products {
    level: SimdLevel,
    /// A pool of only the thread itself.
    alone: Pool,
    quantised: Quantised,
}

impl Linear {
    fn width(&self) -> usize {
        self.bias.len()
    }

    /// `out = x W + b`, rows of the padded width.
    fn to(&self, tools: &mut Products, x: &[f32], out: &mut [f32]) {
        for row in out.chunks_exact_mut(self.bias.len()) {
            row.copy_from_slice(&self.bias);
        }
        self.product(tools, x, out);
    }

    /// `out += x W + b`.
    fn add_to(&self, tools: &mut Products, x: &[f32], out: &mut [f32]) {
        for row in out.chunks_exact_mut(self.bias.len()) {
            row.iter_mut().zip(&self.bias).for_each(|(x, b)| *x += b);
        }
        self.product(tools, x, out);
    }

    fn product(&self, tools: &mut Products, x: &[f32], out: &mut [f32]) {
        let n = self.bias.len();
        let (pool, scratch) = (&mut tools.alone, &mut tools.quantised);
        self.weight
            .product(tools.level, pool, scratch, x, n, Then::Add, out, n);
    }
}

/// Gain and offset of layer norm.
struct Norm {
    gain: Vec<f32>,
    offset: Vec<f32>,
}

struct Attention {
    norm: Norm,
    /// Query (which includes the scale of the scores), key and value projections side by side.
    qkv: Linear,
    out: Linear,
}

struct Layer {
    space: Attention,
    time: Attention,
    norm: Norm,
    widen: Linear,
    narrow: Linear,
}

/// The weights of the tokenizer, packed once.
pub struct Tokenizer {
    shape: TokenizerShape,
    level: SimdLevel,
    /// `[NEIGHBOUR_DIM, C]`, rows padded.
    point_weight: Vec<f32>,
    point_bias: Vec<f32>,
    tube_mlp: Linear,
    tube_statistics: Option<Linear>,
    /// Embedding of a cell without points.
    empty: Vec<f32>,
    anchor_in: Linear,
    anchor_out: Linear,
    step_in: Linear,
    /// `[max_steps, C]`, rows padded.
    time: Vec<f32>,
    layers: Vec<Layer>,
    norm: Norm,
    pool_scores: Linear,
    pool_out: Linear,
    per_anchor: Option<[Linear; 2]>,
    pool_step: Linear,
    pool_profile: Option<[Linear; 2]>,
    merge: Linear,
    code_out: Linear,
    /// Twice the codebook, `[D, K]`.
    codes: Matrix,
    /// Negative squared norm of each code; negative infinity for the padding.
    code_offsets: Vec<f32>,
}

struct Loader {
    weights: Taker,
}

/// Memory layout of `blocks` blocks of `width` values, each padded to a whole vector.
#[derive(Clone, Copy)]
struct Blocks {
    blocks: usize,
    width: usize,
}

impl Blocks {
    fn one(width: usize) -> Self {
        Self { blocks: 1, width }
    }

    fn values(self) -> usize {
        self.blocks * self.width
    }

    fn padded(self) -> usize {
        self.blocks * padded(self.width)
    }

    /// Converts an index among the padded values to the index among the values.
    fn value(self, at: usize) -> Option<usize> {
        let (block, at) = (at / padded(self.width), at % padded(self.width));
        (at < self.width && block < self.blocks).then_some(block * self.width + at)
    }

    fn spread(self, values: &[f32]) -> Vec<f32> {
        (0..self.padded())
            .map(|at| self.value(at).map_or(0.0, |from| values[from]))
            .collect()
    }
}

impl Loader {
    fn take(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>, EngineError> {
        self.weights.take(name, shape)
    }

    /// `[rows, width]`, each row padded.
    fn rows(&mut self, name: &str, rows: usize, width: usize) -> Result<Vec<f32>, EngineError> {
        let values = self.take(name, &[rows, width])?;
        Ok(Blocks {
            blocks: rows,
            width,
        }
        .spread(&values))
    }

    fn vector(&mut self, name: &str, width: usize) -> Result<Vec<f32>, EngineError> {
        let values = self.take(name, &[width])?;
        Ok(Blocks::one(width).spread(&values))
    }

    fn norm(&mut self, name: &str, width: usize) -> Result<Norm, EngineError> {
        Ok(Norm {
            gain: self.vector(&format!("{name}.gamma"), width)?,
            offset: self.vector(&format!("{name}.beta"), width)?,
        })
    }

    /// Linear maps of the same input side by side, each of them scaled.
    fn linears(
        &mut self,
        names: &[(String, f32)],
        from: Blocks,
        to: Blocks,
    ) -> Result<Linear, EngineError> {
        let mut weights = Vec::with_capacity(names.len());
        let mut bias = Vec::with_capacity(names.len() * to.padded());
        for (name, scale) in names {
            let shape = [from.values(), to.values()];
            weights.push((self.take(&format!("{name}.weight"), &shape)?, *scale));
            let own = self.take(&format!("{name}.bias"), &[to.values()])?;
            bias.extend(to.spread(&own).iter().map(|b| b * scale));
        }
        let columns = names.len() * to.padded();
        let value = |row: usize, column: usize| {
            let (part, column) = (column / to.padded(), column % to.padded());
            let (weight, scale) = &weights[part];
            match (from.value(row), to.value(column)) {
                (Some(row), Some(column)) => weight[row * to.values() + column] * scale,
                _ => 0.0,
            }
        };
        Ok(Linear {
            weight: Matrix::pack(from.padded(), columns, Precision::F32, value),
            bias,
        })
    }

    fn linear(&mut self, name: &str, from: Blocks, to: Blocks) -> Result<Linear, EngineError> {
        self.linears(&[(name.into(), 1.0)], from, to)
    }

    fn attention(&mut self, name: &str, s: &TokenizerShape) -> Result<Attention, EngineError> {
        let width = Blocks::one(s.width);
        let heads = Blocks {
            blocks: s.n_heads,
            width: s.head(),
        };
        let scale = 1.0 / (s.head() as f64).sqrt();
        let parts = [("query", scale as f32), ("key", 1.0), ("value", 1.0)];
        Ok(Attention {
            norm: self.norm(&format!("{name}.norm"), s.width)?,
            qkv: self.linears(
                &parts.map(|(part, scale)| (format!("{name}.{part}"), scale)),
                width,
                heads,
            )?,
            out: self.linear(&format!("{name}.out"), heads, width)?,
        })
    }

    fn layer(&mut self, name: &str, s: &TokenizerShape) -> Result<Layer, EngineError> {
        let (width, inside) = (Blocks::one(s.width), Blocks::one(s.d_ff));
        Ok(Layer {
            space: self.attention(&format!("{name}.space"), s)?,
            time: self.attention(&format!("{name}.time"), s)?,
            norm: self.norm(&format!("{name}.norm"), s.width)?,
            widen: self.linear(&format!("{name}.widen"), width, inside)?,
            narrow: self.linear(&format!("{name}.narrow"), inside, width)?,
        })
    }
}

impl Tokenizer {
    /// Packs the weights of a tokenizer's checkpoint for the best instruction set of this machine.
    ///
    /// Names are those of the checkpoint's `model.safetensors`, without the parts that are used only in training
    /// (`mask`, `head_in`, `head_out`, `guidance`, `words`).
    ///
    /// # Errors
    /// If the shape is invalid, or a weight is missing, unknown, not finite or of another shape.
    pub fn new(shape: TokenizerShape, weights: NamedTensors) -> Result<Self, EngineError> {
        Self::with_level(shape, weights, SimdLevel::detect())
    }

    /// Like [`Self::new`], with the given instruction set.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_level(
        shape: TokenizerShape,
        weights: NamedTensors,
        level: SimdLevel,
    ) -> Result<Self, EngineError> {
        shape.validate()?;
        let s = &shape;
        let mut loader = Loader {
            weights: Taker(weights),
        };
        let l = &mut loader;
        let (width, step) = (Blocks::one(s.width), Blocks::one(2 * s.width));
        let (inputs, merged) = (Blocks::one(STEP_DIM), Blocks::one(4 * s.width));
        let pooled = Blocks {
            blocks: s.pool_queries,
            width: s.width,
        };
        let pair = Blocks {
            blocks: STEPS_PER_CODE,
            width: 2 * s.width,
        };
        let cells = Blocks {
            blocks: s.n_anchors,
            width: s.per_anchor,
        };
        let codebook = l.take("codebook", &[s.n_codes, s.code_dim])?;
        let mut code_offsets = vec![f32::NEG_INFINITY; padded(s.n_codes)];
        for (offset, code) in code_offsets
            .iter_mut()
            .zip(codebook.chunks_exact(s.code_dim))
        {
            *offset = -code.iter().map(|v| v * v).sum::<f32>();
        }
        let tokenizer = Self {
            point_weight: l.rows("point_conv.weight", NEIGHBOUR_DIM, s.width)?,
            point_bias: l.vector("point_conv.bias", s.width)?,
            tube_mlp: l.linear("tube_mlp", width, width)?,
            tube_statistics: match s.tube_statistics {
                true => Some(l.linear("tube_statistics", Blocks::one(TUBE_DIM), width)?),
                false => None,
            },
            empty: l.rows("empty", 1, s.width)?,
            anchor_in: l.linear("anchor_in", Blocks::one(ANCHOR_DIM), width)?,
            anchor_out: l.linear("anchor_out", width, width)?,
            step_in: l.linear("step_in", inputs, width)?,
            time: l.rows("time", s.max_steps, s.width)?,
            layers: (0..s.n_layers)
                .map(|i| l.layer(&format!("layers.{i}"), s))
                .collect::<Result<_, _>>()?,
            norm: l.norm("norm", s.width)?,
            pool_scores: l.linear("pool_scores", width, Blocks::one(s.pool_queries))?,
            pool_out: l.linear("pool_out", pooled, step)?,
            per_anchor: match s.per_anchor {
                0 => None,
                narrow => Some([
                    l.linear("per_anchor.0", width, Blocks::one(narrow))?,
                    l.linear("per_anchor.1", cells, step)?,
                ]),
            },
            pool_step: l.linear("pool_step", inputs, step)?,
            pool_profile: match s.profile {
                None => None,
                Some(values) => Some([
                    l.linear("pool_profile.0", Blocks::one(values), step)?,
                    l.linear("pool_profile.1", step, step)?,
                ]),
            },
            merge: l.linear("merge", pair, merged)?,
            code_out: l.linear("code_out", merged, Blocks::one(s.code_dim))?,
            // Doubled, because the nearest code maximizes 2 x.c - |c|^2. The term |x|^2 is the same for all codes.
            codes: Matrix::pack(s.code_dim, s.n_codes, Precision::F32, |row, code| {
                2.0 * codebook[code * s.code_dim + row]
            }),
            code_offsets,
            level,
            shape,
        };
        loader.weights.finish()?;
        Ok(tokenizer)
    }

    /// Shape of the network.
    pub fn shape(&self) -> &TokenizerShape {
        &self.shape
    }
}
