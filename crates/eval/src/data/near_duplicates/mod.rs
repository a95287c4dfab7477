//! Finds held-out motions that are nearly the same as a training motion, whatever their place, heading and body
//! size, also if mirrored, shifted, cut, a little faster or slower, or a little noisy.
//!
//! **What is compared.** A clip becomes 10 poses a second, averaged over a quarter of a second: the unit
//! vectors of twelve body segments and the velocity of the pelvis in leg lengths per second. Directions
//! do not depend on place and size. Two windows are compared frame by frame after the one turn about the
//! vertical that fits them best, which has a closed form, so the heading cancels and turning does not.
//!
//! **Distance.** Root mean square difference of the vectors, in rad for small ones: 0 for a copy. Windows
//! that hardly move are not judged, because all people who stand still look alike.
//!
//! **Threshold.** Procedural motions are the hard case, because one program performs them all: a test fall
//! differs from the nearest of a thousand training falls by little more than a degree. [`LEAK_DISTANCE`] lies
//! between the two distributions of docs/guides/dataset.md. Noise of up to 4 mm on every coordinate still
//! lies below it. Noise of 2 cm lies far above: such a copy cannot be distinguished from another performance.
//!
//! **Search.** The cost of comparing all pairs at all shifts grows with the square of the data. Instead, the most
//! unusual moment of every fifth of a held-out clip is looked up in a k-d tree over moments of all training clips
//! (heights and angles of segments at three instants, which no turn changes). The neighbours propose shifts; only
//! these are compared, and the best of them are refined in shift and speed.
//!
//! ```
//! use radarllm_eval::near_duplicates::{LEAK_DISTANCE, MotionClip, MotionSketch, nearest_motions};
//!
//! // Four seconds of joints that swing, each at its own pace.
//! let dance = |pace: f32| -> Vec<[[f32; 3]; 22]> {
//!     let joint = |i: usize, j: usize, axis: usize| {
//!         0.08 * j as f32 + 0.15 * (i as f32 * 0.05 * (pace + (j % 5) as f32) + (j + axis) as f32).sin()
//!     };
//!     (0..80).map(|i| std::array::from_fn(|j| std::array::from_fn(|axis| joint(i, j, axis)))).collect()
//! };
//! let sketch = |id, joints: &[_]| MotionSketch::of(MotionClip { id, fps: 20.0, joints }).unwrap();
//! let train = [sketch("train-1", &dance(2.0)), sketch("train-2", &dance(3.1))];
//! // A test motion that is a part of the second training motion.
//! let found = nearest_motions(&train, &[sketch("test-1", &dance(3.1)[10..70])]);
//! let nearest = found[0].as_ref().unwrap();
//! assert_eq!(nearest.train_id, "train-2");
//! assert!(nearest.distance < LEAK_DISTANCE);
//! ```

mod kd_tree;
mod sketch;

use radarllm_base::seed::derive_seed;
use serde::Serialize;

use kd_tree::KdTree;
use sketch::{DIM, MIN_OVERLAP, N_MOMENT, N_SEGMENTS, RATE_HZ, WIDTH};

pub use sketch::{MotionClip, MotionSketch};

/// Least motion of a window that is judged, as root mean square deviation of a segment's direction, rad.
pub const MIN_MOTION: f64 = 0.1;
/// Distances below this are a leak, rad; measured in `tests/it/near_duplicates.rs`.
pub const LEAK_DISTANCE: f64 = 0.01;
/// Change of speed that is tried, either way.
const MAX_SPEED_CHANGE: f64 = 0.1;
/// Change of speed that is tried with a shift by one frame.
const SPEED_STEP: f64 = 0.02;
/// Shift at which refinement ends, frames: three milliseconds.
const MIN_STEP: f64 = 0.03;
/// Parts of a held-out clip that each name a moment: an overlap of half the clip holds one of them whole.
const N_PARTS: usize = 5;
/// Training moments looked at for each held-out moment.
const N_NEIGHBOURS: usize = 48;
/// Proposals that are compared at all speeds.
const N_REFINED: usize = 12;

/// The training motion that is nearest to a held-out one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NearestMotion {
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

