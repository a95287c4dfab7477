//! Is a held-out motion nearly the same as a training motion? Found whatever the place, heading and body
//! size, mirrored or not, shifted, cut, a little faster or slower, a little noisy.
//!
//! **What is compared.** A clip becomes 10 poses a second, averaged over a quarter of a second: the unit
//! vectors of twelve body segments and the velocity of the pelvis in leg lengths per second. Directions
//! do not know place and size. Two windows are compared frame by frame after the one turn about the
//! vertical that suits them best, which has a closed form, so heading cancels and turning does not.
//!
//! **Distance.** Root mean square difference of the vectors, in rad for small ones: 0 for a copy. Windows
//! that hardly move are not judged: all people who stand still look alike.
//!
//! **Threshold.** Procedural motions are the hard case, because one program performs them all: a test fall
//! differs from the nearest of a thousand training falls by little more than a degree. `LEAK_DISTANCE` lies
//! between the two distributions of docs/dataset.md. Noise of up to 4 mm on every coordinate still
//! lies below it, noise of 2 cm far above: such a copy is not told from another performance.
//!
//! **Search.** Comparing all pairs at all shifts grows with the square of the data. Instead, every fifth
//! of a held-out clip names its most unusual moment; a k-d tree over moments of all training clips (heights
//! and angles of segments at three instants, which no turn changes) proposes places to lay the clips on
//! each other, and only these are compared, the best of them refined in shift and speed.

use std::collections::BinaryHeap;

use radarllm_base::seed::derive_seed;
use serde::Serialize;

/// Poses per second that are compared.
const RATE_HZ: f64 = 10.0;
/// Half of the averaging window, s: takes the edge off noise of single joints.
const SMOOTH_S: f64 = 0.125;
/// Half of the time over which the pelvis' velocity is taken, s.
const VELOCITY_S: f64 = 0.1;
/// Left out at both ends of a clip, s.
const EDGE_S: f64 = SMOOTH_S + VELOCITY_S;
/// Weight of the velocity against a segment: walking, 1.5 leg lengths per second, is as long as a segment.
const VELOCITY_WEIGHT: f32 = 0.6;
/// Shortest overlap judged, frames.
const MIN_OVERLAP: usize = 10;
/// Least motion of a window that is judged, as root mean square deviation of a segment's direction, rad.
pub const MIN_MOTION: f64 = 0.1;
/// Distances below this are a leak, rad; measured in `crates/synth/tests/it/leakage.rs`.
pub const LEAK_DISTANCE: f64 = 0.01;
/// Change of speed that is tried, either way.
const MOST_SPEED_CHANGE: f64 = 0.1;
/// Change of speed that is tried with a shift by one frame.
const SPEED_STEP: f64 = 0.02;
/// Shift at which refinement ends, frames: three milliseconds.
const SMALLEST_STEP: f64 = 0.03;
/// Parts of a held-out clip that each name a moment: an overlap of half the clip holds one of them whole.
const N_PARTS: usize = 5;
/// Instants of a moment, frames from its middle.
const INSTANTS: [isize; 3] = [-3, 0, 3];
/// Training moments looked at for each held-out moment.
const N_NEIGHBOURS: usize = 48;
/// Proposals that are compared at all speeds.
const N_REFINED: usize = 12;

/// Body segments by joint, from and to: trunk, head, upper arms, forearms, thighs, shanks, and the lines
/// across hips and shoulders. Left and right stand side by side, left first.
const SEGMENTS: [(usize, usize); N_SEGMENTS] = [
    (0, 12),
    (12, 15),
    (16, 18),
    (17, 19),
    (18, 20),
    (19, 21),
    (1, 4),
    (2, 5),
    (4, 7),
    (5, 8),
    (2, 1),
    (17, 16),
];
const N_SEGMENTS: usize = 12;
/// Where a segment comes from in the mirror; lines across also change their direction.
const MIRRORED: [usize; N_SEGMENTS] = [0, 1, 3, 2, 5, 4, 7, 6, 9, 8, 10, 11];
const N_ACROSS: usize = 2;
/// Segments whose angle to each other describes a pose.
const ANGLES: [(usize, usize); 10] = [
    (2, 3),
    (2, 4),
    (3, 5),
    (6, 7),
    (6, 8),
    (7, 9),
    (11, 2),
    (11, 3),
    (10, 6),
    (10, 7),
];
/// Segments and the velocity, xyz each.
const WIDTH: usize = 3 * (N_SEGMENTS + 1);
/// Numbers that describe a pose without its heading.
const N_SHAPE: usize = N_SEGMENTS + ANGLES.len();
/// Dimensions of the tree: random signed sums of a moment's numbers keep neighbours near (Johnson and
/// Lindenstrauss 1984), and a tree in all 66 of them would be no better than a list.
const DIM: usize = 12;

