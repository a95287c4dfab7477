//! The decoder of radar codes as it is trained: embeddings of a code and of its neighbours in time, then three linear
//! layers.

use burn::module::{Module, Param};
use burn::nn::{Initializer, Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Int, Tensor, TensorData};
use radarllm_engine::point_decoder::PointDecoderShape;

/// The decoder.
#[derive(Module, Debug)]
pub struct PointNet {
    /// Embeddings of the codes, `[K, W]`.
    codes: Param<Tensor<2>>,
    /// Embedding of what is before the first code and after the last one, `[1, W]`.
    edge: Param<Tensor<2>>,
    widen: Linear,
    middle: Linear,
    out: Linear,
}

impl PointNet {
    /// Random weights, drawn from `device`'s generator.
    pub fn new(shape: &PointDecoderShape, device: &Device) -> Self {
        let normal = Initializer::Normal {
            mean: 0.0,
            std: 1.0,
        };
        let linear = |from: usize, to: usize| LinearConfig::new(from, to).init(device);
        Self {
            codes: normal.init([shape.n_codes, shape.width], device),
            edge: normal.init([1, shape.width], device),
            widen: linear(shape.window() * shape.width, shape.hidden),
            middle: linear(shape.hidden, shape.hidden),
            out: linear(shape.hidden, shape.outputs()),
        }
    }

    /// The device that stores the weights.
    pub fn device(&self) -> Device {
        self.codes.val().device()
    }

    /// Outputs `[n, outputs]` of `n` codes, each given with its neighbours: see [`window_rows`].
    pub fn forward(&self, rows: Vec<i32>, shape: &PointDecoderShape) -> Tensor<2> {
        let window = shape.window();
        let n = rows.len() / window;
        let rows = TensorData::new(rows, [n * window]);
        let rows = Tensor::<1, Int>::from_data(rows, &self.device());
        let table = Tensor::cat(vec![self.codes.val(), self.edge.val()], 0);
        let x = table.select(0, rows).reshape([n, window * shape.width]);
        let hidden = relu(self.widen.forward(x));
        self.out.forward(relu(self.middle.forward(hidden)))
    }
}

/// Rows of the table of embeddings for code `index` of a clip: the codes around it, and the edge beyond the clip.
pub fn window_rows(codes: &[u32], index: usize, shape: &PointDecoderShape) -> Vec<i32> {
    let row = |i: usize| {
        let at = (index + i).checked_sub(shape.context);
        let code = at.and_then(|at| codes.get(at));
        code.map_or(shape.n_codes, |code| *code as usize) as i32
    };
    (0..shape.window()).map(row).collect()
}

#[cfg(test)]
mod tests {
    use radarllm_engine::point_decoder::PointDecoder;

    use super::*;
    use crate::params::collect_params;

    #[test]
    fn the_engine_gives_the_same_outputs() {
        let shape = PointDecoderShape {
            n_codes: 8,
            width: 4,
            context: 2,
            hidden: 16,
            points: 3,
        };
        let device = Device::flex();
        device.seed(5);
        let net = PointNet::new(&shape, &device);
        let engine = PointDecoder::new(shape, collect_params(&net)).unwrap();
        let codes = [3, 0, 7, 7, 1, 2];
        let fast = engine.decode(&codes).unwrap();
        let rows = (0..codes.len()).flat_map(|i| window_rows(&codes, i, &shape));
        let slow = net.forward(rows.collect(), &shape).into_data();
        let slow: Vec<f32> = slow.try_into_vec().unwrap();
        for (a, b) in fast.concat().iter().zip(&slow) {
            // Sums of at most 20 products of numbers near 1.
            assert!((a - b).abs() < 1e-4, "{a}, {b}");
        }
        assert_eq!(fast.concat().len(), slow.len());
    }
}
