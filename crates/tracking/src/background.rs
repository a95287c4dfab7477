//! Background subtraction: removes the points that the empty room also produces.

use std::collections::HashSet;

use radarllm_base::{PointFrame, RadarPoint, options::within, static_cells::held_cells};

use crate::OptionError;

/// Options of the background model of an empty room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BackgroundOptions {
    /// Edge of a cell in x, y and z, m. It is larger than the radar's position errors and smaller than a person.
    pub cell_m: f64,
    /// Edge of a cell in radial velocity, m/s. Cells are centred on zero, so that static points share one cell.
    pub cell_mps: f64,
    /// Share of the empty room's frames above which a cell with points counts as background.
    pub share: f64,
}

impl Default for BackgroundOptions {
    fn default() -> Self {
        Self {
            cell_m: 0.25,
            cell_mps: 0.25,
            share: 0.1,
        }
    }
}

/// Background model: the cells of position and radial velocity in which an empty room has points.
#[derive(Clone, Debug)]
pub struct PointBackground {
    options: BackgroundOptions,
    cells: HashSet<[i32; 4]>,
    /// Number of frames of the empty room.
    pub n_frames: usize,
}

impl PointBackground {
    /// Learns the background from frames of a room without people.
    ///
    /// # Errors
    /// If a cell size or the share (0 to 1) is out of range.
    pub fn learn(frames: &[PointFrame], options: BackgroundOptions) -> Result<Self, OptionError> {
        within("cell_m", options.cell_m, [0.01, 10.0], "0.01 to 10 m")?;
        within("cell_mps", options.cell_mps, [0.01, 10.0], "0.01 to 10 m/s")?;
        within("share", options.share, [0.0, 1.0], "0 to 1")?;
        let cells = held_cells(frames, options.share, |p| Some(cell(&options, p)));
        Ok(Self {
            options,
            cells,
            n_frames: frames.len(),
        })
    }

    /// Number of background cells.
    pub fn n_cells(&self) -> usize {
        self.cells.len()
    }

    /// Removes the background points and returns their number.
    pub fn remove(&self, frames: &mut [PointFrame]) -> usize {
        let mut n_removed = 0;
        for frame in frames {
            let before = frame.points.len();
            let points = &mut frame.points;
            points.retain(|p| !self.cells.contains(&cell(&self.options, p)));
            n_removed += before - points.len();
        }
        n_removed
    }
}

fn cell(options: &BackgroundOptions, point: &RadarPoint) -> [i32; 4] {
    // Casts saturate: points that are extremely far away share the outermost cell.
    let place = |v: f32, edge: f64| (f64::from(v) / edge).floor() as i32;
    [
        place(point.x_m, options.cell_m),
        place(point.y_m, options.cell_m),
        place(point.z_m, options.cell_m),
        (f64::from(point.velocity_mps) / options.cell_mps).round() as i32,
    ]
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

    fn frames(points: &[&[RadarPoint]]) -> Vec<PointFrame> {
        let frame = |(i, points): (usize, &&[RadarPoint])| PointFrame {
            frame: i as u32,
            time_s: 0.1 * i as f64,
            points: points.to_vec(),
            board: None,
        };
        points.iter().enumerate().map(frame).collect()
    }

    #[test]
    fn what_the_empty_room_has_often_enough_goes_and_movers_in_the_same_place_stay() {
        // The lamp is in every frame, the flicker in one frame of four.
        let (lamp, flicker) = (point(0.6, 0.0), point(-1.1, 0.0));
        let empty = frames(&[&[lamp, lamp], &[lamp], &[lamp, flicker], &[lamp]]);
        let options = |share| BackgroundOptions {
            share,
            ..BackgroundOptions::default()
        };
        let walker = point(0.6, 0.8);
        let recorded = frames(&[&[lamp, walker], &[flicker], &[point(0.62, 0.05)]]);
        // The flicker is in a quarter of the frames. It is removed if `share` is less than a quarter, and kept if
        // `share` is a quarter or more.
        for (share, removed, left) in [(0.2, 3, 1), (0.25, 2, 2), (1.0, 0, 4)] {
            let background = PointBackground::learn(&empty, options(share)).unwrap();
            let mut cleaned = recorded.clone();
            assert_eq!(background.remove(&mut cleaned), removed, "{share}");
            assert_eq!(cleaned.iter().map(|f| f.points.len()).sum::<usize>(), left);
            assert_eq!(cleaned.len(), 3, "frames stay, empty or not");
            assert!(cleaned[0].points.contains(&walker));
        }
        assert!(PointBackground::learn(&empty, options(1.5)).is_err());
        let none = PointBackground::learn(&[], options(0.1)).unwrap();
        assert_eq!(none.remove(&mut recorded.clone()), 0);
    }
}
