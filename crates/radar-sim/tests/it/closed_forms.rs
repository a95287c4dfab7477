//! The simulator against textbook formulas.

use std::f64::consts::PI;

use glam::{DQuat, DVec3};
use num_complex::{Complex32, Complex64};
use radarllm_base::{
    BOLTZMANN_J_PER_K, Material, MovingSurface, RadarConfig, RadarCube, SPEED_OF_LIGHT_MPS,
};
use radarllm_radar_sim::link::Link;
use radarllm_radar_sim::shapes::RigidSurface;
use radarllm_radar_sim::{Noise, PointTarget, Scene, SimOptions, Simulator};

fn frame(config: &RadarConfig, scene: &Scene<'_>, seed: u64) -> RadarCube {
    let mut simulator = Simulator::new(config, SimOptions::default()).unwrap();
    let mut cube = simulator.new_cube();
    simulator
        .simulate_frame(scene, 0, 0.0, seed, &mut cube)
        .unwrap();
    cube
}

fn point(position: [f64; 3], velocity: [f64; 3]) -> Scene<'static> {
    let target = PointTarget {
        position_m: DVec3::from(position),
        velocity_mps: DVec3::from(velocity),
        rcs_m2: 1.0,
    };
    Scene {
        surfaces: vec![],
        points: vec![target],
        noise: Noise::Off,
    }
}

fn surface(shape: &dyn MovingSurface) -> Scene<'_> {
    Scene {
        surfaces: vec![shape],
        points: vec![],
        noise: Noise::Off,
    }
}

/// A few loops are enough for what stands still.
fn short() -> RadarConfig {
    RadarConfig {
        n_loops: 2,
        ..RadarConfig::awr1843boost()
    }
}

/// One TX and one RX in the same place: angles of incidence are those of the array centre.
fn monostatic() -> RadarConfig {
    let antenna = RadarConfig::awr1843boost().tx[0];
    RadarConfig {
        tx: vec![antenna],
        rx: vec![antenna],
        ..short()
    }
}

/// Range from the beat frequency of one chirp, m: nu = S tau / fs exactly.
fn beat_range_m(config: &RadarConfig, chirp: &[Complex32]) -> f64 {
    let sum: Complex64 = chirp
        .windows(2)
        .map(|w| {
            let z = w[1] * w[0].conj();
            Complex64::new(f64::from(z.re), f64::from(z.im))
        })
        .sum();
    let cycles = (sum.arg() / (2.0 * PI)).rem_euclid(1.0);
    cycles * config.sample_rate_hz / config.slope_hz_per_s * 0.5 * SPEED_OF_LIGHT_MPS
}

/// Phase of `b` relative to `a` at the ADC centre, rad: mean over a symmetric window.
fn phase_between(a: &[Complex32], b: &[Complex32]) -> f64 {
    let sum: Complex32 = a[1..].iter().zip(&b[1..]).map(|(a, b)| b * a.conj()).sum();
    f64::from(sum.arg())
}

/// Cross section from the sample at the ADC centre, where the model's wavelength is exact, m^2.
fn rcs_m2(config: &RadarConfig, cube: &RadarCube, range_m: f64) -> f64 {
    let amplitude = f64::from(cube.chirp(0, 0, 0)[config.n_samples / 2].norm());
    (amplitude * range_m * range_m / Link::new(config).amplitude_at_1m).powi(2)
}

