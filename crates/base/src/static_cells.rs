//! The places of a room where static echoes are.
//!
//! Firmware that does not remove static clutter reports walls and furniture not only at a radial speed of zero, but also
//! one Doppler bin to either side, through the main lobe of the Doppler window. These points do not move, although their
//! speed is not zero. A recording shows where they are: their places have static points in most of its frames.
//!
//! Such firmware also reports the coupling between transmitters and receivers: points at a few centimetres, a quarter of
//! all in recordings of IWR1443 and IWR6843. They show that nothing static was removed, however much a person moves.

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
/// Points nearer than this are coupling between transmitters and receivers, m; nobody is so near.
const COUPLING_M: f32 = 0.3;
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
    /// Whether more than a third of the frames have points of antenna coupling.
    reports_coupling: bool,
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
        let n_coupled = frames
            .iter()
            .filter(|f| f.points.iter().any(is_coupling))
            .count();
        let reports_coupling =
            frames.len() >= MIN_FRAMES && n_coupled as f64 > SHARE * frames.len() as f64;
        Self {
            cells,
            leaking,
            one_bin_mps,
            reports_coupling,
        }
    }

    /// Whether the radar reports coupling between its antennas, and so static echoes: points nearer than 0.3 m in more than
    /// a third of at least 20 frames.
    pub fn reports_coupling(&self) -> bool {
        self.reports_coupling
    }

    /// Whether a point is static: slower than [`STATIC_SPEED_MPS`], or slow and in a static cell, or in the Doppler bins
    /// beside zero of a cell that leaks into them, or coupling between the antennas.
    pub fn is_static(&self, point: &RadarPoint) -> bool {
        let speed_mps = point.velocity_mps.abs();
        is_still(point)
            || (self.reports_coupling && is_coupling(point))
            || (speed_mps < SLOW_MPS && self.cells.contains(&cell(point)))
            || (speed_mps <= self.one_bin_mps && self.leaking.contains(&cell(point)))
    }

    /// Counts the static points of the frames. Returns `None` if they are no more than half of all points and the radar
    /// reports no coupling between its antennas.
    pub fn clutter(&self, frames: &[PointFrame]) -> Option<StaticClutter> {
        let points = || frames.iter().flat_map(|f| &f.points);
        let n_static = points().filter(|p| self.is_static(p)).count();
        let n_points = points().count();
        (self.reports_coupling || 2 * n_static > n_points)
            .then_some(StaticClutter { n_static, n_points })
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
    let min = share * frames.len() as f64;
    let held = counts.into_iter().filter(|(_, n)| *n as f64 > min);
    held.map(|(cell, _)| cell).collect()
}

fn is_still(point: &RadarPoint) -> bool {
    point.velocity_mps.abs() < STATIC_SPEED_MPS
}

fn is_coupling(point: &RadarPoint) -> bool {
    let [x, y, z] = [point.x_m, point.y_m, point.z_m];
    x * x + y * y + z * z < COUPLING_M * COUPLING_M
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
            board: None,
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
            board: None,
        };
        let mut frames: Vec<PointFrame> = (0..20).map(frame).collect();
        StaticCells::of(&frames).remove(&mut frames);
        for (i, frame) in frames.iter().enumerate() {
            let person = point(-1.0, if i.is_multiple_of(2) { -0.5 } else { 1.0 });
            assert_eq!(frame.points, [point(1.0, 1.0), person]);
        }
    }

    /// A person who moves fast gives most points; the antennas' coupling, with Doppler side lobes, shows that static echoes are
    /// reported.
    #[test]
    fn antenna_coupling_shows_that_static_echoes_are_reported() {
        let near = |velocity_mps| RadarPoint {
            y_m: 0.05,
            ..point(0.1, velocity_mps)
        };
        let points = |i: u32| {
            let person = (0..6).map(|n| point(0.4 * (i % 5) as f32, 0.3 + 0.1 * n as f32));
            let room = [point(2.0, 0.0), near(0.06), near(-0.12)];
            person.chain(room).collect::<Vec<_>>()
        };
        let recording = |n: u32, of: &dyn Fn(u32) -> Vec<RadarPoint>| -> Vec<PointFrame> {
            let frame = |i| PointFrame {
                frame: i,
                time_s: f64::from(i) / 10.0,
                points: of(i),
                board: None,
            };
            (0..n).map(frame).collect()
        };
        let mut frames = recording(20, &points);
        let cells = StaticCells::of(&frames);
        let clutter = cells.clutter(&frames).unwrap();
        assert_eq!((clutter.n_static, clutter.n_points), (60, 180));
        cells.remove(&mut frames);
        assert!(frames.iter().all(|f| f.points.len() == 6));
        // A hand that comes near for a moment, too few frames, a radar that starts at 0.3 m.
        let seldom = recording(60, &|i| match i < 20 {
            true => points(i),
            false => points(i)[..7].to_vec(),
        });
        let far = recording(20, &|i| points(i)[..7].to_vec());
        for frames in [seldom, recording(19, &points), far] {
            let cells = StaticCells::of(&frames);
            assert!(!cells.reports_coupling());
            assert_eq!(cells.clutter(&frames), None);
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
