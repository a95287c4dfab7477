//! Voxels of made frames against those of NumPy (`goldens/radhar_voxels.py`).

use radarllm_base::RadarPoint;
use radarllm_eval::radhar::voxels::{GRID, frame_cells};

/// Numbers of the lines of a golden, by frame, which is the first of them.
fn by_frame(text: &str) -> Vec<(usize, Vec<f64>)> {
    let line = |line: &str| {
        let (frame, rest) = line.split_once(',').unwrap();
        let numbers = rest.split(',').map(|number| number.parse().unwrap());
        (frame.parse().unwrap(), numbers.collect())
    };
    text.lines().map(line).collect()
}

#[test]
fn voxels_of_frames_are_those_of_numpy() {
    let points = by_frame(include_str!("../goldens/radhar_points.csv"));
    let voxels = by_frame(include_str!("../goldens/radhar_voxels.csv"));
    let n_frames = points.last().unwrap().0 + 1;
    assert_eq!(n_frames, 7);
    let mut n_counted = 0.0;
    for frame in 0..n_frames {
        let own = points.iter().filter(|(number, _)| *number == frame);
        let point = |(_, place_m): &(usize, Vec<f64>)| RadarPoint {
            x_m: -place_m[1] as f32,
            y_m: place_m[0] as f32,
            z_m: place_m[2] as f32,
            ..RadarPoint::default()
        };
        let own: Vec<RadarPoint> = own.map(point).collect();
        let expected = voxels.iter().filter(|(number, _)| *number == frame);
        let expected: Vec<(usize, f32)> = expected
            .map(|(_, v)| {
                let [i, j, k] = [v[0] as usize, v[1] as usize, v[2] as usize];
                ((i * GRID[1] + j) * GRID[2] + k, v[3] as f32)
            })
            .collect();
        assert_eq!(frame_cells(&own), expected, "frame {frame}");
        n_counted += expected.iter().map(|(_, count)| count).sum::<f32>();
    }
    // Points are dropped, but not all of them.
    assert!(n_counted > 60.0 && n_counted < points.len() as f32 - 10.0);
}
