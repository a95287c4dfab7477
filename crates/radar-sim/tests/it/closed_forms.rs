//! Points, motion, shadow and noise against textbook formulas; surfaces are in `cross_sections`.

use std::f64::consts::PI;

use glam::{DQuat, DVec3, Vec3};
use num_complex::{Complex32, Complex64};
use radarllm_base::{BOLTZMANN_J_PER_K, Material, MovingSurface, RadarConfig, SPEED_OF_LIGHT_MPS};
use radarllm_radar_sim::shapes::RigidSurface;
use radarllm_radar_sim::{Noise, PointTarget, Scene, SimOptions, Simulator};

use crate::common::{frame, rcs_m2, short, surface};

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

#[test]
fn point_target_range_and_range_walk() {
    let config = RadarConfig::awr1843boost();
    for range in [0.4, 1.0, 3.0, 7.7, 10.9] {
        let cube = frame(&short(), &point([0.0, range, 0.0], [0.0; 3]), 1);
        // Half the TX-RX path is longer than the range by a^2 / 2R, a = 4 mm: 20 um at 0.4 m.
        let found = beat_range_m(&config, cube.chirp(0, 0, 0));
        assert!((found - range).abs() < 1e-4, "{range}: {found}");
    }
    // The filter before the ADC takes echoes beyond the maximum range away. Sampled, they would fold to near ranges.
    for range in [config.max_range_m() + 0.01, 14.0] {
        let cube = frame(&short(), &point([0.0, range, 0.0], [0.0; 3]), 1);
        assert!(cube.data.iter().all(|z| *z == Complex32::ZERO), "{range}");
    }

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
    for range in [1.0, 1.7, 3.1, 5.6, 10.0] {
        let cube = frame(&config, &point([0.0, range, 0.0], [0.0; 3]), 1);
        // 1 m^2; the array's centre is 3.3 mm off boresight: 5e-6 of range at 1 m, and 2 ln 2 (0.19
        // deg / 28 deg)^2 = 6e-5 of pattern; the range grid's kernel leaves 60 dB, 1e-3 of amplitude
        // at worst, 1e-4 as a rule.
        let found = rcs_m2(&config, &cube, range);
        assert!((found - 1.0).abs() < 1e-3, "{range}: {found}");
    }
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

/// A ball that swings on an arm, without turning: theta(t) = swing cos(rate t), from straight down.
struct Pendulum {
    ball: RigidSurface,
    pivot_m: DVec3,
    arm_m: f64,
    swing_rad: f64,
    rate_rad_per_s: f64,
}

impl Pendulum {
    /// Position and velocity of the ball's middle, m and m/s.
    fn at(&self, time_s: f64) -> (DVec3, DVec3) {
        let (sin, cos) = (self.rate_rad_per_s * time_s).sin_cos();
        let (theta, theta_dot) = (
            self.swing_rad * cos,
            -self.swing_rad * self.rate_rad_per_s * sin,
        );
        // In the plane x = 0: along y by sin theta, down by cos theta.
        let radial = DVec3::new(0.0, theta.sin(), -theta.cos());
        let tangent = DVec3::new(0.0, theta.cos(), theta.sin());
        (
            self.pivot_m + self.arm_m * radial,
            self.arm_m * theta_dot * tangent,
        )
    }
}

impl MovingSurface for Pendulum {
    fn triangles(&self) -> &[[u32; 3]] {
        self.ball.triangles()
    }
    fn n_vertices(&self) -> usize {
        self.ball.n_vertices()
    }
    fn positions_at(&self, time_s: f64, out: &mut [Vec3]) {
        self.ball.positions_at(0.0, out);
        let by = self.at(time_s).0.as_vec3();
        out.iter_mut().for_each(|p| *p += by);
    }
    fn material(&self) -> Material {
        self.ball.material()
    }
}

/// f_D(t) = (2 / lambda) l theta_dot (tangent . line of sight) over a whole swing.
#[test]
fn pendulum_shows_its_micro_doppler() {
    let config = RadarConfig::awr1843boost();
    let pendulum = Pendulum {
        ball: RigidSurface::sphere(0.02, 0.002),
        pivot_m: DVec3::new(0.0, 2.5, 0.4),
        arm_m: 0.5,
        swing_rad: 0.7,
        rate_rad_per_s: (9.81_f64 / 0.5).sqrt(),
    };
    let scene = surface(&pendulum);
    let mut simulator = Simulator::new(&config, SimOptions::default()).unwrap();
    let mut cube = simulator.new_cube();
    let (mut fastest, mut slowest) = (f64::NEG_INFINITY, f64::INFINITY);
    // A swing takes 1.42 s.
    for frame_idx in 0..15 {
        let start_s = 0.1 * f64::from(frame_idx);
        simulator
            .simulate_frame(&scene, 0, start_s, 1, &mut cube)
            .unwrap();
        let per_loop = phase_between(cube.chirp(63, 0, 0), cube.chirp(64, 0, 0));
        let found_hz = per_loop / (2.0 * PI * config.loop_period_s());
        // Half a loop after the ADC centre of the first of the two chirps.
        let to_centre_s = config.adc_start_s + 128.0 / config.sample_rate_hz;
        let time_s =
            start_s + config.ramp_start_s(63, 0) + to_centre_s + 0.5 * config.loop_period_s();
        let (position, velocity) = pendulum.at(time_s);
        let expected_hz = 2.0 / config.wavelength_m() * velocity.dot(position.normalize());
        // The ball's echo comes from the near side of its middle, on the line of sight: the same
        // speed. Flat facets of 2 mm on 2 cm (phase 2 k e^2 / 8 a = 0.083 rad, six grating echoes of
        // 2 / pi^2 of it) hop by 0.1 rad over the 40 degrees that the line of sight turns against the
        // facets, 2 km/rad at 2 m/s / 2.5 m, 216 us: far under 1e-4 of the phase. What is left: the
        // middle of the array lies 6 mm from boresight (0.1 % at most), the residual video phase
        // (2e-5), and phase_between's unequal ends.
        let error_hz = found_hz - expected_hz;
        assert!(
            error_hz.abs() < 1.0 + 2e-3 * expected_hz.abs(),
            "{time_s} s: {found_hz} Hz for {expected_hz} Hz"
        );
        fastest = fastest.max(expected_hz);
        slowest = slowest.min(expected_hz);
    }
    // Both ways through the bottom: l theta_max rate = 1.55 m/s, 818 Hz.
    assert!(
        fastest > 700.0 && slowest < -700.0,
        "{slowest} .. {fastest}"
    );
}
