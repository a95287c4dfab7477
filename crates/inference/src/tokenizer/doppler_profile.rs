//! Doppler profile of each step: statistics of points by radial velocity and height.
//!
//! A still torso and a moving arm belong to the same anchors but to different velocity classes. The sideways
//! displacement of the fast points from the slow ones distinguishes a left hand from a right one, wherever the person
//! stands. A network with maximum pooling over each tube must learn this feature; the profile contains it explicitly.

use super::grouping::Point;

/// Upper edges of the radial velocity classes, m/s: fast and slow approach, still, slow and fast
/// recession.
const VELOCITY_EDGES_MPS: [f32; 4] = [-0.8, -0.2, 0.2, 0.8];
/// Upper edges of the height classes above the floor, m: feet and lying, knees, hips, chest, head.
const HEIGHT_EDGES_M: [f32; 4] = [0.4, 0.8, 1.2, 1.6];
const N_VELOCITIES: usize = VELOCITY_EDGES_MPS.len() + 1;
const N_HEIGHTS: usize = HEIGHT_EDGES_M.len() + 1;
/// Per velocity class: count, mean x, y, z, spread of x and z.
const PER_VELOCITY: usize = 6;
/// Per (velocity, height): count, mean x.
const PER_CELL: usize = 2;

/// Number of values per step.
pub const PROFILE_DIM: usize = N_VELOCITIES * (PER_VELOCITY + N_HEIGHTS * PER_CELL);

/// Amplitude-weighted sums of points.
#[derive(Clone, Copy, Default)]
struct Sums {
    n: usize,
    weight: f32,
    at: [f32; 3],
    squares: [f32; 3],
}

impl Sums {
    fn add(&mut self, at: [f32; 3], weight: f32) {
        self.n += 1;
        self.weight += weight;
        for ((sum, square), v) in self.at.iter_mut().zip(&mut self.squares).zip(at) {
            *sum += weight * v;
            *square += weight * v * v;
        }
    }

    /// ln(1 + n) / 3: 0 without points, and 2.0 with three frames of 128 points.
    fn count(&self) -> f32 {
        (self.n as f32).ln_1p() / 3.0
    }

    /// Mean along an axis, limited to 4 m in both directions; 0 without points.
    fn mean(&self, axis: usize) -> f32 {
        match self.weight > 0.0 {
            true => (self.at[axis] / self.weight).clamp(-4.0, 4.0),
            false => 0.0,
        }
    }

    fn spread(&self, axis: usize) -> f32 {
        match self.weight > 0.0 {
            true => {
                let mean = self.at[axis] / self.weight;
                let variance = self.squares[axis] / self.weight - mean * mean;
                variance.max(0.0).sqrt().min(4.0)
            }
            false => 0.0,
        }
    }
}

/// Profile of one step's points around `centre` (x, y, m). Heights are relative to 1 m above the floor.
///
/// Weights are linear amplitudes. The velocity classes follow one another. Each has its own six values first and then
/// those of its height classes.
pub(super) fn doppler_profile<'a>(
    points: impl Iterator<Item = &'a Point>,
    centre: [f32; 2],
) -> [f32; PROFILE_DIM] {
    let mut of_velocity = [Sums::default(); N_VELOCITIES];
    let mut of_cell = [[Sums::default(); N_HEIGHTS]; N_VELOCITIES];
    for p in points {
        let class = |edges: &[f32; 4], value: f32| edges.iter().filter(|e| value >= **e).count();
        let velocity = class(&VELOCITY_EDGES_MPS, p.velocity_mps());
        let height = class(&HEIGHT_EDGES_M, p.at[2]);
        let at = [p.at[0] - centre[0], p.at[1] - centre[1], p.at[2] - 1.0];
        of_velocity[velocity].add(at, p.amplitude());
        of_cell[velocity][height].add(at, p.amplitude());
    }
    let mut out = [0.0; PROFILE_DIM];
    let mut slots = out.iter_mut();
    let mut write = |values: &[f32]| {
        // The values are the first iterator of the zip. If the slots were first, the zip would consume one more than it
        // fills.
        for (value, slot) in values.iter().zip(slots.by_ref()) {
            *slot = *value;
        }
    };
    for (sums, cells) in of_velocity.iter().zip(&of_cell) {
        let means = [0, 1, 2].map(|axis| sums.mean(axis));
        write(&[sums.count()]);
        write(&means);
        write(&[sums.spread(0), sums.spread(2)]);
        for cell in cells {
            write(&[cell.count(), cell.mean(0)]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tokenizer::config::GroupingConfig;
    use crate::tokenizer::grouping::group;
    use radarllm_base::{PointFrame, RadarPoint};

    #[test]
    fn an_arm_to_the_left_of_a_torso_shows_in_its_velocity_class() {
        let point = |x_m: f32, z_m: f32, velocity_mps: f32| RadarPoint {
            x_m,
            y_m: 3.0,
            z_m,
            range_m: 3.0,
            velocity_mps,
            intensity_db: 20.0,
        };
        // Four still points of a torso at x = 1 m, two of an arm 0.4 m beside it, 1.4 m high.
        let torso = [0.9, 1.0, 1.0, 1.1].map(|x| point(x, 0.1, 0.0));
        let arm = [1.3, 1.5].map(|x| point(x, 0.4, 1.2));
        let frame = PointFrame {
            points: torso.into_iter().chain(arm).collect(),
            ..Default::default()
        };
        let grouped = group(&[frame], 1.0, &GroupingConfig::default()).unwrap();
        let profile = grouped.profiles[0];
        let row = N_VELOCITIES - 1;
        let of = |velocity: usize| &profile[velocity * (PER_VELOCITY + N_HEIGHTS * PER_CELL)..];
        let (still, fast) = (of(2), of(row));
        assert!(
            (fast[1] - still[1] - 0.4).abs() < 1e-5,
            "{still:?} {fast:?}"
        );
        assert!((fast[0] - 3f32.ln() / 3.0).abs() < 1e-6);
        assert!((fast[3] - 0.4).abs() < 1e-5, "height of the arm above 1 m");
        assert!((fast[4] - 0.1).abs() < 1e-4, "spread in x");
        // The arm's height class, 1.2 to 1.6 m, contains both points. The approach classes are empty.
        assert!((fast[PER_VELOCITY + 3 * PER_CELL] - 3f32.ln() / 3.0).abs() < 1e-6);
        assert!(of(0)[..PER_VELOCITY].iter().all(|v| *v == 0.0));
    }
}
