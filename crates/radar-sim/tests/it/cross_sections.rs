//! Cross sections of surfaces against textbook formulas, one bounce each.
//!
//! What flat facets leave of a curved surface: within a facet of edge e they lie below it by up to
//! e^2 / 8 R, R the radius of curvature, which is a phase of psi = 2 k e^2 / 8 R. Its mean shifts the
//! echo; its harmonics make gratings, of which the first has the amplitude 2 psi / pi^2 (Fourier
//! series of a parabola) and sends back one echo for each of the six directions of a triangulated
//! grid. Hence [`facet_ripple`], the most that the field can be off.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DQuat, DVec3};
use num_complex::Complex64;
use radarllm_base::{Material, RadarConfig};
use radarllm_radar_sim::link::Link;
use radarllm_radar_sim::shapes::RigidSurface;
use radarllm_radar_sim::{SimOptions, Simulator};

use crate::common::{far_field, frame, monostatic, rcs_m2, short, surface};

/// Most that flat facets change a smooth surface's field, relative to the specular echo.
fn facet_ripple(config: &RadarConfig, edge_m: f64, radius_m: f64) -> f64 {
    let k = TAU / config.wavelength_m();
    let psi = 2.0 * k * edge_m * edge_m / (8.0 * radius_m);
    6.0 * 2.0 * psi / (PI * PI)
}

/// What fills the nulls of an aperture of this length at this range, relative to the peak field: the
/// wave front's curvature is a phase of psi u^2 over u in -1..1, psi = k L^2 / 4 R, whose mean against
/// cos(pi u) is 2 / pi^2 psi, in quadrature to the far field.
fn null_fill(config: &RadarConfig, length_m: f64, range_m: f64) -> f64 {
    let psi = TAU / config.wavelength_m() * length_m * length_m / (4.0 * range_m);
    2.0 * psi / (PI * PI)
}

/// Where the array stands; [`RigidSurface`]s are placed relative to it.
fn centre(config: &RadarConfig) -> DVec3 {
    Link::new(config).array_centre_m
}

fn measured(config: &RadarConfig, shape: &RigidSurface, range_m: f64) -> f64 {
    rcs_m2(config, &frame(config, &surface(shape), 1), range_m)
}

#[test]
fn plate_at_normal_incidence_and_against_angle() {
    let config = far_field();
    let lambda = config.wavelength_m();
    let (side, range) = (0.05_f64, 60.0);
    let fill = null_fill(&config, side, range);
    let peak = 4.0 * PI * side.powi(4) / (lambda * lambda);
    let at = |angle: f64| {
        let plate = RigidSurface::plate(side, side, 0.02)
            .at(centre(&config) + DVec3::Y * range)
            .turned(DQuat::from_rotation_z(angle));
        measured(&config, &plate, range)
    };
    // x = k a sin(theta): first null, first sidelobe (tan x = x), second null.
    let special = [PI, 4.493_409, TAU].map(|x| (x * lambda / (TAU * side)).asin());
    let degrees = [0.0_f64, 0.5, 1.0, 1.7, 2.2, 3.0, 4.5, 8.0];
    for angle in degrees
        .into_iter()
        .map(f64::to_radians)
        .chain(special)
        .chain(special.map(|a| -a))
    {
        let found = at(angle);
        let x = TAU / lambda * side * angle.sin();
        let sinc = if x == 0.0 { 1.0 } else { x.sin() / x };
        let expected = (angle.cos() * sinc).powi(2) * peak;
        let error = (found.sqrt() - expected.sqrt()).abs() / peak.sqrt();
        // f32 vertices at 60 m: 1.9e-6 m or 0.006 rad each way at worst, averaged over nine.
        let relative = (expected / peak).sqrt();
        let limit = 2e-3 + relative.hypot(fill) - relative;
        assert!(error < limit, "{angle} rad: {found} {expected} {limit}");
    }
    // 2e-3 and the filling are -45 dB in the null; 2e-3 are 0.08 dB of the sidelobe.
    let db = |angle| 10.0 * (at(angle) / peak).log10();
    assert!(db(special[0]) < -45.0);
    let sidelobe_db = db(special[1]) - 20.0 * special[1].cos().log10();
    assert!((sidelobe_db + 13.26).abs() < 0.08, "{sidelobe_db}");
}

