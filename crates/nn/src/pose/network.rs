//! The network.

use burn::module::Module;
use burn::nn::{Linear, LinearConfig};
use burn::tensor::activation::relu;
use burn::tensor::{Device, Int, Tensor, TensorData};
use radarllm_base::skeleton::N_JOINTS;
use radarllm_base::stats::median_upper;

use super::config::{POINT_INPUTS, PoseConfig, REFERENCE_HEIGHT_M};
use super::kinematics::Rotations;
use super::layers::{Lstm, NormLayer, Pool, PosePass};

/// Inputs of a point that are repeated behind the base layers: x, y, height, velocity.
const REPEATED: usize = 4;
/// Anchors along the height and along either horizontal axis.
const GRID: [usize; 3] = [9, 3, 3];
/// Distance between neighbouring anchors, m.
const GRID_STEP_M: f32 = 0.3;
/// Height of the lowest anchors above the floor, m.
const GRID_BOTTOM_M: f32 = -0.3;
/// Anchors of a frame.
const N_ANCHORS: usize = GRID[0] * GRID[1] * GRID[2];
/// Layers of each LSTM.
const LSTM_LAYERS: usize = 3;
/// Values of a frame: six of each joint's rotation, the translation, the logarithm of the height.
const N_OUTPUTS: usize = 6 * N_JOINTS + 3 + 1;

/// Frames of several clips, filled up to one number of frames and points.
#[derive(Clone, Debug)]
pub struct PoseBatch {
    /// Clips.
    pub n_clips: usize,
    /// Frames of a clip.
    pub n_frames: usize,
    /// Points of a frame.
    pub n_points: usize,
    /// `[clip][frame][point][POINT_INPUTS]`.
    pub points: Vec<f32>,
    /// 1 for a point, 0 for filling: `[clip][frame][point]`.
    pub exists: Vec<f32>,
}

/// What the network says of every frame.
#[derive(Debug)]
pub struct PoseOutput {
    /// Rotations of the joints.
    pub rotations: Rotations,
    /// Positions of the joints, `[clips * frames, N_JOINTS, 3]`, m; z is the height above the floor.
    pub joints: Tensor<3>,
    /// Place of the person on the floor by the global branch, `[clips * frames, 2]`, m.
    pub place: Tensor<2>,
    /// Logarithm of the height of the body over [`REFERENCE_HEIGHT_M`], `[clips * frames, 1]`.
    pub log_height: Tensor<2>,
}

/// The network of mmMesh on 22 joints.
#[derive(Module, Debug)]
pub struct PoseNet {
    base: Vec<NormLayer>,
    global: Vec<NormLayer>,
    global_pool: Pool,
    global_lstm: Lstm,
    place_hidden: Linear,
    place: Linear,
    anchor: Vec<NormLayer>,
    anchor_pool: Pool,
    /// Convolutions along the height, of 3, 5 and 3 anchors. The first one covers the horizontal grid.
    volume: Vec<NormLayer>,
    anchor_lstm: Lstm,
    head_hidden: Linear,
    head: Linear,
    #[module(skip)]
    neighbours: usize,
    #[module(skip)]
    relative_translation: bool,
    #[module(skip)]
    centred: bool,
}

/// Anchors per window of the three convolutions.
const WINDOWS: [usize; 3] = [3, 5, 3];

impl PoseNet {
    /// Random weights, drawn from `device`'s generator.
    pub fn new(config: &PoseConfig, device: &Device) -> Self {
        Self::with_outputs(config, N_OUTPUTS, device)
    }

