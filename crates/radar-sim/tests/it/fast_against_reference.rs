//! The fast path against the direct sum: error at least 60 dB below the peak.

use glam::{DQuat, DVec3};
use radarllm_base::radar_config::TxMultiplexing;
use radarllm_base::{Material, MovingSurface, RadarConfig, RadarCube};
use radarllm_radar_sim::shapes::RigidSurface;
use radarllm_radar_sim::{Noise, PointTarget, Scene, SimOptions, Simulator, reference};

/// Largest difference over largest reference sample, dB, over `loops`.
fn error_db(
    config: &RadarConfig,
    scene: &Scene<'_>,
    loops: std::ops::Range<usize>,
    step: usize,
) -> f64 {
    error_with(config, &SimOptions::default(), scene, loops, step)
}

fn error_with(
    config: &RadarConfig,
    options: &SimOptions,
    scene: &Scene<'_>,
    loops: std::ops::Range<usize>,
    step: usize,
) -> f64 {
    let mut simulator = Simulator::new(config, options.clone()).unwrap();
    let mut fast = simulator.new_cube();
    simulator
        .simulate_frame(scene, 3, 0.3, 5, &mut fast)
        .unwrap();
    let mut slow = simulator.new_cube();
    let (mut error, mut peak) = (0.0_f32, 0.0_f32);
    for l in loops.step_by(step) {
        reference::simulate_loops(config, options, scene, 0.3, 5, l..l + 1, &mut slow).unwrap();
        let (f, s) = (of_loop(&fast, l), of_loop(&slow, l));
        for (f, s) in f.iter().zip(s) {
            assert!(f.re.is_finite() && f.im.is_finite());
            error = error.max((f - s).norm());
            peak = peak.max(s.norm());
        }
    }
    assert!(peak > 0.0);
    20.0 * f64::from(error / peak).log10()
}

fn of_loop(cube: &RadarCube, l: usize) -> &[num_complex::Complex32] {
    let len = cube.n_tx * cube.n_rx * cube.n_samples;
    &cube.data[l * len..(l + 1) * len]
}

fn off(points: Vec<PointTarget>) -> Scene<'static> {
    Scene {
        surfaces: vec![],
        points,
        noise: Noise::Off,
    }
}

const CLOTH: Material = Material {
    power_reflection: 0.34,
    roughness_m: 0.4e-3,
    rough_albedo: 0.1,
    power_transmission: 0.0,
};

#[test]
fn still_and_moving_points_over_the_whole_frame() {
    let config = RadarConfig::awr1843boost();
    let point = |p: [f64; 3], v: [f64; 3]| PointTarget {
        position_m: DVec3::from(p),
        velocity_mps: DVec3::from(v),
        rcs_m2: 1.0,
    };
    // Speeds within and beyond the ambiguity; ranges near, middle and last bin.
    for (p, v) in [
        ([0.3, 3.0, 0.2], [0.0, 0.0, 0.0]),
        ([0.3, 3.0, 0.2], [0.4, -1.7, 0.3]),
        ([-0.6, 1.2, -0.2], [-2.0, 4.4, 0.5]),
        ([1.0, 4.0, 0.2], [0.0, 19.0, 0.0]),
        ([0.1, 10.2, 0.2], [0.0, 2.0, 0.0]),
        ([0.05, 0.3, 0.0], [1.0, 0.3, 0.0]),
    ] {
        let error = error_db(&config, &off(vec![point(p, v)]), 0..128, 9);
        println!("{p:?} {v:?}: {error:.1} dB");
        assert!(error < -60.0, "{p:?} {v:?}: {error} dB");
    }
}

