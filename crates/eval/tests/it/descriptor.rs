use radarllm_base::seed::derive_seed;
use radarllm_base::{PointFrame, RadarPoint};
use radarllm_eval::descriptor::{DESCRIPTOR_DIM, descriptor};

/// Frames of up to four points, drawn from a seed.
fn frames(n: u64) -> Vec<PointFrame> {
    let draw = |i: u64| derive_seed(n, &i.to_string());
    let unit = |i: u64| (draw(i) >> 40) as f32 / (1 << 23) as f32 - 1.0;
    (0..n)
        .map(|frame| PointFrame {
            frame: frame as u32,
            time_s: frame as f64 * 0.1,
            points: (0..draw(frame) % 5)
                .map(|point| {
                    let of = |axis: u64| unit(1000 * (frame + 1) + 10 * point + axis);
                    RadarPoint {
                        x_m: of(0),
                        y_m: 3.0 + of(1),
                        z_m: of(2),
                        range_m: 3.0 + of(3),
                        velocity_mps: 2.0 * of(4),
                        intensity_db: -60.0 + 20.0 * of(5),
                    }
                })
                .collect(),
            board: None,
        })
        .collect()
}

#[test]
fn length_is_fixed_and_values_are_finite() {
    for n in [0, 1, 2, 7, 100] {
        let d = descriptor(&frames(n), 1.0);
        assert_eq!(d.len(), DESCRIPTOR_DIM);
        assert!(d.iter().all(|v| v.is_finite()));
    }
}

#[test]
fn a_walk_away_shows_in_displacement_and_velocity() {
    // One point receding at 0.5 m/s, 1 m below a radar at 1.5 m, 8 s at 10 frames/s.
    let walk: Vec<_> = (0..80_u32)
        .map(|frame| {
            let time_s = f64::from(frame) / 10.0;
            let y_m = 2.0 + 0.5 * time_s as f32;
            let point = RadarPoint {
                y_m,
                z_m: -1.0,
                range_m: y_m,
                velocity_mps: 0.5,
                ..Default::default()
            };
            PointFrame {
                frame,
                time_s,
                points: vec![point],
                board: None,
            }
        })
        .collect();
    let d = descriptor(&walk, 1.5);
    let tail = &d[DESCRIPTOR_DIM - 5..];
    // Duration 8 s; centres of the first and last second are 7 s apart: 3.5 m, along y only.
    for (found, expected) in tail.iter().zip([8.0, 0.0, 3.5, 0.0, 3.5]) {
        assert!((found - expected).abs() < 1e-5, "{tail:?}"); // f32 rounding of times and positions
    }
    // First part: height 0.5 m is bin 1 of 5, velocity 0.5 m/s bin 3 of 5: all points there.
    assert_eq!(d[5 + 3], 1.0);
    // Weighted height and velocity follow the 25 cells, range and x.
    assert!((d[27] - 0.5).abs() < 1e-6 && (d[28] - 0.5).abs() < 1e-6);
}