    fn with_outputs(config: &PoseConfig, n_outputs: usize, device: &Device) -> Self {
        let w = config.width;
        let layers = |widths: &[usize]| {
            let pairs = widths.windows(2);
            pairs
                .map(|p| NormLayer::new(p[0], p[1], device))
                .collect::<Vec<_>>()
        };
        let point = 24 * w + REPEATED;
        let state = 64 * w;
        let linear = |from: usize, to: usize| LinearConfig::new(from, to).init(device);
        let horizontal = GRID[1] * GRID[2];
        let volume = [
            (WINDOWS[0] * horizontal * state, 96 * w),
            (WINDOWS[1] * 96 * w, 128 * w),
            (WINDOWS[2] * 128 * w, state),
        ];
        Self {
            base: layers(&[POINT_INPUTS, 8 * w, 16 * w, 24 * w]),
            global: layers(&[point, 32 * w, 48 * w, state]),
            global_pool: Pool::new(state, device),
            global_lstm: Lstm::new(state, LSTM_LAYERS, device),
            place_hidden: linear(state, 16 * w),
            place: linear(16 * w, 2),
            anchor: layers(&[point + 3, 32 * w, 48 * w, state]),
            anchor_pool: Pool::new(state, device),
            volume: volume
                .map(|(from, to)| NormLayer::new(from, to, device))
                .into(),
            anchor_lstm: Lstm::new(state, LSTM_LAYERS, device),
            head_hidden: linear(2 * state, 128 * w),
            head: linear(128 * w, n_outputs),
            neighbours: config.neighbours,
            relative_translation: config.relative_translation,
            centred: config.centred,
        }
    }

    /// Applies the network; with `pass`, as a step of training.
    pub fn forward(&self, batch: &PoseBatch, pass: Option<&mut PosePass>) -> PoseOutput {
        if !self.centred {
            return self.forward_as_given(batch, pass);
        }
        let centres = centres(batch);
        let mut moved = batch.clone();
        let (points, exists) = (&mut moved.points, &moved.exists);
        for (index, point) in points.chunks_exact_mut(POINT_INPUTS).enumerate() {
            let centre = centres[index / batch.n_points];
            if exists[index] > 0.0 {
                point[0] -= centre[0];
                point[1] -= centre[1];
            }
        }
        let out = self.forward_as_given(&moved, pass);
        let device = out.place.device();
        let n = centres.len();
        let flat: Vec<f32> = centres.iter().flatten().copied().collect();
        let centres = Tensor::<2>::from_data(TensorData::new(flat, [n, 2]), &device);
        let zero = Tensor::<2>::zeros([n, 1], &device);
        let shift = Tensor::cat(vec![centres.clone(), zero], 1).reshape([n, 1, 3]);
        PoseOutput {
            joints: out.joints + shift,
            place: out.place + centres,
            ..out
        }
    }

    /// The published forward pass, in the coordinates of `batch`.
    fn forward_as_given(&self, batch: &PoseBatch, mut pass: Option<&mut PosePass>) -> PoseOutput {
        let device = self.head.weight.val().device();
        let (n, frames, points) = (batch.n_clips, batch.n_frames, batch.n_points);
        let n_frames = n * frames;
        let rows = n_frames * points;
        let inputs = TensorData::new(batch.points.clone(), [rows, POINT_INPUTS]);
        let inputs = Tensor::<2>::from_data(inputs, &device);
        let exists = TensorData::new(batch.exists.clone(), [rows, 1]);
        let exists = Tensor::<2>::from_data(exists, &device);

        let mut x = inputs.clone();
        for layer in &self.base {
            x = layer.forward(x, &exists, pass.as_deref_mut());
        }
        // Positions and velocity first.
        let described = Tensor::cat(vec![inputs.slice([0..rows, 0..REPEATED]), x], 1);

        let mut x = described.clone();
        for layer in &self.global {
            x = layer.forward(x, &exists, pass.as_deref_mut());
        }
        let pooled = self.global_pool.forward(x, &exists, points);
        let [_, state] = pooled.dims();
        let sequence = pooled.reshape([n, frames, state]);
        let global = self.global_lstm.forward(sequence, pass.as_deref_mut());
        let global = global.reshape([n_frames, state]);
        let place = self
            .place
            .forward(relu(self.place_hidden.forward(global.clone())));

        let anchors = self.anchors(&described, &place, batch, pass.as_deref_mut());
        let sequence = anchors.reshape([n, frames, state]);
        let anchors = self.anchor_lstm.forward(sequence, pass);
        let anchors = anchors.reshape([n_frames, state]);

        let hidden = Tensor::cat(vec![global, anchors], 1);
        let out = self.head.forward(relu(self.head_hidden.forward(hidden)));
        let six = out.clone().slice([0..n_frames, 0..6 * N_JOINTS]);
        let mut root = out
            .clone()
            .slice([0..n_frames, 6 * N_JOINTS..6 * N_JOINTS + 3]);
        if self.relative_translation {
            let zero = Tensor::<2>::zeros([n_frames, 1], &device);
            root = root + Tensor::cat(vec![place.clone(), zero], 1);
        }
        let log_height = out.slice([0..n_frames, N_OUTPUTS - 1..N_OUTPUTS]);
        let rotations = Rotations::from_six(six.reshape([n_frames, N_JOINTS, 6]));
        // A body is neither smaller than 0.8 m nor larger than 3.6 m, whatever the first updates say.
        let height = log_height.clone().clamp(-0.75, 0.75).exp() * f64::from(REFERENCE_HEIGHT_M);
        PoseOutput {
            joints: rotations.joints(root, height),
            rotations,
            place,
            log_height,
        }
    }