/// Joints of a clip, as a data set stores them.
#[derive(Clone, Copy)]
pub struct MotionClip<'a> {
    /// Name in the result.
    pub id: &'a str,
    /// Poses per second.
    pub fps: f64,
    /// 22 joints, m, z up: `[frame][joint][xyz]`.
    pub joints: &'a [[[f32; 3]; 22]],
}

/// Directions over time, 10 frames a second.
#[derive(Clone)]
pub struct Sketch {
    id: String,
    frames: Vec<[f32; WIDTH]>,
}

/// The training motion that is nearest to a held-out one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Nearest {
    /// Held-out clip.
    pub id: String,
    /// Training clip.
    pub train_id: String,
    /// See the module: 0 for a copy, rad.
    pub distance: f64,
    /// Whether the held-out clip's mirror image was nearer than the clip itself.
    pub mirrored: bool,
    /// Time in the training clip at which the held-out one begins, s; negative if it begins earlier.
    pub shift_s: f64,
    /// Speed of the training clip relative to the held-out one.
    pub speed: f64,
    /// Length of the compared window, s.
    pub overlap_s: f64,
}

impl Sketch {
    /// Directions of a clip; `None` if it is shorter than a second, slower than 5 frames a second, or not
    /// finite.
    pub fn of(clip: MotionClip) -> Option<Self> {
        let MotionClip { id, fps, joints } = clip;
        let finite = || {
            joints
                .iter()
                .all(|p| p.as_flattened().iter().all(|v| v.is_finite()))
        };
        if !(5.0..=1000.0).contains(&fps) || joints.is_empty() || !finite() {
            return None;
        }
        let last = joints.len() - 1;
        // Averages near the ends would be of fewer poses than those of a copy that goes on there.
        let usable_s = last as f64 / fps - 2.0 * EDGE_S;
        let n_frames = (usable_s * RATE_HZ + 1e-6).floor() + 1.0;
        if n_frames < MIN_OVERLAP as f64 {
            return None;
        }
        let leg_m = leg_m(joints);
        let mean = |time_s: f64| -> [[f32; 3]; 22] {
            let at = |t: f64| ((t * fps).round().max(0.0) as usize).min(last);
            let (first, end) = (at(time_s - SMOOTH_S), at(time_s + SMOOTH_S));
            let n = (end - first + 1) as f32;
            std::array::from_fn(|joint| {
                std::array::from_fn(|axis| {
                    joints[first..=end]
                        .iter()
                        .map(|p| p[joint][axis])
                        .sum::<f32>()
                        / n
                })
            })
        };
        let frames = (0..n_frames as usize)
            .map(|i| {
                let time_s = EDGE_S + i as f64 / RATE_HZ;
                let pose = mean(time_s);
                let mut out = [0.0; WIDTH];
                for (k, (from, to)) in SEGMENTS.into_iter().enumerate() {
                    let d: [f32; 3] = std::array::from_fn(|a| pose[to][a] - pose[from][a]);
                    let length = d.iter().map(|v| v * v).sum::<f32>().sqrt().max(1e-6);
                    for axis in 0..3 {
                        out[3 * k + axis] = d[axis] / length;
                    }
                }
                let (a, b) = (mean(time_s - VELOCITY_S), mean(time_s + VELOCITY_S));
                for axis in 0..3 {
                    let mps = (b[0][axis] - a[0][axis]) / (2.0 * VELOCITY_S) as f32;
                    out[3 * N_SEGMENTS + axis] = VELOCITY_WEIGHT * mps / leg_m;
                }
                out
            })
            .collect();
        Some(Self {
            id: id.into(),
            frames,
        })
    }

