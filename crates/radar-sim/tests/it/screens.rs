//! What lies behind a wall, a pane or a curtain.

use glam::{DQuat, DVec3};
use radarllm_base::{Material, MovingSurface, RadarConfig, RadarCube};
use radarllm_radar_sim::shapes::RigidSurface;
use radarllm_radar_sim::{Noise, Scene, SimOptions, Simulator, reference};

/// Reflects nothing, so that what comes back is the target's alone.
fn veil(power_transmission: f32) -> Material {
    Material {
        power_reflection: 0.0,
        roughness_m: 0.0,
        rough_albedo: 0.0,
        power_transmission,
    }
}

const ROUGH: Material = Material {
    power_reflection: 0.3,
    roughness_m: 0.4e-3,
    rough_albedo: 0.2,
    power_transmission: 0.0,
};

fn config() -> RadarConfig {
    RadarConfig {
        n_loops: 2,
        ..RadarConfig::awr1843boost()
    }
}

/// Fast and direct cube of a rough body before a wall at the side, behind `veils`.
fn cubes(veils: &[Material], max_bounces: usize) -> [RadarCube; 2] {
    let config = config();
    let body = RigidSurface::ellipsoid(DVec3::new(0.15, 0.1, 0.3), 0.04)
        .at(DVec3::new(0.1, 3.0, 0.0))
        .of(ROUGH);
    let wall = RigidSurface::plate(3.0, 2.0, 0.25)
        .at(DVec3::new(0.7, 3.0, 0.0))
        .turned(DQuat::from_rotation_z(-1.5));
    let veils: Vec<_> = veils
        .iter()
        .enumerate()
        .map(|(i, &material)| {
            RigidSurface::plate(4.0, 4.0, 0.2)
                .at(DVec3::Y * (1.0 + 0.1 * i as f64))
                .of(material)
        })
        .collect();
    let mut surfaces: Vec<&dyn MovingSurface> = vec![&body, &wall];
    surfaces.extend(veils.iter().map(|v| v as &dyn MovingSurface));
    let scene = Scene {
        surfaces,
        points: vec![],
        noise: Noise::Off,
    };
    let options = SimOptions {
        max_bounces,
        bounce_rays: 64,
        ..SimOptions::default()
    };
    let mut simulator = Simulator::new(&config, options.clone()).unwrap();
    let mut fast = simulator.new_cube();
    simulator
        .simulate_frame(&scene, 0, 0.0, 1, &mut fast)
        .unwrap();
    let mut slow = simulator.new_cube();
    reference::simulate_loops(&config, &options, &scene, 0.0, 1, 0..2, &mut slow).unwrap();
    [fast, slow]
}

fn power(cube: &RadarCube) -> f64 {
    cube.data.iter().map(|z| f64::from(z.norm_sqr())).sum()
}

/// Every path crosses every veil twice, ghosts over the wall as well.
#[test]
fn power_falls_by_twice_the_one_way_loss() {
    for max_bounces in [1, 3] {
        // A veil of no loss: the raster's window is the same in all.
        let clear = cubes(&[veil(1.0), veil(1.0)], max_bounces);
        for (veils, one_way) in [([0.5, 1.0], 0.5), ([0.6, 0.7], 0.42), ([1.0, 0.03], 0.03)] {
            // Ghosts end where mirrors or screens leave less than -16 dB of amplitude.
            if one_way < 0.1 && max_bounces > 1 {
                continue;
            }
            let dim = cubes(&veils.map(veil), max_bounces);
            for (dim, clear) in dim.iter().zip(&clear) {
                let found = power(dim) / power(clear);
                // Rounding of gains in f32 and, in the fast path, its error of -60 dB of the peak.
                let expected = one_way * one_way;
                assert!(
                    (found / expected - 1.0).abs() < 1e-4,
                    "{veils:?}, {max_bounces}: {found} {expected}"
                );
            }
        }
    }
}

#[test]
fn behind_an_opaque_wall_nothing_is_seen() {
    for max_bounces in [1, 3] {
        for cube in cubes(&[veil(0.8), veil(0.0)], max_bounces) {
            assert_eq!(power(&cube), 0.0);
        }
    }
}

/// A screen reflects like any surface of its power reflection, and an opaque plate hides a screen.
#[test]
fn screens_reflect_and_are_hidden() {
    let config = config();
    let frame = |surfaces: Vec<&dyn MovingSurface>| {
        let scene = Scene {
            surfaces,
            points: vec![],
            noise: Noise::Off,
        };
        let mut simulator = Simulator::new(&config, SimOptions::default()).unwrap();
        let mut cube = simulator.new_cube();
        simulator
            .simulate_frame(&scene, 0, 0.0, 1, &mut cube)
            .unwrap();
        cube
    };
    let plate = |material| {
        RigidSurface::plate(0.3, 0.3, 0.01)
            .at(DVec3::Y * 2.0)
            .of(material)
    };
    let glass = Material {
        power_reflection: 0.2,
        power_transmission: 0.7,
        ..Material::PEC
    };
    let opaque = Material {
        power_transmission: 0.0,
        ..glass
    };
    assert_eq!(frame(vec![&plate(glass)]), frame(vec![&plate(opaque)]));
    let lid = RigidSurface::plate(0.6, 0.6, 0.1)
        .at(DVec3::Y * 1.5)
        .of(veil(0.0));
    assert_eq!(power(&frame(vec![&plate(glass), &lid])), 0.0);
}
