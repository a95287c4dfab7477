//! Background subtraction: removes the points that the empty room also produces.
//!
//! What stands still in the empty room has points in the same cells of position and velocity. What moves there, such as a
//! fan or a curtain, has few points in each of many such cells: the places on the floor where it moved are removed with all
//! velocities and heights, and the cells around them.

use std::collections::HashSet;

use radarllm_base::{
    PointFrame, RadarPoint, STATIC_SPEED_MPS, options::within, static_cells::held_cells,
};

use crate::OptionError;

/// Edge of a cell on the floor in which something moves, m.
const PLACE_M: f64 = 0.25;
/// Share of the frames above which a cell with moving points is such a place: noise has points everywhere, but seldom twice
/// in the same cell.
const PLACE_SHARE: f64 = 0.01;
/// Largest floor of all places together, m²: a tenth of a room of 6 m by 6 m. Where more moves, somebody was there, and
/// nobody would be seen afterwards.
pub const MAX_PLACES_M2: f64 = 3.6;

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
    /// Cells of the floor in which something moves, with those around them.
    places: HashSet<[i32; 2]>,
    /// Floor on which something moves, m², also if that is too much to be removed.
    moving_m2: f64,
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
        let moves = |p: &RadarPoint| p.velocity_mps.abs() >= STATIC_SPEED_MPS;
        // Once is noise in short recordings, too.
        let place_share = PLACE_SHARE.max(1.0 / frames.len().max(1) as f64);
        let moving = held_cells(frames, place_share, |p| moves(p).then(|| place(p)));
        let around = |[x, y]: [i32; 2]| {
            (-1..=1).flat_map(move |dx| {
                (-1..=1).map(move |dy| [x.saturating_add(dx), y.saturating_add(dy)])
            })
        };
        let mut places: HashSet<[i32; 2]> = moving.into_iter().flat_map(around).collect();
        let moving_m2 = places.len() as f64 * PLACE_M * PLACE_M;
        if moving_m2 > MAX_PLACES_M2 {
            places.clear();
        }
        Ok(Self {
            options,
            cells,
            places,
            moving_m2,
            n_frames: frames.len(),
        })
    }

    /// Number of background cells.
    pub fn n_cells(&self) -> usize {
        self.cells.len()
    }

    /// Floor on which something moves, m². If it is more than [`MAX_PLACES_M2`], none of it is removed as a whole.
    pub fn moving_m2(&self) -> f64 {
        self.moving_m2
    }

    /// Number of places in which something moves and all points are removed. Cells that touch are one place.
    pub fn n_places(&self) -> usize {
        let mut left = self.places.clone();
        let mut n_places = 0;
        while let Some(first) = left.iter().next().copied() {
            n_places += 1;
            left.remove(&first);
            let mut border = vec![first];
            while let Some([x, y]) = border.pop() {
                let touching = left.extract_if(|[a, b]| {
                    a.saturating_sub(x).abs() <= 1 && b.saturating_sub(y).abs() <= 1
                });
                border.extend(touching);
            }
        }
        n_places
    }

    /// Removes the background points and returns their number.
    pub fn remove(&self, frames: &mut [PointFrame]) -> usize {
        let mut n_removed = 0;
        for frame in frames {
            let before = frame.points.len();
            let points = &mut frame.points;
            points.retain(|p| {
                !self.cells.contains(&cell(&self.options, p)) && !self.places.contains(&place(p))
            });
            n_removed += before - points.len();
        }
        n_removed
    }
}

/// The cell of the floor.
fn place(point: &RadarPoint) -> [i32; 2] {
    [point.x_m, point.y_m].map(|v| (f64::from(v) / PLACE_M).floor() as i32)
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

    #[test]
    fn what_moves_to_and_fro_is_removed_with_its_surroundings_and_a_walker_elsewhere_is_not() {
        // A fan: other places within 0.2 m and other velocities in every frame.
        let fan = |i: u32| {
            let shift = [0.0, 0.06, 0.12, 0.18, 0.03, 0.09, 0.15][(i % 7) as usize];
            point(-1.1 + shift, [0.3, -0.9, 0.6, -1.4, 1.1][(i % 5) as usize])
        };
        // And a point of noise in every frame, in another cell each time.
        let noise = |i: u32| RadarPoint {
            y_m: 20.0 + i as f32,
            ..point(3.0, 0.5)
        };
        let empty: Vec<[RadarPoint; 2]> = (0..600).map(|i| [fan(i), noise(i)]).collect();
        let empty: Vec<&[RadarPoint]> = empty.iter().map(|points| &points[..]).collect();
        let background =
            PointBackground::learn(&frames(&empty), BackgroundOptions::default()).unwrap();
        // Cells from -1.25 to -0.75 m, and those around: 4 by 3.
        assert_eq!(background.n_places(), 1);
        assert!((background.moving_m2() - 12.0 * 0.0625).abs() < 1e-9);
        let mut after = frames(&[&[point(-1.1, 2.0), point(-1.3, 0.4), point(0.6, 0.8)]]);
        assert_eq!(background.remove(&mut after), 2);
        assert_eq!(after[0].points, [point(0.6, 0.8)]);
        // Somebody who walks about is too much: 90 cells in a row, each eleven times or more, and those around.
        let walked: Vec<[RadarPoint; 1]> = (0..1_000)
            .map(|i| [point(0.25 * (i % 90) as f32 + 0.1, 0.8)])
            .collect();
        let walked: Vec<&[RadarPoint]> = walked.iter().map(|points| &points[..]).collect();
        let options = BackgroundOptions::default();
        let background = PointBackground::learn(&frames(&walked), options).unwrap();
        assert!(background.moving_m2() > MAX_PLACES_M2);
        assert_eq!(background.n_places(), 0);
        assert_eq!(background.remove(&mut frames(&walked[..10])), 0);
    }
}