#[test]
fn point_target_range_and_range_walk() {
    let config = RadarConfig::awr1843boost();
    for range in [0.4, 1.0, 3.0, 7.7, 10.9] {
        let cube = frame(&short(), &point([0.0, range, 0.0], [0.0; 3]), 1);
        // Half the TX-RX path is longer than the range by a^2 / 2R, a = 4 mm: 20 um at 0.4 m.
        let found = beat_range_m(&config, cube.chirp(0, 0, 0));
        assert!((found - range).abs() < 1e-4, "{range}: {found}");
    }
    // Beyond the maximum range the beat folds.
    let cube = frame(&short(), &point([0.0, 14.0, 0.0], [0.0; 3]), 1);
    let found = beat_range_m(&config, cube.chirp(0, 0, 0));
    assert!(
        (found - (14.0 - config.max_range_m())).abs() < 1e-4,
        "{found}"
    );

    let speed = 4.5;
    let cube = frame(&config, &point([0.0, 3.0, 0.0], [0.0, speed, 0.0]), 1);
    let walk =
        beat_range_m(&config, cube.chirp(127, 0, 0)) - beat_range_m(&config, cube.chirp(0, 0, 0));
    let expected = speed * 127.0 * config.loop_period_s();
    assert!((walk - expected).abs() < 1e-4, "{walk} {expected}");
    assert!((walk / config.range_resolution_m() - 2.9).abs() < 0.05);
}

#[test]
fn point_target_velocity_and_tdm_phase() {
    let config = RadarConfig::awr1843boost();
    for speed in [-3.1, -0.4, 0.02, 1.3] {
        let cube = frame(&config, &point([0.0, 4.0, 0.0], [0.0, speed, 0.0]), 1);
        let to_speed = config.wavelength_m() / (4.0 * PI);
        let phase = phase_between(cube.chirp(60, 0, 0), cube.chirp(61, 0, 0));
        let found = phase * to_speed / config.loop_period_s();
        // The residual video phase lowers the carrier by S tau = 1.6 MHz of 79 GHz (2e-5); the
        // window's asymmetry and the kernel leave less than 1e-4.
        assert!(
            (found - speed).abs() < 1e-4 + 1e-4 * speed.abs(),
            "{speed}: {found}"
        );
        // Slot 2 fires two thirds of a loop after slot 0; TX2's place adds path: subtract a still
        // target at the same place (mid-frame position).
        let middle = config.ramp_start_s(60, 1) + 35e-6;
        let still = frame(
            &short(),
            &point([0.0, 4.0 + speed * middle, 0.0], [0.0; 3]),
            1,
        );
        let moved = phase_between(cube.chirp(60, 0, 0), cube.chirp(60, 2, 0));
        let placed = phase_between(still.chirp(0, 0, 0), still.chirp(0, 2, 0));
        let between = (moved - placed + PI).rem_euclid(2.0 * PI) - PI;
        let found = between * to_speed / (2.0 * config.chirp_period_s());
        assert!(
            (found - speed).abs() < 1e-3 + 1e-3 * speed.abs(),
            "{speed}: {found}"
        );
    }
}

#[test]
fn handedness_azimuth_and_elevation() {
    let config = short();
    let lambda = config.wavelength_m();
    let half = 0.5 * SPEED_OF_LIGHT_MPS / config.start_hz;
    for (azimuth, elevation) in [(0.3_f64, 0.0_f64), (-0.45, 0.1), (0.1, -0.2)] {
        let range = 5.0;
        let direction = DVec3::new(
            azimuth.sin() * elevation.cos(),
            azimuth.cos() * elevation.cos(),
            elevation.sin(),
        );
        let cube = frame(&config, &point((range * direction).to_array(), [0.0; 3]), 1);
        // Path to an antenna at a is shorter by a . u: a target at +x makes the phase fall along
        // +x. Second order: a^2 / 2R of 1e-5 m, 0.02 rad.
        let along_x = phase_between(cube.chirp(0, 0, 0), cube.chirp(0, 0, 1));
        let expected = -2.0 * PI * half * direction.x / lambda;
        assert!((along_x - expected).abs() < 0.02, "{along_x} {expected}");
        assert!(along_x * azimuth < 0.0);
        // TX slot 2 is raised by one and shifted by 2: against RX 2 of slot 0 only height is left.
        let raised = phase_between(cube.chirp(0, 0, 2), cube.chirp(0, 2, 0));
        let expected = -2.0 * PI * half * direction.z / lambda;
        assert!((raised - expected).abs() < 0.02, "{raised} {expected}");
    }
}