    /// The same seen in a mirror.
    fn mirrored(&self) -> Self {
        let frames = self.frames.iter().map(|frame| {
            let mut out = *frame;
            for (k, &from) in MIRRORED.iter().enumerate() {
                let sign = if k >= N_SEGMENTS - N_ACROSS {
                    -1.0
                } else {
                    1.0
                };
                for axis in 0..3 {
                    out[3 * k + axis] = sign * frame[3 * from + axis];
                }
            }
            for x in out.iter_mut().step_by(3) {
                *x = -*x;
            }
            out
        });
        Self {
            id: self.id.clone(),
            frames: frames.collect(),
        }
    }

    /// Heights and angles around a frame, which no turn changes. Beyond the ends the last pose stays.
    fn moment(&self, frame: usize, signs: &[[f32; DIM]]) -> [f32; DIM] {
        let last = self.frames.len() as isize - 1;
        let mut out = [0.0; DIM];
        let mut row = 0;
        for instant in INSTANTS {
            let pose = &self.frames[(frame as isize + instant).clamp(0, last) as usize];
            let u = |k: usize| [pose[3 * k], pose[3 * k + 1], pose[3 * k + 2]];
            let heights = (0..N_SEGMENTS).map(|k| u(k)[2]);
            let angles = ANGLES.iter().map(|&(a, b)| {
                let (a, b) = (u(a), u(b));
                a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
            });
            for value in heights.chain(angles) {
                for (sum, sign) in out.iter_mut().zip(&signs[row]) {
                    *sum += sign * value;
                }
                row += 1;
            }
        }
        out
    }
}

/// Mean length of a leg, m.
fn leg_m(joints: &[[[f32; 3]; 22]]) -> f32 {
    let distance = |a: [f32; 3], b: [f32; 3]| -> f32 {
        a.iter()
            .zip(b)
            .map(|(u, v)| (u - v) * (u - v))
            .sum::<f32>()
            .sqrt()
    };
    let legs = joints.iter().map(|p| {
        let (left, right) = (
            distance(p[1], p[4]) + distance(p[4], p[7]),
            distance(p[2], p[5]) + distance(p[5], p[8]),
        );
        0.5 * (left + right)
    });
    (legs.sum::<f32>() / joints.len() as f32).max(0.05)
}

/// The nearest training motion of every held-out one; `None` where nothing overlaps long enough or moves.
///
/// With N training moments (five a second) and M held-out clips: about N log N + M log N steps, and 200
/// bytes a moment.
pub fn nearest(train: &[Sketch], held_out: &[Sketch]) -> Vec<Option<Nearest>> {
    let signs: Vec<[f32; DIM]> = (0..N_SHAPE * INSTANTS.len())
        .map(|row| {
            let bits = derive_seed(row as u64, "dataset/near");
            std::array::from_fn(|d| if bits >> d & 1 == 0 { 1.0 } else { -1.0 })
        })
        .collect();
    let mut places = Vec::new();
    let mut points = Vec::new();
    for (clip, sketch) in train.iter().enumerate() {
        for frame in (0..sketch.frames.len()).step_by(2) {
            places.push((clip as u32, frame as u32));
            points.push(sketch.moment(frame, &signs));
        }
    }
    if points.is_empty() {
        return vec![None; held_out.len()];
    }
    let mut middle = [0.0_f64; DIM];
    for point in &points {
        for (sum, v) in middle.iter_mut().zip(point) {
            *sum += f64::from(*v) / points.len() as f64;
        }
    }
    let tree = Tree::new(points);
    held_out
        .iter()
        .map(|sketch| {
            let found = [(false, sketch.clone()), (true, sketch.mirrored())]
                .into_iter()
                .filter_map(|(mirrored, sketch)| {
                    let proposals = propose(&sketch, &tree, &places, &middle, &signs);
                    let best = best(&sketch, train, proposals)?;
                    Some(Nearest { mirrored, ..best })
                });
            found.min_by(|a, b| a.distance.total_cmp(&b.distance))
        })
        .collect()
}