/// The nearest training motion of every held-out one; `None` where nothing overlaps long enough or moves.
///
/// With N training moments (five a second) and M held-out clips: about N log N + M log N steps, and 200
/// bytes a moment.
pub fn nearest_motions(
    train: &[MotionSketch],
    held_out: &[MotionSketch],
) -> Vec<Option<NearestMotion>> {
    let signs: Vec<[f32; DIM]> = (0..N_MOMENT)
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
    let tree = KdTree::new(points);
    held_out
        .iter()
        .map(|sketch| {
            let found = [(false, sketch.clone()), (true, sketch.mirrored())]
                .into_iter()
                .filter_map(|(mirrored, sketch)| {
                    let proposals = propose(&sketch, &tree, &places, &middle, &signs);
                    let best = best(&sketch, train, proposals)?;
                    Some(NearestMotion { mirrored, ..best })
                });
            found.min_by(|a, b| a.distance.total_cmp(&b.distance))
        })
        .collect()
}

/// Places to lay a clip on training clips: (clip, training frame under the held-out frame 0).
fn propose(
    sketch: &MotionSketch,
    tree: &KdTree,
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
fn best(
    sketch: &MotionSketch,
    train: &[MotionSketch],
    proposals: Vec<(u32, i32)>,
) -> Option<NearestMotion> {
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
            while step > MIN_STEP {
                let mut moved = false;
                for (shift_step, speed_step) in [
                    (step, 0.0),
                    (-step, 0.0),
                    (0.0, step * SPEED_STEP),
                    (0.0, -step * SPEED_STEP),
                ] {
                    let faster = speed + speed_step;
                    if (faster - 1.0_f64).abs() > MAX_SPEED_CHANGE {
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
            Some(NearestMotion {
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
    let min = (MIN_OVERLAP as f64).max(0.5 * shorter).ceil() as usize;
    let last = (b.len() - 1) as f64;
    let first = (-shift / speed - 1e-9).ceil().max(0.0) as usize;
    let end = (((last - shift) / speed + 1e-9).floor() + 1.0).clamp(0.0, a.len() as f64) as usize;
    let n = end.checked_sub(first).filter(|&n| n >= min)?;
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

    fn sketch(id: &str, joints: &[[[f32; 3]; 22]]) -> MotionSketch {
        let clip = MotionClip {
            id,
            fps: 20.0,
            joints,
        };
        MotionSketch::of(clip).unwrap()
    }

    #[test]
    fn copies_are_found_whatever_was_done_to_them() {
        let train: Vec<Vec<[[f32; 3]; 22]>> = (0..40).map(|i| dance(100 + i, 120)).collect();
        let sketches: Vec<MotionSketch> = train
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
            let found = nearest_motions(&sketches, &[sketch("x", &joints)]);
            let found = found[0].as_ref().unwrap();
            assert_eq!(
                (found.train_id.as_str(), found.mirrored),
                ("t17", is_mirror),
                "{what}"
            );
            assert!(found.distance < LEAK_DISTANCE, "{what}: {found:?}");
        }
        let cut = nearest_motions(&sketches, &[sketch("x", &original[30..95])]);
        // To a hundredth of a second; motion at 1 rad/s would else add as much distance as the threshold.
        assert!(
            (cut[0].as_ref().unwrap().shift_s - 1.5).abs() < 0.01,
            "{cut:?}"
        );
        // Other dances are far.
        let other = nearest_motions(&sketches, &[sketch("x", &dance(7, 120))]);
        assert!(
            other[0].as_ref().is_none_or(|n| n.distance > 0.5),
            "{other:?}"
        );
    }

    #[test]
    fn what_cannot_be_judged_is_left_out() {
        let still = vec![dance(1, 1)[0]; 60];
        let moving = dance(1, 60);
        let found = nearest_motions(&[sketch("a", &still)], &[sketch("b", &still)]);
        assert_eq!(found, [None]);
        assert_eq!(nearest_motions(&[], &[sketch("b", &moving)]), [None]);
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
            assert!(MotionSketch::of(wrong).is_none());
        }
    }
}
