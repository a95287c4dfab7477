//! The decoder of radar codes: input codes, output points.
//!
//! The codes of a clip stand for 0.4 s each. Points of a code are computed from the embeddings of that code and of its
//! neighbours in time by three linear layers. The network, the names of its weights and its outputs are those of
//! `radarllm-nn`, which trains it. The network is so small that it needs no vector instructions.

use crate::EngineError;
use crate::dense::Dense;
use crate::weights::{NamedTensors, Taker};

/// Radar frames of a code.
pub const FRAMES_PER_CODE: usize = 4;
/// Values of a point: x, y, z, radial velocity, intensity, all scaled.
pub const POINT_DIM: usize = 5;

/// Shape of the decoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PointDecoderShape {
    /// Number of radar codes.
    pub n_codes: usize,
    /// Width of the embedding of a code.
    pub width: usize,
    /// Number of codes before and after a code from which its points are computed.
    pub context: usize,
    /// Width of the hidden layers.
    pub hidden: usize,
    /// Most points of a frame.
    pub points: usize,
}

impl PointDecoderShape {
    /// Checks that the shape is valid.
    ///
    /// # Errors
    /// [`EngineError::Shape`] names the first field out of range.
    pub fn validate(&self) -> Result<(), EngineError> {
        for (field, value, min, max) in [
            ("n_codes", self.n_codes, 1, 1 << 16),
            ("width", self.width, 1, 1024),
            ("context", self.context, 0, 16),
            ("hidden", self.hidden, 1, 4096),
            ("points", self.points, 1, 128),
        ] {
            if value < min || value > max {
                let problem = format!("must be in {min}..={max}, found {value}");
                return Err(EngineError::Shape { field, problem });
            }
        }
        Ok(())
    }

    /// Codes from which the points of a code are computed.
    pub fn window(&self) -> usize {
        2 * self.context + 1
    }

    /// Outputs of a frame: its points, then the scaled logarithm of their number.
    pub fn frame_outputs(&self) -> usize {
        self.points * POINT_DIM + 1
    }

    /// Outputs of a code.
    pub fn outputs(&self) -> usize {
        FRAMES_PER_CODE * self.frame_outputs()
    }
}

/// The weights of the decoder.
pub struct PointDecoder {
    shape: PointDecoderShape,
    /// `[n_codes, width]`.
    codes: Vec<f32>,
    /// Embedding of what is before the first code and after the last one.
    edge: Vec<f32>,
    layers: [Dense; 3],
}

impl PointDecoder {
    /// Checks and takes the weights.
    ///
    /// # Errors
    /// If the shape is invalid, or a weight is missing, unknown, not finite or of another shape.
    pub fn new(shape: PointDecoderShape, weights: NamedTensors) -> Result<Self, EngineError> {
        shape.validate()?;
        let mut weights = Taker(weights);
        let w = &mut weights;
        let decoder = Self {
            codes: w.take("codes", &[shape.n_codes, shape.width])?,
            edge: w.take("edge", &[1, shape.width])?,
            layers: [
                Dense::take(w, "widen", shape.window() * shape.width, shape.hidden)?,
                Dense::take(w, "middle", shape.hidden, shape.hidden)?,
                Dense::take(w, "out", shape.hidden, shape.outputs())?,
            ],
            shape,
        };
        weights.finish()?;
        Ok(decoder)
    }

    /// Shape of the network.
    pub fn shape(&self) -> &PointDecoderShape {
        &self.shape
    }

    /// Outputs of every code, [`PointDecoderShape::outputs`] each.
    ///
    /// # Errors
    /// [`EngineError::Input`] names the first code beyond the codebook; [`EngineError::Output`] if an output is not
    /// finite.
    pub fn decode(&self, codes: &[u32]) -> Result<Vec<Vec<f32>>, EngineError> {
        let s = &self.shape;
        if let Some(index) = codes.iter().position(|code| *code as usize >= s.n_codes) {
            let problem = format!("code {}, but there are {}", codes[index], s.n_codes);
            return Err(EngineError::Input { index, problem });
        }
        let embedding = |at: Option<usize>| match at.and_then(|at| codes.get(at)) {
            Some(code) => &self.codes[*code as usize * s.width..][..s.width],
            None => &self.edge,
        };
        let one = |index: usize| {
            let window = (0..s.window()).map(|i| (index + i).checked_sub(s.context));
            let x: Vec<f32> = window.flat_map(embedding).copied().collect();
            let [widen, middle, out] = &self.layers;
            let values = out.apply(&middle.apply_relu(&widen.apply_relu(&x)));
            match values.iter().all(|v| v.is_finite()) {
                true => Ok(values),
                false => Err(EngineError::Output { index }),
            }
        };
        (0..codes.len()).map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::HostTensor;
    use crate::tests::Random;

    const SHAPE: PointDecoderShape = PointDecoderShape {
        n_codes: 4,
        width: 2,
        context: 1,
        hidden: 3,
        points: 2,
    };

    fn weights() -> NamedTensors {
        let mut random = Random(3);
        let mut out = NamedTensors::new();
        for (name, shape) in [
            ("codes", vec![4, 2]),
            ("edge", vec![1, 2]),
            ("widen.weight", vec![6, 3]),
            ("widen.bias", vec![3]),
            ("middle.weight", vec![3, 3]),
            ("middle.bias", vec![3]),
            ("out.weight", vec![3, 44]),
            ("out.bias", vec![44]),
        ] {
            let values = (0..shape.iter().product()).map(|_| random.normal());
            let values = values.collect();
            out.insert(name.into(), HostTensor { shape, values });
        }
        out
    }

    #[test]
    fn points_of_a_code_depend_on_its_neighbours_and_on_nothing_else() {
        let decoder = PointDecoder::new(SHAPE, weights()).unwrap();
        let long = decoder.decode(&[0, 1, 2, 3, 0]).unwrap();
        assert_eq!((long.len(), long[0].len()), (5, SHAPE.outputs()));
        let other = decoder.decode(&[3, 1, 2, 3, 3]).unwrap();
        assert_eq!(long[2], other[2], "two codes away");
        assert!(long[1] != other[1] && long[0] != other[0]);
        assert_eq!(decoder.decode(&[]).unwrap(), Vec::<Vec<f32>>::new());
        let beyond = decoder.decode(&[0, 4]).unwrap_err().to_string();
        assert!(beyond.contains("code 4"), "{beyond}");
    }

    #[test]
    fn weights_that_do_not_fit_are_refused() {
        for name in ["codes", "edge", "out.bias"] {
            let mut missing = weights();
            missing.remove(name);
            let error = PointDecoder::new(SHAPE, missing).err().unwrap();
            assert!(error.to_string().contains(name), "{error}");
        }
        let mut more = weights();
        more.insert("more".into(), HostTensor::vector(vec![0.0]));
        assert!(PointDecoder::new(SHAPE, more).is_err());
        let mut nan = weights();
        nan.get_mut("edge").unwrap().values[1] = f32::NAN;
        assert!(PointDecoder::new(SHAPE, nan).is_err());
        let huge = PointDecoderShape {
            hidden: 1 << 30,
            ..SHAPE
        };
        assert!(PointDecoder::new(huge, weights()).is_err());
    }
}
