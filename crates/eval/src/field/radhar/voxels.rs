//! Voxels of point clouds: the occupancy grid of RadHAR's preprocessing, and a grid of fixed size.
//!
//! RadHAR (Singh et al., mmNets 2019; nesl/RadHAR, `DataPreprocessing/voxels.py`) counts the points of every frame in
//! 10 x 32 x 32 cells between the frame's own minimum and maximum of each coordinate, so that place and size are lost.
//! Its edges grow from the minimum by repeated addition, and the first interval that it tests is empty. Cell 0 of every
//! axis is therefore always empty, a point of interval `k` is counted in cell `k + 1`, and the points of the last interval
//! are dropped: those in the farthest tenth of the frame's depth, and in the last 1/32 of its width and of its height. Two
//! frames at the end of a recording are left out. [`frame_cells`] and [`windows`] reproduce all of this.

use radarllm_base::RadarPoint;

use super::sparse::SparseRows;

/// Cells of a frame: forward, left, up.
pub const GRID: [usize; 3] = [10, 32, 32];
/// Number of cells of a frame, for one channel.
pub const N_CELLS: usize = GRID[0] * GRID[1] * GRID[2];
/// Frames of a window: 2 s at 30 frames/s.
pub const WINDOW_FRAMES: usize = 60;
/// Frames from the start of a window to that of the next one.
pub const STRIDE_FRAMES: usize = 10;
/// Frames at the end of a recording that RadHAR's preprocessing leaves out.
const N_LAST_FRAMES: usize = 2;
/// The fixed box in the radar's frame of reference, m, as forward, left, up: 4 x 4 x 2.4 m before the radar. Up is
/// relative to the radar, which is assumed to stand 1 m above the floor.
pub const BOX_M: [[f64; 2]; 3] = [[0.0, 4.0], [-2.0, 2.0], [-1.0, 1.4]];

/// How points become voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Voxels {
    /// Counts between the minimum and the maximum of the frame, as in RadHAR's preprocessing.
    Frame,
    /// Counts in the fixed box [`BOX_M`].
    Box,
    /// Counts in the fixed box, and the mean velocity of each cell, m/s, as a second channel.
    BoxVelocity,
}

impl Voxels {
    /// Description in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Frame => "voxels scaled by frame",
            Self::Box => "voxels in a fixed box",
            Self::BoxVelocity => "voxels in a fixed box, with velocity",
        }
    }

    /// Values of a frame.
    pub fn n_values(self) -> usize {
        match self {
            Self::Frame | Self::Box => N_CELLS,
            Self::BoxVelocity => 2 * N_CELLS,
        }
    }

    /// The values of a frame that are not zero, by index.
    pub fn of_frame(self, points: &[RadarPoint]) -> Vec<(usize, f32)> {
        match self {
            Self::Frame => frame_cells(points),
            Self::Box | Self::BoxVelocity => box_cells(points, self == Self::BoxVelocity),
        }
    }
}

/// The coordinates of RadHAR's files: forward, left, up, m.
fn coordinates_m(point: &RadarPoint) -> [f64; 3] {
    [
        f64::from(point.y_m),
        -f64::from(point.x_m),
        f64::from(point.z_m),
    ]
}

/// Index of a cell of [`GRID`].
fn flat([i, j, k]: [usize; 3]) -> usize {
    (i * GRID[1] + j) * GRID[2] + k
}

/// Cells that contain points, as index in `[forward][left][up]` and count, scaled by the frame's own minimum and maximum.
/// Points that RadHAR's preprocessing drops are not counted.
pub fn frame_cells(points: &[RadarPoint]) -> Vec<(usize, f32)> {
    let places_m: Vec<[f64; 3]> = points.iter().map(coordinates_m).collect();
    let mut edges_m: [Vec<f64>; 3] = Default::default();
    for (axis, edges_m) in edges_m.iter_mut().enumerate() {
        let values_m = places_m.iter().map(|place| place[axis]);
        let min_m = values_m.clone().fold(f64::INFINITY, f64::min);
        let max_m = values_m.fold(f64::NEG_INFINITY, f64::max);
        *edges_m = accumulated_edges(min_m, max_m, GRID[axis]);
    }
    let mut cells: Vec<(usize, f32)> = Vec::new();
    for place_m in places_m {
        let mut cell = [0; 3];
        let is_counted = (0..3).all(|axis| {
            let edges_m = &edges_m[axis];
            let interval = edges_m.partition_point(|edge_m| *edge_m <= place_m[axis]);
            cell[axis] = interval;
            (1..edges_m.len()).contains(&interval)
        });
        if is_counted {
            cells.push((flat(cell), 1.0));
        }
    }
    merged(cells)
}

/// Upper edges of the cells of one axis, of which the first is the minimum itself. The sum is repeated, not multiplied, so
/// that points on an edge are counted as in the reference.
fn accumulated_edges(min_m: f64, max_m: f64, n_cells: usize) -> Vec<f64> {
    let step_m = (max_m - min_m) / n_cells as f64;
    let edges_m = std::iter::successors(Some(min_m), |edge_m| Some(edge_m + step_m));
    edges_m
        .take(n_cells)
        .take_while(|edge_m| *edge_m <= max_m)
        .collect()
}

