//! The places of a room where static echoes are.
//!
//! Firmware that does not remove static clutter reports walls and furniture not only at a radial speed of zero, but also
//! one Doppler bin to either side, through the main lobe of the Doppler window. These points do not move, although their
//! speed is not zero. A recording shows where they are: their places have static points in most of its frames.

use std::{
    collections::{HashMap, HashSet},
    hash::Hash,
};

use crate::{PointFrame, RadarPoint, STATIC_SPEED_MPS, StaticClutter};

/// Edge of a cell, m.
const EDGE_M: f32 = 0.3;
/// Share of the frames with static points above which a cell is static.
const SHARE: f64 = 1.0 / 3.0;
/// Points of a static cell with a smaller speed are static, m/s: one Doppler bin of radars that resolve slow motion.
const SLOW_MPS: f32 = 0.2;
/// Share of the frames with points in the Doppler bins beside zero above which these are leakage of the static echo, for
/// bins that are wider than [`SLOW_MPS`]. A person who moves in a cell leaves such points in fewer frames.
const LEAK_SHARE: f64 = 2.0 / 3.0;
/// Fewer frames do not tell leakage from a person.
const MIN_FRAMES: usize = 20;
/// Rounding of recorded speeds.
const ROUNDING: f32 = 1.1;

/// Cells of 0.3 m that have points below [`STATIC_SPEED_MPS`] in more than a third of the frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StaticCells {
    cells: HashSet<[i32; 3]>,
    /// Those whose echo leaks into the Doppler bins beside zero in most frames.
    leaking: HashSet<[i32; 3]>,
    /// Largest speed in the Doppler bins beside zero, m/s; 0 if all points are static.
    one_bin_mps: f32,
}

impl StaticCells {
    /// Finds the static cells of a recording.
    pub fn of(frames: &[PointFrame]) -> Self {
        let speeds = frames
            .iter()
            .flat_map(|f| &f.points)
            .filter(|p| !is_still(p))
            .map(|p| p.velocity_mps.abs());
        let one_bin_mps = match speeds.fold(f32::INFINITY, f32::min) {
            f32::INFINITY => 0.0,
            slowest_mps => slowest_mps * ROUNDING,
        };
        let cells = held_cells(frames, SHARE, |p| is_still(p).then(|| cell(p)));
        let is_beside_zero = |p: &RadarPoint| !is_still(p) && p.velocity_mps.abs() <= one_bin_mps;
        let leaking_cell =
            |p: &RadarPoint| Some(cell(p)).filter(|c| is_beside_zero(p) && cells.contains(c));
        let leaking = match frames.len() < MIN_FRAMES {
            true => HashSet::new(),
            false => held_cells(frames, LEAK_SHARE, leaking_cell),
        };
        Self {
            cells,
            leaking,
            one_bin_mps,
        }
    }

    /// Whether a point is static: slower than [`STATIC_SPEED_MPS`], or slow and in a static cell, or in the Doppler bins
    /// beside zero of a cell that leaks into them.
    pub fn is_static(&self, point: &RadarPoint) -> bool {
        let speed_mps = point.velocity_mps.abs();
        is_still(point)
            || (speed_mps < SLOW_MPS && self.cells.contains(&cell(point)))
            || (speed_mps <= self.one_bin_mps && self.leaking.contains(&cell(point)))
    }

    /// Counts the static points of the frames. Returns `None` if they are no more than half of all points.
    pub fn clutter(&self, frames: &[PointFrame]) -> Option<StaticClutter> {
        let points = || frames.iter().flat_map(|f| &f.points);
        let n_static = points().filter(|p| self.is_static(p)).count();
        let n_points = points().count();
        (2 * n_static > n_points).then_some(StaticClutter { n_static, n_points })
    }

    /// Removes the static points.
    pub fn remove(&self, frames: &mut [PointFrame]) {
        for frame in frames {
            frame.points.retain(|p| !self.is_static(p));
        }
    }
}

/// Cells that have points in more than a share of the frames. `cell` is the cell of a point that counts.
pub fn held_cells<C: Copy + Eq + Hash>(
    frames: &[PointFrame],
    share: f64,
    cell: impl Fn(&RadarPoint) -> Option<C>,
) -> HashSet<C> {
    let mut counts: HashMap<C, usize> = HashMap::new();
    let mut seen = HashSet::new();
    for frame in frames {
        seen.clear();
        for cell in frame.points.iter().filter_map(&cell) {
            if seen.insert(cell) {
                *counts.entry(cell).or_default() += 1;
            }
        }
    }
    let least = share * frames.len() as f64;
    let held = counts.into_iter().filter(|(_, n)| *n as f64 > least);
    held.map(|(cell, _)| cell).collect()
}

fn is_still(point: &RadarPoint) -> bool {
    point.velocity_mps.abs() < STATIC_SPEED_MPS
}

fn cell(point: &RadarPoint) -> [i32; 3] {
    // Casts saturate: points that are extremely far away share the outermost cell.
    [point.x_m, point.y_m, point.z_m].map(|v| (v / EDGE_M).floor() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x_m: f32, velocity_mps: f32) -> RadarPoint {
        RadarPoint {
            x_m,
            y_m: 2.0,
            velocity_mps,
            ..RadarPoint::default()
        }
    }

    #[test]
    fn neighbouring_doppler_bins_of_a_wall_are_static_and_slow_people_are_not() {
        // A wall with the bins next to it; a person who is in each place for one frame.
        let frame = |i: u32| PointFrame {
            frame: i,
            time_s: f64::from(i) / 10.0,
            points: vec![
                point(1.0, 0.0),
                point(1.0, 0.13),
                point(1.0, -0.13),
                point(1.0, 0.5),
                point(-0.4 * i as f32, 0.13),
                point(-0.4 * i as f32, 0.0),
            ],
        };
        let mut frames: Vec<PointFrame> = (0..10).map(frame).collect();
        let cells = StaticCells::of(&frames);
        cells.remove(&mut frames);
        for (i, frame) in frames.iter().enumerate() {
            let expected = [point(1.0, 0.5), point(-0.4 * i as f32, 0.13)];
            assert_eq!(frame.points, expected);
        }
    }

    /// A radar with Doppler bins of 0.5 m/s: a wall that leaks in every frame, and somebody in place who moves in every
    /// other frame.
    #[test]
    fn wide_bins_beside_zero_are_leakage_where_they_are_always_held() {
        let frame = |i: u32| PointFrame {
            frame: i,
            time_s: f64::from(i) / 10.0,
            points: vec![
                point(1.0, 0.0),
                point(1.0, 0.5),
                point(1.0, 1.0),
                point(-1.0, 0.0),
                point(-1.0, if i.is_multiple_of(2) { -0.5 } else { 1.0 }),
            ],
        };
        let mut frames: Vec<PointFrame> = (0..20).map(frame).collect();
        StaticCells::of(&frames).remove(&mut frames);
        for (i, frame) in frames.iter().enumerate() {
            let person = point(-1.0, if i.is_multiple_of(2) { -0.5 } else { 1.0 });
            assert_eq!(frame.points, [point(1.0, 1.0), person]);
        }
    }

    #[test]
    fn without_static_points_everything_stays() {
        let frame = PointFrame {
            points: vec![point(1.0, 0.13), point(1.0, -0.13)],
            ..PointFrame::default()
        };
        let mut frames = vec![frame; 10];
        let before = frames.clone();
        let cells = StaticCells::of(&frames);
        cells.remove(&mut frames);
        assert!(cells.cells.is_empty());
        assert_eq!(frames, before);
        StaticCells::of(&[]).remove(&mut []);
    }
}