#[test]
fn echoes_beyond_the_maximum_range_are_in_neither() {
    let config = RadarConfig::awr1843boost();
    let at = |p: [f64; 3]| PointTarget::at(DVec3::from(p), 1.0);
    let far = PointTarget {
        velocity_mps: DVec3::new(0.0, -3.0, 0.0),
        ..at([0.3, 14.0, 0.2])
    };
    // A wall from 10.2 m to 12.1 m, whose facets are partly beyond 10.99 m.
    let wall = RigidSurface::plate(4.0, 0.4, 0.05)
        .at(DVec3::new(0.0, 11.0, 0.0))
        .turned(DQuat::from_rotation_z(0.5))
        .of(CLOTH);
    let moving = wall.clone().moving(DVec3::new(0.0, 1.0, 0.0));
    for wall in [&wall, &moving] {
        let scene = Scene {
            surfaces: vec![wall as &dyn MovingSurface],
            points: vec![at([0.3, 3.0, 0.2]), far],
            noise: Noise::Off,
        };
        let error = error_db(&config, &scene, 0..128, 25);
        assert!(error < -60.0, "{error} dB");
        let options = SimOptions::default();
        let mut simulator = Simulator::new(&config, options.clone()).unwrap();
        let mut cube = simulator.new_cube();
        let stats = simulator
            .simulate_frame(&scene, 3, 0.3, 5, &mut cube)
            .unwrap();
        assert!(stats.n_visible > 100 && stats.n_visible < stats.n_facets - 100);
        // The point alone beyond the maximum range leaves nothing.
        let alone = off(vec![far]);
        let (mut fast, mut slow) = (simulator.new_cube(), simulator.new_cube());
        simulator
            .simulate_frame(&alone, 0, 0.0, 5, &mut fast)
            .unwrap();
        reference::simulate_loops(&config, &options, &alone, 0.0, 5, 0..1, &mut slow).unwrap();
        let is_silent = |cube: &RadarCube| cube.data.iter().all(|z| z.norm_sqr() == 0.0);
        assert!(is_silent(&fast) && is_silent(&slow));
    }
}

#[test]
fn rotating_accelerating_bodies() {
    let config = RadarConfig::awr1843boost();
    let body = |at: [f64; 3], v: [f64; 3], a: [f64; 3], w: [f64; 3]| {
        let mut surface = RigidSurface::ellipsoid(DVec3::new(0.08, 0.05, 0.15), 0.03)
            .at(DVec3::from(at))
            .moving(DVec3::from(v))
            .turned(DQuat::from_rotation_y(0.4))
            .of(CLOTH);
        surface.acceleration_mps2 = DVec3::from(a);
        surface.angular_velocity = DVec3::from(w);
        surface
    };
    let smooth = body([0.2, 3.0, 0.1], [0.0, 0.5, 0.0], [0.0; 3], [0.0; 3]).of(Material::PEC);
    let walk = body(
        [-0.3, 2.0, 0.1],
        [0.2, -1.5, 0.0],
        [0.0, 5.0, 0.0],
        [2.0, 0.0, 0.0],
    );
    let kick = body(
        [0.4, 2.5, -0.3],
        [0.0, -4.0, 1.0],
        [0.0, 50.0, 20.0],
        [8.0, 2.0, 0.0],
    );
    for (name, surfaces) in [
        ("smooth", vec![&smooth as &dyn MovingSurface]),
        ("walk", vec![&walk]),
        ("kick", vec![&kick]),
        ("all", vec![&smooth, &walk, &kick]),
    ] {
        let scene = Scene {
            surfaces,
            points: vec![],
            noise: Noise::Off,
        };
        let error = error_db(&config, &scene, 0..128, 25);
        println!("{name}: {error:.1} dB");
        assert!(error < -60.0, "{name}: {error} dB");
    }
}

#[test]
fn ghosts_of_a_moving_body_over_a_wall_and_a_floor() {
    let config = RadarConfig::awr1843boost();
    let mut body = RigidSurface::ellipsoid(DVec3::new(0.08, 0.05, 0.15), 0.04)
        .at(DVec3::new(-0.2, 2.0, -0.2))
        .moving(DVec3::new(0.3, -1.5, 0.2))
        .of(CLOTH);
    body.angular_velocity = DVec3::new(2.0, 0.0, 1.0);
    let mut wall = RigidSurface::plate(3.0, 2.0, 0.25)
        .at(DVec3::new(0.6, 2.0, 0.0))
        .turned(DQuat::from_rotation_z(-1.5));
    // A door that swings: the mirror itself moves.
    wall.angular_velocity = DVec3::new(0.0, 0.0, 0.4);
    let floor = RigidSurface::plate(3.0, 3.0, 0.25)
        .at(DVec3::new(0.0, 2.0, -1.0))
        .turned(DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2));
    let scene = Scene {
        surfaces: vec![&body, &wall, &floor],
        points: vec![],
        noise: Noise::Off,
    };
    let options = SimOptions {
        max_bounces: 3,
        bounce_rays: 64,
        ..SimOptions::default()
    };
    let error = error_with(&config, &options, &scene, 0..128, 42);
    println!("ghosts: {error:.1} dB");
    assert!(error < -60.0, "{error} dB");
}

