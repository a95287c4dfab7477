//! Surfaces that stand still are computed once. The same surfaces at a speed of 1e-12 m/s are at the same places, but are
//! computed in every frame.

use glam::{DQuat, DVec3};
use radarllm_base::radar_config::TxMultiplexing;
use radarllm_base::{Material, MovingSurface, RadarConfig, RadarCube};
use radarllm_radar_sim::shapes::RigidSurface;
use radarllm_radar_sim::{FrameStats, Noise, Scene, SimOptions, Simulator, reference};
use std::f64::consts::{FRAC_PI_2, PI};

const CLOTH: Material = Material {
    power_reflection: 0.34,
    roughness_m: 0.4e-3,
    rough_albedo: 0.1,
    power_transmission: 0.0,
};
const CURTAIN: Material = Material {
    power_reflection: 0.04,
    power_transmission: 0.8,
    ..CLOTH
};

/// A room of 4 m x 5 m around the array, a metal pillar in it, and a curtain before its back wall.
fn room(pillar_x_m: f64) -> Vec<RigidSurface> {
    let wall = |width, height| RigidSurface::plate(width, height, 0.5).of(CLOTH);
    vec![
        wall(4.0, 2.6).at(DVec3::new(0.0, 4.5, 0.2)),
        wall(4.0, 2.6)
            .turned(DQuat::from_rotation_z(PI))
            .at(DVec3::new(0.0, -0.5, 0.2)),
        wall(5.0, 2.6)
            .turned(DQuat::from_rotation_z(FRAC_PI_2))
            .at(DVec3::new(-2.0, 2.0, 0.2)),
        wall(5.0, 2.6)
            .turned(DQuat::from_rotation_z(-FRAC_PI_2))
            .at(DVec3::new(2.0, 2.0, 0.2)),
        wall(4.0, 5.0)
            .turned(DQuat::from_rotation_x(-FRAC_PI_2))
            .at(DVec3::new(0.0, 2.0, -1.1)),
        RigidSurface::cylinder(0.1, 0.6, 0.1).at(DVec3::new(pillar_x_m, 3.0, -0.5)),
        RigidSurface::plate(0.6, 1.0, 0.2)
            .at(DVec3::new(-1.2, 4.2, 0.0))
            .of(CURTAIN),
    ]
}

/// Walks before the pillar and the curtain.
fn body() -> RigidSurface {
    let mut body = RigidSurface::ellipsoid(DVec3::new(0.2, 0.15, 0.6), 0.1)
        .at(DVec3::new(-0.4, 2.2, -0.4))
        .moving(DVec3::new(1.3, -0.6, 0.1))
        .of(CLOTH);
    body.angular_velocity = DVec3::new(0.5, 0.0, 1.0);
    body
}

/// The room with a speed that moves nothing within a frame, but for the computation.
fn not_quite_still(mut room: Vec<RigidSurface>) -> Vec<RigidSurface> {
    for surface in &mut room {
        surface.velocity_mps = DVec3::splat(1e-12);
    }
    room
}

fn scene<'a>(room: &'a [RigidSurface], body: Option<&'a RigidSurface>) -> Scene<'a> {
    Scene {
        surfaces: room
            .iter()
            .chain(body)
            .map(|s| s as &dyn MovingSurface)
            .collect(),
        points: vec![],
        noise: Noise::Off,
    }
}

fn options(max_bounces: usize) -> SimOptions {
    SimOptions {
        max_bounces,
        bounce_rays: 64,
        ..SimOptions::default()
    }
}

fn small() -> RadarConfig {
    RadarConfig {
        n_loops: 32,
        ..RadarConfig::awr1843boost()
    }
}

fn frame(simulator: &mut Simulator, scene: &Scene<'_>, index: u64) -> (RadarCube, FrameStats) {
    let mut cube = simulator.new_cube();
    let time_s = index as f64 * 0.1;
    let stats = simulator.simulate_frame(scene, index, time_s, 5, &mut cube);
    (cube, stats.unwrap())
}

/// Largest difference over the largest sample of `of`, dB.
fn difference_db(a: &RadarCube, b: &RadarCube, of: &RadarCube) -> f64 {
    let pairs = a.data.iter().zip(&b.data);
    let error = pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f32::max);
    let peak = of.data.iter().map(|z| z.norm()).fold(0.0, f32::max);
    20.0 * f64::from(error / peak).log10()
}