    /// The anchor branch: `[frames, state]` from described points, `[frames * points, ..]`, and places, `[frames, 2]`.
    fn anchors(
        &self,
        described: &Tensor<2>,
        place: &Tensor<2>,
        batch: &PoseBatch,
        mut pass: Option<&mut PosePass>,
    ) -> Tensor<2> {
        let device = described.device();
        let [rows, width] = described.dims();
        let n_frames = batch.n_clips * batch.n_frames;
        let k = self.neighbours;
        let places: Vec<f32> = place
            .clone()
            .without_autodiff()
            .into_data()
            .try_into_vec()
            .unwrap_or_default();
        let grid = grid();
        let (mut indices, mut valid) = (Vec::new(), Vec::new());
        for frame in 0..n_frames {
            let at = frame * batch.n_points;
            let points: Vec<(usize, [f32; 3])> = (at..at + batch.n_points)
                .filter(|i| batch.exists[*i] > 0.0)
                .map(|i| {
                    (
                        i,
                        std::array::from_fn(|axis| batch.points[i * POINT_INPUTS + axis]),
                    )
                })
                .collect();
            let place = [places.get(2 * frame), places.get(2 * frame + 1)];
            let place = place.map(|v| v.copied().unwrap_or(0.0));
            for anchor in &grid {
                let anchor = [anchor[0] + place[0], anchor[1] + place[1], anchor[2]];
                nearest(&points, anchor, k, at, &mut indices, &mut valid);
            }
        }
        let groups = n_frames * N_ANCHORS;
        let indices = Tensor::<1, Int>::from_data(TensorData::new(indices, [groups * k]), &device);
        let valid = Tensor::<2>::from_data(TensorData::new(valid, [groups * k, 1]), &device);
        debug_assert_eq!(rows, n_frames * batch.n_points);
        let points = described.clone().select(0, indices);
        let flat: Vec<f32> = grid.iter().flatten().copied().collect();
        let grid = Tensor::<3>::from_data(TensorData::new(flat, [1, N_ANCHORS, 3]), &device);
        let zero = Tensor::<2>::zeros([n_frames, 1], &device);
        let at = Tensor::cat(vec![place.clone(), zero], 1).reshape([n_frames, 1, 3]);
        let anchors = (grid + at).reshape([groups, 1, 3]).repeat_dim(1, k);
        let anchors = anchors.reshape([groups * k, 3]);
        let offset = points.clone().slice([0..groups * k, 0..3]) - anchors.clone();
        let rest = points.slice([0..groups * k, 3..width]);
        let mut x = Tensor::cat(vec![anchors, offset, rest], 1);
        for layer in &self.anchor {
            x = layer.forward(x, &valid, pass.as_deref_mut());
        }
        let pooled = self.anchor_pool.forward(x, &valid, k);
        let [_, state] = pooled.dims();
        let mut x = pooled.reshape([n_frames, GRID[0], GRID[1] * GRID[2] * state]);
        for (layer, size) in self.volume.iter().zip(WINDOWS) {
            let [_, length, width] = x.dims();
            let windows = length + 1 - size;
            let shifted: Vec<Tensor<3>> = (0..size)
                .map(|i| x.clone().slice([0..n_frames, i..i + windows, 0..width]))
                .collect();
            let rows = Tensor::cat(shifted, 2).reshape([n_frames * windows, size * width]);
            let all = Tensor::<2>::ones([n_frames * windows, 1], &device);
            let out = layer.forward(rows, &all, pass.as_deref_mut());
            let [_, width] = out.dims();
            x = out.reshape([n_frames, windows, width]);
        }
        x.reshape([n_frames, state])
    }

