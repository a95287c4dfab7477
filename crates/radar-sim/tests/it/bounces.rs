//! Paths over several surfaces against textbook formulas.

use std::f64::consts::PI;

use glam::{DQuat, DVec3};
use radarllm_base::{Material, MovingSurface, RadarConfig, RadarCube};
use radarllm_radar_sim::link::Link;
use radarllm_radar_sim::shapes::RigidSurface;
use radarllm_radar_sim::{FrameStats, Scene, SimOptions, Simulator};

use crate::common::{far_field, rcs_m2, surfaces};

const ROUGH: Material = Material {
    power_reflection: 0.0,
    roughness_m: 0.0,
    rough_albedo: 0.2,
    power_transmission: 0.0,
};

fn frame(config: &RadarConfig, scene: &Scene<'_>, max_bounces: usize) -> (RadarCube, FrameStats) {
    let options = SimOptions {
        max_bounces,
        ..SimOptions::default()
    };
    let mut simulator = Simulator::new(config, options).unwrap();
    let mut cube = simulator.new_cube();
    let stats = simulator
        .simulate_frame(scene, 0, 0.0, 1, &mut cube)
        .unwrap();
    (cube, stats)
}

/// 8 pi a^2 b^2 / lambda^2 on the axis; away from it the wings' shared aperture shrinks as
/// sqrt(2) sin(45 deg - |phi|), and its square with it.
#[test]
fn dihedral_needs_the_second_bounce() {
    let config = far_field();
    let lambda = config.wavelength_m();
    // 4 cm wings at 20 m: curvature over the 5.7 cm aperture is 0.067 rad at its ends.
    let (side, range) = (0.04_f64, 20.0);
    let centre = Link::new(&config).array_centre_m;
    let on_axis = 8.0 * PI * side.powi(4) / (lambda * lambda);
    for degrees in [0.0_f64, 5.0, -11.0, 20.0] {
        let phi = degrees.to_radians();
        let corner = RigidSurface::dihedral(side, side, 0.01)
            .at(centre + DVec3::Y * range)
            .turned(DQuat::from_rotation_z(phi));
        let found = |bounces| {
            let (cube, stats) = frame(&config, &surfaces(&[&corner]), bounces);
            (rcs_m2(&config, &cube, range), stats.n_bounces)
        };
        let expected = on_axis * 2.0 * (PI / 4.0 - phi.abs()).sin().powi(2);
        let ((single, none), (double, some)) = (found(1), found(2));
        assert_eq!(none, 0);
        assert!(some > 0);
        assert!(
            single < 0.021 * 0.021 * expected,
            "{degrees} deg: {single} {expected}"
        );
        // The rays' grid, 256 across, knows each of the aperture's four rims to half a cell: 0.8 % of
        // the area and so of the field. The wings' own echoes, 45 degrees off, are 2 / (sqrt(2) k a) =
        // 2.1 % of it at worst.
        let error = (double / expected).sqrt() - 1.0;
        assert!(error.abs() < 0.03, "{degrees} deg: {double} {expected}");
    }
}

/// 4 pi a^4 / (3 lambda^2): the third bounce makes it.
#[test]
fn trihedral_needs_the_third_bounce() {
    let config = far_field();
    let lambda = config.wavelength_m();
    let (leg, range) = (0.06_f64, 20.0);
    let centre = Link::new(&config).array_centre_m;
    let expected = 4.0 * PI * leg.powi(4) / (3.0 * lambda * lambda);
    for (yaw, pitch) in [(0.0_f64, 0.0_f64), (4.0, -3.0)] {
        let corner = RigidSurface::trihedral(leg, 0.01)
            .at(centre + DVec3::Y * range)
            .turned(
                DQuat::from_rotation_z(yaw.to_radians())
                    * DQuat::from_rotation_x(pitch.to_radians()),
            );
        let found = |bounces| {
            let (cube, _) = frame(&config, &surfaces(&[&corner]), bounces);
            rcs_m2(&config, &cube, range)
        };
        let (single, double, triple) = (found(1), found(2), found(3));
        // What one face alone sends back 55 degrees off its normal is the flash of its outer edge,
        // which all three do in phase on the axis: 3 / (k h sin 55 deg) = 5 % of the field, h = 4.2 cm
        // the triangle's height; pairs of faces, 35 degrees off their dihedral's best, about as much.
        assert!(single < 0.05 * 0.05 * expected, "{single} {expected}");
        assert!(double < 0.1 * 0.1 * expected, "{double} {expected}");
        // Single and double echoes measure 3 % of the field (0.28 dB), the rays' grid 0.8 % of the
        // aperture (0.07 dB), 5 degrees off the axis (3 dB at 20 degrees: 0.19 dB).
        let error_db = 10.0 * (triple / expected).log10();
        assert!(error_db.abs() < 0.5, "{yaw} {pitch}: {error_db} dB");
    }
}

