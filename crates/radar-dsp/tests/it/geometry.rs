//! Point targets come back where they were put.

use radarllm_base::radar_config::{Antenna, TxMultiplexing};
use radarllm_base::{RadarConfig, RadarPoint, SPEED_OF_LIGHT_MPS};
use radarllm_radar_dsp::{DspOptions, PointExtractor};

use crate::synthetic::{Target, cube, norm, small_radar};

fn strongest(radar: &RadarConfig, options: DspOptions, targets: &[Target]) -> RadarPoint {
    let mut extractor = PointExtractor::new(radar, options).unwrap();
    extractor.extract(&cube(radar, targets)).unwrap().points[0]
}

/// Direction seen from the middle of the azimuth row: virtual elements act from half their place.
fn truth(radar: &RadarConfig, target: &Target) -> ([f64; 3], f64) {
    let extractor = PointExtractor::new(radar, DspOptions::default()).unwrap();
    let row = &extractor.array().azimuth_row;
    let centre_m = 0.5 * row.iter().map(|e| e.x_m).sum::<f64>() / row.len() as f64;
    let [x, y, z] = target.at(0.5 * radar.loop_period_s() * radar.n_loops as f64);
    let range_m = norm([x - centre_m, y, z]);
    (
        [(x - centre_m) / range_m, y / range_m, z / range_m],
        range_m,
    )
}

/// Tolerances: half a range bin and half a Doppler bin, since both are bin centres. Half a Doppler
/// bin leaves 0.0082 rad per TDM slot: 0.0016 rad per row element, 0.0005 in u_x, and 1.5 slots,
/// 0.0123 rad, 0.0038 in u_z. The parabola adds under 0.001. Wavefront curvature over antennas p,
/// |p|^2 / 2R each way, differs by 1.1e-5 m / R between the rows and by 1e-6 m / R per row element:
/// 0.003 / R in u_z and 0.0005 / R in u_x; the rows' height of 1 mm adds 0.001 / R to u_z.
fn check(radar: &RadarConfig, target: Target, label: &str) {
    let point = strongest(radar, DspOptions::default(), &[target]);
    let (u, range_m) = truth(radar, &target);
    let speed_mps = target
        .velocity_mps
        .iter()
        .zip(u)
        .map(|(v, c)| v * c)
        .sum::<f64>();
    let range_error_m = f64::from(point.range_m) - range_m;
    assert!(
        range_error_m.abs() < 0.51 * radar.range_resolution_m() + 0.001,
        "{label}: range {range_error_m}"
    );
    let speed_error = f64::from(point.velocity_mps) - speed_mps;
    assert!(
        speed_error.abs() < 0.51 * radar.velocity_resolution_mps(),
        "{label}: speed {speed_error}"
    );
    let [ux, uz] = [point.x_m, point.z_m].map(|c| f64::from(c / point.range_m));
    assert!(
        (ux - u[0]).abs() < 0.002 + 0.001 / range_m,
        "{label}: u_x {ux} for {}",
        u[0]
    );
    assert!(
        (uz - u[2]).abs() < 0.005 + 0.004 / range_m,
        "{label}: u_z {uz} for {}",
        u[2]
    );
    let length = norm([point.x_m, point.y_m, point.z_m].map(f64::from));
    assert!(
        (length - f64::from(point.range_m)).abs() < 1e-4,
        "{label}: |xyz| is the range"
    );
}

#[test]
fn targets_across_the_field_of_view() {
    let radar = RadarConfig::awr1843boost();
    let mut speed_mps = -3.9;
    for azimuth_deg in [-50.0, -31.0, -14.5, 0.0, 9.0, 27.0, 50.0] {
        for elevation_deg in [-22.0, -7.0, 0.0, 16.0] {
            let range_m = 1.5 + (azimuth_deg + 50.0) / 20.0;
            check(
                &radar,
                Target::radial(range_m, azimuth_deg, elevation_deg, speed_mps),
                &format!("{range_m:.1} m, {azimuth_deg}, {elevation_deg}, {speed_mps:.2} m/s"),
            );
            // Spreads speeds over the interval and over places inside a Doppler bin.
            speed_mps += 0.287;
        }
    }
}

#[test]
fn ranges_from_the_gate_to_ten_metres() {
    let radar = RadarConfig::awr1843boost();
    for range_m in [0.5, 0.77, 1.013, 2.5, 4.99, 7.2, 9.9] {
        check(
            &radar,
            Target::radial(range_m, 10.0, 5.0, 0.8),
            &format!("{range_m} m"),
        );
    }
}

