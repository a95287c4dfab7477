//! The radar tokenizer at inference: tubes of points in, codes and features out.
//!
//! Network, names of weights and inputs are those of `radarllm-nn`, where it is trained; `radarllm-inference` groups points;
//! f32 throughout. Clips do not influence one another: each is one thread's, unpadded.

mod session;

use crate::EngineError;
use crate::Precision;
use crate::matrix::{Matrix, Quantised, Then, padded};
use crate::pool::Pool;
use crate::weights::{MAX_WIDTH, NamedTensors, Taker};
use radarllm_simd::SimdLevel;

pub use session::{Codes, TokenizerSession};

/// Values per neighbour: displacement from the anchor in units of the radius (3), frame offset,
/// range, radial velocity, intensity relative to the clip's median.
pub const NEIGHBOUR_DIM: usize = 7;
/// Values per step: centre x, y, its velocity x, y, logarithm of the point count, mean velocity.
pub const STEP_DIM: usize = 6;
/// Values per tube: logarithm of the number of points in the radius, mean radial velocity.
pub const TUBE_DIM: usize = 2;
/// Coordinates of an anchor.
const ANCHOR_DIM: usize = 3;
/// Steps joined into a code.
const STEPS_PER_CODE: usize = 2;
/// Added to the variance in layer norm: burn's default, with which the networks are trained.
const NORM_EPS: f32 = 1e-5;

/// Shape of the tokenizer's network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TokenizerShape {
    /// Anchors A.
    pub n_anchors: usize,
    /// Steps of the longest clip.
    pub max_steps: usize,
    /// Channels C.
    pub width: usize,
    /// Factorised transformer layers.
    pub n_layers: usize,
    /// Attention heads; `width` is a multiple.
    pub n_heads: usize,
    /// Inner width of the feed-forward.
    pub d_ff: usize,
    /// Queries of the attention pooling over anchors.
    pub pool_queries: usize,
    /// Channels of each anchor that reach the code side by side; 0 for none.
    pub per_anchor: usize,
    /// Values of each step's profile; none without one.
    pub profile: Option<usize>,
    /// Tubes carry statistics beside their points' maximum.
    pub tube_statistics: bool,
    /// Width of a code D.
    pub code_dim: usize,
    /// Codes K.
    pub n_codes: usize,
}

impl TokenizerShape {
    /// Checks that the network can exist.
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

    /// Width of all heads, each padded.
    fn inner(&self) -> usize {
        self.n_heads * padded(self.head())
    }
}

/// One anchor at one step.
#[derive(Clone, Debug, PartialEq)]
pub struct Tube {
    /// Step.
    pub step: u32,
    /// Anchor.
    pub anchor: u32,
    /// First neighbour in [`TubeClip::neighbours`].
    pub start: u32,
    /// One past the last neighbour.
    pub end: u32,
    /// See [`TUBE_DIM`].
    pub statistics: [f32; TUBE_DIM],
}

/// A clip as tubes.
#[derive(Clone, Copy, Debug)]
pub struct TubeClip<'a> {
    /// Tubes that have points.
    pub tubes: &'a [Tube],
    /// Neighbours of all tubes.
    pub neighbours: &'a [[f32; NEIGHBOUR_DIM]],
    /// Per step; their number is the clip's length.
    pub steps: &'a [[f32; STEP_DIM]],
    /// `[step, profile]`; empty without profiles.
    pub profiles: &'a [f32],
    /// Anchor positions: `[anchor]`, or `[step, anchor]`.
    pub anchors: &'a [[f32; ANCHOR_DIM]],
}

/// A matrix and what is added to its products.
struct Linear {
    weight: Matrix,
    /// Padded.
    bias: Vec<f32>,
}

/// A thread's tools for products.
struct Products {
    level: SimdLevel,
    /// The thread itself.
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

/// Gain and offset of a layer norm.
struct Norm {
    gain: Vec<f32>,
    offset: Vec<f32>,
}

struct Attention {
    norm: Norm,
    /// Query (with the scores' scale), key and value side by side.
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

/// The tokenizer's weights, packed once.
pub struct Tokenizer {
    shape: TokenizerShape,
    level: SimdLevel,
    /// `[NEIGHBOUR_DIM, C]`, rows padded.
    point_weight: Vec<f32>,
    point_bias: Vec<f32>,
    tube_mlp: Linear,
    tube_statistics: Option<Linear>,
    /// Stands for a cell without points.
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
    /// Twice the codes, `[D, K]`.
    codes: Matrix,
    /// Less the square of each code's length; negative infinity beyond the last.
    code_offsets: Vec<f32>,
}

struct Loader {
    weights: Taker,
}

/// How `blocks` blocks of `width` values lie in memory: each padded to a vector.
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

    /// Place among the values of a place among the padded ones.
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

    /// Maps of the same input side by side, each scaled.
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
    /// Packs the weights of a tokenizer's checkpoint for the best instructions of this machine.
    ///
    /// Names are those of `model.safetensors` there, without the parts that only training needs (`mask`,
    /// `head_in`, `head_out`, `guidance`, `words`).
    ///
    /// # Errors
    /// If the shape cannot be, or a weight is missing, unknown, of another shape or not finite.
    pub fn new(shape: TokenizerShape, weights: NamedTensors) -> Result<Self, EngineError> {
        Self::with_level(shape, weights, SimdLevel::detect())
    }

    /// As [`Self::new`] with given instructions.
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
            // Doubled: the nearest code has the largest 2 x.c - |c|^2, and |x|^2 does not matter.
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

    /// The shape.
    pub fn shape(&self) -> &TokenizerShape {
        &self.shape
    }
}