/// The physical-optics sphere, edge term included: pi a^2 |1 + j (1 - e^(-j beta)) / beta|^2, beta = 2 k
/// a. Small spheres, so that the edge matters, with beta on both of its extremes.
#[test]
fn small_spheres_show_the_edge_of_their_lit_half() {
    let config = monostatic();
    let k = TAU / config.wavelength_m();
    let distance = 3.0;
    for quarter_turns in [5.0, 7.0, 11.0, 13.0] {
        let beta = quarter_turns * FRAC_PI_2;
        let radius = beta / (2.0 * k);
        let edge = 0.05 * radius;
        let sphere = RigidSurface::sphere(radius, edge).at(centre(&config) + DVec3::Y * distance);
        let found = measured(&config, &sphere, distance - radius);
        let term = Complex64::I * (1.0 - Complex64::cis(-beta)) / beta;
        let factor = (1.0 + term).norm();
        // The sphere is in the near field of its own size by a / R = 1e-3.
        let expected = PI * radius * radius * (1.0 - radius / distance).powi(2) * factor * factor;
        let error = (found / expected).sqrt() - 1.0;
        // The inscribed polyhedron is smaller by e^2 / 6 a = 4e-4 of the radius, which turns the edge
        // term by as much of beta; beyond its ripple, the rim is a polygon of 126 corners and the
        // raster's share of its facets is known to a sample (both 1e-3 of the whole).
        let limit = facet_ripple(&config, edge, radius) + 4e-4 * (1.0 + term.norm() * beta) + 2e-3;
        // Without the edge term the field would be off by 1 / beta.
        assert!(limit < 0.4 / beta, "the test sees the edge: {limit}");
        assert!(error.abs() < limit, "{quarter_turns}: {error}, {limit}");
        assert!(((factor - 1.0) * beta).abs() > 0.9);
    }
}

/// pi R1 R2 R^2 / ((R1 + R)(R2 + R)), R1 and R2 the radii of curvature at the specular point: from an
/// egg to the flat limit pi R^2.
#[test]
fn specular_points_in_the_near_field() {
    let config = monostatic();
    let here = centre(&config);
    let far = |r: f64, range: f64| if r.is_finite() { r / (r + range) } else { 1.0 };
    // An ellipsoid with half axes x, y, z has the radii x^2 / y and z^2 / y where it meets the y axis.
    let egg = |x: f64, y: f64, z: f64, edge: f64| {
        let shape = RigidSurface::ellipsoid(DVec3::new(x, y, z), edge);
        (shape, y, [x * x / y, z * z / y], edge)
    };
    // Plates and tubes reach to where the elements see nothing any more (1 m up at 0.3 m is 73
    // degrees), so that their rims do not show.
    let plate = RigidSurface::plate(1.2, 0.6, 0.005);
    let tube = RigidSurface::cylinder(0.1, 0.6, 0.004);
    for ((shape, depth, radii, edge), range) in [
        (egg(0.15, 0.15, 0.15, 0.004), 2.85),
        (egg(0.2, 0.1, 0.3, 0.004), 1.0),
        (egg(0.2, 0.1, 0.3, 0.004), 0.25),
        (egg(0.1, 0.2, 0.1, 0.002), 0.6),
        ((tube, 0.1, [0.1, f64::INFINITY], 0.004), 0.3),
        ((plate, 0.0, [f64::INFINITY; 2], 0.005), 0.3),
    ] {
        let shape = shape.at(here + DVec3::Y * (range + depth));
        let found = measured(&config, &shape, range);
        let [first, second] = radii.map(|r| far(r, range));
        let expected = PI * first * second * range * range;
        let error = (found / expected).sqrt() - 1.0;
        // What counts is the curvature against the wave front's: 1 / R + 1 / r. The pattern's bend
        // over the first Fresnel zone, ln 2 / (2 w^2 k R) with w = 14 degrees, is 1.2 % in quadrature
        // at 0.3 m, 7e-5 of the size; f32 and raster 1e-3.
        let relative_radius = radii
            .iter()
            .fold(range, |r, c| r.min(1.0 / (1.0 / c + 1.0 / range)));
        let limit = facet_ripple(&config, edge, relative_radius) + 2e-3;
        assert!(
            error.abs() < limit,
            "{radii:?} at {range} m: {error} {limit}"
        );
    }
}

