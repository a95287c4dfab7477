//! The places of a room where static echoes are.
//!
//! Firmware that does not remove static clutter reports walls and furniture not only at a radial speed of zero, but also
//! one Doppler bin to either side, through the main lobe of the Doppler window. These points do not move, although their
//! speed is not zero. A recording shows where they are: their places have static points in most of its frames.

use std::collections::{HashMap, HashSet};

use crate::{PointFrame, RadarPoint, STATIC_SPEED_MPS};

/// Edge of a cell, m.
const EDGE_M: f32 = 0.3;
/// Share of the frames with static points above which a cell is static.
const SHARE: f32 = 1.0 / 3.0;
/// Points of a static cell with a smaller speed are static, m/s: one Doppler bin of radars that resolve slow motion.
const SLOW_MPS: f32 = 0.2;

/// Cells of 0.3 m that have points below [`STATIC_SPEED_MPS`] in more than a third of the frames.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StaticCells(HashSet<[i32; 3]>);

impl StaticCells {
    /// Finds the static cells of a recording.
    pub fn of(frames: &[PointFrame]) -> Self {
        let mut counts: HashMap<[i32; 3], usize> = HashMap::new();
        let mut seen = HashSet::new();
        for frame in frames {
            seen.clear();
            for point in frame.points.iter().filter(|p| is_still(p)) {
                let cell = cell(point);
                if seen.insert(cell) {
                    *counts.entry(cell).or_default() += 1;
                }
            }
        }
        let least = SHARE * frames.len() as f32;
        let cells = counts.into_iter().filter(|(_, n)| *n as f32 > least);
        Self(cells.map(|(cell, _)| cell).collect())
    }

    /// Whether a point is static: slower than [`STATIC_SPEED_MPS`], or slow and in a static cell.
    pub fn is_static(&self, point: &RadarPoint) -> bool {
        is_still(point)
            || (point.velocity_mps.abs() < SLOW_MPS
                && !self.0.is_empty()
                && self.0.contains(&cell(point)))
    }

    /// Removes the static points.
    pub fn remove(&self, frames: &mut [PointFrame]) {
        for frame in frames {
            frame.points.retain(|p| !self.is_static(p));
        }
    }
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
        assert_eq!((cells, frames), (StaticCells::default(), before));
        StaticCells::of(&[]).remove(&mut []);
    }
}
