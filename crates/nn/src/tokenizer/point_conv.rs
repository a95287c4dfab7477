//! P4DConv (Fan et al., Point 4D Transformer Networks, CVPR 2021, equation 1): a shared linear map of
//! displacement and features, then the maximum over a tube's points.
//!
//! The textbook form computes a `[neighbours, C]` array, pads every tube to the same length and takes a
//! maximum; its time is dominated by memory traffic. Here the maximum is found in plain loops over ragged
//! tubes, and only the winning neighbour of each (tube, channel) enters the autodiff graph. The
//! gradient of a maximum reaches nothing else, so values and gradients are the same. A GPU
//! finds the winners itself, from the neighbours alone.

use std::collections::BTreeMap;

use burn::module::{Module, Param};
use burn::nn::Initializer;
use burn::tensor::{Device, Int, Tensor, TensorData};

use super::batch::ClipBatch;
use crate::device::is_cpu;
use radarllm_inference::tokenizer::grouping::NEIGHBOUR_DIM;

/// Linear map of neighbours followed by the maximum over each tube.
#[derive(Module, Debug)]
pub struct PointConv {
    /// `[NEIGHBOUR_DIM, C]`.
    weight: Param<Tensor<2>>,
    /// `[C]`.
    bias: Param<Tensor<1>>,
}

impl PointConv {
    /// A layer with random weights for `width` channels.
    pub fn new(width: usize, device: &Device) -> Self {
        let bound = 1.0 / (NEIGHBOUR_DIM as f64).sqrt();
        let uniform = Initializer::Uniform {
            min: -bound,
            max: bound,
        };
        Self {
            weight: uniform.init([NEIGHBOUR_DIM, width], device),
            bias: uniform.init([width], device),
        }
    }

    /// Features of the batch's tubes, `[n_tubes, C]`; `None` if no tube has points.
    pub fn forward(&self, batch: &ClipBatch) -> Option<Tensor<2>> {
        if batch.tubes.is_empty() {
            return None;
        }
        let weight = self.weight.val();
        let [_, width] = weight.dims();
        let device = weight.device();
        let values = weight.clone().without_autodiff();
        let n = batch.tubes.len();
        let inputs = if is_cpu(&device) {
            let w: Vec<f32> = values.into_data().try_into_vec().unwrap_or_default();
            let (best, winner) = winners(batch, &w, width);
            if !weight.is_autodiff() {
                let best = Tensor::from_data(TensorData::new(best, [n, width]), &device);
                return Some(best + self.bias.val().unsqueeze());
            }
            // Inputs of the winners, one plane per input value: [NEIGHBOUR_DIM, n * C].
            let mut planes = vec![0.0f32; NEIGHBOUR_DIM * n * width];
            for (d, plane) in planes.chunks_exact_mut(n * width).enumerate() {
                for (value, &neighbour) in plane.iter_mut().zip(&winner) {
                    *value = batch.neighbours[neighbour as usize][d];
                }
            }
            Tensor::from_data(TensorData::new(planes, [NEIGHBOUR_DIM, n, width]), &device)
        } else {
            winners_on_gpu(batch, values)
        };
        let sum = (inputs * weight.unsqueeze_dim(1)).sum_dim(0);
        Some(sum.reshape([n, width]) + self.bias.val().unsqueeze())
    }
}

/// Inputs of the winners, `[NEIGHBOUR_DIM, n_tubes, C]`, found on the device of `weight`.
///
/// Tubes of similar length are grouped and padded to the next power of two with their own last neighbour, which changes
/// no maximum. The number of products is at most doubled, regardless of the longest tube.
fn winners_on_gpu(batch: &ClipBatch, weight: Tensor<2>) -> Tensor<3> {
    let device = weight.device();
    let [_, width] = weight.dims();
    let (n, n_neighbours) = (batch.tubes.len(), batch.neighbours.len());
    let flat = TensorData::new(batch.neighbours.concat(), [n_neighbours, NEIGHBOUR_DIM]);
    let neighbours = Tensor::<2>::from_data(flat, &device);
    let mut by_length: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (tube, &(start, end)) in batch.tubes.iter().enumerate() {
        let padded = (end - start).next_power_of_two() as usize;
        by_length.entry(padded).or_default().push(tube);
    }
    let mut planes = Vec::with_capacity(by_length.len());
    // Position of each tube in the grouped order.
    let mut place = vec![0i32; n];
    let mut n_placed = 0;
    for (&padded, tubes) in &by_length {
        let n_tubes = tubes.len();
        let mut rows = Vec::with_capacity(n_tubes * padded);
        for &tube in tubes {
            let (start, end) = batch.tubes[tube];
            rows.extend((0..padded as u32).map(|i| (start + i).min(end - 1) as i32));
            place[tube] = n_placed;
            n_placed += 1;
        }
        let rows = TensorData::new(rows, [n_tubes * padded]);
        let own = (neighbours.clone()).select(0, Tensor::<1, Int>::from_data(rows, &device));
        let products = own.clone().matmul(weight.clone());
        let winner = products.reshape([n_tubes, padded, width]).argmax(1);
        let winner = winner.reshape([n_tubes, width]);
        let of_each = (0..NEIGHBOUR_DIM).map(|d| {
            let value = own.clone().narrow(1, d, 1).reshape([n_tubes, padded]);
            value.gather(1, winner.clone()).unsqueeze::<3>()
        });
        planes.push(Tensor::cat(of_each.collect(), 0));
    }
    let place = Tensor::<1, Int>::from_data(TensorData::new(place, [n]), &device);
    Tensor::cat(planes, 1).select(1, place)
}