/// k a L^2 broadside; tilted by theta, k a L^2 cos(theta) sinc^2(k L sin(theta)).
#[test]
fn cylinder_broadside_and_tilted() {
    let config = far_field();
    let k = TAU / config.wavelength_m();
    let (radius, length, edge, range) = (0.02, 0.05_f64, 0.0005, 60.0);
    let fill = null_fill(&config, length, range);
    let nulls = [1.0, 2.0].map(|n| (n * config.wavelength_m() / (2.0 * length)).asin());
    let peak = k * radius * length * length;
    for angle in [0.0, 0.01, 0.02, nulls[0], 0.054, nulls[1], 0.2] {
        let tube = RigidSurface::cylinder(radius, length, edge)
            .at(centre(&config) + DVec3::Y * range)
            .turned(DQuat::from_rotation_x(angle));
        let found = measured(&config, &tube, range - radius);
        let x = k * length * angle.sin();
        let sinc = if x == 0.0 { 1.0 } else { x.sin() / x };
        let expected = angle.cos() * sinc * sinc * peak;
        let error = (found.sqrt() - expected.sqrt()).abs() / peak.sqrt();
        // The rims along the tube, where cos(incidence) is 0, give 2 / (2 k a)^2 against
        // sqrt(2 pi / 2 k a): 1.5e-3. Two grating echoes (the tube is straight along its axis), f32
        // at 60 m as for the plate.
        let relative = (expected / peak).sqrt();
        let limit = relative * (facet_ripple(&config, edge, radius) / 3.0 + 1.5e-3)
            + relative.hypot(fill)
            - relative
            + 2e-3;
        assert!(error < limit, "{angle} rad: {found} {expected}");
    }
}

#[test]
fn sphere_has_the_near_field_specular_cross_section_from_every_side() {
    let config = short();
    let (radius, distance, edge) = (0.15_f64, 3.0_f64, 0.006);
    // pi a^2 (R / (R + a))^2 at the specular point R = 2.85 m (radar.md section 3).
    let expected = PI * radius * radius * ((distance - radius) / distance).powi(2);
    let limit = facet_ripple(&config, edge, radius);
    let mut errors = Vec::new();
    for turn in 0..6 {
        let sphere = RigidSurface::sphere(radius, edge)
            .at(DVec3::new(0.002, distance, 0.0))
            .turned(DQuat::from_rotation_x(0.9) * DQuat::from_rotation_y(f64::from(turn) * 0.37));
        let cube = frame(&config, &surface(&sphere), 1);
        let found = rcs_m2(&config, &cube, distance - radius);
        errors.push((found / expected).sqrt() - 1.0);
    }
    // 12 % of the field, 1 dB, if all six grating echoes agree; at random phases sqrt(3) of one, 0.3
    // dB, and the mean of six turns 0.12 dB: four of those.
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    assert!(
        mean.abs() < 4.0 * limit / 12_f64.sqrt() / 6_f64.sqrt(),
        "{errors:?}"
    );
    assert!(
        errors.iter().all(|e| e.abs() < limit),
        "{errors:?}, {limit}"
    );
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
        power_transmission: 0.0,
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