#[test]
fn other_boards_use_their_own_antennas() {
    // Four columns by two rows plus a pair below, 60 GHz: not the reference layout in any respect.
    let half_m = 0.5 * SPEED_OF_LIGHT_MPS / 62e9;
    let antenna = |x: f64, z: f64| Antenna {
        x_m: x * half_m,
        z_m: z * half_m,
    };
    let radar = RadarConfig {
        name: "square".into(),
        start_hz: 60e9,
        tx: vec![antenna(-2.0, 0.0), antenna(0.0, 0.0), antenna(-2.0, -2.0)],
        rx: vec![
            antenna(0.0, 0.0),
            antenna(0.0, -1.0),
            antenna(-1.0, -1.0),
            antenna(-1.0, 0.0),
        ],
        ..RadarConfig::awr1843boost()
    };
    let extractor = PointExtractor::new(&radar, DspOptions::default()).unwrap();
    assert_eq!(extractor.array().azimuth_row.len(), 4);
    assert!(extractor.array().has_elevation());
    for (azimuth_deg, elevation_deg) in [(0.0, 0.0), (25.0, 20.0), (-40.0, -15.0)] {
        // On a Doppler bin centre: with fewer elements the slots weigh differently.
        let speed_mps = 14.0 * radar.velocity_resolution_mps();
        let target = Target::radial(3.0, azimuth_deg, elevation_deg, speed_mps);
        let point = strongest(&radar, DspOptions::default(), &[target]);
        let [x, _, z] = target.at(0.0138);
        // Antenna centre offsets of up to 4 mm and a peak 0.003 wide in the parabola of 4 elements.
        assert!(
            (f64::from(point.x_m) - x).abs() < 0.03,
            "x {} for {x}",
            point.x_m
        );
        assert!(
            (f64::from(point.z_m) - z).abs() < 0.03,
            "z {} for {z}",
            point.z_m
        );
    }
}

#[test]
fn flat_boards_put_points_at_height_zero_and_say_so() {
    let mut radar = RadarConfig::awr1843boost();
    radar.tx.truncate(2);
    let extractor = PointExtractor::new(&radar, DspOptions::default()).unwrap();
    assert!(!extractor.array().has_elevation());
    let point = strongest(
        &radar,
        DspOptions::default(),
        &[Target::radial(3.0, 20.0, 0.0, 1.0)],
    );
    assert_eq!(point.z_m, 0.0);
    // sin 20 degrees times 3 m, half a range bin of 2.2 cm times the sine, and 0.002 of u.
    assert!((f64::from(point.x_m) - 3.014 * 20_f64.to_radians().sin()).abs() < 0.02);
}

#[test]
fn tdm_compensation_puts_a_mover_at_its_height() {
    let radar = RadarConfig::awr1843boost();
    let target = Target::radial(3.0, 0.0, 0.0, 1.0);
    let on = strongest(&radar, DspOptions::default(), &[target]);
    // 0.0038 in u_z times 3 m: half a Doppler bin of uncompensated phase.
    assert!(on.z_m.abs() < 0.015, "{}", on.z_m);
    let options = DspOptions {
        compensate_tdm: false,
        ..DspOptions::default()
    };
    let off = strongest(&radar, options, &[target]);
    // Phase of 1.5 chirps, 2 pi * (2 v / lambda) * 1.5 * 72 us = 0.358 rad, times lambda / (2 pi *
    // spacing) = 1.947 / (2 pi), times 3.014 m: 0.334 m (the target seems lower).
    assert!(
        (f64::from(off.z_m).abs() - 0.334).abs() < 0.015,
        "{}",
        off.z_m
    );
}

#[test]
fn range_doppler_coupling_is_the_documented_1_3_mm_per_metre_per_second() {
    let radar = RadarConfig::awr1843boost();
    let target = [Target::radial(3.0, 0.0, 0.0, 2.0)];
    let on = strongest(&radar, DspOptions::default(), &target);
    let options = DspOptions {
        correct_range_doppler_coupling: false,
        ..DspOptions::default()
    };
    let off = strongest(&radar, options, &target);
    // v * carrier / slope = 2 * 79.106e9 / 60.012e12 = 2.636 mm; v is a bin centre within 3.4 cm/s.
    assert!((f64::from(off.range_m - on.range_m) - 2.636e-3).abs() < 6e-5);
}

#[test]
fn maps_peak_where_the_target_is() {
    let radar = RadarConfig::awr1843boost();
    let target = Target::radial(4.0, -20.0, 0.0, -1.5);
    let cube = cube(&radar, &[target]);
    let mut extractor = PointExtractor::new(&radar, DspOptions::default()).unwrap();
    let peak = |values: &[f32]| {
        (0..values.len())
            .max_by(|&a, &b| values[a].total_cmp(&values[b]))
            .unwrap()
    };
    let range_m = target.middle_range_m(&radar);

    let map = extractor.range_doppler_map(&cube).unwrap();
    let i = peak(&map.values);
    // A bin's half plus the coupling of 2 mm.
    assert!((map.rows.at(i / map.n_cols) - range_m).abs() < 0.025);
    assert!((map.cols.at(i % map.n_cols) + 1.5).abs() < 0.036);

    let map = extractor.range_azimuth_map(&cube).unwrap();
    let i = peak(&map.values);
    assert!((map.rows.at(i / map.n_cols) - range_m).abs() < 0.025);
    // Half of a 64-point bin: 1.947 / 64 / 2 = 0.0152.
    assert!((map.cols.at(i % map.n_cols) + 20_f64.to_radians().sin()).abs() < 0.0165);

    let profile = extractor.range_profile(&cube).unwrap();
    assert!((profile.cols.at(peak(&profile.values)) - range_m).abs() < 0.025);
}