/// The samples of the loops minus their mean over the loops: what moves.
fn without_constant(cube: &RadarCube) -> RadarCube {
    let len = cube.data.len() / cube.n_loops;
    let mut out = cube.clone();
    for i in 0..len {
        let loops = cube.data.iter().skip(i).step_by(len);
        let mean = loops.sum::<num_complex::Complex32>() / cube.n_loops as f32;
        for z in out.data.iter_mut().skip(i).step_by(len) {
            *z -= mean;
        }
    }
    out
}

#[test]
fn what_stands_still_is_the_same_as_computed_in_every_frame() {
    let (room, body) = (room(0.5), body());
    let moved = not_quite_still(room.clone());
    let two_transmitters = |multiplexing| {
        let mut config = small();
        config.tx.truncate(2);
        config.multiplexing = multiplexing;
        config
    };
    let long = RadarConfig {
        n_loops: 300,
        ..RadarConfig::awr1843boost()
    };
    for (name, config, max_bounces) in [
        ("direct paths", small(), 1),
        ("three surfaces", small(), 3),
        (
            "two transmitters in turn",
            two_transmitters(TxMultiplexing::Tdm),
            2,
        ),
        (
            "two transmitters at once",
            two_transmitters(TxMultiplexing::Bpm),
            2,
        ),
        ("several segments", long, 2),
    ] {
        let plan = || Simulator::new(&config, options(max_bounces)).unwrap();
        let (mut kept, mut anew) = (plan(), plan());
        for index in 0..2 {
            let (a, of_kept) = frame(&mut kept, &scene(&room, Some(&body)), index);
            let (b, of_anew) = frame(&mut anew, &scene(&moved, Some(&body)), index);
            let error = difference_db(&a, &b, &b);
            let moving = without_constant(&b);
            let error_of_moving = difference_db(&without_constant(&a), &moving, &moving);
            println!("{name}, frame {index}: {error:.1} dB, of what moves {error_of_moving:.1} dB");
            assert!(error < -65.0, "{name}, frame {index}: {error} dB");
            let counts = |s: &FrameStats| {
                (
                    s.n_facets,
                    s.n_degenerate,
                    s.n_visible,
                    s.n_coarse,
                    s.n_bounces,
                )
            };
            assert_eq!(counts(&of_kept), counts(&of_anew), "{name}, frame {index}");
            assert!((of_kept.signal_power_w / of_anew.signal_power_w - 1.0).abs() < 1e-3);
            assert!(
                of_kept.n_nodes < of_anew.n_nodes,
                "{name}: nothing was kept"
            );
        }
    }
}

#[test]
fn a_body_in_a_room_is_the_direct_sum() {
    let (room, body) = (room(0.5), body());
    let config = small();
    let options = options(3);
    let mut simulator = Simulator::new(&config, options.clone()).unwrap();
    let scene = scene(&room, Some(&body));
    let (fast, _) = frame(&mut simulator, &scene, 3);
    let mut slow = simulator.new_cube();
    reference::simulate_loops(&config, &options, &scene, fast.time_s, 5, 0..32, &mut slow).unwrap();
    let error = difference_db(&fast, &slow, &slow);
    let moving = without_constant(&slow);
    let error_of_moving = difference_db(&without_constant(&fast), &moving, &moving);
    println!("{error:.1} dB, of what moves {error_of_moving:.1} dB");
    assert!(error < -60.0, "{error} dB");
}

#[test]
fn frames_do_not_depend_on_those_before() {
    let (one, other, body) = (room(0.5), room(0.7), body());
    let mut simulator = Simulator::new(&small(), options(3)).unwrap();
    // Other furniture, an empty room, frames in another order.
    let scenes = [
        (scene(&one, Some(&body)), 0),
        (scene(&one, Some(&body)), 1),
        (scene(&other, Some(&body)), 1),
        (scene(&one, None), 1),
        (scene(&[], Some(&body)), 1),
        (scene(&one, Some(&body)), 0),
    ];
    for (i, (scene, index)) in scenes.iter().enumerate() {
        let (again, _) = frame(&mut simulator, scene, *index);
        let mut fresh = Simulator::new(&small(), options(3)).unwrap();
        let (alone, _) = frame(&mut fresh, scene, *index);
        assert!(again.data == alone.data, "scene {i} differs");
    }
}

#[test]
fn an_empty_room_is_the_same_in_every_loop() {
    let room = room(0.5);
    let mut simulator = Simulator::new(&small(), options(2)).unwrap();
    let (cube, stats) = frame(&mut simulator, &scene(&room, None), 0);
    assert!(stats.signal_power_w > 0.0);
    let loop_len = cube.data.len() / cube.n_loops;
    let (first, rest) = cube.data.split_at(loop_len);
    assert!(rest.chunks_exact(loop_len).all(|samples| samples == first));
}