    /// The network after a step of training: its running statistics follow those of the batch.
    pub fn follow(mut self, pass: PosePass) -> Self {
        let mut seen = pass.seen().into_iter();
        for layers in [
            &mut self.base,
            &mut self.global,
            &mut self.anchor,
            &mut self.volume,
        ] {
            for layer in layers.iter_mut() {
                if let Some(seen) = seen.next() {
                    layer.norm = layer.norm.clone().follow(seen);
                }
            }
        }
        self
    }
}

/// Whether a parameter is learned by gradients; the others are running statistics.
pub fn is_learned(path: &str) -> bool {
    !path.contains("running_")
}

/// Frames on either side whose points count for the centre of a frame.
const CENTRE_FRAMES: usize = 3;

/// Median x and y of the points about every frame, m; where there are none, those of the nearest frame that has some.
fn centres(batch: &PoseBatch) -> Vec<[f32; 2]> {
    let mut all = Vec::with_capacity(batch.n_clips * batch.n_frames);
    for clip in 0..batch.n_clips {
        let of_frame = |frame: usize| -> Option<[f32; 2]> {
            let first = frame.saturating_sub(CENTRE_FRAMES);
            let last = (frame + CENTRE_FRAMES + 1).min(batch.n_frames);
            let from = (clip * batch.n_frames + first) * batch.n_points;
            let to = (clip * batch.n_frames + last) * batch.n_points;
            let rows = || (from..to).filter(|row| batch.exists[*row] > 0.0);
            let median = |axis: usize| {
                median_upper(rows().map(|row| batch.points[row * POINT_INPUTS + axis]))
            };
            Some([median(0)?, median(1)?])
        };
        let known: Vec<Option<[f32; 2]>> = (0..batch.n_frames).map(of_frame).collect();
        for frame in 0..batch.n_frames {
            let away = |k: &usize| k.abs_diff(frame);
            let nearest = (0..batch.n_frames)
                .filter(|k| known[*k].is_some())
                .min_by_key(away);
            all.push(nearest.and_then(|k| known[k]).unwrap_or_default());
        }
    }
    all
}

/// Anchors about the origin, the height slowest: x, y, height, m.
fn grid() -> Vec<[f32; 3]> {
    let side = |i: usize| (i as f32 - 1.0) * GRID_STEP_M;
    let mut anchors = Vec::with_capacity(N_ANCHORS);
    for level in 0..GRID[0] {
        for i in 0..GRID[1] {
            for j in 0..GRID[2] {
                anchors.push([side(i), side(j), GRID_BOTTOM_M + level as f32 * GRID_STEP_M]);
            }
        }
    }
    anchors
}