/// A rough ball beside a metal wall: its own echo, one echo over the wall out or back (two equal
/// paths), and one over the wall both ways, at the ranges and angles of its image.
#[test]
fn a_wall_makes_ghosts_where_the_image_stands() {
    let config = RadarConfig {
        n_loops: 1,
        ..RadarConfig::awr1843boost()
    };
    let ball = RigidSurface::sphere(0.05, 0.02)
        .at(DVec3::new(-0.8, 3.0, 0.0))
        .of(ROUGH);
    // The wall stands in the plane x = 0.9 m and faces -x.
    let wall = RigidSurface::plate(6.0, 3.0, 0.1)
        .at(DVec3::new(0.9, 3.0, 0.0))
        .turned(DQuat::from_rotation_z(-PI / 2.0));
    let image = DVec3::new(2.6, 3.0, 0.0);
    let (direct_m, image_m) = (DVec3::new(-0.8, 3.0, 0.0).length(), image.length());
    let options = SimOptions {
        max_bounces: 2,
        bounce_rays: 400,
        ..SimOptions::default()
    };
    let mut simulator = Simulator::new(&config, options).unwrap();
    let mut cube = simulator.new_cube();
    // Powers by a plain discrete Fourier sum, averaged over the phases of the rough facets.
    let ranges = [direct_m, 0.5 * (direct_m + image_m), image_m, 5.2];
    let mut powers = [0.0_f64; 4];
    let solids = [ball, wall];
    let shapes: Vec<&dyn MovingSurface> = solids.iter().map(|s| s as &dyn MovingSurface).collect();
    for seed in 0..200 {
        simulator
            .simulate_frame(&surfaces(&shapes), 0, 0.0, seed, &mut cube)
            .unwrap();
        for (power, range) in powers.iter_mut().zip(ranges) {
            *power += spectrum(&config, cube.chirp(0, 0, 0), range - 0.04) / 200.0;
        }
    }
    let db = powers.map(|p| 10.0 * p.log10());
    // The patterns and 1/R^2 of each way: amplitude(p) is the two-way amplitude at p.
    let link = Link::new(&config);
    let at = |p: DVec3| f64::from(link.amplitude(p.as_vec3())).powi(2);
    let (direct, over) = (at(DVec3::new(-0.8, 3.0, 0.0)), at(image));
    // Two coherent, equal paths (out and back) at the middle range; their phases agree for the
    // monostatic part of the array within the facets' own coherence: 4 times one path's power.
    let expected_middle = 10.0 * (4.0 * (direct * over).sqrt() / direct).log10();
    let expected_far = 10.0 * (over / direct).log10();
    // Means of 200 exponential powers: 0.3 dB each, 0.45 dB their ratio; five of them.
    assert!(
        (db[1] - db[0] - expected_middle).abs() < 2.25,
        "{db:?} {expected_middle}"
    );
    assert!(
        (db[2] - db[0] - expected_far).abs() < 2.25,
        "{db:?} {expected_far}"
    );
    assert!(db[3] < db[2] - 15.0, "{db:?}");
}

/// A path over two surfaces that is longer than twice the maximum range is not received, though each of both is.
#[test]
fn paths_longer_than_twice_the_maximum_range_are_left_out() {
    // Every second sample: the maximum range is 5.495 m.
    let whole = RadarConfig {
        n_loops: 1,
        ..RadarConfig::awr1843boost()
    };
    let half = RadarConfig {
        n_samples: whole.n_samples / 2,
        sample_rate_hz: whole.sample_rate_hz / 2.0,
        ..whole.clone()
    };
    let ball = RigidSurface::sphere(0.05, 0.02)
        .at(DVec3::new(-0.8, 4.0, 0.0))
        .of(ROUGH);
    // The ball's image is at (4.0, 4.0), 5.66 m away, and the ball 4.08 m: one way over the wall makes half a path of
    // 4.87 m, both ways of 5.66 m.
    let wall = RigidSurface::plate(6.0, 3.0, 0.1)
        .at(DVec3::new(1.6, 3.0, 0.0))
        .turned(DQuat::from_rotation_z(-PI / 2.0));
    let solids = [ball, wall];
    let shapes: Vec<&dyn MovingSurface> = solids.iter().map(|s| s as &dyn MovingSurface).collect();
    let n_bounces = |config: &RadarConfig| frame(config, &surfaces(&shapes), 2).1.n_bounces;
    let (all, received) = (n_bounces(&whole), n_bounces(&half));
    // Of the three paths of a facet (out, back, both) the third is missing; a facet that is not seen directly has no
    // other.
    assert!(
        received > 0 && 3 * received <= 2 * all,
        "{received} of {all}"
    );
}

/// |sum of windowed samples at a range's beat frequency|^2.
fn spectrum(config: &RadarConfig, chirp: &[num_complex::Complex32], range_m: f64) -> f64 {
    let n = chirp.len() as f64;
    let cycles = config.slope_hz_per_s * 2.0 * range_m
        / radarllm_base::SPEED_OF_LIGHT_MPS
        / config.sample_rate_hz;
    let sum: num_complex::Complex64 = chirp
        .iter()
        .enumerate()
        .map(|(i, z)| {
            let window = 0.5 - 0.5 * (2.0 * PI * (i as f64 + 0.5) / n).cos();
            num_complex::Complex64::new(f64::from(z.re), f64::from(z.im))
                * num_complex::Complex64::from_polar(window, -2.0 * PI * cycles * i as f64)
        })
        .sum();
    sum.norm_sqr()
}
