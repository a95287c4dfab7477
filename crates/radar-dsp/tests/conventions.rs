//! The worked numbers of CONVENTIONS.md. Each test bears the name given there.

#![allow(clippy::unwrap_used, unreachable_pub, reason = "a test")]

#[path = "it/synthetic.rs"]
mod synthetic;

use std::f64::consts::TAU;

use num_complex::Complex32;
use radarllm_base::{RadarConfig, RadarCube, RadarPoint};
use radarllm_radar_dsp::{ClutterFilter, DspOptions, PointExtractor};
use synthetic::{Target, cube};

fn radar() -> RadarConfig {
    RadarConfig::awr1843boost()
}

fn strongest(targets: &[Target]) -> RadarPoint {
    let mut extractor = PointExtractor::new(&radar(), DspOptions::default()).unwrap();
    extractor.extract(&cube(&radar(), targets)).unwrap().points[0]
}

/// Largest column or bin of one row of values.
fn peak(values: &[f32]) -> usize {
    (0..values.len())
        .max_by(|&a, &b| values[a].total_cmp(&values[b]))
        .unwrap()
}

/// Phase from `a` to `b`, rad.
fn turn(a: Complex32, b: Complex32) -> f64 {
    f64::from((b * a.conj()).arg())
}

#[test]
fn radar_axes_are_right_forward_up() {
    let target = Target {
        position_m: [0.8, 2.0, 0.3],
        velocity_mps: [0.0, 1.0, 0.0],
        amplitude: 1.0,
    };
    let p = strongest(&[target]);
    // Half a range bin, and the direction tolerances derived in tests/it/geometry.rs.
    for (found, expected) in [(p.x_m, 0.8), (p.y_m, 2.014), (p.z_m, 0.3)] {
        assert!((found - expected).abs() < 0.03, "{p:?}");
    }
}

#[test]
fn azimuth_is_zero_at_boresight_and_positive_to_the_right() {
    let p = strongest(&[Target::radial(2.0, 30.0, 10.0, 1.0)]);
    let azimuth_deg = p.x_m.atan2(p.y_m).to_degrees();
    let elevation_deg = (p.z_m / p.range_m).asin().to_degrees();
    // 0.005 of a direction cosine is 0.3 degrees.
    assert!(
        (azimuth_deg - 30.0).abs() < 0.5 && (elevation_deg - 10.0).abs() < 0.5,
        "{p:?}"
    );
}

#[test]
fn a_target_to_the_right_has_falling_phase_along_x() {
    // -2 pi / lambda * spacing * sin 30 degrees = -pi * (79.106 / 77) * 0.5 = -1.6138 rad.
    let cube = cube(&radar(), &[Target::radial(100.0, 30.0, 0.0, 0.0)]);
    // Neighbouring receivers at the middle of the ADC window, where the frequency is the carrier.
    let step = turn(cube.chirp(0, 0, 0)[128], cube.chirp(0, 0, 1)[128]);
    assert!((step + 1.6138).abs() < 0.002, "{step}");
}

#[test]
fn delay_turns_the_phase_forward() {
    // Beat frequency S * 2 R / c = 60.012e12 * 20.0138e-9 = 1.20108 MHz: bin 69.88.
    let cube = cube(&radar(), &[Target::radial(3.0, 0.0, 0.0, 0.0)]);
    let step = turn(cube.chirp(0, 0, 0)[0], cube.chirp(0, 0, 0)[1]);
    assert!((step - TAU * 1.20108e6 / 4.4e6).abs() < 0.002, "{step}");
    let mut extractor = PointExtractor::new(&radar(), DspOptions::default()).unwrap();
    assert_eq!(peak(&extractor.range_profile(&cube).unwrap().values), 70);
}

#[test]
fn swapped_i_and_q_mirror_the_range() {
    let mut cube = cube(&radar(), &[Target::radial(3.0, 0.0, 0.0, 0.0)]);
    for value in &mut cube.data {
        *value = Complex32::new(value.im, value.re);
    }
    let mut extractor = PointExtractor::new(&radar(), DspOptions::default()).unwrap();
    // Bin 70 becomes 256 - 70.
    assert_eq!(peak(&extractor.range_profile(&cube).unwrap().values), 186);
}

#[test]
fn receding_targets_have_positive_doppler() {
    let target = [Target::radial(3.0, 0.0, 0.0, 1.0)];
    let cube = cube(&radar(), &target);
    // 2 v / lambda = 527.74 Hz over one loop of 216 us: 0.71622 rad.
    let step = turn(cube.chirp(0, 0, 0)[128], cube.chirp(1, 0, 0)[128]);
    assert!((step - 0.71622).abs() < 0.002, "{step}");
    // 1 m/s is 14.59 bins: the nearest is 15.
    assert!((strongest(&target).velocity_mps - 15.0 * 0.068_536).abs() < 1e-4);
}