#[test]
fn micro_doppler_follows_the_speed_over_frames() {
    let radar = small_radar(64, 128);
    let mut extractor = PointExtractor::new(&radar, DspOptions::default()).unwrap();
    let mut spectrogram = radarllm_radar_dsp::MicroDoppler::default();
    let speeds = [-2.0, -0.7, 0.9, 2.4];
    for speed in speeds {
        spectrogram
            .push(
                &mut extractor,
                &cube(&radar, &[Target::radial(2.0, 0.0, 0.0, speed)]),
            )
            .unwrap();
    }
    let map = spectrogram.finish().unwrap();
    assert_eq!((map.n_rows, map.n_cols), (64, 4));
    for (column, speed) in speeds.iter().enumerate() {
        let power = |row: usize| map.values[row * map.n_cols + column];
        let best = (0..map.n_rows)
            .max_by(|&a, &b| power(a).total_cmp(&power(b)))
            .unwrap();
        assert!(
            (map.rows.at(best) - speed).abs() < 0.51 * map.rows.step,
            "{speed}"
        );
    }
}

/// The reference board with two of its transmitters and binary phase modulation.
fn phase_modulated(second: usize) -> RadarConfig {
    let mut radar = RadarConfig {
        multiplexing: TxMultiplexing::Bpm,
        ..RadarConfig::awr1843boost()
    };
    radar.tx = vec![radar.tx[0], radar.tx[second]];
    radar
}

/// TX1 and TX2 see elevation over rows of four, TX1 and TX3 a row of eight in azimuth. The tolerances
/// are those of time division: half a Doppler bin is the same 0.0082 rad x 3/2 between the slots.
#[test]
fn phase_modulated_movers_come_back_where_they_were() {
    let radar = phase_modulated(1);
    assert_eq!(
        PointExtractor::new(&radar, DspOptions::default())
            .unwrap()
            .array()
            .azimuth_row
            .len(),
        8
    );
    let (mut speed_mps, limit_mps) = (-6.4_f64, radar.max_velocity_mps());
    for azimuth_deg in [-40.0, -15.0, 0.0, 30.0] {
        assert!(speed_mps.abs() < limit_mps);
        let target = Target::radial(2.5, azimuth_deg, 0.0, speed_mps);
        check(&radar, target, &format!("{azimuth_deg}, {speed_mps} m/s"));
        speed_mps += 3.7;
    }

    let radar = phase_modulated(2);
    for (elevation_deg, speed_mps) in [(-20.0, 5.1), (0.0, -1.3), (12.0, 0.7), (25.0, -6.0)] {
        // On a Doppler bin centre: with one row of four for each transmitter, a bin's edge costs
        // 0.0123 rad of phase between the rows and as much again by what is left of the other row.
        let bin_mps = radar.velocity_resolution_mps();
        let speed_mps = (speed_mps / bin_mps).round() * bin_mps;
        let target = Target::radial(3.0, 8.0, elevation_deg, speed_mps);
        let point = strongest(&radar, DspOptions::default(), &[target]);
        let (u, range_m) = truth(&radar, &target);
        let u_z = f64::from(point.z_m / point.range_m);
        assert!(
            (u_z - u[2]).abs() < 0.006,
            "u_z {u_z} for {u:?} at {range_m}"
        );
        let u_x = f64::from(point.x_m / point.range_m);
        assert!(
            (u_x - u[0]).abs() < 0.006,
            "u_x {u_x} for {u:?} at {range_m}"
        );
    }
}

/// Without the phase between the slots, half of each transmitter lands in the other.
#[test]
fn phase_modulation_needs_the_phase_between_the_slots() {
    let radar = phase_modulated(2);
    let target = Target::radial(3.0, 0.0, 20.0, 3.0);
    let error_of = |compensate_tdm| {
        let options = DspOptions {
            compensate_tdm,
            ..DspOptions::default()
        };
        let point = strongest(&radar, options, &[target]);
        (f64::from(point.z_m) - target.at(0.009)[2]).abs()
    };
    assert!(error_of(true) < 0.03, "{}", error_of(true));
    assert!(error_of(false) > 0.1, "{}", error_of(false));
}