/// Places to lay a clip on training clips: (clip, training frame under the held-out frame 0).
fn propose(
    sketch: &Sketch,
    tree: &Tree,
    places: &[(u32, u32)],
    middle: &[f64; DIM],
    signs: &[[f32; DIM]],
) -> Vec<(u32, i32)> {
    let n = sketch.frames.len();
    let mut out = Vec::new();
    for part in 0..N_PARTS {
        let range = part * n / N_PARTS
            ..((part + 1) * n / N_PARTS)
                .max(part * n / N_PARTS + 1)
                .min(n);
        let unusual = range
            .map(|frame| (frame, sketch.moment(frame, signs)))
            .max_by(|a, b| off(&a.1, middle).total_cmp(&off(&b.1, middle)));
        let Some((frame, _)) = unusual else { continue };
        // Training moments stand at every second frame: a neighbour is asked too.
        for frame in [frame, (frame + 1).min(n - 1)] {
            for index in tree.nearest(&sketch.moment(frame, signs), N_NEIGHBOURS) {
                let (clip, at) = places[index as usize];
                out.push((clip, at as i32 - frame as i32));
            }
        }
    }
    out.sort_unstable();
    out.dedup();
    out
}

fn off(moment: &[f32; DIM], middle: &[f64; DIM]) -> f64 {
    let pairs = moment.iter().zip(middle);
    pairs.map(|(a, b)| (f64::from(*a) - b).powi(2)).sum()
}

/// Compares a clip at the proposed places, and refines the best of them in shift and speed.
fn best(sketch: &Sketch, train: &[Sketch], proposals: Vec<(u32, i32)>) -> Option<Nearest> {
    let mut coarse: Vec<(f64, u32, i32)> = proposals
        .into_iter()
        .filter_map(|(clip, shift)| {
            let other = &train[clip as usize].frames;
            let (distance, _) = compare(&sketch.frames, other, f64::from(shift), 1.0)?;
            Some((distance, clip, shift))
        })
        .collect();
    coarse.sort_by(|a, b| a.0.total_cmp(&b.0));
    let refined = coarse
        .iter()
        .take(N_REFINED)
        .filter_map(|&(_, clip, shift)| {
            let other = &train[clip as usize];
            let (mut at, mut speed, mut step) = (f64::from(shift), 1.0, 1.0);
            let (mut distance, mut overlap) = compare(&sketch.frames, &other.frames, at, speed)?;
            // Down the hill in shift and speed, in smaller and smaller steps.
            while step > SMALLEST_STEP {
                let mut moved = false;
                for (shift_step, speed_step) in [
                    (step, 0.0),
                    (-step, 0.0),
                    (0.0, step * SPEED_STEP),
                    (0.0, -step * SPEED_STEP),
                ] {
                    let faster = speed + speed_step;
                    if (faster - 1.0_f64).abs() > MOST_SPEED_CHANGE {
                        continue;
                    }
                    // Another speed turns about the middle of the held-out clip.
                    let middle = 0.5 * sketch.frames.len() as f64;
                    let there = at + shift_step - speed_step * middle;
                    match compare(&sketch.frames, &other.frames, there, faster) {
                        Some(found) if found.0 < distance => {
                            (distance, overlap) = found;
                            (at, speed, moved) = (there, faster, true);
                        }
                        _ => {}
                    }
                }
                if !moved {
                    step *= 0.5;
                }
            }
            Some(Nearest {
                id: sketch.id.clone(),
                train_id: other.id.clone(),
                distance,
                mirrored: false,
                shift_s: at / RATE_HZ,
                speed,
                overlap_s: overlap as f64 / RATE_HZ,
            })
        });
    refined.min_by(|a, b| a.distance.total_cmp(&b.distance))
}