/// Appends the rows of the `k` points nearest to an anchor, nearest first; missing ones are filled with row `filling`.
fn nearest(
    points: &[(usize, [f32; 3])],
    anchor: [f32; 3],
    k: usize,
    filling: usize,
    indices: &mut Vec<i64>,
    valid: &mut Vec<f32>,
) {
    let mut found: Vec<(f32, usize)> = points
        .iter()
        .map(|(row, p)| {
            let distance = p.iter().zip(anchor).map(|(a, b)| (a - b) * (a - b)).sum();
            (distance, *row)
        })
        .collect();
    let order = |a: &(f32, usize), b: &(f32, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
    if found.len() > k {
        found.select_nth_unstable_by(k - 1, order);
        found.truncate(k);
    }
    found.sort_unstable_by(order);
    for slot in 0..k {
        let row = found.get(slot);
        indices.push(row.map_or(filling, |f| f.1) as i64);
        valid.push(f32::from(u8::from(row.is_some())));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::collect_params;

    fn n_learned(net: &PoseNet) -> usize {
        let params = collect_params(net);
        let learned = params.iter().filter(|(path, _)| is_learned(path));
        learned.map(|(_, t)| t.values.len()).sum()
    }

    #[test]
    fn the_published_network_has_its_number_of_parameters() {
        let device = Device::flex();
        let config = PoseConfig::paper();
        // Nine rotations, translation, ten values of shape, gender.
        let published = PoseNet::with_outputs(&config, 9 * 6 + 3 + 10 + 1, &device);
        assert_eq!(n_learned(&published), 491_608);
        assert_eq!(n_learned(&PoseNet::new(&config, &device)), 500_380);
    }

    fn batch(n_frames: usize, n_points: usize, filled: usize) -> PoseBatch {
        let total = n_points + filled;
        let mut points = Vec::new();
        let mut exists = Vec::new();
        for frame in 0..n_frames {
            for point in 0..total {
                let value = |i: usize| ((frame * 7 + point * 3 + i) as f32 * 0.7).sin();
                points.extend(
                    (0..POINT_INPUTS).map(|i| if point < n_points { value(i) } else { 9.0 }),
                );
                exists.push(f32::from(u8::from(point < n_points)));
            }
        }
        PoseBatch {
            n_clips: 1,
            n_frames,
            n_points: total,
            points,
            exists,
        }
    }

    fn joints(net: &PoseNet, batch: &PoseBatch) -> Vec<f32> {
        net.forward(batch, None)
            .joints
            .into_data()
            .try_into_vec()
            .unwrap()
    }

    /// Filling must change nothing, in inference and in the statistics of training.
    #[test]
    fn filling_counts_for_nothing() {
        let device = Device::flex();
        device.seed(3);
        let net = PoseNet::new(&PoseConfig::paper(), &device);
        let (plain, filled) = (batch(3, 5, 0), batch(3, 5, 4));
        for (a, b) in joints(&net, &plain).iter().zip(joints(&net, &filled)) {
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
        let after = |batch: &PoseBatch| {
            let mut pass = PosePass::new(1);
            net.forward(batch, Some(&mut pass));
            let next = net.clone().follow(pass);
            collect_params(&next)
        };
        let (a, b) = (after(&plain), after(&filled));
        let before = collect_params(&net);
        let mut moved = 0;
        for (path, tensor) in &a {
            for (x, y) in tensor.values.iter().zip(&b[path].values) {
                assert!((x - y).abs() < 1e-4, "{path}: {x} {y}");
            }
            moved += usize::from(tensor.values != before[path].values);
        }
        // Mean and variance of twelve normalisations.
        assert_eq!(moved, 24);
    }

    #[test]
    fn frames_without_points_have_a_pose() {
        let device = Device::flex();
        device.seed(3);
        let net = PoseNet::new(&PoseConfig::paper(), &device);
        assert!(joints(&net, &batch(2, 0, 4)).iter().all(|v| v.is_finite()));
    }

    /// Where the person is in the room changes nothing but the place.
    #[test]
    fn a_centred_network_moves_with_the_points() {
        let device = Device::flex();
        device.seed(3);
        let config = PoseConfig {
            centred: true,
            ..PoseConfig::paper()
        };
        let net = PoseNet::new(&config, &device);
        let here = batch(3, 5, 2);
        let mut there = here.clone();
        for point in there.points.chunks_exact_mut(POINT_INPUTS) {
            point[0] += 0.5;
            point[1] -= 0.25;
        }
        let (a, b) = (joints(&net, &here), joints(&net, &there));
        for (p, q) in a.chunks_exact(3).zip(b.chunks_exact(3)) {
            assert!((q[0] - p[0] - 0.5).abs() < 1e-4, "{p:?} {q:?}");
            assert!((q[1] - p[1] + 0.25).abs() < 1e-4, "{p:?} {q:?}");
            assert!((q[2] - p[2]).abs() < 1e-4, "{p:?} {q:?}");
        }
    }

    #[test]
    fn the_nearest_points_come_first_and_missing_ones_are_marked() {
        let points = [
            (4, [0.0, 0.0, 1.0]),
            (5, [0.0, 0.0, 0.2]),
            (6, [3.0, 0.0, 0.0]),
        ];
        let (mut indices, mut valid) = (Vec::new(), Vec::new());
        nearest(&points, [0.0; 3], 2, 4, &mut indices, &mut valid);
        nearest(&points[..1], [0.0; 3], 2, 4, &mut indices, &mut valid);
        assert_eq!(indices, [5, 4, 4, 4]);
        assert_eq!(valid, [1.0, 1.0, 1.0, 0.0]);
    }
}