/// Largest value and its neighbour, for every tube and channel. The bias is left out because it
/// does not change which neighbour is the maximum. Ties are resolved in favour of the first neighbour.
fn winners(batch: &ClipBatch, weight: &[f32], width: usize) -> (Vec<f32>, Vec<u32>) {
    let n = batch.tubes.len();
    let mut best = vec![f32::NEG_INFINITY; n * width];
    let mut winner = vec![0u32; n * width];
    let mut value = vec![0.0f32; width];
    let rows: Vec<&[f32]> = weight.chunks_exact(width).collect();
    for (tube, &(start, end)) in batch.tubes.iter().enumerate() {
        let best = &mut best[tube * width..][..width];
        let winner = &mut winner[tube * width..][..width];
        for neighbour in start..end {
            let x = &batch.neighbours[neighbour as usize];
            value.fill(0.0);
            for (row, &x) in rows.iter().zip(x) {
                value.iter_mut().zip(*row).for_each(|(v, w)| *v += x * w);
            }
            for ((v, b), i) in value.iter().zip(best.iter_mut()).zip(winner.iter_mut()) {
                let wins = *v > *b;
                *b = if wins { *v } else { *b };
                *i = if wins { neighbour } else { *i };
            }
        }
    }
    (best, winner)
}

#[cfg(test)]
mod tests {
    use super::super::batch::ClipInput;
    use super::*;
    use radarllm_inference::tokenizer::config::TokenizerConfig;
    use radarllm_inference::tokenizer::doppler_profile::PROFILE_DIM;
    use radarllm_inference::tokenizer::grouping::{Grouped, Tube};

    /// Against a padded tensor and the framework's own maximum, values and gradients.
    #[test]
    fn equals_the_textbook_form() {
        let value = |i: usize| ((i * 7919 % 1000) as f32 / 500.0 - 1.0) * 0.9;
        let neighbours: Vec<[f32; NEIGHBOUR_DIM]> = (0..9)
            .map(|i| std::array::from_fn(|d| value(i * NEIGHBOUR_DIM + d)))
            .collect();
        let tube = |anchor, start, end| Tube {
            step: 0,
            anchor,
            start,
            end,
            statistics: [0.0; 2],
        };
        let grouped = Grouped {
            n_steps: 1,
            n_codes: 1,
            tubes: vec![tube(0, 0, 3), tube(1, 3, 4), tube(5, 4, 9)],
            neighbours: neighbours.clone(),
            steps: vec![[0.0; 6]],
            profiles: vec![[0.0; PROFILE_DIM]],
            anchors: vec![[0.0; 3]; 54],
            n_points_used: 9,
        };
        let batch = ClipBatch::new(&TokenizerConfig::small(), &[ClipInput::whole(&grouped)]);
        let device = Device::flex().autodiff();
        device.seed(7);
        let conv = PointConv::new(16, &device);
        let fast = conv.forward(&batch).unwrap();
        let mut slow = Vec::new();
        for &(start, end) in &batch.tubes {
            let rows: Vec<f32> = neighbours[start as usize..end as usize].concat();
            let n = (end - start) as usize;
            let x = Tensor::<2>::from_data(TensorData::new(rows, [n, NEIGHBOUR_DIM]), &device);
            slow.push((x.matmul(conv.weight.val()) + conv.bias.val().unsqueeze()).max_dim(0));
        }
        let slow = Tensor::cat(slow, 0);
        let gradient = |y: Tensor<2>| {
            let grads = y.square().sum().backward();
            let g = conv.weight.val().grad(&grads).unwrap();
            g.into_data().try_into_vec::<f32>().unwrap()
        };
        let host = |t: &Tensor<2>| t.clone().into_data().try_into_vec::<f32>().unwrap();
        let pairs = host(&fast).into_iter().zip(host(&slow));
        let grads = gradient(fast).into_iter().zip(gradient(slow));
        for (a, b) in pairs.chain(grads) {
            // Sums of seven products in another order: a few ulp of values below 10.
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
        // The computation for GPUs: the same neighbours win.
        let w = conv.weight.val().without_autodiff();
        let inputs = host(&winners_on_gpu(&batch, w.clone()).flatten(0, 1));
        let (_, winner) = winners(&batch, &host(&w), 16);
        assert_eq!(winner.len(), 3 * 16);
        for (d, plane) in inputs.chunks_exact(winner.len()).enumerate() {
            for (input, winner) in plane.iter().zip(&winner) {
                assert_eq!(*input, neighbours[*winner as usize][d]);
            }
        }
        let valid = conv.valid().forward(&batch).unwrap();
        let train = conv.forward(&batch).unwrap();
        for (a, b) in host(&valid).into_iter().zip(host(&train)) {
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
    }
}