/// Distance and overlap of a clip laid on another: frame i on frame `shift + speed i`. `None` if less than
/// half of the shorter clip or than a second overlaps, or the window hardly moves.
fn compare(a: &[[f32; WIDTH]], b: &[[f32; WIDTH]], shift: f64, speed: f64) -> Option<(f64, usize)> {
    let shorter = (a.len() as f64).min(b.len() as f64 / speed);
    let least = (MIN_OVERLAP as f64).max(0.5 * shorter).ceil() as usize;
    let last = (b.len() - 1) as f64;
    let first = (-shift / speed - 1e-9).ceil().max(0.0) as usize;
    let end = (((last - shift) / speed + 1e-9).floor() + 1.0).clamp(0.0, a.len() as f64) as usize;
    let n = end.checked_sub(first).filter(|&n| n >= least)?;
    let (mut squares, mut upright, mut along, mut across) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
    let (mut sum, mut own) = ([0.0_f32; WIDTH], 0.0_f64);
    for (i, u) in a.iter().enumerate().take(end).skip(first) {
        let at = (shift + speed * i as f64).clamp(0.0, last);
        let low = at as usize;
        // Catmull and Rom's cubic: straight lines between poses a tenth of a second apart would be off
        // by more than copies differ.
        let f = at.fract() as f32;
        let weights = [
            0.5 * f * (-1.0 + f * (2.0 - f)),
            1.0 + 0.5 * f * f * (3.0 * f - 5.0),
            0.5 * f * (1.0 + f * (4.0 - 3.0 * f)),
            0.5 * f * f * (f - 1.0),
        ];
        let pose = |offset: usize| &b[(low + offset).saturating_sub(1).min(b.len() - 1)];
        let poses = [pose(0), pose(1), pose(2), pose(3)];
        let (mut s, mut z, mut d, mut c, mut o) = (0.0_f32, 0.0_f32, 0.0_f32, 0.0_f32, 0.0_f32);
        for k in (0..WIDTH).step_by(3) {
            let v: [f32; 3] = std::array::from_fn(|x| {
                weights
                    .iter()
                    .zip(poses)
                    .map(|(w, pose)| w * pose[k + x])
                    .sum()
            });
            o += u[k] * u[k] + u[k + 1] * u[k + 1] + u[k + 2] * u[k + 2];
            s += v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
            z += u[k + 2] * v[2];
            d += u[k] * v[0] + u[k + 1] * v[1];
            c += u[k] * v[1] - u[k + 1] * v[0];
        }
        for (sum, v) in sum.iter_mut().zip(u) {
            *sum += v;
        }
        own += f64::from(o);
        squares += f64::from(s);
        upright += f64::from(z);
        along += f64::from(d);
        across += f64::from(c);
    }
    let per_segment = (N_SEGMENTS * n) as f64;
    let mean: f64 = sum.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / n as f64;
    let motion = ((own - mean) / per_segment).max(0.0).sqrt();
    if motion < MIN_MOTION {
        return None;
    }
    // The best turn makes the horizontal part of the product as large as its length.
    let left = own + squares - 2.0 * upright - 2.0 * along.hypot(across);
    Some(((left / per_segment).max(0.0).sqrt(), n))
}

/// A k-d tree over points, all in memory.
struct Tree {
    points: Vec<[f32; DIM]>,
    /// Points of node ranges, halved at every level.
    order: Vec<u32>,
    /// Where each node is cut; the halves of node i are nodes 2 i + 1 and 2 i + 2.
    cuts: Vec<f32>,
}

/// Points that are looked at one by one.
const LEAF: usize = 16;

/// A part of the tree: its points, its number and the axis that it is cut along.
#[derive(Clone, Copy)]
struct Node {
    low: usize,
    high: usize,
    number: usize,
    axis: usize,
}

impl Node {
    fn is_leaf(self) -> bool {
        self.high - self.low <= LEAF
    }

    fn halves(self) -> [Node; 2] {
        let middle = self.low + (self.high - self.low) / 2;
        let half = |low, high, number| Node {
            low,
            high,
            number,
            axis: (self.axis + 1) % DIM,
        };
        [
            half(self.low, middle, 2 * self.number + 1),
            half(middle, self.high, 2 * self.number + 2),
        ]
    }
}

