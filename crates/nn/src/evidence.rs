//! The networks that read a window's points as numbers as they are trained: two perceptrons.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Tensor, TensorData};
use radarllm_engine::evidence::{EvidenceShape, N_SIDES};

/// Three linear layers.
#[derive(Module, Debug)]
pub struct Perceptron {
    widen: Linear,
    middle: Linear,
    out: Linear,
}

impl Perceptron {
    fn new([inputs, first, second, outputs]: [usize; 4], device: &Device) -> Self {
        let linear = |from: usize, to: usize| LinearConfig::new(from, to).init(device);
        Self {
            widen: linear(inputs, first),
            middle: linear(first, second),
            out: linear(second, outputs),
        }
    }

    fn forward(&self, inputs: Vec<f32>, n_inputs: usize) -> Tensor<2> {
        let shape = [inputs.len() / n_inputs, n_inputs];
        let device = self.widen.weight.val().device();
        let x = Tensor::<2>::from_data(TensorData::new(inputs, shape), &device);
        let hidden = relu(self.widen.forward(x));
        self.out.forward(relu(self.middle.forward(hidden)))
    }
}

/// Both networks.
#[derive(Module, Debug)]
pub struct EvidenceNet {
    actions: Perceptron,
    sides: Perceptron,
}

impl EvidenceNet {
    /// Random weights, drawn from `device`'s generator.
    pub fn new(shape: &EvidenceShape, device: &Device) -> Self {
        let [first, second] = shape.hidden;
        let network = |inputs, outputs| Perceptron::new([inputs, first, second, outputs], device);
        Self {
            actions: network(shape.values, shape.contents),
            sides: network(shape.values + shape.sided, N_SIDES),
        }
    }

    /// The device that stores the weights.
    pub fn device(&self) -> Device {
        self.actions.widen.weight.val().device()
    }

    /// Logits `[n, contents]` of `n` rows of standardised values.
    pub fn actions(&self, values: Vec<f32>, shape: &EvidenceShape) -> Tensor<2> {
        self.actions.forward(values, shape.values)
    }

    /// Logits `[n, 3]` of left, right and both for `n` rows of inputs: the standardised values, then 1 for the action and 0
    /// for the other actions that have sides.
    pub fn sides(&self, inputs: Vec<f32>, shape: &EvidenceShape) -> Tensor<2> {
        self.sides.forward(inputs, shape.values + shape.sided)
    }
}

#[cfg(test)]
mod tests {
    use radarllm_engine::evidence::EvidenceNetworks;

    use super::*;
    use crate::params::collect_params;

    #[test]
    fn the_engine_gives_the_same_logits() {
        let shape = EvidenceShape {
            values: 5,
            contents: 4,
            sided: 3,
            hidden: [8, 4],
        };
        let device = Device::flex();
        device.seed(7);
        let net = EvidenceNet::new(&shape, &device);
        let engine = EvidenceNetworks::new(shape, collect_params(&net)).unwrap();
        let values = [0.3, -1.0, 2.0, 0.0, -0.7];
        let close = |fast: &[f32], slow: Tensor<2>| {
            let slow: Vec<f32> = slow.into_data().try_into_vec().unwrap();
            assert_eq!(fast.len(), slow.len());
            for (a, b) in fast.iter().zip(&slow) {
                // Sums of at most 8 products of numbers near 1.
                assert!((a - b).abs() < 1e-5, "{a}, {b}");
            }
        };
        close(
            &engine.actions(&values),
            net.actions(values.to_vec(), &shape),
        );
        for action in 0..3 {
            let mut inputs = values.to_vec();
            inputs.extend((0..3).map(|i| f32::from(u8::from(i == action))));
            close(&engine.sides(&values, action), net.sides(inputs, &shape));
        }
    }
}