#[test]
fn a_moving_body_and_its_ghosts_behind_a_curtain_that_sways() {
    let config = RadarConfig::awr1843boost();
    let mut body = RigidSurface::ellipsoid(DVec3::new(0.08, 0.05, 0.15), 0.04)
        .at(DVec3::new(-0.1, 2.0, -0.1))
        .moving(DVec3::new(0.3, -1.5, 0.2))
        .of(CLOTH);
    body.angular_velocity = DVec3::new(2.0, 0.0, 1.0);
    // Covers part of the body and of the wall.
    let mut curtain = RigidSurface::plate(0.5, 1.0, 0.05)
        .at(DVec3::new(0.1, 1.2, 0.0))
        .of(Material {
            power_reflection: 0.04,
            power_transmission: 0.8,
            ..CLOTH
        });
    curtain.angular_velocity = DVec3::new(0.3, 0.0, 0.4);
    let wall = RigidSurface::plate(3.0, 2.0, 0.25)
        .at(DVec3::new(0.6, 2.0, 0.0))
        .turned(DQuat::from_rotation_z(-1.5));
    let scene = Scene {
        surfaces: vec![&body, &curtain, &wall],
        points: vec![],
        noise: Noise::Off,
    };
    for max_bounces in [1, 3] {
        let options = SimOptions {
            max_bounces,
            bounce_rays: 64,
            ..SimOptions::default()
        };
        let error = error_with(&config, &options, &scene, 0..128, 42);
        println!("curtain, {max_bounces}: {error:.1} dB");
        assert!(error < -60.0, "{error} dB");
    }
}

#[test]
fn other_radars() {
    let base = RadarConfig::awr1843boost();
    let half = base.rx[1].x_m;
    let antenna = |x: usize, z: usize| radarllm_base::radar_config::Antenna {
        x_m: x as f64 * half,
        z_m: z as f64 * half,
    };
    let single = RadarConfig {
        tx: vec![base.tx[0]],
        rx: vec![base.rx[0]],
        n_loops: 1,
        ..base.clone()
    };
    let odd = RadarConfig {
        n_samples: 101,
        n_loops: 37,
        ..base.clone()
    };
    // 6 x 5 = 30 channels in two passes, 24 half wavelengths wide: channels in different cells.
    let wide = RadarConfig {
        tx: (0..6).map(|i| antenna(5 * i, i)).collect(),
        rx: (0..5).map(|i| antenna(i, 0)).collect(),
        n_loops: 20,
        ..base.clone()
    };
    // 300 loops of 216 us: three segments.
    let long = RadarConfig {
        n_loops: 300,
        ..base
    };
    let mut body = RigidSurface::ellipsoid(DVec3::new(0.08, 0.05, 0.15), 0.04)
        .at(DVec3::new(0.4, 2.0, 0.1))
        .moving(DVec3::new(0.3, -1.0, 0.2))
        .of(CLOTH);
    body.angular_velocity = DVec3::new(1.0, 0.0, 0.5);
    for (name, config) in [
        ("single", single),
        ("odd", odd),
        ("wide", wide),
        ("long", long),
    ] {
        let target = PointTarget::at(DVec3::new(-0.8, 2.5, 0.3), 1e-3);
        let scene = Scene {
            surfaces: vec![&body],
            points: vec![target],
            noise: Noise::Off,
        };
        let error = error_db(
            &config,
            &scene,
            0..config.n_loops,
            config.n_loops.div_ceil(4),
        );
        println!("{name}: {error:.1} dB");
        assert!(error < -60.0, "{name}: {error} dB");
    }
}

#[test]
fn two_transmitters_at_once() {
    let mut config = RadarConfig {
        multiplexing: TxMultiplexing::Bpm,
        ..RadarConfig::awr1843boost()
    };
    config.tx = vec![config.tx[0], config.tx[2]];
    let points = vec![
        PointTarget {
            position_m: DVec3::new(0.5, 2.8, 0.6),
            velocity_mps: DVec3::new(0.6, 3.4, 0.7),
            rcs_m2: 0.1,
        },
        PointTarget {
            position_m: DVec3::new(-1.2, 4.0, -0.3),
            velocity_mps: DVec3::new(0.0, -1.5, 0.2),
            rcs_m2: 0.5,
        },
    ];
    let found_db = error_db(&config, &off(points), 0..128, 16);
    println!("binary phase modulation: {found_db:.1} dB");
    assert!(found_db < -60.0, "{found_db}");
}