impl Tree {
    fn new(points: Vec<[f32; DIM]>) -> Self {
        let order: Vec<u32> = (0..points.len() as u32).collect();
        let mut tree = Self {
            points,
            order,
            cuts: Vec::new(),
        };
        let mut nodes = vec![tree.root()];
        while let Some(node) = nodes.pop() {
            if node.is_leaf() {
                continue;
            }
            let [left, right] = node.halves();
            let value = |index: u32| tree.points[index as usize][node.axis];
            let (_, middle, _) = tree.order[node.low..node.high]
                .select_nth_unstable_by(left.high - left.low, |&a, &b| {
                    value(a).total_cmp(&value(b))
                });
            let cut = value(*middle);
            if tree.cuts.len() <= node.number {
                tree.cuts.resize(node.number + 1, 0.0);
            }
            tree.cuts[node.number] = cut;
            nodes.extend([left, right]);
        }
        tree
    }

    fn root(&self) -> Node {
        Node {
            low: 0,
            high: self.order.len(),
            number: 0,
            axis: 0,
        }
    }

    /// Indices of the `k` nearest points.
    fn nearest(&self, query: &[f32; DIM], k: usize) -> Vec<u32> {
        let mut found = BinaryHeap::with_capacity(k + 1);
        self.visit(query, k, self.root(), &mut found);
        found.into_iter().map(|near: Near| near.index).collect()
    }

    fn visit(&self, query: &[f32; DIM], k: usize, node: Node, found: &mut BinaryHeap<Near>) {
        let worst = |found: &BinaryHeap<Near>| match found.peek() {
            Some(near) if found.len() >= k => near.square,
            _ => f32::INFINITY,
        };
        if node.is_leaf() {
            for &index in &self.order[node.low..node.high] {
                let pairs = query.iter().zip(&self.points[index as usize]);
                let square: f32 = pairs.map(|(a, b)| (a - b) * (a - b)).sum();
                if square < worst(found) {
                    found.push(Near { square, index });
                    if found.len() > k {
                        found.pop();
                    }
                }
            }
            return;
        }
        let beyond = query[node.axis] - self.cuts[node.number];
        let [left, right] = node.halves();
        let (near, far) = if beyond < 0.0 {
            (left, right)
        } else {
            (right, left)
        };
        self.visit(query, k, near, found);
        // Points as far as the cut itself may lie on either side of it.
        if beyond * beyond < worst(found) {
            self.visit(query, k, far, found);
        }
    }
}

/// A neighbour; the farthest is the greatest.
#[derive(PartialEq)]
struct Near {
    square: f32,
    index: u32,
}

impl Eq for Near {}

impl PartialOrd for Near {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Near {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        (self.square.total_cmp(&other.square)).then(self.index.cmp(&other.index))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn draws(seed: u64) -> impl FnMut() -> f32 {
        let mut n = 0_u64;
        move || {
            n += 1;
            (derive_seed(seed, &n.to_string()) >> 40) as f32 / (1_u64 << 23) as f32 - 1.0
        }
    }

    #[test]
    fn the_tree_finds_what_a_list_finds() {
        let mut draw = draws(1);
        // Few distinct values, so that there are many ties on every axis.
        let points: Vec<[f32; DIM]> = (0..700)
            .map(|_| std::array::from_fn(|_| (draw() * 3.0).round()))
            .collect();
        let tree = Tree::new(points.clone());
        for _ in 0..50 {
            let query: [f32; DIM] = std::array::from_fn(|_| draw() * 3.0);
            let square = |p: &[f32; DIM]| -> f32 {
                p.iter().zip(&query).map(|(a, b)| (b - a) * (b - a)).sum()
            };
            let mut expected: Vec<f32> = points.iter().map(square).collect();
            expected.sort_by(f32::total_cmp);
            let mut found: Vec<f32> = tree
                .nearest(&query, 20)
                .iter()
                .map(|&i| square(&points[i as usize]))
                .collect();
            found.sort_by(f32::total_cmp);
            assert_eq!(found, expected[..20]);
        }
        assert_eq!(
            Tree::new(points[..3].to_vec())
                .nearest(&[0.0; DIM], 20)
                .len(),
            3
        );
    }

