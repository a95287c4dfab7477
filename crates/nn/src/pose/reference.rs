//! The forward pass of inference again, in f64 and plain loops, from the definition of the network alone.

use radarllm_inference::checkpoint::NamedTensors;

use super::config::{POINT_INPUTS, PoseConfig};
use super::network::{PoseBatch, PoseNet};
use crate::params::{collect_params, replace_params};

type Row = Vec<f64>;

struct Weights(NamedTensors);

impl Weights {
    fn values(&self, path: &str) -> Vec<f64> {
        let tensor = self.0.get(path).unwrap_or_else(|| panic!("{path}"));
        tensor.values.iter().map(|v| f64::from(*v)).collect()
    }

    /// `x W + b`; the weights are `[from, to]`.
    fn linear(&self, path: &str, x: &[f64]) -> Row {
        let (w, b) = (
            self.values(&format!("{path}.weight")),
            self.values(&format!("{path}.bias")),
        );
        let to = b.len();
        (0..to)
            .map(|j| b[j] + (0..x.len()).map(|i| x[i] * w[i * to + j]).sum::<f64>())
            .collect()
    }

    /// Linear map, normalisation by the running statistics, ReLU.
    fn layer(&self, path: &str, x: &[f64]) -> Row {
        let of = |name: &str| self.values(&format!("{path}.norm.{name}"));
        let (gain, shift) = (of("gain"), of("shift"));
        let (mean, variance) = (of("running_mean"), of("running_variance"));
        let y = self.linear(&format!("{path}.linear"), x);
        (0..y.len())
            .map(|i| ((y[i] - mean[i]) / (variance[i] + 1e-5).sqrt() * gain[i] + shift[i]).max(0.0))
            .collect()
    }

    fn layers(&self, path: &str, x: &[f64]) -> Row {
        (0..3).fold(x.to_vec(), |x, i| self.layer(&format!("{path}.{i}"), &x))
    }

    /// Softmax attention over rows.
    fn pool(&self, path: &str, rows: &[Row], width: usize) -> Row {
        let scores: Vec<f64> = rows
            .iter()
            .map(|r| self.linear(&format!("{path}.score"), r)[0].exp())
            .collect();
        let sum: f64 = scores.iter().sum();
        (0..width)
            .map(|i| rows.iter().zip(&scores).map(|(r, s)| r[i] * s / sum).sum())
            .collect()
    }

    /// Three layers; gates input, forget, cell, output.
    fn lstm(&self, path: &str, x: &[Row]) -> Vec<Row> {
        let sigmoid = |v: f64| 1.0 / (1.0 + (-v).exp());
        let mut x = x.to_vec();
        for layer in 0..3 {
            let width = x[0].len();
            let (mut state, mut cell) = (vec![0.0; width], vec![0.0; width]);
            for row in &mut x {
                let a = self.linear(&format!("{path}.layers.{layer}.input"), row);
                let b = self.linear(&format!("{path}.layers.{layer}.hidden"), &state);
                let gate = |g: usize, i: usize| a[g * width + i] + b[g * width + i];
                for i in 0..width {
                    cell[i] =
                        sigmoid(gate(1, i)) * cell[i] + sigmoid(gate(0, i)) * gate(2, i).tanh();
                    state[i] = sigmoid(gate(3, i)) * cell[i].tanh();
                }
                *row = state.clone();
            }
        }
        x
    }
}

/// Outputs of the head for every frame of one clip, and the places.
fn outputs(w: &Weights, frames: &[Vec<Row>], neighbours: usize) -> (Vec<Row>, Vec<Row>) {
    let described: Vec<Vec<Row>> = frames
        .iter()
        .map(|points| {
            let of = |p: &Row| [&p[..4], &w.layers("base", p)].concat();
            points.iter().map(of).collect()
        })
        .collect();
    let pooled: Vec<Row> = described
        .iter()
        .map(|points| {
            let rows: Vec<Row> = points.iter().map(|p| w.layers("global", p)).collect();
            w.pool("global_pool", &rows, 64)
        })
        .collect();
    let global = w.lstm("global_lstm", &pooled);
    let relu = |x: Row| -> Row { x.into_iter().map(|v| v.max(0.0)).collect() };
    let places: Vec<Row> = global
        .iter()
        .map(|g| w.linear("place", &relu(w.linear("place_hidden", g))))
        .collect();
    let anchored: Vec<Row> = described
        .iter()
        .zip(&places)
        .map(|(points, place)| anchors(w, points, place, neighbours))
        .collect();
    let anchored = w.lstm("anchor_lstm", &anchored);
    let head = |(g, a): (&Row, &Row)| {
        let hidden = relu(w.linear("head_hidden", &[&g[..], a].concat()));
        w.linear("head", &hidden)
    };
    (global.iter().zip(&anchored).map(head).collect(), places)
}

