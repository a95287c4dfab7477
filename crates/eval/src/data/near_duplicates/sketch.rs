//! What two motions are compared by: directions of body segments and the velocity of the pelvis.

/// Poses per second that are compared.
pub(super) const RATE_HZ: f64 = 10.0;
/// Half of the averaging window, s: takes the edge off noise of single joints.
const SMOOTH_S: f64 = 0.125;
/// Half of the time over which the pelvis' velocity is taken, s.
const VELOCITY_S: f64 = 0.1;
/// Left out at both ends of a clip, s.
const EDGE_S: f64 = SMOOTH_S + VELOCITY_S;
/// Weight of the velocity against a segment: walking, 1.5 leg lengths per second, is as long as a segment.
const VELOCITY_WEIGHT: f32 = 0.6;
/// Shortest overlap judged, frames.
pub(super) const MIN_OVERLAP: usize = 10;
/// Instants of a moment, frames from its middle.
const INSTANTS: [isize; 3] = [-3, 0, 3];
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
pub(super) const N_SEGMENTS: usize = 12;
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
pub(super) const WIDTH: usize = 3 * (N_SEGMENTS + 1);
/// Numbers that describe a pose without its heading.
const N_SHAPE: usize = N_SEGMENTS + ANGLES.len();
/// Numbers that describe a moment.
pub(super) const N_MOMENT: usize = N_SHAPE * INSTANTS.len();
/// Dimensions of the search: random signed sums of a moment's numbers keep neighbours near (Johnson and
/// Lindenstrauss 1984), and a tree in all 66 of them would be no better than a list.
pub(super) const DIM: usize = 12;

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

/// Directions of body segments over time, 10 frames a second: what motions are compared by.
#[derive(Clone)]
pub struct MotionSketch {
    pub(super) id: String,
    pub(super) frames: Vec<[f32; WIDTH]>,
}

impl MotionSketch {
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
    pub(super) fn mirrored(&self) -> Self {
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
    pub(super) fn moment(&self, frame: usize, signs: &[[f32; DIM]]) -> [f32; DIM] {
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