    /// Joints that swing about a standing body, each at its own pace.
    fn dance(seed: u64, n: usize) -> Vec<[[f32; 3]; 22]> {
        let mut draw = draws(seed);
        let rest: [[f32; 3]; 22] = std::array::from_fn(|j| {
            [
                0.3 * ((j % 3) as f32 - 1.0),
                3.0 + 0.01 * j as f32,
                0.08 * j as f32,
            ]
        });
        let swing: [[f32; 6]; 22] = std::array::from_fn(|_| std::array::from_fn(|_| draw()));
        (0..n)
            .map(|i| {
                let t = i as f32 / 20.0;
                std::array::from_fn(|j| {
                    std::array::from_fn(|a| {
                        rest[j][a] + 0.15 * (t * (2.0 + swing[j][a]) + 3.0 * swing[j][a + 3]).sin()
                    })
                })
            })
            .collect()
    }

    fn sketch(id: &str, joints: &[[[f32; 3]; 22]]) -> Sketch {
        let clip = MotionClip {
            id,
            fps: 20.0,
            joints,
        };
        Sketch::of(clip).unwrap()
    }

    #[test]
    fn copies_are_found_whatever_was_done_to_them() {
        let train: Vec<Vec<[[f32; 3]; 22]>> = (0..40).map(|i| dance(100 + i, 120)).collect();
        let sketches: Vec<Sketch> = train
            .iter()
            .enumerate()
            .map(|(i, joints)| sketch(&format!("t{i}"), joints))
            .collect();
        let original = &train[17];
        let turn = |joints: &[[[f32; 3]; 22]]| -> Vec<[[f32; 3]; 22]> {
            let (s, c) = 2.1_f32.sin_cos();
            let moved = |p: &[f32; 3]| {
                [
                    1.1 * (c * p[0] - s * p[1]) + 0.7,
                    1.1 * (s * p[0] + c * p[1]) - 0.4,
                    1.1 * p[2] + 0.2,
                ]
            };
            joints
                .iter()
                .map(|pose| pose.each_ref().map(moved))
                .collect()
        };
        let swap: [usize; 22] = [
            0, 2, 1, 3, 5, 4, 6, 8, 7, 9, 11, 10, 12, 14, 13, 15, 17, 16, 19, 18, 21, 20,
        ];
        let mirror: Vec<[[f32; 3]; 22]> = original
            .iter()
            .map(|pose| {
                std::array::from_fn(|j| {
                    let [x, y, z] = pose[swap[j]];
                    [-x, y, z]
                })
            })
            .collect();
        for (what, joints, is_mirror) in [
            ("copy", original.clone(), false),
            ("turned, moved, of another size", turn(original), false),
            ("cut", original[30..95].to_vec(), false),
            ("mirrored", mirror.clone(), true),
            ("mirrored and turned", turn(&mirror), true),
        ] {
            let found = nearest(&sketches, &[sketch("x", &joints)]);
            let found = found[0].as_ref().unwrap();
            assert_eq!(
                (found.train_id.as_str(), found.mirrored),
                ("t17", is_mirror),
                "{what}"
            );
            assert!(found.distance < LEAK_DISTANCE, "{what}: {found:?}");
        }
        let cut = nearest(&sketches, &[sketch("x", &original[30..95])]);
        // To a hundredth of a second; motion at 1 rad/s would else add as much distance as the threshold.
        assert!(
            (cut[0].as_ref().unwrap().shift_s - 1.5).abs() < 0.01,
            "{cut:?}"
        );
        // Other dances are far.
        let other = nearest(&sketches, &[sketch("x", &dance(7, 120))]);
        assert!(
            other[0].as_ref().is_none_or(|n| n.distance > 0.5),
            "{other:?}"
        );
    }

    #[test]
    fn what_cannot_be_judged_is_left_out() {
        let still = vec![dance(1, 1)[0]; 60];
        let moving = dance(1, 60);
        let found = nearest(&[sketch("a", &still)], &[sketch("b", &still)]);
        assert_eq!(found, [None]);
        assert_eq!(nearest(&[], &[sketch("b", &moving)]), [None]);
        let clip = |fps, joints| MotionClip {
            id: "c",
            fps,
            joints,
        };
        let mut broken = moving.clone();
        broken[3][4][1] = f32::NAN;
        for wrong in [
            clip(20.0, &moving[..10]),
            clip(20.0, &[]),
            clip(0.001, &moving),
            clip(f64::NAN, &moving),
            clip(20.0, &broken),
        ] {
            assert!(Sketch::of(wrong).is_none());
        }
    }
}