/// The anchor branch of one frame.
fn anchors(w: &Weights, points: &[Row], place: &[f64], neighbours: usize) -> Row {
    let mut volume = vec![vec![vec![Row::new(); 3]; 3]; 9];
    for (level, plane) in volume.iter_mut().enumerate() {
        for (i, line) in plane.iter_mut().enumerate() {
            for (j, cell) in line.iter_mut().enumerate() {
                let anchor = [
                    (i as f64 - 1.0) * 0.3 + place[0],
                    (j as f64 - 1.0) * 0.3 + place[1],
                    level as f64 * 0.3 - 0.3,
                ];
                let distance = |p: &Row| (0..3).map(|k| (p[k] - anchor[k]).powi(2)).sum::<f64>();
                let mut order: Vec<&Row> = points.iter().collect();
                order.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
                let rows: Vec<Row> = order
                    .iter()
                    .take(neighbours)
                    .map(|p| {
                        let offset: Row = (0..3).map(|k| p[k] - anchor[k]).collect();
                        w.layers("anchor", &[&anchor[..], &offset, &p[3..]].concat())
                    })
                    .collect();
                *cell = w.pool("anchor_pool", &rows, 64);
            }
        }
    }
    // Every level as one row, then three convolutions along the height.
    let mut rows: Vec<Row> = volume
        .iter()
        .map(|plane| plane.iter().flatten().flatten().copied().collect())
        .collect();
    for (index, size) in [3, 5, 3].into_iter().enumerate() {
        rows = (0..=rows.len() - size)
            .map(|at| w.layer(&format!("volume.{index}"), &rows[at..at + size].concat()))
            .collect();
    }
    rows.remove(0)
}

#[test]
fn the_network_equals_its_definition() {
    let device = burn::tensor::Device::flex();
    device.seed(5);
    let config = PoseConfig {
        neighbours: 3,
        ..PoseConfig::paper()
    };
    let net = PoseNet::new(&config, &device);
    // Statistics and factors other than zero and one, as after a training.
    let mut weights = collect_params(&net);
    for (path, tensor) in &mut weights {
        if path.contains(".norm.") {
            for (i, v) in tensor.values.iter_mut().enumerate() {
                *v += 0.3 * ((i as f32 + path.len() as f32) * 0.9).sin().abs();
            }
        }
    }
    let net = replace_params(net, weights.clone());
    let n_points = 6;
    let value = |frame: usize, point: usize, i: usize| {
        ((frame * 11 + point * 5 + i * 3) as f32 * 0.37).sin() + if i == 1 { 2.0 } else { 0.0 }
    };
    let frames: Vec<Vec<Row>> = (0..3)
        .map(|f| {
            let point = |p: usize| {
                (0..POINT_INPUTS)
                    .map(|i| f64::from(value(f, p, i)))
                    .collect()
            };
            (0..n_points).map(point).collect()
        })
        .collect();
    let batch = PoseBatch {
        n_clips: 1,
        n_frames: 3,
        n_points,
        points: frames
            .iter()
            .flatten()
            .flatten()
            .map(|v| *v as f32)
            .collect(),
        exists: vec![1.0; 3 * n_points],
    };
    let (expected, places) = outputs(&Weights(weights), &frames, 3);
    let out = net.forward(&batch, None);
    let host = |data: burn::tensor::TensorData| data.try_into_vec::<f32>().unwrap();
    for (found, expected) in host(out.place.into_data()).iter().zip(places.concat()) {
        assert!(
            (f64::from(*found) - expected).abs() < 1e-5,
            "{found} {expected}"
        );
    }
    let heights = host(out.log_height.into_data());
    let joints = host(out.joints.into_data());
    let first_columns = host(out.rotations.columns[0].clone().into_data());
    for (frame, expected) in expected.iter().enumerate() {
        assert!((f64::from(heights[frame]) - expected[135]).abs() < 1e-5);
        for axis in 0..3 {
            let root = f64::from(joints[frame * 66 + axis]);
            assert!((root - expected[132 + axis]).abs() < 1e-5, "{root}");
        }
        for joint in 0..22 {
            let six = &expected[6 * joint..6 * joint + 3];
            let length = six.iter().map(|v| v * v).sum::<f64>().sqrt();
            for axis in 0..3 {
                let found = f64::from(first_columns[(frame * 22 + joint) * 3 + axis]);
                assert!((found - six[axis] / length).abs() < 1e-4, "{joint} {found}");
            }
        }
    }
}