#[test]
fn power_falls_with_the_fourth_power_and_follows_the_radar_equation() {
    let config = short();
    for range in [1.0, 2.0, 4.0, 8.0] {
        let cube = frame(&config, &point([0.0, range, 0.0], [0.0; 3]), 1);
        // 1 m^2; the array's centre is 3.3 mm off boresight: 3e-6 of range, 1e-5 of pattern.
        let found = rcs_m2(&config, &cube, range);
        assert!((found - 1.0).abs() < 1e-3, "{range}: {found}");
    }
}

#[test]
fn plate_at_normal_incidence_and_against_angle() {
    let config = monostatic();
    let lambda = config.wavelength_m();
    // 5 cm at 60 m: the far field begins at 2 D^2 / lambda = 1.3 m; at 60 m the corners' phase is
    // 0.035 rad, 5e-4 of the peak field.
    let (side, range) = (0.05_f64, 60.0);
    let peak = 4.0 * PI * side.powi(4) / (lambda * lambda);
    let centre = Link::new(&config).array_centre_m;
    for degrees in [0.0_f64, 0.5, 1.0, 1.7, 2.2, 3.0, 4.5, 8.0] {
        let angle = degrees.to_radians();
        let plate = RigidSurface::plate(side, side, 0.02)
            .at(centre + DVec3::Y * range)
            .turned(DQuat::from_rotation_z(angle));
        let found = rcs_m2(&config, &frame(&config, &surface(&plate), 1), range);
        let x = 2.0 * PI / lambda * side * angle.sin();
        let sinc = if x == 0.0 { 1.0 } else { x.sin() / x };
        let expected = (angle.cos() * sinc).powi(2) * peak;
        let error = (found.sqrt() - expected.sqrt()).abs() / peak.sqrt();
        // Curvature 5e-4 and f32 vertices at 60 m (4e-6 m, 0.013 rad at worst, averaged over nine).
        assert!(error < 2e-3, "{degrees} deg: {found} {expected}");
    }
}

#[test]
fn sphere_has_the_near_field_specular_cross_section() {
    let config = short();
    let (radius, distance) = (0.15_f64, 3.0_f64);
    // pi a^2 (R / (R + a))^2 at the specular point R = 2.85 m (radar.md section 3).
    let expected = PI * radius * radius * ((distance - radius) / distance).powi(2);
    let mut found_db = Vec::new();
    for turn in 0..6 {
        let sphere = RigidSurface::sphere(radius, 0.006)
            .at(DVec3::new(0.002, distance, 0.0))
            .turned(DQuat::from_rotation_x(0.9) * DQuat::from_rotation_y(f64::from(turn) * 0.37));
        let cube = frame(&config, &surface(&sphere), 1);
        let found = rcs_m2(&config, &cube, distance - radius);
        found_db.push(10.0 * (found / expected).log10());
    }
    let mean = found_db.iter().sum::<f64>() / found_db.len() as f64;
    // Flat facets of 0.6 cm scintillate by a few tenths of a dB (radar.md section 2: -11.3..-10.7
    // for 0.5 cm), and the raster's rim adds little.
    assert!(mean.abs() < 0.4, "{found_db:?}");
    assert!(found_db.iter().all(|d| d.abs() < 1.0), "{found_db:?}");
}

#[test]
fn rough_plate_has_four_rho_area_cos_squared() {
    let config = RadarConfig {
        n_loops: 1,
        ..short()
    };
    let material = Material {
        power_reflection: 0.0,
        roughness_m: 0.0,
        rough_albedo: 0.2,
    };
    let angle = 0.6_f64;
    let plate = RigidSurface::plate(0.06, 0.06, 0.015)
        .at(DVec3::Y * 4.0)
        .turned(DQuat::from_rotation_x(angle))
        .of(material);
    let mut simulator = Simulator::new(&config, SimOptions::default()).unwrap();
    let mut cube = simulator.new_cube();
    let n = 1500;
    let mut mean = 0.0;
    for seed in 0..n {
        simulator
            .simulate_frame(&surface(&plate), 0, 0.0, seed, &mut cube)
            .unwrap();
        mean += rcs_m2(&config, &cube, 4.0) / n as f64;
    }
    let expected = 4.0 * 0.2 * 0.06 * 0.06 * angle.cos().powi(2);
    // Sums of 32 random phasors: nearly exponential, relative deviation 1/sqrt(1500) = 2.6 %; four
    // of them.
    assert!((mean / expected - 1.0).abs() < 0.1, "{mean} {expected}");
}