/// Cells of the fixed box that contain points, with their counts and, in a second channel, their mean velocities.
fn box_cells(points: &[RadarPoint], with_velocity: bool) -> Vec<(usize, f32)> {
    let mut counts = Vec::new();
    let mut sums_mps = Vec::new();
    for point in points {
        let place_m = coordinates_m(point);
        let mut cell = [0; 3];
        let is_inside = (0..3).all(|axis| {
            let [low_m, high_m] = BOX_M[axis];
            let share = (place_m[axis] - low_m) / (high_m - low_m);
            cell[axis] = (share * GRID[axis] as f64) as usize;
            (0.0..1.0).contains(&share)
        });
        if is_inside {
            counts.push((flat(cell), 1.0));
            sums_mps.push((flat(cell), point.velocity_mps));
        }
    }
    let mut cells = merged(counts);
    if with_velocity {
        let means = merged(sums_mps).into_iter().zip(&cells);
        let means: Vec<(usize, f32)> = means
            .map(|((cell, sum_mps), (_, count))| (N_CELLS + cell, sum_mps / count))
            .filter(|(_, mean_mps)| *mean_mps != 0.0)
            .collect();
        cells.extend(means);
    }
    cells
}

/// One entry for each cell, in order, with the sum of its values.
fn merged(mut cells: Vec<(usize, f32)>) -> Vec<(usize, f32)> {
    cells.sort_by_key(|(cell, _)| *cell);
    let groups = cells.chunk_by(|a, b| a.0 == b.0);
    groups
        .map(|group| (group[0].0, group.iter().map(|(_, value)| value).sum()))
        .collect()
}

/// The windows of a recording: rows of [`WINDOW_FRAMES`] x [`Voxels::n_values`] values, `[frame][channel][forward][left][up]`.
pub fn windows(frames: &[Vec<RadarPoint>], voxels: Voxels) -> SparseRows {
    let mut rows = SparseRows::new(WINDOW_FRAMES * voxels.n_values());
    let n_frames = frames.len().saturating_sub(N_LAST_FRAMES);
    let frames = frames.iter().take(n_frames);
    let cells: Vec<Vec<(usize, f32)>> = frames.map(|points| voxels.of_frame(points)).collect();
    for window in cells.windows(WINDOW_FRAMES).step_by(STRIDE_FRAMES) {
        let entries = window.iter().enumerate().flat_map(|(i, frame)| {
            let offset = i * voxels.n_values();
            frame
                .iter()
                .map(move |(cell, value)| (offset + cell, *value))
        });
        rows.push(entries);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point at forward, left, up.
    fn point(forward_m: f32, left_m: f32, up_m: f32, velocity_mps: f32) -> RadarPoint {
        RadarPoint {
            x_m: -left_m,
            y_m: forward_m,
            z_m: up_m,
            velocity_mps,
            ..RadarPoint::default()
        }
    }

    #[test]
    fn the_first_cell_is_empty_and_the_last_interval_is_dropped() {
        // Along each axis: the minimum, a point in the middle, one in the last interval, the maximum.
        let shares = [0.0, 0.5, 0.995, 1.0];
        let points: Vec<RadarPoint> = shares.map(|s| point(s, s, s, 0.0)).to_vec();
        let expected = [(flat([1, 1, 1]), 1.0), (flat([6, 17, 17]), 1.0)];
        assert_eq!(frame_cells(&points), expected);
        // A frame without an extent has no cells at all.
        assert_eq!(frame_cells(&points[..1]), []);
        assert_eq!(frame_cells(&[]), []);
    }

    #[test]
    fn voxels_scaled_by_frame_ignore_place_and_size() {
        let points = [[0.0, 0.0, 0.0], [0.25, 0.5, 0.125], [1.0, 1.0, 1.0]];
        let near: Vec<RadarPoint> = points.map(|[x, y, z]| point(x, y, z, 0.0)).to_vec();
        let far: Vec<RadarPoint> = points
            .map(|[x, y, z]| point(4.0 + 2.0 * x, 2.0 * y - 8.0, 2.0 * z, 0.0))
            .to_vec();
        assert_eq!(frame_cells(&near), frame_cells(&far));
        assert_ne!(Voxels::Box.of_frame(&near), Voxels::Box.of_frame(&far));
    }

    #[test]
    fn the_box_counts_points_and_averages_their_velocities() {
        let points = [
            point(2.0, 0.0, 0.2, 1.0),
            point(2.01, 0.01, 0.21, 0.5),
            point(3.9, -1.99, -0.99, 0.0),
            // Behind the radar, beside the box and above it.
            point(-0.1, 0.0, 0.0, 1.0),
            point(2.0, 2.0, 0.0, 1.0),
            point(2.0, 0.0, 1.5, 1.0),
        ];
        let centre = flat([5, 16, 16]);
        let corner = flat([9, 0, 0]);
        let counts = [(centre, 2.0), (corner, 1.0)];
        assert_eq!(Voxels::Box.of_frame(&points), counts);
        let mut with_velocity = counts.to_vec();
        // Zeros are not stored.
        with_velocity.push((N_CELLS + centre, 0.75));
        assert_eq!(Voxels::BoxVelocity.of_frame(&points), with_velocity);
    }

    #[test]
    fn windows_have_sixty_frames_and_start_every_ten() {
        let frame = vec![point(0.0, 0.0, 0.0, 0.0), point(1.0, 1.0, 1.0, 0.0)];
        // 600 frames less the last two are 54 windows; 602 are 55, as many as RadHAR has of each recording of 20 s.
        for (n_frames, n_windows) in [(61, 0), (62, 1), (71, 1), (72, 2), (600, 54), (602, 55)] {
            let rows = windows(&vec![frame.clone(); n_frames], Voxels::Frame);
            assert_eq!(rows.n_rows(), n_windows, "{n_frames}");
            assert!((0..n_windows).all(|row| rows.row(row).0.len() == WINDOW_FRAMES));
        }
    }
}