#[test]
fn transforms_are_forward_and_unnormalised_and_decibels_refer_to_one() {
    // A tone of amplitude 1, range bin 40, Doppler bin 12, alike in all channels.
    let mut cube = RadarCube::zeros(128, 3, 4, 256);
    for (i, value) in cube.data.iter_mut().enumerate() {
        let (sample, loop_idx) = (i % 256, i / (256 * 12));
        let turns = (40 * sample) as f64 / 256.0 + (12 * loop_idx) as f64 / 128.0;
        let z = num_complex::Complex64::cis(TAU * turns.fract());
        *value = Complex32::new(z.re as f32, z.im as f32);
    }
    let options = DspOptions {
        compensate_tdm: false,
        ..DspOptions::default()
    };
    let mut extractor = PointExtractor::new(&radar(), options).unwrap();
    let p = extractor.extract(&cube).unwrap().points[0];
    assert!((p.velocity_mps - 12.0 * 0.068_536).abs() < 1e-4);
    // Hamming sums 0.54 N - 0.46: 137.78 and 68.66. D = 12 * (137.78 * 68.66)^2: 90.31 dB.
    assert!(
        (p.intensity_db - 90.311).abs() < 0.002,
        "{}",
        p.intensity_db
    );
}

#[test]
fn maps_start_at_the_most_negative_velocity() {
    let mut extractor = PointExtractor::new(&radar(), DspOptions::default()).unwrap();
    let map = extractor
        .range_doppler_map(&cube(&radar(), &[Target::radial(3.0, 0.0, 0.0, -1.0)]))
        .unwrap();
    assert!((map.cols.at(0) + 4.3863).abs() < 1e-3 && map.cols.at(64).abs() < 1e-12);
    // -14.59 bins: column 64 - 15.
    assert_eq!(peak(&map.values) % map.n_cols, 49);
}

#[test]
fn cubes_are_loop_tx_rx_sample() {
    let mut cube = RadarCube::zeros(128, 3, 4, 256);
    // ((5 * 3 + 2) * 4 + 1) * 256 + 7
    cube.data[17_671] = Complex32::ONE;
    assert_eq!(cube.chirp(5, 2, 1)[7], Complex32::ONE);
}

#[test]
fn slots_fire_tx1_tx3_tx2_72_microseconds_apart() {
    let radar = radar();
    assert!((radar.ramp_start_s(1, 2) - (216e-6 + 144e-6 + 7e-6)).abs() < 1e-12);
    let half_m = 1.946_7e-3;
    let places: Vec<_> = radar
        .tx
        .iter()
        .map(|t| ((t.x_m / half_m).round(), (t.z_m / half_m).round()))
        .collect();
    assert_eq!(places, [(0.0, 0.0), (4.0, 0.0), (2.0, 1.0)]);
    // A slot later, a target at 1 m/s has moved 72 um: 2 pi * 527.74 * 72e-6 = 0.23874 rad. Slots 0
    // and 1 lie 4 elements apart, which boresight does not see.
    let cube = cube(&radar, &[Target::radial(100.0, 0.0, 0.0, 1.0)]);
    let step = turn(cube.chirp(0, 0, 0)[128], cube.chirp(0, 1, 0)[128]);
    assert!((step - 0.2387).abs() < 0.003, "{step}");
}

#[test]
fn elevation_is_the_phase_between_rows() {
    // A raised element is nearer to a raised target: -pi * (79.106 / 77) * sin 10 degrees = -0.56045.
    let cube = cube(&radar(), &[Target::radial(100.0, 0.0, 10.0, 0.0)]);
    let step = turn(cube.chirp(0, 0, 2)[128], cube.chirp(0, 2, 0)[128]);
    assert!((step + 0.5604).abs() < 0.003, "{step}");
}

#[test]
fn points_describe_the_middle_of_the_active_time() {
    // 128 loops of 216 us: the middle is 13.824 ms after time_s. 4 m/s for that long is 55 mm, more
    // than a range bin.
    let p = strongest(&[Target::radial(3.0, 0.0, 0.0, 4.0)]);
    assert!((p.range_m - 3.0553).abs() < 0.5 * 0.0430, "{}", p.range_m);
}

#[test]
fn static_clutter_is_removed_by_default() {
    let static_target = [Target::radial(3.0, 0.0, 0.0, 0.0)];
    let cube = cube(&radar(), &static_target);
    let count = |clutter| {
        let options = DspOptions {
            clutter,
            ..DspOptions::default()
        };
        PointExtractor::new(&radar(), options)
            .unwrap()
            .extract(&cube)
            .unwrap()
            .points
            .len()
    };
    assert!(count(ClutterFilter::Off) > 0);
    let mut extractor = PointExtractor::new(&radar(), DspOptions::default()).unwrap();
    let left = extractor.range_doppler_map(&cube).unwrap();
    let all = PointExtractor::new(
        &radar(),
        DspOptions {
            clutter: ClutterFilter::Off,
            ..DspOptions::default()
        },
    )
    .unwrap()
    .range_doppler_map(&cube)
    .unwrap();
    let strongest = |map: &radarllm_radar_dsp::Map| map.values.iter().copied().fold(0.0, f32::max);
    // Rounding of f32 samples only; the promise is 40 dB.
    assert!(strongest(&left) < 1e-10 * strongest(&all));
}