#[test]
fn noise_floor_is_k_t_b_f() {
    let config = RadarConfig::awr1843boost();
    let cube = frame(
        &config,
        &Scene {
            noise: Noise::Thermal,
            ..Default::default()
        },
        1,
    );
    let n = cube.data.len() as f64;
    let mean = cube
        .data
        .iter()
        .map(|z| f64::from(z.norm_sqr()))
        .sum::<f64>()
        / n;
    let expected = BOLTZMANN_J_PER_K * 290.0 * 4.4e6 * 10_f64.powf(1.5);
    // Powers are exponential: five deviations of the mean of n = 393,216 of them.
    assert!(
        (mean / expected - 1.0).abs() < 5.0 / n.sqrt(),
        "{mean} {expected}"
    );
}

#[test]
fn relative_noise_has_the_asked_ratio() {
    let config = RadarConfig::awr1843boost();
    let silent = frame(&config, &point([0.1, 3.0, 0.0], [0.0, 1.0, 0.0]), 1);
    let noisy = Scene {
        noise: Noise::SnrDb(7.0),
        ..point([0.1, 3.0, 0.0], [0.0, 1.0, 0.0])
    };
    let noisy = frame(&config, &noisy, 1);
    let power = |f: &dyn Fn(usize) -> f64| (0..silent.data.len()).map(f).sum::<f64>();
    let signal = power(&|i| f64::from(silent.data[i].norm_sqr()));
    let noise = power(&|i| f64::from((noisy.data[i] - silent.data[i]).norm_sqr()));
    // Five deviations of the noise power: 5 / sqrt(393216) = 0.8 % = 0.035 dB.
    assert!((10.0 * (signal / noise).log10() - 7.0).abs() < 0.035);
}

#[test]
fn what_is_hidden_contributes_nothing() {
    let config = short();
    let front = RigidSurface::plate(0.5, 0.5, 0.02).at(DVec3::Y * 2.0);
    let behind = RigidSurface::sphere(0.1, 0.01).at(DVec3::Y * 3.0);
    let both = Scene {
        surfaces: vec![&front, &behind],
        ..surface(&front)
    };
    let (both, alone) = (
        frame(&config, &both, 1),
        frame(&config, &surface(&front), 1),
    );
    assert_eq!(both.data, alone.data);
    assert!(alone.data.iter().any(|z| z.norm() > 0.0));
    // And turned away, the plate itself is unseen.
    let away = front.turned(DQuat::from_rotation_z(PI));
    assert!(
        frame(&config, &surface(&away), 1)
            .data
            .iter()
            .all(|z| z.norm() == 0.0)
    );
}

#[test]
fn pendulum_shows_its_micro_doppler() {
    let config = RadarConfig::awr1843boost();
    // A small sphere on a 0.5 m arm turning at 4 rad/s about the x axis, hanging down: it moves
    // along +y with w x r = 4 * 0.5 = 2 m/s.
    let mut bob = RigidSurface::sphere(0.02, 0.006)
        .shifted(DVec3::new(0.0, 0.0, -0.5))
        .at(DVec3::new(0.0, 3.0, 0.5));
    bob.angular_velocity = DVec3::new(4.0, 0.0, 0.0);
    bob.orientation = DQuat::from_rotation_x(-4.0 * 0.5 * 127.0 * config.loop_period_s());
    let cube = frame(&config, &surface(&bob), 1);
    let phase = phase_between(cube.chirp(63, 0, 0), cube.chirp(64, 0, 0));
    let found = phase * config.wavelength_m() / (4.0 * PI) / config.loop_period_s();
    // The specular point of a sphere moves as its centre; flat facets make it hop by a few per cent.
    assert!((found - 2.0).abs() < 0.1, "{found}");
}
